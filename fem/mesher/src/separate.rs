//! Keeping muscles apart from each other and from the bones.
//!
//! Where two surfaces come close, the closest points of two triangles get a plane half way between them, normal to their distance,
//! and each side has to stay half the wanted gap away from it. Where surfaces cross, every point inside the other body and the
//! point of the surface nearest to it trade sides in the same way. The planes are found again after every round of smoothing, so that
//! the softer side gives way.
//!
//! Four nodes are not in one plane: a quadrilateral is read as two triangles along a diagonal (as files of surfaces want it) and as four
//! about the mean of its corners (as contact has it, [`fem::contact::surface`]). Surfaces are kept apart in both readings.

use nalgebra::Vector3;

use super::smooth::Plane;
use super::{Bone, MuscleBlock};
use fem::geometry::{Gap, SearchSurface, SignedDistance, Surface};
use fem::mesh::unique_nodes;

/// A closed surface that is searched for neighbours, with its points as means of nodes and mean normals at the points.
#[derive(Clone, Debug)]
pub struct Skin {
    /// The triangles.
    pub search: SearchSurface,
    /// What every point is a mean of.
    means: Vec<NodeMean>,
    normals: Vec<Vector3<f64>>,
}

/// A weighted mean of at most four nodes; nodes without weight may repeat others.
#[derive(Clone, Copy, Debug)]
struct NodeMean {
    nodes: [u32; 4],
    weights: [f64; 4],
}

impl NodeMean {
    fn node(n: u32) -> NodeMean {
        NodeMean { nodes: [n; 4], weights: [1.0, 0.0, 0.0, 0.0] }
    }

    fn at(&self, points: &[[f64; 3]]) -> Vector3<f64> {
        (0..4).map(|i| Vector3::from(points[self.nodes[i] as usize]) * self.weights[i]).sum()
    }

    /// Mean of means of altogether four nodes at most.
    fn of(parts: [(&NodeMean, f64); 3]) -> NodeMean {
        let mut sum = NodeMean { nodes: [parts[0].0.nodes[0]; 4], weights: [0.0; 4] };
        let mut n = 0;
        for (mean, fraction) in parts {
            for (&node, weight) in mean.nodes.iter().zip(mean.weights).filter(|(_, weight)| *weight != 0.0) {
                let slot = sum.nodes[..n].iter().position(|&known| known == node).unwrap_or(n);
                sum.nodes[slot] = node;
                sum.weights[slot] += fraction * weight;
                n = n.max(slot + 1);
            }
        }
        sum
    }
}

/// Planes for the two sides of close and crossing places.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    /// For the first surface.
    pub a: Vec<Plane>,
    /// For the second.
    pub b: Vec<Plane>,
}

/// A point of a skin.
struct Spot {
    mean: NodeMean,
    point: Vector3<f64>,
    normal: Vector3<f64>,
}

/// Surfaces count as facing each other from here on: sum of the cosines between the way across and the two normals.
const FACING: f64 = 0.5;
/// Surfaces that cross must not look the same way more than so much: cosine between their normals.
const OPPOSED: f64 = 0.5;
/// Largest way that is asked for at once \[m\]: the planes are true only close to where they were found.
const FARTHEST: f64 = 0.4e-3;
/// Deeper points are not pushed back the way they came \[m\].
const DEEPEST: f64 = 5e-3;

impl Skin {
    /// Of a muscle with its quadrilaterals cut in two along the diagonal of the smallest node.
    pub fn cut_in_two(block: &MuscleBlock) -> Skin {
        let (surface, nodes) = Surface::from_faces(&block.points, &block.surface());
        Skin::new(surface, nodes.into_iter().map(NodeMean::node).collect())
    }

    /// Of a muscle with its quadrilaterals cut in four about the means of their corners.
    pub fn cut_in_four(block: &MuscleBlock) -> Skin {
        let faces = block.surface();
        let nodes = unique_nodes(faces.iter().flatten().copied());
        let number = |n: u32| nodes.binary_search(&n).expect("nodes of the faces") as u32;
        let mut triangles = Vec::with_capacity(4 * faces.len());
        for (centre, face) in (nodes.len() as u32..).zip(&faces) {
            let corners = face.map(number);
            triangles.extend((0..4).map(|k| [corners[k], corners[(k + 1) % 4], centre]));
        }
        let centres = faces.iter().map(|&nodes| NodeMean { nodes, weights: [0.25; 4] });
        let means: Vec<NodeMean> = nodes.iter().map(|&n| NodeMean::node(n)).chain(centres).collect();
        let points = means.iter().map(|m| m.at(&block.points).into()).collect();
        Skin::new(Surface { points, triangles }, means)
    }

    /// Of a bone, which does not move.
    pub fn of_bone(bone: &Bone) -> Skin {
        let n = bone.surface.points.len() as u32;
        Skin::new(bone.surface.clone(), (0..n).map(NodeMean::node).collect())
    }

    fn new(surface: Surface, means: Vec<NodeMean>) -> Skin {
        let normals = point_normals(&surface);
        Skin { search: SearchSurface::new(surface), means, normals }
    }

    /// Follows the nodes.
    pub fn update(&mut self, points: &[[f64; 3]]) {
        let here: Vec<[f64; 3]> = self.means.iter().map(|m| m.at(points).into()).collect();
        self.search.set_points(&here);
        self.normals = point_normals(self.search.surface());
    }

    /// The bounding boxes come within `d` \[m\].
    pub fn is_near(&self, other: &Skin, d: f64) -> bool {
        let ((low, high), (other_low, other_high)) =
            (self.search.surface().bounds(), other.search.surface().bounds());
        (0..3).all(|i| low[i] - d <= other_high[i] && other_low[i] - d <= high[i])
    }

    /// Mesh nodes that move a triangle; some may come twice.
    pub fn nodes_of(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let corners = self.search.surface().triangles[triangle as usize];
        corners.into_iter().flat_map(|p| self.means[p as usize].nodes)
    }

    /// Mean normal at every mesh node that is a point of the surface.
    pub fn node_normals(&self) -> impl Iterator<Item = (u32, Vector3<f64>)> + '_ {
        let nodes = self.means.iter().zip(&self.normals).filter(|(mean, _)| mean.weights[0] == 1.0);
        nodes.map(|(mean, normal)| (mean.nodes[0], *normal))
    }

    fn spot(&self, triangle: u32, point: &Vector3<f64>) -> Spot {
        let surface = self.search.surface();
        let corners = surface.triangles[triangle as usize];
        let weights = barycentric(&surface.corners(triangle as usize), point);
        let normal: Vector3<f64> = (0..3).map(|i| self.normals[corners[i] as usize] * weights[i]).sum();
        let mean = NodeMean::of([0, 1, 2].map(|i| (&self.means[corners[i] as usize], weights[i])));
        Spot { mean, point: *point, normal: normal.normalize() }
    }

    fn corner(&self, point: usize) -> Spot {
        Spot {
            mean: self.means[point],
            point: Vector3::from(self.search.surface().points[point]),
            normal: self.normals[point],
        }
    }

    /// Points of this skin inside another, with the spot of the other's surface nearest to each.
    fn inside(&self, other: &Skin, signed: &SignedDistance) -> Vec<(Spot, Spot)> {
        let (low, high) = other.search.surface().bounds();
        let points = self.search.surface().points.iter().enumerate();
        let candidates = points.filter(|(_, p)| (0..3).all(|i| low[i] < p[i] && p[i] < high[i]));
        candidates
            .filter_map(|(i, p)| {
                let depth = signed.at(&Vector3::from(*p));
                let within = depth.distance < 0.0 && depth.distance > -DEEPEST;
                within.then(|| (self.corner(i), other.spot(depth.triangle, &depth.closest)))
            })
            .collect()
    }
}

/// Planes that shall bring two surfaces `gap` \[m\] apart; `fraction`: part of the way that the first one goes, 0..1.
///
/// `pairs` come from [`SearchSurface::pairs_within`].
pub fn planes(a: &Skin, b: &Skin, pairs: &[Gap], gap: f64, fraction: f64) -> Planes {
    let mut planes = Planes::default();
    let mut add = |on_a: &Spot, on_b: &Spot, normal: Vector3<f64>, apart: f64| {
        let plane = |spot: &Spot, normal: Vector3<f64>, way: f64| Plane {
            nodes: spot.mean.nodes,
            weights: spot.mean.weights,
            normal,
            offset: normal.dot(&spot.point) - way,
        };
        let way = (gap - apart).min(FARTHEST);
        planes.a.push(plane(on_a, normal, fraction * way));
        planes.b.push(plane(on_b, -normal, (1.0 - fraction) * way));
    };
    let mut crossing = false;
    for pair in pairs {
        let (on_a, on_b) = (a.spot(pair.a, &pair.closest.on_a), b.spot(pair.b, &pair.closest.on_b));
        let facing = on_a.normal - on_b.normal;
        let between = on_b.point - on_a.point;
        let distance = between.norm();
        if pair.closest.distance > 0.0 && distance > 0.0 {
            // Otherwise they look at each other through something thin, or one is inside the other.
            if between.dot(&facing) > FACING * distance {
                add(&on_a, &on_b, between / distance, distance);
            }
        } else {
            crossing = true;
            if fraction == 1.0 {
                add(&on_a, &on_b, -on_b.normal, 0.0); // a body that does not move shows the way out
            } else if on_a.normal.dot(&on_b.normal) < OPPOSED {
                add(&on_a, &on_b, facing.normalize(), 0.0);
            }
        }
    }
    if crossing {
        let signed = [a, b].map(|skin| SignedDistance::new(&skin.search).expect("a skin is closed"));
        for (on_a, on_b) in a.inside(b, &signed[1]) {
            let way = on_a.point - on_b.point; // from the surface of b to the point of a inside
            if let Some(normal) = way.try_normalize(0.0) {
                add(&on_a, &on_b, normal, -way.norm());
            }
        }
        for (on_b, on_a) in b.inside(a, &signed[0]) {
            let way = on_a.point - on_b.point;
            if let Some(normal) = way.try_normalize(0.0) {
                add(&on_a, &on_b, normal, -way.norm());
            }
        }
    }
    planes
}

/// Mean of the triangle normals at every point, weighted with their areas.
fn point_normals(surface: &Surface) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); surface.points.len()];
    for t in 0..surface.triangles.len() {
        let area = surface.area_vector(t);
        surface.triangles[t].iter().for_each(|&p| normals[p as usize] += area);
    }
    normals.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

/// Weights of the corners in a point of a triangle.
fn barycentric(t: &[Vector3<f64>; 3], p: &Vector3<f64>) -> [f64; 3] {
    let (u, v, w) = (t[1] - t[0], t[2] - t[0], p - t[0]);
    let n = u.cross(&v);
    let size = n.norm_squared();
    let (b, c) = (w.cross(&v).dot(&n) / size, u.cross(&w).dot(&n) / size);
    [1.0 - b - c, b, c]
}
