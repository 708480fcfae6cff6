//! Order of elimination and structure of a factor, found once per pattern.

use super::Pattern;
use super::ordering::{Supernode, by_degree, dissect, elimination_work};
use rayon::prelude::*;
use std::sync::Arc;

/// Order of elimination and structure of the factor: depends on the pattern only.
#[derive(Debug)]
pub struct Analysis {
    pub(super) pattern: Arc<Pattern>,
    /// Node at each place of the elimination order.
    pub(super) order: Vec<u32>,
    /// Children before parents; a subtree is contiguous. The last one is the root and owns no nodes.
    pub(super) fronts: Vec<Front>,
}

/// One dense front. Places are places in the elimination order.
#[derive(Debug)]
pub(super) struct Front {
    /// First place it eliminates, and how many.
    pub(super) first: usize,
    pub(super) n_columns: usize,
    /// Later places coupled with it, ascending.
    pub(super) rows: Vec<u32>,
    /// Where the parent's front keeps each of `rows`: an index into (columns, rows) of the parent.
    pub(super) in_parent: Vec<u32>,
    pub(super) children: Vec<usize>,
    /// First front and first place of its subtree.
    pub(super) subtree: (usize, usize),
    /// What it takes from the matrix: block, row and column in this front; lower triangle.
    pub(super) entries: Vec<(u32, u32, u32)>,
    /// Multiply-adds of the subtree.
    pub(super) work: f64,
}

impl Front {
    /// Unknowns of the front: own, and own and passed on together.
    pub(super) fn sizes(&self) -> (usize, usize) {
        (3 * self.n_columns, 3 * (self.n_columns + self.rows.len()))
    }
}

impl Analysis {
    /// Symbolic factorization in the order of least work. `points`: a place for every node (three coordinates each), used to divide the
    /// graph only.
    pub fn new(pattern: &Arc<Pattern>, points: &[f64]) -> Analysis {
        let (divided, by_degree) = rayon::join(
            || Analysis::of(pattern, dissect(pattern, points)),
            || by_degree(pattern).map(|roots| Analysis::of(pattern, roots)),
        );
        let analyses = std::iter::once(divided).chain(by_degree);
        let mut best = analyses.min_by(|a, b| a.work().total_cmp(&b.work())).expect("there is one");
        best.find_entries();
        best
    }

    /// Fronts of the given sets, without entries yet.
    fn of(pattern: &Arc<Pattern>, roots: Vec<Supernode>) -> Analysis {
        let mut this = Analysis { pattern: pattern.clone(), order: Vec::new(), fronts: Vec::new() };
        this.number(&Supernode { nodes: Vec::new(), children: roots });
        this.find_rows(&this.places());
        this
    }

    /// Place of each node in the elimination order.
    fn places(&self) -> Vec<u32> {
        let mut place = vec![0_u32; self.order.len()];
        for (p, &node) in self.order.iter().enumerate() {
            place[node as usize] = p as u32;
        }
        place
    }

    /// Numbers nodes and fronts, children first; returns the index of the front of `set`.
    fn number(&mut self, set: &Supernode) -> usize {
        let subtree = (self.fronts.len(), self.order.len());
        let children: Vec<usize> = set.children.iter().map(|c| self.number(c)).collect();
        let first = self.order.len();
        self.order.extend(&set.nodes);
        let n_columns = set.nodes.len();
        let (rows, in_parent, entries) = (Vec::new(), Vec::new(), Vec::new());
        self.fronts.push(Front { first, n_columns, rows, in_parent, children, subtree, entries, work: 0.0 });
        self.fronts.len() - 1
    }

    fn find_rows(&mut self, place: &[u32]) {
        for f in 0..self.fronts.len() {
            let front = &self.fronts[f];
            let end = (front.first + front.n_columns) as u32;
            let mut rows: Vec<u32> = self.order[front.first..end as usize]
                .iter()
                .flat_map(|&node| self.pattern.row(node as usize))
                .map(|&node| place[node as usize])
                .chain(front.children.iter().flat_map(|&c| self.fronts[c].rows.iter().copied()))
                .filter(|&p| p >= end)
                .collect();
            rows.sort_unstable();
            rows.dedup();
            let (first, n_columns) = (front.first, front.n_columns);
            let mut work = 0.0;
            for c in front.children.clone() {
                let local = |&p: &u32| {
                    let p = p as usize;
                    if p < first + n_columns {
                        (p - first) as u32
                    } else {
                        (n_columns + rows.binary_search(&(p as u32)).expect("parent has its child's rows"))
                            as u32
                    }
                };
                self.fronts[c].in_parent = self.fronts[c].rows.iter().map(local).collect();
                work += self.fronts[c].work;
            }
            let front = &mut self.fronts[f];
            front.rows = rows;
            let (own, all) = front.sizes();
            front.work = work + elimination_work(own as f64, (all - own) as f64);
        }
    }

    fn find_entries(&mut self) {
        let place = self.places();
        let (order, pattern) = (&self.order, &self.pattern);
        self.fronts.par_iter_mut().for_each(|front| {
            let end = front.first + front.n_columns;
            for (column, &node) in order[front.first..end].iter().enumerate() {
                let start = pattern.row_start()[node as usize];
                for (k, &other) in pattern.row(node as usize).iter().enumerate() {
                    let p = place[other as usize];
                    let row = match p as usize {
                        p if p < front.first + column => continue,
                        p if p < end => p - front.first,
                        _ => front.n_columns + front.rows.binary_search(&p).expect("row is in the front"),
                    };
                    front.entries.push(((start + k) as u32, row as u32, column as u32));
                }
            }
        });
    }

    /// Numbers stored in the factor.
    pub fn n_values(&self) -> usize {
        self.fronts.iter().map(|f| f.sizes().0 * f.sizes().1).sum()
    }

    /// Multiply-adds of one factorization.
    pub fn work(&self) -> f64 {
        self.fronts[self.fronts.len() - 1].work
    }
}
