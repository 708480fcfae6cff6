//! Are the files of `optimize` what they claim to be: tables, OpenSim storage files, the page, a killed run?

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use coupling::measured::Overlay;
use coupling::output::run::{RunRecord, RunStatus};
use coupling::output::write_optimize;
use coupling::report::{MuscleInfo, OptimizeReport, Summary, optimize_page};
use multibody::kinematics::ANGLES;
use multibody::natural::{Coordinates, SegmentId};
use multibody::read::KneeForces;
use multibody::sharing::REACTIONS;
use multibody::trial::{
    Effort, FitVerdict, GroundReaction, Loads, MarkerTrack, Motion, Sex, Shortfall, Side, Status, Subject,
    Table, Trial, Verdict,
};
use nalgebra::{DMatrix, SVector, Vector3};

/// Name, full name, strength \[N\] (gait2392), then what only this test needs: when the muscle peaks as a share of
/// the cycle, and at which share of its strength.
#[rustfmt::skip]
const MUSCLES: [(&str, &str, f64, f64, f64); 43] = [
    ("gmax1", "Gluteus maximus, superior part", 573.0, 0.08, 0.35),
    ("gmax2", "Gluteus maximus, middle part", 819.0, 0.08, 0.3),
    ("gmax3", "Gluteus maximus, inferior part", 552.0, 0.06, 0.3),
    ("gmed1", "Gluteus medius, anterior part", 819.0, 0.2, 0.6),
    ("gmed2", "Gluteus medius, middle part", 573.0, 0.18, 0.55),
    ("gmed3", "Gluteus medius, posterior part", 653.0, 0.15, 0.6),
    ("gmin1", "Gluteus minimus, anterior part", 270.0, 0.25, 0.4),
    ("gmin2", "Gluteus minimus, middle part", 285.0, 0.22, 0.35),
    ("gmin3", "Gluteus minimus, posterior part", 323.0, 0.2, 0.3),
    ("addlong", "Adductor longus", 627.0, 0.65, 0.2),
    ("addbrev", "Adductor brevis", 429.0, 0.6, 0.15),
    ("addmag1", "Adductor magnus, superior part", 381.0, 0.05, 0.2),
    ("addmag2", "Adductor magnus, middle part", 343.0, 0.05, 0.2),
    ("addmag3", "Adductor magnus, inferior (ischiocondylar) part", 488.0, 0.03, 0.3),
    ("pect", "Pectineus", 266.0, 0.6, 0.2),
    ("iliacus", "Iliacus", 1073.0, 0.55, 0.55),
    ("psoas", "Psoas major", 1113.0, 0.56, 0.6),
    ("quadfem", "Quadratus femoris", 381.0, 0.1, 0.1),
    ("gem", "Gemelli (superior and inferior)", 164.0, 0.1, 0.2),
    ("piri", "Piriformis", 444.0, 0.15, 0.4),
    ("tfl", "Tensor fasciae latae", 233.0, 0.35, 0.5),
    ("grac", "Gracilis", 162.0, 0.8, 0.3),
    ("sart", "Sartorius", 156.0, 0.65, 0.5),
    ("semimem", "Semimembranosus", 1288.0, 0.03, 0.45),
    ("semiten", "Semitendinosus", 410.0, 0.95, 0.4),
    ("bflh", "Biceps femoris, long head", 896.0, 0.05, 0.4),
    ("bfsh", "Biceps femoris, short head", 804.0, 0.7, 0.4),
    ("recfem", "Rectus femoris", 1169.0, 0.6, 0.35),
    ("vasmed", "Vastus medialis", 1294.0, 0.14, 0.4),
    ("vasint", "Vastus intermedius", 1365.0, 0.14, 0.3),
    ("vaslat", "Vastus lateralis", 1871.0, 0.14, 0.45),
    ("gasmed", "Gastrocnemius, medial head", 1558.0, 0.46, 0.6),
    ("gaslat", "Gastrocnemius, lateral head", 683.0, 0.46, 0.4),
    ("soleus", "Soleus", 3549.0, 0.5, 0.55),
    ("tibpost", "Tibialis posterior", 1588.0, 0.45, 0.9),
    ("tibant", "Tibialis anterior", 905.0, 0.05, 0.4),
    ("perbrev", "Fibularis (peroneus) brevis", 435.0, 0.45, 0.5),
    ("perlong", "Fibularis (peroneus) longus", 943.0, 0.47, 0.6),
    ("pertert", "Fibularis (peroneus) tertius", 180.0, 0.03, 0.3),
    ("extdig", "Extensor digitorum longus", 512.0, 0.06, 0.3),
    ("exthal", "Extensor hallucis longus", 162.0, 0.07, 0.25),
    ("flexdig", "Flexor digitorum longus", 310.0, 0.5, 0.5),
    ("flexhal", "Flexor hallucis longus", 322.0, 0.5, 0.6),];

const FRAMES: usize = 101;
const MARGIN: usize = 10;
const CYCLE: f64 = 1.242;

/// A made-up walking cycle with curves of the usual shape and size, not a solution of any model.
struct Walk {
    trial: Trial,
    motion: Motion,
    loads: Loads,
    effort: Effort,
    muscles: Vec<MuscleInfo>,
    settings: Vec<(String, String)>,
    simulated: Vec<String>,
    left_out: Vec<(String, String)>,
    notes: Vec<String>,
    overlay: Option<Overlay>,
}

/// A bump of height 1 at share `centre` of the cycle, periodic.
fn bump(p: f64, centre: f64, width: f64) -> f64 {
    let d = (p - centre + 0.5).rem_euclid(1.0) - 0.5;
    (-(d / width).powi(2)).exp()
}

fn table(columns: &[&str], rows: usize, value: impl Fn(f64, usize) -> f64, offset: usize) -> Table {
    let share = |i: usize| (i as f64 - offset as f64) / (FRAMES - 1) as f64;
    Table {
        columns: columns.iter().map(|c| c.to_string()).collect(),
        values: DMatrix::from_fn(rows, columns.len(), |i, j| value(share(i), j)),
    }
}

impl Walk {
    fn new() -> Walk {
        let all = FRAMES + 2 * MARGIN;
        let step = CYCLE / (FRAMES - 1) as f64;
        let times: Vec<f64> = (0..all).map(|i| (i as f64 - MARGIN as f64) * step).collect();
        let report = MARGIN..MARGIN + FRAMES;
        let time = times[report.clone()].to_vec();
        let ground = |p: f64| {
            let on = if (0.005..0.64).contains(&p) { 1.0 } else { 0.0 };
            let up =
                690.0 * (0.98 * bump(p, 0.15, 0.12) + 0.9 * bump(p, 0.46, 0.13) + 0.45 * bump(p, 0.3, 0.1));
            on * Vector3::new(-90.0 * bump(p, 0.12, 0.08) + 115.0 * bump(p, 0.53, 0.08), up, -0.06 * up)
        };
        let angles = |p: f64, j: usize| {
            let degrees = match ANGLES[j] {
                "hip_flexion" => 17.0 + 19.0 * (TAU * p).cos(),
                "hip_adduction" => 5.0 * (TAU * (p - 0.2)).cos(),
                "hip_rotation" => 3.0 * (TAU * (p - 0.4)).cos(),
                "knee_flexion" => 6.0 + 19.0 * bump(p, 0.14, 0.08) + 58.0 * bump(p, 0.73, 0.12),
                "knee_adduction" => 1.5 * (TAU * p).sin(),
                "knee_rotation" => 4.0 * bump(p, 0.73, 0.15),
                "ankle_flexion" => -6.0 + 13.0 * bump(p, 0.48, 0.15) - 6.0 * bump(p, 0.66, 0.05),
                "ankle_inversion" => 8.0 - 5.0 * bump(p, 0.3, 0.2),
                "patella_flexion" => 10.0 + 40.0 * bump(p, 0.73, 0.12),
                "pelvis_tilt" => -11.0 + (2.0 * TAU * p).sin(),
                "pelvis_rotation" => 4.0 * (TAU * p).cos(),
                _ => 3.0 * (TAU * p).sin(),
            };
            degrees.to_radians()
        };
        let names: Vec<&str> = MUSCLES.iter().map(|m| m.0).collect();
        let activation = |p: f64, j: usize| {
            let (_, _, _, centre, height) = MUSCLES[j];
            height * (0.97 * bump(p, centre, 0.1) + 0.03)
        };
        let reactions = |p: f64, j: usize| match REACTIONS[j].name {
            "knee_medial" => 60.0 + 1150.0 * bump(p, 0.15, 0.09) + 1300.0 * bump(p, 0.47, 0.1),
            "knee_lateral" => 20.0 + 480.0 * bump(p, 0.16, 0.08) + 350.0 * bump(p, 0.49, 0.09),
            "acl" => 90.0 * bump(p, 0.4, 0.2),
            "pcl" => 140.0 * bump(p, 0.7, 0.1),
            "mcl" => 60.0 * bump(p, 0.5, 0.3),
            "patellar_tendon" => 900.0 * bump(p, 0.14, 0.08),
            "patella_x" => 400.0 * bump(p, 0.14, 0.08),
            "patella_y" => -250.0 * bump(p, 0.14, 0.08),
            "patella_z" => -60.0 * bump(p, 0.14, 0.08),
            "ankle_y" => 50.0 + 1100.0 * bump(p, 0.15, 0.1) + 2900.0 * bump(p, 0.48, 0.1),
            "hip_y" => 300.0 + 1900.0 * bump(p, 0.15, 0.1) + 2100.0 * bump(p, 0.5, 0.1),
            "hip_x" | "ankle_x" => 300.0 * bump(p, 0.5, 0.1) - 200.0 * bump(p, 0.1, 0.1),
            "hip_z" | "ankle_z" => 250.0 * bump(p, 0.3, 0.2),
            "tibia_axial" => 900.0 * bump(p, 0.45, 0.15),
            _ => 100.0 * bump(p, 0.45, 0.15),
        };
        let moments = |p: f64, j: usize| match j {
            0 => 45.0 * bump(p, 0.08, 0.1) - 50.0 * bump(p, 0.55, 0.1),
            1 => -55.0 * bump(p, 0.15, 0.1) - 50.0 * bump(p, 0.46, 0.1),
            2 => 6.0 * bump(p, 0.2, 0.1) - 5.0 * bump(p, 0.5, 0.1),
            3 => 40.0 * bump(p, 0.15, 0.07) - 15.0 * bump(p, 0.42, 0.1),
            4 => 8.0 * bump(p, 0.07, 0.05) - 100.0 * bump(p, 0.5, 0.12),
            _ => 12.0 * bump(p, 0.4, 0.2),
        };
        let fit = (0..all).map(|i| FitVerdict {
            failure: None,
            markers_seen: [4, 3, 0, 3, 4],
            marker_rms: 1e-3 * (4.4 + 1.3 * (i as f64 * 0.21).sin()),
            iterations: 5,
            residual: 1e-12,
            constraint: 1e-12,
        });
        let verdicts = (0..FRAMES).map(|i| Verdict {
            status: Status::Solved,
            reason: None,
            kkt_residual: 1e-11 * (1.0 + (i as f64 * 1.7).sin().powi(2) * 50.0),
            equality_residual: 1e-13 * (1.0 + (i as f64 * 2.3).cos().powi(2) * 9.0),
            iterations: 11 + (i % 4) as u32,
            active_bounds: 24 + i % 7,
            reserve_share: 0.0,
            shortfall: vec![],
            saturated: vec![],
        });
        let ground_force: Vec<_> = (0..FRAMES).map(|i| ground(i as f64 / 100.0)).collect();
        Walk {
            trial: Trial {
                name: "synthetic walk <test>".into(),
                side: Side::Right,
                subject: Subject { mass: 70.0, height: 1.72, sex: Sex::Male },
                time: times.clone(),
                report: report.clone(),
                markers: vec![MarkerTrack {
                    name: "R_Heel".into(),
                    segment: SegmentId::Foot,
                    position: vec![None; all],
                }],
                ground: GroundReaction::default(),
            },
            motion: Motion {
                time: times,
                report,
                Q: vec![Coordinates::zeros(); all],
                Qd: vec![Coordinates::zeros(); all],
                Qdd: vec![Coordinates::zeros(); all],
                angles: table(&ANGLES, all, angles, MARGIN),
                fit: fit.collect(),
            },
            loads: Loads {
                time: time.clone(),
                generalised: vec![SVector::zeros(); FRAMES],
                reduced: vec![None; FRAMES],
                moments: table(&MOMENTS, FRAMES, moments, 0),
                centre_of_pressure: (0..FRAMES)
                    .map(|i| Vector3::new(0.002 * i as f64, 0.0, 0.05) * ground_force[i].y.signum())
                    .collect(),
                free_moment: ground_force.iter().map(|f| Vector3::new(0.0, 0.005 * f.y, 0.0)).collect(),
                ground_force,
            },
            effort: Effort {
                time,
                forces: table(&names, FRAMES, |p, j| MUSCLES[j].2 * activation(p, j), 0),
                activations: table(&names, FRAMES, activation, 0),
                reactions: table(&reaction_names(), FRAMES, reactions, 0),
                reserves: Table { columns: vec![], values: DMatrix::zeros(FRAMES, 0) },
                verdicts: verdicts.collect(),
            },
            muscles: MUSCLES
                .iter()
                .map(|m| MuscleInfo { full_name: m.1.into(), f_max: m.2, clipped: Some(0.0) })
                .collect(),
            settings: vec![
                ("Cost".into(), "Σ f², weights of condition 2".into()),
                ("Ankle".into(), "universal".into()),
            ],
            simulated: vec![
                "43 muscles, bounded by their strength".into(),
                "Knee with sphere-on-plane contacts".into(),
            ],
            left_out: vec![("Reserve moments".into(), "not asked for".into())],
            notes: vec![],
            overlay: None,
        }
    }

    fn report(&self) -> OptimizeReport<'_> {
        OptimizeReport {
            trial: &self.trial,
            motion: &self.motion,
            loads: &self.loads,
            effort: &self.effort,
            muscles: &self.muscles,
            cycle: Some([0.0, CYCLE]),
            settings: &self.settings,
            simulated: &self.simulated,
            left_out: &self.left_out,
            notes: &self.notes,
            measured: self.overlay.as_ref(),
        }
    }

    /// Frames 51 to 53 infeasible, 71 failed, 81 and 82 without marker fit.
    fn spoil(mut self) -> Walk {
        for i in 50..53 {
            let verdict = &mut self.effort.verdicts[i];
            verdict.status = Status::Infeasible;
            verdict.reason = Some("the loads exceed the strength".into());
            verdict.shortfall = vec![Shortfall { coordinate: "ankle_flexion".into(), missing: -12.34 }];
            verdict.saturated = vec!["soleus".into(), "gasmed".into()];
        }
        self.effort.verdicts[70].status = Status::Failed;
        self.effort.verdicts[70].reason = Some("iteration limit".into());
        self.effort.verdicts[70].kkt_residual = f64::NAN;
        for table in [&mut self.effort.forces, &mut self.effort.activations, &mut self.effort.reactions] {
            table.values.row_mut(70).fill(f64::NAN);
        }
        for i in 80..82 {
            self.motion.fit[MARGIN + i].failure = Some("thigh: 1 of 3 markers seen".into());
        }
        self.muscles[0].clipped = Some(0.125);
        self
    }

    fn with_measured_knee(mut self) -> Walk {
        let time: Vec<f64> = (0..160).map(|i| i as f64 / 120.0).collect();
        let p = |t: &f64| t / CYCLE;
        let medial = time
            .iter()
            .map(|t| 100.0 + 900.0 * bump(p(t), 0.17, 0.1) + 1050.0 * bump(p(t), 0.49, 0.1))
            .collect();
        let lateral = time
            .iter()
            .map(|t| 60.0 + 500.0 * bump(p(t), 0.16, 0.1) + 300.0 * bump(p(t), 0.5, 0.1))
            .collect();
        let measured = KneeForces { time, medial, lateral };
        self.overlay = Some(Overlay::new(&measured, &self.effort, self.trial.subject.mass).unwrap());
        self
    }
}

/// The coordinates of the leg with the universal ankle.
const MOMENTS: [&str; 6] =
    ["hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion", "ankle_flexion", "subtalar_inversion"];

/// The names that the model gives its reactions, both ankles together.
fn reaction_names() -> Vec<&'static str> {
    REACTIONS.iter().map(|reaction| reaction.name).collect()
}

fn write(walk: &Walk, folder: &Path) -> Vec<String> {
    write_optimize(folder, &walk.report(), RunRecord::new("optimize")).unwrap()
}

/// Header and rows of a CSV file.
fn csv(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().iter().map(String::from).collect();
    (header, reader.records().map(|row| row.unwrap().iter().map(String::from).collect()).collect())
}

#[test]
fn tables_have_the_promised_columns_and_give_back_the_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let walk = Walk::new().spoil();
    write(&walk, dir.path());
    let suffixed =
        |names: &[&str], suffix: &str| names.iter().map(|n| format!("{n}{suffix}")).collect::<Vec<_>>();
    let muscles: Vec<&str> = MUSCLES.iter().map(|m| m.0).collect();
    let expected = BTreeMap::from([
        ("kinematics", [suffixed(&ANGLES, "_deg"), vec!["marker_rms_mm".into()]].concat()),
        ("muscle_forces", suffixed(&muscles, "_N")),
        ("activations", suffixed(&muscles, "")),
        ("joint_forces", suffixed(&reaction_names(), "_N")),
        ("joint_moments", suffixed(&MOMENTS, "_Nm")),
        (
            "ground_reaction",
            [
                suffixed(&["force_x", "force_y", "force_z"], "_N"),
                suffixed(&["centre_of_pressure_x", "centre_of_pressure_y", "centre_of_pressure_z"], "_m"),
                suffixed(&["free_moment_x", "free_moment_y", "free_moment_z"], "_Nm"),
            ]
            .concat(),
        ),
    ]);
    for (stem, columns) in expected {
        let (header, rows) = csv(&dir.path().join(format!("{stem}.csv")));
        assert_eq!(header[0], "time_s", "{stem}");
        assert_eq!(header[1..], columns, "{stem}");
        assert_eq!(rows.len(), FRAMES, "{stem}");
        for (row, time) in rows.iter().zip(&walk.effort.time) {
            assert_eq!(row[0].parse::<f64>().unwrap(), *time, "{stem}");
        }
    }
    let (_, forces) = csv(&dir.path().join("muscle_forces.csv"));
    let (_, angles) = csv(&dir.path().join("kinematics.csv"));
    for i in 0..FRAMES {
        for j in 0..MUSCLES.len() {
            let wanted = walk.effort.forces.values[(i, j)];
            match forces[i][j + 1].as_str() {
                "" => assert_eq!(i, 70, "only the failed frame is empty"),
                text => assert_eq!(text.parse::<f64>().unwrap(), wanted, "frame {i}, muscle {j}"),
            }
        }
        let hip = &angles[i][1];
        let wanted = walk.motion.angles.values[(MARGIN + i, 0)].to_degrees();
        assert_eq!(
            *hip,
            if (80..82).contains(&i) { String::new() } else { format!("{wanted:?}") },
            "frame {i}"
        );
    }
}

#[test]
fn verdicts_keep_status_and_reason_of_every_frame() {
    let dir = tempfile::tempdir().unwrap();
    write(&Walk::new().spoil(), dir.path());
    let (header, rows) = csv(&dir.path().join("verdicts.csv"));
    let promised = [
        "time_s",
        "status",
        "kkt_residual",
        "equality_residual",
        "iterations",
        "active_bounds",
        "reserve_share",
    ];
    assert_eq!(header[..promised.len()], promised);
    let status: Vec<&str> = rows.iter().map(|row| row[1].as_str()).collect();
    assert_eq!(status[49..54], ["solved", "infeasible", "infeasible", "infeasible", "solved"]);
    assert_eq!((status[70], rows[70][2].as_str()), ("failed", ""));
    assert!(rows[51].contains(&"ankle_flexion=-12.34".to_string()), "{:?}", rows[51]);
    assert!(rows[51].contains(&"soleus gasmed".to_string()), "{:?}", rows[51]);
    assert!(rows[80].contains(&"thigh: 1 of 3 markers seen".to_string()), "{:?}", rows[80]);
}

#[test]
fn storage_files_say_truly_how_large_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let walk = Walk::new().spoil();
    write(&walk, dir.path());
    for (stem, columns, degrees) in
        [("kinematics", ANGLES.len(), "yes"), ("muscle_forces", 43, "no"), ("activations", 43, "no")]
    {
        let text = fs::read_to_string(dir.path().join(format!("{stem}.sto"))).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let end = lines.iter().position(|l| *l == "endheader").unwrap();
        let header: BTreeMap<_, _> = lines[1..end].iter().map(|l| l.split_once('=').unwrap()).collect();
        assert_eq!(header["nRows"], FRAMES.to_string(), "{stem}");
        assert_eq!(header["nColumns"], (columns + 1).to_string(), "{stem}");
        assert_eq!((header["inDegrees"], header["version"]), (degrees, "1"), "{stem}");
        assert_eq!(lines[end + 1].split('\t').next(), Some("time"), "{stem}");
        assert_eq!(lines.len() - end - 2, FRAMES, "{stem}");
        for line in &lines[end + 1..] {
            assert_eq!(line.split('\t').count(), columns + 1, "{stem}: {line}");
        }
        for line in &lines[end + 2..] {
            assert!(
                line.split('\t').all(|cell| cell == "nan" || cell.parse::<f64>().is_ok()),
                "{stem}: {line}"
            );
        }
    }
    let forces = fs::read_to_string(dir.path().join("muscle_forces.sto")).unwrap();
    assert!(forces.contains("\ntime\tgmax1\t"), "OpenSim knows muscles by their bare names");
}

#[test]
fn run_json_counts_the_frames_and_is_the_only_file_with_times() {
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let walk = Walk::new().spoil();
    let files = write(&walk, a.path());
    let mut slow = RunRecord::new("optimize");
    slow.status = RunStatus::NotConverged;
    slow.stage("read", Duration::from_millis(1500));
    slow.stage("fit", Duration::from_millis(250));
    write_optimize(b.path(), &walk.report(), slow).unwrap();
    assert_eq!(files.last().map(String::as_str), Some("run.json"));
    for file in &files {
        let same = fs::read(a.path().join(file)).unwrap() == fs::read(b.path().join(file)).unwrap();
        assert_eq!(same, file != "run.json", "{file}");
    }
    let run: serde_json::Value =
        serde_json::from_slice(&fs::read(b.path().join("run.json")).unwrap()).unwrap();
    assert_eq!(run["status"], "not_converged");
    assert_eq!(run["seconds"]["read"], 1.5);
    assert!(run["seconds"]["write"].as_f64().unwrap() >= 0.0);
    assert_eq!(run["files"].as_array().unwrap().len(), files.len() - 1);
    let verdict = &run["verdict"];
    let counts =
        ["frames", "solved", "infeasible", "failed", "not_fitted"].map(|k| verdict[k].as_u64().unwrap());
    assert_eq!(counts, [101, 95, 3, 1, 2]);
}

#[test]
fn the_summary_finds_the_peaks() {
    let mut walk = Walk::new();
    let [medial, lateral] = ["knee_medial", "knee_lateral"]
        .map(|name| REACTIONS.iter().position(|reaction| reaction.name == name).unwrap());
    for i in 0..FRAMES {
        walk.effort.reactions.values[(i, medial)] = 100.0 + i as f64;
        walk.effort.reactions.values[(i, lateral)] = 50.0;
        walk.motion.fit[MARGIN + i].marker_rms = if i % 2 == 0 { 3e-3 } else { 5e-3 };
    }
    walk.motion.fit[0].marker_rms = 1.0; // outside the reported frames
    walk.effort.reactions.values[(30, lateral)] = 9000.0; // but not solved
    walk.effort.verdicts[30].status = Status::Infeasible;
    let tibpost = MUSCLES.iter().position(|m| m.0 == "tibpost").unwrap();
    walk.effort.forces.values[(40, tibpost)] = 1.5 * MUSCLES[tibpost].2;
    let s = Summary::of(&walk.report());
    let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-9 * b;
    assert!(close(s.peak_knee_force_N, 250.0), "{s:?}");
    assert!(close(s.peak_knee_force_bw, 250.0 / (70.0 * 9.80665)), "{s:?}");
    assert_eq!(s.peak_knee_force_time_s, Some(walk.effort.time[100]));
    assert!(close(s.marker_rms_mm, ((51.0 * 9.0 + 50.0 * 25.0) / 101.0_f64).sqrt()), "{s:?}");
    assert!(close(s.worst_marker_rms_mm, 5.0), "{s:?}");
    assert!(close(s.largest_load, 1.5), "{s:?}");
    assert_eq!(s.largest_load_muscle.as_deref(), Some("tibpost"));
    assert_eq!((s.solved, s.infeasible, s.all_solved()), (100, 1, false));
}

/// Every opening tag is closed in order, every attribute is quoted; returns tag name and attributes of each.
fn parse_html(page: &str) -> Vec<(String, BTreeMap<String, String>)> {
    const VOID: [&str; 2] = ["meta", "br"];
    let mut open: Vec<String> = Vec::new();
    let mut found = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").expect("doctype");
    while let Some(at) = rest.find('<') {
        assert!(!rest[..at].contains('>'), "stray > before {}", &rest[at..rest.len().min(at + 60)]);
        rest = &rest[at + 1..];
        if let Some(closing) = rest.strip_prefix('/') {
            let (name, after) = closing.split_once('>').expect("closing tag ends");
            assert_eq!(open.pop().as_deref(), Some(name), "closing tags are in order");
            rest = after;
            continue;
        }
        let name_end = rest.find(|c: char| !c.is_ascii_alphanumeric()).expect("tag ends");
        let name = rest[..name_end].to_string();
        assert!(!name.is_empty(), "stray < before {}", &rest[..rest.len().min(60)]);
        rest = rest[name_end..].trim_start();
        let mut attributes = BTreeMap::new();
        let closed = loop {
            if let Some(after) = rest.strip_prefix("/>") {
                rest = after;
                break true;
            }
            if let Some(after) = rest.strip_prefix('>') {
                rest = after;
                break false;
            }
            let end = rest.find(['=', ' ', '>']).expect("attribute ends");
            let key = rest[..end].to_string();
            rest = &rest[end..];
            let mut value = String::new();
            if let Some(after) = rest.strip_prefix("=\"") {
                let (text, after) = after.split_once('"').expect("quote ends");
                value = text.into();
                rest = after;
            } else {
                assert!(!rest.starts_with('='), "unquoted attribute {key} of {name}");
            }
            assert!(attributes.insert(key.clone(), value).is_none(), "{key} twice in {name}");
            rest = rest.trim_start();
        };
        if name == "style" || name == "script" {
            let end = rest.find(&format!("</{name}>")).expect("raw text ends");
            rest = &rest[end..];
        }
        if !closed && !VOID.contains(&name.as_str()) {
            open.push(name.clone());
        }
        found.push((name, attributes));
    }
    assert!(open.is_empty(), "left open: {open:?}");
    found
}

/// Well formed, self-contained, and all geometry is numbers.
fn check_page(page: &str) -> Vec<(String, BTreeMap<String, String>)> {
    for fetch in ["http://", "https://", "url(", "@import", "<link", " src=", "<img", "<iframe"] {
        assert!(!page.contains(fetch), "the page fetches something: {fetch}");
    }
    let tags = parse_html(page);
    for (name, attributes) in &tags {
        for key in
            ["d", "x", "y", "width", "height", "viewBox", "data-frame", "data-domain", "stroke-opacity"]
        {
            if name == "meta" {
                continue;
            }
            let Some(value) = attributes.get(key) else { continue };
            for number in value.split(|c: char| "MLHhvVZ ".contains(c)).filter(|n| !n.is_empty()) {
                assert!(number.parse::<f64>().is_ok_and(f64::is_finite), "{name} {key}: {number} in {value}");
            }
        }
    }
    tags
}

fn classed<'a>(
    tags: &'a [(String, BTreeMap<String, String>)],
    class: &'a str,
) -> impl Iterator<Item = &'a BTreeMap<String, String>> {
    tags.iter()
        .map(|(_, a)| a)
        .filter(move |a| a.get("class").is_some_and(|c| c.split(' ').any(|w| w == class)))
}

#[test]
fn the_page_is_whole_and_draws_every_muscle() {
    let walk = Walk::new();
    let page = optimize_page(&walk.report());
    let tags = check_page(&page);
    assert!(page.contains("101 of 101 frames solved"));
    assert!(page.contains("synthetic walk &lt;test&gt;") && !page.contains("walk <test>"));
    let curves: Vec<&str> =
        classed(&tags, "line").filter_map(|a| a.get("data-name")).map(String::as_str).collect();
    for (name, ..) in MUSCLES {
        assert_eq!(curves.iter().filter(|c| **c == name).count(), 1, "{name}");
    }
    let rows: Vec<_> = classed(&tags, "row").collect();
    assert_eq!(rows.len(), 43);
    assert!(rows.iter().all(|row| row["data-values"].split(',').count() == FRAMES));
    for curve in ["medial", "lateral", "total", "ACL", "tendon", "resultant", "KKT", "residual"] {
        assert!(curves.contains(&curve), "{curve} is not drawn");
    }
    assert!(page.contains("% of gait cycle"));
    // Strengths on the scale of their figure (those of at most twice the peak), and the tolerance of the residuals.
    assert_eq!(classed(&tags, "bound").count(), MUSCLES.iter().filter(|m| m.4 >= 0.5).count() + 1);
    // While the foot swings there is no centre of pressure; the made-up one moves 2 mm per frame.
    let travel = classed(&tags, "line").find(|a| a.get("data-name").is_some_and(|n| n == "forward")).unwrap();
    let stance = walk.loads.ground_force.iter().filter(|f| f.y > 20.0).count();
    assert!((50..FRAMES).contains(&stance));
    assert_eq!(travel["d"].matches(['M', 'L']).count(), stance);
    let mut no_cycle = walk.report();
    no_cycle.cycle = None;
    let page = optimize_page(&no_cycle);
    check_page(&page);
    assert!(!page.contains("% of gait cycle</text>") && page.contains("time, s"));
}

/// The inverse of the drawing: a curve's height in the figure gives back its value.
#[test]
fn curves_are_drawn_where_the_axes_say() {
    let walk = Walk::new();
    let page = optimize_page(&walk.report());
    let at = page.find("data-name=\"soleus\" d=\"").expect("soleus is drawn");
    let start = page[..at].rfind("<svg").unwrap();
    let tags = parse_html(&format!(
        "<!DOCTYPE html>{}</svg>",
        &page[start..at + page[at..].find("</svg>").unwrap()]
    ));
    let numbers = |text: &str| text.split(' ').map(|n| n.parse().unwrap()).collect::<Vec<f64>>();
    let (frame, domain) = (numbers(&tags[0].1["data-frame"]), numbers(&tags[0].1["data-domain"]));
    let curve = classed(&tags, "line").next().unwrap();
    let points: Vec<Vec<f64>> = curve["d"].split(['M', 'L']).skip(1).map(&numbers).collect();
    assert_eq!(points.len(), FRAMES);
    let j = MUSCLES.iter().position(|m| m.0 == "soleus").unwrap();
    for (i, point) in points.iter().enumerate() {
        let t = domain[0] + (point[0] - frame[0]) / (frame[1] - frame[0]) * (domain[1] - domain[0]);
        let per_pixel = (domain[3] - domain[2]) / (frame[3] - frame[2]);
        let force = domain[2] + (frame[3] - point[1]) * per_pixel;
        // Two decimals of a unit of the figure: half of 0.01 units away at most.
        assert!((t - walk.effort.time[i]).abs() < 0.0051 * CYCLE / (frame[1] - frame[0]), "frame {i}");
        assert!((force - walk.effort.forces.values[(i, j)]).abs() < 0.0051 * per_pixel, "frame {i}: {force}");
    }
}

#[test]
fn frames_that_are_not_solved_appear_in_strip_and_text() {
    let walk = Walk::new().spoil();
    let page = optimize_page(&walk.report());
    let tags = check_page(&page);
    let strip =
        page.split("class=\"strip\" style=\"--n: 101\">").nth(1).unwrap().split("</div>").next().unwrap();
    let letters: Vec<&str> = strip.split("</span>").filter_map(|cell| cell.rsplit('>').next()).collect();
    assert_eq!(
        letters[..FRAMES].concat(),
        [
            "S".repeat(50),
            "III".into(),
            "S".repeat(17),
            "F".into(),
            "S".repeat(9),
            "MM".into(),
            "S".repeat(19)
        ]
        .concat()
    );
    assert!(page.contains("95 of 101 frames solved"));
    assert!(page.contains("3 infeasible, 1 failed, 2 without marker fit"));
    for text in
        ["51–53", "ankle flexion lacks −12.3 N·m", "soleus, gasmed", "iteration limit", "1 of 3 markers seen"]
    {
        assert!(page.contains(text), "{text}");
    }
    assert!(page.contains("12.5"), "clipped share of gmax1");
    // The failed frame breaks the curves and is hatched in the map of activations.
    let soleus = classed(&tags, "line").find(|a| a.get("data-name").is_some_and(|n| n == "soleus")).unwrap();
    assert_eq!(soleus["d"].matches('M').count(), 2);
    assert_eq!(classed(&tags, "missing").count(), 43);
}

#[test]
fn measured_knee_forces_are_drawn_tabled_and_saved() {
    let dir = tempfile::tempdir().unwrap();
    let walk = Walk::new().with_measured_knee();
    write(&walk, dir.path());
    let page = fs::read_to_string(dir.path().join("report.html")).unwrap();
    let tags = check_page(&page);
    assert_eq!(
        classed(&tags, "line").filter(|a| a.get("data-name").is_some_and(|n| n == "measured")).count(),
        3
    );
    let rmse = walk.overlay.as_ref().unwrap().total.agreement.rmse_N;
    assert!(rmse > 10.0 && page.contains(&format!("{rmse:.0} (")));
    let (header, rows) = csv(&dir.path().join("measured_knee.csv"));
    assert_eq!(header[..3], ["time_s", "medial_measured_N", "medial_model_N"]);
    assert_eq!(rows.len(), FRAMES);
    // The next run into the same folder has no measurement: its table must not stay behind.
    write(&Walk::new(), dir.path());
    assert!(!dir.path().join("measured_knee.csv").exists());
}

#[test]
fn odd_results_still_make_a_whole_page() {
    let mut short = Walk::new();
    short.motion.report = MARGIN..MARGIN + 1;
    for v in [&mut short.effort.time, &mut short.loads.time] {
        v.truncate(1);
    }
    short.loads.ground_force.truncate(1);
    let effort = &mut short.effort;
    for table in [&mut effort.forces, &mut effort.activations, &mut effort.reactions, &mut effort.reserves] {
        table.values = table.values.rows(0, 1).into_owned();
    }
    short.loads.moments.values = short.loads.moments.values.rows(0, 1).into_owned();
    effort.verdicts.truncate(1);
    check_page(&optimize_page(&short.report()));

    for value in [f64::NAN, f64::INFINITY, 1e308, -1e308, 1e-320, 0.0, 1e20] {
        let mut walk = Walk::new();
        let effort = &mut walk.effort;
        for table in
            [&mut effort.forces, &mut effort.activations, &mut effort.reactions, &mut walk.loads.moments]
        {
            table.values.fill(value);
        }
        walk.motion.angles.values.fill(value);
        for (verdict, fit) in walk.effort.verdicts.iter_mut().zip(&mut walk.motion.fit) {
            (verdict.kkt_residual, fit.marker_rms) = (value, value);
        }
        check_page(&optimize_page(&walk.report()));
    }
}

#[test]
fn an_error_midway_leaves_no_folder_that_looks_complete() {
    let dir = tempfile::tempdir().unwrap();
    let walk = Walk::new();
    write(&walk, dir.path());
    assert!(dir.path().join("run.json").exists());
    let blocked = dir.path().join("joint_forces.csv");
    fs::remove_file(&blocked).unwrap();
    fs::create_dir_all(blocked.join("in the way")).unwrap();
    let error = write_optimize(dir.path(), &walk.report(), RunRecord::new("optimize")).unwrap_err();
    assert!(error.to_string().contains("joint_forces.csv"), "{error}");
    assert!(!dir.path().join("run.json").exists());
    let partial = fs::read_dir(dir.path())
        .unwrap()
        .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().ends_with(".partial"));
    assert_eq!(partial.count(), 0);
}

const VICTIM: &str = "SARTORIUS_TEST_VICTIM_FOLDER";

/// Not a question of its own: the process that the next test kills.
#[test]
fn victim_of_the_kill_test() {
    let Some(folder) = std::env::var_os(VICTIM) else { return };
    let walk = Walk::new();
    loop {
        write(&walk, Path::new(&folder));
        std::thread::sleep(Duration::from_millis(60)); // so that some kills find a complete folder
    }
}

#[test]
fn a_killed_run_leaves_only_whole_files_and_run_json_only_beside_all_of_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut complete = 0;
    let mut kills = 0;
    // Killed at 20 moments spread over the first writes, and then on until both outcomes were seen.
    while kills < 20 || ((complete == 0 || complete == kills) && kills < 200) {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "victim_of_the_kill_test", "--test-threads=1"])
            .env(VICTIM, dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(15 + 37 * kills % 283));
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        let names: Vec<String> = fs::read_dir(dir.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        for name in names.iter().filter(|n| n.ends_with(".csv")) {
            assert_eq!(csv(&dir.path().join(name)).1.len(), FRAMES, "{name} is cut");
        }
        if names.iter().any(|n| n == "report.html") {
            assert!(fs::read_to_string(dir.path().join("report.html")).unwrap().ends_with("</html>\n"));
        }
        if let Ok(text) = fs::read(dir.path().join("run.json")) {
            complete += 1;
            let run: serde_json::Value = serde_json::from_slice(&text).expect("run.json is whole");
            let files = run["files"].as_array().unwrap();
            assert_eq!(files.len(), 11);
            assert!(files.iter().all(|f| names.iter().any(|n| n == f.as_str().unwrap())), "{names:?}");
        }
    }
    println!("{complete} of {kills} kills found a complete folder");
    assert!(complete > 0 && complete < kills, "both outcomes are needed, else the test saw nothing");
}

/// Opens `page` in headless Chromium with `script` run at its end; `None`, with a notice, where there is no Chromium.
fn in_browser(page: &str, script: &str, arguments: &[&str]) -> Option<String> {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("page.html");
    fs::write(&file, page.replace("</body>", &format!("<script>{script}</script></body>"))).unwrap();
    let output = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", dir.path().join("profile").display()))
        .args(arguments)
        .arg("--dump-dom")
        .arg(format!("file://{}", file.display()))
        .stderr(Stdio::null())
        .output();
    match output {
        Ok(output) if output.status.success() => Some(String::from_utf8(output.stdout).unwrap()),
        _ => {
            eprintln!("notice: Chromium is absent or does not start; this check is skipped");
            None
        }
    }
}

/// The tooltip of a muscle's figure reads its force back, and no width makes the page scroll sideways.
#[test]
fn the_pointer_reads_values_back_in_a_browser() {
    let walk = Walk::new().with_measured_knee();
    let page = optimize_page(&walk.report());
    let script = r#"
        const svg = document.querySelector('path.line[data-name="soleus"]').ownerSVGElement;
        svg.scrollIntoView();
        const box = svg.getBoundingClientRect();
        const [left, right] = svg.dataset.frame.split(" ").map(Number);
        const x = box.left + (left + 0.5 * (right - left)) / svg.viewBox.baseVal.width * box.width;
        svg.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: box.top + 20 }));
        document.title = document.getElementById("tip").innerText.replace(/\s+/g, " ")
            + " | " + (document.documentElement.scrollWidth - innerWidth);"#;
    let j = MUSCLES.iter().position(|m| m.0 == "soleus").unwrap();
    let force = walk.effort.forces.values[(50, j)];
    for width in ["--window-size=1400,900", "--window-size=800,900", "--window-size=500,900"] {
        let Some(dom) = in_browser(&page, script, &[width]) else { return };
        let title = dom.split("<title>").nth(1).unwrap().split("</title>").next().unwrap();
        let (tip, overflow) = title.rsplit_once(" | ").expect("the script of the page ran to its end");
        assert!(overflow.parse::<f64>().unwrap() <= 0.0, "{width}: {overflow} px too wide");
        let value: f64 =
            tip.split("soleus").nth(1).and_then(|t| t.trim().split(' ').next()).unwrap().parse().unwrap();
        assert!((value - force).abs() < 1.0, "{width}: {tip}, wanted {force} N"); // shown without decimals
        assert!(tip.starts_with("0.621 s · 50.0 %"), "{tip}");
    }
}
