//! The first day of a user: does `check` name every mistake at once, and does `template` write a trial file that runs?

use std::fs;
use std::path::{Path, PathBuf};

use coupling::scene::{KEYS as SCENE_KEYS, Scene, TomlKind};
use multibody::InputError;
use multibody::keys::page;
use multibody::trial::Side;
use multibody::trial_file::{KEYS, TrialFile, Wishes, guess};
use nalgebra::Vector3;
use support::walking::Walking;
use support::{sartorius, shared};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every message that `check` has for this trial file and its recordings.
fn mistakes(walking: &Walking) -> Vec<String> {
    match multibody::read::check(&walking.write(), None) {
        Ok(good) => panic!("nothing was noticed: {good}"),
        Err(InputError::Several(all)) => all.iter().map(InputError::to_string).collect(),
        Err(one) => vec![one.to_string()],
    }
}

/// Each of `wanted` is in a message of its own, and there are no others.
fn assert_named(messages: &[String], wanted: &[&[&str]]) {
    for words in wanted {
        let hits = messages.iter().filter(|m| words.iter().all(|w| m.contains(w))).count();
        assert_eq!(hits, 1, "{words:?} in {messages:#?}");
    }
    assert_eq!(messages.len(), wanted.len(), "{messages:#?}");
}

mod check;
mod pages;
mod recordings;
mod template;
mod tutorial;
