//! Are the answers about triangulated surfaces right: what meets, how close, inside or outside, sound or not?

use fem::geometry::closest::Feature;
use fem::geometry::distance::{self, Closest};
use fem::geometry::intersect::{Triangle, neighbours_meet, triangles_meet};
use fem::geometry::overlap::overlap;
use fem::geometry::{SearchSurface, SignedDistance, Surface, SurfaceError};
use fem::mesh::LengthUnit;
use nalgebra::{Rotation3, Vector3};
use support::{Random, shared};

// ------------------------------------------------------------------------------------------------ shapes

/// A closed surface: an octahedron, each triangle cut in four `n` times, points put on the sphere [m].
fn sphere(radius: f64, centre: [f64; 3], n: usize) -> Surface {
    let mut points: Vec<Vector3<f64>> = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
        .map(|p| Vector3::from(p).cast())
        .into();
    let mut triangles =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..n {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    points.push((points[a as usize] + points[b as usize]).normalize());
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let place = |p: &Vector3<f64>| (Vector3::from(centre) + radius * p).into();
    Surface { points: points.iter().map(place).collect(), triangles }
}

/// A box with outward triangles [m].
fn cuboid(low: [f64; 3], high: [f64; 3]) -> Surface {
    let points: Vec<[f64; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] })).collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    Surface::from_faces(&points, &faces).0
}

/// Two surfaces as one list.
fn together(mut a: Surface, b: &Surface) -> Surface {
    let shift = a.points.len() as u32;
    a.points.extend(&b.points);
    a.triangles.extend(b.triangles.iter().map(|t| t.map(|p| p + shift)));
    a
}

/// A bumpy ball that fills boxes badly.
fn bumpy(centre: [f64; 3], n: usize, seed: u64) -> Surface {
    let mut surface = sphere(1.0, [0.0; 3], n);
    let mut random = Random::new(seed);
    for p in &mut surface.points {
        let r = 0.1 * (1.0 + 0.1 * random.uniform());
        *p = [0, 1, 2].map(|k| centre[k] + r * p[k] * [1.0, 1.0, 0.4][k]);
    }
    surface
}

fn on_threads<T: Send>(n: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads").install(work)
}

// ------------------------------------------------------------------------------------------------ exact test

type Grid = [i128; 3];

fn sub(a: Grid, b: Grid) -> Grid {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Grid, b: Grid) -> Grid {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Grid, b: Grid) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Two convex sets meet if and only if the hull of all differences of their corners holds the origin, and by Carathéodory's
/// theorem the origin is then in a simplex of at most four of them that are in general position. Whole numbers: exact.
fn meet_by_differences(a: [Grid; 3], b: [Grid; 3]) -> bool {
    let d: Vec<Grid> = (0..9).map(|i| sub(a[i / 3], b[i % 3])).collect();
    let zero = [0; 3];
    let same = |turns: &[i128]| turns.iter().all(|&t| t >= 0) || turns.iter().all(|&t| t <= 0);
    for i in 0..9 {
        if d[i] == zero {
            return true;
        }
        for j in 0..i {
            if cross(d[i], d[j]) == zero && dot(d[i], d[j]) < 0 {
                return true;
            }
            for k in 0..j {
                let n = cross(sub(d[j], d[i]), sub(d[k], d[i]));
                if n != zero && dot(n, d[i]) == 0 {
                    let turn = |p, q| dot(n, cross(p, q));
                    if same(&[turn(d[i], d[j]), turn(d[j], d[k]), turn(d[k], d[i])]) {
                        return true;
                    }
                }
                for l in 0..k {
                    let six =
                        |p: Grid, q: Grid, r: Grid, s: Grid| dot(sub(q, p), cross(sub(r, p), sub(s, p)));
                    let all = six(d[i], d[j], d[k], d[l]);
                    let parts = [
                        six(zero, d[j], d[k], d[l]),
                        six(d[i], zero, d[k], d[l]),
                        six(d[i], d[j], zero, d[l]),
                        six(d[i], d[j], d[k], zero),
                    ];
                    if all != 0 && same(&parts) {
                        return true;
                    }
                }
            }
        }
    }
    false
}

fn grid_triangle(random: &mut Random, size: i128) -> [Grid; 3] {
    let n = 2 * size + 1;
    [(); 3].map(|()| [(); 3].map(|()| (random.bits() % n as u64) as i128 - size))
}

fn triangle(t: [Grid; 3], scale: f64, shift: f64) -> Triangle {
    t.map(|p| Vector3::from(p.map(|x| x as f64 * scale + shift)))
}

#[test]
fn triangles_meet_exactly_when_whole_numbers_say_so() {
    let mut random = Random::new(7);
    let mut met = 0;
    let mut degenerate = 0;
    for round in 0..60_000 {
        // Small grids: in one plane, touching, without area, equal; large ones: in general position.
        let size = [1, 2, 3, 40][round % 4];
        let (a, b) = (grid_triangle(&mut random, size), grid_triangle(&mut random, size));
        let expected = meet_by_differences(a, b);
        met += usize::from(expected);
        degenerate += usize::from(cross(sub(a[1], a[0]), sub(a[2], a[0])) == [0; 3]);
        // Exact in doubles as well: small, and shifted so far that differences of products lose all digits.
        for (scale, shift) in [(1.0, 0.0), (0.001953125, 1.0), (9.313225746154785e-10, 3.0)] {
            let (a, b) = (triangle(a, scale, shift), triangle(b, scale, shift));
            for [a, b] in [[a, b], [b, a], [[a[2], a[0], a[1]], [b[1], b[0], b[2]]]] {
                assert_eq!(triangles_meet(&a, &b), expected, "{a:?} {b:?}");
            }
            assert_eq!(distance::triangles(&a, &b).distance == 0.0, expected);
        }
    }
    assert!(met > 10_000 && 60_000 - met > 10_000 && degenerate > 2_000, "{met} {degenerate}");
}

/// One triangle inside another of the same plane: no edge meets an edge.
#[test]
fn nested_triangles_of_one_plane_meet() {
    let mut random = Random::new(11);
    let mut tested = 0;
    while tested < 2_000 {
        let t = grid_triangle(&mut random, 20);
        let n = cross(sub(t[1], t[0]), sub(t[2], t[0]));
        if n == [0; 3] {
            continue;
        }
        tested += 1;
        let mix = |w: [i128; 3]| [0, 1, 2].map(|i| w[0] * t[0][i] + w[1] * t[1][i] + w[2] * t[2][i]);
        let outer = [mix([6, 0, 0]), mix([0, 6, 0]), mix([0, 0, 6])];
        let inner = [mix([4, 1, 1]), mix([1, 4, 1]), mix([1, 1, 4])];
        let moved = |by: Grid| inner.map(|p| [0, 1, 2].map(|i| p[i] + by[i]));
        // Inside; lifted off the plane; in the plane, but two widths aside.
        let aside = sub(mix([12, 0, 0]), mix([0, 12, 0]));
        for (inner, expected) in [(inner, true), (moved(n), false), (moved(aside), false)] {
            assert_eq!(meet_by_differences(outer, inner), expected);
            let (a, b) = (triangle(outer, 1.0, 0.0), triangle(inner, 1.0, 0.0));
            assert_eq!([triangles_meet(&a, &b), triangles_meet(&b, &a)], [expected; 2], "{a:?} {b:?}");
            assert_eq!(distance::triangles(&a, &b).distance == 0.0, expected);
        }
    }
}

#[test]
fn triangles_one_rounding_error_apart_are_told_apart() {
    // A corner above, in, or below a sloping plane by one unit in the last place.
    let mut random = Random::new(3);
    for _ in 0..2_000 {
        let t: Triangle = [(); 3].map(|()| random.vector(0.5).component_mul(&Vector3::new(1.0, 1.0, 0.1)));
        if (t[1] - t[0]).xy().perp(&(t[2] - t[0]).xy()).abs() < 0.1 {
            continue;
        }
        let middle = (t[0] + t[1] + t[2]) / 3.0;
        let tip = |x: f64| Vector3::new(middle.x, middle.y, x);
        let far = tip(middle.z + 0.3);
        // Move the tip until the exact sign changes; on one side it must miss, on the other meet.
        let meets = |z: f64| triangles_meet(&t, &[tip(z), far, far + Vector3::new(0.1, 0.05, 0.0)]);
        let (mut low, mut high) = (middle.z - 1e-12, middle.z + 1e-12);
        assert!(meets(low) && !meets(high));
        while low.next_up() < high {
            let half = low + (high - low) / 2.0;
            if meets(half) { low = half } else { high = half }
        }
        assert!((low - middle.z).abs() < 1e-14, "{} {}", low, middle.z);
        // and distance agrees with the exact test
        let at =
            |z: f64| distance::triangles(&t, &[tip(z), far, far + Vector3::new(0.1, 0.05, 0.0)]).distance;
        assert!(at(low) == 0.0 && at(high) > 0.0 && at(high) < 1e-14);
    }
}

#[test]
fn neighbours_meet_only_beyond_what_they_share() {
    let v = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let (o, x, y) = (v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.));
    let t = [o, x, y];
    let edge = [(0, 0), (1, 1)];
    for (third, expected) in [
        (v(0.3, -1., 0.), false),     // flat, to the other side
        (v(0.3, 0.4, 0.), true),      // folded back onto it
        (v(0.3, 0.4, 1e-300), false), // folded back, but not quite
        (v(0.3, 0.4, 1.), false),     // upright
        (v(-3., 0.1, 0.), true),      // overlapping only near the corner
    ] {
        assert_eq!(neighbours_meet(&t, &[o, x, third], &edge), expected, "{third:?}");
        assert_eq!(neighbours_meet(&[o, x, third], &t, &edge), expected, "{third:?}");
    }
    for (b, c, expected) in [
        (v(-1., 0., 0.), v(0., -1., 0.), false), // opposite quadrant of the plane
        (v(0.5, 0.5, 1.), v(0.5, 0.5, -1.), true), // through it
        (v(0.5, 0.5, 1.), v(0.5, 0.5, 0.5), false), // above it
        (v(2., 2., 0.), v(-1., 2., 0.), true),   // in the plane, covering
        (v(0.4, 0.4, 0.), v(0., -1., 0.5), true), // corner inside it
        (v(2., 0., 0.), v(0., -1., 0.), true),   // along its edge
        (v(-1., 1., 0.), v(-1., 0., 0.), false), // only the corner
        (v(-1e-9, 1., 0.), v(-1., 0., 0.), false),
        (v(1e-9, 1., 0.), v(-1., 0., 0.), true),
    ] {
        assert_eq!(neighbours_meet(&t, &[b, o, c], &[(0, 1)]), expected, "{b:?} {c:?}");
        assert_eq!(neighbours_meet(&[b, o, c], &t, &[(1, 0)]), expected, "{b:?} {c:?}");
    }
}

// ------------------------------------------------------------------------------------------------ distances

/// The two points are the closest ones of two convex sets if and only if neither set reaches, anywhere, beyond the plane
/// through its point across the line between them. Where it does so by v at a distance L, a step there would shorten the
/// distance d by v²/(2 d L²), at most v/d: less than round-off is wanted.
fn assert_closest(a: &[Vector3<f64>], b: &[Vector3<f64>], found: &Closest) {
    let size = a.iter().chain(b).map(|p| p.amax()).fold(0.0, f64::max);
    let apart = found.on_b - found.on_a;
    assert!((apart.norm() - found.distance).abs() <= 4e-16 * size);
    let beyond_a = a.iter().map(|p| ((p - found.on_a).dot(&apart), (p - found.on_a).norm_squared()));
    let beyond_b = b.iter().map(|p| ((found.on_b - p).dot(&apart), (found.on_b - p).norm_squared()));
    for (v, l2) in beyond_a.chain(beyond_b) {
        let gain = (v * v / (2.0 * found.distance * l2)).min(v / found.distance);
        assert!(
            v <= 0.0 || (v < 1e-12 * size * size && gain < 1e-15 * size),
            "{v:e} {gain:e} {a:?} {b:?} {found:?}"
        );
    }
}

#[test]
fn closest_points_pass_the_test_of_convex_sets() {
    let mut random = Random::new(11);
    for round in 0..40_000 {
        let mut a: Triangle = [(); 3].map(|()| random.vector(1.0));
        let mut b: Triangle = [(); 3].map(|()| random.vector(1.0));
        match round % 8 {
            0 => b = b.map(|p| p + Vector3::new(1.5, 1.5, 1.5)),
            1 => b[1] = b[0] + (a[1] - a[0]) * 0.7, // parallel edges
            2 => b[1] = b[0] + (a[1] - a[0]) * 0.7 + random.vector(1e-9),
            3 => (a[2], b[2]) = (a[0] + (a[1] - a[0]) * 0.3, b[0]), // segments
            4 => b = a.map(|p| p + Vector3::new(0.0, 0.0, 1e-9)),   // a hair apart
            5 => a = a.map(|p| Vector3::new(p.x, p.y, 0.25)),
            6 => b = [a[0], b[1], b[2]],
            _ => {}
        }
        let found = distance::triangles(&a, &b);
        assert_eq!(found.distance == 0.0, triangles_meet(&a, &b));
        assert_closest(&a, &b, &found);
        assert_closest(&a[..1], &b, &distance::point_triangle(&a[0], &b).0);
        assert_closest(&a[..2], &b[1..], &distance::segments([&a[0], &a[1]], [&b[1], &b[2]]));
    }
}

#[test]
fn parts_of_a_triangle_are_named() {
    let t = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    for (p, part) in [
        ([-1.0, -1.0, 0.5], Feature::Vertex(0)),
        ([3.0, 0.5, 0.5], Feature::Vertex(1)),
        ([0.0, 2.0, -1.0], Feature::Vertex(2)),
        ([0.5, -1.0, 0.1], Feature::Edge(0)),
        ([1.0, 1.0, 0.1], Feature::Edge(1)),
        ([-1.0, 0.5, 0.1], Feature::Edge(2)),
        ([0.2, 0.2, 7.0], Feature::Face),
    ] {
        assert_eq!(distance::point_triangle(&Vector3::from(p), &t).1, part);
    }
}

// ------------------------------------------------------------------------------------------------ whole surfaces

#[test]
fn the_tree_finds_what_trying_all_pairs_finds() {
    let n = 3;
    let mut a = SearchSurface::new(sphere(0.2, [0.0; 3], n)); // boxes fitted to other places than in use
    a.set_points(&bumpy([0.0; 3], n, 1).points);
    for (shift, expect_meeting) in
        [([0.0, 0.0, 0.095], false), ([0.05, 0.0, 0.06], true), ([0.7, 0.1, 0.0], false)]
    {
        let b = SearchSurface::new(bumpy(shift, n, 2));
        let (s, t) = (a.surface(), b.surface());
        let d = 0.03;
        let all = |i: usize| (0..t.triangles.len()).map(move |j| (i, j));
        let every: Vec<_> = (0..s.triangles.len()).flat_map(all).collect();
        let gap = |&(i, j): &(usize, usize)| distance::triangles(&s.corners(i), &t.corners(j)).distance;
        let near: Vec<_> = every.iter().filter(|p| gap(p) <= d).map(|p| (p.0 as u32, p.1 as u32)).collect();
        let pairs = a.pairs_within(&b, d);
        assert_eq!(pairs.iter().map(|g| (g.a, g.b)).collect::<Vec<_>>(), near);
        let least = every.iter().map(gap).fold(f64::INFINITY, f64::min);
        assert_eq!(a.least_gap(&b).unwrap().closest.distance, least);
        assert_eq!(b.least_gap(&a).unwrap().closest.distance, least);
        let meeting: Vec<_> =
            every.iter().filter(|p| gap(p) == 0.0).map(|p| (p.0 as u32, p.1 as u32)).collect();
        assert_eq!(a.intersections(&b), meeting);
        assert_eq!(!meeting.is_empty(), expect_meeting);
    }
}

#[test]
fn answers_do_not_depend_on_threads() {
    let a = SearchSurface::new(bumpy([0.0; 3], 4, 1));
    let b = SearchSurface::new(bumpy([0.0, 0.0, 0.07], 4, 2));
    let signed = SignedDistance::new(&b).unwrap();
    let ask = || {
        let gaps = (a.pairs_within(&b, 0.01), a.least_gap(&b), a.intersections(&b), a.self_intersections());
        (gaps, signed.of(&a.surface().points), overlap(&a, &b, 2e-3).unwrap())
    };
    assert_eq!(on_threads(1, ask), on_threads(7, ask));
}

#[test]
fn self_intersections_are_found_and_only_they() {
    let ball = sphere(0.1, [0.0; 3], 3);
    assert!(SearchSurface::new(ball.clone()).self_intersections().is_empty());
    // Two balls in one list: the pairs are those of the two surfaces.
    let other = sphere(0.1, [0.15, 0.01, 0.0], 3);
    let n = ball.triangles.len() as u32;
    let expected = SearchSurface::new(ball.clone()).intersections(&SearchSurface::new(other.clone()));
    let found = SearchSurface::new(together(ball.clone(), &other)).self_intersections();
    assert!(!expected.is_empty());
    assert_eq!(found, expected.iter().map(|&(a, b)| (a, b + n)).collect::<Vec<_>>());
    // One point pushed through the far side.
    let mut pierced = ball;
    pierced.points[0] = [-0.2, 0.013, 0.007];
    let found = SearchSurface::new(pierced.clone()).self_intersections();
    let touched = |t: u32| pierced.triangles[t as usize].contains(&0);
    assert!(!found.is_empty() && found.iter().all(|&(a, b)| touched(a) || touched(b)));
}

#[test]
fn signed_distance_to_a_box_is_the_formula() {
    let half = [0.1, 0.07, 0.03];
    let turn = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
    let mut surface = cuboid(half.map(|x| -x), half);
    surface.points.iter_mut().for_each(|p| *p = (turn * Vector3::from(*p)).into());
    let search = SearchSurface::new(surface);
    let signed = SignedDistance::new(&search).unwrap();
    let mut random = Random::new(5);
    let mut inside = 0;
    for round in 0..20_000 {
        let mut p = random.vector(0.2);
        if round % 4 == 0 {
            p = Vector3::from(half).component_mul(&p.map(f64::signum)) * (1.0 + 0.2 * random.uniform()); // near a corner
        }
        let q = p.abs() - Vector3::from(half);
        let expected = q.sup(&Vector3::zeros()).norm() + q.max().min(0.0);
        let found = signed.at(&(turn * p));
        assert!((found.distance - expected).abs() < 1e-15, "{p:?}: {} {expected}", found.distance);
        assert!(((found.closest - turn * p).norm() - expected.abs()).abs() < 1e-15);
        inside += usize::from(expected < 0.0);
    }
    assert!(inside > 1_000);
}

/// parry's triangle meshes share no closest points and no normals with ours.
#[test]
fn signed_distance_is_that_of_parry() {
    use parry3d_f64::math::Vector;
    use parry3d_f64::query::PointQuery;
    use parry3d_f64::shape::{TriMesh, TriMeshFlags};
    let (mut inside, mut worst) = (0, 0.0_f64);
    for seed in 0..4 {
        let surface = bumpy([0.3, -0.2, 0.1], 3, seed);
        let vertices = surface.points.iter().map(|p| Vector::new(p[0], p[1], p[2])).collect();
        let theirs =
            TriMesh::with_flags(vertices, surface.triangles.clone(), TriMeshFlags::ORIENTED).unwrap();
        let search = SearchSurface::new(surface);
        let ours = SignedDistance::new(&search).unwrap();
        let mut random = Random::new(seed);
        for _ in 0..2_000 {
            let p = Vector3::new(0.3, -0.2, 0.1) + random.vector(0.2);
            let here = Vector::new(p.x, p.y, p.z);
            let projected = theirs.project_local_point(here, false);
            let distance = projected.point.distance(here);
            let expected = if projected.is_inside { -distance } else { distance };
            worst = worst.max((ours.at(&p).distance - expected).abs());
            inside += usize::from(projected.is_inside);
        }
    }
    assert!(inside > 100, "{inside}");
    assert!(worst < 1e-14, "{worst}");
}

#[test]
fn signed_distance_keeps_its_sign_at_sharp_edges() {
    // A thin wedge: at its edge the normal of either face alone gives the wrong sign for many points.
    let points = [
        [0.0, 0.0, 0.0],
        [0.1, 0.0, 0.0],
        [0.0, 0.1, 0.004],
        [0.1, 0.1, 0.004],
        [0.0, 0.1, -0.004],
        [0.1, 0.1, -0.004],
    ];
    let faces = [[0, 1, 3, 2], [0, 4, 5, 1], [2, 3, 5, 4], [0, 2, 4, 4], [1, 5, 3, 3]];
    let surface = Surface::from_faces(&points, &faces).0;
    surface.check().expect("a sound wedge");
    let search = SearchSurface::new(surface);
    let signed = SignedDistance::new(&search).unwrap();
    let mut random = Random::new(9);
    for _ in 0..20_000 {
        let p = random.vector(0.15);
        let inside = (0.0..0.1).contains(&p.x) && (0.0..0.1).contains(&p.y) && p.z.abs() < 0.04 * p.y;
        assert_eq!(signed.at(&p).distance < 0.0, inside, "{p:?}");
    }
}

#[test]
fn a_signed_distance_needs_a_closed_surface() {
    let mut open = sphere(0.1, [0.0; 3], 1);
    open.triangles.pop();
    let search = SearchSurface::new(open);
    assert!(matches!(SignedDistance::new(&search), Err(SurfaceError::Open { count: 3, .. })));
}

#[test]
fn overlap_volume_of_boxes_and_balls() {
    let one = SearchSurface::new(cuboid([0.0; 3], [0.1, 0.1, 0.1]));
    let two = SearchSurface::new(cuboid([0.05, 0.02, 0.07], [0.2, 0.06, 0.3]));
    let found = overlap(&one, &two, 1e-3).unwrap();
    assert!((found.volume - 0.05 * 0.04 * 0.03).abs() < 1e-16, "{found:?}");
    assert!((found.longest - 0.03).abs() < 1e-15);
    // Lines through corners and along faces: a box in itself, a box beside itself.
    assert!((overlap(&one, &one, 1e-3).unwrap().volume - 1e-3).abs() < 1e-15);
    let beside = SearchSurface::new(cuboid([0.1, 0.0, 0.0], [0.2, 0.1, 0.1]));
    assert_eq!(overlap(&one, &beside, 1e-3).unwrap().volume, 0.0);
    // A lens of two balls, π (4 R + d) (2 R - d)² / 12.
    let (r, d) = (0.05, 0.06);
    let [a, b] = [0.0, d].map(|x| SearchSurface::new(sphere(r, [x, 0.001, 0.002], 6)));
    let lens = std::f64::consts::PI * (4.0 * r + d) * (2.0 * r - d).powi(2) / 12.0;
    let found = overlap(&a, &b, 0.5e-3).unwrap();
    assert!((found.volume / lens - 1.0).abs() < 2e-3, "{} {lens}", found.volume);
    assert!(found.uncertainty < 2e-3 * lens);
}

#[test]
fn quadrilaterals_are_cut_the_same_from_both_sides() {
    let points = [[0.0; 3], [0.1, 0.0, 0.0], [0.1, 0.1, 0.02], [0.0, 0.1, 0.0]];
    for start in 0..4u32 {
        let face = [0, 1, 2, 3].map(|k| (start + k) % 4);
        let mut back = face;
        back.reverse();
        for face in [face, back] {
            let (surface, nodes) = Surface::from_faces(&points, &[face]);
            assert_eq!(nodes, [0, 1, 2, 3]);
            assert!(surface.triangles.iter().all(|t| t.contains(&0) && t.contains(&2)));
        }
    }
}

// ------------------------------------------------------------------------------------------------ soundness (IO3)

#[test]
fn measures_of_a_ball() {
    let ball = sphere(0.1, [3.0, -2.0, 1.0], 6);
    ball.check().expect("a sound ball");
    assert!((ball.volume() / (4e-3 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3);
    assert!((ball.area() / (0.04 * std::f64::consts::PI) - 1.0).abs() < 1e-3);
    assert!(ball.is_closed());
    assert_eq!(ball.components().1, 1);
    let (half, old) = ball.subset(&(0..100).collect::<Vec<_>>());
    assert_eq!(half.triangles.len(), 100);
    assert!(half.triangles[7].iter().zip(ball.triangles[7]).all(|(&p, q)| old[p as usize] == q));
    assert!(!half.is_closed());
}

/// Case IO3: every poison is refused by its name and place.
#[test]
fn poisoned_surfaces_are_refused_with_their_place() {
    let good = || sphere(0.1, [0.0; 3], 2);
    let refused = |surface: &Surface| surface.check().expect_err("a poisoned surface");
    let edit = |change: &dyn Fn(&mut Surface)| {
        let mut surface = good();
        change(&mut surface);
        refused(&surface)
    };
    good().check().expect("a sound ball");
    assert!(matches!(refused(&Surface::default()), SurfaceError::Empty));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let error = edit(&|s| s.points[5][1] = bad);
        assert!(matches!(error, SurfaceError::NotFinite { point: 5, .. }), "{error}");
    }
    let error = edit(&|s| s.triangles[9][2] = 66);
    assert!(
        matches!(error, SurfaceError::PointOutOfRange { triangle: 9, point: 66, n_points: 66 }),
        "{error}"
    );
    let error = edit(&|s| s.triangles[9][2] = s.triangles[9][0]);
    assert!(matches!(error, SurfaceError::RepeatedPoint { triangle: 9, .. }), "{error}");
    let error = edit(&|s| s.points[20] = s.points[21]);
    assert!(matches!(error, SurfaceError::CoincidentPoints { first: 20, second: 21, .. }), "{error}");
    let error = edit(&|s| s.points[0] = [0.0; 3].map(|_| 400.0));
    assert!(matches!(error, SurfaceError::Units { .. }) && error.to_string().contains("unit mm"), "{error}");
    let error = edit(&|s| s.points.iter_mut().flatten().for_each(|x| *x *= 1e-3));
    assert!(matches!(error, SurfaceError::Units { size } if (size - 2e-4).abs() < 1e-9), "{error}");
    let error = edit(&|s| {
        let [a, b, c] = s.triangles[3].map(|p| p as usize);
        let line = [0.0, 1.0, 2.0].map(|x| [0.0078125, 0.015625, 0.00390625].map(|d| x * d));
        (s.points[a], s.points[b], s.points[c]) = (line[0], line[1], line[2]);
    });
    assert!(matches!(error, SurfaceError::NoArea { triangle: 3, .. }), "{error}");
    let error = edit(&|s| {
        s.triangles.remove(17);
    });
    assert!(matches!(error, SurfaceError::Open { count: 3, .. }), "{error}");
    let error = edit(&|s| {
        let [a, b, _] = s.triangles[17];
        s.points.push([0.2, 0.2, 0.2]);
        s.triangles.push([a, b, s.points.len() as u32 - 1]);
    });
    assert!(
        matches!(&error, SurfaceError::CrowdedEdge { triangles, .. } if triangles.contains(&17)),
        "{error}"
    );
    let error = edit(&|s| s.triangles[30].swap(0, 1));
    assert!(
        matches!(error, SurfaceError::MixedOrientation { first, second, .. } if first == 30 || second == 30),
        "{error}"
    );
    let error = edit(&|s| s.triangles.iter_mut().for_each(|t| t.swap(0, 1)));
    assert!(matches!(error, SurfaceError::InsideOut { volume, .. } if volume < 0.0), "{error}");
    let two = together(good(), &sphere(0.05, [0.3, 0.0, 0.0], 1));
    let error = refused(&two);
    assert!(
        matches!(error, SurfaceError::SeveralComponents { count: 2, triangle: 128, n_triangles: 32, .. }),
        "{error}"
    );
    // Two balls that have one point in common.
    let mut pinched = together(good(), &sphere(0.1, [0.2, 0.0, 0.0], 2));
    let (east, west) = (0, 66 + 1);
    pinched.triangles.iter_mut().flatten().for_each(|p| *p = if *p == west { east } else { *p });
    pinched.points[west as usize] = [0.0, 0.0, 0.5]; // no longer used
    let error = refused(&pinched);
    assert!(matches!(error, SurfaceError::PinchedPoint { point: 0, .. }), "{error}");
    let error = edit(&|s| s.points[0] = [-0.2, 0.013, 0.007]);
    assert!(matches!(error, SurfaceError::SelfIntersection { count, .. } if count > 0), "{error}");
}

#[test]
fn no_random_damage_makes_a_check_panic() {
    let mut random = Random::new(21);
    for _ in 0..3_000 {
        let mut surface = sphere(0.1, [0.0; 3], 1);
        for _ in 0..1 + random.bits() % 3 {
            let t = random.bits() as usize % surface.triangles.len();
            let p = random.bits() as usize % surface.points.len();
            match random.bits() % 5 {
                0 => surface.triangles[t][0] = random.bits() as u32 % 20,
                1 => surface.points[p] = [f64::MAX, -f64::MAX, 1e-310],
                2 => surface.points[p] = surface.points[0],
                3 => drop(surface.triangles.swap_remove(t)),
                _ => surface.triangles.push(surface.triangles[t]),
            }
        }
        let _ = surface.check(); // sound or refused, but it ends
    }
}

// ------------------------------------------------------------------------------------------------ anatomy

#[test]
fn surfaces_of_a_leg_are_sound_and_do_not_meet() {
    let Some(folder) = shared("anatomy") else { return };
    let read = |name: &str| {
        let file = folder.join(format!("{name}.stl"));
        Surface::read_checked(&file, LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"))
    };
    // Volumes of the published tables [cm³].
    let table = [
        ("muscles_fit/rectus_femoris_r", 334.2),
        ("muscles_fit/vastus_lateralis_r", 487.7),
        ("muscles_fit/vastus_intermedius_r", 235.2),
        ("muscles_fit/gluteus_minimus_r", 97.9),
        ("muscles_fit/sartorius_r", 66.1),
        ("bones/femur_r", 500.5),
    ];
    let surfaces: Vec<SearchSurface> = table
        .iter()
        .map(|(name, volume)| {
            let surface = read(name);
            let found = surface.volume() * 1e6;
            assert!((found - volume).abs() < 0.2, "{name}: {found:.2} cm³, published {volume}");
            SearchSurface::new(surface)
        })
        .collect();
    for (i, a) in surfaces.iter().enumerate() {
        for (b, (name, _)) in surfaces[..i].iter().zip(&table) {
            let gap = a.least_gap(b).expect("triangles");
            assert!(gap.closest.distance > 0.0, "{} meets {name}", table[i].0);
            assert!(a.intersections(b).is_empty());
        }
    }
}

/// Which surfaces are closed and cross themselves is published with them, found by other means.
#[test]
fn faults_of_published_surfaces_are_found() {
    let Some(folder) = shared("anatomy") else { return };
    let check = |name: &str| {
        let file = folder.join(format!("{name}.stl"));
        Surface::read_checked(&file, LengthUnit::Metre).map_err(|e| match e {
            SurfaceError::InFile { reason, .. } => *reason,
            other => panic!("{name}: {other}"),
        })
    };
    for name in [
        "gracilis",
        "sartorius",
        "gluteus_maximus",
        "biceps_femoris_short_head",
        "obturator_internus",
        "tibialis_posterior",
    ] {
        let found = check(&format!("muscles/{name}_r"));
        assert!(matches!(found, Err(SurfaceError::SelfIntersection { .. })), "{name}: {found:?}");
    }
    for name in [
        "rectus_femoris",
        "adductor_magnus",
        "vastus_lateralis",
        "iliotibial_tract",
        "plantaris",
        "adductor_minimus",
    ] {
        check(&format!("muscles/{name}_r")).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    for (name, border) in [
        ("femoral_cartilage_r", 574),
        ("femoral_subchondral_r", 443),
        ("patellar_cartilage_r", 166),
        ("tibial_cartilage_medial_r", 156),
    ] {
        let found = check(&format!("knee/{name}"));
        assert!(
            matches!(found, Err(SurfaceError::Open { count, .. }) if count == border),
            "{name}: {found:?}"
        );
    }
}
