//! A tree of axis-aligned boxes over the primitives of one surface: built once, refitted as the surface moves.
//!
//! Every node halves its primitives at the median of their centres along the longest side. The same input gives the same
//! tree, and queries report in the order of the tree, on any number of threads.

use nalgebra::Vector3;

/// An axis-aligned box \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Least corner.
    pub lo: Vector3<f64>,
    /// Greatest corner.
    pub hi: Vector3<f64>,
}

impl Aabb {
    /// The box of nothing.
    pub fn empty() -> Aabb {
        Aabb { lo: Vector3::repeat(f64::INFINITY), hi: Vector3::repeat(f64::NEG_INFINITY) }
    }

    /// The box of a way from `a` to `b`, grown by `by` on all sides.
    pub fn of_way(a: &Vector3<f64>, b: &Vector3<f64>, by: f64) -> Aabb {
        Aabb { lo: a.inf(b).add_scalar(-by), hi: a.sup(b).add_scalar(by) }
    }

    /// The box of some of the points at `p`.
    pub fn of(points: &[u32], p: &[Vector3<f64>]) -> Aabb {
        points
            .iter()
            .fold(Aabb::empty(), |sum, &i| sum.join(&Aabb::of_way(&p[i as usize], &p[i as usize], 0.0)))
    }

    /// The box of these points.
    pub fn around<'p>(points: impl Iterator<Item = &'p Vector3<f64>>) -> Aabb {
        points.fold(Aabb::empty(), |sum, p| sum.join(&Aabb { lo: *p, hi: *p }))
    }

    /// Distance from a point to what of the box is farthest from it.
    pub fn farthest(&self, p: &Vector3<f64>) -> f64 {
        (p - self.lo).abs().sup(&(p - self.hi).abs()).norm()
    }

    /// The box of both.
    pub fn join(&self, other: &Aabb) -> Aabb {
        Aabb { lo: self.lo.inf(&other.lo), hi: self.hi.sup(&other.hi) }
    }

    /// Grown by `by` on all sides.
    pub fn grown(&self, by: f64) -> Aabb {
        Aabb { lo: self.lo.add_scalar(-by), hi: self.hi.add_scalar(by) }
    }

    /// Whether they share a point.
    pub fn overlaps(&self, other: &Aabb) -> bool {
        (0..3).all(|i| self.lo[i] <= other.hi[i] && other.lo[i] <= self.hi[i])
    }

    /// Whether `p` lies inside.
    pub fn contains(&self, p: &Vector3<f64>) -> bool {
        (0..3).all(|i| self.lo[i] <= p[i] && p[i] <= self.hi[i])
    }

    /// Squared distance to a point.
    pub fn squared_distance(&self, p: &Vector3<f64>) -> f64 {
        (0..3).map(|i| (self.lo[i] - p[i]).max(p[i] - self.hi[i]).max(0.0).powi(2)).sum()
    }
}

/// Primitives in a leaf at most.
const LEAF: usize = 4;

/// The tree without its boxes.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    /// Primitives, those of a node side by side.
    order: Vec<u32>,
    /// (first, end) in `order` and the index of the second child (the first follows its parent), 0 for a leaf.
    nodes: Vec<(u32, u32, u32)>,
}

/// A tree with its boxes at one time.
#[derive(Clone, Debug, Default)]
pub struct Fitted {
    boxes: Vec<Aabb>,
}

impl Fitted {
    /// The box of all primitives.
    pub fn whole(&self) -> Aabb {
        self.boxes.first().copied().unwrap_or(Aabb::empty())
    }
}

impl Tree {
    /// Tree over primitives with these boxes.
    pub fn new(boxes: &[Aabb]) -> Tree {
        let mut tree = Tree { order: (0..boxes.len() as u32).collect(), nodes: Vec::new() };
        if !boxes.is_empty() {
            let centres: Vec<Vector3<f64>> = boxes.iter().map(|b| (b.lo + b.hi) / 2.0).collect();
            tree.divide(0, boxes.len(), &centres);
        }
        tree
    }

    fn divide(&mut self, first: usize, end: usize, centres: &[Vector3<f64>]) {
        let at = self.nodes.len();
        self.nodes.push((first as u32, end as u32, 0));
        if end - first <= LEAF {
            return;
        }
        let mine = &mut self.order[first..end];
        let (mut lo, mut hi) = (centres[mine[0] as usize], centres[mine[0] as usize]);
        for &p in mine.iter() {
            lo = lo.inf(&centres[p as usize]);
            hi = hi.sup(&centres[p as usize]);
        }
        let axis = (hi - lo).imax();
        let middle = (end - first) / 2;
        mine.select_nth_unstable_by(middle, |&a, &b| {
            centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
        });
        mine[..middle].sort_unstable();
        mine[middle..].sort_unstable();
        self.divide(first, first + middle, centres);
        self.nodes[at].2 = self.nodes.len() as u32;
        self.divide(first + middle, end, centres);
    }

    /// Boxes of all nodes from those of the primitives.
    pub fn fit(&self, boxes: impl Fn(u32) -> Aabb) -> Fitted {
        let mut all = vec![Aabb::empty(); self.nodes.len()];
        for (at, &(first, end, second)) in self.nodes.iter().enumerate().rev() {
            all[at] = match second {
                0 => self.order[first as usize..end as usize]
                    .iter()
                    .fold(Aabb::empty(), |sum, &p| sum.join(&boxes(p))),
                second => all[at + 1].join(&all[second as usize]),
            };
        }
        Fitted { boxes: all }
    }

    /// Calls `found` with every primitive of a leaf that `query` overlaps.
    pub fn overlapping(&self, fitted: &Fitted, query: &Aabb, mut found: impl FnMut(u32)) {
        let mut stack = [0_u32; 64];
        let mut n = usize::from(!self.nodes.is_empty());
        while n > 0 {
            n -= 1;
            let at = stack[n];
            if !fitted.boxes[at as usize].overlaps(query) {
                continue;
            }
            match self.nodes[at as usize] {
                (first, end, 0) => {
                    self.order[first as usize..end as usize].iter().for_each(|&p| found(p));
                }
                (_, _, second) => {
                    (stack[n], stack[n + 1]) = (second, at + 1);
                    n += 2;
                }
            }
        }
    }

    /// The primitive nearest to `p` by `squared_distance`, closer than `within`; ties go to the lesser primitive. The answer does not
    /// hang on `guess`, a primitive that is likely to be near.
    pub fn nearest(
        &self,
        fitted: &Fitted,
        p: &Vector3<f64>,
        within: f64,
        guess: Option<u32>,
        mut squared_distance: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        let mut best = (u32::MAX, within * within);
        let mut try_one = |q: u32, best: &mut (u32, f64)| {
            let d = squared_distance(q);
            if d < best.1 || (d == best.1 && q < best.0) {
                *best = (q, d);
            }
        };
        if let Some(guess) = guess {
            try_one(guess, &mut best);
        }
        let mut stack = [0_u32; 64];
        let mut n = usize::from(!self.nodes.is_empty());
        while n > 0 {
            n -= 1;
            let at = stack[n];
            if fitted.boxes[at as usize].squared_distance(p) > best.1 {
                continue;
            }
            match self.nodes[at as usize] {
                (first, end, 0) => {
                    self.order[first as usize..end as usize].iter().for_each(|&q| try_one(q, &mut best));
                }
                (_, _, second) => {
                    let (a, b) = (at + 1, second);
                    let [da, db] = [a, b].map(|i| fitted.boxes[i as usize].squared_distance(p));
                    (stack[n], stack[n + 1]) = if da <= db { (b, a) } else { (a, b) };
                    n += 2;
                }
            }
        }
        (best.0 != u32::MAX).then_some(best)
    }
}
