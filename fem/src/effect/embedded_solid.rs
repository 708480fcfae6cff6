//! Solid elements whose nodes are fixed means of others, as those of a mesh in a coarse grid: one group per cluster of elements, over
//! the nodes that move them.
//!
//! Mean dilatation is one for a cluster. Element by element it would lock: the eight corners of a cube cannot keep the volume of every one of
//! the many elements in it.

use super::solid::LawField;
use super::{Effect, EffectKind, Groups, NO_NODE, SolidState, State, point};
use crate::element::{Cluster, Formulation};
use rayon::prelude::*;

/// Clusters of solid elements of one region.
pub struct EmbeddedSolid<F> {
    groups: Groups,
    field: F,
    formulation: Formulation,
    clusters: Vec<Cluster>,
    /// Number of elements before each cluster.
    first: Vec<usize>,
    /// Index in the mesh of each element.
    cells: Vec<u32>,
    /// Cluster of each element.
    cluster: Vec<u32>,
    /// Factor on the energy density of each element; empty: 1 everywhere.
    scale: Vec<f64>,
}

impl<F: LawField> EmbeddedSolid<F> {
    /// Clusters over `nodes_per_group` places each in `nodes`, filled up with [`NO_NODE`]; `centroids` \[m\] one per cluster.
    ///
    /// `cells`, `field` and `scale` (empty: 1) go through the elements of all clusters in their order.
    pub fn new(
        name: &str,
        (field, formulation, scale): (F, Formulation, Vec<f64>),
        (nodes_per_group, nodes): (usize, Vec<u32>),
        clusters: Vec<Cluster>,
        centroids: Vec<[f64; 3]>,
        cells: Vec<u32>,
    ) -> Self {
        assert!(scale.is_empty() || scale.len() == cells.len(), "one factor per element");
        let mut first = vec![0];
        let mut cluster = Vec::with_capacity(cells.len());
        for (c, of) in clusters.iter().enumerate() {
            cluster.extend(std::iter::repeat_n(c as u32, of.parts.len()));
            first.push(cluster.len());
        }
        assert_eq!(cluster.len(), cells.len(), "one cell per element");
        let groups = Groups::of_size(name, EffectKind::Matrix, nodes_per_group, nodes, centroids);
        EmbeddedSolid { groups, field, formulation, clusters, first, cells, cluster, scale }
    }

    /// Places of the nodes of a cluster \[m\].
    fn places(&self, cluster: usize, s: &State) -> Vec<[f64; 3]> {
        let m = self.groups.nodes_per_group;
        let nodes = &self.groups.nodes[cluster * m..(cluster + 1) * m];
        nodes.iter().take_while(|n| **n != NO_NODE).map(|&n| point(s.x, n)).collect()
    }

    /// Law and scale of each part of a cluster.
    fn laws<'a>(&'a self, cluster: usize, s: &'a State<'a>) -> impl Fn(usize) -> (F::Law<'a>, f64) + 'a {
        let first = self.first[cluster];
        move |part| {
            let scale = self.scale.get(first + part).copied().unwrap_or(1.0);
            (self.field.law(first + part, s), scale)
        }
    }

    /// Least det F of a cluster and the element where it is.
    fn least(&self, cluster: usize, s: &State) -> (f64, usize) {
        let x = self.places(cluster, s);
        let parts = self.clusters[cluster].parts.iter().map(|part| part.least_det_f(&x));
        worst(parts.zip(self.first[cluster]..)).expect("a cluster has elements")
    }
}

/// The least of some values, or one that is not a number, with where it is.
fn worst(values: impl Iterator<Item = (f64, usize)>) -> Option<(f64, usize)> {
    values.reduce(|worst, now| if now.0 < worst.0 || now.0.is_nan() { now } else { worst })
}

impl<F: LawField> Effect for EmbeddedSolid<F> {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let of = |c: usize| self.clusters[c].energy(self.formulation, self.laws(c, s), &self.places(c, s));
        let energies: Vec<f64> = (0..self.clusters.len()).into_par_iter().map(of).collect();
        energies.iter().sum()
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        let m = 3 * self.groups.nodes_per_group;
        for (c, out) in (first..).zip(out.chunks_exact_mut(m)) {
            let x = self.places(c, s);
            let (own, rest) = out.split_at_mut(3 * x.len());
            self.clusters[c].gradient(self.formulation, self.laws(c, s), &x, own);
            rest.fill(0.0);
        }
    }

    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        let m = 3 * self.groups.nodes_per_group;
        for (c, out) in (first..).zip(out.chunks_exact_mut(m * m)) {
            let x = self.places(c, s);
            let n = 3 * x.len();
            let mut small = vec![0.0; n * n];
            self.clusters[c].hessian(self.formulation, self.laws(c, s), &x, convexity, &mut small);
            out.fill(0.0);
            for (row, small) in out.chunks_exact_mut(m).zip(small.chunks_exact(n)) {
                row[..n].copy_from_slice(small);
            }
        }
    }

    fn cells(&self) -> Option<&[u32]> {
        Some(&self.cells)
    }

    fn solid_state(&self, s: &State, cell: usize) -> Option<SolidState> {
        let c = self.cluster[cell] as usize;
        let (cluster, at) = (&self.clusters[c], cell - self.first[c]);
        let (x, part) = (self.places(c, s), &cluster.parts[at]);
        let fibre = self.field.fibre(cell).map(|a0| part.mean_deformation_gradient(&x) * a0);
        let cauchy = cluster.mean_cauchy(self.formulation, self.laws(c, s), at, &x);
        Some(SolidState { volume: part.volume, volume_ratio: part.dilatation(&x), cauchy, fibre })
    }

    fn group_det_f(&self, s: &State, group: usize) -> Option<(f64, usize)> {
        Some(self.least(group, s))
    }

    fn least_det_f(&self, s: &State) -> Option<(f64, usize)> {
        let all: Vec<_> = (0..self.clusters.len()).into_par_iter().map(|c| self.least(c, s)).collect();
        worst(all.into_iter())
    }
}
