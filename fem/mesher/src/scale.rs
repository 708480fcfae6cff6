//! Scaling to a subject: an affine map per body segment, blended along muscles that span joints.
//!
//! A point p fixed to a segment goes to p′ = O′ + R′ diag(kx, ky, kz) Rᵀ (p − O), with origin O and axes R of the segment as
//! measured (`gait-data/thigh/limb_frames.csv`) and O′, R′ of the subject in the same pose. A section of a muscle goes to
//! (1 − w) p′ + w p″ with the maps of the segments above and below a joint; w steps smoothly from 0 to 1 along the muscle.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::sections::{MuscleSections, Station};
use super::table::Table;
use fem::mesh::MeshError;

/// Length of the smooth step from one segment to the next, along the muscle \[m\].
const STEP: f64 = 60e-3;
/// How far axes of a table of five decimals may be from orthonormal.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Frame of a body segment in the pose in which the thigh was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentFrame {
    /// Name, e.g. `thigh`.
    pub segment: String,
    /// Proximal end point P \[m\], the origin.
    pub origin: Vector3<f64>,
    /// Distal end point D \[m\], where the table has one.
    pub distal: Option<Vector3<f64>>,
    /// Axes X, Y, Z as columns.
    pub axes: Matrix3<f64>,
}

/// Affine map of the points of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentMap {
    /// Linear part R′ diag(k) Rᵀ.
    pub linear: Matrix3<f64>,
    /// Origin before \[m\].
    pub from: Vector3<f64>,
    /// Origin after \[m\].
    pub to: Vector3<f64>,
}

impl SegmentFrame {
    /// Reads the table of frames, in mm. `file` is the name for messages.
    pub fn read_csv(text: &str, file: &Path) -> Result<Vec<SegmentFrame>, MeshError> {
        let mut table = Table::read(text, file)?;
        let mut frames: Vec<SegmentFrame> = Vec::new();
        for row in table.rows() {
            let row = row?;
            let segment = row.cell("segment")?.to_string();
            if segment.is_empty() || frames.iter().any(|f| f.segment == segment) {
                return Err(row.bad(format!("segment `{segment}`: give every row a name of its own")));
            }
            let axes = Matrix3::from_columns(&[
                row.vector(["Xx", "Xy", "Xz"])?,
                row.vector(["Yx", "Yy", "Yz"])?,
                row.vector(["Zx", "Zy", "Zz"])?,
            ]);
            let error = (axes.transpose() * axes - Matrix3::identity()).amax();
            if !(error <= UNIT_TOLERANCE && axes.determinant() > 0.0) {
                return Err(row.bad(format!("the axes of `{segment}` are no right-handed frame")));
            }
            // Rounded in the table: made orthonormal again, the long axis Y kept.
            let (x, y) = (axes.column(0), axes.column(1).normalize());
            let x = (x - y * y.dot(&x)).normalize();
            let axes = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            let distal = if row.cell("Dx")?.is_empty() {
                None
            } else {
                Some(row.vector(["Dx", "Dy", "Dz"])? / 1000.0)
            };
            frames.push(SegmentFrame {
                segment,
                origin: row.vector(["Px", "Py", "Pz"])? / 1000.0,
                distal,
                axes,
            });
        }
        Ok(frames)
    }
}

impl SegmentMap {
    /// The map that carries a measured frame to `origin` \[m\] and `axes` of a subject and stretches along the segment's axes by
    /// `factors`.
    pub fn new(
        measured: &SegmentFrame,
        origin: Vector3<f64>,
        axes: Matrix3<f64>,
        factors: Vector3<f64>,
    ) -> SegmentMap {
        let linear = axes * Matrix3::from_diagonal(&factors) * measured.axes.transpose();
        SegmentMap { linear, from: measured.origin, to: origin }
    }

    /// Where a point of the segment goes \[m\].
    pub fn apply(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.to + self.linear * (p - self.from)
    }
}

/// A muscle carried along by the segments it spans, from origin to insertion: `maps`, and between each two the joint centre
/// `joints` \[m\] as measured.
///
/// The step at a joint is centred where the muscle's line comes nearest to the joint's height, and moved along the line as far as
/// needed for the muscle to begin and end wholly on its segments.
pub fn map_sections(
    sections: &MuscleSections,
    maps: &[SegmentMap],
    joints: &[Vector3<f64>],
) -> MuscleSections {
    assert_eq!(maps.len(), joints.len() + 1, "one joint between each two segments");
    let stations = &sections.stations;
    let mut along = vec![0.0];
    for w in stations.windows(2) {
        along.push(along[along.len() - 1] + (w[1].centre - w[0].centre).norm());
    }
    let length = along[along.len() - 1];
    let n_joints = joints.len() as f64;
    let half = (STEP / 2.0).min(length / (2.0 * n_joints.max(1.0)));
    let middles: Vec<f64> = joints
        .iter()
        .enumerate()
        .map(|(k, joint)| {
            let height = |i: &usize| (stations[*i].centre.y - joint.y).abs();
            let nearest = (0..stations.len()).min_by(|a, b| height(a).total_cmp(&height(b))).unwrap_or(0);
            // Room for the other joints before and after.
            let (before, after) = (k as f64, n_joints - 1.0 - k as f64);
            along[nearest].clamp(half * (1.0 + 2.0 * before), length - half * (1.0 + 2.0 * after))
        })
        .collect();
    let carried = |p: &Vector3<f64>, at: f64| {
        let mut q = maps[0].apply(p);
        for (map, middle) in maps[1..].iter().zip(&middles) {
            let x = ((at - middle) / (2.0 * half) + 0.5).clamp(0.0, 1.0);
            let w = x * x * (3.0 - 2.0 * x);
            q += (map.apply(p) - q) * w;
        }
        q
    };
    let mut mapped: Vec<Station> = stations
        .iter()
        .zip(&along)
        .map(|(station, &at)| {
            let centre = carried(&station.centre, at);
            let outline = station.outline.map(|p| carried(&p, at));
            let n = outline.len();
            let area: Vector3<f64> =
                (0..n).map(|k| (outline[k] - centre).cross(&(outline[(k + 1) % n] - centre))).sum();
            let normal = area.normalize();
            let axis = carried(&(station.centre + station.axis * STEP), at) - centre;
            let axis = (axis - normal * axis.dot(&normal)).normalize();
            Station { s: station.s, centre, normal, axis, outline }
        })
        .collect();
    let mut line = vec![0.0];
    for w in mapped.windows(2) {
        line.push(line[line.len() - 1] + (w[1].centre - w[0].centre).norm());
    }
    let total = line[line.len() - 1];
    mapped.iter_mut().zip(&line).for_each(|(station, at)| station.s = at / total);
    MuscleSections { name: sections.name.clone(), stations: mapped }
}
