//! A load without potential, as the solver sees it: a quadratic model about where the nodes were last looked at.
//!
//! With the forces f and the symmetric part S of their derivative at the anchor x₀ the model is Π(x) = f·(x − x₀) + ½ (x − x₀)·S (x − x₀).
//! At the anchor its gradient is the true force. Newton's method moves the anchor to every iterate, so that its residual is the true one and
//! every step still descends an energy; what is lost is the unsymmetric part of the stiffness, and with it quadratic convergence.

use super::{Effect, Groups, NO_NODE, State};

/// The model of `effect` about the positions `anchor` \[m\] of all nodes.
pub struct Anchored<'a> {
    /// The load.
    pub effect: &'a dyn Effect,
    /// Where the nodes were last looked at.
    pub anchor: &'a [f64],
}

impl Anchored<'_> {
    fn at<'a>(&'a self, s: &State<'a>) -> State<'a> {
        State { x: self.anchor, controls: s.controls }
    }

    /// x − x₀ of the nodes of a group, and S (x − x₀).
    fn displaced(&self, s: &State, group: usize) -> (Vec<f64>, Vec<f64>) {
        let m = self.effect.nodes_per_group();
        let nodes = &self.effect.nodes()[m * group..m * (group + 1)];
        let d: Vec<f64> = nodes
            .iter()
            .flat_map(|&n| {
                std::array::from_fn::<f64, 3, _>(|i| match n {
                    NO_NODE => 0.0,
                    n => s.x[3 * n as usize + i] - self.anchor[3 * n as usize + i],
                })
            })
            .collect();
        let mut k = vec![0.0; 9 * m * m];
        self.effect.stiffness(&self.at(s), 0.0, group, &mut k);
        let Sd = k.chunks_exact(3 * m).map(|row| row.iter().zip(&d).map(|(k, d)| k * d).sum()).collect();
        (d, Sd)
    }
}

impl Effect for Anchored<'_> {
    fn groups(&self) -> &Groups {
        self.effect.groups()
    }

    fn energy(&self, s: &State) -> f64 {
        let mut f = vec![0.0; 3 * self.effect.nodes_per_group()];
        let mut energy = 0.0;
        for group in 0..self.groups().len() {
            self.effect.forces(&self.at(s), group, &mut f);
            let (d, Sd) = self.displaced(s, group);
            energy += (0..d.len()).map(|i| d[i] * (f[i] + 0.5 * Sd[i])).sum::<f64>();
        }
        energy
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        self.effect.forces(&self.at(s), first, out);
        for (group, out) in (first..).zip(out.chunks_exact_mut(3 * self.effect.nodes_per_group())) {
            let (_, Sd) = self.displaced(s, group);
            out.iter_mut().zip(Sd).for_each(|(f, Sd)| *f += Sd);
        }
    }

    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        self.effect.stiffness(&self.at(s), convexity, first, out);
    }
}
