//! C7 on a real knee: the patella free in six coordinates, the tibia prescribed from 0 to 137.5 degrees.

#![allow(non_snake_case)]

use crate::sweeps::rapid_fraction;
use crate::{Case, Outcome, Tier};
use coupling::knee::anatomy::Bone;
use coupling::knee::deep::{DeepFlexion, Deviation, deviations, nrmsd_sum};
use coupling::knee::flexion::{Bent, FlexionFrame, flex};
use coupling::knee::muscles::Resolution;
use coupling::knee::pose::Coordinates;
use coupling::knee::rigid::Quadriceps;
use fem::scene::ContactMode;
use fem::solve::Settings;
use nalgebra::{Isometry3, Matrix4, Point3, UnitQuaternion, Vector3, Vector4};
use support::shared;

/// A case that takes seconds, and one minutes.
const fn full(id: &'static str, title: &'static str, run: fn() -> Outcome) -> Case {
    Case { id, title, tier: Tier::Full, run }
}

#[rustfmt::skip]
pub const CASES: &[Case] = &[
    full("C7", "patella of a real knee, 200 N, cheap", || bent(Cheap, 200.0)),
    full("C7", "patella of a real knee, 200 N, guarded", || bent(Guarded, 200.0)),
    full("C7", "patella of a real knee, 1000 N, cheap", || bent(Cheap, 1e3)),
    full("C7", "patella of a real knee, 1000 N, guarded", || bent(Guarded, 1e3)),
    full("C7j", "patella of a real knee neither jumps nor chatters, 200 N, cheap", || smooth(Cheap, 200.0)),
    full("C7j", "patella of a real knee neither jumps nor chatters, 200 N, guarded", || smooth(Guarded, 200.0)),
    full("C7j", "patella of a real knee neither jumps nor chatters, 1000 N, cheap", || smooth(Cheap, 1e3)),
    full("C7j", "patella of a real knee neither jumps nor chatters, 1000 N, guarded", || smooth(Guarded, 1e3)),
    full("C7t", "patella of a real knee, its quadriceps as tissue, vasti embedded, to 137.5 degrees", tissue),
    full("C7m", "patella of a real knee against its measured poses, 50 N", measured),
];
use ContactMode::{Cheap, Guarded};

/// What is left of forces \[N\] and moments \[N mm\] on the patella at most.
const RESIDUAL: [f64; 2] = [0.01, 0.1];
/// Turn \[degrees\] and shift \[mm\] from frame to frame at most.
const STEP: [f64; 2] = [3.0, 2.5];
const ITERATIONS: f64 = 10.0;
const CHATTER: f64 = 0.02;

/// The knee of the folder and its measured poses; `None`: its data are absent.
fn subject() -> Result<Option<DeepFlexion>, String> {
    let (Some(folder), Some(_)) = (shared("anatomy"), shared("reference/deep")) else { return Ok(None) };
    DeepFlexion::find(&folder).map(Some).map_err(|e| e.to_string())
}

/// Pairs of triangles of both cartilages that intersect, over all frames.
fn crossings(subject: &DeepFlexion, frames: &[FlexionFrame]) -> usize {
    let patellas: Vec<Coordinates> = frames.iter().map(|f| f.patella).collect();
    subject.crossings(&patellas).iter().sum()
}

fn bent(mode: ContactMode, quadriceps: f64) -> Outcome {
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let knee = subject.knee(mode).map_err(|e| e.to_string())?;
    let poses = subject.poses(0.0);
    let Bent { knee, frames, stopped, .. } = flex(knee, &poses, quadriceps, &Settings::default());
    if let Some(stopped) = stopped {
        return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
    }
    let crossed: usize = match mode {
        Cheap => 0,
        Guarded => crossings(&subject, &frames),
    };
    let norm = |v: [f64; 3]| Vector3::from(v).norm();
    let most = |of: &dyn Fn(&FlexionFrame) -> f64| frames.iter().map(of).fold(0.0, f64::max);
    let left = [most(&|f| norm(f.residual.force)), most(&|f| 1e3 * norm(f.residual.moment))];
    let steps = frames.windows(2).map(|w| w[1].step_from(&w[0]));
    let step = steps.fold([0.0_f64; 2], |most, step| [0, 1].map(|c| most[c].max(step[c])));
    let iterations = frames.iter().map(|f| f.iterations).sum::<usize>() as f64 / frames.len() as f64;
    let forces: Vec<f64> = frames.iter().map(|f| f.contact.force.norm()).collect();
    let chatter = rapid_fraction(&forces);
    let gain = |a: usize, b: usize| {
        (frames[b].patella.flexion - frames[a].patella.flexion) / (poses[b].flexion - poses[a].flexion)
    };
    let text = format!(
        "{} frames, {iterations:.1} iterations each; left {:.0e} N and {:.0e} N mm; largest step {:.2} degrees and {:.2} mm; contact {:.0} to {:.0} N, \
         rapid fraction {:.2} %; patellar flexion gains {:.2} of 0 to 90 degrees",
        frames.len(),
        left[0],
        left[1],
        step[0],
        step[1],
        forces.iter().fold(f64::MAX, |m, f| m.min(*f)),
        most(&|f| f.contact.force.norm()),
        100.0 * chatter,
        gain(0, 36)
    );
    let within = |found: [f64; 2], bar: [f64; 2]| found[0] <= bar[0] && found[1] <= bar[1];
    let text = if crossed > 0 { format!("{text}; {crossed} pairs of triangles intersect") } else { text };
    let good = crossed == 0
        && within(left, RESIDUAL)
        && within(step, STEP)
        && iterations <= ITERATIONS
        && chatter < CHATTER;
    if good { Ok(text) } else { Err(text) }
}

/// Quadriceps as tissue, as coarse as the shipped scene: equilibria to the end, nothing through anything, nothing turned over.
fn tissue() -> Outcome {
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let resolution = Resolution { edge: 10e-3, cell: Some(20e-3) };
    let knee = subject.knee_with(Guarded, Quadriceps::Tissue(resolution)).map_err(|e| e.to_string())?;
    let poses = subject.poses(25.0);
    let Bent { knee, frames, stopped, .. } = flex(knee, &poses, 0.0, &Settings::default());
    if let Some(stopped) = stopped {
        return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
    }
    let norm = |v: [f64; 3]| Vector3::from(v).norm();
    let most = |of: &dyn Fn(&FlexionFrame) -> f64| frames.iter().map(of).fold(0.0, f64::max);
    let left = [most(&|f| norm(f.residual.force)), most(&|f| 1e3 * norm(f.residual.moment))];
    let states = || frames.iter().filter_map(|f| f.muscles);
    let [heads, femur] = [0, 1].map(|k| states().map(|m| m.crossings[k]).sum::<usize>());
    let volume = states().map(|m| m.least_volume).fold(f64::INFINITY, f64::min);
    let det_f = frames.iter().map(|f| f.least_det_f).fold(f64::INFINITY, f64::min);
    let cartilage = crossings(&subject, &frames);
    let iterations = frames.iter().map(|f| f.iterations).sum::<usize>() as f64 / frames.len() as f64;
    let text = format!(
        "{} frames, {iterations:.1} iterations each; left {:.0e} N and {:.0e} N mm; pairs of triangles that intersect: {heads} of heads, {femur} of a head and the femur, \
         {cartilage} of cartilages; least volume of a cell {volume:.2}, least det F {det_f:.2}",
        frames.len(),
        left[0],
        left[1]
    );
    let good =
        heads + femur + cartilage == 0 && left[0] < RESIDUAL[0] && left[1] < RESIDUAL[1] && det_f > 0.0;
    if good { Ok(text) } else { Err(text) }
}

/// Flexion from frame to frame \[degrees\]: that of the published bars, and half of it.
const STRIDES: [f64; 2] = [2.5, 1.25];
/// Mean edge of the surfaces of cartilage \[mm\]: what hops from facet to facet goes so far at once.
const FACET: f64 = 0.76;
/// Strands of the ligament: springs of the knee whose ends they have, with their stiffness \[N/mm\].
const LIGAMENT: [(&str, f64); 6] =
    [("PT1", 86.5), ("PT5", 86.5), ("PT3", 139.0), ("PT4", 139.0), ("PT6", 100.5), ("PT2", 100.5)];

/// Whether steps and forces are those of a smooth way. The published bars ask it of the size of a step and of the spectrum of a curve, which also see
/// how fast the tibia takes the patella along, and that a curve ends with a slope. Here what the tibia prescribes is taken off each step, and the
/// smoothed curve off the force; at half the stride, where a jump would be as great as before.
fn smooth(mode: ContactMode, quadriceps: f64) -> Outcome {
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let ends = ligament(&subject);
    let mut found = Vec::new();
    let mut crossed = 0;
    for stride in STRIDES {
        let n = (137.5 / stride) as usize;
        let poses: Vec<Coordinates> = (0..=n).map(|k| subject.path.at(k as f64 * stride)).collect();
        let knee = subject.knee(mode).map_err(|e| e.to_string())?;
        let Bent { knee, frames, stopped, .. } = flex(knee, &poses, quadriceps, &Settings::default());
        if let Some(stopped) = stopped {
            return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
        }
        if mode == Guarded {
            crossed += crossings(&subject, &frames);
        }
        let steps = frames.windows(2).map(|w| (w[1].step_from(&w[0])[1], prescribed(&w[0], &w[1], &ends)));
        // Of the longest step, and of the one that has most left.
        let longest = steps.clone().max_by(|a, b| a.0.total_cmp(&b.0)).expect("frames");
        let free = steps.map(|(step, of)| (step - of).abs()).fold(0.0, f64::max);
        let forces: Vec<f64> = frames.iter().map(|f| f.contact.force.norm()).collect();
        found.push((longest, free, off_smooth(&forces)));
    }
    let parts: Vec<String> = (STRIDES.iter().zip(&found))
        .map(|(stride, ((step, of), free, off))| {
            format!(
                "every {stride} degrees: longest step {step:.2} mm, {of:.2} of it prescribed, at most {free:.2} mm not; {:.2} % of the contact force off its smoothed curve",
                100.0 * off
            )
        })
        .collect();
    let text = format!("{}; {crossed} pairs of triangles intersect", parts.join("; "));
    let halves = |k: usize| found[k].1 <= FACET * STRIDES[k] / STRIDES[0];
    if crossed == 0 && halves(0) && halves(1) && found[1].2 < CHATTER { Ok(text) } else { Err(text) }
}

/// Ends of the ligament at tibia and patella in their own frames \[m\], means of its strands by stiffness.
fn ligament(subject: &DeepFlexion) -> [Point3<f64>; 2] {
    let anatomy = &subject.anatomy;
    [Bone::Tibia, Bone::Patella].map(|bone| {
        let own = anatomy.frame(bone).inverse();
        let end = |(name, k): &(&str, f64)| {
            let spring = anatomy.springs.iter().find(|s| s.name == *name).expect("a strand has it");
            let (_, at) = spring.ends.iter().find(|e| e.0 == bone).expect("from the tibia to the patella");
            *k * (own * at).coords
        };
        let all: f64 = LIGAMENT.iter().map(|l| l.1).sum();
        Point3::from(LIGAMENT.iter().map(end).sum::<Vector3<f64>>() / all)
    })
}

/// How far \[mm\] the patella would have to go on its way from one frame to the next for its ligament to keep its length: what the tibia prescribes.
/// Nothing of the solver is in it but the way.
fn prescribed(from: &FlexionFrame, to: &FlexionFrame, [tubercle, apex]: &[Point3<f64>; 2]) -> f64 {
    let [a, b] = [from, to].map(|f| f.patella.pose());
    let turn = (a.rotation.inverse() * b.rotation).scaled_axis();
    let shift = b.translation.vector - a.translation.vector;
    let tibia = to.tibia.pose() * tubercle;
    let kept = (from.tibia.pose() * tubercle - a * apex).norm();
    let longer = |s: f64| {
        let pose = Isometry3::from_parts(
            (a.translation.vector + s * shift).into(),
            a.rotation * UnitQuaternion::from_scaled_axis(s * turn),
        );
        (tibia - pose * apex).norm() - kept
    };
    // The ligament is the longer the less far the patella has gone: from where it is to half as far again.
    let (mut lo, mut hi) = (0.0, 1.5);
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if longer(middle) > 0.0 { lo = middle } else { hi = middle }
    }
    1e3 * lo * shift.norm()
}

/// The most that a curve is off itself smoothed, over its value there. Smoothed: cubics through nine values by least squares, those at the ends
/// through the first and last nine (Savitzky & Golay, Anal Chem 36:1627, 1964).
fn off_smooth(curve: &[f64]) -> f64 {
    const WINDOW: usize = 9;
    let off = |i: usize| {
        let first = i.saturating_sub(WINDOW / 2).min(curve.len() - WINDOW);
        let power = |j: usize, p: usize| (j as f64 - i as f64).powi(p as i32);
        let (mut A, mut b) = (Matrix4::zeros(), Vector4::zeros());
        for j in first..first + WINDOW {
            let row = Vector4::from_fn(|p, _| power(j, p));
            A += row * row.transpose();
            b += curve[j] * row;
        }
        let smoothed = A.try_inverse().expect("nine places").row(0).transpose().dot(&b);
        ((curve[i] - smoothed) / curve[i]).abs()
    };
    (0..curve.len()).map(off).fold(0.0, f64::max)
}

/// The measured poses of the tibia imposed: RMSD of the patella by coordinate, in brackets over the mean of the measured values.
fn measured() -> Outcome {
    const BARS: [f64; 6] = [5.0, 1.5, 3.0, 3.5, 2.0, 2.0];
    const NAMES: [&str; 6] = ["flexion", "rotation", "tilt", "forward", "up", "sideways"];
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let (knee, rows) = (subject.knee(Cheap).map_err(|e| e.to_string())?, &subject.measured);
    let poses: Vec<Coordinates> = rows.rows.iter().map(|row| row[0]).collect();
    let Bent { knee, frames, stopped, .. } = flex(knee, &poses, 50.0, &Settings::default());
    if let Some(stopped) = stopped {
        return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
    }
    let all = deviations(&frames, rows);
    let sum = nrmsd_sum(&all).ok_or("a mean of the measured poses is zero")?;
    let good = (0..6).all(|c| all[c].rmsd <= BARS[c]);
    let part = |of: Deviation| format!("{:.2} ({:.2})", of.rmsd, of.nrmsd.expect("there is a sum"));
    let parts: Vec<String> = (0..6).map(|c| format!("{} {}", NAMES[c], part(all[c]))).collect();
    let text = format!("RMSD in degrees and mm (NRMSD): {}; sum {sum:.2}", parts.join(", "));
    if good && sum <= 3.0 { Ok(text) } else { Err(text) }
}
