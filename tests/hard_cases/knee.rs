//! C7 on a real knee: the patella free in six coordinates, the tibia prescribed from 0 to 137.5 degrees.

use crate::sweeps::rapid_fraction;
use crate::{Case, Outcome, Tier};
use coupling::knee::anatomy::KneeAnatomy;
use coupling::knee::flexion::{FlexionFrame, flex};
use coupling::knee::pose::{Coordinates, TibiaPath, read_measured};
use coupling::knee::rigid::{ReferencePose, RigidKnee};
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
/// Row of the measured poses that is the reference pose: the one nearest to extension that is a mean of more than two frames.
const REFERENCE: usize = 1;
const MEASURED: &str = "reference/deep/dynamic_mri_knee.csv";

/// The knee of the folder and its measured poses.
struct Subject {
    anatomy: KneeAnatomy,
    rows: Vec<[Coordinates; 2]>,
}

impl Subject {
    /// `None`: its data are absent.
    fn read() -> Result<Option<Subject>, String> {
        let (Some(folder), Some(table)) = (shared("anatomy/knee"), shared(MEASURED)) else { return Ok(None) };
        let anatomy = KneeAnatomy::read(&folder).map_err(|e| e.to_string())?;
        let rows = read_measured(&table).map_err(|e| e.to_string())?;
        Ok(Some(Subject { anatomy, rows }))
    }

    fn knee(&self, mode: ContactMode) -> Result<RigidKnee, String> {
        let [tibia, patella] = self.rows[REFERENCE];
        let reference = ReferencePose { tibia, patella };
        RigidKnee::new(&self.anatomy, &reference, mode).map_err(|e| e.to_string())
    }
}

fn bent(mode: ContactMode, quadriceps: f64) -> Outcome {
    let (Some(subject), Some(table)) = (Subject::read()?, shared("reference/deep/tibia_path_deep.csv"))
    else {
        return Ok("not run: its data are absent".to_string());
    };
    let knee = subject.knee(mode)?;
    let path = TibiaPath::read(&table).map_err(|e| e.to_string())?;
    let poses: Vec<Coordinates> = (0..56).map(|k| path.at(2.5 * f64::from(k))).collect();
    let (frames, error) = flex(&knee, &poses, quadriceps, &Settings::default());
    if let Some(error) = error {
        return Err(format!("{} frames, then {error}", frames.len()));
    }
    let norm = |v: [f64; 3]| Vector3::from(v).norm();
    let most = |of: &dyn Fn(&FlexionFrame) -> f64| frames.iter().map(of).fold(0.0, f64::max);
    let left = [most(&|f| norm(f.residual.force)), most(&|f| 1e3 * norm(f.residual.moment))];
    let steps = frames.windows(2).map(|w| w[1].step_from(&w[0]));
    let step = steps.fold([0.0_f64; 2], |most, step| [0, 1].map(|c| most[c].max(step[c])));
    let iterations = frames.iter().map(|f| f.iterations).sum::<usize>() as f64 / frames.len() as f64;
    let forces: Vec<f64> =
        frames.iter().map(|f| f.contact.as_ref().map_or(0.0, |c| norm(c.wrench.force))).collect();
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
        most(&|f| f.contact.as_ref().map_or(0.0, |c| norm(c.wrench.force))),
        100.0 * chatter,
        gain(0, 36)
    );
    let within = |found: [f64; 2], bar: [f64; 2]| found[0] <= bar[0] && found[1] <= bar[1];
    let good = within(left, RESIDUAL) && within(step, STEP) && iterations <= ITERATIONS && chatter < CHATTER;
    if good { Ok(text) } else { Err(text) }
}

/// The measured poses of the tibia imposed: RMSD of the patella by coordinate, in brackets over the mean of the measured values.
fn measured() -> Outcome {
    const BARS: [f64; 6] = [5.0, 1.5, 3.0, 3.5, 2.0, 2.0];
    const NAMES: [&str; 6] = ["flexion", "rotation", "tilt", "forward", "up", "sideways"];
    let Some(subject) = Subject::read()? else { return Ok("not run: its data are absent".to_string()) };
    let (knee, rows) = (subject.knee(Cheap)?, &subject.rows);
    let poses: Vec<Coordinates> = rows.iter().map(|row| row[0]).collect();
    let (frames, error) = flex(&knee, &poses, 50.0, &Settings::default());
    if let Some(error) = error {
        return Err(format!("{} frames, then {error}", frames.len()));
    }
    let (mut sum, mut good, mut parts) = (0.0, true, Vec::new());
    for c in 0..6 {
        let n = rows.len() as f64;
        let off = frames.iter().zip(rows).map(|(f, row)| f.patella.to_array()[c] - row[1].to_array()[c]);
        let rmsd = (off.map(|d| d * d).sum::<f64>() / n).sqrt();
        let mean = rows.iter().map(|row| row[1].to_array()[c]).sum::<f64>() / n;
        sum += rmsd / mean.abs();
        good &= rmsd <= BARS[c];
        parts.push(format!("{} {rmsd:.2} ({:.2})", NAMES[c], rmsd / mean.abs()));
    }
    let text = format!("RMSD in degrees and mm (NRMSD): {}; sum {sum:.2}", parts.join(", "));
    if good && sum <= 3.0 { Ok(text) } else { Err(text) }
}
