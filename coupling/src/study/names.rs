//! Which keys a study can set, and what is meant by a name that is none of them.

use multibody::calibration::shifts::LANDMARKS;
use multibody::error::{hint, nearest, unknown};
use multibody::keys::{Key, Kind};
use multibody::trial_file;

use super::vary::Target;
use crate::options::OPTIONS;
use crate::scene::KEYS as SCENE_KEYS;

/// What a key of `[[vary]]` stands for; an error says what may be meant. `muscles`: names of the muscle lines.
pub fn targets(key: &str, muscles: &[String]) -> Result<Vec<Target>, String> {
    let (name, rest) = key.split_once('.').map_or((key, None), |(name, rest)| (name, Some(rest)));
    let of_landmark = |name: &'static str| (0..3).map(move |axis| Target::Landmark(name, axis));
    match (name, rest) {
        ("landmarks", None) => Ok(LANDMARKS.iter().flat_map(|name| of_landmark(name)).collect()),
        ("landmarks", Some(given)) => match LANDMARKS.iter().find(|name| **name == given) {
            Some(name) => Ok(of_landmark(name).collect()),
            None => Err(unknown(given, "landmarks are", LANDMARKS.iter().copied())),
        },
        ("strengths", None) => Ok(muscles.iter().cloned().map(Target::Strength).collect()),
        ("strengths", Some(given)) => match muscles.iter().any(|m| m == given) {
            true => Ok(vec![Target::Strength(given.into())]),
            false => Err(unknown(given, "muscle lines are", muscles.iter().map(String::as_str))),
        },
        _ => known_key(key).map(|target| vec![target]),
    }
}

/// Names of the muscle lines, in the order of the model.
pub fn muscle_lines() -> Vec<String> {
    let mut table = csv::Reader::from_reader(include_str!("../../../gait-data/muscles.csv").as_bytes());
    let column = table.headers().ok().and_then(|names| names.iter().position(|n| n == "name"));
    let column = column.expect("built-in table");
    table.records().map(|row| row.expect("built-in table")[column].to_string()).collect()
}

/// Kinds of keys that a run can take a value of.
fn settable(keys: &'static [Key]) -> impl Iterator<Item = &'static Key> {
    let in_list = |k: &Key| {
        keys.iter().any(|s| matches!(s.kind, Kind::Sections) && k.path.starts_with(&format!("{}.", s.path)))
    };
    keys.iter().filter(move |k| !k.is_section() && !in_list(k))
}

/// What a key means; an error names what may be meant.
pub(super) fn known_key(key: &str) -> Result<Target, String> {
    /// Begin of a key, what may follow it, and what it sets.
    type Space = (&'static str, &'static [Key], fn(String) -> Target);
    let spaces: [Space; 3] = [
        ("trial", trial_file::KEYS, Target::Trial),
        ("scene", SCENE_KEYS, Target::Scene),
        ("optimize", OPTIONS, Target::Option),
    ];
    let all = || {
        spaces.iter().flat_map(|(space, keys, _)| settable(keys).map(move |k| format!("{space}.{}", k.path)))
    };
    for (space, keys, target) in spaces {
        let Some(path) = key.strip_prefix(space).and_then(|rest| rest.strip_prefix('.')) else { continue };
        if settable(keys).any(|k| k.path == path) || (space == "scene" && is_in_named_element(path)) {
            return Ok(target(path.to_string()));
        }
    }
    let groups = ["landmarks", "strengths"].map(String::from);
    let candidates: Vec<String> = all().chain(groups).collect();
    let ends_alike = || candidates.iter().find(|c| c.rsplit('.').next() == key.rsplit('.').next()).cloned();
    let meant = nearest(key, candidates.iter().map(String::as_str)).or_else(ends_alike);
    let meant = hint(meant);
    let space = key.split('.').next().unwrap_or("");
    let known: Vec<String> = all().filter(|c| c.split('.').next() == Some(space)).collect();
    Err(match known.is_empty() {
        true => format!("{meant}keys begin with trial, scene or optimize, or are landmarks or strengths"),
        false => format!("{meant}known are {}", known.join(", ")),
    })
}

/// Whether a key of the scene is one of a named element of a list: `step.heel_strike.knee_flexion_deg`.
fn is_in_named_element(path: &str) -> bool {
    ["step", "materials.muscle"].iter().any(|list| {
        let rest = path.strip_prefix(list).and_then(|rest| rest.strip_prefix('.'));
        let key = rest.and_then(|rest| rest.split_once('.')).map(|(_, key)| format!("{list}.{key}"));
        key.is_some_and(|key| !key.ends_with(".name") && SCENE_KEYS.iter().any(|k| k.path == key))
    })
}
