//! Where the quadriceps pulls: its tendon as a taut string from the patella over the trochlea to the middle of the muscle.
//!
//! In the plane of the groove the string takes the foremost of all ways to the muscle that the femur leaves open: it leaves the patella
//! towards the muscle where that is free, and touches the cartilage ahead where it is not. Across that plane it goes straight. Thickness and
//! friction of the tendon are left out.

use nalgebra::{Point3, Vector3};

/// Middles of the four heads \[m\] in the frame of the femur, with their shares of the force: rectus femoris, vastus intermedius, lateralis
/// and medialis. Middles: of the volumes of the surfaces of the limb that the knee lies in. Shares: greatest isometric forces \[N\] of
/// gait2392 (`gait-data/muscles_gait2392.csv`).
const HEADS: [([f64; 3], f64); 4] = [
    ([0.0390, 0.2856, 0.0637], 1169.0),
    ([0.0328, 0.1810, 0.0479], 1365.0),
    ([0.0114, 0.1880, 0.0686], 1871.0),
    ([0.0432, 0.1459, 0.0082], 1294.0),
];
/// Half the width \[m\] of the strip of the femur over which the tendon runs: a quarter of the width of the patella, 43 mm.
const STRIP: f64 = 10e-3;

/// The tendon of the quadriceps of a femur.
#[derive(Clone, Debug)]
pub struct Tendon {
    /// Points of the cartilage of the femur in its own frame \[m\].
    cartilage: Vec<Point3<f64>>,
}

impl Tendon {
    /// Over these points of a femur, in its own frame \[m\].
    pub fn new(cartilage: Vec<Point3<f64>>) -> Tendon {
        Tendon { cartilage }
    }

    /// Unit vector of its pull on a point in the frame of the femur \[m\].
    pub fn direction(&self, from: &Point3<f64>) -> Vector3<f64> {
        let of = |(middle, share): &([f64; 3], f64)| (Point3::from(*middle) - from).normalize() * *share;
        let free = HEADS.iter().map(of).sum::<Vector3<f64>>().normalize();
        // Angle forward of straight up, in the plane of the groove, from -180 degrees on: what lies behind and below is never foremost.
        let angle = |v: &Vector3<f64>| v.x.atan2(v.y);
        let beneath = |p: &&Point3<f64>| (p.z - from.z).abs() < STRIP;
        let over = self.cartilage.iter().filter(beneath).map(|p| angle(&(p - from)));
        let foremost = over.fold(angle(&free), f64::max);
        let along = free.xy().norm();
        Vector3::new(along * foremost.sin(), along * foremost.cos(), free.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tendon_goes_to_the_muscle_or_touches_what_is_in_its_way() {
        let from = Point3::new(0.05, 0.02, 0.0);
        let free = Tendon::new(vec![Point3::new(0.03, 0.03, 0.0)]).direction(&from);
        let alone = Tendon::new(Vec::new()).direction(&from);
        assert_eq!(free, alone);
        assert!(
            (alone.norm() - 1.0).abs() < 1e-12 && alone.x < 0.0 && alone.y > 0.9 && alone.z > 0.1,
            "{alone}"
        );
        // 45 degrees ahead; as far to the side as before.
        let over = Tendon::new(vec![Point3::new(0.06, 0.03, 0.0)]).direction(&from);
        assert!(
            (over.x - over.y).abs() < 1e-12 && over.z == alone.z && (over.norm() - 1.0).abs() < 1e-12,
            "{over}"
        );
        let beside = Tendon::new(vec![Point3::new(0.06, 0.03, 0.02)]).direction(&from);
        assert_eq!(beside, alone);
    }
}
