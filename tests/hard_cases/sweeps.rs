//! Contact on long ways: C5 (squeezed through a tube, in time) and C7 (patella in its groove, a sequence of equilibria of a stiff body
//! on strands in place of a free rigid one).

#![allow(non_snake_case)]

use crate::{Case, Outcome, Tier};
use fem::body::Pose;
use fem::measure::{pair_forces, volume};
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame, Frame, run};
use fem::scene::{ContactMode, ContactSpec, GravitySpec, InertiaSpec, LawSpec, Scene, StrandSpec, TieSpec};
use fem::solve::{Settings, Stability};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use support::contact_scenes::{add, guarded};
use support::fem_scenes::held;

pub const CASES: &[Case] = &[
    Case {
        id: "C5",
        title: "five soft blobs through a tube of half their width",
        tier: Tier::Full,
        run: squeeze,
    },
    Case {
        id: "C7",
        title: "patella in its groove, 0 to 140 degrees, guarded",
        tier: Tier::Full,
        run: groove_guarded,
    },
    Case {
        id: "C7",
        title: "patella in its groove, 0 to 140 degrees, cheap",
        tier: Tier::Full,
        run: groove_cheap,
    },
];

/// A rigid shell of one layer of `n` cells, all of it held; `map` carries the unit cube to places \[m\]. Its surface is `name_z_max`.
fn rigid(
    scene: &mut Scene,
    mesh: &mut Mesh,
    name: &str,
    n: [usize; 2],
    map: impl Fn([f64; 3]) -> [f64; 3],
) -> String {
    generate::append(mesh, generate::mapped([n[0], n[1], 1], map), name);
    for side in ["z_min", "z_max"] {
        scene.prescribed.push(held(&format!("{name}_{side}"), [true; 3]));
    }
    format!("{name}_z_max")
}

/// Five blobs 15 mm wide and round in a tube that narrows to half their width, under an acceleration along it: 1000 m/s² until three
/// are through, three times as much for the last two, which nothing pushes from behind. Afterwards they fly on and come to rest in
/// themselves. Steps of 1 ms, to a residual of a thousandth of the forces in play.
fn squeeze() -> Outcome {
    let (radius, count, apart, throat) = (8e-3, 5, 16.5e-3, 3.75e-3);
    let (mut scene, mut mesh, mut surfaces) = (Scene::default(), Mesh::default(), Vec::new());
    for i in 0..count {
        // A cube blown up to a ball, but for a third: the cells at its edges would be flat.
        let blob = generate::mapped([5; 3], |s| {
            let [x, y, z] = s.map(|s| 2.0 * s - 1.0);
            let out = |a: f64, b: f64| (1.0 - a * a / 2.0 - b * b / 2.0 + a * a * b * b / 3.0).sqrt();
            let round = [x * out(y, z), y * out(x, z), z * out(x, y)];
            std::array::from_fn(|c| radius * (0.65 * round[c] + 0.35 * 0.75 * [x, y, z][c]))
        });
        let (name, place) = (format!("blob{i}"), [0.0, 0.0, -32e-3 - i as f64 * apart]);
        add(&mut scene, &mut mesh, &name, blob, place, LawSpec::NeoHookean { young: 30e3, nu: 0.49 });
        surfaces.push(format!("{name}_block"));
    }
    // 18 mm wide, narrowed over 22 mm before and behind the throat of 6 mm.
    let (from, to) = (-110e-3, 30e-3);
    surfaces.push(rigid(&mut scene, &mut mesh, "tube", [24, 70], |s| {
        let (angle, z) = (-2.0 * PI * s[0], from + (to - from) * s[1]);
        let far = ((z.abs() - 3e-3) / 22e-3).clamp(0.0, 1.0);
        let r = throat + (9e-3 - throat) * 0.5 * (1.0 - (PI * far).cos()) + 2e-3 * (1.0 - s[2]);
        [r * angle.cos(), r * angle.sin(), z]
    }));
    let spec = ContactSpec::new(&surfaces.iter().map(String::as_str).collect::<Vec<_>>());
    scene.contact = Some(ContactSpec { spacing: Some(3e-3), ..spec });
    scene.gravity = Some(GravitySpec { acceleration: [0.0, 0.0, 1000.0], control: "pull".into() });
    scene.inertia = Some(InertiaSpec::default());
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let frame = |i: usize| -> Result<DriveFrame, String> {
        let pull = match i {
            ..=20 => 1.0,
            21..=35 => 3.0,
            _ => 0.0,
        };
        let load = plan.load(&[("pull", pull)], &[]).map_err(|e| e.to_string())?;
        Ok(DriveFrame { time: 1e-3 * i as f64, load })
    };
    let drive = Drive { frames: (1..=70).map(frame).collect::<Result<_, _>>()? };
    let stability = Stability::Never; // what is unstable moves on by itself
    let settings = Settings { tolerance: 1e-3, max_iterations: 200, stability, ..Settings::default() };
    let out = guarded(&plan, &drive, &settings)?;
    let off = |frame: &Frame, i: usize| {
        let (rest, now) = volume(&plan, frame.snapshot(), &format!("blob{i}_block")).expect("a solid");
        (now / rest - 1.0).abs()
    };
    let last = out.last().expect("solved");
    for i in 0..count {
        let nodes = &plan.mesh.blocks[i].nodes;
        let back = nodes.iter().map(|&n| last.x[3 * n as usize + 2]).fold(f64::MAX, f64::min);
        if back < to {
            return Err(format!("blob {i} is not through the tube, its back is at {back} m"));
        }
    }
    let end = (0..count).map(|i| off(last, i)).fold(0.0, f64::max);
    let on_the_way = out.frames.iter().flat_map(|f| (0..count).map(|i| off(f, i))).fold(0.0, f64::max);
    let text = format!(
        "all through in {} frames, {:.0} iterations each, least det F {:.2}; volume off by at most {:.1} % on the way, {:.1e} at the end",
        out.frames.len(),
        out.iterations.len() as f64 / out.frames.len() as f64,
        out.frames.iter().flat_map(|f| &f.islands).map(|i| i.least_det_f).fold(f64::MAX, f64::min),
        100.0 * on_the_way,
        end
    );
    if end < 1e-3 { Ok(text) } else { Err(text) }
}

/// Flexion per frame \[degrees\].
const STEP: f64 = 1.0;

/// Fraction of a signal's change that lies above ten cycles over its length (the motion is one), by the cosine transform.
pub fn rapid_fraction(signal: &[f64]) -> f64 {
    let n = signal.len();
    let power = |k: usize| -> f64 {
        let sum: f64 = (0..n).map(|i| signal[i] * (PI * k as f64 * (i as f64 + 0.5) / n as f64).cos()).sum();
        sum * sum
    };
    // The k-th cosine has k / 2 cycles.
    let (slow, rapid): (f64, f64) = ((1..=20).map(power).sum(), (21..n).map(power).sum());
    (rapid / (slow + rapid)).sqrt()
}

/// The turn and shift that take the points `from` to `to` best (Arun, Huang & Blostein, IEEE Trans. PAMI 9 (1987)): six numbers, in m
/// and rad.
fn rigid_motion(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> [f64; 6] {
    let mean = |p: &[Vector3<f64>]| p.iter().sum::<Vector3<f64>>() / p.len() as f64;
    let (a, b) = (mean(from), mean(to));
    let H: Matrix3<f64> = from.iter().zip(to).map(|(p, q)| (q - b) * (p - a).transpose()).sum();
    let turn = Rotation3::from_matrix_eps(&H, 1e-14, 1000, Rotation3::identity()).scaled_axis();
    let shift = b - a;
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

fn groove(mode: ContactMode) -> Outcome {
    let (trochlea, widening) = (22e-3, 15e-3);
    // Where a point at angle α from x towards z, y across and height h above the bottom of the groove is.
    let at = |alpha: f64, y: f64, h: f64| {
        let r = trochlea + h;
        [r * alpha.cos(), y, r * alpha.sin()]
    };
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    // A patella of 24 x 20 x 12 mm above α = 20 degrees, more curved across than the groove, nearly flat along it. Its cells are 1 mm
    // wide: with 3.3 mm the facets of its back are so large that it rocks from one to the next (rapid fraction of its turn 6 %).
    let start = 20f64.to_radians();
    let along = [-start.sin(), 0.0, start.cos()];
    let patella = generate::mapped([10, 20, 2], |s| {
        let (p, y) = (24e-3 * (s[0] - 0.5), -20e-3 * (s[1] - 0.5));
        let low = y * y / (2.0 * 11e-3) + p * p / (2.0 * 80e-3);
        let h = 0.4e-3 + low + (12e-3 - low) * s[2];
        let foot = at(start, y, h);
        [0, 1, 2].map(|d| foot[d] + p * along[d])
    });
    add(&mut scene, &mut mesh, "patella", patella, [0.0; 3], LawSpec::NeoHookean { young: 20e6, nu: 0.3 });
    let n_patella = mesh.points.len();
    let femur = rigid(&mut scene, &mut mesh, "femur", [120, 20], |s| {
        let (alpha, y) = ((60.0 - 240.0 * s[0]).to_radians(), 13e-3 * (2.0 * s[1] - 1.0));
        at(alpha, y, y * y / (2.0 * widening) - 2e-3 * (1.0 - s[2]))
    });
    // Quadriceps from the top edge, 15 degrees to the side; ligament from the bottom edge to the tibia, 1 N and 10 N per 1 %.
    let mut strands = |name: &str, side: &str, stiffness: f64, end: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let (mut lines, mut ends) = (Vec::new(), Vec::new());
        for &n in mesh.node_sets[side].clone().iter().filter(|n| *n % 4 == 0) {
            ends.push(mesh.points.len() as u32);
            lines.extend([n, mesh.points.len() as u32]);
            mesh.points.push(end(mesh.points[n as usize]));
        }
        mesh.blocks.push(CellBlock { name: name.into(), kind: CellKind::Line2, nodes: lines });
        mesh.node_sets.insert(format!("{name}_ends"), ends);
        let reference_strain = 0.05;
        scene.strands.push(StrandSpec { region: name.into(), stiffness, toe: 0.01, reference_strain });
    };
    strands("quadriceps", "patella_x_max", 20.0, &|p| [-0.1, p[1] + 0.07, 0.27]);
    strands("ligament", "patella_x_min", 200.0, &|p| {
        let r = 50e-3;
        let angle = -50f64.to_radians();
        [r * angle.cos(), 0.8 * p[1], r * angle.sin()]
    });
    // The muscle lies on the femur when the knee is bent; here its far end turns with 0.6 of the flexion instead.
    scene.ties.push(TieSpec { nodes: "quadriceps_ends".into(), body: "muscle".into() });
    scene.ties.push(TieSpec { nodes: "ligament_ends".into(), body: "tibia".into() });
    scene.contact = Some(ContactSpec { mode, ..ContactSpec::new(&["patella_block", &femur]) });
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let steps = (140.0 / STEP) as usize;
    let frame = |i: usize| -> Result<DriveFrame, String> {
        let angle = (i as f64 * STEP).to_radians();
        let turned = |angle: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
            Pose::from_parts(Translation3::identity(), turn)
        };
        let poses = [("tibia", turned(angle)), ("muscle", turned(0.6 * angle))];
        let load = plan.load(&[], &poses).map_err(|e| e.to_string())?;
        Ok(DriveFrame { time: i as f64 * STEP, load })
    };
    let drive = Drive { frames: (0..=steps).map(frame).collect::<Result<_, _>>()? };
    let out = match mode {
        ContactMode::Guarded => guarded(&plan, &drive, &Settings::default())?,
        ContactMode::Cheap => run(&plan, &drive, &Settings::default(), None, &mut |_| {}),
    };
    if let Some(e) = out.errors.first() {
        return Err(format!("at {} degrees: {e}", out.frames.len() as f64 * STEP));
    }
    let place = |x: &[f64]| -> Vec<Vector3<f64>> {
        x[..3 * n_patella].as_chunks::<3>().0.iter().map(|p| Vector3::from(*p)).collect()
    };
    let rest = place(&plan.reference());
    let motions: Vec<[f64; 6]> = out.frames.iter().map(|f| rigid_motion(&rest, &place(&f.x))).collect();
    let force = |f: &Frame| -> f64 {
        let pairs = pair_forces(&plan, f.snapshot(), [0.0; 3]);
        pairs.iter().map(|p| Vector3::from(p.wrench.force).norm()).sum()
    };
    let forces: Vec<f64> = out.frames.iter().map(force).collect();
    let chatter = rapid_fraction(&forces);
    // Of the six coordinates those that move by a tenth of a millimetre or half a degree.
    let coordinate = |c: usize| -> Vec<f64> { motions.iter().map(|m| m[c]).collect() };
    let range =
        |s: &[f64]| s.iter().fold(f64::MIN, |m, v| m.max(*v)) - s.iter().fold(f64::MAX, |m, v| m.min(*v));
    let moving =
        (0..6).map(coordinate).enumerate().filter(|(c, s)| range(s) > if *c < 3 { 1e-4 } else { 9e-3 });
    let fractions: Vec<(usize, f64)> = moving.map(|(c, s)| (c, rapid_fraction(&s))).collect();
    let rough = fractions.iter().map(|(_, s)| *s).fold(0.0, f64::max);
    let text = format!(
        "{} frames, {:.0} iterations each; contact {:.2} to {:.2} N, rapid fraction {:.2} %; {} of 6 coordinates move, rapid fraction at most {:.2} %",
        out.frames.len(),
        out.iterations.len() as f64 / out.frames.len() as f64,
        forces.iter().fold(f64::MAX, |m, f| m.min(*f)),
        forces.iter().fold(0.0, |m: f64, f| m.max(*f)),
        100.0 * chatter,
        fractions.len(),
        100.0 * rough
    );
    if chatter < 0.02 && rough < 0.02 && forces.iter().all(|f| *f > 0.0) { Ok(text) } else { Err(text) }
}

fn groove_guarded() -> Outcome {
    groove(ContactMode::Guarded)
}

fn groove_cheap() -> Outcome {
    groove(ContactMode::Cheap)
}
