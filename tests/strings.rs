//! Strings that slide: do they go the shortest way over a rigid solid, with one tension from end to end, and press on it as they should?

#![allow(non_snake_case)]

use fem::effect::obstacle::{Layer, Obstacle, Sample};
use fem::effect::sling::{NODES, Pull, Slings};
use fem::effect::{Effect, State};
use fem::geometry::DistanceField;
use fem::material::line::{LineLaw, Strand};
use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::plan::sliding::{resting, strings};
use fem::plan::{LoadedIsland, Plan};
use fem::scene::Scene;
use fem::solve::Loading;
use nalgebra::Vector3;
use std::sync::Arc;
use support::Random;
use support::fem_scenes::{derivative_orders, held, solve, tolerance};

const RADIUS: f64 = 0.02;
const SPACING: f64 = 1e-3;
const TENSION: f64 = 100.0;
/// So stiff \[Pa/m\] that a string of 100 N sinks in by about a micrometre.
const HARD: Layer = Layer::Foundation { stiffness: 1e12 };
/// Area \[m²\] per node.
const AREA: f64 = 4e-5;

/// A round solid about the origin: a ball, or a rod along z.
#[derive(Clone, Copy, PartialEq)]
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
    fn shortest(self, a: Vector3<f64>, b: Vector3<f64>) -> f64 {
        let r = self.radius();
        let flat = |v: Vector3<f64>| if self == Round::Ball { v } else { Vector3::new(v.x, v.y, 0.0) };
        let [p, q] = [a, b].map(flat);
        let free = |v: Vector3<f64>| (v.norm_squared() - r * r).sqrt();
        let turn = p.angle(&q) - (r / p.norm()).acos() - (r / q.norm()).acos();
        let around = free(p) + free(q) + r * turn.max(0.0);
        around.hypot((a - b - flat(a - b)).norm())
    }
}

/// A string between two points with its nodes on an arc around the solid, and its plan.
fn strung(round: Round, [a, b]: [Vector3<f64>; 2], layer: Layer, pull: Pull) -> Plan {
    let mut mesh = Mesh::default();
    let nodes: [u32; NODES] = std::array::from_fn(|k| k as u32);
    for k in 0..NODES {
        let t = k as f64 / (NODES - 1) as f64;
        let straight = a + (b - a) * t;
        // Outside, at the distance of the ends.
        let out = straight.normalize() * (a.norm() * (1.0 - t) + b.norm() * t);
        mesh.points.push(if k == 0 { a } else if k == NODES - 1 { b } else { out }.into());
    }
    let pairs = nodes.windows(2).flatten().copied().collect();
    mesh.blocks.push(CellBlock { name: "string".into(), kind: CellKind::Line2, nodes: pairs });
    mesh.node_sets.insert("ends".into(), vec![0, NODES as u32 - 1]);
    let mut scene = Scene::default();
    scene.prescribed.push(held("ends", [true; 3]));
    let field = round.field();
    let own = |_: &Mesh, names: &mut fem::plan::Names| {
        names.control("tension");
        let inner: Vec<[u32; 1]> = nodes[1..NODES - 1].iter().map(|n| [*n]).collect();
        let samples = vec![vec![Sample { weights: [1.0], area: AREA }]; inner.len()];
        Ok(vec![
            strings("string", &[nodes], vec![pull]),
            resting("on the solid", &field, layer, &inner, samples),
        ])
    };
    Plan::with_terms(&scene, mesh, &own).unwrap_or_else(|e| panic!("{e}"))
}

/// Places of the nodes in equilibrium under a tension.
fn places(plan: &Plan) -> Vec<Vector3<f64>> {
    let frame = solve(plan, &[("tension", TENSION)], &tolerance(1e-10));
    frame.x.as_chunks::<3>().0.iter().map(|p| Vector3::from(*p)).collect()
}

const GIVEN: Pull = Pull::Tension(0, 1.0);

fn cases() -> Vec<(Round, [Vector3<f64>; 2])> {
    let ends = |a: [f64; 3], b: [f64; 3]| [a, b].map(Vector3::from);
    vec![
        (Round::Ball, ends([-0.03, 0.005, 0.0], [0.03, 0.008, 0.004])),
        (Round::Ball, ends([-0.021, 0.004, 0.01], [0.028, 0.001, -0.006])),
        (Round::Rod, ends([-0.03, 0.005, -0.02], [0.03, 0.008, 0.015])),
        (Round::Rod, ends([-0.025, 0.002, 0.0], [0.025, 0.002, 0.0])),
    ]
}

#[test]
fn a_string_goes_the_shortest_way_with_its_nodes_evenly_spread() {
    for (i, (round, ends)) in cases().into_iter().enumerate() {
        let at = places(&strung(round, ends, HARD, GIVEN));
        let segments: Vec<f64> = at.windows(2).map(|p| (p[1] - p[0]).norm()).collect();
        let (found, exact) = (segments.iter().sum::<f64>(), round.shortest(ends[0], ends[1]));
        // Of a turn by up to 2 rad in 12 segments chords leave out 1/24 of the square of a segment's turn: 0.12 %. Where the string leaves
        // the solid within a segment it cuts a corner of as much.
        assert!((found / exact - 1.0).abs() < 2.5e-3, "case {i}: {found} m, exact {exact} m");
        let mean = found / segments.len() as f64;
        let uneven = segments.iter().map(|s| (s / mean - 1.0).abs()).fold(0.0, f64::max);
        assert!(uneven < 0.02, "case {i}: segments differ by {uneven}");
    }
}

/// Without friction the tension is the same at both ends, the solid bears their sum, and a rod or ball no moment about its axis.
#[test]
fn a_frictionless_capstan_gives_back_the_tension_and_no_torque() {
    for (i, (round, ends)) in cases().into_iter().enumerate() {
        let at = places(&strung(round, ends, HARD, GIVEN));
        let x: Vec<f64> = at.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let nodes: [u32; NODES] = std::array::from_fn(|k| k as u32);
        let points: Vec<[f64; 3]> = at.iter().map(|p| (*p).into()).collect();
        let string = Slings::new("string", &points, &[nodes], vec![GIVEN]);
        let mut forces = vec![0.0; 3 * NODES];
        string.forces(&State { x: &x, controls: &[TENSION] }, 0, &mut forces);
        let of = |k: usize| -Vector3::from_column_slice(&forces[3 * k..3 * k + 3]);
        let (first, last) = (of(0), of(NODES - 1));
        for (force, chord) in [(first, at[1] - at[0]), (last, at[NODES - 2] - at[NODES - 1])] {
            assert!((force.norm() / TENSION - 1.0).abs() < 0.02, "case {i}: {} N", force.norm());
            assert!(force.normalize().dot(&chord.normalize()) > 1.0 - 1e-12, "case {i}");
        }
        assert!((first.norm() - last.norm()).abs() < 0.02 * TENSION, "case {i}");
        let inner: Vec<[u32; 1]> = nodes[1..NODES - 1].iter().map(|n| [*n]).collect();
        let samples = vec![vec![Sample { weights: [1.0], area: AREA }]; inner.len()];
        let pressed = Obstacle::new("solid", round.field(), HARD, &inner, samples).pressed(&x);
        // The string pulls its ends with `first` and `last`; what rests on the solid is pushed the other way.
        assert!((pressed.force - (first + last)).norm() < 1e-5 * TENSION, "case {i}: {}", pressed.force);
        let arm = if round == Round::Ball { pressed.moment.norm() } else { pressed.moment.z.abs() };
        assert!(arm < 1e-3 * TENSION * RADIUS, "case {i}: {arm} N m");
        assert!(pressed.force.norm() > 10.0, "case {i}: it lies on nothing");
    }
}

/// Where the way is free a string is a straight strand.
#[test]
fn beside_the_solid_a_string_is_straight_and_pulls_as_a_strand() {
    let ends = [[-0.03, 0.035, 0.01], [0.03, 0.03, -0.01]].map(Vector3::from);
    let law = Strand { stiffness: 5e3, toe: 0.03 };
    let whole = (ends[1] - ends[0]).norm();
    let slack = whole / 1.08;
    let at = places(&strung(Round::Ball, ends, HARD, Pull::Elastic(LineLaw::Strand(law), slack)));
    for (k, p) in at.iter().enumerate() {
        let straight = ends[0] + (ends[1] - ends[0]) * (k as f64 / (NODES - 1) as f64);
        assert!((p - straight).norm() < 1e-9, "node {k}: {}", (p - straight).norm());
    }
    let x: Vec<f64> = at.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    let nodes: [u32; NODES] = std::array::from_fn(|k| k as u32);
    let pull = Pull::Elastic(LineLaw::Strand(law), slack);
    let string = Slings::new("string", &[[0.0; 3]; NODES], &[nodes], vec![pull]);
    let (stretch, tension) = string.line_state(&State { x: &x, controls: &[0.0] }, 0).unwrap();
    assert!((stretch - 1.08).abs() < 1e-9 && (tension - 5e3 * 0.05).abs() < 0.01, "{stretch} {tension}");
}

#[test]
fn forces_and_stiffness_of_strings_and_of_what_they_lie_on_are_derivatives() {
    let law = Strand { stiffness: 5e3, toe: 0.03 };
    let elastic = Pull::Elastic(LineLaw::Strand(law), 0.06);
    let layers = [Layer::Foundation { stiffness: 4e9 }, Layer::Barrier { modulus: 2e7, distance: 2e-3 }];
    for (seed, (layer, pull)) in
        layers.into_iter().flat_map(|l| [GIVEN, elastic].map(|p| (l, p))).enumerate()
    {
        let (round, ends) = cases()[seed];
        let plan = strung(round, ends, layer, pull);
        let (island, load) = (plan.islands[0].clone(), plan.load(&[("tension", TENSION)], &[]).unwrap());
        let mut x = island.free_positions(&island.X);
        // Into the layer, all of it.
        let depth = if seed < 2 { -3e-4 } else { 1e-3 };
        for p in x.as_chunks_mut::<3>().0 {
            let place = Vector3::from(*p);
            let axis = if round == Round::Rod { Vector3::new(0.0, 0.0, place.z) } else { Vector3::zeros() };
            *p = (axis + (place - axis).normalize() * (RADIUS + depth)).into();
        }
        let mut potential = LoadedIsland::new(island, load.clone(), load);
        potential.set_load(1.0, &mut x);
        let mut random = Random::new(seed as u64);
        let mut direction = || (0..x.len()).map(|_| random.uniform()).collect::<Vec<f64>>();
        let (u, w) = (direction(), direction());
        let [of_energy, of_forces] = derivative_orders(&potential, &x, [&u, &w], 1e-4);
        assert!(of_energy > 1.9 && of_forces > 1.9, "{layer:?}, {pull:?}: {of_energy:.2} and {of_forces:.2}");
    }
}
