//! A bent knee cut through from front to back: bones, cartilage, muscles, and the ways of ligament and quadriceps as seen from lateral.

use std::fmt::Write;

use coupling::knee::anatomy::{Bone, KneeAnatomy};
use coupling::knee::flexion::{Bent, FlexionFrame};
use coupling::knee::muscles::MUSCLES;
use fem::geometry::Surface;
use mesher::MusclePart;
use nalgebra::{Isometry3, Vector3};

use super::anatomy::surface_section;
use super::svg::{escape, fixed, px};

/// Flexions \[degrees\] that are drawn, or the frames nearest to them.
const DRAWN: [f64; 4] = [25.0, 55.0, 100.0, 137.5];
/// What is seen, backward to forward and down to up \[mm\] from the middle of the knee.
const SEEN: [[f64; 2]; 2] = [[-75.0, 85.0], [-85.0, 95.0]];
/// Pixels in a millimetre.
const SCALE: f64 = 2.0;

/// A figure per flexion, the plane where the patella has its middle in the first frame.
pub fn figures(anatomy: &KneeAnatomy, bent: &Bent) -> Vec<String> {
    let Some(first) = bent.frames.first() else { return Vec::new() };
    let z = 1e-3 * first.patella.place[2];
    let nearest = |flexion: f64| {
        let away = |f: &FlexionFrame| (f.tibia.flexion - flexion).abs();
        (0..bent.frames.len()).min_by(|a, b| away(&bent.frames[*a]).total_cmp(&away(&bent.frames[*b])))
    };
    let mut drawn: Vec<usize> = DRAWN.into_iter().filter_map(nearest).collect();
    drawn.dedup();
    drawn.into_iter().map(|k| figure(anatomy, bent, k, z)).collect()
}

/// Place of a point in the picture.
fn at(p: &Vector3<f64>) -> String {
    format!("{} {}", px(SCALE * (1e3 * p.x - SEEN[0][0])), px(SCALE * (SEEN[1][1] - 1e3 * p.y)))
}

/// Where a plane across z cuts a closed surface: lines to be filled.
fn filled(surface: &Surface, z: f64) -> String {
    // The other drawing cuts across y.
    let turned = |p: &Vector3<f64>| Vector3::new(p.x, p.z, p.y);
    let points = surface.points.iter().map(|p| turned(&Vector3::from(*p)).into()).collect();
    let loops = surface_section(&Surface { points, triangles: surface.triangles.clone() }, z);
    let line = |points: Vec<Vector3<f64>>| {
        let places: Vec<String> = points.iter().map(|p| at(&turned(p))).collect();
        format!("M{}Z", places.join("L"))
    };
    loops.into_iter().map(line).collect()
}

/// The same of any surface: a segment per triangle.
fn lines(surface: &Surface, z: f64) -> String {
    let mut d = String::new();
    for t in 0..surface.triangles.len() {
        let corners = surface.corners(t);
        let sides = (0..3).map(|k| (corners[k], corners[(k + 1) % 3]));
        let crossing = |(a, b): (Vector3<f64>, Vector3<f64>)| {
            ((a.z < z) != (b.z < z)).then(|| at(&(a + (b - a) * ((z - a.z) / (b.z - a.z)))))
        };
        let ends: Vec<String> = sides.filter_map(crossing).collect();
        if let [from, to] = &ends[..] {
            let _ = write!(d, "M{from}L{to}");
        }
    }
    d
}

fn figure(anatomy: &KneeAnatomy, bent: &Bent, k: usize, z: f64) -> String {
    let frame = &bent.frames[k];
    let poses = |bone: Bone| match bone {
        Bone::Femur => Isometry3::identity(),
        Bone::Tibia => frame.tibia.pose(),
        Bone::Patella => frame.patella.pose(),
    };
    let placed = |surface: &Surface, bone: Bone| anatomy.placed(surface, bone, &poses(bone));
    let [width, height] = SEEN.map(|[lo, hi]| SCALE * (hi - lo));
    let title = format!("{}°", fixed(frame.tibia.flexion, 1));
    let mut out = format!(
        "<figure><figcaption>{title}</figcaption><svg class=\"knee\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"section at {title}\">\n",
        px(width),
        px(height)
    );
    let mut path = |class: &str, name: &str, d: String| {
        let _ = writeln!(out, "<path class=\"{class}\" d=\"{d}\"><title>{}</title></path>", escape(name));
    };
    for name in MUSCLES.iter().filter(|_| bent.knee.muscles.is_some()) {
        let set = MusclePart::Surface.of(name);
        let x = &bent.run.frames[k].x;
        let points: Vec<[f64; 3]> = x.as_chunks::<3>().0.to_vec();
        let quads = bent.knee.plan.mesh.surfaces.get(&set).map_or(&[][..], Vec::as_slice);
        path("belly", &name.replace('_', " "), filled(&Surface::from_faces(&points, quads).0, z));
    }
    path("bone", "femur", filled(&placed(&anatomy.femur, Bone::Femur), z));
    path("bone", "patella", filled(&placed(&anatomy.patella, Bone::Patella), z));
    path("line c1", "cartilage of the femur", lines(&placed(&anatomy.femoral_cartilage, Bone::Femur), z));
    path(
        "line c2",
        "cartilage of the patella",
        lines(&placed(&anatomy.patellar_cartilage, Bone::Patella), z),
    );
    // The plane of the patella runs between both cartilages of the tibia: they are cut in their middles.
    for cartilage in &anatomy.tibial_cartilage {
        let surface = placed(cartilage, Bone::Tibia);
        let middle = surface.points.iter().map(|p| p[2]).sum::<f64>() / surface.points.len() as f64;
        path("line c1", "cartilage of the tibia", lines(&surface, middle));
    }
    for (name, way) in bent.knee.strands.iter().zip(&frame.ways) {
        let places: Vec<String> = way.iter().map(|p| at(&p.coords)).collect();
        let class = if name.contains("ligament") { "line c3" } else { "line c4" };
        path(class, &name.replace('_', " "), format!("M{}", places.join("L")));
    }
    out.push_str("</svg></figure>");
    out
}
