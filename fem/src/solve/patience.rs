//! Waiting before what has failed is tried again.

/// Waits once after the first failure, twice as long after every further one, not at all after a success.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    longest: u32,
    wait: u32,
    waited: u32,
}

impl Patience {
    /// At the start nothing has failed; no wait is longer than `longest`.
    pub(super) fn new(longest: u32) -> Patience {
        Patience { longest, wait: 0, waited: 0 }
    }

    /// It has failed.
    pub(super) fn fail(&mut self) {
        (self.wait, self.waited) = ((2 * self.wait).clamp(1, self.longest), 0);
    }

    /// It has worked.
    pub(super) fn succeed(&mut self) {
        (self.wait, self.waited) = (0, 0);
    }

    /// Whether the wait is over; counts one more where it is not.
    pub(super) fn is_over(&mut self) -> bool {
        let over = self.waited >= self.wait;
        self.waited += u32::from(!over);
        over
    }
}
