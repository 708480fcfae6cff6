//! `step deep_flexion`: does the patella of a real knee, and of one that the program makes, go through deep flexion in equilibrium, and is what cannot
//! be computed refused or told?

use std::collections::HashMap;
use std::path::Path;

use coupling::knee::deep::{DeepFlexion, deviations, nrmsd_sum};
use coupling::knee::flexion::{Bent, flex};
use coupling::knee::level::level;
use coupling::knee::muscles::Resolution;
use coupling::knee::pose::{Coordinates, Measured};
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

/// The published bars hold for it, too, and nothing but the program is needed.
#[test]
fn a_made_knee_goes_through_deep_flexion_without_data() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["step", "deep_flexion", "--out", "o"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let out = folder.path().join("o");
    let of = columns(&out.join("patella.csv"));
    let flexion = &of["knee_flexion_deg"];
    assert_eq!((flexion.len(), flexion[0], flexion[55]), (56, 0.0, 137.5));
    for k in 0..56 {
        assert!(of["left_force_N"][k] < LEFT[0] && of["left_moment_Nmm"][k] < LEFT[1], "frame {k}");
        let [tilt, shift] =
            ["patella_medial_tilt_deg", "patella_lateral_mm"].map(|c| (of[c][k] - of[c][0]).abs());
        assert!((50.0..400.0).contains(&of["contact_force_N"][k]), "frame {k}: {}", of["contact_force_N"][k]);
        assert!(tilt < 10.0 && shift < 8.0, "frame {k}: {tilt} degrees, {shift} mm");
    }
    let at = |degrees: f64| flexion.iter().position(|f| *f == degrees).unwrap();
    let gain = (of["patella_flexion_deg"][at(90.0)] - of["patella_flexion_deg"][at(0.0)]) / 90.0;
    assert!((0.6..0.8).contains(&gain), "{gain}");
    assert!(!out.join("measured.csv").exists() && out.join("frames/knee.pvd").is_file());
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("the knee is made by the program") && !page.contains("points: measured"));
}

/// What a knee took stands beside how far its patella is from that of the most detailed one; a knee that a killed run has finished is taken over.
#[test]
fn knees_are_laid_beside_each_other_over_the_time_that_they_take() {
    let folder = tempfile::tempdir().unwrap();
    let cost = |more: &[&str]| {
        let asked = ["cost", "deep_flexion", "--out", "o"];
        sartorius(&asked.iter().chain(more).copied().collect::<Vec<_>>(), folder.path())
    };
    for (more, words) in [
        (&["--only", "deep_flexion_fool"][..], ["no knee", "did you mean `deep_flexion_full`"]),
        (&["--scene", "walker"], ["bends knees", "without --scene"]),
    ] {
        let output = cost(more);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
    let (out, only) = (folder.path().join("o"), ["--only", "deep_flexion"]);
    let output = cost(&only);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let table = || std::fs::read_to_string(out.join("cost.csv")).unwrap();
    let first = table();
    let row: Vec<&str> = first.lines().nth(1).unwrap().split(',').collect();
    // It is its own reference.
    assert!(row[0] == "deep_flexion" && row[3].parse::<f64>().unwrap() > 0.0, "{first}");
    assert_eq!(row[9..15], ["0"; 6], "{first}");
    // Another patella in the tables of the run that was killed: the same seconds, and where it was put.
    let patella = out.join("rungs/deep_flexion/patella.csv");
    let moved = std::fs::read_to_string(&patella).unwrap().replacen("\n0,", "\n1,", 1);
    std::fs::write(&patella, moved).unwrap();
    std::fs::remove_file(out.join("run.json")).unwrap();
    assert_eq!(cost(&[&only[..], &["--resume"]].concat()).status.code(), Some(0));
    assert_eq!(table(), first);
    assert!(std::fs::read_to_string(&patella).unwrap().contains("\n1,"));
    // Without --resume it is bent anew.
    assert_eq!(cost(&only).status.code(), Some(0));
    assert!(std::fs::read_to_string(&patella).unwrap().contains("\n0,"));
}

/// Guarded, no triangle of the cartilage of its patella goes through one of its femur, and the cartilages of its tibia overlap by no more than is
/// allowed.
#[test]
fn surfaces_of_a_made_knee_go_through_nothing() {
    let made = DeepFlexion::made().unwrap();
    let knee = made.knee(ContactMode::Guarded).unwrap();
    made.check_poses(&knee.femur).unwrap();
    let poses: Vec<Coordinates> = made.poses(0.0).into_iter().step_by(5).collect();
    let bent = flex(knee, &poses, 200.0, &Settings::default());
    assert!(bent.stopped.is_none(), "{:?}", bent.stopped_told());
    let crossings = made.crossings(&bent.patellas());
    assert!(crossings.len() == poses.len() && crossings.iter().all(|n| *n == 0), "{crossings:?}");
    // The test of crossings sees what it should: the patella 2 mm back.
    let mut pushed = bent.frames[0].patella;
    pushed.place[0] -= 2.0;
    assert!(made.crossings(&[pushed])[0] > 0);
}

/// Every measured pose twice in a row: the second time nothing has moved, so the patella stays. A failed trial that left strings on another way took
/// it elsewhere.
#[test]
fn a_pose_that_comes_twice_finds_the_patella_where_it_was() {
    let Some(subject) = subject() else { return };
    let rows: Vec<Coordinates> = subject.measured.rows.iter().map(|row| row[0]).collect();
    let twice: Vec<Coordinates> = rows.iter().flat_map(|row| [*row; 2]).collect();
    let bend = |poses: &[Coordinates]| {
        let bent = flex(subject.knee(ContactMode::Cheap).unwrap(), poses, 50.0, &Settings::default());
        assert!(bent.stopped.is_none(), "{:?}", bent.stopped_told());
        bent.frames
    };
    let (once, twice) = (bend(&rows), bend(&twice));
    for (k, frame) in once.iter().enumerate() {
        for again in &twice[2 * k..2 * k + 2] {
            let [turn, shift] = again.step_from(frame);
            assert!(turn < 0.01 && shift < 0.01, "row {k}: {turn} degrees, {shift} mm");
        }
    }
}

/// Where the mean of the measured values is zero there is no deviation over it, and no sum.
#[test]
fn a_mean_of_zero_has_no_deviation_over_it() {
    let made = DeepFlexion::made().unwrap();
    let poses = &made.poses(0.0)[..2];
    let bent = flex(made.knee(ContactMode::Cheap).unwrap(), poses, 200.0, &Settings::default());
    let rows = |tilt: [f64; 2]| {
        let row = |k: usize| [poses[k], Coordinates { turn_y: tilt[k], ..bent.frames[k].patella }];
        Measured { rows: vec![row(0), row(1)], lines: vec![2, 3], frames: Vec::new() }
    };
    // Also where what is left of the mean is round-off: 0.1 and 0.2 and -0.3.
    for tilt in [[-3.0, 3.0], [0.1 + 0.2, -0.3]] {
        let none = deviations(&bent.frames, &rows(tilt));
        assert!(none[2].rmsd > 0.1 && none[2].nrmsd.is_none() && nrmsd_sum(&none).is_none(), "{none:?}");
    }
    let some = deviations(&bent.frames, &rows([1.0, 3.0]));
    assert_eq!(nrmsd_sum(&some), some[2].nrmsd);
}

/// A tibia that is moved aside takes the patella out of its groove, and a quadriceps of twelve kilonewtons stretches the ligament beyond what any
/// bears: both are told, with where.
#[test]
fn what_no_knee_does_is_told() {
    let made = DeepFlexion::made().unwrap();
    let moved = |by: [f64; 3]| -> Vec<Coordinates> {
        let poses = made.poses(20.0).into_iter().take(10).enumerate();
        let part = |k: usize| (k + 1) as f64 / 10.0;
        poses
            .map(|(k, p)| Coordinates { place: std::array::from_fn(|c| p.place[c] + part(k) * by[c]), ..p })
            .collect()
    };
    let bend =
        |by: [f64; 3]| flex(made.knee(ContactMode::Cheap).unwrap(), &moved(by), 200.0, &Settings::default());
    let aside = bend([0.0, 0.0, 120.0]);
    let told = aside.stopped_told().expect("no patella stays in its groove so");
    for word in ["groove", "flexion", "left on the patella", "contact", "patellar_ligament_central_1"] {
        assert!(told.contains(word), "{word}: {told}");
    }
    // 12 kN of the quadriceps, sixty times what is meant.
    let torn =
        flex(made.knee(ContactMode::Cheap).unwrap(), &made.poses(0.0)[..2], 12e3, &Settings::default());
    assert!(torn.stopped.is_none(), "{:?}", torn.stopped_told());
    let stretched = torn.stretched();
    assert!(
        stretched.iter().any(|(name, strain, _)| name.contains("ligament") && *strain > 0.3),
        "{stretched:?}"
    );
}

/// The quadriceps as tissue, as coarse as it goes, on two frames: equilibria, nothing through anything by a test that contact has no part
/// in, and the same bytes on one and on two threads.
#[test]
fn a_quadriceps_of_tissue_lies_on_the_femur_and_goes_through_nothing() {
    let subject = DeepFlexion::made().unwrap();
    let resolution = Resolution { edge: 14e-3, cell: Some(30e-3) };
    let knee = || subject.knee_with(ContactMode::Guarded, Quadriceps::Tissue(resolution)).unwrap();
    // Beside the reference pose, so that the way there is short.
    let poses = [2.0, 5.0].map(|flexion| subject.path.at(flexion));
    let bend = |threads: usize, poses: &[Coordinates]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| flex(knee(), poses, 0.0, &Settings::default()))
    };
    let (one, two) = (bend(1, &poses), bend(2, &poses[..1]));
    assert!(one.stopped.is_none(), "{:?}", one.stopped_told());
    let bits = |bent: &Bent| -> Vec<u64> { bent.run.frames[0].x.iter().map(|v| v.to_bits()).collect() };
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
        assert!(f.least_det_f > 0.0 && f.least_det_f < 1.0, "{}", f.least_det_f);
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
