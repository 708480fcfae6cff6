//! A knee that the program makes, of balls and planes ([`Shape`]): no data are needed.
//!
//! Shaft and head are those of the built-in thigh, and the knee stands where its bellies end: one person.
//! The tibia turns around the middle of the medial condyle, a ball on a plane, so flexion and internal rotation leave both condyles on it.

use fem::geometry::{DistanceField, SearchSurface, Surface, SurfaceError};
use fem::mesh::MeshError;
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::anatomy::{BellyFit, Bone, FemurSolid, Frames, KneeAnatomy, SUNK, Spring, moved};
use super::level::level;
use super::pose::{Coordinates, TibiaPath};
use super::rigid::ReferencePose;
use super::shape::Shape;
use super::solid::{self, MadeFemur};
use crate::thigh::limb;
use crate::thigh::registration::MeshFrames;

/// Where the middle of the knee is in the frame of the built-in thigh \[m\], and by how much it is turned outward there \[degrees\]: bellies of the
/// quadriceps end 16 mm to lateral of the middle of that femur, so the groove looks to where they end.
const MIDDLE: [f64; 3] = [-8e-3, -3e-3, 6e-3];
const OUTWARD: f64 = 12.0;
/// Ends of bellies go a fifth of their distance away from the shaft: tendons have scaled Jacobians from 0.30 up at 4 and at 10 mm, and without it one
/// of vastus lateralis is turned over at 4 mm.
const FIT: BellyFit = BellyFit { turn: 0.0, shift: 0.2 };
/// The patella in extension: how far its middle is above that of the groove, seen from there, and its flexion \[degrees\].
const ABOVE: f64 = 8.0;
const FLEXION: f64 = 5.0;
/// Room \[m\] between its ridge and the bottom of the groove in extension, before it is moved off the femur.
const ROOM: f64 = 0.3e-3;
/// Internal rotation of the tibia over flexion \[degrees\]: chosen, with the shape that Qi et al. 2013 describe (sharp rise to 30, little to 120, sharp
/// rise beyond; their numbers were not read).
const INTERNAL: [[f64; 2]; 4] = [[0.0, 0.0], [30.0, 6.0], [120.0, 9.0], [140.0, 14.0]];
/// From row to row of its path \[degrees\].
const ROW: f64 = 5.0;
/// Edges of the triangles \[m\] of the cartilage of the femur, and of its bone.
const EDGES: [f64; 2] = [1e-3, 2.5e-3];
/// Box \[m\] around the cartilage of the femur.
const BOX: [[f64; 3]; 2] = [[-0.03, -0.03, -0.045], [0.055, 0.045, 0.045]];
/// Squares along a side of a sheet of cartilage: its edges are 1 mm.
const SQUARES: usize = 40;
/// Rounding \[m\] of the ridge of the patella.
const RIDGE: f64 = 3e-3;
/// Half of the length and of the width \[m\] of the cartilages of the tibia, how far their middle is before that of the condyles, and the radius of
/// the medial one, which is hollow.
const PLATEAU: [f64; 2] = [19e-3, 13e-3];
const BEFORE: f64 = 5e-3;
const HOLLOW: f64 = 120e-3;
/// Directions of the ends on the femur of retinacula and of the lateral collateral ligament, from the middle of a condyle: forward, up, and aside.
const EPICONDYLE: [f64; 3] = [0.0, 0.25, 1.0];

/// Why there is no such knee.
#[derive(Debug, Error)]
pub enum MadeError {
    /// Measures that no knee has.
    #[error("no knee has such measures: {}", .0.join("; "))]
    Shape(Vec<String>),
    /// The tables of the thigh.
    #[error(transparent)]
    Thigh(#[from] MeshError),
    /// Its femur is no closed surface.
    #[error("femur of the built-in thigh: {0}")]
    Femur(#[from] SurfaceError),
}

/// A knee and the way of its tibia.
pub struct MadeKnee {
    /// Surfaces and strands.
    pub anatomy: KneeAnatomy,
    /// Poses of the tibia from 0 to 140 degrees.
    pub path: TibiaPath,
    /// Tibia and patella in extension.
    pub reference: ReferencePose,
}

impl MadeKnee {
    /// Makes it.
    pub fn new(shape: &Shape) -> Result<MadeKnee, MadeError> {
        let problems = shape.problems();
        if !problems.is_empty() {
            return Err(MadeError::Shape(problems));
        }
        let path = path(shape);
        let reference = ReferencePose { tibia: path.rows()[0], patella: patella_in_extension(shape) };
        // From the frame of the made femur into that of the thigh.
        let MeshFrames { thigh, knee, .. } = MeshFrames::built_in();
        let axes = Rotation3::from_matrix_eps(&thigh, 1e-12, 100, Rotation3::identity());
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -OUTWARD.to_radians());
        let stands = Isometry3::from_parts(knee.into(), axes.into())
            * Isometry3::from_parts(Translation3::from(Vector3::from(MIDDLE)), turned);
        let frames: Frames = [
            (Bone::Femur, stands),
            (Bone::Tibia, stands * reference.tibia.pose()),
            (Bone::Patella, stands * reference.patella.pose()),
        ]
        .into();
        let limb = limb()?;
        let femur = limb.bones.iter().find(|b| b.name == "femur").expect("the built-in thigh has a femur");
        let shaft = moved(&femur.surface, &stands.inverse());
        let in_frame = |bone: Bone, surface: Surface| moved(&surface, &frames[&bone]);
        let search = SearchSurface::new(shaft.clone());
        let solid = MadeFemur::new(shape, &search, SUNK)?;
        let around = solid.sampled(BOX.map(Vector3::from), EDGES[0]);
        let (lo, hi) = shaft.bounds();
        let margin = Vector3::repeat(10e-3);
        let whole = solid.sampled([lo - margin, hi + margin], EDGES[1]);
        let [facets, bone] = patella(shape);
        let anatomy = KneeAnatomy {
            femoral_cartilage: in_frame(Bone::Femur, cartilage(&solid, &around)),
            patellar_cartilage: in_frame(Bone::Patella, facets),
            patella: in_frame(Bone::Patella, bone),
            femur: in_frame(Bone::Femur, level(&whole, 0.0, EDGES[1])),
            tibial_cartilage: [-1.0, 1.0].map(|side| in_frame(Bone::Tibia, plateau(shape, side))),
            springs: springs(shape, &around, &frames),
            frames,
            solid: FemurSolid::Made { shape: *shape, shaft },
            fit: FIT,
        };
        Ok(MadeKnee { anatomy, path, reference })
    }
}

/// The tibia turned around the middle of the medial condyle.
fn path(shape: &Shape) -> TibiaPath {
    let last = INTERNAL[INTERNAL.len() - 1][0];
    let rows = (0..=(last / ROW) as usize).map(|k| {
        let flexion = k as f64 * ROW;
        let [a, b] =
            INTERNAL.windows(2).map(|w| [w[0], w[1]]).find(|w| flexion <= w[1][0]).expect("in the table");
        let t = (flexion - a[0]) / (b[0] - a[0]);
        let turned = Coordinates { flexion, turn_x: 0.0, turn_y: a[1] + t * (b[1] - a[1]), place: [0.0; 3] };
        let middle = Vector3::new(0.0, 0.0, -shape.condyle_aside);
        let place = 1e3 * (middle - turned.pose() * middle);
        Coordinates { place: place.into(), ..turned }
    });
    TibiaPath::of(rows.collect())
}

fn patella_in_extension(shape: &Shape) -> Coordinates {
    let [x, y] = shape.trochlea;
    // Where both balls are equally near, their seam adds a quarter of it.
    let r = 0.5 * (shape.trochlea_radius[0] + shape.trochlea_radius[1]) + 0.25 * solid::SEAM;
    let groove = (r * r - shape.trochlea_aside.powi(2)).sqrt();
    let out = groove + shape.patella_depth[0] + ROOM;
    let (sin, cos) = ABOVE.to_radians().sin_cos();
    let place = [1e3 * (x + out * cos), 1e3 * (y + out * sin), 0.0];
    Coordinates { flexion: FLEXION, turn_x: 0.0, turn_y: 0.0, place }
}

/// A sheet of squares bent over a disc, two triangles each, whose normals look to where `place` goes counter-clockwise.
fn disc(place: impl Fn(f64, f64) -> [f64; 3]) -> Surface {
    let n = SQUARES;
    let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
    let on_disc = |i: usize, j: usize| {
        let [u, v] = [at(i), at(j)];
        place(u * (1.0 - 0.5 * v * v).sqrt(), v * (1.0 - 0.5 * u * u).sqrt())
    };
    let points = (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))).map(|(i, j)| on_disc(i, j)).collect();
    let number = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    let squares = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    let halves = squares.flat_map(|(i, j)| {
        let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
        // Diagonals run towards the corners of the disc, where squares are flat.
        if (2 * i < n) == (2 * j < n) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    });
    Surface { points, triangles: halves.collect() }
}

/// Cartilage and bone of the patella in its own frame.
fn patella(shape: &Shape) -> [Surface; 2] {
    let [height, width] = shape.patella;
    let [back, front] = shape.patella_depth;
    let behind = |y: f64, z: f64, shift: f64| {
        let aside = (z * z + RIDGE * RIDGE).sqrt() - RIDGE;
        shift - back + aside * shape.facet_turn.tan() + y * y / (2.0 * shape.ridge_radius)
    };
    // Cartilage ends a tenth before the border.
    let facets = disc(|u, v| {
        let (y, z) = (0.9 * height * v, 0.9 * width * u);
        [behind(y, z, 0.0), y, z]
    });
    let back_side = disc(|u, v| {
        let (y, z) = (height * v, width * u);
        [behind(y, z, shape.patella_cartilage), y, z]
    });
    // The front is a dome over the same disc; both share their border.
    let mut bone = back_side;
    let n_back = bone.points.len() as u32;
    let n = SQUARES as u32;
    let is_border = |k: u32| [k / (n + 1), k % (n + 1)].iter().any(|c| *c == 0 || *c == n);
    let mut other: Vec<u32> = (0..n_back).collect();
    for k in (0..n_back).filter(|k| !is_border(*k)) {
        let [x, y, z] = bone.points[k as usize];
        let r2 = (y / height).powi(2) + (z / width).powi(2);
        other[k as usize] = bone.points.len() as u32;
        bone.points.push([x + (front - x) * (1.0 - r2).max(0.0).sqrt(), y, z]);
    }
    let front_side: Vec<[u32; 3]> =
        bone.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|k| other[k as usize])).collect();
    bone.triangles.extend(front_side);
    [facets, bone]
}

/// Cartilage of the tibia on a side, under the middle of a condyle.
fn plateau(shape: &Shape, side: f64) -> Surface {
    disc(|u, v| {
        let (x, z) = (PLATEAU[0] * v, PLATEAU[1] * u);
        let hollow = if side < 0.0 { (x * x + z * z) / (2.0 * HOLLOW) } else { 0.0 };
        [x + BEFORE, hollow - shape.condyle_radius, z + side * shape.condyle_aside]
    })
}

/// What of the surface of the femur is cartilage.
fn cartilage(femur: &MadeFemur, around: &DistanceField) -> Surface {
    let surface = level(around, 0.0, EDGES[0]);
    let is_kept = |t: &u32| {
        let middle = surface.corners(*t as usize).iter().sum::<Vector3<f64>>() / 3.0;
        femur.is_cartilage(&middle)
    };
    let kept: Vec<u32> = (0..surface.triangles.len() as u32).filter(is_kept).collect();
    surface.subset(&kept).0
}

/// Ligament of the patella (its whole width is 0.8 of that of the patella there and 0.7 on the tibia, chosen), retinacula from places along its borders, and where the lateral collateral ligament comes from.
fn springs(shape: &Shape, femur: &DistanceField, frames: &Frames) -> Vec<Spring> {
    let [height, width] = shape.patella;
    let mut all = Vec::new();
    let mut add = |name: &str, ends: [(Bone, Vector3<f64>); 2]| {
        let ends = ends.map(|(bone, at)| (bone, frames[&bone] * Point3::from(at)));
        all.push(Spring { name: name.into(), ends });
    };
    // From lateral to medial over half of the width of the patella, a little less on the tibia.
    for (k, name) in ["PT1", "PT5", "PT3", "PT4", "PT6", "PT2"].into_iter().enumerate() {
        let aside = 1.0 - k as f64 / 2.5;
        let apex = Vector3::new(0.0, -0.95 * height, 0.4 * width * aside);
        let foot = Vector3::from(shape.tuberosity) + 0.35 * width * aside * Vector3::z();
        add(name, [(Bone::Patella, apex), (Bone::Tibia, foot)]);
    }
    let epicondyle = |side: f64| {
        let [x, y, z] = EPICONDYLE;
        let from = Vector3::new(0.0, 0.0, side * shape.condyle_aside);
        on_surface(femur, from, Vector3::new(x, y, side * z).normalize())
    };
    let border =
        |up: f64, side: f64| Vector3::new(-0.2 * shape.patella_depth[0], up * height, 0.95 * side * width);
    let lateral: [&[&str]; 3] =
        [&["lPFL1", "lPFL7", "lPFL5"], &["lPFL4", "lPFL3"], &["lPFL8", "lPFL6", "lPFL2"]];
    for (names, up) in lateral.iter().zip([0.4, 0.0, -0.4]) {
        for name in *names {
            add(name, [(Bone::Patella, border(up, 1.0)), (Bone::Femur, epicondyle(1.0))]);
        }
    }
    for (names, up) in [["mPFL1", "mPFL5", "mPFL4"], ["mPFL3", "mPFL6", "mPFL2"]].iter().zip([0.5, 0.1]) {
        for name in names {
            add(name, [(Bone::Patella, border(up, -1.0)), (Bone::Femur, epicondyle(-1.0))]);
        }
    }
    for name in ["LCL1", "LCL2", "LCL3", "LCL4"] {
        let head = Vector3::new(-0.5 * shape.condyle_radius, -2.2 * shape.condyle_radius, shape.half_width);
        add(name, [(Bone::Femur, epicondyle(1.0)), (Bone::Tibia, head)]);
    }
    all
}

/// Where a ray from inside leaves the femur.
fn on_surface(femur: &DistanceField, from: Vector3<f64>, along: Vector3<f64>) -> Vector3<f64> {
    let mut at = from;
    // A distance is at most the way to the surface, so steps of it never go beyond.
    for _ in 0..200 {
        let Some(here) = femur.at(&at) else { break };
        at -= here.distance * along;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_of_no_knee_are_refused_all_at_once() {
        assert_eq!(Shape::default().problems(), Vec::<String>::new());
        let wrong =
            Shape { condyle_radius: -1.0, trochlea_aside: 30e-3, half_width: f64::NAN, ..Shape::default() };
        let said = MadeKnee::new(&wrong).err().unwrap().to_string();
        for word in
            ["condyle_radius is -1 m", "trochlea_aside is 0.03 m, must be at most", "half_width is NaN m"]
        {
            assert!(said.contains(word), "{word}: {said}");
        }
    }

    #[test]
    fn cartilage_covers_the_seam_of_condyle_and_trochlea() {
        let knee = MadeKnee::new(&Shape::default()).unwrap().anatomy;
        let own = knee.placed(&knee.femoral_cartilage, Bone::Femur, &Isometry3::identity());
        for z in [-21e-3, 21e-3] {
            // Under the condyles from behind their middle to the trochlea.
            for k in -5..=20 {
                let x = 1e-3 * f64::from(k);
                let is_under =
                    |p: &[f64; 3]| (p[0] - x).abs() < 0.8e-3 && (p[2] - z).abs() < 0.8e-3 && p[1] < -10e-3;
                assert!(own.points.iter().any(is_under), "no cartilage under {x} {z}");
            }
        }
    }

    #[test]
    fn both_condyles_stay_on_the_tibia_in_every_pose() {
        let shape = Shape::default();
        for row in path(&shape).rows() {
            for side in [-1.0, 1.0] {
                let middle = Point3::new(0.0, 0.0, side * shape.condyle_aside);
                let in_tibia = row.pose().inverse() * middle;
                assert!(in_tibia.y.abs() < 1e-15, "{row:?}: {in_tibia}");
            }
            // Internal rotation takes the lateral condyle back on the tibia and leaves the medial one where it is.
            let [medial, lateral] = [-1.0, 1.0].map(|side: f64| {
                (row.pose().inverse() * Point3::new(0.0, 0.0, side * shape.condyle_aside)).x
            });
            let back = 2.0 * shape.condyle_aside * row.turn_y.to_radians().sin();
            assert!(medial.abs() < 1e-15 && (lateral + back).abs() < 1e-15, "{row:?}: {medial} {lateral}");
        }
    }

    #[test]
    fn a_made_knee_has_the_measures_of_its_shape() {
        let shape = Shape::default();
        let made = MadeKnee::new(&shape).unwrap();
        let a = &made.anatomy;
        assert!(a.femur.is_closed() && a.femur.volume() > 0.0 && a.femur.components().1 == 1);
        assert!(
            a.patella.is_closed() && (10e-6..40e-6).contains(&a.patella.volume()),
            "{}",
            a.patella.volume()
        );
        // Normals of sheets look into the joint: back, and away from the bone.
        let frame = a.frame(Bone::Patella).inverse();
        let back: f64 = (0..a.patellar_cartilage.triangles.len())
            .map(|t| (frame.rotation * a.patellar_cartilage.area_vector(t)).x)
            .sum();
        assert!((-1.6e-3..-0.8e-3).contains(&back), "{back}");
        for (sheet, side) in a.tibial_cartilage.iter().zip([-1.0, 1.0]) {
            let up = (0..sheet.triangles.len()).map(|t| sheet.area_vector(t).y).sum::<f64>();
            assert!((5e-4..9e-4).contains(&up), "side {side}: {up}");
        }
        // The groove is a circle of 23 mm around its middle, and condyles are balls.
        let own = a.placed(&a.femoral_cartilage, Bone::Femur, &Isometry3::identity());
        let [x, y] = shape.trochlea;
        let (mut groove, mut ball): (Vec<f64>, f64) = (Vec::new(), 0.0);
        for p in &own.points {
            if p[2].abs() < 0.7e-3 && p[0] > x && p[1] < y {
                groove.push((p[0] - x).hypot(p[1] - y));
            }
            let from = Vector3::new(p[0], p[1], p[2].abs() - shape.condyle_aside);
            if p[0] < -5e-3 && p[1] < -5e-3 && from.z.abs() < 6e-3 {
                ball = ball.max((from.norm() - shape.condyle_radius).abs());
            }
        }
        let [least, most] =
            [groove.iter().copied().fold(f64::MAX, f64::min), groove.iter().copied().fold(0.0, f64::max)];
        assert!(
            groove.len() > 30 && least > 22.5e-3 && most < 23.8e-3,
            "{least} to {most} of {}",
            groove.len()
        );
        assert!(ball < 0.2e-3, "{ball}");
    }
}
