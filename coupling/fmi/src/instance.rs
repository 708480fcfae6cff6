//! The state machine of a unit, the same for both sides: what a master may call when, and what comes of it. No pointer gets here.

use std::sync::Arc;

use crate::error::UnitError;
use crate::model::Model;
use crate::saved::Mode::{self, Initialization, Instantiated, Intermediate, Step, Terminated};
use crate::saved::SavedState;
use crate::side::Side;
use crate::variable::{Causality, Kind, Variable};

/// Categories of messages.
pub const CATEGORIES: [(&str, &str); 3] = [
    ("logStatusError", "A call that was wrong; these are always told"),
    ("logStatusDiscard", "A step that has no solution; these are always told"),
    ("logEvents", "What the unit does; told while logging is on"),
];

/// An instance of a unit.
pub struct Instance {
    name: String,
    mode: Mode,
    time: f64,
    start: f64,
    side: Box<dyn Side>,
    variables: Arc<Vec<Variable>>,
    is_logging: bool,
    may_return_early: bool,
}

/// How far a step has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// At a point between, at this time \[s\].
    Between(f64),
    /// At its end, at this time \[s\].
    Done(f64),
}

/// Fraction of a step by which times may differ that should be the same: masters add steps up.
const SAME_TIME: f64 = 1e-6;

impl Instance {
    /// A new instance.
    pub fn new(name: &str, model: &Model, is_logging: bool, may_return_early: bool) -> Instance {
        let side = model.side();
        let variables = side.variables().clone();
        Instance {
            name: name.into(),
            mode: Instantiated,
            time: 0.0,
            start: 0.0,
            side,
            variables,
            is_logging,
            may_return_early,
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Time \[s\].
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Whether it tells more than what goes wrong.
    pub fn is_logging(&self) -> bool {
        self.is_logging
    }

    /// Whether a step may end before its end.
    pub fn may_return_early(&self) -> bool {
        self.may_return_early
    }

    /// Refuses a call in any mode but these.
    fn only_in(&self, call: &str, modes: &[Mode]) -> Result<(), UnitError> {
        if modes.contains(&self.mode) {
            return Ok(());
        }
        let names: Vec<&str> = modes.iter().map(|m| m.name()).collect();
        Err(UnitError::Wrong(format!("{call} in {}; it belongs in {}", self.mode.name(), names.join(" or "))))
    }

    /// Turns logging on or off, for all categories where none is named.
    pub fn set_logging(&mut self, on: bool, categories: &[String]) -> Result<(), UnitError> {
        let known = |name: &String| CATEGORIES.iter().any(|(category, _)| category == name);
        if let Some(unknown) = categories.iter().find(|c| !known(c)) {
            let all = CATEGORIES.map(|c| c.0).join(", ");
            return Err(UnitError::Wrong(format!("there is no category `{unknown}`; there are {all}")));
        }
        let events = |c: &String| c == "logEvents";
        if categories.is_empty() || categories.iter().any(events) {
            self.is_logging = on;
        }
        Ok(())
    }

    /// fmi3EnterInitializationMode.
    pub fn enter_initialization(&mut self, start: f64, stop: Option<f64>) -> Result<(), UnitError> {
        self.only_in("fmi3EnterInitializationMode", &[Instantiated])?;
        let stops = stop.unwrap_or(start);
        if !start.is_finite() || !(stops >= start) {
            return Err(UnitError::Wrong(format!(
                "a simulation from {start} s to {stops} s; times must be finite and not go backwards"
            )));
        }
        (self.mode, self.start, self.time) = (Initialization, start, start);
        Ok(())
    }

    /// fmi3ExitInitializationMode.
    pub fn exit_initialization(&mut self) -> Result<(), UnitError> {
        self.only_in("fmi3ExitInitializationMode", &[Initialization])?;
        self.side.start(self.start)?;
        self.mode = Step;
        Ok(())
    }

    /// fmi3Terminate.
    pub fn terminate(&mut self) -> Result<(), UnitError> {
        self.only_in("fmi3Terminate", &[Step])?;
        self.mode = Terminated;
        Ok(())
    }

    /// fmi3Reset.
    pub fn reset(&mut self) -> Result<(), UnitError> {
        self.only_in("fmi3Reset", &[Instantiated, Initialization, Step, Terminated])?;
        self.side.reset();
        (self.mode, self.time, self.start) = (Instantiated, 0.0, 0.0);
        Ok(())
    }

    /// The variable of a value reference, and its number.
    fn variable(&self, reference: u32, kind: Kind) -> Result<(usize, &Variable), UnitError> {
        let number = reference as usize;
        let Some(variable) = self.variables.get(number) else {
            let last = self.variables.len() - 1;
            return Err(UnitError::Wrong(format!(
                "there is no variable {reference}; value references go from 0 to {last}"
            )));
        };
        match variable.kind == kind {
            true => Ok((number, variable)),
            false => {
                Err(UnitError::Wrong(format!("{} is a {:?}, not a {kind:?}", variable.name, variable.kind)))
            }
        }
    }

    /// Refuses an array of another size than the variables have together.
    fn sized(&self, references: &[u32], kind: Kind, n: usize) -> Result<(), UnitError> {
        let mut wanted = 0;
        for reference in references {
            wanted += self.variable(*reference, kind)?.1.size();
        }
        if wanted == n {
            return Ok(());
        }
        let each: Vec<String> = references
            .iter()
            .filter_map(|r| self.variables.get(*r as usize))
            .map(|v| format!("{} {:?}", v.name, v.dimensions))
            .collect();
        Err(UnitError::Wrong(format!("{n} values for {wanted}: {}", each.join(", "))))
    }

    /// Values of numbers or truth values, one variable after the other, `n` together.
    pub fn get(&mut self, references: &[u32], kind: Kind, n: usize) -> Result<Vec<f64>, UnitError> {
        self.only_in("getting values", &[Initialization, Step, Intermediate, Terminated])?;
        self.sized(references, kind, n)?;
        let mut values = Vec::with_capacity(n);
        for reference in references {
            let number = *reference as usize;
            match self.variables[number].causality {
                Causality::Independent => values.push(self.time),
                _ => values.extend(self.side.get(number)?),
            }
        }
        Ok(values)
    }

    /// Texts of constants, one variable after the other, `n` together.
    pub fn words(&self, references: &[u32], n: usize) -> Result<Vec<String>, UnitError> {
        self.sized(references, Kind::String, n)?;
        Ok(references.iter().flat_map(|r| self.variables[*r as usize].words.clone()).collect())
    }

    /// Sets inputs. All of them are looked at before any is set.
    pub fn set(&mut self, references: &[u32], kind: Kind, values: &[f64]) -> Result<(), UnitError> {
        self.only_in("setting values", &[Instantiated, Initialization, Step])?;
        self.sized(references, kind, values.len())?;
        let (mut mistakes, mut at) = (Vec::new(), 0);
        for reference in references {
            let (_, variable) = self.variable(*reference, kind)?;
            let own = &values[at..at + variable.size()];
            at += own.len();
            if variable.causality != Causality::Input {
                mistakes.push(format!("{} is no input", variable.name));
            } else if let Err(why) = variable.examine(own) {
                mistakes.push(why);
            }
        }
        if !mistakes.is_empty() {
            return Err(UnitError::Wrong(mistakes.join("; ")));
        }
        let mut at = 0;
        for reference in references {
            let n = self.variables[*reference as usize].size();
            self.side.set(*reference as usize, &values[at..at + n])?;
            at += n;
        }
        Ok(())
    }

    /// Begins a step; where it ends.
    pub fn begin_step(&mut self, from: f64, size: f64) -> Result<f64, UnitError> {
        self.only_in("fmi3DoStep", &[Step])?;
        if !(size > 0.0 && size.is_finite()) {
            return Err(UnitError::Wrong(format!(
                "a step of {size} s; it must be above 0, a unit goes back by fmi3SetFMUState alone"
            )));
        }
        if !((from - self.time).abs() <= SAME_TIME * size) {
            let time = self.time;
            return Err(UnitError::Wrong(format!(
                "a step from {from} s, but the unit is at {time} s; it goes back by fmi3SetFMUState alone"
            )));
        }
        Ok(from + size)
    }

    /// Goes on in a step to `end`, by way of what there is to be seen between where `is_watched`. Where that fails the unit is where it was
    /// before.
    pub fn go_on(&mut self, end: f64, is_watched: bool) -> Result<Progress, UnitError> {
        let between = is_watched.then(|| self.side.next_between(self.time, end)).flatten();
        let to = between.unwrap_or(end);
        self.side.step(to)?;
        self.time = to;
        Ok(if between.is_some() { Progress::Between(to) } else { Progress::Done(to) })
    }

    /// The present state, where there is something to be seen before `end`.
    pub fn before_stops(&self, end: f64) -> Result<Option<SavedState>, UnitError> {
        self.side.next_between(self.time, end).map(|_| self.save()).transpose()
    }

    /// Lets the master look, or go on after it has looked.
    pub fn show(&mut self, is_shown: bool) {
        self.mode = if is_shown { Intermediate } else { Step };
    }

    /// fmi3GetFMUState.
    pub fn save(&self) -> Result<SavedState, UnitError> {
        self.only_in("fmi3GetFMUState", &[Instantiated, Initialization, Step, Terminated])?;
        Ok(SavedState {
            key: self.side.key().into(),
            mode: self.mode,
            time: self.time,
            bytes: self.side.save(),
        })
    }

    /// fmi3SetFMUState.
    pub fn restore(&mut self, state: &SavedState) -> Result<(), UnitError> {
        self.only_in("fmi3SetFMUState", &[Instantiated, Initialization, Step, Terminated])?;
        if state.key != self.side.key() {
            return Err(UnitError::wrong("the state is one of another unit"));
        }
        self.side.restore(&state.bytes)?;
        (self.mode, self.time, self.start) = (state.mode, state.time, state.time);
        Ok(())
    }

    /// What is refused because no unit of ours has it.
    pub fn has_none(&self, call: &str) -> UnitError {
        UnitError::Wrong(format!(
            "{call}: this unit has nothing of the kind; modelDescription.xml says what it can"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A side with an input, and an output that is the sum of all inputs so far.
    struct Sum {
        variables: Arc<Vec<Variable>>,
        input: f64,
        sum: f64,
    }

    impl Sum {
        fn new() -> Sum {
            let variables = vec![
                Variable::time(),
                Variable::input("a", &[], "", vec![0.0], [0.0, 1.0], "an input"),
                Variable::output("sum", &[2], "", "an output"),
                Variable::names("names", vec!["x".into(), "y".into()], "names"),
            ];
            Sum { variables: Arc::new(variables), input: 0.0, sum: 0.0 }
        }
    }

    impl Side for Sum {
        fn variables(&self) -> &Arc<Vec<Variable>> {
            &self.variables
        }
        fn get(&mut self, variable: usize) -> Result<Vec<f64>, UnitError> {
            Ok(if variable == 1 { vec![self.input] } else { vec![self.sum, -self.sum] })
        }
        fn set(&mut self, _: usize, values: &[f64]) -> Result<(), UnitError> {
            self.input = values[0];
            Ok(())
        }
        fn start(&mut self, _: f64) -> Result<(), UnitError> {
            Ok(())
        }
        fn step(&mut self, to: f64) -> Result<(), UnitError> {
            if to > 10.0 {
                return Err(UnitError::NoSolution("beyond the end".into()));
            }
            self.sum += self.input;
            Ok(())
        }
        fn next_between(&self, from: f64, to: f64) -> Option<f64> {
            Some(from + 1.0).filter(|t| *t < to)
        }
        fn reset(&mut self) {
            *self = Sum::new();
        }
        fn save(&self) -> Vec<u8> {
            [self.input, self.sum].iter().flat_map(|v| v.to_le_bytes()).collect()
        }
        fn restore(&mut self, state: &[u8]) -> Result<(), UnitError> {
            let ([a, b], []) = state.as_chunks::<8>() else { return Err(UnitError::wrong("damaged")) };
            (self.input, self.sum) = (f64::from_le_bytes(*a), f64::from_le_bytes(*b));
            Ok(())
        }
        fn key(&self) -> &str {
            "sum"
        }
    }

    fn instance() -> Instance {
        let side: Box<dyn Side> = Box::new(Sum::new());
        let variables = side.variables().clone();
        Instance {
            name: "i".into(),
            mode: Instantiated,
            time: 0.0,
            start: 0.0,
            side,
            variables,
            is_logging: false,
            may_return_early: true,
        }
    }

    fn in_step_mode() -> Instance {
        let mut i = instance();
        i.enter_initialization(0.0, None).and_then(|()| i.exit_initialization()).unwrap();
        i
    }

    #[test]
    fn every_call_belongs_in_its_modes_and_nowhere_else() {
        type Call = fn(&mut Instance) -> Result<(), UnitError>;
        let calls: [(&str, Call, &[Mode]); 9] = [
            ("enter", |i| i.enter_initialization(0.0, None), &[Instantiated]),
            ("exit", Instance::exit_initialization, &[Initialization]),
            ("step", |i| i.begin_step(i.time, 1.0).map(|_| ()), &[Step]),
            (
                "get",
                |i| i.get(&[2], Kind::Float64, 2).map(|_| ()),
                &[Initialization, Step, Intermediate, Terminated],
            ),
            ("set", |i| i.set(&[1], Kind::Float64, &[0.5]), &[Instantiated, Initialization, Step]),
            ("terminate", Instance::terminate, &[Step]),
            ("reset", Instance::reset, &[Instantiated, Initialization, Step, Terminated]),
            ("save", |i| i.save().map(|_| ()), &[Instantiated, Initialization, Step, Terminated]),
            ("names", |i| i.words(&[3], 2).map(|_| ()), &Mode::ALL),
        ];
        for (name, call, modes) in calls {
            for mode in Mode::ALL {
                let mut i = instance();
                i.mode = mode;
                assert_eq!(call(&mut i).is_ok(), modes.contains(&mode), "{name} in {mode:?}");
            }
        }
    }

    #[test]
    fn what_is_refused_says_so_and_changes_nothing() {
        let mut i = in_step_mode();
        let before = i.save().unwrap();
        let said = |result: Result<(), UnitError>| match result.unwrap_err() {
            UnitError::Wrong(words) => words,
            other => panic!("{other}"),
        };
        assert!(said(i.set(&[1], Kind::Float64, &[f64::NAN])).contains("a is NaN, must be from 0 to 1"));
        assert!(
            said(i.set(&[1, 2], Kind::Float64, &[2.0, 0.0, 0.0]))
                .contains("a is 2, must be from 0 to 1; sum is no input")
        );
        assert!(said(i.set(&[1], Kind::Float64, &[0.5, 0.5])).contains("2 values for 1: a []"));
        assert!(said(i.set(&[1], Kind::Boolean, &[1.0])).contains("is a Float64, not a Boolean"));
        assert!(said(i.get(&[4], Kind::Float64, 1).map(|_| ())).contains("value references go from 0 to 3"));
        for size in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(said(i.begin_step(0.0, size).map(|_| ())).contains("must be above 0"));
        }
        assert!(said(i.begin_step(-1.0, 1.0).map(|_| ())).contains("the unit is at 0 s"));
        assert_eq!(i.save().unwrap(), before);
    }

    #[test]
    fn a_state_goes_through_bytes_and_comes_back_whole_or_not_at_all() {
        let mut i = in_step_mode();
        i.set(&[1], Kind::Float64, &[0.25]).unwrap();
        let state = i.save().unwrap();
        assert_eq!(i.go_on(3.0, false).unwrap(), Progress::Done(3.0));
        assert_eq!(i.get(&[0, 2], Kind::Float64, 3).unwrap(), [3.0, 0.25, -0.25]);
        let bytes = state.to_bytes();
        assert_eq!(bytes.len(), state.n_bytes());
        i.restore(&SavedState::of_bytes(&bytes).unwrap()).unwrap();
        assert_eq!((i.save().unwrap(), i.time()), (state.clone(), 0.0));
        for n in 0..bytes.len() {
            let cut = SavedState::of_bytes(&bytes[..n]).and_then(|state| i.restore(&state));
            assert!(cut.is_err(), "{n} of {} bytes", bytes.len());
        }
        let other = SavedState { key: "another".into(), ..state };
        assert!(i.restore(&other).unwrap_err().to_string().contains("another unit"));
    }

    #[test]
    fn a_step_stops_where_it_is_watched() {
        let mut i = in_step_mode();
        assert_eq!(i.go_on(2.5, true).unwrap(), Progress::Between(1.0));
        assert_eq!(i.go_on(2.5, true).unwrap(), Progress::Between(2.0));
        assert_eq!(i.go_on(2.5, true).unwrap(), Progress::Done(2.5));
        assert!(matches!(i.go_on(11.0, false), Err(UnitError::NoSolution(_))));
        assert_eq!(i.time(), 2.5);
    }
}
