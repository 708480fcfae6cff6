//! Sections inset, so that muscles lie farther apart.

use nalgebra::Vector3;

use super::sections::{MuscleSections, N_OUTLINE, Station};
use fem::mesh::MeshError;

/// Outline points that face each other across the section, side 1 and side 2, from end A to end B ([`super::CORNERS`]).
const FACING: [[usize; 2]; 6] = [[0, 12], [1, 11], [2, 10], [3, 9], [4, 8], [5, 7]];
/// Points in the middle of end A and end B.
const ENDS: [usize; 2] = [13, 6];
/// A section keeps this fraction of its thickness and width: straps thinner than the gap stay straps.
const LEAST: f64 = 1.0 / 3.0;

impl MuscleSections {
    /// The muscle with its surface moved inwards by `by` \[m\], by less where no third of the thickness or width would be left. The line of the
    /// muscle stays, so do its ends. Refuses what [`MuscleSections::check`] refuses then.
    pub fn inset(&self, by: f64) -> Result<MuscleSections, MeshError> {
        let stations = self.stations.iter().map(|station| inset(station, by)).collect();
        let smaller = MuscleSections { name: self.name.clone(), stations };
        match smaller.check() {
            Ok(()) => Ok(smaller),
            Err((station, reason)) => Err(MeshError::Inset { name: smaller.name, by, station, reason }),
        }
    }
}

/// A section is a band about its middle line, from the middle of end A over the midpoints of facing points to the middle of end B: the band
/// becomes shorter at both ends and thinner on both sides.
fn inset(station: &Station, by: f64) -> Station {
    let at = |k: usize| station.outline[k];
    let mut middle = vec![at(ENDS[0])];
    let mut half = vec![Vector3::zeros()]; // from the middle line to side 1
    for [one, two] in FACING {
        middle.push((at(one) + at(two)) / 2.0);
        half.push((at(one) - at(two)) / 2.0);
    }
    middle.push(at(ENDS[1]));
    half.push(Vector3::zeros());
    let mut along = vec![0.0];
    for w in middle.windows(2) {
        along.push(along[along.len() - 1] + (w[1] - w[0]).norm());
    }
    let length = along[along.len() - 1];
    let kept = (1.0 - 2.0 * by / length).max(LEAST);
    let moved: Vec<Vector3<f64>> =
        along.iter().map(|a| on_line(&middle, &along, length / 2.0 + (a - length / 2.0) * kept)).collect();
    let mut outline = [Vector3::zeros(); N_OUTLINE];
    for (i, [one, two]) in FACING.into_iter().enumerate() {
        let half = half[i + 1];
        let half = half * (1.0 - by / half.norm()).max(LEAST);
        outline[one] = moved[i + 1] + half;
        outline[two] = moved[i + 1] - half;
    }
    [outline[ENDS[0]], outline[ENDS[1]]] = [moved[0], moved[moved.len() - 1]];
    Station { outline, ..station.clone() }
}

/// The point of a polyline at the arc length `at`; `along`: arc length of its corners.
fn on_line(line: &[Vector3<f64>], along: &[f64], at: f64) -> Vector3<f64> {
    let i = along.partition_point(|a| *a < at).clamp(1, line.len() - 1);
    let length = along[i] - along[i - 1];
    let t = if length > 0.0 { (at - along[i - 1]) / length } else { 0.0 };
    line[i - 1] + (line[i] - line[i - 1]) * t
}
