//! Axis-aligned boxes, and a tree of them over the primitives of one surface, parry's: built once, refitted as the surface moves.
//!
//! The same input gives the same tree, and queries report in the order of the tree, on any number of threads. Here are the
//! conversions from nalgebra to parry, and what parry leaves open: of primitives that are equally near the lesser is nearest.

use nalgebra::Vector3;
use parry3d_f64::bounding_volume::Aabb as ParryAabb;
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use std::cell::Cell;

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

    /// The box of one point.
    pub fn at(p: &Vector3<f64>) -> Aabb {
        Aabb { lo: *p, hi: *p }
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

    /// Greatest distance between points of the two.
    pub fn farthest(&self, other: &Aabb) -> f64 {
        (self.hi - other.lo).abs().sup(&(self.lo - other.hi).abs()).norm()
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

    /// Squared distance between the two, zero where they meet.
    pub fn squared_distance(&self, other: &Aabb) -> f64 {
        (0..3).map(|i| (self.lo[i] - other.hi[i]).max(other.lo[i] - self.hi[i]).max(0.0).powi(2)).sum()
    }
}

fn of_parry(v: ParryVector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

impl Default for Aabb {
    fn default() -> Aabb {
        Aabb::empty()
    }
}

impl From<&Aabb> for ParryAabb {
    fn from(b: &Aabb) -> ParryAabb {
        let to = |v: &Vector3<f64>| ParryVector::new(v.x, v.y, v.z);
        ParryAabb { mins: to(&b.lo), maxs: to(&b.hi) }
    }
}

impl From<&BvhNode> for Aabb {
    fn from(node: &BvhNode) -> Aabb {
        Aabb { lo: of_parry(node.mins()), hi: of_parry(node.maxs()) }
    }
}

/// A tree over primitives with their boxes.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    bvh: Bvh,
    whole: Aabb,
}

impl Tree {
    /// Of primitives with these boxes.
    pub fn new(boxes: &[Aabb]) -> Tree {
        let boxes: Vec<ParryAabb> = boxes.iter().map(ParryAabb::from).collect();
        Tree::of(Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes))
    }

    fn of(bvh: Bvh) -> Tree {
        let whole = bvh.root_aabb();
        let whole = match bvh.is_empty() {
            true => Aabb::empty(),
            false => Aabb { lo: of_parry(whole.mins), hi: of_parry(whole.maxs) },
        };
        Tree { bvh, whole }
    }

    /// The tree with other boxes of its primitives.
    pub fn fit(&self, boxes: impl Fn(u32) -> Aabb) -> Tree {
        let mut bvh = self.bvh.clone();
        for primitive in 0..bvh.leaf_count() {
            bvh.update_partially_if_present(ParryAabb::from(&boxes(primitive)), primitive, 0.0);
        }
        bvh.refit_without_opt();
        Tree::of(bvh)
    }

    /// The box of all primitives.
    pub fn whole(&self) -> &Aabb {
        &self.whole
    }

    /// Calls `found` with every primitive whose box `query` overlaps.
    pub fn overlapping(&self, query: &Aabb, mut found: impl FnMut(u32)) {
        // Most surfaces are nowhere near.
        if self.whole.overlaps(query) {
            self.bvh.intersect_aabb(&ParryAabb::from(query)).for_each(&mut found);
        }
    }

    /// The primitive nearest to what lies in the box `to`, by `squared_distance`, no farther than `within`; ties go to the lesser primitive.
    /// The answer does not hang on `guess`, a primitive that is likely to be near.
    pub fn nearest(
        &self,
        to: &Aabb,
        within: f64,
        guess: Option<u32>,
        squared_distance: impl Fn(u32) -> f64,
    ) -> Option<(u32, f64)> {
        self.least(to, |squared| squared, within * within, guess, squared_distance)
    }

    /// The primitive of least `cost`, at most `most`, where that is no less than `of_box` makes of the squared distance from its box to the
    /// box `to`; ties go to the lesser primitive.
    pub fn least(
        &self,
        to: &Aabb,
        of_box: impl Fn(f64) -> f64,
        most: f64,
        guess: Option<u32>,
        cost: impl Fn(u32) -> f64,
    ) -> Option<(u32, f64)> {
        let best = Cell::new((u32::MAX, most));
        let try_one = |q: u32| {
            let (d, (known, least)) = (cost(q), best.get());
            if d < least || (d == least && q < known) {
                best.set((q, d));
            }
            d
        };
        guess.map(try_one);
        // A little less than the distance, so that boxes as far away as the best so far are looked into.
        let to_box =
            |node: &BvhNode, _| of_box(Aabb::from(node).squared_distance(to)) * (1.0 - 4.0 * f64::EPSILON);
        self.bvh.find_best(best.get().1, to_box, |q, _| Some(try_one(q)));
        Some(best.get()).filter(|(q, _)| *q != u32::MAX)
    }
}
