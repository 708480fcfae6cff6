//! Solids embedded in coarse grids: are they what their mesh would be in fewer unknowns, whatever the grid?

#![allow(non_snake_case)]

use fem::effect::EffectKind;
use fem::measure::{Cut, section_force, solid_field};
use fem::mesh::{Mesh, generate};
use fem::plan::{LoadedIsland, Plan};
use fem::scene::{DilatationSpec, EmbeddedSpec, ForceSpec, FormulationSpec, LawSpec, Scene, StrandSpec};
use fem::solve::{BlockMatrix, Galerkin, Loading, Pattern, Potential};
use nalgebra::{DMatrix, DVector, Vector3};
use std::sync::Arc;
use support::Random;
use support::fem_scenes::{
    derivative_orders, displaced, distorted_box, held, laws, mooney_rivlin, plan, solve, tolerance,
};
use support::grid_cases::{apart, embedded, linear, scene_of};

/// Nodes of a held face and linear displacements on the whole boundary of a distorted box, most elements beside held nodes, in grids that fit it
/// nowhere: all nodes and the stress are those of the linear field.
#[test]
fn a_linear_field_is_held_whatever_the_grid() {
    let mesh = distorted_box(6);
    for (name, law) in laws() {
        let small = matches!(law, LawSpec::LinearElastic { .. });
        let field = |X: [f64; 3]| linear(X).map(|u| if small { 0.1 * u } else { u });
        for cell in [1.0, 0.61, 0.37] {
            let mut scene = embedded(&scene_of(&mesh, law.clone(), None), "block", cell);
            scene.prescribed.push(displaced(&mesh, "boundary", field));
            let plan = plan(&scene, &mesh);
            let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-12));
            let exact: Vec<f64> = mesh
                .points
                .iter()
                .flat_map(|&X| std::array::from_fn::<_, 3, _>(|c| X[c] + field(X)[c]))
                .collect();
            let off = apart(&mesh, &frame.x, &exact);
            let cells = solid_field(&plan, frame.snapshot(), "block").expect("a solid");
            assert_eq!(cells.len(), mesh.blocks[0].n_cells());
            let scale = cells[0].cauchy.amax();
            let spread =
                cells.iter().map(|c| (c.cauchy - cells[0].cauchy).amax()).fold(0.0, f64::max) / scale;
            println!("{name}, cubes of {cell}: off by {off:.1e} m, stress {spread:.1e}");
            assert!(off < 1e-9, "{name}, cubes of {cell} m: off the linear field by {off:.1e} m");
            assert!(spread < 1e-8, "{name}, cubes of {cell} m: stress differs by {spread:.1e}");
        }
    }
}

/// An island of a distorted box, half of it held at random nodes, in a grid that fits it nowhere; its unknowns are moved at random.
fn island(
    law: LawSpec,
    formulation: Option<FormulationSpec>,
    cell: f64,
) -> (LoadedIsland<'static>, Vec<f64>) {
    let mut mesh = distorted_box(4);
    let mut random = Random::new(3);
    let some = (0..mesh.points.len() as u32).filter(|_| random.chance(0.3)).collect();
    mesh.node_sets.insert("some".to_string(), some);
    let mut scene = embedded(&scene_of(&mesh, law, formulation), "block", cell);
    scene.solids[0].scale = (0..64).map(|_| random.between(0.5, 2.0)).collect();
    // Fibres are stretched by 1.15 to 1.25: Blemker's law has kinks at 1.1 and 1.54, where its stiffness jumps.
    scene.prescribed.push(displaced(&mesh, "some", |X| X.map(|x| 0.2 * x)));
    let plan = plan(&scene, &mesh);
    assert_eq!(plan.islands.len(), 1);
    let load = plan.load(&[("load", 1.0)], &[]).unwrap();
    let mut loaded = LoadedIsland::new(plan.islands[0].clone(), load.clone(), load);
    let island = loaded.island().clone();
    let mut x = island.free_positions(&island.gather(&plan.reference()));
    loaded.set_load(1.0, &mut x);
    x.iter_mut().for_each(|x| *x = 1.2 * *x + 0.003 * random.uniform());
    (loaded, x)
}

#[test]
fn forces_and_stiffness_are_the_derivatives_of_the_energy() {
    for (name, law) in laws() {
        for formulation in [None, Some(FormulationSpec::Plain)] {
            let (island, x) = island(law.clone(), formulation, 0.5);
            assert!(island.energy(&x).is_finite());
            let mut random = Random::new(11);
            let mut direction = || (0..x.len()).map(|_| random.uniform()).collect::<Vec<f64>>();
            let (u, w) = (direction(), direction());
            let orders = derivative_orders(&island, &x, [&u, &w], 1e-3);
            println!("{name}, {formulation:?}: orders {orders:.2?}");
            assert!(orders.iter().all(|o| *o > 1.8), "{name}, {formulation:?}: orders {orders:?}");
        }
    }
}

/// A bar that is bent, of nearly incompressible tissue.
fn bar(n: [usize; 3]) -> (Mesh, Scene) {
    let mesh = generate::block(n, [0.12, 0.04, 0.04]);
    let mut scene = scene_of(&mesh, mooney_rivlin(), None);
    let bent = |X: [f64; 3]| [-0.01, 0.03, 0.1 * (X[1] - 0.02)];
    scene.prescribed = vec![held("x_min", [true; 3]), displaced(&mesh, "x_max", bent)];
    (mesh, scene)
}

/// One dilatation per element: the finer the cubes, the softer the bar, and none softer than its mesh, as every grid halved holds the one before.
/// One per cube: nearer to the mesh everywhere, though it is no bound, as means of volumes are fewer in larger cubes; the largest have three.
#[test]
fn finer_grids_come_down_to_the_mesh_and_one_dilatation_per_element_locks() {
    let (mesh, scene) = bar([24, 8, 8]);
    let energy = |scene: &Scene| {
        let plan = plan(scene, &mesh);
        let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-9));
        (frame.islands[0].energy, plan.n_unknowns(), frame.islands[0].iterations)
    };
    let exact = energy(&scene);
    const CELLS: [f64; 4] = [0.04, 0.02, 0.01, 0.005];
    let mut all = Vec::new();
    for cell in CELLS {
        let mut both = [DilatationSpec::Cube, DilatationSpec::Element].map(|dilatation| {
            let mut scene = embedded(&scene, "block", cell);
            scene.embedded[0].dilatation = dilatation;
            energy(&scene)
        });
        println!("cubes of {cell} m: {both:?}, the mesh {exact:?}");
        let [cube, element] = both.each_mut().map(|of| of.0 / exact.0);
        all.push([cube, element]);
    }
    let mut last = [f64::INFINITY; 2];
    for (&cell, &[cube, element]) in CELLS.iter().zip(&all) {
        assert!(element < last[1], "cubes of {cell} m: {cube} and {element} after {last:?}");
        assert!(cell == 0.02 || cube < last[0], "cubes of {cell} m: {cube} and {element} after {last:?}");
        assert!(element > 1.0 - 1e-9 && (cube - 1.0).abs() < 0.15);
        last = [cube, element];
        match cell {
            0.005 => assert!((cube - 1.0).abs() < 1e-9 && (element - 1.0).abs() < 1e-9),
            _ => assert!(element - 1.0 > 3.0 * (cube - 1.0).abs()),
        }
    }
}

/// What acts on the mesh acts on its nodes: forces on nodes go through every section, partly along strands between nodes.
#[test]
fn forces_on_embedded_nodes_reach_the_support() {
    let mut mesh = generate::block([8, 4, 4], [0.08, 0.04, 0.04]);
    generate::add_fibres(&mut mesh, "strands", [8, 4, 4], &[[1, 1], [2, 2], [3, 1]]);
    let mut scene = embedded(&scene_of(&mesh, mooney_rivlin(), None), "block", 0.02);
    let (stiffness, toe, reference_strain) = (1.0, 0.01, 0.02);
    scene.strands.push(StrandSpec { region: "strands".to_string(), stiffness, toe, reference_strain });
    scene.prescribed = vec![held("x_min", [true; 3])];
    let loads = mesh.node_sets["x_max"].iter().map(|&n| (n, [2e-3, 1e-3, 0.0])).collect();
    scene.forces.push(ForceSpec { name: "pull".to_string(), loads, control: "load".to_string() });
    let plan = plan(&scene, &mesh);
    let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-10));
    for at in [0.013, 0.041, 0.062] {
        let cut = Cut { point: [at, 0.0, 0.0], normal: [1.0, 0.0, 0.0], effects: vec![] };
        let section = section_force(&plan, frame.snapshot(), &cut);
        let force = section.total.force;
        assert!(section.along_of(EffectKind::Fibre, cut.normal) > 0.01);
        println!("through x = {at} m: {force:?} N");
        let off = (Vector3::from(force) - Vector3::new(0.05, 0.025, 0.0)).norm();
        assert!(off < 1e-8, "through x = {at} m: {force:?} N, applied 0.05, 0.025 N");
    }
}

#[test]
fn what_cannot_be_embedded_is_refused_with_its_remedy() {
    let mesh = generate::block([8, 4, 4], [0.08, 0.04, 0.04]);
    let cases: &[(&str, f64, &[&str])] = &[
        ("blokc", 0.02, &["embedded `blokc` names the solid `blokc`, which is missing; nearest: `block`"]),
        ("block", 0.0, &["embedded `block`: cell [m] is 0, must be positive"]),
        ("block", -0.01, &["cell [m] is -0.01, must be positive"]),
        ("block", f64::NAN, &["cell [m] is NaN, must be positive"]),
        ("block", f64::INFINITY, &["cell [m] is inf, must be positive"]),
        (
            "block",
            0.081,
            &[
                "cubes of 81.000000 mm are larger than the region, whose greatest extent is 80.000 mm; take less",
            ],
        ),
        (
            "block",
            1e-9,
            &["would be more in a row than the region has nodes (225)", "take at least 20.000 mm"],
        ),
        ("block", 1e-300, &["take at least 20.000 mm"]),
        ("block", 0.003, &["do not tell their corners apart", "twice the edge"]),
    ];
    for (region, cell, said) in cases {
        let error =
            Plan::new(&embedded(&scene_of(&mesh, mooney_rivlin(), None), region, *cell), mesh.clone());
        let error = error.err().unwrap_or_else(|| panic!("{region}, {cell} m is accepted")).to_string();
        println!("{error}");
        said.iter().for_each(|said| assert!(error.contains(said), "{error} does not say {said}"));
    }
    let mut twice = embedded(&scene_of(&mesh, mooney_rivlin(), None), "block", 0.02);
    twice.embedded.push(EmbeddedSpec::new("block", 0.03));
    let error = Plan::new(&twice, mesh).err().unwrap().to_string();
    assert!(error.contains("embedded region `block` is there twice"), "{error}");
    let said = Plan::parse("[[embedded]]\nregion = \"block\"\ncel = 0.02\n", "s.toml".as_ref()).unwrap_err();
    assert!(said.to_string().contains("cel"), "{said}");
}

/// A chain of six nodes of K; its ends are free, the others means of three free nodes.
#[test]
fn the_product_is_that_of_dense_matrices() {
    let groups: Vec<Vec<u32>> = vec![vec![0, 1, 2], vec![2, 3], vec![3, 4, 5]];
    let pattern = Arc::new(Pattern::new(6, groups.iter().map(Vec::as_slice)));
    let means: Vec<Vec<(u32, f64)>> = vec![
        vec![(0, 1.0)],
        vec![(0, 0.7), (1, 0.3)],
        vec![(0, 0.2), (1, 0.5), (2, 0.3)],
        vec![(1, 1.5), (2, -0.5)],
        vec![(2, 1.0)],
        vec![(3, 1.0)],
    ];
    let mut k = BlockMatrix::zeros(pattern.clone());
    let mut dense = DMatrix::zeros(18, 18);
    for i in 0..6 {
        for &j in pattern.row(i) {
            let block = std::array::from_fn(|e| (7 * i + 3 * j as usize + e) as f64 % 5.0 - 1.7);
            k.add_block(i, j as usize, &block);
            (0..9).for_each(|e| dense[(3 * i + e / 3, 3 * j as usize + e % 3)] = block[e]);
        }
    }
    let galerkin = Galerkin::new(pattern, means.clone(), 4);
    let pairs = galerkin.pairs();
    let mut out = BlockMatrix::zeros(Arc::new(Pattern::new(4, pairs.iter().map(|p| p.as_slice()))));
    galerkin.add_stiffness(&k, &mut out);
    let mut w = DMatrix::zeros(18, 12);
    for (i, mean) in means.iter().enumerate() {
        for &(p, weight) in mean {
            (0..3).for_each(|c| w[(3 * i + c, 3 * p as usize + c)] = weight);
        }
    }
    let wanted = w.transpose() * dense * &w;
    let mut found = DMatrix::zeros(12, 12);
    for p in 0..4 {
        for (&q, block) in out.pattern().row(p).iter().zip(out.row(p)) {
            (0..9).for_each(|e| found[(3 * p + e / 3, 3 * q as usize + e % 3)] = block[e]);
        }
    }
    assert!((found - wanted).amax() < 1e-13);
    let f: Vec<f64> = (0..18).map(|i| (i as f64).sin()).collect();
    let mut forces = vec![0.0; 12];
    galerkin.add_forces(&f, &mut forces);
    let wanted = w.transpose() * DVector::from_vec(f);
    assert!((DVector::from_vec(forces) - wanted).amax() < 1e-14);
}
