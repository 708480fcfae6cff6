//! Approximate minimum degree: best for slender bodies, and for bodies side by side that touch in places.
//!
//! Of the nodes left the one with the fewest neighbours goes next, by faer: Amestoy, Davis & Duff, An approximate minimum degree
//! ordering algorithm, SIAM J. Matrix Anal. Appl. 17 (1996). Its elimination tree has one node of the graph at each node; a
//! node joins its parent where that costs less than to pass on what is left: Duff & Reid, The multifrontal solution of indefinite
//! sparse symmetric linear equations, ACM Trans. Math. Softw. 9 (1983), §3.

use super::{Pattern, Supernode, elimination_work};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

/// Cost of a number that a front passes to its parent, and of a front, in multiply-adds (3..30 and 10³..10⁵: no difference above noise).
const PASS: f64 = 10.0;
const FRONT: f64 = 1e4;
/// Deepest tree that recursion may walk.
const DEEPEST: usize = 1000;
/// No parent.
const ROOT: u32 = u32::MAX;

/// All nodes of `pattern`; `None` where the tree is too deep, as that of a chain is.
pub fn by_degree(pattern: &Pattern) -> Option<Vec<Supernode>> {
    let (order, place) = minimum_degree(pattern);
    let (parent, n_rows) = elimination_tree(pattern, &order, &place);
    let owner = amalgamate(&parent, &n_rows);
    // Parents come after their children.
    let n = order.len();
    let mut depth = vec![0; n];
    for k in (0..n).rev().filter(|&k| owner[k] as usize == k && parent[k] != ROOT) {
        depth[k] = depth[owner[parent[k] as usize] as usize] + 1;
    }
    if depth.iter().any(|&d| d > DEEPEST) {
        return None;
    }
    let mut sets: Vec<Supernode> =
        (0..n).map(|_| Supernode { nodes: Vec::new(), children: Vec::new() }).collect();
    for (&node, &owner) in order.iter().zip(&owner) {
        sets[owner as usize].nodes.push(node as u32);
    }
    let mut roots = Vec::new();
    for k in (0..n).filter(|&k| owner[k] as usize == k) {
        let set = Supernode {
            nodes: std::mem::take(&mut sets[k].nodes),
            children: std::mem::take(&mut sets[k].children),
        };
        match parent[k] {
            ROOT => roots.push(set),
            p => sets[owner[p as usize] as usize].children.push(set),
        }
    }
    Some(roots)
}

/// The node eliminated at each place, and the place of each node.
fn minimum_degree(pattern: &Pattern) -> (Vec<usize>, Vec<usize>) {
    let n = pattern.n_nodes();
    let columns: Vec<usize> = (0..n).flat_map(|i| pattern.row(i)).map(|&j| j as usize).collect();
    let graph = SymbolicSparseColMatRef::new_checked(n, n, pattern.row_start(), None, &columns);
    let (mut order, mut place) = (vec![0; n], vec![0; n]);
    let mut scratch = MemBuffer::new(amd::order_scratch::<usize>(n, columns.len()));
    let stack = MemStack::new(&mut scratch);
    amd::order(&mut order, &mut place, graph, amd::Control::default(), stack)
        .expect("indices of a pattern fit a machine word");
    (order, place)
}

/// Of each place in the order its parent and the number of later places that it is coupled with by then: Liu, The role of elimination
/// trees in sparse factorization, SIAM J. Matrix Anal. Appl. 11 (1990).
fn elimination_tree(pattern: &Pattern, order: &[usize], place: &[usize]) -> (Vec<u32>, Vec<u32>) {
    let n = order.len();
    let mut parent = vec![ROOT; n];
    let mut n_rows = vec![0; n];
    let mut seen_by = vec![n; n];
    for k in 0..n {
        seen_by[k] = k;
        for &node in pattern.row(order[k]) {
            // All from here up to k in the tree pass a row to k.
            let mut at = place[node as usize];
            while at < k && seen_by[at] != k {
                seen_by[at] = k;
                n_rows[at] += 1;
                if parent[at] == ROOT {
                    parent[at] = k as u32;
                }
                at = parent[at] as usize;
            }
        }
    }
    (parent, n_rows)
}

/// The last place of the set that each place belongs to.
fn amalgamate(parent: &[u32], n_rows: &[u32]) -> Vec<u32> {
    let n = parent.len();
    let mut owner: Vec<u32> = (0..n as u32).collect();
    let mut size = vec![1_u32; n];
    let mut children = vec![Vec::new(); n];
    for k in 0..n {
        let mut mine: Vec<u32> = std::mem::take(&mut children[k]);
        // The largest first: the more a set owns, the dearer it is to join.
        mine.sort_by_key(|&c| std::cmp::Reverse((n_rows[c as usize], c)));
        for c in mine {
            let c = c as usize;
            let unknowns = |n: u32| 3.0 * f64::from(n);
            let (own, rest) = (unknowns(size[k]), unknowns(n_rows[k]));
            let (more, passed) = (unknowns(size[c]), unknowns(n_rows[c]));
            let apart = elimination_work(own, rest)
                + elimination_work(more, passed)
                + PASS * passed * passed / 2.0
                + FRONT;
            if elimination_work(own + more, rest) < apart {
                size[k] += size[c];
                owner[c] = k as u32;
            }
        }
        if parent[k] != ROOT {
            children[parent[k] as usize].push(k as u32);
        }
    }
    for k in (0..n).rev() {
        owner[k] = owner[owner[k] as usize];
    }
    owner
}
