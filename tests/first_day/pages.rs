use super::*;

/// A page of `docs` is what the source says; `SARTORIUS_WRITE_PAGES=1` writes it.
fn assert_page(name: &str, wanted: &str) {
    let file = root().join("docs").join(name);
    if std::env::var_os("SARTORIUS_WRITE_PAGES").is_some() {
        fs::write(&file, wanted).unwrap();
    }
    let written = fs::read_to_string(&file).unwrap_or_default();
    assert!(
        written == wanted,
        "docs/{name} is not what the source says; write it with SARTORIUS_WRITE_PAGES=1 cargo test -p sartorius-tests --test first_day page"
    );
}

#[test]
fn the_page_of_keys_is_what_the_source_says() {
    let trial = page(
        "Trial file",
        "Which recordings make a trial, whose, which part of it, and where the landmarks come from.\n\
         `sartorius template trial RECORDING` writes one; `sartorius check FILE` names every mistake.\n\
         Paths are looked for in the folder of the trial file, then in `--data`.\n\
         They must not lead out by `..` or start with `/`; a symbolic link that lies there is followed.",
        KEYS,
    );
    let scene = page(
        "Scene",
        "What `compare`, `step` and `plan` simulate.\n\
         `sartorius template scene` writes one with every key; an empty file is a scene, too.\n\
         Paths are looked for beside the scene, then in `--data`.",
        SCENE_KEYS,
    );
    let ladder = page(
        "Ladder",
        "What `cost` measures: a scene, and keys of it that go from coarse to fine.\n\
         `sartorius cost` without a file does the shipped one, `gait-data/ladders/walker.toml`.",
        coupling::cost::ladder::KEYS,
    );
    let study = page(
        "Study",
        "What `study` carries out: subjects by settings by samples, and what varies from sample to sample.\n\
         [study.md](study.md) shows how.\n\
         Trials and scene are looked for beside the study, or are shipped ones.",
        coupling::study::keys::KEYS,
    );
    let options = page(
        "Options of `optimize` in a study",
        "Keys `optimize.…` of settings and of what varies: the options of the command line, with underscores.",
        coupling::options::OPTIONS,
    );
    let text = format!(
        "# Keys\n\nEvery key of the four kinds of files that you write (TOML).\nThis page is made from the source and tested against it.\n\n{trial}\n{scene}\n{ladder}\n{study}\n{options}"
    );
    assert_page("keys.md", &text);
}

/// File → names of its columns, as the page of columns has them.
fn page_of_columns() -> std::collections::BTreeMap<String, Vec<String>> {
    let text = fs::read_to_string(root().join("docs/columns.md")).unwrap();
    let mut files = std::collections::BTreeMap::new();
    let mut file = String::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("### ") {
            file = heading.replace('`', "");
            files.insert(file.clone(), Vec::new());
        } else if let Some(row) = line.strip_prefix("| `") {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            assert!(cells.len() == 5 && !cells[3].is_empty(), "{line}");
            files.get_mut(&file).unwrap().push(row.split('`').next().unwrap().to_string());
        }
    }
    files
}

/// Whether a column is the one of the page; `{…}` stands for letters, digits and underscores.
fn is_column(name: &str, pattern: &str) -> bool {
    let parts: Vec<&str> = pattern.split(['{', '}']).step_by(2).collect();
    let (first, last) = (parts[0], parts[parts.len() - 1]);
    match parts.len() {
        1 => name == pattern,
        _ => name.len() > first.len() + last.len() && name.starts_with(first) && name.ends_with(last),
    }
}

/// Tables below a folder with the names of their columns.
fn tables(folder: &Path) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(tables(&path));
        } else if name.ends_with(".csv") {
            let text = fs::read_to_string(&path).unwrap();
            found.push((name, text.lines().next().unwrap().split(',').map(str::to_string).collect()));
        } else if name.ends_with(".sto") || name.ends_with(".mot") {
            let text = fs::read_to_string(&path).unwrap();
            let head = text.lines().skip_while(|l| *l != "endheader").nth(1).unwrap();
            found.push((name, head.split('\t').map(str::to_string).collect()));
        }
    }
    found
}

#[test]
fn the_page_of_columns_has_every_column_that_is_written_and_no_other() {
    // A man who carries four of his kind: no muscle forces make his moments.
    let mut walking = Walking::new();
    walking.plates.iter_mut().flatten().for_each(|(f, _)| *f *= 4.0);
    let samples: String =
        (0..3000).map(|k| format!("{},{}\n", 0.001 * k as f64 - 0.8, (k % 7) as f64)).collect();
    let walking = walking.replace("mass_kg = 70", "mass_kg = 280");
    walking.toml += "\n[emg]\nfile = \"emg.csv\"\n[emg.channels]\nc1 = \"soleus\"\n";
    walking.write();
    fs::write(walking.folder().join("emg.csv"), format!("time_s,c1\n{samples}")).unwrap();
    let trials = walking.folder();
    let folder = trials.parent().unwrap();
    let measured = "time_s,medial_N,lateral_N\n0.0,500,300\n0.3,900,500\n0.6,900,500\n1.2,500,300\n";
    fs::write(folder.join("knee.csv"), measured).unwrap();
    fs::write(folder.join("thermal.toml"), "muscles = [\"gracilis\"]\nstress_free = \"heel_strike\"\nresolution_mm = 20\n[effects]\ncontact = \"none\"\n").unwrap();
    let example = |name: &str| format!("{}/../fem/examples/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    fs::write(folder.join("hill.toml"), "muscles = [\"gluteus_minimus\"]\nresolution_mm = 20\n").unwrap();
    fs::write(folder.join("grid.toml"), "muscles = [\"vastus_intermedius\"]\nresolution_mm = 12\n[effects]\ncontact = \"none\"\n[[fidelity]]\nmuscle = \"vastus_intermedius\"\nlevel = \"embedded\"\ncell_mm = 30\n").unwrap();
    fs::write(folder.join("ladder.toml"), "scene = \"hill.toml\"\n[[axis]]\nname = \"mesh\"\nkey = \"resolution_mm\"\nvalues = [20.0, 14.0]\nerror = \"discretisation\"\n").unwrap();
    let vary = |key: &str, values: &str| {
        format!("[[vary]]\nkey = \"{key}\"\ndistribution = \"choice\"\nvalues = [{values}]\n")
    };
    let leg = [
        vary("landmarks.heel", "1.0, 2.0"),
        vary("strengths.soleus", "0.9, 1.1"),
        vary("optimize.cost", "\"force\""),
    ];
    fs::write(folder.join("leg.toml"), leg.concat()).unwrap();
    let sure = vary("strengths.soleus", "0.9, 1.1");
    fs::write(folder.join("sure.toml"), format!("samples = 8\nindices = true\n{sure}")).unwrap();
    let thigh = vary("scene.materials.matrix_a_kpa", "3.0, 4.0");
    fs::write(
        folder.join("thigh.toml"),
        format!("run = \"compare\"\nscene = \"hill.toml\"\ncontact = \"without\"\n{thigh}"),
    )
    .unwrap();
    let recorded = vary("trial.filter.motion_hz", "5.0, 6.0");
    fs::write(
        folder.join("recorded.toml"),
        format!("[[subject]]\nname = \"walk\"\ntrial = \"trials/walk.toml\"\n{recorded}"),
    )
    .unwrap();
    let can = |step: &str, time: f64| format!("{step},gracilis,0,150,{time},6.5,0.01\n");
    fs::write(
        folder.join("can.csv"),
        "step,muscle,least_N,greatest_N,time_s,knee_flexion_deg,knee_flexion_m\n".to_string()
            + &can("heel_strike", 0.0)
            + &can("cycle_100", 1.2421),
    )
    .unwrap();
    for arguments in [
        &["optimize", "--out", "o", "--reserves", "1e-3", "--measured", "knee.csv", "--bands"][..],
        &["optimize", "--out", "n", "--knee", "implant", "--samples", "70"],
        &["compare", "hill.toml", "--out", "c"],
        &["compare", "hill.toml", "--out", "w", "--two-way", "--passes", "2"],
        &["compare", "hill.toml", "--out", "b", "--two-way", "--passes", "2", "--contact", "with"],
        &["optimize", "trials/walk.toml", "--out", "v"],
        &["optimize", "--out", "h", "--thigh", "can.csv"],
        &["compare", "thermal.toml", "--out", "t"],
        &["compare", "grid.toml", "--out", "e"],
        &["mesh", "--resolution", "20", "--only", "gracilis", "--out", "m"],
        &["solve", &example("squashed_block"), "--out", "s"],
        &["solve", &example("strap_over_rod"), "--out", "r"],
        &["cost", "ladder.toml", "--out", "l"],
        &["cost", "deep_flexion", "--only", "deep_flexion", "--out", "k"],
        &["study", "leg.toml", "--out", "y"],
        &["study", "thigh.toml", "--out", "z"],
        &["study", "recorded.toml", "--out", "q"],
        &["study", "sure.toml", "--out", "i"],
    ] {
        let output = sartorius(arguments, folder);
        // A single pass of two-way coupling or a single muscle may miss its verdict; its tables are written all the same.
        assert_ne!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let page = page_of_columns();
    let mut seen = std::collections::BTreeSet::new();
    for part in ["o", "n", "v", "h", "c", "w", "b", "t", "e", "m", "s", "r", "l", "k", "y", "z", "q", "i"] {
        for (file, columns) in tables(&folder.join(part)) {
            let file = match (part, file.as_str()) {
                ("t", "calibration.csv") => "calibration.csv (thermal fibres)".into(),
                ("k", "cost.csv") => "cost.csv of cost deep_flexion".into(),
                // The tables of a knee stand on the page of the knee.
                ("k", _) => continue,
                _ => file,
            };
            let rows = page.get(&file).unwrap_or_else(|| panic!("docs/columns.md lacks the file {file}"));
            for column in &columns {
                let row = rows.iter().find(|r| is_column(column, r));
                let row = row.unwrap_or_else(|| panic!("docs/columns.md lacks `{column}` of {file}"));
                seen.insert((file.clone(), row.clone()));
            }
        }
    }
    for (file, rows) in &page {
        for row in rows {
            assert!(
                seen.contains(&(file.clone(), row.clone())),
                "docs/columns.md has `{row}` of {file}, which nothing writes"
            );
        }
    }
}
