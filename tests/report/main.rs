//! Are the files of `optimize` and the page of `compare` what they claim to be: tables, OpenSim storage files, pages, a killed run?

mod compare;
mod html;
mod walk;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use command::output::atomic::OutputFolder;
use command::output::run::{RunRecord, RunStatus};
use command::output::write_optimize;
use command::report::{Summary, optimize_page};
use multibody::kinematics::ANGLES;
use multibody::sharing::REACTIONS;
use multibody::trial::{Shortfall, Status, Table};
use nalgebra::DMatrix;

use html::{check_page, classed, parse_html};
use walk::{CYCLE, FRAMES, MARGIN, MOMENTS, MUSCLES, UNSOLVED, Walk, reaction_names};

fn open(folder: &Path) -> OutputFolder {
    OutputFolder::open(folder, "optimize", "walk").unwrap()
}

fn write(walk: &Walk, folder: &Path) -> Vec<String> {
    write_optimize(open(folder), &walk.report(), RunRecord::new("optimize")).unwrap()
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
    // What is no solution is kept apart, under the same names.
    let (header, least) = csv(&dir.path().join("least_violation.csv"));
    assert_eq!(header.len(), 1 + MUSCLES.len() + reaction_names().len());
    let times: Vec<&str> = least.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(times, [50, 51, 52].map(|i| format!("{:?}", walk.effort.time[i])));
    assert_eq!(least[1][1], "1051.0");
    let (_, angles) = csv(&dir.path().join("kinematics.csv"));
    for i in 0..FRAMES {
        for j in 0..MUSCLES.len() {
            let wanted = walk.effort.forces.values[(i, j)];
            match forces[i][j + 1].as_str() {
                "" => assert!(UNSOLVED.contains(&i), "frame {i} is empty"),
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
    write_optimize(open(b.path()), &walk.report(), slow).unwrap();
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
    assert!(close(s.peak_knee_force_bw, 250.0 / (70.0 * 9.81)), "{s:?}");
    assert_eq!(s.peak_knee_force_time_s, Some(walk.effort.time[100]));
    assert!(close(s.marker_rms_mm, ((51.0 * 9.0 + 50.0 * 25.0) / 101.0_f64).sqrt()), "{s:?}");
    assert!(close(s.worst_marker_rms_mm, 5.0), "{s:?}");
    assert!(close(s.largest_load, 1.5), "{s:?}");
    assert_eq!(s.largest_load_muscle.as_deref(), Some("tibpost"));
    assert_eq!((s.solved, s.infeasible, s.all_solved()), (100, 1, false));
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
fn frames_that_are_not_solved_appear_in_band_and_text() {
    let walk = Walk::new().spoil();
    let page = optimize_page(&walk.report());
    let tags = check_page(&page);
    let band = page.split("<div class=\"band\"").nth(1).unwrap().split("</div>").next().unwrap();
    let pieces: Vec<(usize, &str)> = band
        .split("flex-grow:")
        .skip(1)
        .map(|piece| {
            let frames = piece.split('"').next().unwrap().parse().unwrap();
            (frames, piece.split("</span>").next().unwrap().rsplit('>').next().unwrap())
        })
        .collect();
    assert_eq!(pieces, [(50, "S"), (3, "I"), (17, "S"), (1, "F"), (9, "S"), (2, "M"), (19, "S")]);
    assert!(page.contains("95 of 101 frames solved"));
    assert!(page.contains("3 infeasible, 1 failed, 2 without marker fit"));
    for text in
        ["51–53", "ankle flexion lacks −12.3 N·m", "soleus, gasmed", "iteration limit", "1 of 3 markers seen"]
    {
        assert!(page.contains(text), "{text}");
    }
    assert!(page.contains("12.5"), "clipped fraction of gmax1");
    // Frames without a solution break the curves, and are hatched there and in the map of activations.
    let soleus = classed(&tags, "line").find(|a| a.get("data-name").is_some_and(|n| n == "soleus")).unwrap();
    assert_eq!(soleus["d"].matches('M').count(), 4);
    assert_eq!(soleus["d"].matches(['M', 'L']).count(), FRAMES - UNSOLVED.len());
    assert_eq!(classed(&tags, "missing").count(), 43);
    assert!(page.contains("no solution") && page.contains("over 95 of 101 frames"));
    let start = page.find("aria-label=\"Tibiofemoral contact").unwrap();
    let figure =
        &page[page[..start].rfind("<figure").unwrap()..start + page[start..].find("</figure>").unwrap()];
    let hatched = parse_html(&format!("<!DOCTYPE html>{figure}</figure>"));
    assert_eq!(classed(&hatched, "gap").count(), 1 + 3, "a key and three gaps");
    assert!(!optimize_page(&Walk::new().report()).contains("class=\"gap\""), "nothing is missing there");
}

/// A measurement is drawn and scored where there is a solution; the curve does not bridge the others.
#[test]
fn frames_without_a_solution_are_not_scored_against_the_measurement() {
    let whole = Walk::new().with_measured_knee();
    let walk = Walk::new().spoil().with_measured_knee();
    let overlay = walk.overlay.as_ref().unwrap();
    assert_eq!((overlay.time.len(), overlay.frames_left_out), (FRAMES - UNSOLVED.len(), UNSOLVED.len()));
    let solved = |i: &usize| !UNSOLVED.contains(i);
    let total = &whole.overlay.as_ref().unwrap().total;
    let squares = (0..FRAMES).filter(solved).map(|i| (total.model[i] - total.measured[i]).powi(2));
    let rmse = (squares.sum::<f64>() / (FRAMES - UNSOLVED.len()) as f64).sqrt();
    assert!((overlay.total.agreement.rmse_N - rmse).abs() < 1e-9 * rmse);
    assert_eq!(Summary::of(&walk.report()).compared_frames, Some(95));
    let page = optimize_page(&walk.report());
    assert!(page.contains("over 95 of 101 frames, the others have no solution or no measurement"));
    let tags = check_page(&page);
    let curve = classed(&tags, "line").find(|a| a.get("data-name").is_some_and(|n| n == "measured")).unwrap();
    assert_eq!(curve["d"].matches('M').count(), 4, "the curve bridges gaps");
}

#[test]
fn reserves_are_announced_per_coordinate() {
    let mut walk = Walk::new();
    walk.loads.moments.values.fill(20.0);
    let mut values = DMatrix::zeros(FRAMES, MOMENTS.len());
    values[(30, 1)] = -15.0; // of 20 N·m; muscles make 35
    values[(40, 3)] = 0.1;
    walk.effort.reserves = Table { columns: MOMENTS.map(String::from).to_vec(), values };
    walk.effort.verdicts[30].reserve_share = 0.3;
    walk.effort.verdicts[60].reserve_share = 0.9;
    walk.effort.verdicts[60].status = Status::Infeasible; // not counted
    let s = Summary::of(&walk.report());
    assert_eq!((s.largest_reserve_share, s.largest_reserve_share_time_s), (0.3, Some(walk.effort.time[30])));
    let hip = &s.reserves[1];
    assert_eq!((hip.coordinate.as_str(), hip.largest_Nm, hip.needed_Nm), ("hip_adduction", -15.0, 20.0));
    assert!((hip.fraction - 15.0 / 50.0).abs() < 1e-12 && (hip.fraction_of_peak - 0.75).abs() < 1e-12);
    assert!(hip.is_much() && !s.reserves[3].is_much());
    let page = optimize_page(&walk.report());
    check_page(&page);
    assert!(page.contains("Reserve moments carry up to 30 %") && page.contains("id=\"reserve-moments\""));
    assert!(!optimize_page(&Walk::new().report()).contains("Reserve moments carry"));
}

/// A long trial whose every frame lacks another moment is one row, with the largest; its page grows with the problems and not with the frames.
#[test]
fn one_row_per_problem_however_many_frames_it_lasts() {
    let mut walk = Walk::new();
    for (i, verdict) in walk.effort.verdicts.iter_mut().enumerate().take(60).skip(12) {
        verdict.status = Status::Infeasible;
        verdict.reason = Some(format!("hip_adduction lacks {i} N·m"));
        verdict.shortfall = vec![Shortfall { coordinate: "hip_adduction".into(), missing: i as f64 / 10.0 }];
        if i == 20 {
            verdict.shortfall.push(Shortfall { coordinate: "knee_flexion".into(), missing: -0.5 });
        }
        verdict.saturated = vec![if i % 2 == 0 { "gmed1" } else { "gmin1" }.into()];
    }
    let page = optimize_page(&walk.report());
    check_page(&page);
    let table = page.split("Frames that are not solved").nth(1).unwrap().split("</table>").next().unwrap();
    assert_eq!(table.matches("<tr>").count(), 2, "the header and one problem: {table}");
    for text in [
        "13–60",
        "hip adduction lacks up to 5.90 N·m; knee flexion lacks −0.500 N·m in 1 of them",
        "at their bound: gmed1, gmin1",
        "worst, frame 60: hip_adduction lacks 59 N·m",
    ] {
        assert!(table.contains(text), "{text}: {table}");
    }
}

/// Every figure says what its axes are, in which unit.
#[test]
fn axes_of_all_figures_have_titles() {
    let page = optimize_page(&Walk::new().with_measured_knee().report());
    let mut plots = 0;
    for plot in page.split("<svg class=\"plot\"").skip(1) {
        let plot = plot.split("</svg>").next().unwrap();
        assert!(plot.contains(">% of gait cycle</text>"), "{plot}");
        let title = plot.split("rotate(-90)\">").nth(1).unwrap().split('<').next().unwrap();
        let unit = plot.split("data-unit=\"").nth(1).unwrap().split('"').next().unwrap();
        assert!(title.len() > unit.len() + 2 && title.ends_with(unit), "{title}");
        plots += 1;
    }
    assert!(plots > 60, "{plots}");
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
    let tables = [
        &mut effort.forces,
        &mut effort.activations,
        &mut effort.reactions,
        &mut effort.reserves,
        &mut effort.least_violation,
    ];
    for table in tables {
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
    let error = OutputFolder::open(dir.path(), "optimize", "walk")
        .and_then(|out| write_optimize(out, &walk.report(), RunRecord::new("optimize")))
        .unwrap_err();
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
            .args(["--exact", "report::victim_of_the_kill_test", "--test-threads=1"])
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
            let rows = if name == "gait2392_names.csv" { MUSCLES.len() } else { FRAMES };
            assert_eq!(csv(&dir.path().join(name)).1.len(), rows, "{name} is cut");
        }
        if names.iter().any(|n| n == "report.html") {
            assert!(fs::read_to_string(dir.path().join("report.html")).unwrap().ends_with("</html>\n"));
        }
        if let Ok(text) = fs::read(dir.path().join("run.json")) {
            complete += 1;
            let run: serde_json::Value = serde_json::from_slice(&text).expect("run.json is whole");
            let files = run["files"].as_array().unwrap();
            assert_eq!(files.len(), 14);
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
