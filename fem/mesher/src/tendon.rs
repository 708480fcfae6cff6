//! Solid tendons: from the end face of a muscle to its footprint on bone, with the cells of the face in every layer.

use nalgebra::{Matrix3, Vector3};

use super::MuscleBlock;
use super::attachment::Footprint;

/// The tendon at the insertion of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Slip {
    /// Positions of the nodes of every layer \[m\], numbered as in a section of the muscle; first the end face of the muscle, last the
    /// footprint.
    pub layers: Vec<Vec<Vector3<f64>>>,
}

impl Slip {
    /// A tendon of `n_layers` layers of cells with straight fibres. The end face comes to lie on the footprint by an affine map: its
    /// principal sides along those of the footprint, its own bulges kept, so that no cell is bent more than the tendon as a whole.
    pub fn new(block: &MuscleBlock, footprint: &Footprint, n_layers: usize) -> Slip {
        let last = block.n_layers() - 1;
        let face: Vec<Vector3<f64>> =
            (0..block.nodes_per_section as u32).map(|k| block.point(last, k)).collect();
        let centre = face.iter().sum::<Vector3<f64>>() / face.len() as f64;
        let ahead = block.area_vector(last).normalize();
        let [long, mut short] = footprint.half_sides;
        let covariance: Matrix3<f64> = face.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let principal = covariance.symmetric_eigen();
        let e1 = principal.eigenvectors.column(principal.eigenvalues.imax()).into_owned();
        let e1 = (e1 - ahead * ahead.dot(&e1)).normalize();
        let e1 = if e1.dot(&long) < 0.0 { -e1 } else { e1 };
        let e2 = ahead.cross(&e1);
        if long.cross(&short).dot(&ahead) < 0.0 {
            short = -short;
        }
        let into_bone = long.cross(&short).normalize();
        let reach = |e: &Vector3<f64>| face.iter().map(|p| (p - centre).dot(e).abs()).fold(0.0, f64::max);
        let map = long * (e1 / reach(&e1)).transpose()
            + short * (e2 / reach(&e2)).transpose()
            + into_bone * ahead.transpose();
        let layers = (0..=n_layers)
            .map(|l| {
                let f = l as f64 / n_layers as f64;
                let place = |p: &Vector3<f64>| p * (1.0 - f) + (footprint.centre + map * (p - centre)) * f;
                face.iter().map(place).collect()
            })
            .collect();
        Slip { layers }
    }

    /// Mean length of the fibres of such a tendon \[m\].
    pub fn length(&self) -> f64 {
        let (from, to) = (&self.layers[0], &self.layers[self.layers.len() - 1]);
        from.iter().zip(to).map(|(p, q)| (q - p).norm()).sum::<f64>() / from.len() as f64
    }
}
