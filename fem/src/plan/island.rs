//! An island: nodes that nothing connects to the rest, the effects on them, and what is prescribed.
//!
//! Prescribed nodes are eliminated: they keep their place in the island but are no unknowns. Components that follow a
//! master node (a rigid plane) are eliminated too, by moving their rows and columns onto the master's. Nodes that slide in directions that are
//! no axes keep three unknowns, of which only what lies in these directions counts ([`Slide`]).

#![allow(non_snake_case)]

use super::free::FreeBody;
use super::load::{Load, Mean, Motion, on_supports};
use super::predictor::KinematicPredictor;
use super::slide::Slide;
use super::tied::{TiedGroup, tied_group};
use crate::contact::{Contact, ContactTerm};
use crate::effect::{Effect, EffectKind, IslandTerm, NO_NODE, State};
use crate::solve::{Galerkin, PRESCRIBED, Pattern, Slots};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// The fixed part of an island, shared by all states of it.
pub struct Island {
    /// Name of its first region.
    pub name: String,
    /// Index in the mesh of each local node.
    pub nodes: Vec<u32>,
    /// Reference positions \[m\], 3 per local node.
    pub X: Vec<f64>,
    /// Effects over local nodes.
    pub effects: Vec<Box<dyn Effect>>,
    /// Index in the mesh (or in its list in the scene) of each cell of each effect ([`Effect::cells`]).
    pub cells: Vec<Vec<u32>>,
    /// What each component of each local node does; followers name local nodes.
    pub motion: Vec<[Motion; 3]>,
    /// Local nodes that slide; those that they follow are local too.
    pub(super) slides: BTreeMap<u32, Slide>,
    /// Local nodes that are fixed means of others, with these.
    pub(super) means: BTreeMap<u32, Mean>,
    /// Bodies whose poses are unknowns, over local nodes.
    pub(super) bodies: Vec<FreeBody>,
    /// What may touch, over local nodes; absent where nothing can.
    pub contact: Option<Arc<Contact>>,
    /// Centre of the nodes tied to each body of the plan \[m\].
    pub(super) pivots: Arc<Vec<[f64; 3]>>,
    /// How bodies drag the free nodes along; found when first needed.
    pub(super) predictor: OnceLock<Option<KinematicPredictor>>,
    /// Local node of each free node.
    pub(super) free_nodes: Vec<u32>,
    pub(super) fixed: Vec<bool>,
    pub(super) pattern: Arc<Pattern>,
    /// Places of the groups of each effect; of one that is put together over means there.
    pub(super) slots: Vec<Slots>,
    /// Of effects on nodes that are fixed means; absent where there are none.
    pub(super) over_means: Option<OverMeans>,
    pub(super) tied: Vec<TiedGroup>,
    /// Effect and group of the cells with a volume all of whose nodes are prescribed.
    prescribed: Vec<(usize, usize)>,
    /// Of each effect of solids the groups that reach supports.
    supported: Vec<Vec<usize>>,
    /// Forces \[N\] below which nothing is in play.
    pub(super) least_scale: f64,
}

/// Effects whose nodes are fixed means of free ones: put together over all their nodes, then handed on to the free ones.
pub(super) struct OverMeans {
    /// Which effects.
    pub(super) effects: Vec<bool>,
    /// Their nodes and what these are means of.
    pub(super) galerkin: Galerkin,
}

impl Island {
    /// Puts an island together; finds the pattern of its stiffness. `n_controls`: those of the plan.
    pub fn new(
        name: String,
        nodes: Vec<u32>,
        X: Vec<f64>,
        effects: Vec<Box<dyn Effect>>,
        cells: Vec<Vec<u32>>,
        motion: Vec<[Motion; 3]>,
        slides: BTreeMap<u32, Slide>,
        means: BTreeMap<u32, Mean>,
        pivots: Arc<Vec<[f64; 3]>>,
        n_controls: usize,
    ) -> Island {
        let mut free = vec![PRESCRIBED; nodes.len()];
        let mut free_nodes = Vec::new();
        let mut fixed = Vec::new();
        for (n, m) in motion.iter().enumerate() {
            if m.iter().any(Motion::is_unknown) && !means.contains_key(&(n as u32)) {
                free[n] = free_nodes.len() as u32;
                free_nodes.push(n as u32);
                fixed.extend(m.map(|m| !matches!(m, Motion::Free | Motion::Slides(_))));
            }
        }
        let follower = |n: u32| {
            n != NO_NODE && motion[n as usize].iter().any(|m| !matches!(m, Motion::Free) && m.is_unknown())
        };
        let free_of = |n: u32| if n == NO_NODE { PRESCRIBED } else { free[n as usize] };
        // Of nodes in grids there are many, of other followers few: those group by group, these effect by effect.
        let is_mean = |n: &u32| *n != NO_NODE && matches!(motion[*n as usize][0], Motion::Mean(_));
        let over: Vec<bool> = effects.iter().map(|effect| effect.nodes().iter().any(is_mean)).collect();
        let mut inner = vec![PRESCRIBED; nodes.len()];
        let mut inner_means = Vec::new();
        for (n, motion) in motion.iter().enumerate().filter(|_| over.contains(&true)) {
            let own = || (free[n] != PRESCRIBED).then(|| vec![(free[n], 1.0)]);
            let part =
                |&(m, w): &(u32, f64)| (free[m as usize] != PRESCRIBED).then_some((free[m as usize], w));
            let of = |mean: &Mean| mean.iter().filter_map(part).collect();
            let is_plain = motion.iter().all(|m| !matches!(m, Motion::Follows(_) | Motion::Slides(_)));
            if let Some(mean) = means.get(&(n as u32)).map(of).or_else(own).filter(|_| is_plain) {
                inner[n] = inner_means.len() as u32;
                inner_means.push(mean);
            }
        }
        let mut tied = Vec::new();
        let mut places: Vec<Vec<u32>> = Vec::new();
        for ((e, effect), &over) in effects.iter().enumerate().zip(&over) {
            let m = effect.nodes_per_group();
            let mut place = Vec::with_capacity(effect.nodes().len());
            for (g, group) in effect.nodes().chunks_exact(m).enumerate() {
                let moves = |n: &u32| match over {
                    true => follower(*n) && inner[*n as usize] == PRESCRIBED,
                    false => follower(*n),
                };
                if group.iter().any(moves) {
                    tied.push(tied_group(e, g, group, &motion, &slides, &means));
                    place.extend(std::iter::repeat_n(PRESCRIBED, m));
                } else {
                    place.extend(group.iter().map(|&n| match (over, n) {
                        (true, n) if n != NO_NODE => inner[n as usize],
                        _ => free_of(n),
                    }));
                }
            }
            places.push(place);
        }
        let stiff = |e: usize| !effects[e].is_linear();
        let groups_of = |e: usize| places[e].chunks_exact(effects[e].nodes_per_group());
        let over_means = over.contains(&true).then(|| {
            let groups = (0..effects.len()).filter(|&e| over[e] && stiff(e)).flat_map(groups_of);
            let pattern = Arc::new(Pattern::new(inner_means.len(), groups));
            let galerkin = Galerkin::new(pattern, inner_means, free_nodes.len());
            OverMeans { effects: over.clone(), galerkin }
        });
        let pairs = over_means.as_ref().map_or_else(Vec::new, |over| over.galerkin.pairs());
        let tied_places: Vec<Vec<u32>> =
            tied.iter().map(|t| t.nodes.iter().map(|&n| free_of(n)).collect()).collect();
        let coupled: Vec<&[u32]> = (0..effects.len())
            .filter(|&e| !over[e] && stiff(e))
            .flat_map(groups_of)
            .chain(tied_places.iter().map(Vec::as_slice))
            .chain(pairs.iter().map(|pair| pair.as_slice()))
            .collect();
        let pattern = Arc::new(Pattern::new(free_nodes.len(), coupled.iter().copied()));
        let pattern_of = |e: usize| match &over_means {
            Some(over) if over.effects[e] => over.galerkin.pattern(),
            _ => &pattern,
        };
        let slots_of =
            |(e, places): (usize, &Vec<u32>)| pattern_of(e).slots(effects[e].nodes_per_group(), places);
        let slots = places.iter().enumerate().map(slots_of).collect();
        let rest = State { x: &X, controls: &vec![0.0; n_controls] };
        let mut prescribed = Vec::new();
        for (e, effect) in effects.iter().enumerate() {
            let groups = effect.nodes().chunks_exact(effect.nodes_per_group()).enumerate();
            let held = groups.filter(|(_, group)| {
                group.iter().all(|&n| free_of(n) == PRESCRIBED && !means.contains_key(&n))
            });
            prescribed
                .extend(held.map(|(g, _)| (e, g)).filter(|&(_, g)| effect.group_det_f(&rest, g).is_some()));
        }
        let is_support = |n: &u32| *n != NO_NODE && motion[*n as usize].iter().any(Motion::is_support);
        let supported = effects.iter().map(|effect| {
            let groups = effect.nodes().chunks_exact(effect.nodes_per_group()).enumerate();
            let is_solid = effect.kind() == EffectKind::Matrix;
            groups.filter(|(_, group)| is_solid && group.iter().any(is_support)).map(|(g, _)| g).collect()
        });
        let supported = supported.collect();
        let least_scale = effects.iter().map(|e| strain_force(e.as_ref(), &rest)).fold(0.0, f64::max);
        Island {
            name,
            nodes,
            X,
            effects,
            cells,
            motion,
            slides,
            means,
            bodies: Vec::new(),
            contact: None,
            pivots,
            predictor: OnceLock::new(),
            free_nodes,
            fixed,
            pattern,
            slots,
            over_means,
            tied,
            prescribed,
            supported,
            least_scale,
        }
    }

    /// What belongs to it as a whole, as at the start of a solution.
    pub fn terms(&self) -> Vec<Box<dyn IslandTerm>> {
        let contact = self.contact.iter();
        contact.map(|contact| Box::new(ContactTerm::new(contact)) as Box<dyn IslandTerm>).collect()
    }

    /// Effects that are put together over the free nodes.
    pub(super) fn direct(&self) -> impl Iterator<Item = usize> {
        (0..self.effects.len()).filter(|&e| !self.is_over_means(e))
    }

    /// Effects that are put together over nodes that are means of the free ones.
    pub(super) fn over_means(&self) -> impl Iterator<Item = usize> {
        (0..self.effects.len()).filter(|&e| self.is_over_means(e))
    }

    fn is_over_means(&self, effect: usize) -> bool {
        self.over_means.as_ref().is_some_and(|over| over.effects[effect])
    }

    /// ∂Π/∂x of contact \[N\] over all local nodes, prescribed ones included; `None` where nothing can touch.
    pub fn contact_gradient(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.contact.as_ref().map(|contact| {
            let mut g = vec![0.0; x.len()];
            contact.add_gradient(x, 0.0, &mut g);
            g
        })
    }

    /// Whether nothing of a local node is prescribed.
    pub(super) fn is_free(&self, local: u32) -> bool {
        self.motion[local as usize] == [Motion::Free; 3]
    }

    /// Number of unknowns that are not prescribed.
    pub fn n_unknowns(&self) -> usize {
        self.fixed.iter().filter(|f| !**f).count()
    }

    /// Components of its nodes out of those of all nodes of the mesh, 3 per node.
    pub fn gather(&self, all: &[f64]) -> Vec<f64> {
        gather(&self.nodes, all)
    }

    /// Positions \[m\] of the free nodes out of those of all local nodes.
    pub fn free_positions(&self, x: &[f64]) -> Vec<f64> {
        gather(&self.free_nodes, x)
    }

    /// Copies the positions of the free nodes out of those of all local nodes.
    pub(super) fn take_free(&self, all: &[f64], free: &mut [f64]) {
        for (&n, free) in self.free_nodes.iter().zip(free.chunks_exact_mut(3)) {
            free.copy_from_slice(&all[3 * n as usize..3 * n as usize + 3]);
        }
    }

    /// Sets the prescribed components of all local nodes in `x` \[m\].
    pub fn prescribe(&self, load: &Load, x: &mut [f64]) {
        let places = x.as_chunks_mut::<3>().0.iter_mut().zip(self.X.as_chunks::<3>().0);
        for (motion, (x, X)) in self.motion.iter().zip(places) {
            load.prescribe(motion, X, x);
        }
    }

    /// The worst of the cells that `load` turns inside out because all their nodes are prescribed: its det F, and which it is. The solver
    /// never sees them move.
    pub fn folded(&self, load: &Load) -> Option<(f64, String)> {
        if self.prescribed.is_empty() {
            return None;
        }
        let mut x = self.X.clone();
        self.prescribe(load, &mut x);
        let s = State { x: &x, controls: &load.controls };
        let mut worst = None;
        for &(e, g) in &self.prescribed {
            let effect = &self.effects[e];
            let (det, cell) = effect.group_det_f(&s, g).expect("a cell with a volume");
            if !(det > 0.0) && worst.as_ref().is_none_or(|(w, _)| det < *w) {
                worst = Some((det, format!("element {} in `{}`", self.cells[e][cell], effect.name())));
            }
        }
        worst
    }

    /// Adds to `g` what an effect of solids puts on supports \[N\], and what the same groups put elsewhere.
    pub(super) fn add_support_forces(&self, effect: usize, s: &State, g: &mut [f64]) {
        let (e, groups) = (&self.effects[effect], &self.supported[effect]);
        let m = e.nodes_per_group();
        let mut forces = vec![0.0; 3 * m * groups.len()];
        let each = forces.par_chunks_exact_mut(3 * m).zip(groups).with_min_len(FORCE_BATCH);
        each.for_each(|(out, &group)| e.forces(s, group, out));
        let nodes = groups.iter().flat_map(|group| &e.nodes()[m * group..m * (group + 1)]);
        add_at(nodes, &forces, g);
    }

    /// The part of `forces` \[N\] on all local nodes that supports carry.
    pub(super) fn on_supports(&self, forces: &[f64]) -> Vec<f64> {
        let of = |(n, force): (u32, &[f64; 3])| -> [f64; 3] {
            on_supports(&self.motion[n as usize], self.slides.get(&n), Vector3::from(*force)).into()
        };
        (0..).zip(forces.as_chunks::<3>().0).flat_map(of).collect()
    }

    /// ∂Π/∂x \[N\] of one effect over all local nodes, prescribed ones included.
    pub fn effect_gradient(&self, effect: usize, s: &State) -> Vec<f64> {
        let e = &self.effects[effect];
        let m = e.nodes_per_group();
        let mut forces = vec![0.0; 3 * e.nodes().len()];
        let chunks = forces.par_chunks_mut(3 * m * FORCE_BATCH).enumerate();
        chunks.for_each(|(i, out)| e.forces(s, i * FORCE_BATCH, out));
        let mut g = vec![0.0; s.x.len()];
        add_at(e.nodes(), &forces, &mut g);
        g
    }
}

/// Adds `forces`, three for each of `nodes`, to those of all nodes.
fn add_at<'a>(nodes: impl IntoIterator<Item = &'a u32>, forces: &[f64], all: &mut [f64]) {
    for (&n, f) in nodes.into_iter().zip(forces.as_chunks::<3>().0) {
        if n != NO_NODE {
            (0..3).for_each(|c| all[3 * n as usize + c] += f[c]);
        }
    }
}

/// Components of some nodes out of those of all, 3 per node.
fn gather(nodes: &[u32], all: &[f64]) -> Vec<f64> {
    nodes.iter().flat_map(|&n| all[3 * n as usize..3 * n as usize + 3].iter().copied()).collect()
}

/// Norm of the nodal forces \[N\] of an effect under a shear of one millionth, from its first group: a load that strains
/// less than that does not set the scale of the residual, round-off would.
fn strain_force(effect: &dyn Effect, rest: &State) -> f64 {
    if effect.is_linear() || effect.nodes().is_empty() {
        return 0.0;
    }
    let m = effect.nodes_per_group();
    let mut k = vec![0.0; 9 * m * m];
    effect.stiffness(rest, 0.0, 0, &mut k);
    let place = |a: usize| match effect.nodes()[a] {
        NO_NODE => [0.0; 3],
        n => std::array::from_fn(|i| rest.x[3 * n as usize + i]),
    };
    let shear: Vec<f64> = (0..m).flat_map(|a| [place(a)[1], place(a)[2], place(a)[0]]).collect();
    let square = k.chunks_exact(3 * m).map(|row| {
        let f: f64 = row.iter().zip(&shear).map(|(k, u)| k * u).sum();
        f * f
    });
    let n_groups = (effect.nodes().len() / m) as f64;
    1e-6 * (square.sum::<f64>() * n_groups).sqrt()
}

/// Groups whose forces are computed at once.
pub(super) const FORCE_BATCH: usize = 64;
/// Groups whose stiffness is computed at once.
pub(super) const STIFFNESS_BATCH: usize = 16;
