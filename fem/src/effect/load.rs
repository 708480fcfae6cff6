//! Dead loads: gravity and given nodal forces.

use super::{Effect, EffectKind, Groups, State, point};
use crate::element::SolidElement;

/// Nodal forces that keep their direction: Π = −c Σ f·x, c the value of a control.
pub struct DeadLoad {
    groups: Groups,
    control: usize,
    forces: Vec<[f64; 3]>,
}

impl DeadLoad {
    /// Forces \[N\] on nodes at unit value of the control with index `control`.
    pub fn new(name: &str, control: usize, loads: &[(u32, [f64; 3])]) -> Self {
        let nodes: Vec<[u32; 1]> = loads.iter().map(|l| [l.0]).collect();
        DeadLoad {
            groups: Groups::new(name, EffectKind::Load, &nodes, vec![[f64::NAN; 3]; loads.len()]),
            control,
            forces: loads.iter().map(|l| l.1).collect(),
        }
    }
}

/// Adds the weight \[N\] of one element, ∫ρ g N_a dV, to `loads`, 3 per node of the element.
///
/// `n`: shape functions at the quadrature points; `force_density`: ρ g \[N/m³\].
pub fn add_weight<const N: usize, const G: usize>(
    element: &SolidElement<N, G>,
    n: &[[f64; N]; G],
    force_density: [f64; 3],
    loads: &mut [[f64; 3]; N],
) {
    for g in 0..G {
        for a in 0..N {
            for i in 0..3 {
                loads[a][i] += element.w[g] * n[g][a] * force_density[i];
            }
        }
    }
}

impl Effect for DeadLoad {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let work = |(&n, f): (&u32, &[f64; 3])| {
            let x = point(s.x, n);
            f[0] * x[0] + f[1] * x[1] + f[2] * x[2]
        };
        -s.controls[self.control] * self.nodes().iter().zip(&self.forces).map(work).sum::<f64>()
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        let c = s.controls[self.control];
        for (out, f) in out.chunks_exact_mut(3).zip(&self.forces[first..]) {
            out.copy_from_slice(&f.map(|f| -c * f));
        }
    }

    fn stiffness(&self, _: &State, _: f64, _: usize, out: &mut [f64]) {
        out.fill(0.0);
    }

    fn is_linear(&self) -> bool {
        true
    }
}
