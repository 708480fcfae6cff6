//! What is going on, on standard error: a bar with the time left on a terminal, a line per stage with its seconds where that is piped,
//! nothing where a person wants it quiet.

use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

/// Stages of a run on their way.
pub struct Progress {
    /// Hidden where standard error is no terminal.
    bar: ProgressBar,
    lines: bool,
    /// What is to come, and how many seconds it is expected to take, where that is known.
    coming: Vec<(String, Option<f64>)>,
    ahead: Arc<Mutex<Ahead>>,
    clock: Instant,
    seconds: Vec<(String, f64)>,
}

/// What is left to wait for.
struct Ahead {
    /// When the stage that goes on began, and how long it is expected to take \[s\].
    since: Instant,
    stage: f64,
    /// Expected of the stages after it \[s\]; `None` where nothing is known.
    later: Option<f64>,
}

impl Ahead {
    fn left(&self) -> Option<f64> {
        Some(self.later? + (self.stage - self.since.elapsed().as_secs_f64()).max(0.0))
    }
}

impl Progress {
    /// Of a run with these stages in this order.
    pub fn new(stages: &[impl ToString], quiet: bool) -> Progress {
        let coming: Vec<(String, Option<f64>)> =
            stages.iter().map(|stage| (stage.to_string(), None)).collect();
        let terminal = std::io::stderr().is_terminal();
        let clock = Instant::now();
        let ahead = Arc::new(Mutex::new(Ahead { since: clock, stage: 0.0, later: None }));
        let bar =
            if quiet || !terminal { ProgressBar::hidden() } else { ProgressBar::new(coming.len() as u64) };
        let shown = ahead.clone();
        let left = move |_: &ProgressState, w: &mut dyn Write| {
            let left = shown.lock().ok().and_then(|ahead| ahead.left());
            let _ = left.map(|seconds| write!(w, ", {}", words(seconds)));
        };
        let style =
            ProgressStyle::with_template("{elapsed:>4} [{bar:24}] {msg}{left}").expect("a fixed template");
        bar.set_style(style.with_key("left", left).progress_chars("=> "));
        bar.enable_steady_tick(Duration::from_millis(200));
        let progress =
            Progress { bar, lines: !quiet && !terminal, coming, ahead, clock, seconds: Vec::new() };
        progress.show(0);
        progress
    }

    /// Whether a person sees the time left.
    pub fn is_shown(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// How long the stages to come are expected to take \[s\].
    pub fn expect(&mut self, seconds: impl Fn(&str) -> f64) {
        self.coming.iter_mut().for_each(|(stage, expected)| *expected = Some(seconds(stage)));
        self.show(self.seconds.len());
    }

    /// Shows that the stage of this number goes on.
    fn show(&self, stage: usize) {
        let expected = |stages: &[(String, Option<f64>)]| stages.iter().map(|s| s.1).sum::<Option<f64>>();
        let of = |k: usize| self.coming.get(k).and_then(|s| s.1);
        if let Ok(mut ahead) = self.ahead.lock() {
            let later = expected(self.coming.get(stage + 1..).unwrap_or(&[]));
            *ahead = Ahead {
                since: self.clock,
                stage: of(stage).unwrap_or(0.0),
                later: later.filter(|_| of(stage).is_some()),
            };
        }
        self.bar.set_position(stage as u64);
        self.bar.set_message(self.coming.get(stage).map_or("writing".into(), |s| s.0.clone()));
    }

    /// Says something on standard error, away from the bar.
    pub fn pause(&self, say: impl FnOnce()) {
        self.bar.suspend(say);
    }

    /// A stage is over.
    pub fn lap(&mut self, stage: &str) {
        let took = self.clock.elapsed().as_secs_f64();
        if self.lines {
            coupling::say!("{stage:<18}{took:>8.1} s");
        }
        self.seconds.push((stage.to_string(), took));
        self.clock = Instant::now();
        let next = self.coming.iter().position(|s| s.0 == stage).map_or(self.coming.len(), |i| i + 1);
        self.show(next);
    }

    /// The stages so far with their seconds.
    pub fn seconds(&self) -> &[(String, f64)] {
        &self.seconds
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Time left in words: right to a factor of 1.5 at best, so with few digits.
fn words(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => "less than 10 s left".to_string(),
        s if s < 90.0 => format!("about {:.0} s left", (s / 10.0).round() * 10.0),
        s if s < 5400.0 => format!("about {:.0} min left", s / 60.0),
        s => format!("about {:.1} h left", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn the_time_left_has_few_digits() {
        let said = [3.0, 47.0, 300.0, 9000.0].map(words);
        assert_eq!(said, ["less than 10 s left", "about 50 s left", "about 5 min left", "about 2.5 h left"]);
    }
}
