//! Do the shared forces carry the moments with least cost, and does a frame that cannot be carried say why?

#![allow(non_snake_case)]

use std::collections::BTreeMap;

use multibody::loads::loads;
use multibody::model::{Ankle, Model};
use multibody::motion::track;
use multibody::share::{SharingSettings, problem};
use multibody::sharing::{
    Capacity, KKT_TOLERANCE, LeverArm, MuscleCost, SharingError, SharingOptions, SharingProblem,
    SharingSolver, reactions, residuals, share_frames,
};
use multibody::trial::{Filters, Status};
use multibody::walker::{Knee, walker};
use nalgebra::{DMatrix, DVector};
use support::shared;
use support::sharing_cases::{self, leg, solve, solve_raised};
use support::sharing_problems::names;

/// One coordinate, `arms.len()` muscles, costs 1, no x.
fn knee(arms: &[f64], strength: &[f64], tau: f64) -> SharingProblem {
    let n = arms.len();
    SharingProblem {
        R: DMatrix::from_row_slice(1, n, arms),
        tau: DVector::from_element(1, tau),
        x0: DVector::zeros(0),
        X: DMatrix::zeros(0, n),
        lower_f: DVector::zeros(n),
        upper_f: DVector::from_column_slice(strength),
        lower_x: DVector::zeros(0),
        upper_x: DVector::zeros(0),
        w_f: DVector::repeat(n, 1.0),
        target_f: None,
        w_x: DVector::zeros(0),
        w_s: None,
    }
}

/// `problem` with one force x = x0 + gain · f, x ≥ 0.
fn with_reaction(problem: SharingProblem, x0: f64, gain: &[f64]) -> SharingProblem {
    SharingProblem {
        x0: DVector::from_element(1, x0),
        X: DMatrix::from_row_slice(1, gain.len(), gain),
        lower_x: DVector::zeros(1),
        upper_x: DVector::from_element(1, f64::INFINITY),
        w_x: DVector::zeros(1),
        ..problem
    }
}

#[test]
fn ten_thousand_random_problems_agree_with_a_second_solver() {
    println!("{}", sharing_cases::random_problems(10_000).unwrap());
}

#[test]
fn twice_the_capacity_names_what_is_missing() {
    println!("{}", sharing_cases::infeasible_load().unwrap());
}

#[test]
fn a_split_muscle_carries_the_same_with_volume_weighting() {
    println!("{}", sharing_cases::redundant_copies().unwrap());
}

#[test]
fn dependent_rows_and_unactuated_coordinates() {
    println!("{}", sharing_cases::rank_deficient().unwrap());
}

#[test]
fn units_do_not_matter() {
    println!("{}", sharing_cases::scaling().unwrap());
}

#[test]
fn equal_muscles_share_equally_and_antagonists_rest() {
    let answer = solve(&knee(&[0.04, 0.04, 0.02, -0.03], &[1e4; 4], 30.0));
    // f is proportional to the lever arm: 30 = λ (0.04² + 0.04² + 0.02²).
    let lambda = 30.0 / 0.0036;
    for (f, expected) in answer.f.iter().zip([0.04 * lambda, 0.04 * lambda, 0.02 * lambda, 0.0]) {
        assert!((f - expected).abs() < 1e-9, "{}", answer.f);
    }
    assert_eq!(answer.verdict.active_bounds, 1);
    assert!((answer.multipliers.moments[0] - lambda).abs() < 1e-7);
}

#[test]
fn strength_is_a_bound_and_the_rest_takes_over() {
    let answer = solve(&knee(&[0.04, 0.04], &[200.0, 1e4], 30.0));
    assert!((answer.f[0] - 200.0).abs() == 0.0 && (answer.f[1] - 550.0).abs() < 1e-9, "{}", answer.f);
    assert_eq!(answer.verdict.saturated, ["m0"]);
}

/// Capacity 0.04 m × 1500 N = 60 N·m.
#[test]
fn a_missing_moment_has_its_size_sign_and_culprits() {
    for sign in [1.0, -1.0] {
        let arms = [0.04 * sign, 0.04 * sign, -0.03 * sign];
        let answer = solve(&knee(&arms, &[1000.0, 500.0, 800.0], 120.0 * sign));
        let verdict = &answer.verdict;
        assert_eq!(verdict.status, Status::Infeasible);
        assert_eq!(answer.f.as_slice(), [1000.0, 500.0, 0.0]);
        assert_eq!(verdict.shortfall.len(), 1);
        assert!((verdict.shortfall[0].missing - 60.0 * sign).abs() < 1e-9, "{:?}", verdict.shortfall);
        assert_eq!(verdict.saturated, ["m0", "m1"]);
        assert!((verdict.equality_residual - 0.5).abs() < 1e-9, "{verdict:?}");
        assert!(verdict.kkt_residual < KKT_TOLERANCE);
    }
}

#[test]
fn raised_strengths_use_the_smallest_common_factor() {
    let problem = knee(&[0.04, 0.04, -0.03], &[1000.0, 500.0, 800.0], 120.0);
    let answer = solve_raised(&problem, 5.0);
    assert_eq!(answer.verdict.status, Status::Infeasible);
    let factor = answer.raised.expect("a factor of 2 is enough").factor;
    assert!((factor - 2.0).abs() < 1e-5, "{factor}");
    assert!((0.04 * (answer.f[0] + answer.f[1]) - 120.0).abs() < 1e-9, "{}", answer.f);
    assert!((answer.missing[0] - 60.0).abs() < 1e-9);
    assert!(answer.verdict.equality_residual < 1e-12 && answer.residuals.largest() < KKT_TOLERANCE);
    // Not beyond the limit.
    let limited = solve_raised(&problem, 1.5);
    assert!(limited.raised.is_none() && limited.f[0] == 1000.0);
}

/// x = 50 − 0.5 f ≥ 0 allows f ≤ 100 N, hence 4 N·m of 20.
#[test]
fn a_bound_of_a_ligament_that_is_in_the_way_is_named() {
    let answer = solve(&with_reaction(knee(&[0.04, -0.03], &[1e4, 1e4], 20.0), 50.0, &[-0.5, 0.0]));
    assert_eq!(answer.verdict.status, Status::Infeasible);
    assert!((answer.missing[0] - 16.0).abs() < 1e-6, "{}", answer.missing);
    let [block] = &answer.blocking[..] else { panic!("{:?}", answer.blocking) };
    assert_eq!((block.reaction.as_str(), block.bound), ("x0", 0.0));
    assert!((block.needed.unwrap() + 200.0).abs() < 1e-6, "{block:?}");
    assert!(answer.verdict.saturated.is_empty());
}

#[test]
fn a_bound_that_no_tensions_satisfy_is_named() {
    let answer = solve(&with_reaction(knee(&[0.04, -0.03], &[1e4, 1e4], 20.0), -10.0, &[0.0, 0.0]));
    assert_eq!(answer.verdict.status, Status::Infeasible);
    let reason = answer.verdict.reason.unwrap();
    assert!(reason.contains("x0 misses its bound by -10.000 N whatever the tensions"), "{reason}");
    assert!((0.04 * answer.f[0] - 20.0).abs() < 1e-6, "the moment itself can be carried: {}", answer.f);
}

/// min f²/2 + w s²/2 with 0.05 f + s = 20: s = 20 / (1 + 0.05² w).
#[test]
fn reserves_take_their_fraction_and_report_it() {
    let problem =
        SharingProblem { w_s: Some(DVector::from_element(1, 100.0)), ..knee(&[0.05], &[1e4], 20.0) };
    let answer = solve(&problem);
    let s = 20.0 / (1.0 + 0.05 * 0.05 * 100.0);
    assert_eq!(answer.verdict.status, Status::Solved);
    assert!((answer.s[0] - s).abs() < 1e-9 && (answer.f[0] - (20.0 - s) / 0.05).abs() < 1e-7);
    assert!((answer.verdict.reserve_share - s / 20.0).abs() < 1e-9);
    // No reserve where the weight is infinite.
    let without = solve(&SharingProblem { w_s: Some(DVector::from_element(1, f64::INFINITY)), ..problem });
    assert_eq!((without.s[0], without.verdict.reserve_share), (0.0, 0.0));
    assert!((without.f[0] - 400.0).abs() < 1e-9);
}

/// A gradient, bound or equality that is off by 1e-6 must show in its residual.
#[test]
fn residuals_see_what_is_wrong() {
    let (_, _, problem) = leg(1, MuscleCost::Force, true);
    let answer = solve(&problem);
    let zero = DVector::zeros(6);
    assert!(residuals(&problem, &answer.f, &zero, &answer.multipliers).largest() < 1e-12);
    let free = (0..43).find(|i| answer.f[*i] > 1.0 && answer.f[*i] < problem.upper_f[*i]).unwrap();
    let resting = (0..43).find(|i| answer.f[*i] == 0.0).unwrap();
    let largest = answer.f.amax();

    let mut f = answer.f.clone();
    f[free] += 1e-5 * largest;
    let moved = residuals(&problem, &f, &zero, &answer.multipliers);
    assert!(moved.equality > 1e-8 && moved.stationarity > 1e-8, "{moved:?}");
    let mut f = answer.f.clone();
    f[resting] = -1e-3 * largest;
    assert!(residuals(&problem, &f, &zero, &answer.multipliers).primal > 1e-5);
    let mut multipliers = answer.multipliers.clone();
    multipliers.moments *= 1.0 + 1e-6;
    assert!(residuals(&problem, &answer.f, &zero, &multipliers).stationarity > 1e-8);
    let mut multipliers = answer.multipliers.clone();
    let open = (0..10).find(|j| answer.x[*j] > problem.lower_x[*j] + 10.0).unwrap();
    multipliers.reactions[open] = 1.0;
    assert!(residuals(&problem, &answer.f, &zero, &multipliers).complementarity > 1e-8);
    multipliers.reactions[open] = -1.0;
    assert!(residuals(&problem, &answer.f, &zero, &multipliers).dual > 1e-8);
}

/// A slowly changing leg: the kept solver, in any order, gives the bits of a fresh one.
#[test]
fn answers_do_not_depend_on_what_was_solved_before() {
    let (_, _, base) = leg(5, MuscleCost::Force, true);
    let (_, _, other) = leg(6, MuscleCost::Force, true);
    let frame = |k: usize| {
        let phase = k as f64 * 0.05;
        let mut problem = base.clone();
        problem.tau = &base.tau * phase.cos().powi(2) + &other.tau * (0.2 * phase.sin());
        problem.R = &base.R + &other.R * (0.1 * phase.sin());
        problem
    };
    let n = 200;
    let fresh: Vec<_> = (0..n).map(|k| solve(&frame(k))).collect();
    assert!(fresh.iter().filter(|a| a.verdict.status == Status::Solved).count() > n / 2);
    let same = |a: &multibody::sharing::Sharing, b: &multibody::sharing::Sharing, k: usize| {
        assert_eq!(a.f, b.f, "frame {k}");
        assert_eq!((&a.x, &a.s, &a.missing), (&b.x, &b.s, &b.missing), "frame {k}");
        assert_eq!(a.verdict.kkt_residual.to_bits(), b.verdict.kkt_residual.to_bits(), "frame {k}");
    };
    let mut solver = SharingSolver::new(names(&base), SharingOptions::default());
    for k in (0..n).chain((0..n).rev()) {
        same(&solver.solve(&frame(k)).unwrap(), &fresh[k], k);
    }
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            share_frames(n, &names(&base), SharingOptions::default(), |k| Ok::<_, SharingError>(frame(k)))
                .unwrap()
        })
    };
    let (one, two) = (run(1), run(2));
    for k in 0..n {
        same(&one[k], &fresh[k], k);
        assert_eq!(one[k].verdict, two[k].verdict);
        assert_eq!(one[k].f, two[k].f);
    }
}

#[test]
fn malformed_problems_are_refused_by_name() {
    let good = knee(&[0.04, -0.03], &[1e4, 1e4], 20.0);
    let refused = |problem: SharingProblem| {
        let mut solver = SharingSolver::new(names(&good), SharingOptions::default());
        solver.solve(&problem).unwrap_err().to_string()
    };
    let with = |change: fn(&mut SharingProblem)| {
        let mut problem = good.clone();
        change(&mut problem);
        refused(problem)
    };
    assert_eq!(with(|p| p.tau[0] = f64::NAN), "`tau` of `c0` is NaN, expected a finite moment");
    assert_eq!(with(|p| p.R[(0, 1)] = f64::INFINITY), "`R` of `m1` is inf, expected a finite number");
    assert_eq!(with(|p| p.w_f[1] = 0.0), "`w_f` of `m1` is 0, expected a positive finite weight");
    assert!(with(|p| p.upper_f[0] = -1.0).starts_with("`upper_f` of `m0`"));
    assert_eq!(with(|p| p.w_f = DVector::zeros(3)), "`w_f` has 3 entries, expected 2 (muscles)");
}

/// The table of weights is the published one, in the order of the model's reactions.
#[test]
fn weights_and_bounds_are_those_of_the_table() {
    let table = include_str!("../gait-data/so_weights.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(table.as_bytes());
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.unwrap();
        let (count, weight): (usize, f64) = (record[1].parse().unwrap(), record[2].parse().unwrap());
        rows.extend((0..count).map(|k| (record[0].to_string(), k, weight, record[3].to_string())));
    }
    let universal = reactions(false);
    assert_eq!(rows.len(), universal.len() + 43);
    for ((what, k, weight, bounds), reaction) in rows.iter().zip(&universal) {
        assert_eq!(reaction.weight, *weight, "{what}");
        let nonnegative =
            bounds.starts_with(">=0") || (bounds.contains("Y>=0") || bounds.contains("0 for Y")) && *k == 1;
        assert_eq!(reaction.lower == 0.0, nonnegative, "{what} {k}: {bounds}");
        assert!(reaction.lower == 0.0 || reaction.lower == f64::NEG_INFINITY);
    }
    for ankle in [Ankle::Universal, Ankle::Parallel] {
        let (trial, anatomy) = walker(Knee::Hinge);
        let model = Model::new(&trial, anatomy, ankle).unwrap();
        let table: Vec<&str> = reactions(ankle == Ankle::Parallel).iter().map(|r| r.name).collect();
        assert_eq!(table, model.reaction_names());
    }
}

/// One complete OpenSim problem: muscles and ideal actuators of optimal force 1.
struct Instance {
    problem: SharingProblem,
    /// Force at activation 1 \[N\], and OpenSim's activation.
    strength: DVector<f64>,
    activation: DVector<f64>,
}

fn opensim_instances(folder: &std::path::Path) -> Vec<Instance> {
    let rows = |file: &str| -> Vec<Vec<String>> {
        let mut reader = csv::Reader::from_path(folder.join(file)).unwrap();
        reader.records().map(|r| r.unwrap().iter().map(String::from).collect()).collect()
    };
    let number = |text: &str| text.parse::<f64>().unwrap();
    let mut moments: BTreeMap<usize, Vec<(String, f64)>> = BTreeMap::new();
    for row in rows("required_generalised_force.csv") {
        moments.entry(row[0].parse().unwrap()).or_default().push((row[2].clone(), number(&row[3])));
    }
    let (arms, solution) = (rows("moment_arms_nonzero.csv"), rows("so_solution.csv"));
    let instance = |(frame, moments): (usize, Vec<(String, f64)>)| {
        let of_frame = |row: &&Vec<String>| row[0].parse::<usize>().unwrap() == frame;
        let is_muscle = |row: &&Vec<String>| !row[2].ends_with("_residual") && !row[2].ends_with("_reserve");
        let muscles: Vec<&Vec<String>> = solution.iter().filter(of_frame).filter(is_muscle).collect();
        assert_eq!((muscles.len(), moments.len()), (92, 23));
        let mut R = DMatrix::zeros(23, 92);
        for row in arms.iter().filter(of_frame) {
            let c = moments.iter().position(|(name, _)| *name == row[2]).unwrap();
            let m = muscles.iter().position(|m| m[2] == row[3]).unwrap();
            R[(c, m)] = number(&row[4]);
        }
        let activation = DVector::from_iterator(92, muscles.iter().map(|m| number(&m[3])));
        let strength = DVector::from_iterator(92, muscles.iter().map(|m| number(&m[4]) / number(&m[3])));
        let problem = SharingProblem {
            R,
            tau: DVector::from_iterator(23, moments.iter().map(|m| m.1)),
            x0: DVector::zeros(0),
            X: DMatrix::zeros(0, 92),
            lower_f: &strength * 0.01,
            upper_f: strength.clone(),
            lower_x: DVector::zeros(0),
            upper_x: DVector::zeros(0),
            w_f: strength.map(|f| 1.0 / (f * f)),
            target_f: None,
            w_x: DVector::zeros(0),
            w_s: Some(DVector::repeat(23, 1.0)),
        };
        Instance { problem, strength, activation }
    };
    moments.into_iter().map(instance).collect()
}

/// Activations within 0.005 (OpenSim's own convergence error), and a cost that is not above OpenSim's, whose
/// actuators are recomputed from its activations so that both satisfy the same equalities.
#[test]
fn opensim_problems() {
    for folder in ["so_instances_physiology", "so_instances_no_physiology"] {
        let Some(path) = shared(&format!("reference/opensim/{folder}")) else { return };
        let instances = opensim_instances(&path);
        assert_eq!(instances.len(), 8);
        let (mut difference, mut excess, mut kkt) = (0.0f64, 0.0f64, 0.0f64);
        for (k, instance) in instances.iter().enumerate() {
            let p = &instance.problem;
            let answer = solve(p);
            assert_eq!(answer.verdict.status, Status::Solved, "{folder} {k}: {:?}", answer.verdict);
            kkt = kkt.max(answer.residuals.largest());
            let activation = answer.f.component_div(&instance.strength);
            difference = difference.max((&activation - &instance.activation).amax());
            let f = instance.activation.component_mul(&instance.strength);
            let theirs = p.objective(&f, &(&p.tau - &p.R * &f));
            excess = excess.max(theirs / answer.objective - 1.0);
            assert!(answer.objective <= theirs, "{folder} {k}: {} > {theirs}", answer.objective);
        }
        println!(
            "{folder}: activations within {difference:.4}, OpenSim's cost up to {excess:.1e} above, KKT {kkt:.1e}"
        );
        assert!(difference < 0.005 && kkt < KKT_TOLERANCE);
    }
}

/// What a muscle can do is what force sharing counts on: its bounds and its lever arm stand in the problem, and in the answer.
#[test]
fn a_capacity_bounds_its_muscle_and_gives_it_its_lever_arm() {
    let (trial, anatomy) = walker(Knee::Hinge);
    let filters = Filters { motion_hz: 5.0, force_hz: None, contact_threshold: 20.0 };
    let model = Model::new(&trial, anatomy, Ankle::Universal).unwrap();
    let motion = track(&model, &trial, &filters);
    let loads = loads(&model, &motion, &trial, &filters);
    let (frame, settings) = (loads.time.len() / 2, SharingSettings::default());
    let solved = |capacity: &Capacity| {
        let problem = problem(&model, &loads, frame, capacity, &settings).unwrap();
        let names = multibody::share::names(&model);
        SharingSolver::new(names, settings.options).solve(&problem).unwrap()
    };
    let mut capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    let nominal = solved(&capacity);
    assert_eq!(nominal.verdict.status, Status::Solved);
    let hardest = nominal.f.imax();
    let idle = (0..nominal.f.len()).find(|&i| nominal.f[i] < 1e-6).expect("a muscle at rest");
    capacity.bounds[hardest][1] = 0.5 * nominal.f[hardest];
    capacity.bounds[idle][0] = 20.0;
    let bounded = solved(&capacity);
    assert_eq!(bounded.verdict.status, Status::Solved);
    assert!((bounded.f[hardest] / nominal.f[hardest] - 0.5).abs() < 1e-9, "at its upper bound");
    assert!((bounded.f[idle] - 20.0).abs() < 1e-6, "at its lower bound");
    let lever_arms = &loads.reduced[frame].as_ref().unwrap().lever_arms;
    let coordinate = lever_arms.column(hardest).iamax();
    let arm = 1.25 * lever_arms[(coordinate, hardest)];
    let mut capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    capacity.lever_arms.push(LeverArm { coordinate, muscle: hardest, arm });
    let levered = solved(&capacity);
    assert_eq!(levered.verdict.status, Status::Solved);
    let carried = |f: &DVector<f64>, arms: &DMatrix<f64>| (arms * f)[coordinate];
    let mut longer = lever_arms.clone();
    longer[(coordinate, hardest)] = arm;
    let moment = carried(&nominal.f, lever_arms);
    assert!((carried(&levered.f, &longer) - moment).abs() < 1e-6, "the moment is carried with the new arm");
    assert!((carried(&levered.f, lever_arms) - moment).abs() > 0.1, "and not with the old one");
}
