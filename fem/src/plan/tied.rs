//! Groups of an effect some nodes of which follow others or slide in directions that are no axes.

use super::load::Motion;
use super::slide::Slide;
use crate::effect::NO_NODE;
use std::collections::BTreeMap;

/// A group with followers: its nodes with their masters, and which rows move onto which.
pub(super) struct TiedGroup {
    pub(super) effect: usize,
    pub(super) group: usize,
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
) -> TiedGroup {
    let mut nodes = members.to_vec();
    let mut moves = Vec::new();
    for (p, &n) in members.iter().enumerate().filter(|(_, n)| **n != NO_NODE) {
        for c in 0..3 {
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
    TiedGroup { effect, group, nodes, moves, slides: sliding }
}
