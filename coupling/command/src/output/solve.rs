//! What `solve` writes: tables of what the frames measure, and `run.json`.

use std::time::Instant;

use fem::measure::{
    Cut, contact_energy, energies, nodal_forces, pair_forces, section_force, support_wrench_of, volume,
};
use fem::run::{Frame, Run};
use serde_json::json;

use super::OutputError;
use super::atomic::OutputFolder;
use super::run::{RunRecord, RunStatus};
use coupling::solve::OwnScene;

/// Cells of a row, without the time before them.
type Row = Vec<String>;

/// Writes the tables and, last of all, `run.json` into `out`, and returns the names of the files.
pub fn write_solve(
    mut out: OutputFolder,
    scene: &OwnScene,
    run: &Run,
    record: &mut RunRecord,
) -> Result<Vec<String>, OutputError> {
    let started = Instant::now();
    let plan = &scene.plan;
    let settled = "residual_N,wanted_residual_N,forces_in_play_N,iterations,least_det_f,tested_stable";
    table(&mut out, "frames.csv", settled, false, run, |frame| vec![how_settled(frame)])?;
    let sections = "cut,force_N,fx_N,fy_N,fz_N,nodes";
    table(&mut out, "sections.csv", sections, scene.cuts.is_empty(), run, |frame| {
        let of = |(name, cut): &(String, Cut)| {
            let section = section_force(plan, frame.snapshot(), cut);
            let [x, y, z] = section.total.force;
            let along = section.along(cut.normal);
            row([name], &[along, x, y, z], [section.n_nodes.to_string()])
        };
        scene.cuts.iter().map(of).collect()
    })?;
    // What the supports do to the bodies that are solved, about the origin of the mesh.
    let supports = "support,fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm";
    table(&mut out, "supports.csv", supports, scene.supports.is_empty(), run, |frame| {
        let g = nodal_forces(plan, frame.snapshot());
        let of = |(name, nodes): &(String, Vec<u32>)| {
            let w = support_wrench_of(plan, frame.snapshot(), &g, nodes, [0.0; 3]);
            row([name], &[w.force, w.moment].concat(), [])
        };
        scene.supports.iter().map(of).collect()
    })?;
    let contact = "surface,other,fx_N,fy_N,fz_N,area_mm2,standoff_mm,least_distance_mm,peak_pressure_kPa";
    table(&mut out, "contact.csv", contact, plan.contact().is_none(), run, |frame| {
        let of = |p: fem::contact::PairForce| {
            let [x, y, z] = p.wrench.force;
            let [area, standoff] = [p.area * 1e6, p.standoff * 1e3];
            let [least, peak] = [p.least_distance * 1e3, p.peak_pressure * 1e-3];
            row(p.names.each_ref(), &[x, y, z, area, standoff, least, peak], [])
        };
        pair_forces(plan, frame.snapshot(), [0.0; 3]).into_iter().map(of).collect()
    })?;
    table(&mut out, "energies.csv", "effect,energy_J", false, run, |frame| {
        let of = energies(plan, frame.snapshot()).into_iter().map(|e| (e.name, e.energy));
        let contact = plan.contact().map(|_| ("contact".to_string(), contact_energy(plan, frame.snapshot())));
        of.chain(contact).map(|(name, energy)| row([&name], &[energy], [])).collect()
    })?;
    table(&mut out, "volumes.csv", "region,volume_mm3,volume_in_mesh_mm3", false, run, |frame| {
        let of = |(name, _): &(String, usize)| {
            let (before, now) = volume(plan, frame.snapshot(), name)?;
            Some(row([name], &[now * 1e9, before * 1e9], []))
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
    super::finish(out, record, started)
}

/// A table with the time of every frame before the rows that `of` makes of it; where it `is_empty`, none.
fn table(
    out: &mut OutputFolder,
    name: &str,
    columns: &str,
    is_empty: bool,
    run: &Run,
    of: impl Fn(&Frame) -> Vec<Row>,
) -> Result<(), OutputError> {
    if is_empty {
        return out.remove(name);
    }
    out.write(name, |w| {
        let mut csv = csv::Writer::from_writer(w);
        csv.write_record(std::iter::once("time_s").chain(columns.split(',')))?;
        for frame in &run.frames {
            for row in of(frame) {
                csv.write_record(std::iter::once(frame.time.to_string()).chain(row))?;
            }
        }
        csv.flush()
    })
}

/// Names, numbers with seven significant digits, and what else there is to say.
fn row<const N: usize, const M: usize>(names: [&String; N], numbers: &[f64], rest: [String; M]) -> Row {
    let numbers = numbers.iter().map(|v| format!("{v:.6e}"));
    names.into_iter().cloned().chain(numbers).chain(rest).collect()
}

/// How a frame was settled.
fn how_settled(frame: &Frame) -> Row {
    let least = frame.islands.iter().map(|i| i.least_det_f).fold(f64::INFINITY, f64::min);
    let iterations = frame.count(|i| i.iterations);
    let [residual, wanted, in_play] =
        frame.worst().map_or([0.0; 3], |(_, i)| [i.residual, i.wanted, i.force_scale]);
    let rest = [iterations.to_string(), format!("{least:.6e}"), frame.is_tested_stable().to_string()];
    row([], &[residual, wanted, in_play], rest)
}
