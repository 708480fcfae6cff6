//! Hard case C12: nobody ends on the wrong side of another, however large the step.

use crate::{Case, Outcome, Tier};
use fem::plan::Plan;
use fem::run::{Run, run};
use fem::solve::{Settings, Way};
use support::side_scenes::*;

pub const CASES: &[Case] = &[Case {
    id: "C12",
    title: "nobody on the wrong side",
    tier: Tier::Full,
    run: trial,
}];

fn solve(s: &SideScene, pieces: usize, way: Way) -> Result<(Plan, Run, f64), String> {
    let plan = Plan::new(&s.scene, s.mesh.clone()).map_err(|e| e.to_string())?;
    let start = std::time::Instant::now();
    let out = run(&plan, &s.drive(&plan, pieces), &Settings { way, ..Settings::default() }, None, &mut |_| {});
    Ok((plan, out, start.elapsed().as_secs_f64()))
}

fn far(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn trial() -> Outcome {
    let mut scenes = Vec::new();
    if let Ok(which) = std::env::var("C12_RANDOM") {
        let (from, to) = which.split_once("..").expect("a range");
        for family in 0..6 {
            for seed in from.parse().unwrap()..to.parse::<u64>().unwrap() {
                scenes.push(random_side_scene(family, seed));
            }
        }
    } else {
        let full = std::env::var("C12_ALL").is_ok();
        for d in DEPTHS {
            for k in STEPS {
                for v in VARIANTS {
                    let listed = match (d * 1e3).round() as i32 { 10 => k == 15.0, 20 => [5.0,10.0,15.0].contains(&k), 40 => [3.0,5.0,10.0,15.0].contains(&k), _ => false };
                    if full || (v == Variant::Plain && listed) {
                        scenes.push(strap_over_cylinder(d, k, v));
                    }
                }
            }
        }
    }
    use rayon::prelude::*;
    let bad: usize = scenes.par_iter().with_max_len(1).map(|s| {
        let mut bad = 0;
        let big = solve(s, 1, if std::env::var("STRICT").is_ok() { Way::Strict } else { Way::Guided }).unwrap();
        let small = solve(s, 60, Way::Strict).unwrap();
        let end = |r: &(Plan, Run, f64)| r.1.errors.first().map_or_else(|| Ok(r.1.frames.last().unwrap().x.clone()), |e| Err(e.to_string()));
        let text = match (end(&big), end(&small)) {
            (Ok(a), Ok(b)) => { let d = far(&a, &b); if d > 3e-4 { bad += 1; } format!("{} {:.3} mm", if d > 3e-4 { "DIFF" } else { "same" }, d * 1e3) }
            (a, b) => { bad += 1; format!("ERR {:?} {:?}", a.err(), b.err()) }
        };
        let c = |f: fn(&fem::solve::Advance) -> usize| big.1.count(f);
        let text = format!("soft {} again {} crossed {} {text}", c(|a| a.soft_ways), c(|a| usize::from(a.gone_again)), c(|a| a.crossed_pairs));
        println!("{:6.2} s {:6.2} s  {} {}", big.2, small.2, text, s.name);
        bad
    }).sum();
    Ok(format!("{bad} of {}", scenes.len()))
}
