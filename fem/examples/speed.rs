//! How long the two loads take that the solver is measured by, where the time goes, and how it grows with the mesh.
//!
//! `cargo run --release -p sartorius-fem --example speed [block N]... [muscles COUNT]`, by default `block 9 block 16 block 26
//! muscles 17`. `block N`: a cube of N³ hexahedra of Mooney-Rivlin 3/0.75 kPa, ν = 0.495, bonded to two plates, pressed by 30 %
//! in one load step. `muscles COUNT`: separate bars of 8,000 nodes, 30 × 3 × 3 cm, fixed ends, thermal fibres along every line of
//! nodes, three times as strong on one side as on the other, activation 0 → 0.5. `RAYON_NUM_THREADS` sets the threads. Peak memory is that of the whole process so far.
//!
//! One number to expect: `block 26` (19,683 nodes) takes 9 Newton iterations; no row may take more than 12, and every row must
//! reach a residual of 10⁻⁶ of the forces in play, else the example fails.

use fem::material::line::FibreStrain;
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::{Course, FibreLawSpec, FibreSpec, LawSpec, PrescribedSpec, Scene, SolidSpec};
use fem::solve::Settings;
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = match arguments.is_empty() {
        true => "block 9 block 16 block 26 muscles 17".split(' ').collect(),
        false => arguments.iter().map(String::as_str).collect(),
    };
    println!("{} threads", rayon::current_num_threads());
    println!(
        "{:<14} {:>7} {:>9} {:>6} {:>7} {:>4} {:>9} {:>9} {:>9} {:>9} {:>9} {:>6}",
        "case",
        "nodes",
        "unknowns",
        "newton",
        "factors",
        "cg",
        "residual",
        "assembly",
        "factor",
        "cg_s",
        "total_s",
        "MiB"
    );
    for pair in words.chunks(2) {
        let [case, n] = pair else { panic!("{case:?} wants a number", case = pair[0]) };
        let n: usize = n.parse().expect("a number");
        match *case {
            "block" => measure(&format!("block {n}"), block(n), "press"),
            "muscles" => measure(&format!("{n} muscles"), muscles(n), "activation"),
            other => panic!("`{other}` is neither `block` nor `muscles`"),
        }
    }
}

fn tissue() -> LawSpec {
    // K of ν = 0.495 with G = 2 (C₁₀ + C₀₁) = 7.5 kPa.
    let (c10, c01, nu) = (3e3, 0.75e3, 0.495);
    let bulk = 2.0 * (c10 + c01) * 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    LawSpec::MooneyRivlin { c10, c01, bulk }
}

fn solid(region: &str) -> SolidSpec {
    SolidSpec::new(region, tissue())
}

fn held(nodes: &str) -> PrescribedSpec {
    PrescribedSpec { nodes: nodes.into(), components: [true; 3], displacement: Vec::new(), control: None }
}

/// Load `press` = 1 moves the upper plate down by 30 %.
fn block(n: usize) -> (Scene, Mesh) {
    let mesh = generate::block([n; 3], [0.02; 3]);
    let pressed = PrescribedSpec {
        displacement: vec![[0.0, 0.0, -0.3 * 0.02]],
        control: Some("press".into()),
        ..held("z_max")
    };
    let solids = mesh.blocks.iter().map(|b| solid(&b.name)).collect();
    (Scene { solids, prescribed: vec![held("z_min"), pressed], ..Scene::default() }, mesh)
}

/// Load `activation` = 1 is an activation of 0.5.
fn muscles(count: usize) -> (Scene, Mesh) {
    let mesh = generate::bars(count, [124, 7, 7], [0.3, 0.03, 0.03], 0.005);
    // Up to three times as much fibre on one side as on the other, on sides that change twice along the muscle, so
    // that activation bends it.
    let lean = |line: usize, segment: usize| {
        ((line % 8) as f64 / 7.0 - 0.5) * (segment as f64 / 124.0 * std::f64::consts::TAU).cos()
    };
    let area = (0..64 * 124).map(|i| 9e-4 / 64.0 * (1.0 + lean(i / 124, i % 124))).collect::<Vec<f64>>();
    let mut scene = Scene::default();
    for i in 0..count {
        let name = format!("muscle_{i:02}");
        scene.solids.push(solid(&name));
        scene.fibres.push(FibreSpec {
            name: format!("{name}_fibres"),
            course: Course::Region(format!("{name}_fibres")),
            law: FibreLawSpec::Thermal {
                young: 1e6,
                contraction: 0.15,
                strain: FibreStrain::Logarithmic,
                toe: Some(0.01),
            },
            area: area.clone(),
            activation: Some("activation".into()),
        });
        scene.prescribed.extend([held(&format!("{name}_x_min")), held(&format!("{name}_x_max"))]);
    }
    (scene, mesh)
}

fn measure(case: &str, (scene, mesh): (Scene, Mesh), control: &str) {
    let start = Instant::now();
    let plan = Plan::new(&scene, mesh).expect("the scene is sound");
    let load =
        plan.load(&[(control, if control == "press" { 1.0 } else { 0.5 })], &[]).expect("the control exists");
    let run = run(&plan, &Drive::once(load), &Settings::default(), None, &mut |_| {});
    assert!(run.is_solved(), "{:?}", run.errors);
    let islands = &run.frames[0].islands;
    let residual = islands.iter().map(|i| i.residual / i.force_scale).fold(0.0, f64::max);
    assert!(residual <= 1e-6, "{residual:e}");
    assert!(islands.iter().all(|i| i.iterations <= 12), "{islands:?}");
    let sum = |f: fn(&fem::solve::Advance) -> f64| islands.iter().map(f).sum::<f64>();
    println!(
        "{case:<14} {:>7} {:>9} {:>6} {:>7} {:>4} {residual:>9.1e} {:>9.2} {:>9.2} {:>9.2} {:>9.2} {:>6.0}",
        plan.mesh.points.len(),
        plan.n_unknowns(),
        sum(|i| i.iterations as f64),
        sum(|i| i.factorizations as f64),
        sum(|i| i.linear_iterations as f64),
        sum(|i| i.assembly_s),
        sum(|i| i.factorization_s),
        sum(|i| i.linear_s),
        start.elapsed().as_secs_f64(),
        peak_mib()
    );
}

/// Peak memory of the process \[MiB\]; NaN where the system does not tell.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kib.map_or(f64::NAN, |kib| kib / 1024.0)
}
