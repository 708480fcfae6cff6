//! Strings that slide: do they go the shortest way over a rigid solid, with one tension from end to end, and are their derivatives right?

use coupling::knee::deep::DeepFlexion;
use coupling::knee::femur;
use coupling::knee::string::{Memory, Pull, SEGMENTS, Strings, TautString, Way};
use fem::effect::obstacle::{Layer, Obstacle, Sample};
use fem::effect::{Effect, State};
use fem::geometry::DistanceField;
use fem::material::line::Strand;
use nalgebra::{Point3, Vector3};
use std::sync::Arc;
use support::Random;

const RADIUS: f64 = 0.02;
const SPACING: f64 = 1e-3;

/// A round solid about the origin: a ball, or a rod along z.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Round {
    Ball,
    Rod,
}

impl Round {
    fn field(self) -> Arc<DistanceField> {
        let side = Vector3::repeat(0.045);
        let distance = move |p: &Vector3<f64>| match self {
            Round::Ball => p.norm() - RADIUS,
            Round::Rod => p.xy().norm() - RADIUS,
        };
        Arc::new(DistanceField::new(-side, side, SPACING, distance))
    }

    /// Where its smooth distance vanishes: (h²/6) (κ₁ + κ₂) below.
    fn radius(self) -> f64 {
        let curvature = if self == Round::Ball { 2.0 } else { 1.0 } / RADIUS;
        RADIUS - SPACING * SPACING / 6.0 * curvature
    }

    /// Length \[m\] of the shortest way around it between two points: tangents, and a great circle or a helix (unrolled, a straight line).
    fn shortest(self, a: Point3<f64>, b: Point3<f64>) -> f64 {
        let r = self.radius();
        let flat = |v: Point3<f64>| if self == Round::Ball { v.coords } else { Vector3::new(v.x, v.y, 0.0) };
        let [p, q] = [a, b].map(flat);
        let free = |v: Vector3<f64>| (v.norm_squared() - r * r).sqrt();
        let turn = p.angle(&q) - (r / p.norm()).acos() - (r / q.norm()).acos();
        let around = free(p) + free(q) + r * turn;
        if self == Round::Ball { around } else { around.hypot(a.z - b.z) }
    }
}

fn cases() -> Vec<(Round, [Point3<f64>; 2])> {
    let ends = |a: [f64; 3], b: [f64; 3]| [a, b].map(Point3::from);
    vec![
        (Round::Ball, ends([-0.03, 0.005, 0.0], [0.03, 0.008, 0.004])),
        (Round::Ball, ends([-0.021, 0.004, 0.01], [0.028, 0.001, -0.006])),
        (Round::Rod, ends([-0.03, 0.005, -0.02], [0.03, 0.008, 0.015])),
        (Round::Rod, ends([-0.025, 0.004, 0.0], [0.025, 0.004, 0.0])),
    ]
}

fn way(round: Round, [a, b]: [Point3<f64>; 2]) -> Way {
    TautString::new(round.field(), a).way(&b, None)
}

#[test]
fn a_string_goes_the_shortest_way_with_its_nodes_evenly_spread() {
    for (round, ends) in cases() {
        let (found, exact) = (way(round, ends), round.shortest(ends[0], ends[1]));
        // A turn of up to 2 rad in 48 segments: chords leave out up to 1/24 of the square of a segment's turn, 1e-4.
        assert!((found.length / exact - 1.0).abs() < 3e-4, "{round:?}: {} m, exact {exact} m", found.length);
        let segments: Vec<f64> = found.places.windows(2).map(|p| (p[1] - p[0]).norm()).collect();
        let mean = segments.iter().sum::<f64>() / SEGMENTS as f64;
        let uneven = segments.iter().map(|s| (s / mean - 1.0).abs()).fold(0.0, f64::max);
        assert!(uneven < 0.02, "{round:?}: segments differ by {uneven}");
        assert!(found.length > 1.02 * (ends[1] - ends[0]).norm(), "{round:?}: it lies on nothing");
    }
}

/// A capstan without friction: one tension at both ends, along the string; the solid bears their sum, and no moment about its axis.
#[test]
fn a_frictionless_capstan_gives_back_the_tension_and_no_torque() {
    for (round, ends) in cases() {
        let found = way(round, ends);
        let last = found.along;
        // The same way from the other end.
        let first = way(round, [ends[1], ends[0]]).along;
        for (pull, at) in [(first, 0), (last, SEGMENTS)] {
            assert!((pull.norm() - 1.0).abs() < 0.01, "{round:?}: {}", pull.norm());
            // Forces of the ends have no moment about the axis together.
            assert!(found.places[at].coords.norm() > RADIUS);
        }
        assert!((first.norm() - last.norm()).abs() < 0.01, "{round:?}");
        let moment = ends[0].coords.cross(&first) + ends[1].coords.cross(&last);
        let torque = if round == Round::Ball { moment.norm() } else { moment.z.abs() };
        assert!(torque < 0.01 * RADIUS, "{round:?}: {torque} m per newton");
        assert!((first + last).norm() > 0.3, "{round:?}: it presses on nothing");
    }
}

#[test]
fn beside_the_solid_a_string_is_straight() {
    let ends = [[-0.03, 0.035, 0.01], [0.03, 0.03, -0.01]].map(Point3::from);
    let found = way(Round::Ball, ends);
    let whole = ends[1] - ends[0];
    assert!((found.length - whole.norm()).abs() < 1e-12 && (found.along - whole.normalize()).norm() < 1e-9);
    for (k, p) in found.places.iter().enumerate() {
        assert!((p - (ends[0] + whole * (k as f64 / SEGMENTS as f64))).norm() < 1e-9, "node {k}");
    }
}

#[test]
fn forces_and_stiffness_of_strings_are_derivatives() {
    let law = Strand { stiffness: 5e3, toe: 0.03 };
    let mut random = Random::new(5);
    for (round, [from, to]) in cases() {
        for pull in [Pull::Tension(0, 0.7), Pull::Elastic(law, 0.06)] {
            let string = TautString::new(round.field(), from);
            let first = string.way(&to, None);
            let strings = Strings::new("string", &[[0]], vec![(string, pull)], vec![Memory::new(first)]);
            let controls = [100.0];
            let at = |p: Point3<f64>| {
                let x = [p.x, p.y, p.z];
                let s = State { x: &x, controls: &controls };
                let (mut f, mut k) = ([0.0; 3], [0.0; 9]);
                strings.forces(&s, 0, &mut f);
                strings.stiffness(&s, 0.0, 0, &mut k);
                (strings.energy(&s), Vector3::from(f), nalgebra::Matrix3::from_row_slice(&k))
            };
            let u = Vector3::from_fn(|_, _| random.uniform()).normalize();
            let h = 1e-6;
            let ((_, f, k), a, b) = (at(to), at(to - h * u), at(to + h * u));
            let slope = (b.0 - a.0) / (2.0 * h);
            assert!(
                (slope - f.dot(&u)).abs() < 1e-5 * f.norm(),
                "{round:?}, {pull:?}: {slope} {}",
                f.dot(&u)
            );
            let bend = (b.1 - a.1) / (2.0 * h);
            assert!((bend - k * u).norm() < 1e-3 * k.norm(), "{round:?}, {pull:?}: {bend} {}", k * u);
        }
    }
}

/// A string that trials have drawn to the other side of a rod, in whatever steps, comes back to the side that it was on in equilibrium, and from a new
/// equilibrium to the side of that.
#[test]
fn a_trial_far_off_does_not_lead_a_string_astray() {
    let [from, to] = [[-0.03, 0.004, 0.0], [0.03, 0.004, 0.0]].map(Point3::from);
    let string = TautString::new(Round::Rod.field(), from);
    let first = string.way(&to, None);
    // To the left it leaves the rod, comes back below it, and stays there while its end comes up again beside it.
    let corners =
        [[to.x, to.y], [-0.04, 0.03], [-0.04, -0.045], [0.02, -0.045], [0.03, -0.02], [0.03, -0.012]];
    for stride in [0.9e-3, 8e-3] {
        let memory = vec![Memory::new(first.clone())];
        let pull = Pull::Tension(0, 1.0);
        let strings = Strings::new("string", &[[0]], vec![(string.clone(), pull)], memory);
        let way = |x: f64, y: f64| strings.way(0, &[x, y, 0.0]);
        let above = |way: &Way| way.places[SEGMENTS / 2].y > 0.0;
        let mut far = way(to.x, to.y);
        assert!(above(&far));
        for pair in corners.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(nalgebra::Vector2::from);
            let n = ((b - a).norm() / stride).ceil();
            for k in 1..=n as usize {
                let at = a + (b - a) * (k as f64 / n);
                far = way(at.x, at.y);
            }
        }
        assert!(!above(&far), "steps of {stride} m try nothing: {far:?}");
        let back = way(to.x, to.y + 1e-5);
        let [found, wanted] = [back.length, first.length];
        assert!(above(&back) && (found - wanted).abs() < 1e-5, "{found} and {wanted} m, steps of {stride} m");
        strings.settle(&[0.03, -0.012, 0.0]);
        assert!(!above(&way(to.x, to.y)), "steps of {stride} m");
    }
}

/// In a groove what holds a string against going aside is the curvature of the solid across, far more than the string's own: without it ways did not
/// settle, the energy of a patella jumped from trial to trial, and its knee was not solved at 70 degrees. Ends of the long medial head on the way there.
#[test]
fn strings_settle_in_the_groove_of_a_knee() {
    let knee = DeepFlexion::made().unwrap().anatomy;
    let field = Arc::new(femur::field(&knee).unwrap());
    let from = Point3::new(40.8e-3, 187.2e-3, 14.7e-3);
    let string = TautString::new(field, from);
    let mut last: Option<Way> = None;
    for k in 0..40 {
        // Down around the trochlea, with the end of the string at the edge of the patella.
        let angle = 1.7 * f64::from(k) / 40.0;
        let to = Point3::new(12e-3 + 31e-3 * angle.cos(), 7e-3 - 31e-3 * angle.sin(), -9.4e-3);
        let found = string.way(&to, last.as_ref());
        assert!(found.length.is_finite(), "at step {k} it does not settle");
        let h = 1e-6;
        for c in 0..3 {
            let moved = |by: f64| string.way(&(to + by * Vector3::ith(c, 1.0)), Some(&found)).length;
            let slope = (moved(h) - moved(-h)) / (2.0 * h);
            assert!((slope - found.along[c]).abs() < 1e-5, "step {k}: {slope} {}", found.along[c]);
        }
        last = Some(found);
    }
}

/// Samples of a body on a solid: energy, forces and stiffness, for both layers, and what presses.
#[test]
fn what_rests_on_a_solid_has_forces_and_stiffness_that_are_derivatives() {
    let mut random = Random::new(7);
    for layer in [Layer::Foundation { stiffness: 4e9 }, Layer::Barrier { modulus: 2e7, distance: 2e-3 }] {
        // A body over a frame of four nodes, with samples about (0, 0.02, 0).
        let depth = if matches!(layer, Layer::Foundation { .. }) { -3e-4 } else { 1e-3 };
        let samples: Vec<Sample<4>> = (0..40)
            .map(|_| {
                let at = Vector3::new(random.uniform(), 1.0, random.uniform()).normalize() * (RADIUS + depth);
                let a = at / 0.01;
                Sample { weights: [1.0 - a.sum(), a.x, a.y, a.z], area: 1e-6, layer }
            })
            .collect();
        let body = Obstacle::new("body", Round::Ball.field(), &[[0, 1, 2, 3]], vec![samples]);
        let x = [0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01];
        let at = |x: &[f64; 12]| {
            let s = State { x, controls: &[] };
            let (mut f, mut k) = ([0.0; 12], [0.0; 144]);
            body.forces(&s, 0, &mut f);
            body.stiffness(&s, 0.0, 0, &mut k);
            (body.energy(&s), f, k)
        };
        let u: [f64; 12] = std::array::from_fn(|_| random.uniform());
        let moved = |h: f64| -> [f64; 12] { std::array::from_fn(|i| x[i] + h * u[i]) };
        let h = 1e-8;
        let ((_, f, k), a, b) = (at(&x), at(&moved(-h)), at(&moved(h)));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (slope, expected) = ((b.0 - a.0) / (2.0 * h), dot(&f, &u));
        assert!((slope / expected - 1.0).abs() < 1e-5, "{layer:?}: {slope} {expected}");
        let size = k.iter().fold(0.0_f64, |m, k| m.max(k.abs()));
        for i in 0..12 {
            let (bend, expected) = ((b.1[i] - a.1[i]) / (2.0 * h), dot(&k[12 * i..12 * (i + 1)], &u));
            assert!((bend - expected).abs() < 1e-4 * size, "{layer:?}, row {i}: {bend} {expected}");
        }
        // The force on the body is what its energy does not want: minus the sum over the frame.
        let pressed = body.pressed(&x);
        let sum: Vector3<f64> = (0..4).map(|n| Vector3::from_column_slice(&f[3 * n..3 * n + 3])).sum();
        assert!((pressed.force + sum).norm() < 1e-9 * sum.norm() && pressed.force.y > 0.0, "{layer:?}");
        assert!((pressed.area - 40e-6).abs() < 1e-12 && pressed.pressure > 0.0, "{layer:?}");
    }
}
