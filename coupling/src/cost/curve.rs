//! Accuracy against seconds: which settings nothing cheaper is as accurate as, and the cheapest for a wanted accuracy.
//!
//! A curve is kept as a file (TOML, `curve.toml` of `cost`), so that `compare --accuracy` can choose by it, also on a scene that it has not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use multibody::InputError;
use multibody::error::Place;
use multibody::shipped::{self, Kind};
use serde::{Deserialize, Serialize};
use toml::Value;

use super::ladder::{Axis, Ladder};
use super::rung::{Deviation, Ending};

/// Key of a scene that says whether bodies take notice of each other.
const CONTACT: &str = "effects.contact";

/// Factor between an error that was measured on one scene and what is promised of any: as large as the factor of safety of Roache (1994, "Perspective:
/// a method for uniform reporting of grid refinement studies", J. Fluids Eng. 116, 405) for a single pair of meshes, where nothing shows how an error
/// goes on. A scene is known by its name alone, so that the one which the curve was measured on gets the same margin.
pub const MARGIN: f64 = 3.0;

/// A setting with what it costs and how far it is from the finest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Name of its rung.
    pub setting: String,
    /// Wall time without calibration \[s\].
    pub seconds: f64,
    /// Largest error of a section force above 20 N against the finest setting \[%\].
    pub error_percent: f64,
    /// The largest error of all settings that are nowhere coarser, its own among them \[%\]: where a finer one is farther off, this one was near by
    /// chance. Absent: its own error.
    #[serde(default)]
    pub bound_percent: Option<f64>,
    /// Keys of the scene that make it, dotted.
    #[serde(default)]
    pub keys: BTreeMap<String, Value>,
    /// What a coarser run shows.
    #[serde(default)]
    pub coarser: Option<Coarser>,
}

impl Point {
    /// Whether it is the one that all others are measured against.
    pub fn is_reference(&self) -> bool {
        self.error_percent == 0.0
    }

    /// How far it and all that are nowhere coarser were off at most \[%\].
    pub fn bound(&self) -> f64 {
        self.bound_percent.unwrap_or(self.error_percent)
    }

    /// What it promises of any scene \[%\]: [`MARGIN`] times its [bound](Point::bound).
    pub fn promise(&self) -> f64 {
        MARGIN * self.bound()
    }
}

/// The setting with the next coarser mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coarser {
    /// Name of its rung.
    pub setting: String,
    /// Largest difference of a section force above 20 N between the two \[%\].
    pub difference_percent: f64,
    /// Keys of the scene that make it, dotted.
    #[serde(default)]
    pub keys: BTreeMap<String, Value>,
}

/// A curve as it is kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Scene that it was measured on.
    pub scene: String,
    /// The finest setting, which errors are measured against.
    pub reference: String,
    /// [Seconds of an iteration](crate::comparison::speed::iteration_seconds) on the machine that measured it.
    #[serde(default)]
    pub iteration_s: Option<f64>,
    /// Settings with contact, the cheapest first.
    #[serde(default)]
    pub contact: Vec<Point>,
    /// The same without contact.
    #[serde(default)]
    pub no_contact: Vec<Point>,
}

impl Curve {
    /// Reads a curve; a word alone is that of the shipped ladder of this name.
    pub fn read(file: &Path) -> Result<Curve, InputError> {
        let file = shipped::find(file, Kind::Curve)?;
        let text = match shipped::text(&file) {
            Some(text) => text.to_string(),
            None => std::fs::read_to_string(&file)
                .map_err(|source| InputError::Io { file: file.clone(), source })?,
        };
        toml::from_str(&text).map_err(|e: toml::de::Error| InputError::Malformed {
            at: e.span().map_or(Place::Whole, |s| Place::Line(multibody::keys::line_of(&text, s.start))),
            file,
            problem: e.message().to_string(),
            remedy: "give the `curve.toml` that `sartorius cost` wrote".into(),
        })
    }
}

impl Curve {
    /// Of a ladder and what came of its rungs: settings that change how exactly the scene is computed, not what is in it. `reference`: the rung that those
    /// with contact are measured against; those without are against their finest mesh.
    pub fn of(ladder: &Ladder, endings: &[Option<Ending>], reference: usize) -> Curve {
        let mut curve = Curve { scene: ladder.scene.clone(), ..Curve::default() };
        let alone = |axis: &Axis| {
            axis.with.len() == 1 && axis.with.get(CONTACT).and_then(Value::as_str) == Some("none")
        };
        let mesh = |of: &dyn Fn(&Axis) -> bool| ladder.axes.iter().find(|axis| axis.is_mesh() && of(axis));
        if let Some(axis) = mesh(&|axis| axis.with.is_empty()) {
            curve.reference = ladder.rungs[reference].name.clone();
            curve.contact = points(ladder, endings, axis, reference);
        }
        if let Some(axis) = mesh(&alone) {
            curve.no_contact = points(ladder, endings, axis, axis.finest());
        }
        curve
    }
}

/// Settings beside the rungs of an axis of meshes, against a reference.
fn points(ladder: &Ladder, endings: &[Option<Ending>], mesh: &Axis, reference: usize) -> Vec<Point> {
    let solved = |rung: usize| endings.get(rung).and_then(|e| e.as_ref()).and_then(Ending::solved);
    let difference =
        |a: usize, b: usize| Deviation::of(solved(a)?.1, solved(b)?.1).map(|d| 100.0 * d.largest);
    let exact = |axis: &&Axis| axis.owner.is_numerical() && axis.with == mesh.with;
    let exact: Vec<&Axis> = ladder.axes.iter().filter(exact).collect();
    let numerical: BTreeSet<&str> = exact.iter().map(|axis| axis.key.as_str()).collect();
    let belongs = |rung: &&usize| {
        let differs = &ladder.rungs[**rung].differs;
        mesh.with.iter().all(|(key, value)| differs.get(key) == Some(value))
            && differs.keys().all(|key| mesh.with.contains_key(key) || numerical.contains(key.as_str()))
    };
    // All of them, those of the base too: another scene has values of its own there.
    let keys = |rung: usize| -> BTreeMap<String, Value> {
        let of = |key: &str| Some((key.to_string(), ladder.rungs[rung].scene.value(key)?));
        numerical.iter().copied().chain(mesh.with.keys().map(String::as_str)).filter_map(of).collect()
    };
    let size = |rung: usize| ladder.rungs[rung].scene.resolution;
    let mut points: Vec<Point> = (0..ladder.rungs.len())
        .collect::<Vec<_>>()
        .iter()
        .filter(belongs)
        .filter_map(|&rung| {
            let coarser = mesh.rungs.iter().filter(|&&r| size(r) > size(rung) && solved(r).is_some());
            let coarser = coarser.min_by(|a, b| size(**a).total_cmp(&size(**b)));
            Some(Point {
                setting: ladder.rungs[rung].name.clone(),
                seconds: solved(rung)?.0.seconds,
                error_percent: difference(rung, reference)?,
                bound_percent: None,
                keys: keys(rung),
                coarser: coarser.and_then(|&r| {
                    Some(Coarser {
                        setting: ladder.rungs[r].name.clone(),
                        difference_percent: difference(r, rung)?,
                        keys: keys(r),
                    })
                }),
            })
        })
        .collect();
    points.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    // Where a value stands on its axis, from coarse to fine.
    let place = |axis: &Axis, value: Option<&Value>| {
        axis.rungs.iter().position(|&rung| ladder.rungs[rung].scene.value(&axis.key).as_ref() == value)
    };
    let fineness: Vec<Vec<Option<usize>>> = points
        .iter()
        .map(|p| exact.iter().map(|axis| place(axis, p.keys.get(&axis.key))).collect())
        .collect();
    let bounds: Vec<f64> = fineness
        .iter()
        .map(|own| {
            let errors = points.iter().zip(&fineness).filter(|(_, f)| is_nowhere_coarser(f, own));
            errors.fold(0.0, |most, (p, _)| p.error_percent.max(most))
        })
        .collect();
    points.iter_mut().zip(bounds).for_each(|(point, bound)| point.bound_percent = Some(bound));
    points
}

/// Whether a setting is at least as fine as another along every axis, by the places of their values there. `None`: not on it, which the value of the base
/// alone can be, so that two of these are the same.
fn is_nowhere_coarser(a: &[Option<usize>], b: &[Option<usize>]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.is_some() == b.is_some() && a >= b)
}

/// Places of the points that no other is both faster and at least as accurate as, from fast to accurate. Points: seconds and error.
pub fn pareto(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let ([t, e], [s, d]) = (points[a], points[b]);
        t.total_cmp(&s).then(e.total_cmp(&d)).then(a.cmp(&b))
    });
    let mut best = f64::INFINITY;
    order.retain(|&k| {
        let better = points[k][1] < best;
        best = best.min(points[k][1]);
        better
    });
    order
}

/// The cheapest point that promises enough \[%\].
pub fn cheapest(points: &[Point], wanted: f64) -> Option<&Point> {
    let enough = points.iter().filter(|p| p.promise() <= wanted);
    enough.min_by(|a, b| a.seconds.total_cmp(&b.seconds).then(a.setting.cmp(&b.setting)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slower_and_no_better_is_not_on_the_front() {
        let points = [[1.0, 0.5], [2.0, 0.6], [3.0, 0.1], [3.0, 0.2], [9.0, 0.0]];
        assert_eq!(pareto(&points), [0, 2, 4]);
    }

    #[test]
    fn only_what_is_finer_along_every_axis_speaks_against_a_setting() {
        let [coarse, middle, fine] = [Some(0), Some(1), Some(2)];
        assert!(is_nowhere_coarser(&[fine, middle], &[middle, middle]));
        assert!(is_nowhere_coarser(&[middle, middle], &[middle, middle]));
        assert!(!is_nowhere_coarser(&[fine, coarse], &[middle, middle]));
        assert!(!is_nowhere_coarser(&[None, fine], &[coarse, coarse]));
        assert!(is_nowhere_coarser(&[None, fine], &[None, coarse]));
    }

    #[test]
    fn what_is_promised_decides_and_not_what_came_out() {
        let point = |setting: &str, seconds, error_percent, bound_percent| Point {
            setting: setting.into(),
            seconds,
            error_percent,
            bound_percent,
            keys: BTreeMap::new(),
            coarser: None,
        };
        let points = [point("lucky", 1.0, 3.0, Some(7.0)), point("fine", 9.0, 2.0, Some(2.0))];
        assert_eq!(cheapest(&points, 3.0 * 5.0).unwrap().setting, "fine");
        assert_eq!(cheapest(&points, 3.0 * 7.0).unwrap().setting, "lucky");
    }

    #[test]
    fn the_shipped_curve_promises_no_more_than_its_finer_settings_keep() {
        let curve = Curve::read(Path::new("walker")).unwrap();
        let point = |setting: &str| curve.contact.iter().find(|p| p.setting == setting).unwrap();
        assert_eq!(point("mesh_16").bound(), point("mesh_8").error_percent);
        assert!(curve.contact.iter().chain(&curve.no_contact).all(|p| p.bound() >= p.error_percent));
        let taken = [5.0, 2.0].map(|wanted| cheapest(&curve.contact, wanted).unwrap().setting.clone());
        assert_eq!(taken, ["mesh_6", "finest"]);
    }

    #[test]
    fn the_cheapest_that_is_good_enough_is_chosen() {
        let point = |setting: &str, seconds, error_percent| Point {
            setting: setting.into(),
            seconds,
            error_percent,
            bound_percent: None,
            keys: BTreeMap::new(),
            coarser: None,
        };
        let points =
            [point("a", 1.0, 50.0), point("c", 3.0, 10.0), point("d", 3.5, 9.0), point("e", 9.0, 0.0)];
        assert_eq!(cheapest(&points, 3.0 * 30.0).unwrap().setting, "c");
        assert_eq!(cheapest(&points, -1.0), None);
    }
}
