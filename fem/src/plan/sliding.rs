//! Terms of what slides over a rigid solid, for [`Plan::with_terms`](super::Plan::with_terms): strings, and samples of bodies or nodes on it.

use super::term::{Builder, Term};
use crate::effect::obstacle::{Layer, Obstacle, Sample};
use crate::effect::sling::{NODES, Pull, Slings};
use crate::effect::Effect;
use crate::geometry::DistanceField;
use std::sync::Arc;

/// Strings over their nodes, from end to end, with what pulls in each.
pub fn strings(name: &str, strings: &[[u32; NODES]], pulls: Vec<Pull>) -> Term {
    let build: Builder = Box::new(move |name, points, nodes, groups| {
        let (strings, _) = nodes.as_chunks::<NODES>();
        let pulls = groups.iter().map(|g| pulls[*g as usize]).collect();
        Ok(Box::new(Slings::new(name, points, strings, pulls)) as Box<dyn Effect>)
    });
    let nodes = strings.as_flattened().to_vec();
    Term { name: name.into(), nodes_per_group: NODES, nodes, couples: true, build }
}

/// Groups of `M` nodes whose samples rest on a solid.
pub fn resting<const M: usize>(
    name: &str,
    field: &Arc<DistanceField>,
    layer: Layer,
    groups: &[[u32; M]],
    samples: Vec<Vec<Sample<M>>>,
) -> Term {
    let field = field.clone();
    let build: Builder = Box::new(move |name, _, nodes, groups| {
        let (nodes, _) = nodes.as_chunks::<M>();
        let samples = groups.iter().map(|g| samples[*g as usize].clone()).collect();
        Ok(Box::new(Obstacle::new(name, field.clone(), layer, nodes, samples)) as Box<dyn Effect>)
    });
    Term { name: name.into(), nodes_per_group: M, nodes: groups.as_flattened().to_vec(), couples: true, build }
}
