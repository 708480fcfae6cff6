//! The steps of a scene without contact by explicit dynamics, with more or less added mass, beside Newton's method on the same mesh.
//!
//! `cargo run --release -p sartorius-coupling --example explicit_thigh [SCENE [SECONDS [FACTOR...]]]`, by default the shipped scene
//! `walker_no_contact`, 1 s and time steps 10 times as long as the material bears. In each step bodies and activations go their way in a fifth of the
//! time, and are held for the rest, with damping. Damping is [`DAMPING`]. A line per step and factor: time step, added mass, energies, the residual at
//! the end, and by how much section forces differ from Newton's; and with `VERBOSE=1` all forces.

use std::path::Path;
use std::time::Instant;

use coupling::comparison::compare::{drive, measured};
use coupling::comparison::{Prepared, settings_of};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::Scene;
use fem::plan::{LoadedIsland, Plan};
use fem::run::{DriveFrame, Frame, Run, Session, run};
use fem::scene::InertiaSpec;
use fem::solve::{Loading, Method, Potential, Settings};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Rate at which velocities fade \[1/s\]: about twice the circular frequency of a muscle of 0.4 m that swings across itself, whose shear waves run at
/// some 3 m/s, so that the slowest motion comes to rest soonest.
const DAMPING: f64 = 40.0;
/// Fraction of the time in which bodies and activations go their way.
const ON_THE_WAY: f64 = 0.2;

fn main() {
    let targets = std::env::var("RUST_LOG").unwrap_or("error".into()).parse::<Targets>().expect("RUST_LOG");
    let layer = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    tracing_subscriber::registry().with(targets).with(layer).init();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |text: &String| text.parse::<f64>().expect("a number");
    let scene = arguments.first().map_or("walker_no_contact", String::as_str);
    let seconds = arguments.get(1).map_or(1.0, number);
    let factors: Vec<f64> = arguments.iter().skip(2).map(number).collect();
    let factors = if factors.is_empty() { vec![10.0] } else { factors };

    let c = Configuration::WithoutContact;
    let scene = Scene::read(Path::new(scene), None).expect("a scene");
    let prepared = Prepared::new(scene, None, &mut |_| ()).expect("a thigh");
    let asked = PerConfiguration { without: true, with: false };
    let ready = prepared.calibrate(asked, Path::new("target/explicit_thigh"), &mut |_| ()).expect("fibres");
    let steps = &prepared.steps;
    let still = prepared.plan(&ready.thigh, c).expect("a plan");
    let way =
        drive(&still, &ready.thigh, &ready.controls, steps, prepared.scene.stress_free).expect("a drive");
    let settings = settings_of(&prepared.scene, c);
    println!("{} elements, {} unknowns", prepared.n_elements(), still.n_unknowns());

    let clock = Instant::now();
    let newton = run(&still, &way, &settings, None, &mut |_| ());
    println!("newton: {:.1} s, solved: {}", clock.elapsed().as_secs_f64(), newton.is_solved());
    let passive = way.frames.len() - steps.len();
    let newton = measured(still, &ready.thigh, newton, steps, passive, clock.elapsed());

    let mut thigh = ready.thigh.clone();
    thigh.scene.inertia = Some(InertiaSpec::default());
    let moving = prepared.plan(&thigh, c).expect("a plan with masses");
    for factor in factors {
        let settings = Settings {
            method: Method::Explicit,
            damping: DAMPING,
            time_step_factor: factor,
            max_steps: usize::MAX,
            ..settings
        };
        let mut session = Session::new(&moving, &settings, None).expect("settings that can be");
        let mut out = Run::default();
        for (k, to) in way.frames.iter().enumerate() {
            let clock = Instant::now();
            for until in [ON_THE_WAY, 1.0] {
                let time = (k as f64 + until) * seconds;
                let done = session.advance(&DriveFrame { time, load: to.load.clone() });
                done.errors.iter().for_each(|error| println!("factor {factor}, frame {k}: {error}"));
                if !done.errors.is_empty() {
                    return;
                }
                said(factor, k, &done.frame);
                if until == 1.0 {
                    out.frames.push(done.frame);
                }
            }
            let frame = out.frames.last().expect("just pushed");
            let left = residual(&moving, frame);
            println!(
                "factor {factor}, frame {k}: {:.0} s, residual {left:.2} N",
                clock.elapsed().as_secs_f64()
            );
            if k < passive {
                continue;
            }
            let solution = prepared.plan(&ready.thigh, c).expect("a plan");
            let reached = Run { frames: out.frames.clone(), ..Run::default() };
            let explicit = measured(solution, &ready.thigh, reached, steps, passive, clock.elapsed());
            let [ours, theirs] = [&explicit.steps[k - passive], &newton.steps[k - passive]];
            let (mut most, mut off) = (0.0_f64, 0);
            for (i, muscle) in ready.thigh.muscles.iter().enumerate() {
                let (a, b) = (ours.muscles[i].total, theirs.muscles[i].total);
                let difference = (a - b).abs();
                most = most.max(difference);
                off += usize::from(difference > (0.01 * b.abs()).max(1.0));
                if std::env::var_os("VERBOSE").is_some() {
                    println!("  {:28} {b:9.2} {a:9.2}", muscle.name);
                }
            }
            println!(
                "factor {factor}, {}: section forces differ by {most:.2} N at most; {off} of {} by more than 1 % and 1 N",
                ours.step.name(),
                ready.thigh.muscles.len()
            );
        }
    }
}

/// Energies and masses of a frame.
fn said(factor: f64, k: usize, frame: &Frame) {
    let motions = || frame.islands.iter().filter_map(|island| island.motion.as_ref());
    let sum = |of: &dyn Fn(&fem::solve::Motion) -> f64| motions().map(of).sum::<f64>();
    let least = |of: &dyn Fn(&fem::solve::Motion) -> f64| motions().map(of).fold(f64::INFINITY, f64::min);
    let worst = motions().map(|m| m.missing().abs() / m.in_play()).fold(0.0, f64::max);
    println!(
        "factor {factor}, frame {k}: {} steps, shortest {:.1e} s of {:.1e} s without mass; {:.3} kg, {:.3} kg added; kinetic {:.1e} J at most, {:.1e} J of added mass, stored {:.2} J; missing at most {:.2} %",
        motions().map(|m| m.steps).sum::<usize>(),
        least(&|m| m.time_step),
        least(&|m| m.natural_step),
        sum(&|m| m.mass),
        sum(&|m| m.added_mass),
        sum(&|m| m.largest_kinetic),
        sum(&|m| m.added_kinetic),
        sum(&|m| m.stored),
        100.0 * worst
    );
    motions().filter_map(fem::solve::Motion::warning).for_each(|warning| println!("  warned: {warning}"));
}

/// Norm of the forces out of balance at rest \[N\], the largest of any island.
fn residual(plan: &Plan, frame: &Frame) -> f64 {
    let of = |island: &std::sync::Arc<fem::plan::Island>| {
        let mut free = island.free_positions(&island.gather(&frame.x));
        let mut potential = LoadedIsland::new(island.clone(), frame.load.clone(), frame.load.clone());
        potential.set_load(1.0, &mut free);
        let mut g = vec![0.0; free.len()];
        potential.gradient(&free, &mut g);
        g.iter().zip(potential.fixed()).filter(|(_, fixed)| !**fixed).map(|(g, _)| g * g).sum::<f64>().sqrt()
    };
    plan.islands.iter().map(of).fold(0.0, f64::max)
}
