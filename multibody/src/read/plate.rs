//! Force plates of C3D type 2: three forces and three moments per plate.
//!
//! Axes of the plate: x from corner 2 to 1, y from corner 4 to 1, z = x × y, pointing down. Channel Fz is negative under
//! load, so the forces, turned to the axes of the file, are those of the ground on the foot.

#![allow(non_snake_case)]

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::{AnalogRecording, malformed};
use crate::error::{InputError, Place};

/// Place and wiring of one plate.
#[derive(Clone, Debug, PartialEq)]
pub struct ForcePlate {
    /// Number of the plate, 1-based.
    pub number: usize,
    /// C3D type; only type 2 can be evaluated.
    pub kind: usize,
    /// Corners of the surface in file axes \[m\].
    pub corners: [Vector3<f64>; 4],
    /// From the point that the moments refer to, to the centre of the surface, in plate axes \[m\].
    pub origin: Vector3<f64>,
    /// Analog channels of Fx, Fy, Fz, Mx, My, Mz, 0-based.
    pub channels: Vec<usize>,
}

/// One sample of one plate, in plate axes, about the centre of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateLoad {
    /// Force of the ground on the foot \[N\].
    pub force: Vector3<f64>,
    /// Moment of the ground on the foot \[N·m\].
    pub moment: Vector3<f64>,
}

impl ForcePlate {
    /// Centre of the surface in file axes \[m\].
    pub fn centre(&self) -> Vector3<f64> {
        self.corners.iter().sum::<Vector3<f64>>() / 4.0
    }

    /// Rotation from plate to file axes. Unit columns; the corners were tested when the file was read.
    pub fn axes(&self) -> Matrix3<f64> {
        let [c1, c2, _, c4] = self.corners;
        let x = (c1 - c2).normalize();
        let z = x.cross(&(c1 - c4)).normalize();
        Matrix3::from_columns(&[x, z.cross(&x), z])
    }

    /// All samples. `file` is named in errors.
    pub fn loads(&self, file: &Path, analog: &AnalogRecording) -> Result<Vec<PlateLoad>, InputError> {
        let refuse = |problem: String, remedy: &str| Err(malformed(file, Place::Whole, problem, remedy));
        if self.kind != 2 {
            return refuse(
                format!("force plate {} is of type {}, only type 2 is read", self.number, self.kind),
                "export forces and moments (type 2)",
            );
        }
        let mut columns = Vec::new();
        for (k, &channel) in self.channels.iter().enumerate() {
            let Some(values) = analog.values.get(channel) else {
                return refuse(
                    format!(
                        "force plate {} uses analog channel {}, the file has {}",
                        self.number,
                        channel + 1,
                        analog.values.len()
                    ),
                    "correct FORCE_PLATFORM:CHANNEL",
                );
            };
            let (unit, wanted) = (analog.units[channel].as_str(), if k < 3 { "N" } else { "N m" });
            if unit != wanted {
                return refuse(
                    format!(
                        "channel `{}` of force plate {} has unit `{unit}`, wanted {wanted}",
                        analog.names[channel], self.number
                    ),
                    "correct ANALOG:UNITS (N, Nmm or Nm)",
                );
            }
            columns.push(values);
        }
        let [Fx, Fy, Fz, Mx, My, Mz] = columns[..] else {
            return refuse(
                format!("force plate {} has {} channels, wanted 6", self.number, columns.len()),
                "correct FORCE_PLATFORM:CHANNEL",
            );
        };
        let load = |i: usize| {
            let force = Vector3::new(Fx[i], Fy[i], Fz[i]);
            // Moment about C from the one about O: M_C = M_O + F × (C − O).
            PlateLoad { force, moment: Vector3::new(Mx[i], My[i], Mz[i]) + force.cross(&self.origin) }
        };
        Ok((0..analog.time.len()).map(load).collect())
    }

    /// Force of the ground on the foot in file axes \[N\].
    pub fn force(&self, load: &PlateLoad) -> Vector3<f64> {
        self.axes() * load.force
    }

    /// Moment of the ground on the foot about the origin of the file, in file axes \[N·m\].
    pub fn moment_about_file_origin(&self, load: &PlateLoad) -> Vector3<f64> {
        let R = self.axes();
        R * load.moment + self.centre().cross(&(R * load.force))
    }

    /// Where the force pierces the surface, in file axes \[m\]; `None` without vertical force.
    pub fn centre_of_pressure(&self, load: &PlateLoad) -> Option<Vector3<f64>> {
        local_centre_of_pressure(load).map(|p| self.centre() + self.axes() * p)
    }

    /// Moment about the plate's z through the centre of pressure \[N·m\]; `None` without vertical force.
    pub fn free_moment(&self, load: &PlateLoad) -> Option<f64> {
        local_centre_of_pressure(load).map(|p| load.moment.z - p.x * load.force.y + p.y * load.force.x)
    }
}

/// From M = p × F + (0, 0, T) with p in the surface.
fn local_centre_of_pressure(load: &PlateLoad) -> Option<Vector3<f64>> {
    let p = Vector3::new(-load.moment.y / load.force.z, load.moment.x / load.force.z, 0.0);
    p.iter().all(|c| c.is_finite()).then_some(p)
}
