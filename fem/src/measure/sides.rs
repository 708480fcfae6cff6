//! On which side of each other bodies are: an independent look at what contact has to keep.
//!
//! Every surface that takes part in contact gets lines through the body behind it, from where that is held to where else it is held, or
//! along its greatest extent, and where it is flat the sheet of its one side. Between two states the signed crossings of such lines, and
//! the passages of their points through sheets, are counted ([`crossings`], [`passages`]): none as long as nobody goes through anybody.
//! It shares no code with contact, and knows nothing of barriers, distances or collisions.
//!
//! Points go straight from the one state to the other, so states should be no farther apart than frames are: a body that goes round
//! another in between would be told to have gone through it.

use crate::geometry::linking::{crossings, passages};
use crate::mesh::Mesh;
use crate::plan::{Motion, Plan};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

/// A body is flat where its least extent is less than this fraction of the next: a strap of 8 x 2 mm is just none, a sheet is.
const FLAT: f64 = 0.25;
/// Cosine between the normal of a face of the one side of a sheet and that of the sheet: 60 degrees.
const OF_SIDE: f64 = 0.5;

/// What stands for a body that takes part in contact.
#[derive(Debug)]
struct Stand {
    name: String,
    /// Nodes of the lines through it, one after the other.
    lines: Vec<Vec<u32>>,
    /// Its one side, where it is flat.
    sheet: Option<Sheet>,
}

/// The one side of a flat body.
#[derive(Debug)]
struct Sheet {
    nodes: Vec<u32>,
    /// Over `nodes`.
    triangles: Vec<[usize; 3]>,
    rim: Vec<[usize; 2]>,
}

/// Lines and sheets of all bodies that take part in the contact of a plan.
#[derive(Debug)]
pub struct Sides {
    bodies: Vec<Stand>,
    pairs: Vec<[usize; 2]>,
}

impl Sides {
    /// `None` where there is no contact.
    pub fn new(plan: &Plan) -> Option<Sides> {
        let contact = plan.contact()?;
        let bodies = contact.surfaces.par_iter().map(|s| Stand {
            name: s.name.clone(),
            lines: lines(plan, &s.nodes, &s.faces),
            sheet: sheet(&plan.mesh, &s.nodes, &s.faces),
        });
        let others = contact.pairs.iter().copied().filter(|[a, b]| a != b);
        Some(Sides { bodies: bodies.collect(), pairs: others.collect() })
    }

    /// Number of pairs that are looked at.
    pub fn n_pairs(&self) -> usize {
        self.pairs.len()
    }

    /// The pairs of which some of the nodes of one island can move.
    pub fn pairs_of(&self, plan: &Plan, nodes: &[u32]) -> Vec<[usize; 2]> {
        let is_free = |n: &u32| plan.motion[*n as usize].iter().any(Motion::is_unknown);
        let mine: BTreeSet<u32> = nodes.iter().copied().filter(is_free).collect();
        let moves = |body: usize| {
            let Stand { lines, sheet, .. } = &self.bodies[body];
            lines.iter().flatten().chain(sheet.iter().flat_map(|s| &s.nodes)).any(|n| mine.contains(n))
        };
        self.pairs.iter().copied().filter(|&[a, b]| moves(a) || moves(b)).collect()
    }

    /// Pairs of which one has gone through the other on the straight way from `from` to `to`, positions \[m\] of all nodes.
    pub fn changed(&self, from: &[f64], to: &[f64]) -> Vec<[String; 2]> {
        self.changed_of(&self.pairs, from, to)
    }

    /// The same of some [pairs](Self::pairs_of).
    pub fn changed_of(&self, pairs: &[[usize; 2]], from: &[f64], to: &[f64]) -> Vec<[String; 2]> {
        let place = |x: &[f64], n: &u32| Vector3::from_column_slice(&x[3 * *n as usize..3 * *n as usize + 3]);
        let ways = |nodes: &[u32]| [from, to].map(|x| nodes.iter().map(|n| place(x, n)).collect::<Vec<_>>());
        let through = |a: &Stand, b: &Stand| {
            let Some(sheet) = &b.sheet else { return false };
            let [before, after] = ways(&sheet.nodes);
            a.lines.iter().flatten().any(|n| {
                let point = [from, to].map(|x| place(x, n));
                passages(point, &sheet.triangles, &sheet.rim, [&before, &after]) != 0
            })
        };
        let has_changed = |&&[a, b]: &&[usize; 2]| {
            let (a, b) = (&self.bodies[a], &self.bodies[b]);
            let cross = a.lines.iter().any(|line| {
                let mine = ways(line);
                b.lines.iter().any(|other| {
                    let theirs = ways(other);
                    crossings([&mine[0], &mine[1]], [&theirs[0], &theirs[1]]) != 0
                })
            });
            cross || through(a, b) || through(b, a)
        };
        let changed: Vec<&[usize; 2]> = pairs.par_iter().filter(has_changed).collect();
        changed.into_iter().map(|pair| pair.map(|s| self.bodies[s].name.clone())).collect()
    }
}

/// Neighbours of nodes, with how far they are in the mesh \[m\].
type Graph = BTreeMap<u32, Vec<(u32, f64)>>;

/// Lines through the body behind a surface.
fn lines(plan: &Plan, nodes: &[u32], faces: &[[u32; 4]]) -> Vec<Vec<u32>> {
    let mesh = &plan.mesh;
    let mine: BTreeSet<u32> = nodes.iter().copied().collect();
    let shared = |cells: &[u32]| {
        cells.iter().collect::<BTreeSet<_>>().into_iter().filter(|n| mine.contains(n)).count()
    };
    let behind = mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| (shared(&b.nodes), b));
    let behind = behind.max_by_key(|(n, b)| (*n, Reverse(&b.name))).filter(|(n, _)| *n > 0);
    let mut graph = Graph::new();
    let mut join = |cell: &[u32]| {
        for &a in cell {
            for &b in cell.iter().filter(|b| **b != a) {
                let [p, q] = [a, b].map(|n| Vector3::from(mesh.points[n as usize]));
                graph.entry(a).or_default().push((b, (p - q).norm()));
            }
        }
    };
    match behind {
        Some((_, block)) => block.cells().for_each(&mut join),
        None => faces.iter().for_each(|f| join(f)),
    }
    graph.values_mut().for_each(|near| {
        near.sort_by_key(|n| n.0);
        near.dedup_by_key(|n| n.0);
    });
    let Some(&first) = nodes.first() else { return Vec::new() };
    let is_held = |n: &u32| !plan.motion[*n as usize].iter().any(Motion::is_unknown);
    let held: BTreeSet<u32> = graph.keys().copied().filter(is_held).collect();
    let places = if held.len() == graph.len() { Vec::new() } else { held_places(mesh, &graph, &held) };
    let reached = ways_from(&graph, places.first().copied().unwrap_or(first));
    let ends: Vec<u32> = places.iter().skip(1).copied().filter(|n| reached.contains_key(n)).collect();
    if !ends.is_empty() {
        return ends.into_iter().map(|end| way_back(&reached, end)).collect();
    }
    // Held nowhere, or at one place: to the end that is farthest.
    let farthest = |reached: &BTreeMap<u32, (f64, u32)>| {
        *reached.iter().max_by(|a, b| a.1.0.total_cmp(&b.1.0)).expect("the first node").0
    };
    match places.is_empty() {
        false => vec![way_back(&reached, farthest(&reached))],
        true => {
            let reached = ways_from(&graph, farthest(&reached));
            vec![way_back(&reached, farthest(&reached))]
        }
    }
}

/// A node in the middle of each set of held nodes that hang together.
fn held_places(mesh: &Mesh, graph: &Graph, held: &BTreeSet<u32>) -> Vec<u32> {
    let (mut left, mut places) = (held.clone(), Vec::new());
    while let Some(first) = left.pop_first() {
        let (mut together, mut next) = (vec![first], 0);
        while next < together.len() {
            for (n, _) in &graph[&together[next]] {
                if left.remove(n) {
                    together.push(*n);
                }
            }
            next += 1;
        }
        let place = |n: &u32| Vector3::from(mesh.points[*n as usize]);
        let middle = together.iter().map(place).sum::<Vector3<f64>>() / together.len() as f64;
        let from_middle = |n: &u32| (place(n) - middle).norm();
        let nearest = together.iter().min_by(|a, b| from_middle(a).total_cmp(&from_middle(b)));
        places.push(*nearest.expect("the first of them"));
    }
    places
}

/// Shortest ways in a graph from `start`: of every node that can be reached, how far it is and by which node (Dijkstra 1959).
fn ways_from(graph: &Graph, start: u32) -> BTreeMap<u32, (f64, u32)> {
    let mut reached = BTreeMap::from([(start, (0.0, start))]);
    // Lengths are positive, and the bits of such numbers are ordered as they are.
    let mut open = BinaryHeap::from([Reverse((0.0_f64.to_bits(), start))]);
    while let Some(Reverse((bits, n))) = open.pop() {
        let so_far = f64::from_bits(bits);
        if so_far > reached[&n].0 {
            continue;
        }
        for &(next, length) in graph.get(&n).into_iter().flatten() {
            let far = so_far + length;
            if reached.get(&next).is_none_or(|known| far < known.0) {
                reached.insert(next, (far, n));
                open.push(Reverse((far.to_bits(), next)));
            }
        }
    }
    reached
}

fn way_back(reached: &BTreeMap<u32, (f64, u32)>, end: u32) -> Vec<u32> {
    let mut way = vec![end];
    loop {
        let last = way[way.len() - 1];
        let before = reached[&last].1;
        if before == last {
            return way;
        }
        way.push(before);
    }
}

/// The one side of the surface of a flat body.
fn sheet(mesh: &Mesh, nodes: &[u32], faces: &[[u32; 4]]) -> Option<Sheet> {
    let place = |n: &u32| Vector3::from(mesh.points[*n as usize]);
    let middle = nodes.iter().map(place).sum::<Vector3<f64>>() / nodes.len() as f64;
    let spread: Matrix3<f64> =
        nodes.iter().map(|n| (place(n) - middle) * (place(n) - middle).transpose()).sum();
    let axes = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| axes.eigenvalues[a].total_cmp(&axes.eigenvalues[b]));
    let axis: Vector3<f64> = axes.eigenvectors.column(order[0]).into_owned();
    let width = |c: usize| -> f64 {
        let along: Vector3<f64> = axes.eigenvectors.column(c).into_owned();
        let of = nodes.iter().map(|n| along.dot(&place(n)));
        let (lo, hi) = of.fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)));
        hi - lo
    };
    if width(order[0]) >= FLAT * width(order[1]) {
        return None;
    }
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).filter(|t| t[1] != t[2]);
    let of_side = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|n| place(&n));
        let normal = (b - a).cross(&(c - a));
        normal.dot(&axis) > OF_SIDE * normal.norm()
    };
    let triangles: Vec<[u32; 3]> = triangles.filter(of_side).collect();
    let nodes: Vec<u32> = triangles.iter().flatten().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let triangles: Vec<[usize; 3]> =
        triangles.iter().map(|t| t.map(|n| nodes.binary_search(&n).expect("one of them"))).collect();
    let edges: BTreeSet<[usize; 2]> =
        triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let rim = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).copied().collect();
    Some(Sheet { nodes, triangles, rim })
}
