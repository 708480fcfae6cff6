//! Folders of results.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// All files below a folder by their path in it.
pub fn files(folder: &Path) -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).into_iter().flatten() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => open.push(path),
                false => {
                    found.insert(path.strip_prefix(folder).unwrap().to_str().unwrap().to_string(), path);
                }
            }
        }
    }
    found
}

/// What all files but `run.json` and the marker of the folder say, without the seconds that a run took.
pub fn files_without_times(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let all = files(folder).into_iter().filter(|(name, _)| name != "run.json" && name != ".sartorius");
    all.map(|(name, path)| (name.clone(), timeless(&name, &path))).collect()
}

fn timeless(name: &str, path: &Path) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    if name.ends_with("iterations.csv") {
        let rows = text.lines().map(|l| l.rsplit_once(',').unwrap().0);
        return rows.collect::<Vec<_>>().join("\n").into_bytes();
    }
    if name == "report.html"
        && let Some((before, rest)) = text.split_once("<section id=\"cost\">")
    {
        return [before, rest.split_once("</section>").unwrap().1].concat().into_bytes();
    }
    bytes
}
