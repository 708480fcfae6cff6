//! Squash, twist and contraction: three large deformations, written for ParaView.
//!
//! `cargo run --release -p sartorius-fem --example gallery -- out/gallery` writes `squash.pvd`, `twist.pvd` and
//! `contraction.pvd` with a `.vtu` file per frame; `docs/gallery.py` makes `docs/gallery.png` of their last frames.
//! Number to expect, asserted: the bar with activated fibres shortens to 0.8253 of its length.

use std::f64::consts::PI;
use std::path::Path;

use fem::material::line::FibreStrain;
use fem::measure::solid_field;
use fem::mesh::format::{pvd::PvdWriter, vtu::Field};
use fem::mesh::{CellKind, Mesh};
use fem::plan::{Load, Plan, SceneError};
use fem::run::{Drive, DriveFrame, Frame, run};
use fem::scene::Scene;
use fem::solve::Settings;
use fem::verification::{Ends, fibre_bar, squashed_block, turned, twisted_cylinder};

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "out/gallery".into());
    let folder = Path::new(&folder);
    let shares = || (1..=10).map(|i| 0.1 * f64::from(i));

    let (scene, mesh) = squashed_block(10);
    simulate(folder, "squash", &scene, mesh, |plan| {
        shares().map(|s| plan.load(&[("c", 0.5 * s)], &[])).collect()
    })?;

    let (scene, mesh) = twisted_cylinder(8, 2, 20);
    simulate(folder, "twist", &scene, mesh, |plan| {
        shares().map(|s| plan.load(&[], &[("end", turned(1.5 * PI * s))])).collect()
    })?;

    let (scene, mesh) = fibre_bar(1, FibreStrain::Engineering, Ends::Free);
    let bar = simulate(folder, "contraction", &scene, mesh, |plan| {
        shares().map(|s| plan.load(&[("a", s)], &[])).collect()
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
    let mut series = PvdWriter::create(folder, name)?;
    let rest = Frame { time: 0.0, load: plan.load(&[], &[])?, x: plan.reference(), islands: Vec::new() };
    write_frame(&mut series, &plan, &rest)?;
    let frames = loads(&plan)?.into_iter().zip(1..);
    let drive = Drive { frames: frames.map(|(load, i)| DriveFrame { time: f64::from(i), load }).collect() };
    let mut written = Ok(());
    let mut result = run(&plan, &drive, &Settings::default(), None, &mut |frame| {
        if written.is_ok() {
            written = write_frame(&mut series, &plan, frame);
        }
    });
    written?;
    if !result.errors.is_empty() {
        return Err(result.errors.swap_remove(0).into());
    }
    println!("{name}: {} nodes, {} frames", plan.mesh.points.len(), result.frames.len());
    Ok(result.frames.pop().map_or(rest.x, |frame| frame.x))
}

/// Displacement and, in solid cells, von Mises stress (NaN in fibres).
fn write_frame(series: &mut PvdWriter, plan: &Plan, frame: &Frame) -> Result<(), Error> {
    let displacement: Vec<f64> =
        frame.x.iter().zip(plan.reference()).map(|(x, reference)| x - reference).collect();
    let mut mises = Vec::new();
    for block in &plan.mesh.blocks {
        if block.kind == CellKind::Line2 {
            mises.extend(std::iter::repeat_n(f64::NAN, block.n_cells()));
            continue;
        }
        let cells = solid_field(plan, frame.snapshot(), &block.name).ok_or("a solid without field")?;
        mises.extend(cells.iter().map(|cell| {
            let [a, b, c] = cell.principal;
            (((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2)) / 2.0).sqrt()
        }));
    }
    let point_data = [Field::new("displacement_m", 3, &displacement)];
    series.push(frame.time, &plan.mesh, &point_data, &[Field::new("von_mises_Pa", 1, &mises)])?;
    Ok(())
}
