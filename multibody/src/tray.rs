//! The knee as a prosthesis: what its tray carries, in place of the cruciate ligaments.
//!
//! The joint equations stay those of the natural knee, so motion, moments and lever arms are the same. What their multipliers mean changes:
//! in the natural knee the two cruciate ligaments pull and press the compartments together; a prosthesis has none. There the post
//! and cam and the conforming surfaces take shear forward and backward, inward and outward, and the tray alone carries along the shank.
//!
//! With λ the tension of a ligament, u its unit direction from femur to tibia and b its place on the tibia, in axes of the shank, and z_m, z_l
//! where the compartments bear, forces on the femur keep their sum and their moment about the forward axis on the plateau (height y_p):
//!
//! ```text
//! shear_x = Σ λ u_x        shear_z = Σ λ u_z
//! Δ_m + Δ_l = V = Σ λ u_y
//! z_m Δ_m + z_l Δ_l = W = Σ λ (b_z u_y − (b_y − y_p) u_z)
//! ```
//!
//! Δ is added to the compartments. The moment about the flexion axis that is left is the place where the tray bears, forward or backward; that about
//! the shank is taken by the conforming surfaces. A compartment whose force is zero has lifted off. These are the axial force and the frontal
//! moment that an instrumented tray measures.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, Vector3};

use crate::model::Model;
use crate::natural::{Coordinates, End, SegmentId};
use crate::tables::JointTable;

/// Names of the shear forces on the femur, in axes of the shank; they stand where those of the ligaments stood.
pub const SHEAR: [(&str, &str); 2] = [("acl", "knee_shear_x"), ("pcl", "knee_shear_z")];

/// Turns the rows of wanted forces of the natural knee (`names`) into those of a tray.
pub fn bear(model: &Model, Q: &Coordinates, names: &[String], rows: &mut DMatrix<f64>) {
    let table = JointTable::built_in();
    let row = |name: &str| names.iter().position(|n| n == name).expect("a force of every knee");
    let (thigh, shank) = (&model.shapes[SegmentId::Thigh.index()], &model.shapes[SegmentId::Shank.index()]);
    let X = model.pose(SegmentId::Shank, Q);
    let item = |name: &str| table.point("tibiofemoral", name);
    let from_femur = |name: &str| {
        let ground = thigh.point(SegmentId::Thigh, &item(name), End::Distal).at(Q);
        X.R.transpose() * (ground - X.p)
    };
    let on_tibia = |name: &str| {
        let ground = shank.point(SegmentId::Shank, &item(name), End::Proximal).at(Q);
        X.R.transpose() * (ground - X.p)
    };
    let plateau = 0.5 * (item("medial contact plane point").y + item("lateral contact plane point").y);
    let (z_m, z_l) = (from_femur("medial sphere centre").z, from_femur("lateral sphere centre").z);
    let ligaments: [(Vector3<f64>, Vector3<f64>); 2] = ["ACL", "PCL"].map(|name| {
        let (a, b) = (from_femur(&format!("{name} origin")), on_tibia(&format!("{name} insertion")));
        ((b - a).normalize(), b)
    });
    let (medial, lateral) = (row("knee_medial"), row("knee_lateral"));
    let shear = SHEAR.map(|(_, name)| row(name));
    for mut column in rows.column_iter_mut() {
        let tension = shear.map(|r| column[r]);
        let mut sum = [0.0; 4];
        for (lambda, (u, b)) in tension.iter().zip(&ligaments) {
            let parts = [u.x, u.z, u.y, b.z * u.y - (b.y - plateau) * u.z];
            sum.iter_mut().zip(parts).for_each(|(s, part)| *s += lambda * part);
        }
        let [x, z, V, W] = sum;
        column[shear[0]] = x;
        column[shear[1]] = z;
        column[medial] += (W - z_l * V) / (z_m - z_l);
        column[lateral] += (z_m * V - W) / (z_m - z_l);
    }
}
