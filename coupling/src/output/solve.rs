//! What `solve` writes: tables of what the frames measure, and `run.json`.

use std::io::{self, Write};
use std::time::Instant;

use fem::measure::{contact_energy, energies, pair_forces, section_force, support_wrench, volume};
use fem::plan::Motion;
use fem::run::{Frame, Run};
use serde_json::json;

use super::OutputError;
use super::atomic::OutputFolder;
use super::run::{RunRecord, RunStatus, peak_memory_mib};
use crate::solve::OwnScene;

/// Writes the tables and, last of all, `run.json` into `out`, and returns the names of the files.
pub fn write_solve(
    mut out: OutputFolder,
    scene: &OwnScene,
    run: &Run,
    mut record: RunRecord,
) -> Result<Vec<String>, OutputError> {
    let started = Instant::now();
    let plan = &scene.plan;
    out.write("frames.csv", |w| write_frames(w, run))?;
    table(
        &mut out,
        "sections.csv",
        "cut,force_N,fx_N,fy_N,fz_N,nodes",
        scene.cuts.is_empty(),
        run,
        |frame| {
            let row = |(name, cut): &(String, fem::measure::Cut)| {
                let section = section_force(plan, frame.snapshot(), cut);
                let [x, y, z] = section.total.force;
                format!("{name},{},{}", numbers(&[section.along(cut.normal), x, y, z]), section.n_nodes)
            };
            scene.cuts.iter().map(row).collect()
        },
    )?;
    let is_free = plan.bodies.is_empty() && scene.supports.is_empty();
    table(&mut out, "supports.csv", "support,fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm", is_free, run, |frame| {
        // What the supports do to the bodies that are solved, about the origin of the mesh.
        let wrench = |name: &str, nodes: &[u32]| {
            let w = support_wrench(plan, frame.snapshot(), nodes, [0.0; 3]);
            format!("{name},{},{}", numbers(&w.force), numbers(&w.moment))
        };
        let tied = |b: usize| {
            let moves = |n: &u32| plan.motion[*n as usize][0] == Motion::Body(b);
            (0..plan.motion.len() as u32).filter(moves).collect::<Vec<_>>()
        };
        let bodies = plan.bodies.iter().enumerate().map(|(b, name)| wrench(name, &tied(b)));
        bodies.chain(scene.supports.iter().map(|name| wrench(name, &plan.mesh.node_sets[name]))).collect()
    })?;
    let columns = "surface,other,fx_N,fy_N,fz_N,area_mm2,standoff_mm,least_distance_mm,peak_pressure_kPa";
    table(&mut out, "contact.csv", columns, plan.contact().is_none(), run, |frame| {
        let pairs = pair_forces(plan, frame.snapshot(), [0.0; 3]);
        let row = |p: &fem::contact::PairForce| {
            let [a, b] = &p.names;
            let rest = [p.area * 1e6, p.standoff * 1e3, p.least_distance * 1e3, p.peak_pressure * 1e-3];
            format!("{a},{b},{},{}", numbers(&p.wrench.force), numbers(&rest))
        };
        pairs.iter().map(row).collect()
    })?;
    table(&mut out, "energies.csv", "effect,energy_J", false, run, |frame| {
        let of = energies(plan, frame.snapshot()).into_iter().map(|e| (e.name, e.energy));
        let contact = plan.contact().map(|_| ("contact".to_string(), contact_energy(plan, frame.snapshot())));
        of.chain(contact).map(|(name, energy)| format!("{name},{}", numbers(&[energy]))).collect()
    })?;
    table(&mut out, "volumes.csv", "region,volume_mm3,volume_in_mesh_mm3", false, run, |frame| {
        let of = |(name, _): &(String, usize)| {
            let (before, now) = volume(plan, frame.snapshot(), name)?;
            Some(format!("{name},{}", numbers(&[now * 1e9, before * 1e9])))
        };
        plan.effects.iter().filter_map(of).collect()
    })?;
    if !run.is_solved() {
        record.status = RunStatus::NotConverged;
        record.reason = Some(run.errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "));
    }
    record.verdict = Some(json!({
        "frames_solved": run.frames.len(),
        "frames_asked": scene.drive.frames.len(),
        "frames_tested_for_stability": run.frames_tested_for_stability(),
        "nodes": plan.mesh.points.len(),
    }));
    if let Some(worst) = run.worst() {
        record.settled =
            json!({ "residual_N": worst.advance.residual, "wanted_residual_N": worst.advance.wanted });
    }
    record.notes = plan.warnings.iter().map(ToString::to_string).collect();
    record.files = out.files().to_vec();
    record.stage("write", started.elapsed());
    record.peak_memory_mib = peak_memory_mib();
    out.finish(&record)
}

/// A table with the time of every frame before the rows that `of` makes of it; where it `is_empty`, none.
fn table(
    out: &mut OutputFolder,
    name: &str,
    columns: &str,
    is_empty: bool,
    run: &Run,
    of: impl Fn(&Frame) -> Vec<String>,
) -> Result<(), OutputError> {
    if is_empty {
        return out.remove(name);
    }
    out.write(name, |w| {
        writeln!(w, "time_s,{columns}")?;
        for frame in &run.frames {
            for row in of(frame) {
                writeln!(w, "{},{row}", frame.time)?;
            }
        }
        Ok(())
    })
}

/// How every frame was settled.
fn write_frames(w: &mut dyn Write, run: &Run) -> io::Result<()> {
    writeln!(w, "time_s,residual_N,wanted_residual_N,forces_in_play_N,iterations,least_det_f,tested_stable")?;
    for frame in &run.frames {
        let worst =
            frame.islands.iter().max_by(|a, b| (a.residual / a.wanted).total_cmp(&(b.residual / b.wanted)));
        let Some(worst) = worst else {
            writeln!(w, "{},0,0,0,0,,", frame.time)?;
            continue;
        };
        let least = frame.islands.iter().map(|i| i.least_det_f).fold(f64::INFINITY, f64::min);
        let iterations: usize = frame.islands.iter().map(|i| i.iterations).sum();
        let stable = frame.islands.iter().all(|i| i.tested_stable);
        let settled = numbers(&[worst.residual, worst.wanted, worst.force_scale]);
        writeln!(w, "{},{settled},{iterations},{},{stable}", frame.time, numbers(&[least]))?;
    }
    Ok(())
}

/// Cells of a table, seven significant digits.
fn numbers(values: &[f64]) -> String {
    values.iter().map(|v| format!("{v:.6e}")).collect::<Vec<_>>().join(",")
}
