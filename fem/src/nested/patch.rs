//! Cells that a guess folds get a shape again, in patches of the mesh of their own.

use crate::mesh::quality::gauss_dets;
use crate::mesh::{CellBlock, CellKind, Mesh};
use crate::plan::{Island, LoadedIsland, Plan};
use crate::scene::{FormulationSpec, LawSpec, PrescribedSpec, Scene, SolidSpec};
use crate::solve::{DET_F_FRACTION, Settings, Solver};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Rings of cells about folded ones that give way: the fewer the better, as there the guess is lost; more where fewer have no shape.
const RINGS: [usize; 3] = [1, 2, 4];
/// ε of the energy that gives shape, one after the other: with a small one at once Newton's method creeps.
const EPSILONS: [f64; 3] = [1.0, 0.1, 0.01];
/// How well a patch settles, relative to its forces: any shape does.
const SETTLED: f64 = 0.1;
/// Iterations that a patch may take with each.
const MOST_ITERATIONS: usize = 20;
/// Set of nodes, and the control that moves them.
const RIM: &str = "rim";

/// Moves free nodes at `x` \[m\] about cells that are folded to where these cells have a shape as near to that in the mesh as others let them.
/// Folded is what the solver would not go to at once from `start` \[m\]. What finds no shape stays folded.
pub(super) fn unfold(mesh: &Mesh, start: &[f64], is_free: &[bool], x: &mut [f64]) {
    for rings in RINGS {
        let cells = folded(mesh, start, x);
        tracing::debug!(rings, cells = cells.len(), "a guess folds cells");
        if cells.is_empty() {
            return;
        }
        let near = within(mesh, &cells, rings);
        let moves: Vec<bool> = near.iter().zip(is_free).map(|(near, free)| *near && *free).collect();
        for epsilon in EPSILONS {
            let Some(patches) = Patches::new(mesh, &near, &moves, x, epsilon) else { return };
            patches.shape(&moves, x);
            if folded(mesh, start, x).is_empty() {
                return;
            }
        }
    }
}

/// All solid cells with their blocks.
fn cells(mesh: &Mesh) -> impl Iterator<Item = (&CellBlock, &[u32])> {
    let solids = mesh.blocks.iter().filter(|block| block.kind.is_solid());
    solids.flat_map(|block| block.cells().map(move |cell| (block, cell)))
}

/// Cells whose least det F at `x` is below the fraction of that at `start` that the solver admits in one go.
fn folded<'a>(mesh: &'a Mesh, start: &[f64], x: &[f64]) -> Vec<&'a [u32]> {
    let all: Vec<(&CellBlock, &[u32])> = cells(mesh).collect();
    let is_folded = |(block, cell): &(&CellBlock, &[u32])| {
        let least = |x| least_det_f(block.kind, mesh, cell, x);
        !(least(x) > DET_F_FRACTION * least(start))
    };
    let is_folded: Vec<bool> = all.par_iter().map(is_folded).collect();
    all.iter().zip(is_folded).filter_map(|((_, cell), folded)| folded.then_some(*cell)).collect()
}

fn least_det_f(kind: CellKind, mesh: &Mesh, cell: &[u32], x: &[f64]) -> f64 {
    let dets = |place: &dyn Fn(usize) -> [f64; 3]| {
        let corners: Vec<Vector3<f64>> = cell.iter().map(|&n| place(n as usize).into()).collect();
        gauss_dets(kind, &corners)
    };
    let (now, then) = (dets(&|n| [x[3 * n], x[3 * n + 1], x[3 * n + 2]]), dets(&|n| mesh.points[n]));
    now.iter().zip(then).map(|(now, then)| now.0 / then.0).fold(f64::INFINITY, f64::min)
}

/// Which nodes are on the cells `some` or on those in rings about them.
fn within(mesh: &Mesh, some: &[&[u32]], rings: usize) -> Vec<bool> {
    let mut near = vec![false; mesh.points.len()];
    some.iter().copied().flatten().for_each(|&n| near[n as usize] = true);
    for _ in 1..rings {
        let before = near.clone();
        for (_, cell) in cells(mesh).filter(|(_, cell)| cell.iter().any(|&n| before[n as usize])) {
            cell.iter().for_each(|&n| near[n as usize] = true);
        }
    }
    near
}

/// Patches as a plan of their own, an island each.
struct Patches {
    plan: Plan,
    /// Node of the whole mesh of each of theirs.
    nodes: Vec<u32>,
}

impl Patches {
    /// Of the cells that have a node that is `near`; nodes that do not move are displaced to `x` \[m\]. `None` where all move.
    fn new(mesh: &Mesh, near: &[bool], moves: &[bool], x: &[f64], epsilon: f64) -> Option<Patches> {
        let mut nodes = Vec::new();
        let mut known = BTreeMap::new();
        let mut small = Mesh::default();
        let mut blocks: BTreeMap<&str, CellBlock> = BTreeMap::new();
        for (block, cell) in cells(mesh).filter(|(_, cell)| cell.iter().any(|&n| near[n as usize])) {
            let empty = || CellBlock { name: block.name.clone(), kind: block.kind, nodes: Vec::new() };
            let own = blocks.entry(&block.name).or_insert_with(empty);
            own.nodes.extend(cell.iter().map(|&n| {
                *known.entry(n).or_insert_with(|| {
                    nodes.push(n);
                    small.points.push(mesh.points[n as usize]);
                    nodes.len() as u32 - 1
                })
            }));
        }
        small.blocks = blocks.into_values().collect();
        let rim: Vec<u32> = (0..nodes.len() as u32).filter(|&s| !moves[nodes[s as usize] as usize]).collect();
        if rim.is_empty() {
            return None;
        }
        let displaced = |&s: &u32| {
            let n = nodes[s as usize] as usize;
            std::array::from_fn(|c| x[3 * n + c] - mesh.points[n][c])
        };
        let rim_moves = PrescribedSpec {
            nodes: RIM.into(),
            components: [true; 3],
            displacement: rim.iter().map(displaced).collect(),
            control: Some(RIM.into()),
        };
        small.node_sets.insert(RIM.into(), rim);
        let solid = |block: &CellBlock| SolidSpec {
            formulation: Some(FormulationSpec::Plain),
            ..SolidSpec::new(&block.name, LawSpec::FoldoverFree { epsilon })
        };
        let scene = Scene {
            solids: small.blocks.iter().map(solid).collect(),
            prescribed: vec![rim_moves],
            ..Scene::default()
        };
        let plan = Plan::new(&scene, small).expect("cells of a mesh that has a plan");
        Some(Patches { plan, nodes })
    }

    /// Puts the nodes that move to where they come to rest.
    fn shape(&self, moves: &[bool], x: &mut [f64]) {
        let settings =
            Settings { tolerance: SETTLED, max_iterations: MOST_ITERATIONS, ..Settings::default() };
        let load = self.plan.load(&[(RIM, 1.0)], &[]).expect("the control of the rim");
        let all: Vec<f64> =
            self.nodes.iter().flat_map(|&n| x[3 * n as usize..3 * n as usize + 3].to_vec()).collect();
        let shape = |island: &Arc<Island>| {
            let mut potential = LoadedIsland::new(island.clone(), load.clone(), load.clone());
            let mut free = island.free_positions(&island.gather(&all));
            if free.is_empty() {
                return None;
            }
            let took = Solver::new(RIM, settings).settle(&mut potential, &mut free);
            tracing::debug!(island = %island.name, unknowns = free.len(), ?took, "patch");
            took.ok().map(|_| potential.expand(&free))
        };
        let shapes: Vec<Option<Vec<f64>>> = self.plan.islands.par_iter().map(shape).collect();
        for (island, shape) in self.plan.islands.iter().zip(shapes) {
            for (&s, place) in island.nodes.iter().zip(shape.iter().flat_map(|x| x.as_chunks::<3>().0)) {
                let n = self.nodes[s as usize] as usize;
                if moves[n] {
                    x[3 * n..3 * n + 3].copy_from_slice(place);
                }
            }
        }
    }
}
