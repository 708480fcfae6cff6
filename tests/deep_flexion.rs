//! `step deep_flexion`: does the patella of a real knee go through deep flexion in equilibrium, and is what cannot be computed refused?

use std::collections::HashMap;
use std::path::Path;

use fem::mesh::LengthUnit;
use fem::mesh::format::vtu::{self, Vtu};
use support::{sartorius, shared};

/// What is left of forces \[N\] and moments \[N mm\] on the patella at most.
const LEFT: [f64; 2] = [0.01, 0.1];

/// Columns of a table by their names.
fn columns(file: &Path) -> HashMap<String, Vec<f64>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let names = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let column = |c: usize| rows.iter().map(|row| row[c].parse().unwrap()).collect();
    names.iter().enumerate().map(|(c, name)| (name.to_string(), column(c))).collect()
}

#[test]
fn the_patella_of_a_real_knee_goes_through_deep_flexion() {
    let (Some(_), Some(data)) = (shared("reference/deep"), shared("anatomy")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let bend = |threads: &str| {
        let arguments = [
            "step",
            "deep_flexion",
            "--data",
            data.to_str().unwrap(),
            "--threads",
            threads,
            "--out",
            threads,
        ];
        let output = sartorius(&arguments, folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        folder.path().join(threads)
    };
    let [one, two] = ["1", "2"].map(bend);
    for file in ["patella.csv", "measured.csv"] {
        let bytes = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
        assert!(bytes(&one) == bytes(&two), "{file} on one and on two threads");
    }
    let of = columns(&one.join("patella.csv"));
    let flexion = &of["knee_flexion_deg"];
    assert_eq!((flexion.len(), flexion[0], flexion[55]), (56, 0.0, 137.5));
    for k in 0..56 {
        assert!(of["left_force_N"][k] < LEFT[0] && of["left_moment_Nmm"][k] < LEFT[1], "frame {k}");
        // 200 N of the quadriceps against a groove: no contact is a patella that has left it.
        assert!(
            (50.0..400.0).contains(&of["contact_force_N"][k]),
            "frame {k}: {} N",
            of["contact_force_N"][k]
        );
    }
    // Published: 0.6 to 0.8 of the flexion of the knee.
    let at = |degrees: f64| flexion.iter().position(|f| *f == degrees).unwrap();
    let gain = (of["patella_flexion_deg"][at(90.0)] - of["patella_flexion_deg"][at(0.0)]) / 90.0;
    assert!((0.6..0.8).contains(&gain), "{gain}");
    // RMSD against the measured poses, as wanted.
    let measured = columns(&one.join("measured.csv"));
    for (name, most) in [
        ("flexion_deg", 5.0),
        ("rotation_deg", 1.5),
        ("medial_tilt_deg", 3.0),
        ("anterior_mm", 3.5),
        ("proximal_mm", 2.0),
        ("lateral_mm", 2.0),
    ] {
        let [found, wanted] =
            [format!("patella_{name}"), format!("measured_patella_{name}")].map(|n| &measured[&n]);
        let squared: f64 = found.iter().zip(wanted).map(|(f, w)| (f - w).powi(2)).sum();
        let rmsd = (squared / found.len() as f64).sqrt();
        assert!(found.len() >= 8 && rmsd < most, "{name}: {rmsd}");
    }
    // Frames: one per row, strands with their tension, the patella where the table has it.
    let series = std::fs::read_to_string(one.join("frames/knee.pvd")).unwrap();
    assert_eq!(series.matches("name=\"strands\"").count(), 56);
    let Vtu { mesh, cell_data, .. } =
        vtu::read(&one.join("frames/knee_0055_strands.vtu"), LengthUnit::Metre).unwrap();
    let tension = cell_data.iter().find(|f| f.name == "tension_N").unwrap();
    assert_eq!(mesh.blocks.len(), 17);
    let mut first = 0;
    for block in &mesh.blocks {
        let said = of[&format!("{}_N", block.name)][55];
        assert!((tension.values[first] - said).abs() < 1e-6 * said.abs().max(1.0), "{}", block.name);
        first += block.n_cells();
    }
    assert!(one.join("frames/femur.pvd").is_file());
    assert!(std::fs::read_to_string(one.join("report.html")).unwrap().contains("retinaculum medial 1"));
}

#[test]
fn what_cannot_be_bent_is_refused_with_all_its_mistakes() {
    let folder = tempfile::tempdir().unwrap();
    let said = |data: &str| {
        let output = sartorius(&["step", "deep_flexion", "--data", data], folder.path());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).to_string())
    };
    let (code, text) = said(".");
    assert_eq!(code, Some(2), "{text}");
    for file in ["knee_model.json", "tibia_path_deep.csv", "dynamic_mri_knee.csv"] {
        assert!(text.contains(file), "{file}: {text}");
    }
    let (Some(tables), Some(knee)) = (shared("reference/deep"), shared("anatomy/knee")) else { return };
    std::os::unix::fs::symlink(knee.canonicalize().unwrap(), folder.path().join("knee")).unwrap();
    std::fs::create_dir(folder.path().join("deep")).unwrap();
    let copy = |name: &str, change: &dyn Fn(String) -> String| {
        let text = std::fs::read_to_string(tables.join(name)).unwrap();
        std::fs::write(folder.path().join("deep").join(name), change(text)).unwrap();
    };
    copy("dynamic_mri_knee.csv", &|text| text);
    // Row 3 turned by 60 degrees from its neighbours, row 5 with the tibia 20 mm up in the femur.
    let spoilt = |row: usize, column: usize, value: &'static str| {
        move |text: String| -> String {
            let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
            let mut cells: Vec<String> = lines[row].split(',').map(str::to_string).collect();
            cells[column] = value.into();
            lines[row] = cells.join(",");
            lines.join("\n") + "\n"
        }
    };
    copy("tibia_path_deep.csv", &spoilt(3, 2, "60.0"));
    let (code, text) = said(".");
    assert_eq!(code, Some(2), "{text}");
    // Into that row, and out of it.
    assert!(
        text.contains("tibia_path_deep.csv") && text.matches("the tibia turns by").count() == 2,
        "{text}"
    );
    copy("tibia_path_deep.csv", &spoilt(5, 4, "20.0"));
    let (code, text) = said(".");
    assert_eq!(code, Some(2), "{text}");
    assert!(
        text.contains("tibia_path_deep.csv") && text.contains("row 5") && text.contains("overlap"),
        "{text}"
    );
}
