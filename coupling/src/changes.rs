//! What a run takes in place of what its files say: keys of trial and scene, places of landmarks, strengths, options of `optimize`. A study varies these.

use std::collections::BTreeMap;
use std::path::Path;

use multibody::InputError;
use multibody::calibration::shifts::Shifts;
use multibody::keys::Key;
use multibody::keys::Kind::{Flag, Number, Word};
use multibody::keys::Need::{Default as Is, Optional};
use multibody::keys::key;
use multibody::model::{Ankle, Model};
use multibody::muscle::curves::{Curves, DeGroote2016};
use multibody::muscle::hill::Tendon;
use multibody::sharing::{MuscleCost, ReactionCost};
use multibody::trial_file::HipRule;
use toml::{Table, Value};

use crate::cost::ladder;
use crate::optimize::OptimizeOptions;
use crate::scene::Scene;

/// What differs from the trial as it was recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// Keys of the trial file, dotted, in place of its own. The built-in walker has none.
    pub trial: BTreeMap<String, Value>,
    /// Landmarks that sit elsewhere.
    pub landmarks: Shifts,
    /// Factor on the strength of muscle lines, by name; of the others it is 1.
    pub strengths: BTreeMap<String, f64>,
}

impl Changes {
    /// Muscles as strong as they are to be.
    pub fn strengthen(&self, model: &mut Model) {
        for muscle in &mut model.muscles {
            muscle.f_max *= self.strengths.get(&muscle.name).copied().unwrap_or(1.0);
        }
    }

    /// The text of a trial file with these keys.
    pub fn trial_text(&self, text: &str) -> Result<String, toml::de::Error> {
        let mut table: Table = toml::from_str(text)?;
        self.trial.iter().for_each(|(path, value)| set(&mut table, path, value));
        Ok(toml::to_string(&table).expect("keys and values of TOML"))
    }
}

/// A scene with keys, dotted, in place of its own; an element of a list is called by its `name`: `step.heel_strike.knee_flexion_deg`.
pub fn scene_with(
    base: &Scene,
    keys: &BTreeMap<String, Value>,
    data: Option<&Path>,
) -> Result<Scene, InputError> {
    let resolved = ladder::changed(base, &BTreeMap::new(), &base.name, data)?;
    if keys.is_empty() {
        return Ok(resolved);
    }
    let mut table: Table = toml::from_str(&resolved.text).expect("it was read");
    keys.iter().for_each(|(path, value)| set(&mut table, path, value));
    let text = toml::to_string(&table).expect("keys and values of TOML");
    Scene::parse(Path::new(&format!("{}.toml", base.name)), &text, data)
}

/// Sets a dotted key; sections that are not there are made.
fn set(table: &mut Table, path: &str, value: &Value) {
    let Some((first, rest)) = path.split_once('.') else {
        table.insert(path.into(), value.clone());
        return;
    };
    let inner = table.entry(first).or_insert_with(|| match first {
        "step" | "muscle" => Value::Array(Vec::new()),
        _ => Value::Table(Table::new()),
    });
    match inner {
        Value::Table(inner) => set(inner, rest, value),
        Value::Array(list) => {
            let (name, rest) = rest.split_once('.').unwrap_or((rest, ""));
            let is_named = |v: &Value| v.get("name").and_then(Value::as_str) == Some(name);
            if !list.iter().any(is_named) {
                list.push(Table::from_iter([("name".to_string(), Value::from(name))]).into());
            }
            let element = list.iter_mut().find(|v| is_named(v)).and_then(Value::as_table_mut);
            set(element.expect("just added"), rest, value);
        }
        other => *other = value.clone(), // refused by whoever reads the file
    }
}

/// Options of `optimize`, as its command line names them.
#[rustfmt::skip]
pub const OPTIONS: &[Key] = &[
    key("cost", Word(&["force", "activation", "volume"]), Is("\"force\""), "", "What muscle forces cost: their squares, squared activations, or those weighted by volume", "\"activation\""),
    key("joint_weights", Word(&["table", "none"]), Is("\"table\""), "", "What joint forces cost: the published weights, or nothing", "\"none\""),
    key("unbounded", Flag, Is("false"), "", "No upper bounds on muscle forces", "true"),
    key("reserves", Number(f64::MIN_POSITIVE, f64::MAX), Optional("no reserve moments"), "1/(N·m)²", "Weight of squared reserve moments on every joint coordinate", "0.01"),
    key("raise_bounds", Number(1.0, f64::MAX), Optional("strengths stay"), "", "Where a frame is infeasible, raise all strengths by up to this factor", "1.5"),
    key("curves", Word(&["thelen", "degroote"]), Is("\"thelen\""), "", "Muscle curves for activations", "\"degroote\""),
    key("tendon", Word(&["elastic", "rigid"]), Is("\"elastic\""), "", "Tendons for activations", "\"rigid\""),
    key("ankle", Word(&["universal", "parallel"]), Optional("that of the trial"), "", "Joint between shank and foot", "\"parallel\""),
    key("hip_centre", Word(&["table", "regression", "harrington"]), Optional("that of the trial"), "", "Rule for the hip centre", "\"harrington\""),
];

/// Sets an option by name; an error says what it takes.
pub fn set_option(options: &mut OptimizeOptions, name: &str, value: &Value) -> Result<(), String> {
    let Some(known) = OPTIONS.iter().find(|k| k.path == name) else {
        let meant = multibody::error::nearest(name, OPTIONS.iter().map(|k| k.path));
        let meant = meant.map_or(String::new(), |m| format!("did you mean `{m}`? "));
        let all: Vec<&str> = OPTIONS.iter().map(|k| k.path).collect();
        return Err(format!("{meant}options of optimize are {}", all.join(", ")));
    };
    let takes = || format!("give {} ({})", known.kind.words(known.unit), known.meaning);
    let word = value.as_str().unwrap_or("");
    let number = value.as_float().or(value.as_integer().map(|n| n as f64));
    let sharing = &mut options.sharing;
    match (name, word) {
        ("cost", "force") => sharing.muscle_cost = MuscleCost::Force,
        ("cost", "activation") => sharing.muscle_cost = MuscleCost::Activation,
        ("cost", "volume") => sharing.muscle_cost = MuscleCost::Volume,
        ("joint_weights", "table") => sharing.reaction_cost = ReactionCost::Table,
        ("joint_weights", "none") => sharing.reaction_cost = ReactionCost::None,
        ("unbounded", _) => sharing.bounded = !value.as_bool().ok_or_else(takes)?,
        ("reserves" | "raise_bounds", _) => {
            let Number(least, _) = known.kind else { unreachable!("a number in the table") };
            let number = number.filter(|v| v.is_finite() && *v >= least).ok_or_else(takes)?;
            match name {
                "reserves" => sharing.reserves = Some(number),
                _ => sharing.options.raise_bounds = Some(number),
            }
        }
        ("curves", "thelen") => options.hill.curves = Curves::default(),
        ("curves", "degroote") => options.hill.curves = Curves::DeGroote(DeGroote2016::OPENSIM),
        ("tendon", "elastic") => options.hill.tendon = Tendon::Elastic,
        ("tendon", "rigid") => options.hill.tendon = Tendon::Rigid,
        ("ankle", "universal") => options.ankle = Some(Ankle::Universal),
        ("ankle", "parallel") => options.ankle = Some(Ankle::Parallel),
        ("hip_centre", "table") => options.hip_centre = Some(HipRule::Table),
        ("hip_centre", "regression") => options.hip_centre = Some(HipRule::Regression),
        ("hip_centre", "harrington") => options.hip_centre = Some(HipRule::Harrington),
        _ => return Err(takes()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_reach_sections_and_named_elements() {
        let base = Scene::walker();
        let keys = [
            ("resolution_mm", Value::from(20.0)),
            ("effects.contact", Value::from("none")),
            ("materials.muscle.sartorius.matrix_a_kpa", Value::from(4.0)),
            ("step.heel_strike.knee_flexion_deg", Value::from(15.0)),
        ];
        let keys = keys.map(|(k, v)| (k.to_string(), v)).into();
        let scene = scene_with(&base, &keys, None).unwrap();
        assert_eq!(scene.resolution, 0.02);
        assert!(scene.contact.is_none());
        assert_eq!(scene.steps.len(), 2);
        assert_eq!(scene.steps[0].knee_flexion, Some(15f64.to_radians()));
        assert_eq!(scene.steps[1].knee_flexion, None);
        let text = &scene.text;
        assert!(text.contains("name = \"sartorius\"") && text.contains("matrix_a_kpa = 4.0"), "{text}");
    }

    #[test]
    fn every_option_is_set_and_what_it_does_not_take_is_refused() {
        for option in OPTIONS {
            let mut options = OptimizeOptions::default();
            let example: Table = toml::from_str(&format!("v = {}", option.example)).unwrap();
            set_option(&mut options, option.path, &example["v"]).unwrap();
            assert_ne!(
                format!("{options:?}"),
                format!("{:?}", OptimizeOptions::default()),
                "{}",
                option.path
            );
            let refused = set_option(&mut options, option.path, &Value::Array(Vec::new())).unwrap_err();
            assert!(refused.contains(option.meaning), "{refused}");
        }
        let said = set_option(&mut OptimizeOptions::default(), "tendons", &Value::from(1)).unwrap_err();
        assert!(said.contains("did you mean `tendon`"), "{said}");
    }
}
