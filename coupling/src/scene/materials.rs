//! Material constants of a scene: those of all muscles, and of single ones.
//!
//! ```toml
//! [materials]                             # of all muscles; what is absent is as below
//! matrix_a_kpa = 3.0                      # Mooney-Rivlin matrix: ψ = A (I₁ − 3) + B (I₂ − 3) + …
//! matrix_b_kpa = 0.75                     # 0: neo-Hookean
//! bulk_modulus_kpa = 747.5                # absent: 99.7 times the shear modulus 2 (A + B)
//! density_kg_m3 = 1060.0                  # counts with gravity or inertia alone
//! aponeurosis_thickness_mm = 0.5          # shells around the muscles
//! aponeurosis_shear_modulus_kpa = 7.5
//! tendon_modulus_mpa = 1200.0             # along its fibres; the solid quadriceps tendon: 370
//! tendon_section_mm2 = 30.0               # of a tendon of strands, per attachment
//!
//! [[materials.muscle]]                    # goes before that of all
//! name = "rectus_femoris"
//! aponeurosis_thickness_mm = 1.0
//! ```
//!
//! What is not given is not touched, so a scene without materials is the same to the last bit.

use mesher::part::{MusclePart, is_strands, muscle_of};
use std::ops::RangeInclusive;

use fem::scene::{LawSpec, MembraneLawSpec};
use serde::Deserialize;
use toml::Spanned;

use crate::number::short;
use crate::thigh::build::Thigh;
use crate::thigh::tendons::QUADRICEPS_TENDON;
use crate::thigh::tissue::{MATRIX, SHELL_SHEAR, SHELL_THICKNESS, TENDON_MODULUS, TENDON_SECTION};

/// Bulk over shear modulus: below, a muscle is no longer nearly incompressible; above, round-off eats the digits of the volume.
const BULK_OVER_SHEAR: RangeInclusive<f64> = 5.0..=5000.0;

/// A constant that a scene may give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    /// Key in the file, which ends in the unit.
    pub key: &'static str,
    /// Unit of the file, and what one of it is in SI.
    pub unit: (&'static str, f64),
    /// What is accepted, in the unit of the file.
    pub range: (f64, f64),
    /// What it is.
    pub words: &'static str,
}

impl Constant {
    /// A value of the file in SI, rounded once: 30 mm² are 30e-6 m² to the last bit.
    fn in_si(&self, value: f64) -> f64 {
        let one = self.unit.1;
        if one < 1.0 { value / (1.0 / one).round() } else { value * one }
    }
}

/// All constants, in the order of [`Constants`].
pub const CONSTANTS: [Constant; 8] = [
    Constant { key: "matrix_a_kpa", unit: ("kPa", 1e3), range: (0.01, 1e3), words: "matrix A" },
    Constant { key: "matrix_b_kpa", unit: ("kPa", 1e3), range: (0.0, 1e3), words: "matrix B" },
    Constant { key: "bulk_modulus_kpa", unit: ("kPa", 1e3), range: (1.0, 1e7), words: "bulk modulus" },
    Constant { key: "density_kg_m3", unit: ("kg/m³", 1.0), range: (500.0, 2000.0), words: "density" },
    Constant {
        key: "aponeurosis_thickness_mm",
        unit: ("mm", 1e-3),
        range: (0.01, 5.0),
        words: "thickness of the aponeurosis",
    },
    Constant {
        key: "aponeurosis_shear_modulus_kpa",
        unit: ("kPa", 1e3),
        range: (0.01, 1e6),
        words: "shear modulus of the aponeurosis",
    },
    Constant {
        key: "tendon_modulus_mpa",
        unit: ("MPa", 1e6),
        range: (1.0, 5000.0),
        words: "modulus of the tendon",
    },
    Constant {
        key: "tendon_section_mm2",
        unit: ("mm²", 1e-6),
        range: (1.0, 500.0),
        words: "section of the tendon",
    },
];

// Positions in [`CONSTANTS`].
pub(super) const A: usize = 0;
pub(super) const B: usize = 1;
pub(super) const BULK: usize = 2;
pub(super) const DENSITY: usize = 3;
pub(super) const THICKNESS: usize = 4;
pub(super) const SHELL: usize = 5;
pub(super) const TENDON: usize = 6;
pub(super) const SECTION: usize = 7;

/// Constants as given, in SI; `None`: as for all muscles, or the default.
pub type Constants = [Option<f64>; CONSTANTS.len()];

/// Materials of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Materials {
    /// Of all muscles.
    pub all: Constants,
    /// Of single muscles, by name.
    pub of: Vec<(String, Constants)>,
}

/// `[materials]` as written.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialsEntry {
    matrix_a_kpa: Option<Spanned<f64>>,
    matrix_b_kpa: Option<Spanned<f64>>,
    bulk_modulus_kpa: Option<Spanned<f64>>,
    density_kg_m3: Option<Spanned<f64>>,
    aponeurosis_thickness_mm: Option<Spanned<f64>>,
    aponeurosis_shear_modulus_kpa: Option<Spanned<f64>>,
    tendon_modulus_mpa: Option<Spanned<f64>>,
    tendon_section_mm2: Option<Spanned<f64>>,
    #[serde(default)]
    muscle: Vec<MuscleEntry>,
}

/// `[[materials.muscle]]` as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MuscleEntry {
    name: Spanned<String>,
    matrix_a_kpa: Option<Spanned<f64>>,
    matrix_b_kpa: Option<Spanned<f64>>,
    bulk_modulus_kpa: Option<Spanned<f64>>,
    density_kg_m3: Option<Spanned<f64>>,
    aponeurosis_thickness_mm: Option<Spanned<f64>>,
    aponeurosis_shear_modulus_kpa: Option<Spanned<f64>>,
    tendon_modulus_mpa: Option<Spanned<f64>>,
    tendon_section_mm2: Option<Spanned<f64>>,
}

/// The constants of an entry in the order of [`CONSTANTS`].
macro_rules! given {
    ($entry:expr) => {
        [
            &$entry.matrix_a_kpa,
            &$entry.matrix_b_kpa,
            &$entry.bulk_modulus_kpa,
            &$entry.density_kg_m3,
            &$entry.aponeurosis_thickness_mm,
            &$entry.aponeurosis_shear_modulus_kpa,
            &$entry.tendon_modulus_mpa,
            &$entry.tendon_section_mm2,
        ]
    };
}

/// A mistake: byte in the file, key, value, remedy.
pub(super) type Wrong<'a> = &'a mut dyn FnMut(usize, &str, String, String);

impl MaterialsEntry {
    /// Checks every value and name. `muscles`: those of the scene, empty for all; `shells`: whether it has aponeuroses.
    pub(super) fn check(&self, muscles: &[String], shells: bool, wrong: Wrong) -> Materials {
        let all = constants(given!(self), None, shells, wrong);
        let mut of: Vec<(String, Constants)> = Vec::new();
        for entry in &self.muscle {
            let (name, at) = (entry.name.get_ref(), entry.name.span().start);
            let again = of.iter().any(|m| m.0 == *name);
            let remedy = match super::known_muscle(name) {
                Err(remedy) => Some(remedy),
                Ok(()) if again => Some("give the constants of a muscle in one place".into()),
                Ok(()) if !muscles.is_empty() && !muscles.contains(name) => Some(
                    "the scene does not name this muscle in `muscles`: add it there, or take it out here"
                        .into(),
                ),
                Ok(()) => None,
            };
            let own = constants(given!(entry), Some(&all), shells, wrong);
            match remedy {
                Some(remedy) => wrong(at, "name", format!("`{name}`"), remedy),
                None => of.push((name.clone(), own)),
            }
        }
        Materials { all, of }
    }
}

/// Constants in SI; those that are out of range are told and left out. `all`: what holds where nothing is given.
fn constants(
    given: [&Option<Spanned<f64>>; CONSTANTS.len()],
    all: Option<&Constants>,
    shells: bool,
    wrong: Wrong,
) -> Constants {
    let mut found = [None; CONSTANTS.len()];
    for (k, (constant, given)) in CONSTANTS.iter().zip(given).enumerate() {
        let Some(value) = given else { continue };
        let (at, (low, high)) = (value.span().start, constant.range);
        if !(low..=high).contains(value.get_ref()) {
            continue; // noted with the table of keys
        }
        if matches!(k, THICKNESS | SHELL) && !shells {
            let remedy = "the scene has `shells = false`, so nothing has it: take it out, or have shells";
            wrong(at, constant.key, value.get_ref().to_string(), remedy.into());
        } else {
            found[k] = Some(constant.in_si(*value.get_ref()));
        }
    }
    let joined = joined(&found, all.unwrap_or(&[None; CONSTANTS.len()]));
    // A muscle that gives none of these has the ratio of all muscles, which is judged there.
    let first = [BULK, A, B].iter().find_map(|&k| given[k].as_ref());
    if let (Some(bulk), Some(first)) = (joined[BULK], first) {
        let ratio = bulk / shear(&joined);
        if !BULK_OVER_SHEAR.contains(&ratio) {
            let at = first.span().start;
            let (low, high) = (BULK_OVER_SHEAR.start(), BULK_OVER_SHEAR.end());
            let value = format!("{ratio:.3} times the shear modulus 2 (A + B)");
            wrong(at, CONSTANTS[BULK].key, value, format!("give {low} to {high} times the shear modulus"));
        }
    }
    found
}

/// Those of `own`, and of `all` where it has none.
fn joined(own: &Constants, all: &Constants) -> Constants {
    std::array::from_fn(|k| own[k].or(all[k]))
}

/// A, B and Poisson's ratio of the matrix where nothing is given.
fn natural_matrix() -> (f64, f64, f64) {
    let LawSpec::MooneyRivlinDyna { a, b, nu } = MATRIX else {
        unreachable!("the matrix of the publication")
    };
    (a, b, nu)
}

/// Shear modulus of the matrix at rest \[Pa\].
fn shear(given: &Constants) -> f64 {
    let (a, b, _) = natural_matrix();
    2.0 * (given[A].unwrap_or(a) + given[B].unwrap_or(b))
}

/// The law of the matrix.
fn matrix(given: &Constants) -> LawSpec {
    let (a, b, nu) = natural_matrix();
    let mu = shear(given);
    let nu = given[BULK].map_or(nu, |k| (3.0 * k - 2.0 * mu) / (6.0 * k + 2.0 * mu));
    LawSpec::MooneyRivlinDyna { a: given[A].unwrap_or(a), b: given[B].unwrap_or(b), nu }
}

impl Materials {
    /// Those of a muscle.
    pub fn of_muscle(&self, name: &str) -> Constants {
        match self.of.iter().find(|m| m.0 == name) {
            Some((_, own)) => joined(own, &self.all),
            None => self.all,
        }
    }

    /// Puts the constants into the parts of the thigh; what is not given stays as it is. The message names a muscle that has no such part.
    pub fn apply(&self, thigh: &mut Thigh) -> Result<(), String> {
        for muscle in &thigh.muscles {
            let name = &muscle.name;
            let given = self.of_muscle(name);
            let (solid_tendon, tendon_fibres) =
                (MusclePart::Tendon.of(name), MusclePart::TendonFibres.of(name));
            let scene = &mut thigh.scene;
            for solid in scene.solids.iter_mut().filter(|s| s.region == *name || s.region == solid_tendon) {
                if [A, B, BULK].iter().any(|k| given[*k].is_some()) {
                    solid.law = matrix(&given);
                }
                solid.density = given[DENSITY].unwrap_or(solid.density);
            }
            for shell in scene.membranes.iter_mut().filter(|m| m.region == MusclePart::Shell.of(name)) {
                shell.thickness = given[THICKNESS].unwrap_or(shell.thickness);
                if let Some(mu) = given[SHELL] {
                    shell.law = MembraneLawSpec::NeoHookean { mu };
                }
            }
            let (mut strands, mut solids) = (0, 0);
            for strand in &mut scene.strands {
                if strand.region == tendon_fibres {
                    solids += 1;
                    strand.stiffness *= given[TENDON].map_or(1.0, |e| e / QUADRICEPS_TENDON);
                } else if muscle_of(&strand.region) == name && is_strands(&strand.region) {
                    strands += 1;
                    let factor = |k: usize, natural: f64| given[k].map_or(1.0, |v| v / natural);
                    strand.stiffness *= factor(TENDON, TENDON_MODULUS) * factor(SECTION, TENDON_SECTION);
                }
            }
            let own = self.of.iter().find(|m| m.0 == *name).map_or([None; CONSTANTS.len()], |m| m.1);
            for (k, absent, why) in [
                (TENDON, strands + solids == 0, "both its ends grow from bone"),
                (SECTION, strands == 0, "it has no tendon of strands"),
            ] {
                if own[k].is_some() && absent {
                    let key = CONSTANTS[k].key;
                    return Err(format!("the scene gives `{key}` of {name}, but {why}: take it out"));
                }
            }
        }
        Ok(())
    }

    /// What holds for all muscles, and what single muscles have of their own, as label and value.
    pub fn settings(&self, shells: bool) -> Vec<(String, String)> {
        let (a, b, nu) = natural_matrix();
        let bulk = |given: &Constants| {
            let mu = shear(given);
            given[BULK].unwrap_or(2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu)))
        };
        let number = |k: usize, si: f64| short(si / CONSTANTS[k].unit.1);
        let of = |k: usize, natural: f64| number(k, self.all[k].unwrap_or(natural));
        let mut rows = vec![(
            "Matrix".to_string(),
            format!(
                "Mooney-Rivlin, A = {} kPa, B = {} kPa, bulk modulus {} kPa, {} kg/m³",
                of(A, a),
                of(B, b),
                number(BULK, bulk(&self.all)),
                of(DENSITY, 1060.0)
            ),
        )];
        if shells {
            rows.push((
                "Aponeuroses".into(),
                format!(
                    "shells of {} mm, shear modulus {} kPa",
                    of(THICKNESS, SHELL_THICKNESS),
                    of(SHELL, SHELL_SHEAR)
                ),
            ));
        }
        rows.push((
            "Tendons".into(),
            format!(
                "{} MPa on {} mm² per attachment; solid quadriceps tendon {} MPa",
                of(TENDON, TENDON_MODULUS),
                of(SECTION, TENDON_SECTION),
                of(TENDON, QUADRICEPS_TENDON)
            ),
        ));
        for (name, own) in &self.of {
            let given: Vec<String> = CONSTANTS
                .iter()
                .enumerate()
                .filter_map(|(k, c)| Some(format!("{} {} {}", c.words, number(k, own[k]?), c.unit.0)))
                .collect();
            let given = if given.is_empty() { "as all".into() } else { given.join(", ") };
            rows.push((format!("Of its own: {}", name.replace('_', " ")), given));
        }
        rows
    }
}
