//! The built-in thigh with all muscles and bones, without and with guarded contact: hip flexed by 30 and knee by 15 degrees from
//! standing. `cargo run --release -p sartorius-coupling --example thigh_contact [MM] [with|without|both] [NAME,NAME,... [SHARE OF THE WAY]]`

use std::time::Instant;

use coupling::registration::{BODIES, MeshFrames, Registration};
use coupling::thigh::build::ThighEffects;
use coupling::thigh::built_in;
use fem::body::Pose;
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::solve::{Settings, Stability};
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use nalgebra::{Translation3, UnitQuaternion, Vector3};

fn main() {
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .init();
    let argument = |i: usize| std::env::args().nth(i);
    let mm: f64 = argument(1).map_or(6.0, |a| a.parse().expect("edge length in mm"));
    let which = argument(2).unwrap_or("both".into());
    let only: Vec<String> = argument(3).map_or(Vec::new(), |a| a.split(',').map(String::from).collect());
    let share: f64 = argument(4).map_or(1.0, |a| a.parse().expect("share of the way"));
    let made =
        built_in(1e-3 * mm, &only, ThighEffects { fibres: true, shells: true }).expect("built-in tables");
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, Ankle::Universal).expect("the walker has markers");
    let frames = MeshFrames::built_in();
    let registration = Registration::new(frames, &model).expect("the patella of the walker finds its place");
    let standing = registration.standing(&model);
    let mut poses =
        registration.poses_at_flexion(&model, &standing, share * 15_f64.to_radians()).expect("within reach");
    // Flexion turns the thigh forwards against the pelvis, so the pelvis backwards against the thigh.
    let medial_lateral = frames.pelvis.column(2).into_owned();
    let turn = UnitQuaternion::from_scaled_axis(medial_lateral * (share * -30_f64.to_radians()));
    let about = |p: Vector3<f64>| Translation3::from(p) * turn * Translation3::from(-p);
    poses[0] = about(frames.hip) * poses[0];

    for contact in [false, true] {
        if which == "with" && !contact || which == "without" && contact {
            continue;
        }
        let mut thigh = made.thigh.clone();
        if contact {
            thigh.add_contact(&made.bones, &made.attachments);
        }
        let clock = Instant::now();
        let plan = Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap_or_else(|e| panic!("{e}"));
        eprintln!(
            "plan {:.1} s, {} islands, repair: {} nodes, {:.2} mm, {} ignored",
            clock.elapsed().as_secs_f64(),
            plan.islands.len(),
            plan.repair.n_nodes,
            1e3 * plan.repair.farthest,
            plan.repair.n_ignored
        );
        let settings = Settings {
            tolerance: 1e-3,
            least_force: 100.0,
            max_iterations: 400,
            stability: Stability::Never,
            ..Settings::default()
        };
        let moved: Vec<(&str, Pose)> =
            BODIES.into_iter().zip(poses).filter(|(name, _)| plan.bodies.iter().any(|b| b == name)).collect();
        let mut session = Session::new(&plan, &settings, None);
        let clock = Instant::now();
        let done = session.advance(&DriveFrame { time: 1.0, load: plan.load(&[], &moved).expect("bodies") });
        for e in &done.errors {
            println!("{e}");
        }
        println!("contact {contact}: {:.1} s", clock.elapsed().as_secs_f64());
        for i in &done.frame.islands {
            println!("{i:?}");
        }
    }
}
