//! Do the shared forces carry the moments with least cost, and does a frame that cannot be carried say why?

#![allow(non_snake_case)]

use multibody::sharing::{KKT_TOLERANCE, SharingOptions, SharingSolver};
use multibody::trial::Status;
use support::sharing_problems::{Random, names, random_problem, second_opinion};

/// KKT residual, agreement with an independent solver, and the same opinion on feasibility.
#[test]
fn ten_thousand_random_problems_agree_with_a_second_solver() {
    let mut random = Random(20_26);
    let (mut solved, mut infeasible, mut worst_kkt, mut worst_difference) = (0, 0, 0.0f64, 0.0f64);
    for case in 0..10_000 {
        let problem = random_problem(&mut random);
        let mut solver = SharingSolver::new(names(&problem), SharingOptions::default());
        let answer = solver.solve(&problem).expect("well posed");
        match second_opinion(&problem) {
            Some(f) => {
                assert_eq!(answer.verdict.status, Status::Solved, "case {case}: {:?}", answer.verdict);
                worst_kkt = worst_kkt.max(answer.residuals.largest());
                worst_difference = worst_difference.max((&answer.f - &f).amax() / f.amax().max(1.0));
                assert!(answer.residuals.largest() < KKT_TOLERANCE, "case {case}: {:?}", answer.residuals);
                assert!((&answer.f - &f).amax() < 1e-7 * f.amax().max(1.0), "case {case}: {} {f}", answer.f);
                solved += 1;
            }
            None => {
                assert_eq!(answer.verdict.status, Status::Infeasible, "case {case}: {:?}", answer.verdict);
                infeasible += 1;
            }
        }
    }
    println!(
        "{solved} solved, {infeasible} infeasible; KKT {worst_kkt:.1e}, difference {worst_difference:.1e}"
    );
    assert!(solved > 8000 && infeasible > 500);
}
