//! Where a unit is in its life, and states that a master keeps.

use crate::error::UnitError;

/// Where a unit is in its life (FMI 3.0, 2.3.1 and 4.2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Made, or reset.
    Instantiated,
    /// Inputs are set before the first step.
    Initialization,
    /// Steps are done.
    Step,
    /// Within a step, while the master looks at it.
    Intermediate,
    /// No more steps.
    Terminated,
}

use Mode::{Initialization, Instantiated, Intermediate, Step, Terminated};

impl Mode {
    /// All.
    pub const ALL: [Mode; 5] = [Instantiated, Initialization, Step, Intermediate, Terminated];

    /// Its name, for messages.
    pub fn name(self) -> &'static str {
        match self {
            Instantiated => "instantiated",
            Initialization => "initialization mode",
            Step => "step mode",
            Intermediate => "an intermediate update",
            Terminated => "terminated",
        }
    }
}

/// A state that a master keeps.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedState {
    /// Which unit it is of.
    pub key: String,
    /// Where that was in its life.
    pub mode: Mode,
    /// Its time \[s\].
    pub time: f64,
    /// State of its side.
    pub bytes: Vec<u8>,
}

/// Version of the layout of [`SavedState::to_bytes`].
const LAYOUT: u8 = 1;

impl SavedState {
    /// As bytes, from which [`SavedState::of_bytes`] makes the same.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mode = Mode::ALL.iter().position(|m| *m == self.mode).expect("every mode is listed") as u8;
        let mut bytes = vec![LAYOUT, mode];
        bytes.extend(self.time.to_bits().to_le_bytes());
        bytes.extend((self.key.len() as u64).to_le_bytes());
        bytes.extend(self.key.as_bytes());
        bytes.extend(&self.bytes);
        bytes
    }

    /// Number of these bytes.
    pub fn n_bytes(&self) -> usize {
        18 + self.key.len() + self.bytes.len()
    }

    /// Reads them; the sides examine what is inside when it is taken over.
    pub fn of_bytes(bytes: &[u8]) -> Result<SavedState, UnitError> {
        let bad = || UnitError::wrong("these bytes are no state of a unit of this version");
        let (head, rest) = bytes.split_at_checked(18).ok_or_else(bad)?;
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
        let mode = *Mode::ALL.get(usize::from(head[1])).ok_or_else(bad)?;
        let time = f64::from_bits(number(2));
        let n = usize::try_from(number(10)).map_err(|_| bad())?;
        let (key, rest) = rest.split_at_checked(n).ok_or_else(bad)?;
        let key = std::str::from_utf8(key).map_err(|_| bad())?.to_string();
        if head[0] != LAYOUT || !time.is_finite() || mode == Intermediate {
            return Err(bad());
        }
        Ok(SavedState { key, mode, time, bytes: rest.to_vec() })
    }
}
