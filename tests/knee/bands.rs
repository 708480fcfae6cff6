//! Bands of joint forces: they hold the answer, nothing admissible lies outside, and their ends are reached.

#![allow(non_snake_case)]

use coupling::form::Form;
use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use multibody::share::{BAND_NAMES, SharingSettings, names, problem};
use multibody::sharing::{Capacity, SharingOptions, SharingProblem, SharingSolver, extremes};
use multibody::trial::Status;
use nalgebra::{DMatrix, DVector};
use support::{Random, shared, shipped_trial};

fn run(trial: Option<&str>, form: Form, reserves: Option<f64>) -> Optimized {
    optimize(&OptimizeOptions {
        trial: trial.map(shipped_trial),
        data: shared("gait"),
        form,
        bands: true,
        sharing: SharingSettings { reserves, ..SharingSettings::default() },
        ..OptimizeOptions::default()
    })
    .unwrap()
}

/// Value of a band's force in a frame, from the joint forces that were found.
fn found(done: &Optimized, name: &str, frame: usize) -> f64 {
    let column = |n: &str| done.effort.reactions.column(n).unwrap()[frame];
    match name {
        "knee_total" => column("knee_medial") + column("knee_lateral"),
        "hip" | "ankle" => {
            ["x", "y", "z"].map(|a| column(&format!("{name}_{a}")).powi(2)).iter().sum::<f64>().sqrt()
        }
        _ => column(name),
    }
}

#[test]
fn the_band_holds_the_answer_in_every_frame() {
    let mut trials = vec![None];
    if shared("gait").is_some() {
        trials.extend([Some("DM_ngait_og3"), Some("jw_ngait_og3")]);
    }
    for trial in trials {
        for (form, reserves) in
            [(Form::PUBLISHED, None), (Form::REVISED, None), (Form::PUBLISHED, Some(1e-2))]
        {
            let done = run(trial, form, reserves);
            let bands = done.bands.as_ref().unwrap();
            assert_eq!(bands.values.nrows(), done.effort.time.len());
            let mut wide = 0;
            for k in 0..done.effort.time.len() {
                assert_eq!(done.effort.verdicts[k].status, Status::Solved);
                for (j, name) in BAND_NAMES.iter().enumerate() {
                    // An end that duality does not prove is NaN, and fails here.
                    let (least, greatest) = (bands.values[(k, 2 * j)], bands.values[(k, 2 * j + 1)]);
                    let value = found(&done, name, k);
                    // The joint moments are met to 1e-8 of their size, and so is the place of the answer.
                    let round_off = 1e-6 * value.abs().max(1.0);
                    assert!(
                        least <= value + round_off && value <= greatest + round_off,
                        "{trial:?}, frame {k}, {name}: {value} outside {least} to {greatest}"
                    );
                    wide += usize::from(greatest - least > 100.0);
                }
            }
            assert!(wide > 2 * done.effort.time.len(), "bands without width say nothing: {wide}");
        }
    }
}

/// The strength of the whole leg decides nothing that a cost could not: other costs give other forces, and all of them are inside.
#[test]
fn answers_of_any_cost_lie_in_the_band_and_some_come_near_its_ends() {
    let done = run(None, Form::PUBLISHED, None);
    let bands = done.bands.as_ref().unwrap();
    let model = &done.model;
    let capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    let settings = SharingSettings::default();
    let mut solver = SharingSolver::new(names(model), SharingOptions::default());
    let mut random = Random::new(11);
    let at = |n: &str| model.reaction_names().iter().position(|r| r == n).unwrap();
    let (medial, lateral) = (at("knee_medial"), at("knee_lateral"));
    let mut nearest: f64 = f64::INFINITY;
    for k in (0..done.effort.time.len()).step_by(10) {
        let posed = problem(model, &done.loads, k, &capacity, &settings).unwrap();
        for round in 0..12 {
            let mut other = posed.clone();
            other.w_f = DVector::from_fn(43, |_, _| random.power(-3.0, 3.0));
            // Every fourth cost wants the total small above all.
            other.w_x.fill(0.0);
            if round % 4 == 0 {
                other.w_f.fill(1e-6);
                other.w_x[medial] = 1e3;
                other.w_x[lateral] = 1e3;
            }
            let answer = solver.solve(&other).unwrap();
            if answer.verdict.status != Status::Solved {
                continue; // weights of nine decades are not always settled; they say so
            }
            let values = [answer.x[medial], answer.x[lateral], answer.x[medial] + answer.x[lateral]];
            for (j, value) in values.iter().enumerate() {
                let (least, greatest) = (bands.values[(k, 2 * j)], bands.values[(k, 2 * j + 1)]);
                assert!(
                    *value >= least - 1e-5 * value.abs().max(1.0)
                        && *value <= greatest + 1e-5 * value.abs().max(1.0),
                    "frame {k}, {}: {value} outside {least} to {greatest}",
                    BAND_NAMES[j]
                );
                nearest = nearest.min(value - least);
            }
        }
    }
    assert!(nearest < 20.0, "no cost comes nearer than {nearest} N to an end");
}

/// All vertices of small problems, by brute force: every choice of bounds that leaves one point.
fn by_enumeration(p: &SharingProblem, w: &DVector<f64>) -> Option<[f64; 2]> {
    let (n, ne) = (p.n_muscles(), p.n_coordinates());
    let mut rows: Vec<(DVector<f64>, f64)> = Vec::new();
    for i in 0..n {
        let unit = DVector::from_fn(n, |j, _| f64::from(i == j));
        rows.push((unit.clone(), p.lower_f[i]));
        rows.push((unit, p.upper_f[i]));
    }
    for j in 0..p.n_reactions() {
        for bound in [p.lower_x[j], p.upper_x[j]].into_iter().filter(|b| b.is_finite()) {
            rows.push((p.X.row(j).transpose(), bound - p.x0[j]));
        }
    }
    let mut ends: Option<[f64; 2]> = None;
    let mut chosen: Vec<usize> = (0..n - ne).collect();
    loop {
        let A = DMatrix::from_fn(n, n, |r, c| if r < ne { p.R[(r, c)] } else { rows[chosen[r - ne]].0[c] });
        let b = DVector::from_fn(n, |r, _| if r < ne { p.tau[r] } else { rows[chosen[r - ne]].1 });
        if let Some(f) = A.clone().lu().solve(&b).filter(|f| (&A * f - &b).amax() < 1e-7 && f.amax() < 1e7) {
            let x = p.reactions(&f);
            let within = (0..n).all(|i| f[i] >= p.lower_f[i] - 1e-7 && f[i] <= p.upper_f[i] + 1e-7)
                && (0..x.len()).all(|j| x[j] >= p.lower_x[j] - 1e-7 && x[j] <= p.upper_x[j] + 1e-7);
            if within {
                let value = w.dot(&x);
                ends = Some(ends.map_or([value, value], |[lo, hi]| [lo.min(value), hi.max(value)]));
            }
        }
        // The next choice of n − ne rows.
        let Some(k) = (0..chosen.len()).rev().find(|&k| chosen[k] < rows.len() - chosen.len() + k) else {
            break;
        };
        chosen[k] += 1;
        for j in k + 1..chosen.len() {
            chosen[j] = chosen[j - 1] + 1;
        }
    }
    ends
}

#[test]
fn the_ends_are_those_of_all_vertices() {
    let mut random = Random::new(3);
    let mut compared = 0;
    for _ in 0..400 {
        let n = 5;
        let problem = SharingProblem {
            R: DMatrix::from_fn(2, n, |_, _| 0.05 * random.uniform()),
            tau: DVector::from_fn(2, |_, _| 20.0 * random.uniform()),
            x0: DVector::from_fn(2, |_, _| 300.0 * random.uniform()),
            X: DMatrix::from_fn(2, n, |_, _| random.uniform()),
            lower_f: DVector::from_fn(
                n,
                |_, _| if random.chance(0.3) { random.between(0.0, 50.0) } else { 0.0 },
            ),
            upper_f: DVector::from_fn(n, |_, _| random.between(200.0, 1500.0)),
            lower_x: DVector::from_fn(2, |_, _| if random.chance(0.5) { -100.0 } else { f64::NEG_INFINITY }),
            upper_x: DVector::from_element(2, f64::INFINITY),
            w_f: DVector::repeat(n, 1.0),
            w_x: DVector::zeros(2),
            w_s: None,
        };
        let mut solver =
            SharingSolver::new(support::sharing_problems::names(&problem), SharingOptions::default());
        let answer = solver.solve(&problem).unwrap();
        if answer.verdict.status != Status::Solved {
            continue;
        }
        for w in [DVector::from_vec(vec![1.0, 0.0]), DVector::from_vec(vec![0.6, -0.8])] {
            let [got] = extremes(&problem, &answer.f, &answer.s, std::slice::from_ref(&w))[..] else {
                panic!()
            };
            let want = by_enumeration(&problem, &w).expect("a solved problem has a vertex");
            for (got, want) in got.iter().zip(want) {
                assert!((got - want).abs() < 1e-6 * want.abs().max(1.0), "{got} {want}");
            }
            compared += 1;
        }
    }
    assert!(compared > 300, "{compared}");
}

/// Tensions without an upper bound: the least force is finite, the greatest is not.
#[test]
fn what_nothing_bounds_is_infinite() {
    let problem = SharingProblem {
        R: DMatrix::from_row_slice(1, 2, &[0.04, -0.04]),
        tau: DVector::from_element(1, 20.0),
        x0: DVector::from_element(1, 100.0),
        X: DMatrix::from_row_slice(1, 2, &[1.0, 1.0]),
        lower_f: DVector::zeros(2),
        upper_f: DVector::from_element(2, f64::INFINITY),
        lower_x: DVector::zeros(1),
        upper_x: DVector::from_element(1, f64::INFINITY),
        w_f: DVector::repeat(2, 1.0),
        w_x: DVector::zeros(1),
        w_s: None,
    };
    let f = DVector::from_vec(vec![500.0, 0.0]);
    let [band] = extremes(&problem, &f, &DVector::zeros(1), &[DVector::from_element(1, 1.0)])[..] else {
        panic!()
    };
    assert!((band[0] - 600.0).abs() < 1e-9 && band[1] == f64::INFINITY, "{band:?}");
}

/// A frame takes less than a millisecond; nothing is computed where nobody asks.
#[test]
fn bands_cost_less_than_a_millisecond_a_frame() {
    let took = |done: &Optimized| {
        done.stages.iter().find(|s| s.0 == "bands").map(|s| s.1.as_secs_f64() / done.effort.time.len() as f64)
    };
    let fastest =
        (0..5).filter_map(|_| took(&run(None, Form::PUBLISHED, None))).fold(f64::INFINITY, f64::min);
    println!("{:.3} ms per frame", 1e3 * fastest);
    assert!(fastest < 1e-3, "{fastest}");
    let without = optimize(&OptimizeOptions::default()).unwrap();
    assert!(without.bands.is_none() && took(&without).is_none());
}
