//! How well a loft fits the surface it was made from.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::End;
use crate::{Loft, MuscleSections, N_OUTLINE};
use fem::geometry::{SearchSurface, SignedDistance};

/// Samples per interval around and along.
const SAMPLES: usize = 4;

/// How well a loft fits its surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Distance of points of the loft to the surface that 95 % of them do not exceed \[m\].
    pub p95: f64,
    /// Largest distance of a point of the loft to the surface \[m\].
    pub largest: f64,
    /// Cosine of the angle between the normal of an end section and the line of centres there, the smaller of the two ends: small
    /// where the muscle ends in a long oblique cut.
    pub end_cosine: f64,
    /// Deepest point of an end section in the bone it is attached to \[m\].
    pub bone_depth: f64,
    /// Volume of the loft \[m³\].
    pub loft_volume: f64,
    /// Volume of the surface \[m³\].
    pub surface_volume: f64,
}

impl Fit {
    /// Good enough to look no further.
    pub fn is_good(&self) -> bool {
        self.p95 <= 2e-3 && self.coverage() >= 0.93 && self.end_cosine >= 0.3 && self.bone_depth <= 2e-3
    }

    /// Volume of the loft over the volume of the surface.
    pub fn coverage(&self) -> f64 {
        self.loft_volume / self.surface_volume
    }

    /// To choose among fits that are not good: what is missing in volume, 20 % per millimetre of distance, and oblique ends.
    pub(super) fn score(&self) -> f64 {
        -(1.0 - self.coverage()).abs()
            - 0.2 * (self.p95 / 1e-3 - 1.0).max(0.0)
            - (0.3 - self.end_cosine).max(0.0)
    }
}

/// Distance of the loft to the surface that 95 % of its points do not exceed \[m\]: at every section, and half-way between any two.
pub(super) fn by_section(sections: &MuscleSections, surface: &SearchSurface) -> (Vec<f64>, Vec<f64>) {
    let loft = Loft::new(sections);
    let around = N_OUTLINE * SAMPLES;
    let off = |s: f64| {
        let distance = |k: usize| {
            let p = loft.point(k as f64 / SAMPLES as f64, s).position;
            surface.nearest(&p).map_or(f64::INFINITY, |found| found.0.distance)
        };
        let mut distances: Vec<f64> = (0..around).map(distance).collect();
        distances.sort_by(f64::total_cmp);
        distances[(around - 1) * 95 / 100]
    };
    let stations = &sections.stations;
    (
        stations.par_iter().map(|station| off(station.s)).collect(),
        stations.par_windows(2).map(|w| off((w[0].s + w[1].s) / 2.0)).collect(),
    )
}

/// Compares the loft of `sections` with the surface.
pub(super) fn measure(sections: &MuscleSections, surface: &SearchSurface, ends: &[End; 2]) -> Fit {
    let loft = Loft::new(sections);
    let around = N_OUTLINE * SAMPLES;
    let s: Vec<f64> = sections
        .stations
        .windows(2)
        .flat_map(|w| (0..SAMPLES).map(move |k| w[0].s + (w[1].s - w[0].s) * k as f64 / SAMPLES as f64))
        .chain([1.0])
        .collect();
    let points: Vec<Vec<Vector3<f64>>> = s
        .iter()
        .map(|&s| (0..around).map(|k| loft.point(k as f64 / SAMPLES as f64, s).position).collect())
        .collect();
    let mut distances: Vec<f64> = points
        .par_iter()
        .flatten()
        .map(|p| surface.nearest(p).map_or(f64::INFINITY, |found| found.0.distance))
        .collect();
    distances.sort_by(f64::total_cmp);
    // Closed by fans over the two ends.
    let origin = points[0][0];
    let volume = |a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>| {
        (a - origin).dot(&(b - origin).cross(&(c - origin))) / 6.0
    };
    let mut loft_volume = 0.0;
    for pair in points.windows(2) {
        for k in 0..around {
            let l = (k + 1) % around;
            loft_volume +=
                volume(&pair[0][k], &pair[0][l], &pair[1][l]) + volume(&pair[0][k], &pair[1][l], &pair[1][k]);
        }
    }
    for (ring, sign) in [(&points[0], -1.0), (&points[points.len() - 1], 1.0)] {
        let middle = ring.iter().sum::<Vector3<f64>>() / around as f64;
        loft_volume +=
            sign * (0..around).map(|k| volume(&middle, &ring[k], &ring[(k + 1) % around])).sum::<f64>();
    }
    let stations = &sections.stations;
    let last = stations.len() - 1;
    let cosine = |end: usize, next: usize| {
        let line = stations[end.max(next)].centre - stations[end.min(next)].centre;
        stations[end].normal.dot(&line) / line.norm()
    };
    Fit {
        bone_depth: (0..2).map(|i| depth(&points[i * (points.len() - 1)], &ends[i])).fold(0.0, f64::max),
        end_cosine: cosine(0, 1).min(cosine(last, last - 1)),
        p95: distances[(distances.len() - 1) * 95 / 100],
        largest: distances[distances.len() - 1],
        loft_volume,
        surface_volume: surface.surface().volume(),
    }
}

/// Deepest point of the section inside an outline in the bone of this end \[m\]; zero without a bone.
fn depth(outline: &[Vector3<f64>], end: &End) -> f64 {
    let End::Bone(bone) = end else { return 0.0 };
    let Ok(signed) = SignedDistance::new(bone) else { return 0.0 };
    let middle = outline.iter().sum::<Vector3<f64>>() / outline.len() as f64;
    let inside = |p: &Vector3<f64>| {
        let at = |f: f64| -signed.at(&(middle + f * (p - middle))).distance;
        [0.25, 0.5, 0.75, 1.0].map(at).into_iter().fold(0.0, f64::max)
    };
    outline.par_iter().map(inside).reduce(|| 0.0, f64::max)
}
