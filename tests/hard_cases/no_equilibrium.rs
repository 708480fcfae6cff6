//! Hard case of loads that nothing can bear: E16.

use super::equilibrium::{check, held, solid};
use super::judge::judged_run;
use crate::{Case, Outcome, Tier};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame};
use fem::scene::{ForceSpec, GravitySpec, LawSpec, PrescribedSpec, PressureSpec, Scene};
use fem::solve::{Settings, SolveError};

pub const CASES: &[Case] = &[
    Case {
        id: "E16",
        title: "sphere inflated past its limit, Mooney-Rivlin",
        tier: Tier::Quick,
        run: coarse_mooney_rivlin_sphere,
    },
    Case {
        id: "E16",
        title: "sphere inflated past its limit, 4x4 cells",
        tier: Tier::Full,
        run: mooney_rivlin_sphere,
    },
    Case {
        id: "E16",
        title: "sphere inflated past its limit, neo-Hookean",
        tier: Tier::Quick,
        run: neo_hookean_sphere,
    },
    Case { id: "E16", title: "bar pulled beyond what it holds", tier: Tier::Quick, run: pulled_bar },
    Case { id: "E16", title: "unsupported body under load", tier: Tier::Quick, run: unsupported },
];

/// Inner and outer radius \[m\].
const RADII: [f64; 2] = [10e-3, 15e-3];
/// Moduli \[Pa\] of the benchmarks.
const BULK: f64 = 747.5e3;

/// Radial and circumferential Cauchy stress \[Pa\] of the law at stretches λ_r and λ_θ (twice):
/// σᵢ = 2/J (C₁₀ J^(−2/3) (λᵢ² − I₁/3) + C₀₁ J^(−4/3) (I₁ λᵢ² − λᵢ⁴ − ⅔ I₂)) + K (J − 1) (Holzapfel, Nonlinear Solid Mechanics, §6.5).
fn stresses(c10: f64, c01: f64, [r, t]: [f64; 2]) -> [f64; 2] {
    let j = r * t * t;
    let (i1, i2) = (r * r + 2.0 * t * t, 2.0 * (r * t).powi(2) + t.powi(4));
    [r, t].map(|l| {
        let first = c10 * j.powf(-2.0 / 3.0) * (l * l - i1 / 3.0);
        let second = c01 * j.powf(-4.0 / 3.0) * (i1 * l * l - l.powi(4) - 2.0 / 3.0 * i2);
        2.0 / j * (first + second) + BULK * (j - 1.0)
    })
}

/// Inner stretch and pressure \[Pa\] of the sphere by the ordinary differential equation of its radius, dσ_r/dR = 2 λ_r (σ_θ − σ_r)/r and
/// dr/dR = λ_r, from the free outside at stretch `outer` inwards by Heun's method.
///
/// At finite K the wall gains volume as it is stretched (6 % at an inner stretch of 4), which gives the pressure a greatest value. The
/// incompressible sphere of these constants has none: its pressure only rises.
fn by_ode(c10: f64, c01: f64, outer: f64) -> [f64; 2] {
    // The radial stretch that goes with a radial stress, by Newton's method.
    let radial = |sigma: f64, t: f64, mut r: f64| {
        for _ in 0..30 {
            let [f, ahead] = [r, r * (1.0 + 1e-6)].map(|r| stresses(c10, c01, [r, t])[0] - sigma);
            r -= f * 1e-6 * r / (ahead - f);
        }
        r
    };
    let n = 200;
    let step = (RADII[0] - RADII[1]) / f64::from(n);
    let (mut place, mut sigma, mut stretch) = (outer * RADII[1], 0.0, outer.powi(-2));
    for k in 0..n {
        let reference = RADII[1] + f64::from(k) * step;
        let slope = |reference: f64, place: f64, sigma: f64, guess: f64| {
            let t = place / reference;
            let r = radial(sigma, t, guess);
            (r, 2.0 * r * (stresses(c10, c01, [r, t])[1] - sigma) / place)
        };
        let (r0, s0) = slope(reference, place, sigma, stretch);
        let (r1, s1) = slope(reference + step, place + step * r0, sigma + step * s0, r0);
        place += 0.5 * step * (r0 + r1);
        sigma += 0.5 * step * (s0 + s1);
        stretch = r1;
    }
    [place / RADII[0], -sigma]
}

/// Pressures over inner stretches, out to an outer stretch of 4.
fn curve(c10: f64, c01: f64) -> Vec<[f64; 2]> {
    (1..300).map(|k| by_ode(c10, c01, 1.0 + 0.01 * f64::from(k))).take_while(|[_, p]| p.is_finite()).collect()
}

/// Pressure \[Pa\] of a curve at an inner stretch.
fn pressure_at(curve: &[[f64; 2]], stretch: f64) -> f64 {
    let after = curve.iter().position(|c| c[0] >= stretch).unwrap_or(curve.len() - 1).max(1);
    let [[s0, p0], [s1, p1]] = [curve[after - 1], curve[after]];
    p0 + (stretch - s0) / (s1 - s0) * (p1 - p0)
}

/// How the sphere ended under the last of some pressures.
struct Inflated {
    solved: bool,
    /// Pressure \[Pa\] of the last good state.
    pressure: f64,
    /// Inner stretch there.
    stretch: f64,
    why: String,
}

/// An octant of the sphere under one pressure \[Pa\] after the other; `Err` where the independent code contradicts.
fn inflate(c10: f64, c01: f64, cells: usize, pressures: &[f64]) -> Result<Inflated, String> {
    let mesh = generate::sphere_octant(RADII[0], RADII[1], cells, cells);
    let law = LawSpec::MooneyRivlin { c10, c01, bulk: BULK };
    let on_plane = |d: usize| PrescribedSpec {
        components: std::array::from_fn(|c| c == d),
        ..held(["x_min", "y_min", "z_min"][d])
    };
    let pressure =
        PressureSpec { surface: "inner".into(), origin: Some([0.0; 3]), control: "pressure".into() };
    let scene = Scene {
        solids: vec![solid("block", law)],
        prescribed: (0..3).map(on_plane).collect(),
        pressures: vec![pressure],
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let frame = |(i, p): (usize, &f64)| DriveFrame {
        time: i as f64,
        load: plan.load(&[("pressure", *p)], &[]).expect("the control exists"),
    };
    let drive = Drive { frames: pressures.iter().enumerate().map(frame).collect() };
    let settings = Settings::default();
    let (run, judge) = judged_run(&scene, &plan, &drive, &settings);
    if let Some(mistake) = judge.mistakes.first() {
        return Err(format!("{pressures:?} Pa: {mistake}"));
    }
    let last = run.unsolved.as_ref().or(run.last()).expect("a frame");
    let inner = &plan.mesh.node_sets["inner"];
    let radius = |n: &u32| (0..3).map(|c| last.x[3 * *n as usize + c].powi(2)).sum::<f64>().sqrt();
    let radii: Vec<f64> = inner.iter().map(radius).collect();
    let stretch = radii.iter().sum::<f64>() / inner.len() as f64 / RADII[0];
    let done = run.frames.len();
    let before = if done == 0 { 0.0 } else { pressures[done - 1] };
    let (solved, pressure, why) = match run.errors.first() {
        None => (true, before, String::new()),
        Some(SolveError::NotConverged(why)) => {
            (false, before + why.load * (pressures[done] - before), why.reason.to_string())
        }
        Some(other) => return Err(format!("{pressures:?} Pa: {other}")),
    };
    Ok(Inflated { solved, pressure, stretch, why })
}

/// The sphere of some constants: solved below its greatest pressure, on the curve of its differential equation; not converged above, with
/// a last good load near that.
fn sphere(c10: f64, c01: f64, cells: usize, below: f64, above: [f64; 2]) -> Outcome {
    let curve = curve(c10, c01);
    let limit = curve.iter().map(|c| c[1]).fold(0.0, f64::max);
    let mut told = Vec::new();
    for pressures in [&[below][..], &[below, above[0]], &[above[1]]] {
        let end = inflate(c10, c01, cells, pressures)?;
        let (asked, wanted) = (pressures[pressures.len() - 1], pressure_at(&curve, end.stretch));
        let text = format!(
            "{asked:.0} Pa: {} at {:.0} Pa and inner stretch {:.2}",
            if end.solved { "solved" } else { "not converged, last good state" },
            end.pressure,
            end.stretch
        );
        if !((wanted / end.pressure - 1.0).abs() < 0.03) {
            return Err(format!("{text}, for which {wanted:.0} Pa are wanted"));
        }
        let near = (0.95..1.03).contains(&(end.pressure / limit));
        if end.solved != (asked < limit) || !end.solved && !near {
            return Err(format!("{text}; the limit is {limit:.0} Pa; {}", end.why));
        }
        told.push(text);
    }
    Ok(format!("limit {limit:.0} Pa; {}", told.join("; ")))
}

fn coarse_mooney_rivlin_sphere() -> Outcome {
    sphere(3e3, 0.75e3, 2, 4.6e3, [4.8e3, 7e3])
}

fn mooney_rivlin_sphere() -> Outcome {
    sphere(3e3, 0.75e3, 4, 4.6e3, [4.8e3, 7e3])
}

fn neo_hookean_sphere() -> Outcome {
    sphere(3.75e3, 0.0, 2, 3.4e3, [4e3, 6e3])
}

/// Mooney-Rivlin with C₁₀ < 0 < C₀₁: the force on a bar, 2 A (λ − λ⁻²)(C₁₀ + C₀₁/λ), has a greatest value.
fn pulled_bar() -> Outcome {
    let (c10, c01, side) = (-1e3, 5e3, 0.01);
    let force = |l: f64| 2.0 * side * side * (l - l.powi(-2)) * (c10 + c01 / l);
    let limit = (0..400).map(|k| force(1.0 + 0.01 * f64::from(k))).fold(0.0, f64::max);
    let pull = |asked: &[f64]| {
        let mesh = generate::block([6, 2, 2], [0.06, side, side]);
        let nodes = mesh.node_sets["x_max"].clone();
        // Fractions of the end face: corners a quarter of the middle.
        let edge = |v: f64| if v == 0.0 || v == side { 0.5 } else { 1.0 };
        let fraction = |n: &u32| {
            let p = mesh.points[*n as usize];
            (*n, [edge(p[1]) * edge(p[2]) / 4.0, 0.0, 0.0])
        };
        let loads = nodes.iter().map(fraction).collect();
        let roller = |d: usize| PrescribedSpec {
            components: std::array::from_fn(|c| c == d),
            ..held(["x_min", "y_min", "z_min"][d])
        };
        let scene = Scene {
            solids: vec![solid("block", LawSpec::MooneyRivlin { c10, c01, bulk: 1e6 })],
            prescribed: (0..3).map(roller).collect(),
            forces: vec![ForceSpec { name: "pull".into(), loads, control: "pull".into() }],
            ..Scene::default()
        };
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let load = |f: f64| plan.load(&[("pull", f)], &[]).expect("the control exists");
        let frame = |f: &f64| DriveFrame { time: 0.0, load: load(*f) };
        let drive = Drive { frames: asked.iter().map(frame).collect() };
        let settings = Settings::default();
        let (run, judge) = judged_run(&scene, &plan, &drive, &settings);
        match judge.mistakes.first() {
            Some(mistake) => Err(format!("{asked:?} N: {mistake}")),
            None => Ok((run.frames.len(), run.errors)),
        }
    };
    let mut told = Vec::new();
    for asked in [&[0.95 * limit, 1.05 * limit][..], &[1.05 * limit], &[2.0 * limit]] {
        let (done, errors) = pull(asked)?;
        let Some(SolveError::NotConverged(why)) = errors.first() else {
            return Err(format!("{asked:?} N of {limit:.3} N: {errors:?}"));
        };
        let before = if done == 0 { 0.0 } else { asked[done - 1] };
        let fraction = (before + why.load * (asked[done] - before)) / limit;
        if !(0.9..1.01).contains(&fraction) {
            return Err(format!("{asked:?} N: ended at {fraction:.3} of {limit:.3} N: {why}"));
        }
        told.push(format!("{fraction:.3}"));
    }
    Ok(format!("holds {limit:.3} N; last good loads {} of it", told.join(", ")))
}

/// Under its weight, or a force, and with nothing to hold it, or rollers on one side only.
fn unsupported() -> Outcome {
    let block = || generate::block([3; 3], [0.02; 3]);
    let refused = |mesh: Mesh, prescribed: Vec<PrescribedSpec>, forces: Vec<ForceSpec>| {
        let gravity = GravitySpec { acceleration: [0.0, 0.0, -9.81], control: "load".into() };
        let law = LawSpec::NeoHookean { young: 30e3, nu: 0.45 };
        let scene = Scene {
            solids: vec![solid("block", law)],
            gravity: Some(gravity),
            prescribed,
            forces,
            ..Scene::default()
        };
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let drive = Drive::once(plan.load(&[("load", 1.0)], &[]).expect("the control exists"));
        let settings = Settings::default();
        let (run, judge) = judged_run(&scene, &plan, &drive, &settings);
        let untouched = run.unsolved.as_ref().is_some_and(|frame| frame.x == plan.reference());
        match (run.errors.first(), judge.mistakes.first()) {
            (Some(SolveError::Unsupported { .. }), None) if untouched => Ok(()),
            (error, mistake) => Err(format!("{error:?}, {mistake:?}, places kept: {untouched}")),
        }
    };
    refused(block(), vec![], vec![])?;
    let roller = PrescribedSpec { components: [false, false, true], ..held("z_min") };
    refused(block(), vec![roller.clone()], vec![])?;
    let push = ForceSpec { name: "push".into(), loads: vec![(63, [1.0, 0.0, 0.0])], control: "load".into() };
    refused(block(), vec![roller], vec![push])?;
    check(
        true,
        "floating, on rollers, and pushed along them: named as unsupported, nodes where they were".into(),
    )
}
