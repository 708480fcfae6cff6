//! A tree of boxes over the triangles of a surface.

use nalgebra::Vector3;

use super::Surface;

/// Triangles of a leaf.
const LEAF: usize = 4;

/// An axis-parallel box \[m\].
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub low: Vector3<f64>,
    pub high: Vector3<f64>,
}

impl Bounds {
    pub fn of(points: &[Vector3<f64>]) -> Bounds {
        let mut bounds =
            Bounds { low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) };
        for p in points {
            bounds = Bounds { low: bounds.low.inf(p), high: bounds.high.sup(p) };
        }
        bounds
    }

    fn join(&self, other: &Bounds) -> Bounds {
        Bounds { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Distance between the boxes \[m\]; zero where they meet.
    pub fn distance(&self, other: &Bounds) -> f64 {
        (self.low - other.high).sup(&(other.low - self.high)).sup(&Vector3::zeros()).norm()
    }
}

/// Nodes in the order parent, all of the left branch, all of the right.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    /// Triangles, those of a leaf together.
    order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// Of a leaf: first entry in `order`. Of a branch: the right child (the left one follows its parent).
    at: u32,
    /// Triangles of a leaf; zero for a branch.
    count: u32,
}

impl Tree {
    /// Halves along the longest side of the box of the centres, down to leaves of four triangles.
    pub fn new(surface: &Surface) -> Tree {
        let centre = |t| surface.corners(t).iter().sum::<Vector3<f64>>() / 3.0;
        let centres: Vec<Vector3<f64>> = (0..surface.triangles.len()).map(centre).collect();
        let mut tree = Tree { nodes: Vec::new(), order: (0..).take(centres.len()).collect() };
        let mut order = std::mem::take(&mut tree.order);
        if !order.is_empty() {
            tree.split(&mut order, 0, &centres);
        }
        tree.order = order;
        tree.refit(surface);
        tree
    }

    fn split(&mut self, order: &mut [u32], first: usize, centres: &[Vector3<f64>]) {
        let placeholder = Bounds::of(&[]);
        let here = self.nodes.len();
        if order.len() <= LEAF {
            self.nodes.push(Node { bounds: placeholder, at: first as u32, count: order.len() as u32 });
            return;
        }
        let members: Vec<Vector3<f64>> = order.iter().map(|&t| centres[t as usize]).collect();
        let bounds = Bounds::of(&members);
        let axis = (bounds.high - bounds.low).imax();
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |&a, &b| {
            centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
        });
        self.nodes.push(Node { bounds: placeholder, at: 0, count: 0 });
        let (left, right) = order.split_at_mut(middle);
        self.split(left, first, centres);
        self.nodes[here].at = self.nodes.len() as u32;
        self.split(right, first + middle, centres);
    }

    /// Fits the boxes to moved points; the triangles must be those of [`Tree::new`].
    pub fn refit(&mut self, surface: &Surface) {
        for i in (0..self.nodes.len()).rev() {
            let Node { at, count, .. } = self.nodes[i];
            self.nodes[i].bounds = if count == 0 {
                self.nodes[i + 1].bounds.join(&self.nodes[at as usize].bounds)
            } else {
                let members = &self.order[at as usize..(at + count) as usize];
                let corners: Vec<_> = members.iter().flat_map(|&t| surface.corners(t as usize)).collect();
                Bounds::of(&corners)
            };
        }
    }

    /// Visits the triangles whose leaf comes as near to the box as `visit` last answered, nearer branches first.
    ///
    /// `limit`: distance to begin with \[m\]; `visit` takes a triangle and the limit and returns the limit from then on.
    pub fn visit(&self, bounds: &Bounds, mut limit: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let mut open: Vec<(f64, u32)> = Vec::with_capacity(64);
        if let Some(root) = self.nodes.first() {
            open.push((root.bounds.distance(bounds), 0));
        }
        while let Some((distance, i)) = open.pop() {
            if !(distance <= limit) {
                continue;
            }
            let node = &self.nodes[i as usize];
            if node.count > 0 {
                for &t in &self.order[node.at as usize..(node.at + node.count) as usize] {
                    limit = visit(t, limit);
                }
                continue;
            }
            let child = |i: u32| (self.nodes[i as usize].bounds.distance(bounds), i);
            let (left, right) = (child(i + 1), child(node.at));
            let (near, far) = if right.0 < left.0 { (right, left) } else { (left, right) };
            open.push(far);
            open.push(near);
        }
    }
}
