//! Softened contact, the way to a first guess: what it finds inside bodies, and where it pushes.

use super::scenes::{SAMPLED_DIFFERENTLY, contact_of};
use fem::contact::Contact;
use fem::geometry::SearchSurface;
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::scene::*;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_4, PI};
use support::contact_scenes::*;
use support::fem_scenes::{held, plan};
use support::{Random, taylor_order};

/// Two blocks 1.5 mm apart in so many cells, in contact, and the first node of the upper one.
fn blocks(n: [[usize; 3]; 2]) -> (Plan, usize) {
    let spec = ContactSpec { distance: 1e-3, ..ContactSpec::new(&["lower_block", "upper_block"]) };
    let (scene, mesh) = two_blocks(n, 1.5e-3, spec);
    (plan(&scene, &mesh), n[0].iter().map(|n| n + 1).product())
}

/// Softened contact pushes a block out of the one that it is in, harder the deeper it is.
#[test]
fn softened_contact_pushes_out() {
    let (plan, first) = blocks([[4, 4, 2], [5, 5, 2]]);
    let contact = contact_of(&plan);
    let upward = |closer: f64| -> f64 {
        let mut x = plan.reference();
        for n in first..plan.mesh.points.len() {
            // Aside, so that no sides are flush.
            (x[3 * n], x[3 * n + 1], x[3 * n + 2]) =
                (x[3 * n] + 3.1e-3, x[3 * n + 1] + 2.3e-3, x[3 * n + 2] - closer);
        }
        let mut g = vec![0.0; x.len()];
        contact.add_gradient(&x, 0.3, &mut g);
        -(first..plan.mesh.points.len()).map(|n| g[3 * n + 2]).sum::<f64>()
    };
    let forces = [1.0e-3, 1.4e-3, 1.6e-3, 2.5e-3, 3.5e-3].map(upward);
    println!("{forces:?} N");
    assert!(forces[0] > 0.0 && forces.windows(2).all(|f| f[1] > f[0]), "{forces:?}");
}

/// Where nothing is ahead a softened step ends where a point has gone so far beside what any point of the other surface does, along every axis,
/// as a step may be long.
#[test]
fn a_softened_step_is_as_long_as_points_may_go_beside_another_surface() {
    let (plan, first) = blocks([[4, 4, 2], [5, 5, 2]]);
    let contact = contact_of(&plan);
    let (start, longest) = (plan.reference(), contact.longest_soft_step());
    let mut random = Random::new(13);
    for noise in [0.0, 5e-3] {
        for round in 0..10 {
            let away = [0.05 * random.uniform(), 0.05 * random.uniform(), 0.05];
            let mut to = start.clone();
            for n in 0..to.len() / 3 {
                let by = if n < first { [0.0; 3] } else { away };
                (0..3).for_each(|c| to[3 * n + c] += by[c] + noise * random.uniform());
            }
            let [before, after] = [&start, &to].map(|x| contact.surfaces.positions(x));
            let u: Vec<_> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
            let [mine, theirs] = [0, 1].map(|s| &u[contact.surfaces.list[s].samples.clone()]);
            let beside = |u: &Vector3<f64>, of: &[Vector3<f64>]| {
                let along = |c: usize| of.iter().map(|v| (u[c] - v[c]).abs()).fold(0.0, f64::max);
                Vector3::new(along(0), along(1), along(2)).norm()
            };
            let farthest = |of: &[Vector3<f64>], all: &[Vector3<f64>]| {
                of.iter().map(|u| beside(u, all)).fold(0.0, f64::max)
            };
            let wanted = longest / farthest(mine, theirs).max(farthest(theirs, mine));
            let fraction = contact.soft_step(&start, &to, 0.3);
            assert!(
                wanted < 0.5 && (fraction / wanted - 1.0).abs() < 1e-12,
                "{round}: {fraction} for {wanted}"
            );
        }
    }
}

/// What was deep inside, deeper than is looked, is still inside when it comes closer to the surface again.
#[test]
fn softened_contact_finds_what_comes_back_from_deep_inside() {
    let lowered = |(plan, first): &(Plan, usize), by: f64| {
        let mut x = plan.reference();
        for n in *first..plan.mesh.points.len() {
            (x[3 * n], x[3 * n + 1], x[3 * n + 2]) =
                (x[3 * n] + 3.1e-3, x[3 * n + 1] + 2.3e-3, x[3 * n + 2] - by);
        }
        x
    };
    for softness in SAMPLED_DIFFERENTLY {
        // Energies where the upper block is lowered by one way after the other.
        let energies = |ways: &[f64]| -> Vec<f64> {
            let blocks = blocks([[16, 16, 8], [13, 13, 6]]);
            let contact = contact_of(&blocks.0);
            ways.iter().map(|&by| contact.energy(&lowered(&blocks, by), softness)).collect()
        };
        let there = energies(&[3.5e-3])[0];
        let and_back = energies(&[5.7e-3, 3.5e-3])[1];
        assert!(there > 0.0 && and_back == there, "{and_back} J, at once {there} J");
    }
}

/// A search remembers what earlier ones have found, of other samples too: after any history it finds what one without a history finds,
/// to the last bit.
#[test]
fn what_was_found_before_changes_nothing() {
    let n = [[6, 6, 3], [5, 5, 2]];
    let (remembers, first) = blocks(n);
    let mut random = Random::new(11);
    let (mut way, mut touching) = ([3.1e-3, 2.3e-3, -1e-3], 0);
    for round in 0..40 {
        let mut x = remembers.reference();
        for n in first..remembers.mesh.points.len() {
            (0..3).for_each(|c| x[3 * n + c] += way[c] + 2e-4 * random.uniform());
        }
        let softness = SAMPLED_DIFFERENTLY[usize::from(round % 8 > 2)];
        let fresh = contact_of(&blocks(n).0).energy(&x, softness);
        assert_eq!(
            contact_of(&remembers).energy(&x, softness),
            fresh,
            "round {round}, softness {softness}, {way:?}"
        );
        touching += usize::from(fresh > 0.0);
        // Mostly small steps up and down, at times a long one.
        let step = if round % 7 == 6 { 8e-3 } else { 8e-4 };
        (0..3).for_each(|c| way[c] += step * random.uniform());
        way[2] = way[2].clamp(-6e-3, -1e-3);
    }
    assert!(touching >= 20, "in touch in {touching} of 40 rounds");
}

/// No sample that is inside a block, or nearly so, is missed, wherever the corners around it are.
#[test]
fn every_sample_inside_a_block_is_found() {
    let (plan, first) = blocks([[3, 3, 2], [5, 5, 2]]);
    let contact = contact_of(&plan);
    let mut random = Random::new(12);
    let (mut n_inside, mut n_without_corners) = (0, 0);
    for round in 0..20 {
        let way = [8e-3 * random.uniform(), 8e-3 * random.uniform(), -4e-3 + 2e-3 * random.uniform()];
        let mut x = plan.reference();
        for n in first..plan.mesh.points.len() {
            (0..3).for_each(|c| x[3 * n + c] += way[c]);
        }
        let all = &contact.surfaces;
        let p = all.positions(&x);
        let mut wanted = 0;
        for (mine, other) in [(0, 1), (1, 0)] {
            let its = || all.list[other].samples.clone().map(|i| p[i]);
            let (lo, hi) = (its().reduce(|a, b| a.inf(&b)).unwrap(), its().reduce(|a, b| a.sup(&b)).unwrap());
            let is_inside = |i: usize| (0..3).all(|c| lo[c] < p[i][c] && p[i][c] < hi[c]);
            for i in all.list[mine].samples.clone().filter(|&i| is_inside(i)) {
                n_inside += 1;
                n_without_corners += usize::from(!all.corners_of[i].iter().any(|&c| is_inside(c as usize)));
                // Every point brings its nodes and those of a quarter of a face: two of its nodes, and all four for the middle.
                wanted += all.points[i].n + 6;
            }
        }
        assert_eq!(contact.close_pairs(&x, 0.0, &|_| true).len(), wanted, "round {round}");
    }
    println!("{n_inside} samples inside, {n_without_corners} of them beside corners that are outside");
    assert!(n_without_corners >= 10, "{n_without_corners}");
}

/// A plate of 2 mm and above it a block, in contact, and the first node of the block.
fn plate_and_block() -> (Plan, usize) {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let law = LawSpec::NeoHookean { young: 20e3, nu: 0.3 };
    for (name, n, size, shift) in [
        ("plate", [12, 12, 1], [0.04, 0.04, 0.002], [0.0; 3]),
        ("block", [4, 4, 2], [0.02, 0.02, 0.012], [0.0113, 0.0107, 0.003]),
    ] {
        add(&mut scene, &mut mesh, name, generate::block(n, size), shift, law.clone());
        scene.prescribed.push(held(&format!("{name}_x_min"), [true; 3]));
    }
    scene.contact = Some(ContactSpec { distance: 1e-3, ..ContactSpec::new(&["plate_block", "block_block"]) });
    (plan(&scene, &mesh), 13 * 13 * 2)
}

/// The block of [`plate_and_block`] with its bottom at the height `bottom` \[m\], raised by an angle about the edge of it along y.
fn lowered_block(plan: &Plan, first: usize, bottom: f64, angle: f64) -> Vec<f64> {
    let mut x = plan.reference();
    let edge = Vector3::new(0.0113, 0.0, bottom);
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), -angle);
    for place in x.as_chunks_mut::<3>().0.iter_mut().skip(first) {
        let moved = Vector3::new(place[0], place[1], place[2] + bottom - 0.003);
        *place = (edge + turn * (moved - edge)).into();
    }
    x
}

/// Past the middle of a thin plate, as far as four fifths of it, softened contact still pushes a block back to the side that it came from,
/// and farther on out at the other; a thin plate deep inside a block leaves by the side that is nearest.
#[test]
fn softened_contact_finds_the_way_back_through_thin_bodies() {
    let (plan, first) = plate_and_block();
    let contact = contact_of(&plan);
    let upward = |bottom: f64, softness: f64| -> f64 {
        let x = lowered_block(&plan, first, bottom, 0.0);
        let mut g = vec![0.0; x.len()];
        contact.add_gradient(&x, softness, &mut g);
        -g.iter().skip(3 * first + 2).step_by(3).sum::<f64>()
    };
    let ascending = |f: &[f64]| f.windows(2).all(|f| f[1] > f[0]);
    for softness in SAMPLED_DIFFERENTLY {
        let into_plate = [1.7e-3, 1.4e-3, 0.8e-3, 0.5e-3].map(|bottom| upward(bottom, softness));
        let nearly_through = upward(0.2e-3, softness);
        println!(
            "the block's bottom inside the plate: {into_plate:?} N, nearly through it: {nearly_through} N"
        );
        assert!(into_plate[0] > 0.0 && ascending(&into_plate), "{into_plate:?}");
        assert!(nearly_through < 0.0, "{nearly_through}");
        // The top of the block 1 to 2.5 mm above the plate, which is inside.
        let around_plate = [1.0e-3, 1.5e-3, 2.5e-3].map(|above| -upward(0.002 + above - 0.012, softness));
        println!("the plate inside the block: {around_plate:?} N");
        assert!(around_plate.iter().all(|f| *f > 0.0), "{around_plate:?}");
    }
}

/// The largest change of the energy \[J\] of softened contact from one to the next of `n` places along a way.
fn largest_change(contact: &Contact, softness: f64, n: usize, way: impl Fn(f64) -> Vec<f64>) -> f64 {
    let energy = |k: usize| contact.energy(&way(k as f64 / n as f64), softness);
    let energies: Vec<f64> = (0..=n).map(energy).collect();
    energies.windows(2).map(|e| (e[1] - e[0]).abs()).fold(0.0, f64::max)
}

/// As a block goes through a thin plate and out at its far side the energy has no jump: eight times as many places along the way lie nearly
/// eight times closer in energy. And where points count as deeper than they are, since the side that is nearest faces their way, the
/// force is its derivative.
#[test]
fn softened_contact_has_an_energy_without_jumps_through_a_thin_plate() {
    let (plan, first) = plate_and_block();
    for softness in SAMPLED_DIFFERENTLY {
        let contact = contact_of(&plan).anew();
        let down = |t: f64| lowered_block(&plan, first, 2.9e-3 - 3.3e-3 * t, 0.017);
        let changes = [100, 800].map(|n| largest_change(&contact, softness, n, down));
        println!("softness {softness}: {changes:?} J");
        assert!(6.0 * changes[1] < changes[0], "softness {softness}: a jump of {:.1e} J", changes[1]);
        for bottom in [0.1e-3, 0.2e-3, 0.3e-3] {
            let x = |h: f64| lowered_block(&plan, first, bottom + h, 0.017);
            let mut g = vec![0.0; 3 * plan.mesh.points.len()];
            contact.add_gradient(&x(0.0), softness, &mut g);
            let slope = g.iter().skip(3 * first + 2).step_by(3).sum::<f64>();
            let order = taylor_order(|h| contact.energy(&x(h), softness), slope, 1e-7);
            assert!(order > 1.9, "softness {softness}, bottom at {bottom} m: order {order}");
        }
    }
}

/// As a block turns inside a plate until its bottom faces no longer the way of the plate's, its way out changes. While normals are held
/// it does not.
#[test]
fn held_normals_leave_one_energy_along_a_step() {
    let (plan, first) = plate_and_block();
    let softness = SAMPLED_DIFFERENTLY[1];
    let contact = contact_of(&plan).anew();
    let turned = |t: f64| lowered_block(&plan, first, 0.3e-3, 0.5 + 0.6 * t);
    let of_the_moment = [400, 3200].map(|n| largest_change(&contact, softness, n, turned));
    contact.hold_normals(&turned(0.0));
    let held = [400, 3200].map(|n| largest_change(&contact, softness, n, turned));
    contact.release_normals();
    let released = largest_change(&contact, softness, 3200, turned);
    println!("of the moment {of_the_moment:?} J, held {held:?} J");
    assert!(2.0 * of_the_moment[1] > of_the_moment[0], "no jump in this case: {of_the_moment:?} J");
    assert!(6.0 * held[1] < held[0], "a jump with held normals: {held:?} J");
    assert_eq!(released, of_the_moment[1]);
}

/// A face that folds over takes nobody in who is on its other side and has hardly moved; a trial that goes far in between does not change that.
#[test]
fn a_folded_face_takes_nobody_in_who_has_not_moved() {
    let (plan, first) = blocks([[4, 4, 2], [5, 5, 2]]);
    let contact = contact_of(&plan);
    let lower = &plan.mesh.points[..first];
    let height = lower.iter().map(|p| p[2]).fold(0.0, f64::max);
    let top: Vec<usize> = (0..first).filter(|&n| lower[n][2] > height - 1e-9).collect();
    assert_eq!(top.len(), 5 * 5);
    for softness in SAMPLED_DIFFERENTLY {
        // A node of the top, raised by less than leaves the blocks out of reach, goes over its neighbours in strides of half a millimetre.
        for &n in &top {
            for along in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
                for goes_far in [false, true] {
                    let contact = contact.anew();
                    let mut x = plan.reference();
                    assert_eq!(contact.energy(&x, softness), 0.0, "apart at the start");
                    x[3 * n + 2] += 0.3e-3;
                    for stride in 0..20 {
                        let energy = contact.energy(&x, softness);
                        assert_eq!(
                            energy, 0.0,
                            "node {n} after {stride} strides along {along:?}, far in between: {goes_far}"
                        );
                        if goes_far {
                            contact.arrive();
                            let mut far = x.clone();
                            (0..first).for_each(|n| far[3 * n + 2] -= 30e-3);
                            assert_eq!(contact.energy(&far, softness), 0.0, "apart when far");
                        }
                        (0..2).for_each(|c| x[3 * n + c] += 0.5e-3 * along[c]);
                    }
                }
            }
        }
    }
}

/// Two blocks, a ridge of each across one of the other and through it at any angle, are parted, though hardly a point of either is inside
/// the other; and no node goes far.
#[test]
fn ridges_that_cross_are_parted() {
    let without_points = part_ridges(1e-4, 1e-4, [2e-5, 2e-4]);
    assert!(without_points >= 20, "{without_points} of 60 are told by their edges alone");
}

/// So are ridges that cross a hundred times as deep as the gap that is wanted.
#[test]
fn ridges_that_cross_deeper_than_the_gap_are_parted() {
    part_ridges(3e-4, 9e-6, [6e-4, 9e-4]);
}

/// Parts 60 pairs of ridges that cross by a depth between two \[m\], by `gap` \[m\]; returns in how many no point is inside.
fn part_ridges(distance: f64, gap: f64, [least, most]: [f64; 2]) -> usize {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for name in ["lower", "upper"] {
        let law = LawSpec::NeoHookean { young: 20e3, nu: 0.3 };
        let z = if name == "upper" { 0.03 } else { 0.0 };
        add(&mut scene, &mut mesh, name, generate::block([4, 3, 3], [0.02, 0.01, 0.01]), [0.0, 0.0, z], law);
        scene.prescribed.push(held(&format!("{name}_x_min"), [true; 3]));
    }
    scene.contact = Some(ContactSpec { distance, ..ContactSpec::new(&["lower_block", "upper_block"]) });
    let plan = plan(&scene, &mesh);
    let contact = contact_of(&plan);
    let crossings = |x: &[f64]| {
        let [lower, upper] = [0, 1].map(|s| SearchSurface::new(contact.triangles(s, x)));
        lower.intersections(&upper).len()
    };
    let n = mesh.points.len() / 2;
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let mut random = Random::new(3);
    let (mut farthest, mut without_points) = (0.0_f64, 0);
    for round in 0..60 {
        let depth = random.between(least, most);
        let across = about(Vector3::z_axis(), random.between(0.3, 1.5));
        let mut x = plan.reference();
        for (of, block) in x.chunks_mut(3 * n).enumerate() {
            // The edge along x at the bottom becomes a ridge that points down; of the lower block up.
            let down = about(Vector3::x_axis(), FRAC_PI_4 + random.between(-0.3, 0.3));
            let middle = Vector3::new(random.between(0.006, 0.014), 0.0, [0.0, 0.03][of]);
            for place in block.as_chunks_mut::<3>().0 {
                let ridge = down * (Vector3::from(*place) - middle);
                let turned = match of {
                    0 => about(Vector3::x_axis(), PI) * ridge,
                    _ => across * ridge - Vector3::z() * depth,
                };
                *place = turned.into();
            }
        }
        assert!(crossings(&x) > 0, "round {round}: nothing crosses");
        without_points += usize::from(contact.close_pairs(&x, 0.0, &|_| true).is_empty());
        let moved = contact.untangle(&x, gap, &|_| true);
        let moved = moved.unwrap_or_else(|stuck| panic!("round {round}: still too close: {stuck:?}"));
        let parted: Vec<f64> = x.iter().zip(&moved).map(|(x, u)| x + u).collect();
        assert_eq!(crossings(&parted), 0, "round {round}");
        let most = moved.as_chunks::<3>().0.iter().map(|u| Vector3::from(*u).norm()).fold(0.0, f64::max);
        farthest = farthest.max(most / (depth + gap));
    }
    println!(
        "{without_points} of 60 without a point inside; a node goes {farthest:.2} times the depth at most"
    );
    assert!(farthest < 4.0, "a node goes {farthest:.2} times the depth");
    without_points
}
