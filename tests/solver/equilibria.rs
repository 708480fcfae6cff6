//! What Newton's method finds, and what it says where there is nothing to find.

use super::lattice::{LEAST, Lattice, STIFFNESS, dense, no_motion, residual};
use fem::solve::{
    BlockMatrix, Island, Iteration, IterationLog, Loading, NotConverged, PRESCRIBED, Potential, Reason,
    Settings, SolveError, Solver, advance_islands,
};

#[test]
fn quadratic_potential_takes_one_step() {
    let pull = |p: &[f64; 3]| [0.1 * p[2], 0.0, 0.3 * p[2]];
    let mut lattice = Lattice::new([5, 5, 6], |p| p[2] == 0.0 || p[2] == 5.0, |_| false, pull);
    lattice.linear = true;
    let mut x = lattice.start();
    let mut log = Vec::new();
    let settings = Settings { tolerance: 1e-10, ..Settings::default() };
    let advance = Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    assert!(residual(&lattice, &x) <= 1e-10 * lattice.force_scale(&x));
    // Carrying the load over solves it to the tolerance of the prediction, one Newton step to the last digit.
    assert_eq!((advance.load_steps, advance.iterations, advance.factorizations), (1, 1, 1), "{log:?}");
}

#[test]
fn converges_quadratically_where_springs_turn() {
    let shear = |p: &[f64; 3]| [0.4 * p[2], 0.0, 0.0];
    let mut lattice = Lattice::new([4, 4, 6], |p| p[2] == 0.0 || p[2] == 5.0, |_| false, shear);
    let mut x = lattice.start();
    let mut log = Vec::new();
    let settings = Settings { tolerance: 1e-12, ..Settings::default() };
    Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    let last: Vec<f64> = log.iter().rev().take(3).map(|r| (r.residual / r.force_scale).log10()).collect();
    assert!(last[0] <= -12.0 && log.len() <= 8, "log10 of the residuals, last first: {last:?}");
}

#[test]
fn indefinite_start_finds_a_minimum() {
    let mut lattice = Lattice::new([4, 4, 4], |p| p[2] == 0.0, |_| false, no_motion);
    let mut x: Vec<f64> = lattice
        .start()
        .chunks_exact(3)
        .flat_map(|p| [0.6 * p[0], 0.6 * p[1] + 0.01 * p[0], 0.6 * p[2]])
        .collect();
    let mut k = BlockMatrix::zeros(lattice.pattern.clone());
    lattice.hessian(&x, 0.0, &mut k);
    assert!(dense(&k).symmetric_eigenvalues().min() < 0.0, "the start is meant to be indefinite");
    let mut log = Vec::new();
    // At rest no forces are in play to which a residual could be relative.
    let settings = Settings { least_force: STIFFNESS, ..Settings::default() };
    Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    lattice.hessian(&x, 0.0, &mut k);
    assert!(dense(&k).symmetric_eigenvalues().min() > 0.0);
    assert!(log.iter().any(|r| r.projected));
    let rest = lattice.start();
    let away = x.iter().zip(&rest).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(away < 1e-4, "the rest shape is the minimum nearby, {away:.1e} m away");
}

#[test]
fn no_step_is_taken_through_an_inversion() {
    // Pressed and sheared at once: the straight prediction would press some springs below a third.
    let press = |p: &[f64; 3]| [0.0, 0.5 * p[2], -0.4 * p[2]];
    let mut lattice = Lattice::new([4, 4, 5], |p| p[2] == 0.0 || p[2] == 4.0, |_| false, press);
    let mut x = lattice.start();
    let mut log = Vec::new();
    Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x));
    assert!(log.iter().all(|r| r.least_det_f >= LEAST && r.energy.is_finite()));
}

#[test]
fn impossible_load_keeps_the_last_equilibrium_and_says_where() {
    // A node guided along z between two plates that close: its two springs need two thirds of the height.
    let squash = |p: &[f64; 3]| [0.0, 0.0, -0.95 * p[2]];
    let rest = vec![[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED];
    let fixed = vec![true, true, false];
    let mut lattice = Lattice::of(rest, free, fixed, vec![[0, 1], [1, 2]], squash);
    let mut x = lattice.start();
    let mut log = Vec::new();
    let error =
        Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 3, &mut log).unwrap_err();
    let SolveError::NotConverged(stop) = &error else { panic!("{error}") };
    let NotConverged { load, reason, step, place, .. } = &**stop;
    assert_eq!((*step, reason), (3, &Reason::Inversion));
    assert!(place.starts_with("spring"), "{place}");
    assert!(
        (0.69..0.71).contains(load),
        "two thirds of the height are reached at load 0.702, stopped at {load}"
    );
    lattice.set_load(*load, &mut x);
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x).max(1e-9));
}

#[test]
fn unsupported_island_is_refused_with_its_free_motions() {
    let refused = |mut lattice: Lattice| {
        let mut x = lattice.start();
        match Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 0, &mut Vec::new()) {
            Err(SolveError::Unsupported { parts, .. }) => parts,
            other => panic!("{other:?}"),
        }
    };
    let floating = refused(Lattice::new([3, 3, 3], |_| false, |_| false, no_motion));
    assert_eq!(floating.len(), 1);
    assert_eq!(floating[0].directions.len(), 6, "{floating:?}");
    let on_rollers = refused(Lattice::new([3, 3, 3], |_| false, |p| p[2] == 0.0, no_motion));
    let names = &on_rollers[0].directions;
    assert_eq!(names.len(), 3, "{names:?}");
    assert!(names[0] == "translation along x" && names[1] == "translation along y", "{names:?}");
    assert!(names[2].starts_with("rotation about z"), "{names:?}");
    let hinged = refused(Lattice::new([3, 3, 3], |p| p[1] == 0.0 && p[2] == 0.0, |_| false, no_motion));
    assert_eq!(hinged[0].directions.len(), 1, "{hinged:?}");
    assert!(hinged[0].directions[0].contains("rotation about x"), "{hinged:?}");
}

#[test]
fn mechanism_is_named_with_node_and_direction() {
    // A node between two collinear springs: nothing resists it sideways.
    let rest = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED, PRESCRIBED];
    let springs = vec![[0, 1], [1, 2], [1, 3]];
    let mut lattice = Lattice::of(rest, free, vec![false; 3], springs, no_motion);
    let mut x = lattice.start();
    let error = Solver::new("chain", Settings::default()).advance(&mut lattice, &mut x, 0, &mut Vec::new());
    let Err(error) = error else { panic!("solved: {error:?}") };
    assert!(error.to_string().contains('z'), "{error}");
    assert!(matches!(error, SolveError::Unsupported { .. }), "{error}");
}

#[test]
fn same_bits_on_any_number_of_threads() {
    let twist = |p: &[f64; 3]| [-0.15 * p[2] * p[1] / 12.0, 0.15 * p[2] * p[0] / 12.0, -0.1 * p[2]];
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let islands = |n: usize| {
                let lattice = Lattice::new([n, n, 13], |p| p[2] == 0.0 || p[2] == 12.0, |_| false, twist);
                let x = lattice.start();
                Island::new(&format!("island {n}"), Box::new(lattice), x, Settings::default())
            };
            let mut islands: Vec<Island> = [12, 5, 9].map(islands).into();
            let mut log = Vec::new();
            let results = advance_islands(&mut islands, 0, &mut log);
            assert!(results.iter().all(Result::is_ok), "{results:?}");
            let bits: Vec<u64> = islands.iter().flat_map(|i| &i.x).map(|x| x.to_bits()).collect();
            let names: Vec<String> = log.into_iter().map(|r| r.island).collect();
            (bits, names)
        })
    };
    let one = solve(1);
    assert!(one == solve(2), "1 and 2 threads");
    assert!(one == solve(3), "1 and 3 threads");
}

#[test]
fn log_has_its_name_only_when_finished() {
    let folder = tempfile::tempdir().unwrap();
    let row = Iteration {
        island: "a, b".into(),
        step: 1,
        load: 0.5,
        iteration: 2,
        residual: 1e-3,
        force_scale: 2.0,
        energy: -3.0,
        step_length: 1.0,
        least_det_f: 0.9,
        linear_iterations: 4,
        factorizations: 1,
        projected: false,
        seconds: 0.1,
    };
    let path = folder.path().join("iterations.csv");
    std::fs::write(&path, "of an earlier run").unwrap();
    let mut log = IterationLog::create(folder.path()).unwrap();
    log.write(&[row.clone(), row]).unwrap();
    assert!(!path.exists(), "a run that is killed now leaves no finished log");
    drop(log);
    assert!(!path.exists());
    let mut log = IterationLog::create(folder.path()).unwrap();
    log.write(&[]).unwrap();
    assert_eq!(log.finish().unwrap(), path);
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.starts_with("island,step,load,iteration,residual_N,"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}
