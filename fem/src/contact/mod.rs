//! Frictionless contact between surfaces.
//!
//! **Guarded**: a barrier on the distance, integrated over both surfaces of a pair, and continuous collision detection in
//! every step (Li et al., Incremental potential contact, ACM Trans. Graph. 39, 2020), so nothing passes through. One way around is
//! `soft.rs`: it finds a guess at which nothing overlaps, from which the guarded mode goes on. docs/theory.md has it all on one page.
//!
//! Π = ½ Σ over samples of A (area) b(distance to B) + the same from B to A + Σ over pairs of edges (area) b(distance).
//! The distance of a sample to a surface is made smooth at edges and corners by counting the triangles within reach, less the
//! edges that they share, plus the corners (Li, Kaufman & Jiang, arXiv:2307.15908, §4). Areas are those of
//! the reference configuration, so that forces do not hang on the mesh. Edges are within reach at half the distance only:
//! they matter where edges cross and nothing else is near.
//!
//! **Cheap**: a penalty on the penetration of the samples of both surfaces instead; nothing is guaranteed, the depth is
//! reported (see [`PairForce`]).

#![allow(non_snake_case)]

pub mod barrier;
mod candidates;
pub mod ccd;
mod measure;
mod near;
mod normals;
mod penalty;
mod soft;
mod start;
pub mod stencil;
pub mod surface;
mod term;
mod untangle;

pub use candidates::FREE;
pub use measure::PairForce;
pub use start::Overlap;
pub use term::ContactTerm;

use crate::geometry::closest::{
    Feature, Points, edge_edge, feature, point_edge, point_point, point_triangle,
};
use candidates::{Candidates, Partners, Primitives};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::{Arc, Mutex};
use stencil::{Law, Matrix12, Stencil};
use surface::{Edge, SurfaceInput, Surfaces};

/// Distance within which edges repel each other, as a fraction of that of samples.
const EDGE_REACH: f64 = 0.5;
/// Slack of the candidate list as a fraction of the activation distance.
const SLACK: f64 = 0.5;

/// How contact keeps surfaces apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Nothing ever passes through.
    #[default]
    Guarded,
    /// Surfaces penetrate each other a little.
    Cheap,
}

/// What takes part in the contact of one island, over its local nodes.
#[derive(Clone, Debug, Default)]
pub struct ContactInput {
    /// Surfaces.
    pub surfaces: Vec<SurfaceInput>,
    /// Pairs of surfaces that may meet; twice the same for contact with itself.
    pub pairs: Vec<[usize; 2]>,
    /// Guarded: activation distance d̂ \[m\]; cheap: penetration at which the pressure is the stiffness of the softer side.
    pub distance: f64,
    /// Which of the two.
    pub mode: Mode,
    /// What each node moves with where all its components are prescribed (the same number: together); from [`FREE`] on free bodies, whose
    /// poses are unknowns; `None`: free.
    pub carrier: Vec<Option<u32>>,
    /// (node, surface): primitives with this node take no notice of that surface.
    pub muted: Vec<(u32, usize)>,
}

/// Contact of one island. What it remembers spares work; no lock is held while it works, so that threads that share it never wait for
/// each other.
pub struct Contact {
    /// How surfaces are kept apart.
    pub mode: Mode,
    distance: f64,
    /// The collision surfaces.
    pub surfaces: Arc<Surfaces>,
    partners: Arc<Partners>,
    /// Activation distance of each collision point \[m\]: no greater than its distance at the start, so that the start is
    /// free of forces.
    reach: Arc<[f64]>,
    /// The same of edges.
    edge_reach: Arc<[f64]>,
    largest_reach: f64,
    /// What may be near each other.
    candidates: Mutex<Arc<Candidates>>,
    /// The terms at the positions asked for last: energy, gradient and Hessian of one state are asked for one after the other.
    last: Mutex<Arc<Terms>>,
    /// What the last search for near points has found.
    memory: Mutex<near::Memory>,
    /// Normals by which it is told who faces whom inside bodies; `None`: those of the moment.
    held_normals: Mutex<Option<Arc<Vec<normals::Normals>>>>,
}

/// The terms of the potential at some positions.
#[derive(Debug, Default)]
struct Terms {
    /// Positions of the local nodes \[m\].
    x: Vec<f64>,
    /// Fraction of the activation distance below which the barriers are softened; 0: nowhere.
    softness: f64,
    /// Positions of the collision points \[m\].
    p: Vec<Vector3<f64>>,
    stencils: Vec<Stencil>,
}

impl Contact {
    /// Contact over nodes that start at `X` \[m\]. The surfaces must not touch there; see [`Contact::least_distance`].
    pub fn new(input: &ContactInput, X: &[f64]) -> Contact {
        let surfaces = Surfaces::new(&input.surfaces, X);
        let mut of = vec![Vec::new(); surfaces.list.len()];
        for &[a, b] in &input.pairs {
            of[a].push(b);
            of[b].push(a);
        }
        of.iter_mut().for_each(|list| {
            list.sort_unstable();
            list.dedup();
        });
        let mut muted_at = vec![0_u64; X.len() / 3];
        for &(node, surface) in &input.muted {
            muted_at[node as usize] |= 1 << surface;
        }
        let muted =
            surfaces.points.iter().map(|b| b.weighted_nodes().fold(0, |m, (n, _)| m | muted_at[n as usize]));
        let carrier = |b: &surface::Blend| {
            let first = input.carrier[b.nodes[0] as usize];
            match b.weighted_nodes().all(|(n, _)| input.carrier[n as usize] == first) {
                true => first,
                // Prescribed in several ways: it moves with nothing else.
                false => {
                    let is_prescribed =
                        |(n, _)| input.carrier[n as usize].is_some_and(|c| !candidates::is_free_body(c));
                    b.weighted_nodes().all(is_prescribed).then_some(u32::MAX)
                }
            }
        };
        let carrier: Vec<Option<u32>> = surfaces.points.iter().map(carrier).collect();
        let rigid = |s: &surface::Surface| {
            let first = carrier[s.samples.start];
            s.samples.clone().all(|p| carrier[p] == first).then_some(first).flatten()
        };
        let rigid = surfaces.list.iter().map(rigid).collect();
        let partners = Partners { of, muted: muted.collect(), carrier, rigid };
        let mut contact = Contact {
            mode: input.mode,
            distance: input.distance,
            reach: vec![input.distance; surfaces.points.len()].into(),
            edge_reach: vec![EDGE_REACH * input.distance; surfaces.edges.len()].into(),
            largest_reach: input.distance,
            surfaces: Arc::new(surfaces),
            partners: Arc::new(partners),
            candidates: Mutex::default(),
            last: Mutex::default(),
            memory: Mutex::default(),
            held_normals: Mutex::default(),
        };
        if contact.mode == Mode::Guarded {
            contact.fit_reach(X);
        }
        contact
    }

    /// The same contact that remembers nothing: for a solution of its own, which no other one may influence.
    pub fn anew(&self) -> Contact {
        Contact {
            mode: self.mode,
            distance: self.distance,
            surfaces: self.surfaces.clone(),
            partners: self.partners.clone(),
            reach: self.reach.clone(),
            edge_reach: self.edge_reach.clone(),
            largest_reach: self.largest_reach,
            candidates: Mutex::default(),
            last: Mutex::default(),
            memory: Mutex::default(),
            held_normals: Mutex::default(),
        }
    }

    /// Lowers the activation distances to the distances at the start.
    fn fit_reach(&mut self, X: &[f64]) {
        let p = self.surfaces.positions(X);
        let near = self.candidates_at(Primitives::Edges, &p);
        let (mut reach, mut edge_reach) = (self.reach.to_vec(), self.edge_reach.to_vec());
        for &[s, t] in &near.point_triangle {
            let d = point_triangle(&self.triangle_points(s, t, &p)).squared().sqrt();
            let reach = &mut reach[s as usize];
            *reach = reach.min(d);
        }
        for &[e, f] in &near.edge_edge {
            let d = edge_edge(&self.edge_points(e, f, &p)).squared().sqrt();
            for edge in [e, f] {
                let reach = &mut edge_reach[edge as usize];
                *reach = reach.min(d);
            }
        }
        (self.reach, self.edge_reach) = (reach.into(), edge_reach.into());
    }

    fn triangle_points(&self, s: u32, t: u32, p: &[Vector3<f64>]) -> Points {
        let [a, b, c] = self.surfaces.triangles[t as usize];
        [s, a, b, c].map(|i| p[i as usize])
    }

    fn edge_points(&self, e: u32, f: u32, p: &[Vector3<f64>]) -> Points {
        let [e, f] = [e, f].map(|e| self.surfaces.edges[e as usize].points);
        [e[0], e[1], f[0], f[1]].map(|i| p[i as usize])
    }

    /// Pairs of `primitives` that can be within reach of each other with the points at `p`.
    fn candidates_at(&self, primitives: Primitives, p: &[Vector3<f64>]) -> Arc<Candidates> {
        self.candidates_between(primitives, p, p)
    }

    fn candidates_between(
        &self,
        primitives: Primitives,
        from: &[Vector3<f64>],
        to: &[Vector3<f64>],
    ) -> Arc<Candidates> {
        let held = || self.candidates.lock().expect("no thread panics while it holds the list");
        let list = held().clone();
        if list.covers(primitives, from) && list.covers(primitives, to) {
            return list;
        }
        let (all, reach) = (&self.surfaces, self.largest_reach);
        let list = Candidates::new(all, &self.partners, primitives, from, to, SLACK * reach, reach);
        let list = Arc::new(list);
        *held() = list.clone();
        list
    }

    /// Terms of the potential at positions `x` \[m\] of the local nodes.
    fn terms(&self, x: &[f64], softness: f64) -> Arc<Terms> {
        let held = || self.last.lock().expect("no thread panics while it holds the terms");
        let last = held().clone();
        if last.x == x && last.softness == softness {
            return last;
        }
        let p = self.surfaces.positions(x);
        let stencils = match self.mode {
            Mode::Guarded if softness > 0.0 => self.soft_barriers(&p, softness),
            Mode::Guarded => self.barriers(&p),
            Mode::Cheap => self.springs(&p),
        };
        let terms = Arc::new(Terms { x: x.to_vec(), softness, p, stencils });
        *held() = terms.clone();
        terms
    }

    /// Barriers of the guarded mode with the collision points at `p`.
    fn barriers(&self, p: &[Vector3<f64>]) -> Vec<Stencil> {
        let near = self.candidates_at(Primitives::Edges, p);
        let samples = self.sample_barriers(&near.point_triangle, p);
        let edges = near
            .edge_edge
            .par_chunks(512)
            .map(|chunk| chunk.iter().filter_map(|&[e, f]| self.edge_stencil(e, f, p)).collect::<Vec<_>>());
        let edges: Vec<Vec<Stencil>> = edges.collect();
        [samples, edges.concat()].concat()
    }

    /// Barriers of the samples in the list `near` of (sample, triangle), ascending.
    fn sample_barriers(&self, near: &[[u32; 2]], p: &[Vector3<f64>]) -> Vec<Stencil> {
        let of_samples: Vec<&[[u32; 2]]> = near.chunk_by(|a, b| a[0] == b[0]).collect();
        let samples = of_samples.par_chunks(128).map(|chunk| {
            let mut out = Vec::new();
            chunk.iter().for_each(|list| self.sample_stencils(list, p, &mut out));
            out
        });
        samples.collect::<Vec<_>>().concat()
    }

    /// Terms of one sample: triangles within reach, less the edges they share, plus the corners.
    fn sample_stencils(&self, near: &[[u32; 2]], p: &[Vector3<f64>], out: &mut Vec<Stencil>) {
        let s = near[0][0];
        let all = &self.surfaces;
        let reach = self.reach[s as usize];
        let within =
            |&&[_, t]: &&[u32; 2]| point_triangle(&self.triangle_points(s, t, p)).squared() < reach * reach;
        let triangles: Vec<u32> = near.iter().filter(within).map(|n| n[1]).collect();
        // (kind of feature, which) and how often it counts: 0 triangle, 1 edge, 2 corner.
        let mut counts: Vec<((u8, u32), f64)> = Vec::new();
        let mut count = |key: (u8, u32), by: f64| match counts.iter_mut().find(|(k, _)| *k == key) {
            Some((_, n)) => *n += by,
            None => counts.push((key, by)),
        };
        let mut edges: Vec<(u32, f64)> = Vec::new();
        let mut corners: Vec<(u32, f64)> = Vec::new();
        for &t in &triangles {
            let (which, _) = feature(&self.triangle_points(s, t, p));
            let key = match which {
                Feature::Face => (0, t),
                Feature::Edge(e) => (1, all.triangle_edges[t as usize][e as usize]),
                Feature::Vertex(v) => (2, all.triangles[t as usize][v as usize]),
            };
            count(key, 1.0);
            if triangles.len() > 1 {
                all.triangle_edges[t as usize].iter().for_each(|&e| tally(&mut edges, e, 1.0, 0.0));
                all.triangles[t as usize].iter().for_each(|&v| tally(&mut corners, v, -1.0, 1.0));
            }
        }
        for &(e, n) in edges.iter().filter(|(_, n)| *n > 1.0) {
            let [a, b] = all.edges[e as usize].points;
            [a, b].iter().for_each(|&v| tally(&mut corners, v, n - 1.0, 1.0));
            let closest = point_edge(&[s, a, b, b].map(|i| p[i as usize]));
            if closest.squared() < reach * reach {
                let key = match closest.n_free {
                    1 => (1, e),
                    _ => (2, if closest.c[1] == 0.0 { b } else { a }),
                };
                count(key, 1.0 - n);
            }
        }
        for &(v, n) in corners.iter().filter(|(_, n)| *n != 0.0) {
            if (p[s as usize] - p[v as usize]).norm_squared() < reach * reach {
                count((2, v), n);
            }
        }
        for ((kind, which), n) in counts.into_iter().filter(|(_, n)| *n != 0.0) {
            let (points, other) = match kind {
                0 => {
                    let [a, b, c] = all.triangles[which as usize];
                    ([s, a, b, c], all.triangle_stiffness[which as usize])
                }
                1 => {
                    let Edge { points: [a, b], stiffness, .. } = all.edges[which as usize];
                    ([s, a, b, b], stiffness)
                }
                _ => ([s, which, which, which], all.stiffness[which as usize]),
            };
            let x = points.map(|i| p[i as usize]);
            let closest = match kind {
                0 => point_triangle(&x),
                1 => point_edge(&x),
                _ => point_point(&x),
            };
            let scale = 0.5 * n * all.areas[s as usize] * all.stiffness[s as usize].min(other);
            out.push(Stencil { points, closest, scale, law: Law::Barrier(reach), edges: 0.0 });
        }
    }

    fn edge_stencil(&self, e: u32, f: u32, p: &[Vector3<f64>]) -> Option<Stencil> {
        let reach = self.edge_reach[e as usize].min(self.edge_reach[f as usize]);
        let closest = edge_edge(&self.edge_points(e, f, p));
        if closest.squared() >= reach * reach {
            return None;
        }
        let (e, f) = (&self.surfaces.edges[e as usize], &self.surfaces.edges[f as usize]);
        let points = [e.points[0], e.points[1], f.points[0], f.points[1]];
        let scale = 0.25 * (e.area + f.area) * e.stiffness.min(f.stiffness);
        Some(Stencil {
            points,
            closest,
            scale,
            law: Law::Barrier(reach),
            edges: e.squared_length * f.squared_length,
        })
    }

    /// Stiffness \[Pa\] of the layer between a sample and a triangle: that of the softer side.
    fn stiffness(&self, sample: u32, triangle: u32) -> f64 {
        let all = &self.surfaces;
        all.stiffness[sample as usize].min(all.triangle_stiffness[triangle as usize])
    }

    /// Π \[J\]. With `softness` above zero the softened one of the guarded mode, see `soft.rs`.
    pub fn energy(&self, x: &[f64], softness: f64) -> f64 {
        let terms = self.terms(x, softness);
        let (p, stencils) = (&terms.p, &terms.stencils);
        let energies: Vec<f64> = stencils
            .par_iter()
            .with_min_len(512)
            .map(|s| s.energy(&s.points.map(|i| p[i as usize])))
            .collect();
        energies.iter().sum()
    }

    /// Adds ∂Π/∂x \[N\] over the local nodes.
    pub fn add_gradient(&self, x: &[f64], softness: f64, g: &mut [f64]) {
        let terms = self.terms(x, softness);
        let (p, stencils) = (&terms.p, &terms.stencils);
        let forces: Vec<[Vector3<f64>; 4]> = stencils
            .par_iter()
            .with_min_len(512)
            .map(|s| s.gradient(&s.points.map(|i| p[i as usize])))
            .collect();
        for (stencil, forces) in stencils.iter().zip(&forces) {
            for (&point, force) in stencil.points.iter().zip(forces) {
                for (node, weight) in self.surfaces.points[point as usize].weighted_nodes() {
                    for c in 0..3 {
                        g[3 * node as usize + c] += weight * force[c];
                    }
                }
            }
        }
    }

    /// ∂²Π/∂x∂x \[N/m\] as blocks between local nodes, both triangles, ascending by (row, column). With `convexity` above zero less that
    /// fraction of the negative curvatures of every term between a point and the inside of a triangle, and less all of those of the others: a
    /// point beside an edge or corner sees a fillet as small as the gap, whose negative curvature nothing makes up for.
    pub fn hessian(&self, x: &[f64], softness: f64, convexity: f64) -> Vec<([u32; 2], [f64; 9])> {
        let terms = self.terms(x, softness);
        let (p, stencils) = (&terms.p, &terms.stencils);
        let matrices: Vec<Matrix12> = stencils
            .par_iter()
            .with_min_len(64)
            .map(|s| {
                let fraction = if s.is_face() || convexity == 0.0 { convexity } else { 1.0 };
                s.lifted_hessian(&s.points.map(|i| p[i as usize]), fraction)
            })
            .collect();
        // Which (stencil, point) each node takes part in.
        let mut at_node: Vec<(u32, u32, u8, f64)> = Vec::new();
        for (k, stencil) in stencils.iter().enumerate() {
            for (i, &point) in stencil.points.iter().enumerate().filter(|(i, _)| stencil.weighs(*i)) {
                let parts = self.surfaces.points[point as usize].weighted_nodes();
                at_node.extend(parts.map(|(node, weight)| (node, k as u32, i as u8, weight)));
            }
        }
        at_node.sort_by_key(|entry| (entry.0, entry.1, entry.2));
        let rows: Vec<&[(u32, u32, u8, f64)]> = at_node.chunk_by(|a, b| a.0 == b.0).collect();
        let blocks: Vec<Vec<([u32; 2], [f64; 9])>> = rows
            .par_iter()
            .with_min_len(16)
            .map(|row| {
                let mut blocks: Vec<([u32; 2], [f64; 9])> = Vec::new();
                for &(node, k, i, weight) in row.iter() {
                    let (stencil, H) = (&stencils[k as usize], &matrices[k as usize]);
                    let i = i as usize;
                    for (j, &point) in stencil.points.iter().enumerate().filter(|(j, _)| stencil.weighs(*j)) {
                        for (other, fraction) in self.surfaces.points[point as usize].weighted_nodes() {
                            let at = match blocks.binary_search_by_key(&other, |b| b.0[1]) {
                                Ok(at) => at,
                                Err(at) => {
                                    blocks.insert(at, ([node, other], [0.0; 9]));
                                    at
                                }
                            };
                            let block = &mut blocks[at].1;
                            for (e, value) in block.iter_mut().enumerate() {
                                *value += weight * fraction * H[3 * i + e / 3][3 * j + e % 3];
                            }
                        }
                    }
                }
                blocks
            })
            .collect();
        blocks.concat()
    }

    /// Greatest fraction 0..=1 of the way from `from` to `to` (positions of the local nodes, m) that touches nothing; in the
    /// cheap mode the fraction on which no penetration can escape notice.
    pub fn collision_free_step(&self, from: &[f64], to: &[f64]) -> f64 {
        let (start, end) = (self.surfaces.positions(from), self.surfaces.positions(to));
        let farthest = ccd::largest(start.iter().zip(&end).map(|(a, b)| b - a));
        if !farthest.is_finite() {
            return 0.0;
        }
        if self.mode == Mode::Cheap {
            // A point that comes deeper than half an element finds its way out on the other side.
            return (0.5 * self.surfaces.edge_length / farthest).min(1.0);
        }
        // Long ways in pieces of an edge's length, so that the boxes of the ways do not meet everything.
        let n = ((farthest / self.surfaces.edge_length).ceil() as usize).clamp(1, MAX_PIECES);
        let at = |k: usize| -> Vec<Vector3<f64>> {
            match k {
                0 => start.clone(),
                k if k == n => end.clone(),
                k => start.iter().zip(&end).map(|(a, b)| a + (b - a) * (k as f64 / n as f64)).collect(),
            }
        };
        for k in 0..n {
            let fraction = self.straight_step(&at(k), &at(k + 1));
            if fraction < 1.0 {
                return (k as f64 + fraction) / n as f64;
            }
        }
        1.0
    }

    fn straight_step(&self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        let near = self.candidates_between(Primitives::Edges, from, to);
        let triangles = near.point_triangle.par_iter().with_min_len(512).map(|&[s, t]| {
            let [from, to] = [from, to].map(|p| self.triangle_points(s, t, p));
            ccd::point_triangle_step(&from, &to, ccd::tenth)
        });
        let edges = near.edge_edge.par_iter().with_min_len(512).map(|&[e, f]| {
            let [from, to] = [from, to].map(|p| self.edge_points(e, f, p));
            ccd::edge_edge_step(&from, &to, ccd::tenth)
        });
        triangles.chain(edges).reduce(|| 1.0, f64::min)
    }
}

/// Pieces at most into which a way is cut.
const MAX_PIECES: usize = 64;

fn tally(list: &mut Vec<(u32, f64)>, key: u32, by: f64, start: f64) {
    match list.iter_mut().find(|(k, _)| *k == key) {
        Some((_, n)) => *n += by,
        None => list.push((key, start + by)),
    }
}
