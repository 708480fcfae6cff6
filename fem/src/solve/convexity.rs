//! How much of its negative curvatures the Hessian has to lose.

use super::patience::Patience;

/// Convexity tried first where the true Hessian is indefinite, and the least one.
const FIRST: f64 = 0.25;
const LEAST: f64 = 1.0 / 256.0;
/// Iterations at most that go by until less is tried again.
const LONGEST_WAIT: u32 = 8;

/// The fraction of the negative curvatures that the next Hessian loses, see [`Potential::hessian`](super::Potential::hessian): a quarter of
/// what made the last one definite. Where less keeps failing it is tried less often, for a trial costs a Hessian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Convexity {
    /// Tried next.
    pub(super) next: f64,
    /// The last one that was enough where the true Hessian was not.
    pub(super) enough: f64,
    /// Less may be tried.
    may_fall: bool,
    patience: Patience,
}

impl Convexity {
    /// Starts with the true Hessian.
    pub(super) fn none() -> Convexity {
        Convexity { next: 0.0, enough: FIRST, may_fall: true, patience: Patience::new(LONGEST_WAIT) }
    }

    /// Starts with all of it, for two iterations.
    pub(super) fn falling() -> Convexity {
        let mut falling = Convexity { next: 1.0, enough: 1.0, ..Convexity::none() };
        falling.patience.fail();
        falling
    }

    /// All of it, whatever would do: for a way on which a Hessian costs more than what less convexity saves.
    pub(super) fn full() -> Convexity {
        Convexity { may_fall: false, ..Convexity::falling() }
    }

    /// Less than `FIRST` is not tried next.
    pub(super) fn first(&mut self) {
        self.next = FIRST;
    }

    /// A Hessian that lost `fraction` was definite, the one of `next` or one after it.
    pub(super) fn suffices(&mut self, fraction: f64) {
        if fraction > self.next {
            self.patience.fail();
        } else if fraction < self.enough {
            self.patience.succeed();
        }
        if fraction > 0.0 {
            self.enough = fraction;
        }
        self.next = match self.may_fall && self.patience.is_over() {
            false => fraction,
            true if fraction / 4.0 < LEAST => 0.0,
            true => fraction / 4.0,
        };
    }
}
