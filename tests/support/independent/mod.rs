//! The residual of a scene's equilibrium by other means than those of the crate: small, slow and plain.
//!
//! Shape functions, quadrature and energies are written down once more from their sources, in numbers of 32 digits, so that round-off
//! of positions far from the origin is in the positions and nowhere else. Stresses come from the energies by differentiation with dual
//! numbers; pressure acts as a traction on the deformed face. Which components are free, what moves together, and which forces are in
//! play follows the documentation of [`fem::scene`] and [`fem::solve::Potential::force_scale`].
//!
//! Contact is left out: nodes of contact surfaces are not judged one by one, but what contact does to them is known from the rest.

mod cells;
mod laws;
mod number;
mod terms;

use fem::mesh::Mesh;
use fem::scene::{Direction, Scene};
use number::Wide;
use std::collections::{BTreeMap, BTreeSet};
use terms::{At, Kind, Term, Vector, masses, terms};

/// What a component of a node does.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Component {
    /// It is an unknown.
    Free,
    /// The scene says where it is.
    Prescribed,
    /// Its displacement is that of a node.
    Follows(u32),
}

/// A scene over its mesh, ready to be judged.
pub struct Independent<'a> {
    mesh: &'a Mesh,
    terms: Vec<Term<'a>>,
    components: Vec<[Component; 3]>,
    /// Groups (term, index) of each island.
    islands: Vec<Vec<(usize, usize)>>,
    masses: Option<Vec<Wide>>,
    /// Nodes of contact surfaces.
    touching: BTreeSet<u32>,
}

/// A state to judge.
pub struct Candidate<'a> {
    /// Positions of all nodes \[m\].
    pub x: &'a [f64],
    /// Value of a control.
    pub control: &'a dyn Fn(&str) -> f64,
    /// With inertia: time step \[s\], positions \[m\] and velocities \[m/s\] at its start.
    pub before: Option<(f64, &'a [f64], &'a [f64])>,
}

/// What is left of the forces on one island.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// All its nodes.
    pub nodes: BTreeSet<u32>,
    /// Norm of the forces on its unknowns \[N\]; not a number or infinite where the state is not admissible.
    pub residual: f64,
    /// Forces in play \[N\].
    pub scale: f64,
    /// Least det F over all quadrature points.
    pub least_det: f64,
    /// Where it has contact: what is missing at each node of a contact surface \[N\], which is what contact has to do.
    pub contact: BTreeMap<u32, [f64; 3]>,
}

impl<'a> Independent<'a> {
    /// `mesh`: as the plan has it.
    pub fn new(scene: &'a Scene, mesh: &'a Mesh) -> Independent<'a> {
        let terms = terms(scene, mesh);
        let components = components(scene, mesh);
        let masses = scene.inertia.as_ref().map(|_| masses(scene, mesh));
        let mut touching = BTreeSet::new();
        for name in scene.contact.iter().flat_map(|c| &c.surfaces) {
            touching.extend(mesh.surfaces[name].iter().flatten());
        }
        let islands = islands(mesh, &terms, &components, &touching);
        Independent { mesh, terms, components, islands, masses, touching }
    }

    /// What each component of each node does.
    pub fn components(&self) -> &[[Component; 3]] {
        &self.components
    }

    /// Judges every island.
    pub fn judge(&self, state: &Candidate) -> Vec<Judgement> {
        let u = displacements(self.mesh, state.x);
        let at = At { mesh: self.mesh, u: &u, control: state.control };
        self.islands.iter().map(|groups| self.judge_island(groups, state, &at)).collect()
    }

    fn judge_island(&self, groups: &[(usize, usize)], state: &Candidate, at: &At) -> Judgement {
        let mut total = BTreeMap::<u32, Vector>::new();
        let mut of_term = BTreeMap::<usize, BTreeMap<u32, Vector>>::new();
        let (mut admissible, mut least_det) = (true, f64::INFINITY);
        for &(t, g) in groups {
            let term = &self.terms[t];
            if let Some(det) = term.least_det(g, at) {
                least_det = if det < least_det || det.is_nan() { det } else { least_det };
            }
            let Some(forces) = term.forces(g, at) else {
                admissible = false;
                continue;
            };
            for (&n, f) in term.groups[g].iter().zip(&forces) {
                let mut f = *f;
                if matches!(term.kind, Kind::Pressure { .. } | Kind::Dead { .. }) {
                    // What a load puts on supports does not count as a force in play.
                    let prescribed = |c: &usize| self.components[n as usize][*c] == Component::Prescribed;
                    (0..3).filter(prescribed).for_each(|c| f[c] = Wide::ZERO);
                }
                add(&mut total, n, f);
                if !matches!(term.kind, Kind::Solid { .. }) {
                    add(of_term.entry(t).or_default(), n, f);
                }
            }
        }
        let mut scale = self.strain_forces(groups);
        let of_effect = of_term.values().map(|forces| norm(forces.values().flatten().copied()));
        scale = of_effect.fold(scale, larger);
        let mut nodes: BTreeSet<u32> = total.keys().copied().collect();
        for n in nodes.clone() {
            nodes.extend(self.components[n as usize].iter().filter_map(|c| match c {
                Component::Follows(master) => Some(*master),
                _ => None,
            }));
        }
        if let (Some(masses), Some((h, x0, v0))) = (&self.masses, state.before) {
            let h = Wide::new(h);
            let before = displacements(self.mesh, x0);
            let mut stopping = Vec::new();
            for &n in &nodes {
                let stiffness = masses[n as usize] / (h * h);
                for c in 0..3 {
                    if self.components[n as usize][c] == Component::Prescribed {
                        continue;
                    }
                    let flight = h * Wide::new(v0[3 * n as usize + c]);
                    stopping.push(stiffness * flight);
                    let mut force = [Wide::ZERO; 3];
                    force[c] = stiffness * (at.u[n as usize][c] - before[n as usize][c] - flight);
                    add(&mut total, n, force);
                }
            }
            scale = larger(scale, norm(stopping.into_iter()));
        }
        let (mut residual, mut reactions) = (BTreeMap::<(u32, usize), Wide>::new(), Vec::new());
        let mut contact = BTreeMap::<u32, [f64; 3]>::new();
        for (&n, f) in &total {
            let touches = self.touching.contains(&n);
            if touches {
                contact.insert(n, f.map(|f| f.value()));
            }
            for c in 0..3 {
                let owner = match self.components[n as usize][c] {
                    Component::Prescribed => {
                        reactions.push(f[c]);
                        continue;
                    }
                    Component::Free => n,
                    Component::Follows(master) => master,
                };
                if !touches {
                    let sum = residual.entry((owner, c)).or_insert(Wide::ZERO);
                    *sum = *sum + f[c];
                }
            }
        }
        scale = larger(scale, norm(reactions.into_iter()));
        if !self.touching.is_empty() {
            // What contact does to what is free is as much as what is missing there.
            scale = larger(scale, contact.values().flatten().map(|f| f * f).sum::<f64>().sqrt());
        }
        let residual = norm(residual.into_values());
        Judgement {
            nodes,
            residual: if admissible { residual } else { f64::INFINITY },
            scale,
            least_det,
            contact,
        }
    }

    /// The largest of the forces of each effect under a shear of one millionth of the mesh, counted from its first group.
    fn strain_forces(&self, groups: &[(usize, usize)]) -> f64 {
        let mut first = BTreeMap::<usize, (usize, usize)>::new();
        for &(t, g) in groups.iter().filter(|(t, _)| self.terms[*t].couples()) {
            first.entry(t).or_insert((g, 0)).1 += 1;
        }
        let mut largest = 0.0;
        for (t, (g, count)) in first {
            let term = &self.terms[t];
            if matches!(term.kind, Kind::Whole { .. }) {
                continue; // only what is across a fibre would count
            }
            let step = 1e-10;
            let origin = self.mesh.points[term.groups[g][0] as usize];
            let sheared = |sign: f64| -> Option<Vec<Vector>> {
                let mut u = vec![[Wide::ZERO; 3]; self.mesh.points.len()];
                for &n in &term.groups[g] {
                    let p = self.mesh.points[n as usize];
                    let away = |i: usize| Wide::new(p[i]) - Wide::new(origin[i]);
                    u[n as usize] = std::array::from_fn(|i| away((i + 1) % 3) * Wide::new(sign * step));
                }
                term.forces(g, &At { mesh: self.mesh, u: &u, control: &|_| 0.0 })
            };
            let (Some(ahead), Some(behind)) = (sheared(1.0), sheared(-1.0)) else { continue };
            let slope = ahead.iter().flatten().zip(behind.iter().flatten()).map(|(a, b)| *a - *b);
            largest = larger(largest, norm(slope) / (2.0 * step) * 1e-6 * (count as f64).sqrt());
        }
        largest
    }
}

fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

fn norm(values: impl Iterator<Item = Wide>) -> f64 {
    values.map(|v| v * v).sum::<Wide>().sqrt().value()
}

fn add(to: &mut BTreeMap<u32, Vector>, n: u32, f: Vector) {
    let sum = to.entry(n).or_insert([Wide::ZERO; 3]);
    *sum = std::array::from_fn(|i| sum[i] + f[i]);
}

fn displacements(mesh: &Mesh, x: &[f64]) -> Vec<Vector> {
    let of = |(x, p): (&[f64], &[f64; 3])| std::array::from_fn(|i| Wide::new(x[i]) - Wide::new(p[i]));
    x.chunks_exact(3).zip(&mesh.points).map(of).collect()
}

fn components(scene: &Scene, mesh: &Mesh) -> Vec<[Component; 3]> {
    let mut components = vec![[Component::Free; 3]; mesh.points.len()];
    for spec in &scene.prescribed {
        for &n in &mesh.node_sets[&spec.nodes] {
            for c in (0..3).filter(|c| spec.components[*c]) {
                components[n as usize][c] = Component::Prescribed;
            }
        }
    }
    for &n in scene.ties.iter().flat_map(|spec| &mesh.node_sets[&spec.nodes]) {
        components[n as usize] = [Component::Prescribed; 3];
    }
    for spec in &scene.planes {
        let nodes = &mesh.node_sets[&spec.nodes];
        let Direction::Axis(axis) = spec.axis else { panic!("planes of random scenes move along axes") };
        for &n in nodes.iter().skip(1) {
            components[n as usize][axis] = Component::Follows(nodes[0]);
        }
    }
    components
}

/// Groups that nothing connects but what is prescribed. A group without an unknown goes with the first island that has one of its nodes
/// among the prescribed ones.
fn islands(
    mesh: &Mesh,
    terms: &[Term],
    components: &[[Component; 3]],
    touching: &BTreeSet<u32>,
) -> Vec<Vec<(usize, usize)>> {
    let moves = |n: &u32| components[*n as usize].iter().any(|c| *c != Component::Prescribed);
    let mut label: Vec<usize> = (0..mesh.points.len()).collect();
    let mut unite = |nodes: &[u32]| {
        let Some(least) = nodes.iter().map(|&n| label[n as usize]).min() else { return };
        let old: BTreeSet<usize> = nodes.iter().map(|&n| label[n as usize]).collect();
        label.iter_mut().filter(|l| old.contains(l)).for_each(|l| *l = least);
    };
    for (n, of) in components.iter().enumerate() {
        for c in of {
            if let Component::Follows(master) = c {
                unite(&[n as u32, *master]);
            }
        }
    }
    for group in terms.iter().filter(|t| t.couples()).flat_map(|t| &t.groups) {
        unite(&group.iter().copied().filter(moves).collect::<Vec<u32>>());
    }
    unite(&touching.iter().copied().filter(moves).collect::<Vec<u32>>());
    let mut at_prescribed = BTreeMap::<u32, usize>::new();
    for group in terms.iter().flat_map(|t| &t.groups) {
        if let Some(&free) = group.iter().find(|n| moves(n)) {
            for &n in group.iter().filter(|n| !moves(n)) {
                at_prescribed.entry(n).or_insert(label[free as usize]);
            }
        }
    }
    let mut islands = BTreeMap::<usize, Vec<(usize, usize)>>::new();
    for (t, term) in terms.iter().enumerate() {
        for (g, group) in term.groups.iter().enumerate() {
            let of = match group.iter().find(|n| moves(n)) {
                Some(&free) => label[free as usize],
                None => *group.iter().find_map(|n| at_prescribed.get(n)).unwrap_or(&(group[0] as usize)),
            };
            islands.entry(of).or_default().push((t, g));
        }
    }
    islands.into_values().collect()
}
