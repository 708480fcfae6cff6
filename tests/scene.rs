//! Does a plan find every mistake of a scene, and leave out what the scene does not call for?

use fem::measure::{solid_field, support_wrench};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::scene::*;
use std::path::Path;
use support::fem_scenes::{displaced, held, mooney_rivlin, plan, solid, solve, tolerance};

const BAR: &str = r#"
mesh = "bar.vtu"
mesh_unit = "mm"

[[solids]]
region = "block"
law = { kind = "mooney_rivlin", c10 = 3e3, c01 = 750.0, bulk = 747.5e3 }
density = 1060.0

[[fibres]]
name = "fibres"
course = { region = "trusses" }
law = { kind = "hill", sigma_max = 3e5, lambda_opt = 1.0 }
area = [1e-6]
activation = "a"

[[ties]]
nodes = "x_min"
body = "pelvis"

[[prescribed]]
nodes = "x_max"
components = [true, false, false]
displacement = [[0.01, 0.0, 0.0]]
control = "stretch"
"#;

fn bar() -> Mesh {
    let mut mesh = generate::block([4, 2, 2], [0.04, 0.02, 0.02]);
    generate::add_fibres(&mut mesh, "trusses", [4, 2, 2], &[[0, 0], [2, 2]]);
    mesh
}

fn read(text: &str) -> Result<Scene, String> {
    Plan::parse(text, Path::new("bar.toml")).map_err(|e| e.to_string())
}

#[test]
fn a_scene_is_read_and_compiled() {
    let scene = read(BAR).expect("a good scene");
    let plan = Plan::new(&scene, bar()).expect("a good scene");
    assert_eq!(plan.controls, ["a", "stretch"]);
    assert_eq!(plan.bodies, ["pelvis"]);
    assert_eq!(plan.effects, [("block".to_string(), 16), ("fibres".to_string(), 8)]);
    assert_eq!(
        plan.absent,
        [
            "membranes",
            "strands",
            "gravity",
            "inertia",
            "pressures",
            "patch pressures",
            "forces",
            "free bodies",
            "embedded regions",
            "contact"
        ]
    );
    assert_eq!(plan.islands.len(), 1);
    // 45 nodes; 9 tied, 9 with a prescribed x.
    assert_eq!(plan.n_unknowns(), 3 * 45 - 27 - 9);
    assert_eq!(scene.mesh_unit, fem::mesh::LengthUnit::Millimetre);
}

#[test]
fn mistakes_are_named_with_place_and_remedy() {
    let misspelt = read(&BAR.replace("density", "densitty")).expect_err("a misspelt key");
    assert!(misspelt.contains("densitty") && misspelt.contains("line 8"), "{misspelt}");
    let missing = Plan::read(Path::new("no/such/scene.toml")).err().expect("no such file").to_string();
    assert!(missing.contains("no/such/scene.toml"), "{missing}");

    let compile = |change: &dyn Fn(&mut Scene)| -> String {
        let mut scene = read(BAR).expect("a good scene");
        change(&mut scene);
        Plan::new(&scene, bar()).err().expect("a mistake").to_string()
    };
    let cases: Vec<(String, Vec<&str>)> = vec![
        (compile(&|s| s.solids[0].region = "blok".to_string()), vec!["`blok`", "nearest: `block`"]),
        (compile(&|s| s.ties[0].nodes = "xmin".to_string()), vec!["`xmin`", "`x_min`"]),
        (compile(&|s| s.solids[0].density = -1.0), vec!["density [kg/m^3] is -1", "at least 0"]),
        (compile(&|s| s.solids[0].scale = vec![1.0; 3]), vec!["scale has 3 entries", "one per cell (16)"]),
        (
            compile(&|s| s.solids[0].scale = [vec![1.0; 15], vec![0.0]].concat()),
            vec!["solid `block`", "scale of cell 15 is 0", "positive"],
        ),
        (compile(&|s| s.solids[0].scale = vec![f64::INFINITY; 16]), vec!["scale of cell 0 is inf"]),
        (compile(&|s| s.solids[0].law = LawSpec::NeoHookean { young: 1e3, nu: 0.5 }), vec!["Poisson", "0.5"]),
        (compile(&|s| s.fibres[0].area = vec![1e-6, 2e-6]), vec!["areas has 2 entries, needs 1 or 8"]),
        (compile(&|s| s.fibres[0].area = vec![f64::NAN]), vec!["area [m^2] is NaN"]),
        (compile(&|s| s.fibres[0].course = Course::Region("block".to_string())), vec!["Hex8", "lines"]),
        (
            compile(&|s| s.fibres[0].course = Course::Embedded(vec![vec![[0.01; 3], [0.05, 0.0, 0.0]]])),
            vec!["(0.050000, 0.000000, 0.000000)", "line 0", "no solid cell"],
        ),
        (
            compile(&|s| s.prescribed.push(held("x_min", [true, false, false]))),
            vec!["node 0, component x", "set `x_min`"],
        ),
        (compile(&|s| s.prescribed[0].control = None), vec!["without a control"]),
        (compile(&|s| s.solids.push(solid("block", mooney_rivlin(), None))), vec!["`block` is there twice"]),
        (
            compile(&|s| {
                let (surface, control) = ("y_max".to_string(), "p".to_string());
                s.pressures.push(PressureSpec { surface, control, origin: None });
            }),
            vec!["rim", "node"],
        ),
        (
            Plan::new(&Scene::default(), bar()).err().expect("an empty scene").to_string(),
            vec!["nothing can deform"],
        ),
    ];
    for (message, words) in cases {
        println!("{message}");
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
    }
    let scene = read(BAR).expect("a good scene");
    let plan = Plan::new(&scene, bar()).expect("a good scene");
    let unknown = plan.load(&[("strech", 1.0)], &[]).expect_err("a misspelt control").to_string();
    assert!(unknown.contains("`strech`") && unknown.contains("`stretch`"), "{unknown}");
    let mut broken = bar();
    broken.blocks[0].nodes[5] = 999;
    assert!(Plan::new(&scene, broken).err().expect("a bad node").to_string().contains("999"));
}

/// Two separate cubes in one region, cell for cell in turn, so that each island takes every other factor.
#[test]
fn a_factor_per_cell_multiplies_the_stiffness_of_that_cell() {
    let one = generate::block([2; 3], [0.02; 3]);
    let (mut mesh, n) = (one.clone(), one.points.len() as u32);
    mesh.points.extend(one.points.iter().map(|p| [p[0] + 0.05, p[1], p[2]]));
    mesh.blocks[0].nodes = one.blocks[0]
        .cells()
        .flat_map(|c| [c.to_vec(), c.iter().map(|i| i + n).collect()].concat())
        .collect();
    for name in ["z_min", "z_max"] {
        let nodes = &one.node_sets[name];
        mesh.node_sets.insert(name.to_string(), nodes.iter().flat_map(|&i| [i, i + n]).collect());
        mesh.node_sets.get_mut(name).expect("just added").sort_unstable();
    }
    let press = displaced(&mesh, "z_max", |_| [0.0, 0.002, -0.004]);
    let mut scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        prescribed: vec![held("z_min", [true; 3]), press],
        ..Scene::default()
    };
    scene.solids[0].scale = (0..16).map(|cell| if cell % 2 == 0 { 1.0 } else { 40.0 }).collect();
    let plan = plan(&scene, &mesh);
    assert_eq!(plan.islands.len(), 2);
    let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-12));
    let top = &mesh.node_sets["z_max"];
    let (soft, stiff): (Vec<u32>, Vec<u32>) = top.iter().partition(|&&i| i < n);
    let force = |nodes: &[u32]| support_wrench(&plan, frame.snapshot(), nodes, [0.0; 3]).force;
    for (soft, stiff) in force(&soft).into_iter().zip(force(&stiff)) {
        assert!(
            (stiff - 40.0 * soft).abs() < 1e-9 * stiff.abs().max(1.0),
            "{stiff} N is not 40 times {soft} N"
        );
    }
    let cells = solid_field(&plan, frame.snapshot(), "block").expect("a solid");
    for pair in cells.chunks_exact(2) {
        let off = (pair[1].cauchy - pair[0].cauchy * 40.0).amax() / pair[1].cauchy.amax();
        assert!(off < 1e-9 && (pair[1].volume - pair[0].volume).abs() < 1e-15, "stress {off:.1e}");
    }
}

#[test]
fn a_bad_force_length_law_is_refused() {
    let good = r#"law = { kind = "force_length", stretch = [0.8, 1.0, 1.2], activation = [0.0, 1.0], stress = [[0.0, 0.0, 1e4], [2e5, 3e5, 2e5]] }"#;
    let with = |law: &str| BAR.replace(r#"law = { kind = "hill", sigma_max = 3e5, lambda_opt = 1.0 }"#, law);
    Plan::new(&read(&with(good)).unwrap(), bar()).expect("a good law");
    for (wrong, right, says) in [
        (
            "stretch = [0.8, 1.2, 1.2]",
            "stretch = [0.8, 1.0, 1.2]",
            "stretch after 1.2 is 1.2, must be larger",
        ),
        ("stretch = [1.0]", "stretch = [0.8, 1.0, 1.2]", "number of samples of stretch is 1"),
        ("activation = []", "activation = [0.0, 1.0]", "number of samples of activation is 0"),
        ("[0.0, 0.0]", "[0.0, 0.0, 1e4]", "stresses has 2 entries"),
        ("[-1.0, 0.0, 1e4]", "[0.0, 0.0, 1e4]", "stress [Pa] is -1"),
        ("[nan, 0.0, 1e4]", "[0.0, 0.0, 1e4]", "stress [Pa] is NaN"),
    ] {
        let text = with(&good.replace(right, wrong));
        assert_ne!(text, with(good), "{wrong}");
        let error = Plan::new(&read(&text).unwrap(), bar()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("fibre `fibres`") && error.contains(says), "{error}");
    }
    let embedded = with(good).replace(
        r#"course = { region = "trusses" }"#,
        "course = { embedded = [[[0.01, 0.01, 0.01], [0.03, 0.01, 0.01]]] }",
    );
    let error = Plan::new(&read(&embedded).unwrap(), bar()).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("whole fibres"), "{error}");
}
