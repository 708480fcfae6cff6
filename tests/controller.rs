//! Does a unit of somebody else drive the thigh, in FMI 2 and in FMI 3, and is what it lacks named?

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use coupling::comparison::{Prepared, Sized};
use coupling::configuration::Configuration;
use coupling::scene::Scene;
use coupling::session::{RigidSession, RigidSide, ThighSession, ThighSide};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const MUSCLES: [&str; 3] = ["adductor_magnus", "semimembranosus", "vastus_lateralis"];
const SCENE: &str = "muscles = [\"adductor_magnus\", \"semimembranosus\", \"vastus_lateralis\"]\nresolution_mm = 20.0\n[effects]\ncontact = \"none\"\n";

/// Compiles the unit of tests/fmi/controller.c; `names` are those of its outputs.
fn unit(folder: &Path, version: u8, names: [&str; 3], declared: &str) -> PathBuf {
    let library = folder.join(format!("controller{version}{}", std::env::consts::DLL_SUFFIX));
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fmi/controller.c");
    // The linker of Rust is a C compiler too.
    let compiled = Command::new(std::env::var_os("CC").unwrap_or("cc".into()))
        .args(["-shared", "-fPIC", "-O1", &format!("-DFMI={version}"), "-o"])
        .arg(&library)
        .arg(source)
        .status()
        .expect("a C compiler, as Rust needs one to link");
    assert!(compiled.success());
    let variable = |(k, name): (usize, &&str)| match version {
        2 => format!(
            "<ScalarVariable name=\"{name}\" valueReference=\"{}\" causality=\"output\"><Real/></ScalarVariable>",
            7 + k
        ),
        _ => format!("<Float64 name=\"{name}\" valueReference=\"{}\" causality=\"output\"/>", 7 + k),
    };
    let variables: String = names.iter().enumerate().map(variable).collect();
    let token = if version == 2 { "guid" } else { "instantiationToken" };
    let xml = format!(
        "<?xml version=\"1.0\"?><fmiModelDescription fmiVersion=\"{declared}\" modelName=\"c\" {token}=\"{{1}}\">\
         <CoSimulation modelIdentifier=\"controller\"/><ModelVariables>{variables}</ModelVariables></fmiModelDescription>"
    );
    let (architecture, system) = (std::env::consts::ARCH, std::env::consts::OS);
    let binaries = match version {
        2 => format!("{system}64"),
        _ => format!("{architecture}-{system}"),
    };
    let file = folder.join(format!("controller{version}.fmu"));
    let mut zip = ZipWriter::new(std::fs::File::create(&file).unwrap());
    let mut add = |name: &str, content: &[u8]| {
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        zip.write_all(content).unwrap();
    };
    add("modelDescription.xml", xml.as_bytes());
    add(
        &format!("binaries/{binaries}/controller{}", std::env::consts::DLL_SUFFIX),
        &std::fs::read(library).unwrap(),
    );
    zip.finish().unwrap();
    file
}

fn compare(folder: &Path, scene: &str, out: &str, more: &[&str]) -> u8 {
    let file = folder.join("mine.toml");
    std::fs::write(&file, scene).unwrap();
    let out = folder.join(out);
    let arguments =
        ["sartorius", "compare", file.to_str().unwrap(), "--quiet", "--out", out.to_str().unwrap()];
    command::cli::run(arguments.iter().chain(more).map(Into::into))
}

#[test]
fn a_unit_of_somebody_else_drives_the_thigh() {
    let folder = tempfile::tempdir().unwrap();
    let parsed = || Scene::parse(Path::new("mine.toml"), SCENE, None).unwrap();
    // The same activations given to the thigh by hand.
    let prepared = Prepared::new(parsed(), None, &mut |_| ()).unwrap();
    let steps = prepared.steps.clone();
    let side =
        ThighSide::new(prepared, Configuration::WithoutContact, None, &folder.path().join("out")).unwrap();
    let rigid = RigidSide::new(Sized::new(parsed(), None).unwrap(), Default::default()).unwrap();
    let start = rigid.times()[0];
    let (mut rigid, mut thigh) = (RigidSession::new(Arc::new(rigid)), ThighSession::new(Arc::new(side)));
    let mut wanted = Vec::new();
    for step in &steps {
        rigid.go_to(step.time).unwrap();
        thigh.set_poses(&rigid.result().unwrap().poses).unwrap();
        let activations = [0.1, 0.2, 0.3].map(|a| a + 0.5 * (step.time - start));
        thigh.set_activations(&activations).unwrap();
        thigh.solve().unwrap();
        for (a, muscle) in activations.iter().zip(&thigh.result().muscles) {
            wanted.push((*a, muscle.section.total));
        }
    }
    for version in [2, 3] {
        let file = unit(folder.path(), version, MUSCLES, &format!("{version}.0"));
        let scene = format!("controller = {:?}\n{SCENE}", file.file_name().unwrap());
        let out = format!("driven{version}");
        assert_eq!(compare(folder.path(), &scene, &out, &[]), 0);
        let table = std::fs::read_to_string(folder.path().join(out).join("comparison.csv")).unwrap();
        let mut reader = csv::Reader::from_reader(table.as_bytes());
        let headers = reader.headers().unwrap().clone();
        let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
        let (a, fe) = (column("activation"), column("fe_no_contact_N"));
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(rows.len(), wanted.len());
        for (row, (activation, force)) in rows.iter().zip(&wanted) {
            let number = |at: usize| row[at].parse::<f64>().unwrap();
            // The unit adds its steps up: activations agree to round-off, forces to what the equilibrium is settled to.
            assert!((number(a) - activation).abs() < 1e-3, "{row:?}: {activation}");
            assert!((number(fe) - force).abs() < 0.2, "{row:?}: {force}");
        }
        assert!(wanted.iter().any(|(_, force)| *force > 100.0), "muscles pull: {wanted:?}");
    }
}

#[test]
fn what_a_unit_lacks_is_named_before_anything_is_solved() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["adductor_magnus", "semimembranosis", "vastus_lateralis"];
    let said = |file: &Path, rows: &[usize]| {
        sartorius_fmi::foreign::activations(file, &MUSCLES, &[0.0, 0.5], rows).unwrap_err().to_string()
    };
    let misspelt = unit(folder.path(), 3, names, "3.0");
    let words = said(&misspelt, &[0]);
    assert!(words.contains("`semimembranosus` (did you mean `semimembranosis`?)"), "{words}");
    assert!(!words.contains("vastus"), "{words}");
    let old = unit(folder.path(), 2, MUSCLES, "1.0");
    assert!(said(&old, &[0]).contains("FMI 1.0; a controller is one for co-simulation of FMI 2 or 3"));
    let text = folder.path().join("text.fmu");
    std::fs::write(&text, "no zip").unwrap();
    assert!(said(&text, &[0]).contains("it is no unit"));
    let good = unit(folder.path(), 2, MUSCLES, "2.0");
    assert_eq!(sartorius_fmi::foreign::activations(&good, &MUSCLES, &[0.0, 0.5], &[1]).unwrap().len(), 1);
    let scene = |controller: &str, more: &str| format!("controller = \"{controller}\"\n{SCENE}{more}");
    assert_eq!(compare(folder.path(), &scene("absent.fmu", ""), "out", &[]), 2);
    assert_eq!(compare(folder.path(), &scene("text.fmu", ""), "out", &[]), 2);
    assert_eq!(compare(folder.path(), &scene("controller2.fmu", "fibres = \"thermal\"\n"), "out", &[]), 2);
    assert_eq!(compare(folder.path(), &scene("controller2.fmu", ""), "out", &["--two-way"]), 2);
    assert!(!folder.path().join("out").join("run.json").exists());
}
