//! Sections through the muscles of the scene: what they do to each other without contact, and with it.

use mesher::MusclePart;
use std::fmt::Write;

use fem::body::Pose;
use fem::geometry::Surface;
use fem::plan::Plan;
use fem::run::Frame;
use mesher::Bone;
use nalgebra::Point3;

use super::{CompareReport, frame_label, words};
use crate::report::anatomy::{bone_colour, hue, surface_section};
use crate::report::page::{grid, section};
use crate::report::svg::{escape, fixed, px};
use coupling::configuration::Configuration;
use coupling::thigh::build::segment_of;

/// Pixels per m.
const SCALE: f64 = 3200.0;
/// Lines along which shared area is found are this far apart \[m\].
const SPACING: f64 = 0.4e-3;
const MARGIN: f64 = 12.0;
/// Sections are looked for every so far along the limb \[m\].
const STEP: f64 = 10e-3;
/// A section shows a muscle where it cuts at least this fraction of its largest section.
const SHOWS: f64 = 0.5;
/// Sections at most.
const MOST: usize = 3;
/// Length of the scale bar \[m\].
const BAR: f64 = 50e-3;

/// Closed lines in the plane of the section: right of the body, front of the body \[m\].
type Loops = Vec<Vec<[f64; 2]>>;

/// Muscles and bones in the plane at one frame.
struct Slice {
    title: String,
    muscles: Vec<Loops>,
    bones: Vec<Loops>,
}

/// Figures per step and configuration at every height, those of one height of the same extent.
pub(super) fn sections(report: &CompareReport) -> String {
    let heights = heights(report);
    let at: Vec<(f64, String)> = heights.iter().filter_map(|&y| Some((y, figures(report, y)?))).collect();
    if at.is_empty() {
        return String::new(); // nothing passes the planes
    }
    let name = |y: f64| {
        let place = format!("y = {} mm", fixed(y * 1e3, 0));
        if y == report.mid_thigh { format!("{place}, the middle of the thigh") } else { place }
    };
    let content: Vec<String> =
        at.iter().map(|(y, figures)| format!("<h3>At {}</h3>\n{figures}", name(*y))).collect();
    section(
        "Sections through the muscles",
        "Seen from above; the front of the body is at the top, its right side on the right. Where muscles lie in each other they are hatched in red. The heights are those that show most of the muscles of the scene.",
        &content.join("\n"),
    )
}

/// Where sections show the muscles of the mesh: the height that shows most of them, then the one that shows most of the others. Of equals
/// the one nearest to the middle of the thigh.
fn heights(report: &CompareReport) -> Vec<f64> {
    let surfaces: Vec<Surface> = report
        .comparison
        .thigh
        .muscles
        .iter()
        .filter_map(|m| {
            let faces = report.comparison.thigh.mesh.surfaces.get(&MusclePart::Surface.of(&m.name))?;
            Some(Surface::from_faces(&report.comparison.thigh.mesh.points, faces).0)
        })
        .collect();
    if surfaces.is_empty() {
        return Vec::new(); // the rigid leg alone
    }
    let bounds: Vec<_> = surfaces.iter().map(Surface::bounds).collect();
    let low = bounds.iter().map(|b| b.0.y).fold(f64::INFINITY, f64::min);
    let high = bounds.iter().map(|b| b.1.y).fold(f64::NEG_INFINITY, f64::max);
    // Steps from the middle of the thigh, nearest first.
    let far = (high - report.mid_thigh).max(report.mid_thigh - low) / STEP;
    let candidates = (0..=far.ceil() as usize)
        .flat_map(|k| [1.0, -1.0].map(|sign| report.mid_thigh + sign * STEP * k as f64))
        .skip(1) // the middle once
        .filter(|y| (low..=high).contains(y));
    let areas = candidates.map(|y| {
        let cut = |s: &Surface| flat(s, y).iter().map(|l| area(l)).sum::<f64>().abs();
        (y, surfaces.iter().map(cut).collect::<Vec<f64>>())
    });
    choose(&areas.collect::<Vec<_>>())
}

/// The heights that show all muscles, [`MOST`] at most, from top to bottom. `areas`: sections of all muscles per height, the most wanted height
/// first \[m²\].
fn choose(areas: &[(f64, Vec<f64>)]) -> Vec<f64> {
    let n = areas.first().map_or(0, |a| a.1.len());
    let largest: Vec<f64> = (0..n).map(|m| areas.iter().map(|a| a.1[m]).fold(0.0, f64::max)).collect();
    let shows = |a: &[f64], m: usize| a[m] > 0.0 && a[m] >= SHOWS * largest[m];
    let mut left: Vec<usize> = (0..n).collect();
    let mut chosen = Vec::new();
    while chosen.len() < MOST {
        let new = |a: &[f64]| left.iter().filter(|&&m| shows(a, m)).count();
        // The first of equals.
        let Some((y, a)) = areas.iter().rev().max_by_key(|(_, a)| new(a)).filter(|(_, a)| new(a) > 0) else {
            break;
        };
        chosen.push(*y);
        left.retain(|&m| !shows(a, m));
    }
    chosen.sort_by(|a, b| b.total_cmp(a));
    chosen
}

/// The figures at one height; `None` where nothing passes it.
fn figures(report: &CompareReport, y: f64) -> Option<String> {
    let mut slices = Vec::new();
    for k in 0..report.comparison.steps.len() {
        for (configuration, solution) in report.comparison.solutions.present() {
            if let Some(frame) = solution.run.frames.iter().find(|f| f.time == 1.0 + k as f64) {
                slices.push(slice(report, configuration, &solution.plan, frame, y));
            }
        }
    }
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in slices.iter().flat_map(|s| s.muscles.iter().chain(&s.bones)).flatten().flatten() {
        for d in 0..2 {
            (low[d], high[d]) = (low[d].min(p[d]), high[d].max(p[d]));
        }
    }
    if low[0] > high[0] {
        return None;
    }
    let figures: Vec<String> = slices.iter().map(|s| figure(report, s, low, high)).collect();
    Some(grid("half slices", &figures))
}

/// The lines in which a surface passes the plane at height `y` \[m\].
fn flat(surface: &Surface, y: f64) -> Loops {
    let loops = surface_section(surface, y);
    loops.into_iter().map(|l| l.into_iter().map(|p| [p.z, p.x]).collect()).collect()
}

fn slice(report: &CompareReport, configuration: Configuration, plan: &Plan, frame: &Frame, y: f64) -> Slice {
    let points = frame.x.as_chunks::<3>().0;
    let faces = |muscle: &str| &report.comparison.thigh.mesh.surfaces[&MusclePart::Surface.of(muscle)];
    let bone = |bone: &Bone| {
        let segment = segment_of(&bone.name)?;
        let body = plan.bodies.iter().position(|b| b == segment);
        let pose = body.map_or(Pose::identity(), |b| frame.load.poses[b]);
        let points = bone.surface.points.iter().map(|p| (pose * Point3::from(*p)).coords.into()).collect();
        Some(flat(&Surface { points, triangles: bone.surface.triangles.clone() }, y))
    };
    Slice {
        title: format!("{}, {}", frame_label(report, frame.time, true), configuration.name()),
        muscles: report
            .comparison
            .thigh
            .muscles
            .iter()
            .map(|m| flat(&Surface::from_faces(points, faces(&m.name)).0, y))
            .collect(),
        bones: report.bones.iter().filter_map(bone).collect(),
    }
}

fn figure(report: &CompareReport, slice: &Slice, low: [f64; 2], high: [f64; 2]) -> String {
    let Slice { title, muscles, bones } = slice;
    let shared = shared(muscles);
    let shared_area: f64 = shared.iter().map(|[_, from, to]| (to - from) * SPACING).sum();
    let bottom = SCALE * (high[1] - low[1]) + 2.0 * MARGIN;
    let at = |p: [f64; 2]| [MARGIN + SCALE * (p[0] - low[0]), MARGIN + SCALE * (high[1] - p[1])];
    let path = |loops: &Loops| {
        let mut d = String::new();
        for points in loops {
            for (i, p) in points.iter().enumerate() {
                let [x, y] = at(*p);
                let _ = write!(d, "{}{} {}", if i == 0 { 'M' } else { 'L' }, px(x), px(y));
            }
            d.push('Z');
        }
        d
    };
    let mut out = format!(
        "<figure><figcaption><b>{}</b><span class=\"note\">muscles share {} mm² of the section</span></figcaption>\
         <svg class=\"slice\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"section, {}\">\n",
        escape(title),
        fixed(shared_area * 1e6, 0),
        px(SCALE * (high[0] - low[0]) + 2.0 * MARGIN),
        px(bottom + 30.0),
        escape(title)
    );
    let _ = writeln!(
        out,
        "<path class=\"scale\" d=\"M{MARGIN} {}v4H{}v-4\"/><text x=\"{}\" y=\"{}\">{} mm</text>",
        px(bottom + 8.0),
        px(MARGIN + SCALE * BAR),
        px(MARGIN + SCALE * BAR + 8.0),
        px(bottom + 14.0),
        fixed(1e3 * BAR, 0)
    );
    for (i, loops) in muscles.iter().enumerate().filter(|(_, l)| !l.is_empty()) {
        let _ = writeln!(
            out,
            "<path class=\"muscle\" style=\"fill:hsl({:.0} 50% 66%)\" d=\"{}\"><title>{}</title></path>",
            hue(i),
            path(loops),
            escape(&words(&report.comparison.thigh.muscles[i].name))
        );
    }
    let mut hatch = String::new();
    for [front, from, to] in &shared {
        let ([x, y], [end, _]) = (at([*from, *front]), at([*to, *front]));
        let _ = write!(hatch, "M{} {}H{}", px(x), px(y), px(end));
    }
    if !hatch.is_empty() {
        let _ = writeln!(out, "<path class=\"shared\" d=\"{hatch}\"/>");
    }
    for loops in muscles.iter().filter(|l| !l.is_empty()) {
        let _ = writeln!(out, "<path class=\"outline\" d=\"{}\"/>", path(loops));
    }
    for loops in bones.iter().filter(|l| !l.is_empty()) {
        let _ =
            writeln!(out, "<path class=\"bone\" style=\"fill:{}\" d=\"{}\"/>", bone_colour(0.7), path(loops));
    }
    for (i, loops) in muscles.iter().enumerate() {
        let largest = loops.iter().max_by(|a, b| area(a).abs().total_cmp(&area(b).abs()));
        let Some(largest) = largest.filter(|l| area(l) != 0.0) else { continue };
        let [x, y] = at(middle(largest));
        let _ = writeln!(
            out,
            "<text class=\"mid label\" x=\"{}\" y=\"{}\">{}</text>",
            px(x),
            px(y + 3.0),
            escape(&words(&report.comparison.thigh.muscles[i].name))
        );
    }
    out.push_str("</svg></figure>");
    out
}

/// Corners of every edge of a closed line with twice the area it spans with the origin.
fn edges(points: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2], f64)> {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| (*a, *b, a[0] * b[1] - a[1] * b[0]))
}

/// Signed area within a closed line \[m²\].
fn area(points: &[[f64; 2]]) -> f64 {
    edges(points).map(|e| e.2).sum::<f64>() / 2.0
}

/// Centroid of the area within a closed line \[m\].
fn middle(points: &[[f64; 2]]) -> [f64; 2] {
    let scale = 1.0 / (6.0 * area(points));
    [0, 1].map(|d| scale * edges(points).map(|(a, b, w)| (a[d] + b[d]) * w).sum::<f64>())
}

/// Pieces \[height to the front, from, to; m\] of lines across the section that lie in two muscles or more.
fn shared(muscles: &[Loops]) -> Vec<[f64; 3]> {
    let heights = || muscles.iter().flatten().flatten().map(|p| p[1]);
    let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
    let mut pieces = Vec::new();
    if low > high {
        return pieces;
    }
    for line in 0..((high - low) / SPACING).ceil() as usize {
        let y = low + (line as f64 + 0.5) * SPACING;
        // Where the line enters (+1) and leaves (-1) muscles.
        let mut turns: Vec<(f64, i32)> = Vec::new();
        for loops in muscles {
            let mut crossings: Vec<f64> = loops
                .iter()
                .flat_map(|points| {
                    let next = points.iter().cycle().skip(1);
                    points.iter().zip(next).filter(|(a, b)| (a[1] < y) != (b[1] < y))
                })
                .map(|(a, b)| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
                .collect();
            crossings.sort_unstable_by(f64::total_cmp);
            for pair in crossings.as_chunks::<2>().0 {
                turns.extend([(pair[0], 1), (pair[1], -1)]);
            }
        }
        turns.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut inside, mut since) = (0, 0.0);
        for (x, turn) in turns {
            let before = inside;
            inside += turn;
            if before < 2 && inside >= 2 {
                since = x;
            } else if before >= 2 && inside < 2 && x > since {
                pieces.push([y, since, x]);
            }
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_show_every_muscle_and_the_most_wanted_comes_first() {
        let areas = |list: &[(f64, [f64; 3])]| -> Vec<(f64, Vec<f64>)> {
            list.iter().map(|(y, a)| (*y, a.to_vec())).collect()
        };
        // The first height shows two, an equal one comes later, the third muscle is thin everywhere but far away.
        let list = [
            (0.0, [4.0, 4.0, 0.1]),
            (0.01, [4.0, 4.0, 0.2]),
            (0.3, [0.0, 0.0, 1.0]),
            (-0.2, [0.0, 2.0, 0.4]),
        ];
        assert_eq!(choose(&areas(&list)), [0.3, 0.0]);
        // Nothing is cut at the most wanted height.
        assert_eq!(choose(&areas(&[(0.0, [0.0; 3]), (0.2, [1.0, 1.0, 0.9])])), [0.2]);
        assert!(choose(&[]).is_empty());
    }

    #[test]
    fn squares_share_what_their_overlap_measures() {
        let square = |x: f64, y: f64, side: f64| {
            vec![vec![[x, y], [x + side, y], [x + side, y + side], [x, y + side]]]
        };
        let shared_area =
            |muscles: &[Loops]| shared(muscles).iter().map(|[_, a, b]| (b - a) * SPACING).sum::<f64>();
        let pair = [square(0.0, 0.0, 0.04), square(0.03, 0.01, 0.04)];
        assert!((shared_area(&pair) - 0.01 * 0.03).abs() < 0.01 * SPACING);
        assert_eq!(shared_area(&[square(0.0, 0.0, 0.04), square(0.05, 0.0, 0.04)]), 0.0);
        let [x, y] = middle(&square(0.01, 0.02, 0.04)[0]);
        assert!((x - 0.03).abs() < 1e-12 && (y - 0.04).abs() < 1e-12);
        // Three in one place count once.
        let three = [square(0.0, 0.0, 0.04), square(0.0, 0.0, 0.04), square(0.0, 0.0, 0.04)];
        assert!((shared_area(&three) - 0.0016).abs() < 0.04 * SPACING);
    }
}
