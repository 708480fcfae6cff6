//! Hill muscles: are the curves what the papers say, are slopes derivatives, do lengths agree with OpenSim's, and does
//! the way from force to activation lead back?

#![allow(non_snake_case)]

use std::collections::HashMap;

use multibody::muscle::curves::{Curves, DeGroote2016, Slope, Thelen2003};
use multibody::muscle::hill::{
    self, EquilibriumError, FibreVelocity, HillError, Settings, Tendon, activations, equilibrium,
    tendon_force,
};
use multibody::muscle::musculotendon::{GenericPosture, MusculotendonModel, Spline, TableError};
use multibody::muscle::{MuscleTendon, N_MUSCLES};
use nalgebra::DMatrix;
use support::taylor_order;

#[path = "hill/osim.rs"]
mod osim;

const CURVES: [(&str, Curves); 5] = [
    ("Thelen, gait2392", Curves::Thelen(Thelen2003::GAIT2392)),
    ("Thelen, paper", Curves::Thelen(Thelen2003::PAPER)),
    ("Thelen, OpenSim", Curves::Thelen(Thelen2003::OPENSIM)),
    ("De Groote, paper", Curves::DeGroote(DeGroote2016::PAPER)),
    ("De Groote, OpenSim", Curves::DeGroote(DeGroote2016::OPENSIM)),
];

fn close(what: &str, value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{what}: {value}, expected {expected} within {tolerance:e}"
    );
}

// ---- curves ------------------------------------------------------------------------------------------------------

#[test]
fn curves_pass_through_the_points_of_the_papers() {
    for (name, c) in CURVES {
        // Set B is rounded to about 1e-4 there (constants of the paper).
        let tolerance = if matches!(c, Curves::Thelen(_)) { 1e-14 } else { 2e-4 };
        close(&format!("{name}: f_L(1)"), c.active_length(1.0).f, 1.0, tolerance);
        close(&format!("{name}: f_V(-1)"), c.velocity(-1.0, 1.0).f, 0.0, tolerance);
        close(&format!("{name}: f_V(0)"), c.velocity(0.0, 1.0).f, 1.0, tolerance);
        assert_eq!(c.passive(1.0).f, 0.0, "{name}");
        close(&format!("{name}: f_P(1 + e0)"), c.passive(1.6).f, 1.0, 1e-14);
    }
    // Follows from the constants of the paper.
    close("De Groote f_V(1)", CURVES[3].1.velocity(1.0, 1.0).f, 1.794, 5e-4);
    // The tendon strains at f_max.
    for (c, E0) in [(CURVES[0].1, 0.033), (CURVES[1].1, 0.04), (CURVES[2].1, 0.033)] {
        close("f_T(E0)", c.tendon(E0).f, 1.0, 1e-13);
    }
    close("f_T at slack, OpenSim", CURVES[4].1.tendon(0.0).f, 0.0, 1e-15);
    // c1 exp(k_T (1.044 − c2)) − c3 with the paper's constants.
    close("f_T(0.044), paper", CURVES[3].1.tendon(0.044).f, 0.2 * 1.715_f64.exp() - 0.25, 1e-13);
}

/// Codes that forget the square of the denominator get f_L(1) = 1.25.
#[test]
fn de_groote_force_length_squares_its_denominator() {
    let terms = [(0.815, 1.055, 0.162, 0.063), (0.433, 0.717, -0.030, 0.200), (0.1, 1.0, 0.354, 0.0)];
    let sum = |L: f64, power: i32| -> f64 {
        terms
            .iter()
            .map(|&(b1, b2, b3, b4): &(f64, f64, f64, f64)| {
                b1 * (-0.5 * (L - b2).powi(2) / (b3 + b4 * L).powi(power)).exp()
            })
            .sum()
    };
    close("without the square", sum(1.0, 1), 1.25, 0.01);
    for L in [0.5, 0.7, 0.9, 1.0, 1.1, 1.3, 1.5] {
        // The rounded constants of the supplement move the curve by less than 0.01.
        close(&format!("f_L({L})"), CURVES[3].1.active_length(L).f, sum(L, 2), 0.01);
    }
}

#[test]
fn slopes_are_derivatives() {
    for (name, c) in CURVES {
        let check = |what: String, f: &dyn Fn(f64) -> Slope, x: f64, h: f64| {
            let order = taylor_order(|d| f(x + d).f, f(x).df, h);
            assert!(order > 1.9, "{name}: {what} at {x}: order {order:.2}");
        };
        for L in [0.31, 0.47, 0.83, 0.99, 1.13, 1.37, 1.59, 1.9] {
            check("f_L".into(), &|L| c.active_length(L), L, 1e-3);
            check("f_P".into(), &|L| c.passive(L), L, 1e-3);
        }
        for a in [0.01, 0.3, 1.0] {
            let s = 0.25 + 0.75 * a;
            for V in [-0.9 * s, -0.4 * s, -0.05 * s, 0.01, 0.2, 0.7, 2.0] {
                check(format!("f_V(a = {a})"), &|V| c.velocity(V, a), V, 1e-4);
            }
        }
        for E in [-0.02, 0.004, 0.013, 0.018, 0.028, 0.05] {
            check("f_T".into(), &|E| c.tendon(E), E, 1e-5);
        }
    }
}

/// The paper's rounded constants (0.609 E0, 1.712/E0) leave a step in the slope; the exact ones do not.
#[test]
fn thelen_tendon_is_smooth_at_the_end_of_the_toe() {
    for (name, c) in &CURVES[..3] {
        let toe = c.tendon_strain(0.33);
        let [before, after] = [-1e-9, 1e-9].map(|d| c.tendon(toe * (1.0 + d)));
        close(&format!("{name}: force"), before.f, after.f, 1e-8);
        close(&format!("{name}: slope, relative"), before.df / after.df, 1.0, 1e-8);
        let Curves::Thelen(parameters) = c else { unreachable!() };
        close("toe end / E0", toe / parameters.tendon_strain_at_f_max, 0.609, 5e-4);
        close("slope · E0", after.df * parameters.tendon_strain_at_f_max, 1.712, 1e-3);
    }
}

/// Thelen 2003 doubles the slope of the force-velocity curve where shortening turns to lengthening.
#[test]
fn thelen_force_velocity_doubles_its_slope_at_rest() {
    for (name, c) in &CURVES[..3] {
        for a in [0.0, 0.2, 1.0] {
            let ratio = c.velocity(1e-12, a).df / c.velocity(-1e-12, a).df;
            close(&format!("{name}, a = {a}"), ratio, 2.0, 1e-9);
            close(&format!("{name}, a = {a}: step"), c.velocity(1e-12, a).f, 1.0, 1e-9);
        }
    }
}

#[test]
fn inverses_invert() {
    for (name, c) in CURVES {
        for a in [0.01, 0.4, 1.0] {
            for f in [1e-6, 0.1, 0.7, 0.999, 1.0, 1.001, 1.2, 1.39] {
                let V = c.velocity_inverse(f, a);
                close(&format!("{name}: f_V(f_V⁻¹({f})), a = {a}"), c.velocity(V, a).f, f, 1e-12);
            }
        }
        for f in [0.0, 1e-6, 0.1, 0.329, 0.33, 0.331, 0.9, 2.5] {
            close(&format!("{name}: f_T(f_T⁻¹({f}))"), c.tendon(c.tendon_strain(f)).f, f, 1e-13);
        }
        for V in [-0.6, -0.2, -0.01, 0.0, 0.02, 0.6] {
            for a in [0.0_f64, 0.05, 0.6, 1.0, 3.0] {
                let f_V = c.velocity(V, a).f;
                if f_V > 0.0 {
                    close(&format!("{name}: a f_V, V = {V}"), c.activation(a * f_V, V), a, 1e-12);
                }
            }
        }
    }
}

// ---- lengths -----------------------------------------------------------------------------------------------------

#[test]
fn spline_reproduces_cubics_and_extends_by_tangents() {
    let cubic = |x: f64| 1.0 - 2.0 * x + 0.5 * x * x + 3.0 * x * x * x;
    let knots = [-1.0, -0.7, 0.1, 0.4, 1.3];
    let spline = Spline::new(&knots, &knots.map(cubic)).unwrap();
    for x in [-1.0, -0.9, -0.2, 0.1, 0.33, 1.29, 1.3] {
        close(&format!("S({x})"), spline.value(x), cubic(x), 1e-13);
    }
    close("left of it", spline.value(-1.5), cubic(-1.0) - 0.5 * (-2.0 - 1.0 + 9.0), 1e-12);
    close("right of it", spline.value(2.3), cubic(1.3) + (-2.0 + 1.3 + 9.0 * 1.69), 1e-12);
    let line = Spline::new(&[0.0, 2.0], &[1.0, 5.0]).unwrap();
    assert_eq!([line.value(-1.0), line.value(1.0), line.value(3.0)], [-1.0, 3.0, 7.0]);
    for (x, y) in [(&[0.0, 0.0][..], &[1.0, 2.0][..]), (&[0.0], &[1.0]), (&[0.0, 1.0], &[f64::NAN, 0.0])] {
        assert!(Spline::new(x, y).is_none());
    }
}

#[test]
fn muscles_are_in_the_order_of_the_force_sharing() {
    let Some(path) = support::shared("model/muscles.csv") else { return };
    let mut table = csv::Reader::from_path(path).unwrap();
    let names: Vec<String> = table.records().map(|r| r.unwrap()[1].to_string()).collect();
    let ours: Vec<&str> = MusculotendonModel::generic().units.iter().map(|u| &*u.short_name).collect();
    assert_eq!(names, ours);
}

/// Rows of a table of numbers and names.
fn read(path: &std::path::Path) -> Vec<HashMap<String, String>> {
    csv::Reader::from_path(path).unwrap().deserialize().map(Result::unwrap).collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {}", row[column]))
}

/// The scaled model of the OpenSim reference results, run through our path code, and its eight poses.
fn opensim_subject() -> Option<(MusculotendonModel, Vec<GenericPosture>, std::path::PathBuf)> {
    let folder = support::shared("reference/opensim")?;
    let xml = std::fs::read_to_string(folder.join("inputs/subject01_simbody.osim")).unwrap();
    let names: Vec<&str> = MusculotendonModel::generic().units.iter().map(|u| &*u.name).collect();
    let (muscles, points, joints) = osim::tables(&xml, &names);
    let model = MusculotendonModel::from_tables(&muscles, &points, &joints).unwrap();
    let q = read(&folder.join("exact/kin_q.csv"));
    let poses = [0, 11, 21, 32, 43, 54, 64, 75].map(|i| {
        let value = |name: &str| number(&q[i], name);
        assert_eq!(value("mtp_angle_r"), 0.0);
        GenericPosture {
            hip_flexion: value("hip_flexion_r"),
            hip_adduction: value("hip_adduction_r"),
            hip_rotation: value("hip_rotation_r"),
            knee_flexion: -value("knee_angle_r"),
            ankle_dorsiflexion: value("ankle_angle_r"),
            subtalar: value("subtalar_angle_r"),
        }
    });
    Some((model, poses.to_vec(), folder.join("exact")))
}

#[test]
fn lengths_equal_opensims() {
    let Some((model, poses, folder)) = opensim_subject() else { return };
    let lengths: Vec<_> = poses.iter().map(|p| model.lengths(p)).collect();
    let (mut worst, mut n) = (0.0_f64, 0);
    for row in read(&folder.join("mtu_length.csv")) {
        let Some(m) = model.units.iter().position(|u| u.name == row["muscle"]) else { continue };
        let difference = lengths[number(&row, "pose") as usize][m] - number(&row, "length_m");
        // Round-off: ours and theirs take different orders of operations on exact inputs.
        assert!(difference.abs() < 1e-8, "pose {}, {}: {difference:e} m", row["pose"], row["muscle"]);
        worst = worst.max(difference.abs());
        n += 1;
    }
    assert_eq!(n, 8 * N_MUSCLES);
    println!("{n} lengths, largest difference {worst:.1e} m");
}

#[test]
fn moment_arms_are_slopes_of_the_length() {
    let Some((model, poses, folder)) = opensim_subject() else { return };
    type Change = fn(&mut GenericPosture, f64);
    // gait2392 counts knee extension positive.
    let coordinates: [(&str, Change); 6] = [
        ("hip_flexion_r", |p, d| p.hip_flexion += d),
        ("hip_adduction_r", |p, d| p.hip_adduction += d),
        ("hip_rotation_r", |p, d| p.hip_rotation += d),
        ("knee_angle_r", |p, d| p.knee_flexion -= d),
        ("ankle_angle_r", |p, d| p.ankle_dorsiflexion += d),
        ("subtalar_angle_r", |p, d| p.subtalar += d),
    ];
    let rows = read(&folder.join("moment_arm.csv"));
    let (mut worst, mut n) = (0.0_f64, 0);
    for (coordinate, change) in coordinates {
        let h = 1e-5;
        let arms: Vec<Vec<f64>> = poses
            .iter()
            .map(|pose| {
                let [less, more] = [-h, h].map(|d| {
                    let mut moved = *pose;
                    change(&mut moved, d);
                    model.lengths(&moved)
                });
                less.iter().zip(&more).map(|(l, m)| -(m - l) / (2.0 * h)).collect()
            })
            .collect();
        for row in &rows {
            let Some(m) = model.units.iter().position(|u| u.name == row["muscle"]) else { continue };
            let difference = arms[number(row, "pose") as usize][m] - number(row, coordinate);
            // Stated with the reference: OpenSim's arms agree with differences of its lengths to 0.01 mm.
            assert!(
                difference.abs() < 1e-5,
                "pose {}, {}, {coordinate}: {difference:e} m",
                row["pose"],
                row["muscle"]
            );
            worst = worst.max(difference.abs());
            n += 1;
        }
    }
    assert_eq!(n, 6 * 8 * N_MUSCLES);
    println!("{n} moment arms, largest difference {worst:.1e} m");
}

/// The generic model has the same topology as the scaled one: its lengths are within the scale factors (0.95 to 1.18).
#[test]
fn generic_lengths_are_those_of_the_scaled_model_up_to_scale() {
    let Some((scaled, poses, _)) = opensim_subject() else { return };
    for pose in &poses {
        let (generic, scaled) = (MusculotendonModel::generic().lengths(pose), scaled.lengths(pose));
        for m in 0..N_MUSCLES {
            let ratio = scaled[m] / generic[m];
            assert!(
                (0.95..1.18).contains(&ratio),
                "{}: {ratio}",
                MusculotendonModel::generic().units[m].name
            );
        }
    }
}

#[test]
fn damaged_tables_are_refused_with_line_and_reason() {
    let (muscles, points, joints) = (
        include_str!("../gait-data/muscles_gait2392.csv"),
        include_str!("../gait-data/muscles_gait2392_points.csv"),
        include_str!("../gait-data/joints_gait2392.csv"),
    );
    let fails = |muscles: &str, points: &str, joints: &str, said: &[&str]| {
        let error = MusculotendonModel::from_tables(muscles, points, joints).unwrap_err();
        let text = error.to_string();
        assert!(said.iter().all(|s| text.contains(s)), "{text}");
        error
    };
    let swap = |from: &str, to: &str| {
        assert!(points.contains(from));
        points.replacen(from, to, 1)
    };
    fails(muscles, &swap("glut_max1_r,2", "glut_max1_r,3"), joints, &["points, line 4", "expected number 2"]);
    fails(muscles, &swap("-0.1195", "wide"), joints, &["line 3", "`wide`", "a number"]);
    fails(muscles, &swap("-0.1195", "NaN"), joints, &["line 3", "`NaN`"]);
    fails(muscles, &swap("femur_r", "femur_l"), joints, &["`femur_l`", "tibia_r"]);
    fails(muscles, &swap("-2.0944;-1.99997", "-1.9;-1.99997"), joints, &["x_knots_rad", "increasing"]);
    fails(muscles, &swap("MovingPathPoint", "SpinningPoint"), joints, &["SpinningPoint", "PathPoint"]);
    fails(&muscles.replacen(",573,", ",-573,", 1), points, joints, &["max_isometric_force_N", "positive"]);
    fails(
        muscles,
        points,
        &joints.replace("ankle_r,offset_frame,tibia_r", "ankle_r,offset_frame,patella"),
        &["origin of its child body"],
    );
    let fewer: Vec<&str> = muscles.lines().take(40).collect();
    let short = points.lines().take(100).collect::<Vec<_>>().join("\n");
    let error = fails(&fewer.join("\n"), &short, joints, &["muscles", "expected 43"]);
    assert!(matches!(error, TableError::Incomplete { table: "muscles", .. }));
}

// ---- force and activation ------------------------------------------------------------------------------------------

/// OpenSim's `calcInextensibleTendonActiveFiberForce`: f_max f_L f_V cos α at a = 1 with l_t = l_ts and v = v_mt cos α.
#[test]
fn rigid_tendon_force_equals_opensims() {
    let Some((model, _, folder)) = opensim_subject() else { return };
    let curves = Curves::default();
    let path = read(&folder.join("mtu_length.csv"));
    let (mut worst, mut n) = (0.0_f64, 0);
    for (row, path) in read(&folder.join("rigid_tendon_active_force_at_a1.csv")).iter().zip(&path) {
        assert_eq!((&row["pose"], &row["muscle"]), (&path["pose"], &path["muscle"]));
        let Some(unit) = model.units.iter().find(|u| u.name == row["muscle"]) else { continue };
        let along = number(path, "length_m") - unit.l_ts;
        let l = along.hypot(unit.l_opt * unit.pennation.sin());
        let V = number(path, "lengthening_speed_m_s") * along / l / (unit.v_max * unit.l_opt);
        let L = l / unit.l_opt;
        let active = tendon_force(unit, &curves, 1.0, L, V) - tendon_force(unit, &curves, 0.0, L, V);
        let difference = (active - number(row, "active_force_along_tendon_N")) / unit.f_max;
        // OpenSim inverts the force-velocity relation iteratively; its stopping rule leaves about 1e-10.
        assert!(difference.abs() < 1e-9, "pose {}, {}: {difference:e} f_max", row["pose"], row["muscle"]);
        worst = worst.max(difference.abs());
        n += 1;
    }
    assert_eq!(n, 8 * N_MUSCLES);
    println!("{n} forces, largest difference {worst:.1e} f_max");
}

const TENDONS: [Tendon; 2] = [Tendon::Rigid, Tendon::Elastic];

/// Activation → force → activation for all muscles, both tendons, all curve sets. Every grid point is a stretch of
/// three frames at constant velocity, for which differences are exact, closed by a missing frame.
#[test]
fn activation_survives_the_way_through_force() {
    let units = &MusculotendonModel::generic().units;
    let rate = 1000.0;
    let mut grid = Vec::new();
    for a in [0.0, 0.01, 0.1, 0.5, 1.0] {
        for L in [0.55, 0.8, 1.0, 1.2, 1.5] {
            for V in [-0.9, -0.5, -0.1, 0.0, 0.1, 0.5, 1.0] {
                grid.push((a, L, V));
            }
        }
    }
    for (name, curves) in CURVES {
        for tendon in TENDONS {
            let mut lengths = DMatrix::from_element(4 * grid.len(), units.len(), f64::NAN);
            let mut forces = lengths.clone();
            for (g, &(a, L, V)) in grid.iter().enumerate() {
                for (m, unit) in units.iter().enumerate() {
                    for k in 0..3 {
                        let L = L + (k as f64 - 1.0) * V * unit.v_max / rate;
                        let force = tendon_force(unit, &curves, a, L, V);
                        let strain = match tendon {
                            Tendon::Rigid => 0.0,
                            Tendon::Elastic => curves.tendon_strain(force / unit.f_max),
                        };
                        let along = unit.l_opt * (L * L - unit.pennation.sin().powi(2)).sqrt();
                        lengths[(4 * g + k, m)] = unit.l_ts * (1.0 + strain) + along;
                        forces[(4 * g + k, m)] = force;
                    }
                }
            }
            let settings = Settings { curves, tendon, velocity: FibreVelocity::Differences };
            let result = activations(units, &lengths, &forces, rate, &settings).unwrap();
            let (mut worst, mut n) = (0.0_f64, 0);
            for (g, &(a, L, V)) in grid.iter().enumerate() {
                for m in 0..units.len() {
                    let i = 4 * g + 1;
                    close("fibre length", result.fibre_length[(i, m)], L, 1e-12);
                    close("fibre velocity", result.fibre_velocity[(i, m)], V, 1e-10);
                    assert!(result.activation[(4 * g + 3, m)].is_nan());
                    // Faster than the curve allows at this activation: no force, so nothing to recover.
                    if curves.velocity(V, a).f == 0.0 {
                        continue;
                    }
                    let difference = (result.unclipped[(i, m)] - a).abs();
                    assert!(
                        difference < 1e-10,
                        "{name}, {tendon:?}, {}: a = {a}, L = {L}, V = {V}: {difference:e}",
                        units[m].name
                    );
                    worst = worst.max(difference);
                    n += 1;
                }
            }
            assert!(n > 6000, "only {n} points could be compared");
            println!("{name}, {tendon:?}: {n} points, largest difference {worst:.1e}");
        }
    }
}

fn unit(ratio: f64, pennation: f64) -> MuscleTendon {
    let first = &MusculotendonModel::generic().units[0];
    MuscleTendon { f_max: 1000.0, l_opt: 0.1, l_ts: 0.1 * ratio, pennation, ..first.clone() }
}

/// An isolated missing frame leaves its neighbours at their one-sided differences, and other muscles untouched.
#[test]
fn missing_frames_stay_missing_and_poison_nobody() {
    let units = [unit(1.0, 0.2), unit(2.0, 0.0)];
    let rate = 100.0;
    let lengths = DMatrix::from_fn(30, 2, |i, m| units[m].l_ts + 0.09 + 0.01 * (0.2 * i as f64).sin());
    let forces = DMatrix::from_element(30, 2, 400.0);
    let run = |lengths: &DMatrix<f64>, forces: &DMatrix<f64>, velocity: FibreVelocity| {
        let settings = Settings { velocity, ..Default::default() };
        activations(&units, lengths, forces, rate, &settings).unwrap()
    };
    let whole = run(&lengths, &forces, FibreVelocity::Differences);
    let mut holed = forces.clone();
    holed[(10, 0)] = f64::NAN;
    holed[(12, 0)] = f64::NAN;
    let result = run(&lengths, &holed, FibreVelocity::Differences);
    for i in 0..30 {
        assert_eq!(result.activation[(i, 0)].is_nan(), i == 10 || i == 12, "frame {i}");
        assert_eq!(result.activation[(i, 1)], whole.activation[(i, 1)], "frame {i}");
        if !(9..=13).contains(&i) {
            assert_eq!(result.activation[(i, 0)], whole.activation[(i, 0)], "frame {i}");
        }
    }
    close("one-sided difference", result.fibre_velocity[(9, 0)], whole.fibre_velocity[(9, 0)], 2e-3);
    assert_eq!(result.fibre_velocity[(11, 0)], 0.0);
    assert_eq!((result.fractions[0].n_samples, result.fractions[1].n_samples), (28, 30));
    close("lone frames", result.fractions[0].without_velocity, 1.0 / 28.0, 1e-15);
    close("lone frames, all", result.overall.without_velocity, 1.0 / 58.0, 1e-15);
    let still = run(&lengths, &holed, FibreVelocity::Isometric);
    assert_eq!((still.fibre_velocity[(5, 0)], still.overall.without_velocity), (0.0, 0.0));
    // The filter works on each stretch by itself: as if the trial began after the gap.
    let low_pass = FibreVelocity::LowPass { cutoff_hz: 6.0 };
    let filtered = run(&lengths, &holed, low_pass);
    let rest = run(&lengths.rows(13, 17).into_owned(), &forces.rows(13, 17).into_owned(), low_pass);
    for i in 13..30 {
        assert_eq!(filtered.fibre_velocity[(i, 0)], rest.fibre_velocity[(i - 13, 0)], "frame {i}");
    }
    assert_ne!(filtered.fibre_velocity[(20, 0)], result.fibre_velocity[(20, 0)]);
}

#[test]
fn clipping_and_limits_are_counted_where_they_happen() {
    let units = [unit(1.0, 0.0)];
    let along = |L: f64| 0.1 + 0.1 * L;
    // Resting and stretched; strong; short of the range; beyond it; shorter than the tendon; fine.
    let lengths =
        DMatrix::from_column_slice(6, 1, &[along(1.3), along(1.0), along(0.2), along(1.8), 0.05, along(1.0)]);
    let forces = DMatrix::from_column_slice(6, 1, &[0.0, 1500.0, 100.0, 1900.0, 10.0, 500.0]);
    let settings =
        Settings { tendon: Tendon::Rigid, velocity: FibreVelocity::Isometric, ..Default::default() };
    let result = activations(&units, &lengths, &forces, 100.0, &settings).unwrap();
    let fractions = result.fractions[0];
    assert_eq!(fractions, result.overall);
    assert_eq!(fractions.n_samples, 6);
    close("below zero", fractions.below_zero, 1.0 / 6.0, 1e-15);
    close("limited", fractions.length_limited, 3.0 / 6.0, 1e-15);
    let above = result.unclipped.iter().filter(|a| **a > 1.0).count() as f64;
    close("above one", fractions.above_one, above / 6.0, 1e-15);
    assert!(result.unclipped[(0, 0)] < 0.0 && result.activation[(0, 0)] == 0.0);
    assert!(result.unclipped[(1, 0)] > 1.0 && result.activation[(1, 0)] == 1.0);
    assert_eq!([2, 3, 4].map(|i| result.fibre_length[(i, 0)]), [0.4, 1.6, 0.4]);
    close("half", result.activation[(5, 0)], 0.5, 1e-12);
}

#[test]
fn mismatched_input_is_an_error() {
    let units = [unit(1.0, 0.0)];
    let one = DMatrix::from_element(3, 1, 0.2);
    let run = |lengths: &DMatrix<f64>, rate: f64| {
        activations(&units, lengths, &one, rate, &Settings::default()).unwrap_err()
    };
    let two = DMatrix::from_element(3, 2, 0.2);
    assert!(matches!(run(&two, 100.0), HillError::Shape { n_muscles: 1, .. }));
    assert!(matches!(run(&one, 0.0), HillError::Rate(_)));
    assert!(matches!(run(&one, f64::NAN), HillError::Rate(_)));
    assert_eq!(run(&one, 10.0), HillError::Cutoff { cutoff_hz: 5.0, rate: 10.0 });
}

/// Equilibrium at rest: the fibre length from which the tendon was stretched is found again.
#[test]
fn equilibrium_finds_a_known_fibre_length() {
    for (name, curves) in CURVES {
        for (a, L) in [(0.0, 1.2), (0.3, 0.7), (1.0, 0.9)] {
            let unit = unit(3.0, 0.3);
            let force = tendon_force(&unit, &curves, a, L, 0.0);
            let along = unit.l_opt * (L * L - unit.pennation.sin().powi(2)).sqrt();
            let l_mt = unit.l_ts * (1.0 + curves.tendon_strain(force / unit.f_max)) + along;
            let found = equilibrium(&unit, &curves, l_mt, 0.0, a).unwrap();
            close(&format!("{name}: L"), found.fibre_length, L, 1e-10);
            close(&format!("{name}: force"), found.force, force, 1e-6);
        }
    }
    let curves = Curves::default();
    let muscle = unit(3.0, 0.0);
    let slack = equilibrium(&muscle, &curves, 0.29, 0.0, 0.5).unwrap_err();
    assert!(matches!(slack, EquilibriumError::Slack { .. }), "{slack}");
    // 1 mm of a 0.3 m tendon: 0.3 % strain carries 2 % of f_max, the fully active fibre never gives less than 13 %.
    let short = equilibrium(&muscle, &curves, 0.302, 0.0, 1.0).unwrap_err();
    assert!(matches!(short, EquilibriumError::FibreTooShort { .. }), "{short}");
    // A path of 1000 km overflows the exponential tendon.
    for (curves, l_mt) in [(curves, f64::NAN), (curves, f64::INFINITY), (CURVES[3].1, 1e6)] {
        let error = equilibrium(&muscle, &curves, l_mt, 0.0, 0.5).unwrap_err();
        assert!(matches!(error, EquilibriumError::Argument { .. }), "{error}");
    }
}

/// u = a + τ da/dt undoes the activation dynamics it comes from.
#[test]
fn excitation_inverts_the_activation_dynamics() {
    let unit = unit(1.0, 0.0);
    let rate = 10_000.0;
    let control = |t: f64| if t < 0.1 { 0.8 } else { 0.2 };
    // Euler with ten steps per sample.
    let mut a = 0.05;
    let mut samples = Vec::new();
    for i in 0..2000 {
        samples.push(a);
        for k in 0..10 {
            let u: f64 = control((i as f64 + 0.1 * k as f64) / rate);
            let pace = 0.5 + 1.5 * a;
            let tau = if u > a { unit.tau_activation * pace } else { unit.tau_deactivation / pace };
            a += (u - a) / tau * 0.1 / rate;
        }
    }
    let mut holed = samples.clone();
    holed[500] = f64::NAN;
    let u = hill::excitation(&unit, &holed, rate);
    assert!(u[500].is_nan() && u[499].is_finite());
    for i in (10..990).chain(1010..1990).filter(|&i| i != 500) {
        // First order in the Euler step of 1e-5 s against a time constant of a few milliseconds.
        close(&format!("u at sample {i}"), u[i], control(i as f64 / rate), 0.01);
    }
}

// ---- the reference gait --------------------------------------------------------------------------------------------

/// The averaged walk of `reference_gait.csv`, three cycles: lengths and frames per second; angles of the `osim_*` columns.
fn reference_gait() -> (DMatrix<f64>, f64) {
    let mut table = csv::Reader::from_reader(include_str!("../gait-data/reference_gait.csv").as_bytes());
    let rows: Vec<HashMap<String, String>> = table.deserialize().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 101); // row 100 repeats row 0
    let lengths: Vec<f64> = (0..300)
        .flat_map(|i| {
            let angle = |name: &str| number(&rows[i % 100], &format!("osim_{name}_deg")).to_radians();
            MusculotendonModel::generic().lengths(&GenericPosture {
                hip_flexion: angle("hip_flex"),
                hip_adduction: angle("hip_add"),
                hip_rotation: angle("hip_rot"),
                knee_flexion: angle("knee_flex"),
                ankle_dorsiflexion: angle("ankle_flex"),
                subtalar: angle("subtalar"),
            })
        })
        .collect();
    (DMatrix::from_row_slice(300, N_MUSCLES, &lengths), 100.0 / number(&rows[100], "time_s"))
}

fn range(values: &DMatrix<f64>) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| (lo.min(v), hi.max(v)))
}

/// Known of this walk: L between 0.47 and 1.25, |V| below 0.36 (with the 5 Hz filter of the published method; the gastrocnemius
/// reaches −0.37 at 6 Hz and −0.38 unfiltered). Checked for rigid tendons, where fibres do not depend on the forces,
/// and for elastic tendons at rest. A tenth of each muscle's strength on elastic tendons only shortens fibres, and
/// keeps them above 0.4.
#[test]
fn fibres_work_in_their_range_in_the_reference_gait() {
    let (lengths, rate) = reference_gait();
    let units = &MusculotendonModel::generic().units;
    for (name, curves) in [CURVES[0], CURVES[4]] {
        let run = |tendon: Tendon, fraction: f64| {
            let forces = DMatrix::from_fn(lengths.nrows(), N_MUSCLES, |_, m| fraction * units[m].f_max);
            let settings = Settings { curves, tendon, velocity: FibreVelocity::LowPass { cutoff_hz: 5.0 } };
            let result = activations(units, &lengths, &forces, rate, &settings).unwrap();
            let middle = |x: &DMatrix<f64>| x.rows(100, 100).into_owned();
            let (L, V) = (middle(&result.fibre_length), middle(&result.fibre_velocity));
            let ((L0, L1), (V0, V1)) = (range(&L), range(&V));
            println!("{name}, {tendon:?}, {fraction} f_max: L {L0:.3}..{L1:.3}, V {V0:.3}..{V1:.3}");
            assert_eq!(result.overall.length_limited, 0.0);
            assert!(V0 > -0.36 && V1 < 0.36, "{name}, {tendon:?}: V {V0}..{V1}");
            L
        };
        for tendon in TENDONS {
            let (L0, L1) = range(&run(tendon, 0.0));
            assert!(L0 > 0.47 && L1 < 1.25, "{name}, {tendon:?}: L {L0}..{L1}");
        }
        assert!((run(Tendon::Rigid, 0.1) - run(Tendon::Elastic, 0.1)).min() > 0.0);
    }
}
