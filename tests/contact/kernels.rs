//! Distances, barrier and continuous collision detection against brute force and Taylor expansions.

use fem::contact::barrier::barrier;
use fem::contact::ccd::{edge_edge_step, point_triangle_step, tenth};
use fem::contact::stencil::{Law, Stencil};
use fem::contact::surface::{SurfaceInput, Surfaces};
use fem::contact::{Contact, ContactInput};
use fem::geometry::closest::{Closest, Points, edge_edge, point_edge, point_point, point_triangle};
use nalgebra::Vector3;
use std::sync::mpsc::channel;
use std::time::Duration;
use support::{Random, taylor_order};

type V = Vector3<f64>;

/// Least distance over a raster of both simplices.
fn raster(x: &Points, edges: bool) -> f64 {
    let n = 60;
    let mut least = f64::INFINITY;
    for i in 0..=n {
        for j in 0..=n {
            let (s, t) = (i as f64 / n as f64, j as f64 / n as f64);
            let w = if edges {
                x[0] + (x[1] - x[0]) * s - x[2] - (x[3] - x[2]) * t
            } else if s + t <= 1.0 {
                x[0] - x[1] - (x[2] - x[1]) * s - (x[3] - x[1]) * t
            } else {
                continue;
            };
            least = least.min(w.norm());
        }
    }
    least
}

#[test]
fn distances_agree_with_a_raster() {
    let mut random = Random::new(11);
    for edges in [false, true] {
        for _ in 0..400 {
            let x: Points = std::array::from_fn(|_| random.vector(1.0));
            let closest = if edges { edge_edge(&x) } else { point_triangle(&x) };
            let (d, brute) = (closest.squared().sqrt(), raster(&x, edges));
            assert!(d <= brute + 1e-12 && brute <= d + 0.06, "{d} against {brute}");
            let sum: f64 = closest.c.iter().sum();
            assert!(sum.abs() < 1e-12, "weights of a distance sum to zero, not {sum}");
        }
    }
}

/// Vertex on vertex, parallel edges, vertex over edge, coplanar faces, needles: finite distances and forces.
#[test]
fn degenerate_pairs_have_finite_distances_and_forces() {
    let v = V::new;
    let h = 1e-4;
    let cases: Vec<(&str, Points, bool, f64)> = vec![
        ("vertex over vertex", [v(0., 0., h), v(0., 0., 0.), v(-1., 0., -1.), v(0., -1., -1.)], false, h),
        ("vertex over edge", [v(0.5, 0., h), v(0., 0., 0.), v(1., 0., 0.), v(0.5, -1., -1.)], false, h),
        (
            "vertex in the plane of a face",
            [v(1. + h, 0., 0.), v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)],
            false,
            h,
        ),
        ("needle triangle", [v(0.5, 0., h), v(0., 0., 0.), v(1., 0., 0.), v(0.5, 1e-12, 0.)], false, h),
        ("parallel edges", [v(0., 0., 0.), v(1., 0., 0.), v(0.2, 0., h), v(0.7, 0., h)], true, h),
        (
            "parallel edges end to end",
            [v(0., 0., 0.), v(1., 0., 0.), v(1. + h, 0., 0.), v(2., 0., 0.)],
            true,
            h,
        ),
        ("nearly parallel", [v(0., 0., 0.), v(1., 0., 0.), v(0., 1e-9, h), v(1., -1e-9, h)], true, h),
        ("edge across edge", [v(-1., 0., 0.), v(1., 0., 0.), v(0., -1., h), v(0., 1., h)], true, h),
        ("corner on edge", [v(0., 0., 0.), v(1., 0., 0.), v(1., 0., h), v(1., 1., h)], true, h),
    ];
    for (name, x, edges, expected) in cases {
        let closest = if edges { edge_edge(&x) } else { point_triangle(&x) };
        let d = closest.squared().sqrt();
        assert!((d - expected).abs() < 1e-9, "{name}: distance {d}");
        let term = stencil(closest, &x, 2e-4, edges);
        let g = term.gradient(&x);
        let total = g.iter().sum::<V>().norm();
        let size = g.iter().map(V::norm).fold(0.0, f64::max);
        assert!(
            term.energy(&x).is_finite() && size.is_finite() && total <= 1e-9 * size.max(1e-12),
            "{name}: {g:?}"
        );
        let finite = term.hessian(&x).as_flattened().iter().all(|v| v.is_finite());
        assert!(finite, "{name}: Hessian");
    }
}

fn stencil(closest: Closest, x: &Points, reach: f64, edges: bool) -> Stencil {
    let edges = if edges { (x[1] - x[0]).norm_squared() * (x[3] - x[2]).norm_squared() } else { 0.0 };
    Stencil { points: [0, 1, 2, 3], closest, scale: 3.0, law: Law::Barrier(reach), edges }
}

#[test]
fn the_barrier_is_twice_differentiable_and_infinite_at_contact() {
    for s in [0.01, 0.2, 0.5, 0.9, 0.999] {
        let [_, b1, b2] = barrier(s);
        let h = 1e-2 * s.min(1.0 - s);
        assert!(taylor_order(|h| barrier(s + h)[0], b1, h) > 1.9, "slope at {s}");
        assert!(taylor_order(|h| barrier(s + h)[1], b2, h) > 1.9, "curvature at {s}");
        assert!(b1 < 0.0 && b2 > 0.0);
    }
    assert_eq!(barrier(1.0), [0.0; 3]);
    assert!(barrier(1.0 - 1e-6)[2].abs() < 1e-4, "the curvature fades at the activation distance");
    assert!(barrier(0.0)[0].is_infinite() && barrier(-1.0)[0].is_infinite() && barrier(1e-12)[0] > 27.0);
}

/// The Hessian without (part of) its negative curvatures is the same on the few directions that it is made of as on all twelve.
#[test]
fn hessians_are_lifted_on_the_directions_that_they_are_made_of() {
    let mut random = Random::new(6);
    type Find = fn(&Points) -> Closest;
    let kinds: [(Find, bool); 4] =
        [(point_point, false), (point_edge, false), (point_triangle, false), (edge_edge, true)];
    let mut changed = [0; 4];
    for (kind, (find, edges)) in kinds.into_iter().enumerate() {
        for sample in 0..400 {
            let mut x: Points = std::array::from_fn(|_| random.vector(1.0));
            match sample % 8 {
                // Nearly parallel edges, and a point close to a triangle.
                1 => x[3] = x[2] + (x[1] - x[0]) + random.vector(0.01),
                2 => x[0] = x[1] * 0.3 + x[2] * 0.3 + x[3] * 0.4 + random.vector(1e-6),
                _ => {}
            }
            let closest = find(&x);
            let d = closest.squared().sqrt();
            let law = match sample % 3 {
                0 => Law::Barrier(1.5 * d),
                1 => {
                    let [side, extra] = [[-1.0, 0.0], [-4.0, 0.0], [-1.0, d]][sample / 3 % 3];
                    Law::Soft { reach: 1.5 * d, softness: 0.2, side, extra }
                }
                _ => Law::Spring,
            };
            // Features that are counted once too often have a negative scale.
            let scale = if sample % 5 == 0 { -3.0 } else { 3.0 };
            let term = Stencil { law, scale, ..stencil(closest, &x, 1.5 * d, edges) };
            let fraction = [1.0, 0.25][sample % 2];
            let mut expected = term.hessian(&x);
            let largest = expected.as_flattened().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            changed[kind] += usize::from(fem::element::psd::lift(&mut expected, fraction));
            let lifted = term.lifted_hessian(&x, fraction);
            for (a, b) in lifted.as_flattened().iter().zip(expected.as_flattened()) {
                assert!(
                    (a - b).abs() <= 1e-8 * largest,
                    "kind {kind}, sample {sample}: {a} and {b} of {largest}"
                );
            }
        }
    }
    assert!(changed.iter().all(|n| *n > 100), "{changed:?} of 400 were changed");
}

/// Gradient and Hessian of every kind of pair, mollified edges among them.
#[test]
fn gradient_and_hessian_of_every_kind_of_pair_are_derivatives() {
    let mut random = Random::new(5);
    type Find = fn(&Points) -> Closest;
    let kinds: [(&str, Find, bool); 4] = [
        ("point and point", point_point, false),
        ("point and edge", point_edge, false),
        ("point and triangle", point_triangle, false),
        ("two edges", edge_edge, true),
    ];
    let mut seen = std::collections::BTreeMap::<String, (usize, f64, f64)>::new();
    for (name, find, edges) in kinds {
        for sample in 0..400 {
            let mut x: Points = std::array::from_fn(|_| random.vector(1.0));
            if edges && sample % 2 == 1 {
                // Nearly parallel, so that the mollifier is at work.
                x[2] = x[0] + random.vector(0.3);
                x[3] = x[2] + (x[1] - x[0]) + random.vector(0.01);
            }
            let closest = find(&x);
            let rest = x;
            let reach = 1.5 * closest.squared().sqrt();
            let softened = |side, extra| Law::Soft { reach, softness: 0.2, side, extra };
            let law = match sample / 2 % 3 {
                0 => Law::Barrier(reach),
                1 => softened(-4.0, 0.0),
                _ => softened(-1.0, reach),
            };
            let at = |x: &Points| Stencil { closest: find(x), law, ..stencil(closest, &rest, reach, edges) };
            let term = at(&x);
            let direction: [V; 4] = std::array::from_fn(|_| random.vector(1.0));
            let other: [V; 4] = std::array::from_fn(|_| random.vector(1.0));
            let moved = |h: f64| -> Points { std::array::from_fn(|i| x[i] + direction[i] * h) };
            let h = 1e-5;
            // A pair whose closest features change within the step, or that begins to count as parallel, is smooth only
            // once; leave it.
            let which = |x: &Points| {
                let sine = (x[1] - x[0]).cross(&(x[3] - x[2])).norm_squared()
                    / stencil(closest, &rest, 1.0, true).edges;
                (find(x).c.map(|c| c == 0.0), find(x).n_free, edges && sine < 1e-3)
            };
            if which(&moved(h)) != which(&x) {
                continue;
            }
            let g = term.gradient(&x);
            let slope: f64 = g.iter().zip(&direction).map(|(g, d)| g.dot(d)).sum();
            let first = taylor_order(|h| at(&moved(h)).energy(&moved(h)), slope, h);
            let H = term.hessian(&x);
            let mut curve = 0.0;
            for r in 0..12 {
                for c in 0..12 {
                    curve += other[r / 3][r % 3] * H[r][c] * direction[c / 3][c % 3];
                    assert!(
                        (H[r][c] - H[c][r]).abs() <= 1e-9 * H[r][r].abs().max(H[c][c].abs()).max(1.0),
                        "{name}: symmetry"
                    );
                }
            }
            let along = |h: f64| {
                let y = moved(h);
                at(&y).gradient(&y).iter().zip(&other).map(|(g, d)| g.dot(d)).sum::<f64>()
            };
            let second = taylor_order(along, curve, h);
            let row =
                seen.entry(format!("{name}, {} free", closest.n_free)).or_insert((0, f64::MAX, f64::MAX));
            *row = (row.0 + 1, row.1.min(first), row.2.min(second));
        }
    }
    for (name, (n, first, second)) in &seen {
        println!("{name}: {n} samples, gradient order {first:.2}, Hessian order {second:.2}");
        assert!(*first > 1.9 && *second > 1.9, "{name}: {first}, {second}");
    }
    assert!(seen.len() >= 8, "kinds seen: {:?}", seen.keys());
}

#[test]
fn no_pair_passes_through_within_the_fraction_it_may_go() {
    let mut random = Random::new(3);
    let mut limited = 0;
    for edges in [false, true] {
        for sample in 0..600 {
            let from: Points = std::array::from_fn(|_| random.vector(1.0));
            let size = [0.1, 1.0, 100.0][sample % 3];
            let to: Points = std::array::from_fn(|i| from[i] + random.vector(size));
            let distance = |x: &Points| if edges { edge_edge(x) } else { point_triangle(x) }.squared().sqrt();
            let fraction = if edges {
                edge_edge_step(&from, &to, tenth)
            } else {
                point_triangle_step(&from, &to, tenth)
            };
            assert!((0.0..=1.0).contains(&fraction));
            let at = |t: f64| -> Points { std::array::from_fn(|i| from[i] + (to[i] - from[i]) * t) };
            // The signed volume of the four points changes sign where the pair passes through.
            let least =
                (0..=500).map(|k| distance(&at(fraction * k as f64 / 500.0))).fold(f64::MAX, f64::min);
            assert!(least >= 0.09 * distance(&from), "{least} of {}", distance(&from));
            limited += usize::from(fraction < 1.0);
        }
    }
    assert!(limited > 100, "{limited} pairs would have come too close");
    // Straight through the middle: stops before, at nearly the full way.
    let through = |z: f64| -> Points { [V::new(0.3, 0.3, z), V::zeros(), V::x(), V::y()] };
    let fraction = point_triangle_step(&through(1.0), &through(-1.0), tenth);
    assert!((0.44..0.5).contains(&fraction), "{fraction}");
}

/// What is behind a face is the body, not what stands across a notch: a comb of cubes, whose faces look at each other.
#[test]
fn depths_are_those_of_the_body_behind_a_face() {
    const EDGE: f64 = 0.01;
    let is_body = |[i, j]: [i32; 2]| (0..7).contains(&i) && (j == 0 || j == 1 && i % 2 == 0);
    let (mut points, mut faces, mut expected) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..7 {
        for j in (0..2).filter(|&j| is_body([i, j])) {
            for [x, z] in
                [[1, 0], [-1, 0], [0, 1], [0, -1]].into_iter().filter(|d| !is_body([i + d[0], j + d[1]]))
            {
                let depth = (1..).find(|n| !is_body([i - n * x, j - n * z])).expect("the body ends");
                let centre =
                    Vector3::new(f64::from(i) + 0.5 * f64::from(x), 0.0, f64::from(j) + 0.5 * f64::from(z));
                // Counter-clockwise about the normal (x, 0, z).
                let (y, t) = (Vector3::y() * 0.5, Vector3::new(f64::from(z), 0.0, f64::from(-x)) * 0.5);
                let first = points.len() as u32 / 3;
                [-y - t, -y + t, y + t, y - t]
                    .iter()
                    .for_each(|c| points.extend(((centre + c) * EDGE).iter()));
                faces.push([first, first + 1, first + 2, first + 3]);
                expected.push(f64::from(depth) * EDGE);
            }
        }
    }
    let input = SurfaceInput {
        name: "comb".into(),
        stiffness: vec![1e4; faces.len()],
        faces,
        spacing: f64::INFINITY,
    };
    let surfaces = Surfaces::new(&[input], &points);
    assert_eq!(surfaces.depths.len(), 4 * expected.len());
    for (found, expected) in surfaces.depths.chunks(4).zip(expected) {
        assert!(
            found.iter().all(|d| (d - expected).abs() < 1e-9),
            "depths {found:?} m, expected {expected} m"
        );
    }
}

/// A thread that waits for others in a search may take up another search of the same contact: here one is in the middle of the other.
#[test]
fn a_search_within_a_search_does_not_wait_for_it() {
    const LEAST: f64 = 2e-3;
    const FACES: [[u32; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    // Two cubes of 10 mm, 1 mm apart.
    let cube = |z: f64| {
        let corner = move |i: u32| [f64::from(i & 1), f64::from(i >> 1 & 1), z + f64::from(i >> 2)];
        (0..8).flat_map(corner).map(|c| 0.01 * c)
    };
    let x: Vec<f64> = cube(0.0).chain(cube(1.1)).collect();
    let surface = |k: u32| SurfaceInput {
        name: format!("cube {k}"),
        faces: FACES.map(|face| face.map(|node| node + 8 * k)).to_vec(),
        stiffness: vec![1e4; FACES.len()],
        spacing: 2e-3,
    };
    let input = ContactInput {
        surfaces: vec![surface(0), surface(1)],
        pairs: vec![[0, 1]],
        distance: 1e-3,
        carrier: vec![None; 16],
        ..ContactInput::default()
    };
    let contact = Contact::new(&input, &x);
    let alone = contact.n_near(&x, LEAST, &|_, _| LEAST);
    assert!(alone > 8, "{alone} points");
    let (done, told) = channel();
    std::thread::spawn(move || {
        let least = |_: usize, _: usize| {
            assert_eq!(contact.n_near(&x, LEAST, &|_, _| LEAST), alone);
            LEAST
        };
        done.send(contact.n_near(&x, LEAST, &least)).expect("somebody waits for it");
    });
    assert_eq!(told.recv_timeout(Duration::from_secs(60)), Ok(alone));
}
