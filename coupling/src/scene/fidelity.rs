//! How much of a muscle is simulated: its mesh, its mesh in a coarse grid, or its lines of action alone.
//!
//! ```toml
//! [[fidelity]]
//! muscle = "vastus_medialis"
//! level = "embedded"      # full where nothing is said, embedded, line
//! cell_mm = 30.0          # edge of a cube of the grid
//! ```

use std::collections::BTreeSet;

use fem::geometry::Surface;
use fem::mesh::MeshError;
use fem::scene::EmbeddedSpec;
use mesher::MusclePart;
use serde::Deserialize;
use toml::Spanned;

use super::known_muscle;
use crate::error::CouplingError;
use crate::number::short;
use crate::source::Source;
use crate::thigh::build::Thigh;
use crate::thigh::lines::lines_of_muscles;

/// Words of [`Level`], in the order of what they cost.
pub(super) const LEVELS: [&str; 3] = ["full", "embedded", "line"];
/// Edges of cubes \[mm\]: twice the finest mesh to the length of the longest muscle.
pub(super) const CELLS: std::ops::RangeInclusive<f64> = 6.0..=500.0;

/// Edges of the mesh to a cube at least.
const LEAST_EDGES: f64 = 2.0;

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
    /// Where that is said: file and line.
    pub said: String,
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
    /// Checks every entry. `muscles`: whether there are any, and which, empty for all; those that are lines are taken out. `edge`: that of the
    /// mesh \[m\]. `wrong` is told byte, key, value and remedy of every mistake.
    pub(super) fn check(
        entries: &[FidelityEntry],
        (deformable, muscles): &mut (bool, Vec<String>),
        edge: f64,
        at: &Source,
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
                (Level::Embedded, Some(cell)) if *cell.get_ref() < LEAST_EDGES * edge * 1e3 => wrong(
                    cell.span().start,
                    "cell_mm",
                    cell.get_ref().to_string(),
                    format!(
                        "cubes that hold less than eight cells save nothing: take at least {} mm, twice the edges of the mesh",
                        short(LEAST_EDGES * edge * 1e3)
                    ),
                ),
                (Level::Embedded, Some(cell)) => {
                    let said = format!("{}, line {}", at.file.display(), at.line(cell.span().start));
                    let cell = cell.get_ref() * 1e-3;
                    found.embedded.push(EmbeddedMuscle { muscle: name.clone(), cell, said });
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

    /// Puts the muscles of a thigh that are to be embedded into their grids; all whose cubes are larger than they are wide are refused. A grid
    /// of one cube across has nothing left that bends.
    pub fn apply(&self, thigh: &mut Thigh) -> Result<(), CouplingError> {
        let is_there = |m: &&EmbeddedMuscle| thigh.muscles.iter().any(|of| of.name == m.muscle);
        let embedded: Vec<&EmbeddedMuscle> = self.embedded.iter().filter(is_there).collect();
        let mut wrong = Vec::new();
        for m in &embedded {
            let width = width(thigh, &m.muscle)?;
            if m.cell > width {
                let [cell, most] = [m.cell, width].map(|l| short((1e4 * l).floor() / 10.0));
                wrong.push(format!(
                    "{}: cell_mm is {cell}, and the box around {} is {most} mm wide; take less",
                    m.said, m.muscle
                ));
            }
        }
        if !wrong.is_empty() {
            return Err(CouplingError::Option(wrong.join("\n")));
        }
        thigh.scene.embedded = embedded.iter().map(|m| EmbeddedSpec::new(&m.muscle, m.cell)).collect();
        Ok(())
    }

    /// Muscles in grids with their cubes, in words; `None` where there are none.
    pub(super) fn in_words(&self) -> Option<String> {
        let one = |m: &EmbeddedMuscle| format!("{} {} mm", m.muscle.replace('_', " "), short(m.cell * 1e3));
        let all: Vec<String> = self.embedded.iter().map(one).collect();
        (!all.is_empty()).then(|| all.join(", "))
    }
}

/// Width \[m\] of a muscle: the middle one of the sides of the box around it.
fn width(thigh: &Thigh, muscle: &str) -> Result<f64, MeshError> {
    let (low, high) = Surface::of_mesh(&thigh.mesh, &MusclePart::Surface.of(muscle))?.0.bounds();
    let mut sides: [f64; 3] = (high - low).into();
    sides.sort_by(f64::total_cmp);
    Ok(sides[1])
}
