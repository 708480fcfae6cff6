use super::*;

/// Commands of the tutorial with the lines that it promises, in their order.
fn commands_of_the_tutorial() -> Vec<(Vec<String>, Vec<String>)> {
    let text = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let mut commands: Vec<(Vec<String>, Vec<String>)> = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match (line.starts_with("```"), line.strip_prefix("$ sartorius ")) {
            (true, _) => inside = line == "```console",
            (_, Some(command)) if inside => {
                commands.push((command.split(' ').map(str::to_string).collect(), Vec::new()));
            }
            _ if inside => commands.last_mut().unwrap().1.push(line.to_string()),
            _ => {}
        }
    }
    commands
}

#[test]
fn the_tutorial_does_what_it_says() {
    let Some(data) = shared("gait") else { return };
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    for file in [
        "dm/DM_ngait_og3_new.trc",
        "dm/DM_ngait_og3_grf.sto",
        "jw/jw_ngait_og1.c3d",
        "jw/jw_ngait_og3.c3d",
        "jw/jw_ngait_og7.c3d",
    ] {
        fs::copy(data.join(file), folder.join(Path::new(file).file_name().unwrap())).unwrap();
    }
    let text = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let scene = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    // One muscle without contact shows that the road is open; the tutorial's three are timed by hand.
    let small =
        scene.replace("\"gluteus_maximus\", \"gluteus_medius\", ", "") + "[effects]\ncontact = \"none\"\n";
    fs::write(folder.join("scene.toml"), small).unwrap();
    let commands = commands_of_the_tutorial();
    assert_eq!(commands.len(), 8, "{commands:?}");
    for (arguments, promised) in commands {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = sartorius(&arguments, folder);
        let said =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
        for line in promised {
            assert!(said.contains(&line), "{arguments:?} does not say `{line}` but\n{said}");
        }
    }
    for page in ["dm/report.html", "thigh/report.html", "jw/report.html"] {
        assert!(folder.join(page).exists(), "{page}");
    }
}
