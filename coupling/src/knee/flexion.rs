//! A knee bent from pose to pose of its tibia: the patella in equilibrium at each.

use fem::body::Wrench;
use fem::measure::{PairForce, free_bodies, pair_forces};
use fem::run::{DriveFrame, Session};
use fem::solve::{Settings, SolveError};
use nalgebra::{Isometry3, Vector3};

use super::pose::Coordinates;
use super::rigid::RigidKnee;

/// The patella at a pose of the tibia.
#[derive(Clone, Debug)]
pub struct FlexionFrame {
    /// The pose that was asked for.
    pub tibia: Coordinates,
    /// Where the patella is.
    pub patella: Coordinates,
    /// What is left of all forces on it \[N, N·m\], moments about its origin.
    pub residual: Wrench,
    /// Contact of its cartilage; absent where nothing touches.
    pub contact: Option<PairForce>,
    /// Strain of every strand, in the order of [`RigidKnee::strands`].
    pub strains: Vec<f64>,
    /// Iterations of Newton's method.
    pub iterations: usize,
}

impl FlexionFrame {
    /// Turn \[degrees\] and shift \[mm\] of the patella since another frame.
    pub fn step_from(&self, other: &FlexionFrame) -> [f64; 2] {
        let [a, b] = [self, other].map(|f| f.patella.pose());
        let shift = a.translation.vector - b.translation.vector;
        [a.rotation.angle_to(&b.rotation).to_degrees(), 1e3 * shift.norm()]
    }
}

/// Takes the tibia through some poses under a constant force of the quadriceps \[N\], which pulls as the frame before leaves the patella. With
/// an error the frames before it.
pub fn flex(
    knee: &RigidKnee,
    poses: &[Coordinates],
    quadriceps: f64,
    settings: &Settings,
) -> (Vec<FlexionFrame>, Option<SolveError>) {
    let mut frames = Vec::new();
    let mut session = match Session::new(&knee.plan, settings, None) {
        Ok(session) => session,
        Err(error) => return (frames, Some(error)),
    };
    let mut patella = Isometry3::identity();
    for tibia in poses {
        let load = match knee.load(tibia, quadriceps, &patella) {
            Ok(load) => load,
            Err(source) => {
                let error = SolveError::Load { step: frames.len(), source: Box::new(source) };
                return (frames, Some(error));
            }
        };
        let mut advanced = session.advance(&DriveFrame { time: tibia.flexion, load });
        if !advanced.errors.is_empty() {
            return (frames, Some(advanced.errors.remove(0)));
        }
        let at = advanced.frame.snapshot();
        let state = free_bodies(&knee.plan, at).remove(0);
        patella = state.pose;
        frames.push(FlexionFrame {
            tibia: *tibia,
            patella: knee.coordinates(&patella),
            residual: state.residual,
            contact: pair_forces(&knee.plan, at, [0.0; 3]).into_iter().next(),
            strains: strains(knee, at.x),
            iterations: advanced.frame.count(|island| island.iterations),
        });
    }
    (frames, None)
}

/// Strains of all strands with the nodes at `x` \[m\], 3 per node.
fn strains(knee: &RigidKnee, x: &[f64]) -> Vec<f64> {
    let place = |n: u32| Vector3::from_column_slice(&x[3 * n as usize..][..3]);
    let length = |name: &String| {
        let block = knee.plan.mesh.blocks.iter().find(|b| b.name == *name).expect("a block per strand");
        (place(block.nodes[1]) - place(block.nodes[0])).norm()
    };
    knee.strands.iter().map(|(name, slack)| length(name) / slack - 1.0).collect()
}
