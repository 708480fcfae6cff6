//! T11: a muscle at a held pose, in its mesh and in a grid.

use std::path::Path;

use coupling::comparison::Prepared;
use coupling::configuration::PerConfiguration;
use coupling::scene::Scene;
use fem::measure::energies;

use crate::{Case, Outcome, Tier};

pub const CASES: &[Case] = &[Case {
    id: "T11",
    title: "vastus intermedius from its mesh to a grid at held poses",
    tier: Tier::Full,
    run: switched,
}];

/// Jump of the force through the belly when a level is exchanged for the other, and what counts as none \[N\]: the last digit that `compare` prints.
const JUMP: f64 = 0.02;
const NONE: f64 = 0.1;

/// Force through the belly \[N\] and energy of all its effects \[J\] at both steps of the built-in trial.
fn held(level: &str) -> Result<Vec<[f64; 2]>, String> {
    let text = format!(
        "muscles = [\"vastus_intermedius\"]\nresolution_mm = 12.0\n[effects]\ncontact = \"none\"\n{level}"
    );
    let scene = Scene::parse(Path::new("t11.toml"), &text, None).map_err(|e| e.to_string())?;
    let prepared = Prepared::new(scene, None, &mut |_| ()).map_err(|e| e.to_string())?;
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let asked = PerConfiguration { without: true, with: false };
    let comparison = prepared.solve(asked, folder.path(), false, &mut |_| ()).map_err(|e| e.to_string())?;
    if let Some(short) = comparison.shortcomings().first() {
        return Err(short.clone());
    }
    let solution = comparison.solutions.without.as_ref().ok_or("nothing was solved")?;
    let energy = |frame| energies(&solution.plan, frame).iter().map(|e| e.energy).sum();
    let frames = solution.at_steps().map(|frame| energy(frame.snapshot()));
    Ok(solution.steps.iter().zip(frames).map(|(step, energy)| [step.muscles[0].total, energy]).collect())
}

/// A pose decides the state of a muscle that is bound to bones and to nothing else, so what changes is what a switch on the way would change.
fn switched() -> Outcome {
    let mesh = held("")?;
    let grid = held("[[fidelity]]\nmuscle = \"vastus_intermedius\"\nlevel = \"embedded\"\ncell_mm = 32.0\n")?;
    let mut text = Vec::new();
    // At one of both steps it pulls.
    let mut good = mesh.len() == 2 && grid.len() == 2 && mesh.iter().any(|[force, _]| *force > 50.0 * NONE);
    for ([force, energy], [other, stored]) in mesh.iter().zip(&grid) {
        good &= (other - force).abs() < (JUMP * force.abs()).max(NONE);
        text.push(format!(
            "{force:.2} to {other:.2} N, energy {:.2} to {:.2} mJ ({:+.1} %)",
            1e3 * energy,
            1e3 * stored,
            100.0 * (stored / energy - 1.0)
        ));
    }
    let text = format!("{}; as a line it has no mesh and no energy", text.join("; "));
    if good { Ok(text) } else { Err(text) }
}
