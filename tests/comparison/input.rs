//! What a scene may say, and what is refused.

use super::parse;
use coupling::comparison::Prepared;
use coupling::scene::StepName;
use coupling::scene::StressFree;
use coupling::scene::{Fibres, Scene};
use fem::scene::{ContactMode, LawSpec};
use std::fs;
use std::path::Path;
use support::{sartorius, text};

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
