//! Symmetric sparse matrix of 3×3 blocks, one block row per free node.
//!
//! Both triangles are stored, so that a product is a sum over rows (parallel, same bits on any number of threads).
//! The pattern and the place of every group's blocks are found once; assembly is then a sum without search.

use rayon::prelude::*;
use std::sync::Arc;

/// Marks a prescribed node in lists of free-node indices: its rows and columns are left out.
pub const PRESCRIBED: u32 = u32::MAX;

/// Groups whose matrices are held at once during assembly: about 5 MB for hex8, at most 40 MB where groups are large.
fn groups_at_once(nodes_per_group: usize) -> usize {
    (5_000_000 / (9 * nodes_per_group * nodes_per_group)).clamp(16, 1024)
}

/// Which pairs of free nodes are coupled. Symmetric; the diagonal is always there.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// First block of each row; `n_nodes + 1`.
    row_start: Vec<usize>,
    /// Column of each block, ascending in each row.
    column: Vec<u32>,
}

impl Pattern {
    /// Pattern of `n_nodes` free nodes where the nodes of each group (an element, say) are coupled with each other.
    ///
    /// Entries equal to [`PRESCRIBED`] are skipped.
    pub fn new<'a>(n_nodes: usize, groups: impl Iterator<Item = &'a [u32]> + Clone) -> Pattern {
        let mut touching = vec![0_usize; n_nodes + 1];
        for group in groups.clone() {
            for &node in group.iter().filter(|&&n| n != PRESCRIBED) {
                touching[node as usize + 1] += 1;
            }
        }
        for i in 0..n_nodes {
            touching[i + 1] += touching[i];
        }
        let groups: Vec<&[u32]> = groups.collect();
        let mut next = touching.clone();
        let mut groups_of = vec![0_u32; touching[n_nodes]];
        for (g, group) in groups.iter().enumerate() {
            for &node in group.iter().filter(|&&n| n != PRESCRIBED) {
                groups_of[next[node as usize]] = g as u32;
                next[node as usize] += 1;
            }
        }
        let rows: Vec<Vec<u32>> = (0..n_nodes)
            .into_par_iter()
            .map(|i| {
                let mut row = vec![i as u32];
                for &g in &groups_of[touching[i]..touching[i + 1]] {
                    row.extend(groups[g as usize].iter().filter(|&&n| n != PRESCRIBED));
                }
                row.sort_unstable();
                row.dedup();
                row
            })
            .collect();
        let mut row_start = Vec::with_capacity(n_nodes + 1);
        row_start.push(0);
        for row in &rows {
            row_start.push(row_start[row_start.len() - 1] + row.len());
        }
        Pattern { row_start, column: rows.concat() }
    }

    /// Number of free nodes.
    pub fn n_nodes(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Number of 3×3 blocks, both triangles.
    pub fn n_blocks(&self) -> usize {
        self.column.len()
    }

    /// Nodes coupled with `node`, itself included, ascending.
    pub fn row(&self, node: usize) -> &[u32] {
        &self.column[self.row_start[node]..self.row_start[node + 1]]
    }

    /// First block of each row; `n_nodes + 1`.
    pub fn row_start(&self) -> &[usize] {
        &self.row_start
    }

    /// Where the blocks of equal groups of `nodes_per_group` nodes lie. `nodes`: free-node index or [`PRESCRIBED`],
    /// group after group. Panics where the pattern lacks a pair.
    pub fn slots(&self, nodes_per_group: usize, nodes: &[u32]) -> Slots {
        let m = nodes_per_group;
        assert!(m > 0 && nodes.len().is_multiple_of(m), "{} nodes in groups of {m}", nodes.len());
        let mut slot = vec![PRESCRIBED; nodes.len() * m];
        slot.par_chunks_mut(m).enumerate().for_each(|(entry, slots)| {
            let row = nodes[entry];
            if row == PRESCRIBED {
                return;
            }
            let start = self.row_start[row as usize];
            let group = entry / m;
            for (slot, &column) in slots.iter_mut().zip(&nodes[group * m..(group + 1) * m]) {
                if column != PRESCRIBED {
                    let at = self.row(row as usize).binary_search(&column).expect("pair is in the pattern");
                    *slot = (at + start) as u32;
                }
            }
        });
        let mut by_row = Vec::with_capacity(nodes.len());
        let mut batch_start = vec![0];
        for (batch, nodes) in nodes.chunks(groups_at_once(m) * m).enumerate() {
            let first = by_row.len();
            let offset = batch * groups_at_once(m) * m;
            by_row.extend((0..nodes.len()).filter(|&a| nodes[a] != PRESCRIBED).map(|a| (offset + a) as u32));
            by_row[first..].sort_by_key(|&entry| nodes[entry as usize - offset]);
            batch_start.push(by_row.len());
        }
        Slots { nodes_per_group: m, nodes: nodes.to_vec(), slot, by_row, batch_start }
    }
}

/// Places of the blocks of equal groups (the elements of one block of cells) in a [`BlockMatrix`], and the order in
/// which their contributions are summed.
#[derive(Clone, Debug)]
pub struct Slots {
    nodes_per_group: usize,
    /// Free node of each entry, `nodes_per_group` per group.
    nodes: Vec<u32>,
    /// Block of (entry, other node of its group), `nodes_per_group` per entry.
    slot: Vec<u32>,
    /// Entries of each batch of groups sorted by their free node.
    by_row: Vec<u32>,
    batch_start: Vec<usize>,
}

impl Slots {
    /// Number of groups.
    pub fn n_groups(&self) -> usize {
        self.nodes.len() / self.nodes_per_group
    }

    /// Adds a vector of `3 · nodes_per_group` per group to `g`: `fill(first, out)` overwrites the vectors
    /// of `out.len() / (3 · nodes_per_group)` groups from `first` on, at most `batch` at a time (zeroed before).
    ///
    /// Summed in the order of the groups: same bits on any number of threads.
    pub fn add_vectors(&self, g: &mut [f64], batch: usize, fill: impl Fn(usize, &mut [f64]) + Sync) {
        self.add_rows::<3>(g, batch, fill);
    }

    /// Adds `W` values per node of each group to those of its free node in `sums`, see [`add_vectors`](Slots::add_vectors).
    pub fn add_rows<const W: usize>(
        &self,
        sums: &mut [f64],
        batch: usize,
        fill: impl Fn(usize, &mut [f64]) + Sync,
    ) {
        let m = self.nodes_per_group;
        self.for_each_batch(W * m, batch, fill, |first_entry, entries, values| {
            self.scatter(
                sums,
                |node| W * node,
                entries,
                |entry, offset, sums: &mut [f64]| {
                    let from = &values[W * (entry - first_entry)..][..W];
                    let to = W * self.nodes[entry] as usize - offset;
                    for (to, from) in sums[to..to + W].iter_mut().zip(from) {
                        *to += from;
                    }
                },
            );
        });
    }

    /// Computes the groups' values batch by batch (parallel) and hands each batch with its entries to `add`.
    fn for_each_batch(
        &self,
        size: usize,
        batch: usize,
        fill: impl Fn(usize, &mut [f64]) + Sync,
        mut add: impl FnMut(usize, &[u32], &[f64]),
    ) {
        let n_groups = self.n_groups();
        let at_once = groups_at_once(self.nodes_per_group);
        let batch = batch.clamp(1, at_once);
        let mut values = vec![0.0; size * n_groups.min(at_once)];
        for (b, first) in (0..n_groups).step_by(at_once).enumerate() {
            let values = &mut values[..size * (n_groups - first).min(at_once)];
            values.par_chunks_mut(size * batch).enumerate().for_each(|(c, values)| {
                values.fill(0.0);
                fill(first + c * batch, values);
            });
            let entries = &self.by_row[self.batch_start[b]..self.batch_start[b + 1]];
            add(first * self.nodes_per_group, entries, values);
        }
    }

    /// Adds sorted `entries` to `target` in parallel pieces that own whole rows. `start(node)`: index in `target` of the
    /// first value of a node's row.
    fn scatter<T: Send>(
        &self,
        target: &mut [T],
        start: impl Fn(usize) -> usize,
        entries: &[u32],
        add: impl Fn(usize, usize, &mut [T]) + Sync,
    ) {
        let mut pieces = Vec::new();
        let mut target = target;
        let mut offset = 0; // of `target` in the whole
        let mut entries = entries;
        let piece = entries.len().div_ceil(16).max(64);
        while !entries.is_empty() {
            let mut n = piece.min(entries.len());
            let last = self.nodes[entries[n - 1] as usize];
            n += entries[n..].iter().take_while(|&&e| self.nodes[e as usize] == last).count();
            let begin = start(self.nodes[entries[0] as usize] as usize);
            let end = start(last as usize + 1);
            let (mine, rest) = std::mem::take(&mut target)[begin - offset..].split_at_mut(end - begin);
            target = rest;
            offset = end;
            let (now, later) = entries.split_at(n);
            entries = later;
            pieces.push((begin, now, mine));
        }
        pieces.into_par_iter().for_each(|(offset, entries, target)| {
            for &entry in entries {
                add(entry as usize, offset, target);
            }
        });
    }
}

/// Symmetric matrix of 3×3 blocks on a [`Pattern`].
#[derive(Clone, Debug)]
pub struct BlockMatrix {
    pattern: Arc<Pattern>,
    /// Blocks in the order of the pattern, each row-major.
    blocks: Vec<[f64; 9]>,
    /// Blocks outside the pattern, which come and go with contact.
    cross: Cross,
}

/// Blocks outside a pattern, in the order of their rows and columns; symmetric, without the diagonal.
#[derive(Clone, Debug, Default)]
struct Cross {
    /// First block of each row; empty where there are none at all.
    row_start: Vec<usize>,
    column: Vec<u32>,
    blocks: Vec<[f64; 9]>,
}

impl Cross {
    fn row(&self, node: usize) -> std::ops::Range<usize> {
        match self.row_start.is_empty() {
            true => 0..0,
            false => self.row_start[node]..self.row_start[node + 1],
        }
    }
}

fn add(to: &mut [f64; 9], from: &[f64; 9]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
}

impl BlockMatrix {
    /// The zero matrix on a pattern.
    pub fn zeros(pattern: Arc<Pattern>) -> BlockMatrix {
        let blocks = vec![[0.0; 9]; pattern.n_blocks()];
        BlockMatrix { pattern, blocks, cross: Cross::default() }
    }

    /// The pattern.
    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// Blocks of row `node` in the order of `pattern().row(node)`, each row-major.
    pub fn row(&self, node: usize) -> &[[f64; 9]] {
        &self.blocks[self.pattern.row_start[node]..self.pattern.row_start[node + 1]]
    }

    /// Block number `index` of the pattern, row-major.
    pub fn block(&self, index: usize) -> &[f64; 9] {
        &self.blocks[index]
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.blocks.par_iter_mut().with_min_len(4096).for_each(|b| *b = [0.0; 9]);
        self.cross = Cross::default();
    }

    /// Adds `block` (row-major) to block (`row`, `column`); the caller adds its transpose to (`column`, `row`).
    /// Panics where the pattern lacks it. For single terms; groups of equal size go through [`add_groups`](Self::add_groups).
    pub fn add_block(&mut self, row: usize, column: usize, block: &[f64; 9]) {
        let at = self.pattern.row(row).binary_search(&(column as u32)).expect("block is in the pattern");
        let at = at + self.pattern.row_start[row];
        add(&mut self.blocks[at], block);
    }

    /// Adds the symmetric matrices of equal groups: `fill(first, out)` overwrites the `3m × 3m` row-major matrices of
    /// `out.len() / (9 m²)` consecutive groups from `first` on, at most `batch` at a time (zeroed before);
    /// m is the number of nodes per group. Rows and columns of prescribed nodes are left out.
    ///
    /// Summed in the order of the groups: same bits on any number of threads.
    pub fn add_groups(&mut self, slots: &Slots, batch: usize, fill: impl Fn(usize, &mut [f64]) + Sync) {
        let m = slots.nodes_per_group;
        let n = 3 * m;
        let BlockMatrix { pattern, blocks, .. } = self;
        slots.for_each_batch(n * n, batch, fill, |first_entry, entries, matrices| {
            slots.scatter(
                blocks,
                |node| pattern.row_start[node],
                entries,
                |entry, offset, blocks| {
                    let row = &matrices[3 * n * (entry - first_entry)..][..3 * n];
                    for (b, &slot) in slots.slot[entry * m..(entry + 1) * m].iter().enumerate() {
                        if slot == PRESCRIBED {
                            continue;
                        }
                        let block = &mut blocks[slot as usize - offset];
                        for i in 0..3 {
                            for j in 0..3 {
                                block[3 * i + j] += row[i * n + 3 * b + j];
                            }
                        }
                    }
                },
            );
        });
    }

    /// Calls `change` with every row, its columns and its blocks, rows in parallel.
    pub fn each_row(&mut self, change: impl Fn(usize, &[u32], &mut [[f64; 9]]) + Sync) {
        let BlockMatrix { pattern, blocks, .. } = self;
        let mut rest = blocks.as_mut_slice();
        let rows: Vec<&mut [[f64; 9]]> = (0..pattern.n_nodes())
            .map(|i| rest.split_off_mut(..pattern.row(i).len()).expect("the rows make up the matrix"))
            .collect();
        let rows = rows.into_par_iter().enumerate().with_min_len(64);
        rows.for_each(|(i, row)| change(i, pattern.row(i), row));
    }

    /// Adds symmetric `blocks`, ascending by (row, column): those outside the pattern are kept apart.
    pub fn couple(&mut self, blocks: &[([u32; 2], [f64; 9])]) {
        let mut outside = Vec::new();
        for &([row, column], block) in blocks {
            let start = self.pattern.row_start[row as usize];
            match self.pattern.row(row as usize).binary_search(&column) {
                Ok(at) => add(&mut self.blocks[start + at], &block),
                Err(_) => outside.push(([row, column], block)),
            }
        }
        if outside.is_empty() {
            return;
        }
        let known = (0..self.pattern.n_nodes()).flat_map(|row| {
            let cross = &self.cross;
            cross.row(row).map(move |at| ([row as u32, cross.column[at]], cross.blocks[at]))
        });
        let mut all: Vec<([u32; 2], [f64; 9])> = known.chain(outside).collect();
        all.sort_by_key(|block| block.0);
        all.dedup_by(|from, to| {
            let same = from.0 == to.0;
            if same {
                add(&mut to.1, &from.1);
            }
            same
        });
        let mut cross = Cross::default();
        for ([row, column], block) in all {
            cross.row_start.resize(row as usize + 1, cross.column.len());
            cross.column.push(column);
            cross.blocks.push(block);
        }
        cross.row_start.resize(self.pattern.n_nodes() + 1, cross.column.len());
        self.cross = cross;
    }

    /// Number of blocks outside the pattern.
    pub fn n_cross(&self) -> usize {
        self.cross.column.len()
    }

    /// Whether `pattern` has all blocks of this matrix, those outside its own pattern too.
    pub fn fits(&self, pattern: &Pattern) -> bool {
        let fits = |i: usize| {
            let row = pattern.row(i);
            self.cross.row(i).all(|at| row.binary_search(&self.cross.column[at]).is_ok())
        };
        (0..self.pattern.n_nodes()).all(fits)
    }

    /// The pattern of all blocks, those outside the own pattern too.
    pub fn joint_pattern(&self) -> Pattern {
        let mut joint = Pattern { row_start: vec![0], column: Vec::new() };
        for i in 0..self.pattern.n_nodes() {
            let first = joint.column.len();
            joint.column.extend(self.pattern.row(i));
            joint.column.extend(&self.cross.column[self.cross.row(i)]);
            joint.column[first..].sort_unstable();
            joint.row_start.push(joint.column.len());
        }
        joint
    }

    /// All blocks on a pattern that they [fit](Self::fits).
    pub fn spread(&self, pattern: &Arc<Pattern>) -> BlockMatrix {
        let mut joint = BlockMatrix::zeros(pattern.clone());
        joint.each_row(|i, columns, row| {
            let mine = self.pattern.row(i).iter().zip(self.row(i));
            let cross = self.cross.row(i).map(|at| (&self.cross.column[at], &self.cross.blocks[at]));
            for (column, block) in mine.chain(cross) {
                let at = columns.binary_search(column).expect("the matrix fits the pattern");
                row[at] = *block;
            }
        });
        joint
    }

    /// Cuts the unknowns flagged in `fixed` loose: their rows and columns become zero but for a positive diagonal.
    /// Empty `fixed`: none.
    pub fn constrain(&mut self, fixed: &[bool]) {
        if fixed.is_empty() {
            return;
        }
        let BlockMatrix { pattern, blocks, cross } = self;
        for i in 0..pattern.n_nodes() {
            for at in cross.row(i) {
                let j = cross.column[at] as usize;
                for e in 0..9 {
                    if fixed[3 * i + e / 3] || fixed[3 * j + e % 3] {
                        cross.blocks[at][e] = 0.0;
                    }
                }
            }
            for at in pattern.row_start[i]..pattern.row_start[i + 1] {
                let j = pattern.column[at] as usize;
                for r in 0..3 {
                    for c in 0..3 {
                        let entry = &mut blocks[at][3 * r + c];
                        if (i, r) == (j, c) {
                            if fixed[3 * i + r] && *entry <= 0.0 {
                                *entry = 1.0;
                            }
                        } else if fixed[3 * i + r] || fixed[3 * j + c] {
                            *entry = 0.0;
                        }
                    }
                }
            }
        }
    }

    /// Adds to every diagonal entry `fraction` of its size, at least `fraction` of a thousandth of the largest.
    pub fn shift(&mut self, fraction: f64) {
        let largest = (0..3 * self.pattern.n_nodes()).map(|i| self.diagonal(i).abs()).fold(0.0, f64::max);
        for i in 0..self.pattern.n_nodes() {
            let at = self.pattern.row(i).binary_search(&(i as u32)).expect("the diagonal is in the pattern");
            let block = &mut self.blocks[self.pattern.row_start[i] + at];
            for c in 0..3 {
                block[4 * c] += fraction * block[4 * c].abs().max(1e-3 * largest);
            }
        }
    }

    /// y = K x.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let rows = 256;
        y.par_chunks_mut(3 * rows).enumerate().for_each(|(chunk, y)| {
            for (i, y) in y.chunks_exact_mut(3).enumerate() {
                let node = chunk * rows + i;
                let mut sum = [0.0; 3];
                for (&column, b) in self.pattern.row(node).iter().zip(self.row(node)) {
                    let x = &x[3 * column as usize..3 * column as usize + 3];
                    for r in 0..3 {
                        sum[r] += b[3 * r] * x[0] + b[3 * r + 1] * x[1] + b[3 * r + 2] * x[2];
                    }
                }
                for at in self.cross.row(node) {
                    let (column, b) = (self.cross.column[at] as usize, &self.cross.blocks[at]);
                    let x = &x[3 * column..3 * column + 3];
                    for r in 0..3 {
                        sum[r] += b[3 * r] * x[0] + b[3 * r + 1] * x[1] + b[3 * r + 2] * x[2];
                    }
                }
                y.copy_from_slice(&sum);
            }
        });
    }

    /// Error \[N\] by round-off of a gradient at `x` of which this is the Hessian, computed from positions relative to each other: the last
    /// digit of every product of a stiffness and a difference of positions, added up as errors of any sign are. Against 32 digits, the error
    /// of 95 % of 1362 random equilibria was below it. Rows of `fixed` unknowns do not count.
    pub fn gradient_round_off(&self, x: &[f64], fixed: &[bool]) -> f64 {
        let mut sum = 0.0;
        for a in 0..self.pattern.n_nodes() {
            let rows = [0, 1, 2].map(|i| if fixed.get(3 * a + i) == Some(&true) { 0.0 } else { 1.0 });
            let mut add = |column: u32, block: &[f64; 9]| {
                let b = 3 * column as usize;
                let u = [0, 1, 2].map(|j| x[b + j] - x[3 * a + j]);
                for (i, row) in rows.iter().enumerate() {
                    sum += (0..3).map(|j| row * (block[3 * i + j] * u[j]).powi(2)).sum::<f64>();
                }
            };
            self.pattern.row(a).iter().zip(self.row(a)).for_each(|(&column, block)| add(column, block));
            self.cross.row(a).for_each(|at| add(self.cross.column[at], &self.cross.blocks[at]));
        }
        f64::EPSILON * sum.sqrt()
    }

    /// Block of a node with itself, row-major.
    pub fn diagonal_block(&self, node: usize) -> &[f64; 9] {
        let at =
            self.pattern.row(node).binary_search(&(node as u32)).expect("the diagonal is in the pattern");
        &self.row(node)[at]
    }

    /// Diagonal entry of unknown `i`.
    pub fn diagonal(&self, i: usize) -> f64 {
        let node = i / 3;
        let at =
            self.pattern.row(node).binary_search(&(node as u32)).expect("the diagonal is in the pattern");
        self.row(node)[at][4 * (i % 3)]
    }
}
