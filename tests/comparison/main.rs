//! Scenes: what they may say, what is refused, and what `plan`, `step` and `compare` make of them.

mod input;
mod plans;
mod results;
mod runs;

use coupling::scene::Scene;
use std::path::{Path, PathBuf};

pub fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/scenes")
}

/// Path of a shipped scene for the command line.
pub fn shipped(name: &str) -> String {
    scenes().join(name).with_extension("toml").to_str().unwrap().to_string()
}

pub fn parse(text: &str) -> Result<Scene, String> {
    Scene::parse(Path::new("mine.toml"), text, None).map_err(|e| e.to_string())
}
