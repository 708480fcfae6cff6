//! Strands that slide: strings over the femur, each the shortest way from where it holds on to where the patella has its other end.
//!
//! A string of n segments goes where V = ½ n Σ |x_k+1 − x_k|² + ½ c Σ min(φ(x_k), 0)² is least, φ the smooth distance to the femur. Of all strings
//! of a length that sum is least where all segments are equally long (Cauchy and Schwarz), and then it is ℓ²/2: so ℓ = √(2 V) is the length of
//! the shortest way, its nodes evenly spread, up to chords that cut corners by (1/24) (turn of a segment)². Nothing else has to keep nodes apart.
//! Without friction the tension is one along the way: Π = W(ℓ), the force on the end is W′ ∂ℓ/∂x with ∂ℓ/∂x = n d/ℓ, d the last segment, because V is
//! stationary in all other nodes; its stiffness follows from what the others do (a Schur complement).
//! The nodes are no unknowns of the patella: a slack string has no stiffness, and a few dozen loose nodes would hold up its Newton iterations.

#![allow(non_snake_case)]

use std::sync::{Arc, Mutex, MutexGuard};

use fem::effect::{Effect, EffectKind, Groups, State};
use fem::element::psd::lift;
use fem::geometry::DistanceField;
use fem::material::line::{LineLaw, Strand};
use nalgebra::{Matrix3, Point3, Vector3};

/// Segments of a string: those of the tendon, 0.2 m long, are 4 mm then, a fifth of the radius of the trochlea.
pub const SEGMENTS: usize = 48;
const FREE: usize = SEGMENTS - 1;
/// c: a string of 0.2 m that is bent over 20 mm sinks in by 3 µm, ℓ²/(n c r).
const HARD: f64 = 1.6e4;
/// Iterations at most; a few do where the end has moved a little.
const ITERATIONS: usize = 200;
/// Change of a node \[m\] that is none.
const SETTLED: f64 = 1e-13;
/// Step \[m\] below which all of it is taken.
const NEAR: f64 = 1e-8;
/// Least part of a step that is tried.
const LEAST: f64 = 1e-6;
/// Distance \[m\] between ends of ways that are remembered apart: what the patella does between two of them, a way follows.
const APART: f64 = 1e-3;
/// Ways that are remembered: more trials than a frame has by far, a tenth of a metre of them in a row.
const KNOWN: usize = 256;

/// What pulls in a string.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pull {
    /// A law over the slack length \[m\].
    Elastic(Strand, f64),
    /// A share of a control \[N\].
    Tension(usize, f64),
}

/// A string over a rigid solid from a fixed place \[m\].
#[derive(Clone, Debug)]
pub struct TautString {
    solid: Arc<DistanceField>,
    from: Point3<f64>,
}

/// The way of a string.
#[derive(Clone, Debug)]
pub struct Way {
    /// Its nodes \[m\], from end to end.
    pub places: [Point3<f64>; SEGMENTS + 1],
    /// ℓ \[m\]; infinite where no way settles.
    pub length: f64,
    /// ∂ℓ/∂x of its last node, n d/ℓ: along its last segment, and as long as that is against the others. Where the last nodes lie on a crest, into which
    /// each sinks another way, that is up to 3 % off 1.
    pub along: Vector3<f64>,
    /// ∂²ℓ/∂x² \[1/m\].
    pub bend: Matrix3<f64>,
}

impl TautString {
    /// Over a solid, from a fixed place \[m\] in its frame.
    pub fn new(solid: Arc<DistanceField>, from: Point3<f64>) -> TautString {
        TautString { solid, from }
    }

    /// Straight to a place \[m\].
    fn straight(&self, to: &Point3<f64>) -> [Point3<f64>; SEGMENTS + 1] {
        std::array::from_fn(|k| self.from + (to - self.from) * (k as f64 / SEGMENTS as f64))
    }

    /// c/2 min(φ, 0)² of a node, its gradient and Hessian.
    fn pressed(&self, at: &Point3<f64>) -> (f64, Vector3<f64>, Matrix3<f64>) {
        match self.solid.near(&at.coords, 0.0) {
            None => (0.0, Vector3::zeros(), Matrix3::zeros()),
            Some(f) => {
                let n = f.gradient;
                let bend = HARD * (n * n.transpose() + f.distance * f.hessian);
                (0.5 * HARD * f.distance * f.distance, HARD * f.distance * n, bend)
            }
        }
    }

    fn energy(&self, x: &[Point3<f64>; SEGMENTS + 1]) -> f64 {
        let segments: f64 = x.windows(2).map(|p| (p[1] - p[0]).norm_squared()).sum();
        0.5 * SEGMENTS as f64 * segments + x[1..SEGMENTS].iter().map(|p| self.pressed(p).0).sum::<f64>()
    }

    /// The way to a place \[m\], found from a way that it went before.
    pub fn way(&self, to: &Point3<f64>, before: Option<&Way>) -> Way {
        let mut x = match before {
            // Carried along with its end.
            Some(way) => {
                let shift = to - way.places[SEGMENTS];
                std::array::from_fn(|k| way.places[k] + shift * (k as f64 / SEGMENTS as f64))
            }
            None => self.straight(to),
        };
        let n = SEGMENTS as f64;
        let mut energy = self.energy(&x);
        for _ in 0..ITERATIONS {
            let (mut g, mut bends) = ([Vector3::zeros(); FREE], [Matrix3::zeros(); FREE]);
            for k in 0..FREE {
                let (_, press, bend) = self.pressed(&x[k + 1]);
                g[k] = n * (2.0 * x[k + 1].coords - x[k].coords - x[k + 2].coords) + press;
                bends[k] = bend;
            }
            // Newton's step where V is convex, else that of what is convex in every node. All that holds against the string counts: in a groove it
            // is the curvature across, a hundred times what the string itself has against a long wave.
            let Some(step) = solve(&bends, &g).or_else(|| solve(&bends.map(convex), &g)) else { break };
            let largest = step.iter().map(|s| s.norm()).fold(0.0, f64::max);
            let mut part = 1.0;
            let (next, lower) = loop {
                let moved: [Point3<f64>; SEGMENTS + 1] = std::array::from_fn(|k| {
                    if k == 0 || k == SEGMENTS { x[k] } else { x[k] - part * step[k - 1] }
                });
                let lower = self.energy(&moved);
                // So near the end the energy is round-off, and whole steps are right.
                if lower <= energy || largest < NEAR || part < LEAST {
                    break (moved, lower);
                }
                part *= 0.5;
            };
            (x, energy) = (next, lower);
            if largest < SETTLED {
                return self.described(x, energy);
            }
        }
        // No way that is settled: whoever asked has gone too far.
        Way { length: f64::INFINITY, ..self.described(x, energy) }
    }

    /// Length and derivatives of a way that is settled.
    fn described(&self, places: [Point3<f64>; SEGMENTS + 1], energy: f64) -> Way {
        let n = SEGMENTS as f64;
        let length = (2.0 * energy).sqrt();
        let along = n / length * (places[SEGMENTS] - places[SEGMENTS - 1]);
        // ∂²V/∂x² of the end: n − n² (K⁻¹) of its neighbour, by elimination from the fixed end on.
        let mut left = Matrix3::zeros();
        for k in 0..FREE {
            let own = 2.0 * n * Matrix3::identity() + self.pressed(&places[k + 1]).2 - left;
            // Singular where the way is about to leave for another: then it is not settled.
            let Some(inverse) = own.try_inverse() else {
                return Way { places, length: f64::INFINITY, along, bend: Matrix3::zeros() };
            };
            left = n * n * inverse;
        }
        let second = n * Matrix3::identity() - left;
        let bend = (second - along * along.transpose()) / length;
        Way { places, length, along, bend: 0.5 * (bend + bend.transpose()) }
    }
}

/// What of a stiffness is convex.
fn convex(mut stiffness: Matrix3<f64>) -> Matrix3<f64> {
    lift(&mut stiffness.data.0, 1.0);
    stiffness
}

/// Solves 2n and a stiffness on the diagonal with −n beside it for `g`; `None`: that is not positive definite.
fn solve(stiffness: &[Matrix3<f64>; FREE], g: &[Vector3<f64>; FREE]) -> Option<[Vector3<f64>; FREE]> {
    let n = SEGMENTS as f64;
    let (mut inverse, mut right) = ([Matrix3::zeros(); FREE], *g);
    for k in 0..FREE {
        let mut own = 2.0 * n * Matrix3::identity() + stiffness[k];
        if k > 0 {
            own -= n * n * inverse[k - 1];
            right[k] += n * inverse[k - 1] * right[k - 1];
        }
        inverse[k] = own.cholesky()?.inverse();
    }
    let mut step = [Vector3::zeros(); FREE];
    for k in (0..FREE).rev() {
        let after = if k + 1 < FREE { n * step[k + 1] } else { Vector3::zeros() };
        step[k] = inverse[k] * (right[k] + after);
    }
    Some(step)
}

/// Ways that a string went since the last equilibrium: that of the equilibrium first, then those of trials, each the last one to end within [`APART`]
/// of where it does. The next one is looked for from the nearest: Newton's method, whose trials draw together, so stays on one way where there are
/// two, and what a trial far off has found leads nobody astray who comes back, nor does it count any more after the next equilibrium.
struct KnownWays(Vec<Way>);

impl KnownWays {
    /// The one that ends nearest to a place \[m\].
    fn nearest(&self, to: &Point3<f64>) -> usize {
        let off = |way: &Way| (way.places[SEGMENTS] - to).norm_squared();
        let all = self.0.iter().enumerate();
        all.min_by(|a, b| off(a.1).total_cmp(&off(b.1))).expect("the first one is kept").0
    }

    /// Keeps one that was found from the one at `nearest`; the trial that came first makes room.
    fn keep(&mut self, way: &Way, nearest: usize) {
        let is_near = (self.0[nearest].places[SEGMENTS] - way.places[SEGMENTS]).norm() < APART;
        if is_near && nearest > 0 {
            self.0[nearest] = way.clone();
            return;
        }
        if self.0.len() == KNOWN {
            self.0.remove(1);
        }
        self.0.push(way.clone());
    }
}

/// What is remembered of one string, shared by all who ask for its ways: who measures an equilibrium sees the ways that were found in it.
#[derive(Clone)]
pub struct Memory(Arc<Mutex<KnownWays>>);

impl Memory {
    /// Of a string that goes a way in an equilibrium.
    pub fn new(way: Way) -> Memory {
        Memory(Arc::new(Mutex::new(KnownWays(vec![way]))))
    }

    fn lock(&self) -> MutexGuard<'_, KnownWays> {
        self.0.lock().expect("no thread panics while it holds a way")
    }
}

/// Strings that end at nodes, as a term.
pub struct Strings {
    groups: Groups,
    strings: Vec<(TautString, Pull)>,
    memories: Vec<Memory>,
}

impl Strings {
    /// Strings with what pulls in them and what is remembered of each, by the nodes that they end at.
    pub fn new(
        name: &str,
        nodes: &[[u32; 1]],
        strings: Vec<(TautString, Pull)>,
        memories: Vec<Memory>,
    ) -> Strings {
        // Pulls from outside: it is on no side of a cut.
        let groups = Groups::new(name, EffectKind::Load, nodes, vec![[f64::NAN; 3]; nodes.len()]);
        Strings { groups, strings, memories }
    }

    /// The way of a string with the nodes at `x` \[m\], 3 per node.
    pub fn way(&self, e: usize, x: &[f64]) -> Way {
        let [node] = *self.groups.nodes::<1>(e);
        let to = Point3::from(Vector3::from_column_slice(&x[3 * node as usize..][..3]));
        let mut known = self.memories[e].lock();
        let nearest = known.nearest(&to);
        let before = &known.0[nearest];
        if before.places[SEGMENTS] == to {
            return before.clone();
        }
        let way = self.strings[e].0.way(&to, Some(before));
        // Where none settles the next trial starts from one that did.
        if way.length.is_finite() {
            known.keep(&way, nearest);
        }
        way
    }

    /// Forgets the ways of trials: the nodes at `x` \[m\] are in equilibrium.
    pub fn settle(&self, x: &[f64]) {
        for (e, memory) in self.memories.iter().enumerate() {
            let way = self.way(e, x);
            // One that does not settle leads nowhere.
            if way.length.is_finite() {
                memory.lock().0 = vec![way];
            }
        }
    }

    /// Energy \[J\], tension \[N\] and its derivative by ℓ \[N/m\]. Without a way all of it is infinite, whatever the string bears.
    fn response(&self, e: usize, length: f64, controls: &[f64]) -> [f64; 3] {
        if !length.is_finite() {
            return [f64::INFINITY; 3];
        }
        match self.strings[e].1 {
            Pull::Elastic(law, slack) => {
                let r = LineLaw::Strand(law).response(length / slack, 0.0);
                [slack * r.energy, r.force, r.stiffness / slack]
            }
            Pull::Tension(control, share) => {
                [share * controls[control] * length, share * controls[control], 0.0]
            }
        }
    }
}

impl Effect for Strings {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        (0..self.strings.len()).map(|e| self.response(e, self.way(e, s.x).length, s.controls)[0]).sum()
    }

    /// Stretch over the slack length (1 where the tension is given), and tension \[N\].
    fn line_state(&self, s: &State, group: usize) -> Option<(f64, f64)> {
        let length = self.way(group, s.x).length;
        let stretch = match self.strings[group].1 {
            Pull::Elastic(_, slack) => length / slack,
            Pull::Tension(..) => 1.0,
        };
        Some((stretch, self.response(group, length, s.controls)[1]))
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (e, out) in (first..).zip(out.chunks_exact_mut(3)) {
            let way = self.way(e, s.x);
            let pull = self.response(e, way.length, s.controls)[1];
            (0..3).for_each(|c| out[c] = pull * way.along[c]);
        }
    }

    /// W″ q⊗q + W′ ∂²ℓ/∂x², q = ∂ℓ/∂x; less the fraction `convexity` of negative curvatures.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        for (e, out) in (first..).zip(out.chunks_exact_mut(9)) {
            let way = self.way(e, s.x);
            let [_, pull, slope] = self.response(e, way.length, s.controls);
            let mut block = slope * way.along * way.along.transpose() + pull * way.bend;
            lift(&mut block.data.0, convexity);
            (0..9).for_each(|i| out[i] = block[(i / 3, i % 3)]);
        }
    }
}
