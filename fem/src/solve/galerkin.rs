//! The stiffness Wᵀ K W of nodes of which others are fixed means.
//!
//! K is put together over all nodes, those that are means among them; one product then hands every pair of nodes on once, however many groups
//! share it. The product goes by rows, first H = K W, then Wᵀ H, each row by one thread: same bits on any number of threads.

use super::block_matrix::{BlockMatrix, Pattern};
use rayon::prelude::*;
use std::sync::Arc;

/// Nodes and the free nodes that they are means of.
#[derive(Clone, Debug)]
pub struct Galerkin {
    /// Pattern of K.
    pattern: Arc<Pattern>,
    /// Of each node of K the free nodes that it is a mean of, with their weights: rows of W.
    means: Vec<Vec<(u32, f64)>>,
    /// Columns of each row of H, ascending.
    columns: Vec<Vec<u32>>,
    /// Of each free node the nodes of K of which it is a part: rows of Wᵀ.
    parts: Vec<Vec<(u32, f64)>>,
}

impl Galerkin {
    /// Of `n_free` free nodes.
    pub fn new(pattern: Arc<Pattern>, means: Vec<Vec<(u32, f64)>>, n_free: usize) -> Galerkin {
        assert_eq!(pattern.n_nodes(), means.len(), "a mean per node");
        let row = |i: usize| {
            let free = pattern.row(i).iter().flat_map(|&j| &means[j as usize]).map(|(q, _)| *q);
            let mut columns: Vec<u32> = free.collect();
            columns.sort_unstable();
            columns.dedup();
            columns
        };
        let columns = (0..means.len()).map(row).collect();
        let mut parts = vec![Vec::new(); n_free];
        for (i, mean) in means.iter().enumerate() {
            mean.iter().for_each(|&(p, w)| parts[p as usize].push((i as u32, w)));
        }
        Galerkin { pattern, means, columns, parts }
    }

    /// Pattern of K.
    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// Free nodes that Wᵀ K W couples.
    pub fn pairs(&self) -> Vec<[u32; 2]> {
        let of = |p: usize| {
            let parts = self.parts[p].iter().flat_map(|(i, _)| &self.columns[*i as usize]);
            let mut row: Vec<u32> = parts.copied().collect();
            row.sort_unstable();
            row.dedup();
            row.into_iter().map(move |q| [p as u32, q])
        };
        (0..self.parts.len()).flat_map(of).collect()
    }

    /// Adds Wᵀ f to forces on the free nodes; 3 components per node.
    pub fn add_forces(&self, f: &[f64], out: &mut [f64]) {
        for (mean, f) in self.means.iter().zip(f.as_chunks::<3>().0) {
            for &(p, w) in mean {
                (0..3).for_each(|c| out[3 * p as usize + c] += w * f[c]);
            }
        }
    }

    /// Adds Wᵀ K W to a matrix whose pattern has all [pairs](Self::pairs).
    pub fn add_stiffness(&self, k: &BlockMatrix, out: &mut BlockMatrix) {
        let half = |i: usize| {
            let columns = &self.columns[i];
            let mut row = vec![[0.0; 9]; columns.len()];
            for (&j, block) in self.pattern.row(i).iter().zip(k.row(i)) {
                for &(q, w) in &self.means[j as usize] {
                    let to = &mut row[columns.binary_search(&q).expect("a column of the row")];
                    (0..9).for_each(|e| to[e] += w * block[e]);
                }
            }
            row
        };
        let halves: Vec<Vec<[f64; 9]>> = (0..self.means.len()).into_par_iter().map(half).collect();
        out.each_row(|p, columns, row| {
            for &(i, w) in &self.parts[p] {
                // Both ascend.
                let mut at = 0;
                for (q, block) in self.columns[i as usize].iter().zip(&halves[i as usize]) {
                    at += columns[at..].iter().position(|c| c == q).expect("the pattern has the pair");
                    (0..9).for_each(|e| row[at][e] += w * block[e]);
                }
            }
        });
    }
}
