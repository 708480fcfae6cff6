//! Signed distance of points to a closed surface.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::normals::PseudoNormals;
use super::{SearchSurface, SurfaceError};

/// Signed distance to a closed surface: the closest point, and the sign by the normal there.
#[derive(Clone, Debug)]
pub struct SignedDistance<'a> {
    surface: &'a SearchSurface,
    normals: PseudoNormals,
    /// Edges of the triangles.
    edges: Vec<[usize; 3]>,
}

/// Signed distance of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// Distance to the surface \[m\], negative inside.
    pub distance: f64,
    /// The closest point of the surface \[m\].
    pub closest: Vector3<f64>,
    /// Unit outward normal at the closest point.
    pub normal: Vector3<f64>,
    /// Triangle of the closest point.
    pub triangle: u32,
}

impl Depth {
    /// Unit gradient of the distance at the point \[m\] that was asked for; on the surface its normal.
    pub fn gradient(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let away = point - self.closest;
        away.try_normalize(f64::MIN_POSITIVE).map_or(self.normal, |n| self.distance.signum() * n)
    }
}

impl<'a> SignedDistance<'a> {
    /// Prepares the normals. Refuses a surface with borders, where inside and outside have no meaning.
    pub fn new(search: &'a SearchSurface) -> Result<SignedDistance<'a>, SurfaceError> {
        let surface = search.surface();
        surface.check_borders()?;
        let mut edges = vec![[0; 3]; surface.triangles.len()];
        let mut ends = Vec::new();
        for edge in surface.edges() {
            if edge.sides.len() > 2 {
                return Err(surface.crowded_edge(&edge));
            }
            edge.sides.iter().for_each(|&(t, k, _)| edges[t as usize][k as usize] = ends.len());
            ends.push(edge.points.map(|p| p as usize));
        }
        let triangles = surface.triangles.iter().map(|t| t.map(|c| c as usize)).zip(edges.iter().copied());
        let place = |c: usize| Vector3::from(surface.points[c]);
        let normals = PseudoNormals::new(triangles, &ends, surface.points.len(), place);
        Ok(SignedDistance { surface: search, normals, edges })
    }

    /// Signed distance of one point \[m\].
    pub fn at(&self, point: &Vector3<f64>) -> Depth {
        let (closest, triangle, part) = self.surface.nearest(point).expect("a closed surface has triangles");
        let corners = self.surface.surface().triangles[triangle as usize].map(|c| c as usize);
        let (normal, _) = self.normals.of(triangle as usize, corners, self.edges[triangle as usize], part);
        let inside = (point - closest.on_b).dot(&normal) < 0.0;
        let distance = if inside { -closest.distance } else { closest.distance };
        Depth { distance, closest: closest.on_b, normal, triangle }
    }

    /// Signed distance of many points \[m\], in their order.
    pub fn of(&self, points: &[[f64; 3]]) -> Vec<Depth> {
        points.par_iter().map(|p| self.at(&Vector3::from(*p))).collect()
    }
}
