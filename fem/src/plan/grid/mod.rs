//! Regions embedded in grids: the nodes of a solid as fixed means of those of a coarse grid of cubes.
//!
//! The mesh stays the interpolation: every free node is a trilinear mean of the eight corners of the cube in which it lies, every node of which
//! something is prescribed stays what it is, and whatever acts on the mesh goes on acting on its nodes. So displacements are a subspace of
//! those of the mesh that holds every linear one, beside what is held too: the solution is the best of this subspace, stiffer than the mesh
//! by itself and never wrong about a uniform strain.
//!
//! - What of the region hangs together in a cube is a *piece* of it, with corners of its own, which it shares with pieces of other
//!   cubes that it is joined to (`pieces.rs`; virtual nodes: Molino, Bao & Fedkiw, ACM Trans. Graph. 23, 385, 2004).
//! - A corner that no well filled cube holds is the extrapolation of a well filled one nearby (`filling.rs`; aggregates: Badia, Verdugo &
//!   Martín, Comput. Methods Appl. Mech. Eng. 336, 533, 2018).
//! - Elements of a piece have one dilatation (`clusters.rs`): the corners of a cube cannot keep the volume of each.

#![allow(non_snake_case)]

mod clusters;
mod filling;
mod lattice;
mod pieces;

pub use clusters::Clusters;

use super::SceneError;
use super::error::{Mistakes, nearest};
use super::load::{Mean, Motion, Motions};
use super::slide::Slide;
use super::term::{cells_of, check};
use crate::mesh::{CellBlock, Mesh};
use crate::scene::{EmbeddedSpec, Scene};
use lattice::Lattice;
use pieces::Pieces;

/// A region whose nodes are means of those of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct EmbeddedRegion {
    /// The region.
    pub region: String,
    /// Edge of a cube \[m\].
    pub cell: f64,
    /// Its nodes that are means of nodes of the grid.
    pub n_embedded: usize,
    /// Nodes of the grid in the mesh of the plan.
    pub nodes: std::ops::Range<u32>,
    /// Pieces of cubes that hold nodes of it.
    pub n_pieces: usize,
    /// Centres \[m\] of the cubes in which it is in more pieces than one.
    pub divided: Vec<[f64; 3]>,
    /// Pieces too small to hold corners that they need, which are extrapolated from others.
    pub n_badly_filled: usize,
}

/// Regions of a scene in grids.
#[derive(Default)]
pub struct Embedding {
    /// Means.
    pub means: Vec<Mean>,
    /// Node of the mesh that is each of them.
    pub nodes: Vec<u32>,
    /// What was made of each region.
    pub regions: Vec<EmbeddedRegion>,
    clusters: Vec<Clusters>,
}

impl Embedding {
    /// The elements of a region in clusters; `None` where it is in no grid.
    pub fn clusters_of(&self, region: &str) -> Option<&Clusters> {
        let at = self.regions.iter().position(|r| r.region == region)?;
        Some(&self.clusters[at])
    }
}

/// Puts the regions of a scene into grids, whose nodes are added to the mesh; the first mistake of each is named.
pub fn embed(
    scene: &Scene,
    mesh: &mut Mesh,
    motion: &[[Motion; 3]],
    slides: &[Slide],
) -> Result<Embedding, SceneError> {
    let mut mistakes = Mistakes::default();
    let mut embedding = Embedding::default();
    // Whom others follow must be there to be followed.
    let bare = Motions { motion, slides, free: &[], means: &[] };
    let mut is_own: Vec<bool> = motion.iter().map(|m| *m == [Motion::Free; 3]).collect();
    let follows =
        |n: &u32| matches!(motion[*n as usize][0], Motion::Slides(_)) || has_follower(&motion[*n as usize]);
    for leader in (0..motion.len() as u32).filter(follows).flat_map(|n| bare.leaders(n)) {
        is_own[leader as usize] = false;
    }
    let mut mean_of: Vec<Option<u32>> = vec![None; motion.len()];
    for (i, spec) in scene.embedded.iter().enumerate() {
        if scene.embedded[..i].iter().any(|other| other.region == spec.region) {
            mistakes.add(SceneError::Twice { what: "embedded region", name: spec.region.clone() });
            continue;
        }
        mistakes.keep(embed_one(spec, scene, mesh, &is_own, &mut mean_of, &mut embedding));
    }
    mistakes.end().map(|()| embedding)
}

fn has_follower(motion: &[Motion; 3]) -> bool {
    motion.iter().any(|m| matches!(m, Motion::Follows(_)))
}

fn embed_one(
    spec: &EmbeddedSpec,
    scene: &Scene,
    mesh: &mut Mesh,
    is_own: &[bool],
    mean_of: &mut [Option<u32>],
    embedding: &mut Embedding,
) -> Result<(), SceneError> {
    let user = format!("embedded `{}`", spec.region);
    if scene.solids.iter().all(|solid| solid.region != spec.region) {
        return Err(SceneError::Unknown {
            user,
            what: "solid",
            name: spec.region.clone(),
            nearest: nearest(&spec.region, scene.solids.iter().map(|s| s.region.as_str())),
        });
    }
    check(&user, "cell [m]", spec.cell, spec.cell > 0.0, "positive")?;
    let block = cells_of(mesh, &spec.region, &user)?;
    let mut own: Vec<u32> = block.nodes.clone();
    own.sort_unstable();
    own.dedup();
    let lattice = lattice_of(spec, block, mesh, &own)?;
    // What another grid has moves with that one.
    own.retain(|&n| is_own[n as usize] && mean_of[n as usize].is_none());
    let place_of = |n: &u32| own.binary_search(n).ok().map(|i| i as u32);
    let elements: Vec<Vec<u32>> =
        block.cells().map(|cell| cell.iter().filter_map(place_of).collect()).collect();
    let places: Vec<[f64; 3]> = own.iter().map(|&n| mesh.points[n as usize]).collect();
    let pieces = Pieces::new(&lattice, &places, &elements);
    let volumes = clusters::volumes(block, mesh)?;
    let first = mesh.points.len() as u32;
    let filling = filling::Filling::new(&lattice, &pieces, &places, &elements, &volumes)
        .map_err(|why| SceneError::Cube { region: spec.region.clone(), cell: spec.cell, why })?;
    let (means, corners) = filling.means(&lattice, &pieces, &places, first);
    for (&n, mean) in own.iter().zip(means) {
        mean_of[n as usize] = Some(embedding.means.len() as u32);
        embedding.nodes.push(n);
        embedding.means.push(mean);
    }
    let groups = clusters::assign(spec.dilatation, &lattice, &pieces, &filling, &elements, block, mesh);
    let bearers = |n: u32| match mean_of[n as usize] {
        Some(mean) => embedding.means[mean as usize].clone(),
        None => vec![(n, 1.0)],
    };
    let clusters = Clusters::new(groups, block, mesh, bearers)?;
    mesh.points.extend(corners);
    embedding.clusters.push(clusters);
    embedding.regions.push(EmbeddedRegion {
        region: spec.region.clone(),
        cell: spec.cell,
        n_embedded: own.len(),
        nodes: first..mesh.points.len() as u32,
        n_pieces: pieces.cubes.len(),
        divided: pieces.divided().map(|cube| lattice.centre(cube)).collect(),
        n_badly_filled: filling.n_bad(),
    });
    Ok(())
}

/// The grid about a region; refuses cubes larger than it, and so small that there are more than it has nodes.
fn lattice_of(
    spec: &EmbeddedSpec,
    block: &CellBlock,
    mesh: &Mesh,
    nodes: &[u32],
) -> Result<Lattice, SceneError> {
    let refuse = |why: String| SceneError::Cube { region: spec.region.clone(), cell: spec.cell, why };
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in nodes.iter().map(|&n| mesh.points[n as usize]) {
        for c in 0..3 {
            (low[c], high[c]) = (low[c].min(p[c]), high[c].max(p[c]));
        }
    }
    let extent = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
    // To round-off of the coordinates: a cube may be as large as the region.
    if spec.cell > extent * (1.0 + 1e-9) {
        return Err(refuse(format!(
            "are larger than the region, whose greatest extent is {:.3} mm; take less",
            extent * 1e3
        )));
    }
    // Unknowns of the grid then outnumber those that they replace, and where cubes hold no node, memory ends before the coordinates do.
    if extent / spec.cell > nodes.len() as f64 {
        let volume: f64 = clusters::volumes(block, mesh)?.iter().map(|of| of.0).sum();
        let edge = (volume / block.n_cells() as f64).cbrt();
        return Err(refuse(format!(
            "would be more in a row than the region has nodes ({}), and nothing would be saved; take at least {:.3} mm, twice the edge of \
             its cells, or leave it out",
            nodes.len(),
            2e3 * edge
        )));
    }
    Ok(Lattice::about(low, high, spec.cell))
}
