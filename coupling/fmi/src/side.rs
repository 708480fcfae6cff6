//! The mechanics behind a unit.

use std::sync::Arc;

use crate::error::UnitError;
use crate::variable::Variable;

/// What one side does for the state machine. Variables are told by their numbers in [`variables`](Side::variables).
pub trait Side: Send {
    /// Everything that the master sees; time first.
    fn variables(&self) -> &Arc<Vec<Variable>>;
    /// Values of an input or output.
    fn get(&mut self, variable: usize) -> Result<Vec<f64>, UnitError>;
    /// Sets an input; as many values as it has, each finite and within its range. Refused: nothing changes.
    fn set(&mut self, variable: usize, values: &[f64]) -> Result<(), UnitError>;
    /// Where the simulation starts \[s\].
    fn start(&mut self, time: f64) -> Result<(), UnitError>;
    /// Goes to a time \[s\] with the inputs that are set. Refused: it stays where it is.
    fn step(&mut self, to: f64) -> Result<(), UnitError>;
    /// The next time between two \[s\], both left out, at which there is something to be seen.
    fn next_between(&self, from: f64, to: f64) -> Option<f64>;
    /// As it was when it was made.
    fn reset(&mut self);
    /// State and inputs as bytes.
    fn save(&self) -> Vec<u8>;
    /// Takes them over; refuses those of another unit.
    fn restore(&mut self, state: &[u8]) -> Result<(), UnitError>;
    /// Says which unit a state is of.
    fn key(&self) -> &str;
}

/// A state as bytes: the inputs as bits, then that of the session.
pub fn with_inputs(inputs: &[Vec<f64>], session: &[u8]) -> Vec<u8> {
    let numbers = inputs.iter().flatten().flat_map(|v| v.to_bits().to_le_bytes());
    numbers.chain(session.iter().copied()).collect()
}

/// The inputs of such a state, as many as there are `now`, and that of the session.
pub fn inputs_of<'a>(
    state: &'a [u8],
    now: &[Vec<f64>],
    variables: &[Variable],
) -> Result<(Vec<Vec<f64>>, &'a [u8]), UnitError> {
    let n: usize = now.iter().map(Vec::len).sum();
    let cut = state.split_at_checked(8 * n);
    let (numbers, rest) = cut.ok_or_else(|| UnitError::wrong("the state is incomplete"))?;
    let mut numbers = numbers.as_chunks::<8>().0.iter().map(|b| f64::from_bits(u64::from_le_bytes(*b)));
    let mut inputs = now.to_vec();
    for (values, variable) in inputs.iter_mut().zip(variables) {
        values.iter_mut().for_each(|to| *to = numbers.next().expect("counted"));
        variable.examine(values).map_err(|why| UnitError::Wrong(format!("the state is damaged: {why}")))?;
    }
    Ok((inputs, rest))
}
