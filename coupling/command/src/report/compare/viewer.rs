//! The thigh as numbers for the viewer in the page (`viewer.js`): surfaces, their places and fields in every frame.
//!
//! Places are 16-bit steps of a box around all frames, fields 16-bit steps between their extremes over all frames, so that
//! colours of two configurations compare; 65535 means no value. Arrays are little-endian and base64.

use mesher::MusclePart;
use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use fem::body::Pose;
use fem::plan::Plan;
use fem::run::Frame;
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::nodal::{FIELDS, Scale, nodal_values};
use super::{CompareReport, frame_label};
use crate::report::anatomy::hue;
use crate::report::page::section;
use crate::report::svg::escape;
use coupling::configuration::Configuration;
use coupling::thigh::build::segment_of;

/// Steps between the extremes; one more means no value.
const STEPS: f64 = 65534.0;
/// Colours of fields that rise from zero: viridis without its darkest part, so that the shading of the surface is still seen.
const RISING: [&str; 8] =
    ["#46307e", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
/// Colours of fields that go to both sides of a value.
const DIVERGING: [&str; 9] =
    ["#1f4e9c", "#3f86c0", "#8fc0de", "#c6dcea", "#dfe5ee", "#f3cfc4", "#ee9c86", "#d25c4a", "#a3152c"];
/// Bones are ivory and tissue without value dark grey: neither is a colour of a field.
const BONE: &str = "#eadaa6";
const MISSING: &str = "#77746e";
/// Colours end at this fraction of the values: stress peaks at single corners would leave everything else in one colour.
const SHOWN: f64 = 0.98;

/// One frame as the viewer shows it.
struct Shown {
    configuration: Configuration,
    label: String,
    solved: bool,
    /// Places of all vertices \[m\].
    places: Vec<Vector3<f64>>,
    /// Values of every field at all vertices.
    values: [Vec<f64>; FIELDS.len()],
}

/// The section of the page with the viewer and its data.
pub(super) fn viewer(report: &CompareReport) -> String {
    if report.comparison.solutions.present().next().is_none() {
        return String::new(); // the rigid leg alone
    }
    let parts = Parts::of(report);
    let mut shown = Vec::new();
    for (c, solution) in report.comparison.solutions.present() {
        shown.push(parts.at_rest(c, &solution.plan));
        for frame in &solution.run.frames {
            shown.push(parts.frame(report, c, &solution.plan, frame, true));
        }
        if let Some(frame) = &solution.run.unsolved {
            shown.push(parts.frame(report, c, &solution.plan, frame, false));
        }
    }
    let ranges: Vec<[f64; 4]> = (0..FIELDS.len()).map(|f| range(f, &shown)).collect();
    let corners = shown.iter().flat_map(|s| &s.places);
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) = corners.fold(start, |(low, high), p| (low.inf(p), high.sup(p)));
    let head = json!({
        "parts": parts.head(report),
        "vertices": parts.nodes.len(),
        "box": [low.as_slice(), high.as_slice()],
        "colours": {"rising": RISING, "diverging": DIVERGING, "bone": BONE, "missing": MISSING},
        "fields": fields_head(&ranges),
        "frames": shown.iter().map(|s| json!({
            "configuration": s.configuration as usize, "label": s.label, "solved": s.solved,
            "has": s.values.iter().map(|v| v.iter().any(|v| v.is_finite())).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
    });
    let mut content = controls(report);
    let _ = writeln!(content, "<script type=\"application/json\" id=\"thigh-head\">{}</script>", safe(&head));
    let faces: Vec<u8> = parts.faces.iter().flatten().flat_map(|n| n.to_le_bytes()).collect();
    let mut data = |id: &str, bytes: &[u8]| {
        let _ = writeln!(
            content,
            "<script type=\"text/plain\" id=\"thigh-{id}\">{}</script>",
            BASE64.encode(bytes)
        );
    };
    data("faces", &faces);
    for (i, frame) in shown.iter().enumerate() {
        data(&i.to_string(), &packed(frame, &low, &high, &ranges));
    }
    let lead = "Drag to turn, wheel to zoom, shift and drag to shift, double click to start over; with the keyboard: arrows, + and −, shift and arrows, Home. Click a muscle in the list to hide it, or see through: what carries little becomes glass, and pressure deep inside is seen through the muscles above it. A cut takes away what lies before a plane. Values at nodes are means over the cells around them, and colours compare between steps and configurations.";
    section("The thigh in three dimensions", lead, &content)
}

/// JSON that cannot end a script element.
fn safe(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Places and then the fields that the frame has, in 16-bit numbers.
fn packed(frame: &Shown, low: &Vector3<f64>, high: &Vector3<f64>, ranges: &[[f64; 4]]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(2 * frame.places.len() * (3 + FIELDS.len()));
    let mut put = |value: f64, low: f64, high: f64| {
        let fraction = if high > low { (value - low) / (high - low) } else { 0.0 };
        let step =
            if value.is_finite() { (fraction.clamp(0.0, 1.0) * STEPS).round() as u16 } else { u16::MAX };
        bytes.extend(step.to_le_bytes());
    };
    for p in &frame.places {
        (0..3).for_each(|c| put(p[c], low[c], high[c]));
    }
    for (values, range) in frame.values.iter().zip(ranges).filter(|(v, _)| v.iter().any(|v| v.is_finite())) {
        values.iter().for_each(|v| put(*v, range[0], range[1]));
    }
    bytes
}

/// Least and greatest value of a field over all frames, and where its colours begin and end.
fn range(field: usize, shown: &[Shown]) -> [f64; 4] {
    let mut all: Vec<f64> =
        shown.iter().flat_map(|s| &s.values[field]).copied().filter(|v| v.is_finite()).collect();
    all.sort_unstable_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (all.first(), all.last()) else { return [0.0, 1.0, 0.0, 1.0] };
    // Most of a surface is at rest; the colours are for the rest of it.
    let rest = if let Scale::About(rest) = FIELDS[field].scale { rest } else { 0.0 };
    let mut away: Vec<f64> =
        all.iter().map(|v| (v - rest).abs()).filter(|d| *d > 1e-6 * (high - low)).collect();
    away.sort_unstable_by(f64::total_cmp);
    let far = match away.len() {
        0 => 1.0,
        n => away[((n - 1) as f64 * SHOWN) as usize],
    };
    match FIELDS[field].scale {
        Scale::Up => [low, high, 0.0, far],
        Scale::About(rest) => [low, high, rest - far, rest + far],
    }
}

fn fields_head(ranges: &[[f64; 4]]) -> Vec<Value> {
    let about = |scale| matches!(scale, Scale::About(_));
    FIELDS
        .iter()
        .zip(ranges)
        .map(|(f, r)| {
            json!({
                "key": f.key, "label": f.label, "unit": f.unit, "about": f.about, "diverging": about(f.scale),
                "range": [r[0], r[1]], "shown": [r[2], r[3]],
            })
        })
        .collect()
}

/// A muscle or bone: its vertices and faces are ranges of the common lists.
struct Part {
    name: String,
    /// The segment that carries it, where it is a bone.
    segment: Option<&'static str>,
    vertices: std::ops::Range<usize>,
    faces: std::ops::Range<usize>,
}

/// Everything that is drawn.
struct Parts<'a> {
    list: Vec<Part>,
    /// Node of the mesh of every vertex; of a bone the point of its surface.
    nodes: Vec<u32>,
    /// Corners of every face by vertex; a triangle repeats its last.
    faces: Vec<[u32; 4]>,
    bones: Vec<&'a [[f64; 3]]>,
}

impl<'a> Parts<'a> {
    fn of(report: &CompareReport<'a>) -> Parts<'a> {
        let mut parts = Parts { list: Vec::new(), nodes: Vec::new(), faces: Vec::new(), bones: Vec::new() };
        for muscle in &report.comparison.thigh.muscles {
            let faces = &report.comparison.thigh.mesh.surfaces[&MusclePart::Surface.of(&muscle.name)];
            let nodes = fem::mesh::unique_nodes(faces.iter().flatten().copied());
            let local = |n: &u32| nodes.binary_search(n).expect("a node of the surface") as u32;
            let faces: Vec<[u32; 4]> = faces.iter().map(|f| std::array::from_fn(|k| local(&f[k]))).collect();
            parts.push(&muscle.name, None, nodes, &faces);
        }
        for bone in report.bones {
            let Some(segment) = segment_of(&bone.name) else { continue };
            let surface = &bone.surface;
            let faces: Vec<[u32; 4]> = surface.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
            parts.bones.push(&surface.points);
            parts.push(&bone.name, Some(segment), (0..surface.points.len() as u32).collect(), &faces);
        }
        parts
    }

    fn push(&mut self, name: &str, segment: Option<&'static str>, nodes: Vec<u32>, faces: &[[u32; 4]]) {
        let (first, first_face) = (self.nodes.len(), self.faces.len());
        self.faces.extend(faces.iter().map(|f| f.map(|n| n + first as u32)));
        self.nodes.extend(nodes);
        self.list.push(Part {
            name: name.to_string(),
            segment,
            vertices: first..self.nodes.len(),
            faces: first_face..self.faces.len(),
        });
    }

    fn head(&self, report: &CompareReport) -> Vec<Value> {
        let muscles = report.comparison.thigh.muscles.len();
        let part = |(i, p): (usize, &Part)| {
            json!({
                "name": p.name.replace('_', " "), "bone": p.segment.is_some(), "hue": (i < muscles).then(|| hue(i)),
                "vertices": [p.vertices.start, p.vertices.end], "faces": [p.faces.start, p.faces.end],
            })
        };
        self.list.iter().enumerate().map(part).collect()
    }

    /// The mesh as it was made.
    fn at_rest(&self, configuration: Configuration, plan: &Plan) -> Shown {
        let values = std::array::from_fn(|_| vec![f64::NAN; self.nodes.len()]);
        let places = self.places(plan.mesh.points.as_flattened(), &|_| Pose::identity());
        Shown { configuration, label: "mesh, free of stress".into(), solved: true, places, values }
    }

    fn frame(
        &self,
        report: &CompareReport,
        configuration: Configuration,
        plan: &Plan,
        frame: &Frame,
        solved: bool,
    ) -> Shown {
        let pose = |segment: &str| {
            let body = plan.bodies.iter().position(|b| b == segment);
            body.map_or(Pose::identity(), |b| frame.load.poses[b])
        };
        let at_nodes = nodal_values(plan, &report.comparison.thigh, frame);
        let vertices = || self.list.iter().flat_map(|p| p.vertices.clone().map(move |v| (p, v)));
        let values = at_nodes.map(|values| {
            vertices()
                .map(|(p, v)| if p.segment.is_some() { f64::NAN } else { values[self.nodes[v] as usize] })
                .collect()
        });
        let label = frame_label(report, frame.time, solved);
        Shown { configuration, label, solved, places: self.places(&frame.x, &pose), values }
    }

    /// Places of all vertices with the nodes of the mesh at `x` and bones in their poses.
    fn places(&self, x: &[f64], pose: &dyn Fn(&str) -> Pose) -> Vec<Vector3<f64>> {
        let mut places = Vec::with_capacity(self.nodes.len());
        let mut bones = self.bones.iter();
        for part in &self.list {
            match part.segment {
                None => places.extend(self.nodes[part.vertices.clone()].iter().map(|&n| {
                    let i = 3 * n as usize;
                    Vector3::new(x[i], x[i + 1], x[i + 2])
                })),
                Some(segment) => {
                    let pose = pose(segment);
                    let points = bones.next().expect("one per bone").iter();
                    places.extend(points.map(|p| (pose * Point3::from(*p)).coords));
                }
            }
        }
        places
    }
}

/// Buttons, slider, canvas and colour bar; the script fills the lists.
fn controls(report: &CompareReport) -> String {
    let mut out = String::from("<div class=\"viewer\" id=\"viewer\">\n<div class=\"controls\">\n");
    out.push_str(
        "<div class=\"choice\"><span>Configuration</span><div class=\"buttons\" id=\"pick-configuration\">",
    );
    for (c, solution) in report.comparison.solutions.iter() {
        let (why, off) = match solution {
            Some(_) => ("", ""),
            None => (" title=\"not computed in this run\"", " disabled=\"disabled\""),
        };
        let _ = write!(
            out,
            "<button type=\"button\" data-value=\"{}\"{why}{off}>{}</button>",
            c as usize,
            escape(c.name())
        );
    }
    out.push_str(
        "</div></div>\n<div class=\"choice\"><span>Colour</span><div class=\"buttons\" id=\"pick-field\">",
    );
    out.push_str("<button type=\"button\" data-value=\"\">muscle</button>");
    for field in FIELDS {
        let _ = write!(
            out,
            "<button type=\"button\" data-value=\"{}\">{}</button>",
            field.key,
            escape(field.label)
        );
    }
    out.push_str(
        "</div></div>\n<div class=\"choice\"><span>Step</span><div class=\"slide\">\
         <input type=\"range\" id=\"pick-step\" min=\"0\" max=\"0\" step=\"1\" value=\"0\" aria-label=\"step\"/>\
         <output id=\"step-name\"></output></div>\
         <div class=\"checks\"><label><input type=\"checkbox\" id=\"show-bones\" checked=\"checked\"/>bones</label>\
         <label><input type=\"checkbox\" id=\"show-mesh\"/>mesh lines</label></div></div>\n\
         <div class=\"choice\"><label class=\"slide\"><span>See through</span>\
         <input type=\"range\" id=\"see-through\" min=\"0\" max=\"100\" step=\"5\" value=\"0\"/></label></div>\n\
         <div class=\"choice\"><span>Cut</span><div class=\"buttons\" id=\"pick-cut\">\
         <button type=\"button\" data-value=\"\">none</button><button type=\"button\" data-value=\"0\">front</button>\
         <button type=\"button\" data-value=\"1\">top</button><button type=\"button\" data-value=\"2\">right</button></div>\
         <div class=\"slide\"><input type=\"range\" id=\"cut-at\" min=\"0\" max=\"100\" step=\"1\" value=\"50\" aria-label=\"place of the cut\"/>\
         <output id=\"cut-name\"></output></div></div>\n</div>\n\
         <div class=\"stage\"><canvas id=\"thigh\" tabindex=\"0\" role=\"img\" aria-label=\"the thigh; drag or use the arrow keys to turn\"></canvas>\
         <svg class=\"triad\" id=\"triad\" viewBox=\"-50 -50 100 100\" aria-hidden=\"true\"></svg>\
         <div class=\"scalebar\" id=\"scalebar\" aria-hidden=\"true\"><span></span><i></i></div>\
         <div class=\"colourbar\" id=\"colourbar\" hidden=\"hidden\"><b></b><div class=\"gradient\"></div><div class=\"marks\"></div></div>\
         <p class=\"hint\" id=\"viewer-note\"></p></div>\n\
         <div class=\"list\" id=\"muscle-list\"></div>\n</div>\n",
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// sRGB to CIE L*a*b* under D65, where a distance of 2.3 is just noticed.
    fn lab(hex: &str) -> [f64; 3] {
        let channel = |i: usize| {
            let c = f64::from(u8::from_str_radix(&hex[i..i + 2], 16).unwrap()) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        let [r, g, b] = [channel(1), channel(3), channel(5)];
        let f = |t: f64| if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 };
        let x = f((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505);
        let y = f(0.2126 * r + 0.7152 * g + 0.0722 * b);
        let z = f((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    #[test]
    fn bones_and_missing_values_have_no_colour_of_a_field() {
        let apart = |a: &str, b: &str| {
            let (a, b) = (lab(a), lab(b));
            (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt()
        };
        assert!(apart(BONE, MISSING) > 20.0);
        for colours in [&RISING[..], &DIVERGING[..]] {
            for pair in colours.windows(2) {
                // The colours between two stops as well.
                for k in 0..=10 {
                    let mix = |i: usize| {
                        let of = |c: &str| f64::from(u8::from_str_radix(&c[i..i + 2], 16).unwrap());
                        (of(pair[0]) + f64::from(k) / 10.0 * (of(pair[1]) - of(pair[0]))).round() as u8
                    };
                    let between = format!("#{:02x}{:02x}{:02x}", mix(1), mix(3), mix(5));
                    for other in [BONE, MISSING] {
                        let apart = apart(&between, other);
                        assert!(apart > 20.0, "{between} is {apart:.1} from {other}");
                    }
                }
            }
        }
    }
}
