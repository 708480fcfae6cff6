//! What the viewer colours the muscles by: values at the nodes.
//!
//! Values of cells ([`fem::parts::fields`]) become values of nodes as the mean over the cells of one muscle around them.

use fem::geometry::{SearchSurface, SignedDistance, Surface};
use fem::measure::contact_tractions;
use fem::parts::fields;
use fem::plan::Plan;
use fem::run::Frame;
use mesher::MusclePart;
use nalgebra::Vector3;
use rayon::prelude::*;

use coupling::thigh::build::Thigh;

/// How the colours of a field run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    /// From zero up.
    Up,
    /// To both sides of a value that means rest.
    About(f64),
}

/// What a field is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Field {
    /// Name in the script.
    pub key: &'static str,
    /// For people.
    pub label: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// Colours.
    pub scale: Scale,
    /// One sentence below the viewer.
    pub about: &'static str,
}

/// All fields, in the order of [`nodal_values`].
pub(super) const FIELDS: [Field; 5] = [
    Field {
        key: "von_mises",
        label: "von Mises stress",
        unit: "kPa",
        scale: Scale::Up,
        about: "Cauchy stress of the matrix, without the fibres.",
    },
    Field {
        key: "pressure",
        label: "pressure in the muscle",
        unit: "kPa",
        scale: Scale::About(0.0),
        about: "Minus the mean Cauchy stress of the matrix; compression is positive.",
    },
    Field {
        key: "stretch",
        label: "fibre stretch",
        unit: "",
        scale: Scale::About(1.0),
        about: "Present over reference length of the fibre segments.",
    },
    Field {
        key: "contact",
        label: "contact pressure",
        unit: "kPa",
        scale: Scale::Up,
        about: "Contact force per area of the undeformed surface.",
    },
    Field {
        key: "overlap",
        label: "depth inside other muscles",
        unit: "mm",
        scale: Scale::Up,
        about: "How deep the surface lies inside another muscle: without contact nothing keeps muscles apart.",
    },
];

/// Values of every field at every node of the plan's mesh; not a number where a field has none.
pub(super) fn nodal_values(plan: &Plan, thigh: &Thigh, frame: &Frame) -> [Vec<f64>; FIELDS.len()] {
    let (_, cells) = fields(plan, frame);
    let of_cells = |name: &str, scale: f64, block: &dyn Fn(&str) -> bool| {
        let values = cells.iter().find(|f| f.name == name).map(|f| f.values.as_ref());
        to_nodes(plan, values, scale, block)
    };
    let muscle = |name: &str| thigh.muscles.iter().any(|m| m.name == name);
    [
        of_cells("von_mises_Pa", 1e-3, &muscle),
        of_cells("pressure_Pa", 1e-3, &muscle),
        of_cells("stretch", 1.0, &|block| {
            thigh.muscles.iter().any(|m| MusclePart::Fibres.of(&m.name) == block)
        }),
        contact_pressure(plan, thigh, frame),
        overlap_depth(plan, thigh, frame),
    ]
}

/// Mean over the cells around each node; `block` says which blocks count.
fn to_nodes(plan: &Plan, values: Option<&[f64]>, scale: f64, block: &dyn Fn(&str) -> bool) -> Vec<f64> {
    let mut sums = vec![(0.0, 0u32); plan.mesh.points.len()];
    let mut first = 0;
    for b in &plan.mesh.blocks {
        if let Some(values) = values.filter(|_| block(&b.name)) {
            for (nodes, value) in b.cells().zip(&values[first..]).filter(|(_, v)| v.is_finite()) {
                for &n in nodes {
                    sums[n as usize].0 += value;
                    sums[n as usize].1 += 1;
                }
            }
        }
        first += b.n_cells();
    }
    sums.into_iter().map(|(sum, n)| if n == 0 { f64::NAN } else { scale * sum / f64::from(n) }).collect()
}

/// Contact pressure \[kPa\] at the surfaces of the muscles; nowhere a number without contact.
fn contact_pressure(plan: &Plan, thigh: &Thigh, frame: &Frame) -> Vec<f64> {
    let mut values = vec![f64::NAN; plan.mesh.points.len()];
    if plan.absent.contains(&"contact") {
        return values;
    }
    for muscle in &thigh.muscles {
        let surface = MusclePart::Surface.of(&muscle.name);
        for &n in thigh.mesh.surfaces[&surface].iter().flatten() {
            values[n as usize] = 0.0;
        }
        for (n, traction) in contact_tractions(plan, frame.snapshot(), &surface) {
            values[n as usize] = 1e-3 * Vector3::from(traction).norm();
        }
    }
    values
}

/// Depth \[mm\] at which the surface nodes of a muscle lie inside another muscle, zero outside all of them.
fn overlap_depth(plan: &Plan, thigh: &Thigh, frame: &Frame) -> Vec<f64> {
    let points = frame.x.as_chunks::<3>().0;
    let skins: Vec<(SearchSurface, Vec<u32>)> = thigh
        .muscles
        .iter()
        .map(|m| {
            let (surface, nodes) =
                Surface::from_faces(points, &thigh.mesh.surfaces[&MusclePart::Surface.of(&m.name)]);
            (SearchSurface::new(surface), nodes)
        })
        .collect();
    let depths: Vec<Vec<(u32, f64)>> = (0..skins.len())
        .into_par_iter()
        .map(|i| {
            let mut deepest: Vec<(u32, f64)> = skins[i].1.iter().map(|&n| (n, 0.0)).collect();
            for (j, (other, _)) in skins.iter().enumerate() {
                let (low, high) = other.surface().bounds();
                // A surface with borders has no inside.
                let Some(distance) = (i != j).then(|| SignedDistance::new(other).ok()).flatten() else {
                    continue;
                };
                for (n, depth) in &mut deepest {
                    let p = Vector3::from(points[*n as usize]);
                    if (0..3).all(|c| p[c] >= low[c] && p[c] <= high[c]) {
                        *depth = depth.max(-1e3 * distance.at(&p).distance);
                    }
                }
            }
            deepest
        })
        .collect();
    let mut values = vec![f64::NAN; plan.mesh.points.len()];
    for (n, depth) in depths.into_iter().flatten() {
        values[n as usize] = depth;
    }
    values
}
