//! Is a surface one closed, outward, sound body, or one sheet without holes?

use std::collections::BTreeMap;

use super::intersect::is_degenerate;
use super::surface::Edge;
use super::{SearchSurface, Surface, SurfaceError};

/// No part of a leg is larger or smaller \[m\].
const SIZES: std::ops::Range<f64> = 0.002..3.0;

impl Surface {
    /// Refuses, naming place and remedy: triangles that name points there are not or one point twice, coordinates that are
    /// not finite, sizes that no part of a leg has, points that coincide, triangles without area, open and crowded edges,
    /// mixed and inward orientation, points where parts only touch, several parts, and self-intersection (exact).
    pub fn check(&self) -> Result<(), SurfaceError> {
        self.check_numbers()?;
        self.check_size()?;
        self.check_points()?;
        self.check_borders()?;
        self.check_fans()?;
        self.check_components()?;
        let volume = self.volume();
        if !(volume > 0.0) {
            return Err(SurfaceError::InsideOut { volume, at: self.first_corner(0) });
        }
        let pairs = SearchSurface::new(self.clone()).self_intersections();
        match pairs.first() {
            None => Ok(()),
            Some(&(first, second)) => Err(SurfaceError::SelfIntersection {
                count: pairs.len(),
                first: first as usize,
                second: second as usize,
                at: self.first_corner(first as usize),
            }),
        }
    }

    /// The same of an open sheet: one part, turned to one side, with one border, so without a hole. Self-intersection is not looked for.
    pub fn check_sheet(&self) -> Result<(), SurfaceError> {
        self.check_numbers()?;
        self.check_size()?;
        self.check_points()?;
        let edges = self.edges();
        self.check_crowding(&edges)?;
        self.check_orientation(&edges)?;
        self.check_components()?;
        let rims = self.rims(&edges);
        match rims[..] {
            [_] => Ok(()),
            _ => Err(SurfaceError::Rims {
                count: rims.len(),
                at: rims.iter().min_by_key(|rim| rim.len()).map(|rim| self.points[rim[0] as usize]),
            }),
        }
    }

    /// Points of every border, those that hang together.
    fn rims(&self, edges: &[Edge]) -> Vec<Vec<u32>> {
        let mut beside: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for [a, b] in edges.iter().filter(|e| e.sides.len() == 1).map(|e| e.points) {
            beside.entry(a).or_default().push(b);
            beside.entry(b).or_default().push(a);
        }
        let mut rims = Vec::new();
        while let Some((first, next)) = beside.pop_first() {
            let (mut rim, mut next) = (vec![first], next);
            while let Some(point) = next.pop() {
                if let Some(more) = beside.remove(&point) {
                    rim.push(point);
                    next.extend(more);
                }
            }
            rims.push(rim);
        }
        rims
    }

    fn first_corner(&self, triangle: usize) -> [f64; 3] {
        self.points[self.triangles[triangle][0] as usize]
    }

    /// What every other question needs: triangles of three points there are, with finite coordinates.
    pub fn check_numbers(&self) -> Result<(), SurfaceError> {
        if self.triangles.is_empty() {
            return Err(SurfaceError::Empty);
        }
        let n_points = self.points.len();
        if let Some(point) = self.points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(SurfaceError::NotFinite { point, at: self.points[point] });
        }
        for (triangle, &numbers) in self.triangles.iter().enumerate() {
            if let Some(&point) = numbers.iter().find(|&&p| p as usize >= n_points) {
                return Err(SurfaceError::PointOutOfRange { triangle, point, n_points });
            }
            let [a, b, c] = numbers;
            if a == b || b == c || c == a {
                let point = if a == b || a == c { a } else { b };
                return Err(SurfaceError::RepeatedPoint { triangle, point, at: self.points[point as usize] });
            }
        }
        Ok(())
    }

    fn check_size(&self) -> Result<(), SurfaceError> {
        let (low, high) = self.bounds();
        let size = (high - low).max();
        if SIZES.contains(&size) { Ok(()) } else { Err(SurfaceError::Units { size }) }
    }

    fn check_points(&self) -> Result<(), SurfaceError> {
        let mut sorted: Vec<usize> = (0..self.points.len()).collect();
        let place = |i: usize| self.points[i].map(|x| x + 0.0); // -0 is 0
        let order = |a: &[f64; 3], b: &[f64; 3]| {
            let pairs = a.iter().zip(b).map(|(x, y)| x.total_cmp(y));
            pairs.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        };
        sorted.sort_unstable_by(|&a, &b| order(&place(a), &place(b)).then(a.cmp(&b)));
        if let Some(w) = sorted.windows(2).find(|w| place(w[0]) == place(w[1])) {
            return Err(SurfaceError::CoincidentPoints { first: w[0], second: w[1], at: self.points[w[0]] });
        }
        match (0..self.triangles.len()).find(|&t| is_degenerate(&self.corners(t))) {
            Some(triangle) => Err(SurfaceError::NoArea { triangle, at: self.first_corner(triangle) }),
            None => Ok(()),
        }
    }

    /// Every edge belongs to two triangles that look to the same side.
    pub(super) fn check_borders(&self) -> Result<(), SurfaceError> {
        if self.triangles.is_empty() {
            return Err(SurfaceError::Empty);
        }
        let edges = self.edges();
        self.check_crowding(&edges)?;
        let mut open = edges.iter().filter(|e| e.sides.len() == 1);
        if let Some(edge) = open.next() {
            let (count, triangle) = (1 + open.count(), edge.sides[0].0 as usize);
            return Err(SurfaceError::Open { count, triangle, at: self.points[edge.points[0] as usize] });
        }
        self.check_orientation(&edges)
    }

    /// No edge belongs to more than two triangles.
    fn check_crowding(&self, edges: &[Edge]) -> Result<(), SurfaceError> {
        edges.iter().find(|e| e.sides.len() > 2).map_or(Ok(()), |edge| Err(self.crowded_edge(edge)))
    }

    /// The two triangles of an edge look to the same side.
    fn check_orientation(&self, edges: &[Edge]) -> Result<(), SurfaceError> {
        match edges.iter().find(|e| matches!(e.sides[..], [(.., a), (.., b)] if a == b)) {
            Some(edge) => Err(SurfaceError::MixedOrientation {
                first: edge.sides[0].0 as usize,
                second: edge.sides[1].0 as usize,
                at: self.points[edge.points[0] as usize],
            }),
            None => Ok(()),
        }
    }

    /// Walking around a point from triangle to triangle comes back to the start after all triangles of the point.
    fn check_fans(&self) -> Result<(), SurfaceError> {
        let mut count = vec![0u32; self.points.len()];
        let mut next: BTreeMap<[u32; 2], u32> = BTreeMap::new(); // (point, neighbour) to the neighbour across the triangle
        for t in &self.triangles {
            for k in 0..3 {
                count[t[k] as usize] += 1;
                next.insert([t[k], t[(k + 1) % 3]], t[(k + 2) % 3]);
            }
        }
        let mut point = None;
        for &[p, start] in next.keys() {
            if point == Some(p) {
                continue;
            }
            point = Some(p);
            let (mut at, mut steps) = (start, 0);
            loop {
                at = next[&[p, at]];
                steps += 1;
                if at == start {
                    break;
                }
            }
            if steps != count[p as usize] {
                return Err(SurfaceError::PinchedPoint { point: p as usize, at: self.points[p as usize] });
            }
        }
        Ok(())
    }

    fn check_components(&self) -> Result<(), SurfaceError> {
        let (of, count) = self.components();
        if count == 1 {
            return Ok(());
        }
        let triangle = of.iter().position(|&c| c == 1).expect("every component has a triangle");
        let n_triangles = of.iter().filter(|&&c| c == 1).count();
        Err(SurfaceError::SeveralComponents { count, triangle, at: self.first_corner(triangle), n_triangles })
    }
}
