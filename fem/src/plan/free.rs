//! Free bodies: rigid bodies whose poses are unknowns.
//!
//! A free body is an affine body (Lan et al., ACM Trans. Graph. 41, 67, 2022): its points are x = c + A (X − c₀) with twelve unknowns, and a
//! stiff potential keeps A a rotation. The twelve unknowns are the places of four nodes, its *frame*: c₀ and three points at a
//! distance s from it along the axes. The potential is that of a cell over the frame, (2 s)³ E/8 ‖AᵀA − I‖²: a cube of edge 2 s of a St.
//! Venant-Kirchhoff solid with Young's modulus E and ν = 0.
//!
//! Every node that rides on the body is a fixed mean of the frame. So collision detection along straight ways stays valid, and the
//! solver sees nothing but nodes and a solid.

#![allow(non_snake_case)]

use super::error::{Mistakes, nearest};
use super::term::{Builder, Names, Term, check};
use super::{Motion, SceneError};
use crate::body::Pose;
use crate::effect::{DeadLoad, Effect, FollowerForce};
use crate::geometry::rotation::nearest_rotation;
use crate::mesh::{CellBlock, CellKind, Mesh};
use crate::scene::{BodyForceSpec, Coordinate, FreeBodySpec, LawSpec, Scene, SolidSpec};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Size \[m\] of a frame where all nodes that ride on it are at one place.
const OF_A_POINT: f64 = 0.01;
/// Volume of a cube of edge 2 s over that of the cell over the frame, s³/6.
const CUBE: f64 = 48.0;

/// Entries of R = Rz Rx Ry that vanish with the angle about z, x and y.
const TURNS: [(Coordinate, (usize, usize)); 3] =
    [(Coordinate::TurnZ, (0, 1)), (Coordinate::TurnX, (2, 1)), (Coordinate::TurnY, (2, 0))];
/// Turns in which they are brought back at most; three reach round-off from 30 degrees.
const MAX_TURNS: usize = 5;
/// Slope below which an entry does not change with a turn.
const LEAST_SLOPE: f64 = 1e-6;

/// A body whose pose is an unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeBody {
    /// Name as in the scene.
    pub name: String,
    /// Nodes of its frame: its origin, and the points along x, y and z from it.
    pub frame: [u32; 4],
    /// Its origin in the mesh \[m\].
    pub origin: [f64; 3],
    /// Distance \[m\] of the other three from it.
    pub size: f64,
    /// Coordinates that are held.
    pub held: Vec<Coordinate>,
}

impl FreeBody {
    /// Weights of the frame in the place of the point of the body that is at `X` \[m\] in the mesh; they add up to 1.
    pub fn weights(&self, X: [f64; 3]) -> [(u32, f64); 4] {
        let [a, b, c] = std::array::from_fn(|i| (X[i] - self.origin[i]) / self.size);
        let [o, x, y, z] = self.frame;
        [(o, 1.0 - a - b - c), (x, a), (y, b), (z, c)]
    }

    /// Its origin and A, with the nodes of the mesh at `x` \[m\], 3 per node.
    fn map(&self, x: &[f64]) -> (Vector3<f64>, Matrix3<f64>) {
        let [o, a, b, c] = self.frame.map(|n| Vector3::from_column_slice(&x[3 * n as usize..][..3]));
        (o, Matrix3::from_columns(&[a - o, b - o, c - o]) / self.size)
    }

    /// Places \[m\] of its frame when it comes from `from` near `to` and turns by what `to` would shear it: A goes to exp(ω) (A + dA − ω A),
    /// ω the skew part of dA A⁻¹, and not to A + dA, which would stretch it by ω²/2. Held angles stay.
    pub(super) fn turned(&self, from: &[f64], to: &[f64]) -> [Vector3<f64>; 4] {
        let ((_, before), (origin, straight)) = (self.map(from), self.map(to));
        let step = straight - before;
        let rate = before.try_inverse().map_or(Matrix3::zeros(), |inverse| step * inverse);
        let skew = 0.5 * (rate - rate.transpose());
        let turn = Rotation3::new(Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]));
        let A = self.with_held_entries(turn * (straight - skew * before), &straight);
        [0, 1, 2, 3].map(|n| if n == 0 { origin } else { origin + self.size * A.column(n - 1) })
    }

    /// A turned a little, so that its entries that are held with angles are those of `straight` again.
    fn with_held_entries(&self, mut A: Matrix3<f64>, straight: &Matrix3<f64>) -> Matrix3<f64> {
        let held: Vec<(usize, usize)> =
            TURNS.iter().filter(|t| self.held.contains(&t.0)).map(|t| t.1).collect();
        if held.is_empty() {
            return A;
        }
        for _ in 0..MAX_TURNS {
            let (mut off, mut slopes) = (Vector3::zeros(), Matrix3::zeros());
            for (i, &(r, c)) in held.iter().enumerate() {
                off[i] = straight[(r, c)] - A[(r, c)];
                let column: Vector3<f64> = A.column(c).into();
                (0..3).for_each(|axis| slopes[(i, axis)] = Vector3::ith(axis, 1.0).cross(&column)[r]);
            }
            if off.amax() <= f64::EPSILON {
                break;
            }
            let Ok(inverse) = slopes.pseudo_inverse(LEAST_SLOPE) else { break };
            A = Rotation3::new(inverse * off) * A;
        }
        A
    }

    /// Its pose with the nodes of the mesh at `x` \[m\], 3 per node; the rotation is the one nearest to A.
    pub fn pose(&self, x: &[f64]) -> Pose {
        let (origin, A) = self.map(x);
        let R = Rotation3::from_matrix_unchecked(nearest_rotation(&A));
        let rotation = UnitQuaternion::from_rotation_matrix(&R);
        Pose::from_parts((origin - rotation * Vector3::from(self.origin)).into(), rotation)
    }

    /// Greatest strain of its frame: so far is it from rigid.
    pub fn strain(&self, x: &[f64]) -> f64 {
        self.map(x).1.singular_values().iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max)
    }

    /// What is held of its frame: node, component, and the node whose displacement it takes over.
    pub(super) fn holds(&self) -> Vec<(u32, usize, Motion)> {
        let [o, x, y, _] = self.frame;
        let is_held = |c: Coordinate| self.held.contains(&c);
        let places = [Coordinate::X, Coordinate::Y, Coordinate::Z];
        let along = |c: usize| if is_held(places[c]) { Motion::Held } else { Motion::Follows(o) };
        let shifts = (0..3).filter(|&c| is_held(places[c])).map(|c| (o, c, Motion::Held));
        let turned = TURNS.iter().filter(|t| is_held(t.0));
        let turned = turned.map(|&(_, (r, c))| (if c == 0 { x } else { y }, r, along(r)));
        shifts.chain(turned).collect()
    }
}

/// Block of the mesh that holds the cell of a free body.
fn block_name(body: &str) -> String {
    format!("{body} (free body)")
}

/// Adds the frames of a scene's free bodies to its mesh, and their cells to its solids.
pub fn add(scene: &mut Scene, mesh: &mut Mesh) -> Result<Vec<FreeBody>, SceneError> {
    let mut mistakes = Mistakes::default();
    let specs = scene.free_bodies.clone();
    if let (Some(first), true) = (specs.first(), scene.inertia.is_some()) {
        mistakes.add(SceneError::Massless { body: first.body.clone() });
    }
    let mut bodies = Vec::new();
    for (i, spec) in specs.iter().enumerate() {
        if specs[..i].iter().any(|other| other.body == spec.body) {
            mistakes.add(SceneError::Twice { what: "free body", name: spec.body.clone() });
        }
        bodies.extend(mistakes.keep(add_one(spec, scene, mesh)));
    }
    mistakes.end().map(|()| bodies)
}

fn add_one(spec: &FreeBodySpec, scene: &mut Scene, mesh: &mut Mesh) -> Result<FreeBody, SceneError> {
    let user = format!("free body `{}`", spec.body);
    check(&user, "young [Pa]", spec.young, spec.young > 0.0, "positive")?;
    let ties = scene.ties.iter().filter(|t| t.body == spec.body);
    let sets: Vec<&Vec<u32>> = ties.filter_map(|t| mesh.node_sets.get(&t.nodes)).collect();
    let places: Vec<Vector3<f64>> =
        sets.into_iter().flatten().map(|&n| mesh.points[n as usize].into()).collect();
    if scene.ties.iter().all(|t| t.body != spec.body) {
        let known = scene.ties.iter().map(|t| t.body.as_str());
        return Err(SceneError::Unknown {
            user,
            what: "body of a tie",
            name: spec.body.clone(),
            nearest: nearest(&spec.body, known),
        });
    }
    let n = places.len().max(1) as f64;
    let mean = places.iter().sum::<Vector3<f64>>() / n;
    let origin = spec.origin.map_or(mean, Vector3::from);
    for (axis, value) in ["x", "y", "z"].iter().zip(&origin) {
        check(&user, &format!("origin along {axis} [m]"), *value, true, "a finite number")?;
    }
    // Of the nodes about their mean: a frame far away is as large as the body.
    let square = places.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / n;
    let size = if square > 0.0 { square.sqrt() } else { OF_A_POINT };
    let first = mesh.points.len() as u32;
    let frame = std::array::from_fn(|i| first + i as u32);
    mesh.points.push(origin.into());
    mesh.points.extend((0..3).map(|c| <[f64; 3]>::from(origin + Vector3::ith(c, size))));
    let name = block_name(&spec.body);
    mesh.blocks.push(CellBlock { name: name.clone(), kind: CellKind::Tet4, nodes: frame.to_vec() });
    let law = LawSpec::StVenantKirchhoff { young: spec.young, nu: 0.0 };
    scene.solids.push(SolidSpec { density: 0.0, scale: vec![CUBE], ..SolidSpec::new(&name, law) });
    Ok(FreeBody { name: spec.body.clone(), frame, origin: origin.into(), size, held: spec.held.clone() })
}

/// The term of a force on a free body, over its frame.
pub fn force(spec: &BodyForceSpec, bodies: &[FreeBody], names: &mut Names) -> Result<Term, SceneError> {
    let user = format!("body force `{}`", spec.name);
    let body = bodies.iter().find(|body| body.name == spec.body).ok_or_else(|| SceneError::Unknown {
        user: user.clone(),
        what: "free body",
        name: spec.body.clone(),
        nearest: nearest(&spec.body, bodies.iter().map(|b| b.name.as_str())),
    })?;
    for (axis, c) in ["x", "y", "z"].iter().zip(0..3) {
        check(&user, &format!("point along {axis} [m]"), spec.point[c], true, "a finite number")?;
        check(&user, &format!("force along {axis} [N]"), spec.force[c], true, "a finite number")?;
    }
    let control = names.control(&spec.control);
    let weights = body.weights(spec.point).map(|(_, w)| w);
    let (force, follows, size) = (spec.force, spec.follows, body.size);
    let build: Builder = Box::new(move |name, _, nodes, _| {
        let frame: [u32; 4] = nodes.try_into().expect("the frame of one body");
        Ok(match follows {
            false => {
                let loads: Vec<_> =
                    frame.iter().zip(weights).map(|(&n, w)| (n, force.map(|f| w * f))).collect();
                Box::new(DeadLoad::new(name, control, &loads)) as Box<dyn Effect>
            }
            true => Box::new(FollowerForce::new(name, control, frame, weights, force, size)),
        })
    });
    let (name, nodes) = (spec.name.clone(), body.frame.to_vec());
    match follows {
        // A dead load is a sum over single nodes.
        false => Ok(Term { name, nodes_per_group: 1, nodes, couples: false, build }),
        true => Ok(Term { name, nodes_per_group: 4, nodes, couples: true, build }),
    }
}
