//! `compare --accuracy`: the cheapest setting that a curve promises, and one coarser run that checks the promise on this scene.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};

use super::rung::step;
use crate::error::CommandError;
use crate::output::OutputError;
use coupling::comparison::Comparison;
use coupling::comparison::speed::iteration_seconds;
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::cost::curve::{Curve, MARGIN, Point, cheapest};
use coupling::cost::ladder::changed;
use coupling::cost::rung::{Deviation, numbers_of, read_numbers};
use coupling::number::significant;
use coupling::scene::Scene;

/// An accuracy that was asked for, and the setting that is to reach it.
pub struct Accuracy {
    /// Largest error that section forces above 20 N may have against the finest setting \[%\].
    wanted: f64,
    configuration: Configuration,
    /// Settings to choose from.
    points: Vec<Point>,
    /// Scene that they were measured on.
    measured_on: String,
    /// How many times as long this machine takes as the one that measured the curve, where that is known.
    slower: Option<f64>,
    /// The one chosen.
    chosen: Point,
    /// What a coarser run makes of the error of the chosen one \[%\].
    estimated: Cell<Option<f64>>,
}

impl Accuracy {
    /// Chooses from a curve; refused where no point reaches what is wanted.
    pub fn choose(
        wanted: f64,
        curve: &Path,
        asked: PerConfiguration<bool>,
    ) -> Result<Accuracy, CommandError> {
        if !(wanted > 0.0 && wanted <= 100.0) {
            return Err(CommandError::Option(format!(
                "--accuracy is {wanted}; give percent, above 0 and at most 100"
            )));
        }
        let Curve { scene, contact, no_contact, iteration_s, .. } = Curve::read(curve)?;
        let (configuration, points) = match asked.with {
            true => (Configuration::WithContact, contact),
            false => (Configuration::WithoutContact, no_contact),
        };
        let Some(chosen) = cheapest(&points, wanted).cloned() else {
            let best = points.iter().min_by(|a, b| a.promise().total_cmp(&b.promise()));
            let best = best.map_or("it has no setting for this".into(), |p| {
                format!("the best is {}, {} %", p.setting, significant(p.promise(), 2))
            });
            return Err(CommandError::Option(format!(
                "--accuracy {wanted}: no setting of the curve {} reaches it; {best}",
                curve.display()
            )));
        };
        let slower = iteration_s.map(|there| iteration_seconds() / there);
        let (measured_on, estimated) = (scene, Cell::new(None));
        Ok(Accuracy { wanted, configuration, points, measured_on, slower, chosen, estimated })
    }

    /// The scene with the setting that was chosen.
    pub fn scene(&self, scene: &Scene, data: Option<&Path>) -> Result<Scene, CommandError> {
        Ok(changed(scene, &self.of_configuration(&self.chosen), &scene.name, data)?)
    }

    /// Contact itself stays as the scene has it: both configurations are computed with one setting.
    fn of_configuration(&self, point: &Point) -> std::collections::BTreeMap<String, toml::Value> {
        let mut keys = point.keys.clone();
        keys.remove("effects.contact");
        keys
    }

    /// What was chosen, in words.
    pub fn said(&self) -> String {
        if self.chosen.is_reference() {
            return format!(
                "accuracy: {} % wanted; only {} will do, the finest setting measured on {}: how far that is off the curve cannot tell",
                self.wanted, self.chosen.setting, self.measured_on
            );
        }
        format!(
            "accuracy: {} % wanted; {} promises {} %, {MARGIN} times what it and all finer ones were off by on {}, in {} s there{}",
            self.wanted,
            self.chosen.setting,
            significant(self.chosen.promise(), 2),
            self.measured_on,
            significant(self.chosen.seconds, 2),
            self.slower.map_or(String::new(), |slower| {
                format!(", some {} s on this machine", significant(slower * self.chosen.seconds, 2))
            })
        )
    }

    /// Runs the coarser setting and compares: what was found in words, and why the promise is not kept where it is not. `folder`: of the results;
    /// the coarser run has one beside it while it goes on.
    pub fn check(
        &self,
        scene: &Scene,
        comparison: &Comparison,
        folder: &Path,
        data: Option<&Path>,
    ) -> Result<(String, Option<String>), CommandError> {
        let Some(coarser) = &self.chosen.coarser else {
            return Ok((format!("{}; nothing coarser to check it with", self.said()), None));
        };
        let own = numbers_of(&comparison.quantities(), self.configuration);
        let mut keys = coarser.keys.clone();
        if self.configuration == Configuration::WithoutContact {
            keys.insert("effects.contact".into(), "none".into());
        }
        let coarse = changed(scene, &keys, &scene.name, data)?;
        let numbers = self.numbers(&coarse, folder, data)?;
        let Some(found) = Deviation::of(&numbers, &own).map(|d| 100.0 * d.largest) else {
            return Ok((format!("{}; no force above 20 N to check it with", self.said()), None));
        };
        if self.chosen.is_reference() {
            let note = format!(
                "{}; {} differs from it by {} % here and by {} % there",
                self.said(),
                coarser.setting,
                significant(found, 2),
                significant(coarser.difference_percent, 2)
            );
            return Ok((note, None));
        }
        let estimated = match coarser.difference_percent > 0.0 {
            true => found * self.chosen.bound() / coarser.difference_percent,
            false => found,
        };
        self.estimated.set(Some(estimated));
        let note = format!(
            "{}; checked with {}: it differs by {} % here and by {} % there, so the error is about {} %",
            self.said(),
            coarser.setting,
            significant(found, 2),
            significant(coarser.difference_percent, 2),
            significant(estimated, 2)
        );
        let missed = (estimated > self.wanted).then(|| {
            format!("accuracy: {} % wanted, about {} % reached", self.wanted, significant(estimated, 2))
        });
        Ok((note, missed))
    }

    /// The cheapest setting that this scene needs by what its check found, where the one chosen does not do.
    pub fn finer(&mut self) -> bool {
        let Some(estimated) = self.estimated.take().filter(|e| *e > self.wanted) else { return false };
        // As much worse here as the chosen one is: an estimate of this scene itself, in which the margin of both promises cancels.
        let worse = estimated / self.chosen.promise().max(f64::MIN_POSITIVE);
        let Some(next) = cheapest(&self.points, self.wanted / worse).cloned() else { return false };
        if next.promise() >= self.chosen.promise() {
            return false;
        }
        self.chosen = next;
        true
    }

    /// The numbers of a scene, computed by a process of its own.
    fn numbers(
        &self,
        scene: &Scene,
        folder: &Path,
        data: Option<&Path>,
    ) -> Result<coupling::cost::rung::Numbers, CommandError> {
        let beside = Beside::new(folder)?;
        let file = beside.0.join(format!("{}.toml", scene.name));
        fs::write(&file, &scene.text).map_err(|e| OutputError::at("write", &file, e))?;
        let out = beside.0.with_file_name(format!("{}-run", name_of(&beside.0)));
        let out = Beside(out);
        let output = step(&file, &out.0, data, false)
            .map_err(|e| CommandError::Option(format!("cannot start the coarser run: {e}")))?;
        read_numbers(&out.0.join("quantities.csv")).map_err(|e| {
            let said = String::from_utf8_lossy(&output.stderr);
            CommandError::Option(format!(
                "the coarser run that checks the accuracy has no numbers: {} {e}",
                said.trim()
            ))
        })
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or("out".into(), |n| n.to_string_lossy().into_owned())
}

/// A hidden folder beside that of the results, so that both share their calibrations; gone when this is.
struct Beside(PathBuf);

impl Beside {
    fn new(folder: &Path) -> Result<Beside, CommandError> {
        let path = folder.with_file_name(format!(".{}-coarser", name_of(folder)));
        let _ = fs::remove_dir_all(&path); // left by a run that was killed
        let _ = fs::remove_dir_all(path.with_file_name(format!("{}-run", name_of(&path))));
        fs::create_dir_all(&path).map_err(|e| OutputError::at("create the folder", &path, e))?;
        Ok(Beside(path))
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
