//! Recordings that can be read but cannot be true: wrong units, mirrored axes, exchanged, copied or misplaced markers.
//!
//! Everything here looks at the markers in ground axes (X forward, Y up, Z right) before a left leg is mirrored.

use nalgebra::Vector3;

use super::TrialFile;
use super::recorded::Recorded;
use crate::error::{InputError, Mistakes, Place};
use crate::natural::SegmentId;
use crate::trial::{MarkerTrack, Side};

/// The markers of pelvis to foot span about 0.55 of the body height; these bounds leave room for a bent knee and
/// for markers on the toes.
const SPAN_OVER_HEIGHT: std::ops::Range<f64> = 0.25..1.1;
/// A jump of two markers into each other's places must be larger than this to be believed \[m\].
const LEAST_JUMP: f64 = 0.02;
/// Skin markers of one segment move by 6 mm against each other, a patella marker by 16 mm; standard deviation \[m\].
const LARGEST_SPREAD: f64 = 0.03;
/// Distances that fit the reference worse than this are examined for exchanged names \[m\].
const LARGEST_MISFIT: f64 = 0.015;
/// A walk that is longer than this tells the direction of walking \[m\].
const LEAST_TRAVEL: f64 = 0.3;

/// Tests the tracked markers (`tracks`) and the landmark markers of the same recording.
pub(super) fn examine(
    file: &TrialFile,
    recorded: &Recorded,
    tracks: &[MarkerTrack],
    landmarks: &[MarkerTrack],
    wrong: &mut Mistakes,
) {
    let mut all = tracks.to_vec();
    all.extend(landmarks.iter().filter(|l| tracks.iter().all(|t| t.name != l.name)).cloned());
    duplicates(recorded, &all, wrong);
    if wrong.keep(size(file, recorded, tracks)).is_none() {
        return; // every other bound is a length
    }
    let before = wrong.len();
    exchanges_in_time(recorded, &all, wrong);
    if wrong.keep(axes_and_sides(file, recorded, &all)).is_some() {
        landmark_sides(file, recorded, &all, wrong);
    }
    if wrong.len() > before {
        return; // markers with each other's names do not move with their segment either
    }
    rigidity(recorded, tracks, wrong);
}

/// Tests a standing trial, which has no direction of walking.
pub(super) fn examine_standing(
    file: &TrialFile,
    recorded: &Recorded,
    tracks: &[MarkerTrack],
    wrong: &mut Mistakes,
) {
    duplicates(recorded, tracks, wrong);
    if wrong.keep(size(file, recorded, tracks)).is_some() {
        landmark_sides(file, recorded, tracks, wrong);
        rigidity(recorded, tracks, wrong);
    }
}

/// Kilograms of a pound.
const POUND: f64 = 0.45359237;
/// In a gait cycle one leg carries the body alone for a while: 1.0 to 1.3 body weights in walking, 0.9 where it is very slow.
const LEAST_OF_A_STEP: f64 = 0.7;
/// Body mass index that so few people have that pounds are likelier \[kg/m²\].
const LARGEST_INDEX: f64 = 42.0;

/// What can be true but rarely is, a sentence each with file, line and value. Results are computed all the same.
pub(super) fn rarely_true(file: &TrialFile, trial: &crate::trial::Trial) -> Vec<String> {
    let mut doubts = Vec::new();
    let (mass, height) = (file.subject.mass_kg, file.subject.height_m);
    let place = format!("{}, line {}: `mass_kg` is {mass}", file.path.display(), file.line_of("mass_kg"));
    let in_kg = POUND * mass;
    let mut carried: Vec<f64> = trial.ground.force.iter().map(|f| f.y).filter(|f| *f > 0.0).collect();
    carried.sort_by(f64::total_cmp);
    // A spike of a few samples is no step.
    let most = carried.get(carried.len() * 98 / 100).copied().unwrap_or(0.0);
    let weights = most / (9.81 * mass);
    if file.range.cycle.is_some() && weights < LEAST_OF_A_STEP {
        let meant = match (LEAST_OF_A_STEP..2.0).contains(&(weights / POUND)) {
            true => format!("if these are pounds, give {in_kg:.1} ({:.2} body weights)", weights / POUND),
            false => "check the mass, and the unit of the forces".to_string(),
        };
        doubts.push(format!("{place}, but in a whole gait cycle the foot carries {most:.0} N at most, {weights:.2} body weights; {meant}"));
    } else if mass / height.powi(2) > LARGEST_INDEX {
        let index = mass / height.powi(2);
        doubts.push(format!(
            "{place} at {height} m, a body mass index of {index:.0}; if these are pounds, give {in_kg:.1}"
        ));
    }
    doubts
}

/// Both positions of a pair in every frame that has both.
fn common<'a>(
    a: &'a MarkerTrack,
    b: &'a MarkerTrack,
) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone + 'a {
    a.position.iter().zip(&b.position).filter_map(|(p, q)| Some(((*p)?, (*q)?)))
}

/// Mean distance of two markers \[m\] and its standard deviation; `None` without a common frame.
pub(super) fn distance(a: &MarkerTrack, b: &MarkerTrack) -> Option<(f64, f64)> {
    let distances = common(a, b).map(|(p, q)| (p - q).norm());
    let n = distances.clone().count() as f64;
    let mean = distances.clone().sum::<f64>() / n;
    let variance = distances.map(|d| (d - mean).powi(2)).sum::<f64>() / n;
    (n > 0.0).then_some((mean, variance.sqrt()))
}

fn pairs<T>(items: &[T]) -> impl Iterator<Item = (&T, &T)> {
    items.iter().enumerate().flat_map(|(i, a)| items[i + 1..].iter().map(move |b| (a, b)))
}

fn duplicates(recorded: &Recorded, tracks: &[MarkerTrack], wrong: &mut Mistakes) {
    for (a, b) in pairs(tracks) {
        let mut places = common(a, b).peekable();
        if places.peek().is_some() && places.all(|(p, q)| (p - q).norm() < 1e-6) {
            let (first, second) = (a.name.clone(), b.name.clone());
            wrong.note(InputError::Duplicated { file: recorded.path.clone(), first, second });
        }
    }
}

fn size(file: &TrialFile, recorded: &Recorded, tracks: &[MarkerTrack]) -> Result<(), InputError> {
    let farthest = |frame: usize| {
        let seen: Vec<_> = tracks.iter().filter_map(|t| t.position[frame]).collect();
        pairs(&seen).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
    };
    let n_frames = recorded.markers.time.len();
    let mut spans: Vec<f64> =
        (0..n_frames).step_by(n_frames.div_ceil(50)).map(farthest).filter(|s| *s > 0.0).collect();
    spans.sort_by(f64::total_cmp);
    let Some(&span) = spans.get(spans.len() / 2) else { return Ok(()) };
    let height = file.subject.height_m;
    if !(0.5..=2.6).contains(&height) {
        return Ok(()); // the height itself was refused and tells nothing of the recording
    }
    if SPAN_OVER_HEIGHT.contains(&(span / height)) {
        return Ok(());
    }
    let guess = match 0.55 * height / span {
        f if (5e-4..2e-3).contains(&f) => "millimetres were read as metres".to_string(),
        f if (5e2..2e3).contains(&f) => "metres were read as millimetres".to_string(),
        f if (5e-3..2e-2).contains(&f) => "centimetres were read as metres".to_string(),
        f if (5e1..2e2).contains(&f) => "metres were read as centimetres".to_string(),
        f if (5.0..20.0).contains(&f) => "centimetres were read as millimetres".to_string(),
        f if (0.05..0.2).contains(&f) => "millimetres were read as centimetres".to_string(),
        f => format!("lengths are off by about {f:.3}"),
    };
    Err(InputError::WrongUnits { file: recorded.path.clone(), span, height, guess })
}

/// Two markers that jump into each other's places from one frame to the next.
fn exchanges_in_time(recorded: &Recorded, tracks: &[MarkerTrack], wrong: &mut Mistakes) {
    for (a, b) in pairs(tracks) {
        let mut last = None;
        for (frame, now) in a.position.iter().zip(&b.position).enumerate() {
            let (Some(p), Some(q)) = now else {
                last = None;
                continue;
            };
            if let Some((p0, q0)) = last.replace((*p, *q)) {
                let (stay, swap) = ([(p - p0).norm(), (q - q0).norm()], [(p - q0).norm(), (q - p0).norm()]);
                if (0..2).all(|k| stay[k] > LEAST_JUMP && swap[k] < 0.5 * stay[k]) {
                    wrong.note(InputError::Swapped {
                        file: recorded.path.clone(),
                        at: Place::Frame(recorded.markers.first_frame + frame),
                        first: a.name.clone(),
                        second: b.name.clone(),
                        reason: format!(
                            "they jump by {:.0} and {:.0} mm into each other's places",
                            1e3 * stay[0],
                            1e3 * stay[1]
                        ),
                    });
                    break; // they may jump back; once is enough
                }
            }
        }
    }
}

/// Mean over the frames that have both markers of `to − from`.
fn mean_offset(from: &MarkerTrack, to: &MarkerTrack) -> Option<Vector3<f64>> {
    let n = common(from, to).count();
    (n > 0).then(|| common(from, to).map(|(p, q)| q - p).sum::<Vector3<f64>>() / n as f64)
}

/// Mean place of all seen markers of a segment in a frame.
fn centroid(tracks: &[MarkerTrack], segment: SegmentId, frame: usize) -> Option<Vector3<f64>> {
    let seen: Vec<_> =
        tracks.iter().filter(|t| t.segment == segment).filter_map(|t| t.position[frame]).collect();
    (!seen.is_empty()).then(|| seen.iter().sum::<Vector3<f64>>() / seen.len() as f64)
}

/// Does the subject stand upright and walk forward, and are right and left where they belong?
fn axes_and_sides(file: &TrialFile, recorded: &Recorded, tracks: &[MarkerTrack]) -> Result<(), InputError> {
    let wrong = |problem: String, remedy: &str| {
        Err(InputError::WrongSide { file: recorded.path.clone(), problem, remedy: remedy.to_string() })
    };
    let frames = 0..recorded.markers.time.len();
    let offsets: Vec<_> = frames
        .clone()
        .filter_map(|i| {
            let pelvis = centroid(tracks, SegmentId::Pelvis, i)?;
            Some((
                centroid(tracks, SegmentId::Thigh, i)? - pelvis,
                centroid(tracks, SegmentId::Foot, i)? - pelvis,
            ))
        })
        .collect();
    if offsets.is_empty() {
        return Ok(()); // nothing to compare; the fit will flag every frame
    }
    let n = offsets.len() as f64;
    let thigh = offsets.iter().map(|o| o.0).sum::<Vector3<f64>>() / n;
    let foot = offsets.iter().map(|o| o.1).sum::<Vector3<f64>>() / n;
    if -foot.y < 0.5 * foot.norm() {
        let problem = format!("the pelvis is {:.2} m above the foot along `{}`", -foot.y, file.axes.y);
        return wrong(problem, "`axes.y` must be the axis of the recording that points up");
    }
    let pelvis: Vec<_> = frames.filter_map(|i| centroid(tracks, SegmentId::Pelvis, i)).collect();
    let travel = pelvis[pelvis.len() - 1] - pelvis[0];
    let walks = Vector3::new(travel.x, 0.0, travel.z).norm();
    if walks > LEAST_TRAVEL && travel.x < 0.7 * walks {
        let problem = format!(
            "the pelvis moves by ({:.2}, {:.2}, {:.2}) m forward, up and to the right",
            travel.x, travel.y, travel.z
        );
        return wrong(
            problem,
            "`axes.x` must be the axis of the recording that points in the direction of walking",
        );
    }

    let find = |name: &Option<&str>| name.and_then(|n| tracks.iter().find(|t| t.name == n));
    let [right_asis, left_asis, right_psis, left_psis] = file.pelvis_names();
    let [right_asis, left_asis, right_psis, left_psis] =
        [&right_asis, &left_asis, &right_psis, &left_psis].map(find);
    let swapped = |a: &MarkerTrack, b: &MarkerTrack, reason: String| {
        Err(InputError::Swapped {
            file: recorded.path.clone(),
            at: Place::Whole,
            first: a.name.clone(),
            second: b.name.clone(),
            reason,
        })
    };
    for (front, back) in [(right_asis, right_psis), (left_asis, left_psis)] {
        if let (Some(front), Some(back)) = (front, back)
            && let Some(offset) = mean_offset(back, front).filter(|o| o.x < 0.0)
        {
            return swapped(front, back, format!("the ASIS is {:.0} mm behind the PSIS", -1e3 * offset.x));
        }
    }
    // Metres from left to right marker, positive where the right one is on the right.
    let across =
        |left: Option<&MarkerTrack>, right: Option<&MarkerTrack>| mean_offset(left?, right?).map(|o| o.z);
    let (asis, psis) = (across(left_asis, right_asis), across(left_psis, right_psis));
    // Positive where the leg is on the side that the trial file says.
    let leg = if file.subject.side == Side::Right { thigh.z } else { -thigh.z };
    match (asis, psis, left_asis.zip(right_asis), left_psis.zip(right_psis)) {
        (Some(a), Some(p), ..) if a < 0.0 && p < 0.0 && leg < 0.0 => {
            let problem = format!(
                "right ASIS, right PSIS and the {} leg are on the wrong side ({:.0}, {:.0}, {:.0} mm): the recording is mirrored",
                file.subject.side.name(),
                1e3 * a,
                1e3 * p,
                1e3 * leg
            );
            return wrong(problem, "correct `axes`, or the program that exported the recording");
        }
        (Some(a), Some(p), Some((l, r)), _) if a < 0.0 && (p > 0.0 || leg > 0.0) => {
            return swapped(l, r, format!("the right one is {:.0} mm to the left of the left one", -1e3 * a));
        }
        (_, Some(p), _, Some((l, r))) if p < 0.0 => {
            return swapped(l, r, format!("the right one is {:.0} mm to the left of the left one", -1e3 * p));
        }
        _ => {}
    }
    if leg < 0.0 {
        let problem = format!(
            "`side` is {}, but the thigh markers are {:.0} mm on the other side of the pelvis",
            file.subject.side.name(),
            -1e3 * leg
        );
        return wrong(problem, "correct `side`, or name the markers of that leg");
    }
    Ok(())
}

/// Least distance by which a landmark must be on the wrong side for its name to be wrong \[m\]: knees and ankles are 60 mm wide and more, and
/// a foot that points outwards by 60 degrees still has half of that.
const WRONG_SIDE: f64 = 0.02;

/// The outer one of two landmarks lies on the side of the leg, seen along the line between the two ASISs, wherever the subject turns.
pub(super) fn landmark_sides(
    file: &TrialFile,
    recorded: &Recorded,
    tracks: &[MarkerTrack],
    wrong: &mut Mistakes,
) {
    let find = |name: Option<&str>| tracks.iter().find(|t| Some(t.name.as_str()) == name);
    let [right_asis, left_asis, ..] = file.pelvis_names().map(find);
    let (Some(right_asis), Some(left_asis)) = (right_asis, left_asis) else { return };
    let outwards = if file.subject.side == Side::Right { 1.0 } else { -1.0 };
    for (outer, inner) in file.outer_and_inner() {
        let (Some(outer), Some(inner)) = (find(outer), find(inner)) else { continue };
        // Mean over the frames of how far the outer one lies outwards.
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..outer.position.len() {
            let place = |t: &MarkerTrack| t.position.get(k).copied().flatten();
            if let (Some(l), Some(r), Some(o), Some(i)) =
                (place(left_asis), place(right_asis), place(outer), place(inner))
                && let Some(right) = (r - l).try_normalize(1e-3)
            {
                sum += outwards * (o - i).dot(&right);
                count += 1.0;
            }
        }
        if count > 0.0 && sum / count < -WRONG_SIDE {
            wrong.note(InputError::Swapped {
                file: recorded.path.clone(),
                at: Place::Whole,
                first: outer.name.clone(),
                second: inner.name.clone(),
                reason: format!(
                    "the outer one lies {:.0} mm on the inner side of the {} leg",
                    -1e3 * sum / count,
                    file.subject.side.name()
                ),
            });
        }
    }
}

/// Markers of one segment keep their distances.
fn rigidity(recorded: &Recorded, tracks: &[MarkerTrack], wrong: &mut Mistakes) {
    for segment in SegmentId::ALL {
        let cluster: Vec<&MarkerTrack> = tracks.iter().filter(|t| t.segment == segment).collect();
        let spread = |a: &MarkerTrack, b: &MarkerTrack| distance(a, b).map_or(0.0, |d| d.1);
        let worst = |t: &&MarkerTrack| cluster.iter().map(|o| spread(t, o)).sum::<f64>();
        if pairs(&cluster).all(|(a, b)| spread(a, b) < LARGEST_SPREAD) {
            continue;
        }
        let by_sum = |a: &&&MarkerTrack, b: &&&MarkerTrack| worst(a).total_cmp(&worst(b));
        let Some(marker) = cluster.iter().max_by(by_sum) else { continue };
        let by_spread =
            |a: &&&MarkerTrack, b: &&&MarkerTrack| spread(marker, a).total_cmp(&spread(marker, b));
        let Some(other) = cluster.iter().max_by(by_spread) else { continue };
        wrong.note(InputError::NotRigid {
            file: recorded.path.clone(),
            marker: marker.name.clone(),
            segment: segment.name(),
            other: other.name.clone(),
            spread_mm: 1e3 * spread(marker, other),
        });
    }
}

/// Do the distances inside each segment fit those of another source much better when two names are exchanged?
///
/// `reference`: distance of two markers there \[m\].
pub(super) fn compare_distances(
    recorded: &Recorded,
    tracks: &[MarkerTrack],
    source: &str,
    reference: impl Fn(&str, &str) -> Option<f64>,
    wrong: &mut Mistakes,
) {
    for segment in SegmentId::ALL {
        let cluster: Vec<&MarkerTrack> = tracks.iter().filter(|t| t.segment == segment).collect();
        let n = cluster.len();
        // Root mean square difference when marker i bears the name of marker name[i].
        let misfit = |name: &[usize]| {
            let (mut sum, mut count) = (0.0, 0.0);
            for i in 0..n {
                for j in 0..i {
                    let there = reference(&cluster[name[i]].name, &cluster[name[j]].name);
                    if let (Some((here, _)), Some(there)) = (distance(cluster[i], cluster[j]), there) {
                        sum += (here - there).powi(2);
                        count += 1.0;
                    }
                }
            }
            if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
        };
        let mut name: Vec<usize> = (0..n).collect();
        let as_named = misfit(&name);
        if as_named < LARGEST_MISFIT {
            continue;
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for i in 0..n {
            for j in 0..i {
                name.swap(i, j);
                let exchanged = misfit(&name);
                name.swap(i, j);
                if best.is_none_or(|b| exchanged < b.0) {
                    best = Some((exchanged, j, i));
                }
            }
        }
        if let Some((exchanged, i, j)) = best.filter(|b| b.0 < 0.5 * as_named) {
            wrong.note(InputError::Swapped {
                file: recorded.path.clone(),
                at: Place::Whole,
                first: cluster[i].name.clone(),
                second: cluster[j].name.clone(),
                reason: format!(
                    "the distances on the {} differ from {source} by {:.0} mm as named, by {:.0} mm exchanged",
                    segment.name(),
                    1e3 * as_named,
                    1e3 * exchanged
                ),
            });
        }
    }
}
