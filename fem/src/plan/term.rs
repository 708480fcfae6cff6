//! Terms: what a scene asks for, in mesh numbering, before it is split over the islands.

use super::SceneError;
use super::error::nearest;
use crate::effect::Effect;
use crate::mesh::{CellBlock, Mesh};
use nalgebra::Vector3;

/// Makes the effect of some groups of a [`Term`]: (name, points \[m\] of the island, nodes of the groups in the island's
/// numbering, indices of the groups).
pub type Builder = Box<dyn Fn(&str, &[[f64; 3]], &[u32], &[u32]) -> Result<Box<dyn Effect>, SceneError>>;

/// Makes a caller's own terms over a mesh.
pub type OwnTerms<'a> = &'a dyn Fn(&Mesh, &mut Names) -> Result<Vec<Term>, SceneError>;

/// One effect over the whole mesh.
pub struct Term {
    /// Name, as reported.
    pub name: String,
    /// Nodes of each group.
    pub nodes_per_group: usize,
    /// Nodes of all groups.
    pub nodes: Vec<u32>,
    /// Whether a group connects its nodes; dead loads do not.
    pub couples: bool,
    /// Makes the effect.
    pub build: Builder,
}

/// Controls and bodies, numbered as they are first named.
#[derive(Default)]
pub struct Names {
    /// Controls.
    pub controls: Vec<String>,
    /// Bodies.
    pub bodies: Vec<String>,
}

impl Names {
    /// Index of a control.
    pub fn control(&mut self, name: &str) -> usize {
        index(&mut self.controls, name)
    }

    /// Index of a body.
    pub fn body(&mut self, name: &str) -> usize {
        index(&mut self.bodies, name)
    }
}

fn index(list: &mut Vec<String>, name: &str) -> usize {
    list.iter().position(|n| n == name).unwrap_or_else(|| {
        list.push(name.to_string());
        list.len() - 1
    })
}

/// A block of the mesh.
pub fn cells_of<'a>(mesh: &'a Mesh, name: &str, user: &str) -> Result<&'a CellBlock, SceneError> {
    mesh.blocks.iter().find(|b| b.name == name).ok_or_else(|| SceneError::Unknown {
        user: user.to_string(),
        what: "block of cells",
        name: name.to_string(),
        nearest: nearest(name, mesh.blocks.iter().map(|b| b.name.as_str())),
    })
}

/// A node set of the mesh; refuses empty ones.
pub fn set_of<'a>(mesh: &'a Mesh, name: &str, user: &str) -> Result<&'a [u32], SceneError> {
    let nodes = mesh.node_sets.get(name).map(Vec::as_slice).ok_or_else(|| SceneError::Unknown {
        user: user.to_string(),
        what: "node set",
        name: name.to_string(),
        nearest: nearest(name, mesh.node_sets.keys().map(String::as_str)),
    })?;
    match nodes.is_empty() {
        true => Err(SceneError::EmptySet { user: user.to_string(), name: name.to_string() }),
        false => Ok(nodes),
    }
}

/// Refuses a value that is not a number or not `good`.
pub fn check(
    user: &str,
    quantity: &str,
    value: f64,
    good: bool,
    must: &'static str,
) -> Result<(), SceneError> {
    if good && value.is_finite() {
        return Ok(());
    }
    Err(SceneError::Value { user: user.to_string(), quantity: quantity.to_string(), value, must })
}

/// The direction of a vector.
pub fn unit(user: &str, v: [f64; 3]) -> Result<Vector3<f64>, SceneError> {
    let v = Vector3::from(v);
    check(user, "length of a direction", v.norm(), v.norm() > 0.0, "positive")?;
    Ok(v.normalize())
}
