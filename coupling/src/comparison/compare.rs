//! The gait steps on the deformable thigh, and its muscle forces beside those of the rigid leg.

use mesher::MusclePart;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fem::body::Pose;
use fem::contact::Mode;
use fem::effect::EffectKind;
use fem::geometry::{SearchSurface, Surface};
use fem::measure::{PairForce, collision_surfaces, pair_forces};
use fem::parts::{Beside, MovingBone};
use fem::plan::{Load, Plan, SceneError};
use fem::run::{Drive, DriveFrame, Frame, Run};
use fem::scene::{FibreLawSpec, FibreSpec};
use mesher::Bone;
use rayon::prelude::*;

use crate::error::CouplingError;
use crate::fibres::thermal_calibration::CalibrationError;
use crate::scene::{StepName, StressFree};
use crate::steps::RigidStep;
use crate::thigh::build::{Thigh, ThighMuscle, segment_of};
use crate::thigh::registration::BODIES;
use crate::thigh::section::belly_force;

/// Force of one muscle through its belly \[N\], tension positive.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct MuscleForce {
    /// All parts.
    pub total: f64,
    /// Fibres.
    pub fibre: f64,
    /// Matrix.
    pub matrix: f64,
    /// Shell.
    pub shell: f64,
}

/// Forces of all muscles at one step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepForces {
    /// Which step.
    pub step: StepName,
    /// Per muscle, in the order of the thigh.
    pub muscles: Vec<MuscleForce>,
}

/// Whether everybody has stayed on its side of everybody else, by lines through the bodies ([`fem::measure::Sides`]).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct KeptSides {
    /// Pairs of bodies that may meet.
    pub pairs: usize,
    /// Guesses of softened contact that were taken: none leads anybody through anybody by that look.
    pub guesses: usize,
    /// Guesses that did, and were thrown away.
    pub wrong_guesses: usize,
    /// Pairs that cross on the straight way from frame to frame, all frames together. None crosses in a guess that was taken, so one has gone round
    /// the other in guarded contact, as far as lines and sheets can tell.
    pub crossed_pairs: usize,
    /// Pairs whose prescribed faces, which nothing can keep apart, intersect in a solved frame and not in the mesh.
    pub prescribed_overlaps: BTreeSet<[String; 2]>,
    /// Distance \[mm\] at which surfaces press in the last frame, its mean weighted with the forces: they press as if they were thicker by
    /// that.
    pub standoff_mm: f64,
}

impl KeptSides {
    fn new(plan: &Plan, run: &Run) -> Option<KeptSides> {
        let contact = plan.contact()?;
        let pressed = run.last().map_or(Vec::new(), |f| pair_forces(plan, f.snapshot(), [0.0; 3]));
        let force = |p: &PairForce| nalgebra::Vector3::from(p.wrench.force).norm();
        let (sum, all) =
            pressed.iter().fold((0.0, 0.0), |(sum, all), p| (sum + force(p) * p.standoff, all + force(p)));
        Some(KeptSides {
            pairs: contact.pairs.iter().filter(|[a, b]| a != b).count(),
            guesses: run.count(|i| i.soft_ways),
            wrong_guesses: run.count(|i| i.wrong_ways),
            crossed_pairs: run.count(|i| i.crossed_pairs),
            prescribed_overlaps: run
                .frames
                .iter()
                .flat_map(|f| &f.prescribed_overlaps)
                .map(|(pair, _)| pair.clone())
                .collect(),
            standoff_mm: if all > 0.0 { 1e3 * sum / all } else { 0.0 },
        })
    }
}

/// One configuration carried through the steps.
pub struct Solution {
    /// What was solved.
    pub plan: Plan,
    /// What was computed.
    pub run: Run,
    /// Forces at the steps that were solved.
    pub steps: Vec<StepForces>,
    /// Pairs of surfaces, bones included, that intersect at a step, by the exact test; with guarded contact there are none.
    pub intersections: Vec<String>,
    /// Volume that muscles share with each other at each solved step \[m³\].
    pub overlaps: Vec<f64>,
    /// Who is where, and how far apart they press; absent without contact.
    pub sides: Option<KeptSides>,
    /// Wall time of the solution.
    pub time: Duration,
    /// Frames on the way to the first step.
    pub on_the_way: usize,
}

impl Solution {
    /// The solved frames at the steps.
    pub fn at_steps(&self) -> impl Iterator<Item = &Frame> {
        self.run.frames.iter().skip(self.on_the_way)
    }
}

/// What is wrong with a comparison before it starts.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A file.
    #[error(transparent)]
    Output(#[from] fem::output::OutputError),
}

impl From<CompareError> for CouplingError {
    fn from(error: CompareError) -> CouplingError {
        match error {
            CompareError::Calibration(e) if e.is_verdict() => CouplingError::NotConverged(e.to_string()),
            bad => CouplingError::Option(bad.to_string()),
        }
    }
}

/// Frames of the drive: with thermal fibres from standing the way to heel strike first, passive; then heel strike and loading response.
/// `controls`: per step the control of
/// every muscle.
pub fn drive(
    plan: &Plan,
    thigh: &Thigh,
    controls: &[Vec<f64>],
    steps: &[RigidStep],
    stress_free: StressFree,
) -> Result<Drive, CompareError> {
    let mut frames = Vec::new();
    let mut push = |time: f64, poses: &[Pose; 4], controls: &[f64]| -> Result<(), CompareError> {
        let load = load(plan, thigh, controls, moves(steps, stress_free, poses))?;
        frames.push(DriveFrame { time, load });
        Ok(())
    };
    if has_passive_way(thigh, stress_free) {
        push(0.5, &steps[0].poses, &vec![0.0; thigh.muscles.len()])?;
    }
    for (i, step) in steps.iter().enumerate() {
        push(1.0 + i as f64, &step.poses, &controls[i])?;
    }
    Ok(Drive { frames })
}

/// The load of the thigh: controls of its muscles, and poses of [`BODIES`] relative to the mesh.
pub fn load(plan: &Plan, thigh: &Thigh, controls: &[f64], moved: [Pose; 4]) -> Result<Load, SceneError> {
    // Without fibres nothing is driven.
    let driven = thigh.muscles.iter().zip(controls).filter(|(m, _)| plan.controls.contains(&m.name));
    let controls: Vec<(&str, f64)> = driven.map(|(m, c)| (m.name.as_str(), *c)).collect();
    let is_in_plan = |(name, _): &(&&str, Pose)| plan.bodies.iter().any(|b| b == **name);
    let moved: Vec<(&str, Pose)> =
        BODIES.iter().zip(moved).filter(is_in_plan).map(|(name, pose)| (*name, pose)).collect();
    plan.load(&controls, &moved)
}

/// Whether the way from standing to the first step is gone passively first. Fibres that pull hold a muscle taut on its way: solved in tens of
/// iterations and not in hundreds.
pub fn has_passive_way(thigh: &Thigh, stress_free: StressFree) -> bool {
    let pulls_on_the_way = |f: &FibreSpec| matches!(f.law, FibreLawSpec::ForceLength { .. });
    stress_free == StressFree::Standing && !thigh.scene.fibres.iter().any(pulls_on_the_way)
}

/// Poses of [`BODIES`] relative to the mesh, whose bones stand where it is free of stress.
pub fn moves(steps: &[RigidStep], stress_free: StressFree, poses: &[Pose; 4]) -> [Pose; 4] {
    let start: [Pose; 4] = match stress_free {
        StressFree::Standing => Default::default(),
        StressFree::HeelStrike => steps[0].poses,
    };
    std::array::from_fn(|b| poses[b] * start[b].inverse())
}

/// What the frames of a [`drive`] show beside the muscles: times of the gait, and the bones, those on the way to the first step included.
pub fn beside(drive: &Drive, steps: &[RigidStep], stress_free: StressFree, bones: &[Bone]) -> Beside {
    // On the way the bones stand as at the first step.
    let on_the_way = drive.frames.len() - steps.len();
    let frames: Vec<&RigidStep> = std::iter::repeat_n(&steps[0], on_the_way).chain(steps).collect();
    let moving = |bone: &Bone| {
        let body = BODIES.iter().position(|body| Some(*body) == segment_of(&bone.name))?;
        let poses = frames.iter().map(|step| moves(steps, stress_free, &step.poses)[body]).collect();
        Some(MovingBone { name: bone.name.clone(), surface: bone.surface.clone(), poses })
    };
    Beside {
        times: frames.iter().map(|step| step.time).collect(),
        bones: bones.iter().filter_map(moving).collect(),
    }
}

/// Force of the rigid leg per muscle of the thigh \[N\].
pub fn wanted(thigh: &Thigh, step: &RigidStep) -> Vec<f64> {
    let force = |name: &str| step.muscle(name).map_or(0.0, |m| m.force().norm());
    thigh.muscles.iter().map(|m| force(&m.name)).collect()
}

/// What is measured on a run through the steps: forces, intersections, overlaps. `passive`: frames on the way to the first step.
pub fn measured(
    plan: Plan,
    thigh: &Thigh,
    run: Run,
    steps: &[RigidStep],
    passive: usize,
    time: Duration,
) -> Solution {
    let at_steps = || run.frames.iter().skip(passive);
    let forces = at_steps().zip(steps).map(|(frame, step)| StepForces {
        step: step.name,
        muscles: thigh.muscles.iter().map(|muscle| muscle_force(&plan, frame, muscle)).collect(),
    });
    let forces = forces.collect();
    let mut intersections = Vec::new();
    let mut overlaps = Vec::new();
    for frame in at_steps() {
        let skins = skins(&plan, thigh, frame);
        let pairs: Vec<(usize, usize)> =
            (0..skins.len()).flat_map(|a| (a + 1..skins.len()).map(move |b| (a, b))).collect();
        let shared: Vec<f64> = pairs
            .par_iter()
            .filter(|&&(a, b)| !skins[a].intersections(&skins[b]).is_empty())
            .map(|&(a, b)| {
                let overlap = fem::geometry::overlap::overlap(&skins[a], &skins[b], OVERLAP_SPACING);
                overlap.map_or(f64::NAN, |o| o.volume)
            })
            .collect();
        overlaps.push(shared.iter().fold(0.0, |sum, v| sum + v));
        if plan.islands.iter().filter_map(|i| i.contact.as_ref()).any(|c| c.mode == Mode::Cheap) {
            continue; // cheap contact penetrates, and says how deep
        }
        for ([a, b], n) in fem::measure::intersections(&plan, frame.snapshot()) {
            intersections.push(format!("{a} and {b}: {n} pairs of triangles"));
        }
    }
    let sides = KeptSides::new(&plan, &run);
    Solution { plan, run, steps: forces, intersections, overlaps, sides, time, on_the_way: passive }
}

/// Lines along which shared volume is measured are this far apart \[m\].
const OVERLAP_SPACING: f64 = 1e-3;

/// Surfaces of the muscles in a frame: as contact sees them where there is contact.
fn skins(plan: &Plan, thigh: &Thigh, frame: &Frame) -> Vec<SearchSurface> {
    let mut touching: BTreeMap<String, Surface> =
        collision_surfaces(plan, frame.snapshot()).into_iter().collect();
    let points: Vec<[f64; 3]> = frame.x.as_chunks::<3>().0.to_vec();
    let mut skin = |m: &ThighMuscle| {
        let name = MusclePart::Surface.of(&m.name);
        let of_mesh = || Surface::from_faces(&points, &thigh.mesh.surfaces[&name]).0;
        SearchSurface::new(touching.remove(&name).unwrap_or_else(of_mesh))
    };
    thigh.muscles.iter().map(&mut skin).collect()
}

/// Force of a muscle through its belly.
pub fn muscle_force(plan: &Plan, frame: &Frame, muscle: &ThighMuscle) -> MuscleForce {
    let belly = belly_force(plan, frame.snapshot(), muscle);
    let of = |kind| belly.section.along_of(kind, belly.tangent.into());
    MuscleForce {
        total: belly.along(),
        fibre: of(EffectKind::Fibre),
        matrix: of(EffectKind::Matrix),
        shell: of(EffectKind::Membrane),
    }
}

#[cfg(test)]
mod tests {
    use super::CompareError;
    use crate::error::CouplingError;
    use crate::fibres::thermal_calibration::CalibrationError;

    #[test]
    fn a_muscle_too_weak_is_no_bad_input() {
        let weak = CalibrationError::TooWeak {
            muscle: "gracilis".into(),
            wanted: 9.0,
            reached: 1.0,
            contraction: 0.1,
        };
        assert_eq!(CouplingError::from(CompareError::from(weak)).exit_code(), 3);
        let bad = fem::plan::SceneError::Count {
            user: "fibre `x`".into(),
            quantity: "areas",
            found: 2,
            needed: "1".into(),
        };
        assert_eq!(CouplingError::from(CompareError::from(bad)).exit_code(), 2);
    }
}
