//! From end patches to sections.

use nalgebra::Vector3;

use super::harmonic::{self, Levels, area_and_centroid};
use super::outline::{self, Ring};
use super::{SectionError, Settings, fit};
use crate::MuscleSections;
use fem::geometry::SearchSurface;

/// Largest distance of the centres of traced levels \[m\].
const TRACED: f64 = 1.5e-3;
/// Levels to begin with, and the least difference of values down to which they are refined.
const COARSE: i32 = 64;
const LEAST_STEP: f64 = 1e-5;
/// A level whose other lines have more than this part of the largest line's area is no single outline.
const OTHER_LINES: f64 = 0.1;
/// Shortest interval to which the first and the last one are shortened where their sections cross \[m\].
const LEAST_INTERVAL: f64 = 8e-3;
/// Rounds in which sections are added.
const REFINEMENTS: usize = 3;
/// Sections at least.
const LEAST_STATIONS: usize = 5;

/// A level and its main line.
struct Level {
    value: f64,
    ring: Ring,
    /// Other lines are too large to be left out.
    split: bool,
}

/// Sections between two patches of a surface.
pub(super) fn sections(
    name: &str,
    surface: &SearchSurface,
    zero: &[u32],
    one: &[u32],
    settings: &Settings,
) -> Result<MuscleSections, SectionError> {
    let points = &surface.surface().points;
    if let Some(&point) = zero.iter().find(|p| one.contains(p)) {
        return Err(SectionError::SharedEnds { muscle: name.into(), point, at: points[point as usize] });
    }
    let unmappable = |at: Vector3<f64>, reason: String| SectionError::Unmappable {
        muscle: name.into(),
        at: at.into(),
        reason,
    };
    let value = harmonic::solve(surface.surface(), zero, one);
    let lines = Levels::new(surface.surface(), &value)?;
    let mut levels = trace(&lines);
    let middle = Vector3::from(points[zero[0] as usize]);
    levels.retain(|level| level.ring.area >= settings.least_area);
    if levels.len() < LEAST_STATIONS {
        return Err(unmappable(middle, "hardly any level line spans an area".into()));
    }
    let mut path = vec![0.0];
    for pair in levels.windows(2) {
        path.push(path[path.len() - 1] + (pair[1].ring.centre - pair[0].ring.centre).norm());
    }
    let length = path[path.len() - 1];
    // Split levels are left out; what is left must not have long gaps.
    let whole: Vec<usize> = (0..levels.len()).filter(|&i| !levels[i].split).collect();
    let (Some(&first), Some(&last)) = (whole.first(), whole.last()) else {
        return Err(unmappable(middle, "every section falls into several parts".into()));
    };
    let n = ((path[last] - path[first]) / settings.spacing).ceil().max(LEAST_STATIONS as f64 - 1.0) as usize;
    let nearest = |x: f64| {
        whole
            .iter()
            .copied()
            .fold(first, |best, i| if (path[i] - x).abs() < (path[best] - x).abs() { i } else { best })
    };
    let mut chosen: Vec<usize> =
        (0..=n).map(|k| nearest(path[first] + (path[last] - path[first]) * k as f64 / n as f64)).collect();
    chosen.dedup();
    if let Some(gap) =
        chosen.windows(2).find(|w| path[w[1]] - path[w[0]] > 0.15 * length + 2.0 * settings.spacing)
    {
        let at = levels[(gap[0] + gap[1]) / 2].ring.centre;
        return Err(unmappable(at, "sections fall into several parts over a long way".into()));
    }
    let build = |chosen: &[usize]| {
        let rings: Vec<&Ring> = chosen.iter().map(|&i| &levels[i].ring).collect();
        let sections = MuscleSections { name: name.into(), stations: outline::stations(&rings) };
        match sections.check() {
            Ok(()) => Ok(sections),
            Err(failure) => Err(failure),
        }
    };
    let mut sections = loop {
        let (station, reason) = match build(&chosen) {
            Ok(sections) => break sections,
            Err(failure) => failure,
        };
        if chosen.len() <= LEAST_STATIONS {
            return Err(unmappable(levels[chosen[station]].ring.centre, reason));
        }
        // At an end: end a little earlier, at last with the neighbour. Else: leave out the section named.
        let n = chosen.len();
        let (end, neighbour) = match station {
            0 | 1 => (0, 1),
            _ if station == n - 1 => (n - 1, n - 2),
            _ => {
                chosen.remove(station);
                continue;
            }
        };
        let [x, y] = [end, neighbour].map(|i| path[chosen[i]]);
        let earlier = nearest(x + 0.3 * (y - x));
        if (x - y).abs() > LEAST_INTERVAL && earlier != chosen[end] && earlier != chosen[neighbour] {
            chosen[end] = earlier;
        } else {
            chosen.remove(end);
        }
    };
    // More sections where the loft leaves the surface between two of them.
    for _ in 0..REFINEMENTS {
        let (at, between) = fit::by_section(&sections, surface);
        let inserted: Vec<usize> = (0..between.len())
            .filter(|&i| between[i] > settings.deviation.max(1.3 * at[i].max(at[i + 1])))
            .filter(|&i| path[chosen[i + 1]] - path[chosen[i]] > LEAST_INTERVAL)
            .map(|i| nearest((path[chosen[i]] + path[chosen[i + 1]]) / 2.0))
            .filter(|level| !chosen.contains(level))
            .collect();
        let mut finer = chosen.clone();
        finer.extend(&inserted);
        finer.sort_unstable();
        let found = loop {
            match build(&finer) {
                Ok(found) => break Some(found),
                Err((station, _)) => {
                    // Take back the new section that does not fit, or one beside it.
                    let new = |&i: &usize| finer.get(i).is_some_and(|level| inserted.contains(level));
                    match [station, station.wrapping_sub(1), station + 1].into_iter().find(new) {
                        Some(i) => finer.remove(i),
                        None => break None,
                    };
                }
            }
        };
        match found {
            Some(found) if finer.len() > chosen.len() => (sections, chosen) = (found, finer),
            _ => break,
        }
    }
    Ok(sections)
}

/// Levels from 0 to 1, dense enough for their centres to be [`TRACED`] apart.
fn trace(lines: &Levels) -> Vec<Level> {
    let at = |value: f64| {
        let mut found: Vec<(f64, harmonic::Line)> =
            lines.at(value).into_iter().map(|line| (area_and_centroid(&line).0.norm(), line)).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let split = found.len() > 1 && found[1].0 > OTHER_LINES * found[0].0;
        found.into_iter().next().map(|(_, line)| Level { value, ring: Ring::new(&line), split })
    };
    let mut values: Vec<f64> = (1..COARSE).map(|i| f64::from(i) / f64::from(COARSE)).collect();
    // Near small patches most of the muscle lies within a small part of the values.
    for k in 1..12 {
        let x = 0.5f64.powi(k) / f64::from(COARSE);
        values.extend([x, 1.0 - x]);
    }
    values.sort_by(f64::total_cmp);
    // Levels still to be looked at, the next one last.
    let mut open: Vec<Level> = values.into_iter().rev().filter_map(at).collect();
    let mut levels: Vec<Level> = Vec::new();
    while let Some(next) = open.pop() {
        if let Some(last) = levels.last() {
            let far = (next.ring.centre - last.ring.centre).norm() > TRACED;
            if far
                && next.value - last.value > LEAST_STEP
                && let Some(between) = at((next.value + last.value) / 2.0)
            {
                open.push(next);
                open.push(between);
                continue;
            }
        }
        levels.push(next);
    }
    levels
}
