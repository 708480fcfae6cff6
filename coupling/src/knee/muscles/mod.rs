//! The quadriceps as passive tissue between pelvis, femur and patella.

mod heads;
mod lying;
mod state;

use std::collections::BTreeSet;
use std::sync::Arc;

use fem::geometry::{DistanceField, SearchSurface};
use fem::mesh::{CellBlock, CellKind, Mesh, MeshError};
use fem::plan::Term;
use fem::scene::{ContactSpec, EmbeddedSpec, LawSpec, Scene, SolidSpec};
use mesher::MusclePart;
use nalgebra::Isometry3;
use thiserror::Error;

use super::anatomy::BellyFit;
use super::quadriceps::Shaft;
use crate::thigh::tissue::{CONTACT_LAYER, MATRIX, SHELL_SHEAR};
pub use heads::{MUSCLES, RECTUS};
pub use state::MuscleState;

/// Tendon of the quadriceps: Young's modulus \[Pa\] and Poisson's ratio of the study of the deep knee.
const TENDON: [f64; 2] = [30e6, 0.46];
/// Depth \[m\] up to which overlaps of heads are parted, as in the thigh.
const REPAIR: f64 = 2e-3;

/// How fine the heads are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// Edge of a cell \[m\].
    pub edge: f64,
    /// Edge of the cubes \[m\] whose corners move the vasti; `None`: their own nodes do.
    pub cell: Option<f64>,
}

/// The patella that the heads end on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatellaPlace {
    /// From its own frame into that of the femur.
    pub pose: Isometry3<f64>,
    /// How far it goes up from its origin \[m\].
    pub height: f64,
    /// Height \[m\] of its upper edge in the frame of the thigh, as bellies are drawn.
    pub top: f64,
}

/// Where bellies are.
#[derive(Clone, Copy, Debug)]
pub struct BellyPlace<'a> {
    /// From the frame of the thigh into that of the femur.
    pub to_femur: &'a Isometry3<f64>,
    /// The shaft that they are fitted around.
    pub shaft: &'a Shaft,
    /// How.
    pub fit: BellyFit,
}

/// Why there are no such muscles.
#[derive(Debug, Error)]
pub enum MuscleError {
    /// The tables of the thigh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A head would be of cells that cannot be computed with.
    #[error("{muscle} would have cells with a scaled Jacobian of {shape:.2}; mesh it with other edges")]
    Shape {
        /// Its muscle.
        muscle: String,
        /// Least scaled Jacobian.
        shape: f64,
    },
    /// A side starts inside the femur where it does not grow from it.
    #[error(
        "{muscle} is {:.2} mm deep in the femur at ({:.1}, {:.1}, {:.1}) mm where it does not grow from it; mesh it with other edges",
        1e3 * depth, 1e3 * at[0], 1e3 * at[1], 1e3 * at[2]
    )]
    InBone {
        /// Which.
        muscle: String,
        /// Where \[m\], in the frame of the femur.
        at: [f64; 3],
        /// How deep \[m\].
        depth: f64,
    },
}

/// The heads as a part of the mesh of a knee.
pub struct Muscles {
    femur: Arc<DistanceField>,
    /// The femur as triangles, by which is asked whether something goes through it.
    triangles: SearchSurface,
    lying: lying::Lying,
    /// Nodes of the mesh that are held.
    pub held: Vec<u32>,
    /// Nodes of the mesh that are on the patella.
    pub on_patella: Vec<u32>,
    /// Cells of all heads.
    pub n_cells: usize,
}

impl Muscles {
    /// Adds the heads to a mesh and a scene in the frame of the femur, which is given as what they stay off and as triangles.
    pub fn add(
        mesh: &mut Mesh,
        scene: &mut Scene,
        (femur, triangles): (Arc<DistanceField>, SearchSurface),
        bellies: BellyPlace,
        patella: &PatellaPlace,
        resolution: Resolution,
    ) -> Result<Muscles, MuscleError> {
        let heads = heads::heads(&femur, bellies, patella, resolution.edge)?;
        let (mut held, mut on_patella, mut n_cells) = (Vec::new(), Vec::new(), 0);
        let mut lying = lying::Lying::default();
        let [young, nu] = TENDON;
        // Three times the shear modulus: the matrix hardly changes its volume.
        let modulus = CONTACT_LAYER * 3.0 * SHELL_SHEAR;
        for head in &heads {
            let first = mesh.points.len() as u32;
            let moved = |face: [u32; 4]| face.map(|n| n + first);
            mesh.points.extend(&head.block.points);
            let name = &head.block.name;
            let cells: Vec<u32> = head.block.cells().flatten().map(|n| n + first).collect();
            let (belly, tendon) = cells.split_at(8 * head.n_belly_cells());
            let laws = [
                (name.clone(), belly, MATRIX),
                (MusclePart::Tendon.of(name), tendon, LawSpec::NeoHookean { young, nu }),
            ];
            for (region, nodes, law) in laws {
                mesh.blocks.push(CellBlock {
                    name: region.clone(),
                    kind: CellKind::Hex8,
                    nodes: nodes.to_vec(),
                });
                scene.solids.push(SolidSpec::new(&region, law));
            }
            n_cells += head.block.n_cells();
            let surface = head.block.surface().into_iter().map(moved).collect();
            mesh.surfaces.insert(MusclePart::Surface.of(name), surface);
            let own: BTreeSet<u32> = head.held.iter().map(|n| n + first).collect();
            let feet = head.footprint().into_iter().map(|n| n + first);
            on_patella.extend(feet);
            let faces: Vec<[u32; 4]> = head.block.side_faces().into_iter().map(moved).collect();
            lying.add(name, &faces, &mesh.points, &|n| own.contains(&n), (&femur, modulus))?;
            held.extend(own);
            if let Some(cell) = resolution.cell.filter(|_| name != RECTUS) {
                scene.embedded.push(EmbeddedSpec::new(name, cell));
            }
        }
        let surfaces: Vec<String> = MUSCLES.iter().map(|name| MusclePart::Surface.of(name)).collect();
        let names: Vec<&str> = surfaces.iter().map(String::as_str).collect();
        scene.contact =
            Some(ContactSpec { repair: REPAIR, layer: CONTACT_LAYER, ..ContactSpec::new(&names) });
        Ok(Muscles { femur, triangles, lying, held, on_patella, n_cells })
    }

    /// What keeps them off the femur.
    pub fn term(&self) -> Term {
        self.lying.term(&self.femur)
    }

    /// Pairs of triangles of sides and of the femur that intersect (exact), away from what grows from bone, with the nodes at `x` \[m\], 3 per node.
    pub fn through_femur(&self, x: &[f64]) -> usize {
        self.lying.crossings(x, &self.triangles)
    }

    /// Places that stay off the femur, and those beside attachments that take no notice of it.
    pub fn places(&self) -> [usize; 2] {
        [self.lying.n_places(), self.lying.left_out]
    }
}
