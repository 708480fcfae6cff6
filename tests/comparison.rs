//! Scenes: what they may say, what is refused, and what `plan`, `step` and `compare` make of them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use coupling::comparison::estimate::{Expected, Work};
use coupling::comparison::explain::explain;
use coupling::comparison::{Prepared, Sized};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::fibres::cache::FOLDER;
use coupling::scene::StepName;
use coupling::scene::StressFree;
use coupling::scene::{Fibres, Scene};
use coupling::thigh::build::Thigh;
use fem::measure::nodal_forces;
use fem::scene::{ContactMode, LawSpec};
use nalgebra::Vector3;
use serde_json::Value;
use sha2::{Digest, Sha256};
use support::results::files_without_times;
use support::{sartorius, shared};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/scenes")
}

/// Path of a shipped scene for the command line.
fn shipped(name: &str) -> String {
    scenes().join(name).with_extension("toml").to_str().unwrap().to_string()
}

fn parse(text: &str) -> Result<Scene, String> {
    Scene::parse(Path::new("mine.toml"), text, None).map_err(|e| e.to_string())
}

#[test]
fn an_empty_scene_is_the_walker() {
    let (empty, walker) = (parse("").unwrap(), Scene::walker());
    let same = |s: Scene| Scene { name: String::new(), text: String::new(), folder: None, ..s };
    assert_eq!(same(empty), same(walker.clone()));
    assert_eq!((walker.trial, walker.muscles.len(), walker.resolution), (None, 0, 0.012));
    assert_eq!((walker.stress_free, walker.fibres), (StressFree::Standing, Fibres::Hill));
    assert_eq!(walker.contact, Some(ContactMode::Guarded));
    let names: Vec<StepName> = walker.steps.iter().map(|s| s.name).collect();
    assert_eq!(names, StepName::DEFAULT);
}

#[test]
fn every_key_is_heard() {
    let scene = parse(
        "muscles = [\"sartorius\", \"gracilis\"]\nresolution_mm = 8.0\nstress_free = \"heel_strike\"\n\
         [effects]\nfibres = \"none\"\nshells = false\ncontact = \"cheap\"\n\
         [[step]]\nname = \"loading_response\"\nknee_flexion_deg = 15.0\n[[step]]\nname = \"heel_strike\"\n",
    )
    .unwrap();
    assert_eq!(scene.muscles, ["sartorius", "gracilis"]);
    assert_eq!((scene.resolution, scene.stress_free), (0.008, StressFree::HeelStrike));
    assert_eq!((scene.fibres, scene.shells, scene.contact), (Fibres::None, false, Some(ContactMode::Cheap)));
    // In the order of time, whatever the file says.
    assert_eq!(scene.steps[0].name, StepName::HeelStrike);
    assert!((scene.steps[1].knee_flexion.unwrap() - 15_f64.to_radians()).abs() < 1e-15);
    assert!(!parse("muscles = \"none\"").unwrap().deformable);
    assert_eq!(parse("stress_free = \"heel_strike\"").unwrap().fibres, Fibres::Thermal);
}

#[test]
fn what_cannot_be_meant_is_refused_with_line_value_and_remedy() {
    for (scene, wanted) in [
        ("resolutoin_mm = 6.0", &["line 1", "`resolutoin_mm`", "`resolution_mm`"][..]),
        ("\n\nresolution_mm = 60.0", &["line 3", "60", "2.5 to 20 mm"]),
        ("resolution_mm = nan", &["line 1", "NaN", "2.5 to 20 mm"]),
        ("inset_mm = 7.5", &["line 1", "inset_mm", "7.5", "0 to 5 mm"]),
        ("resolution_mm = \"fine\"", &["line 1", "a number"]),
        (
            "muscles = [\n  \"sartorius\",\n  \"gracillis\",\n]",
            &["line 3", "`gracillis`", "did you mean `gracilis`"],
        ),
        ("muscles = [\"sartorius\", \"sartorius\"]", &["line 1", "twice"]),
        ("muscles = []", &["line 1", "empty"]),
        ("muscles = \"al\"", &["line 1", "`al`", "\"all\""]),
        ("[effects]\ncontact = \"gaurded\"", &["line 2", "contact", "`gaurded`", "did you mean `guarded`"]),
        ("[effects]\nfibers = \"hill\"", &["line 2", "`fibers`", "`fibres`"]),
        ("[effects]\nfibres = \"hil\"", &["line 2", "did you mean `hill`"]),
        ("[[step]]\nname = \"toe_off\"", &["line 2", "`toe_off`", "heel_strike"]),
        ("[[step]]\nname = \"heel_strike\"\n[[step]]\nname = \"heel_strike\"", &["line 4", "again"]),
        ("[[step]]\nname = \"heel_strike\"\nknee_flexion_deg = -3.0", &["line 3", "-3", "0 to 120 degrees"]),
        ("step = []", &["step", "both steps"]),
        ("stress_free = \"heel_strike\"\n[[step]]\nname = \"loading_response\"", &["line 1", "standing"]),
        ("trial = \"nowhere.toml\"", &["nowhere.toml"]),
        ("surfaces = \"nowhere\"", &["line 1", "`nowhere`", "--data"]),
        ("trial = ", &["line 1"]),
        ("[materials]\nmatrix_a_kpa = 3000.0", &["line 2", "matrix_a_kpa", "3000", "0.01 to 1000 kPa"]),
        ("[materials]\ntendon_modulus_mpa = nan", &["line 2", "tendon_modulus_mpa", "1 to 5000 MPa"]),
        ("[materials]\nbulk_modulus_kpa = 8.0", &["line 2", "1.067 times the shear modulus", "5 to 5000"]),
        (
            "[materials]\ntendon_modulus_gpa = 1.2",
            &["line 2", "`tendon_modulus_gpa`", "`tendon_modulus_mpa`"],
        ),
        (
            "[[materials.muscle]]\nname = \"rectus_femuris\"\nmatrix_a_kpa = 4.0",
            &["line 2", "`rectus_femuris`", "did you mean `rectus_femoris`"],
        ),
        (
            "muscles = [\"sartorius\"]\n[[materials.muscle]]\nname = \"gracilis\"",
            &["line 3", "`gracilis`", "add it there"],
        ),
        (
            "[[materials.muscle]]\nname = \"gracilis\"\n[[materials.muscle]]\nname = \"gracilis\"",
            &["line 4", "one place"],
        ),
        (
            "[effects]\nshells = false\n[materials]\naponeurosis_thickness_mm = 1.0",
            &["line 4", "aponeurosis_thickness_mm", "shells = false"],
        ),
    ] {
        let error = parse(scene).map(|s| panic!("{scene} is taken: {s:?}")).unwrap_err();
        assert!(error.contains("mine.toml"), "{error}");
        for word in wanted {
            assert!(error.contains(word), "{scene}: {error} lacks {word}");
        }
    }
    // A muscle that has it from all muscles says nothing again.
    let scene = "[materials]\nbulk_modulus_kpa = 8.0\n[[materials.muscle]]\nname = \"gracilis\"\ndensity_kg_m3 = 1100.0";
    let error = parse(scene).map(|s| panic!("{s:?}")).unwrap_err();
    assert_eq!(error.matches("times the shear modulus").count(), 2, "value and remedy, once each: {error}");
}

/// The thigh of a scene of three muscles: semitendinosus ends in strands, rectus femoris in its solid tendon.
fn thigh_of(materials: &str) -> Result<coupling::thigh::build::Thigh, String> {
    let text = format!(
        "muscles = [\"gluteus_minimus\", \"rectus_femoris\", \"semitendinosus\"]\nresolution_mm = 18.0\n[effects]\ncontact = \"none\"\n{materials}"
    );
    let scene = parse(&text)?;
    assert!(scene.settings().iter().any(|(label, _)| label == "Matrix"));
    Prepared::new(scene, None, &mut |_| ()).map(|p| p.thigh).map_err(|e| e.to_string())
}

#[test]
fn materials_change_what_they_name_and_nothing_else() {
    let plain = thigh_of("").unwrap();
    // The defaults written out are the defaults, to the last bit but for the bulk modulus, which goes by way of Poisson's ratio.
    let same = thigh_of(
        "[materials]\nmatrix_a_kpa = 3.0\nmatrix_b_kpa = 0.75\ndensity_kg_m3 = 1060.0\n\
         aponeurosis_thickness_mm = 0.5\naponeurosis_shear_modulus_kpa = 7.5\ntendon_section_mm2 = 30.0\n",
    )
    .unwrap();
    assert_eq!(same.scene, plain.scene);
    let bulk = |law: &LawSpec| {
        let LawSpec::MooneyRivlinDyna { a, b, nu } = law else { panic!("{law:?}") };
        4.0 * (a + b) * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    };
    let other = thigh_of(
        "[materials]\nbulk_modulus_kpa = 600.0\ndensity_kg_m3 = 1100.0\ntendon_modulus_mpa = 600.0\n\
         [[materials.muscle]]\nname = \"rectus_femoris\"\nmatrix_a_kpa = 6.0\naponeurosis_thickness_mm = 1.0\n\
         tendon_modulus_mpa = 740.0\n",
    )
    .unwrap();
    assert_eq!((&other.mesh.points, &other.scene.fibres), (&plain.mesh.points, &plain.scene.fibres));
    for (changed, before) in other.scene.solids.iter().zip(&plain.scene.solids) {
        let own = changed.region.starts_with("rectus_femoris");
        let LawSpec::MooneyRivlinDyna { a, b, .. } = changed.law else { panic!("{:?}", changed.law) };
        assert_eq!((a, b), (if own { 6e3 } else { 3e3 }, 750.0), "{}", changed.region);
        assert!(
            (bulk(&changed.law) / 600e3 - 1.0).abs() < 1e-9,
            "{}: {}",
            changed.region,
            bulk(&changed.law)
        );
        assert_eq!((changed.density, &changed.scale), (1100.0, &before.scale));
    }
    for (changed, before) in other.scene.membranes.iter().zip(&plain.scene.membranes) {
        let thick = if changed.region == "rectus_femoris/shell" { 1e-3 } else { before.thickness };
        assert_eq!((changed.thickness, &changed.law), (thick, &before.law), "{}", changed.region);
    }
    let mut seen = [0; 3];
    for (changed, before) in other.scene.strands.iter().zip(&plain.scene.strands) {
        let (kind, factor) = match changed.region.as_str() {
            "rectus_femoris/tendon_fibres" => (0, 2.0),
            region if region.starts_with("patellar_ligament") => (1, 1.0),
            _ => (2, 0.5),
        };
        seen[kind] += 1;
        let wanted = factor * before.stiffness;
        assert!(
            (changed.stiffness / wanted - 1.0).abs() < 1e-14,
            "{}: {}",
            changed.region,
            changed.stiffness
        );
    }
    assert!(seen.iter().all(|n| *n > 0), "{seen:?}");
    let refused = thigh_of("[[materials.muscle]]\nname = \"rectus_femoris\"\ntendon_section_mm2 = 20.0\n");
    let refused = refused.map(|_| ()).unwrap_err();
    assert!(refused.contains("tendon_section_mm2") && refused.contains("rectus_femoris"), "{refused}");
}

/// Few muscles, so that the contact of all of them is not looked for.
const SOME: &str = "[\"gluteus_medius\", \"gluteus_minimus\", \"rectus_femoris\"]";

#[test]
fn shipped_scenes_are_good_and_plans_name_what_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |name: &str| -> Value {
        // Coarse, so that the meshes take no time.
        let text = fs::read_to_string(shipped(name)).unwrap();
        let text = text.replace("resolution_mm = 12.0\n", "").replace("\"all\"", SOME);
        let file = folder.path().join(name).with_extension("toml");
        fs::write(&file, format!("resolution_mm = 14.0\n{text}")).unwrap();
        let output = sartorius(&["plan", file.to_str().unwrap(), "--json"], folder.path());
        fs::remove_file(&file).unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{name}: {said}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let left_out = |plan: &Value| -> Vec<String> {
        plan["left_out"].as_array().unwrap().iter().map(|p| format!("{}: {}", p[0], p[1])).collect()
    };
    let has = |plan: &Value, word: &str| left_out(plan).iter().any(|l| l.contains(word));
    let stage = |plan: &Value, i: usize| plan["stages"][i]["stage"].as_str().unwrap_or("").to_string();
    let seconds = |plan: &Value| plan["expected_seconds"].as_f64().unwrap();
    let [full, alone, three, passive, rigid] =
        ["walker", "walker_no_contact", "three_muscles", "no_fibres", "rigid_only"].map(plan);
    assert!(has(&full, "14 muscles") && !has(&alone, "muscles of the thigh"));
    assert!(!has(&full, "contact") && !has(&full, "fibres") && has(&full, "gravity"));
    assert!(has(&alone, "contact") && !has(&alone, "fibres"));
    assert!(has(&three, "14 muscles") && has(&three, "vastus lateralis"));
    assert!(has(&passive, "fibres") && stage(&passive, 0) == "without contact");
    assert!(has(&rigid, "deformable thigh") && rigid["elements"] == 0);
    assert_eq!(
        [stage(&full, 0), stage(&full, 1), stage(&full, 2)],
        ["calibration", "without contact", "with contact"]
    );
    // What is absent costs nothing. Every plan measures the machine anew; seconds of an element's meshing are what it found.
    let speed = |plan: &Value| {
        plan["expected_meshing_seconds"].as_f64().unwrap() / plan["elements"].as_f64().unwrap()
    };
    let work = |plan: &Value| seconds(plan) / speed(plan);
    assert!(work(&alone) > work(&passive) && seconds(&passive) > seconds(&rigid));
    assert!(work(&passive) > 3.0 * three["stages"][1]["expected_seconds"].as_f64().unwrap() / speed(&three));
    assert!(seconds(&rigid) < 0.5 && rigid["expected_meshing_seconds"] == 0.0);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "plan writes nothing");
    for entry in fs::read_dir(scenes()).unwrap() {
        let file = entry.unwrap().path();
        let data = if file.ends_with("real_surfaces.toml") { shared("anatomy") } else { None };
        if file.ends_with("real_surfaces.toml") && data.is_none() {
            continue;
        }
        // Trials are found from the root of the repository.
        if !fs::read_to_string(&file).unwrap().contains("og3") {
            Scene::read(&file, data.as_deref()).unwrap();
        }
    }
}

/// Ring or plain grid, and which nodes lie close enough to bone to be tied, is known of the mesh only.
#[test]
fn a_plan_counts_on_a_draft_what_the_mesh_will_have() {
    let scene = "muscles = [\"vastus_lateralis\", \"vastus_intermedius\", \"rectus_femoris\", \"gluteus_medius\", \"gracilis\"]\n\
                 resolution_mm = 16.0\n";
    let prepared = Prepared::new(parse(scene).unwrap(), None, &mut |_| ()).unwrap();
    let sized = Sized::new(parse(scene).unwrap(), None).unwrap();
    let thigh = sized.draft().unwrap();
    let draft = Work::of_draft(&prepared.scene, &thigh, PerConfiguration::of(|_| true));
    for (c, draft) in draft.iter() {
        let draft = draft.unwrap();
        let mesh = Work::of_plan(&prepared.plan(&prepared.thigh, c).unwrap());
        println!("{draft:?}\n{mesh:?}");
        assert_eq!(draft.islands, mesh.islands);
        for (said, is) in [
            (draft.unknowns as f64, mesh.unknowns as f64),
            (draft.blocks as f64, mesh.blocks as f64),
            (draft.factors as f64, mesh.factors as f64),
        ] {
            assert!((said / is - 1.0).abs() < 0.02, "{said} and {is}");
        }
        assert!((draft.operations / mesh.operations - 1.0).abs() < 0.05);
    }
    let demand = sized.demand();
    let elements = |thigh: &Thigh| {
        Expected::of(&prepared.scene, thigh, PerConfiguration::default(), demand, None).elements
    };
    assert_eq!(elements(&thigh), elements(&prepared.thigh));
    assert_eq!(thigh.tendons.len(), 3);
    let [without, with] =
        Configuration::ALL.map(|c| prepared.plan(&prepared.thigh, c).unwrap().mesh.surfaces);
    let bones = with.iter().filter(|(name, _)| !without.contains_key(*name));
    assert_eq!(demand.bone_triangles, bones.map(|(_, faces)| faces.len()).sum::<usize>());
}

/// A step soon after another is less work.
#[test]
fn frames_count_by_how_far_they_are() {
    let frames = |steps: &str| {
        let scene = parse(&format!("trial = \"walker\"\nmuscles = \"none\"\n{steps}")).unwrap();
        Sized::new(scene, None).unwrap().demand().frames
    };
    let [heel_strike, loading_response, cycle_5] =
        ["heel_strike", "loading_response", "cycle_5"].map(|name| format!("[[step]]\nname = \"{name}\"\n"));
    assert_eq!(frames(&heel_strike), 1.0);
    assert_eq!(frames(&(heel_strike.clone() + &loading_response)), 2.0);
    let soon = frames(&(heel_strike.clone() + &cycle_5));
    assert!((1.3..1.6).contains(&soon), "{soon}");
}

#[test]
fn a_stage_is_a_line_where_standard_error_is_piped() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\"]\nresolution_mm = 18.0\n[effects]\nfibres = \"none\"\ncontact = \"none\"\n";
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let stages = |arguments: &[&str]| -> Vec<String> {
        let output = sartorius(arguments, folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let stage = |line: &str| -> String {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [name @ .., seconds, "s"] = &words[..] else { panic!("{line}") };
            assert!(seconds.parse::<f64>().unwrap() >= 0.0);
            name.join(" ")
        };
        text(&output.stderr).lines().map(stage).collect()
    };
    assert_eq!(stages(&["compare", "one.toml"]), ["rigid leg", "mesh", "without contact", "write"]);
    assert_eq!(stages(&["mesh", "--only", "gracilis", "--resolution", "20"]), ["read", "mesh", "write"]);
    let rigid = ["read", "model", "marker fit", "loads", "sharing", "activations", "write"];
    assert_eq!(stages(&["optimize"]), rigid);
    for command in
        [&["compare", "one.toml"][..], &["mesh", "--only", "gracilis", "--resolution", "20"], &["optimize"]]
    {
        assert!(stages(&[command, &["--quiet"]].concat()).is_empty());
    }
}

#[test]
fn the_rigid_leg_alone_is_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["compare", &shipped("rigid_only"), "--out", "r"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = fs::read_to_string(folder.path().join("r/comparison.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 2 * 17);
    let row = table.lines().find(|l| l.starts_with("heel_strike,gluteus_minimus")).unwrap();
    let cells: Vec<&str> = row.split(',').collect();
    assert!(cells[3].parse::<f64>().unwrap() > 50.0 && cells[4..].iter().all(|c| c.is_empty()), "{row}");
    assert!(fs::read_to_string(folder.path().join("r/report.html")).unwrap().contains("gluteus minimus"));
    assert!(!folder.path().join("r/no_contact").exists());
}

#[test]
fn a_step_is_one_configuration_and_json_is_its_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\"]\nresolution_mm = 16.0\nstress_free = \"heel_strike\"\n\
                 [effects]\nshells = false\ncontact = \"none\"\n[[step]]\nname = \"heel_strike\"\n";
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let output = sartorius(&["step", "one.toml", "--json", "--threads", "1", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "quiet: {}", text(&output.stderr));
    let verdict: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&verdict["status"], &verdict["scene"]), (&"solved".into(), &"one".into()));
    let differences = verdict["differences"].as_array().unwrap();
    assert_eq!(differences.len(), 1);
    assert_eq!(differences[0]["configuration"], "without contact");
    assert!(differences[0]["largest_N"].as_f64().unwrap() < 5.0);
    let out = folder.path().join("out/step-one");
    assert!(out.join("run.json").exists() && !out.join("contact").exists());
    let shells = fs::read_to_string(out.join("comparison.csv")).unwrap();
    assert!(shells.lines().nth(1).unwrap().ends_with(",0.000"), "no shell, no force in it: {shells}");
    // Stability is tested where the scene asks for it, in every frame.
    let tested = || {
        let summary = fs::read_to_string(out.join("no_contact/thigh.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        [&summary["frames_tested_for_stability"], &summary["frames_solved"]]
            .map(|n| n.as_u64().expect("a count"))
    };
    let [without, _] = tested();
    let scene = format!("{scene}[accuracy]\ncheck_stability = true\n");
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let output = sartorius(&["step", "one.toml", "--threads", "1", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let [with, frames] = tested();
    assert!(without == 0 && with == frames && frames > 0, "{without}, {with} of {frames} frames");
}

#[test]
fn passive_tissue_has_no_fibre_force_and_a_prescribed_knee_moves_it() {
    let folder = tempfile::tempdir().unwrap();
    let table = |flexion: &str| {
        let scene = format!(
            "muscles = [\"vastus_lateralis\"]\nresolution_mm = 16.0\n[effects]\nfibres = \"none\"\ncontact = \"none\"\n\
             [[step]]\nname = \"loading_response\"\nknee_flexion_deg = {flexion}\n"
        );
        fs::write(folder.path().join("passive.toml"), scene).unwrap();
        let output = sartorius(&["compare", "passive.toml", "--out", "p"], folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let table = fs::read_to_string(folder.path().join("p/comparison.csv")).unwrap();
        let cells: Vec<f64> =
            table.lines().nth(1).unwrap().split(',').skip(2).map(|c| c.parse().unwrap_or(f64::NAN)).collect();
        cells
    };
    let (straight, bent) = (table("0.0"), table("30.0"));
    for cells in [&straight, &bent] {
        assert_eq!(cells[6], 0.0, "fibres: {cells:?}");
    }
    // The mesh stands with straight knee, where it is free of stress; the solver stops at 0.01 N.
    assert!(straight[2].abs() < 0.02, "{straight:?}");
    assert!(bent[2] > 0.2, "flexion stretches the vasti: {bent:?}");
}

#[test]
fn scenes_that_are_no_scenes_end_with_2_and_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("wrong.toml"), "[effects]\ncontact = \"gaurded\"\n").unwrap();
    for command in ["compare", "step", "plan"] {
        for (scene, words) in
            [("wrong.toml", "line 2"), ("nowhere.toml", "nowhere.toml"), ("wallker", "wallker")]
        {
            let output = sartorius(&[command, scene], folder.path());
            assert_eq!(output.status.code(), Some(2), "{command} {scene}");
            assert!(text(&output.stderr).contains(words), "{}", text(&output.stderr));
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let output = sartorius(&["plan", "three_muscels"], &root);
    assert!(text(&output.stderr).contains("did you mean `three_muscles`"), "{}", text(&output.stderr));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn calibrations_are_kept_and_change_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    for (fibres, reading) in [("hill", "standing"), ("thermal", "heel_strike")] {
        let at = folder.path().join(fibres);
        fs::create_dir(&at).unwrap();
        let scene = format!(
            "muscles = [\"gluteus_minimus\"]\nresolution_mm = 16.0\nstress_free = \"{reading}\"\n\
             [effects]\nfibres = \"{fibres}\"\ncontact = \"none\"\n[[step]]\nname = \"heel_strike\"\n"
        );
        fs::write(at.join("one.toml"), scene).unwrap();
        let run = |out: &str| {
            let output = sartorius(&["compare", "one.toml", "--quiet", "--out", out], &at);
            assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
            let table = |name: &str| fs::read(at.join(out).join(name)).unwrap();
            ((table("comparison.csv"), table("calibration.csv")), text(&output.stderr))
        };
        let (first, said) = run("runs/first");
        assert!(said.is_empty(), "{said}");
        let entry = match fs::read_dir(at.join("runs").join(FOLDER)).unwrap().collect::<Vec<_>>().as_slice() {
            [Ok(entry)] => entry.path(),
            other => panic!("one muscle, one entry: {other:?}"),
        };
        assert_eq!(run("runs/kept"), (first.clone(), String::new()));
        // The entry is what the second run took: a whole one that says something else is believed.
        let whole = fs::read_to_string(&entry).unwrap();
        let rest = whole.split_once('\n').unwrap().1;
        let (key, number) = if fibres == "hill" { ("gain = ", 1.0) } else { ("contraction = [0.0, ", 0.01) };
        let (before, after) = rest.split_once(key).unwrap();
        let end = after.find([',', '\n', ']']).unwrap();
        let value: f64 = after[..end].parse().unwrap();
        let other = format!("{before}{key}{}{}", value + number, &after[end..]);
        let sum: String = Sha256::digest(&other).iter().map(|b| format!("{b:02x}")).collect();
        fs::write(&entry, format!("# {sum}\n{other}")).unwrap();
        assert_ne!(run("runs/other").0, first);
        // Damaged ones are not.
        fs::write(&entry, &whole[..whole.len() / 2]).unwrap();
        let (again, said) = run("runs/damaged");
        assert!(again == first, "a damaged entry is computed anew");
        assert!(said.contains("damaged") && said.contains("gluteus_minimus"), "{said}");
        assert_eq!(fs::read_to_string(&entry).unwrap(), whole);
        if fibres == "hill" {
            // Another material is calibrated anew, under a name of its own, and shown.
            let stiffer = fs::read_to_string(at.join("one.toml")).unwrap()
                + "[materials]\naponeurosis_shear_modulus_kpa = 30.0\n";
            fs::write(at.join("one.toml"), stiffer).unwrap();
            assert_ne!(run("runs/stiffer").0, first);
            assert_eq!(fs::read_dir(at.join("runs").join(FOLDER)).unwrap().count(), 2);
            for file in ["report.html", "run.json"] {
                let shown = fs::read_to_string(at.join("runs/stiffer").join(file)).unwrap();
                assert!(shown.contains("shells of 0.5 mm, shear modulus 30 kPa"), "{file}");
            }
        }
    }
}

#[test]
fn a_coarser_mesh_shows_the_way_and_the_forces_stay() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 9.0\n";
    fs::write(folder.path().join("plain.toml"), scene).unwrap();
    fs::write(folder.path().join("nested.toml"), format!("{scene}[solver]\nnested_from_mm = 18.0\n"))
        .unwrap();
    let run = |scene: &str, threads: &str, out: &str| {
        let output = sartorius(&["compare", scene, "--out", out, "--threads", threads], folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    run("plain.toml", "2", "plain");
    let said = run("nested.toml", "2", "nested");
    let is_said = |stage: &str| said.lines().any(|line| line.starts_with(stage));
    for stage in [
        "calibration, 18 mm, without",
        "without contact, 18 mm",
        "calibration, 18 mm, with ",
        "with contact, 18 mm",
    ] {
        assert!(is_said(stage), "{stage}: {said}");
    }
    run("nested.toml", "1", "single");
    let (two, one) = (
        files_without_times(&folder.path().join("nested")),
        files_without_times(&folder.path().join("single")),
    );
    assert!(two == one, "threads change the run");
    let iterations = |of: &str| {
        let table = fs::read_to_string(folder.path().join(of).join("iterations.csv")).unwrap();
        table.lines().count() - 1
    };
    for configuration in ["no_contact", "contact"] {
        let [at_once, led] = ["plain", "nested"].map(|out| iterations(&format!("{out}/{configuration}")));
        println!("{configuration}: {led} iterations led, {at_once} at once");
        assert!(5 * led < 4 * at_once, "{configuration}: {led} iterations led, {at_once} at once");
    }
    let forces = |out: &str| -> Vec<(String, f64)> {
        let table = fs::read_to_string(folder.path().join(out).join("quantities.csv")).unwrap();
        let rows = table.lines().filter(|row| row.contains(",section_force_N,"));
        rows.map(|row| row.rsplit_once(',').unwrap()).map(|(of, f)| (of.into(), f.parse().unwrap())).collect()
    };
    let (plain, nested) = (forces("plain"), forces("nested"));
    assert!(!plain.is_empty() && plain.len() == nested.len());
    for ((of, a), (_, b)) in plain.iter().zip(&nested) {
        // What a residual of 10 N leaves open, with contact.
        assert!((a - b).abs() < 0.02 * a.abs() + 1.0, "{of}: {a} N, {b} N led");
    }
}

#[test]
fn coarser_meshes_that_were_wanted_and_led_nothing_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let told = |from: f64| {
        let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 9.0\n[effects]\ncontact = \"cheap\"\n";
        fs::write(folder.path().join("scene.toml"), format!("{scene}[solver]\nnested_from_mm = {from:.1}\n"))
            .unwrap();
        let arguments = ["compare", "scene.toml", "--contact", "with", "--out", "out", "--force"];
        let output = sartorius(&arguments, folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        fs::read_to_string(folder.path().join("out/run.json")).unwrap().contains("led nothing here")
    };
    assert!(told(18.0), "wanted, and cheap contact is not led");
    assert!(!told(9.0), "less than twice the edges: at once is what was asked for");
}

/// Files of a run that hold no times, by their path in its folder.
fn timeless(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for sub in ["", "no_contact"] {
        for entry in fs::read_dir(folder.join(sub)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_string();
            let timed = [
                ".sartorius",
                "run.json",
                "report.html",
                "no_contact/iterations.csv",
                "no_contact/thigh.json",
            ];
            if path.is_file() && !timed.contains(&name.as_str()) {
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

#[test]
fn one_pass_of_two_way_coupling_is_the_one_way_result() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\n[effects]\ncontact = \"none\"\n";
    fs::write(folder.path().join("two.toml"), scene).unwrap();
    let run = |out: &str, more: &[&str]| {
        let output = sartorius(&[&["compare", "two.toml", "--out", out], more].concat(), folder.path());
        let code = output.status.code();
        assert!(code == Some(0) || more.len() > 1 && code == Some(3), "{}", text(&output.stderr));
        timeless(&folder.path().join(out))
    };
    let one_way = run("one", &[]);
    let mut stopped = run("stopped", &["--two-way", "--passes", "1"]);
    let passes = text(&stopped.remove("passes.csv").unwrap());
    assert_eq!(passes.lines().count(), 2, "{passes}");
    // What muscles can do is asked for by the pass after; one has none.
    assert_eq!(text(&stopped.remove("capacities.csv").unwrap()).lines().count(), 1);
    // What single muscles keep missing adds up to what is missing.
    let missing = text(&stopped.remove("missing_moments.csv").unwrap());
    let number = |cell: &str| cell.parse::<f64>().unwrap();
    for (k, step) in ["heel_strike", "loading_response"].iter().enumerate() {
        let all: Vec<f64> =
            passes.lines().nth(1).unwrap().split(',').skip(5 + 4 * k).take(4).map(number).collect();
        assert!(all[1].abs() > 0.1, "{passes}");
        let rows: Vec<&str> = missing.lines().filter(|l| l.split(',').nth(1) == Some(step)).collect();
        assert_eq!(rows.len(), 2, "{missing}");
        for (c, all) in all.iter().enumerate() {
            let sum: f64 = rows.iter().map(|row| number(row.split(',').nth(5 + c).unwrap())).sum();
            assert!((sum - all).abs() < 2e-5, "{step} {c}: {sum} and {all}"); // five digits each
        }
    }
    assert!(one_way.len() > 6 && one_way.contains_key("no_contact/thigh_0001_solids.vtu"));
    assert_eq!(one_way.keys().collect::<Vec<_>>(), stopped.keys().collect::<Vec<_>>());
    for (name, bytes) in &one_way {
        assert!(bytes == &stopped[name], "{name} differs");
    }
    // A second pass sees what the first one says, and does not change it.
    let passes_of = |csv: &str| csv.lines().nth(1).unwrap().to_string();
    let coupled = run("two", &["--two-way", "--passes", "2"]);
    let two = text(&coupled["passes.csv"]);
    assert_eq!(two.lines().count(), 3, "{two}");
    assert_eq!(passes_of(&two), passes_of(&passes));
    // A row per step and muscle.
    let capacities = text(&coupled["capacities.csv"]);
    assert_eq!(capacities.lines().count(), 1 + 2 * 2, "{capacities}");
    // The last pass is the result, in every table, and the one-way result stands beside it. It has not settled, and that is said.
    let rows = |csv: &str| -> Vec<Vec<String>> {
        csv.lines().skip(1).map(|l| l.split(',').map(String::from).collect()).collect()
    };
    let (before, after) = (text(&one_way["comparison.csv"]), text(&coupled["comparison.csv"]));
    assert!(
        after.starts_with(before.lines().next().unwrap()),
        "the columns of a one-way result stay where they are"
    );
    let last: Vec<Vec<String>> =
        rows(&text(&coupled["missing_moments.csv"])).into_iter().filter(|r| r[0] == "2").collect();
    for ((one, two), seen) in rows(&before).iter().zip(rows(&after)).zip(&last) {
        assert_eq!([&two[12], &two[13]], [&one[3], &one[4]], "one-way beside it");
        assert_eq!(
            [&two[3], &two[4]],
            [&seen[3], &seen[4]],
            "the forces that were wanted and found in pass 2"
        );
        assert!((number(&two[6]) - (number(&two[4]) - number(&two[3]))).abs() < 2e-3, "{two:?}");
    }
    assert!(
        rows(&before)[3][3..5] != rows(&after)[3][3..5],
        "the second pass changed nothing: the test sees nothing"
    );
    let sto = text(&coupled["fe_forces_no_contact.sto"]);
    let said: f64 = number(sto.lines().last().unwrap().split('\t').next_back().unwrap());
    assert!((said - number(&rows(&after)[3][4])).abs() < 1e-3, "{sto}");
    assert_eq!(coupled["fe_forces_no_contact_one_way.sto"], {
        let sto = text(&one_way["fe_forces_no_contact.sto"]);
        sto.replace("fe_forces_no_contact", "fe_forces_no_contact_one_way").into_bytes()
    });
    let beside = fs::read(folder.path().join("two/one_way/thigh_0001_solids.vtu")).unwrap();
    assert!(beside == one_way["no_contact/thigh_0001_solids.vtu"], "frames of the one-way result");
    let frame = "no_contact/thigh_0001_solids.vtu";
    assert!(coupled[frame] != one_way[frame], "frames of the last pass");
    let run = fs::read_to_string(folder.path().join("two/run.json")).unwrap();
    assert!(run.contains("two-way coupling has not settled"), "{run}");
    let page = fs::read_to_string(folder.path().join("two/report.html")).unwrap();
    assert!(page.contains("one-way: FE, N") && page.contains("two-way coupling has not settled"));
    // One configuration is coupled, not two at once.
    fs::write(folder.path().join("both.toml"), scene.replace("\"none\"", "\"guarded\"")).unwrap();
    let output = sartorius(&["compare", "both.toml", "--two-way", "--contact", "both"], folder.path());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("--contact with"), "{}", text(&output.stderr));
}

/// The contact resultant of a muscle is the sum of what contact does to its nodes, and what its bones have to hold.
#[test]
fn the_contact_resultant_of_a_muscle_is_held_by_its_bones() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\nstress_free = \"heel_strike\"\n\
                 [accuracy]\ncontact_residual_n = 0.1\n[[step]]\nname = \"heel_strike\"\n";
    let scene = Scene::parse(Path::new("mine.toml"), scene, None).unwrap();
    let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
    let with = PerConfiguration { without: false, with: true };
    let comparison = prepared.solve(with, &folder.path().join("out"), false, &mut |_| ()).unwrap();
    let result = comparison.solutions.with.as_ref().unwrap();
    let plan = &result.plan;
    let frame = result.at_steps().next().expect("solved");
    let total = nodal_forces(plan, frame.snapshot());
    let mut pushes = vec![Vector3::zeros(); plan.mesh.points.len()];
    for island in &plan.islands {
        let x: Vec<f64> =
            island.nodes.iter().flat_map(|&n| frame.x[3 * n as usize..][..3].to_vec()).collect();
        let gradient = island.contact_gradient(&x).expect("an island in contact");
        for (&n, g) in island.nodes.iter().zip(gradient.chunks_exact(3)) {
            pushes[n as usize] -= Vector3::from_column_slice(g);
        }
    }
    let rows = explain(plan, &comparison.thigh, &comparison.calibration, &prepared.steps[0], frame);
    assert_eq!(rows.len(), 2);
    for (row, muscle) in rows.iter().zip(&comparison.thigh.muscles) {
        let nodes = muscle.first_node..muscle.first_node + muscle.s.len() as u32 * muscle.nodes_per_layer;
        let push: Vector3<f64> = nodes.map(|n| pushes[n as usize]).sum();
        let said = row.contact.unwrap();
        assert!(push.norm() > 5.0, "{}: {said} N, the test sees nothing", muscle.name);
        assert!((said - push.norm()).abs() < 1e-6 * push.norm(), "{}: {said} and {push}", muscle.name);
        // In equilibrium the bones, tendons included, hold what contact pushes; the solution ends at 0.1 N.
        let own = format!("{}/", muscle.name);
        let ties = comparison.thigh.scene.ties.iter().filter(|t| t.nodes.starts_with(&own));
        let tied = ties.flat_map(|t| &plan.mesh.node_sets[&t.nodes]);
        let held: Vector3<f64> =
            tied.map(|&n| Vector3::from_column_slice(&total[3 * n as usize..][..3])).sum();
        assert!((held + push).norm() < 1.0, "{}: held {held}, pushed {push}", muscle.name);
    }
}

/// Cheap contact penetrates: that is how it works and no reason to call a run not solved.
#[test]
fn what_cheap_contact_penetrates_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\n\
                 [effects]\ncontact = \"cheap\"\n[[step]]\nname = \"heel_strike\"\n";
    fs::write(folder.path().join("cheap.toml"), scene).unwrap();
    let done = sartorius(&["compare", "cheap.toml", "--contact", "with"], folder.path());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
}
