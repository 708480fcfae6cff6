//! What the muscles of the deformable thigh can do over a gait cycle, as an input of force sharing.
//!
//! `compare --two-way` on a scene with many steps writes `capacities.csv`: per step and muscle the least and greatest tension and the lever
//! arms that the thigh shows. Between two steps all of them are interpolated linearly in time. Every line of a muscle has its lever arms,
//! and of its bounds the fraction that its strength is of the strengths of all lines.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::error::{Mistakes, Place, unknown};
use multibody::model::Model;
use multibody::read::with_plain_ends;
use multibody::sharing::Capacity;

use crate::error::CouplingError;
use crate::thigh::lines::lines_of_muscles;

/// Knee flexions of the thigh and of the trial at the same time that differ by more than this \[degrees\] are of different trials: the
/// published and the revised leg of a trial differ by less than 3.
const SAME_KNEE: f64 = 10.0;
/// A row must have these, and at least one lever arm.
const COLUMNS: [&str; 5] = ["muscle", "least_N", "greatest_N", "time_s", "knee_flexion_deg"];

/// What a muscle can do at an instant.
#[derive(Clone, Debug, Default, PartialEq)]
struct Ability {
    /// Least and greatest tension \[N\].
    bounds: [f64; 2],
    /// Lever arms about the coordinates \[m\].
    arms: Vec<f64>,
}

/// Abilities of all muscles at an instant.
#[derive(Clone, Debug, PartialEq)]
struct Instant {
    /// Time \[s\].
    time: f64,
    /// Knee flexion \[degrees\].
    knee: f64,
    /// By muscle.
    abilities: BTreeMap<String, Ability>,
}

/// Abilities of all muscles at a few instants.
#[derive(Clone, Debug, PartialEq)]
pub struct ThighCapacities {
    /// Where they were read.
    pub file: PathBuf,
    /// Coordinates of the lever arms, by name.
    coordinates: Vec<String>,
    /// Lines of every muscle that there is.
    lines: BTreeMap<String, Vec<String>>,
    /// By their time; all have the same muscles.
    instants: Vec<Instant>,
}

/// By how much a straight line between steps misses what lies between, and the muscle and the time \[s\] of which it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BetweenSteps {
    /// Lever arms \[m\].
    pub arm: (f64, String, f64),
    /// Bounds \[N\].
    pub bound: (f64, String, f64),
}

impl ThighCapacities {
    /// Reads `capacities.csv` of `compare --two-way`; names every mistake.
    pub fn read(file: &Path) -> Result<ThighCapacities, InputError> {
        let io = |source| InputError::Io { file: file.to_path_buf(), source };
        ThighCapacities::parse(file, &std::fs::read_to_string(file).map_err(io)?)
    }

    /// The same from its text.
    pub fn parse(file: &Path, text: &str) -> Result<ThighCapacities, InputError> {
        let malformed = |at: Place, problem: String, remedy: &str| InputError::Malformed {
            file: file.to_path_buf(),
            at,
            problem,
            remedy: remedy.into(),
        };
        let mut wrong = Mistakes::default();
        let text = with_plain_ends(text);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let unreadable = |e: csv::Error| {
            let line = e.position().map_or(Place::Whole, |p| Place::Line(p.line() as usize));
            malformed(line, format!("{e}"), "copy the file again")
        };
        let header = reader.headers().map_err(unreadable)?.clone();
        let at = |name: &str| header.iter().position(|h| h == name);
        let columns = COLUMNS.map(at);
        for (name, _) in COLUMNS.iter().zip(columns).filter(|(_, at)| at.is_none()) {
            let problem = format!("there is no column `{name}`");
            wrong.note(malformed(Place::Line(1), problem, "give capacities.csv of compare --two-way"));
        }
        let arms: Vec<(usize, String)> = (header.iter().enumerate())
            .filter_map(|(i, h)| Some((i, h.strip_suffix("_m").filter(|h| *h != "elongation")?.to_string())))
            .collect();
        if arms.is_empty() {
            let problem = "there is no column of lever arms, such as `knee_flexion_m`".to_string();
            wrong.note(malformed(Place::Line(1), problem, "give capacities.csv of compare --two-way"));
        }
        let known = lines_of_muscles();
        let mut read = ThighCapacities {
            file: file.to_path_buf(),
            lines: known.clone(),
            coordinates: arms.iter().map(|(_, name)| name.clone()).collect(),
            instants: Vec::new(),
        };
        for row in reader.records() {
            let row = row.map_err(unreadable)?;
            let line = Place::Line(row.position().map_or(0, |p| p.line() as usize));
            let mut number = |i: Option<usize>| {
                // That a column is missing was said.
                let Some(i) = i else { return f64::NAN };
                let value = row[i].trim().parse::<f64>().ok().filter(|v| v.is_finite());
                if value.is_none() {
                    let (what, value) = (header[i].to_string(), row[i].to_string());
                    wrong.note(InputError::BadNumber { file: file.to_path_buf(), at: line, what, value });
                }
                value.unwrap_or(f64::NAN)
            };
            let [muscle, least, greatest, time, knee] = columns;
            let [least, greatest, time, knee] = [least, greatest, time, knee].map(&mut number);
            let arms = arms.iter().map(|(i, _)| number(Some(*i))).collect();
            let Some(name) = muscle.map(|i| row[i].to_string()) else { continue };
            if !known.contains_key(&name) {
                let remedy = unknown(&name, "muscles of the thigh are", known.keys().map(String::as_str));
                wrong.note(malformed(line, format!("there is no muscle `{name}`"), &remedy));
            }
            if !(least.is_nan() || greatest.is_nan() || 0.0 <= least && least <= greatest) {
                let problem = format!("`{name}` pulls with {least} N at least and {greatest} N at most");
                wrong.note(malformed(line, problem, "give 0 <= least_N <= greatest_N"));
            }
            if time.is_nan() {
                continue;
            }
            match read.instants.last() {
                Some(last) if last.time == time => {}
                Some(Instant { time: previous, .. }) if time < *previous => {
                    let (at, previous) = (line, *previous);
                    let file = file.to_path_buf();
                    wrong.note(InputError::TimeNotIncreasing { file, at, time, previous });
                }
                _ => read.instants.push(Instant { time, knee, abilities: BTreeMap::new() }),
            }
            let Some(instant) = read.instants.last_mut() else { continue };
            if instant.abilities.insert(name.clone(), Ability { bounds: [least, greatest], arms }).is_some() {
                let problem = format!("`{name}` at {time} s again");
                wrong.note(malformed(line, problem, "give every muscle once per step"));
            }
        }
        wrong.finish()?;
        let mut wrong = Mistakes::default();
        let all: BTreeSet<&String> = read.instants.iter().flat_map(|i| i.abilities.keys()).collect();
        for instant in &read.instants {
            let lacks: Vec<&str> =
                all.iter().filter(|m| !instant.abilities.contains_key(**m)).map(|m| m.as_str()).collect();
            if !lacks.is_empty() {
                let problem = format!("at {} s there is no row of {}", instant.time, lacks.join(", "));
                wrong.note(malformed(Place::Whole, problem, "give every muscle at every step"));
            }
        }
        if read.instants.len() < 2 {
            let problem = format!("it has {} steps", read.instants.len());
            let remedy = "give at least two steps of the trial: those between are interpolated; the table of a single pass is empty";
            wrong.note(malformed(Place::Whole, problem, remedy));
        }
        wrong.finish()?;
        Ok(read)
    }

    /// Muscles of the thigh, by name.
    pub fn muscles(&self) -> impl Iterator<Item = &str> {
        self.instants[0].abilities.keys().map(String::as_str)
    }

    /// Refuses frames of another trial. `time` \[s\] and `knee` (flexion, degrees; NaN where it is unknown) of the reported frames.
    pub fn check(&self, time: &[f64], knee: &[f64]) -> Result<(), CouplingError> {
        let refused = |text: String| Err(CouplingError::Option(format!("{}: {text}", self.file.display())));
        let [first, last] = [&self.instants[0], &self.instants[self.instants.len() - 1]].map(|i| i.time);
        let (Some(from), Some(to)) = (time.first(), time.last()) else { return Ok(()) };
        // A step is the frame that is nearest to its instant.
        let half = 0.5 * (to - from) / (time.len().max(2) - 1) as f64;
        if *from < first - half || *to > last + half {
            return refused(format!(
                "its steps reach from {first} to {last} s, the reported frames from {from} to {to} s; name heel_strike, cycle_100 and \
                 steps between as [[step]] of the scene"
            ));
        }
        for instant in &self.instants {
            let far = |k: &usize| (time[*k] - instant.time).abs();
            let nearest = (0..time.len()).min_by(|a, b| far(a).total_cmp(&far(b))).expect("there are frames");
            if (knee[nearest] - instant.knee).abs() > SAME_KNEE {
                return refused(format!(
                    "at {} s the knee flexes by {:.0} degrees there and by {:.0} degrees in the trial; give the capacities of this trial",
                    instant.time, instant.knee, knee[nearest]
                ));
            }
        }
        Ok(())
    }

    /// Capacity at a time \[s\]: `of_lines` with what the thigh says of its muscles.
    pub fn at(&self, time: f64, model: &Model, of_lines: &Capacity) -> Capacity {
        let next =
            self.instants.iter().position(|i| i.time >= time).unwrap_or(self.instants.len() - 1).max(1);
        let [before, after] = [&self.instants[next - 1], &self.instants[next]];
        let fraction = ((time - before.time) / (after.time - before.time)).clamp(0.0, 1.0);
        let mut capacity = of_lines.clone();
        let names = model.coordinate_names();
        for (muscle, ability) in &before.abilities {
            let ability = ability.towards(&after.abilities[muscle], fraction);
            let lines: Vec<usize> = (self.lines[muscle].iter())
                .filter_map(|line| model.muscles.iter().position(|m| m.name == *line))
                .collect();
            let arms: Vec<(usize, f64)> = (self.coordinates.iter().zip(&ability.arms))
                .filter_map(|(name, arm)| Some((names.iter().position(|n| n == name)?, *arm)))
                .collect();
            capacity.give(&lines, |i| model.muscles[i].f_max, ability.bounds, &arms);
        }
        capacity
    }

    /// A quarter of the most that a straight line misses at any step when that step is left out, because the error goes with the square of
    /// the distance. Where a muscle begins to pull, its lever arms turn from those of the lines to those of the mesh, and the error is large.
    pub fn between_steps(&self) -> BetweenSteps {
        let mut most = BetweenSteps::default();
        for i in 1..self.instants.len() - 1 {
            let [before, here, after] = [i - 1, i, i + 1].map(|k| &self.instants[k]);
            let fraction = (here.time - before.time) / (after.time - before.time);
            for (muscle, there) in &here.abilities {
                let told = before.abilities[muscle].towards(&after.abilities[muscle], fraction);
                let farthest = |a: &[f64], b: &[f64]| {
                    a.iter().zip(b).map(|(a, b)| 0.25 * (a - b).abs()).fold(0.0, f64::max)
                };
                let of = |missed: f64| (missed, muscle.clone(), here.time);
                let (arm, bound) = (farthest(&told.arms, &there.arms), farthest(&told.bounds, &there.bounds));
                if arm > most.arm.0 {
                    most.arm = of(arm);
                }
                if bound > most.bound.0 {
                    most.bound = of(bound);
                }
            }
        }
        most
    }
}

impl Ability {
    /// On the straight line to another, this fraction of the way.
    fn towards(&self, other: &Ability, fraction: f64) -> Ability {
        let mix = |(a, b): (&f64, &f64)| a + fraction * (b - a);
        Ability {
            bounds: std::array::from_fn(|i| mix((&self.bounds[i], &other.bounds[i]))),
            arms: self.arms.iter().zip(&other.arms).map(mix).collect(),
        }
    }
}
