//! Hard cases of the rigid side.

#![allow(non_snake_case)]

use multibody::muscle::MuscleTendon;
use multibody::muscle::curves::{Curves, DeGroote2016, Thelen2003};
use multibody::muscle::hill::{EquilibriumError, activation, equilibrium, tendon_force};
use support::{motion_cases, sharing_cases};

use crate::{Case, Outcome, Tier};

pub const CASES: &[Case] = &[
    Case { id: "R1", title: "noise on markers", tier: Tier::Full, run: motion_cases::noise },
    Case { id: "R2", title: "lost markers", tier: Tier::Quick, run: motion_cases::dropout },
    Case { id: "R4", title: "gimbal lock", tier: Tier::Quick, run: motion_cases::gimbal_lock },
    Case { id: "R5", title: "marker out of reach", tier: Tier::Full, run: motion_cases::out_of_reach },
    Case { id: "R6", title: "knee at full extension", tier: Tier::Full, run: motion_cases::full_extension },
    Case { id: "Q1", title: "infeasible load", tier: Tier::Quick, run: sharing_cases::infeasible_load },
    Case { id: "Q2", title: "redundant copies", tier: Tier::Full, run: sharing_cases::redundant_copies },
    Case {
        id: "Q3",
        title: "rank-deficient lever arms",
        tier: Tier::Full,
        run: sharing_cases::rank_deficient,
    },
    Case { id: "Q4", title: "scaling", tier: Tier::Full, run: sharing_cases::scaling },
    Case {
        id: "Q5",
        title: "random problems",
        tier: Tier::Full,
        run: || sharing_cases::random_problems(10_000),
    },
    Case { id: "H1", title: "Hill extremes", tier: Tier::Quick, run: hill_extremes },
];

const CURVES: [Curves; 5] = [
    Curves::Thelen(Thelen2003::GAIT2392),
    Curves::Thelen(Thelen2003::PAPER),
    Curves::Thelen(Thelen2003::OPENSIM),
    Curves::DeGroote(DeGroote2016::PAPER),
    Curves::DeGroote(DeGroote2016::OPENSIM),
];

/// Activation 0, 0.01, 1; fibre length 0.3 to 2 l_opt; tendon/fibre ratio 0.05 to 20; velocity ±20 l_opt/s; pennation 0 to
/// 30°. Forces finite and ≥ 0; where fibre and tendon have an equilibrium it balances to 1e-9 f_max; where
/// they have none the refusal is checked against a scan.
fn hill_extremes() -> Outcome {
    let (mut n_solved, mut n_refused, mut worst) = (0, 0, 0.0_f64);
    for curves in CURVES {
        for ratio in [0.05, 0.2, 1.0, 3.0, 8.0, 20.0] {
            for pennation in [0.0_f64, 15.0, 30.0] {
                let unit = unit(ratio, pennation.to_radians());
                for a in [0.0, 0.01, 1.0] {
                    for L in (0..=17).map(|i| 0.3 + 0.1 * f64::from(i)) {
                        for v in [-20.0, -10.0, -5.0, -1.0, 0.0, 1.0, 5.0, 10.0, 20.0] {
                            let point = || {
                                format!(
                                    "{curves:?}, ratio {ratio}, pennation {pennation}°, a {a}, L {L:.1}, v {v}"
                                )
                            };
                            let outcome =
                                extreme(&unit, &curves, a, L, v).map_err(|e| format!("{}: {e}", point()))?;
                            match outcome {
                                Some(residual) => {
                                    n_solved += 1;
                                    worst = worst.max(residual);
                                }
                                None => n_refused += 1,
                            }
                        }
                    }
                }
            }
        }
    }
    if n_solved < 10 * n_refused {
        return Err(format!("{n_refused} of {} equilibria refused", n_solved + n_refused));
    }
    Ok(format!(
        "{n_solved} equilibria to {worst:.1e} f_max, {n_refused} refused (fibre stronger than its tendon at every length)"
    ))
}

/// f_max 1000 N, l_opt 0.1 m, l_ts = `ratio` l_opt.
fn unit(ratio: f64, pennation: f64) -> MuscleTendon {
    MuscleTendon {
        name: "extreme".into(),
        short_name: "extreme".into(),
        f_max: 1000.0,
        l_opt: 0.1,
        l_ts: 0.1 * ratio,
        pennation,
        v_max: 10.0,
        tau_activation: 0.01,
        tau_deactivation: 0.04,
    }
}

/// The residual of the equilibrium in f_max; `None` where it was rightly refused.
fn extreme(unit: &MuscleTendon, curves: &Curves, a: f64, L: f64, v: f64) -> Result<Option<f64>, String> {
    let force = tendon_force(unit, curves, a, L, v / unit.v_max);
    if !(force.is_finite() && force >= 0.0) {
        return Err(format!("force {force} N"));
    }
    let back = activation(unit, curves, force, L, v / unit.v_max);
    if !back.is_finite() {
        return Err(format!("activation {back} from {force} N"));
    }
    // The path on which a rigid tendon gives this fibre length. At 30° no fibre is shorter than its height; 1.02 of it
    // is a pennation of 79°.
    let height = unit.l_opt * unit.pennation.sin();
    let along = |l: f64| (l * l - height * height).max(0.0).sqrt();
    let (l_mt, v_mt) = (unit.l_ts + along((unit.l_opt * L).max(1.02 * height)), v * unit.l_opt);
    // What the fibre pulls less what the tendon holds, in f_max, written again from the curves.
    let imbalance = |l: f64| {
        let (L, cos) = (l / unit.l_opt, along(l) / l);
        let V = v_mt * cos / (unit.v_max * unit.l_opt);
        let fibre = a * curves.active_length(L).f * curves.velocity(V, a).f + curves.passive(L).f;
        fibre * cos - curves.tendon((l_mt - along(l)) / unit.l_ts - 1.0).f
    };
    match equilibrium(unit, curves, l_mt, v_mt, a) {
        Ok(found) => {
            let residual =
                imbalance(found.fibre_length * unit.l_opt).abs().max(found.residual.abs() / unit.f_max);
            let sound = found.force.is_finite() && found.force >= 0.0 && found.fibre_length > 0.0;
            if !(sound && residual < 1e-9) {
                return Err(format!("residual {residual:.1e} f_max at {found:?}"));
            }
            Ok(Some(residual))
        }
        Err(EquilibriumError::FibreTooShort { shortest_fibre, .. }) => {
            let (short, long) = (shortest_fibre * unit.l_opt, (l_mt - unit.l_ts).hypot(height));
            let held = (0..=1000)
                .map(|k| short + (long - short) * f64::from(k) / 1000.0)
                .find(|&l| imbalance(l) <= 0.0);
            match held {
                Some(l) => Err(format!("refused, but the tendon holds the fibre at {l} m")),
                None => Ok(None),
            }
        }
        Err(other) => Err(other.to_string()),
    }
}
