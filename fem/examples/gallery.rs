//! Squash, twist and contraction: three large deformations, written for ParaView.
//!
//! `cargo run --release -p sartorius-fem --example gallery -- out/gallery` writes `squash/squash.pvd`,
//! `twist/twist.pvd` and `contraction/contraction.pvd` with a `.vtu` file per frame; `docs/gallery.py` makes `docs/gallery.png` of their last frames.
//! Number to expect, asserted: the bar with activated fibres shortens to 0.8253 of its length.

use std::f64::consts::PI;
use std::path::Path;

use fem::material::line::FibreStrain;
use fem::mesh::Mesh;
use fem::output::run_to_files;
use fem::plan::{Load, Plan, SceneError};
use fem::run::{Drive, DriveFrame};
use fem::scene::Scene;
use fem::solve::Settings;
use fem::verification::{Ends, fibre_bar, squashed_block, turned, twisted_cylinder};

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "out/gallery".into());
    let folder = Path::new(&folder);
    let fractions = || (0..=10).map(|i| 0.1 * f64::from(i));

    let (scene, mesh) = squashed_block(10);
    simulate(folder, "squash", &scene, mesh, |plan| {
        fractions().map(|s| plan.load(&[("c", 0.5 * s)], &[])).collect()
    })?;

    let (scene, mesh) = twisted_cylinder(8, 2, 20);
    simulate(folder, "twist", &scene, mesh, |plan| {
        fractions().map(|s| plan.load(&[], &[("end", turned(1.5 * PI * s))])).collect()
    })?;

    let (scene, mesh) = fibre_bar(1, FibreStrain::Engineering, Ends::Free);
    let bar = simulate(folder, "contraction", &scene, mesh, |plan| {
        fractions().map(|s| plan.load(&[("a", s)], &[])).collect()
    })?;
    let length = bar.chunks_exact(3).map(|p| p[0]).fold(0.0, f64::max);
    assert!((length / 0.1 - 0.8253).abs() < 5e-4, "the bar is {length} m long");
    Ok(())
}

/// Carries a scene through loads, writes every frame, and returns the last positions \[m\].
fn simulate(
    folder: &Path,
    name: &str,
    scene: &Scene,
    mesh: Mesh,
    loads: impl Fn(&Plan) -> Result<Vec<Load>, SceneError>,
) -> Result<Vec<f64>, Error> {
    let plan = Plan::new(scene, mesh)?;
    let frames = loads(&plan)?.into_iter().zip(0..);
    let drive = Drive { frames: frames.map(|(load, i)| DriveFrame { time: f64::from(i), load }).collect() };
    let folder = folder.join(name);
    let mut result = run_to_files(&plan, &drive, &Settings::default(), None, &folder, name, &mut |_| {})?;
    if !result.errors.is_empty() {
        return Err(result.errors.swap_remove(0).into());
    }
    println!("{name}: {} nodes, {} frames", plan.mesh.points.len(), result.frames.len());
    Ok(result.frames.pop().ok_or("a drive without frames")?.x)
}
