//! Where results go: never over what is not ours, never two runs at once, nothing where the input is bad, and what a stopped run leaves.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use command::output::claim::{Claim, Identity};
use coupling::fibres::cache::{Cache, FOLDER};
use support::walking::Walking;
use support::{program, sartorius, text};

/// Every file below a folder with its bytes.
fn everything(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).into_iter().flatten() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_string();
            if path.is_dir() {
                found.insert(format!("{name}/"), Vec::new());
                open.push(path);
            } else {
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

fn code_and_words(arguments: &[&str], folder: &Path) -> (Option<i32>, String) {
    let output = sartorius(arguments, folder);
    (output.status.code(), text(&output.stderr))
}

#[test]
fn a_folder_with_something_else_in_it_is_left_alone_even_with_force() {
    let at = tempfile::tempdir().unwrap();
    for (name, content) in [("thesis/report.html", "mine"), ("web/run.json", "{\"command\": \"build\"}")] {
        fs::create_dir_all(at.path().join(name).parent().unwrap()).unwrap();
        fs::write(at.path().join(name), content).unwrap();
    }
    let before = everything(at.path());
    for (out, file) in [("thesis", "report.html"), ("web", "run.json")] {
        for command in [&["optimize"][..], &["compare", "rigid.toml"], &["mesh"]] {
            fs::write(at.path().join("rigid.toml"), "muscles = \"none\"\n").unwrap();
            let (code, words) = code_and_words(&[command, &["--force", "--out", out]].concat(), at.path());
            assert_eq!(code, Some(2), "{command:?}: {words}");
            assert!(words.contains(file) && words.contains("--out"), "{command:?}: {words}");
            fs::remove_file(at.path().join("rigid.toml")).unwrap();
        }
    }
    assert_eq!(everything(at.path()), before);
    // Hidden files are no content.
    fs::create_dir(at.path().join("fresh")).unwrap();
    fs::write(at.path().join("fresh/.gitignore"), "*").unwrap();
    let (code, words) = code_and_words(&["optimize", "--out", "fresh"], at.path());
    assert_eq!(code, Some(0), "{words}");
}

#[test]
fn a_run_replaces_its_own_and_another_one_with_force_only() {
    let at = tempfile::tempdir().unwrap();
    for name in ["one", "other"] {
        fs::write(at.path().join(name).with_extension("toml"), "muscles = \"none\"\n").unwrap();
    }
    let run = |arguments: &[&str]| code_and_words(arguments, at.path());
    assert_eq!(run(&["compare", "one.toml", "--out", "o"]).0, Some(0));
    fs::write(at.path().join("o/notes.txt"), "mine").unwrap();
    assert_eq!(run(&["compare", "one.toml", "--out", "o"]).0, Some(0), "twice in a row simply works");
    let before = everything(&at.path().join("o"));
    for arguments in [["compare", "other.toml"], ["step", "one.toml"]] {
        let (code, words) = run(&[&arguments[..], &["--out", "o"]].concat());
        assert_eq!(code, Some(2), "{words}");
        assert!(words.contains("`compare one`") && words.contains("--force"), "{words}");
    }
    assert!(everything(&at.path().join("o")) == before, "a refused run changes nothing");
    let (code, words) = run(&["optimize", "--out", "o", "--force"]);
    assert_eq!(code, Some(0), "{words}");
    let after = everything(&at.path().join("o"));
    assert!(after.contains_key("kinematics.csv") && after.contains_key("notes.txt"));
    for gone in ["comparison.csv", "rigid_forces.sto", "explanation.csv"] {
        assert!(!after.contains_key(gone), "{gone} of the run that was replaced");
    }
    // Who filled it is known without the marker too, but not on which scene.
    fs::remove_file(at.path().join("o/.sartorius")).unwrap();
    let (code, words) = run(&["optimize", "--out", "o"]);
    assert!(code == Some(2) && words.contains("`optimize`") && words.contains("--force"), "{words}");
}

#[test]
fn bad_input_leaves_earlier_results_as_they_were_and_makes_no_folder() {
    let at = tempfile::tempdir().unwrap();
    fs::write(
        at.path().join("s.toml"),
        "muscles = [\"gracilis\"]\nresolution_mm = 20.0\n[effects]\nfibres = \"none\"\ncontact = \"none\"\n",
    )
    .unwrap();
    fs::write(at.path().join("rigid.toml"), "muscles = \"none\"\n").unwrap();
    fs::write(at.path().join("broken.toml"), "muscles = [\"gracillis\"]\n").unwrap();
    fs::write(at.path().join("lost.toml"), "trial = \"lost_trial.toml\"\n").unwrap();
    fs::write(at.path().join("lost_trial.toml"), "motion = \"nowhere.c3d\"\n").unwrap();
    fs::write(at.path().join("table.csv"), "muscle,s\nx,0\n").unwrap();
    let good: [&[&str]; 4] = [
        &["optimize", "--out", "results/o"],
        &["compare", "s.toml", "--out", "results/c"],
        &["step", "rigid.toml", "--out", "results/s"],
        &["mesh", "--resolution", "20", "--only", "gracilis", "--out", "results/m"],
    ];
    for arguments in good {
        let (code, words) = code_and_words(arguments, at.path());
        assert_eq!(code, Some(0), "{arguments:?}: {words}");
    }
    let before = everything(at.path());
    let bad: [(&[&str], &str); 13] = [
        (&["optimize", "--measured", "nowhere.csv"], "results/o"),
        (&["optimize", "lost_trial.toml", "--force"], "results/o"),
        (&["optimize", "--hip-centre", "regression"], "results/o"),
        (&["compare", "s.toml", "--two-way"], "results/c"),
        (&["compare", "s.toml", "--contact", "with"], "results/c"),
        (&["compare", "s.toml", "--resolution", "1"], "results/c"),
        (&["compare", "s.toml", "--only", "soleus"], "results/c"),
        (&["compare", "broken.toml", "--force"], "results/c"),
        (&["compare", "lost.toml", "--force"], "results/c"),
        (&["step", "broken.toml", "--force"], "results/s"),
        (&["step", "lost.toml", "--force"], "results/s"),
        (&["mesh", "table.csv", "--force"], "results/m"),
        (&["mesh", "--bones", "nowhere.csv"], "results/m"),
    ];
    for (arguments, out) in bad {
        for out in [out, "new/folder"] {
            let (code, words) = code_and_words(&[arguments, &["--out", out]].concat(), at.path());
            assert_eq!(code, Some(2), "{arguments:?}: {words}");
        }
    }
    let after = everything(at.path());
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    assert!(before == after);
}

#[test]
fn two_runs_in_one_folder_are_one_too_many() {
    let at = tempfile::tempdir().unwrap();
    let out = at.path().join("o");
    let claim = Claim::new(&out, Identity::new("optimize", "walker"), false).unwrap();
    let (code, words) = code_and_words(&["optimize", "--out", "o", "--force"], at.path());
    assert_eq!(code, Some(2));
    let holder = format!("process {}", std::process::id());
    assert!(words.contains(&holder) && words.contains("another run"), "{words}");
    drop(claim);
    assert!(!out.exists(), "a claim that comes to nothing leaves nothing");
    // A run that was killed holds no lock, whatever its marker says.
    let scene = "muscles = [\"gluteus_medius\"]\nresolution_mm = 14.0\n";
    fs::write(at.path().join("walker.toml"), scene).unwrap();
    let mut child = start(&["compare", "walker.toml", "--out", "o"], at.path());
    wait_for(&mut child, || out.join(".sartorius").exists());
    child.kill().unwrap();
    child.wait().unwrap();
    let (code, words) = code_and_words(&["optimize", "--out", "o", "--force"], at.path());
    assert_eq!(code, Some(0), "{words}");
}

#[test]
fn the_folders_of_both_legs_belong_to_the_run_of_the_trial() {
    let both = Walking::new().with_mirror_image();
    let at = both.write().parent().unwrap().to_path_buf();
    let (one, out) = (both.toml.split("\n[left.").next().unwrap(), at.join("o"));
    let run = || code_and_words(&["optimize", "walk.toml", "--out", "o", "--quiet"], &at);
    let names = || everything(&out).into_keys().collect::<Vec<_>>();
    assert_eq!(run(), (Some(0), String::new()), "quiet");
    let of_both = names();
    for name in ["right/kinematics.csv", "left/report.html", "report.html", "run.json"] {
        assert!(of_both.contains(&name.to_string()), "{name} is not in {of_both:?}");
    }
    assert!(!of_both.contains(&"right/run.json".to_string()), "one run, one record");
    // What a killed run left goes, in the folders of the legs too; a file of one's own stays, and so does its folder.
    fs::write(out.join("left/.of_old.csv.partial"), "half").unwrap();
    assert_eq!((run().0, names()), (Some(0), of_both.clone()));
    fs::write(out.join("left/notes.txt"), "mine").unwrap();
    fs::write(at.join("walk.toml"), one).unwrap();
    assert_eq!(run().0, Some(0));
    let of_one = names();
    assert!(of_one.contains(&"kinematics.csv".to_string()));
    let in_folders: Vec<&String> = of_one.iter().filter(|name| name.contains('/')).collect();
    assert_eq!(in_folders, ["left/", "left/notes.txt"]);
    fs::remove_file(out.join("left/notes.txt")).unwrap();
    fs::write(at.join("walk.toml"), &both.toml).unwrap();
    assert_eq!((run().0, names()), (Some(0), of_both));
    // The lock is on the folder of both.
    let claim = Claim::new(&out, Identity::new("optimize", "walk"), false).unwrap();
    let before = everything(&out);
    let (code, words) = run();
    assert!(code == Some(2) && words.contains("another run"), "{words}");
    assert!(everything(&out) == before);
    drop(claim);
    // A list of files that leads elsewhere is not followed.
    fs::create_dir_all(at.join("right")).unwrap();
    fs::write(at.join("right/mine.txt"), "mine").unwrap();
    let marker = out.join(".sartorius");
    let mut text = fs::read_to_string(&marker).unwrap();
    text += "file right/../../right/mine.txt\nfile ../right/mine.txt\nfile no_contact/mine.txt\n";
    fs::create_dir(out.join("no_contact")).unwrap();
    fs::write(out.join("no_contact/mine.txt"), "mine").unwrap();
    fs::write(&marker, text).unwrap();
    assert_eq!(run().0, Some(0));
    assert!(at.join("right/mine.txt").exists() && out.join("no_contact/mine.txt").exists());
}

fn start(arguments: &[&str], folder: &Path) -> Child {
    let mut command = Command::new(program());
    command.args(arguments).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn wait_for(child: &mut Child, enough: impl Fn() -> bool) {
    let patience = Instant::now();
    while !enough() {
        assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
        assert!(patience.elapsed() < Duration::from_secs(120));
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// SIGINT, or SIGTERM where tests run in the background of a shell, which has all below it ignore SIGINT: name and number.
#[cfg(unix)]
fn signal() -> (&'static str, i32) {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    match mask.map(|mask| u64::from_str_radix(mask.trim(), 16).unwrap()) {
        Some(mask) if mask & 2 != 0 => ("-TERM", 15),
        _ => ("-INT", 2),
    }
}

/// What a run says that is sent this [`signal`], and which one ended it.
#[cfg(unix)]
fn interrupted(child: Child) -> (Option<i32>, String) {
    use std::os::unix::process::ExitStatusExt;
    assert!(Command::new("kill").args([signal().0, &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    (output.status.signal(), text(&output.stderr))
}

#[cfg(unix)]
#[test]
fn ctrl_c_says_what_is_kept() {
    let sent = Some(signal().1);
    let at = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 16.0\nstress_free = \"heel_strike\"\n";
    fs::write(at.path().join("s.toml"), scene).unwrap();
    let out = at.path().join("runs/o");
    // While the input is prepared: as if nothing had been.
    let mut child = start(&["compare", "s.toml", "--out", "runs/o"], at.path());
    wait_for(&mut child, || out.join(".sartorius").exists());
    let (signal, words) = interrupted(child);
    assert_eq!(signal, sent, "a shell sees Ctrl-C: {words}");
    assert!(words.contains("nothing was written"), "{words}");
    assert!(!out.exists());
    // With a frame solved.
    let mut child = start(&["compare", "s.toml", "--out", "runs/o"], at.path());
    wait_for(&mut child, || out.join("no_contact/thigh_0000.state").exists());
    let (signal, words) = interrupted(child);
    assert_eq!(signal, sent, "{words}");
    assert!(words.contains("of no_contact") && words.contains("--resume"), "{words}");
    assert!(!out.join("run.json").exists(), "looks complete");
    let output = sartorius(&["compare", "s.toml", "--out", "runs/o", "--resume"], at.path());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
    let record: serde_json::Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    assert!(record["iterations"]["frames taken over"].as_u64().unwrap() >= 1);
}

/// Whoever read what it says may be gone; whoever started it, too.
#[cfg(unix)]
#[test]
fn a_run_ends_when_it_is_told_to_though_nobody_listens() {
    use std::os::unix::process::ExitStatusExt;
    let at = tempfile::tempdir().unwrap();
    fs::write(at.path().join("s.toml"), "resolution_mm = 16.0\n").unwrap();
    let started = |arguments: &[&str]| {
        let mut command = Command::new(program());
        command.args(arguments).args(["compare", "s.toml", "--out"]).current_dir(at.path());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    };
    let ended = |mut child: Child| {
        let patience = Instant::now();
        while patience.elapsed() < Duration::from_secs(20) {
            if let Some(status) = child.try_wait().unwrap() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        child.kill().unwrap();
        None
    };
    let mut child = started(&[]).arg("deaf").spawn().unwrap();
    wait_for(&mut child, || at.path().join("deaf/.sartorius").exists());
    drop(child.stderr.take());
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(ended(child).expect("it goes on for ever").signal(), Some(15));
    // Started by a process that is killed: its pipe closes.
    let mut child = started(&["--with-parent"]).arg("orphan").spawn().unwrap();
    wait_for(&mut child, || at.path().join("orphan/.sartorius").exists());
    drop(child.stdin.take());
    assert_eq!(ended(child).expect("it goes on for ever").code(), Some(143));
    assert!(!at.path().join("orphan/run.json").exists());
}

#[test]
fn a_cache_serves_many_runs_at_once() {
    let at = tempfile::tempdir().unwrap();
    let values: Vec<f64> = (0..2000).map(|i| 1.0 / f64::from(3 * i + 1)).collect();
    std::thread::scope(|scope| {
        for run in 0..8 {
            let (values, folder) = (&values, at.path().join(format!("run{run}")));
            scope.spawn(move || {
                for k in 0..40 {
                    let cache = Cache::beside(&folder);
                    let found: Result<BTreeMap<String, Vec<f64>>, ()> =
                        cache.get_or(&format!("{}", k % 4), "it", || {
                            Ok(BTreeMap::from([("values".to_string(), values.clone())]))
                        });
                    assert!(found.unwrap()["values"] == *values);
                }
            });
        }
    });
    let left: Vec<String> = everything(&at.path().join(FOLDER)).into_keys().collect();
    assert_eq!(left, ["0.toml", "1.toml", "2.toml", "3.toml"], "no temporary stays");
}
