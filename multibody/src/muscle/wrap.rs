//! A muscle line over a cylinder: the shortest path, whose length and lever arms have no jumps.
//!
//! The line is straight where it passes the cylinder and tangent to it where it touches it. Where it just touches, both are the same line.

#![allow(non_snake_case)]

use nalgebra::Vector3;

use crate::natural::{Coordinates, VectorForm};

/// A cylinder of the thigh between two points of a path.
#[derive(Clone, Debug, PartialEq)]
pub struct Wrap {
    /// The path meets it after the point of this number.
    pub after: usize,
    /// A point of its axis.
    pub centre: VectorForm,
    /// Unit directions of the thigh; the third is the axis.
    pub axes: [VectorForm; 3],
    /// Radius \[m\].
    pub radius: f64,
    /// 1 where the path turns about the axis from the first direction to the second, −1 where it turns back.
    pub sense: f64,
}

/// Where a path touches the cylinder: two points of the thigh, and the length between them along its surface \[m\].
pub struct Touch {
    /// The points, as forms of the natural coordinates.
    pub points: [VectorForm; 2],
    /// Length of the path on the cylinder \[m\].
    pub arc: f64,
}

impl Wrap {
    /// Where the shortest path from `from` to `to` \[m, ground\] touches; `None` where the straight line passes the cylinder on its side.
    pub fn touch(&self, Q: &Coordinates, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Touch> {
        let centre = self.centre.at(Q);
        let axes = [0, 1, 2].map(|k| self.axes[k].at(Q));
        // Seen from the side on which it turns counter-clockwise.
        let seen = |p: &Vector3<f64>| {
            let d = p - centre;
            (self.sense * d.dot(&axes[0]), d.dot(&axes[1]), d.dot(&axes[2]))
        };
        let ((x0, y0, z0), (x1, y1, z1)) = (seen(from), seen(to));
        let (d0, d1) = (x0.hypot(y0), x1.hypot(y1));
        // A point on the surface is its own tangent point, one of round-off inside it, too.
        let angle = |d: f64| (self.radius / d).min(1.0).acos();
        let free = |d: f64| (d * d - self.radius * self.radius).max(0.0).sqrt();
        let first = y0.atan2(x0) + angle(d0);
        let last = y1.atan2(x1) - angle(d1);
        let turn = std::f64::consts::TAU;
        let wound = (last - first) - turn * ((last - first) / turn).round();
        if wound <= 0.0 {
            return None;
        }
        // Unrolled, the path is straight.
        let arc = self.radius * wound;
        let flat = free(d0) + arc + free(d1);
        let height = |along: f64| z0 + (z1 - z0) * along / flat;
        let point = |a: f64, z: f64| {
            let local = [self.sense * self.radius * a.cos(), self.radius * a.sin(), z];
            let directions = self.axes.iter().zip(local);
            directions.fold(self.centre.clone(), |sum, (axis, c)| sum.plus(axis, c))
        };
        let points = [point(first, height(free(d0))), point(last, height(free(d0) + arc))];
        let rise = (z1 - z0) * arc / flat;
        Some(Touch { points, arc: arc.hypot(rise) })
    }
}
