//! Softened contact, the way to a first guess: what it finds inside bodies, and where it pushes.

use super::scenes::{SAMPLED_DIFFERENTLY, contact_of};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::scene::*;
use nalgebra::Vector3;
use support::Random;
use support::contact_scenes::*;
use support::fem_scenes::{held, plan};

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

/// Past the middle of a thin plate softened contact still pushes a block back to the side that it came from; a thin plate deep inside a
/// block leaves by the side that is nearest.
#[test]
fn softened_contact_finds_the_way_back_through_thin_bodies() {
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
    let plan = plan(&scene, &mesh);
    let contact = contact_of(&plan);
    let first = 13 * 13 * 2; // of the block
    let upward = |bottom: f64, softness: f64| -> f64 {
        let mut x = plan.reference();
        x.iter_mut().skip(3 * first + 2).step_by(3).for_each(|z| *z += bottom - 0.003);
        let mut g = vec![0.0; x.len()];
        contact.add_gradient(&x, softness, &mut g);
        -g.iter().skip(3 * first + 2).step_by(3).sum::<f64>()
    };
    let ascending = |f: &[f64]| f.windows(2).all(|f| f[1] > f[0]);
    for softness in SAMPLED_DIFFERENTLY {
        let into_plate = [1.7e-3, 1.4e-3, 0.8e-3, 0.5e-3, 0.2e-3].map(|bottom| upward(bottom, softness));
        println!("the block's bottom inside the plate: {into_plate:?} N");
        assert!(into_plate[0] > 0.0 && ascending(&into_plate), "{into_plate:?}");
        // The top of the block 1 to 2.5 mm above the plate, which is inside.
        let around_plate = [1.0e-3, 1.5e-3, 2.5e-3].map(|above| -upward(0.002 + above - 0.012, softness));
        println!("the plate inside the block: {around_plate:?} N");
        // Corners alone are too few for more than the direction: some come out at the sides.
        let all_samples = softness == SAMPLED_DIFFERENTLY[1];
        let as_wanted =
            if all_samples { ascending(&around_plate) } else { around_plate.iter().all(|f| *f > 0.0) };
        assert!(around_plate[0] > 0.0 && as_wanted, "{around_plate:?}");
    }
}

/// A face that folds over takes nobody in who is on its other side and has hardly moved.
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
                let mut x = plan.reference();
                assert_eq!(contact.energy(&x, softness), 0.0, "apart at the start");
                x[3 * n + 2] += 0.3e-3;
                for stride in 0..20 {
                    let energy = contact.energy(&x, softness);
                    assert_eq!(energy, 0.0, "node {n} after {stride} strides along {along:?}");
                    (0..2).for_each(|c| x[3 * n + c] += 0.5e-3 * along[c]);
                }
            }
        }
    }
}
