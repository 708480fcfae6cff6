//! Dynamic relaxation beside Newton's method on the same meshes, and how both grow with them.
//!
//! `cargo run --release -p sartorius-fem --example relaxation [block N | bar N]...`, by default `block 8 bar 2`. `block N`: a cube of N³ hexahedra of tissue
//! between plates, pressed by 30 %; `bar N`: 30N × N × N hexahedra, 10 times as long as wide, bent by fibres along its lines that are stronger on one
//! side. A line per method: the steps it took, seconds, nanoseconds per step and element, and by how much the force at the far end differs
//! from that of Newton's method. `NEWTON=0` leaves that out, for meshes beyond its memory.

use fem::material::line::FibreStrain;
use fem::measure::support_wrench;
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::{Course, FibreLawSpec, FibreSpec, LawSpec, PrescribedSpec, Scene, SolidSpec};
use fem::solve::{Method, Settings};
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = match arguments.is_empty() {
        true => "block 8 bar 2".split(' ').collect(),
        false => arguments.iter().map(String::as_str).collect(),
    };
    let with_newton = std::env::var("NEWTON").as_deref() != Ok("0");
    println!("case method elements unknowns steps seconds ns_per_step_and_element force_n difference");
    for pair in words.chunks(2) {
        let [case, n] = pair else { panic!("{case:?} wants a number", case = pair[0]) };
        let n: usize = n.parse().expect("a number");
        let (scene, mesh, far, control) = match *case {
            "block" => block(n),
            "bar" => bar(n),
            other => panic!("`{other}` is neither `block` nor `bar`"),
        };
        let elements: usize = mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
        let plan = Plan::new(&scene, mesh).expect("the scene is sound");
        let load = plan.load(&[control], &[]).expect("the control exists");
        let mut reference = None;
        for (name, method) in [("newton", Method::Newton), ("relaxation", Method::Relaxation)] {
            if method == Method::Newton && !with_newton {
                continue;
            }
            let settings = Settings { method, tolerance: 1e-4, ..Settings::default() };
            let clock = Instant::now();
            let out = run(&plan, &Drive::once(load.clone()), &settings, None, &mut |_| {});
            let seconds = clock.elapsed().as_secs_f64();
            assert!(out.is_solved(), "{:?}", out.errors);
            let frame = &out.frames[0];
            let steps: usize = frame.count(|i| i.iterations);
            let force = support_wrench(&plan, frame.snapshot(), &plan.mesh.node_sets[far], [0.0; 3]).force;
            let size = |f: [f64; 3]| f.iter().map(|f| f * f).sum::<f64>().sqrt();
            let before = *reference.get_or_insert(force);
            let off = size(std::array::from_fn(|c| force[c] - before[c])) / size(before);
            let each = 1e9 * seconds / (steps * elements) as f64;
            let unknowns = plan.n_unknowns();
            println!(
                "{case}_{n} {name} {elements} {unknowns} {steps} {seconds:.3} {each:.0} {:.6} {off:.1e}",
                size(force)
            );
        }
    }
}

fn tissue() -> LawSpec {
    // K of ν = 0.495 with G = 2 (C₁₀ + C₀₁) = 7.5 kPa.
    let (c10, c01, nu) = (3e3, 0.75e3, 0.495);
    let bulk = 2.0 * (c10 + c01) * 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    LawSpec::MooneyRivlin { c10, c01, bulk }
}

fn held(nodes: &str) -> PrescribedSpec {
    PrescribedSpec { nodes: nodes.into(), components: [true; 3], displacement: Vec::new(), control: None }
}

type Case = (Scene, Mesh, &'static str, (&'static str, f64));

/// `press` = 1 moves the upper plate down by 30 %.
fn block(n: usize) -> Case {
    let mesh = generate::block([n; 3], [0.02; 3]);
    let pressed = PrescribedSpec {
        displacement: vec![[0.0, 0.0, -0.3 * 0.02]],
        control: Some("press".into()),
        ..held("z_max")
    };
    let solids = mesh.blocks.iter().map(|b| SolidSpec::new(&b.name, tissue())).collect();
    (
        Scene { solids, prescribed: vec![held("z_min"), pressed], ..Scene::default() },
        mesh,
        "z_max",
        ("press", 1.0),
    )
}

/// `activation` = 0.5 contracts the fibres, three times as many on one side as on the other.
fn bar(n: usize) -> Case {
    let mesh = generate::bars(1, [30 * n, n, n], [0.3, 0.03, 0.03], 0.005);
    let (lines, segments) = ((n + 1) * (n + 1), 30 * n);
    let lean = |line: usize, s: usize| {
        ((line % (n + 1)) as f64 / n as f64 - 0.5)
            * (s as f64 / segments as f64 * std::f64::consts::TAU).cos()
    };
    let area = (0..lines * segments)
        .map(|i| 9e-4 / lines as f64 * (1.0 + lean(i / segments, i % segments)))
        .collect::<Vec<f64>>();
    let fibres = FibreSpec {
        name: "fibres".into(),
        course: Course::Region("muscle_00_fibres".into()),
        law: FibreLawSpec::Thermal {
            young: 1e6,
            contraction: 0.15,
            strain: FibreStrain::Logarithmic,
            toe: Some(0.01),
        },
        area,
        activation: Some("activation".into()),
    };
    let scene = Scene {
        solids: vec![SolidSpec::new("muscle_00", tissue())],
        fibres: vec![fibres],
        prescribed: vec![held("muscle_00_x_min"), held("muscle_00_x_max")],
        ..Scene::default()
    };
    (scene, mesh, "muscle_00_x_max", ("activation", 0.5))
}
