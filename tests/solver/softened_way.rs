//! The way through softened contact: where it begins, and what ends it.

use super::lattice::{Lattice, residual};
use fem::solve::{Admissible, BlockMatrix, Loading, Pattern, Potential, Settings, Solver};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A lattice whose energy may jump while it is softened, right beyond where it starts; what touches cuts steps in half.
struct Ledge {
    lattice: Lattice,
    jumps: bool,
    /// Where the load ends is guessed.
    guessed: bool,
    /// Whoever looks says that the softened way leads through somebody.
    leads_through: bool,
    softness: f64,
    /// Where softening began, one after the other, and how often overlaps were parted.
    schedule: Vec<f64>,
    parted: AtomicUsize,
}

impl Ledge {
    fn new(jumps: bool, guessed: bool) -> Ledge {
        let pull = |p: &[f64; 3]| [0.0, 0.0, 0.25 * p[2]];
        let lattice = Lattice::new([3, 3, 3], |p| p[2] == 0.0 || p[2] == 2.0, |_| false, pull);
        let (softness, leads_through) = (0.0, false);
        Ledge {
            lattice,
            jumps,
            guessed,
            leads_through,
            softness,
            schedule: Vec::new(),
            parted: AtomicUsize::new(0),
        }
    }

    /// Energy by which it jumps \[J\], and how far from the start \[m\].
    const JUMP: f64 = 1e3;
    const AT: f64 = 1e-8;
}

impl Potential for Ledge {
    fn pattern(&self) -> &Arc<Pattern> {
        self.lattice.pattern()
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let jumps = self.jumps && self.softness > 0.0 && x[2] > 1.0 + Ledge::AT;
        let jump = if jumps { Ledge::JUMP } else { 0.0 };
        self.lattice.energy(x) + jump
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        self.lattice.gradient(x, g);
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        self.lattice.hessian(x, convexity, k);
    }

    fn force_scale(&self, x: &[f64]) -> f64 {
        self.lattice.force_scale(x)
    }
}

impl Admissible for Ledge {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        self.lattice.least_det_f(x)
    }

    fn touching(&self, x: &[f64]) -> Vec<f64> {
        let prescribed = self.lattice.points.iter().flatten();
        x.iter().chain(prescribed).copied().collect()
    }

    fn collision_free_step(&self, from: &[f64], x: &[f64]) -> f64 {
        let way = from.iter().zip(self.touching(x)).map(|(from, to)| (from - to).abs()).fold(0.0, f64::max);
        if way > 0.05 { 0.5 } else { 1.0 }
    }
}

impl Loading for Ledge {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.lattice.set_load(t, x);
    }

    fn n_pieces(&self, _t: f64) -> usize {
        1
    }

    fn is_guessed(&self, t: f64) -> bool {
        self.guessed && t == 1.0
    }

    fn soften(&mut self, softness: f64) -> bool {
        if softness > 0.0 {
            self.schedule.push(softness);
        }
        self.softness = softness;
        true
    }

    fn untangle(&self, _x: &mut [f64], _softness: f64) -> bool {
        self.parted.fetch_add(1, Ordering::Relaxed);
        true
    }

    fn keeps_sides(&self, _from: &[f64], _x: &[f64]) -> bool {
        assert_eq!(self.softness, 0.0, "with contact as it is");
        !self.leads_through
    }
}

/// A guess is near equilibrium with hard contact: the softest stage, which others begin with, is left out.
#[test]
fn a_guess_begins_with_hard_contact() {
    let [plain, led] = [false, true].map(|guessed| {
        let mut ledge = Ledge::new(false, guessed);
        let mut x = ledge.lattice.start();
        Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut Vec::new()).unwrap();
        assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
        ledge.schedule
    });
    // Both look first whether anything is met, with softest contact.
    let [look, softest, harder @ ..] = &plain[..] else { panic!("softened below {plain:?}") };
    assert_eq!((look, harder.is_empty()), (softest, false), "softened below {plain:?}");
    assert_eq!((&led[0], &led[1..]), (look, harder), "softened below {led:?}");
}

/// A softened way that leads through somebody is looked at once, and nothing is softened after it.
#[test]
fn a_softened_way_that_leads_through_is_the_last_one() {
    let mut ledge = Ledge { leads_through: true, ..Ledge::new(false, false) };
    let mut x = ledge.lattice.start();
    let advance =
        Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut Vec::new()).unwrap();
    assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
    assert_eq!((advance.soft_ways, advance.wrong_ways), (0, 1));
    assert!(advance.load_steps > 1, "collision detection cuts the way");
    assert_eq!(ledge.parted.into_inner(), 1, "softened below {:?}", ledge.schedule);
}

/// Where softened contact does not settle, collision detection alone goes the first piece of the way; from there it is tried again.
#[test]
fn softened_contact_that_does_not_settle_waits_for_collision_detection() {
    let mut ledge = Ledge::new(true, false);
    let mut x = ledge.lattice.start();
    let mut log = Vec::new();
    let advance = Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut log).unwrap();
    assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
    assert_eq!((advance.load_steps, advance.loose_steps, advance.retries), (2, 1, 0), "{log:?}");
    assert!(log[0].load < 1.0 && log[0].energy < Ledge::JUMP, "{:?}", log[0]);
    assert_eq!((advance.soft_ways, ledge.parted.into_inner()), (1, 1), "softened below {:?}", ledge.schedule);
    // Only the first stage did not settle.
    let tries = ledge.schedule.iter().filter(|softness| **softness == ledge.schedule[0]).count();
    assert!(tries > 1 && ledge.schedule.is_sorted_by(|a, b| a >= b), "softened below {:?}", ledge.schedule);
}
