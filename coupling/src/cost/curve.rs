//! Accuracy against seconds: which settings nothing cheaper is as accurate as, and the cheapest for a wanted accuracy.

/// A rung on the curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Its name.
    pub setting: String,
    /// Wall time \[s\].
    pub seconds: f64,
    /// Error as a fraction.
    pub error: f64,
}

/// Places of the points that no other is both faster and at least as accurate as, from fast to accurate.
pub fn pareto(points: &[Point]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (&points[a], &points[b]);
        a.seconds.total_cmp(&b.seconds).then(a.error.total_cmp(&b.error)).then(a.setting.cmp(&b.setting))
    });
    let mut best = f64::INFINITY;
    order.retain(|&k| {
        let better = points[k].error < best;
        best = best.min(points[k].error);
        better
    });
    order
}

/// The cheapest point that is accurate enough.
pub fn cheapest(points: &[Point], wanted: f64) -> Option<&Point> {
    let enough = points.iter().filter(|p| p.error <= wanted);
    enough.min_by(|a, b| a.seconds.total_cmp(&b.seconds).then(a.setting.cmp(&b.setting)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slower_and_no_better_is_not_on_the_front() {
        let point = |setting: &str, seconds, error| Point { setting: setting.into(), seconds, error };
        let points = [
            point("a", 1.0, 0.5),
            point("b", 2.0, 0.6),
            point("c", 3.0, 0.1),
            point("d", 3.0, 0.2),
            point("e", 9.0, 0.0),
        ];
        assert_eq!(pareto(&points), [0, 2, 4]);
        assert_eq!(cheapest(&points, 0.3).unwrap().setting, "c");
        assert_eq!(cheapest(&points, -1.0), None);
    }
}
