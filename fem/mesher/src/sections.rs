//! Cross-sections of a muscle along its line, and the reader of their table (`gait-data/thigh/muscle_sections.csv`).

use std::path::Path;

use nalgebra::Vector3;

use super::table::{Table, bad};
use fem::mesh::MeshError;

/// Boundary points of a section.
pub const N_OUTLINE: usize = 14;
/// Outline parameters of the four corners: side 1 from 0 to 5, end B to 7, side 2 to 12, end A back to 14 = 0.
pub const CORNERS: [f64; 4] = [0.0, 5.0, 7.0, 12.0];

/// Lengths of muscles that are believed \[m\]; outside, the table is not in mm.
const LENGTHS: std::ops::RangeInclusive<f64> = 5e-3..=1.5;
/// Least distance of neighbouring boundary points \[m\].
const LEAST_STEP: f64 = 1e-6;
/// How far a direction may be from unit length, in a table of four decimals.
const UNIT_TOLERANCE: f64 = 1e-2;

/// One cross-section.
#[derive(Clone, Debug, PartialEq)]
pub struct Station {
    /// Fraction of the length of the line through the centres, 0 at the origin and 1 at the insertion.
    pub s: f64,
    /// Centre \[m\].
    pub centre: Vector3<f64>,
    /// Unit normal towards the insertion.
    pub normal: Vector3<f64>,
    /// Unit in-plane axis from end B towards end A, orthogonal to the normal.
    pub axis: Vector3<f64>,
    /// Boundary points \[m\], counter-clockwise about the normal; not exactly in one plane.
    pub outline: [Vector3<f64>; N_OUTLINE],
}

/// The sections of one muscle from origin to insertion, limb frame, m.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleSections {
    /// Name, e.g. `rectus_femoris`.
    pub name: String,
    /// At least two, s increasing from 0 to 1.
    pub stations: Vec<Station>,
}

impl MuscleSections {
    /// Reads the table of sections: a header, then one row per section in mm, muscle by muscle. `file` is the name for messages.
    ///
    /// Refuses, with the line: columns that are missing, numbers that are not, stations out of order, axes that are no unit
    /// vectors, outlines that run clockwise or cross themselves, sections that cross their neighbour, and lengths that
    /// are no muscle's.
    pub fn read_csv(text: &str, file: &Path) -> Result<Vec<MuscleSections>, MeshError> {
        let mut table = Table::read(text, file)?;
        let mut muscles: Vec<MuscleSections> = Vec::new();
        let mut lines: Vec<Vec<usize>> = Vec::new();
        for row in table.rows() {
            let row = row?;
            let name = row.cell("muscle")?;
            if name.is_empty() {
                return Err(row.bad("the muscle has no name".into()));
            }
            let previous = muscles.last_mut().filter(|m| m.name == name);
            let expected = previous.as_ref().map_or(0, |m| m.stations.len());
            let station = row.number("station")?;
            if station != expected as f64 {
                let reason = format!(
                    "station {station} of `{name}` where {expected} was expected; list each muscle once, its stations in order from 0"
                );
                return Err(row.bad(reason));
            }
            let unit = |what: &str, v: Vector3<f64>| {
                if (v.norm() - 1.0).abs() <= UNIT_TOLERANCE {
                    return Ok(v.normalize());
                }
                Err(row.bad(format!("{what} of `{name}` has length {}, not 1", v.norm())))
            };
            let normal = unit("the normal", row.vector(["nx", "ny", "nz"])?)?;
            let axis = unit("the axis", row.vector(["ax", "ay", "az"])?)?;
            if axis.dot(&normal).abs() > UNIT_TOLERANCE {
                return Err(row.bad(format!(
                    "axis and normal of `{name}` are not orthogonal (their product is {})",
                    axis.dot(&normal)
                )));
            }
            let axis = (axis - normal * axis.dot(&normal)).normalize();
            let across = normal.cross(&axis);
            let centre = row.vector(["cx", "cy", "cz"])? / 1000.0;
            let mut outline = [Vector3::zeros(); N_OUTLINE];
            for (k, point) in outline.iter_mut().enumerate() {
                let uvw = row.vector([&format!("u{k}"), &format!("v{k}"), &format!("w{k}")])? / 1000.0;
                *point = centre + axis * uvw.x + across * uvw.y + normal * uvw.z;
            }
            let section = Station { s: row.number("s")?, centre, normal, axis, outline };
            match previous {
                Some(muscle) => muscle.stations.push(section),
                None => {
                    if muscles.iter().any(|m| m.name == name) {
                        return Err(row.bad(format!("`{name}` appears a second time; list each muscle once")));
                    }
                    lines.push(Vec::new());
                    muscles.push(MuscleSections { name: name.into(), stations: vec![section] });
                }
            }
            lines.last_mut().expect("a muscle was begun").push(row.line);
        }
        if muscles.is_empty() {
            return Err(bad(file, 1, "the table has no sections".into()));
        }
        for (i, muscle) in muscles.iter().enumerate() {
            muscle.check().map_err(|(station, reason)| {
                bad(file, lines[i][station], format!("`{}`, station {station}: {reason}", muscle.name))
            })?;
        }
        Ok(muscles)
    }

    /// Can these sections be lofted? The first station that cannot, and why.
    pub fn check(&self) -> Result<(), (usize, String)> {
        let last = self.stations.len().saturating_sub(1);
        if last == 0 {
            return Err((0, "one section does not make a muscle; give at least two".into()));
        }
        let length: f64 = self.stations.windows(2).map(|w| (w[1].centre - w[0].centre).norm()).sum();
        if !LENGTHS.contains(&length) {
            return Err((
                0,
                format!(
                    "the muscle is {length:.4} m long; lengths of the table are in mm, and muscles of {} to {} m are believed",
                    LENGTHS.start(),
                    LENGTHS.end()
                ),
            ));
        }
        for (i, station) in self.stations.iter().enumerate() {
            let fail = |reason: String| Err((i, reason));
            if (i == 0 && station.s != 0.0) || (i == last && station.s != 1.0) {
                return fail(format!(
                    "s is {}; it runs from 0 at the first to 1 at the last section",
                    station.s
                ));
            }
            if i > 0 && station.s <= self.stations[i - 1].s {
                return fail(format!("s is {}, not above that of the section before", station.s));
            }
            let size = station.outline.iter().map(|p| (p - station.centre).norm()).fold(0.0, f64::max);
            if size > length.max(0.3) {
                return fail(format!(
                    "a boundary point lies {size:.3} m from the centre; is the table in mm?"
                ));
            }
            for k in 0..N_OUTLINE {
                if !((station.outline[(k + 1) % N_OUTLINE] - station.outline[k]).norm() > LEAST_STEP) {
                    return fail(format!("boundary points {k} and {} coincide", (k + 1) % N_OUTLINE));
                }
            }
            let area = station.polygon_area();
            if !(area > 0.0) {
                return fail(format!(
                    "the outline has the area {:.1} mm² about its normal; it must run counter-clockwise",
                    area * 1e6
                ));
            }
            if let Some([a, b]) = station.crossing_edges() {
                return fail(format!("the outline crosses itself: edge {a} and edge {b}"));
            }
            if i > 0 {
                let before = &self.stations[i - 1];
                let mean = before.normal + station.normal;
                for k in 0..N_OUTLINE {
                    if !((station.outline[k] - before.outline[k]).dot(&mean) > 0.0) {
                        return fail(format!(
                            "boundary point {k} does not advance from the section before: the sections cross"
                        ));
                    }
                }
            }
        }
        Ok(())
    }
}

impl Station {
    /// Boundary points in the plane of the section, from the centre \[m\].
    fn plane_points(&self) -> [[f64; 2]; N_OUTLINE] {
        let across = self.normal.cross(&self.axis);
        self.outline.map(|p| [(p - self.centre).dot(&self.axis), (p - self.centre).dot(&across)])
    }

    /// Area of the polygon of boundary points about the normal \[m²\]; negative where it runs clockwise.
    pub fn polygon_area(&self) -> f64 {
        let p = self.plane_points();
        (0..N_OUTLINE).map(|k| cross(p[k], p[(k + 1) % N_OUTLINE])).sum::<f64>() / 2.0
    }

    /// Two edges of the outline that cross, seen along the normal.
    fn crossing_edges(&self) -> Option<[usize; 2]> {
        let p = self.plane_points();
        let edge = |i: usize| (p[i], p[(i + 1) % N_OUTLINE]);
        for i in 0..N_OUTLINE {
            for j in i + 2..N_OUTLINE {
                if (i, j) == (0, N_OUTLINE - 1) {
                    continue; // neighbours
                }
                let ((a, b), (c, d)) = (edge(i), edge(j));
                let side = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| cross(minus(b, a), minus(c, a));
                if side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0 {
                    return Some([i, j]);
                }
            }
        }
        None
    }
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
