//! The femur of a made knee as a solid: balls, cones, a shaft and a notch, joined smoothly.

use fem::geometry::{DistanceField, SearchSurface, SignedDistance, SurfaceError};
use nalgebra::Vector3;

use super::shape::Shape;

/// Over what distance \[m\] parts run into each other; where two are equally near, a quarter of it is added.
pub const SEAM: f64 = 6e-3;
/// Radii \[m\] of the cones from the knee to the shaft, at either end.
const CONES: [f64; 2] = [17e-3, 15e-3];
/// Where the cones begin \[m\], forward and up, and to lateral in half distances of the condyles: above both, and behind the trochlea.
const FEET: [[f64; 3]; 3] = [[13e-3, 12e-3, -0.85], [15e-3, 14e-3, 0.0], [13e-3, 12e-3, 0.85]];
/// The notch between the condyles: a rod of this radius \[m\] from behind to where the groove ends, its ends in radii of a condyle forward and up.
const NOTCH: f64 = 8e-3;
const NOTCH_ENDS: [[f64; 2]; 2] = [[-1.6, 0.0], [-0.1, -0.6]];
/// Above this height \[m\] there is the shaft, which is that of another femur.
const SHAFT_FROM: f64 = 63e-3;
/// How high \[m\] above the middle of the condyles cartilage goes, in front and behind.
const CARTILAGE_TO: [f64; 2] = [26e-3, 12e-3];
/// A point is of cartilage where it is nearer \[m\] than this to the balls, and farther from notch and sides.
const OF_BALL: f64 = 0.8e-3;

/// The femur in its own frame.
pub struct MadeFemur<'a> {
    shape: &'a Shape,
    shaft: SignedDistance<'a>,
    /// How far \[m\] the shaft is sunk.
    sunk: f64,
    /// Middle of the shaft where it begins.
    neck: Vector3<f64>,
}

/// The smooth least of two distances: less than it by a quarter of `seam` at most, where both are equal.
fn joined(a: f64, b: f64, seam: f64) -> f64 {
    let h = (1.0 - (a - b).abs() / seam).max(0.0);
    a.min(b) - 0.25 * seam * h * h
}

/// What is in both.
fn common(a: f64, b: f64, seam: f64) -> f64 {
    -joined(-a, -b, seam)
}

/// Distance to a rod whose radius goes from `r[0]` to `r[1]`.
fn rod(p: &Vector3<f64>, [a, b]: [Vector3<f64>; 2], r: [f64; 2]) -> f64 {
    let (way, to) = (b - a, p - a);
    let t = (to.dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    (to - t * way).norm() - (r[0] + t * (r[1] - r[0]))
}

impl<'a> MadeFemur<'a> {
    /// With the shaft of another femur, in the frame of this one, sunk by so much \[m\].
    pub fn new(shape: &'a Shape, shaft: &'a SearchSurface, sunk: f64) -> Result<MadeFemur<'a>, SurfaceError> {
        let mut femur = MadeFemur { shape, shaft: SignedDistance::new(shaft)?, sunk, neck: Vector3::zeros() };
        // The mean of a grid of points inside, every 2 mm.
        let place = |i: i32, k: i32| Vector3::new(2e-3 * f64::from(i), SHAFT_FROM, 2e-3 * f64::from(k));
        let grid = (-30..=30).flat_map(|i| (-30..=30).map(move |k| place(i, k)));
        let inside: Vec<_> = grid.filter(|p| femur.shaft.at(p).distance < 0.0).collect();
        femur.neck = inside.iter().sum::<Vector3<f64>>() / inside.len().max(1) as f64;
        Ok(femur)
    }

    /// Distances to the trochlea, with the fillet of its groove, and to the nearer condyle.
    fn balls(&self, p: &Vector3<f64>) -> [f64; 2] {
        let s = self.shape;
        let ball = |[x, y]: [f64; 2], z: f64, r: f64| (p - Vector3::new(x, y, z)).norm() - r;
        let [medial, lateral] = s.trochlea_radius;
        let crests =
            [ball(s.trochlea, -s.trochlea_aside, medial), ball(s.trochlea, s.trochlea_aside, lateral)];
        let condyle = |side: f64| ball([0.0; 2], side * s.condyle_aside, s.condyle_radius);
        [joined(crests[0], crests[1], SEAM), condyle(-1.0).min(condyle(1.0))]
    }

    fn notch(&self, p: &Vector3<f64>) -> f64 {
        let end = |[x, y]: [f64; 2]| self.shape.condyle_radius * Vector3::new(x, y, 0.0);
        rod(p, NOTCH_ENDS.map(end), [NOTCH; 2])
    }

    /// Its signed distance \[m\] at a point, or what seams leave of it.
    pub fn distance(&self, p: &Vector3<f64>) -> f64 {
        let [groove, condyles] = self.balls(p);
        let cone = |[x, y, aside]: [f64; 3]| {
            let foot = Vector3::new(x, y, aside * self.shape.condyle_aside);
            rod(p, [foot, self.neck], CONES)
        };
        let bone = FEET.map(cone).into_iter().fold(f64::INFINITY, |a, b| joined(a, b, SEAM));
        let joint = joined(joined(groove, condyles, SEAM), bone, SEAM);
        let joint = common(joint, p.z.abs() - self.shape.half_width, SEAM);
        let shaft = common(self.shaft.at(p).distance + self.sunk, SHAFT_FROM - p.y, SEAM);
        common(joined(joint, shaft, SEAM), -self.notch(p), 0.5 * SEAM)
    }

    /// The same as a smooth distance in a box \[m\].
    pub fn sampled(&self, [lo, hi]: [Vector3<f64>; 2], spacing: f64) -> DistanceField {
        DistanceField::new(lo, hi, spacing, |p| self.distance(p))
    }

    /// Whether a point of its surface is of cartilage.
    pub fn is_cartilage(&self, p: &Vector3<f64>) -> bool {
        let [front, behind] = CARTILAGE_TO;
        let to = if p.x > self.shape.trochlea[0] { front } else { behind };
        let [groove, condyles] = self.balls(p);
        let ball = joined(groove, condyles, SEAM);
        let is_aside = p.z.abs() > self.shape.half_width - OF_BALL;
        p.y < to && ball < OF_BALL && self.notch(p) > OF_BALL && !is_aside
    }
}
