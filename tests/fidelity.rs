//! Muscles of a scene in grids or as lines: is what is left what was asked for, and does a muscle in a grid pull as its mesh does?

use std::fs;
use std::path::Path;

use coupling::comparison::estimate::Work;
use coupling::comparison::{Comparison, Prepared, SETTINGS, Sized};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::fibres::matrix_factor::{MatrixFactor, PULLED, drawn};
use coupling::fibres::{WrittenCalibration, alone::alone};
use coupling::scene::Scene;
use coupling::session::ThighSide;
use fem::solve::Settings;
use support::sartorius;

fn parse(text: &str) -> Result<Scene, String> {
    Scene::parse(Path::new("mine.toml"), text, None).map_err(|e| e.to_string())
}

fn level(muscle: &str, level: &str, rest: &str) -> String {
    format!("[[fidelity]]\nmuscle = \"{muscle}\"\nlevel = \"{level}\"\n{rest}\n")
}

#[test]
fn levels_are_read_and_lines_are_left_out() {
    let text = level("vastus_medialis", "embedded", "cell_mm = 30.0") + &level("gracilis", "line", "");
    let scene = parse(&text).unwrap();
    let embedded: Vec<_> = scene.fidelity.embedded.iter().map(|m| (m.muscle.as_str(), m.cell)).collect();
    assert_eq!(embedded, [("vastus_medialis", 0.03)]);
    assert!(scene.deformable && scene.muscles.len() == 16 && !scene.muscles.contains(&"gracilis".into()));
    // Written out and read back it is the same, whatever of it is left.
    let same = |mut s: Scene| {
        s.fidelity.embedded.iter_mut().for_each(|m| m.said.clear());
        Scene { text: String::new(), ..s }
    };
    assert_eq!(same(parse(&scene.resolved(None)).unwrap()), same(scene.clone()));
    let fewer = Scene { muscles: vec!["gracilis".into()], ..scene };
    let again = parse(&fewer.resolved(None)).unwrap();
    assert_eq!((again.muscles, again.fidelity.embedded), (fewer.muscles, Vec::new()));
    let all_lines = "muscles = [\"gracilis\"]\n".to_string() + &level("gracilis", "line", "");
    assert!(!parse(&all_lines).unwrap().deformable);
    assert_eq!(parse(&level("gracilis", "full", "")).unwrap().muscles, Vec::<String>::new());
}

#[test]
fn coarser_meshes_lead_without_being_asked_where_they_can() {
    // Edges of those before a mesh of 3 mm, without contact and with it [mm].
    let led = |rest: &str| {
        let scene = parse(&format!("resolution_mm = 3.0\n{rest}")).unwrap();
        Configuration::ALL
            .map(|c| scene.coarser(c).iter().map(|e| (1e3 * e).round() as u32).collect::<Vec<_>>())
    };
    let (both, none) = (vec![12, 6], Vec::new());
    assert_eq!(led(""), [both.clone(), both.clone()]);
    assert_eq!(led("[solver]\nnested_from_mm = 6.0\n"), [vec![6], vec![6]]);
    assert_eq!(led("[solver]\nnested_from_mm = 3.0\n"), [none.clone(), none.clone()]);
    assert_eq!(led("[effects]\ncontact = \"cheap\"\n"), [both, none.clone()]);
    let grid = level("gracilis", "embedded", "cell_mm = 30.0");
    for alone in ["[solver]\nmethod = \"relaxation\"\n", "[accuracy]\nstrict_steps = 5\n", &grid] {
        assert_eq!(led(alone), [none.clone(), none.clone()], "{alone}");
    }
    assert_eq!(Scene::walker().coarser(Configuration::WithContact), Vec::<f64>::new());
}

#[test]
fn mistakes_are_named_all_at_once() {
    let text = "muscles = [\"sartorius\", \"gracilis\"]\n".to_string()
        + &level("gracillis", "line", "")
        + &level("sartorius", "embedded", "")
        + &level("sartorius", "full", "")
        + &level("gracilis", "line", "cell_mm = 20.0")
        + &level("pectineus", "embedded", "cell_mm = 20.0");
    let said = parse(&text).unwrap_err();
    for wanted in [
        &["line 3", "`gracillis`", "did you mean `gracilis`"][..],
        &["line 8", "`embedded` without cell_mm", "twice the edges"],
        &["line 11", "`sartorius`", "one place"],
        &["line 17", "cell_mm", "20", "only embedded muscles"],
        &["line 19", "`pectineus`", "add it there"],
    ] {
        let line = said.lines().find(|l| wanted.iter().all(|w| l.contains(w)));
        assert!(line.is_some() || wanted.iter().all(|w| said.contains(w)), "{wanted:?} in {said}");
    }
    let said = parse(&level("gracilis", "embeded", "cell_mm = 2.0")).unwrap_err();
    for wanted in ["did you mean `embedded`", "6 to 500 mm"] {
        assert!(said.contains(wanted), "{wanted} in {said}");
    }
    let said = parse(
        &("[solver]\nmethod = \"relaxation\"\nnested_from_mm = 20.0\n".to_string()
            + &level("gracilis", "embedded", "cell_mm = 30.0")),
    );
    let said = said.unwrap_err();
    for wanted in [
        "relaxation with level = \"embedded\"",
        "relaxation with solver.nested_from_mm",
        "line 3: `solver.nested_from_mm` is 20 with level = \"embedded\"",
    ] {
        assert!(said.contains(wanted), "{wanted} in {said}");
    }
    let said = parse("[accuracy]\nstrict_steps = 5\n[solver]\nnested_from_mm = 20.0\n").unwrap_err();
    assert!(said.contains("line 4: `solver.nested_from_mm` is 20 with accuracy.strict_steps"), "{said}");
    let said = parse(&level("gracilis", "embedded", "cell_mm = 20.0")).unwrap_err();
    assert!(said.contains("line 4: `cell_mm` is 20") && said.contains("at least 24 mm"), "{said}");
    // What only the mesh can tell, of all muscles and before anything is solved, by `plan` too.
    let folder = tempfile::tempdir().unwrap();
    let scene =
        "muscles = [\"gracilis\", \"sartorius\"]\nresolution_mm = 16.0\n[effects]\ncontact = \"none\"\n"
            .to_string()
            + &level("gracilis", "embedded", "cell_mm = 100.0")
            + &level("sartorius", "embedded", "cell_mm = 500.0");
    fs::write(folder.path().join("grid.toml"), scene).unwrap();
    for command in [&["compare", "grid.toml", "--out", "o"][..], &["plan", "grid.toml"]] {
        let output = sartorius(command, folder.path());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for words in [
            ["line 8: cell_mm is 100", "around gracilis is"],
            ["line 12: cell_mm is 500", "around sartorius is"],
        ] {
            let line = said
                .lines()
                .find(|l| words.iter().all(|w| l.contains(w)) && l.contains("mm wide; take less"));
            assert!(line.is_some(), "{words:?} in {said}");
        }
        assert!(!folder.path().join("o/run.json").exists());
    }
}

/// Vastus intermedius, the muscle that study B embeds first, and gracilis, which stays whole.
fn scene(resolution_mm: f64, level: &str) -> Scene {
    let text = format!(
        "muscles = [\"vastus_intermedius\", \"gracilis\"]\nresolution_mm = {resolution_mm:?}\n[effects]\ncontact = \"none\"\n{level}"
    );
    parse(&text).unwrap()
}

fn solved(scene: Scene, folder: &Path) -> (Prepared, Comparison) {
    let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
    let asked = PerConfiguration { without: true, with: false };
    let comparison = prepared.solve(asked, folder, false, &mut |_| ()).unwrap();
    assert_eq!(comparison.shortcomings(), Vec::<String>::new());
    (prepared, comparison)
}

/// Forces through the belly \[N\], a list per step.
fn forces(comparison: &Comparison) -> Vec<Vec<f64>> {
    let solution = comparison.solutions.without.as_ref().unwrap();
    solution.steps.iter().map(|step| step.muscles.iter().map(|m| m.total).collect()).collect()
}

#[test]
fn a_muscle_in_a_grid_pulls_as_its_mesh_does_and_the_others_do_not_notice() {
    let folder = tempfile::tempdir().unwrap();
    let (_, whole) = solved(scene(12.0, ""), &folder.path().join("whole"));
    let in_grid = scene(12.0, &level("vastus_intermedius", "embedded", "cell_mm = 32.0"));
    let (prepared, grid) = solved(in_grid, &folder.path().join("grid"));
    assert!(whole.calibration.matrix.is_empty());
    let [factor] = &grid.calibration.matrix[..] else { panic!("one muscle is in a grid") };
    let MatrixFactor { of_mesh, of_grid, softened, unknowns, .. } = factor;
    println!("{factor:?}");
    // Some of the displacements of the mesh: stiffer, until it is softened.
    assert!(of_grid > of_mesh && factor.factor < 1.0 && unknowns[1] * 3 < unknowns[0]);
    assert!((softened / of_mesh - 1.0).abs() < 1e-3);
    // The thigh that is solved has that matrix, as seen by code that knows nothing of the factor; away from where it was found as well.
    let settings = Settings { tolerance: 1e-4, least_force: 1.0, ..SETTINGS };
    let at = |comparison: &Comparison, by: f64| {
        let i = comparison.thigh.muscles.iter().position(|m| m.name == "vastus_intermedius").unwrap();
        let mut muscle = alone(&comparison.thigh, i);
        muscle.scene.fibres.clear();
        drawn(&muscle, by, &settings).unwrap().0
    };
    for (by, within) in [(PULLED, 2e-3), (0.3, 0.15)] {
        let [mesh, grid] = [&whole, &grid].map(|c| at(c, by));
        println!("drawn by {by}: mesh {mesh:.4} N, grid {grid:.4} N, {:.4}", grid / mesh);
        assert!((grid / mesh - 1.0).abs() < within, "drawn by {by}: {grid} N, mesh {mesh} N");
    }
    // At the steps: T11, a held pose; a muscle that is in no grid to the last bit.
    for (a, b) in forces(&whole).into_iter().zip(forces(&grid)) {
        println!("mesh {a:.3?} N, grid {b:.3?} N");
        let of = |muscle: &str| grid.thigh.muscles.iter().position(|m| m.name == muscle).unwrap();
        let (i, j) = (of("vastus_intermedius"), of("gracilis"));
        assert!((a[i] - b[i]).abs() < 0.02 * a[i].abs().max(10.0), "{} N, mesh {} N", b[i], a[i]);
        assert_eq!(a[j].to_bits(), b[j].to_bits());
    }
    // What was written down of it makes the same thigh; of other cubes it is refused.
    let written = toml::to_string(&grid.calibration.written()).unwrap();
    let read = || toml::from_str::<WrittenCalibration>(&written).unwrap();
    let side = ThighSide::new(prepared, Configuration::WithoutContact, Some(read()), folder.path()).unwrap();
    assert_eq!(side.thigh().scene, grid.thigh.scene);
    let other = scene(12.0, &level("vastus_intermedius", "embedded", "cell_mm = 34.0"));
    let other = Prepared::new(other, None, &mut |_| ()).unwrap();
    let refused = ThighSide::new(other, Configuration::WithoutContact, Some(read()), folder.path());
    assert!(refused.err().unwrap().to_string().contains("is not one of these muscles"));
}

#[test]
fn a_plan_counts_grids() {
    let scene = || scene(9.0, &level("vastus_intermedius", "embedded", "cell_mm = 24.0"));
    let prepared = Prepared::new(scene(), None, &mut |_| ()).unwrap();
    let thigh = Sized::new(scene(), None).unwrap().draft().unwrap();
    let draft = Work::of_thigh(&thigh);
    let mesh = Work::of_plan(&prepared.plan(&prepared.thigh, Configuration::WithoutContact).unwrap());
    println!("{draft:?}\n{mesh:?}");
    // Badly filled cubes and pieces are not counted, which are a part of the corners.
    assert!((draft.unknowns as f64 / mesh.unknowns as f64 - 1.0).abs() < 0.25);
    let whole = Work::of_thigh(&Sized::new(self::scene(9.0, ""), None).unwrap().draft().unwrap());
    println!("{whole:?}");
    // A muscle of some 4500 unknowns in its mesh has some 500 in its grid.
    assert!(whole.unknowns - draft.unknowns > 3500);
}
