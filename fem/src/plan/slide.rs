//! Nodes that may move in some directions only, which need not be axes: rollers on oblique planes, and oblique planes that move as one.
//!
//! The constraints n_k · u = d_k of a node make its displacement u = P ũ + Σ d_k w_k, with the projector P onto the directions across all n_k
//! and their dual basis w_k. Each d_k is a control times a length, or n_k · u of another node. Unknowns ũ stay three per node in ground
//! axes: forces on them are P f, blocks of the stiffness P K P; along the n_k, where nothing is left to find, a spring keeps the matrix definite.

use nalgebra::{Matrix3, Vector3};

/// Sine of the angle by which a direction must differ from those before it to be one of its own. Directions written with six digits that should be the same are.
const PARALLEL: f64 = 1e-5;
/// Difference of prescribed displacements \[m\], relative to the larger, that counts as none.
const ROUND_OFF: f64 = 1e-9;

/// What a constraint prescribes along its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Along {
    /// A control times a length \[m\]; none: held.
    Control(Option<(usize, f64)>),
    /// What another node does.
    Node(u32),
}

/// How a node moves that is constrained in directions that are no axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Slide {
    /// P: projector onto the directions in which it is free.
    pub free: Matrix3<f64>,
    /// How far each control takes it along the others \[m\] per unit.
    pub by: Vec<(usize, Vector3<f64>)>,
    /// A node m of which it takes over n · u as w (n · u_m): m, n, w.
    pub follows: Option<(u32, Vector3<f64>, Vector3<f64>)>,
}

impl Slide {
    /// From directions of unit length and what is prescribed along each. `Err` holds the index of the first constraint that contradicts
    /// one before it, and of that one.
    pub fn new(constraints: &[(Vector3<f64>, Along)]) -> Result<Slide, [usize; 2]> {
        let mut kept: Vec<usize> = Vec::new();
        for (i, (n, along)) in constraints.iter().enumerate() {
            // What is left of the direction across those kept, and the factor of each in it.
            let (rest, factors) = split(*n, &kept.iter().map(|&k| constraints[k].0).collect::<Vec<_>>());
            if rest.norm() > PARALLEL {
                let follows = |a: &Along| matches!(a, Along::Node(_));
                if let Some(&other) = kept.iter().find(|&&k| follows(along) && follows(&constraints[k].1)) {
                    return Err([i, other]);
                }
                kept.push(i);
                continue;
            }
            // Nothing new: it must agree with what those kept prescribe along it.
            let mut implied: Vec<(Along, f64)> =
                kept.iter().zip(&factors).map(|(&k, factor)| (constraints[k].1, *factor)).collect();
            implied.push((*along, -1.0));
            if !cancels(&implied) {
                let other = kept.iter().zip(&factors).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
                return Err([i, *other.map_or(&0, |(k, _)| k)]);
            }
        }
        let normals: Vec<Vector3<f64>> = kept.iter().map(|&k| constraints[k].0).collect();
        let mut slide = Slide { free: projector(&normals), by: Vec::new(), follows: None };
        for (i, &k) in kept.iter().enumerate() {
            // Its dual vector: across all others, in the span of all.
            let others: Vec<Vector3<f64>> =
                (0..normals.len()).filter(|&j| j != i).map(|j| normals[j]).collect();
            let across = projector(&others) * normals[i];
            let w = across / across.dot(&normals[i]);
            match constraints[k].1 {
                Along::Control(None) => {}
                Along::Control(Some((control, u))) => slide.by.push((control, w * u)),
                Along::Node(node) => slide.follows = Some((node, normals[i], w)),
            }
        }
        Ok(slide)
    }

    /// Displacement \[m\] that the controls prescribe.
    pub fn prescribed(&self, controls: &[f64]) -> Vector3<f64> {
        self.by.iter().map(|(control, u)| u * controls[*control]).sum()
    }

    /// Moves what acts on the node, three values at `at(3 p)` to `at(3 p + 2)`, onto what is free of it and onto the node that it follows,
    /// at `q`.
    pub fn redistribute(&self, values: &mut [f64], at: impl Fn(usize) -> usize, p: usize, q: Option<usize>) {
        let f = Vector3::from_fn(|i, _| values[at(3 * p + i)]);
        let own = self.free * f;
        (0..3).for_each(|i| values[at(3 * p + i)] = own[i]);
        if let (Some(q), Some((_, n, w))) = (q, self.follows) {
            (0..3).for_each(|i| values[at(3 * q + i)] += n[i] * w.dot(&f));
        }
    }

    /// The part of a force \[N\] on the node that its support carries: not what moves the node, nor what the node that it follows feels.
    pub fn reaction(&self, force: Vector3<f64>) -> Vector3<f64> {
        let along = force - self.free * force;
        self.follows.map_or(along, |(_, n, w)| along - n * w.dot(&force))
    }
}

/// Projector onto what is across all of some directions, which are independent.
fn projector(normals: &[Vector3<f64>]) -> Matrix3<f64> {
    let mut P = Matrix3::identity();
    for n in normals {
        // Twice, against round-off where directions are close (Kahan's rule).
        let q = (P * (P * n)).normalize();
        P -= q * q.transpose();
    }
    // Of three directions nothing is left.
    if normals.len() == 3 { Matrix3::zeros() } else { 0.5 * (P + P.transpose()) }
}

/// The part of a vector across some independent directions, and its coefficients along them.
fn split(v: Vector3<f64>, basis: &[Vector3<f64>]) -> (Vector3<f64>, Vec<f64>) {
    if basis.is_empty() {
        return (v, Vec::new());
    }
    let B = nalgebra::Matrix3xX::from_columns(basis);
    let gram = B.transpose() * &B;
    let factors = gram.try_inverse().map(|inverse| inverse * B.transpose() * v);
    let factors = factors.unwrap_or_else(|| nalgebra::DVector::zeros(basis.len()));
    (v - &B * &factors, factors.as_slice().to_vec())
}

/// Whether prescriptions times factors add up to nothing, whatever the controls and nodes do.
fn cancels(sum: &[(Along, f64)]) -> bool {
    let key = |along: &Along| match along {
        Along::Control(None) => None,
        Along::Control(Some((control, _))) => Some((false, *control)),
        Along::Node(node) => Some((true, *node as usize)),
    };
    let length = |along: &Along| match along {
        Along::Control(Some((_, u))) => *u,
        _ => 1.0,
    };
    sum.iter().filter_map(|(along, _)| key(along)).all(|of| {
        let mine = || sum.iter().filter(|(a, _)| key(a) == Some(of));
        let largest = mine().fold(0.0_f64, |m, (a, _)| m.max(length(a).abs()));
        mine().map(|(a, factor)| factor * length(a)).sum::<f64>().abs() <= ROUND_OFF * largest
    })
}
