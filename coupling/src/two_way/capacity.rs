//! What the muscles of the deformable thigh can do at a step, in the terms of force sharing: bounds of their tensions and lever arms.
//!
//! The tissue of a muscle pulls at the bones that it is tied to, and in contact presses on others. The virtual work of these forces per joint coordinate is the moment of
//! the muscle; over the force through its belly it is its lever arm, to be held against those of the lines of the rigid leg.
//!
//! Bones move relative to the femur: the forces of what is in equilibrium add up to nothing, so its work is the same as with the pelvis
//! held. But then the moment about the hip is that of the forces on the pelvis, which no other muscle shares. At the knee, muscles that
//! are sewn together pull at the patella with what seams pass from head to head, so the work there says nothing about one head, only
//! about all of them: they are one [unit](sewn), whose moment is shared out by [`as_units`].

#![allow(non_snake_case)]

use fem::body::Wrench;
use fem::effect::EffectKind;
use fem::measure::{PairForce, Snapshot, nodal_forces, pair_forces};
use fem::plan::Plan;
use mesher::part::{MusclePart, body_of, muscle_of};
use multibody::model::Model;
use multibody::natural::{Coordinates, SegmentId};
use nalgebra::{DMatrix, DVector, Vector3};

use crate::fibres::muscle_unit::MuscleUnit;
use crate::thigh::build::{Thigh, segment_of};
use crate::thigh::registration::{BODIES, Registration};
use crate::thigh::section::belly_force;

/// Below this force \[N\] moment over force says nothing about a lever arm.
const LEAST_FORCE: f64 = 20.0;
/// Bounds of a tension are at least this far apart \[N\]: a muscle that can do next to nothing is held, but not by two equal bounds.
const ROOM: f64 = 1.0;
/// Step of the difference quotient along the natural coordinates \[rad\].
const STEP: f64 = 1e-6;

/// How the bones of the thigh move with the joint coordinates, the femur held.
pub struct VirtualTwists {
    /// Per body of the scene (pelvis, patella, shank): its name, and per coordinate the velocity of its point at the hip centre \[m/rad\]
    /// and its angular velocity, in the frame of the mesh.
    bodies: Vec<(&'static str, Vec<[Vector3<f64>; 2]>)>,
    /// Hip centre in the mesh \[m\].
    hip: Vector3<f64>,
}

impl VirtualTwists {
    /// `tangent`: dQ/dq of the leg ([`multibody::equilibrium::Equilibrium::tangent`]).
    pub fn new(
        model: &Model,
        registration: &Registration,
        Q: &Coordinates,
        tangent: &DMatrix<f64>,
    ) -> VirtualTwists {
        let hip = model.pose(SegmentId::Thigh, Q).p;
        // With the pelvis held, as the coordinates have it.
        let twist = |segment: SegmentId, c: usize| {
            let moved = |h: f64| {
                let mut Q = *Q;
                (0..tangent.nrows()).for_each(|i| Q[i] += h * tangent[(i, c)]);
                model.pose(segment, &Q)
            };
            let (here, ahead, behind) = (model.pose(segment, Q), moved(STEP), moved(-STEP));
            let local = here.R.transpose() * (hip - here.p);
            let velocity = (ahead.R * local + ahead.p - behind.R * local - behind.p) / (2.0 * STEP);
            let spin = (ahead.R - behind.R) / (2.0 * STEP) * here.R.transpose();
            let omega = 0.5
                * Vector3::new(
                    spin[(2, 1)] - spin[(1, 2)],
                    spin[(0, 2)] - spin[(2, 0)],
                    spin[(1, 0)] - spin[(0, 1)],
                );
            [velocity, omega].map(|v| registration.direction(model, Q, &v))
        };
        let femur: Vec<_> = (0..tangent.ncols()).map(|c| twist(SegmentId::Thigh, c)).collect();
        let relative = |segment: SegmentId| {
            let minus = |(c, femur): (usize, &[Vector3<f64>; 2])| {
                let [v, w] = twist(segment, c);
                [v - femur[0], w - femur[1]]
            };
            femur.iter().enumerate().map(minus).collect()
        };
        let bodies = vec![
            ("pelvis", femur.iter().map(|[v, w]| [-v, -w]).collect()),
            ("patella", relative(SegmentId::Patella)),
            ("shank", relative(SegmentId::Shank)),
        ];
        VirtualTwists { bodies, hip: registration.frames().hip }
    }

    /// Twists of the bones about the hip centre of the mesh \[m\], femur held: per bone of [`BODIES`], per coordinate, velocity
    /// \[m/rad\] and angular velocity, in the frame of the mesh.
    pub fn given(twists: &BoneTwists, hip: Vector3<f64>) -> VirtualTwists {
        let of_bone = |(body, of): (&&'static str, &[[f64; 6]; MOVED])| {
            let two = |t: &[f64; 6]| [Vector3::new(t[0], t[1], t[2]), Vector3::new(t[3], t[4], t[5])];
            (*body, of.iter().map(two).collect())
        };
        let moving = BODIES.iter().zip(twists).filter(|(body, _)| **body != "thigh");
        VirtualTwists { bodies: moving.map(of_bone).collect(), hip }
    }

    /// The same, told.
    pub fn told(&self) -> BoneTwists {
        let of_bone = |body: &str| {
            let twists = self.bodies.iter().find(|b| b.0 == body).map(|b| &b.1);
            let one = |c: usize| twists.map_or([0.0; 6], |t| std::array::from_fn(|i| t[c][i / 3][i % 3]));
            std::array::from_fn(one)
        };
        BODIES.map(of_bone)
    }

    /// Virtual work \[N·m/rad\] per coordinate of a wrench on a body, moments about the hip centre; none on the femur, which is held.
    pub fn work(&self, body: &str, wrench: &Wrench) -> DVector<f64> {
        let n = self.bodies[0].1.len();
        let Some((_, twists)) = self.bodies.iter().find(|b| b.0 == body) else { return DVector::zeros(n) };
        let (force, moment) = (Vector3::from(wrench.force), Vector3::from(wrench.moment));
        DVector::from_iterator(n, twists.iter().map(|[v, omega]| v.dot(&force) + omega.dot(&moment)))
    }
}

/// Joint coordinates that muscles of the thigh move: three of the hip, one of the knee.
pub const MOVED: usize = 4;
/// Per bone of [`BODIES`] and joint coordinate a twist: velocity of its point at the hip centre of the mesh, and angular velocity.
pub type BoneTwists = [[[f64; 6]; MOVED]; BODIES.len()];
/// Their names.
pub const COORDINATES: [&str; MOVED] = ["hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion"];

/// What force sharing counts on a muscle of the thigh for, at a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MuscleCapacity {
    /// Its lines are longer by this than in the posture of the mesh \[m\].
    pub shift: f64,
    /// Force of its matrix and shell \[N\].
    pub tissue: f64,
    /// How much of the tension of its fibres comes through the belly, as a factor.
    pub through_belly: f64,
    /// Lever arms about the [`COORDINATES`] \[m\].
    pub lever_arms: [f64; MOVED],
}

impl MuscleCapacity {
    /// Its numbers.
    pub const N: usize = 3 + MOVED;
    /// Changes that count alike: of lengths \[m\], of forces \[N\], of the factor, of lever arms \[m\].
    const LENGTH: f64 = 0.01;
    const FORCE: f64 = 100.0;
    const FACTOR: f64 = 0.1;
    const ARM: f64 = 0.01;

    /// As numbers that count alike, the factor from one on.
    pub fn scaled(&self) -> [f64; Self::N] {
        std::array::from_fn(|i| match i {
            0 => self.shift / Self::LENGTH,
            1 => self.tissue / Self::FORCE,
            2 => (self.through_belly - 1.0) / Self::FACTOR,
            arm => self.lever_arms[arm - 3] / Self::ARM,
        })
    }

    /// From these numbers.
    pub fn of_scaled(x: &[f64]) -> MuscleCapacity {
        MuscleCapacity {
            shift: Self::LENGTH * x[0],
            tissue: Self::FORCE * x[1],
            through_belly: 1.0 + Self::FACTOR * x[2],
            lever_arms: std::array::from_fn(|c| Self::ARM * x[3 + c]),
        }
    }

    /// What a number is.
    pub fn quantity(number: usize) -> String {
        match number {
            0 => "length".into(),
            1 => "tissue".into(),
            2 => "fraction".into(),
            arm => COORDINATES[arm - 3].replace('_', " "),
        }
    }

    /// Least and greatest tension \[N\] of a muscle whose fibres are `unit`: at rest and fully active.
    pub fn bounds(&self, unit: &MuscleUnit) -> [f64; 2] {
        let bound = |a: f64| (self.through_belly * unit.force(self.shift, a) + self.tissue).max(0.0);
        let (least, most) = (bound(0.0), bound(1.0));
        [least, most.max(least + ROOM)]
    }

    /// The isometric activation at which it pulls with `tension` \[N\].
    pub fn drive(&self, unit: &MuscleUnit, tension: f64) -> f64 {
        unit.drive_for(self.shift, (tension - self.tissue) / self.through_belly)
    }
}

/// What a muscle does to the skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleAction {
    /// Force through its belly \[N\].
    pub force: f64,
    /// Fraction of matrix and shell in it \[N\].
    pub tissue: f64,
    /// Mean stretch of its fibres.
    pub stretch: f64,
    /// Moment per joint coordinate \[N·m\].
    pub moments: DVector<f64>,
    /// Lever arm per joint coordinate \[m\]; `None` where there is hardly any force to say it.
    pub lever_arms: Vec<Option<f64>>,
    /// Resultant of its forces on all bones \[N\]: nothing, but for what contact and the seams of its tendon carry.
    pub resultant: Vector3<f64>,
}

/// Actions of all muscles of the thigh in a solved state, by what they are tied to.
pub fn actions(plan: &Plan, thigh: &Thigh, at: Snapshot, twists: &VirtualTwists) -> Vec<MuscleAction> {
    let g = nodal_forces(plan, at);
    let presses = pair_forces(plan, at, twists.hip.into());
    let one = |(i, muscle): (usize, &crate::thigh::build::ThighMuscle)| {
        let mut moments = DVector::zeros(twists.bodies[0].1.len());
        let mut resultant = Vector3::zeros();
        for tie in thigh.scene.ties.iter().filter(|t| muscle_of(&t.nodes) == muscle.name) {
            let mut wrench = Wrench::default();
            for &n in &plan.mesh.node_sets[&tie.nodes] {
                let k = 3 * n as usize;
                // The bone holds the node with g, so the tissue pulls at the bone with −g.
                wrench.add(
                    std::array::from_fn(|c| at.x[k + c] - twists.hip[c]),
                    std::array::from_fn(|c| -g[k + c]),
                );
            }
            moments += twists.work(&tie.body, &wrench);
            resultant += Vector3::from(wrench.force);
        }
        for (body, wrench) in presses.iter().filter_map(|pair| pressed_bone(&muscle.name, pair)) {
            moments += &twists.work(body, &wrench);
        }
        let belly = belly_force(plan, at, muscle);
        let of = |kind| belly.section.along_of(kind, belly.tangent.into());
        let force = belly.along();
        MuscleAction {
            force,
            tissue: of(EffectKind::Matrix) + of(EffectKind::Membrane),
            stretch: thigh.fibre_stretch(i, at.x),
            lever_arms: moments.iter().map(|m| (force >= LEAST_FORCE).then(|| m / force)).collect(),
            moments,
            resultant,
        }
    };
    thigh.muscles.iter().enumerate().map(one).collect()
}

/// The bone on which a muscle presses in a pair in contact, as a body of the scene, and the wrench on it; `None` where it is another pair.
/// Muscles that press on each other do nothing to bones by that.
fn pressed_bone(muscle: &str, pair: &PairForce) -> Option<(&'static str, Wrench)> {
    let surface = MusclePart::Surface.of(muscle);
    let [first, second] = &pair.names;
    if *second == surface {
        return Some((segment_of(body_of(first))?, pair.wrench));
    }
    let Wrench { force, moment } = pair.wrench;
    let on_second = Wrench { force: force.map(|c| -c), moment: moment.map(|c| -c) };
    (*first == surface).then_some((segment_of(body_of(second))?, on_second))
}

/// Muscles of the thigh that are sewn together, by number: those that the plan, without contact, has in one island. Every muscle is in one
/// unit, most of them alone.
pub fn sewn(plan: &Plan, thigh: &Thigh) -> Vec<Vec<usize>> {
    let island_of = |m: usize| {
        let muscle = &thigh.muscles[m];
        let middle = muscle.layer_nodes(muscle.s.len() / 2);
        plan.islands.iter().position(|i| middle.clone().any(|n| i.nodes.contains(&n)))
    };
    let mut units: Vec<(Option<usize>, Vec<usize>)> = Vec::new();
    for m in 0..thigh.muscles.len() {
        let island = island_of(m);
        match units.iter_mut().find(|u| island.is_some() && u.0 == island) {
            Some(unit) => unit.1.push(m),
            None => units.push((island, vec![m])),
        }
    }
    units.into_iter().map(|u| u.1).collect()
}

/// Makes one of the muscles of every unit about a coordinate: the moment of the unit stays what it is, and each head has a fraction of it.
///
/// `rigid`: lever arm of a muscle on the rigid leg \[m\]. The unit tells one number, by how much the arm of its whole force differs from what
/// the rigid leg says of these forces; all its heads have this difference, slack ones too. So lines of the rigid leg keep their arms, and a
/// muscle by itself keeps its moment over its force.
pub fn as_units(
    actions: &mut [MuscleAction],
    units: &[Vec<usize>],
    coordinate: usize,
    rigid: &dyn Fn(usize) -> f64,
) {
    for unit in units.iter().filter(|u| u.len() > 1) {
        let sum = |of: &dyn Fn(usize) -> f64| unit.iter().map(|&m| of(m)).sum::<f64>();
        let force = sum(&|m| actions[m].force);
        if force < LEAST_FORCE {
            continue;
        }
        let difference =
            (sum(&|m| actions[m].moments[coordinate]) - sum(&|m| rigid(m) * actions[m].force)) / force;
        for &m in unit {
            let arm = rigid(m) + difference;
            actions[m].moments[coordinate] = arm * actions[m].force;
            actions[m].lever_arms[coordinate] = Some(arm);
        }
    }
}
