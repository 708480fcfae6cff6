//! A term of a user's own, a spring between two nodes: is it one file, and does the solver balance it?

use fem::effect::{Effect, EffectKind, Groups, State};
use fem::mesh::generate;
use fem::plan::{Builder, LoadedIsland, Plan, Term};
use fem::scene::Scene;
use fem::solve::Loading;
use nalgebra::{Matrix3, Vector3};
use support::Random;
use support::fem_scenes::{derivative_orders, held, mooney_rivlin, solid, solve, tolerance};

/// k (l − l₀)² / 2 between two nodes.
struct Spring {
    groups: Groups,
    stiffness: f64,
    rest: f64,
}

impl Spring {
    /// Vector \[m\] from the first node to the second.
    fn span(&self, s: &State) -> Vector3<f64> {
        let place = |n: u32| Vector3::from_column_slice(&s.x[3 * n as usize..3 * n as usize + 3]);
        let [a, b] = *self.groups.nodes::<2>(0);
        place(b) - place(a)
    }
}

impl Effect for Spring {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        0.5 * self.stiffness * (self.span(s).norm() - self.rest).powi(2)
    }

    fn forces(&self, s: &State, _first: usize, out: &mut [f64]) {
        let d = self.span(s);
        let f = d * (self.stiffness * (1.0 - self.rest / d.norm()));
        (0..3).for_each(|c| (out[c], out[3 + c]) = (-f[c], f[c]));
    }

    fn stiffness(&self, s: &State, convexity: f64, _first: usize, out: &mut [f64]) {
        let (d, n) = (self.span(s), self.span(s).normalize());
        let across = self.stiffness * (1.0 - self.rest / d.norm());
        let across = across - convexity * across.min(0.0);
        let k = n * n.transpose() * (self.stiffness - across) + Matrix3::identity() * across;
        for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
            out[6 * i + j] = if (i < 3) == (j < 3) { k[(i % 3, j % 3)] } else { -k[(i % 3, j % 3)] };
        }
    }
}

/// A block of muscle matrix, 20 mm, held at x = 0, with a spring from corner to corner that is 5 mm too short.
fn sprung(stiffness: f64) -> (Plan, [u32; 2], f64) {
    let mesh = generate::block([2, 2, 2], [0.02; 3]);
    let ends = [0, mesh.points.len() as u32 - 1];
    let [a, b] = ends.map(|n| Vector3::from(mesh.points[n as usize]));
    let rest = (b - a).norm() - 5e-3;
    let spring = move |name: &str, nodes: &[u32]| {
        let groups = Groups::new(name, EffectKind::Fibre, &[[nodes[0], nodes[1]]], vec![[0.01; 3]]);
        Box::new(Spring { groups, stiffness, rest }) as Box<dyn Effect>
    };
    let mut scene = Scene::default();
    scene.solids.push(solid("block", mooney_rivlin(), None));
    scene.prescribed.push(held("x_min", [true; 3]));
    let own = move || {
        let build: Builder = Box::new(move |name, _, nodes, _| Ok(spring(name, nodes)));
        Term { name: "spring".into(), nodes_per_group: 2, nodes: ends.to_vec(), couples: true, build }
    };
    (Plan::with_terms(&scene, mesh, &|_, _| Ok(vec![own()])).unwrap(), ends, rest)
}

#[test]
fn a_stiff_spring_pulls_the_corner_to_its_length_and_a_soft_one_by_its_force() {
    let length = |stiffness: f64| {
        let (plan, ends, rest) = sprung(stiffness);
        let frame = solve(&plan, &[], &tolerance(1e-8));
        let place = |n: u32| Vector3::from_column_slice(&frame.x[3 * n as usize..3 * n as usize + 3]);
        (place(ends[1]) - place(ends[0])).norm() - rest
    };
    // What is left of 5 mm falls as one over the stiffness: the force of the block is the same.
    let (soft, stiff, stiffer) = (length(0.1), length(1e6), length(1e7));
    assert!((4e-3..5e-3).contains(&soft), "{soft} m left");
    assert!(
        (1e-8..1e-5).contains(&stiff) && (stiff / stiffer / 10.0 - 1.0).abs() < 1e-3,
        "{stiff}, {stiffer}"
    );
}

#[test]
fn its_forces_and_stiffness_are_derivatives_of_its_energy() {
    let (plan, ..) = sprung(1e3);
    let (island, load) = (plan.islands[0].clone(), plan.load(&[], &[]).unwrap());
    let mut potential = LoadedIsland::new(island.clone(), load.clone(), load);
    let mut x = island.free_positions(&island.X);
    potential.set_load(1.0, &mut x);
    let mut random = Random::new(3);
    let mut direction = || (0..x.len()).map(|_| random.uniform()).collect::<Vec<f64>>();
    let (u, w) = (direction(), direction());
    let [of_energy, of_forces] = derivative_orders(&potential, &x, [&u, &w], 1e-3);
    assert!(of_energy > 1.9 && of_forces > 1.9, "orders {of_energy:.2} and {of_forces:.2}");
}
