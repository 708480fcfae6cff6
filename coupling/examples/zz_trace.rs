#![allow(missing_docs, non_snake_case, clippy::all)]
use coupling::hill_calibration::with_laws;
use coupling::muscle_unit::{Fit, MuscleUnit};
use coupling::registration::{MeshFrames, Registration};
use coupling::section::belly_force;
use coupling::steps::rigid_muscles_standing;
use coupling::study::SETTINGS;
use coupling::thigh::build::{Thigh, ThighEffects};
use coupling::thigh::{from_limb, limb};
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::scene::FibreLawSpec;
use multibody::model::{Ankle, Model};
use multibody::muscle::curves::Curves;
use multibody::walker::{Knee, walker};
use std::time::Instant;

fn flat(thigh: &Thigh, units: &[MuscleUnit], a: f64) -> Thigh {
    let mut t = thigh.clone();
    for i in 0..t.muscles.len() {
        let s = units[i].force(0.0, a) / t.muscles[i].fibre_area;
        t.set_fibre_law(
            i,
            FibreLawSpec::ForceLength {
                stretch: vec![0.01, 10.0],
                activation: vec![0.0, 1.0],
                stress: vec![vec![0.0, 0.0], vec![s, s]],
            },
        );
    }
    t
}
fn go(label: &str, thigh: &Thigh, a: &[f64], start: Option<&[f64]>) -> Vec<f64> {
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap();
    let tol: f64 = std::env::var("TOL").map_or(1e-4, |t| t.parse().unwrap());
    let settings = fem::solve::Settings { tolerance: tol, ..SETTINGS };
    let mut session = Session::new(&plan, &settings, start);
    let mut x = vec![];
    for (k, a) in a.iter().enumerate() {
        eprintln!("== {label} {a}");
        let clock = Instant::now();
        let controls: Vec<(&str, f64)> = thigh.muscles.iter().map(|m| (m.name.as_str(), *a)).collect();
        let done =
            session.advance(&DriveFrame { time: k as f64 + 1.0, load: plan.load(&controls, &[]).unwrap() });
        for e in &done.errors {
            println!("{e}");
        }
        println!("{label} a={a}: {:.1} s", clock.elapsed().as_secs_f64());
        for (i, adv) in plan.islands.iter().zip(&done.frame.islands) {
            let m = thigh.muscles.iter().position(|m| m.name == i.name).unwrap();
            let f = belly_force(&plan, done.frame.snapshot(), &thigh.muscles[m]);
            println!(
                "   {:28} it {:4} fac {:3} lin {:5} s {:6.2} asm {:6.2} res {:.3} force {:.2} stretch {:.4} steps {} retries {} ",
                i.name,
                adv.iterations,
                adv.factorizations,
                adv.linear_iterations,
                adv.total_s,
                adv.assembly_s,
                adv.residual,
                f.along(),
                thigh.fibre_stretch(m, &done.frame.x),
                adv.load_steps,
                adv.retries
            );
        }
        x = done.frame.x.clone();
    }
    x
}
fn main() {
    tracing_subscriber::fmt()
        .without_time()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .init();
    let argument = |i: usize| std::env::args().nth(i);
    let only: Vec<String> =
        argument(1).unwrap().split(',').filter(|s| !s.is_empty()).map(String::from).collect();
    let what = argument(2).unwrap();
    let mut made = from_limb(limb().unwrap(), 12e-3, &only, ThighEffects { fibres: true, shells: true });
    if let Ok(one) = std::env::var("ALONE") {
        let i = made.thigh.muscles.iter().position(|m| m.name == one).unwrap();
        made.thigh = coupling::alone::alone(&made.thigh, i);
    }
    if let Ok(d) = std::env::var("SURF") {
        let d = std::path::PathBuf::from(d);
        made = coupling::thigh::from_surfaces(
            &d.join("muscles_fit"),
            &d.join("bones"),
            14e-3,
            &only,
            ThighEffects { fibres: true, shells: true },
        )
        .unwrap()
        .0;
        for b in &made.built.muscles {
            let femur = fem::geometry::SearchSurface::new(
                made.bones.iter().find(|b| b.name == "femur").unwrap().surface.clone(),
            );
            let mut h = [0usize; 12];
            let block = &b.block;
            for l in 0..block.n_layers() {
                for &n in &block.outline {
                    let d = femur.nearest(&block.point(l, n)).map_or(1.0, |(p, _, _)| p.distance);
                    h[((d * 1000.0) as usize).min(11)] += 1;
                }
            }
            println!("{} outline nodes by mm to femur {h:?}", block.name);
        }
        for m in &made.thigh.muscles {
            println!(
                "{} fibre_length {:.4} area {:.6} line {:?} .. {:?} s {:?} areas {:?}",
                m.name,
                m.fibre_length,
                m.fibre_area,
                m.line.first().unwrap().as_slice(),
                m.line.last().unwrap().as_slice(),
                m.s,
                m.areas
            );
            for (k, v) in &m.tied {
                let c: nalgebra::Vector3<f64> = v
                    .iter()
                    .map(|&n| nalgebra::Vector3::from(made.thigh.mesh.points[n as usize]))
                    .sum::<nalgebra::Vector3<f64>>()
                    / v.len() as f64;
                let layers: std::collections::BTreeMap<u32, usize> =
                    v.iter().fold(Default::default(), |mut m2, n| {
                        *m2.entry((n - m.first_node) / m.nodes_per_layer).or_default() += 1;
                        m2
                    });
                println!(
                    "  tied {k}: {} nodes at {:?} layers {layers:?} of {}",
                    v.len(),
                    c.as_slice(),
                    m.nodes_per_layer
                );
            }
            for t in &made.thigh.scene.ties {
                println!("  tie {} {} n {}", t.nodes, t.body, made.thigh.mesh.node_sets[&t.nodes].len());
            }
        }
    }
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, Ankle::Universal).unwrap();
    let registration = Registration::new(MeshFrames::built_in(), &model).unwrap();
    let meshed = rigid_muscles_standing(&model, &registration);
    let units: Vec<MuscleUnit> = made
        .thigh
        .muscles
        .iter()
        .map(|m| MuscleUnit::new(meshed.iter().find(|r| r.name == m.name).unwrap(), Curves::default()))
        .collect();
    let scale = registration.thigh_length() / multibody::muscle::path::GENERIC_THIGH;
    let raw = vec![Fit::default(); units.len()];
    let hill = with_laws(&made.thigh, &units, scale, &raw);
    for w in what.split(',') {
        match w {
            "raw" => {
                go("raw", &hill, &[0.5], None);
            }
            "rawfull" => {
                go("rawfull", &hill, &[1.0, 0.5], None);
            }
            "flat" => {
                let x = go("flat", &flat(&made.thigh, &units, 0.5), &[1.0], None);
                go("flat then raw", &hill, &[0.5], Some(&x));
            }
            "high" => {
                go("high", &flat(&made.thigh, &units, 0.5), &[4.0, 1.0], None);
            }
            "high1" => {
                let mut t = flat(&made.thigh, &units, 2.0);
                for _ in 0..1 {
                    t = t.clone();
                }
                let x = go("high1", &t, &[1.0], None);
                go("then flat", &flat(&made.thigh, &units, 0.5), &[1.0], Some(&x));
            }
            _ => panic!(),
        }
    }
}
