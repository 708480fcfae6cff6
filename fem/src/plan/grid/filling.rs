//! How well pieces fill their cubes, and what becomes of corners that nothing holds well.

use super::lattice::Lattice;
use super::pieces::{Pieces, Sets};
use crate::plan::load::Mean;
use nalgebra::SMatrix;
use std::collections::{BTreeMap, BTreeSet};

/// A piece is well filled if it holds its corners at least so well, relative to the best piece of its body.
///
/// How well it holds them is the least eigenvalue of M = Σ v N Nᵀ, over its nodes with their shares v of the volume and the weights N of the corners
/// there: a displacement u of the corners moves the mass inside by at least √(λ uᵀu). It goes as the cube of the filled fraction of a
/// slab, so this is a tenth of a slab.
const WELL_FILLED: f64 = 1e-3;
/// Least eigenvalue over the sum of all below which nodes do not tell the corners apart; round-off of it is 1e-15.
const TOLD_APART: f64 = 1e-9;
/// Weights below this are round-off of nodes on faces of cubes.
const NO_WEIGHT: f64 = 1e-12;

/// Which pieces hold their corners, and which of them stands for one that does not.
pub struct Filling {
    /// The piece whose dilatation each piece shares: a well filled one where a node of it hangs on an extrapolated corner, otherwise itself.
    pub root: Vec<u32>,
    /// The well filled piece from which each corner is extrapolated; `None`: a well filled piece has it.
    from: Vec<Option<u32>>,
}

impl Filling {
    /// Of pieces with nodes at `places` \[m\]; `volumes` \[m³\] of the elements. `Err`: why there is none.
    pub fn new(
        lattice: &Lattice,
        pieces: &Pieces,
        places: &[[f64; 3]],
        elements: &[Vec<u32>],
        volumes: &[(f64, usize)],
    ) -> Result<Filling, String> {
        let hold = hold(lattice, pieces, places, elements, volumes);
        let at_corners = pieces.at_corners();
        let mut bodies = Sets::new(hold.len());
        for at in &at_corners {
            at.iter().for_each(|&piece| bodies.unite(at[0], piece));
        }
        let mut best = vec![0.0_f64; hold.len()];
        for (piece, &hold) in (0..).zip(&hold) {
            let body = bodies.root(piece) as usize;
            best[body] = best[body].max(hold);
        }
        let mut is_well = Vec::with_capacity(hold.len());
        for (piece, &hold) in (0..).zip(&hold) {
            let best = best[bodies.root(piece) as usize];
            if best == 0.0 {
                return Err("hold so few nodes of the mesh each that these do not tell their corners apart; take at least twice the \
                            edge of its cells, or leave it out"
                    .to_string());
            }
            is_well.push(hold >= WELL_FILLED * best);
        }
        let nearest =
            |start: &[u32], p: [f64; 3]| nearest_well(lattice, pieces, &at_corners, &is_well, start, p);
        let centre = |piece: usize| lattice.centre(pieces.cubes[piece]);
        let from = at_corners.iter().zip(&pieces.sites).map(|(at, &site)| {
            let is_held = at.iter().any(|&piece| is_well[piece as usize]);
            (!is_held).then(|| nearest(at, lattice.place(site)))
        });
        let from: Vec<Option<u32>> = from.collect();
        // Where bones hold the rest of a cube, corners that nothing holds may matter to no node.
        let mut leans = vec![false; hold.len()];
        for (p, in_pieces) in places.iter().zip(&pieces.of_node) {
            for &piece in in_pieces {
                let weights = lattice.weights(pieces.cubes[piece as usize], *p);
                let mut corners = pieces.corners[piece as usize].iter().zip(weights);
                leans[piece as usize] |=
                    corners.any(|(&c, w)| w.abs() >= NO_WEIGHT && from[c as usize].is_some());
            }
        }
        let root = (0..hold.len()).map(|piece| match leans[piece] {
            false => piece as u32,
            true => nearest(&[piece as u32], centre(piece)),
        });
        Ok(Filling { root: root.collect(), from })
    }

    /// Number of pieces that hang on others.
    pub fn n_bad(&self) -> usize {
        (0..).zip(&self.root).filter(|(piece, root)| piece != *root).count()
    }

    /// Every node as a mean of corners, which are numbered from `first` on, and where those are \[m\].
    pub fn means(
        &self,
        lattice: &Lattice,
        pieces: &Pieces,
        places: &[[f64; 3]],
        first: u32,
    ) -> (Vec<Mean>, Vec<[f64; 3]>) {
        let of_node = |(p, in_pieces): (&[f64; 3], &Vec<u32>)| {
            let mut mean = BTreeMap::<u32, f64>::new();
            let piece = in_pieces[0];
            let weights = lattice.weights(pieces.cubes[piece as usize], *p);
            for (corner, w) in pieces.corners[piece as usize].into_iter().zip(weights) {
                if w.abs() < NO_WEIGHT {
                    continue;
                }
                match self.from[corner as usize] {
                    None => *mean.entry(corner).or_default() += w,
                    Some(root) => {
                        let site = lattice.place(pieces.sites[corner as usize]);
                        let cube = pieces.cubes[root as usize];
                        let of_root =
                            pieces.corners[root as usize].into_iter().zip(lattice.weights(cube, site));
                        of_root.for_each(|(corner, v)| *mean.entry(corner).or_default() += w * v);
                    }
                }
            }
            mean.retain(|_, w| w.abs() >= NO_WEIGHT);
            mean
        };
        let means: Vec<_> = places.iter().zip(&pieces.of_node).map(of_node).collect();
        let used: BTreeSet<u32> = means.iter().flat_map(|mean| mean.keys().copied()).collect();
        let mut corners: Vec<u32> = used.into_iter().collect();
        corners.sort_by_key(|&c| (pieces.sites[c as usize], c));
        let number: BTreeMap<u32, u32> = corners.iter().copied().zip(first..).collect();
        let means = means.iter().map(|mean| mean.iter().map(|(c, &w)| (number[c], w)).collect());
        (means.collect(), corners.iter().map(|&c| lattice.place(pieces.sites[c as usize])).collect())
    }
}

/// How well each piece holds its corners, over the volume of a cube; 0 where its nodes do not tell them apart.
fn hold(
    lattice: &Lattice,
    pieces: &Pieces,
    places: &[[f64; 3]],
    elements: &[Vec<u32>],
    volumes: &[(f64, usize)],
) -> Vec<f64> {
    let mut share = vec![0.0; places.len()];
    for (nodes, &(volume, n)) in elements.iter().zip(volumes) {
        nodes.iter().for_each(|&node| share[node as usize] += volume / n as f64);
    }
    let mut sums = vec![SMatrix::<f64, 8, 8>::zeros(); pieces.cubes.len()];
    for ((p, in_pieces), share) in places.iter().zip(&pieces.of_node).zip(share) {
        for &piece in in_pieces {
            let N = SMatrix::<f64, 8, 1>::from(lattice.weights(pieces.cubes[piece as usize], *p));
            sums[piece as usize] += N * N.transpose() * (share / in_pieces.len() as f64);
        }
    }
    let least = |sum: &SMatrix<f64, 8, 8>| {
        let least = sum.symmetric_eigenvalues().min();
        if least > TOLD_APART * sum.trace() { least / lattice.edge().powi(3) } else { 0.0 }
    };
    sums.iter().map(least).collect()
}

/// The well filled piece fewest joints away from one of `start`, of those the one whose centre is nearest to `p` \[m\].
fn nearest_well(
    lattice: &Lattice,
    pieces: &Pieces,
    at_corners: &[Vec<u32>],
    is_well: &[bool],
    start: &[u32],
    p: [f64; 3],
) -> u32 {
    let mut seen: BTreeSet<u32> = start.iter().copied().collect();
    let mut front: Vec<u32> = start.to_vec();
    loop {
        let distance = |piece: &u32| lattice.squared_distance(pieces.cubes[*piece as usize], p);
        let well = front.iter().copied().filter(|&piece| is_well[piece as usize]);
        if let Some(found) = well.min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b))) {
            return found;
        }
        let beside = front.iter().flat_map(|&piece| pieces.corners[piece as usize]);
        let mut next: Vec<u32> = beside.flat_map(|c| &at_corners[c as usize]).copied().collect();
        next.sort_unstable();
        next.dedup();
        next.retain(|&piece| seen.insert(piece));
        assert!(!next.is_empty(), "the best piece of a body is well filled");
        front = next;
    }
}
