//! Groups of an effect some nodes of which follow others or slide in directions that are no axes.

use super::load::{Mean, Motion};
use super::slide::Slide;
use crate::effect::NO_NODE;
use std::collections::BTreeMap;

/// A group with followers: its nodes with their masters, and which rows move onto which.
pub(super) struct TiedGroup {
    pub(super) effect: usize,
    pub(super) group: usize,
    /// Places among `nodes` of those that are means of others, each with places and weights of these.
    pub(super) means: Vec<(usize, Vec<(usize, f64)>)>,
    /// Local nodes, those of the group first.
    pub(super) nodes: Vec<u32>,
    /// (row of the follower, row of its master), 3 per node.
    pub(super) moves: Vec<(usize, usize)>,
    /// Places among `nodes` of those that slide, and of those that they follow.
    pub(super) slides: Vec<(usize, Option<usize>)>,
}

/// The group `members` of an effect with whom its nodes follow.
pub(super) fn tied_group(
    effect: usize,
    group: usize,
    members: &[u32],
    motion: &[[Motion; 3]],
    slides: &BTreeMap<u32, Slide>,
    means: &BTreeMap<u32, Mean>,
) -> TiedGroup {
    let mut nodes = members.to_vec();
    let mut blended = Vec::new();
    for (p, n) in members.iter().enumerate() {
        if let Some(mean) = means.get(n) {
            let place = |&(of, weight): &(u32, f64)| {
                let known = nodes.iter().position(|m| *m == of);
                let q = known.unwrap_or_else(|| {
                    nodes.push(of);
                    nodes.len() - 1
                });
                (q, weight)
            };
            blended.push((p, mean.iter().map(place).collect()));
        }
    }
    let mut moves = Vec::new();
    for p in 0..nodes.len() {
        let n = nodes[p];
        for c in (0..3).filter(|_| n != NO_NODE) {
            if let Motion::Follows(master) = motion[n as usize][c] {
                let q = nodes.iter().position(|&m| m == master).unwrap_or_else(|| {
                    nodes.push(master);
                    nodes.len() - 1
                });
                moves.push((3 * p + c, 3 * q + c));
            }
        }
    }
    let mut sliding = Vec::new();
    for p in 0..nodes.len() {
        if let Some(slide) = slides.get(&nodes[p]) {
            let leader = slide.follows.map(|(leader, ..)| {
                nodes.iter().position(|&m| m == leader).unwrap_or_else(|| {
                    nodes.push(leader);
                    nodes.len() - 1
                })
            });
            sliding.push((p, leader));
        }
    }
    TiedGroup { effect, group, means: blended, nodes, moves, slides: sliding }
}
