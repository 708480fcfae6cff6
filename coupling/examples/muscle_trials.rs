//! Every muscle of the built-in thigh alone: its fibres, attachments and line of action, and how it bears being stretched and
//! contracted. `cargo run --release -p sartorius-coupling --example muscle_trials [MM]`

use coupling::steps::rigid_muscles_standing;
use coupling::thigh::build::ThighEffects;
use coupling::thigh::built_in;
use coupling::thigh::registration::{MeshFrames, Registration};
use coupling::thigh::trial::{LEAST_FORCE, MuscleAlone, TOLERANCE, Task, Trial};
use mesher::fibres::mean_section;
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;

/// Stretch of the straight line from end to end, and active stress times mean section \[Pa\].
const STRETCH: f64 = 0.15;
const ACTIVE: f64 = 300e3;
/// What a task may take.
const INCREMENTS: usize = 10;
const ITERATIONS: usize = 60;

fn main() {
    let mm: f64 = std::env::args().nth(1).map_or(6.0, |a| a.parse().expect("edge length in mm"));
    let made =
        built_in(1e-3 * mm, &[], ThighEffects { fibres: Some(1), shells: false }).expect("built-in tables");
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
    println!(
        "\nAlone, end faces held: increments / Newton iterations to {TOLERANCE:.0e} of the forces in play, at least {LEAST_FORCE} N / least det F at \
         Gauss points / corners turned over / force through the belly",
    );
    println!(
        "Stretched by 15 % of the straight line between the ends, fibres passive; first guess: the stretch spread over the length."
    );
    println!("Contracted from rest, to a force through the belly within 2 %.");
    println!(
        "{:<28}{:>30}{:>30}{:>30}",
        "muscle", "stretched by 15 %", "300 kPa x mean section", "half of own strength"
    );
    let mut borne = [0; 3];
    for (muscle, built) in made.thigh.muscles.iter().zip(&made.built.muscles) {
        let half = 0.5 * rigid.iter().find(|m| m.name == muscle.name).map_or(0.0, |m| m.strength());
        let alone = MuscleAlone::new(&built.block, muscle.fibre_area);
        let tasks =
            [Task::Stretch(STRETCH), Task::Force(ACTIVE * mean_section(&built.block)), Task::Force(half)];
        let trials = tasks.map(|task| alone.run(task));
        for (n, trial) in borne.iter_mut().zip(&trials) {
            *n += usize::from(trial.as_ref().is_ok_and(is_borne));
        }
        let [a, b, c] = trials.each_ref().map(|t| t.as_ref().map_or("no equilibrium".to_string(), shown));
        println!("{:<28}{a:>30}{b:>30}{c:>30}", muscle.name);
        for error in trials.iter().filter_map(|c| c.as_ref().err()) {
            println!("    {error}");
        }
    }
    println!(
        "det F > 0 at all Gauss points within {INCREMENTS} increments and {ITERATIONS} iterations: {} stretched, {} at 300 kPa, {} at half \
         of their own strength, of {} muscles",
        borne[0],
        borne[1],
        borne[2],
        made.thigh.muscles.len()
    );
}

fn is_borne(t: &Trial) -> bool {
    t.least_det_f > 0.0 && t.increments <= INCREMENTS && t.iterations <= ITERATIONS
}

fn shown(t: &Trial) -> String {
    format!(
        "{} / {} / {:.2} / {} / {:.0} N",
        t.increments, t.iterations, t.least_det_f, t.turned_corners, t.force
    )
}
