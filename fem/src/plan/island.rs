//! An island: nodes that nothing connects to the rest, the effects on them, and what is prescribed.
//!
//! Prescribed nodes are eliminated: they keep their place in the island but are no unknowns. Components that follow a
//! master node (a rigid plane) are eliminated too, by moving their rows and columns onto the master's. Nodes that slide in directions that are
//! no axes keep three unknowns, of which only what lies in these directions counts ([`Slide`]).

use super::flow::Flow;
use super::slide::Slide;
use crate::body::{Pose, interpolate};
use crate::contact::Contact;
use crate::effect::{Anchored, Effect, NO_NODE, Part, State, TimeStep};
use crate::solve::{BlockMatrix, Loading, PRESCRIBED, Pattern, Potential, Slots};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// What one component of a node does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It is an unknown.
    Free,
    /// It stays where it is in the mesh.
    Held,
    /// It is displaced by the value of a control times a length \[m\].
    Control(usize, f64),
    /// It moves with a body.
    Body(usize),
    /// Its displacement is that of the same component of a node.
    Follows(u32),
    /// It moves with its node, which slides in directions that are no axes: index into [`Plan::slides`](super::Plan::slides).
    Slides(u32),
}

impl Motion {
    /// Whether it is not prescribed altogether.
    pub fn is_unknown(&self) -> bool {
        matches!(self, Motion::Free | Motion::Follows(_) | Motion::Slides(_))
    }

    /// The node whose displacement it takes over.
    pub(super) fn leader(&self, slides: &[Slide]) -> Option<u32> {
        match self {
            Motion::Follows(leader) => Some(*leader),
            Motion::Slides(of) => slides[*of as usize].follows.map(|(leader, ..)| leader),
            _ => None,
        }
    }
}

/// Values of the controls and poses of the bodies at one time, in the order of the plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Load {
    /// Controls.
    pub controls: Vec<f64>,
    /// Poses.
    pub poses: Vec<Pose>,
}

impl Load {
    /// Sets what is prescribed of the place `x` \[m\] of a node that is at `X` \[m\] in the mesh.
    pub fn prescribe(&self, motion: &[Motion; 3], X: &[f64; 3], x: &mut [f64; 3]) {
        for c in 0..3 {
            match motion[c] {
                Motion::Free | Motion::Follows(_) | Motion::Slides(_) => {}
                Motion::Held => x[c] = X[c],
                Motion::Control(control, u) => x[c] = X[c] + self.controls[control] * u,
                Motion::Body(b) => x[c] = (self.poses[b] * nalgebra::Point3::from(*X))[c],
            }
        }
    }

    /// The load a share `t` of the way to `end`; bodies turn about `pivots` \[m\] of the mesh.
    pub fn towards(&self, end: &Load, pivots: &[[f64; 3]], t: f64) -> Load {
        // Both ends exactly: frames of a run meet there.
        if t == 0.0 || t == 1.0 {
            return if t == 0.0 { self.clone() } else { end.clone() };
        }
        let pose = |i: usize| interpolate(&self.poses[i], &end.poses[i], pivots[i].into(), t);
        Load {
            controls: self.controls.iter().zip(&end.controls).map(|(a, b)| a + t * (b - a)).collect(),
            poses: (0..self.poses.len()).map(pose).collect(),
        }
    }
}

/// A group with followers: its nodes with their masters, and which rows move onto which.
struct TiedGroup {
    effect: usize,
    group: usize,
    /// Local nodes, those of the group first.
    nodes: Vec<u32>,
    /// (row of the follower, row of its master), 3 per node.
    moves: Vec<(usize, usize)>,
    /// Places among `nodes` of those that slide, and of those that they follow.
    slides: Vec<(usize, Option<usize>)>,
}

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
    /// Index in the mesh (or in its list in the scene) of each group of each effect.
    pub cells: Vec<Vec<u32>>,
    /// What each component of each local node does; followers name local nodes.
    pub motion: Vec<[Motion; 3]>,
    /// Local nodes that slide; those that they follow are local too.
    slides: BTreeMap<u32, Slide>,
    /// What may touch, over local nodes; absent where nothing can.
    pub contact: Option<Contact>,
    /// Centre of the nodes tied to each body of the plan \[m\].
    pivots: Arc<Vec<[f64; 3]>>,
    /// How bodies drag the free nodes along; found when first needed.
    flow: OnceLock<Option<Flow>>,
    /// Local node of each free node.
    free_nodes: Vec<u32>,
    fixed: Vec<bool>,
    pattern: Arc<Pattern>,
    slots: Vec<Slots>,
    tied: Vec<TiedGroup>,
    /// Effect and group of the cells with a volume all of whose nodes are prescribed.
    prescribed: Vec<(usize, usize)>,
    /// Forces \[N\] below which nothing is in play.
    least_scale: f64,
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
        pivots: Arc<Vec<[f64; 3]>>,
        n_controls: usize,
    ) -> Island {
        let mut free = vec![PRESCRIBED; nodes.len()];
        let mut free_nodes = Vec::new();
        let mut fixed = Vec::new();
        for (n, m) in motion.iter().enumerate() {
            if m.iter().any(Motion::is_unknown) {
                free[n] = free_nodes.len() as u32;
                free_nodes.push(n as u32);
                fixed.extend(m.map(|m| !matches!(m, Motion::Free | Motion::Slides(_))));
            }
        }
        let follower = |n: u32| {
            n != NO_NODE
                && motion[n as usize].iter().any(|m| matches!(m, Motion::Follows(_) | Motion::Slides(_)))
        };
        let free_of = |n: u32| if n == NO_NODE { PRESCRIBED } else { free[n as usize] };
        let mut tied = Vec::new();
        let mut places: Vec<Vec<u32>> = Vec::new();
        for (e, effect) in effects.iter().enumerate() {
            let m = effect.nodes_per_group();
            let mut place = Vec::with_capacity(effect.nodes().len());
            for (g, group) in effect.nodes().chunks_exact(m).enumerate() {
                if group.iter().any(|&n| follower(n)) {
                    tied.push(tied_group(e, g, group, &motion, &slides));
                    place.extend(std::iter::repeat_n(PRESCRIBED, m));
                } else {
                    place.extend(group.iter().map(|&n| free_of(n)));
                }
            }
            places.push(place);
        }
        let tied_places: Vec<Vec<u32>> =
            tied.iter().map(|t| t.nodes.iter().map(|&n| free_of(n)).collect()).collect();
        let coupled: Vec<&[u32]> = effects
            .iter()
            .zip(&places)
            .filter(|(effect, _)| !effect.is_linear())
            .flat_map(|(effect, place)| place.chunks_exact(effect.nodes_per_group()))
            .chain(tied_places.iter().map(Vec::as_slice))
            .collect();
        let pattern = Arc::new(Pattern::new(free_nodes.len(), coupled.iter().copied()));
        let slots = effects.iter().zip(&places).map(|(e, p)| pattern.slots(e.nodes_per_group(), p)).collect();
        let rest = State { x: &X, controls: &vec![0.0; n_controls] };
        let mut prescribed = Vec::new();
        for (e, effect) in effects.iter().enumerate() {
            let groups = effect.nodes().chunks_exact(effect.nodes_per_group()).enumerate();
            let held = groups.filter(|(_, group)| group.iter().all(|&n| free_of(n) == PRESCRIBED));
            prescribed
                .extend(held.map(|(g, _)| (e, g)).filter(|&(_, g)| effect.group_det_f(&rest, g).is_some()));
        }
        let least_scale = effects.iter().map(|e| strain_force(e.as_ref(), &rest)).fold(0.0, f64::max);
        Island {
            name,
            nodes,
            X,
            effects,
            cells,
            motion,
            slides,
            contact: None,
            pivots,
            flow: OnceLock::new(),
            free_nodes,
            fixed,
            pattern,
            slots,
            tied,
            prescribed,
            least_scale,
        }
    }

    /// ∂Π/∂x of contact \[N\] over all local nodes, prescribed ones included; `None` where nothing can touch.
    pub fn contact_gradient(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.soft_contact_gradient(x, 0.0)
    }

    /// The same, softened below the share `floor` of the activation distance.
    fn soft_contact_gradient(&self, x: &[f64], floor: f64) -> Option<Vec<f64>> {
        self.contact.as_ref().map(|contact| {
            let mut g = vec![0.0; x.len()];
            contact.add_gradient(x, floor, &mut g);
            g
        })
    }

    /// Whether nothing of a local node is prescribed.
    fn is_free(&self, local: u32) -> bool {
        self.motion[local as usize] == [Motion::Free; 3]
    }

    /// The unknown that a component of a local node moves with: its free node and component; none where prescribed.
    fn unknown(&self, node: u32, c: usize) -> Option<(u32, usize)> {
        let owner = match self.motion[node as usize][c] {
            Motion::Free | Motion::Slides(_) => node,
            Motion::Follows(master) => master,
            _ => return None,
        };
        self.free_index(owner).map(|free| (free as u32, c))
    }

    /// The free nodes whose unknowns move a local node, with the matrices T of u = Σ T ũ.
    fn movers(&self, node: u32) -> Vec<(u32, Matrix3<f64>)> {
        if let Some(slide) = self.slides.get(&node) {
            let own = self.free_index(node).map(|free| (free as u32, slide.free));
            let leader =
                slide.follows.and_then(|(m, n, w)| Some((self.free_index(m)? as u32, w * n.transpose())));
            return own.into_iter().chain(leader).collect();
        }
        let single = |c: usize| {
            let mut T = Matrix3::zeros();
            T[(c, c)] = 1.0;
            self.unknown(node, c).map(|(free, _)| (free, T))
        };
        (0..3).filter_map(single).collect()
    }

    /// Moves blocks between local nodes onto their unknowns; ascending by (row, column).
    fn onto_unknowns(&self, blocks: Vec<([u32; 2], [f64; 9])>) -> Vec<([u32; 2], [f64; 9])> {
        let mut out: Vec<([u32; 2], [f64; 9])> = Vec::with_capacity(blocks.len());
        for ([i, j], block) in blocks {
            if [i, j].iter().all(|&n| self.is_free(n)) {
                let free = |n| self.free_index(n).expect("a free node") as u32;
                out.push(([free(i), free(j)], block));
                continue;
            }
            if [i, j].iter().any(|n| self.slides.contains_key(n)) {
                let B = Matrix3::from_row_slice(&block);
                for (row, Ti) in self.movers(i) {
                    for (column, Tj) in self.movers(j) {
                        let moved = Ti.transpose() * B * Tj;
                        out.push(([row, column], std::array::from_fn(|e| moved[(e / 3, e % 3)])));
                    }
                }
                continue;
            }
            for e in 0..9 {
                if let (Some((row, r)), Some((column, c))) = (self.unknown(i, e / 3), self.unknown(j, e % 3))
                {
                    let mut single = [0.0; 9];
                    single[3 * r + c] = block[e];
                    out.push(([row, column], single));
                }
            }
        }
        out.sort_by_key(|b| b.0);
        out.dedup_by(|from, to| {
            let same = from.0 == to.0;
            if same {
                to.1.iter_mut().zip(&from.1).for_each(|(to, from)| *to += from);
            }
            same
        });
        out
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
    fn take_free(&self, all: &[f64], free: &mut [f64]) {
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
            let det = effect.group_det_f(&s, g).expect("a cell with a volume");
            if !(det > 0.0) && worst.as_ref().is_none_or(|(w, _)| det < *w) {
                worst = Some((det, format!("element {} in `{}`", self.cells[e][g], effect.name())));
            }
        }
        worst
    }

    /// Moves nodes that slide in `x` \[m\] to where the controls and their own ways take them, followers to where their masters want them.
    fn follow(&self, controls: &[f64], x: &mut [f64]) {
        for (&n, slide) in &self.slides {
            let i = 3 * n as usize;
            let X = Vector3::from_column_slice(&self.X[i..i + 3]);
            let own = slide.free * (Vector3::from_column_slice(&x[i..i + 3]) - X);
            x[i..i + 3].copy_from_slice((X + own + slide.prescribed(controls)).as_slice());
        }
        for (&n, slide) in &self.slides {
            if let Some((m, normal, w)) = slide.follows {
                let m = 3 * m as usize;
                let along: f64 = (0..3).map(|c| normal[c] * (x[m + c] - self.X[m + c])).sum();
                (0..3).for_each(|c| x[3 * n as usize + c] += w[c] * along);
            }
        }
        for &n in &self.free_nodes {
            for c in 0..3 {
                if let Motion::Follows(master) = self.motion[n as usize][c] {
                    let (i, m) = (3 * n as usize + c, 3 * master as usize + c);
                    x[i] = self.X[i] + (x[m] - self.X[m]);
                }
            }
        }
    }

    /// ∂Π/∂x \[N\] of one effect over all local nodes, prescribed ones included.
    pub fn effect_gradient(&self, effect: usize, s: &State) -> Vec<f64> {
        let e = &self.effects[effect];
        let m = e.nodes_per_group();
        let mut forces = vec![0.0; 3 * e.nodes().len()];
        let chunks = forces.par_chunks_mut(3 * m * FORCE_BATCH).enumerate();
        chunks.for_each(|(i, out)| e.forces(s, i * FORCE_BATCH, out));
        let mut g = vec![0.0; s.x.len()];
        for (&n, f) in e.nodes().iter().zip(forces.chunks_exact(3)) {
            if n != NO_NODE {
                for i in 0..3 {
                    g[3 * n as usize + i] += f[i];
                }
            }
        }
        g
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

const FORCE_BATCH: usize = 64;
const STIFFNESS_BATCH: usize = 16;

fn tied_group(
    effect: usize,
    group: usize,
    members: &[u32],
    motion: &[[Motion; 3]],
    slides: &BTreeMap<u32, Slide>,
) -> TiedGroup {
    let mut nodes = members.to_vec();
    let mut moves = Vec::new();
    for (p, &n) in members.iter().enumerate().filter(|(_, n)| **n != NO_NODE) {
        for c in 0..3 {
            if let Motion::Follows(master) = motion[n as usize][c] {
                let q = nodes.iter().position(|&m| m == master).unwrap_or_else(|| {
                    nodes.push(master);
                    nodes.len() - 1
                });
                moves.push((3 * p + c, 3 * q + c));
            }
        }
    }
    let mut sliding = Vec::new();
    for p in 0..nodes.len() {
        if let Some(slide) = slides.get(&nodes[p]) {
            let leader = slide.follows.map(|(leader, ..)| {
                nodes.iter().position(|&m| m == leader).unwrap_or_else(|| {
                    nodes.push(leader);
                    nodes.len() - 1
                })
            });
            sliding.push((p, leader));
        }
    }
    TiedGroup { effect, group, nodes, moves, slides: sliding }
}

/// An island under a load: what the solver minimizes.
pub struct LoadedIsland {
    island: Arc<Island>,
    start: Load,
    end: Load,
    load: Load,
    /// All local nodes; free components are stale.
    x: Vec<f64>,
    /// Where all local nodes were when loads without potential were last looked at; empty where there are none.
    anchor: Vec<f64>,
    /// Share of the activation distance below which contact is softened; 0: nowhere.
    floor: f64,
    /// Inertia over the time step that the load takes; absent: equilibrium is sought.
    inertia: Option<TimeStep>,
    /// Time spent in contact \[ns\].
    in_contact: AtomicU64,
}

impl LoadedIsland {
    /// The island on its way from `start` to `end`.
    pub fn new(island: Arc<Island>, start: Load, end: Load) -> LoadedIsland {
        let mut x = island.X.clone();
        island.prescribe(&start, &mut x);
        let (load, in_contact) = (start.clone(), AtomicU64::new(0));
        let anchor = if island.effects.iter().all(|e| e.has_potential()) { Vec::new() } else { x.clone() };
        LoadedIsland { island, load, start, end, x, anchor, floor: 0.0, inertia: None, in_contact }
    }

    /// The same with inertia: from the places `x` \[m\] and velocities `v` \[m/s\] of all local nodes over `h` \[s\]; `masses` \[kg\] per
    /// local node.
    pub fn over(mut self, h: f64, masses: &[f64], x: &[f64], v: &[f64]) -> LoadedIsland {
        let mass = masses.iter().zip(&self.island.motion);
        let mass =
            mass.flat_map(|(&m, motion)| motion.map(|c| if c.is_unknown() { m } else { 0.0 })).collect();
        self.inertia = Some(TimeStep::new(h, mass, x.to_vec(), v));
        self
    }

    /// What `of` says of an effect as the solver sees it.
    fn effect<T>(&self, effect: usize, of: impl FnOnce(&dyn Effect) -> T) -> T {
        let effect = self.island.effects[effect].as_ref();
        match effect.has_potential() {
            true => of(effect),
            false => of(&Anchored { effect, anchor: &self.anchor }),
        }
    }

    /// What `of` says of the contact of the island, where it has one; its time counts as that of contact.
    fn contact<T>(&self, of: impl FnOnce(&Contact) -> T) -> Option<T> {
        let contact = self.island.contact.as_ref()?;
        let start = Instant::now();
        let answer = of(contact);
        self.in_contact.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
        Some(answer)
    }

    /// ∂Π/∂x of contact \[N\] over all local nodes.
    fn contact_gradient(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.contact(|_| self.island.soft_contact_gradient(x, self.floor)).flatten()
    }

    /// ∂Π/∂x of inertia \[N\] over all local nodes.
    fn inertia_gradient(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.inertia.as_ref().map(|inertia| {
            let mut g = vec![0.0; x.len()];
            inertia.add_gradient(x, &mut g);
            g
        })
    }

    /// Positions \[m\] of all local nodes.
    pub fn expand(&self, free: &[f64]) -> Vec<f64> {
        let mut x = self.x.clone();
        for (&n, p) in self.island.free_nodes.iter().zip(free.chunks_exact(3)) {
            for c in 0..3 {
                if matches!(self.island.motion[n as usize][c], Motion::Free | Motion::Slides(_)) {
                    x[3 * n as usize + c] = p[c];
                }
            }
        }
        self.island.follow(&self.load.controls, &mut x);
        x
    }
}

impl Potential for LoadedIsland {
    fn pattern(&self) -> &Arc<Pattern> {
        &self.island.pattern
    }

    fn fixed(&self) -> &[bool] {
        &self.island.fixed
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        let energy: f64 = (0..self.island.effects.len()).map(|e| self.effect(e, |e| e.energy(&s))).sum();
        energy
            + self.contact(|contact| contact.energy(&x, self.floor)).unwrap_or(0.0)
            + self.inertia.as_ref().map_or(0.0, |inertia| inertia.energy(&x))
    }

    fn energy_jumps(&self) -> bool {
        self.floor > 0.0
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        g.fill(0.0);
        for (e, slots) in island.slots.iter().enumerate() {
            self.effect(e, |effect| {
                slots.add_vectors(g, FORCE_BATCH, |first, out| effect.forces(&s, first, out));
            });
        }
        let mut f = Vec::new();
        for t in &island.tied {
            let effect = &island.effects[t.effect];
            f.clear();
            f.resize(3 * effect.nodes_per_group(), 0.0);
            self.effect(t.effect, |effect| effect.forces(&s, t.group, &mut f));
            f.resize(3 * t.nodes.len(), 0.0);
            for &(from, to) in &t.moves {
                f[to] += f[from];
                f[from] = 0.0;
            }
            for &(p, leader) in &t.slides {
                island.slides[&t.nodes[p]].redistribute(&mut f, |i| i, p, leader);
            }
            for (&n, f) in t.nodes.iter().zip(f.chunks_exact(3)) {
                if let Some(free) = island.free_index(n) {
                    for c in 0..3 {
                        g[3 * free + c] += f[c];
                    }
                }
            }
        }
        for forces in [self.contact_gradient(&x), self.inertia_gradient(&x)].into_iter().flatten() {
            for (&n, slide) in &island.slides {
                let mut f: Vec<f64> = forces[3 * n as usize..3 * n as usize + 3].to_vec();
                f.resize(6, 0.0);
                slide.redistribute(&mut f, |i| i, 0, Some(1));
                let leader = slide.follows.and_then(|(m, ..)| island.free_index(m));
                for (free, f) in [(island.free_index(n), &f[..3]), (leader, &f[3..])] {
                    if let Some(free) = free {
                        (0..3).for_each(|c| g[3 * free + c] += f[c]);
                    }
                }
            }
            for (i, force) in forces.iter().enumerate().filter(|(_, f)| **f != 0.0) {
                if island.slides.contains_key(&((i / 3) as u32)) {
                    continue;
                }
                if let Some((free, c)) = island.unknown((i / 3) as u32, i % 3) {
                    g[3 * free as usize + c] += force;
                }
            }
        }
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        k.clear();
        for (e, slots) in island.slots.iter().enumerate() {
            self.effect(e, |effect| {
                if !effect.is_linear() {
                    k.add_groups(slots, STIFFNESS_BATCH, |first, out| {
                        effect.stiffness(&s, convexity, first, out)
                    });
                }
            });
        }
        for t in &island.tied {
            let effect = &island.effects[t.effect];
            if effect.is_linear() {
                continue;
            }
            let (m, n) = (3 * effect.nodes_per_group(), 3 * t.nodes.len());
            let mut small = vec![0.0; m * m];
            self.effect(t.effect, |effect| effect.stiffness(&s, convexity, t.group, &mut small));
            let mut full = vec![0.0; n * n];
            for r in 0..m {
                full[r * n..r * n + m].copy_from_slice(&small[r * m..(r + 1) * m]);
            }
            for &(from, to) in &t.moves {
                for c in 0..n {
                    full[to * n + c] += std::mem::take(&mut full[from * n + c]);
                }
                for r in 0..n {
                    full[r * n + to] += std::mem::take(&mut full[r * n + from]);
                }
            }
            for &(p, leader) in &t.slides {
                let slide = &island.slides[&t.nodes[p]];
                let stiffness = (0..3).map(|c| full[(3 * p + c) * (n + 1)].abs()).sum::<f64>() / 3.0;
                for c in 0..n {
                    slide.redistribute(&mut full, |r| r * n + c, p, leader);
                }
                for r in 0..n {
                    slide.redistribute(&mut full, |c| r * n + c, p, leader);
                }
                let spring = (Matrix3::identity() - slide.free) * stiffness;
                for e in 0..9 {
                    full[(3 * p + e / 3) * n + 3 * p + e % 3] += spring[(e / 3, e % 3)];
                }
            }
            for (a, &na) in t.nodes.iter().enumerate() {
                for (b, &nb) in t.nodes.iter().enumerate() {
                    if let (Some(row), Some(column)) = (island.free_index(na), island.free_index(nb)) {
                        let block = std::array::from_fn(|e| full[(3 * a + e / 3) * n + 3 * b + e % 3]);
                        k.add_block(row, column, &block);
                    }
                }
            }
        }
        if let Some(blocks) = self.contact(|contact| contact.hessian(&x, self.floor, convexity)) {
            k.couple(&island.onto_unknowns(blocks));
        }
        for (i, stiffness) in self.inertia.iter().flat_map(|i| i.stiffness()).enumerate() {
            if *stiffness > 0.0
                && let Some((free, c)) = island.unknown((i / 3) as u32, i % 3)
            {
                let mut block = [0.0; 9];
                block[4 * c] = *stiffness;
                k.add_block(free as usize, free as usize, &block);
            }
        }
        // What a leader feels of the inertia of those that follow it obliquely: across their own ways, so that nothing couples them.
        for (&n, slide) in self.inertia.iter().flat_map(|_| &island.slides) {
            let inertia = self.inertia.as_ref().expect("it has inertia");
            if let Some((m, normal, w)) = slide.follows
                && let Some(free) = island.free_index(m)
            {
                let mass = inertia.stiffness()[3 * n as usize] * w.norm_squared();
                let block = normal * normal.transpose() * mass;
                k.add_block(free, free, &std::array::from_fn(|e| block[(e / 3, e % 3)]));
            }
        }
    }

    /// The largest of the reactions of what is prescribed (the internal forces there), the forces of any single fibre or membrane effect, of
    /// a load on what is free, of contact and of inertia, and those of a strain of one millionth. What a load puts on supports says nothing
    /// of the forces inside, and the opening of a pressure puts on its rim what no pressure does.
    fn force_scale(&self, x: &[f64]) -> f64 {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        let norm = |g: &[f64]| g.iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut total = vec![0.0; x.len()];
        let mut scale = island.least_scale;
        for (e, effect) in island.effects.iter().enumerate() {
            let mut g = island.effect_gradient(e, &s);
            if effect.part() == Part::Load {
                let motions = island.motion.iter().flatten();
                g.iter_mut().zip(motions).filter(|(_, m)| !m.is_unknown()).for_each(|(g, _)| *g = 0.0);
            }
            if effect.part() != Part::Matrix {
                scale = scale.max(norm(&g));
            }
            total.iter_mut().zip(&g).for_each(|(t, g)| *t += g);
        }
        if let Some(g) = self.contact_gradient(&x) {
            scale = scale.max(norm(&g));
            total.iter_mut().zip(&g).for_each(|(t, g)| *t += g);
        }
        if let Some(inertia) = &self.inertia {
            scale = scale.max(inertia.scale());
        }
        for (n, motion) in island.motion.iter().enumerate() {
            for c in (0..3).filter(|&c| matches!(motion[c], Motion::Free | Motion::Follows(_))) {
                total[3 * n + c] = 0.0;
            }
        }
        for (&n, slide) in &island.slides {
            let i = 3 * n as usize;
            let reaction = slide.reaction(Vector3::from_column_slice(&total[i..i + 3]));
            total[i..i + 3].copy_from_slice(reaction.as_slice());
        }
        scale.max(norm(&total))
    }

    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        let mut worst = (f64::INFINITY, "no element".to_string());
        for (effect, cells) in self.island.effects.iter().zip(&self.island.cells) {
            if let Some((det, group)) = effect.least_det_f(&s)
                && (det < worst.0 || det.is_nan())
            {
                worst = (det, format!("element {} in `{}`", cells[group], effect.name()));
            }
        }
        worst
    }

    fn has_inertia(&self) -> bool {
        self.inertia.is_some()
    }

    fn touching(&self, x: &[f64]) -> Vec<f64> {
        match &self.island.contact {
            Some(_) => self.expand(x),
            None => Vec::new(),
        }
    }

    fn longest_step(&self) -> f64 {
        match self.floor {
            0.0 => f64::INFINITY,
            _ => self.contact(Contact::longest_soft_step).unwrap_or(f64::INFINITY),
        }
    }

    fn free_share(&self, from: &[f64], x: &[f64]) -> f64 {
        let share = |contact: &Contact| {
            let to = self.expand(x);
            match self.floor {
                0.0 => contact.share(from, &to),
                floor => contact.soft_share(from, &to, floor),
            }
        };
        self.contact(share).unwrap_or(1.0)
    }

    fn contact_seconds(&self) -> f64 {
        1e-9 * self.in_contact.load(Ordering::Relaxed) as f64
    }

    fn node_name(&self, free_node: usize) -> String {
        let node = self.island.nodes[self.island.free_nodes[free_node] as usize];
        format!("node {node} of `{}`", self.island.name)
    }
}

impl Island {
    fn free_index(&self, local: u32) -> Option<usize> {
        if local == NO_NODE {
            return None;
        }
        self.free_nodes.binary_search(&local).ok()
    }
}

impl LoadedIsland {
    fn flow(&self) -> Option<&Flow> {
        let island = &self.island;
        island.flow.get_or_init(|| Flow::new(island, &island.free_nodes)).as_ref()
    }

    fn load_at(&self, t: f64) -> Load {
        self.start.towards(&self.end, &self.island.pivots, t)
    }
}

impl Loading for LoadedIsland {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.load = self.load_at(t);
        if let Some(inertia) = &mut self.inertia {
            inertia.set(t);
        }
        self.island.prescribe(&self.load, &mut self.x);
        let full = self.expand(x);
        self.island.take_free(&full, x);
        if !self.anchor.is_empty() {
            self.anchor = full;
        }
    }

    fn renew(&mut self, x: &[f64]) -> bool {
        if self.anchor.is_empty() {
            return false;
        }
        self.anchor = self.expand(x);
        true
    }

    fn displaces(&self, t: f64) -> bool {
        let to = self.load_at(t);
        let by_control =
            |m: &Motion| matches!(m, Motion::Control(c, _) if self.load.controls[*c] != to.controls[*c]);
        let slides = |s: &Slide| s.by.iter().any(|(c, _)| self.load.controls[*c] != to.controls[*c]);
        self.load.poses != to.poses
            || self.island.motion.iter().flatten().any(by_control)
            || self.island.slides.values().any(slides)
    }

    fn n_pieces(&self, t: f64) -> usize {
        // What flies is not dragged along.
        match self.displaces(t) && self.inertia.is_none() {
            false => 0,
            true => self.flow().map_or(0, |flow| flow.n_pieces(&self.load, &self.load_at(t))),
        }
    }

    fn soften(&mut self, floor: f64) -> bool {
        // With inertia what is passed through on the way would be a tunnel.
        let can = self.inertia.is_none() && self.island.contact.as_ref().is_some_and(Contact::can_soften);
        self.floor = if can { floor } else { 0.0 };
        can
    }

    fn meets(&self, x: &[f64]) -> bool {
        self.contact(|contact| contact.energy(&self.expand(x), self.floor) > 0.0).unwrap_or(false)
    }

    fn part(&self, x: &mut [f64], floor: f64) -> bool {
        let is_free = |n| self.island.is_free(n);
        let parted = self.contact(|contact| contact.parted(&self.expand(x), floor, &is_free));
        match parted {
            None => true,
            Some(None) => false,
            Some(Some(parted)) => {
                self.island.take_free(&parted, x);
                true
            }
        }
    }

    fn carry(&mut self, t: f64, x: &mut [f64]) {
        let to = self.load_at(t);
        if let Some(flow) = self.flow() {
            flow.carry(&self.load, &to, x);
        }
        self.set_load(t, x);
    }
}
