//! Nodes that take over from others or slide in directions that are no axes: which unknowns move them, and how forces and blocks on them go
//! to these unknowns.

#![allow(non_snake_case)]

use super::island::Island;
use super::load::Motion;
use crate::effect::NO_NODE;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// A block between local nodes \[N/m\].
type Block = ([u32; 2], [f64; 9]);

impl Island {
    /// Moves the blocks of nodes that are means of others onto these.
    fn onto_means(&self, blocks: Vec<Block>) -> Vec<Block> {
        if self.means.is_empty() {
            return blocks;
        }
        // Columns first, row by row, then rows: a block of two such nodes would go to sixteen places at once.
        let fold = |blocks: &[Block], side: usize| {
            let mut sums = BTreeMap::<[u32; 2], [f64; 9]>::new();
            for (at, block) in blocks {
                let own = [(at[side], 1.0)];
                for &(node, weight) in self.means.get(&at[side]).map_or(&own[..], Vec::as_slice) {
                    let mut to = *at;
                    to[side] = node;
                    let sum = sums.entry(to).or_insert([0.0; 9]);
                    (0..9).for_each(|e| sum[e] += weight * block[e]);
                }
            }
            sums.into_iter().collect::<Vec<Block>>()
        };
        let is_moved = |n: &u32| self.motion[*n as usize].iter().any(Motion::is_unknown);
        let moved: Vec<Block> = blocks.into_iter().filter(|(at, _)| at.iter().all(is_moved)).collect();
        fold(&fold(&moved, 1), 0)
    }

    /// Moves nodes that are means of others in `x` \[m\] to where these want them.
    fn blend(&self, x: &mut [f64]) {
        for (&n, mean) in &self.means {
            for c in 0..3 {
                x[3 * n as usize + c] = mean.iter().map(|(of, w)| w * x[3 * *of as usize + c]).sum();
            }
        }
    }

    /// The free node that a local node is.
    pub(super) fn free_index(&self, local: u32) -> Option<usize> {
        if local == NO_NODE {
            return None;
        }
        self.free_nodes.binary_search(&local).ok()
    }

    /// The unknown that a component of a local node moves with: its free node and component; none where prescribed.
    pub(super) fn unknown(&self, node: u32, c: usize) -> Option<(u32, usize)> {
        let owner = match self.motion[node as usize][c] {
            Motion::Free | Motion::Slides(_) => node,
            Motion::Follows(master) => master,
            _ => return None,
        };
        self.free_index(owner).map(|free| (free as u32, c))
    }

    /// The free nodes whose unknowns move a local node, with the matrices T of u = Σ T ũ.
    fn movers(&self, node: u32) -> Vec<(u32, Matrix3<f64>)> {
        if let Some(slide) = self.slides.get(&node) {
            let own = self.free_index(node).map(|free| (free as u32, slide.free));
            let leader =
                slide.follows.and_then(|(m, n, w)| Some((self.free_index(m)? as u32, w * n.transpose())));
            return own.into_iter().chain(leader).collect();
        }
        let single = |c: usize| {
            let mut T = Matrix3::zeros();
            T[(c, c)] = 1.0;
            self.unknown(node, c).map(|(free, _)| (free, T))
        };
        (0..3).filter_map(single).collect()
    }

    /// Moves blocks between local nodes onto their unknowns; ascending by (row, column).
    pub(super) fn onto_unknowns(&self, blocks: Vec<([u32; 2], [f64; 9])>) -> Vec<([u32; 2], [f64; 9])> {
        let blocks = self.onto_means(blocks);
        let mut out: Vec<([u32; 2], [f64; 9])> = Vec::with_capacity(blocks.len());
        for ([i, j], block) in blocks {
            if [i, j].iter().all(|&n| self.is_free(n)) {
                let free = |n| self.free_index(n).expect("a free node") as u32;
                out.push(([free(i), free(j)], block));
                continue;
            }
            if [i, j].iter().any(|n| self.slides.contains_key(n)) {
                let B = Matrix3::from_row_slice(&block);
                for (row, Ti) in self.movers(i) {
                    for (column, Tj) in self.movers(j) {
                        let moved = Ti.transpose() * B * Tj;
                        out.push(([row, column], std::array::from_fn(|e| moved[(e / 3, e % 3)])));
                    }
                }
                continue;
            }
            for e in 0..9 {
                if let (Some((row, r)), Some((column, c))) = (self.unknown(i, e / 3), self.unknown(j, e % 3))
                {
                    let mut single = [0.0; 9];
                    single[3 * r + c] = block[e];
                    out.push(([row, column], single));
                }
            }
        }
        out.sort_by_key(|b| b.0);
        out.dedup_by(|from, to| {
            let same = from.0 == to.0;
            if same {
                to.1.iter_mut().zip(&from.1).for_each(|(to, from)| *to += from);
            }
            same
        });
        out
    }

    /// Adds forces \[N\] on all local nodes to those on the unknowns that move them.
    pub(super) fn add_onto_unknowns(&self, forces: &[f64], g: &mut [f64]) {
        let with_means: Vec<f64>;
        let mut forces = forces;
        if !self.means.is_empty() {
            let mut sums = forces.to_vec();
            for (&n, mean) in &self.means {
                for c in 0..3 {
                    let force = std::mem::take(&mut sums[3 * n as usize + c]);
                    mean.iter().for_each(|(of, w)| sums[3 * *of as usize + c] += w * force);
                }
            }
            with_means = sums;
            forces = &with_means;
        }
        for (&n, slide) in &self.slides {
            let mut f: Vec<f64> = forces[3 * n as usize..3 * n as usize + 3].to_vec();
            f.resize(6, 0.0);
            slide.redistribute(&mut f, |i| i, 0, Some(1));
            let leader = slide.follows.and_then(|(m, ..)| self.free_index(m));
            for (free, f) in [(self.free_index(n), &f[..3]), (leader, &f[3..])] {
                if let Some(free) = free {
                    (0..3).for_each(|c| g[3 * free + c] += f[c]);
                }
            }
        }
        for (i, force) in forces.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            if self.slides.contains_key(&((i / 3) as u32)) {
                continue;
            }
            if let Some((free, c)) = self.unknown((i / 3) as u32, i % 3) {
                g[3 * free as usize + c] += force;
            }
        }
    }

    /// Moves nodes that slide in `x` \[m\] to where the controls and their own ways take them, followers to where their masters want them.
    pub(super) fn follow(&self, controls: &[f64], x: &mut [f64]) {
        for (&n, slide) in &self.slides {
            let i = 3 * n as usize;
            let X = Vector3::from_column_slice(&self.X[i..i + 3]);
            let own = slide.free * (Vector3::from_column_slice(&x[i..i + 3]) - X);
            x[i..i + 3].copy_from_slice((X + own + slide.prescribed(controls)).as_slice());
        }
        for (&n, slide) in &self.slides {
            if let Some((m, normal, w)) = slide.follows {
                let m = 3 * m as usize;
                let along: f64 = (0..3).map(|c| normal[c] * (x[m + c] - self.X[m + c])).sum();
                (0..3).for_each(|c| x[3 * n as usize + c] += w[c] * along);
            }
        }
        for &n in &self.free_nodes {
            for c in 0..3 {
                if let Motion::Follows(master) = self.motion[n as usize][c] {
                    let (i, m) = (3 * n as usize + c, 3 * master as usize + c);
                    x[i] = self.X[i] + (x[m] - self.X[m]);
                }
            }
        }
        self.blend(x);
    }
}
