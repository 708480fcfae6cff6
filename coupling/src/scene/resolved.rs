//! A scene as it was carried out, for `run.json`: every key with its value, what the command line put in its place included.

use crate::configuration::PerConfiguration;
use fem::scene::ContactMode;
use toml::{Table, Value};

use super::Scene;

impl Scene {
    /// The value of a dotted key in the text of the scene; `None` where it says nothing.
    pub fn value(&self, key: &str) -> Option<Value> {
        let table: Table = toml::from_str(&self.text).expect("it was read");
        let mut parts = key.split('.');
        let first = table.get(parts.next()?)?.clone();
        parts.try_fold(first, |at, part| at.get(part).cloned())
    }

    /// The scene as TOML; read back, it is carried out to the same bytes. `trial`: path of its trial file from there, none for the
    /// built-in walker.
    pub fn resolved(&self, trial: Option<&str>) -> String {
        let mut keys: Table = toml::from_str(&self.text).expect("it was read");
        let muscles = match (self.deformable, self.muscles.is_empty()) {
            (false, _) => "none".into(),
            (true, true) => "all".into(),
            (true, false) => Value::from(self.muscles.clone()),
        };
        keys.insert("trial".into(), trial.unwrap_or("walker").into());
        keys.insert("muscles".into(), muscles);
        // Materials of muscles that the command line took out would be refused.
        let materials = keys.get_mut("materials").and_then(|m| m.get_mut("muscle"));
        if let (Some(Value::Array(of)), false) = (materials, self.muscles.is_empty()) {
            let simulated = |m: &Value| self.muscles.iter().any(|name| m["name"].as_str() == Some(name));
            of.retain(simulated);
        }
        // What the command line took out is in no grid, and what it put in is no line.
        if let (Some(Value::Array(levels)), false) = (keys.get_mut("fidelity"), self.muscles.is_empty()) {
            let simulated = |m: &Value| self.muscles.iter().any(|name| m["muscle"].as_str() == Some(name));
            levels.retain(|m| simulated(m) != (m["level"].as_str() == Some("line")));
        }
        keys.insert("resolution_mm".into(), in_millimetres(self.resolution).into());
        keys.entry("inset_mm").or_insert(in_millimetres(self.inset).into());
        keys.insert("stress_free".into(), Value::try_from(self.stress_free).expect("a word"));
        let PerConfiguration { without, with } = self.residuals;
        let accuracy = section(&mut keys, "accuracy");
        accuracy.entry("residual_n").or_insert(without.into());
        accuracy.entry("contact_residual_n").or_insert(with.into());
        let solver = section(&mut keys, "solver");
        solver.insert("method".into(), Value::try_from(self.method).expect("a word"));
        solver.entry("max_steps").or_insert((self.max_steps as i64).into());
        let effects = section(&mut keys, "effects");
        effects.insert("fibres".into(), Value::try_from(self.fibres).expect("a word"));
        effects.entry("fibre_spacing").or_insert((self.fibre_spacing as i64).into());
        effects.entry("contact_distance_mm").or_insert(in_millimetres(self.contact_distance).into());
        effects.entry("shells").or_insert(self.shells.into());
        let contact = match self.contact {
            Some(ContactMode::Guarded) => "guarded",
            Some(ContactMode::Cheap) => "cheap",
            None => "none",
        };
        effects.entry("contact").or_insert(contact.into());
        let steps = self
            .steps
            .iter()
            .map(|s| Value::from(Table::from_iter([("name".into(), Value::from(s.name.name()))])));
        keys.entry("step").or_insert(Value::Array(steps.collect()));
        toml::to_string(&keys).expect("keys and values of TOML")
    }
}

/// A section of the file, made where it is absent.
fn section<'a>(keys: &'a mut Table, name: &str) -> &'a mut Table {
    let section = keys.entry(name).or_insert(Value::Table(Table::new()));
    section.as_table_mut().expect("it was read as a section")
}

/// The number of millimetres that reads back as these metres, to the last bit.
fn in_millimetres(metres: f64) -> f64 {
    let near = 1e3 * metres;
    // As a person wrote it: 18 and not 18.000000000000004.
    let written: f64 = format!("{near:.14e}").parse().expect("a printed number");
    let candidates = [written, near, near.next_up(), near.next_down()];
    candidates.into_iter().find(|mm| mm * 1e-3 == metres).unwrap_or(near)
}
