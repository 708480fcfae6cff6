//! An island under a load: what the solver minimizes.
//!
//! It is a sum of effects over groups of nodes and of terms of the whole island; of neither it knows what kind they are.

#![allow(non_snake_case)]

use super::island::{FORCE_BATCH, Island, STIFFNESS_BATCH};
use super::load::{Load, Motion};
use super::predictor::KinematicPredictor;
use super::slide::Slide;
use super::tied::TiedGroup;
use crate::effect::{Anchored, Effect, EffectKind, IslandTerm, State};
use crate::solve::{Admissible, BlockMatrix, Loading, Pattern, Potential};
use nalgebra::Matrix3;
use rayon::prelude::*;
use std::sync::Arc;

/// Groups some nodes of which follow others whose stiffness is held at once: 6 MB of segments between two cubes of a grid.
const TIED_AT_ONCE: usize = 256;

/// Looks whether bodies go through each other; sees more than one island.
pub trait Watch: Sync {
    /// Places \[m\] of all nodes that it looks at where the local nodes of the island are at `x` \[m\] under a load.
    fn places(&self, load: &Load, x: &[f64]) -> Vec<f64>;

    /// Whether nobody goes through anybody on the straight way between two such places.
    fn keeps_sides(&self, from: &[f64], to: &[f64]) -> bool;
}

/// An island under a load: what the solver minimizes.
pub struct LoadedIsland<'a> {
    island: Arc<Island>,
    start: Load,
    end: Load,
    load: Load,
    /// All local nodes; free components are stale.
    x: Vec<f64>,
    /// Where all local nodes were when loads without potential were last looked at; empty where there are none.
    anchor: Vec<f64>,
    /// What belongs to the island as a whole.
    terms: Vec<Box<dyn IslandTerm>>,
    /// Where a guess has the free nodes at the end \[m\], `None` where it knows nothing; empty where there is no guess.
    guess: Vec<Option<[f64; 3]>>,
    /// Who looks at the sides of bodies, if anybody does.
    watch: Option<&'a dyn Watch>,
}

/// Overwrites the stiffness \[N/m\] of one group of an effect.
type StiffnessOf<'a> = dyn Fn(&dyn Effect, usize, &mut [f64]) + Sync + 'a;

impl<'a> LoadedIsland<'a> {
    /// The island on its way from `start` to `end`.
    pub fn new(island: Arc<Island>, start: Load, end: Load) -> LoadedIsland<'a> {
        let mut x = island.X.clone();
        island.prescribe(&start, &mut x);
        let load = start.clone();
        let anchor = if island.effects.iter().all(|e| e.has_potential()) { Vec::new() } else { x.clone() };
        let terms = island.terms();
        LoadedIsland { island, load, start, end, x, anchor, terms, guess: Vec::new(), watch: None }
    }

    /// The same with one more term.
    pub fn with(mut self, term: Box<dyn IslandTerm>) -> LoadedIsland<'a> {
        self.terms.push(term);
        self
    }

    /// The same with somebody who looks at the sides of bodies.
    pub fn watched_by(mut self, watch: &'a dyn Watch) -> LoadedIsland<'a> {
        self.watch = Some(watch);
        self
    }

    /// The same with a guess of where the way leads: displacements \[m\] of the local nodes, `None` where nothing is known; `x` are the
    /// positions \[m\] of the free nodes at the start.
    pub fn led_by(mut self, way: &[Option<[f64; 3]>], x: &[f64]) -> LoadedIsland<'a> {
        let is_known = self.island.free_nodes.iter().any(|&n| way[n as usize].is_some());
        if !is_known {
            return self;
        }
        let places = self.island.free_nodes.iter().zip(x.as_chunks::<3>().0);
        let end =
            |(&n, x): (&u32, &[f64; 3])| way[n as usize].map(|way| std::array::from_fn(|c| x[c] + way[c]));
        self.guess = places.map(end).collect();
        self
    }

    /// Positions \[m\] of all local nodes at the end, the free ones where what is prescribed takes them from `x` by itself.
    pub fn carried(mut self, x: &[f64]) -> Vec<f64> {
        let mut x = x.to_vec();
        if let Some(predictor) = self.predictor() {
            let n = predictor.n_pieces(&self.start, &self.end);
            let at = |k: usize| self.load_at(k as f64 / n as f64);
            (0..n).for_each(|k| predictor.predict(&at(k), &at(k + 1), &mut x));
        }
        self.set_load(1.0, &mut x);
        self.expand(&x)
    }

    /// The island.
    pub fn island(&self) -> &Arc<Island> {
        &self.island
    }

    /// What `of` says of an effect as the solver sees it.
    fn effect<T>(&self, effect: usize, of: impl FnOnce(&dyn Effect) -> T) -> T {
        let effect = self.island.effects[effect].as_ref();
        match effect.has_potential() {
            true => of(effect),
            false => of(&Anchored { effect, anchor: &self.anchor }),
        }
    }

    /// Stiffness of a group some nodes of which follow others, over its nodes and those that they follow: rows and columns are where they
    /// count. `of` overwrites the stiffness of a group of an effect.
    fn tied_stiffness(&self, t: &TiedGroup, of: &StiffnessOf) -> Vec<f64> {
        let island = &self.island;
        let effect = &island.effects[t.effect];
        let (m, n) = (3 * effect.nodes_per_group(), 3 * t.nodes.len());
        let mut small = vec![0.0; m * m];
        self.effect(t.effect, |effect| of(effect, t.group, &mut small));
        let mut full = vec![0.0; n * n];
        for r in 0..m {
            full[r * n..r * n + m].copy_from_slice(&small[r * m..(r + 1) * m]);
        }
        for (from, mean) in &t.means {
            for c in 0..3 {
                for column in 0..n {
                    let value = std::mem::take(&mut full[(3 * from + c) * n + column]);
                    mean.iter().for_each(|(to, w)| full[(3 * to + c) * n + column] += w * value);
                }
            }
            for c in 0..3 {
                for row in 0..n {
                    let value = std::mem::take(&mut full[row * n + 3 * from + c]);
                    mean.iter().for_each(|(to, w)| full[row * n + 3 * to + c] += w * value);
                }
            }
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
        full
    }

    /// Hands the stiffness of every group some nodes of which follow others to `see`, in their order; computed in parallel, so many at a
    /// time that memory stays small.
    fn each_tied(&self, of: &StiffnessOf, mut see: impl FnMut(&TiedGroup, &[f64])) {
        let island = &self.island;
        let is_there = |t: &&TiedGroup| !island.effects[t.effect].is_linear();
        let tied: Vec<&TiedGroup> = island.tied.iter().filter(is_there).collect();
        for some in tied.chunks(TIED_AT_ONCE) {
            let all: Vec<_> = some.par_iter().map(|t| self.tied_stiffness(t, of)).collect();
            some.iter().zip(&all).for_each(|(t, full)| see(t, full));
        }
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

impl Potential for LoadedIsland<'_> {
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
        self.terms.iter().fold(energy, |sum, term| sum + term.energy(&x))
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        g.fill(0.0);
        let add = |e: usize, g: &mut [f64]| {
            self.effect(e, |effect| {
                island.slots[e].add_vectors(g, FORCE_BATCH, |first, out| effect.forces(&s, first, out));
            });
        };
        island.direct().for_each(|e| add(e, g));
        if let Some(over) = &island.over_means {
            let mut forces = vec![0.0; 3 * over.galerkin.pattern().n_nodes()];
            island.over_means().for_each(|e| add(e, &mut forces));
            over.galerkin.add_forces(&forces, g);
        }
        let mut f = Vec::new();
        for t in &island.tied {
            let effect = &island.effects[t.effect];
            f.clear();
            f.resize(3 * effect.nodes_per_group(), 0.0);
            self.effect(t.effect, |effect| effect.forces(&s, t.group, &mut f));
            f.resize(3 * t.nodes.len(), 0.0);
            for (from, mean) in &t.means {
                for c in 0..3 {
                    let force = std::mem::take(&mut f[3 * from + c]);
                    mean.iter().for_each(|(to, w)| f[3 * to + c] += w * force);
                }
            }
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
        for term in &self.terms {
            let mut forces = vec![0.0; x.len()];
            term.add_gradient(&x, &mut forces);
            island.add_onto_unknowns(&forces, g);
        }
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        k.clear();
        let add = |e: usize, k: &mut BlockMatrix| {
            self.effect(e, |effect| {
                if !effect.is_linear() {
                    k.add_groups(&island.slots[e], STIFFNESS_BATCH, |first, out| {
                        effect.stiffness(&s, convexity, first, out)
                    });
                }
            });
        };
        island.direct().for_each(|e| add(e, k));
        if let Some(over) = &island.over_means {
            let mut inner = BlockMatrix::zeros(over.galerkin.pattern().clone());
            island.over_means().for_each(|e| add(e, &mut inner));
            over.galerkin.add_stiffness(&inner, k);
        }
        self.each_tied(&|effect, group, out| effect.stiffness(&s, convexity, group, out), |t, full| {
            let n = 3 * t.nodes.len();
            let places = t.nodes.iter().enumerate();
            let free: Vec<_> = places.filter_map(|(a, &n)| Some((a, island.free_index(n)?))).collect();
            for &(a, row) in &free {
                for &(b, column) in &free {
                    let block = std::array::from_fn(|e| full[(3 * a + e / 3) * n + 3 * b + e % 3]);
                    k.add_block(row, column, &block);
                }
            }
        });
        for term in &self.terms {
            k.couple(&island.onto_unknowns(term.hessian(&x, convexity)));
        }
    }

    fn diagonal_blocks(&self, x: &[f64], blocks: &mut [f64]) {
        let island = &self.island;
        if island.over_means.is_some() {
            // Those of WᵀKW hang on blocks of K off its diagonal.
            let mut k = BlockMatrix::zeros(island.pattern.clone());
            self.hessian(x, 1.0, &mut k);
            for (node, block) in blocks.as_chunks_mut::<9>().0.iter_mut().enumerate() {
                *block = *k.diagonal_block(node);
            }
            return;
        }
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        blocks.fill(0.0);
        for (e, slots) in island.slots.iter().enumerate().filter(|(e, _)| !island.effects[*e].is_linear()) {
            let m = island.effects[e].nodes_per_group();
            self.effect(e, |effect| {
                slots.add_rows::<9>(blocks, STIFFNESS_BATCH, |first, out| {
                    let mut k = vec![0.0; 9 * m * m];
                    for (group, out) in (first..).zip(out.chunks_exact_mut(9 * m)) {
                        effect.taut_stiffness(&s, group, &mut k);
                        for (a, block) in out.as_chunks_mut::<9>().0.iter_mut().enumerate() {
                            *block = std::array::from_fn(|e| k[(3 * a + e / 3) * 3 * m + 3 * a + e % 3]);
                        }
                    }
                });
            });
        }
        let blocks = blocks.as_chunks_mut::<9>().0;
        self.each_tied(&|effect, group, out| effect.taut_stiffness(&s, group, out), |t, full| {
            let n = 3 * t.nodes.len();
            for (a, &node) in t.nodes.iter().enumerate() {
                if let Some(free) = island.free_index(node) {
                    for (e, sum) in blocks[free].iter_mut().enumerate() {
                        *sum += full[(3 * a + e / 3) * n + 3 * a + e % 3];
                    }
                }
            }
        });
        for term in &self.terms {
            for ([row, column], block) in island.onto_unknowns(term.hessian(&x, 1.0)) {
                if row == column {
                    blocks[row as usize].iter_mut().zip(block).for_each(|(sum, b)| *sum += b);
                }
            }
        }
    }

    /// The largest of the reactions of what is prescribed (the internal forces there), the forces of any single fibre or membrane effect, of
    /// a load on what is free, or of a term of the whole island, and those of a strain of one millionth. What a load puts on supports says nothing
    /// of the forces inside, and the opening of a pressure puts on its rim what no pressure does.
    fn force_scale(&self, x: &[f64]) -> f64 {
        let island = &self.island;
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        let norm = |g: &[f64]| g.iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut total = vec![0.0; x.len()];
        let mut scale = island.least_scale;
        for (e, effect) in island.effects.iter().enumerate() {
            if effect.kind() == EffectKind::Matrix {
                island.add_support_forces(e, &s, &mut total);
                continue;
            }
            let mut g = island.effect_gradient(e, &s);
            if effect.kind() == EffectKind::Load {
                let taken = island.on_supports(&g);
                g.iter_mut().zip(taken).for_each(|(g, taken)| *g -= taken);
            }
            scale = scale.max(norm(&g));
            total.iter_mut().zip(&g).for_each(|(t, g)| *t += g);
        }
        scale = self.terms.iter().fold(scale, |scale, term| scale.max(term.force_scale(&x, &mut total)));
        scale.max(norm(&island.on_supports(&total)))
    }

    fn followers(&self) -> Vec<[usize; 2]> {
        let island = &self.island;
        let mut all = Vec::new();
        for (free, &n) in island.free_nodes.iter().enumerate() {
            for c in 0..3 {
                if let Motion::Follows(leader) = island.motion[n as usize][c]
                    && let Some(leader) = island.free_index(leader)
                {
                    all.push([3 * free + c, 3 * leader + c]);
                }
            }
        }
        all
    }

    fn go(&self, x: &[f64], dx: &[f64], length: f64, out: &mut [f64]) {
        for i in 0..x.len() {
            out[i] = x[i] + length * dx[i];
        }
        if self.island.bodies.is_empty() {
            return;
        }
        let (from, to) = (self.expand(x), self.expand(out));
        for body in &self.island.bodies {
            for (&n, place) in body.frame.iter().zip(body.turned(&from, &to)) {
                if let Some(free) = self.island.free_index(n) {
                    out[3 * free..3 * free + 3].copy_from_slice(place.as_slice());
                }
            }
        }
    }

    fn is_curved(&self) -> bool {
        !self.island.bodies.is_empty()
    }

    fn holds_free_bodies(&self) -> bool {
        self.terms.iter().any(|term| term.holds_free_bodies())
    }

    fn node_name(&self, free_node: usize) -> String {
        let node = self.island.nodes[self.island.free_nodes[free_node] as usize];
        format!("node {node} of `{}`", self.island.name)
    }
}

impl Admissible for LoadedIsland<'_> {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        let x = self.expand(x);
        let s = State { x: &x, controls: &self.load.controls };
        let mut worst = (f64::INFINITY, "no element".to_string());
        for (effect, cells) in self.island.effects.iter().zip(&self.island.cells) {
            if let Some((det, cell)) = effect.least_det_f(&s)
                && (det < worst.0 || det.is_nan())
            {
                worst = (det, format!("element {} in `{}`", cells[cell], effect.name()));
            }
        }
        worst
    }

    fn touching(&self, x: &[f64]) -> Vec<f64> {
        match self.terms.iter().any(|term| term.keeps_apart()) {
            true => self.expand(x),
            false => Vec::new(),
        }
    }

    fn longest_step(&self) -> f64 {
        self.terms.iter().map(|term| term.longest_step()).fold(f64::INFINITY, f64::min)
    }

    fn collision_free_step(&self, from: &[f64], x: &[f64]) -> f64 {
        if self.terms.is_empty() {
            return 1.0;
        }
        let to = self.expand(x);
        self.terms.iter().map(|term| term.collision_free_step(from, &to)).fold(1.0, f64::min)
    }

    fn contact_seconds(&self) -> f64 {
        self.terms.iter().map(|term| term.seconds()).sum()
    }
}

impl LoadedIsland<'_> {
    fn predictor(&self) -> Option<&KinematicPredictor> {
        let island = &self.island;
        let acted_on = || island.effects.iter().flat_map(|e| e.nodes()).copied();
        if island.predictor.get().is_none() {
            // Not while the others wait: it works in parallel, and one that waits could be what it waits for.
            let found = KinematicPredictor::new(&island.X, &island.motion, acted_on(), &island.free_nodes);
            let _ = island.predictor.set(found);
        }
        island.predictor.get().expect("it is there").as_ref()
    }

    fn load_at(&self, t: f64) -> Load {
        self.start.towards(&self.end, &self.island.pivots, t)
    }
}

impl Loading for LoadedIsland<'_> {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.load = self.load_at(t);
        self.terms.iter_mut().for_each(|term| term.set_load(t));
        self.island.prescribe(&self.load, &mut self.x);
        let full = self.expand(x);
        self.island.take_free(&full, x);
        if !self.anchor.is_empty() {
            self.anchor = full;
        }
    }

    fn renew(&mut self, x: &[f64]) -> bool {
        if self.terms.is_empty() && self.anchor.is_empty() {
            return false;
        }
        let x = self.expand(x);
        let renewed = self.terms.iter_mut().fold(false, |any, term| term.renew(&x) | any);
        if self.anchor.is_empty() {
            return renewed;
        }
        self.anchor = x;
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
        let may = self.terms.iter().all(|term| term.may_be_predicted());
        // Where a body answers to forces, the tangent to its path says where it goes, not who is near it.
        if !may || !self.island.bodies.is_empty() {
            return 0;
        }
        match (self.is_guessed(t), self.displaces(t)) {
            (true, _) => 1,
            (false, false) => 0,
            (false, true) => {
                self.predictor().map_or(0, |predictor| predictor.n_pieces(&self.load, &self.load_at(t)))
            }
        }
    }

    fn is_guessed(&self, t: f64) -> bool {
        t == 1.0 && !self.guess.is_empty()
    }

    fn forget_guess(&mut self) -> bool {
        !std::mem::take(&mut self.guess).is_empty()
    }

    fn soften(&mut self, softness: f64) -> bool {
        let can = self.terms.iter().all(|term| term.may_be_predicted())
            && self.terms.iter().any(|term| term.can_soften());
        let softness = if can { softness } else { 0.0 };
        self.terms.iter_mut().filter(|term| term.can_soften()).for_each(|term| term.soften(softness));
        can
    }

    fn meets(&self, x: &[f64]) -> bool {
        let x = self.expand(x);
        self.terms.iter().any(|term| term.meets(&x))
    }

    fn untangle(&self, x: &mut [f64], softness: f64) -> bool {
        let mut places = self.expand(x);
        let is_free = |n| self.island.is_free(n);
        if !self.terms.iter().all(|term| term.untangle(&mut places, softness, &is_free)) {
            return false;
        }
        self.island.take_free(&places, x);
        true
    }

    fn sides(&self, x: &[f64]) -> Vec<f64> {
        self.watch.map_or(Vec::new(), |watch| watch.places(&self.load, &self.expand(x)))
    }

    fn keeps_sides(&self, from: &[f64], x: &[f64]) -> bool {
        self.watch.is_none_or(|watch| watch.keeps_sides(from, &self.sides(x)))
    }

    fn predict(&mut self, t: f64, x: &mut [f64]) {
        let to = self.load_at(t);
        if let Some(predictor) = self.predictor() {
            predictor.predict(&self.load, &to, x);
        }
        if self.is_guessed(t) {
            let places = x.as_chunks_mut::<3>().0.iter_mut().zip(&self.guess);
            places.for_each(|(x, guess)| *x = guess.unwrap_or(*x));
        }
        self.set_load(t, x);
    }
}
