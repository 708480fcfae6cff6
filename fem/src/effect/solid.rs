//! Solid elements of one region and one law.

use super::{Effect, EffectKind, Groups, SolidState, State, mean, point};
use crate::element::{Formulation, Rule, SolidElement};
use crate::material::Material;
use rayon::prelude::*;

/// The law of each element of a region.
pub trait LawField: Send + Sync {
    /// Law at one element.
    type Law<'a>: Material
    where
        Self: 'a;
    /// Law of element `cell` under the controls of `s`.
    fn law<'a>(&'a self, cell: usize, s: &State<'a>) -> Self::Law<'a>;
    /// Direction of the fibres at rest in element `cell`, a unit vector; `None` where the law has none.
    fn fibre(&self, _cell: usize) -> Option<nalgebra::Vector3<f64>> {
        None
    }
}

/// The same law everywhere.
pub struct Uniform<L>(pub L);

impl<L: Material> LawField for Uniform<L> {
    type Law<'a>
        = L
    where
        L: 'a;
    #[inline(always)]
    fn law<'a>(&'a self, _: usize, _: &State<'a>) -> L {
        self.0
    }
}

/// Solid elements with `N` nodes and `G` quadrature points.
pub struct Solid<F, const N: usize, const G: usize> {
    groups: Groups,
    field: F,
    formulation: Formulation,
    elements: Vec<SolidElement<N, G>>,
    /// Factor on the energy density of each element; empty: 1 everywhere.
    scale: Vec<f64>,
}

/// Least number of elements handed to one task.
const CHUNK: usize = 64;

impl<F: LawField, const N: usize, const G: usize> Solid<F, N, G> {
    /// Elements with nodes `nodes` (indices into `points` \[m\]); `Err` names the first element whose reference
    /// shape is inverted or flat, with its det(∂X/∂ξ).
    pub fn new(
        name: &str,
        field: F,
        formulation: Formulation,
        rule: &Rule<N, G, 3>,
        points: &[[f64; 3]],
        nodes: Vec<[u32; N]>,
    ) -> Result<Self, (usize, f64)> {
        let mut elements = Vec::with_capacity(nodes.len());
        let mut centroids = Vec::with_capacity(nodes.len());
        for (cell, n) in nodes.iter().enumerate() {
            let X = n.map(|n| points[n as usize]);
            elements.push(SolidElement::new(rule, &X).map_err(|det| (cell, det))?);
            centroids.push(mean(&X));
        }
        Ok(Solid {
            groups: Groups::new(name, EffectKind::Matrix, &nodes, centroids),
            field,
            formulation,
            elements,
            scale: Vec::new(),
        })
    }

    /// The same with a factor on the energy density of each element.
    pub fn scaled(mut self, scale: Vec<f64>) -> Self {
        assert!(scale.is_empty() || scale.len() == self.elements.len(), "one factor per element");
        self.scale = scale;
        self
    }

    #[inline(always)]
    fn scale(&self, cell: usize) -> f64 {
        if self.scale.is_empty() { 1.0 } else { self.scale[cell] }
    }

    /// Least det F of an element; not a number where its positions are not.
    fn det_f(&self, s: &State, cell: usize) -> f64 {
        let x = self.positions(cell, s);
        let det = |g| self.elements[cell].deformation_gradient(g, &x).determinant();
        (0..G).map(det).fold(f64::INFINITY, f64::min)
    }

    #[inline(always)]
    fn positions(&self, cell: usize, s: &State) -> [[f64; 3]; N] {
        self.groups.nodes(cell).map(|n| point(s.x, n))
    }
}

impl<F: LawField, const N: usize, const G: usize> Effect for Solid<F, N, G> {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let energies: Vec<f64> = (0..self.elements.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|c| {
                let (law, x) = (self.field.law(c, s), self.positions(c, s));
                self.scale(c) * self.elements[c].energy(self.formulation, &law, &x)
            })
            .collect();
        energies.iter().sum()
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (c, out) in (first..).zip(out.chunks_exact_mut(3 * N)) {
            let law = self.field.law(c, s);
            let f = self.elements[c].gradient(self.formulation, &law, &self.positions(c, s));
            let scale = self.scale(c);
            out.iter_mut().zip(f.as_flattened()).for_each(|(out, f)| *out = scale * f);
        }
    }

    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        for (c, out) in (first..).zip(out.chunks_exact_mut(9 * N * N)) {
            let law = self.field.law(c, s);
            self.elements[c].hessian(self.formulation, &law, &self.positions(c, s), convexity, out);
            if !self.scale.is_empty() {
                out.iter_mut().for_each(|k| *k *= self.scale[c]);
            }
        }
    }

    fn solid_state(&self, s: &State, group: usize) -> Option<SolidState> {
        let element = &self.elements[group];
        let x = self.positions(group, s);
        let cauchy = element.mean_cauchy(self.formulation, &self.field.law(group, s), &x) * self.scale(group);
        let fibre = self.field.fibre(group).map(|a0| element.mean_deformation_gradient(&x) * a0);
        Some(SolidState { volume: element.volume, volume_ratio: element.dilatation(&x), cauchy, fibre })
    }

    fn group_det_f(&self, s: &State, group: usize) -> Option<(f64, usize)> {
        Some((self.det_f(s, group), group))
    }

    fn least_det_f(&self, s: &State) -> Option<(f64, usize)> {
        let least: Vec<f64> =
            (0..self.elements.len()).into_par_iter().with_min_len(CHUNK).map(|c| self.det_f(s, c)).collect();
        let mut worst = None;
        for (c, &d) in least.iter().enumerate() {
            if worst.is_none_or(|(w, _)| d < w || d.is_nan()) {
                worst = Some((d, c));
            }
        }
        worst
    }
}
