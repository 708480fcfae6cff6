//! Poses of rigid bodies.

/// Pose of a body: the map of its points from the mesh as read to where they are \[m\].
pub type Pose = nalgebra::Isometry3<f64>;

/// The pose a fraction `t` of the way from `a` to `b`: the rotation about one axis at constant rate, the point `about`
/// (in the mesh as read, m) on a straight line.
pub fn interpolate(a: &Pose, b: &Pose, about: nalgebra::Point3<f64>, t: f64) -> Pose {
    let between = (b.rotation * a.rotation.inverse()).scaled_axis();
    let rotation = nalgebra::UnitQuaternion::from_scaled_axis(between * t) * a.rotation;
    let place = (a * about).coords.lerp(&(b * about).coords, t);
    Pose::from_parts(nalgebra::Translation3::from(place - rotation * about.coords), rotation)
}

/// Force and moment about a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force \[N\].
    pub force: [f64; 3],
    /// Moment \[N·m\] about the stated point.
    pub moment: [f64; 3],
}

impl Wrench {
    /// Adds a force \[N\] that acts at `arm` \[m\] from the point of reference.
    pub fn add(&mut self, arm: [f64; 3], f: [f64; 3]) {
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            self.force[i] += f[i];
            self.moment[i] += arm[j] * f[k] - arm[k] * f[j];
        }
    }
}
