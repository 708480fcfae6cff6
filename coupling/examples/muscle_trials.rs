//! Every muscle of the built-in thigh alone: its fibres, attachments and line of action, and how it bears being stretched and
//! contracted. `cargo run --release -p sartorius-coupling --example muscle_trials [MM]`

use coupling::registration::{MeshFrames, Registration};
use coupling::steps::rigid_muscles_standing;
use coupling::thigh::build::{FIBRE_YOUNG, ThighEffects, ThighMuscle};
use coupling::thigh::{BuiltIn, built_in};
use fem::mesh::muscle::fibres::mean_section;
use fem::plan::{Plan, SceneError};
use fem::run::{DriveFrame, Session};
use fem::scene::{PrescribedSpec, Scene};
use fem::solve::Settings;
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;

/// Stretch of the line from end to end, and active stress times mean section \[Pa\].
const STRETCH: f64 = 0.15;
const ACTIVE: f64 = 300e3;

fn main() {
    let mm: f64 = std::env::args().nth(1).map_or(6.0, |a| a.parse().expect("edge length in mm"));
    let made =
        built_in(1e-3 * mm, &[], ThighEffects { fibres: true, shells: false }).expect("built-in tables");
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, Ankle::Universal).expect("the walker has markers");
    let frames = MeshFrames::built_in();
    let registration = Registration::new(frames, &model).expect("the patella of the walker finds its place");
    println!("Fibres, attachments and lines of action, {mm} mm, standing");
    println!(
        "{:<28}{:>10}{:>12}{:>12}{:>34}{:>12}",
        "muscle", "elements", "mean mm2", "fibres mm2", "tied surface nodes", "line deg"
    );
    let rigid = rigid_muscles_standing(&model, &registration);
    for (i, muscle) in made.thigh.muscles.iter().enumerate() {
        let tied: Vec<String> =
            muscle.tied.iter().map(|(segment, nodes)| format!("{segment} {}", nodes.len())).collect();
        let line = rigid.iter().find(|m| m.name == muscle.name).expect("tables agree");
        // All lines pull alike: the direction of the muscle, not of a step.
        let direction: Vector3<f64> = line.lines.iter().map(|l| l.f_max * l.direction()).sum();
        let angle = muscle.tangent(muscle.layer_at(0.5)).angle(&direction).to_degrees();
        println!(
            "{:<28}{:>10}{:>12.0}{:>12.0}{:>34}{angle:>12.1}",
            muscle.name,
            made.built.muscles[i].block.n_cells(),
            1e6 * mean_section(&made.built.muscles[i].block),
            1e6 * muscle.fibre_area,
            tied.join(", "),
        );
    }
    println!("\nAlone, ends held: increments / Newton iterations / least det F / force at the end");
    println!(
        "{:<28}{:>26}{:>26}{:>26}",
        "muscle", "stretched by 15 %", "300 kPa x mean section", "half of own strength"
    );
    for (i, muscle) in made.thigh.muscles.iter().enumerate() {
        let half = 0.5 * rigid.iter().find(|m| m.name == muscle.name).map_or(0.0, |m| m.strength());
        let mean = mean_section(&made.built.muscles[i].block);
        let cells = [
            trial_of(&made, muscle, Load::Stretch),
            trial_of(&made, muscle, Load::Force(ACTIVE * mean)),
            trial_of(&made, muscle, Load::Force(half)),
        ];
        let show = |c: &Result<String, String>| c.as_ref().map_or("no equilibrium".into(), Clone::clone);
        println!("{:<28}{:>26}{:>26}{:>26}", muscle.name, show(&cells[0]), show(&cells[1]), show(&cells[2]));
        for error in cells.iter().filter_map(|c| c.as_ref().err()) {
            println!("    {error}");
        }
    }
}

/// What is done to a muscle.
enum Load {
    /// The insertion is moved away from the origin.
    Stretch,
    /// The fibres contract as if to pull with a force \[N\].
    Force(f64),
}

/// Increments, iterations, least det F and the force on the origin.
fn trial_of(made: &BuiltIn, muscle: &ThighMuscle, load: Load) -> Result<String, String> {
    let (scene, chord) = alone(made, muscle, matches!(load, Load::Stretch));
    let mut mesh = made.thigh.mesh.clone();
    mesh.blocks.retain(|b| b.name == muscle.name || b.name == format!("{}/fibres", muscle.name));
    mesh.surfaces.clear();
    mesh.remove_unused_nodes();
    let word = |e: SceneError| e.to_string();
    let plan = Plan::new(&scene, mesh).map_err(word)?;
    let control = match load {
        Load::Stretch => ("stretch", STRETCH),
        Load::Force(force) => (muscle.name.as_str(), force / (FIBRE_YOUNG * muscle.fibre_area)),
    };
    let settings = Settings { tolerance: 1e-4, least_force: 10.0, ..Settings::default() };
    let mut session = Session::new(&plan, &settings, None);
    let to = DriveFrame { time: 1.0, load: plan.load(&[control], &[]).map_err(word)? };
    let done = session.advance(&to);
    if let Some(error) = done.errors.first() {
        return Err(error.to_string());
    }
    let report = &done.frame.islands[0];
    let ends = &plan.mesh.node_sets[&format!("{}/origin", muscle.name)];
    let wrench = fem::measure::support_wrench(&plan, done.frame.snapshot(), ends, [0.0; 3]);
    let force = -Vector3::from(wrench.force).dot(&chord);
    Ok(format!("{} / {} / {:.2} / {force:.0} N", report.load_steps, report.iterations, report.least_det_f))
}

/// The muscle with its ends held; the unit vector from its origin to its insertion.
fn alone(made: &BuiltIn, muscle: &ThighMuscle, stretched: bool) -> (Scene, Vector3<f64>) {
    let thigh = &made.thigh;
    let name = &muscle.name;
    let way = muscle.line[muscle.line.len() - 1] - muscle.line[0];
    let held = |end: &str, displacement, control| PrescribedSpec {
        nodes: format!("{name}/{end}"),
        components: [true; 3],
        displacement,
        control,
    };
    let scene = Scene {
        solids: thigh.scene.solids.iter().filter(|s| s.region == *name).cloned().collect(),
        fibres: thigh.scene.fibres.iter().filter(|f| f.activation.as_ref() == Some(name)).cloned().collect(),
        prescribed: vec![
            held("origin", vec![], None),
            held(
                "insertion",
                if stretched { vec![way.into()] } else { vec![] },
                stretched.then(|| "stretch".into()),
            ),
        ],
        ..Scene::default()
    };
    (scene, way.normalize())
}
