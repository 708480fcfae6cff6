//! What `sartorius optimize` says of a leg: on the terminal, and in the notes of its page.

use std::io::Write;
use std::path::Path;

use multibody::emg;
use multibody::sharing::KKT_TOLERANCE;

use super::arguments::{OptimizeArguments, heeded, word};
use crate::report::problems::{Mark, Run, runs};
use crate::report::{Summary, total_knee_force};
use coupling::number::plain;
use coupling::optimize::Optimized;
use coupling::subject::words;

pub(super) fn simulated(done: &Optimized) -> Vec<String> {
    let model = &done.model;
    vec![
        format!("Five segments, spherical hip, sphere-on-plane knee with isometric ACL, PCL and MCL, patella on a hinge with isometric tendon; {} markers.", model.markers.len()),
        format!("{} muscle lines of action with conditional points on {} joint coordinates.", model.muscles.len(), model.coordinate_names().len()),
        "Gravity, inertia of foot, shank, patella and thigh, and the ground reaction on the foot.".to_string(),
        "One convex force-sharing problem per frame for muscle, contact, ligament and bone forces, then Hill-type activations.".to_string(),
    ]
}

pub(super) fn left_out(arguments: &OptimizeArguments, done: &Optimized) -> Vec<(String, String)> {
    let mut list = Vec::new();
    if done.with_thigh.is_none() {
        list.push((
            "Deformable thigh".to_string(),
            "optimize is the rigid side alone; --thigh takes what its muscles can do".to_string(),
        ));
    }
    let form = arguments.form();
    if !form.passive.of_muscles() {
        list.push((
            "Passive muscle force in force sharing".to_string(),
            "muscles are lines of tension; passive force enters with the activations".to_string(),
        ));
    }
    if !form.passive.of_joints() {
        list.push(("Passive joint moments".to_string(), "not asked for (--passive)".to_string()));
    }
    if arguments.samples.is_none() {
        list.push(("Scatter of the inputs".to_string(), "not asked for (--samples)".to_string()));
    }
    if !arguments.bands {
        list.push(("Bands of joint forces".to_string(), "not asked for (--bands)".to_string()));
    }
    if arguments.reserves.is_none() {
        list.push(("Reserve moments".to_string(), "not asked for (--reserves)".to_string()));
    }
    if arguments.measured.is_some() && done.measured.is_none() && done.not_compared.is_none() {
        list.push(("Measured knee forces".to_string(), "compared with the right leg".to_string()));
    }
    list
}

/// What the reader of the page must know: the warnings, and what became of the activations.
pub(super) fn notes(done: &Optimized) -> Vec<String> {
    let mut notes = warnings(done);
    let overall = &done.hill.overall;
    notes.push(format!(
        "Activations clipped at 0 in {:.1} % of samples (mostly resting muscles with passive force, which force sharing does not know), at 1 in {:.1} %; fibre length limited in {:.1} %.",
        100.0 * overall.below_zero,
        100.0 * overall.above_one,
        100.0 * overall.length_limited
    ));
    notes
}

/// What makes these results less certain than others.
fn warnings(done: &Optimized) -> Vec<String> {
    let mut notes = done.case.doubts.clone();
    notes.extend(done.not_compared.clone());
    let mm = |v: f64| format!("{:.1}", 1e3 * v);
    if let Some(q) = &done.case.quality {
        notes.push(format!(
            "Knee and ankle axes come from motion: residual {} mm over {:.0} degrees at the knee, {} mm over {:.0} degrees at the ankle. A standing trial with landmark markers would be more certain.",
            mm(q.knee_rms),
            q.knee_range.to_degrees(),
            mm(q.ankle_rms),
            q.ankle_range.to_degrees()
        ));
        if let Some(c) = &q.knee_centre {
            let word = if c.is_plausible() {
                ""
            } else {
                " That is more than skin explains: check which marker is the patella's, and the distance."
            };
            let [back, down] = c.moved.map(mm);
            notes.push(format!(
                "The knee centre was moved {back} mm backward and {down} mm down from the functional axis, to {} mm behind the patella marker, because skin that slides moves a functional axis.{word}",
                mm(c.distance)
            ));
        }
    }
    let fits = &done.motion.fit[done.motion.report.clone()];
    let cautions: std::collections::BTreeSet<&String> =
        fits.iter().filter(|f| f.failure.is_none()).filter_map(|f| f.caution.as_ref()).collect();
    if !cautions.is_empty() {
        let list: Vec<&str> = cautions.iter().map(|c| c.as_str()).take(4).collect();
        notes.push(format!(
            "Some frames are fitted with less certainty ({}); column caution of verdicts.csv.",
            list.join("; ")
        ));
    }
    let rms = done.motion.marker_rms();
    if rms > DOUBTFUL_RESIDUAL {
        notes.push(format!(
            "The marker residual of {} mm is far above what soft tissue explains (5 to 10 mm in walking): check which marker is which, the landmarks and the hip centre.",
            mm(rms)
        ));
    }
    let unused: Vec<&str> = done
        .case
        .trial
        .markers
        .iter()
        .filter(|t| done.model.markers.iter().all(|m| m.name != t.name))
        .map(|t| t.name.as_str())
        .collect();
    if !unused.is_empty() {
        notes.push(format!(
            "Markers without a place on the model, not used in the fit: {}.",
            unused.join(", ")
        ));
    }
    notes
}

/// Marker residual that no soft tissue explains \[m\].
const DOUBTFUL_RESIDUAL: f64 = 0.025;
/// Runs of unsolved frames that are spelt out on the terminal.
const PROBLEMS_SHOWN: usize = 8;

/// The summary in words.
pub(super) fn print(
    out: &mut impl Write,
    done: &Optimized,
    summary: &Summary,
    folder: &Path,
    n_files: usize,
) -> std::io::Result<()> {
    writeln!(
        out,
        "{}: {} of {} frames solved ({}, {} ankle)",
        done.case.trial.name,
        summary.solved,
        summary.frames,
        words(&done.case.trial),
        word(done.case.ankle)
    )?;
    if let (Some(over), true) = (summary.over(), summary.solved > 0) {
        writeln!(out, "  forces and activations are over {over}, the others have no solution")?;
    }
    let show = |value: Option<f64>, unit: &str, digits: usize| {
        value.map_or("-".to_string(), |v| format!("{} {unit}", plain(v, digits)))
    };
    writeln!(out, "  marker residual        {} RMS", show(summary.marker_rms_mm, "mm", 2))?;
    writeln!(
        out,
        "  peak knee force        {} = {} at {}",
        show(summary.peak_knee_force_N, "N", 0),
        show(summary.peak_knee_force_bw, "body weights", 2),
        show(summary.peak_knee_force_time_s, "s", 3)
    )?;
    writeln!(
        out,
        "  largest force/strength {} ({})",
        show(summary.largest_load, "", 2).trim_end(),
        summary.largest_load_muscle.as_deref().unwrap_or("-")
    )?;
    writeln!(
        out,
        "  largest KKT residual   {} (tolerance {KKT_TOLERANCE:.0e})",
        summary.largest_kkt_residual.map_or("-".into(), |v| format!("{v:.1e}"))
    )?;
    writeln!(
        out,
        "  activations clipped    {}",
        show(summary.clipped_share.map(|s| 100.0 * s), "% of samples", 1)
    )?;
    if let Some(when) = summary.largest_reserve_share_time_s {
        writeln!(
            out,
            "  reserves carry         up to {:.0} % of the joint moments of a frame (at {when:.3} s); muscle and joint forces lack it:",
            100.0 * summary.largest_reserve_share
        )?;
        for r in &summary.reserves {
            writeln!(
                out,
                "    {:<20} {:>8.2} N·m at {:.3} s, {:.0} % of {:.2} N·m needed there, {:.0} % of the largest moment needed{}",
                r.coordinate,
                r.largest_Nm,
                r.time_s,
                100.0 * r.fraction,
                r.needed_Nm,
                100.0 * r.fraction_of_peak,
                if r.is_much() { ": much" } else { "" }
            )?;
        }
    }
    if let (Some(curves), Some(compared)) = (&summary.measured, summary.compared_frames) {
        writeln!(out, "  against measured knee force, over {compared} of {} frames:", summary.frames)?;
        for (name, a) in curves {
            writeln!(
                out,
                "    {name:<8} RMSE {:.0} N = {:.2} BW, 1 - SSE/SST {}, squared correlation {}, peak error {:+.0} N = {:+.2} BW",
                a.rmse_N,
                a.rmse_bw,
                a.determination.map_or("-".into(), |r| plain(r, 2)),
                a.squared_correlation.map_or("-".into(), |r| plain(r, 2)),
                a.peak_error_N,
                a.peak_error_bw
            )?;
        }
    }
    if let Some(compared) = &done.emg {
        if let Some(overall) = emg::overall(compared) {
            let n = compared.iter().filter(|c| c.defect.is_none()).count();
            writeln!(
                out,
                "  concordance with EMG   {:.0} % of frames, mean of {n} of {} channels",
                100.0 * overall,
                compared.len()
            )?;
        }
        for c in compared {
            let said = match (c.defect, c.concordance) {
                (Some(defect), _) => defect.words().to_string(),
                (None, Some(part)) => format!("{:.0} %", 100.0 * part),
                (None, None) => "-".into(),
            };
            writeln!(out, "    {:<20} {said} ({})", c.channel, c.muscles.join(" "))?;
        }
    }
    if let Some(informed) = &done.informed {
        writeln!(out, "  EMG heeded             {}", heeded(informed))?;
    }
    if let Some(with_thigh) = &done.with_thigh {
        let peak = |effort| total_knee_force(effort).unwrap_or_default().into_iter().fold(f64::NAN, f64::max);
        let between = with_thigh.capacities.between_steps();
        writeln!(out, "  with the deformable thigh: {}", with_thigh.words())?;
        writeln!(
            out,
            "    peak knee force      {:.0} N, {:.0} N without",
            peak(&with_thigh.effort),
            peak(&done.effort)
        )?;
        writeln!(
            out,
            "    between its steps    lever arms are off by up to {:.1} mm ({} at {:.2} s), bounds of forces by up to {:.0} N ({} at {:.2} s)",
            1e3 * between.arm.0,
            between.arm.1,
            between.arm.2,
            between.bound.0,
            between.bound.1,
            between.bound.2
        )?;
    }
    for note in warnings(done) {
        writeln!(out, "  note: {note}")?;
    }
    let runs = runs(&done.motion, &done.effort);
    let problems: Vec<&Run> = runs.iter().filter(|r| r.mark != Mark::Solved).collect();
    for problem in problems.iter().take(PROBLEMS_SHOWN) {
        let time = &done.effort.time;
        let (first, last) = (time[problem.frames.start], time[problem.frames.end - 1]);
        let (frames, when) = match problem.frames.len() {
            1 => ("frame", format!("{first:.3} s")),
            _ => ("frames", format!("{first:.3} to {last:.3} s")),
        };
        let (numbers, how) = (problem.numbers(), problem.mark.words());
        writeln!(out, "  {frames} {numbers} ({when}): {how}, {}", problem.why)?;
    }
    if problems.len() > PROBLEMS_SHOWN {
        let more = problems.len() - PROBLEMS_SHOWN;
        writeln!(out, "  … and {more} more such runs of frames; see verdicts.csv")?;
    }
    let seconds: f64 = done.stages.iter().map(|s| s.1.as_secs_f64()).sum();
    writeln!(
        out,
        "  computed in {seconds:.3} s; {n_files} files in {}, open report.html there",
        folder.display()
    )
}
