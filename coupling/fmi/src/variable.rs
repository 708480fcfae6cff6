//! What a master sees of a unit.

/// What a variable is to the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Time.
    Independent,
    /// The master sets it.
    Input,
    /// The unit says it.
    Output,
    /// A constant: names.
    Constant,
}

/// Type of the values of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Double precision.
    Float64,
    /// True or false; held as 1 and 0.
    Boolean,
    /// Text.
    String,
}

/// A variable. Its value reference is its number in the list of the unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name, structured: `pelvis.pose`.
    pub name: String,
    /// What it is to the master.
    pub causality: Causality,
    /// Type.
    pub kind: Kind,
    /// Size in every dimension, rows first; empty: a single value.
    pub dimensions: Vec<usize>,
    /// Unit, one of [`UNITS`]; empty where it has none or several, as the description says.
    pub unit: &'static str,
    /// What it is, for people.
    pub description: String,
    /// Start values of inputs.
    pub start: Vec<f64>,
    /// Least and greatest value of inputs.
    pub range: [f64; 2],
    /// Values of constants.
    pub words: Vec<String>,
}

/// Units with the exponents of kg, m, s and rad.
pub const UNITS: [(&str, [i32; 4]); 5] = [
    ("s", [0, 0, 1, 0]),
    ("m", [0, 1, 0, 0]),
    ("rad", [0, 0, 0, 1]),
    ("N", [1, 1, -2, 0]),
    ("N.m", [1, 2, -2, 0]),
];

/// Any finite number.
pub const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Variable {
    /// An output of numbers.
    pub fn output(
        name: impl Into<String>,
        dimensions: &[usize],
        unit: &'static str,
        description: impl Into<String>,
    ) -> Variable {
        Variable {
            name: name.into(),
            causality: Causality::Output,
            kind: Kind::Float64,
            dimensions: dimensions.to_vec(),
            unit,
            description: description.into(),
            start: Vec::new(),
            range: ANY,
            words: Vec::new(),
        }
    }

    /// An input of numbers.
    pub fn input(
        name: impl Into<String>,
        dimensions: &[usize],
        unit: &'static str,
        start: Vec<f64>,
        range: [f64; 2],
        description: impl Into<String>,
    ) -> Variable {
        Variable {
            causality: Causality::Input,
            start,
            range,
            ..Variable::output(name, dimensions, unit, description)
        }
    }

    /// The same, true or false.
    pub fn as_boolean(self) -> Variable {
        Variable { kind: Kind::Boolean, ..self }
    }

    /// Names that never change.
    pub fn names(name: &str, words: Vec<String>, description: &str) -> Variable {
        Variable {
            causality: Causality::Constant,
            kind: Kind::String,
            words: words.clone(),
            ..Variable::output(name, &[words.len()], "", description)
        }
    }

    /// Time.
    pub fn time() -> Variable {
        Variable { causality: Causality::Independent, ..Variable::output("time", &[], "s", "Time") }
    }

    /// Number of values.
    pub fn size(&self) -> usize {
        self.dimensions.iter().product()
    }

    /// Refuses values that are not finite or out of range; as many as the variable has.
    pub fn examine(&self, values: &[f64]) -> Result<(), String> {
        let [least, most] = self.range;
        let wrong = |v: &f64| !(v.is_finite() && *v >= least && *v <= most);
        let all: Vec<String> = values
            .iter()
            .enumerate()
            .filter(|(_, v)| wrong(v))
            .map(|(i, v)| if self.size() == 1 { format!("{v}") } else { format!("{v} at {}", i + 1) })
            .collect();
        match all.is_empty() {
            true => Ok(()),
            false if self.range == ANY => Err(format!("{} is {}, must be finite", self.name, all.join(", "))),
            false => Err(format!("{} is {}, must be from {least} to {most}", self.name, all.join(", "))),
        }
    }
}
