//! Do capacities of the deformable thigh enter force sharing as they are, and are bad tables refused with all that is wrong?

use std::fmt::Write;
use std::path::{Path, PathBuf};

use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use coupling::thigh_capacities::ThighCapacities;
use multibody::muscle::path::knee_angle;
use multibody::sharing::Capacity;
use multibody::trial::Status;
use support::sartorius;

/// Muscles of one line each, and that line.
const SINGLE: [(&str, &str); 4] = [
    ("sartorius", "sart"),
    ("gracilis", "grac"),
    ("rectus_femoris", "recfem"),
    ("vastus_lateralis", "vaslat"),
];
const HEADER: &str = "step,muscle,least_N,greatest_N,time_s,knee_flexion_deg,hip_flexion_m,knee_flexion_m\n";

fn published(thigh: Option<PathBuf>) -> Optimized {
    optimize(&OptimizeOptions { thigh, ..OptimizeOptions::default() }).unwrap()
}

/// A table in which every muscle can do what its line can, in every frame; strengths times `factor`.
fn as_lines(done: &Optimized, factor: f64) -> String {
    let mut text =
        "step,muscle,least_N,greatest_N,time_s,knee_flexion_deg,hip_flexion_m,hip_adduction_m,hip_rotation_m,knee_flexion_m\n"
            .to_string();
    for (k, time) in done.loads.time.iter().enumerate() {
        let frame = done.motion.report.start + k;
        let knee = -knee_angle(&done.model.shapes, &done.motion.Q[frame]).to_degrees();
        let arms = &done.loads.reduced[k].as_ref().unwrap().lever_arms;
        for (muscle, line) in SINGLE {
            let i = done.model.muscles.iter().position(|m| m.name == line).unwrap();
            let most = factor * done.model.muscles[i].f_max;
            write!(text, "{k},{muscle},0,{most:?},{time:?},{knee:?}").unwrap();
            (0..4).for_each(|c| write!(text, ",{:?}", arms[(c, i)]).unwrap());
            text.push('\n');
        }
    }
    text
}

#[test]
fn muscles_that_can_do_what_their_lines_can_share_as_these() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("capacities.csv");
    let alone = published(None);
    assert!(alone.with_thigh.is_none());
    std::fs::write(&file, as_lines(&alone, 1.0)).unwrap();
    let same = published(Some(file.clone()));
    let with = same.with_thigh.as_ref().unwrap();
    let off = (&with.effort.forces.values - &alone.effort.forces.values).amax();
    assert!(off < 1e-9, "{off} N");
    assert_eq!(same.effort.forces, alone.effort.forces, "the rigid leg alone stays as it was");
    // A twentieth of their strength binds where they pulled with more.
    std::fs::write(&file, as_lines(&alone, 0.05)).unwrap();
    let weak = published(Some(file)).with_thigh.unwrap();
    for (_, line) in SINGLE {
        let most = 0.05 * alone.model.muscles.iter().find(|m| m.name == line).unwrap().f_max;
        let [before, after] = [&alone.effort, &weak.effort].map(|e| e.forces.column(line).unwrap());
        let solved = |k: &usize| weak.effort.verdicts[*k].status == Status::Solved;
        assert!((0..after.len()).filter(solved).all(|k| after[k] <= most * (1.0 + 1e-9)), "{line}");
        if before.iter().any(|f| *f > most) {
            assert!((0..after.len()).filter(solved).any(|k| (after[k] - most).abs() < 1e-6 * most), "{line}");
        }
    }
}

#[test]
fn between_steps_it_is_a_straight_line_and_heads_share_by_their_strength() {
    let rows = "a,gluteus_maximus,10,1000,1.0,5,-0.04,0\nb,gluteus_maximus,20,1400,2.0,15,-0.06,0.01\nc,gluteus_maximus,40,1400,3.0,15,-0.06,0\n";
    let thigh = ThighCapacities::parse(Path::new("c.csv"), &format!("{HEADER}{rows}")).unwrap();
    let done = published(None);
    let nominal = Capacity::nominal(done.model.muscles.iter().map(|m| m.f_max).collect());
    let at = thigh.at(1.25, &done.model, &nominal);
    let heads: Vec<usize> = ["gmax1", "gmax2", "gmax3"]
        .map(|head| done.model.muscles.iter().position(|m| m.name == head).unwrap())
        .into();
    let all: f64 = heads.iter().map(|&i| done.model.muscles[i].f_max).sum();
    for &i in &heads {
        let fraction = done.model.muscles[i].f_max / all;
        let [least, most] = at.bounds[i];
        assert!((least - 12.5 * fraction).abs() < 1e-12 && (most - 1100.0 * fraction).abs() < 1e-9);
        let arm = |c: usize| at.lever_arms.iter().find(|a| a.muscle == i && a.coordinate == c).unwrap().arm;
        assert!((arm(0) + 0.045).abs() < 1e-15 && (arm(3) - 0.0025).abs() < 1e-15);
    }
    let others = (0..nominal.bounds.len()).filter(|i| !heads.contains(i));
    others.for_each(|i| assert_eq!(at.bounds[i], nominal.bounds[i]));
    // The step between lies 10 mm, 5 N and 200 N off the line through the others.
    let between = thigh.between_steps();
    assert!((between.arm.0 - 0.25 * 0.01).abs() < 1e-15 && (between.bound.0 - 0.25 * 200.0).abs() < 1e-12);
    assert_eq!((between.arm.1.as_str(), between.arm.2), ("gluteus_maximus", 2.0));
}

#[test]
fn every_mistake_of_a_table_is_named_at_once() {
    let said = |text: &str| ThighCapacities::parse(Path::new("c.csv"), text).unwrap_err().to_string();
    let rows = "a,gluteus_medus,10,1000,1.0,5,-0.04,0\na,gracilis,30,20,1.0,5,-0.04,0\na,gracilis,x,20,0.5,5,nan,0\n";
    let all = said(&format!("{HEADER}{rows}"));
    // As saved by a spreadsheet, too.
    assert_eq!(said(&format!("{HEADER}{rows}").replace('\n', "\r\n")), all);
    for words in [
        "c.csv, line 2: there is no muscle `gluteus_medus`; did you mean `gluteus_medius`",
        "c.csv, line 3: `gracilis` pulls with 30 N at least and 20 N at most",
        "c.csv, line 4: least_N is x",
        "line 4: hip_flexion_m is nan",
        "line 4: time 0.5 s follows 1 s",
    ] {
        assert!(all.contains(words), "{words} in {all}");
    }
    let columns = said("muscle,least_N\nsoleus,1\n");
    for words in ["`greatest_N`", "`time_s`", "`knee_flexion_deg`", "lever arms", "no muscle `soleus`"] {
        assert!(columns.contains(words), "{words} in {columns}");
    }
    let lacks = said(&format!("{HEADER}a,gracilis,0,20,1,5,0,0\nb,sartorius,0,20,2,5,0,0\n"));
    assert!(lacks.contains("at 1 s there is no row of sartorius") && lacks.contains("at 2 s"), "{lacks}");
    assert!(said(HEADER).contains("it has 0 steps"));
}

#[test]
fn capacities_of_other_times_or_another_trial_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c.csv");
    let refused = |rows: &str| {
        std::fs::write(&file, format!("{HEADER}{rows}")).unwrap();
        let options = OptimizeOptions { thigh: Some(file.clone()), ..OptimizeOptions::default() };
        optimize(&options).err().unwrap().to_string()
    };
    let short = refused("a,gracilis,0,20,0,6,0,0\nb,gracilis,0,20,0.5,12,0,0\n");
    assert!(short.contains("reach from 0 to 0.5 s") && short.contains("cycle_100"), "{short}");
    let other = refused("a,gracilis,0,20,0,6,0,0\nb,gracilis,0,20,1.2421,60,0,0\n");
    assert!(other.contains("knee flexes by 60 degrees there and by 7 degrees"), "{other}");
}

/// The whole way: what two-way coupling settled at a step is what `optimize` shares at its frame.
#[test]
fn a_cycle_of_the_thigh_goes_into_optimize() {
    let folder = tempfile::tempdir().unwrap();
    let steps: String = ["heel_strike", "cycle_20", "cycle_50", "cycle_70", "cycle_100"]
        .map(|name| format!("[[step]]\nname = \"{name}\"\n"))
        .concat();
    let scene = format!(
        "muscles = [\"sartorius\", \"gluteus_medius\"]\nresolution_mm = 20.0\n{steps}[effects]\ncontact = \"none\"\n"
    );
    std::fs::write(folder.path().join("cycle.toml"), scene).unwrap();
    let output = sartorius(&["compare", "cycle.toml", "--two-way", "--out", "c", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
    let thigh = folder.path().join("c/capacities.csv");
    let done = published(Some(thigh.clone()));
    let with = &done.with_thigh.as_ref().unwrap().effort;
    let mut table = csv::Reader::from_path(folder.path().join("c/comparison.csv")).unwrap();
    let header = table.headers().unwrap().clone();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let mut seen = 0;
    for row in table.records() {
        let row = row.unwrap();
        if &row[column("muscle")] != "sartorius" {
            continue;
        }
        let percent = row[column("step")].strip_prefix("cycle_").map_or(0, |n| n.parse().unwrap());
        let wanted: f64 = row[column("rigid_N")].parse().unwrap();
        let found = with.forces.column("sart").unwrap()[percent];
        // The table is of the last pass, the next one would change it by a thousandth.
        assert!((found - wanted).abs() < 5e-3 * wanted + 0.2, "{percent} %: {found} N, {wanted} N");
        seen += 1;
    }
    assert_eq!(seen, 5);
    // The command says both, writes both, and draws both.
    let args = ["optimize", "--form", "published", "--thigh", "c/capacities.csv", "--out", "o", "--quiet"];
    let output = sartorius(&args, folder.path());
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let all_solved = with.verdicts.iter().all(|v| v.status == Status::Solved);
    assert_eq!(output.status.code(), Some(if all_solved { 0 } else { 3 }), "{said}");
    assert!(said.contains("with the deformable thigh: ") && said.contains("between its steps"), "{said}");
    for file in ["muscle_forces_with_thigh.csv", "joint_forces_with_thigh.csv"] {
        assert!(folder.path().join("o").join(file).exists(), "{file}");
    }
    let page = std::fs::read_to_string(folder.path().join("o/report.html")).unwrap();
    assert!(page.contains("With the deformable thigh") && page.contains("with the thigh"));
}
