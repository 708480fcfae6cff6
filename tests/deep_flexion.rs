//! The patella in its groove from 0 to 137.5 degrees: is every frame an equilibrium, and how does it move?

use coupling::knee::anatomy::KneeAnatomy;
use coupling::knee::pose::TibiaPath;
use coupling::knee::rigid::RigidKnee;
use fem::measure::{free_bodies, pair_forces};
use fem::run::{Drive, DriveFrame, run};
use fem::scene::ContactMode;
use fem::solve::Settings;
use support::shared;

#[test]
fn scratch() {
    let anatomy = KneeAnatomy::read(&shared("anatomy/knee").unwrap()).unwrap();
    let path = TibiaPath::read(&shared("reference/deep/tibia_path_deep.csv").unwrap()).unwrap();
    let mode = if std::env::var_os("GUARDED").is_some() { ContactMode::Guarded } else { ContactMode::Cheap };
    let force: f64 = std::env::var("FORCE").map_or(200.0, |f| f.parse().unwrap());
    let knee = RigidKnee::new(&anatomy, mode).unwrap().unwrap();
    println!("lifted {:.2} mm", 1e3 * knee.lifted);
    let frames = (0..56).map(|k| {
        let flexion = 2.5 * k as f64;
        DriveFrame { time: flexion, load: knee.load(&path.at(flexion), force).unwrap() }
    });
    let drive = Drive { frames: frames.collect() };
    let start = std::time::Instant::now();
    let mut last = start.elapsed().as_secs_f64();
    let result = run(&knee.plan, &drive, &Settings::default(), None, &mut |frame| {
        let at = frame.snapshot();
        let state = free_bodies(&knee.plan, at).remove(0);
        let c = knee.coordinates(&state.pose).to_array().map(|v| (v * 100.0).round() / 100.0);
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let pressed = pair_forces(&knee.plan, at, [0.0; 3]);
        let force = pressed.first().map_or((0.0, 0.0, 0.0), |p| (norm(p.wrench.force), 1e6 * p.area, 1e3 * p.least_distance));
        let now = start.elapsed().as_secs_f64();
        let strains: Vec<f64> = knee.strands.iter().map(|(name, slack)| {
            let block = knee.plan.mesh.blocks.iter().find(|b| b.name == *name).unwrap();
            let p = |n: u32| nalgebra::Vector3::from_column_slice(&frame.x[3 * n as usize..][..3]);
            let l: f64 = block.nodes.chunks(2).map(|n| (p(n[1]) - p(n[0])).norm()).sum();
            (1e3 * (l / slack - 1.0)).round() / 1e3
        }).collect();
        println!(
            "{:6.1} {:?} it {} left {:.1e} N {:.1e} Nmm contact {:.0?} strain {:.0e} {:.2}s {:?}",
            frame.time, c, frame.count(|a| a.iterations), norm(state.residual.force), 1e3 * norm(state.residual.moment), force,
            state.strain, now - last, strains
        );
        last = now;
    });
    println!("{} frames, {:.1} s, {:?}", result.frames.len(), start.elapsed().as_secs_f64(), result.errors.first().map(|e| e.to_string()));
}
