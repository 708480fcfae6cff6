//! Hard case C12: nobody ends on the wrong side of another, however large the step.
//!
//! Every scene goes in one large step and in 60 small ones by collision detection alone. The ends are held against each other by lines
//! and sheets through the bodies ([`Sides`]), which share nothing with contact, and by the forces on the bodies.

use crate::{Case, Outcome, Tier};
use fem::measure::{Sides, body_wrenches};
use fem::plan::Plan;
use fem::run::{DriveFrame, Frame, Run, Session, run};
use fem::solve::{Settings, Stability, Way};
use nalgebra::Vector3;
use rayon::prelude::*;
use support::contact_scenes::intersections;
use support::side_scenes::{
    DEPTHS, FAMILIES, STEPS, SideScene, VARIANTS, random_side_scene, strap_over_cylinder,
};

pub const CASES: &[Case] = &[
    Case { id: "C12", title: "strap over a cylinder, 14 of 300", tier: Tier::Quick, run: some_straps },
    Case { id: "C12", title: "six families of scenes, 18 of 300", tier: Tier::Quick, run: some_random },
    Case { id: "C12", title: "strap over a cylinder, 300 variants", tier: Tier::Full, run: all_straps },
    Case { id: "C12", title: "six families of scenes, 50 each", tier: Tier::Full, run: all_random },
    Case { id: "C12", title: "the cheap mode tells who went through", tier: Tier::Full, run: cheap },
];

/// Small steps in place of a large one.
const SMALL: usize = 60;
/// Relative difference of forces beyond which two ends are two equilibria.
const SAME: f64 = 0.01;

fn go(scene: &SideScene, plan: &Plan, pieces: usize, way: Way) -> Run {
    run(plan, &scene.drive(plan, pieces), &Settings { way, ..Settings::default() }, None, &mut |_| {})
}

/// Forces \[N\] on the bodies.
fn forces(plan: &Plan, frame: &Frame) -> Vec<Vector3<f64>> {
    let about = vec![[0.0; 3]; plan.bodies.len()];
    body_wrenches(plan, frame.snapshot(), &about).iter().map(|w| Vector3::from(w.force)).collect()
}

/// Whether a frame stays where it is when it is looked at once more, and is a minimum of the potential.
fn is_stable(plan: &Plan, frame: &Frame) -> Result<bool, String> {
    let settings = Settings { stability: Stability::Always, ..Settings::default() };
    let mut session = Session::from_frame(plan, &settings, frame, 0).map_err(|e| e.to_string())?;
    let again = session.advance(&DriveFrame { time: frame.time + 1.0, load: frame.load.clone() });
    let moved = again.frame.x.iter().zip(&frame.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let tested = again.frame.islands.iter().all(|i| i.tested_stable && i.unstable_at.is_empty());
    Ok(again.errors.is_empty() && tested && moved < 1e-5)
}

/// How one large step ended beside many small ones.
enum End {
    Same,
    /// Another equilibrium on the same side, with how much the forces differ.
    Other(String),
    Refused,
    /// Neither way has an end to compare.
    Open,
}

/// Pairs that the frame names as sent into each other by the drive; only of surfaces that are prescribed all over, which nobody can keep apart.
fn told<'a>(plan: &Plan, frame: &'a Frame) -> Vec<[&'a str; 2]> {
    let surfaces = &plan.contact().expect("with contact").surfaces;
    let is_prescribed = |name: &String| {
        let surface =
            surfaces.iter().find(|s| s.name == *name).expect("an overlap is of surfaces of contact");
        let nodes = surface.faces.iter().flatten();
        nodes.flat_map(|&n| &plan.motion[n as usize]).all(|motion| !motion.is_unknown())
    };
    let all = frame.prescribed_overlaps.iter().filter(|(pair, _)| pair.iter().all(is_prescribed));
    all.map(|([a, b], _)| [a.as_str(), b]).collect()
}

fn judge(scene: &SideScene) -> Result<End, String> {
    let name = &scene.name;
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).map_err(|e| format!("{name}: {e}"))?;
    let sides = Sides::new(&plan).expect("with contact");
    let large = go(scene, &plan, 1, Way::Guided);
    for frame in large.frames.iter().chain(&large.unsolved) {
        let bad = intersections(&plan, frame.snapshot(), &told(&plan, frame));
        if !bad.is_empty() {
            return Err(format!("{name}: {}", bad.join("; ")));
        }
    }
    if let Some(error) = large.errors.first() {
        return if error.to_string().is_empty() {
            Err(format!("{name}: no words"))
        } else {
            Ok(End::Refused)
        };
    }
    let small = go(scene, &plan, SMALL, Way::Strict);
    let (Some(end), Some(wanted), true) = (large.last(), small.last(), small.is_solved()) else {
        return Ok(End::Open);
    };
    let crossed = sides.changed(&wanted.x, &end.x);
    if !crossed.is_empty() {
        return Err(format!("{name}: {crossed:?} on the wrong side"));
    }
    let (is, should) = (forces(&plan, end), forces(&plan, wanted));
    let scale = should.iter().map(|f| f.norm()).fold(0.0, f64::max);
    let off = is.iter().zip(&should).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    if off <= SAME * scale {
        return Ok(End::Same);
    }
    match is_stable(&plan, end)? && is_stable(&plan, wanted)? {
        true => Ok(End::Other(format!("{name}: forces {:.0} % apart", 100.0 * off / scale))),
        false => Err(format!("{name}: forces {:.1} % apart, and not both are stable", 100.0 * off / scale)),
    }
}

fn judge_all(scenes: Vec<SideScene>) -> Outcome {
    let ends: Vec<Result<End, String>> = scenes.par_iter().with_max_len(1).map(judge).collect();
    let wrong: Vec<&String> = ends.iter().filter_map(|e| e.as_ref().err()).collect();
    let others: Vec<&String> =
        ends.iter().filter_map(|e| if let Ok(End::Other(what)) = e { Some(what) } else { None }).collect();
    let count = |is: fn(&End) -> bool| ends.iter().flatten().filter(|e| is(e)).count();
    let text = format!(
        "{} scenes: {} as in {SMALL} small steps, {} refused, {} without an end to compare, {} in another stable equilibrium on the same side{}",
        ends.len(),
        count(|e| matches!(e, End::Same)),
        count(|e| matches!(e, End::Refused)),
        count(|e| matches!(e, End::Open)),
        others.len(),
        others.iter().map(|o| format!("; {o}")).collect::<String>(),
    );
    match wrong.is_empty() {
        true => Ok(text),
        false => Err(format!("{text}; WRONG: {wrong:?}")),
    }
}

fn straps(every: usize) -> Outcome {
    let all = DEPTHS.iter().flat_map(|&depth| {
        STEPS.iter().flat_map(move |&step| VARIANTS.iter().map(move |&v| strap_over_cylinder(depth, step, v)))
    });
    // The last ones first: they go farthest.
    judge_all(all.collect::<Vec<_>>().into_iter().rev().step_by(every).collect())
}

fn random(seeds: u64) -> Outcome {
    let scenes =
        (0..FAMILIES.len()).flat_map(|family| (0..seeds).map(move |seed| random_side_scene(family, seed)));
    judge_all(scenes.collect())
}

fn all_straps() -> Outcome {
    straps(1)
}

fn some_straps() -> Outcome {
    // 23 and five variants have no divisor in common: all variants occur.
    straps(23)
}

fn all_random() -> Outcome {
    random(50)
}

fn some_random() -> Outcome {
    random(3)
}

/// In this scene the cheap mode leaves the strap impaled on the cylinder, skin on both sides of its axis, and says nothing. To refuse whoever
/// has the middle of a body in itself would refuse the whole thigh as well, where gluteus minimus and sartorius come so deep.
const STUCK: &str = "strap over cylinder, 20 mm above it, step of 5 thicknesses, OneFrame";

/// In the cheap mode nothing keeps bodies from going through each other in a large step: whoever did is named, and nobody else.
fn cheap() -> Outcome {
    let (mut named, mut right, mut stuck) = (0, 0, 0);
    for &depth in &DEPTHS {
        for &step in &[1.0, 5.0, 15.0] {
            for &variant in &[VARIANTS[0], VARIANTS[4]] {
                let scene = strap_over_cylinder(depth, step, variant).cheap();
                let plan = Plan::new(&scene.scene, scene.mesh.clone()).map_err(|e| e.to_string())?;
                let out = go(&scene, &plan, 1, Way::Guided);
                let names_both =
                    |e: String| e.contains("`strap_block` and `cylinder_block` went through each other");
                match out.errors.first().map(ToString::to_string) {
                    None => {
                        // The middle of the strap, at its first and last node across.
                        let x = &out.last().expect("solved").x;
                        let nodes = &plan.mesh.blocks[0].nodes;
                        let middle = nodes.iter().filter(|&&n| plan.mesh.points[n as usize][0] == 0.0);
                        let lowest = middle.map(|&n| x[3 * n as usize + 2]).fold(f64::MAX, f64::min);
                        let axis = -depth - 3e-3;
                        if lowest < axis && scene.name == STUCK {
                            stuck += 1;
                            continue;
                        }
                        if lowest < axis {
                            return Err(format!("{}: below the cylinder without a word", scene.name));
                        }
                        right += 1;
                    }
                    Some(error) if names_both(error.clone()) => named += 1,
                    Some(error) => return Err(format!("{}: {error}", scene.name)),
                }
            }
        }
    }
    let text =
        format!("{named} refused by name, {right} above the cylinder, {stuck} known to be stuck in it");
    if named > 0 && right > 0 && stuck == 1 { Ok(text) } else { Err(text) }
}
