//! `step deep_flexion`: does the patella of a real knee go through deep flexion in equilibrium, and is what cannot be computed refused?

use std::collections::HashMap;
use std::path::Path;

use coupling::knee::deep::DeepFlexion;
use coupling::knee::flexion::{Bent, flex};
use coupling::knee::level::level;
use coupling::knee::muscles::Resolution;
use coupling::knee::rigid::Quadriceps;
use fem::mesh::LengthUnit;
use fem::mesh::format::vtu::{self, Vtu};
use fem::scene::ContactMode;
use fem::solve::Settings;
use nalgebra::Vector3;
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

/// The knee of the folder; none where its data are absent.
fn subject() -> Option<DeepFlexion> {
    let (Some(folder), Some(_)) = (shared("anatomy"), shared("reference/deep")) else { return None };
    Some(DeepFlexion::find(&folder).unwrap())
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

/// The quadriceps as tissue, as coarse as it goes, on two frames: equilibria, nothing through anything by a test that contact has no part
/// in, and the same bytes on one and on two threads.
#[test]
fn a_quadriceps_of_tissue_lies_on_the_femur_and_goes_through_nothing() {
    let Some(subject) = subject() else { return };
    let resolution = Resolution { edge: 14e-3, cell: Some(30e-3) };
    let knee = || subject.knee_with(ContactMode::Guarded, Quadriceps::Tissue(resolution)).unwrap();
    // Beside the reference pose, so that the way there is short.
    let poses = [14.0, 17.0].map(|flexion| subject.path.at(flexion));
    let bend = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| flex(knee(), &poses, 0.0, &Settings::default()))
    };
    let [one, two] = [1, 2].map(bend);
    assert!(one.stopped.is_none(), "{:?}", one.stopped_told());
    let bits = |bent: &Bent| -> Vec<u64> { bent.run.frames[1].x.iter().map(|v| v.to_bits()).collect() };
    assert!(bits(&one) == bits(&two), "on one and on two threads");
    for f in &one.frames {
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(
            norm(f.residual.force) < LEFT[0] && 1e3 * norm(f.residual.moment) < LEFT[1],
            "{:?}",
            f.residual
        );
        let muscles = f.muscles.unwrap();
        assert_eq!(muscles.crossings, [0, 0]);
        assert!(muscles.least_volume > 0.5 && muscles.stress[1] > muscles.stress[0], "{muscles:?}");
        // What pulls is stretched tissue alone: some newtons.
        assert!((0.0..20.0).contains(&f.contact.force.norm()), "{}", f.contact.force.norm());
    }
    assert!(one.frames[1].muscles.unwrap().stress[0] > one.frames[0].muscles.unwrap().stress[0]);
    // The test of crossings sees what it should: the same nodes with the femur pushed 4 mm forward into them.
    let muscles = one.knee.muscles.as_ref().unwrap();
    let pushed: Vec<f64> = one.run.frames[1].x.chunks(3).flat_map(|p| [p[0] - 4e-3, p[1], p[2]]).collect();
    assert!(muscles.through_femur(&pushed) > 0);
}

/// Nothing stands out of the smooth femur: from every point of its level set the way out is free for 3 mm. Along the rim of the cartilage a slope
/// that goes on where the femur turns away has two sides within a millimetre of each other.
#[test]
fn no_fin_stands_on_the_femur() {
    let Some(subject) = subject() else { return };
    let knee = subject.knee(ContactMode::Cheap).unwrap();
    let surface = level(&knee.femur, 0.0, 1e-3);
    let mut thin = 0.0;
    for t in 0..surface.triangles.len() {
        let middle = surface.corners(t).iter().sum::<Vector3<f64>>() / 3.0;
        let inward = -surface.area_vector(t).normalize();
        // 1.5 mm below the surface there is bone, and no way out on the other side.
        let is_out =
            |depth: f64| knee.femur.at(&(middle + depth * inward)).is_some_and(|at| at.distance > 0.0);
        if (1..=6).any(|k| is_out(0.25e-3 * f64::from(k))) {
            thin += surface.area_vector(t).norm();
        }
    }
    println!("{:.2} mm2 of the femur are thinner than 1.5 mm", 1e6 * thin);
    assert!(1e6 * thin < 5.0, "{:.2} mm2", 1e6 * thin);
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
