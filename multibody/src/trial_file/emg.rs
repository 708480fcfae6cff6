//! `[emg]`: which channels of electromyography belong to which muscles.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::TrialFile;
use crate::emg::{Channel, Recording};
use crate::error::{InputError, Mistakes, nearest};
use crate::read::{c3d, ending, read_series};
use crate::tables::muscle_names;
use crate::trial::Side;

/// `[emg]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmgEntry {
    /// Table with the channels; absent: the analog channels of the C3D motion file.
    pub file: Option<PathBuf>,
    /// How long force comes after excitation \[ms\]; 50 ms: Cavanagh & Komi, Eur J Appl Physiol 1979;42:159.
    #[serde(default = "delay")]
    pub delay_ms: f64,
    /// Channel of the recording → muscle lines, separated by spaces.
    pub channels: BTreeMap<String, String>,
}

fn delay() -> f64 {
    50.0
}

impl TrialFile {
    /// The electromyography of the leg under study; `None` where the file names none. `data`: folder of the recordings, besides that of the
    /// trial file.
    pub fn emg(&self, data: Option<&Path>) -> Result<Option<Recording>, InputError> {
        let Some(entry) = &self.emg else { return Ok(None) };
        // Of a file of both legs, the channels are those of the right one.
        if self.leg == Some(Side::Left) {
            return Ok(None);
        }
        let path = self.find(entry.file.as_ref().unwrap_or(&self.motion), data)?;
        let (names, time, values) = match ending(&path).as_str() {
            "c3d" => {
                let analog = c3d::read(&path)?.analog;
                (analog.names, analog.time, analog.values)
            }
            "trc" => {
                let remedy = "a TRC file has no analog channels: name the table with them as `file` of [emg]";
                return Err(self.bad_value("[emg]", "without `file`", remedy));
            }
            _ => {
                let series = read_series(&path)?;
                (series.columns, series.time, series.values)
            }
        };
        let mut wrong = Mistakes::default();
        let muscles = muscle_names();
        let mut channels = Vec::new();
        if time.len() < 2 {
            wrong.note(self.bad_value("[emg]", format!("`{}`", path.display()), "it holds no samples"));
        }
        for (name, listed) in &entry.channels {
            let mut lines = Vec::new();
            for muscle in listed.split_whitespace() {
                match muscles.iter().position(|m| m == muscle) {
                    Some(line) => lines.push(line),
                    None => {
                        let near = nearest(muscle, muscles.iter().map(String::as_str));
                        let hint = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
                        let remedy = format!("no muscle line of that name{hint}");
                        wrong.note(self.bad_value(name, format!("`{muscle}`"), &remedy));
                    }
                }
            }
            if listed.trim().is_empty() {
                wrong.note(self.bad_value(
                    name,
                    "empty",
                    "name the muscle line, or several with spaces between",
                ));
            }
            match names.iter().position(|n| n == name) {
                Some(k) if time.len() >= 2 => channels.push(Channel {
                    name: name.clone(),
                    muscles: lines,
                    start: time[0],
                    rate: (time.len() - 1) as f64 / (time[time.len() - 1] - time[0]),
                    samples: values[k].clone(),
                }),
                Some(_) => {}
                None => wrong.note(InputError::UnknownName {
                    file: self.path.clone(),
                    line: self.line_of(name),
                    name: name.clone(),
                    within: path.clone(),
                    nearest: nearest(name, names.iter().map(String::as_str)),
                }),
            }
        }
        wrong.finish()?;
        Ok(Some(Recording { channels, delay: 1e-3 * entry.delay_ms }))
    }
}
