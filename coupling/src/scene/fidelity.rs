//! How much of a muscle is simulated: its mesh, its mesh in a coarse grid, or its lines of action alone.
//!
//! ```toml
//! [[fidelity]]
//! muscle = "vastus_medialis"
//! level = "embedded"      # full where nothing is said, embedded, line
//! cell_mm = 30.0          # edge of a cube of the grid
//! ```

use std::collections::BTreeSet;

use fem::scene::EmbeddedSpec;
use serde::Deserialize;
use toml::Spanned;

use super::known_muscle;
use crate::number::short;
use crate::thigh::build::Thigh;
use crate::thigh::lines::lines_of_muscles;

/// Words of [`Level`], in the order of what they cost.
pub(super) const LEVELS: [&str; 3] = ["full", "embedded", "line"];
/// Edges of cubes \[mm\]: twice the finest mesh to the length of the longest muscle.
pub(super) const CELLS: std::ops::RangeInclusive<f64> = 6.0..=500.0;

/// `[[fidelity]]` as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FidelityEntry {
    muscle: Spanned<String>,
    level: Spanned<Level>,
    cell_mm: Option<Spanned<f64>>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Level {
    Full,
    Embedded,
    Line,
}

/// A muscle whose mesh moves with a grid of cubes.
#[derive(Clone, Debug, PartialEq)]
pub struct EmbeddedMuscle {
    /// Which.
    pub muscle: String,
    /// Edge of a cube \[m\].
    pub cell: f64,
}

/// What `[[fidelity]]` says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fidelity {
    /// Muscles in grids.
    pub embedded: Vec<EmbeddedMuscle>,
    /// Muscles that are lines of the rigid leg alone.
    pub lines: BTreeSet<String>,
}

impl Fidelity {
    /// Checks every entry. `muscles`: whether there are any, and which, empty for all; those that are lines are taken out. `wrong` is told byte,
    /// key, value and remedy of every mistake.
    pub(super) fn check(
        entries: &[FidelityEntry],
        (deformable, muscles): &mut (bool, Vec<String>),
        wrong: &mut dyn FnMut(usize, &str, String, String),
    ) -> Fidelity {
        let mut found = Fidelity::default();
        let mut seen = BTreeSet::new();
        for entry in entries {
            let (name, level) = (entry.muscle.get_ref(), *entry.level.get_ref());
            let is_simulated = *deformable && (muscles.is_empty() || muscles.contains(name));
            let remedy = match known_muscle(name) {
                Err(remedy) => Some(remedy),
                Ok(()) if !seen.insert(name.clone()) => {
                    Some("give the level of a muscle in one place".into())
                }
                Ok(()) if !is_simulated && level != Level::Line => Some(
                    "the scene does not name this muscle in `muscles`: add it there, or take it out here"
                        .into(),
                ),
                Ok(()) => None,
            };
            if let Some(remedy) = remedy {
                wrong(entry.muscle.span().start, "muscle", format!("`{name}`"), remedy);
                continue;
            }
            match (level, &entry.cell_mm) {
                (Level::Embedded, Some(cell)) => {
                    let cell = cell.get_ref() * 1e-3;
                    found.embedded.push(EmbeddedMuscle { muscle: name.clone(), cell });
                }
                (Level::Embedded, None) => wrong(
                    entry.level.span().start,
                    "level",
                    "`embedded` without cell_mm".into(),
                    "say how large the cubes are: at least twice the edges of the mesh".into(),
                ),
                (_, Some(cell)) => wrong(
                    cell.span().start,
                    "cell_mm",
                    cell.get_ref().to_string(),
                    "only embedded muscles have cubes: take it out, or set level = \"embedded\"".into(),
                ),
                (Level::Line, None) => {
                    found.lines.insert(name.clone());
                }
                (Level::Full, None) => {}
            }
        }
        if *deformable && !found.lines.is_empty() {
            if muscles.is_empty() {
                *muscles = lines_of_muscles().into_keys().collect();
            }
            muscles.retain(|name| !found.lines.contains(name));
            *deformable = !muscles.is_empty();
        }
        found
    }

    /// Puts the muscles of a thigh that are to be embedded into their grids.
    pub fn apply(&self, thigh: &mut Thigh) {
        let of = |name: &str| self.embedded.iter().find(|m| m.muscle == name);
        let specs = thigh.muscles.iter().filter_map(|m| of(&m.name));
        thigh.scene.embedded = specs.map(|m| EmbeddedSpec::new(&m.muscle, m.cell)).collect();
    }

    /// Muscles in grids with their cubes, in words; `None` where there are none.
    pub(super) fn in_words(&self) -> Option<String> {
        let one = |m: &EmbeddedMuscle| format!("{} {} mm", m.muscle.replace('_', " "), short(m.cell * 1e3));
        let all: Vec<String> = self.embedded.iter().map(one).collect();
        (!all.is_empty()).then(|| all.join(", "))
    }
}
