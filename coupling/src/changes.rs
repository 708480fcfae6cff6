//! What a run takes in place of what its files say: keys of trial and scene, places of landmarks, strengths. A study varies these.

use std::collections::BTreeMap;
use std::path::Path;

use multibody::InputError;
use multibody::calibration::shifts::Shifts;
use multibody::model::Model;
use toml::{Table, Value};

use crate::cost::ladder;
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

/// A number of TOML, whole or not.
pub fn number(value: &Value) -> Option<f64> {
    value.as_float().or(value.as_integer().map(|n| n as f64))
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
}
