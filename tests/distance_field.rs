//! Is a smooth distance to a surface as exact, and its derivatives as true, as it says?

use fem::geometry::DistanceField;
use nalgebra::Vector3;

fn ball(spacing: f64) -> DistanceField {
    let side = Vector3::repeat(0.03);
    DistanceField::new(-side, side, spacing, |p| p.norm() - 0.02)
}

#[test]
fn a_plane_is_itself_and_a_ball_lies_too_deep_by_its_curvature() {
    let n = Vector3::new(0.6, 0.0, 0.8);
    let side = Vector3::repeat(0.01);
    let plane = DistanceField::new(-side, side, 1e-3, |p| n.dot(p) - 1e-3);
    let at = plane.at(&Vector3::new(1.3e-3, -2e-3, 0.7e-3)).unwrap();
    assert!((at.distance - (0.6 * 1.3e-3 + 0.8 * 0.7e-3 - 1e-3)).abs() < 1e-15, "{at:?}");
    assert!((at.gradient - n).norm() < 1e-12 && at.hessian.norm() < 1e-8, "{at:?}");
    let p = Vector3::new(1.0, -2.0, 0.5).normalize() * 0.02;
    for h in [1e-3, 2e-3] {
        // (h²/6) 2/r.
        let (found, expected) = (ball(h).at(&p).unwrap().distance, h * h / 6.0 * 2.0 / 0.02);
        assert!((found / expected - 1.0).abs() < 0.03, "{found} against {expected}");
    }
}

#[test]
fn a_raised_ball_lies_farther_out() {
    let p = Vector3::new(1.0, -2.0, 0.5).normalize() * 0.0215;
    let [before, after] = [ball(1e-3), ball(1e-3).raised(1.5e-3)].map(|f| f.at(&p).unwrap());
    assert!((before.distance - after.distance - 1.5e-3).abs() < 1e-15, "{before:?} {after:?}");
    assert!((before.gradient - after.gradient).norm() < 1e-12);
    let [lo, hi] = ball(1e-3).bounds();
    assert!(ball(1e-3).at(&(lo + Vector3::repeat(1e-9))).is_some(), "{lo}");
    assert!(ball(1e-3).at(&(hi - Vector3::repeat(1e-9))).is_some(), "{hi}");
}

#[test]
fn derivatives_are_those_of_the_value() {
    let field = ball(1e-3);
    let (p, step) = (Vector3::new(0.011, 0.0123, -0.0134), 1e-7);
    let at = field.at(&p).unwrap();
    for c in 0..3 {
        let [a, b] = [-step, step].map(|s| field.at(&(p + s * Vector3::ith(c, 1.0))).unwrap());
        let slope = (b.distance - a.distance) / (2.0 * step);
        assert!((slope - at.gradient[c]).abs() < 1e-7, "{slope} {}", at.gradient[c]);
        let bend = (b.gradient - a.gradient) / (2.0 * step);
        assert!((bend - at.hessian.column(c)).norm() < 1e-4 * at.hessian.norm(), "{bend}");
    }
    assert!(field.near(&Vector3::new(0.0, 0.0, 0.028), 1e-3).is_none());
    assert!(field.near(&Vector3::new(0.0, 0.0, 0.0215), 1e-3).is_none());
    assert!(field.near(&Vector3::new(0.0, 0.0, 0.0205), 1e-3).is_some());
    assert!(field.at(&Vector3::new(0.0, 0.0, 0.031)).is_none());
}

#[test]
fn what_is_free_has_nothing_near_and_what_is_not_may_have() {
    let field = ball(1e-3);
    let within = 1e-3;
    for k in 0..400_u32 {
        // From the middle of the ball to far outside the box, in balls of 0.1 to 8 mm.
        let [x, y, z] = [7, 11, 13].map(|m| f64::from(k * m % 101) / 50.0 - 1.0);
        let (middle, radius) = (Vector3::new(x, y, z) * 0.045, 1e-4 * f64::from(1 + k % 80));
        let mut near = (0..60).filter_map(|i| {
            let [x, y, z] = [17, 23, 29].map(|m| f64::from((i + k) * m % 97) / 48.0 - 1.0);
            let out = Vector3::new(x, y, z).try_normalize(1e-9)? * radius * f64::from(i % 4 + 1) / 4.0;
            field.near(&(middle + out), within)
        });
        let free = field.is_free(&middle, radius, within);
        assert!(!(free && near.next().is_some()), "{middle} {radius}");
        let sure = middle.norm() - radius > 0.02 + within + 1e-4;
        assert!(free || !sure || middle.amax() + 2e-3 > 0.03, "{middle} {radius}");
    }
}
