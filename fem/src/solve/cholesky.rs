//! Multifrontal Cholesky factorization L Lᵀ of a [`BlockMatrix`].
//!
//! Every set of nodes eliminated together is one dense front, see [`Analysis`]. A front adds what its children passed on, eliminates its columns with faer's dense kernels and
//! passes the rest to its parent. Subtrees run in parallel, the large fronts near the root tile by tile; what is added
//! to what never depends on the number of threads. Duff & Reid, The multifrontal solution of indefinite sparse
//! symmetric linear equations, ACM Trans. Math. Softw. 9 (1983); Liu, The multifrontal method, SIAM Review 34 (1992).

#![allow(non_snake_case)]

use super::BlockMatrix;
use super::analysis::{Analysis, Front};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::{matmul, triangular};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

/// Columns eliminated at once, and width of the tiles that run in parallel.
const TILE: usize = 192;
/// Work \[multiply-adds\] below which a front is not worth dividing into tiles.
const DIVISIBLE: f64 = 2e7;

/// Number type of a factor: `f64`, or `f32` for a factor that only preconditions (half the memory and time).
pub trait Scalar: faer::traits::RealField + Copy + Default + Send + Sync {
    /// Rounds.
    fn from_f64(value: f64) -> Self;
    /// Exact.
    fn to_f64(self) -> f64;
}

impl Scalar for f64 {
    fn from_f64(value: f64) -> f64 {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
}

impl Scalar for f32 {
    fn from_f64(value: f64) -> f32 {
        value as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

/// The matrix is not positive definite: elimination met a pivot that is not positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indefinite {
    /// The unknown whose pivot it was.
    pub unknown: usize,
}

/// The factor of one matrix; its memory is kept for the next: fresh pages from the system cost an eighth of the time of a solution.
#[derive(Debug)]
pub struct Cholesky<T: Scalar> {
    analysis: Arc<Analysis>,
    /// Of each front its columns, all rows, column-major; one front after the other.
    values: Vec<T>,
    /// What fronts have passed on in, to be used again.
    spare: Spare<T>,
}

/// Numbers passed from a front to its parent: the lower triangle of a square column-major matrix.
type Passed<T> = Vec<T>;

/// Memory that nobody uses now.
#[derive(Debug)]
struct Spare<T>(Mutex<Vec<Vec<T>>>);

impl<T: Scalar> Spare<T> {
    /// `n` zeros, in the smallest piece that holds them; where none does, a new piece takes the place of the largest.
    fn zeros(&self, n: usize) -> Vec<T> {
        let mut piece = {
            let mut pieces = self.0.lock().expect("no thread panics while it looks for a piece");
            let sizes = || pieces.iter().map(Vec::capacity).enumerate();
            let fits = sizes().filter(|(_, size)| *size >= n).min_by_key(|(_, size)| *size);
            match (fits, sizes().max_by_key(|(_, size)| *size)) {
                (Some((i, _)), _) => pieces.swap_remove(i),
                (None, Some((i, _))) => {
                    drop(pieces.swap_remove(i));
                    Vec::new()
                }
                (None, None) => Vec::new(),
            }
        };
        piece.clear();
        piece.resize(n, T::default());
        piece
    }

    fn give_back(&self, piece: Vec<T>) {
        self.0.lock().expect("no thread panics while it gives a piece back").push(piece);
    }
}

impl<T: Scalar> Cholesky<T> {
    /// Nothing factorized yet.
    pub fn new(analysis: Arc<Analysis>) -> Cholesky<T> {
        Cholesky { analysis, values: Vec::new(), spare: Spare(Mutex::default()) }
    }

    /// For matrices of another pattern from now on, with the same memory; nothing factorized yet.
    pub fn renew(&mut self, analysis: Arc<Analysis>) {
        self.analysis = analysis;
    }

    /// The columns of each front.
    fn panels(&self) -> Vec<&[T]> {
        let mut rest = &self.values[..];
        let mut next = |front: &Front| {
            let (own, all) = front.sizes();
            let (panel, later) = rest.split_at(own * all);
            rest = later;
            panel
        };
        self.analysis.fronts.iter().map(&mut next).collect()
    }

    /// The analysis it was made from.
    pub fn analysis(&self) -> &Arc<Analysis> {
        &self.analysis
    }

    /// Factorizes `k`. After an error the factor must not be used.
    pub fn factorize(&mut self, k: &BlockMatrix) -> Result<(), Indefinite> {
        let Cholesky { analysis, values, spare } = self;
        assert!(k.pattern().n_blocks() == analysis.pattern.n_blocks(), "the matrix has the analysed pattern");
        let n = analysis.n_values();
        if values.capacity() < n {
            *values = Vec::new(); // given back before more is taken
            // The next joint matrix is often a little larger, and memory that is not touched costs nothing.
            values.reserve_exact(n + n / 4);
        }
        values.resize(n, T::default());
        let mut rest = &mut values[..];
        let mut panels = Vec::with_capacity(analysis.fronts.len());
        for front in &analysis.fronts {
            let (own, all) = front.sizes();
            let (panel, later) = rest.split_at_mut(own * all);
            panels.push(panel);
            rest = later;
        }
        factorize_subtree(analysis, k, panels.len() - 1, &mut panels, spare).map(|_| ())
    }

    /// Replaces `b` by the solution of L Lᵀ x = b.
    pub fn solve(&self, b: &mut [f64]) {
        let analysis = &*self.analysis;
        let mut x = vec![T::default(); b.len()];
        for (x, &node) in x.chunks_exact_mut(3).zip(&analysis.order) {
            for (i, x) in x.iter_mut().enumerate() {
                *x = T::from_f64(b[3 * node as usize + i]);
            }
        }
        let (panels, root) = (self.panels(), analysis.fronts.len() - 1);
        forward(analysis, &panels, root, &mut x);
        backward(analysis, &panels, root, &[], &mut x);
        for (x, &node) in x.chunks_exact(3).zip(&analysis.order) {
            for (i, x) in x.iter().enumerate() {
                b[3 * node as usize + i] = x.to_f64();
            }
        }
    }

    /// Least ratio of a pivot to the diagonal entry it came from, and its unknown: near the round-off of `T` where the
    /// matrix is singular.
    pub fn least_pivot(&self, k: &BlockMatrix) -> (f64, usize) {
        let mut least = (f64::INFINITY, 0);
        for (front, panel) in self.analysis.fronts.iter().zip(self.panels()) {
            let (own, all) = front.sizes();
            for i in 0..own {
                let unknown = 3 * self.analysis.order[front.first + i / 3] as usize + i % 3;
                let ratio = panel[i * all + i].to_f64().powi(2) / k.diagonal(unknown);
                if ratio < least.0 {
                    least = (ratio, unknown);
                }
            }
        }
        least
    }
}

/// Runs `run` on every child of front `f`, in parallel where worth it, each with its part of `panels` (those of the
/// subtree of `f`).
fn each_child<P: Send, R: Send>(
    analysis: &Analysis,
    children: &[usize],
    panels: &mut [P],
    offset: usize,
    run: &(impl Fn(usize, &mut [P]) -> R + Sync),
    out: &mut Vec<R>,
) {
    match children {
        [] => {}
        [child] => {
            out.push(run(*child, &mut panels[analysis.fronts[*child].subtree.0 - offset..=child - offset]))
        }
        _ => {
            let (low, high) = children.split_at(children.len() / 2);
            let cut = analysis.fronts[high[0]].subtree.0;
            let (low_panels, high_panels) = panels.split_at_mut(cut - offset);
            let work: f64 = children.iter().map(|&c| analysis.fronts[c].work).sum();
            let mut more = Vec::new();
            if work > 1e5 {
                rayon::join(
                    || each_child(analysis, low, low_panels, offset, run, out),
                    || each_child(analysis, high, high_panels, cut, run, &mut more),
                );
            } else {
                each_child(analysis, low, low_panels, offset, run, out);
                each_child(analysis, high, high_panels, cut, run, &mut more);
            }
            out.append(&mut more);
        }
    }
}

fn factorize_subtree<T: Scalar>(
    analysis: &Analysis,
    k: &BlockMatrix,
    f: usize,
    panels: &mut [&mut [T]],
    spare: &Spare<T>,
) -> Result<Passed<T>, Indefinite> {
    let front = &analysis.fronts[f];
    let offset = front.subtree.0;
    let mut passed = Vec::with_capacity(front.children.len());
    let run = |child: usize, panels: &mut [&mut [T]]| factorize_subtree(analysis, k, child, panels, spare);
    each_child(analysis, &front.children, panels, offset, &run, &mut passed);

    let (own, all) = front.sizes();
    let rest = all - own;
    let panel = &mut *panels[f - offset];
    panel.fill(T::default());
    for &(block, row, column) in &front.entries {
        let block = k.block(block as usize); // block (column, row) of the symmetric matrix
        for j in 0..3 {
            for i in 0..3 {
                panel[(3 * column as usize + j) * all + 3 * row as usize + i] = T::from_f64(block[3 * j + i]);
            }
        }
    }
    let mut pass = spare.zeros(rest * rest);
    for (&child, passed) in front.children.iter().zip(passed) {
        let passed = passed?;
        extend_add(&analysis.fronts[child].in_parent, &passed, panel, &mut pass, own, all);
        spare.give_back(passed);
    }
    if own > 0 {
        let unknown = |i: usize| 3 * analysis.order[front.first + i / 3] as usize + i % 3;
        let divisible = own as f64 * all as f64 * all as f64 > DIVISIBLE;
        eliminate(panel, &mut pass, own, all, divisible).map_err(|i| Indefinite { unknown: unknown(i) })?;
    }
    Ok(pass)
}

/// Adds what a child passed on (lower triangle) to its parent's columns and to what the parent passes on itself.
fn extend_add<T: Scalar>(
    in_parent: &[u32],
    passed: &[T],
    panel: &mut [T],
    pass: &mut [T],
    own: usize,
    all: usize,
) {
    let n = 3 * in_parent.len();
    let rest = all - own;
    for (b, &to) in in_parent.iter().enumerate() {
        for j in 0..3 {
            let from = &passed[(3 * b + j) * n..][..n];
            let column = 3 * to as usize + j;
            // Rows above `own` of a later column do not occur: places ascend.
            let (target, skip) = match column < own {
                true => (&mut panel[column * all..][..all], 0),
                false => (&mut pass[(column - own) * rest..][..rest], own),
            };
            for (from, &row) in from[3 * b..].chunks_exact(3).zip(&in_parent[b..]) {
                let at = 3 * row as usize - skip;
                for (to, from) in target[at..at + 3].iter_mut().zip(from) {
                    *to += *from;
                }
            }
        }
    }
}

/// Eliminates the `own` columns of a front: `panel` becomes its columns of L, `pass` gets −L₂₁ L₂₁ᵀ (lower triangle).
/// The error is the index of the pivot that is not positive.
fn eliminate<T: Scalar>(
    panel: &mut [T],
    pass: &mut [T],
    own: usize,
    all: usize,
    divisible: bool,
) -> Result<(), usize> {
    let mut panel = MatMut::from_column_major_slice_mut(panel, all, own);
    let mut scratch =
        MemBuffer::new(cholesky_in_place_scratch::<T>(TILE.min(own), Par::Seq, Default::default()));
    for start in (0..own).step_by(TILE) {
        let width = TILE.min(own - start);
        let (columns, mut later) = panel.rb_mut().get_mut(start.., start..).split_at_col_mut(width);
        let (mut diagonal, mut below) = columns.split_at_row_mut(width);
        let stack = MemStack::new(&mut scratch);
        cholesky_in_place(diagonal.rb_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|faer::linalg::cholesky::llt::factor::LltError::NonPositivePivot { index }| {
                start + index
            })?;
        if let Some(i) = (0..width).find(|&i| diagonal[(i, i)].to_f64().is_nan()) {
            return Err(start + i); // a NaN passes faer's test
        }
        let diagonal = diagonal.rb();
        let divide = |rows: MatMut<'_, T>| {
            solve_lower_triangular_in_place(diagonal, rows.transpose_mut(), Par::Seq);
        };
        if divisible && below.nrows() > 0 {
            below.rb_mut().par_row_chunks_mut(TILE).for_each(divide);
        } else {
            divide(below.rb_mut());
        }
        if later.ncols() > 0 {
            let later = later.rb_mut().get_mut(width.., ..);
            subtract_square(later, below.rb(), divisible);
        }
    }
    let rest = all - own;
    if rest > 0 {
        let pass = MatMut::from_column_major_slice_mut(pass, rest, rest);
        subtract_square(pass, panel.rb().get(own.., ..), divisible);
    }
    Ok(())
}

/// A −= L Lᵀ on and below the diagonal of the first `A.ncols()` columns.
fn subtract_square<T: Scalar>(A: MatMut<'_, T>, L: MatRef<'_, T>, divisible: bool) {
    let n = A.nrows();
    let minus = -T::one_impl();
    let tile = |(t, A): (usize, MatMut<'_, T>)| {
        let start = t * TILE;
        let width = A.ncols();
        let (top, below) = A.get_mut(start.., ..).split_at_row_mut(width);
        let right = L.get(start..start + width, ..);
        triangular::matmul(
            top,
            triangular::BlockStructure::TriangularLower,
            Accum::Add,
            right,
            triangular::BlockStructure::Rectangular,
            right.transpose(),
            triangular::BlockStructure::Rectangular,
            minus,
            Par::Seq,
        );
        if start + width < n {
            let left = L.get(start + width.., ..);
            matmul(below, Accum::Add, left, right.transpose(), minus, Par::Seq);
        }
    };
    let least = if divisible { 1 } else { n }; // one piece: no task is made
    A.par_col_chunks_mut(TILE).enumerate().with_min_len(least).for_each(tile);
}

/// L x = b on a subtree, whose part of the right-hand side is `x`; returns what its rows owe to later places.
fn forward<T: Scalar>(analysis: &Analysis, panels: &[&[T]], f: usize, x: &mut [T]) -> Vec<T> {
    let front = &analysis.fronts[f];
    let (own, all) = front.sizes();
    let mut owed = vec![T::default(); all];
    let mut from_children = Vec::with_capacity(front.children.len());
    let (before, mine) = x.split_at_mut(3 * (front.first - front.subtree.1));
    each_part(
        analysis,
        &front.children,
        before,
        front.subtree.1,
        &mut from_children,
        &|child, x: &mut [T]| forward(analysis, panels, child, x),
    );
    for (&child, from) in front.children.iter().zip(from_children) {
        for (from, &to) in from.chunks_exact(3).zip(&analysis.fronts[child].in_parent) {
            for i in 0..3 {
                owed[3 * to as usize + i] += from[i];
            }
        }
    }
    if own == 0 {
        return owed;
    }
    for (x, owed) in mine.iter_mut().zip(&owed) {
        *x += *owed;
    }
    let panel = MatRef::from_column_major_slice(panels[f], all, own);
    let mut mine = MatMut::from_column_major_slice_mut(mine, own, 1);
    solve_lower_triangular_in_place(panel.get(..own, ..), mine.rb_mut(), Par::Seq);
    let mut owed = owed.split_off(own);
    if !owed.is_empty() {
        let n = owed.len();
        let owed = MatMut::from_column_major_slice_mut(&mut owed, n, 1);
        matmul(owed, Accum::Add, panel.get(own.., ..), mine.rb(), -T::one_impl(), Par::Seq);
    }
    owed
}

/// Lᵀ x = b on a subtree; `above`: the solution at the rows of its root.
fn backward<T: Scalar>(analysis: &Analysis, panels: &[&[T]], f: usize, above: &[T], x: &mut [T]) {
    let front = &analysis.fronts[f];
    let (own, all) = front.sizes();
    let (before, mine) = x.split_at_mut(3 * (front.first - front.subtree.1));
    if own > 0 {
        let panel = MatRef::from_column_major_slice(panels[f], all, own);
        let mut mine = MatMut::from_column_major_slice_mut(mine, own, 1);
        if !above.is_empty() {
            let above = MatRef::from_column_major_slice(above, above.len(), 1);
            let lower = panel.get(own.., ..);
            matmul(mine.rb_mut(), Accum::Add, lower.transpose(), above, -T::one_impl(), Par::Seq);
        }
        solve_upper_triangular_in_place(panel.get(..own, ..).transpose(), mine.rb_mut(), Par::Seq);
    }
    let mine = &*mine;
    let mut none = Vec::new();
    each_part(analysis, &front.children, before, front.subtree.1, &mut none, &|child, x: &mut [T]| {
        let gather = |&p: &u32| {
            let at = 3 * p as usize;
            let from = if at < own { &mine[at..at + 3] } else { &above[at - own..at - own + 3] };
            [from[0], from[1], from[2]]
        };
        let above: Vec<T> = analysis.fronts[child].in_parent.iter().flat_map(gather).collect();
        backward(analysis, panels, child, &above, x);
    });
}

/// Runs `run` on every child with its part of `x`, which begins at place `offset`; in parallel where worth it.
fn each_part<T: Scalar, R: Send>(
    analysis: &Analysis,
    children: &[usize],
    x: &mut [T],
    offset: usize,
    out: &mut Vec<R>,
    run: &(impl Fn(usize, &mut [T]) -> R + Sync),
) {
    match children {
        [] => {}
        [child] => out.push(run(*child, x)),
        _ => {
            let (low, high) = children.split_at(children.len() / 2);
            let cut = analysis.fronts[high[0]].subtree.1;
            let (low_x, high_x) = x.split_at_mut(3 * (cut - offset));
            let mut more = Vec::new();
            if x_work(analysis, children) > 1e6 {
                rayon::join(
                    || each_part(analysis, low, low_x, offset, out, run),
                    || each_part(analysis, high, high_x, cut, &mut more, run),
                );
            } else {
                each_part(analysis, low, low_x, offset, out, run);
                each_part(analysis, high, high_x, cut, &mut more, run);
            }
            out.append(&mut more);
        }
    }
}

/// Work of the subtrees of `children`, a proxy for the cost of a solve there.
fn x_work(analysis: &Analysis, children: &[usize]) -> f64 {
    children.iter().map(|&c| analysis.fronts[c].work).sum()
}
