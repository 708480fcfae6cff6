//! What came of a rung: its numbers, what it took, and how it ended.

use std::collections::BTreeMap;
use std::path::Path;

use crate::comparison::quantities::Quantity;
use crate::configuration::Configuration;

/// Numbers of a run by step, configuration, quantity and whose it is, as in `quantities.csv`.
pub type Numbers = BTreeMap<[String; 3], f64>;

/// Section forces below this \[N\] enter no error in percent: a twentieth of it, 1 N, is what contact leaves open.
pub const LEAST_FORCE: f64 = 20.0;
/// The quantity that settings are judged by.
pub const SECTION_FORCE: &str = "section_force_N";
/// What stands for it where a muscle has no mesh.
const LINE_FORCE: &str = "line_force_N";

/// What a rung took.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Taken {
    /// Solid elements; 0 of the rigid leg alone.
    pub elements: usize,
    /// Unknowns.
    pub unknowns: usize,
    /// Wall time without calibration \[s\]: that is made once per mesh and kept.
    pub seconds: f64,
    /// Wall time of the calibration, made or found \[s\].
    pub calibration_seconds: f64,
    /// Seconds of every stage.
    pub stages: BTreeMap<String, f64>,
    /// Largest resident memory \[MiB\]; absent where the system does not tell.
    pub peak_mib: Option<f64>,
}

/// How a rung ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    /// Everything solved.
    Solved {
        /// What it took.
        taken: Taken,
        /// Its numbers.
        numbers: Numbers,
    },
    /// It has no numbers, and why.
    Failed(String),
}

impl Ending {
    /// What it took and its numbers, where it solved.
    pub fn solved(&self) -> Option<(&Taken, &Numbers)> {
        match self {
            Ending::Solved { taken, numbers } => Some((taken, numbers)),
            Ending::Failed(_) => None,
        }
    }
}

/// The numbers of a comparison in one configuration.
pub fn numbers_of(quantities: &[Quantity], configuration: Configuration) -> Numbers {
    let of = quantities.iter().filter(|q| q.configuration == configuration);
    of.map(|q| ([q.step.name().to_string(), q.kind.name().to_string(), q.of.clone()], q.value)).collect()
}

/// Reads `quantities.csv`: what another process has written. The configuration is left out: a rung has one.
pub fn read_numbers(file: &Path) -> Result<Numbers, String> {
    let bad = |what: String| format!("{}: {what}", file.display());
    let mut reader = csv::Reader::from_path(file).map_err(|e| bad(e.to_string()))?;
    let mut numbers = Numbers::new();
    for (i, row) in reader.records().enumerate() {
        let row = row.map_err(|e| bad(e.to_string()))?;
        let cell = |k: usize| row.get(k).unwrap_or("").to_string();
        let value = cell(4).parse().ok().filter(|v: &f64| v.is_finite());
        let value = value.ok_or_else(|| bad(format!("line {}: `{}` is no number", i + 2, cell(4))))?;
        numbers.insert([cell(0), cell(2), cell(3)], value);
    }
    Ok(numbers)
}

/// Errors of section forces against those of a finer rung, in fractions of the latter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Largest.
    pub largest: f64,
    /// Root mean square.
    pub rms: f64,
}

impl Deviation {
    /// Over all section forces above [`LEAST_FORCE`] in the reference; `None` where there are none.
    pub fn of(numbers: &Numbers, reference: &Numbers) -> Option<Deviation> {
        let errors: Vec<f64> = reference
            .iter()
            .filter(|(key, value)| key[1] == SECTION_FORCE && value.abs() > LEAST_FORCE)
            .map(|(key, value)| {
                let line = [key[0].clone(), LINE_FORCE.into(), key[2].clone()];
                let own = numbers.get(key).or_else(|| numbers.get(&line));
                own.map_or(1.0, |own| (own / value - 1.0).abs())
            })
            .collect();
        let n = errors.len() as f64;
        (n > 0.0).then(|| Deviation {
            largest: errors.iter().fold(0.0, |m, e| e.max(m)),
            rms: (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_look_at_what_carries() {
        let numbers = |forces: &[(&str, f64)]| -> Numbers {
            forces.iter().map(|(of, f)| (["step".into(), SECTION_FORCE.into(), (*of).into()], *f)).collect()
        };
        let fine = numbers(&[("a", 100.0), ("b", -50.0), ("c", 10.0)]);
        let coarse = numbers(&[("a", 103.0), ("b", -48.0), ("c", 90.0)]);
        let Deviation { largest, rms } = Deviation::of(&coarse, &fine).unwrap();
        assert!((largest - 0.04).abs() < 1e-12 && (rms - 0.0025f64.sqrt() / 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(Deviation::of(&coarse, &numbers(&[("c", 10.0)])), None);
        // A muscle without mesh has the force of its lines.
        let lines: Numbers = coarse
            .iter()
            .map(|([step, _, of], f)| ([step.clone(), LINE_FORCE.into(), of.clone()], *f))
            .collect();
        assert_eq!(Deviation::of(&lines, &fine), Deviation::of(&coarse, &fine));
        // A force that is not there is wrong altogether.
        assert_eq!(Deviation::of(&numbers(&[]), &fine).unwrap().largest, 1.0);
    }
}
