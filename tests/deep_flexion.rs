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
    if std::env::var_os("RUST_LOG").is_some() {
        tracing_subscriber::fmt().with_env_filter(tracing_subscriber::EnvFilter::from_default_env()).init();
    }
    let anatomy = KneeAnatomy::read(&shared("anatomy/knee").unwrap()).unwrap();
    let measured = std::env::var_os("MEASURED").is_some();
    let table =
        if measured { "reference/deep/dynamic_mri_knee.csv" } else { "reference/deep/tibia_path_deep.csv" };
    let path = TibiaPath::read(&shared(table).unwrap()).unwrap();
    let mode = if std::env::var_os("GUARDED").is_some() { ContactMode::Guarded } else { ContactMode::Cheap };
    let force: f64 = std::env::var("FORCE").map_or(200.0, |f| f.parse().unwrap());
    let knee = RigidKnee::new(&anatomy, mode).unwrap().unwrap();
    println!("lifted {:.2} mm", 1e3 * knee.lifted);
    let flexions: Vec<f64> = if measured {
        path.rows().iter().map(|r| r.flexion).collect()
    } else {
        (0..56).map(|k| 2.5 * k as f64).collect()
    };
    let frames = flexions
        .iter()
        .map(|&flexion| DriveFrame { time: flexion, load: knee.load(&path.at(flexion), force).unwrap() });
    let drive = Drive { frames: frames.collect() };
    let start = std::time::Instant::now();
    let mut last = start.elapsed().as_secs_f64();
    let (mut before, mut turned, mut shifted) = (None::<nalgebra::Isometry3<f64>>, 0.0_f64, 0.0_f64);
    let mut all = Vec::new();
    let result = run(&knee.plan, &drive, &Settings::default(), None, &mut |frame| {
        let at = frame.snapshot();
        let state = free_bodies(&knee.plan, at).remove(0);
        let pose = knee.coordinates(&state.pose).pose();
        if let Some(b) = before {
            turned = turned.max(pose.rotation.angle_to(&b.rotation).to_degrees());
            shifted = shifted.max(1e3 * (pose.translation.vector - b.translation.vector).norm());
        }
        before = Some(pose);
        let c = knee.coordinates(&state.pose).to_array().map(|v| (v * 100.0).round() / 100.0);
        all.push(c);
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let pressed = pair_forces(&knee.plan, at, [0.0; 3]);
        let force = pressed
            .first()
            .map_or((0.0, 0.0, 0.0), |p| (norm(p.wrench.force), 1e6 * p.area, 1e3 * p.least_distance));
        let now = start.elapsed().as_secs_f64();
        let strains: Vec<f64> = knee
            .strands
            .iter()
            .map(|(name, slack)| {
                let block = knee.plan.mesh.blocks.iter().find(|b| b.name == *name).unwrap();
                let p = |n: u32| nalgebra::Vector3::from_column_slice(&frame.x[3 * n as usize..][..3]);
                let l: f64 = block.nodes.chunks(2).map(|n| (p(n[1]) - p(n[0])).norm()).sum();
                (1e3 * (l / slack - 1.0)).round() / 1e3
            })
            .collect();
        println!(
            "{:6.1} {:?} it {} left {:.1e} N {:.1e} Nmm contact {:.0?} strain {:.0e} {:.2}s {:?}",
            frame.time,
            c,
            frame.count(|a| a.iterations),
            norm(state.residual.force),
            1e3 * norm(state.residual.moment),
            force,
            state.strain,
            now - last,
            strains
        );
        last = now;
    });
    let its = result.count(|a| a.iterations) as f64 / result.frames.len() as f64;
    println!(
        "{} frames, {:.1} s, {its:.1} iterations a frame, largest steps {turned:.2} deg {shifted:.2} mm, {:?}",
        result.frames.len(),
        start.elapsed().as_secs_f64(),
        result.errors.first().map(|e| e.to_string())
    );
    if measured {
        let text = std::fs::read_to_string(shared(table).unwrap()).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip(1)
            .map(|l| l.split(',').skip(8).take(6).map(|c| c.parse().unwrap()).collect())
            .collect();
        let (mut sum, n) = (0.0, all.len() as f64);
        for c in 0..6 {
            let rmsd = (all.iter().zip(&rows).map(|(a, b)| (a[c] - b[c]).powi(2)).sum::<f64>() / n).sqrt();
            let mean = rows.iter().map(|b| b[c]).sum::<f64>() / n;
            sum += rmsd / mean.abs();
            println!("coordinate {c}: RMSD {rmsd:.2}, NRMSD {:.2}, mean {mean:.2}", rmsd / mean.abs());
        }
        println!("sum {sum:.2}");
    }
}
