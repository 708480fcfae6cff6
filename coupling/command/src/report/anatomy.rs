//! Pictures of muscle meshes and bones: views from a side with hidden parts hidden, and plane sections.

use std::collections::BTreeMap;
use std::fmt::Write;

use fem::geometry::Surface;
use mesher::{Bone, MuscleBlock};
use nalgebra::Vector3;

use super::svg::{escape, px};

/// From where a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// From the front; the right side of the body is on the left of the picture.
    Front,
    /// From the right; the front is on the right of the picture.
    Side,
    /// From above, on a section; the front is at the top, the right side on the right.
    Above,
}

impl View {
    /// Unit vectors of the picture to the right and up, in the limb frame (X anterior, Y superior, Z right).
    fn axes(self) -> [Vector3<f64>; 2] {
        match self {
            View::Front => [-Vector3::z(), Vector3::y()],
            View::Side => [Vector3::x(), Vector3::y()],
            View::Above => [Vector3::z(), Vector3::x()],
        }
    }

    /// Unit vector towards the eye.
    fn towards_eye(self) -> Vector3<f64> {
        let [right, up] = self.axes();
        right.cross(&up)
    }
}

/// Pixels per m.
const SCALE: f64 = 1500.0;
/// Pixels per m of a section.
const SECTION_SCALE: f64 = 3600.0;
/// Margin around a picture in pixels.
const MARGIN: f64 = 40.0;

/// Hue of muscle `i` in degrees: neighbours in the list differ by the golden angle.
pub(super) fn hue(i: usize) -> f64 {
    (20.0 + 137.508 * i as f64) % 360.0
}

/// Colour of muscle `i` as hue, saturation and lightness.
fn colour(i: usize, light: f64) -> String {
    format!("hsl({:.0} 52% {:.0}%)", hue(i), 32.0 + 34.0 * light)
}

pub(super) fn bone_colour(light: f64) -> String {
    format!("hsl(42 28% {:.0}%)", 60.0 + 32.0 * light)
}

fn tendon_colour(light: f64) -> String {
    format!("hsl(210 30% {:.0}%)", 72.0 + 24.0 * light)
}

/// Colour keys of the muscles, in their order.
pub fn legend(muscles: &[&MuscleBlock]) -> String {
    let mut out = String::from("<div class=\"keys\">");
    for (i, muscle) in muscles.iter().enumerate() {
        let _ = write!(
            out,
            "<span><i style=\"display:inline-block;width:13px;height:13px;margin-right:6px;background:{}\"></i>{}</span>",
            colour(i, 0.6),
            escape(&muscle.name.replace('_', " "))
        );
    }
    out.push_str("</div>\n");
    out
}

/// Muscles, bones and `tendons` (faces, and lines as faces of two corners) seen from a side, every face of the mesh drawn; far faces first.
pub fn view(muscles: &[&MuscleBlock], bones: &[Bone], tendons: &[Vec<Vector3<f64>>], view: View) -> String {
    let [right, up] = view.axes();
    let eye = view.towards_eye();
    let mut faces: Vec<(f64, Vec<[f64; 2]>, String)> = Vec::new();
    let mut add = |corners: &[Vector3<f64>], paint: &dyn Fn(f64) -> String| {
        let n = corners.len();
        let normal: Vector3<f64> = (1..n - 1)
            .map(|k| (corners[k] - corners[0]).cross(&(corners[k + 1] - corners[0])))
            .sum::<Vector3<f64>>();
        let facing = normal.dot(&eye) / normal.norm();
        if facing.is_nan() || facing <= 0.0 {
            return; // looks away
        }
        let depth = corners.iter().map(|p| p.dot(&eye)).sum::<f64>() / n as f64;
        faces.push((depth, corners.iter().map(|p| [p.dot(&right), -p.dot(&up)]).collect(), paint(facing)));
    };
    for (i, muscle) in muscles.iter().enumerate() {
        for face in muscle.surface() {
            let corners = face.map(|n| Vector3::from(muscle.points[n as usize]));
            add(&corners, &|light| colour(i, light));
        }
    }
    for bone in bones {
        for t in 0..bone.surface.triangles.len() {
            add(&bone.surface.corners(t), &bone_colour);
        }
    }
    let flat = |p: &Vector3<f64>| [p.dot(&right), -p.dot(&up)];
    for face in tendons {
        // Both sides are seen, lines from everywhere.
        let normal: Vector3<f64> = match face[..] {
            [a, b, c, ..] => (b - a).cross(&(c - a)),
            _ => eye,
        };
        let light = (normal.dot(&eye) / normal.norm()).abs();
        let depth = face.iter().map(|p| p.dot(&eye)).sum::<f64>() / face.len() as f64;
        faces.push((depth, face.iter().map(flat).collect(), tendon_colour(light)));
    }
    faces.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The frame holds the muscles; bones that reach farther down are cut off.
    let points = muscles.iter().flat_map(|m| &m.points).map(|p| {
        let p = Vector3::from(*p);
        [p.dot(&right), -p.dot(&up)]
    });
    let frame = Frame::around(points, SCALE);
    let mut out = frame.open(match view {
        View::Front => "front view",
        View::Side => "view from the right",
        View::Above => "view from above",
    });
    out.push_str(
        "<g stroke=\"#000\" stroke-opacity=\".28\" stroke-width=\".3\" stroke-linejoin=\"round\">\n",
    );
    for (_, corners, fill) in &faces {
        let line = if corners.len() == 2 {
            format!(" stroke=\"{fill}\" stroke-opacity=\"1\" stroke-width=\"1.5\"")
        } else {
            String::new()
        };
        let _ = writeln!(out, "<path fill=\"{fill}\"{line} d=\"{}\"/>", frame.path(corners));
    }
    out.push_str("</g>\n");
    out.push_str(&frame.scale_bar());
    out.push_str("</svg>\n");
    out
}

/// The section at height `y` \[m\], seen from above: every cell that the plane cuts, bones filled.
pub fn section(muscles: &[&MuscleBlock], bones: &[Bone], y: f64) -> String {
    let [right, up] = View::Above.axes();
    let flat = |p: Vector3<f64>| [p.dot(&right), -p.dot(&up)];
    let mut cells: Vec<(usize, Vec<[f64; 2]>)> = Vec::new();
    for (i, muscle) in muscles.iter().enumerate() {
        for cell in muscle.cells() {
            let corners = cell.map(|n| Vector3::from(muscle.points[n as usize]));
            let mut cut: Vec<[f64; 2]> =
                EDGES.iter().filter_map(|&[a, b]| crossing(corners[a], corners[b], y)).map(flat).collect();
            if cut.len() < 3 {
                continue;
            }
            let n = cut.len() as f64;
            let middle = cut.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
            let angle = |p: &[f64; 2]| (p[1] - middle[1]).atan2(p[0] - middle[0]);
            cut.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            cells.push((i, cut));
        }
    }
    let loops: Vec<Vec<[f64; 2]>> = bones
        .iter()
        .flat_map(|bone| surface_section(&bone.surface, y))
        .map(|points| points.into_iter().map(flat).collect())
        .collect();
    let points = cells.iter().map(|c| &c.1).chain(&loops).flatten().copied();
    let frame = Frame::around(points, SECTION_SCALE);
    let mut out = frame.open(&format!("section at y = {:.0} mm", y * 1e3));
    out.push_str(
        "<g stroke=\"#000\" stroke-opacity=\".45\" stroke-width=\".5\" stroke-linejoin=\"round\">\n",
    );
    for (i, corners) in &cells {
        let _ = writeln!(out, "<path fill=\"{}\" d=\"{}\"/>", colour(*i, 0.75), frame.path(corners));
    }
    for corners in &loops {
        let _ = writeln!(out, "<path fill=\"{}\" d=\"{}\"/>", bone_colour(0.7), frame.path(corners));
    }
    out.push_str("</g>\n");
    for (i, muscle) in muscles.iter().enumerate() {
        let own: Vec<[f64; 2]> =
            cells.iter().filter(|c| c.0 == i).flat_map(|c| c.1.iter().copied()).collect();
        if own.is_empty() {
            continue;
        }
        let n = own.len() as f64;
        let [x, y] = frame.at(own.iter().fold([0.0; 2], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]));
        let _ = writeln!(
            out,
            "<text class=\"mid\" style=\"fill:#111;font-size:9px;paint-order:stroke;stroke:#fff;stroke-width:2.5px\" x=\"{}\" y=\"{}\">{}</text>",
            px(x),
            px(y + 3.0),
            escape(&muscle.name.replace('_', " "))
        );
    }
    out.push_str(&frame.scale_bar());
    out.push_str("</svg>\n");
    out
}

/// Edges of a hexahedron.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [1, 2], [3, 2], [0, 3], [4, 5], [5, 6], [7, 6], [4, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Where a segment passes the height `y`.
fn crossing(a: Vector3<f64>, b: Vector3<f64>, y: f64) -> Option<Vector3<f64>> {
    ((a.y < y) != (b.y < y)).then(|| a + (b - a) * ((y - a.y) / (b.y - a.y)))
}

/// Closed lines in which a closed surface meets the plane of height `y`.
pub(super) fn surface_section(surface: &Surface, y: f64) -> Vec<Vec<Vector3<f64>>> {
    // Every cut triangle leads from one cut edge to another; edges are named by their points.
    let mut next: BTreeMap<[u32; 2], ([u32; 2], Vector3<f64>)> = BTreeMap::new();
    for (t, corners) in surface.triangles.iter().enumerate() {
        let x = surface.corners(t);
        let (mut from, mut to) = (None, None);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if let Some(point) = crossing(x[k], x[(k + 1) % 3], y) {
                let end = Some(([a.min(b), a.max(b)], point));
                // Seen from inside the triangle one edge goes up and the other down.
                if x[k].y < y { from = end } else { to = end }
            }
        }
        if let (Some((from, point)), Some((to, _))) = (from, to) {
            next.insert(from, (to, point));
        }
    }
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.iter().next() {
        let mut line = Vec::new();
        let mut at = start;
        while let Some((to, point)) = next.remove(&at) {
            line.push(point);
            at = to;
        }
        loops.push(line);
    }
    loops
}

/// From m to pixels.
struct Frame {
    low: [f64; 2],
    size: [f64; 2],
    scale: f64,
}

impl Frame {
    fn around(points: impl Iterator<Item = [f64; 2]>, scale: f64) -> Frame {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in points {
            for d in 0..2 {
                low[d] = low[d].min(p[d]);
                high[d] = high[d].max(p[d]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 2], [0.0; 2]); // nothing to show
        }
        Frame { low, size: [0, 1].map(|d| scale * (high[d] - low[d]) + 2.0 * MARGIN), scale }
    }

    fn at(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|d| MARGIN + self.scale * (p[d] - self.low[d]))
    }

    fn open(&self, title: &str) -> String {
        let [w, h] = self.size;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
            px(w),
            px(h),
            escape(title)
        )
    }

    /// A bar below the picture, in its margin.
    fn scale_bar(&self) -> String {
        let length = if self.scale > 2000.0 { 20e-3 } else { 100e-3 };
        let (end, y) = (MARGIN + self.scale * length, self.size[1] - 14.0);
        format!(
            "<path d=\"M{MARGIN} {}v4H{}v-4\" fill=\"none\" stroke=\"currentColor\" stroke-width=\"1.5\"/><text x=\"{}\" y=\"{}\">{:.0} mm</text>\n",
            px(y),
            px(end),
            px(end + 8.0),
            px(y + 6.0),
            length * 1e3
        )
    }

    fn path(&self, corners: &[[f64; 2]]) -> String {
        let mut d = String::new();
        for (i, &p) in corners.iter().enumerate() {
            let [x, y] = self.at(p);
            let _ = write!(d, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
        }
        d.push('Z');
        d
    }
}
