//! Contact as a part of the potential of an island on its way.

use super::Contact;
use crate::effect::IslandTerm;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Contact, softened or not; what it takes is counted.
pub struct ContactTerm {
    contact: Contact,
    /// Fraction of the activation distance below which it is softened; 0: nowhere.
    softness: f64,
    /// Time spent in it \[ns\].
    spent: AtomicU64,
}

impl ContactTerm {
    /// Contact as it is, at the start of a solution.
    pub fn new(contact: &Contact) -> ContactTerm {
        ContactTerm { contact: contact.anew(), softness: 0.0, spent: AtomicU64::new(0) }
    }

    /// What `of` says of it; the time of that counts.
    fn timed<T>(&self, of: impl FnOnce(&Contact) -> T) -> T {
        let start = Instant::now();
        let answer = of(&self.contact);
        self.spent.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
        answer
    }
}

impl IslandTerm for ContactTerm {
    fn energy(&self, x: &[f64]) -> f64 {
        self.timed(|contact| contact.energy(x, self.softness))
    }

    fn add_gradient(&self, x: &[f64], g: &mut [f64]) {
        self.timed(|contact| contact.add_gradient(x, self.softness, g));
    }

    fn hessian(&self, x: &[f64], convexity: f64) -> Vec<([u32; 2], [f64; 9])> {
        self.timed(|contact| contact.hessian(x, self.softness, convexity))
    }

    fn force_scale(&self, x: &[f64], total: &mut [f64]) -> f64 {
        let mut g = vec![0.0; x.len()];
        self.add_gradient(x, &mut g);
        total.iter_mut().zip(&g).for_each(|(t, g)| *t += g);
        g.iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    fn keeps_apart(&self) -> bool {
        true
    }

    fn collision_free_step(&self, from: &[f64], to: &[f64]) -> f64 {
        self.timed(|contact| match self.softness {
            0.0 => contact.collision_free_step(from, to),
            softness => contact.soft_step(from, to, softness),
        })
    }

    fn longest_step(&self) -> f64 {
        match self.softness {
            0.0 => f64::INFINITY,
            _ => self.timed(Contact::longest_soft_step),
        }
    }

    fn can_soften(&self) -> bool {
        self.contact.can_soften()
    }

    fn soften(&mut self, softness: f64) {
        if self.softness == 0.0 {
            self.contact.forget_near();
        }
        self.softness = softness;
        self.contact.release_normals();
    }

    fn renew(&mut self, x: &[f64]) -> bool {
        if self.softness == 0.0 {
            return false;
        }
        let softness = self.softness;
        self.timed(|contact| {
            contact.hold_normals(x);
            contact.energy(x, softness); // what is known at `x`, and kept: the energy is asked for next
            contact.arrive();
        });
        true
    }

    fn meets(&self, x: &[f64]) -> bool {
        self.energy(x) > 0.0
    }

    fn untangle(&self, x: &mut Vec<f64>, softness: f64, moves: &dyn Fn(u32) -> bool) -> bool {
        self.contact.release_normals();
        let untangled = self.timed(|contact| contact.untangled(x, softness, moves));
        untangled.map(|untangled| *x = untangled).is_some()
    }

    fn seconds(&self) -> f64 {
        1e-9 * self.spent.load(Ordering::Relaxed) as f64
    }
}
