//! How sure joint forces are: a trial computed many times with landmarks, strengths, masses, markers and costs that scatter as they do between
//! measurements and people; bands of the knee forces, and which input their scatter comes from.
//!
//! Sobol indices by Saltelli's design: two independent sets of inputs A and B, and for each group of inputs the set A with that group of B. First-order
//! indices after Jansen, total ones after Jansen (Saltelli et al., Comput Phys Commun 2010;181:259). Every other frame is computed.

#![allow(non_snake_case)]

use multibody::loads::loads;
use multibody::motion::track;
use multibody::natural::SegmentId;
use multibody::share::share_each;
use multibody::trial::{Status, Table, Trial};
use nalgebra::{DMatrix, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use crate::error::CouplingError;
use crate::optimize::{Case, Known, OptimizeOptions, model_of};

/// Groups of inputs that scatter together.
pub const GROUPS: [&str; 5] = ["landmarks", "strengths", "masses", "markers", "weights"];
/// Quantities whose indices are computed: largest force of the compartments and of both.
pub const PEAKS: [&str; 3] = ["knee_medial", "knee_lateral", "knee_total"];
/// Fewest computations: ten of each of the seven sets.
pub const LEAST: usize = 70;

/// Standard deviation of the hip centre per axis \[m\]: mean error of the rule is some 8 mm in space (Harrington et al. 2007).
const HIP: f64 = 0.005;
/// Of the knee and ankle centres per axis \[m\]: spread of the patella's distance in the recordings of DM, and of the skin.
const JOINTS: f64 = 0.004;
/// Of the logarithm of a muscle's strength: between people some 20 to 36 % (Montefiori et al. 2020).
const STRENGTH: f64 = 0.2;
/// Of the logarithm of a segment's mass: tables of fractions differ by some 5 %.
const MASS: f64 = 0.05;
/// Of a marker coordinate in a frame \[m\]: what clusters on skin change their shape by.
const MARKER: f64 = 0.002;
/// Of the logarithm of the strength by which the cost counts a muscle: as for strength itself.
const WEIGHT: f64 = 0.2;
/// Every how many frames one is computed.
const STRIDE: usize = 2;
/// Ends of the bands: nineteen of twenty samples lie within.
const TAILS: [f64; 2] = [0.025, 0.975];

/// What came of the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Computations.
    pub n: usize,
    /// Frames without solution, over all computations.
    pub unsolved: usize,
    /// Largest forces \[N\] of each independent computation (sets A and B), in the order of [`PEAKS`].
    pub peaks: Vec<[f64; 3]>,
    /// Times of the frames that were computed \[s\].
    pub time: Vec<f64>,
    /// Columns `knee_medial_low`, `knee_medial_high` and so on \[N\], over the independent computations.
    pub bands: Table,
    /// Indices.
    pub indices: Vec<Index>,
}

/// Which part of the scatter of a quantity comes from a group of inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Index {
    /// One of [`PEAKS`].
    pub quantity: &'static str,
    /// One of [`GROUPS`].
    pub group: &'static str,
    /// By itself, and its standard error.
    pub first: [f64; 2],
    /// With all that it does together with others, and its standard error.
    pub total: [f64; 2],
}

/// Where the random numbers of a group start, so that groups can be exchanged.
#[derive(Clone, Copy)]
struct Seeds([u64; 5]);

/// One computation: curves of the compartments and frames without solution.
struct Run {
    medial: Vec<f64>,
    lateral: Vec<f64>,
    unsolved: usize,
}

/// Computes `case` at least `n` times (rounded up to a multiple of seven); `n` is at least [`LEAST`].
pub fn samples(case: &Case, options: &OptimizeOptions, n: usize) -> Result<Samples, CouplingError> {
    let base = n.max(LEAST).div_ceil(GROUPS.len() + 2);
    let sparse = thinned(case);
    let of = |row: usize, set: u64| -> [u64; 5] {
        std::array::from_fn(|group| (((row as u64) << 8) | (set << 4) | group as u64) + 1)
    };
    let mut wanted = Vec::new();
    for row in 0..base {
        let (a, b) = (of(row, 0), of(row, 1));
        wanted.push(Seeds(a));
        wanted.push(Seeds(b));
        for group in 0..GROUPS.len() {
            let mut mixed = a;
            mixed[group] = b[group];
            wanted.push(Seeds(mixed));
        }
    }
    let runs: Vec<Run> =
        wanted.par_iter().map(|seeds| run(&sparse, options, seeds)).collect::<Result<_, _>>()?;
    let width = GROUPS.len() + 2;
    let peaks: Vec<[f64; 3]> = runs.iter().map(Run::peaks).collect();
    let independent: Vec<&Run> =
        runs.iter().enumerate().filter(|(k, _)| k % width < 2).map(|(_, r)| r).collect();
    let time: Vec<f64> = sparse.trial.report.clone().map(|k| sparse.trial.time[k]).collect();
    Ok(Samples {
        n: runs.len(),
        unsolved: runs.iter().map(|r| r.unsolved).sum(),
        bands: bands(&independent, time.len()),
        indices: indices(&peaks, base),
        peaks: peaks.chunks(width).flat_map(|set| [set[0], set[1]]).collect(),
        time,
    })
}

/// Every other frame of the trial.
fn thinned(case: &Case) -> Case {
    let Trial { report, .. } = &case.trial;
    let first = report.start % STRIDE;
    let mut thin = case.clone();
    let keep = |k: usize| first + STRIDE * k < case.trial.time.len();
    let frames: Vec<usize> = (0..).take_while(|&k| keep(k)).map(|k| first + STRIDE * k).collect();
    thin.trial.time = frames.iter().map(|&k| case.trial.time[k]).collect();
    for track in &mut thin.trial.markers {
        track.position = frames.iter().map(|&k| track.position[k]).collect();
    }
    let start = (report.start - first) / STRIDE;
    thin.trial.report = start..start + report.len().div_ceil(STRIDE);
    thin
}

/// Standard normal numbers of a group.
fn normals(seed: u64) -> impl FnMut() -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || StandardNormal.sample(&mut random)
}

fn run(case: &Case, options: &OptimizeOptions, seeds: &Seeds) -> Result<Run, CouplingError> {
    let [landmarks, strengths, masses, markers, weights] = seeds.0.map(normals);
    let (mut landmarks, mut strengths, mut masses) = (landmarks, strengths, masses);
    let (mut markers, mut weights) = (markers, weights);
    let mut case = case.clone();
    let mut shift = |size: f64| size * Vector3::from_fn(|_, _| landmarks());
    let (hip, knee, ankle) = (shift(HIP), shift(JOINTS), shift(JOINTS));
    move_centres(&mut case, &hip, &knee, &ankle);
    for position in case.trial.markers.iter_mut().flat_map(|t| &mut t.position).flatten() {
        *position += MARKER * Vector3::from_fn(|_, _| markers());
    }
    let mut model = model_of(&case, options)?;
    for inertia in &mut model.inertia {
        let factor = (MASS * masses()).exp();
        inertia.mass *= factor;
        inertia.tensor *= factor;
        inertia.G *= factor;
    }
    let motion = track(&model, &case.trial, &case.filters);
    let mut loads = loads(&model, &motion, &case.trial, &case.filters);
    let mut known = Known::new(&model, &motion, &mut loads, case.is_cycle, options)?;
    let stronger: Vec<f64> = model.muscles.iter().map(|_| (STRENGTH * strengths()).exp()).collect();
    let counted: Vec<f64> = model.muscles.iter().map(|_| (WEIGHT * weights()).exp()).collect();
    for capacity in &mut known.capacities {
        for m in 0..model.muscles.len() {
            let [least, greatest] = &mut capacity.bounds[m];
            *greatest = (*greatest * stronger[m]).max(*least);
            capacity.force_per_activation[m] *= counted[m];
        }
    }
    let effort = share_each(&model, &motion, &loads, |k| known.capacity(k), &options.sharing)?;
    let column = |name: &str| effort.reactions.column(name).expect("a force of every knee");
    Ok(Run {
        medial: column("knee_medial"),
        lateral: column("knee_lateral"),
        unsolved: effort.verdicts.iter().filter(|v| v.status != Status::Solved).count(),
    })
}

/// Moves the joint centres by shifts \[m\] in axes of the proximal cluster, the same in both segments of a joint.
fn move_centres(case: &mut Case, hip: &Vector3<f64>, knee: &Vector3<f64>, ankle: &Vector3<f64>) {
    let middle = case.trial.report.start + case.trial.report.len() / 2;
    let anatomy = &mut case.anatomy;
    let pose = |s: SegmentId| anatomy.clusters[s.index()].pose(&case.trial, s, middle).map(|X| X.R);
    let (thigh, shank, foot) = (pose(SegmentId::Thigh), pose(SegmentId::Shank), pose(SegmentId::Foot));
    anatomy.pelvis.hip += hip;
    anatomy.thigh.knee += knee;
    anatomy.shank.ankle += ankle;
    if let (Some(thigh), Some(shank)) = (thigh, shank) {
        anatomy.shank.knee += shank.transpose() * (thigh * knee);
    }
    if let (Some(shank), Some(foot)) = (shank, foot) {
        anatomy.foot.ankle += foot.transpose() * (shank * ankle);
    }
}

impl Run {
    fn total(&self, k: usize) -> f64 {
        self.medial[k] + self.lateral[k]
    }

    fn curve(&self, quantity: usize, k: usize) -> f64 {
        [self.medial[k], self.lateral[k], self.total(k)][quantity]
    }

    /// Largest values over the solved frames.
    fn peaks(&self) -> [f64; 3] {
        std::array::from_fn(|q| (0..self.medial.len()).map(|k| self.curve(q, k)).fold(f64::NAN, f64::max))
    }
}

/// Nineteen of twenty of the solved samples, frame by frame.
fn bands(runs: &[&Run], n_frames: usize) -> Table {
    let columns = PEAKS.iter().flat_map(|name| ["low", "high"].map(|end| format!("{name}_{end}"))).collect();
    let mut values = DMatrix::from_element(n_frames, 2 * PEAKS.len(), f64::NAN);
    for q in 0..PEAKS.len() {
        for k in 0..n_frames {
            let mut all: Vec<f64> = runs.iter().map(|r| r.curve(q, k)).filter(|v| v.is_finite()).collect();
            all.sort_by(f64::total_cmp);
            for (end, tail) in TAILS.iter().enumerate() {
                if !all.is_empty() {
                    values[(k, 2 * q + end)] = all[(tail * (all.len() - 1) as f64).round() as usize];
                }
            }
        }
    }
    Table { columns, values }
}

/// Jansen's estimators with the standard errors of their means.
fn indices(peaks: &[[f64; 3]], base: usize) -> Vec<Index> {
    let width = GROUPS.len() + 2;
    let mut all = Vec::new();
    for (q, &quantity) in PEAKS.iter().enumerate() {
        let at = |row: usize, set: usize| peaks[width * row + set][q];
        let rows: Vec<usize> =
            (0..base).filter(|&row| (0..width).all(|set| at(row, set).is_finite())).collect();
        let outer: Vec<f64> = rows.iter().flat_map(|&row| [at(row, 0), at(row, 1)]).collect();
        let middle = mean(&outer);
        let variance = mean(&outer.iter().map(|v| (v - middle).powi(2)).collect::<Vec<_>>());
        for (group, &name) in GROUPS.iter().enumerate() {
            let halves = |set: usize| -> [f64; 2] {
                let squares: Vec<f64> =
                    rows.iter().map(|&row| 0.5 * (at(row, set) - at(row, 2 + group)).powi(2)).collect();
                mean_and_error(&squares).map(|v| v / variance)
            };
            let (own, others) = (halves(0), halves(1));
            all.push(Index { quantity, group: name, first: [1.0 - others[0], others[1]], total: own });
        }
    }
    all
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Mean and its standard error.
fn mean_and_error(values: &[f64]) -> [f64; 2] {
    let middle = mean(values);
    let n = values.len().max(2) as f64;
    let variance = values.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (n - 1.0);
    [middle, (variance / n).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f = 3 x₁ + 4 x₂ + x₃ x₄ of standard normal inputs: variance 9 + 16 + 1; the product has no first-order part.
    #[test]
    fn indices_of_a_known_function_are_found() {
        let base = 20_000;
        let mut peaks = Vec::new();
        for row in 0..base {
            let mut draw = normals(row as u64);
            let a: [f64; 5] = std::array::from_fn(|_| draw());
            let b: [f64; 5] = std::array::from_fn(|_| draw());
            let f = |x: &[f64; 5]| 3.0 * x[0] + 4.0 * x[1] + x[2] * x[3];
            peaks.push([f(&a); 3]);
            peaks.push([f(&b); 3]);
            for group in 0..5 {
                let mut mixed = a;
                mixed[group] = b[group];
                peaks.push([f(&mixed); 3]);
            }
        }
        let found = indices(&peaks, base);
        let wanted = [(9.0, 9.0), (16.0, 16.0), (0.0, 1.0), (0.0, 1.0), (0.0, 0.0)];
        for (index, (first, total)) in found.iter().zip(wanted) {
            let near =
                |[value, error]: [f64; 2], want: f64| (value - want / 26.0).abs() < 4.0 * error + 1e-12;
            assert!(near(index.first, first) && near(index.total, total), "{index:?}");
            assert!(index.first[1] < 0.02);
        }
    }
}
