//! What the sharing costs and what bounds it: muscle weights, the table of reactions, strengths.

use nalgebra::{DMatrix, DVector};

/// What the muscles can do in a frame. An input of force sharing; only *nominal* where nothing but the rigid leg is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Capacity {
    /// Force at full activation per muscle \[N\], by which its activation is counted.
    pub force_per_activation: Vec<f64>,
    /// Least and greatest tension per muscle \[N\].
    pub bounds: Vec<[f64; 2]>,
    /// Lever arms in place of those of the muscle lines.
    pub lever_arms: Vec<LeverArm>,
}

/// A lever arm in place of that of a muscle line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeverArm {
    /// Joint coordinate, by its number.
    pub coordinate: usize,
    /// Muscle, by its number.
    pub muscle: usize,
    /// Moment over tension \[m\].
    pub arm: f64,
}

impl Capacity {
    /// Tensions up to the maximal isometric forces \[N\], and the lever arms of the muscle lines.
    pub fn nominal(f_max: Vec<f64>) -> Capacity {
        let bounds = f_max.iter().map(|f| [0.0, *f]).collect();
        Capacity { force_per_activation: f_max, bounds, lever_arms: Vec::new() }
    }

    /// Gives the `lines` of a muscle what it can do as a whole: each its lever arms (coordinate and arm \[m\]), and of its least and greatest
    /// tension \[N\] the fraction that its strength is of the strengths of all.
    pub fn give(
        &mut self,
        lines: &[usize],
        strength: impl Fn(usize) -> f64,
        bounds: [f64; 2],
        arms: &[(usize, f64)],
    ) {
        let all: f64 = lines.iter().map(|&i| strength(i)).sum();
        for &muscle in lines {
            let fraction = strength(muscle) / all;
            self.bounds[muscle] = bounds.map(|bound| fraction * bound);
            let arms = arms.iter().map(|&(coordinate, arm)| LeverArm { coordinate, muscle, arm });
            self.lever_arms.extend(arms);
        }
    }

    /// Lever arms \[m\], n_coordinates × n_muscles: those of the muscle lines where nothing else is given.
    pub fn arms(&self, of_lines: &DMatrix<f64>) -> DMatrix<f64> {
        let mut arms = of_lines.clone();
        for given in &self.lever_arms {
            arms[(given.coordinate, given.muscle)] = given.arm;
        }
        arms
    }
}

/// What the tensions cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MuscleCost {
    /// Σ f² \[N²\]: w_f = 1 (Moissenet et al. 2014).
    #[default]
    Force,
    /// Σ (1000 N · a)² with a = f / force per activation: sum of squared activations, in newtons so that
    /// it can stand beside weighted reactions.
    Activation,
    /// The same weighted with muscle volume: Σ V (1000 N · a)², V = force per activation × optimal fibre length,
    /// in units of 1000 N × 0.1 m. Splitting a muscle changes nothing
    /// (Happee & van der Helm, J Biomech 1995;28:1179; Holmberg & Klarbring, Multibody Syst Dyn 2012;28:283).
    Volume,
}

/// What contact, ligament, tendon and bone forces cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReactionCost {
    /// Nothing: muscles only ("condition 1").
    None,
    /// The weights of [`REACTIONS`] ("condition 2").
    #[default]
    Table,
}

/// Tension that counts as one activation in activation-based costs \[N\].
const REFERENCE_FORCE: f64 = 1000.0;
/// Fibre length that counts as one in the volume-weighted cost \[m\].
const REFERENCE_LENGTH: f64 = 0.1;

/// Weights w_f of the squared tensions.
/// `l_opt`: optimal fibre lengths \[m\], read by [`MuscleCost::Volume`] only.
pub fn muscle_weights(cost: MuscleCost, capacity: &Capacity, l_opt: &[f64]) -> DVector<f64> {
    let strength = &capacity.force_per_activation;
    DVector::from_fn(strength.len(), |i, _| match cost {
        MuscleCost::Force => 1.0,
        MuscleCost::Activation => (REFERENCE_FORCE / strength[i]).powi(2),
        // V (1000/F)² with V = F l / (1000 N · 0.1 m)
        MuscleCost::Volume => l_opt[i] / REFERENCE_LENGTH * REFERENCE_FORCE / strength[i],
    })
}

/// One contact, ligament, tendon or bone force: weight and bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reaction {
    /// Name, also of the output column.
    pub name: &'static str,
    /// Weight of the squared force in condition 2.
    pub weight: f64,
    /// Least force \[N\].
    pub lower: f64,
}

const FREE: f64 = f64::NEG_INFINITY;

/// The forces wanted beside the tensions, in the order of the rows of x, with the weights of condition 2 and
/// bounds of the 2018 release of the toolbox to Moissenet et al. 2014. Upper bounds are infinite. The MCL stays
/// unbounded: this knee has no lateral ligament, and a negative MCL stands in for it.
/// The two ankle ligaments (rows 3 and 4) exist with the parallel ankle only; weight and bound are a choice.
pub const REACTIONS: [Reaction; 21] = [
    Reaction { name: "ankle_x", weight: 1.0, lower: FREE },
    Reaction { name: "ankle_y", weight: 1.0, lower: 0.0 },
    Reaction { name: "ankle_z", weight: 1.0, lower: FREE },
    Reaction { name: "tibiocalcaneal", weight: 1.0, lower: 0.0 },
    Reaction { name: "calcaneofibular", weight: 1.0, lower: 0.0 },
    Reaction { name: "knee_medial", weight: 2.0, lower: 0.0 },
    Reaction { name: "knee_lateral", weight: 4.0, lower: 0.0 },
    Reaction { name: "acl", weight: 1e-6, lower: 0.0 },
    Reaction { name: "pcl", weight: 1e-6, lower: 0.0 },
    Reaction { name: "mcl", weight: 1.0, lower: FREE },
    Reaction { name: "patella_x", weight: 1.0, lower: FREE },
    Reaction { name: "patella_y", weight: 1.0, lower: FREE },
    Reaction { name: "patella_z", weight: 1.0, lower: FREE },
    Reaction { name: "patellar_tendon", weight: 1.0, lower: 0.0 },
    Reaction { name: "hip_x", weight: 1.0, lower: FREE },
    Reaction { name: "hip_y", weight: 1.0, lower: 0.0 },
    Reaction { name: "hip_z", weight: 1.0, lower: FREE },
    Reaction { name: "foot_axial", weight: 1.0, lower: FREE },
    Reaction { name: "tibia_axial", weight: 1e-6, lower: 0.0 },
    Reaction { name: "patella_axial", weight: 1.0, lower: FREE },
    Reaction { name: "femur_axial", weight: 1e-6, lower: 0.0 },
];

/// What stands in place of the ligaments where a post and conforming surfaces take shear both ways: as cheap as the cruciate ligaments.
pub const SHEAR: [Reaction; 3] = [
    Reaction { name: "knee_shear_medial", weight: 1e-6, lower: FREE },
    Reaction { name: "knee_shear_lateral", weight: 1e-6, lower: FREE },
    Reaction { name: "knee_shear_z", weight: 1e-6, lower: FREE },
];

/// The rows of x: 21 with the parallel ankle, 19 with the universal one.
pub fn reactions(parallel_ankle: bool) -> Vec<Reaction> {
    let exists = |(row, _): &(usize, Reaction)| parallel_ankle || !(3..5).contains(row);
    REACTIONS.into_iter().enumerate().filter(exists).map(|(_, reaction)| reaction).collect()
}
