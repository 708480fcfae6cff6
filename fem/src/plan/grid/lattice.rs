//! Cubes that fill space: in which a point lies, and the weights of their corners there.

use crate::element::shape::{HEX_CORNERS, hex8_at};

/// Cube or corner of a lattice by its numbers along x, y and z.
pub type Site = [i64; 3];

/// Cubes of one size.
pub struct Lattice {
    origin: [f64; 3],
    edge: f64,
    /// Cubes along each axis.
    n: Site,
}

/// Distance from a face of a cube, over its edge, within which a point is on both sides of it: far above round-off of coordinates of the size of
/// a body (1e-13 of a cube of 1 mm), far below what makes a difference.
const ON_FACE: f64 = 1e-9;

impl Lattice {
    /// Cubes about a box \[m\], which they overlap on both sides by the same amount.
    pub fn about(low: [f64; 3], high: [f64; 3], edge: f64) -> Lattice {
        let n: Site = std::array::from_fn(|c| (((high[c] - low[c]) / edge - ON_FACE).ceil() as i64).max(1));
        let origin = std::array::from_fn(|c| 0.5 * (low[c] + high[c] - n[c] as f64 * edge));
        Lattice { origin, edge, n }
    }

    /// Edge of a cube \[m\].
    pub fn edge(&self) -> f64 {
        self.edge
    }

    /// Place of a point in cubes from the origin.
    fn coordinate(&self, p: [f64; 3], c: usize) -> f64 {
        (p[c] - self.origin[c]) / self.edge
    }

    /// The cubes that hold a point \[m\]: more than one where it is on a face of theirs. Ascending.
    pub fn cubes(&self, p: [f64; 3]) -> Vec<Site> {
        let mut cubes = vec![[0; 3]];
        for c in 0..3 {
            let at = self.coordinate(p, c);
            let nearest = at.round();
            let of = match (at - nearest).abs() < ON_FACE {
                true => [nearest as i64 - 1, nearest as i64],
                false => [at.floor() as i64; 2],
            };
            let mut of = of.map(|i| i.clamp(0, self.n[c] - 1)).to_vec();
            of.dedup();
            cubes = cubes.iter().flat_map(|&cube| of.iter().map(move |&i| with(cube, c, i))).collect();
        }
        cubes
    }

    /// Weights of the corners of a cube at a point \[m\], which may lie outside it; in the order of [`HEX_CORNERS`].
    pub fn weights(&self, cube: Site, p: [f64; 3]) -> [f64; 8] {
        hex8_at(std::array::from_fn(|c| 2.0 * (self.coordinate(p, c) - cube[c] as f64) - 1.0)).0
    }

    /// The corners of a cube.
    pub fn corners(cube: Site) -> [Site; 8] {
        HEX_CORNERS.map(|corner| std::array::from_fn(|c| cube[c] + i64::from(corner[c] > 0.0)))
    }

    /// Where a corner is \[m\].
    pub fn place(&self, corner: Site) -> [f64; 3] {
        std::array::from_fn(|c| self.origin[c] + self.edge * corner[c] as f64)
    }

    /// Where the centre of a cube is \[m\].
    pub fn centre(&self, cube: Site) -> [f64; 3] {
        self.place(cube).map(|x| x + 0.5 * self.edge)
    }

    /// Squared distance \[m²\] of the centre of a cube from a point.
    pub fn squared_distance(&self, cube: Site, p: [f64; 3]) -> f64 {
        let centre = self.centre(cube);
        (0..3).map(|c| (centre[c] - p[c]).powi(2)).sum()
    }
}

fn with(mut site: Site, c: usize, i: i64) -> Site {
    site[c] = i;
    site
}
