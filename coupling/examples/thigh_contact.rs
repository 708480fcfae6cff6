//! The built-in thigh with all muscles and bones under hard load, with Hill fibres calibrated as `compare` does, to a residual of 10 N:
//!
//! - `posture`: hip flexed by 30 and knee by 15 degrees from standing, passive; without and with guarded contact;
//! - `pull`: from there all muscles activated by 20 %, then by 50 %;
//! - `belt`: in standing, a stiff belt of 40 mm around the middle of the thigh squeezes it by 10 % of its girth.
//!
//! `cargo run --release -p sartorius-coupling --example thigh_contact [MM [CASE [COARSE_MM]]]`; a line per state reached, with what it took.
//! Where a coarser mesh is asked for, contact is solved on that one first, which leads the fine one; seconds of both count then.
//! Exit code 3 where a state is not reached, surfaces intersect, or an element is inverted.

use std::f64::consts::TAU;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use coupling::comparison::SETTINGS;
use coupling::fibres::FibreTask;
use coupling::fibres::cache::Cache;
use coupling::scene::Fibres;
use coupling::scene::StressFree;
use coupling::thigh::build::{Thigh, ThighEffects};
use coupling::thigh::registration::{BODIES, MeshFrames, Registration};
use coupling::thigh::{BuiltIn, built_in};
use fem::body::Pose;
use fem::measure::intersections;
use fem::mesh::{CellBlock, CellKind};
use fem::nested::CoarseRun;
use fem::plan::Plan;
use fem::run::{DriveFrame, Frame, Session};
use fem::scene::PrescribedSpec;
use fem::solve::{Advance, Settings};
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Residual \[N\], that of `compare` with contact.
const RESIDUAL: f64 = 10.0;
/// Height and thickness of the belt, and its distance from the muscles \[m\].
const BELT: [f64; 3] = [0.04, 0.003, 0.001];
/// Corners of the belt.
const CORNERS: usize = 48;
/// Fraction of its girth by which it is drawn in.
const SQUEEZE: f64 = 0.1;

/// A state to be reached: its name, activation of all muscles, bones where the hip and knee are flexed, fraction of the belt's way.
struct Goal {
    name: &'static str,
    activation: f64,
    flexed: bool,
    belt: f64,
}

fn main() -> ExitCode {
    let targets = std::env::var("RUST_LOG").unwrap_or("error".into()).parse::<Targets>().expect("RUST_LOG");
    let layer = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    tracing_subscriber::registry().with(targets).with(layer).init();
    let argument = |i: usize| std::env::args().nth(i);
    let edge = 1e-3 * argument(1).map_or(6.0, |a| a.parse().expect("edge length in mm"));
    let case = argument(2).unwrap_or("all".into());
    let wanted = |name: &str| case == name || case == "all";
    let coarse_edge = argument(3).map(|a| 1e-3 * a.parse::<f64>().expect("edge length in mm"));

    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, Ankle::Universal).expect("the walker has markers");
    let registration =
        Registration::new(MeshFrames::built_in(), &model).expect("the patella of the walker finds its place");
    let flexed = registration
        .posture(&model, 30_f64.to_radians(), 15_f64.to_radians())
        .expect("the patella finds its place there too");
    let poses = registration.poses(&model, &flexed);
    let (made, thigh) = calibrated(edge, &model, &registration);
    let coarse = coarse_edge.map(|edge| {
        let (made, thigh) = calibrated(edge, &model, &registration);
        with_contact(&thigh, &made)
    });
    let coarse = coarse.as_ref();

    let posture = Goal { name: "posture", activation: 0.0, flexed: true, belt: 0.0 };
    let pull = |name, activation| Goal { name, activation, flexed: true, belt: 0.0 };
    let belt = Goal { name: "belt", activation: 0.0, flexed: false, belt: 1.0 };
    let mut good = true;
    if wanted("posture") {
        good &= run(&thigh, "without contact", &[&posture], &poses, None);
    }
    let with = with_contact(&thigh, &made);
    if wanted("pull") {
        good &= run(
            &with,
            "with contact",
            &[&posture, &pull("pull 20 %", 0.2), &pull("pull 50 %", 0.5)],
            &poses,
            coarse,
        );
    } else if wanted("posture") {
        good &= run(&with, "with contact", &[&posture], &poses, coarse);
    }
    if wanted("belt") {
        let frames = registration.frames();
        let belted = |thigh: &Thigh| {
            let mut thigh = thigh.clone();
            add_belt(&mut thigh, 0.5 * (frames.hip.y + frames.knee.y));
            thigh
        };
        good &= run(&belted(&with), "with contact", &[&belt], &poses, coarse.map(belted).as_ref());
    }
    if good { ExitCode::SUCCESS } else { ExitCode::from(3) }
}

/// The thigh with edges of `edge` \[m\], calibrated, without contact.
fn calibrated(edge: f64, model: &Model, registration: &Registration) -> (BuiltIn, Thigh) {
    let made = built_in(edge, &[], ThighEffects { fibres: Some(1), shells: true }).expect("built-in tables");
    let clock = Instant::now();
    let cache = Cache::beside(Path::new("target/thigh_contact"));
    let fibres = FibreTask {
        thigh: &made.thigh,
        model,
        registration,
        steps: &[],
        stress_free: StressFree::Standing,
        kind: Fibres::Hill,
        check: false,
    };
    let thigh = fibres.calibrate(&SETTINGS, Some(&cache)).expect("every muscle can be calibrated").thigh;
    let n = thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum::<usize>();
    println!("{n} elements of {:.0} mm, calibrated in {:.0} s", 1e3 * edge, clock.elapsed().as_secs_f64());
    (made, thigh)
}

fn with_contact(thigh: &Thigh, made: &BuiltIn) -> Thigh {
    let mut thigh = thigh.clone();
    thigh.add_contact(&made.bones, &made.attachments);
    thigh
}

/// Drives a thigh from goal to goal, led by the `coarse` one where there is one; prints a line for each and returns whether all is well.
fn run(
    thigh: &Thigh,
    configuration: &str,
    goals: &[&Goal],
    poses: &[Pose; 4],
    coarse: Option<&Thigh>,
) -> bool {
    let plan_of =
        |thigh: &Thigh| Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap_or_else(|e| panic!("{e}"));
    let plan = plan_of(thigh);
    let Some(coarse) = coarse.map(plan_of) else {
        return solve(&plan, configuration, goals, poses, None).is_some();
    };
    let Some(frames) = solve(&coarse, &format!("{configuration}, coarse"), goals, poses, None) else {
        return false;
    };
    let clock = Instant::now();
    let led = CoarseRun::new(&coarse, &frames, &plan);
    println!("{configuration}: ways from mesh to mesh in {:.1} s", clock.elapsed().as_secs_f64());
    solve(&plan, &format!("{configuration}, led"), goals, poses, Some(&led)).is_some()
}

/// Drives a plan from goal to goal; prints a line for each and returns the frames, where all is well.
fn solve(
    plan: &Plan,
    configuration: &str,
    goals: &[&Goal],
    poses: &[Pose; 4],
    led: Option<&CoarseRun>,
) -> Option<Vec<Frame>> {
    let settings = Settings { tolerance: RESIDUAL / SETTINGS.least_force, ..SETTINGS };
    let mut session = Session::new(plan, &settings, None).expect("settings that can be");
    let (mut frames, mut good): (Vec<Frame>, bool) = (Vec::new(), true);
    for (k, goal) in goals.iter().enumerate() {
        let value = |c: &String| if c == "belt" { goal.belt } else { goal.activation };
        let controls: Vec<(&str, f64)> = plan.controls.iter().map(|c| (c.as_str(), value(c))).collect();
        let moved: Vec<(&str, Pose)> = BODIES
            .into_iter()
            .zip(poses.iter().map(|p| if goal.flexed { *p } else { Pose::identity() }))
            .filter(|(name, _)| plan.bodies.iter().any(|b| b == name))
            .collect();
        let load = plan.load(&controls, &moved).expect("bodies and controls of the plan");
        let clock = Instant::now();
        let way = led.map_or(Vec::new(), |coarse| coarse.way(plan, frames.last(), k, &load));
        let done = session.advance_along(&DriveFrame { time: 1.0 + k as f64, load }, &way);
        let seconds = clock.elapsed().as_secs_f64();
        let islands = &done.frame.islands;
        let sum = |of: fn(&Advance) -> f64| islands.iter().map(of).sum::<f64>();
        let percent = |of: fn(&Advance) -> f64| 100.0 * sum(of) / sum(|i| i.total_s);
        // What nothing can move is not solved.
        let solved = islands.iter().filter(|i| i.load_steps > 0);
        let det = solved.map(|i| i.least_det_f).fold(f64::INFINITY, f64::min);
        let met = intersections(plan, done.frame.snapshot());
        println!(
            "{configuration:20} {:10} {seconds:6.1} s  {:4.0} Newton {:6.0} CG {:4.0} factors  contact {:4.1}, assembly {:4.1}, factors {:4.1}, CG {:4.1} %  least det F {det:.3}  {} intersections{}",
            goal.name,
            sum(|i| i.iterations as f64),
            sum(|i| i.linear_iterations as f64),
            sum(|i| i.factorizations as f64),
            percent(|i| i.contact_s),
            percent(|i| i.assembly_s),
            percent(|i| i.factorization_s),
            percent(|i| i.linear_s),
            met.len(),
            if done.errors.is_empty() { "" } else { "  NOT REACHED" },
        );
        met.iter().for_each(|([a, b], n)| println!("  {a} and {b}: {n} pairs of triangles"));
        done.errors.iter().for_each(|e| println!("  {e}"));
        good &= met.is_empty() && det > 0.0 && done.errors.is_empty();
        if !done.errors.is_empty() {
            break;
        }
        frames.push(done.frame);
    }
    good.then_some(frames)
}

/// A closed ring of cells around the thigh at `height` \[m\], all of it prescribed by the control `belt`: at 1 its girth is smaller by
/// [`SQUEEZE`]. Its outline are the tangents of the muscles there, so it is convex.
fn add_belt(thigh: &mut Thigh, height: f64) {
    let [width, thickness, gap] = BELT;
    let mesh = &mut thigh.mesh;
    let within = |p: &&[f64; 3]| (p[1] - height).abs() < 0.5 * width + 0.01;
    let skin: Vec<u32> = thigh
        .muscles
        .iter()
        .flat_map(|m| mesh.surfaces[&format!("{}/surface", m.name)].iter().flatten().copied())
        .collect();
    let near: Vec<[f64; 2]> =
        skin.iter().map(|&n| &mesh.points[n as usize]).filter(within).map(|p| [p[0], p[2]]).collect();
    let direction = |k: usize| {
        let angle = TAU * k as f64 / CORNERS as f64;
        [angle.cos(), angle.sin()]
    };
    let support = |k: usize| {
        let d = direction(k);
        near.iter().map(|p| p[0] * d[0] + p[1] * d[1]).fold(f64::NEG_INFINITY, f64::max)
    };
    // Where the tangents k and k + 1, moved out by `out`, meet.
    let corner = |k: usize, out: f64| {
        let (d, e) = (direction(k), direction((k + 1) % CORNERS));
        let (h, i) = (support(k) + out, support((k + 1) % CORNERS) + out);
        let det = d[0] * e[1] - d[1] * e[0];
        [(h * e[1] - i * d[1]) / det, (d[0] * i - e[0] * h) / det]
    };
    let inner: Vec<[f64; 2]> = (0..CORNERS).map(|k| corner(k, gap)).collect();
    let outer: Vec<[f64; 2]> = (0..CORNERS).map(|k| corner(k, gap + thickness)).collect();
    let centre: [f64; 2] = std::array::from_fn(|c| inner.iter().map(|p| p[c]).sum::<f64>() / CORNERS as f64);

    let first = mesh.points.len() as u32;
    let mut displacement = Vec::new();
    // Corner by corner: inner and outer, below and above.
    for (p, q) in inner.iter().zip(&outer) {
        for (point, y) in [(p, -0.5), (q, -0.5), (q, 0.5), (p, 0.5)] {
            mesh.points.push([point[0], height + y * width, point[1]]);
            displacement.push([SQUEEZE * (centre[0] - p[0]), 0.0, SQUEEZE * (centre[1] - p[1])]);
        }
    }
    let n = CORNERS as u32;
    let mut faces = Vec::new();
    for k in 0..n {
        let (here, next) = (first + 4 * k, first + 4 * ((k + 1) % n));
        for side in 0..4 {
            let after = (side + 1) % 4;
            faces.push([here + side, here + after, next + after, next + side]);
        }
    }
    mesh.node_sets.insert("belt".into(), (first..first + 4 * n).collect());
    let nodes = faces.iter().flatten().copied().collect();
    mesh.blocks.push(CellBlock { name: "belt/faces".into(), kind: CellKind::Quad4, nodes });
    mesh.surfaces.insert("belt".into(), faces);
    thigh.scene.prescribed.push(PrescribedSpec {
        nodes: "belt".into(),
        components: [true; 3],
        displacement,
        control: Some("belt".into()),
    });
    thigh.scene.contact.as_mut().expect("a thigh with contact").surfaces.push("belt".into());
}
