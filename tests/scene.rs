//! Does a plan find every mistake of a scene, and leave out what the scene does not call for?

use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::scene::*;
use std::path::Path;
use support::fem_scenes::{held, mooney_rivlin, solid};

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
    assert_eq!(plan.absent, ["membranes", "strands", "gravity", "pressures", "forces"]);
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
                s.pressures.push(PressureSpec { surface, origin: [0.0; 3], control });
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
