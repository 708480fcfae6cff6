//! Pieces: what of a region hangs together in a cube, and which corners it shares with others.

use super::lattice::{Lattice, Site};
use std::collections::BTreeMap;

/// The pieces of a region.
pub struct Pieces {
    /// Cube of each piece.
    pub cubes: Vec<Site>,
    /// Pieces that each element has nodes in, ascending.
    pub of_element: Vec<Vec<u32>>,
    /// Pieces of each node: more than one where it is on a face of its cube.
    pub of_node: Vec<Vec<u32>>,
    /// The corners of each piece: index into `sites`. Pieces that are joined share those at one place.
    pub corners: Vec<[u32; 8]>,
    /// Where in the lattice each corner is.
    pub sites: Vec<Site>,
}

impl Pieces {
    /// Of nodes at `places` \[m\], in elements that are lists of these nodes.
    ///
    /// In a cube, elements that have nodes in it hang together where they share a node, in the cube or beside it. Two pieces are joined
    /// where an element is in both.
    pub fn new(lattice: &Lattice, places: &[[f64; 3]], elements: &[Vec<u32>]) -> Pieces {
        let node_cubes: Vec<Vec<Site>> = places.iter().map(|&p| lattice.cubes(p)).collect();
        let mut in_cube = BTreeMap::<Site, Vec<u32>>::new();
        for (e, nodes) in (0..).zip(elements) {
            let mut cubes: Vec<Site> = nodes.iter().flat_map(|&n| &node_cubes[n as usize]).copied().collect();
            cubes.sort_unstable();
            cubes.dedup();
            cubes.into_iter().for_each(|cube| in_cube.entry(cube).or_default().push(e));
        }
        let mut cubes = Vec::new();
        let mut of_element = vec![Vec::new(); elements.len()];
        for (cube, members) in in_cube {
            let mut sets = Sets::new(members.len());
            let mut seen = BTreeMap::<u32, u32>::new();
            for (i, &e) in (0..).zip(&members) {
                for &n in &elements[e as usize] {
                    sets.unite(*seen.entry(n).or_insert(i), i);
                }
            }
            let mut piece_of = BTreeMap::new();
            for (i, &e) in (0..).zip(&members) {
                let piece = *piece_of.entry(sets.root(i)).or_insert_with(|| {
                    cubes.push(cube);
                    cubes.len() as u32 - 1
                });
                of_element[e as usize].push(piece);
            }
        }
        let mut of_node = vec![Vec::new(); places.len()];
        for (e, nodes) in elements.iter().enumerate() {
            for &n in nodes.iter().filter(|n| of_node[**n as usize].is_empty()).collect::<Vec<_>>() {
                let holds = |piece: &&u32| node_cubes[n as usize].contains(&cubes[**piece as usize]);
                of_node[n as usize] = of_element[e].iter().filter(holds).copied().collect();
            }
        }
        let (corners, sites) = shared_corners(&cubes, &of_element);
        Pieces { cubes, of_element, of_node, corners, sites }
    }

    /// Cubes with more than one piece.
    pub fn divided(&self) -> impl Iterator<Item = Site> {
        // Pieces of a cube follow each other.
        self.cubes.chunk_by(|a, b| a == b).filter(|pieces| pieces.len() > 1).map(|pieces| pieces[0])
    }

    /// Pieces that have each corner.
    pub fn at_corners(&self) -> Vec<Vec<u32>> {
        let mut at = vec![Vec::new(); self.sites.len()];
        for (piece, corners) in (0..).zip(&self.corners) {
            corners.iter().for_each(|&c| at[c as usize].push(piece));
        }
        at
    }
}

/// Corners of all pieces: those at one place of pieces that an element joins are one.
fn shared_corners(cubes: &[Site], of_element: &[Vec<u32>]) -> (Vec<[u32; 8]>, Vec<Site>) {
    let mut sets = Sets::new(8 * cubes.len());
    for pieces in of_element.iter().filter(|pieces| pieces.len() > 1) {
        let mut first = BTreeMap::<Site, u32>::new();
        for &piece in pieces {
            for (i, site) in (0..).zip(Lattice::corners(cubes[piece as usize])) {
                let own = 8 * piece + i;
                sets.unite(*first.entry(site).or_insert(own), own);
            }
        }
    }
    let (mut number, mut sites) = (BTreeMap::new(), Vec::new());
    let corners = (0..).zip(cubes).map(|(piece, &cube)| {
        let of_cube = Lattice::corners(cube);
        std::array::from_fn(|i| {
            *number.entry(sets.root(8 * piece + i as u32)).or_insert_with(|| {
                sites.push(of_cube[i]);
                sites.len() as u32 - 1
            })
        })
    });
    let corners = corners.collect();
    (corners, sites)
}

/// Disjoint sets of numbers; the least of a set stands for it.
pub struct Sets(Vec<u32>);

impl Sets {
    /// Every number by itself.
    pub fn new(n: usize) -> Sets {
        Sets((0..n as u32).collect())
    }

    /// What stands for the set of a number.
    pub fn root(&mut self, mut n: u32) -> u32 {
        while self.0[n as usize] != n {
            self.0[n as usize] = self.0[self.0[n as usize] as usize];
            n = self.0[n as usize];
        }
        n
    }

    /// Makes one set of two.
    pub fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
