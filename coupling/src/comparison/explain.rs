//! Why a muscle of the thigh pulls otherwise than on the rigid leg, in numbers.

use mesher::MusclePart;
use std::io::{self, Write};

use fem::effect::EffectKind;
use fem::measure::pair_forces;
use fem::plan::Plan;
use fem::run::Frame;
use nalgebra::Vector3;

use crate::fibres::matrix_factor::MatrixFactor;
use crate::fibres::{Calibration, FibreCalibration};
use crate::number::short;
use crate::steps::RigidStep;
use crate::thigh::build::Thigh;
use crate::thigh::section::belly_force;

/// Forces below this have no direction worth the name \[N\].
const LEAST_FORCE: f64 = 1.0;

/// One muscle at one step in one configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// The muscle.
    pub muscle: String,
    /// Angle between the lines of action \[deg\]: of the force through the belly, of the tangent of the belly where there is hardly any
    /// force, and of the sum of the rigid lines (with their tensions, or with their strengths).
    pub angle: f64,
    /// Force through the belly \[N\] that no activation makes: matrix, shell, and the passive tension of Hill fibres.
    pub passive: f64,
    /// Passive tension \[N\] of the lines of the rigid leg at their length, which force sharing does not know; Hill fibres only.
    pub rigid_passive: Option<f64>,
    /// Fibre length over that of the rigid leg, each musculotendon length less slack tendon; Hill fibres only.
    pub length_ratio: Option<f64>,
    /// Fraction of matrix and shell in the force through the belly; `None` where there is hardly any.
    pub matrix_share: Option<f64>,
    /// Resultant of all contact on the muscle \[N\]; `None` without contact.
    pub contact: Option<f64>,
}

/// Explains all muscles of a solved step.
pub fn explain(
    plan: &Plan,
    thigh: &Thigh,
    calibration: &Calibration,
    step: &RigidStep,
    frame: &Frame,
) -> Vec<Explanation> {
    let at = frame.snapshot();
    let touching = plan.islands.iter().any(|i| i.contact.is_some());
    let pairs = if touching { pair_forces(plan, at, [0.0; 3]) } else { Vec::new() };
    let one = |(i, muscle): (usize, &crate::thigh::build::ThighMuscle)| {
        let belly = belly_force(plan, at, muscle);
        let of = |kind| belly.section.along_of(kind, belly.tangent.into());
        let (total, tissue) = (belly.along(), of(EffectKind::Matrix) + of(EffectKind::Membrane));
        let rigid = step.muscle(&muscle.name);
        let force = Vector3::from(belly.section.total.force);
        let deformable = if force.norm() < LEAST_FORCE { belly.tangent } else { force };
        let line = rigid.map(|r| match r.force() {
            f if f.norm() >= LEAST_FORCE => f,
            _ => r.lines.iter().map(|l| l.f_max * l.direction()).sum(),
        });
        let (mut passive, mut rigid_passive, mut length_ratio) = (tissue, None, None);
        if let (FibreCalibration::Hill { muscles, units, scale }, Some(rigid)) = (&calibration.fibres, rigid)
        {
            let stretch = thigh.fibre_stretch(i, at.x);
            let shift = (stretch - muscles[i].fit.rest) * muscle.fibre_length / scale;
            passive += units[i].force(shift, 0.0);
            rigid_passive = Some(units[i].force_at(rigid, 0.0));
            length_ratio = Some(units[i].fibre_length(shift) / units[i].fibre_length_at(rigid));
        }
        let name = MusclePart::Surface.of(&muscle.name);
        let pushes = pairs.iter().filter_map(|p| {
            let sign = p.names.iter().position(|n| *n == name).map(|side| [1.0, -1.0][side])?;
            Some(sign * Vector3::from(p.wrench.force))
        });
        Explanation {
            muscle: muscle.name.clone(),
            angle: line.map_or(f64::NAN, |line: Vector3<f64>| line.angle(&deformable).to_degrees()),
            passive,
            rigid_passive,
            length_ratio,
            matrix_share: (total.abs() >= LEAST_FORCE).then_some(tissue / total),
            contact: touching.then(|| pushes.sum::<Vector3<f64>>().norm()),
        }
    };
    thigh.muscles.iter().enumerate().map(one).collect()
}

/// Head of `explanation.csv`.
pub const COLUMNS: &str =
    "step,muscle,configuration,angle_deg,passive_N,rigid_passive_N,fibre_length_ratio,matrix_share,contact_N";

/// Rows of `explanation.csv` of a step in a configuration.
pub fn write_rows(
    w: &mut dyn Write,
    step: &str,
    configuration: &str,
    rows: &[Explanation],
) -> io::Result<()> {
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.4}"));
    for e in rows {
        let columns =
            [Some(e.angle), Some(e.passive), e.rigid_passive, e.length_ratio, e.matrix_share, e.contact]
                .map(number);
        writeln!(w, "{step},{},{configuration},{}", e.muscle, columns.join(","))?;
    }
    Ok(())
}

/// `embedded.csv`: how the matrix of every embedded muscle was softened.
pub fn write_factors(w: &mut dyn Write, factors: &[MatrixFactor]) -> io::Result<()> {
    writeln!(w, "muscle,cell_mm,matrix_factor,mesh_N,grid_N,softened_N,unknowns_of_mesh,unknowns_of_grid")?;
    for f in factors {
        let MatrixFactor { muscle, cell, factor, of_mesh, of_grid, softened, unknowns: [mesh, grid] } = f;
        let cell = short(cell * 1e3);
        writeln!(w, "{muscle},{cell},{factor:.4},{of_mesh:.4},{of_grid:.4},{softened:.4},{mesh},{grid}")?;
    }
    Ok(())
}

/// `calibration.csv`: what was found about every muscle alone.
pub fn write_calibration(w: &mut dyn Write, thigh: &Thigh, calibration: &Calibration) -> io::Result<()> {
    match &calibration.fibres {
        FibreCalibration::None => Ok(()),
        FibreCalibration::Thermal(curves) => {
            writeln!(w, "muscle,contraction,force_N")?;
            for (muscle, curve) in thigh.muscles.iter().zip(curves) {
                for (contraction, force) in curve.contraction.iter().zip(&curve.force) {
                    writeln!(w, "{},{contraction:.6},{force:.3}", muscle.name)?;
                }
            }
            Ok(())
        }
        FibreCalibration::Hill { muscles, .. } => {
            writeln!(
                w,
                "muscle,rest_stretch,gain,posture,activation,stretch,rigid_N,rigid_at_fe_length_N,fe_N,error_N"
            )?;
            for m in muscles {
                for s in &m.samples {
                    let numbers = [s.rigid, s.rigid_at_length, s.found, s.found - s.rigid_at_length];
                    let numbers = numbers.map(|v| format!("{v:.3}")).join(",");
                    writeln!(
                        w,
                        "{},{:.5},{:.5},\"{}\",{},{:.5},{numbers}",
                        m.muscle, m.fit.rest, m.fit.gain, s.posture, s.activation, s.stretch
                    )?;
                }
            }
            Ok(())
        }
    }
}
