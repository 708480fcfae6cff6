//! Elements of an embedded region in clusters of one dilatation, over the nodes that move them.

use super::filling::Filling;
use super::lattice::Lattice;
use super::pieces::Pieces;
use crate::effect::NO_NODE;
use crate::element::{Cluster, Part, Rule, Sample, SolidElement, shape};
use crate::mesh::{CellBlock, CellKind, Mesh};
use crate::plan::SceneError;
use crate::plan::load::Mean;
use crate::scene::DilatationSpec;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The clusters of a region.
#[derive(Clone)]
pub struct Clusters {
    /// Most nodes of a cluster.
    pub nodes_per_group: usize,
    /// Nodes of every cluster in the mesh, filled up with [`NO_NODE`].
    pub nodes: Vec<u32>,
    /// The clusters, over the places of their nodes in this list.
    pub clusters: Arc<Vec<Cluster>>,
    /// Centroid of each in the mesh \[m\].
    pub centroids: Arc<Vec<[f64; 3]>>,
    /// Elements of each.
    pub cells: Arc<Vec<Vec<u32>>>,
}

impl Clusters {
    /// Of groups of elements; `bearers`: nodes of which a node is a mean, itself where it is none.
    pub fn new(
        groups: Vec<Vec<u32>>,
        block: &CellBlock,
        mesh: &Mesh,
        bearers: impl Fn(u32) -> Mean,
    ) -> Result<Clusters, SceneError> {
        let make = |group: &Vec<u32>| match block.kind {
            CellKind::Hex8 => cluster(&shape::hex8(), group, block, mesh, &bearers),
            CellKind::Tet4 => cluster(&shape::tet4(), group, block, mesh, &bearers),
            CellKind::Tet10 => cluster(&shape::tet10(), group, block, mesh, &bearers),
            CellKind::Wedge6 => cluster(&shape::wedge6(), group, block, mesh, &bearers),
            _ => Err(kind(block)),
        };
        let made = groups.iter().map(make).collect::<Result<Vec<_>, _>>()?;
        let nodes_per_group = made.iter().map(|(nodes, ..)| nodes.len()).max().unwrap_or(1);
        let (mut nodes, mut clusters, mut centroids) = (Vec::new(), Vec::new(), Vec::new());
        for (own, cluster, centroid) in made {
            let unused = nodes_per_group - own.len();
            nodes.extend(own.into_iter().chain(std::iter::repeat_n(NO_NODE, unused)));
            clusters.push(cluster);
            centroids.push(centroid);
        }
        let (clusters, centroids, cells) = (Arc::new(clusters), Arc::new(centroids), Arc::new(groups));
        Ok(Clusters { nodes_per_group, nodes, clusters, centroids, cells })
    }
}

fn kind(block: &CellBlock) -> SceneError {
    SceneError::Kind {
        user: format!("embedded `{}`", block.name),
        block: block.name.clone(),
        found: block.kind,
        needed: "hexahedra, tetrahedra or wedges",
    }
}

/// Volume \[m³\] and number of nodes of every element.
pub fn volumes(block: &CellBlock, mesh: &Mesh) -> Result<Vec<(f64, usize)>, SceneError> {
    fn of<const N: usize, const G: usize>(
        rule: &Rule<N, G, 3>,
        block: &CellBlock,
        mesh: &Mesh,
    ) -> Result<Vec<(f64, usize)>, SceneError> {
        (0..block.n_cells()).map(|cell| Ok((element(rule, block, mesh, cell)?.0.volume, N))).collect()
    }
    match block.kind {
        CellKind::Hex8 => of(&shape::hex8(), block, mesh),
        CellKind::Tet4 => of(&shape::tet4(), block, mesh),
        CellKind::Tet10 => of(&shape::tet10(), block, mesh),
        CellKind::Wedge6 => of(&shape::wedge6(), block, mesh),
        _ => Err(kind(block)),
    }
}

/// Elements that have one dilatation. An element belongs to the piece of the cube that holds its centroid, or where it has no node there, to
/// that of its pieces whose centre is nearest; a badly filled piece goes with the one that stands for it.
///
/// Elements that have nodes outside the grid stand alone. Beside a bone the field is the mesh's own: a corner that is off the bone strains the
/// one layer of elements between, and in a mean over the cube its change of volume, which is what ties the corner to the bone, would drown:
/// a bar of three cubes between two held ends had 77 % of the energy of its mesh.
pub fn assign(
    dilatation: DilatationSpec,
    lattice: &Lattice,
    pieces: &Pieces,
    filling: &Filling,
    elements: &[Vec<u32>],
    block: &CellBlock,
    mesh: &Mesh,
) -> Vec<Vec<u32>> {
    let mut of_piece = BTreeMap::<u32, Vec<u32>>::new();
    let mut alone = Vec::new();
    for ((cell, nodes), in_pieces) in (0..).zip(block.cells()).zip(&pieces.of_element) {
        let centroid = centroid(nodes, mesh);
        // The cube that holds a point is the one whose centre is nearest.
        let distance = |piece: &u32| lattice.squared_distance(pieces.cubes[*piece as usize], centroid);
        let nearest = in_pieces.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let is_inside = elements[cell as usize].len() == nodes.len();
        match (nearest, dilatation) {
            (Some(&piece), DilatationSpec::Cube) if is_inside => {
                of_piece.entry(filling.root[piece as usize]).or_default().push(cell);
            }
            _ => alone.push(vec![cell]),
        }
    }
    of_piece.into_values().chain(alone).collect()
}

fn centroid(nodes: &[u32], mesh: &Mesh) -> [f64; 3] {
    std::array::from_fn(|c| {
        nodes.iter().map(|&n| mesh.points[n as usize][c]).sum::<f64>() / nodes.len() as f64
    })
}

/// An element by itself, and its nodes.
fn element<const N: usize, const G: usize>(
    rule: &Rule<N, G, 3>,
    block: &CellBlock,
    mesh: &Mesh,
    cell: usize,
) -> Result<(SolidElement<N, G>, [u32; N]), SceneError> {
    let nodes = block.nodes.as_chunks::<N>().0[cell];
    let element = SolidElement::new(rule, &nodes.map(|n| mesh.points[n as usize]))
        .map_err(|det| SceneError::Shape { block: block.name.clone(), cell, det })?;
    Ok((element, nodes))
}

/// Nodes of a cluster, the cluster over them, and its centroid.
fn cluster<const N: usize, const G: usize>(
    rule: &Rule<N, G, 3>,
    group: &[u32],
    block: &CellBlock,
    mesh: &Mesh,
    bearers: &impl Fn(u32) -> Mean,
) -> Result<(Vec<u32>, Cluster, [f64; 3]), SceneError> {
    let (mut elements, mut all) = (Vec::new(), Vec::new());
    for &cell in group {
        let (element, nodes) = element(rule, block, mesh, cell as usize)?;
        let means = nodes.map(bearers);
        all.extend(means.iter().flatten().map(|(n, _)| *n));
        elements.push((element, nodes, means));
    }
    all.sort_unstable();
    all.dedup();
    let (mut parts, mut sum, mut volume) = (Vec::new(), [0.0; 3], 0.0);
    for (element, nodes, means) in elements {
        let mut own: Vec<u32> = means.iter().flatten().map(|(n, _)| *n).collect();
        own.sort_unstable();
        own.dedup();
        let at = |n: &u32| own.binary_search(n).expect("listed");
        let samples = (0..G).map(|g| Sample { w: element.w[g], dn: element.dn[g].to_vec() }).collect();
        let number = |mean: &Mean| mean.iter().map(|(n, w)| (at(n) as u32, *w)).collect();
        let means = means.iter().map(number).collect();
        let place = |n: &u32| all.binary_search(n).expect("listed") as u32;
        let nodes_of_part = own.iter().map(place).collect();
        parts.push(Part { nodes: nodes_of_part, means, samples, volume: element.volume });
        let centroid = centroid(&nodes, mesh);
        (0..3).for_each(|c| sum[c] += element.volume * centroid[c]);
        volume += element.volume;
    }
    // An element alone keeps all its points: what moves it is as small as itself.
    let cluster = Cluster { parts, volume };
    let cluster = if group.len() > 1 { cluster.with_uniform_strain() } else { cluster };
    Ok((all, cluster, sum.map(|s| s / volume)))
}
