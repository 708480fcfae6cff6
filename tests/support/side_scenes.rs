//! Scenes in which a body may end on the wrong side of another: large steps of straps, sheets, stacks, blobs and pegs.

use super::Random;
use super::contact_scenes::add;
use fem::body::Pose;
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame};
use fem::scene::{ContactMode, ContactSpec, LawSpec, Scene, TieSpec};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A scene with the way that its bodies go.
pub struct SideScene {
    /// What it is.
    pub name: String,
    /// What is simulated.
    pub scene: Scene,
    /// Over this mesh.
    pub mesh: Mesh,
    /// Poses of the bodies at the end of each load step that is asked for.
    pub frames: Vec<Vec<(String, Pose)>>,
}

impl SideScene {
    /// The frames of a plan of it, each reached in `pieces`.
    pub fn drive(&self, plan: &Plan, pieces: usize) -> Drive {
        let mut from = plan.load(&[], &[]).expect("nothing is named");
        let mut frames = Vec::new();
        for (i, poses) in self.frames.iter().enumerate() {
            let poses: Vec<(&str, Pose)> = poses.iter().map(|(name, pose)| (name.as_str(), *pose)).collect();
            let to = plan.load(&[], &poses).expect("bodies of the scene");
            for k in 1..=pieces {
                let t = k as f64 / pieces as f64;
                let load = from.towards(&to, &vec![[0.0; 3]; plan.bodies.len()], t);
                frames.push(DriveFrame { time: i as f64 + t, load });
            }
            from = to;
        }
        Drive { frames }
    }

    /// The same in the cheap mode.
    pub fn cheap(mut self) -> SideScene {
        self.scene.contact.as_mut().expect("with contact").mode = ContactMode::Cheap;
        self
    }

    fn empty(name: String, distance: f64) -> SideScene {
        let contact = Some(ContactSpec { distance, ..ContactSpec::new(&[]) });
        let scene = Scene { contact, ..Scene::default() };
        SideScene { name, scene, mesh: Mesh::default(), frames: Vec::new() }
    }

    fn takes_part(&mut self, name: &str) {
        self.scene.contact.as_mut().expect("with contact").surfaces.push(format!("{name}_block"));
    }

    /// A body of stuff of 20 kPa.
    fn soft(&mut self, name: &str, part: Mesh) {
        add(&mut self.scene, &mut self.mesh, name, part, [0.0; 3], soft(0.45));
        self.takes_part(name);
    }

    /// A body all of whose nodes move with the body `with`.
    fn rigid(&mut self, name: &str, mut part: Mesh, with: &str) {
        part.node_sets.insert("all".into(), (0..part.points.len() as u32).collect());
        generate::append(&mut self.mesh, part, name);
        self.tie(&format!("{name}_all"), with);
        self.takes_part(name);
    }

    fn tie(&mut self, nodes: &str, body: &str) {
        self.scene.ties.push(TieSpec { nodes: nodes.into(), body: body.into() });
    }

    fn frame(&mut self, poses: &[(&str, Pose)]) {
        self.frames.push(poses.iter().map(|(name, pose)| (name.to_string(), *pose)).collect());
    }
}

fn soft(nu: f64) -> LawSpec {
    LawSpec::NeoHookean { young: 20e3, nu }
}

fn shift(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::identity())
}

/// A box of `n` cells between two corners \[m\].
fn brick(n: [usize; 3], from: [f64; 3], to: [f64; 3]) -> Mesh {
    generate::mapped(n, |s| std::array::from_fn(|d| from[d] + s[d] * (to[d] - from[d])))
}

/// A cylinder about an axis through `centre` \[m\] along `axis`.
fn rod(radius: f64, length: f64, centre: [f64; 3], axis: Vector3<f64>, n_long: usize) -> Mesh {
    let mut mesh = generate::cylinder(radius, length, 4, 2, n_long);
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
    for p in &mut mesh.points {
        let local = Vector3::new(p[0], p[1], p[2] - length / 2.0);
        *p = (turn * local + Vector3::from(centre)).into();
    }
    mesh
}

/// A cube blown up to a ball, but for a third: the cells at its edges would be flat.
fn blob(radius: f64, n: usize, centre: [f64; 3]) -> Mesh {
    generate::mapped([n; 3], |s| {
        let [x, y, z] = s.map(|s| 2.0 * s - 1.0);
        let out = |a: f64, b: f64| (1.0 - a * a / 2.0 - b * b / 2.0 + a * a * b * b / 3.0).sqrt();
        let round = [x * out(y, z), y * out(x, z), z * out(x, y)];
        std::array::from_fn(|c| centre[c] + radius * (0.65 * round[c] + 0.35 * 0.75 * [x, y, z][c]))
    })
}

/// How the smallest scene is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// The ends of the strap go down, each with a body of its own.
    Plain,
    /// The cylinder comes up in the second frame.
    CylinderMoves,
    /// The cylinder deforms; its ends are held.
    CylinderSoft,
    /// Both ends are tied to one body.
    OneBody,
    /// All the way in one frame.
    OneFrame,
}

/// A strap of 40 x 8 x 2 mm whose ends go down by `depth` - 0.4 mm, to a rigid cylinder of radius 3 mm across below it, and on by
/// `step` times its thickness.
pub fn strap_over_cylinder(depth: f64, step: f64, variant: Variant) -> SideScene {
    let name =
        format!("strap over cylinder, {} mm above it, step of {step} thicknesses, {variant:?}", depth * 1e3);
    let mut s = SideScene::empty(name, 0.3e-3);
    s.soft("strap", brick([16, 2, 2], [-0.02, -0.004, 0.0], [0.02, 0.004, 2e-3]));
    let cylinder = rod(3e-3, 0.03, [0.0, 0.0, -depth - 3e-3], Vector3::y(), 10);
    match variant {
        Variant::CylinderSoft => {
            s.soft("cylinder", cylinder);
            s.tie("cylinder_z_min", "cylinder");
            s.tie("cylinder_z_max", "cylinder");
        }
        _ => s.rigid("cylinder", cylinder, "cylinder"),
    }
    let ends = if variant == Variant::OneBody { ["l", "l"] } else { ["l", "r"] };
    s.tie("strap_x_min", ends[0]);
    s.tie("strap_x_max", ends[1]);
    let poses = |down: f64, up: f64| {
        let mut poses = vec![("l", shift(0.0, 0.0, -down)), ("r", shift(0.0, 0.0, -down))];
        poses.truncate(if variant == Variant::OneBody { 1 } else { 2 });
        poses.push(("cylinder", shift(0.0, 0.0, up)));
        poses
    };
    let (first, second) = (depth - 0.4e-3, step * 2e-3);
    match variant {
        Variant::CylinderMoves => {
            s.frame(&poses(first, 0.0));
            s.frame(&poses(first, second));
        }
        Variant::OneFrame => s.frame(&poses(first + second, 0.0)),
        _ => {
            s.frame(&poses(first, 0.0));
            s.frame(&poses(first + second, 0.0));
        }
    }
    s
}

/// Two such straps side by side that take no notice of each other; the cylinder comes up in the second frame.
pub fn two_straps_over_cylinder(depth: f64, step: f64) -> SideScene {
    let mut s = SideScene::empty("two straps over a cylinder".into(), 0.3e-3);
    let cylinder = rod(3e-3, 0.03, [0.0, 0.0, -depth - 3e-3], Vector3::y(), 10);
    s.rigid("cylinder", cylinder, "cylinder");
    for (name, y) in [("near", -6e-3), ("far", 6e-3)] {
        s.soft(name, brick([16, 2, 2], [-0.02, y - 4e-3, 0.0], [0.02, y + 4e-3, 2e-3]));
        s.tie(&format!("{name}_x_min"), "ends");
        s.tie(&format!("{name}_x_max"), "ends");
    }
    let straps = ["near_block".to_string(), "far_block".to_string()];
    s.scene.contact.as_mut().expect("with contact").excluded.push(straps);
    let down = ("ends", shift(0.0, 0.0, 0.4e-3 - depth));
    s.frame(&[down, ("cylinder", shift(0.0, 0.0, 0.0))]);
    s.frame(&[down, ("cylinder", shift(0.0, 0.0, step * 2e-3))]);
    s
}

/// Depths \[m\] and steps \[thicknesses\] of the variants of [`strap_over_cylinder`].
pub const DEPTHS: [f64; 5] = [2e-3, 5e-3, 10e-3, 20e-3, 40e-3];
/// See [`DEPTHS`].
pub const STEPS: [f64; 12] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0, 12.5, 15.0];
/// See [`DEPTHS`].
pub const VARIANTS: [Variant; 5] =
    [Variant::Plain, Variant::CylinderMoves, Variant::CylinderSoft, Variant::OneBody, Variant::OneFrame];

/// A soft block of 20 mm, 10 mm high, between two plates; each comes nearer by half of `by` \[m\], and they are 11 mm apart.
pub fn pressed_block(by: f64) -> SideScene {
    let mut s = SideScene::empty("block between plates".into(), 0.3e-3);
    s.soft("block", brick([5, 5, 4], [-0.01, -0.01, -5e-3], [0.01, 0.01, 5e-3]));
    s.tie("block_x_min", "wall");
    let plate = |z: f64| brick([4, 4, 1], [-0.008, -0.008, z - 1e-3], [0.02, 0.008, z + 1e-3]);
    s.rigid("lower", plate(-6.5e-3), "lower");
    s.rigid("upper", plate(6.5e-3), "upper");
    s.frame(&[("lower", shift(0.0, 0.0, by / 2.0)), ("upper", shift(0.0, 0.0, -by / 2.0))]);
    s
}

/// The names of the families of [`random_side_scene`].
pub const FAMILIES: [&str; 6] = [
    "strap over rods",
    "straps across",
    "straps round an axis",
    "strap between",
    "sheets and stacks",
    "blobs and pegs",
];

/// A scene of a family with shapes, gaps and ways at random.
pub fn random_side_scene(family: usize, seed: u64) -> SideScene {
    let random = &mut Random::new(1000 * family as u64 + seed);
    let name = format!("{}, seed {seed}", FAMILIES[family]);
    match family {
        0 => over(name, random),
        1 => across(name, random),
        2 => round(name, random),
        3 => between(name, random),
        4 => sheets(name, random),
        _ => blobs(name, random),
    }
}

/// A strap over one to three rods that lie in some direction across, with its ends driven down and sideways.
fn over(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, random.between(0.15e-3, 0.4e-3));
    let (half, wide, thick) =
        (random.between(0.02, 0.035), random.between(3e-3, 6e-3), random.between(1.5e-3, 4e-3));
    s.soft("strap", brick([16, 2, 2], [-half, -wide, 0.0], [half, wide, thick]));
    let depth = random.between(1e-3, 30e-3);
    let n_rods = random.integer(1, 3);
    let axis = Vector3::new(random.between(-0.3, 0.3), 1.0, 0.0).normalize();
    for i in 0..n_rods {
        let radius = random.between(2e-3, 3.5e-3);
        let x = (i as f64 - 0.5 * (n_rods - 1) as f64) * 0.5 * half + random.between(-1e-3, 1e-3);
        let centre = [x, 0.0, -depth - radius - random.between(0.0, 1e-3)];
        s.rigid(&format!("rod{i}"), rod(radius, 0.06, centre, axis, 12), "rods");
    }
    s.tie("strap_x_min", "l");
    s.tie("strap_x_max", "r");
    let first = depth - 0.5e-3;
    let down = first + random.between(0.5, 12.0) * thick;
    let (y, tilt) = (random.between(-3e-3, 3e-3), random.between(-0.2, 0.2) * (down - first));
    s.frame(&[("l", shift(0.0, 0.0, -first)), ("r", shift(0.0, 0.0, -first))]);
    s.frame(&[("l", shift(0.0, y, -down + tilt)), ("r", shift(0.0, y, -down - tilt))]);
    s
}

/// Two straps that cross above each other, pulled against each other through where they cross.
fn across(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, 0.3e-3);
    let thick = random.between(1.5e-3, 4e-3);
    let gap = random.between(0.5e-3, 20e-3);
    let angle = random.between(0.8, FRAC_PI_2);
    for (i, z) in [0.0, -gap - thick].into_iter().enumerate() {
        let (half, wide) = (random.between(0.02, 0.03), random.between(3e-3, 5e-3));
        let mut part = brick([14, 2, 2], [-half, -wide, z], [half, wide, z + thick]);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), i as f64 * angle);
        part.points.iter_mut().for_each(|p| *p = (turn * Vector3::from(*p)).into());
        s.soft(&format!("strap{i}"), part);
        s.tie(&format!("strap{i}_x_min"), &format!("l{i}"));
        s.tie(&format!("strap{i}_x_max"), &format!("r{i}"));
    }
    let by = gap + random.between(0.5, 8.0) * thick;
    let fraction = random.between(0.3, 0.7);
    let (a, b) = (-fraction * by, (1.0 - fraction) * by);
    s.frame(&[
        ("l0", shift(0.0, 0.0, a)),
        ("r0", shift(0.0, 0.0, a)),
        ("l1", shift(0.0, 0.0, b)),
        ("r1", shift(0.0, 0.0, b)),
    ]);
    s
}

/// A strap carried round an axis at its one end, with a rigid peg in its way.
fn round(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, 0.3e-3);
    let (length, thick) = (random.between(0.03, 0.05), random.between(1.5e-3, 4e-3));
    s.soft("strap", brick([16, 2, 2], [0.0, -4e-3, 0.0], [length, 4e-3, thick]));
    let (radius, at) = (random.between(2e-3, 4e-3), random.between(0.35, 0.65) * length);
    let below = random.between(0.5e-3, 8e-3);
    s.rigid("peg", rod(radius, 0.04, [at, 0.0, -below - radius], Vector3::y(), 10), "peg");
    s.tie("strap_x_min", "hub");
    s.tie("strap_x_max", "tip");
    let turn = random.between(0.2, 1.2);
    let turned =
        Pose::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn));
    s.frame(&[("tip", turned)]);
    s
}

/// A strap between two rods, one above and one below, drawn through them, and the rods driven past each other.
fn between(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, random.between(0.15e-3, 0.4e-3));
    let (half, thick) = (random.between(0.02, 0.03), random.between(1.5e-3, 3e-3));
    s.soft("strap", brick([18, 2, 2], [-half, -4e-3, 0.0], [half, 4e-3, thick]));
    let (x, gap) = (random.between(0.2, 0.4) * half, random.between(0.5e-3, 6e-3));
    let radius = random.between(2e-3, 4e-3);
    let axis = |random: &mut Random| Vector3::new(random.between(-0.2, 0.2), 1.0, 0.0).normalize();
    let axes = [axis(random), axis(random)];
    s.rigid("above", rod(radius, 0.05, [x, 0.0, thick + gap + radius], axes[0], 12), "above");
    s.rigid("below", rod(radius, 0.05, [-x, 0.0, -gap - radius], axes[1], 12), "below");
    s.tie("strap_x_min", "l");
    s.tie("strap_x_max", "r");
    let by = gap + random.between(0.5, 3.0) * thick;
    let along = random.between(-0.2, 0.2) * half;
    s.frame(&[
        ("above", shift(0.0, 0.0, -by)),
        ("below", shift(0.0, 0.0, by)),
        ("l", shift(along, 0.0, 0.0)),
        ("r", shift(along, 0.0, 0.0)),
    ]);
    s
}

/// A stack of one to three sheets or straps, held at their ends, pressed by a plate or a ball that comes from afar.
fn sheets(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, 0.3e-3);
    let n = random.integer(1, 3);
    let is_sheet = random.integer(0, 1) == 1;
    let (half, thick, gap) = (0.02, random.between(1e-3, 3e-3), random.between(0.4e-3, 1.5e-3));
    let wide = if is_sheet { half } else { 5e-3 };
    for i in 0..n {
        let z = -(i as f64) * (thick + gap);
        let cells = if is_sheet { [10, 10, 2] } else { [14, 3, 2] };
        s.soft(&format!("sheet{i}"), brick(cells, [-half, -wide, z], [half, wide, z + thick]));
        s.tie(&format!("sheet{i}_x_min"), "frame");
        s.tie(&format!("sheet{i}_x_max"), "frame");
        if is_sheet {
            s.tie(&format!("sheet{i}_y_min"), "frame");
            s.tie(&format!("sheet{i}_y_max"), "frame");
        }
    }
    let far = thick + random.between(0.5e-3, 20e-3);
    if random.integer(0, 1) == 0 {
        s.rigid("press", brick([6, 6, 1], [-9e-3, -8e-3, far], [9e-3, 8e-3, far + 3e-3]), "press");
    } else {
        let radius = random.between(4e-3, 8e-3);
        let off = random.between(-3e-3, 3e-3);
        s.rigid("press", blob(radius, 4, [off, 0.0, far + radius]), "press");
    }
    let by = far - thick + random.between(0.5, 4.0) * thick;
    s.frame(&[("press", shift(0.0, 0.0, -by))]);
    s
}

/// Balls held by a face or by their middle, driven against pegs or each other.
fn blobs(name: String, random: &mut Random) -> SideScene {
    let mut s = SideScene::empty(name, 0.3e-3);
    let radius = random.between(5e-3, 9e-3);
    s.soft("blob", blob(radius, 5, [0.0, 0.0, 0.0]));
    s.tie("blob_z_max", "grip");
    let gap = random.between(0.5e-3, 15e-3);
    let off = random.between(-0.5, 0.5) * radius;
    match random.integer(0, 2) {
        0 => {
            let peg = random.between(1.5e-3, 4e-3);
            s.rigid("peg", rod(peg, 0.05, [off, 0.0, -radius - gap - peg], Vector3::y(), 12), "peg");
        }
        1 => {
            let other = random.between(4e-3, 7e-3);
            s.soft("other", blob(other, 4, [off, 0.0, -radius - gap - other]));
            s.tie("other_z_min", "other");
        }
        _ => {
            let (peg, apart) = (random.between(1.5e-3, 3e-3), random.between(0.4, 0.8) * radius);
            for (i, x) in [off - apart, off + apart].into_iter().enumerate() {
                let centre = [x, 0.0, -radius - gap - peg];
                s.rigid(&format!("peg{i}"), rod(peg, 0.05, centre, Vector3::y(), 12), "peg");
            }
        }
    }
    let by = gap + random.between(0.2, 1.0) * radius;
    s.frame(&[("grip", shift(random.between(-2e-3, 2e-3), 0.0, -by))]);
    s
}
