//! The knee as a prosthesis: what its tray carries, in place of ligaments.
//!
//! The joint equations stay those of the natural knee, so motion, moments and lever arms are the same. What their multipliers mean changes:
//! in the natural knee three ligaments pull and press the compartments together, and one that pushes (the MCL, negative, stands in for the lateral
//! ligament) takes load off them. A prosthesis in gait has no ligament that is taut, and nothing that pushes but its tray. The post, the cam and the
//! conforming surfaces take shear both ways.
//!
//! The five forces on the femur become five others of the same resultant. With λ the tension of a ligament, u its unit direction from
//! femur to tibia, b its place on the tibia, all in axes of the shank, m and l the places where the compartments bear (below the spheres' centres, on
//! the plateau, height y_p), and x_c half-way between them:
//!
//! ```text
//! axial force             Δ_m + Δ_l         = Σ λ u_y
//! frontal moment          m_z Δ_m + l_z Δ_l = Σ λ (b_z u_y − (b_y − y_p) u_z)
//! shear forward           S_m + S_l         = Σ λ u_x
//! moment about the shank  m_z S_m + l_z S_l = Σ λ (b_z u_x − b_x u_z) + x_c S_z
//! shear to the right      S_z               = Σ λ u_z
//! ```
//!
//! Δ is added to the compartments; S_m and S_l are the forward shear that each bears. The moment about the flexion axis that is left over is the
//! place where the tray bears, forward or backward. A compartment whose force is zero has lifted off. Axial force and frontal moment are what an
//! instrumented tray measures.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, Vector3};

use crate::model::Model;
use crate::natural::{Coordinates, End, SegmentId};
use crate::tables::JointTable;

/// Forces of the natural knee, and the shear forces on the femur that stand in their place: forward on the medial and lateral compartment, and to
/// the right, in axes of the shank.
pub const SHEAR: [(&str, &str); 3] =
    [("acl", "knee_shear_medial"), ("pcl", "knee_shear_lateral"), ("mcl", "knee_shear_z")];

/// Turns the rows of wanted forces of the natural knee, under their `names` with a tray, into those of a tray.
pub fn bear(model: &Model, Q: &Coordinates, names: &[String], rows: &mut DMatrix<f64>) {
    let table = JointTable::built_in();
    let row = |name: &str| names.iter().position(|n| n == name).expect("a force of every knee");
    let (thigh, shank) = (&model.shapes[SegmentId::Thigh.index()], &model.shapes[SegmentId::Shank.index()]);
    let X = model.pose(SegmentId::Shank, Q);
    let item = |name: &str| table.point("tibiofemoral", name);
    let local = |ground: Vector3<f64>| X.R.transpose() * (ground - X.p);
    let of_femur = |name: &str| local(thigh.point(SegmentId::Thigh, &item(name), End::Distal).at(Q));
    let of_tibia = |name: &str| local(shank.point(SegmentId::Shank, &item(name), End::Proximal).at(Q));
    let plateau = 0.5 * (item("medial contact plane point").y + item("lateral contact plane point").y);
    let (m, l) = (of_femur("medial sphere centre"), of_femur("lateral sphere centre"));
    let middle = 0.5 * (m.x + l.x);
    let ligaments: [(Vector3<f64>, Vector3<f64>); 3] = ["ACL", "PCL", "MCL"].map(|name| {
        let (a, b) = (of_femur(&format!("{name} origin")), of_tibia(&format!("{name} insertion")));
        ((b - a).normalize(), b)
    });
    // Shares of two places z_m and z_l with this sum and this moment.
    let shared =
        |sum: f64, moment: f64| [(moment - l.z * sum) / (m.z - l.z), (m.z * sum - moment) / (m.z - l.z)];
    let (medial, lateral) = (row("knee_medial"), row("knee_lateral"));
    let shear = SHEAR.map(|(_, name)| row(name));
    for mut column in rows.column_iter_mut() {
        let tension = shear.map(|r| column[r]);
        let (mut force, mut frontal, mut axial) = (Vector3::zeros(), 0.0, 0.0);
        for (lambda, (u, b)) in tension.iter().zip(&ligaments) {
            force += *lambda * u;
            frontal += lambda * (b.z * u.y - (b.y - plateau) * u.z);
            axial += lambda * (b.z * u.x - b.x * u.z);
        }
        let [on_medial, on_lateral] = shared(force.y, frontal);
        let [shear_medial, shear_lateral] = shared(force.x, axial + middle * force.z);
        column[medial] += on_medial;
        column[lateral] += on_lateral;
        column[shear[0]] = shear_medial;
        column[shear[1]] = shear_lateral;
        column[shear[2]] = force.z;
    }
}
