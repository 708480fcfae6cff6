//! Does the deformable side give the known answers of the benchmarks, within their tolerances, on the stated meshes?
//!
//! The refinements run in `cargo run --release -p sartorius-fem --example verification`.

use fem::verification::reference::{DENSITY, MATRIX};
use fem::verification::{CaseFn, cases};

fn hold(name: &str) {
    let case: CaseFn = cases().into_iter().find(|c| c.0 == name).expect("a case of this name").1;
    let checks = case(false).unwrap_or_else(|e| panic!("{e}"));
    assert!(!checks.is_empty(), "{name} checks nothing");
    let failed: Vec<String> =
        checks.iter().filter(|c| !c.holds()).map(fem::verification::table_row).collect();
    assert!(failed.is_empty(), "\n{}", failed.join("\n"));
}

#[test]
fn cubes_follow_their_curves() {
    hold("b01");
}

#[test]
fn inflated_sphere_carries_its_pressure() {
    hold("b02");
}

#[test]
fn twisted_cylinder_has_its_torque_and_axial_force() {
    hold("b03");
}

#[test]
fn fibre_bar_contracts_in_one_step_and_carries_its_end_force_throughout() {
    hold("b04");
}

#[test]
fn hanging_bar_carries_the_weight_below() {
    hold("b05");
}

#[test]
fn cooks_membrane_does_not_lock() {
    hold("b08");
}

#[test]
fn squashed_block_bulges_without_locking() {
    hold("b09");
}

/// A table of the reference material, by columns; `None` where it is absent.
fn columns(name: &str) -> Option<Vec<Vec<f64>>> {
    let path = support::shared(&format!("benchmarks/{name}.csv"))?;
    let mut reader = csv::Reader::from_path(&path).expect("readable");
    let mut columns = vec![Vec::new(); reader.headers().expect("a header").len()];
    for row in reader.records() {
        for (column, field) in columns.iter_mut().zip(&row.expect("a row")) {
            column.push(field.parse().expect("a number"));
        }
    }
    assert!(columns[0].len() > 5, "{name} is empty");
    Some(columns)
}

/// Compares a column with a function of the first one; the tables have eight digits, half a unit in the last is 5e-8 at most.
fn agree(name: &str, columns: &[Vec<f64>], column: usize, f: impl Fn(f64) -> f64) {
    let largest = columns[column].iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    for (x, wanted) in columns[0].iter().zip(&columns[column]) {
        let found = f(*x);
        assert!(
            (found - wanted).abs() < 5e-8 * largest,
            "{name}, column {column} at {x}: {found}, table {wanted}"
        );
    }
}

#[test]
fn references_agree_with_the_tables() {
    if let Some(t) = columns("b01_uniaxial") {
        agree("b01_uniaxial", &t, 1, |l| MATRIX.uniaxial(l).0);
        agree("b01_uniaxial", &t, 2, |l| MATRIX.uniaxial(l).1 / 1e3);
        agree("b01_uniaxial", &t, 3, |l| MATRIX.uniaxial_nominal(l) / 1e3);
    }
    if let Some(t) = columns("b01_equibiaxial") {
        agree("b01_equibiaxial", &t, 1, |l| MATRIX.equibiaxial(l).0);
        agree("b01_equibiaxial", &t, 2, |l| MATRIX.equibiaxial(l).1 / 1e3);
    }
    if let Some(t) = columns("b01_confined") {
        agree("b01_confined", &t, 1, |l| MATRIX.cauchy([l, 1.0, 1.0])[0] / 1e3);
        agree("b01_confined", &t, 2, |l| MATRIX.cauchy([l, 1.0, 1.0])[1] / 1e3);
    }
    if let Some(t) = columns("b01_simple_shear") {
        for (column, component) in [(1, 3), (2, 0), (3, 1), (4, 2)] {
            agree("b01_simple_shear", &t, column, |g| MATRIX.simple_shear(g)[component] / 1e3);
        }
    }
    if let Some(t) = columns("b02_sphere") {
        agree("b02_sphere", &t, 3, |l| MATRIX.sphere_pressure(0.010, 0.015, l) / 1e3);
    }
    if let Some(t) = columns("b03_torsion") {
        agree("b03_torsion", &t, 1, |d| 1e3 * MATRIX.torsion(0.010, d.to_radians() / 0.040).0);
        agree("b03_torsion", &t, 2, |d| MATRIX.torsion(0.010, d.to_radians() / 0.040).1);
    }
    if let Some(t) = columns("b04_fibre_bar") {
        use fem::material::line::FibreStrain::{Engineering, Logarithmic};
        use fem::verification::{fibre_bar_force, fibre_bar_free_stretch};
        for (column, strain) in [(3, Engineering), (4, Logarithmic)] {
            agree("b04_fibre_bar", &t, column, |a| fibre_bar_free_stretch(strain, a));
            agree("b04_fibre_bar", &t, column + 2, |a| fibre_bar_force(strain, 1.1, a));
            agree("b04_fibre_bar", &t, 2, |a| fibre_bar_force(strain, 1.0, a));
        }
    }
    if let Some(t) = columns("b05_gravity") {
        agree("b05_gravity", &t, 1, |z| DENSITY * 9.81 * 0.02 * 0.02 * (0.2 - 1e-3 * z));
        // The elongations stated with the table.
        assert!((1e3 * MATRIX.hanging_elongation(0.2, 9.81) - 10.01).abs() < 0.005);
        assert!((1e3 * MATRIX.hanging_elongation(0.2, 5.0 * 9.81) - 69.50).abs() < 0.01);
    }
}
