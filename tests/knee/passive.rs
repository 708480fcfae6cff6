//! Passive moments and tensions: they resist, count once, and bound what muscles do.

#![allow(non_snake_case)]

use coupling::form::{Bounds, Form, Passive};
use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use multibody::activation::generic_postures;
use multibody::muscle::musculotendon::GenericPosture;
use multibody::passive::{COORDINATES, moments, upright_tilt};

fn walker(passive: Passive, bounds: Bounds) -> Optimized {
    let form = Form { passive, bounds, ..Form::PUBLISHED };
    optimize(&OptimizeOptions { form, ..OptimizeOptions::default() }).unwrap()
}

/// Hip 16 degrees extended, knee 13 degrees bent, 10 degrees of dorsiflexion, by pocket calculator from the printed formulas.
#[test]
fn passive_moments_are_those_of_the_publication() {
    let at = |h: f64, k: f64, a: f64| {
        moments(&GenericPosture {
            hip_flexion: h.to_radians(),
            knee_flexion: k.to_radians(),
            ankle_dorsiflexion: a.to_radians(),
            ..GenericPosture::default()
        })
    };
    let [hip, knee, ankle] = at(-16.0, 13.0, 10.0);
    // e^2.6213 − e^0.5585 + 8.072; e^1.4552 − e^(−3.1187) − 4.820 + e^0.27; e^(−9.9149) − e^2.7158 + 1.792
    assert!((hip - (13.7536 - 1.7480 + 8.072)).abs() < 2e-3, "{hip}");
    assert!((knee - (4.2854 - 0.0442 - 4.820 + 1.3100)).abs() < 2e-3, "{knee}");
    assert!((ankle - (0.00005 - 15.1167 + 1.792)).abs() < 2e-3, "{ankle}");
}

#[test]
fn passive_moments_resist_their_own_joint() {
    for h in [-20.0, 0.0, 40.0, 80.0] {
        for k in [2.0, 20.0, 60.0, 100.0] {
            for a in [-25.0, 0.0, 20.0] {
                for joint in 0..3 {
                    let at = |step: f64| {
                        let mut angle = [f64::to_radians(h), f64::to_radians(k), f64::to_radians(a)];
                        angle[joint] += step;
                        moments(&GenericPosture {
                            hip_flexion: angle[0],
                            knee_flexion: angle[1],
                            ankle_dorsiflexion: angle[2],
                            ..GenericPosture::default()
                        })[joint]
                    };
                    assert!(at(0.01) < at(-0.01), "{} at {h}, {k}, {a}", COORDINATES[joint]);
                }
            }
        }
    }
}

/// Required moment as published = what muscles must supply + what joints resist beside resting muscles + nothing; and resting muscles with
/// the rest make the measured moment.
#[test]
fn nothing_counts_twice() {
    let (none, both) = (walker(Passive::None, Bounds::Strength), walker(Passive::Both, Bounds::Strength));
    let passive = both.passive.as_ref().unwrap();
    let postures = generic_postures(&both.model, &both.motion);
    let upright = upright_tilt(&both.motion);
    let coordinates = both.model.coordinate_names();
    for k in 0..both.effort.time.len() {
        let reduced = both.loads.reduced[k].as_ref().unwrap();
        let measured =
            moments(&GenericPosture { hip_flexion: postures[k].hip_flexion + upright, ..postures[k] });
        for (j, name) in COORDINATES.iter().enumerate() {
            let row = coordinates.iter().position(|c| c == name).unwrap();
            let before = none.loads.reduced[k].as_ref().unwrap().moments[row];
            assert!((before - reduced.moments[row] - passive.values[(k, j)]).abs() < 1e-10, "{name}");
            // Resting muscles pull with what the Hill model gives at no activation.
            let resting: f64 = (0..43)
                .map(|i| {
                    let unit = &multibody::muscle::musculotendon::MusculotendonModel::generic().units[i];
                    let length = multibody::activation::musculotendon_lengths(&postures[k..=k])[(0, i)];
                    let curves = multibody::muscle::curves::Curves::default();
                    let found = multibody::muscle::hill::equilibrium(unit, &curves, length, 0.0, 0.0);
                    reduced.lever_arms[(row, i)] * found.map_or(0.0, |e| e.force.min(unit.f_max))
                })
                .sum();
            assert!((resting + passive.values[(k, j)] - measured[j]).abs() < 1e-6, "{name}, frame {k}");
        }
        // No muscle pulls less than it does at rest.
        assert!((0..43).all(|i| both.effort.forces.values[(k, i)] >= 0.0));
    }
}

/// With bounds by the state of the muscle and resting tensions as the least, there is an activation within 0 and 1 for nearly every force:
/// without them a sixth of the samples has none.
#[test]
fn forces_within_the_bounds_of_the_state_have_activations() {
    let clipped = |done: &Optimized| done.hill.overall.below_zero + done.hill.overall.above_one;
    let published = clipped(&walker(Passive::None, Bounds::Strength));
    let state = clipped(&walker(Passive::Muscles, Bounds::State));
    assert!(published > 0.1, "{published}");
    assert!(state < 5e-3, "{state}");
}
