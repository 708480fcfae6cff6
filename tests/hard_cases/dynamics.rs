//! Cases in time, with inertia: C4 (fast thin bodies), C6 (mass ratio, for 10 s), T1 (large time steps), T2 (quasi-static by dynamics).

use crate::{Case, Outcome, Tier};
use fem::measure::{kinetic_energy, pair_forces, support_wrench};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::Frame;
use fem::scene::{ContactSpec, GravitySpec, InertiaSpec, LawSpec, Scene, VelocitySpec};
use fem::solve::Settings;
use support::contact_scenes::{add, block_mean, guarded, moved, timed, total_energy, two_blocks};
use support::fem_scenes::held;

pub const CASES: &[Case] = &[
    Case { id: "C4", title: "1 mm sheet at 50 m/s in steps of 1 ms", tier: Tier::Quick, run: fast_sheet },
    Case { id: "C6", title: "stack of densities 1 and 1e6 kg/m3 for 10 s", tier: Tier::Full, run: stack },
    Case {
        id: "T1",
        title: "steps of 1e-4 to 1 s, beam let go under gravity",
        tier: Tier::Quick,
        run: large_steps,
    },
    Case { id: "T2", title: "pressed slowly, and half as fast", tier: Tier::Quick, run: slowly },
];

/// Soft tissue of the hard cases.
const TISSUE: LawSpec = LawSpec::NeoHookean { young: 30e3, nu: 0.49 };

/// A free sheet flies at another that is held at its rim: 50 mm in the first step, over a gap of 20 mm.
fn fast_sheet() -> Outcome {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let sheet = |n: usize, side: f64| {
        generate::mapped([n, n, 1], move |s| [side * (s[0] - 0.5), side * (s[1] - 0.5), 1e-3 * s[2]])
    };
    add(&mut scene, &mut mesh, "target", sheet(10, 0.04), [0.0, 0.0, 0.02], TISSUE);
    add(&mut scene, &mut mesh, "flyer", sheet(6, 0.02), [0.0; 3], TISSUE);
    for side in ["x_min", "x_max", "y_min", "y_max"] {
        scene.prescribed.push(held(&format!("target_{side}"), [true; 3]));
    }
    let velocity = VelocitySpec { region: "flyer_block".into(), velocity: [0.0, 0.0, 50.0] };
    scene.inertia = Some(InertiaSpec { velocities: vec![velocity] });
    scene.contact = Some(ContactSpec::new(&["target_block", "flyer_block"]));
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let out = guarded(&plan, &timed(&plan, 1e-3, 20, |_| vec![]), &Settings::default())?;
    let mut deepest = 0.0_f64;
    for frame in &out.frames {
        let [flyer, target] = ["flyer_block", "target_block"].map(|b| block_mean(&plan, b, &frame.x)[2]);
        let middle = plan.mesh.node_sets["target_z_min"]
            .iter()
            .map(|&n| frame.x[3 * n as usize + 2])
            .fold(f64::MIN, f64::max);
        if flyer > middle {
            return Err(format!("at {} s the flyer is at {flyer} m, the target at {target} m", frame.time));
        }
        deepest = deepest.max(middle - 0.02);
    }
    let back = -block_mean(&plan, "flyer_block", &out.last().expect("solved").v)[2];
    let text = format!(
        "target dented by {:.1} mm and never passed; the flyer comes back at {back:.1} m/s",
        1e3 * deepest
    );
    // Deeper than it is thick, or they never met; slower than it came.
    if deepest > 1e-3 && (0.0..50.0).contains(&back) { Ok(text) } else { Err(text) }
}

/// A heavy block falls onto a wider light one that falls onto the ground, all free but for contact, under a weight of 1 kPa. (As wide
/// as each other they slide off: rim on rim is unstable.)
fn stack() -> Outcome {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let block = |n: [usize; 3], side: f64, height: f64| {
        generate::mapped(n, move |s| [side * (s[0] - 0.5), side * (s[1] - 0.5), height * s[2]])
    };
    add(&mut scene, &mut mesh, "ground", block([3, 3, 1], 0.04, 0.005), [0.0, 0.0, -0.005], TISSUE);
    add(&mut scene, &mut mesh, "light", block([4, 4, 2], 0.02, 0.01), [0.0, 0.0, 2e-4], TISSUE);
    add(&mut scene, &mut mesh, "heavy", block([5, 5, 3], 0.014, 0.01), [0.0, 0.0, 0.0105], TISSUE);
    (scene.solids[1].density, scene.solids[2].density) = (1.0, 1e6);
    for side in ["z_min", "z_max"] {
        scene.prescribed.push(held(&format!("ground_{side}"), [true; 3]));
    }
    scene.gravity = Some(GravitySpec { acceleration: [0.0, 0.0, -0.1], control: "g".into() });
    scene.inertia = Some(InertiaSpec::default());
    scene.contact = Some(ContactSpec::new(&["ground_block", "light_block", "heavy_block"]));
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    // What pushes a body of 4 mg sideways is small beside a weight of 0.2 N.
    let settings = Settings { tolerance: 1e-8, ..Settings::default() };
    let drive = timed(&plan, 0.05, 200, |_| vec![("g", 1.0)]);
    let out = guarded(&plan, &drive, &settings)?;
    // Penetration there is none, which `guarded` has seen; after half of the time all is at rest.
    let (half, last) = (&out.frames[99], out.last().expect("solved"));
    let drift = ["light_block", "heavy_block"].map(|b| {
        let (a, b) = (block_mean(&plan, b, &half.x), block_mean(&plan, b, &last.x));
        (0..3).map(|c| (b[c] - a[c]).powi(2)).sum::<f64>().sqrt()
    });
    let worst = drift[0].max(drift[1]) / 0.01;
    let pairs = pair_forces(&plan, last.snapshot(), [0.0; 3]);
    let (weight, mut off) = (0.1 * 1e6 * 0.014 * 0.014 * 0.01, 0.0_f64);
    for pair in &pairs {
        off = off.max((pair.wrench.force[2].abs() / weight - 1.0).abs());
    }
    let text = format!(
        "no penetration; drift from 5 to 10 s {worst:.1e} of the thickness; {} contacts bear the weight of {weight:.3} N to {off:.1e}",
        pairs.len()
    );
    if worst < 1e-3 && pairs.len() == 2 && off < 1e-3 { Ok(text) } else { Err(text) }
}

/// A beam held at one end, let go under five times its gravity; energy may not grow from step to step, and ends at equilibrium where
/// steps are long.
fn large_steps() -> Outcome {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let beam = generate::block([12, 2, 2], [0.06, 0.01, 0.01]);
    add(&mut scene, &mut mesh, "beam", beam, [0.0; 3], TISSUE);
    scene.prescribed.push(held("beam_x_min", [true; 3]));
    scene.gravity = Some(GravitySpec { acceleration: [0.0, 0.0, -50.0], control: "g".into() });
    let still = Plan::new(&scene, mesh.clone()).map_err(|e| e.to_string())?;
    scene.inertia = Some(InertiaSpec::default());
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let tip = |plan: &Plan, frame: &Frame| {
        let nodes = &plan.mesh.node_sets["beam_x_max"];
        nodes.iter().map(|&n| frame.x[3 * n as usize + 2]).sum::<f64>() / nodes.len() as f64
    };
    let rest = guarded(&still, &timed(&still, 1.0, 1, |_| vec![("g", 1.0)]), &Settings::default())?;
    let rest = tip(&still, rest.last().expect("solved"));
    let mut rows = Vec::new();
    for h in [1e-4, 1e-3, 1e-2, 1e-1, 1.0] {
        let out = guarded(&plan, &timed(&plan, h, 20, |_| vec![("g", 1.0)]), &Settings::default())?;
        let x = plan.reference();
        let load = out.frames[0].load.clone();
        let at_start = Frame { load, v: vec![0.0; x.len()], x, ..Frame::default() };
        let mut before = total_energy(&plan, &at_start);
        let scale = before.abs();
        for frame in &out.frames {
            let now = total_energy(&plan, frame);
            if now > before + 1e-6 * scale {
                return Err(format!(
                    "steps of {h} s: energy grows from {before} to {now} J at {} s",
                    frame.time
                ));
            }
            before = now;
        }
        let way = (tip(&plan, out.last().expect("solved")) - 5e-3) / (rest - 5e-3);
        rows.push(format!("{h:.0e} s: tip at {way:.4} of its sag"));
        if h >= 0.1 && (way - 1.0).abs() > 1e-3 {
            return Err(rows.join(", "));
        }
    }
    Ok(format!("energy never grows; {}", rows.join(", ")))
}

/// The upper of two blocks is pressed down by 4 mm within 2 s, and within 4 s.
fn slowly() -> Outcome {
    let press = |duration: f64| -> Result<(f64, f64), String> {
        let contact = ContactSpec::new(&["lower_z_max", "upper_z_min"]);
        let (mut scene, mesh) = two_blocks([[4, 4, 2], [5, 5, 3]], 1e-4, contact);
        scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, -1.0], "down"));
        scene.inertia = Some(InertiaSpec::default());
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let n = 40;
        let down = |t: f64| vec![("down", 4e-3 * t / duration)];
        let out = guarded(&plan, &timed(&plan, duration / n as f64, n, down), &Settings::default())?;
        let fraction = |frame: &Frame| {
            let kinetic = kinetic_energy(&plan, &frame.v);
            kinetic / (total_energy(&plan, frame) - kinetic)
        };
        let fast = out.frames[n / 10..].iter().map(fraction).fold(0.0, f64::max);
        let last = out.last().expect("solved");
        let force =
            support_wrench(&plan, last.snapshot(), &plan.mesh.node_sets["upper_z_max"], [0.0; 3]).force[2];
        Ok((fast, force))
    };
    let ((fast, force), (_, slower)) = (press(2.0)?, press(4.0)?);
    let change = (slower / force - 1.0).abs();
    let text = format!(
        "kinetic energy at most {fast:.1e} of the stored after a tenth of the run; {:.4} N, half as fast {change:.1e} off",
        -force
    );
    if fast < 0.05 && change < 0.02 { Ok(text) } else { Err(text) }
}
