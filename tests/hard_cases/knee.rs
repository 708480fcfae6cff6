//! C7 on a real knee: the patella free in six coordinates, the tibia prescribed from 0 to 137.5 degrees.

use crate::sweeps::rapid_fraction;
use crate::{Case, Outcome, Tier};
use coupling::knee::deep::{DeepFlexion, deviations};
use coupling::knee::flexion::{Bent, FlexionFrame, flex};
use coupling::knee::pose::Coordinates;
use fem::scene::ContactMode;
use fem::solve::Settings;
use nalgebra::Vector3;
use support::shared;

pub const CASES: &[Case] = &[
    Case {
        id: "C7",
        title: "patella of a real knee, 200 N, cheap",
        tier: Tier::Full,
        run: || bent(Cheap, 200.0),
    },
    Case {
        id: "C7",
        title: "patella of a real knee, 200 N, guarded",
        tier: Tier::Full,
        run: || bent(Guarded, 200.0),
    },
    Case {
        id: "C7",
        title: "patella of a real knee, 1000 N, cheap",
        tier: Tier::Full,
        run: || bent(Cheap, 1e3),
    },
    Case {
        id: "C7",
        title: "patella of a real knee, 1000 N, guarded",
        tier: Tier::Full,
        run: || bent(Guarded, 1e3),
    },
    Case {
        id: "C7m",
        title: "patella of a real knee against its measured poses, 50 N",
        tier: Tier::Full,
        run: measured,
    },
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

fn bent(mode: ContactMode, quadriceps: f64) -> Outcome {
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let knee = subject.knee(mode).map_err(|e| e.to_string())?;
    let poses = subject.poses();
    let Bent { frames, stopped, .. } = flex(&knee, &poses, quadriceps, &Settings::default());
    if let Some(stopped) = stopped {
        return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
    }
    let crossed: usize = match mode {
        Cheap => 0,
        Guarded => frames.iter().map(|f| subject.crossings(&f.patella)).sum(),
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

/// The measured poses of the tibia imposed: RMSD of the patella by coordinate, in brackets over the mean of the measured values.
fn measured() -> Outcome {
    const BARS: [f64; 6] = [5.0, 1.5, 3.0, 3.5, 2.0, 2.0];
    const NAMES: [&str; 6] = ["flexion", "rotation", "tilt", "forward", "up", "sideways"];
    let Some(subject) = subject()? else { return Ok("not run: its data are absent".to_string()) };
    let (knee, rows) = (subject.knee(Cheap).map_err(|e| e.to_string())?, &subject.measured);
    let poses: Vec<Coordinates> = rows.iter().map(|row| row[0]).collect();
    let Bent { frames, stopped, .. } = flex(&knee, &poses, 50.0, &Settings::default());
    if let Some(stopped) = stopped {
        return Err(format!("{} frames, then {}", frames.len(), stopped.told(&knee)));
    }
    let all = deviations(&frames, rows);
    let (sum, good) = (all.iter().map(|a| a[1]).sum::<f64>(), (0..6).all(|c| all[c][0] <= BARS[c]));
    let parts: Vec<String> =
        (0..6).map(|c| format!("{} {:.2} ({:.2})", NAMES[c], all[c][0], all[c][1])).collect();
    let text = format!("RMSD in degrees and mm (NRMSD): {}; sum {sum:.2}", parts.join(", "));
    if good && sum <= 3.0 { Ok(text) } else { Err(text) }
}
