//! Every key of a scene, and telling a scene from a trial file.

use std::path::Path;

use multibody::InputError;
use multibody::error::Place;
use multibody::keys::Kind::{Count, Either, File, Flag, Number, Section, Sections, Text, Texts, Word};
use multibody::keys::Need::{Default, Optional, Required};
use multibody::keys::{Key, key, likeness, top_keys};
use multibody::trial_file;

use super::fidelity::{CELLS, LEVELS};
use super::materials::{A, B, BULK, CONSTANTS, DENSITY, SECTION, SHELL, TENDON, THICKNESS};
use super::{DISTANCES, FLEXIONS, INSETS, RESIDUALS, RESOLUTIONS, STEPS};

/// What a material constant may be.
const fn of(constant: usize) -> multibody::keys::Kind {
    let (low, high) = CONSTANTS[constant].range;
    Number(low, high)
}

/// One row per key of `SceneFile` and what is in it; a test compares them.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("trial", File, Default("\"walker\""), "", "The built-in walker, a trial file beside this one or in --data, or the name of a shipped trial", "\"DM_ngait_og3\""),
    key("controller", File, Optional("the static optimization"), "", "Co-simulation unit (FMI 2 or 3) whose scalar outputs, named as the muscles, are their isometric activations; Hill fibres; beside this file or in --data", "\"controller.fmu\""),
    key("muscles", Either(&[Word(&["all", "none"]), Texts]), Default("\"all\""), "", "Muscles of the thigh that are simulated; none: the rigid leg alone", "[\"gluteus_maximus\", \"sartorius\"]"),
    key("resolution_mm", Number(*RESOLUTIONS.start(), *RESOLUTIONS.end()), Default("12.0"), "mm", "Length of the edges of the mesh that is aimed at", "8.0"),
    key("inset_mm", Number(*INSETS.start(), *INSETS.end()), Default("0.0"), "mm", "Surfaces of the muscles are inset by up to this, so that gaps between them grow by up to twice as much", "2.0"),
    key("stress_free", Word(&["standing", "heel_strike"]), Default("\"standing\""), "", "Posture in which the mesh is free of stress; heel_strike is the reading of the publication", "\"heel_strike\""),
    key("surfaces", File, Optional("the built-in thigh"), "", "Folder of closed muscle surfaces in m, beside a folder `bones`; beside this file or in --data", "\"muscles_fit\""),

    key("accuracy", Section, Optional("the defaults of its keys"), "", "Forces out of balance at which a step counts as solved, norm over all nodes", ""),
    key("accuracy.residual_n", Number(*RESIDUALS.start(), *RESIDUALS.end()), Default("0.1"), "N", "Without contact", "0.01"),
    key("accuracy.contact_residual_n", Number(*RESIDUALS.start(), *RESIDUALS.end()), Default("10.0"), "N", "With contact; the last 10 N cost as much time as all before", "1.0"),
    key("accuracy.strict_steps", Count(1, 1000), Optional("softened contact says where to go, collision detection goes there"), "", "Guarded contact: every step goes in so many smaller ones by collision detection alone; many times slower, to see whether forces depend on the path", "20"),
    key("accuracy.check_stability", Flag, Default("false"), "", "Every state is shown to be a minimum of the energy, and left where it is none; `frames_tested_for_stability` in the summary counts them", "true"),
    key("accuracy.check_calibration", Flag, Default("false"), "", "Every muscle with Hill fibres is solved alone in four more states, to see how well it is calibrated; most of the time of a calibration", "true"),

    key("solver", Section, Optional("the defaults of its keys"), "", "How the steps are solved", ""),
    key("solver.method", Word(&["newton", "relaxation"]), Default("\"newton\""), "", "Newton's method with sparse factors, or dynamic relaxation, which needs no matrices", "\"relaxation\""),
    key("solver.max_steps", Count(1, 100_000_000), Default("100000"), "", "Time steps of dynamic relaxation that a step may take per body before it is given up", "1000000"),
    key("solver.nested_from_mm", Number(*RESOLUTIONS.start(), *RESOLUTIONS.end()), Optional("12 mm, but for muscles in grids, relaxation and strict steps"), "mm", "Meshes of 2, 4, ... times `resolution_mm`, up to this, are solved first, from coarse to fine; each shows the next one the way; not in cheap contact; less than twice `resolution_mm`: the mesh is solved at once", "12.0"),

    key("effects", Section, Optional("the defaults of its keys"), "", "What is simulated; what is left out costs nothing", ""),
    key("effects.fibres", Word(&["hill", "thermal", "none"]), Optional("hill; thermal where the mesh is free of stress at heel strike"), "", "Law of the fibres: force from activation and length, from contraction as in the publication, or passive tissue", "\"hill\""),
    key("effects.fibre_spacing", Count(1, 4), Default("1"), "", "A fibre at every node of a section, or at one of so many along each row; all together keep their section", "2"),
    key("effects.shells", Flag, Default("true"), "", "Shells around the muscles (aponeuroses)", "false"),
    key("effects.contact", Word(&["guarded", "cheap", "none"]), Default("\"guarded\""), "", "Contact between all muscles and bones: nothing passes through, a penalty on penetration, or none", "\"none\""),

    key("effects.contact_distance_mm", Number(*DISTANCES.start(), *DISTANCES.end()), Default("0.3"), "mm", "Guarded: distance at which surfaces begin to repel each other; cheap: depth at which they do with the stiffness of the softer side", "0.1"),

    key("materials", Section, Optional("the defaults of its keys"), "", "Material constants of all muscles", ""),
    key("materials.matrix_a_kpa", of(A), Optional("3.0"), "kPa", "A of the Mooney-Rivlin matrix, A (I1 - 3) + B (I2 - 3)", "3.0"),
    key("materials.matrix_b_kpa", of(B), Optional("0.75"), "kPa", "B of the matrix; 0 is neo-Hookean", "0.75"),
    key("materials.bulk_modulus_kpa", of(BULK), Optional("99.7 times the shear modulus 2 (A + B)"), "kPa", "Bulk modulus of the matrix", "747.5"),
    key("materials.density_kg_m3", of(DENSITY), Optional("1060"), "kg/m³", "Density; counts with gravity or inertia alone", "1060.0"),
    key("materials.aponeurosis_thickness_mm", of(THICKNESS), Optional("0.5"), "mm", "Thickness of the shell around a muscle", "0.5"),
    key("materials.aponeurosis_shear_modulus_kpa", of(SHELL), Optional("7.5"), "kPa", "Shear modulus of the shell", "7.5"),
    key("materials.tendon_modulus_mpa", of(TENDON), Optional("1200; of the solid quadriceps tendon 370"), "MPa", "Young's modulus of tendons along their fibres", "1200.0"),
    key("materials.tendon_section_mm2", of(SECTION), Optional("30"), "mm²", "Section of a tendon of strands, per attachment", "30.0"),
    key("materials.muscle", Sections, Optional("all muscles are alike"), "", "Material constants of a single muscle; they go before those of all", ""),
    key("materials.muscle.name", Text, Required, "", "Which muscle, as in `muscles`", "\"rectus_femoris\""),
    key("materials.muscle.matrix_a_kpa", of(A), Optional("that of all muscles"), "kPa", "A of the Mooney-Rivlin matrix, A (I1 - 3) + B (I2 - 3)", "3.0"),
    key("materials.muscle.matrix_b_kpa", of(B), Optional("that of all muscles"), "kPa", "B of the matrix; 0 is neo-Hookean", "0.75"),
    key("materials.muscle.bulk_modulus_kpa", of(BULK), Optional("that of all muscles"), "kPa", "Bulk modulus of the matrix", "747.5"),
    key("materials.muscle.density_kg_m3", of(DENSITY), Optional("that of all muscles"), "kg/m³", "Density; counts with gravity or inertia alone", "1060.0"),
    key("materials.muscle.aponeurosis_thickness_mm", of(THICKNESS), Optional("that of all muscles"), "mm", "Thickness of the shell around a muscle", "0.5"),
    key("materials.muscle.aponeurosis_shear_modulus_kpa", of(SHELL), Optional("that of all muscles"), "kPa", "Shear modulus of the shell", "7.5"),
    key("materials.muscle.tendon_modulus_mpa", of(TENDON), Optional("that of all muscles"), "MPa", "Young's modulus of tendons along their fibres", "1200.0"),
    key("materials.muscle.tendon_section_mm2", of(SECTION), Optional("that of all muscles"), "mm²", "Section of a tendon of strands, per attachment", "30.0"),

    key("fidelity", Sections, Optional("the mesh of every muscle is simulated"), "", "How much of a muscle is simulated; what matters less costs less", ""),
    key("fidelity.muscle", Text, Required, "", "Which muscle, as in `muscles`", "\"vastus_medialis\""),
    key("fidelity.level", Word(&LEVELS), Required, "", "Its mesh; its mesh in a coarse grid of cubes, whose corners move it; or its lines of action on the rigid leg alone", "\"embedded\""),
    key("fidelity.cell_mm", Number(*CELLS.start(), *CELLS.end()), Optional("only embedded muscles have it"), "mm", "Edge of a cube: at least twice the edges of the mesh", "30.0"),

    key("step", Sections, Optional("heel strike and loading response"), "", "Steps of the gait cycle that are solved", ""),
    key("step.name", Word(&STEPS), Required, "", "Which step; cycle_N is N % of the cycle, or of the reported frames", "\"heel_strike\""),
    key("step.knee_flexion_deg", Number(*FLEXIONS.start(), *FLEXIONS.end()), Optional("that of the trial"), "degrees", "Knee flexion in place of the trial's", "15.0"),
];

/// What a TOML file is, told by its keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TomlKind {
    /// A scene; an empty file is one, as every key of a scene has a default.
    Scene,
    /// A trial file.
    Trial,
    /// A ladder of `cost` ([`crate::cost::ladder`]): it has axes.
    Ladder,
    /// A study ([`mod@crate::study`]): it has samples, settings or what varies.
    Study,
    /// A scene of bodies of one's own ([`crate::solve`]): it names a mesh and no trial.
    OwnScene,
}

impl TomlKind {
    /// By the keys at the top, misspelt ones included.
    pub fn of(text: &str) -> TomlKind {
        let top = top_keys(text);
        let has = |name: &str| top.iter().any(|key| key == name);
        if has("axis") {
            TomlKind::Ladder
        } else if ["samples", "setting", "vary"].into_iter().any(has) {
            TomlKind::Study
        } else if has("mesh") && !has("trial") {
            TomlKind::OwnScene
        } else if likeness(text, trial_file::KEYS) > likeness(text, KEYS) {
            TomlKind::Trial
        } else {
            TomlKind::Scene
        }
    }
}

/// Refuses a file of another kind than the one wanted.
pub fn wanted(kind: TomlKind, file: &Path, text: &str) -> Result<(), InputError> {
    let found = TomlKind::of(text);
    if found == kind || text.trim().is_empty() {
        return Ok(());
    }
    let name = |kind: TomlKind| match kind {
        TomlKind::Scene => "a scene",
        TomlKind::Trial => "a trial file",
        TomlKind::OwnScene => "a scene of `solve`",
        TomlKind::Ladder => "a ladder",
        TomlKind::Study => "a study",
    };
    let remedy = match found {
        TomlKind::Scene => "run `sartorius compare`, `step` or `plan` with it",
        TomlKind::Trial => "run `sartorius optimize` with it, or write a scene with `trial = \"FILE\"`",
        TomlKind::OwnScene => "run `sartorius solve` with it",
        TomlKind::Ladder => "run `sartorius cost` with it",
        TomlKind::Study => "run `sartorius study` with it",
    };
    let problem = format!("this is {}, not {}", name(found), name(kind));
    Err(InputError::Malformed { file: file.to_path_buf(), at: Place::Whole, problem, remedy: remedy.into() })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use multibody::keys::{Filled, differences, template};

    use super::super::{Scene, SceneFile};
    use super::KEYS;

    #[test]
    fn every_field_has_a_row_and_every_row_a_field() {
        assert_eq!(differences::<SceneFile>(KEYS), Vec::<String>::new());
    }

    #[test]
    fn a_template_with_the_defaults_written_out_is_the_empty_scene() {
        let read = |text: &str| Scene::parse(Path::new("x.toml"), text, None).unwrap();
        let text = template(KEYS, &Filled::default());
        assert!(text.contains("resolution_mm = 12.0 #") && text.contains("# [[step]]"), "{text}");
        assert_eq!(Scene { text: String::new(), ..read(&text) }, Scene { text: String::new(), ..read("") });
    }
}
