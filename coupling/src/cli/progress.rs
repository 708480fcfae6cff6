//! A bar on standard error with the stage that is going on, and the seconds each took. Silent when piped.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::scene::{Fibres, Scene};
use crate::study::STAGES;

/// Stages of a study on their way.
pub struct Progress {
    bar: ProgressBar,
    /// What is to come.
    coming: Vec<&'static str>,
    clock: Instant,
    seconds: Vec<(String, f64)>,
}

impl Progress {
    /// A bar of the stages that the scene has.
    pub fn new(scene: &Scene, asked: [bool; 2]) -> Progress {
        let here = [
            true,
            scene.deformable,
            scene.deformable && scene.fibres != Fibres::None,
            scene.deformable && asked[0],
            scene.deformable && asked[1],
        ];
        let coming: Vec<&str> = STAGES.into_iter().zip(here).filter(|s| s.1).map(|s| s.0).collect();
        let bar = ProgressBar::new(coming.len() as u64); // draws to standard error, where that is a terminal
        let style = ProgressStyle::with_template("{elapsed:>4} [{bar:24}] {msg}").expect("a fixed template");
        bar.set_style(style.progress_chars("=> "));
        bar.set_message(coming[0]);
        bar.enable_steady_tick(Duration::from_millis(200));
        Progress { bar, coming, clock: Instant::now(), seconds: Vec::new() }
    }

    /// A stage is over.
    pub fn lap(&mut self, stage: &str) {
        self.seconds.push((stage.to_string(), self.clock.elapsed().as_secs_f64()));
        self.clock = Instant::now();
        let next = self.coming.iter().position(|s| *s == stage).map_or(0, |i| i + 1);
        self.bar.set_position(next as u64);
        self.bar.set_message(self.coming.get(next).copied().unwrap_or("writing"));
    }

    /// Takes the bar away; the stages with their seconds.
    pub fn finish(self) -> Vec<(String, f64)> {
        self.bar.finish_and_clear();
        self.seconds
    }
}
