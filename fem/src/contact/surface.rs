//! Collision surfaces: triangles over *collision points*, each a fixed mean of nodes.
//!
//! A quadrilateral becomes four triangles about the mean of its nodes, a triangle stays as it is. The barrier is
//! integrated over each surface with the trapezoidal rule on triangles divided finely enough for the surfaces that it
//! may meet: the corners of the divided triangles are the *samples*, each with its fraction of the area.

use crate::geometry::closest::EDGES;
use crate::geometry::tree::{Aabb, Tree};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// One surface as it enters contact.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceInput {
    /// Name, as reported.
    pub name: String,
    /// Quadrilaterals, or triangles that repeat their last node; counter-clockwise from outside.
    pub faces: Vec<[u32; 4]>,
    /// Stiffness \[Pa\] of what lies behind each face; infinite where rigid.
    pub stiffness: Vec<f64>,
    /// Distance \[m\] between samples that is fine enough.
    pub spacing: f64,
}

/// A mean of at most four nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blend {
    /// Nodes; those past `n` are void.
    pub nodes: [u32; 4],
    /// Weights.
    pub weights: [f64; 4],
    /// How many.
    pub n: usize,
}

impl Blend {
    fn node(node: u32) -> Blend {
        Blend { nodes: [node, 0, 0, 0], weights: [1.0, 0.0, 0.0, 0.0], n: 1 }
    }

    fn mix(parts: &[(Blend, f64)]) -> Blend {
        let mut sum = BTreeMap::<u32, f64>::new();
        for (blend, fraction) in parts {
            for (node, weight) in blend.weighted_nodes() {
                *sum.entry(node).or_default() += fraction * weight;
            }
        }
        let mut out = Blend { n: sum.len(), ..Blend::default() };
        for (i, (node, weight)) in sum.into_iter().enumerate() {
            (out.nodes[i], out.weights[i]) = (node, weight);
        }
        out
    }

    /// (node, weight).
    pub fn weighted_nodes(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        (0..self.n).map(|i| (self.nodes[i], self.weights[i]))
    }

    /// Where it is.
    pub fn at(&self, x: &[f64]) -> Vector3<f64> {
        let mut p = Vector3::zeros();
        for (node, weight) in self.weighted_nodes() {
            let i = 3 * node as usize;
            p += Vector3::new(x[i], x[i + 1], x[i + 2]) * weight;
        }
        p
    }
}

/// An edge of a collision surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Its ends.
    pub points: [u32; 2],
    /// Squared length in the reference configuration \[m²\].
    pub squared_length: f64,
    /// A third of the area of those \[m²\].
    pub area: f64,
    /// Stiffness \[Pa\] of the softest of its triangles.
    pub stiffness: f64,
}

/// One collision surface; indices run over the points, triangles and edges of all surfaces.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name, as reported.
    pub name: String,
    /// Twice its volume over its area in the reference configuration \[m\]: the thickness of a plate; 0 where it is open.
    pub thickness: f64,
    /// Its triangles.
    pub triangles: std::ops::Range<usize>,
    /// Its edges.
    pub edges: std::ops::Range<usize>,
    /// Its collision points, every one a sample.
    pub samples: std::ops::Range<usize>,
    /// Tree over the triangles, counted from the first.
    pub triangle_tree: Tree,
    /// Tree over the edges, counted from the first.
    pub edge_tree: Tree,
}

/// All collision surfaces of an island.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// Surfaces.
    pub list: Vec<Surface>,
    /// Collision points.
    pub points: Vec<Blend>,
    /// Area of each collision point as a sample \[m²\].
    pub areas: Vec<f64>,
    /// The same where only the corners of triangles are samples.
    pub corner_areas: Vec<f64>,
    /// Surface of each collision point.
    pub surface_of: Vec<u32>,
    /// Corners of triangles between which each collision point lies: itself, the ends of an edge, or three; repeated to fill up.
    pub corners_of: Vec<[u32; 3]>,
    /// Stiffness \[Pa\] of the softest triangle at each collision point.
    pub stiffness: Vec<f64>,
    /// Corners of the triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Stiffness \[Pa\] of what lies behind each triangle; infinite where rigid.
    pub triangle_stiffness: Vec<f64>,
    /// Samples of the triangles, those on edges and corners included.
    pub triangle_samples: Vec<Vec<u32>>,
    /// Way through the body from the middle of each triangle in the reference configuration \[m\]; infinite where the surface is open.
    pub depths: Vec<f64>,
    /// Least depth of the triangles of each sample \[m\].
    pub sample_depths: Vec<f64>,
    /// Edges of the triangles, in the order of [`EDGES`].
    pub triangle_edges: Vec<[u32; 3]>,
    /// Edges.
    pub edges: Vec<Edge>,
    /// Mean length of the edges in the reference configuration \[m\].
    pub edge_length: f64,
}

/// The collision triangles of a face with these corners: four about their `mean`; of a triangle, which has none, itself.
pub fn collision_triangles<C: Copy>([a, b, c, d]: [C; 4], mean: Option<C>) -> Vec<[C; 3]> {
    match mean {
        None => vec![[a, b, c]],
        Some(mean) => vec![[a, b, mean], [b, c, mean], [c, d, mean], [d, a, mean]],
    }
}

/// Divisions of a triangle at most.
const MAX_DIVISIONS: usize = 12;

impl Surfaces {
    /// Builds the collision surfaces over nodes at `X` \[m\].
    #[allow(non_snake_case)]
    pub fn new(inputs: &[SurfaceInput], X: &[f64]) -> Surfaces {
        let mut all = Surfaces::default();
        for (index, input) in inputs.iter().enumerate() {
            all.add(index as u32, input, X);
        }
        let length = |e: &Edge| {
            let [a, b] = e.points.map(|p| all.points[p as usize].at(X));
            (b - a).norm()
        };
        all.edge_length = all.edges.iter().map(length).sum::<f64>() / all.edges.len().max(1) as f64;
        all
    }

    #[allow(non_snake_case)]
    fn add(&mut self, index: u32, input: &SurfaceInput, X: &[f64]) {
        let (first_point, first_triangle) = (self.points.len(), self.triangles.len());
        let mut corner_of = BTreeMap::<u32, u32>::new();
        for (face, stiffness) in input.faces.iter().zip(&input.stiffness) {
            let corners = face.map(|node| {
                *corner_of.entry(node).or_insert_with(|| {
                    self.points.push(Blend::node(node));
                    self.points.len() as u32 - 1
                })
            });
            let mean = (face[2] != face[3]).then(|| {
                let parts = face.map(|node| (Blend::node(node), 0.25));
                self.points.push(Blend::mix(&parts));
                self.points.len() as u32 - 1
            });
            self.triangles.extend(collision_triangles(corners, mean));
            self.triangle_stiffness.resize(self.triangles.len(), *stiffness);
        }
        self.areas.resize(self.points.len(), 0.0);
        self.corners_of.extend((first_point as u32..self.points.len() as u32).map(|p| [p; 3]));
        let first_edge = self.edges.len();
        self.find_edges(first_triangle, X);
        self.divide(first_triangle, input.spacing, X);
        self.corner_areas.resize(self.points.len(), 0.0);
        for t in first_triangle..self.triangles.len() {
            let fraction = self.area(t, X) / 3.0;
            self.triangles[t].iter().for_each(|&c| self.corner_areas[c as usize] += fraction);
        }
        self.surface_of.resize(self.points.len(), index);

        let at = |p: u32| self.points[p as usize].at(X);
        let box_of = |points: &[u32]| {
            points.iter().fold(Aabb::empty(), |sum, &p| sum.join(&Aabb::of_way(&at(p), &at(p), 0.0)))
        };
        let triangles: Vec<Aabb> = self.triangles[first_triangle..].iter().map(|t| box_of(t)).collect();
        let edges: Vec<Aabb> = self.edges[first_edge..].iter().map(|e| box_of(&e.points)).collect();
        let (triangle_tree, edge_tree) = (Tree::new(&triangles), Tree::new(&edges));
        let corners: Vec<_> = self.triangles[first_triangle..].iter().map(|t| t.map(at)).collect();
        self.depths.extend(depths(&corners, &triangle_tree));
        self.sample_depths.resize(self.points.len(), f64::INFINITY);
        self.stiffness.resize(self.points.len(), f64::INFINITY);
        for t in first_triangle..self.triangles.len() {
            for &s in &self.triangle_samples[t] {
                let (depth, stiffness) =
                    (&mut self.sample_depths[s as usize], &mut self.stiffness[s as usize]);
                *depth = depth.min(self.depths[t]);
                *stiffness = stiffness.min(self.triangle_stiffness[t]);
            }
        }
        self.list.push(Surface {
            name: input.name.clone(),
            thickness: self.thickness(first_triangle, first_edge, X),
            triangles: first_triangle..self.triangles.len(),
            edges: first_edge..self.edges.len(),
            samples: first_point..self.points.len(),
            triangle_tree,
            edge_tree,
        });
    }

    #[allow(non_snake_case)]
    fn find_edges(&mut self, first_triangle: usize, X: &[f64]) {
        let mut known = BTreeMap::<[u32; 2], u32>::new();
        for t in first_triangle..self.triangles.len() {
            let triangle = self.triangles[t];
            let area = self.area(t, X);
            let edges = EDGES.map(|[i, j]| {
                let (a, b) = (triangle[i].min(triangle[j]), triangle[i].max(triangle[j]));
                *known.entry([a, b]).or_insert_with(|| {
                    let [p, q] = [a, b].map(|p| self.points[p as usize].at(X));
                    let squared_length = (q - p).norm_squared();
                    self.edges.push(Edge {
                        points: [a, b],
                        squared_length,
                        area: 0.0,
                        stiffness: f64::INFINITY,
                    });
                    self.edges.len() as u32 - 1
                })
            });
            for e in edges {
                let edge = &mut self.edges[e as usize];
                edge.area += area / 3.0;
                edge.stiffness = edge.stiffness.min(self.triangle_stiffness[t]);
            }
            self.triangle_edges.push(edges);
        }
    }

    /// Divides triangles into n² equal ones and shares the area of each part among its corners.
    #[allow(non_snake_case)]
    fn divide(&mut self, first_triangle: usize, spacing: f64, X: &[f64]) {
        let mut on_edge = BTreeMap::<(u32, usize, usize), u32>::new();
        for t in first_triangle..self.triangles.len() {
            let corners = self.triangles[t];
            let at = corners.map(|p| self.points[p as usize].at(X));
            let longest = EDGES.iter().map(|[i, j]| (at[*j] - at[*i]).norm()).fold(0.0, f64::max);
            // A quarter over the wanted distance is fine enough.
            let n = ((longest / spacing - 0.25).ceil() as usize).clamp(1, MAX_DIVISIONS);
            let fraction = self.area(t, X) / (3 * n * n) as f64;
            let mut samples = Vec::with_capacity((n + 1) * (n + 2) / 2);
            for i in 0..=n {
                for j in 0..=n - i {
                    let k = n - i - j;
                    // Parts that meet here: six inside, three on an edge, one in a corner.
                    let parts = match [i, j, k].iter().filter(|&&m| m == 0).count() {
                        0 => 6.0,
                        1 => 3.0,
                        _ => 1.0,
                    };
                    let p = self.sample(t, [i, j, k], n, &mut on_edge);
                    samples.push(p);
                    if self.areas.len() <= p as usize {
                        self.areas.resize(p as usize + 1, 0.0);
                    }
                    self.areas[p as usize] += parts * fraction;
                }
            }
            self.triangle_samples.push(samples);
        }
    }

    /// The sample with barycentric coordinates `at` / `n` of triangle `t`; those on corners and edges are shared.
    fn sample(
        &mut self,
        t: usize,
        at: [usize; 3],
        n: usize,
        on_edge: &mut BTreeMap<(u32, usize, usize), u32>,
    ) -> u32 {
        let corners = self.triangles[t];
        if let Some(corner) = (0..3).find(|&c| at[c] == n) {
            return corners[corner];
        }
        let parts: [(Blend, f64); 3] =
            std::array::from_fn(|c| (self.points[corners[c] as usize], at[c] as f64 / n as f64));
        let parts: Vec<_> = parts.into_iter().filter(|(_, fraction)| *fraction > 0.0).collect();
        let mut push = |between: [u32; 3]| {
            self.points.push(Blend::mix(&parts));
            self.corners_of.push(between);
            self.points.len() as u32 - 1
        };
        match (0..3).find(|&e| at[3 - EDGES[e][0] - EDGES[e][1]] == 0) {
            Some(e) => {
                let [i, j] = EDGES[e];
                // Counted from the lesser end, so that both triangles name it alike.
                let along = if corners[i] < corners[j] { at[j] } else { at[i] };
                let key = (self.triangle_edges[t][e], along, n);
                *on_edge.entry(key).or_insert_with(|| push([corners[i], corners[j], corners[j]]))
            }
            None => push(corners),
        }
    }

    /// See [`Surface::thickness`], of the triangles and edges from the given ones on.
    #[allow(non_snake_case)]
    fn thickness(&self, first_triangle: usize, first_edge: usize, X: &[f64]) -> f64 {
        let mut sides = vec![0; self.edges.len() - first_edge];
        let (mut volume, mut area) = (0.0, 0.0);
        for t in first_triangle..self.triangles.len() {
            let [a, b, c] = self.triangles[t].map(|p| self.points[p as usize].at(X));
            volume += a.dot(&b.cross(&c)) / 6.0;
            area += self.area(t, X);
            self.triangle_edges[t].iter().for_each(|e| sides[*e as usize - first_edge] += 1);
        }
        let closed = sides.iter().all(|n| *n == 2);
        if closed { 2.0 * volume.max(0.0) / area } else { 0.0 }
    }

    #[allow(non_snake_case)]
    fn area(&self, t: usize, X: &[f64]) -> f64 {
        let [a, b, c] = self.triangles[t].map(|p| self.points[p as usize].at(X));
        (b - a).cross(&(c - a)).norm() / 2.0
    }

    /// Positions of all collision points.
    pub fn positions(&self, x: &[f64]) -> Vec<Vector3<f64>> {
        self.points.par_iter().with_min_len(1024).map(|p| p.at(x)).collect()
    }

    /// Surface of a collision point.
    pub fn surface(&self, point: u32) -> usize {
        self.surface_of[point as usize] as usize
    }

    /// Whether a collision point is a corner of triangles.
    pub fn is_corner(&self, point: u32) -> bool {
        self.corners_of[point as usize] == [point; 3]
    }

    /// Whether two collision points are neighbours for good: on one surface those that have a corner of a triangle in common (not those
    /// of faces that share a node: they can be folded onto each other), on two those that share a node.
    pub fn related(&self, p: u32, q: u32) -> bool {
        if self.surface_of[p as usize] == self.surface_of[q as usize] {
            let [mine, theirs] = [p, q].map(|p| &self.corners_of[p as usize]);
            return mine.iter().any(|c| theirs.contains(c));
        }
        let (p, q) = (&self.points[p as usize], &self.points[q as usize]);
        p.nodes[..p.n].iter().any(|n| q.nodes[..q.n].contains(n))
    }
}

/// Way \[m\] from the middle of each triangle into the body until it comes out of it; infinite where it never does.
fn depths(triangles: &[[Vector3<f64>; 3]], tree: &Tree) -> Vec<f64> {
    let whole = tree.whole();
    let diagonal = (whole.hi - whole.lo).norm();
    let through = |[a, b, c]: &[Vector3<f64>; 3]| {
        let (from, inwards) = ((a + b + c) / 3.0, (c - a).cross(&(b - a)).normalize());
        let mut nearest = f64::INFINITY;
        let mut length = (b - a).norm();
        // Short ways first: their boxes meet little.
        while !(nearest <= length) && length < 2.0 * diagonal {
            length *= 2.0;
            let way = Aabb::of_way(&from, &(from + inwards * length), 0.0);
            tree.overlapping(&way, |t| {
                if let Some(hit) = way_out(&from, &inwards, &triangles[t as usize]) {
                    nearest = nearest.min(hit);
                }
            });
        }
        nearest
    };
    triangles.par_iter().map(through).collect()
}

/// How far along a ray a triangle is met from behind \[m\]: Möller & Trumbore, Fast, minimum storage ray-triangle intersection, J. Graph.
/// Tools 2 (1997).
fn way_out(from: &Vector3<f64>, along: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> Option<f64> {
    let (u, v, w) = (b - a, c - a, from - a);
    let det = -u.cross(&v).dot(along);
    if !(det < 0.0) {
        return None;
    }
    let side = w.cross(along);
    let (s, t) = (v.dot(&side) / det, -u.dot(&side) / det);
    let way = w.dot(&u.cross(&v)) / det;
    (s >= 0.0 && t >= 0.0 && s + t <= 1.0 && way > 0.0).then_some(way)
}
