//! Natural coordinates Q = [u, rP, rD, w] of five segments (Dumas & Chèze 2007, Med Biol Eng Comput 45:315).
//!
//! Each segment has four vectors of three components: `u` (unit, anterior), the proximal and distal end
//! points `rP` and `rD`, and `w` (unit, medio-lateral, to the right); v = rP − rD. Everything that is
//! fixed to a segment is a *constant* linear combination of these four vectors, the same in x, y and z. So
//! every map of this crate is a matrix on the 20 vectors (`blocks`) times the 3×3 identity, every joint equation
//! is at most quadratic in Q, and its second derivatives are constant.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, SVector, Vector3};

/// Number of coordinates: 5 segments × 12 (foot, shank, patella, thigh, pelvis).
pub const N_COORDINATES: usize = 60;
/// Number of vectors in Q: 5 segments × (u, rP, rD, w).
pub const N_BLOCKS: usize = 20;
/// All natural coordinates of one frame.
pub type Coordinates = SVector<f64, N_COORDINATES>;

/// The five segments, in the order of the coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SegmentId {
    /// Foot.
    Foot,
    /// Shank.
    Shank,
    /// Patella.
    Patella,
    /// Thigh.
    Thigh,
    /// Pelvis.
    Pelvis,
}

impl SegmentId {
    /// All segments in the order of the coordinates.
    pub const ALL: [SegmentId; 5] =
        [SegmentId::Foot, SegmentId::Shank, SegmentId::Patella, SegmentId::Thigh, SegmentId::Pelvis];

    /// Position in [`SegmentId::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Lower-case name, as in files.
    pub fn name(self) -> &'static str {
        ["foot", "shank", "patella", "thigh", "pelvis"][self.index()]
    }

    /// Index of the segment's vector `which` (0 u, 1 rP, 2 rD, 3 w) among the 20 blocks.
    pub fn block(self, which: usize) -> usize {
        4 * self.index() + which
    }
}

/// Block `b` of Q as a vector.
pub fn block(Q: &Coordinates, b: usize) -> Vector3<f64> {
    Q.fixed_rows::<3>(3 * b).into_owned()
}

/// A vector fixed to segments: Σ coefficient · block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VectorForm {
    /// Block index and its coefficient.
    pub terms: Vec<(usize, f64)>,
}

impl VectorForm {
    /// Value at Q \[m, or 1 for directions\].
    pub fn at(&self, Q: &Coordinates) -> Vector3<f64> {
        self.terms.iter().map(|&(b, k)| k * block(Q, b)).sum()
    }

    /// This form minus another one.
    pub fn minus(&self, other: &VectorForm) -> VectorForm {
        self.plus(other, -1.0)
    }

    /// This form plus `factor` times another one.
    pub fn plus(&self, other: &VectorForm, factor: f64) -> VectorForm {
        let mut terms = self.terms.clone();
        for &(b, k) in &other.terms {
            match terms.iter_mut().find(|(c, _)| *c == b) {
                Some((_, sum)) => *sum += factor * k,
                None => terms.push((b, factor * k)),
            }
        }
        terms.retain(|&(_, k)| k != 0.0);
        VectorForm { terms }
    }
}

/// End point from which a point of a segment is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// rP.
    Proximal,
    /// rD.
    Distal,
}

/// Position and orientation of a segment's orthonormal frame (SCS: origin rP, X = u, Y in the plane of u and v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation from the segment to ground.
    pub R: Matrix3<f64>,
    /// Origin rP in ground \[m\].
    pub p: Vector3<f64>,
}

/// Constant length and angles of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// |v| \[m\].
    pub L: f64,
    /// Cosine of the angle α between v and w.
    pub cos_alpha: f64,
    /// Cosine of the angle β between u and w.
    pub cos_beta: f64,
    /// Cosine of the angle γ between u and v.
    pub cos_gamma: f64,
}

impl Shape {
    /// Shape of a segment in one posture.
    pub fn of(u: &Vector3<f64>, rP: &Vector3<f64>, rD: &Vector3<f64>, w: &Vector3<f64>) -> Shape {
        let v = rP - rD;
        let L = v.norm();
        Shape { L, cos_alpha: v.dot(w) / L, cos_beta: u.dot(w), cos_gamma: u.dot(&v) / L }
    }

    /// B: columns are u, v, w in the SCS (Dumas & Chèze 2007 eq. 5).
    pub fn basis(&self) -> Matrix3<f64> {
        let sin_gamma = (1.0 - self.cos_gamma * self.cos_gamma).sqrt();
        let q = (self.cos_alpha - self.cos_beta * self.cos_gamma) / sin_gamma;
        let z = (1.0 - self.cos_beta * self.cos_beta - q * q).sqrt();
        Matrix3::new(1.0, self.L * self.cos_gamma, self.cos_beta, 0.0, self.L * sin_gamma, q, 0.0, 0.0, z)
    }

    /// Coefficients n = B⁻¹ c of an SCS vector.
    pub fn coefficients(&self, c: &Vector3<f64>) -> Vector3<f64> {
        // B is upper triangular with a positive diagonal for every shape a posture can have.
        let B = self.basis();
        let n3 = c.z / B[(2, 2)];
        let n2 = (c.y - B[(1, 2)] * n3) / B[(1, 1)];
        Vector3::new(c.x - B[(0, 1)] * n2 - B[(0, 2)] * n3, n2, n3)
    }

    /// The point with SCS coordinates `c` \[m\], counted from `end`.
    pub fn point(&self, segment: SegmentId, c: &Vector3<f64>, end: End) -> VectorForm {
        point_form(segment, &self.coefficients(c), end)
    }

    /// The direction with SCS components `c`.
    pub fn direction(&self, segment: SegmentId, c: &Vector3<f64>) -> VectorForm {
        let n = self.coefficients(c);
        form(segment, [n.x, n.y, -n.y, n.z])
    }

    /// u, rP, rD, w at a pose: the local vectors ℓ and whether the origin is added, for each block.
    pub fn local_blocks(&self) -> [(Vector3<f64>, f64); 4] {
        let B = self.basis();
        [(B.column(0).into(), 0.0), (Vector3::zeros(), 1.0), (-B.column(1), 1.0), (B.column(2).into(), 0.0)]
    }

    /// Pose of the segment in Q; exact when Q satisfies the rigid-body equations.
    pub fn pose(&self, segment: SegmentId, Q: &Coordinates) -> Pose {
        let u = block(Q, segment.block(0));
        let v = block(Q, segment.block(1)) - block(Q, segment.block(2));
        let x = u.normalize();
        let z = x.cross(&v).normalize();
        Pose { R: Matrix3::from_columns(&[x, z.cross(&x), z]), p: block(Q, segment.block(1)) }
    }

    /// Writes the segment at `pose` into Q.
    pub fn write(&self, segment: SegmentId, pose: &Pose, Q: &mut Coordinates) {
        for (which, (local, origin)) in self.local_blocks().iter().enumerate() {
            let value = pose.R * local + *origin * pose.p;
            Q.fixed_rows_mut::<3>(3 * segment.block(which)).copy_from(&value);
        }
    }

    /// Largest of the six rigid-body equations u·u = 1, u·v = L cos γ, … at Q.
    pub fn rigid_residual(&self, segment: SegmentId, Q: &Coordinates) -> f64 {
        let u = block(Q, segment.block(0));
        let v = block(Q, segment.block(1)) - block(Q, segment.block(2));
        let w = block(Q, segment.block(3));
        [
            u.dot(&u) - 1.0,
            u.dot(&v) - self.L * self.cos_gamma,
            u.dot(&w) - self.cos_beta,
            v.dot(&v) - self.L * self.L,
            v.dot(&w) - self.L * self.cos_alpha,
            w.dot(&w) - 1.0,
        ]
        .iter()
        .fold(0.0, |m, r| r.abs().max(m))
    }
}

/// The point with coefficients `n` of (u, v, w) counted from `end`.
pub fn point_form(segment: SegmentId, n: &Vector3<f64>, end: End) -> VectorForm {
    match end {
        End::Proximal => form(segment, [n.x, 1.0 + n.y, -n.y, n.z]),
        End::Distal => form(segment, [n.x, n.y, 1.0 - n.y, n.z]),
    }
}

fn form(segment: SegmentId, coefficients: [f64; 4]) -> VectorForm {
    let terms = (0..4).map(|k| (segment.block(k), coefficients[k])).filter(|&(_, k)| k != 0.0).collect();
    VectorForm { terms }
}
