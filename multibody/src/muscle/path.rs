//! Muscle lines of action: straight segments between points fixed to segments, some active only in a range of knee
//! angles (Delp et al. 1990; Moissenet et al. 2014).
//!
//! These paths are shortened to the points that face another segment. They give forces and lever arms; their lengths
//! are not musculotendon lengths.

#![allow(non_snake_case)]

use nalgebra::Vector3;

use super::wrap::{Touch, Wrap};
use crate::joint::GENERIC_SHANK;
use crate::natural::{Coordinates, End, Pose, SegmentId, Shape, VectorForm};
use crate::tables::{number, rows};

/// Generic thigh length of the muscle geometry \[m\].
pub const GENERIC_THIGH: f64 = 0.3960;
/// Generic hip centre in the pelvis frame of Delp 1990 \[m\]: homothety centre of the pelvis points.
const GENERIC_HIP: Vector3<f64> = Vector3::new(-0.0707, -0.0661, 0.0835);

/// One point of a path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// Segment that carries it.
    pub segment: SegmentId,
    /// Position as a form of the natural coordinates.
    pub position: VectorForm,
    /// Knee angles FE (extension positive) \[rad\] in which the point exists: from ≤ FE < to.
    pub active: std::ops::Range<f64>,
}

/// One muscle line of action.
#[derive(Clone, Debug, PartialEq)]
pub struct Muscle {
    /// Name as in `muscles.csv`, e.g. `recfem`.
    pub name: String,
    /// Full name, e.g. `Rectus femoris`.
    pub full_name: String,
    /// Maximal isometric force of the gait2392 set \[N\].
    pub f_max: f64,
    /// Optimal fibre length of the gait2392 set \[m\].
    pub l_opt: f64,
    /// Origin, via points, insertion.
    pub path: Vec<PathPoint>,
    /// Cylinder that the path goes over.
    pub wrap: Option<Wrap>,
}

impl Muscle {
    /// Points of the path at knee angle `fe` \[rad, extension positive\].
    pub fn points(&self, fe: f64) -> impl Iterator<Item = &PathPoint> {
        self.path.iter().filter(move |p| p.active.contains(&fe))
    }

    /// Length of the (shortened) path \[m\].
    pub fn length(&self, Q: &Coordinates, fe: f64) -> f64 {
        let mut length = 0.0;
        self.pieces(Q, fe, |piece| match piece {
            Piece::Straight([from, to]) => length += (to.at(Q) - from.at(Q)).norm(),
            Piece::Round(arc) => length += arc,
        });
        length
    }

    /// Generalised force of unit tension: calls `add(block, force)` for every block that a point of the path touches.
    ///
    /// What presses on a cylinder is the pull of both ends of the piece that lies on it.
    pub fn unit_force(&self, Q: &Coordinates, fe: f64, mut add: impl FnMut(usize, Vector3<f64>)) {
        self.pieces(Q, fe, |piece| {
            let Piece::Straight([from, to]) = piece else { return };
            // A line that begins on its cylinder has a first piece without length, between points of one body.
            let Some(e) = (to.at(Q) - from.at(Q)).try_normalize(1e-12) else { return };
            from.terms.iter().for_each(|&(block, k)| add(block, k * e));
            to.terms.iter().for_each(|&(block, k)| add(block, -k * e));
        });
    }

    /// The pieces of the path, from the origin on.
    fn pieces(&self, Q: &Coordinates, fe: f64, mut each: impl FnMut(Piece)) {
        let mut previous: Option<&PathPoint> = None;
        for (k, point) in self.points(fe).enumerate() {
            let Some(before) = previous.replace(point) else { continue };
            let (from, to) = (&before.position, &point.position);
            let wrap = self.wrap.as_ref().filter(|wrap| wrap.after + 1 == k);
            match wrap.and_then(|wrap| wrap.touch(Q, &from.at(Q), &to.at(Q))) {
                Some(Touch { points: [first, last], arc }) => {
                    each(Piece::Straight([from, &first]));
                    each(Piece::Round(arc));
                    each(Piece::Straight([&last, to]));
                }
                None => each(Piece::Straight([from, to])),
            }
        }
    }
}

/// A piece of a path.
enum Piece<'a> {
    /// Between two points.
    Straight([&'a VectorForm; 2]),
    /// On a cylinder, of this length \[m\].
    Round(f64),
}

/// Knee angle FE \[rad, extension positive\] that switches the conditional points: the Z rotation of the sequence
/// Z, Y', X'' between thigh axes with Z = w (Y along w × u) and the shank SCS.
pub fn knee_angle(shapes: &[Shape; 5], Q: &Coordinates) -> f64 {
    let u = crate::natural::block(Q, SegmentId::Thigh.block(0));
    let w = crate::natural::block(Q, SegmentId::Thigh.block(3));
    let z = w.normalize();
    let y = w.cross(&u).normalize();
    let x = y.cross(&z);
    let Pose { R, .. } = shapes[SegmentId::Shank.index()].pose(SegmentId::Shank, Q);
    let shank_x = R.column(0);
    // R = Rz(a) Ry(b) Rx(c): the first column is (cos a cos b, sin a cos b, −sin b).
    shank_x.dot(&y).atan2(shank_x.dot(&x))
}

/// The 43 muscles of `muscles.csv` on a subject.
///
/// `hip`: hip centre in pelvis SCS from rP \[m\].
pub fn muscles(shapes: &[Shape; 5], hip: &Vector3<f64>) -> Vec<Muscle> {
    let points = rows(include_str!("../../../gait-data/muscle_points.csv"));
    let s_shank = shapes[SegmentId::Shank.index()].L / GENERIC_SHANK;
    let s_thigh = shapes[SegmentId::Thigh.index()].L / GENERIC_THIGH;
    let table = rows(include_str!("../../../gait-data/muscles.csv"));
    let place = |row: &std::collections::HashMap<String, String>| {
        let c = Vector3::from(["x_m", "y_m", "z_m"].map(|column| number(row, column)));
        let (segment, position, end) = match (row["segment"].as_str(), row["anchor"].as_str()) {
            ("pelvis", _) => (SegmentId::Pelvis, hip + s_thigh * (c - GENERIC_HIP), End::Proximal),
            ("thigh", "P(hip)") => (SegmentId::Thigh, s_thigh * c, End::Proximal),
            ("thigh", "D(knee)") => {
                (SegmentId::Thigh, s_thigh * (c + Vector3::new(0.0, GENERIC_THIGH, 0.0)), End::Distal)
            }
            ("patella", _) => (SegmentId::Patella, s_thigh * c, End::Distal),
            ("shank", "P(knee)") => (SegmentId::Shank, s_shank * c, End::Proximal),
            ("shank", "D(ankle)") => {
                (SegmentId::Shank, s_shank * (c + Vector3::new(0.0, GENERIC_SHANK, 0.0)), End::Distal)
            }
            // From the calcaneus frame to the talus and to the malleoli.
            ("foot", _) => {
                let shift = Vector3::new(-0.04877, -0.04195, 0.00792)
                    + Vector3::new(0.0, GENERIC_SHANK - 0.4260, 0.0);
                (SegmentId::Foot, s_shank * (c + shift), End::Proximal)
            }
            (segment, anchor) => panic!("muscle_points.csv: segment `{segment}` anchored at `{anchor}`"),
        };
        let position = shapes[segment.index()].point(segment, &position, end);
        PathPoint { segment, position, active: condition(&row["active_when"]) }
    };
    table
        .iter()
        .map(|row| Muscle {
            name: row["name"].clone(),
            full_name: row["full_name"].clone(),
            f_max: number(row, "fmax_gait2392_N"),
            l_opt: number(row, "opt_fibre_length_m_gait2392"),
            path: points.iter().filter(|p| p["muscle"] == row["name"]).map(place).collect(),
            wrap: None,
        })
        .collect()
}

/// Points of a muscle in the frames of the generic segments that carry them \[m\], in the order of the table.
pub(super) fn generic_points(muscle: &str) -> Vec<Vector3<f64>> {
    let table = rows(include_str!("../../../gait-data/muscle_points.csv"));
    let of_muscle = table.iter().filter(|row| row["muscle"] == muscle);
    of_muscle.map(|row| Vector3::from(["x_m", "y_m", "z_m"].map(|column| number(row, column)))).collect()
}

/// Reads `always`, `FE>=a`, `FE<b` or `FE<b and FE>=a` (degrees) as a half-open range \[rad\].
fn condition(text: &str) -> std::ops::Range<f64> {
    let mut range = f64::NEG_INFINITY..f64::INFINITY;
    for part in text.split(" and ") {
        let part: String = part.chars().filter(|c| !c.is_whitespace()).collect();
        let degrees = |s: &str| {
            s.trim_end_matches("deg")
                .parse::<f64>()
                .unwrap_or_else(|_| panic!("muscle_points.csv: condition `{text}`"))
                .to_radians()
        };
        if let Some(from) = part.strip_prefix("FE>=") {
            range.start = degrees(from);
        } else if let Some(to) = part.strip_prefix("FE<") {
            range.end = degrees(to);
        } else {
            assert_eq!(part, "always", "muscle_points.csv: condition `{text}`");
        }
    }
    range
}
