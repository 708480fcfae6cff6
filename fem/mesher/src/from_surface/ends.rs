//! Where a muscle begins and ends: patches of its surface.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{End, SectionError};
use fem::geometry::{SearchSurface, Surface};

/// Muscle and bone touch where they are closer \[m\].
const CONTACT: f64 = 3e-3;
/// Half the width of holes and clefts of a contact patch that are closed \[m\].
const CLOSING: f64 = 4e-3;
/// Parts of the contact that are tried as patch: all, and what lies within this fraction of the way from the tip to the other.
const PARTS: [f64; 3] = [1.0, 0.25, 0.1];
/// Points of a patch of contact, at least.
const LEAST_PATCH: usize = 10;
/// Radius of the patch at a tip \[m\].
const TIP_RADIUS: f64 = 4e-3;

/// Length of the edges of every point to its neighbours.
struct Graph {
    neighbours: Vec<Vec<(u32, f64)>>,
}

impl Graph {
    pub fn new(surface: &Surface) -> Graph {
        let mut neighbours = vec![Vec::new(); surface.points.len()];
        for t in &surface.triangles {
            for k in 0..3 {
                // Each edge once per direction: the other triangle runs along it the other way round.
                let (p, q) = (t[k], t[(k + 1) % 3]);
                let [x, y] = [p, q].map(|p| Vector3::from(surface.points[p as usize]));
                neighbours[p as usize].push((q, (x - y).norm()));
            }
        }
        Graph { neighbours }
    }

    /// Length of the shortest way along edges from the nearest of `sources` to every point \[m\].
    pub fn distances(&self, sources: &[u32]) -> Vec<f64> {
        let mut distance = vec![f64::INFINITY; self.neighbours.len()];
        // Lengths are positive: their bits are in the order of the numbers.
        let mut open = BinaryHeap::new();
        for &p in sources {
            distance[p as usize] = 0.0;
            open.push(Reverse((0u64, p)));
        }
        while let Some(Reverse((bits, p))) = open.pop() {
            let d = f64::from_bits(bits);
            if d > distance[p as usize] {
                continue;
            }
            for &(q, step) in &self.neighbours[p as usize] {
                if d + step < distance[q as usize] {
                    distance[q as usize] = d + step;
                    open.push(Reverse(((d + step).to_bits(), q)));
                }
            }
        }
        distance
    }

    /// Connected parts of a set of points, largest first.
    pub fn parts(&self, set: &[bool]) -> Vec<Vec<u32>> {
        let mut left = set.to_vec();
        let mut parts = Vec::new();
        for start in 0..set.len() {
            if !std::mem::take(&mut left[start]) {
                continue;
            }
            let mut part = vec![start as u32];
            let mut next = 0;
            while next < part.len() {
                for &(q, _) in &self.neighbours[part[next] as usize] {
                    if std::mem::take(&mut left[q as usize]) {
                        part.push(q);
                    }
                }
                next += 1;
            }
            parts.push(part);
        }
        parts.sort_by_key(|part| Reverse(part.len()));
        parts
    }
}

/// The two points of the surface that are farthest apart along it.
fn tips(graph: &Graph) -> [u32; 2] {
    let farthest = |from: u32| {
        let d = graph.distances(&[from]);
        (0..d.len()).fold(0, |best, i| if d[i] > d[best] { i } else { best }) as u32
    };
    let mut ends = [0, farthest(0)];
    for _ in 0..3 {
        ends = [ends[1], farthest(ends[1])];
    }
    ends
}

/// Points near a tip.
fn tip_patch(graph: &Graph, tip: u32) -> Vec<u32> {
    let d = graph.distances(&[tip]);
    (0..d.len() as u32).filter(|&p| d[p as usize] <= TIP_RADIUS).collect()
}

/// Is each point of the muscle closer than [`CONTACT`] to the bone?
fn touching(surface: &Surface, bone: &SearchSurface) -> Vec<bool> {
    let near = |p: &[f64; 3]| bone.nearest(&Vector3::from(*p)).is_some_and(|n| n.0.distance < CONTACT);
    surface.points.par_iter().map(near).collect()
}

/// Possible patches for the origin and for the insertion, the preferred first.
pub(super) fn candidates(
    muscle: &str,
    surface: &Surface,
    ends: [End; 2],
) -> Result<[Vec<Vec<u32>>; 2], SectionError> {
    let n = surface.points.len();
    for (end, name) in ends.iter().zip(["origin", "insertion"]) {
        if let End::Points(points) = end {
            let held = points.iter().filter(|&&p| (p as usize) < n).count();
            if held == 0 || held < points.len() {
                let (given, last) = (points.len(), n.saturating_sub(1));
                return Err(SectionError::Patch { muscle: muscle.into(), end: name, given, held, last });
            }
        }
    }
    let graph = Graph::new(surface);
    let contact = ends.map(|end| match end {
        End::Bone(bone) => touching(surface, bone),
        End::Points(points) => {
            let mut set = vec![false; n];
            points.iter().for_each(|&p| set[p as usize] = true);
            set
        }
        End::Tip => vec![false; n],
    });
    // Of the two tips, the origin's lies nearer along the surface to where the origin is known to be.
    let [first, second] = tips(&graph);
    let [to_first, to_second] = [first, second].map(|tip| graph.distances(&[tip]));
    let lean = |set: &[bool]| {
        let fraction = |p: usize| (to_second[p] - to_first[p]) / (to_second[p] + to_first[p]);
        let (sum, count) = (0..n).filter(|&p| set[p]).fold((0.0, 0), |(s, c), p| (s + fraction(p), c + 1));
        sum / f64::max(count as f64, 1.0)
    };
    let mut preference = lean(&contact[0]) - lean(&contact[1]);
    if preference == 0.0 {
        preference = surface.points[first as usize][1] - surface.points[second as usize][1];
    }
    let (tips, distances) = if preference >= 0.0 {
        ([first, second], [&to_first, &to_second])
    } else {
        ([second, first], [&to_second, &to_first])
    };
    Ok([0, 1].map(|i| {
        let mut found: Vec<Vec<u32>> = Vec::new();
        match ends[i] {
            End::Points(points) => return vec![points.to_vec()],
            End::Bone(_) => {
                let whole = graph.parts(&close(&graph, &contact[i])).into_iter().next().unwrap_or_default();
                let (near, far) = (distances[i], distances[1 - i]);
                for part in PARTS {
                    let at_end = |&p: &u32| near[p as usize] <= part * (near[p as usize] + far[p as usize]);
                    let patch: Vec<u32> = whole.iter().copied().filter(at_end).collect();
                    if patch.len() >= LEAST_PATCH && found.last().is_none_or(|last| patch.len() < last.len())
                    {
                        found.push(patch);
                    }
                }
            }
            End::Tip => {}
        }
        found.push(tip_patch(&graph, tips[i]));
        found
    }))
}

/// The set without holes and clefts narrower than twice [`CLOSING`].
fn close(graph: &Graph, set: &[bool]) -> Vec<bool> {
    let numbers = |set: &[bool]| (0..set.len() as u32).filter(|&p| set[p as usize]).collect::<Vec<_>>();
    let grown: Vec<bool> = graph.distances(&numbers(set)).iter().map(|&d| d <= CLOSING).collect();
    let outside: Vec<bool> = grown.iter().map(|g| !g).collect();
    let depth = graph.distances(&numbers(&outside));
    depth.iter().zip(set).map(|(&d, &s)| s || d > CLOSING).collect()
}
