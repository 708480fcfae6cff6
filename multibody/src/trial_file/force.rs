//! Ground reaction: which samples of which plate belong to the foot under study.

#![allow(non_snake_case)]

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::recorded::Recorded;
use super::{PlateColumns, TrialFile};
use crate::error::{InputError, Mistakes, Place};
use crate::natural::SegmentId;
use crate::read::{self, MarkerRecording, TimeSeries};
use crate::trial::{GroundReaction, MarkerTrack};

/// Shorter loads are spikes, not steps \[s\].
const SHORTEST_STEP: f64 = 0.05;
/// Farthest that the centre of pressure may be from the nearest foot marker, horizontally, over half a step \[m\].
/// The toes reach about 0.15 m beyond a marker on the instep; the other foot is twice as far away.
const FOOT_REACH: f64 = 0.2;
/// No step of a human exceeds this, in body weights.
const LARGEST_STEP: f64 = 8.0;
/// Farthest that a plate may be from the origin \[m\].
const LARGEST_LAB: f64 = 1e3;
const GRAVITY: f64 = 9.81;

/// Load of one plate on whatever stands on it, in ground axes.
pub(super) struct PlateSignal {
    number: usize,
    file: PathBuf,
    time: Vec<f64>,
    /// \[N\]
    force: Vec<Vector3<f64>>,
    /// About the origin of ground \[N·m\].
    moment: Vec<Vector3<f64>>,
    /// On the surface \[m\]; where there is no vertical force, anywhere.
    point: Vec<Vector3<f64>>,
}

/// One contact of the foot under study: plate (index) and samples.
pub(super) struct Step {
    plate: usize,
    contact: Range<usize>,
    /// Samples that are used: up to half way to the next load on the plate.
    window: Range<usize>,
}

/// Reads the named plates; those that cannot be used are left out and noted.
pub(super) fn plates(
    file: &TrialFile,
    recorded: &Recorded,
    data: Option<&Path>,
    wrong: &mut Mistakes,
) -> Vec<PlateSignal> {
    // `check` looks at the recordings of a file that has mistakes, too.
    if wrong.keep(file.check_plates()).is_none() {
        return Vec::new();
    }
    let mut numbers = file.force.plates.clone();
    numbers.extend(file.force.next_plate);
    numbers.sort_unstable();
    numbers.dedup();
    let table = match &file.force.file {
        Some(given) => {
            let read = |path: PathBuf| Ok((read::read_series(&path)?, path));
            match wrong.keep(file.find(given, data).and_then(read)) {
                Some(table) => Some(table),
                None => return Vec::new(),
            }
        }
        None => None,
    };
    let read = |number: usize| {
        let mut signal = match &table {
            Some((series, path)) => from_table(file, series, path, number)?,
            None => from_c3d(file, recorded, number)?,
        };
        if file.force.on_plate {
            signal.force.iter_mut().chain(&mut signal.moment).for_each(|v| *v = -*v);
        }
        plausible(file, &signal)?;
        Ok(signal)
    };
    numbers.into_iter().filter_map(|number| wrong.keep(read(number))).collect()
}

fn from_c3d(file: &TrialFile, recorded: &Recorded, number: usize) -> Result<PlateSignal, InputError> {
    let Some(c3d) = &recorded.c3d else {
        return Err(file.bad_value(
            "[force]",
            "without `file`",
            "the motion file has no force plates; name the file with the forces",
        ));
    };
    let Some(plate) = c3d.plates.iter().find(|p| p.number == number) else {
        let known: Vec<String> = c3d.plates.iter().map(|p| p.number.to_string()).collect();
        let remedy = format!("the recording has the plates {}", known.join(", "));
        return Err(file.bad_value("plates", number, &remedy));
    };
    let turn = file.axes.rotation();
    let loads = plate.loads(&recorded.path, &c3d.analog)?;
    let (R, centre) = (plate.axes(), plate.centre());
    let point = |l| plate.centre_of_pressure(l).map_or(centre, |p| p);
    Ok(PlateSignal {
        number,
        file: recorded.path.clone(),
        time: c3d.analog.time.clone(),
        force: loads.iter().map(|l| turn * (R * l.force)).collect(),
        moment: loads.iter().map(|l| turn * (R * l.moment + centre.cross(&(R * l.force)))).collect(),
        point: loads.iter().map(|l| turn * point(l)).collect(),
    })
}

fn from_table(
    file: &TrialFile,
    series: &TimeSeries,
    path: &Path,
    number: usize,
) -> Result<PlateSignal, InputError> {
    let Some(names) = file.force.columns.iter().find(|c| c.plate == number) else {
        return Err(file.bad_value("plates", number, "name its columns in [[force.columns]]"));
    };
    let turn = file.force.axes.unwrap_or(file.axes).rotation();
    let PlateColumns { force, point, moment, .. } = names;
    let mut used = HashSet::new();
    if let Some(twice) = force.iter().chain(point).chain(moment.iter().flatten()).find(|c| !used.insert(*c)) {
        let remedy = format!("plate {number} uses that column twice; name another one");
        return Err(file.bad_value(twice, "repeated", &remedy));
    }
    let [force, point] = [vectors(file, series, path, force)?, vectors(file, series, path, point)?]
        .map(|v| v.into_iter().map(|v| turn * v).collect::<Vec<_>>());
    let free = match moment {
        Some(names) => vectors(file, series, path, names)?,
        None => vec![Vector3::zeros(); series.time.len()],
    };
    let moment = point.iter().zip(&force).zip(free).map(|((p, f), t)| p.cross(f) + turn * t).collect();
    Ok(PlateSignal { number, file: path.to_path_buf(), time: series.time.clone(), force, moment, point })
}

fn vectors(
    file: &TrialFile,
    series: &TimeSeries,
    path: &Path,
    names: &[String; 3],
) -> Result<Vec<Vector3<f64>>, InputError> {
    let mut wrong = Mistakes::default();
    let mut column = |name: &String| {
        wrong.keep(series.column(name).ok_or_else(|| InputError::UnknownName {
            file: file.path.clone(),
            line: file.line_of(name),
            name: name.clone(),
            within: path.to_path_buf(),
            nearest: series.nearest(name),
        }))
    };
    let [x, y, z] = [column(&names[0]), column(&names[1]), column(&names[2])];
    wrong.finish()?;
    let (Some(x), Some(y), Some(z)) = (x, y, z) else { return Ok(Vec::new()) };
    Ok((0..x.len()).map(|i| Vector3::new(x[i], y[i], z[i])).collect())
}

/// Refuses forces that no human makes, and forces that pull the foot down.
fn plausible(file: &TrialFile, plate: &PlateSignal) -> Result<(), InputError> {
    let weight = file.subject.mass_kg * GRAVITY;
    let wrong = |problem: String, remedy: &str| {
        Err(InputError::WrongForce { file: plate.file.clone(), problem, remedy: remedy.to_string() })
    };
    let within = |v: &Vector3<f64>, limit: f64| v.iter().all(|c| c.abs() <= limit); // false for NaN
    for (i, (force, point)) in plate.force.iter().zip(&plate.point).enumerate() {
        if !within(force, LARGEST_STEP * weight) {
            let problem = format!(
                "plate {} at {:.4} s: force ({:.0}, {:.0}, {:.0}) N is beyond {LARGEST_STEP} body weights of {weight:.0} N",
                plate.number, plate.time[i], force.x, force.y, force.z
            );
            return wrong(problem, "forces must be in N, `mass_kg` in kg");
        }
        let far = force.y > file.filter.contact_threshold && !within(point, LARGEST_LAB);
        if far || !within(&plate.moment[i], LARGEST_LAB * LARGEST_STEP * weight) {
            let problem = format!(
                "plate {} at {:.4} s: the force acts at ({:.1}, {:.1}, {:.1}) m",
                plate.number, plate.time[i], point.x, point.y, point.z
            );
            return wrong(problem, "points of application must be in m, moments in N m");
        }
    }
    let (low, high) = plate.force.iter().fold((0.0f64, 0.0f64), |(a, b), f| (a.min(f.y), b.max(f.y)));
    if -low > 3.0 * high && -low > 0.2 * weight {
        let problem = format!(
            "plate {}: the vertical force runs from {low:.0} to {high:.0} N, so the ground pulls",
            plate.number
        );
        return wrong(
            problem,
            "set `on_plate = true` where the file holds the force of the foot on the plate, or correct the axes",
        );
    }
    Ok(())
}

/// Runs of samples above the threshold that last long enough.
fn contacts(plate: &PlateSignal, threshold: f64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut start = None;
    for i in 0..=plate.time.len() {
        let loaded = plate.force.get(i).is_some_and(|f| f.y > threshold);
        match (start, loaded) {
            (None, true) => start = Some(i),
            (Some(first), false) => {
                if plate.time[i - 1] - plate.time[first] >= SHORTEST_STEP {
                    runs.push(first..i);
                }
                start = None;
            }
            _ => {}
        }
    }
    runs
}

/// Contacts of the foot under study on the plates, by time. Each named plate must have one.
pub(super) fn steps(
    file: &TrialFile,
    plates: &[PlateSignal],
    recording: &MarkerRecording,
    markers: &[MarkerTrack],
    wrong: &mut Mistakes,
) -> Option<Vec<Step>> {
    let before = wrong.len();
    let threshold = file.filter.contact_threshold;
    let foot: Vec<&MarkerTrack> = markers.iter().filter(|t| t.segment == SegmentId::Foot).collect();
    let mut steps = Vec::new();
    for (index, plate) in plates.iter().enumerate() {
        let runs = contacts(plate, threshold);
        if runs.is_empty() {
            let peak = plate.force.iter().map(|f| f.y).fold(0.0, f64::max);
            wrong.note(InputError::NoContact {
                file: plate.file.clone(),
                plate: plate.number,
                peak,
                threshold,
            });
            continue;
        }
        let reach: Vec<Option<f64>> =
            runs.iter().map(|run| distance_to_foot(plate, run, recording, &foot)).collect();
        let own = |r: &Option<f64>| r.is_some_and(|d| d < FOOT_REACH);
        if !reach.iter().any(own) {
            wrong.note(match reach.iter().flatten().copied().reduce(f64::min) {
                Some(distance) => InputError::WrongFoot {
                    file: plate.file.clone(),
                    plate: plate.number,
                    side: file.subject.side.name(),
                    distance,
                },
                None => unseen_foot(file, plates, recording, plate, &runs),
            });
            continue;
        }
        for (k, run) in runs.iter().enumerate().filter(|(k, _)| own(&reach[*k])) {
            let from = k.checked_sub(1).map_or(0, |j| (runs[j].end + run.start) / 2);
            let to = runs.get(k + 1).map_or(plate.time.len(), |next| (run.end + next.start) / 2);
            steps.push(Step { plate: index, contact: run.clone(), window: from..to });
        }
    }
    steps.sort_by(|a, b| {
        plates[a.plate].time[a.contact.start].total_cmp(&plates[b.plate].time[b.contact.start])
    });
    (wrong.len() == before).then_some(steps)
}

/// A contact of the foot under study with a plate.
pub(super) struct Contact {
    /// Number of the plate.
    pub plate: usize,
    /// First time \[s\].
    pub start: f64,
    /// Last time \[s\].
    pub end: f64,
    /// Whether its begin is seen while the foot is on no other plate: a heel strike.
    pub whole: bool,
}

/// Every contact of the foot with every plate, by time.
pub(super) fn contacts_of_the_foot(
    file: &TrialFile,
    plates: &[PlateSignal],
    recording: &MarkerRecording,
    markers: &[MarkerTrack],
) -> Vec<Contact> {
    let mut contacts = Vec::new();
    for plate in plates {
        let own = std::slice::from_ref(plate);
        for step in steps(file, own, recording, markers, &mut Mistakes::default()).unwrap_or_default() {
            let (start, end) = (plate.time[step.contact.start], plate.time[step.contact.end - 1]);
            contacts.push(Contact { plate: plate.number, start, end, whole: step.contact.start > 0 });
        }
    }
    contacts.sort_by(|a: &Contact, b: &Contact| a.start.total_cmp(&b.start));
    for k in 1..contacts.len() {
        let on_another = contacts[..k].iter().any(|c| c.end >= contacts[k].start);
        contacts[k].whole &= !on_another;
    }
    contacts
}

/// Mean of the vertical force of all plates together \[N\]; `None` where a plate has no sample in the time.
pub(super) fn mean_vertical(plates: &[PlateSignal], start: f64, end: f64) -> Option<f64> {
    let mean = |plate: &PlateSignal| {
        let within = plate.time.iter().zip(&plate.force).filter(|(t, _)| (start..end).contains(*t));
        let (sum, n) = within.fold((0.0, 0usize), |(sum, n), (_, f)| (sum + f.y, n + 1));
        (n > 0).then(|| sum / n as f64)
    };
    plates.iter().map(mean).sum()
}

/// No contact of the plate has a frame with a foot marker: the times differ, or the foot was lost.
fn unseen_foot(
    file: &TrialFile,
    plates: &[PlateSignal],
    recording: &MarkerRecording,
    plate: &PlateSignal,
    runs: &[Range<usize>],
) -> InputError {
    let span = |run: &Range<usize>| (plate.time[run.start], plate.time[run.end - 1]);
    let recorded = |run: &&Range<usize>| {
        let (start, end) = span(run);
        recording.time.iter().any(|t| (start..end).contains(t))
    };
    match runs.iter().find(recorded) {
        None => no_overlap(file, plates, recording, span(&runs[0]).0, span(&runs[0]).1),
        Some(run) => InputError::WrongForce {
            file: plate.file.clone(),
            problem: format!(
                "plate {} is loaded from {:.4} to {:.4} s, but no marker of the {} foot is seen then, so whose step it \
                 is cannot be told",
                plate.number,
                span(run).0,
                span(run).1,
                file.subject.side.name()
            ),
            remedy: "recover the foot markers, or leave this plate out and give `start_s` and `end_s`"
                .to_string(),
        },
    }
}

/// Median over a contact of the horizontal distance from the centre of pressure to the nearest foot marker \[m\];
/// `None` where no frame of the contact shows the foot.
fn distance_to_foot(
    plate: &PlateSignal,
    run: &Range<usize>,
    recording: &MarkerRecording,
    foot: &[&MarkerTrack],
) -> Option<f64> {
    let mut distances = Vec::new();
    for (frame, &time) in recording.time.iter().enumerate() {
        if !(plate.time[run.start]..plate.time[run.end - 1]).contains(&time) {
            continue;
        }
        let sample = plate.time.partition_point(|t| *t < time);
        let flat = |p: Vector3<f64>| (p - plate.point[sample]).xz().norm();
        distances.extend(foot.iter().filter_map(|t| t.position[frame]).map(flat).reduce(f64::min));
    }
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

/// First and last time that are reported \[s\].
pub(super) fn range(
    file: &TrialFile,
    plates: &[PlateSignal],
    steps: &[Step],
    recorded: &Recorded,
) -> Result<(f64, f64), InputError> {
    let (start, end) = match (file.range.cycle, file.range.start_s, file.range.end_s) {
        (_, Some(start), Some(end)) => (start, end),
        (cycle, ..) => {
            let wanted = cycle.unwrap_or(1);
            let strikes = heel_strikes(plates, steps);
            match strikes.get(wanted - 1..=wanted) {
                Some(&[a, b]) => (a, b),
                _ => {
                    return Err(InputError::NoCycle { file: plates[0].file.clone(), wanted, found: strikes });
                }
            }
        }
    };
    let time = &recorded.markers.time;
    let half_frame = 0.5 / recorded.markers.rate_hz;
    let covers = |t: &[f64]| t[0] <= start + half_frame && t[t.len() - 1] >= end - half_frame;
    if !covers(time) || !plates.iter().all(|p| covers(&p.time)) {
        return Err(no_overlap(file, plates, &recorded.markers, start, end));
    }
    if (end - start) * recorded.markers.rate_hz < 2.0 {
        return Err(InputError::Malformed {
            file: recorded.path.clone(),
            at: Place::Whole,
            problem: format!("the range from {start} to {end} s holds less than three frames"),
            remedy: "give a longer range".to_string(),
        });
    }
    Ok((start, end))
}

/// Times at which the foot comes down, seen from the start of its contact, while it is on no other plate.
fn heel_strikes(plates: &[PlateSignal], steps: &[Step]) -> Vec<f64> {
    let span = |s: &Step| (plates[s.plate].time[s.contact.start], plates[s.plate].time[s.contact.end - 1]);
    let strikes = steps.iter().enumerate().filter(|(i, step)| {
        let (start, _) = span(step);
        step.contact.start > 0 && steps[..*i].iter().all(|other| span(other).1 < start)
    });
    strikes.map(|(_, step)| span(step).0).collect()
}

fn no_overlap(
    file: &TrialFile,
    plates: &[PlateSignal],
    recording: &MarkerRecording,
    start: f64,
    end: f64,
) -> InputError {
    let first = plates.iter().map(|p| p.time[0]).fold(f64::NEG_INFINITY, f64::max);
    let last = plates.iter().map(|p| p.time[p.time.len() - 1]).fold(f64::INFINITY, f64::min);
    InputError::NoOverlap {
        motion: file.motion.clone(),
        motion_start: recording.time[0],
        motion_end: recording.time[recording.time.len() - 1],
        force: plates[0].file.clone(),
        force_start: first,
        force_end: last,
        start,
        end,
    }
}

/// Sum over the plates of the samples that belong to the foot.
pub(super) fn ground_reaction(plates: &[PlateSignal], steps: &[Step]) -> GroundReaction {
    let time = plates[0].time.clone();
    let mut ground = GroundReaction {
        force: vec![Vector3::zeros(); time.len()],
        moment: vec![Vector3::zeros(); time.len()],
        time,
    };
    for step in steps {
        let plate = &plates[step.plate];
        for i in step.window.clone() {
            ground.force[i] += plate.force[i];
            ground.moment[i] += plate.moment[i];
        }
    }
    ground
}
