//! What there is to damage, and which command reads it.

use super::worker::Ended;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use support::c3d_file::{C3dFile, Order};
use support::shared;

/// How a command ended, with what it said.
pub struct Run {
    /// How.
    pub how: Ended,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

/// A command line.
pub struct Command {
    /// Its words after the name of the program.
    pub words: Vec<String>,
    /// In which fraction of the runs.
    pub fraction: f64,
    /// What a message may name in place of the damaged file.
    pub names: Vec<&'static str>,
    /// Only where the command before refused the file: what is good would take long.
    pub if_refused: bool,
}

/// A sound file, and what reads it.
pub struct Base {
    /// Its name.
    pub file: String,
    /// What it holds.
    pub bytes: Vec<u8>,
    /// Whether lines and numbers can be damaged.
    pub text: bool,
    /// Commands.
    pub commands: Vec<Command>,
}

/// A kind of file.
pub struct Kind {
    /// Name.
    pub name: &'static str,
    /// Sound files of the kind; what else they need is written to the folder.
    pub bases: fn(&Path) -> Vec<Base>,
}

/// All kinds.
pub fn all() -> Vec<Kind> {
    let kind = |name, bases| Kind { name, bases };
    vec![
        kind("c3d", c3d),
        kind("trc", |folder| of_trial(folder, "motion.trc")),
        kind("sto", |folder| of_trial(folder, "force.sto")),
        kind("mot", |folder| of_trial(folder, "force.mot")),
        kind("trial", trial),
        kind("landmarks", |folder| of_trial(folder, "landmarks.csv")),
        kind("csv", table),
        kind("knee-force", knee_force),
        kind("capacities", capacities),
        kind("scene", scene),
        kind("ladder", |_| {
            let text = repository("gait-data/ladders/walker.toml");
            vec![base("ladder.toml", text, true, vec![command("check ladder.toml", 1.0)])]
        }),
        kind("surface", surface),
        kind("sections", sections),
        kind("mesh", mesh),
        kind("own-scene", |folder| of_own(folder, "toml")),
        kind("own-mesh", |folder| of_own(folder, "inp")),
        kind("own-drive", |folder| of_own(folder, "csv")),
    ]
}

fn command(line: &str, fraction: f64) -> Command {
    Command {
        words: line.split(' ').map(str::to_string).collect(),
        fraction,
        names: Vec::new(),
        if_refused: false,
    }
}

fn base(file: &str, bytes: Vec<u8>, text: bool, commands: Vec<Command>) -> Base {
    Base { file: file.to_string(), bytes, text, commands }
}

fn repository(file: &str) -> Vec<u8> {
    fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file))
        .unwrap_or_else(|e| panic!("{file}: {e}"))
}

/// C3D files made here in all three byte orders, integers and reals, and one that was recorded.
fn c3d(_: &Path) -> Vec<Base> {
    let mut bases = Vec::new();
    for (i, (order, real)) in
        [(Order::Intel, true), (Order::Intel, false), (Order::Dec, true), (Order::Mips, false)]
            .into_iter()
            .enumerate()
    {
        let file = C3dFile { order, real, ..C3dFile::default() };
        let name = format!("small{i}.c3d");
        bases.push(base(&name, file.bytes(), false, vec![command(&format!("check {name}"), 1.0)]));
    }
    if let Some(file) = shared("gait/jw/jw_ngait_og3.c3d") {
        let bytes = fs::read(file).expect("readable");
        bases.push(base("recorded.c3d", bytes, false, vec![command("check recorded.c3d", 0.3)]));
    }
    bases
}

/// The first lines of a file that was recorded.
fn cut(file: &str, lines: usize) -> Option<String> {
    let text = fs::read_to_string(shared(file)?).expect("readable");
    Some(text.lines().take(lines).map(|l| format!("{l}\n")).collect())
}

/// A trial of a few recorded frames. Returns the text of each file.
fn short_trial() -> Option<Vec<(&'static str, String)>> {
    const FRAMES: usize = 60;
    let motion =
        cut("gait/dm/DM_ngait_og3_new.trc", 6 + FRAMES)?.replace("\t302\t", &format!("\t{FRAMES}\t"));
    let force = cut("gait/dm/DM_ngait_og3_grf.sto", 7 + 700)?.replace("nRows=3019", "nRows=700");
    let text = String::from_utf8(repository("gait-data/trials/DM_ngait_og3.toml")).expect("text");
    let row = motion.lines().nth(7).expect("a first frame");
    let first: f64 = row.split('\t').nth(1).expect("a time").trim().parse().expect("a number");
    let trial = text
        .replace("dm/DM_ngait_og3_new.trc", "motion.trc")
        .replace("dm/DM_ngait_og3_grf.sto", "force.sto")
        .replace("DM.csv", "landmarks.csv")
        .replace("next_plate = 3\n", "")
        .replace("cycle = 1", &format!("start_s = {:.3}\nend_s = {:.3}", first + 0.1, first + 0.35));
    let landmarks = String::from_utf8(repository("gait-data/subjects/DM.csv")).expect("text");
    let mot = force.clone();
    Some(vec![
        ("motion.trc", motion),
        ("force.sto", force),
        ("force.mot", mot),
        ("landmarks.csv", landmarks),
        ("trial.toml", trial.clone()),
        ("trial_mot.toml", trial.replace("force.sto", "force.mot")),
    ])
}

/// One file of a short trial, which is written whole.
fn of_trial(folder: &Path, file: &str) -> Vec<Base> {
    let Some(files) = short_trial() else { return Vec::new() };
    files.iter().for_each(|(name, text)| fs::write(folder.join(name), text).expect("written"));
    let text = &files.iter().find(|f| f.0 == file).expect("a file of the trial").1;
    let trial = if file == "force.mot" { "trial_mot.toml" } else { "trial.toml" };
    let mut optimize = command(&format!("optimize {trial}"), 0.03);
    // Sound files that do not fit together are named by the trial.
    optimize.names = vec!["trial", "DM", "motion.trc", "force."];
    let mut check = command(&format!("check {trial}"), 0.3);
    check.names = vec!["trial", "motion.trc", "force."];
    vec![base(
        file,
        text.clone().into_bytes(),
        true,
        vec![command(&format!("check {file}"), 1.0), check, optimize],
    )]
}

fn trial(folder: &Path) -> Vec<Base> {
    let mut bases: Vec<Base> = of_trial(folder, "trial.toml");
    for base in &mut bases {
        base.commands.remove(1);
        // A time that no recording covers is told with the times of the recordings.
        base.commands.iter_mut().for_each(|command| command.names.push("motion.trc"));
    }
    for name in ["jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og3_both"] {
        let Some(data) = shared("gait") else { continue };
        let text = repository(&format!("gait-data/trials/{name}.toml"));
        let file = format!("{name}.toml");
        // Reads three recordings of 700 KB.
        let mut command = command(&format!("check {file} --data"), 0.1);
        command.words.push(data.to_string_lossy().into_owned());
        command.names = vec![".c3d"];
        bases.push(base(&file, text, true, vec![command]));
    }
    bases
}

fn table(_: &Path) -> Vec<Base> {
    let rows: String = (0..40).map(|k| format!("{},{},{}\n", 0.01 * k as f64, (k * k) % 17, -k)).collect();
    let text = format!("time_s,a,b\n{rows}").into_bytes();
    vec![base("table.csv", text, true, vec![command("check table.csv", 1.0)])]
}

/// Both forms of measured knee forces, on the time of the built-in walker.
fn knee_force(_: &Path) -> Vec<Base> {
    let rows = |row: &dyn Fn(usize) -> String| (0..60).map(row).collect::<String>();
    let ours = rows(&|k| format!("{:.3},{},{}\n", 0.02 * k as f64, 700 + k, 300 - k));
    let cells = rows(&|k| format!("{:.3},{},40,30,{}, \n", 0.02 * k as f64, 50 + k, 20 + k));
    let commands = |file: &str| {
        let mut optimize = command(&format!("optimize --measured {file}"), 0.01);
        optimize.names = vec!["measured knee force"];
        vec![command(&format!("check {file}"), 1.0), optimize]
    };
    let of = |file: &str, text: String| base(file, text.into_bytes(), true, commands(file));
    let mut bases = vec![of("knee.csv", format!("time_s,medial_N,lateral_N\n{ours}"))];
    let text = format!("Time(sec),PM,AM,AL,PL\n{}", cells.replace(", \n", "\n"));
    bases.push(of("cells.csv", text));
    bases
}

fn capacities(_: &Path) -> Vec<Base> {
    let mut text =
        "step,muscle,least_N,greatest_N,time_s,knee_flexion_deg,hip_flexion_m,knee_flexion_m\n".to_string();
    for (step, time) in [("heel_strike", "0.0"), ("cycle_100", "1.2421")] {
        for (muscle, most) in [("gracilis", 150), ("sartorius", 140), ("gluteus_maximus", 1500)] {
            text += &format!("{step},{muscle},0,{most},{time},6.5,-0.02,0.01\n");
        }
    }
    let optimize = command("optimize --thigh capacities.csv", 0.2);
    vec![base("capacities.csv", text.into_bytes(), true, vec![optimize])]
}

fn scene(_: &Path) -> Vec<Base> {
    let texts = [
        ("rigid.toml", "trial = \"walker\"\nmuscles = \"none\"\n\n[[step]]\nname = \"heel_strike\"\n".to_string()),
        (
            "one.toml",
            "trial = \"walker\"\nmuscles = [\"gluteus_minimus\"]\nresolution_mm = 20.0\ninset_mm = 0.5\nstress_free = \
             \"standing\"\n\n[accuracy]\nresidual_n = 0.1\ncontact_residual_n = 10.0\n\n[effects]\nfibres = \
             \"hill\"\nshells = true\ncontact = \"guarded\"\n\n[[step]]\nname = \"heel_strike\"\n\n[[step]]\nname = \
             \"loading_response\"\nknee_flexion_deg = 15.0\n"
                .to_string(),
        ),
    ];
    let of = |(file, text): (&str, String)| {
        let mut plan = command(&format!("plan {file}"), 0.3);
        plan.if_refused = true;
        let commands = vec![command(&format!("check {file}"), 1.0), plan];
        base(file, text.into_bytes(), true, commands)
    };
    texts.into_iter().map(of).collect()
}

/// Points and triangles of a spindle along y, closed at both ends.
fn spindle(radius: f64, length: f64, around: usize, along: usize) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let mut points = vec![[0.0, 0.0, 0.0]];
    for i in 0..along {
        let s = (i as f64 + 0.5) / along as f64;
        let r = radius * (0.4 + 0.6 * (0.5 * TAU * s).sin());
        for k in 0..around {
            let phi = TAU * k as f64 / around as f64;
            points.push([r * phi.cos(), -length * s, 0.7 * r * phi.sin()]);
        }
    }
    points.push([0.0, -length, 0.0]);
    let at = |i: usize, k: usize| 1 + i * around + k % around;
    let last = points.len() - 1;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.push([0, at(0, k + 1), at(0, k)]);
        for i in 0..along - 1 {
            triangles.push([at(i, k), at(i, k + 1), at(i + 1, k)]);
            triangles.push([at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)]);
        }
        triangles.push([last, at(along - 1, k), at(along - 1, k + 1)]);
    }
    (points, triangles)
}

/// A muscle and a bone as STL, OBJ and PLY.
fn surface(folder: &Path) -> Vec<Base> {
    let (points, triangles) = spindle(0.02, 0.2, 16, 12);
    let bones = folder.join("bones");
    fs::create_dir_all(&bones).expect("a folder");
    let moved: Vec<[f64; 3]> = points.iter().map(|p| [p[0] + 0.1, p[1], p[2]]).collect();
    fs::write(bones.join("femur.stl"), stl(&moved, &triangles)).expect("written");
    fs::write(folder.join("ends.csv"), "muscle,end,bone\nbelly,origin,\nbelly,insertion,\n")
        .expect("written");
    let obj: String = points.iter().map(|p| format!("v {} {} {}\n", p[0], p[1], p[2])).collect::<String>()
        + &triangles
            .iter()
            .map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1))
            .collect::<String>();
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face \
             {}\nproperty list uchar int vertex_indices\nend_header\n",
            points.len(),
            triangles.len()
        )
    };
    let rows: String = points.iter().map(|p| format!("{} {} {}\n", p[0], p[1], p[2])).collect();
    let faces: String = triangles.iter().map(|t| format!("3 {} {} {}\n", t[0], t[1], t[2])).collect();
    let mut binary = header("binary_little_endian").into_bytes();
    binary.extend(points.iter().flatten().flat_map(|x| (*x as f32).to_le_bytes()));
    for t in &triangles {
        binary.push(3);
        binary.extend(t.iter().flat_map(|i| (*i as i32).to_le_bytes()));
    }
    let mut text = "solid belly\n".to_string();
    for t in &triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        t.iter()
            .for_each(|&i| text += &format!("vertex {} {} {}\n", points[i][0], points[i][1], points[i][2]));
        text += "endloop\nendfacet\n";
    }
    text += "endsolid belly\n";
    let files = [
        ("a", "belly.stl", stl(&points, &triangles), false),
        ("b", "belly.stl", text.into_bytes(), true),
        ("c", "belly.obj", obj.into_bytes(), true),
        ("d", "belly.ply", format!("{}{rows}{faces}", header("ascii")).into_bytes(), true),
        ("e", "belly.ply", binary, false),
    ];
    let of = |(place, file, bytes, text): (&str, &str, Vec<u8>, bool)| {
        fs::create_dir_all(folder.join(place)).expect("a folder");
        let line = format!("mesh {place} --bones bones --ends ends.csv --resolution 20");
        let mut mesh = command(&line, 0.1);
        mesh.names = vec!["belly", "muscle"];
        let file = format!("{place}/{file}");
        let read = command(&format!("read-surface {file}"), 1.0);
        base(&file, bytes, text, vec![read, mesh])
    };
    files.into_iter().map(of).collect()
}

fn stl(points: &[[f64; 3]], triangles: &[[usize; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0; 12]);
        bytes.extend(t.iter().flat_map(|&i| points[i]).flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Tables of muscle sections, bone sections and ends.
fn sections(folder: &Path) -> Vec<Base> {
    let only = |text: Vec<u8>, name: &str| -> String {
        let text = String::from_utf8(text).expect("text");
        let kept = |(i, line): &(usize, &str)| *i == 0 || line.starts_with(name);
        text.lines().enumerate().filter(kept).map(|(_, l)| format!("{l}\n")).collect()
    };
    let muscle = only(repository("gait-data/thigh/muscle_sections.csv"), "gluteus_minimus,");
    let bone = only(repository("gait-data/thigh/bone_sections.csv"), "patella,");
    fs::write(folder.join("muscle.csv"), &muscle).expect("written");
    fs::write(folder.join("bone.csv"), &bone).expect("written");
    let line = "mesh muscle.csv --bones bone.csv --resolution 20";
    let mut of_muscle = command(line, 0.3);
    of_muscle.names = vec!["gluteus_minimus", "muscle"];
    let mut of_bone = command(line, 0.3);
    of_bone.names = vec!["patella", "bone"];
    vec![
        base("muscle.csv", muscle.into_bytes(), true, vec![of_muscle]),
        base("bone.csv", bone.into_bytes(), true, vec![of_bone]),
    ]
}

/// Volume meshes: no command reads them, the library does.
fn mesh(_: &Path) -> Vec<Base> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("mesh_data");
    let mut files: Vec<_> =
        fs::read_dir(folder).expect("the folder").map(|e| e.expect("readable").path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "msh" || e == "vtu"));
    files.sort();
    let inp = "*Node\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n5, 0, 0, 1\n6, 1, 0, 1\n7, 1, 1, 1\n8, 0, 1, \
               1\n*Element, type=C3D8, elset=box\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*Nset, nset=low\n1, 2, 3, 4\n*Nset, nset=high, \
               generate\n5, 8, 1\n";
    let mut bases =
        vec![base("box.inp", inp.as_bytes().to_vec(), true, vec![command("read-mesh box.inp", 1.0)])];
    for file in files {
        let name = file.file_name().expect("a file").to_string_lossy().into_owned();
        let bytes = fs::read(&file).expect("readable");
        let text = std::str::from_utf8(&bytes).is_ok();
        bases.push(base(&name, bytes, text, vec![command(&format!("read-mesh {name}"), 1.0)]));
    }
    bases
}

/// The file with this ending of the shipped scenes of bodies of one's own; the others are written to the folder.
fn of_own(folder: &Path, ending: &str) -> Vec<Base> {
    let mut bases = Vec::new();
    for name in ["squashed_block", "contracting_muscle", "strap_over_rod"] {
        for other in ["toml", "inp", "csv"] {
            let file = format!("{name}.{other}");
            let bytes = repository(&format!("fem/examples/scenes/{file}"));
            if other == ending {
                let mut check = command(&format!("check {name}.toml"), 1.0);
                // Where a name no longer fits, the other side of it may be what is said to be wrong.
                check.names = vec![name];
                bases.push(base(&file, bytes, true, vec![check]));
            } else {
                fs::write(folder.join(&file), bytes).expect("written");
            }
        }
    }
    bases
}
