//! Signed distance of points to a closed surface.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::distance::Part;
use super::{SearchSurface, SurfaceError};

/// Signed distance to a closed surface: the closest point, and the sign by the normal there, which at a corner is the
/// mean of the triangle normals weighted by their angles and at an edge the sum of the two.
///
/// J. A. Bærentzen, H. Aanæs, IEEE Trans Vis Comput Graph 2005;11:243: with these normals the sign is right everywhere.
#[derive(Clone, Debug)]
pub struct SignedDistance<'a> {
    surface: &'a SearchSurface,
    /// Unit normal of every triangle.
    faces: Vec<Vector3<f64>>,
    /// Sum of the unit normals at the edges of every triangle.
    edges: Vec<[Vector3<f64>; 3]>,
    /// Sum of the normals weighted by angle, at every point.
    points: Vec<Vector3<f64>>,
}

/// Signed distance of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// Distance to the surface \[m\], negative inside.
    pub distance: f64,
    /// The closest point of the surface \[m\].
    pub closest: Vector3<f64>,
    /// Outward direction at the closest point (not of unit length).
    pub normal: Vector3<f64>,
    /// Triangle of the closest point.
    pub triangle: u32,
}

impl<'a> SignedDistance<'a> {
    /// Prepares the normals. Refuses a surface with borders, where inside and outside have no meaning.
    pub fn new(search: &'a SearchSurface) -> Result<SignedDistance<'a>, SurfaceError> {
        let surface = search.surface();
        surface.check_borders()?;
        let faces = surface.normals();
        let neighbours = surface.neighbours()?;
        let edge =
            |t: usize, k: usize| faces[t] + neighbours[t][k].map_or(Vector3::zeros(), |u| faces[u as usize]);
        let edges = (0..faces.len()).map(|t| [0, 1, 2].map(|k| edge(t, k))).collect();
        let mut points = vec![Vector3::zeros(); surface.points.len()];
        for (t, numbers) in surface.triangles.iter().enumerate() {
            let x = surface.corners(t);
            for k in 0..3 {
                let (u, v) = (x[(k + 1) % 3] - x[k], x[(k + 2) % 3] - x[k]);
                points[numbers[k] as usize] += u.angle(&v) * faces[t];
            }
        }
        Ok(SignedDistance { surface: search, faces, edges, points })
    }

    /// Signed distance of one point \[m\].
    pub fn at(&self, point: &Vector3<f64>) -> Depth {
        let (closest, triangle, part) = self.surface.nearest(point).expect("a closed surface has triangles");
        let t = triangle as usize;
        let normal = match part {
            Part::Face => self.faces[t],
            Part::Edge(k) => self.edges[t][k as usize],
            Part::Corner(k) => self.points[self.surface.surface().triangles[t][k as usize] as usize],
        };
        let inside = (point - closest.on_b).dot(&normal) < 0.0;
        let distance = if inside { -closest.distance } else { closest.distance };
        Depth { distance, closest: closest.on_b, normal, triangle }
    }

    /// Signed distance of many points \[m\], in their order.
    pub fn of(&self, points: &[[f64; 3]]) -> Vec<Depth> {
        points.par_iter().map(|p| self.at(&Vector3::from(*p))).collect()
    }
}
