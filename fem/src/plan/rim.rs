//! Rims of surfaces under pressure: how their nodes may move, and whether an energy gives the force of the pressure then.
//!
//! A displacement δx of the rim adds the volume ∫ δx·n da of the strips that the rim has swept. That vanishes, and p V is the potential of
//! the pressure on the surface alone, if for every edge of the rim there is a plane in which both its nodes start and stay.

use super::{Motion, SceneError, Slide};
use crate::mesh::{Mesh, edge_counts};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// Sine of the angle between an edge and the plane in which it slides that still counts as none. The strip that it sweeps then adds forces
/// below this fraction of the pressure on the strip; coordinates of single precision, or written with six digits, are good for it.
const TILT: f64 = 1e-5;
/// Relative difference of displacements that counts as none.
const ROUND_OFF: f64 = 1e-9;

/// Every node of the rim of a surface with the projector onto the directions in which it is not prescribed; empty where the surface is
/// closed. Refuses faces that turn opposite ways, and rims on which pressure has no potential.
pub fn rim(
    user: &str,
    faces: &[[u32; 4]],
    mesh: &Mesh,
    (motion, slides): (&[[Motion; 3]], &[Slide]),
) -> Result<BTreeMap<u32, Matrix3<f64>>, SceneError> {
    let mut rim = BTreeMap::new();
    for (edge, [forwards, backwards]) in edge_counts(faces) {
        match forwards.abs_diff(backwards) {
            0 => continue,
            1 => {}
            _ => return Err(SceneError::Orientation { user: user.to_string(), nodes: edge }),
        }
        if let Some(how) = leaves(edge, mesh, motion, slides) {
            return Err(SceneError::OpenRim { user: user.to_string(), nodes: edge, how });
        }
        rim.extend(edge.map(|n| (n, free_directions(&motion[n as usize], slides))));
    }
    Ok(rim)
}

/// How an edge leaves the plane in which it should stay; `None` where it does not.
fn leaves(edge: [u32; 2], mesh: &Mesh, motion: &[[Motion; 3]], slides: &[Slide]) -> Option<&'static str> {
    let [a, b] = edge.map(|n| &motion[n as usize]);
    let [p, q] = edge.map(|n| Vector3::from(mesh.points[n as usize]));
    let eigen = (free_directions(a, slides) + free_directions(b, slides)).symmetric_eigen();
    let normals: Vec<usize> = (0..3).filter(|&i| eigen.eigenvalues[i] < 1e-9).collect();
    match normals[..] {
        [] => Some("moves freely"),
        [only] => {
            let normal = Vector3::from(eigen.eigenvectors.column(only));
            if (q - p).dot(&normal).abs() > TILT * (q - p).norm() {
                return Some("slides in a plane in which it does not lie");
            }
            (!go_together(a, b, &normal, slides)).then_some("is taken out of its plane by what is prescribed")
        }
        // Along one line, or not at all: such a line and the edge always have a plane in common.
        _ => None,
    }
}

/// Projector onto the directions in which a node is not prescribed.
fn free_directions(motion: &[Motion; 3], slides: &[Slide]) -> Matrix3<f64> {
    if let Motion::Slides(of) = motion[0] {
        // What it takes over from another node is not prescribed.
        let slide = &slides[of as usize];
        return slide
            .follows
            .map_or(slide.free, |(_, _, w)| slide.free + w * w.transpose() / w.norm_squared());
    }
    let free = motion.map(|m| f64::from(u8::from(matches!(m, Motion::Free | Motion::Follows(_)))));
    Matrix3::from_diagonal(&free.into())
}

/// How far each control moves a node \[m\]; `None` where a body moves it.
fn moved(motion: &[Motion; 3], slides: &[Slide]) -> Option<BTreeMap<usize, Vector3<f64>>> {
    let mut by = BTreeMap::new();
    for (c, m) in motion.iter().enumerate() {
        match m {
            Motion::Control(control, u) => by.entry(*control).or_insert_with(Vector3::zeros)[c] += u,
            Motion::Body(_) | Motion::Rides(_) | Motion::Mean(_) => return None,
            Motion::Slides(of) if c == 0 => {
                slides[*of as usize]
                    .by
                    .iter()
                    .for_each(|(control, u)| *by.entry(*control).or_insert_with(Vector3::zeros) += u);
            }
            Motion::Slides(_) | Motion::Held | Motion::Free | Motion::Follows(_) => {}
        }
    }
    Some(by)
}

/// Whether every control moves two nodes by the same length along a direction.
fn go_together(a: &[Motion; 3], b: &[Motion; 3], direction: &Vector3<f64>, slides: &[Slide]) -> bool {
    let (Some(a), Some(b)) = (moved(a, slides), moved(b, slides)) else { return false };
    a.keys().chain(b.keys()).all(|control| {
        let [a, b] = [&a, &b].map(|by| by.get(control).copied().unwrap_or_default());
        (a - b).dot(direction).abs() <= ROUND_OFF * a.norm().max(b.norm())
    })
}
