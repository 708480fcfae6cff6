//! Smoothing of one muscle: all nodes move at once to the least of one smooth objective.
//!
//! The objective is the sum of the shape penalty of every cell (`shape.rs`), a small spring on the logarithm of every edge
//! length, a spring on the distance of surface nodes from the loft along its normal (they slide freely along it), a spring on the
//! volume, and one-sided springs on the planes that keep the muscle apart from its neighbours. Nodes on the outline of the two ends
//! slide along the end curves of the loft, nodes inside the ends along the tangent planes in which they started, held by springs.

use nalgebra::{Matrix3, Vector3};

use super::grid::Coarser;
use super::lbfgs::minimise;
use super::shape::cell_penalty;
use super::{Loft, MuscleBlock, N_OUTLINE, quad_volume};
use fem::mesh::unique_nodes;

/// Weight of the squared logarithm of an edge's length over its first length.
const EDGE_WEIGHT: f64 = 0.02;
/// Weight of the squared distance from the loft, and the distance that counts as one \[m\].
const LOFT_WEIGHT: f64 = 0.05;
const LOFT_DISTANCE: f64 = 0.3e-3;
/// The same for the distance of inner nodes of the end layers from the tangent planes in which they started.
const CAP_WEIGHT: f64 = 0.05;
const CAP_DISTANCE: f64 = 1e-3;
/// The same for the distance of surface nodes from where a round found them, where they are anchored.
const ANCHOR_WEIGHT: f64 = 0.05;
const ANCHOR_DISTANCE: f64 = 0.3e-3;
/// Weight, per cell, of the squared relative error of the volume.
const VOLUME_WEIGHT: f64 = 200.0;
/// Weight of the squared trespass over a plane, and the trespass that counts as one \[m\].
const PLANE_WEIGHT: f64 = 1.0;
const PLANE_DISTANCE: f64 = 0.05e-3;
/// Rough second derivative of the shape penalty by the turn of an edge, for the first guess of the Hessian.
const SHAPE_STIFFNESS: f64 = 4.0;
/// Farthest that a node may go in one step, in edge lengths.
const REACH: f64 = 0.3;
/// Decrease of the objective that ends a minimisation early, per cell.
const TOLERANCE: f64 = 1e-7;

/// A plane that a point of a surface face must not cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Nodes of the face.
    pub nodes: [u32; 4],
    /// The point as weighted mean of the nodes.
    pub weights: [f64; 4],
    /// Unit normal, away from this muscle.
    pub normal: Vector3<f64>,
    /// Largest allowed `normal · point` \[m\].
    pub offset: f64,
}

impl Plane {
    /// How far the point of the face is past the plane \[m\], negative on the allowed side.
    pub fn trespass(&self, points: &[[f64; 3]]) -> f64 {
        let part = |i: usize| Vector3::from(points[self.nodes[i] as usize]) * self.weights[i];
        self.normal.dot(&(0..4).map(part).sum::<Vector3<f64>>()) - self.offset
    }
}

/// A point of the lateral surface, a node (four times the same) or the centre of a face, and the coordinates (t, s) of its foot on
/// the loft.
#[derive(Clone, Copy, Debug)]
struct SidePoint {
    nodes: [u32; 4],
    foot: [f64; 2],
    range: [f64; 2],
}

impl SidePoint {
    fn at(&self, x: &[Vector3<f64>]) -> Vector3<f64> {
        let [a, b, c, d] = self.nodes.map(|n| x[n as usize]);
        if self.nodes[0] == self.nodes[1] { a } else { (a + b + c + d) / 4.0 }
    }
}

/// One muscle while it is being smoothed.
#[derive(Clone, Debug)]
pub struct Smoother {
    /// The muscle as it stands.
    pub block: MuscleBlock,
    loft: Loft,
    x: Vec<Vector3<f64>>,
    cells: Vec<[u32; 8]>,
    edges: Vec<(u32, u32, f64)>,
    faces: Vec<[u32; 4]>,
    /// Nodes first, then centres of faces.
    side: Vec<SidePoint>,
    /// Inner nodes of the end layers, where they started, and the normal of the end face there.
    caps: Vec<(u32, Vector3<f64>, Vector3<f64>)>,
    /// What the block shall hold \[m³\].
    pub volume: f64,
    /// Planes of the neighbours.
    pub planes: Vec<Plane>,
    /// Nodes of the surface are drawn back to where a round of smoothing found them: planes are true only close to where they were found.
    pub anchored: bool,
    anchors: Vec<(u32, Vector3<f64>)>,
}

impl Smoother {
    /// `volume`: what the block shall hold \[m³\].
    pub fn new(block: MuscleBlock, loft: Loft, volume: f64) -> Smoother {
        let x: Vec<Vector3<f64>> = block.points.iter().map(|p| Vector3::from(*p)).collect();
        let cells: Vec<[u32; 8]> = block.cells().collect();
        let mut pairs: Vec<[u32; 2]> =
            cells.iter().flat_map(|c| CELL_EDGES.map(|[a, b]| [c[a], c[b]])).collect();
        pairs.iter_mut().for_each(|p| p.sort_unstable());
        pairs.sort_unstable();
        pairs.dedup();
        let length = |[a, b]: [u32; 2]| (x[a as usize] - x[b as usize]).norm_squared();
        let edges = pairs.into_iter().map(|p| (p[0], p[1], length(p))).collect();
        let last = block.n_layers() - 1;
        let mut side = Vec::new();
        for (layer, &s) in block.s.iter().enumerate() {
            let range = if layer == 0 || layer == last { [s, s] } else { [block.s[0], block.s[last]] };
            for (&node, &t) in block.outline.iter().zip(&block.outline_parameter) {
                side.push(SidePoint { nodes: [block.node(layer, node); 4], foot: [t, s], range });
            }
        }
        let around = block.outline.len();
        for (i, nodes) in block.side_faces().into_iter().enumerate() {
            let (layer, k) = (i / around, i % around);
            let t = (block.outline_parameter[k]
                + block.outline_parameter.get(k + 1).copied().unwrap_or(N_OUTLINE as f64))
                / 2.0;
            let s = (block.s[layer] + block.s[layer + 1]) / 2.0;
            side.push(SidePoint { nodes, foot: [t, s], range: [block.s[0], block.s[last]] });
        }
        let mut cap_normal = vec![Vector3::zeros(); x.len()];
        for layer in [0, last] {
            for face in block.end_faces(layer) {
                let p = face.map(|n| x[n as usize]);
                let normal = (p[2] - p[0]).cross(&(p[3] - p[1]));
                face.iter().for_each(|&n| cap_normal[n as usize] += normal);
            }
        }
        // Nodes on the outline of an end slide along the end curve of the loft instead.
        for side in side.iter().filter(|side| side.range[0] == side.range[1]) {
            cap_normal[side.nodes[0] as usize] = Vector3::zeros();
        }
        let inner = (0u32..).zip(&cap_normal).filter(|(_, n)| n.norm() > 0.0);
        let caps = inner.map(|(i, n)| (i, x[i as usize], n.normalize())).collect();
        let faces = block.surface();
        Smoother {
            block,
            loft,
            x,
            cells,
            edges,
            faces,
            side,
            caps,
            volume,
            planes: Vec::new(),
            anchored: false,
            anchors: Vec::new(),
        }
    }

    /// Starts where a coarser mesh of the same muscle ended.
    pub fn start_from(&mut self, coarse: &Smoother, map: &Coarser) {
        self.block.points = map.points(&coarse.block, self.block.n_layers());
        self.x = self.block.points.iter().map(|p| Vector3::from(*p)).collect();
        // Feet from the nearest node of the coarse outline: nodes have slid far from where they were filled in.
        let (around, layers) = (self.block.outline.len(), self.block.n_layers());
        let (coarse_around, coarse_last) = (coarse.block.outline.len(), coarse.block.n_layers() - 1);
        for (i, side) in self.side.iter_mut().enumerate() {
            let (layer, k) = if i < around * layers {
                ((i / around) as f64, (i % around) as f64)
            } else {
                let face = i - around * layers;
                ((face / around) as f64 + 0.5, (face % around) as f64 + 0.5)
            };
            let near = (layer * coarse_last as f64 / (layers - 1) as f64).round() as usize;
            let foot =
                coarse.side[near * coarse_around + map.outline(k).round() as usize % coarse_around].foot;
            side.foot = [foot[0], foot[1].clamp(side.range[0], side.range[1])];
        }
    }

    /// Moves the nodes towards the least of the objective. `k`: sharpness of the shape penalty. Returns the steps taken.
    pub fn smooth(&mut self, k: f64, iterations: usize) -> usize {
        self.anchors.clear();
        if self.anchored {
            let nodes = unique_nodes(self.faces.iter().flatten().copied());
            self.anchors.extend(nodes.into_iter().map(|n| (n, self.x[n as usize])));
        }
        let (metric, reach) = self.metric();
        let mut x = std::mem::take(&mut self.x);
        let tolerance = TOLERANCE * self.cells.len() as f64;
        let (_, steps) =
            minimise(&mut x, &metric, &reach, iterations, tolerance, |x, g| self.objective(x, k, g));
        self.x = x;
        self.block.points = self.x.iter().map(|&p| p.into()).collect();
        steps
    }

    /// The node belongs to one of the end layers.
    pub fn is_end(&self, node: u32) -> bool {
        let n = self.block.nodes_per_section;
        (node as usize) < n || node as usize >= self.x.len() - n
    }

    /// Distance of every node of the lateral surface from the loft \[m\], positive outside.
    pub fn deviations(&self) -> Vec<f64> {
        let signed = |side: &SidePoint| {
            let x = side.at(&self.x);
            let foot = self.loft.project(&x, side.foot, side.range).1;
            let d = x - foot.position;
            d.norm().copysign(d.dot(&foot.normal()))
        };
        self.side.iter().filter(|side| side.nodes[0] == side.nodes[1]).map(signed).collect()
    }

    /// First guess of the inverse Hessian: shape stiffness over the squared edge lengths at a node, springs along their normals.
    /// And how far a node may go in one step.
    fn metric(&self) -> (Vec<Matrix3<f64>>, Vec<f64>) {
        let mut stiffness = vec![0.0; self.x.len()];
        let mut count = vec![0.0; self.x.len()];
        for &(a, b, _) in &self.edges {
            let square = (self.x[a as usize] - self.x[b as usize]).norm_squared();
            for n in [a as usize, b as usize] {
                stiffness[n] += 1.0 / square;
                count[n] += 1.0;
            }
        }
        let mut hessian: Vec<Matrix3<f64>> = stiffness
            .iter()
            .zip(&count)
            .map(|(s, n)| Matrix3::from_diagonal_element(SHAPE_STIFFNESS * s / n))
            .collect();
        for side in &self.side {
            let spring = 2.0 * LOFT_WEIGHT / (LOFT_DISTANCE * LOFT_DISTANCE);
            let normal = self.loft.point(side.foot[0], side.foot[1]).normal();
            let spring = normal * normal.transpose() * (spring / 4.0);
            side.nodes.iter().for_each(|&n| hessian[n as usize] += spring);
        }
        for (node, _) in &self.anchors {
            let spring = 2.0 * ANCHOR_WEIGHT / (ANCHOR_DISTANCE * ANCHOR_DISTANCE);
            hessian[*node as usize] += Matrix3::from_diagonal_element(spring);
        }
        for plane in &self.planes {
            let spring = 2.0 * PLANE_WEIGHT / (PLANE_DISTANCE * PLANE_DISTANCE);
            for (&node, &weight) in plane.nodes.iter().zip(&plane.weights) {
                hessian[node as usize] +=
                    plane.normal * plane.normal.transpose() * (spring * weight * weight);
            }
        }
        for (node, _, normal) in &self.caps {
            let spring = 2.0 * CAP_WEIGHT / (CAP_DISTANCE * CAP_DISTANCE);
            hessian[*node as usize] += normal * normal.transpose() * spring;
        }
        let metric: Vec<Matrix3<f64>> =
            hessian.into_iter().map(|h| h.try_inverse().unwrap_or_else(Matrix3::zeros)).collect();
        let reach = stiffness.iter().zip(&count).map(|(s, n)| REACH * (n / s).sqrt()).collect();
        (metric, reach)
    }

    /// The objective at `x`; writes its gradient.
    pub fn objective(&mut self, x: &[Vector3<f64>], k: f64, gradient: &mut [Vector3<f64>]) -> f64 {
        gradient.fill(Vector3::zeros());
        let mut sum = 0.0;
        for cell in &self.cells {
            let corners = cell.map(|n| x[n as usize]);
            let mut slope = [Vector3::zeros(); 8];
            sum += cell_penalty(&corners, k, &mut slope);
            cell.iter().zip(slope).for_each(|(&n, g)| gradient[n as usize] += g);
        }
        for &(a, b, first) in &self.edges {
            let e = x[b as usize] - x[a as usize];
            let square = e.norm_squared();
            let log = (square / first).ln() / 2.0; // of the length
            sum += EDGE_WEIGHT * log * log;
            let slope = e * (2.0 * EDGE_WEIGHT * log / square);
            gradient[a as usize] -= slope;
            gradient[b as usize] += slope;
        }
        for side in &mut self.side {
            let p = side.at(x);
            let (foot, point) = self.loft.project(&p, side.foot, side.range);
            side.foot = foot;
            let away = (p - point.position) / LOFT_DISTANCE;
            sum += LOFT_WEIGHT * away.norm_squared();
            let slope = away * (2.0 * LOFT_WEIGHT / LOFT_DISTANCE / 4.0);
            side.nodes.iter().for_each(|&n| gradient[n as usize] += slope);
        }
        for (node, start, normal) in &self.caps {
            let away = (x[*node as usize] - start).dot(normal) / CAP_DISTANCE;
            sum += CAP_WEIGHT * away * away;
            gradient[*node as usize] += normal * (2.0 * CAP_WEIGHT * away / CAP_DISTANCE);
        }
        for (node, start) in &self.anchors {
            let away = (x[*node as usize] - start) / ANCHOR_DISTANCE;
            sum += ANCHOR_WEIGHT * away.norm_squared();
            gradient[*node as usize] += away * (2.0 * ANCHOR_WEIGHT / ANCHOR_DISTANCE);
        }
        for plane in &self.planes {
            let point: Vector3<f64> = (0..4).map(|i| x[plane.nodes[i] as usize] * plane.weights[i]).sum();
            let trespass = (plane.normal.dot(&point) - plane.offset) / PLANE_DISTANCE;
            if trespass > 0.0 {
                sum += PLANE_WEIGHT * trespass * trespass;
                let slope = plane.normal * (2.0 * PLANE_WEIGHT * trespass / PLANE_DISTANCE);
                for i in 0..4 {
                    gradient[plane.nodes[i] as usize] += slope * plane.weights[i];
                }
            }
        }
        let origin = x[0];
        let volume: f64 = self.faces.iter().map(|f| quad_volume(f.map(|n| x[n as usize] - origin))).sum();
        let weight = VOLUME_WEIGHT * self.cells.len() as f64;
        let error = volume / self.volume - 1.0;
        let slope = 2.0 * weight * error / self.volume;
        for face in &self.faces {
            let p = face.map(|n| x[n as usize] - origin);
            // By corner i the mean over the two splits into triangles gives (next × previous + … )/12.
            for i in 0..4 {
                let [next, across, previous] = [p[(i + 1) % 4], p[(i + 2) % 4], p[(i + 3) % 4]];
                let by = next.cross(&across) + across.cross(&previous) + next.cross(&previous);
                gradient[face[i] as usize] += by * (slope / 12.0);
            }
        }
        sum + weight * error * error
    }
}

/// Edges of a hexahedron.
const CELL_EDGES: [[usize; 2]; 12] =
    [[0, 1], [1, 2], [3, 2], [0, 3], [4, 5], [5, 6], [7, 6], [4, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
