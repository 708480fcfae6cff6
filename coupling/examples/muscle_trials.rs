//! Every muscle of the built-in thigh alone: its fibres, attachments and line of action, and how it bears being stretched and
//! contracted. `cargo run --release -p sartorius-coupling --example muscle_trials [MM]`

use coupling::registration::{MeshFrames, Registration};
use coupling::steps::rigid_muscles_standing;
use coupling::thigh::build::{MATRIX, ThighEffects, ThighMuscle};
use coupling::thigh::built_in;
use fem::material::line::FibreStrain;
use fem::measure::{Cut, section_force};
use fem::mesh::muscle::fibres::{end_stiffness, fibres, mean_section};
use fem::mesh::muscle::{MuscleBlock, to_mesh};
use fem::mesh::{CellBlock, CellKind};
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::scene::{Course, FibreLawSpec, FibreSpec, PrescribedSpec, Scene, SolidSpec};
use fem::solve::Settings;
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;

/// Stretch of the line from end to end, and active stress times mean section \[Pa\].
const STRETCH: f64 = 0.15;
const ACTIVE: f64 = 300e3;
/// Fibres are springs: Young's modulus \[Pa\] and the strain over which their tension sets in.
const YOUNG: f64 = 1e6;
const TOE: f64 = 0.05;

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
    println!(
        "\nAlone, ends held: increments / Newton iterations / least det F / corners turned over / force through the belly"
    );
    println!(
        "{:<28}{:>30}{:>30}{:>30}",
        "muscle", "stretched by 15 %", "300 kPa x mean section", "half of own strength"
    );
    for (i, muscle) in made.thigh.muscles.iter().enumerate() {
        let half = 0.5 * rigid.iter().find(|m| m.name == muscle.name).map_or(0.0, |m| m.strength());
        let block = &made.built.muscles[i].block;
        let mean = mean_section(block);
        let cells = [
            trial_of(block, muscle, Load::Stretch),
            trial_of(block, muscle, Load::Force(ACTIVE * mean)),
            trial_of(block, muscle, Load::Force(half)),
        ];
        let show = |c: &Result<String, String>| c.as_ref().map_or("no equilibrium".into(), Clone::clone);
        println!("{:<28}{:>30}{:>30}{:>30}", muscle.name, show(&cells[0]), show(&cells[1]), show(&cells[2]));
        for error in cells.iter().filter_map(|c| c.as_ref().err()) {
            println!("    {error}");
        }
    }
}

/// What is done to a muscle.
#[derive(Clone, Copy)]
enum Load {
    /// The insertion is moved away from the origin.
    Stretch,
    /// The fibres contract until this force passes through the belly \[N\].
    Force(f64),
}

/// Tries to find the contraction for a force.
const MOST_TRIES: usize = 8;
/// How near a force is met.
const MET: f64 = 0.02;

/// Increments, iterations, least det F, corners of cells turned over and the force through the belly, all of one computation from
/// rest.
fn trial_of(block: &MuscleBlock, muscle: &ThighMuscle, load: Load) -> Result<String, String> {
    let mut mesh = to_mesh(std::slice::from_ref(block));
    mesh.surfaces.clear();
    let fibres = fibres(block, muscle.fibre_area);
    let region = format!("{}/fibres", block.name);
    let nodes = fibres.segments.iter().flatten().copied().collect();
    mesh.blocks.push(CellBlock { name: region.clone(), kind: CellKind::Line2, nodes });
    let way = muscle.line[muscle.line.len() - 1] - muscle.line[0];
    let held = |end: &str, displacement, control| PrescribedSpec {
        nodes: format!("{}/{end}", block.name),
        components: [true; 3],
        displacement,
        control,
    };
    let (moved, control) = match load {
        Load::Stretch => (vec![way.into()], Some("stretch".into())),
        Load::Force(_) => (vec![], None),
    };
    let scene = Scene {
        solids: vec![SolidSpec {
            region: block.name.clone(),
            law: MATRIX,
            formulation: None,
            density: 1060.0,
            scale: end_stiffness(block, 40.0, 3),
        }],
        fibres: vec![FibreSpec {
            name: region.clone(),
            course: Course::Region(region),
            law: FibreLawSpec::Thermal {
                young: YOUNG,
                contraction: 1.0,
                strain: FibreStrain::Engineering,
                toe: Some(TOE),
            },
            area: fibres.area,
            activation: Some(block.name.clone()),
        }],
        prescribed: vec![held("origin", vec![], None), held("insertion", moved, control)],
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    match load {
        Load::Stretch => Ok(compute(&plan, block, muscle, ("stretch", STRETCH))?.0),
        Load::Force(wanted) => {
            let stiffness = YOUNG * muscle.fibre_area;
            // Half the toe is slack; more goes into straightening, which the tries find out.
            let mut contraction = TOE / 2.0 + wanted / stiffness;
            let mut last: Option<(f64, f64)> = None;
            for _ in 0..MOST_TRIES {
                let (row, force) = compute(&plan, block, muscle, (&block.name, contraction))?;
                if (force / wanted - 1.0).abs() <= MET {
                    return Ok(row);
                }
                let slope = last.map_or(stiffness, |(c, f)| (force - f) / (contraction - c));
                last = Some((contraction, force));
                contraction += (wanted - force) / slope.clamp(0.2 * stiffness, stiffness);
            }
            Err(format!("no contraction found for {wanted:.0} N, last {last:?}"))
        }
    }
}

/// The row of the table, and the force through the belly \[N\].
fn compute(
    plan: &Plan,
    block: &MuscleBlock,
    muscle: &ThighMuscle,
    control: (&str, f64),
) -> Result<(String, f64), String> {
    let settings = Settings { tolerance: 1e-4, least_force: 10.0, ..Settings::default() };
    let mut session = Session::new(plan, &settings, None);
    let to = DriveFrame { time: 1.0, load: plan.load(&[control], &[]).map_err(|e| e.to_string())? };
    let done = session.advance(&to);
    if let Some(error) = done.errors.first() {
        return Err(error.to_string());
    }
    let report = &done.frame.islands[0];
    let layer = muscle.layer_at(0.5);
    let tangent = muscle.tangent(layer);
    let effects = ["", "/fibres"].map(|part| format!("{}{part}", block.name)).to_vec();
    let cut = Cut { point: muscle.line[layer].into(), normal: tangent.into(), effects };
    let force = section_force(plan, done.frame.snapshot(), &cut).along(tangent.into());
    let turned = turned_corners(block, &done.frame.x);
    let (steps, iterations) = (report.load_steps, report.iterations);
    Ok((format!("{steps} / {iterations} / {:.2} / {turned} / {force:.0} N", report.least_det_f), force))
}

/// Corners of cells that are turned over at `x`.
fn turned_corners(block: &MuscleBlock, x: &[f64]) -> usize {
    // Neighbours of the corners along the three directions of the cell, so that a good corner has a positive product.
    const NEIGHBOURS: [[usize; 3]; 8] =
        [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]];
    let at = |n: u32| Vector3::from_row_slice(&x[3 * n as usize..3 * n as usize + 3]);
    let corner = |cell: &[u32; 8], k: usize| {
        let [a, b, c] = NEIGHBOURS[k].map(|j| at(cell[j]) - at(cell[k]));
        a.dot(&b.cross(&c)) <= 0.0
    };
    block.cells().map(|cell| (0..8).filter(|&k| corner(&cell, k)).count()).sum()
}
