//! Hard cases of contact: C1 to C4, C6, C8, C11 and E12. C4 and C6 are at rest here, with one large step in place of speed and weight in
//! place of a falling stack; in time they are among the dynamics.

use crate::{Case, Outcome, Tier};
use fem::body::Pose;
use fem::measure::{nodal_forces, pair_forces, support_wrench};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Run, run};
use fem::scene::{ContactSpec, GravitySpec, InertiaSpec, LawSpec, Scene, TieSpec};
use fem::solve::Settings;
use std::f64::consts::TAU;
use support::contact_scenes::{add, guarded, moved, ramp, random_scene, two_blocks};
use support::fem_scenes::{held, mooney_rivlin};

pub const CASES: &[Case] = &[
    Case { id: "C1", title: "degenerate pairs pressed together", tier: Tier::Quick, run: degenerate_pairs },
    Case {
        id: "C2",
        title: "17 cylinders start in touch and 1e-12 m apart",
        tier: Tier::Quick,
        run: touching,
    },
    Case { id: "C3", title: "start overlapping by 0.1 to 5 mm", tier: Tier::Quick, run: overlapping },
    Case { id: "C4", title: "1 mm sheet driven 50 mm in one step", tier: Tier::Quick, run: thin_and_far },
    Case { id: "C6", title: "stack of densities 1 and 1e6 kg/m3", tier: Tier::Quick, run: heavy_on_light },
    Case { id: "C8", title: "stair-stepped surface", tier: Tier::Quick, run: stairs },
    Case { id: "C11", title: "sides swapped, model mirrored", tier: Tier::Quick, run: swapped_and_mirrored },
    Case {
        id: "E12",
        title: "bar stretched to 500 % and turned, self-contact",
        tier: Tier::Full,
        run: twist,
    },
    Case { id: "Crnd", title: "200 random small scenes", tier: Tier::Full, run: random_scenes },
];

fn plan_of(scene: &Scene, mesh: Mesh) -> Result<Plan, String> {
    Plan::new(scene, mesh).map_err(|e| e.to_string())
}

fn press(scene: &Scene, mesh: Mesh, controls: &[(&str, f64)], steps: usize) -> Result<(Plan, Run), String> {
    let plan = plan_of(scene, mesh)?;
    let out = guarded(&plan, &ramp(&plan, controls, &[], steps), &Settings::default())?;
    Ok((plan, out))
}

/// Force \[N\] of a set's support along z.
fn support_z(plan: &Plan, out: &Run, set: &str) -> f64 {
    let frame = out.last().expect("a solved run has a frame");
    support_wrench(plan, frame.snapshot(), &plan.mesh.node_sets[set], [0.0; 3]).force[2]
}

/// Two parts in the given shapes, the lower's bottom held and the upper's top driven down.
fn pressed_parts(lower: Mesh, upper: Mesh, down: f64, distance: f64) -> Result<f64, String> {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    add(&mut scene, &mut mesh, "lower", lower, [0.0; 3], mooney_rivlin());
    add(&mut scene, &mut mesh, "upper", upper, [0.0; 3], mooney_rivlin());
    scene.prescribed =
        vec![held("lower_z_min", [true; 3]), moved("upper_z_max", [true; 3], [0.0, 0.0, -1.0], "down")];
    scene.contact = Some(ContactSpec { distance, ..ContactSpec::new(&["lower_block", "upper_block"]) });
    let (plan, out) = press(&scene, mesh, &[("down", down)], 1)?;
    Ok(-support_z(&plan, &out, "upper_z_max"))
}

fn degenerate_pairs() -> Outcome {
    // A block of side 20 mm about z, turned by `angle` about an axis, with its lowest point at `z`; its top face is cut flat by
    // the drive alone.
    let block = |n: usize| generate::mapped([n; 3], |s| [0, 1, 2].map(|d| 0.02 * (s[d] - 0.5)));
    let shifted = |mut mesh: Mesh, by: [f64; 3]| {
        mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += by[c]));
        mesh
    };
    // A roof: the lower half narrows to a ridge 1 mm wide along y; a spike: to a square of 1 mm.
    let narrowed = |along_y: bool| {
        generate::mapped([3, 3, 4], move |s| {
            let width = 0.001 + 0.019 * s[2];
            let depth = if along_y { 0.02 } else { width };
            [width * (s[0] - 0.5), depth * (s[1] - 0.5), 0.02 * s[2]]
        })
    };
    let upside = |along_y: bool, turned: bool| {
        // The lower part of the same shape: ridge up.
        generate::mapped([3, 3, 4], move |s| {
            let width = 0.001 + 0.019 * (1.0 - s[2]);
            let depth = if along_y { 0.02 } else { width };
            let (x, y) = (width * (s[0] - 0.5), depth * (s[1] - 0.5));
            let (x, y) = if turned { (-y, x) } else { (x, y) };
            [x, y, 0.02 * (s[2] - 1.0)]
        })
    };
    // A wedge: two slopes that meet in a valley along y.
    let wedge = generate::mapped([4, 3, 3], |s| {
        let x = 0.03 * (s[0] - 0.5);
        [x, 0.02 * (s[1] - 0.5), -0.02 + s[2] * (0.012 + 0.6 * x.abs())]
    });
    let gap = 5e-4;
    let cases: Vec<(&str, Mesh, Mesh, f64)> = vec![
        (
            "vertex on vertex",
            shifted(block(2), [0.0, 0.0, -0.01]),
            shifted(block(2), [0.02, 0.02, 0.01 + gap]),
            4e-3,
        ),
        (
            "faces on faces, same mesh",
            shifted(block(2), [0.0, 0.0, -0.01]),
            shifted(block(2), [0.0, 0.0, 0.01 + gap]),
            4e-3,
        ),
        ("edge along edge", upside(true, false), shifted(narrowed(true), [0.0, 0.0, gap]), 4e-3),
        ("edge across edge", upside(true, true), shifted(narrowed(true), [0.0, 0.0, gap]), 4e-3),
        ("spike on edge", upside(true, false), shifted(narrowed(false), [0.0, 0.0, gap]), 4e-3),
        ("spike on spike", upside(false, false), shifted(narrowed(false), [0.0, 0.0, gap]), 4e-3),
        ("spike in wedge", wedge, shifted(narrowed(false), [0.0, 0.0, -0.008 + gap + 1e-3]), 4e-3),
        (
            "cliff edge",
            shifted(block(2), [0.0, 0.0, -0.01]),
            shifted(block(3), [0.0115, 0.0, 0.01 + gap]),
            4e-3,
        ),
    ];
    let mut forces = Vec::new();
    for (name, lower, upper, down) in cases {
        let force = pressed_parts(lower, upper, down, 3e-4).map_err(|e| format!("{name}: {e}"))?;
        if !(force.is_finite() && force >= 0.0) {
            return Err(format!("{name}: force {force} N"));
        }
        forces.push(format!("{name} {force:.3} N"));
    }
    Ok(forces.join(", "))
}

/// `count` cylinders side by side in a hexagonal bundle, radius 15 mm, `gap` \[m\] apart, both ends tied.
fn bundle(count: usize, n: usize, gap: f64, spec: ContactSpec) -> (Scene, Mesh) {
    let (radius, length) = (0.015, 0.1);
    let mut places = vec![[0.0, 0.0]];
    for ring in 1..4_usize {
        for k in 0..6 * ring {
            let corner = |s: usize| {
                let a = s as f64 * std::f64::consts::PI / 3.0;
                [a.cos(), a.sin()]
            };
            let (p, q, f) = (corner(k / ring), corner(k / ring + 1), (k % ring) as f64 / ring as f64);
            places.push([0, 1].map(|d| ring as f64 * (p[d] * (1.0 - f) + q[d] * f)));
        }
    }
    let (mut scene, mut mesh, mut surfaces) = (Scene::default(), Mesh::default(), Vec::new());
    for (i, p) in places.iter().take(count).enumerate() {
        let name = format!("muscle{i:02}");
        let mut part = generate::cylinder(radius, length, n, 1, 6);
        // Slimmer towards the ends, which are tied and cannot give way.
        for p in &mut part.points {
            let slim = 1.0 - 0.05 * (2.0 * p[2] / length - 1.0).powi(2);
            (p[0], p[1]) = (p[0] * slim, p[1] * slim);
        }
        let place = [p[0] * (2.0 * radius + gap), p[1] * (2.0 * radius + gap), 0.0];
        add(&mut scene, &mut mesh, &name, part, place, mooney_rivlin());
        scene.ties.push(TieSpec { nodes: format!("{name}_z_min"), body: "pelvis".into() });
        scene.ties.push(TieSpec { nodes: format!("{name}_z_max"), body: "tibia".into() });
        surfaces.push(format!("{name}_side"));
    }
    scene.contact = Some(ContactSpec { surfaces, ..spec });
    (scene, mesh)
}

fn touching() -> Outcome {
    let mut rows = Vec::new();
    for gap in [0.0, 1e-12] {
        let (scene, mesh) = bundle(17, 2, gap, ContactSpec::new(&[]));
        let plan = plan_of(&scene, mesh)?;
        let start = plan.load(&[], &[]).map_err(|e| e.to_string())?;
        let x = plan.reference();
        let at = fem::measure::Snapshot { x: &x, load: &start };
        let rest = nodal_forces(&plan, at).iter().fold(0.0_f64, |m, f| m.max(f.abs()));
        if rest.is_nan() || rest >= 1e-6 {
            return Err(format!("gap {gap}: {rest:.1e} N at rest"));
        }
        // A twist of the far end by 10 degrees, with a little tension.
        let turn =
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), 10f64.to_radians());
        let pose = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, 2e-3), turn);
        let out = guarded(&plan, &ramp(&plan, &[], &[("tibia", pose)], 1), &Settings::default())?;
        let pairs = pair_forces(&plan, out.last().expect("solved").snapshot(), [0.0; 3]);
        rows.push(format!(
            "gap {gap:.0e}: {rest:.1e} N at rest, meshes parted by {:.1e} m; twisted 10 deg: {} pairs press",
            plan.repair.farthest,
            pairs.len()
        ));
    }
    Ok(rows.join("; "))
}

fn overlapping() -> Outcome {
    let mut rows = Vec::new();
    for depth in [1e-4, 1e-3, 5e-3] {
        let (scene, mesh) = bundle(3, 2, -depth, ContactSpec::new(&[]));
        let refusal = Plan::new(&scene, mesh.clone()).err().ok_or("an overlap is refused")?.to_string();
        if !(refusal.contains("`muscle00_side` and `muscle01_side` by") && refusal.contains("mm")) {
            return Err(format!("the refusal does not list pairs and depths: {refusal}"));
        }
        let mut allowed = scene.clone();
        allowed.ties.clear();
        for i in 0..3 {
            // Free ends: ties would keep the overlap there.
            allowed.prescribed.push(held(&format!("muscle{i:02}_z_min"), [false, false, true]));
        }
        allowed.contact.as_mut().expect("there").repair = depth;
        match Plan::new(&allowed, mesh) {
            Ok(plan) => {
                rows.push(format!("{:.1} mm mended by {:.2} mm", depth * 1e3, plan.repair.farthest * 1e3))
            }
            Err(e) if e.to_string().contains("overlap") || e.to_string().contains("invert") => {
                rows.push(format!("{:.1} mm refused", depth * 1e3));
            }
            Err(e) => return Err(e.to_string()),
        }
    }
    Ok(rows.join(", "))
}

fn thin_and_far() -> Outcome {
    // A sheet of 40 x 40 x 1 mm held at its rim; a small block is driven 50 mm into it in one step.
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let sheet = generate::mapped([10, 10, 1], |s| [0.04 * (s[0] - 0.5), 0.04 * (s[1] - 0.5), 1e-3 * s[2]]);
    let block =
        generate::mapped([3, 3, 3], |s| [0.008 * (s[0] - 0.5), 0.008 * (s[1] - 0.5), 2e-3 + 0.008 * s[2]]);
    let stiff = LawSpec::NeoHookean { young: 1e6, nu: 0.3 };
    add(&mut scene, &mut mesh, "sheet", sheet, [0.0; 3], mooney_rivlin());
    add(&mut scene, &mut mesh, "block", block, [0.0; 3], stiff);
    for side in ["x_min", "x_max", "y_min", "y_max"] {
        scene.prescribed.push(held(&format!("sheet_{side}"), [true; 3]));
    }
    scene.prescribed.push(moved("block_z_max", [true; 3], [0.0, 0.0, -1.0], "down"));
    scene.contact = Some(ContactSpec::new(&["sheet_block", "block_block"]));
    let (plan, out) = press(&scene, mesh, &[("down", 0.05)], 1)?;
    let x = &out.last().expect("solved").x;
    let lowest =
        plan.mesh.node_sets["sheet_z_min"].iter().map(|&n| x[3 * n as usize + 2]).fold(f64::MAX, f64::min);
    let tip =
        plan.mesh.node_sets["block_z_min"].iter().map(|&n| x[3 * n as usize + 2]).fold(f64::MAX, f64::min);
    if lowest < tip {
        Ok(format!(
            "sheet pushed down to {:.1} mm in front of the block at {:.1} mm",
            lowest * 1e3,
            tip * 1e3
        ))
    } else {
        Err(format!("the block at {tip} m is below the sheet at {lowest} m"))
    }
}

fn heavy_on_light() -> Outcome {
    let (mut scene, mesh) =
        two_blocks([[4, 4, 2], [5, 5, 3]], 1e-4, ContactSpec::new(&["lower_z_max", "upper_z_min"]));
    (scene.solids[0].density, scene.solids[1].density) = (1.0, 1e6);
    // 1e6 kg/m3 of 10 mm: at 0.1 m/s2 they press with 1 kPa.
    scene.gravity = Some(GravitySpec { acceleration: [0.0, 0.0, -0.1], control: "g".into() });
    let (plan, out) = press(&scene, mesh, &[("g", 1.0)], 1)?;
    let pair = &pair_forces(&plan, out.last().expect("solved").snapshot(), [0.0; 3])[0];
    let (force, weight) = (pair.wrench.force[2].abs(), 1e6 * 0.1 * 4e-6);
    if (force / weight - 1.0).abs() < 1e-4 && pair.least_distance > 0.0 {
        Ok(format!(
            "contact bears {force:.6} N of {weight:.6} N; gap {:.1e} m, no penetration",
            pair.least_distance
        ))
    } else {
        Err(format!("contact bears {force} N of {weight} N, gap {}", pair.least_distance))
    }
}

fn stairs() -> Outcome {
    // Steps of 1 mm every 2.5 mm, as of a segmented image.
    let lower = generate::mapped([8, 8, 3], |s| {
        let (x, y) = (0.02 * (s[0] - 0.5), 0.02 * (s[1] - 0.5));
        let smooth = -0.4 * x - 20.0 * (x * x + y * y);
        [x, y, -0.02 + s[2] * (0.016 + 1e-3 * (smooth / 1e-3).round())]
    });
    let upper =
        generate::mapped([5, 5, 3], |s| [0.018 * (s[0] - 0.5), 0.018 * (s[1] - 0.5), 1.5e-3 + 0.01 * s[2]]);
    let force = pressed_parts(lower, upper, 6e-3, 3e-4)?;
    if force > 0.0 { Ok(format!("pressed by {force:.3} N")) } else { Err(format!("force {force} N")) }
}

fn swapped_and_mirrored() -> Outcome {
    // An upper block askew on a lower one, so that nothing is symmetric by itself.
    let force = |swapped: bool, mirrored: bool| -> Result<f64, String> {
        let sign = if mirrored { -1.0 } else { 1.0 };
        // The mirror turns hexahedra inside out; counting x backwards turns them right again.
        let shape = move |n: [usize; 3], map: fn([f64; 3]) -> [f64; 3]| {
            generate::mapped(n, move |s| {
                let p = map([if mirrored { 1.0 - s[0] } else { s[0] }, s[1], s[2]]);
                [sign * p[0], p[1], p[2]]
            })
        };
        let lower = shape([4, 4, 2], |s| [0.02 * (s[0] - 0.5), 0.02 * (s[1] - 0.5), 0.01 * (s[2] - 1.0)]);
        let upper = shape([3, 3, 3], |s| {
            let (x, y) = (0.014 * (s[0] - 0.4), 0.012 * (s[1] - 0.3));
            [x * 0.9 - y * 0.3, y * 0.9 + x * 0.3, 4e-4 + 0.012 * s[2] + 0.1 * x * (1.0 - s[2]) + 1e-3]
        });
        let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
        add(&mut scene, &mut mesh, "lower", lower, [0.0; 3], mooney_rivlin());
        add(&mut scene, &mut mesh, "upper", upper, [0.0; 3], mooney_rivlin());
        scene.prescribed =
            vec![held("lower_z_min", [true; 3]), moved("upper_z_max", [true; 3], [0.0, 0.0, -1.0], "down")];
        let surfaces = if swapped { ["upper_block", "lower_block"] } else { ["lower_block", "upper_block"] };
        scene.contact = Some(ContactSpec::new(&surfaces));
        let (plan, out) = press(&scene, mesh, &[("down", 4e-3)], 1)?;
        Ok(-support_z(&plan, &out, "upper_z_max"))
    };
    let (plain, swapped, mirrored) = (force(false, false)?, force(true, false)?, force(false, true)?);
    let worst = (swapped / plain - 1.0).abs().max((mirrored / plain - 1.0).abs());
    if worst < 0.01 {
        Ok(format!("{plain:.4} N, off by at most {worst:.1e}"))
    } else {
        Err(format!("{plain} N, swapped {swapped} N, mirrored {mirrored} N"))
    }
}

/// A bar of 10 x 10 x 60 mm is drawn to 500 % and back within 0.1 s, then turned ten times within 0.5 s, in steps of 1 ms.
fn twist() -> Outcome {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let n = [4, 4, 24];
    let bar = generate::mapped(n, |s| [0.01 * (s[0] - 0.5), 0.01 * (s[1] - 0.5), 0.06 * s[2]]);
    add(&mut scene, &mut mesh, "bar", bar, [0.0; 3], LawSpec::NeoHookean { young: 30e3, nu: 0.4 });
    scene.ties = vec![
        TieSpec { nodes: "bar_z_min".into(), body: "low".into() },
        TieSpec { nodes: "bar_z_max".into(), body: "high".into() },
    ];
    scene.contact = Some(ContactSpec {
        pairs: vec![["bar_block".into(), "bar_block".into()]],
        ..ContactSpec::new(&["bar_block"])
    });
    scene.inertia = Some(InertiaSpec::default());
    let plan = plan_of(&scene, mesh)?;
    let turn = |angle: f64| nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), angle);
    let mut frames = Vec::new();
    let mut add_frame = |z: f64, angle: f64| -> Result<(), String> {
        let pose = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.0, z), turn(angle));
        let load = plan.load(&[], &[("high", pose)]).map_err(|e| e.to_string())?;
        frames.push(fem::run::DriveFrame { time: 1e-3 * (frames.len() as f64 + 1.0), load });
        Ok(())
    };
    let (stretching, turns, per_turn) = (100, 10, 50);
    for i in 1..=stretching {
        let fraction = 0.5 * (1.0 - (TAU * i as f64 / stretching as f64).cos());
        add_frame(4.0 * 0.06 * fraction, 0.0)?;
    }
    for i in 1..=turns * per_turn {
        add_frame(0.0, i as f64 * TAU / per_turn as f64)?;
    }
    let drive = fem::run::Drive { frames };
    let settings = Settings { tolerance: 1e-3, max_iterations: 200, ..Settings::default() };
    let out = run(&plan, &drive, &settings, None, &mut |_| {});
    let turned = out.frames.len().saturating_sub(stretching) as f64 / per_turn as f64;
    for frame in &out.frames {
        let surface = &fem::measure::collision_surfaces(&plan, frame.snapshot())[0].1;
        let pairs = fem::geometry::SearchSurface::new(surface.clone()).self_intersections();
        if !pairs.is_empty() {
            return Err(format!("at time {}: {} pairs of triangles intersect", frame.time, pairs.len()));
        }
    }
    match out.errors.first() {
        None => Ok(format!(
            "500 % and {turned} turns without intersection, {:.0} iterations a frame, least det F {:.2}",
            out.iterations.len() as f64 / out.frames.len() as f64,
            out.frames.iter().map(|f| f.islands[0].least_det_f).fold(f64::MAX, f64::min)
        )),
        Some(e) => Err(format!("stopped after {turned} turns: {e}")),
    }
}

fn random_scenes() -> Outcome {
    let (mut iterations, mut pressing, mut failures) = (0, 0, Vec::new());
    let count = 200;
    for seed in 0..count {
        let (scene, mesh, poses) = random_scene(1000 + seed);
        let attempt = || -> Result<(usize, bool), String> {
            let plan = plan_of(&scene, mesh)?;
            let poses: Vec<_> = poses.iter().map(|(n, p)| (n.as_str(), *p)).collect();
            let steps = 1 + seed as usize % 3;
            let out = guarded(&plan, &ramp(&plan, &[], &poses, steps), &Settings::default())?;
            let pairs = pair_forces(&plan, out.last().expect("solved").snapshot(), [0.0; 3]);
            Ok((out.iterations.len(), !pairs.is_empty()))
        };
        match attempt() {
            Ok((n, presses)) => {
                iterations += n;
                pressing += usize::from(presses);
            }
            Err(reason) => failures.push(format!("seed {}: {reason}", 1000 + seed)),
        }
    }
    let text = format!(
        "{} of {count} failed, {pressing} end in contact, {:.0} Newton iterations each; {}",
        failures.len(),
        iterations as f64 / count as f64,
        failures.join("; ")
    );
    if failures.is_empty() && pressing * 2 > count as usize { Ok(text) } else { Err(text) }
}
