//! What a plan says before anything is solved.

use super::{parse, scenes, shipped};
use coupling::comparison::estimate::{Expected, Work};
use coupling::comparison::{Prepared, Sized};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::Scene;
use coupling::thigh::build::Thigh;
use serde_json::Value;
use std::fs;
use support::{sartorius, shared};

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
