//! From a trial file and its recordings to a [`Trial`].

use std::path::Path;

use nalgebra::Vector3;

use super::recorded::Recorded;
use super::{LengthUnit, TrialFile, doubts, force, names};
use crate::error::{InputError, Mistakes, nearest};
use crate::natural::SegmentId;
use crate::read::{self, c3d};
use crate::trial::{MarkerTrack, Side, Trial};

impl TrialFile {
    /// Reads the recordings and makes the trial; every mistake is named. `data`: folder of the recordings, besides that of the trial file.
    pub fn load(&self, data: Option<&Path>) -> Result<Trial, InputError> {
        let mut wrong = Mistakes::default();
        let trial = self.gather(data, &mut wrong);
        wrong.finish()?;
        trial.ok_or_else(|| self.bad_value("motion", format!("`{}`", self.motion.display()), "no trial"))
    }

    /// What rarely is as the file says, a sentence each; nothing is refused for it. `trial`: what [`TrialFile::load`] made.
    pub fn doubts(&self, trial: &Trial) -> Vec<String> {
        doubts::rarely_true(self, trial)
    }

    /// Goes as far as the mistakes let it: what hangs on something wrong is not examined.
    fn gather(&self, data: Option<&Path>, wrong: &mut Mistakes) -> Option<Trial> {
        let others =
            self.force.file.iter().chain(&self.landmarks.static_trial).chain(&self.landmarks.motions);
        for given in others {
            wrong.keep(self.find(given, data));
        }
        let recorded = wrong.keep(self.record(&self.motion, data))?;
        let wanted: Vec<_> = self.markers.all().collect();
        let mut markers = self.tracks(&recorded, &wanted, wrong);
        let landmarks = self.tracks(&recorded, &self.landmark_markers_of_the_trial(), wrong);
        let complete = wrong.is_empty();
        let seen = |segment| markers.iter().any(|t: &MarkerTrack| t.segment == segment);
        // The size of a leg of which a segment is missing says nothing.
        if markers.len() == wanted.len()
            || [SegmentId::Pelvis, SegmentId::Thigh, SegmentId::Foot].into_iter().all(seen)
        {
            doubts::examine(self, &recorded, &markers, &landmarks, wrong);
        }
        if complete {
            self.compare_with_other_sources(&recorded, &markers, data, wrong);
        } else if self.landmarks.source == super::Source::Table {
            wrong.keep(self.landmark_table(data));
        }
        wrong.keep(self.check_cut_off("motion_hz", self.filter.motion_hz, recorded.markers.rate_hz));
        let plates = force::plates(self, &recorded, data, wrong);
        if !wrong.is_empty() {
            return None; // whose step it is cannot be told with wrong markers or plates
        }
        let steps = force::steps(self, &plates, &recorded.markers, &markers, wrong)?;
        let (start, end) = wrong.keep(force::range(self, &plates, &steps, &recorded))?;
        let mut ground = force::ground_reaction(&plates, &steps);
        let n = ground.time.len();
        let force_rate = (n - 1) as f64 / (ground.time[n - 1] - ground.time[0]);
        wrong.keep(self.check_cut_off("force_hz", self.filter.force_hz, force_rate))?;

        for track in &mut markers {
            fill_gaps(&mut track.position, self.gaps.fill_up_to_frames);
        }
        if self.subject.side == Side::Left {
            mirror(&mut markers);
            ground.force.iter_mut().for_each(|f| f.z = -f.z);
            // A moment turns the other way in the mirror: S r × S f = −S (r × f).
            ground.moment.iter_mut().for_each(|m| *m = Vector3::new(-m.x, -m.y, m.z));
        }
        let (first, rate) = (recorded.markers.time[0], recorded.markers.rate_hz);
        let frame = |time: f64| ((time - first) * rate).round() as usize;
        Some(Trial {
            name: self.name(),
            side: self.subject.side,
            subject: self.subject(),
            time: (0..recorded.markers.time.len()).map(|i| first + i as f64 / rate).collect(),
            report: frame(start)..frame(end) + 1,
            markers,
            ground,
        })
    }

    /// A low-pass needs a cut-off below half the sampling rate.
    fn check_cut_off(&self, key: &str, cut_off: f64, rate: f64) -> Result<(), InputError> {
        if cut_off < 0.5 * rate {
            return Ok(());
        }
        let remedy = format!("the samples come at {rate:.1} Hz: give a cut-off below {:.1} Hz", 0.5 * rate);
        Err(self.bad_value(key, cut_off, &remedy))
    }

    /// Reads a motion file and turns it to ground axes.
    pub(super) fn record(&self, given: &Path, data: Option<&Path>) -> Result<Recorded, InputError> {
        let path = self.find(given, data)?;
        let (mut markers, mut c3d) = match read::ending(&path).as_str() {
            "c3d" => {
                let mut c3d = c3d::read(&path)?;
                (std::mem::take(&mut c3d.markers), Some(c3d))
            }
            _ => (read::read_markers(&path)?, None),
        };
        if markers.time.len() < 2 {
            let remedy = "a trial needs two frames or more; export the whole trial".to_string();
            let problem = format!("the recording has {} frames", markers.time.len());
            return Err(InputError::Malformed {
                file: path,
                at: crate::error::Place::Whole,
                problem,
                remedy,
            });
        }
        // What a recording says of itself goes before what holds for all.
        let own = self.recording.iter().find(|r| r.file == given);
        if own.and_then(|r| r.zeros_missing).unwrap_or(self.zeros_missing) {
            markers.zeros_to_gaps();
        }
        let scale = match own.and_then(|r| r.units).or(self.units) {
            Some(unit) => unit.metres() / read::metres_per(&markers.file_unit).unwrap_or(1.0),
            None => 1.0,
        };
        let turn = own.and_then(|r| r.axes).unwrap_or(self.axes).rotation() * scale;
        markers.position.iter_mut().flatten().flatten().for_each(|p| *p = turn * *p);
        for plate in c3d.iter_mut().flat_map(|c| &mut c.plates) {
            plate.corners.iter_mut().for_each(|c| *c *= scale);
            plate.origin *= scale;
        }
        Ok(Recorded { path, markers, c3d })
    }

    /// The paths of named markers; those that cannot be used are left out and noted.
    pub(super) fn tracks(
        &self,
        recorded: &Recorded,
        wanted: &[(&str, SegmentId)],
        wrong: &mut Mistakes,
    ) -> Vec<MarkerTrack> {
        let track = |&(name, segment): &(&str, SegmentId)| self.one_track(recorded, name, segment);
        wanted.iter().filter_map(|w| wrong.keep(track(w))).collect()
    }

    fn one_track(
        &self,
        recorded: &Recorded,
        name: &str,
        segment: SegmentId,
    ) -> Result<MarkerTrack, InputError> {
        let m = &recorded.markers;
        let index = match names::find(&m.names, name) {
            Ok(Some(index)) => index,
            Ok(None) => {
                return Err(InputError::UnknownName {
                    file: self.path.clone(),
                    line: self.line_of(name),
                    name: name.to_string(),
                    within: recorded.path.clone(),
                    nearest: nearest(name, m.names.iter().map(String::as_str)),
                });
            }
            Err(names::Ambiguous(candidates)) => {
                let remedy = match candidates.iter().all(|c| *c == candidates[0]) {
                    true => "the recording has two markers of that name; rename one of them".to_string(),
                    false => format!(
                        "the recording has {}; write the name with its prefix",
                        candidates.join(" and ")
                    ),
                };
                return Err(self.bad_value(name, "ambiguous", &remedy));
            }
        };
        let position = m.position[index].clone();
        let file = recorded.path.clone();
        if position.iter().all(Option::is_none) {
            let (marker, frames, zeros) = (name.to_string(), position.len(), self.zeros_missing);
            return Err(InputError::NeverSeen { file, marker, frames, zeros });
        }
        if let Some(frame) = position.iter().position(|p| *p == Some(Vector3::zeros())) {
            let (frame, marker) = (m.first_frame + frame, name.to_string());
            return Err(InputError::ExactZero { file, frame, marker });
        }
        Ok(MarkerTrack { name: name.to_string(), segment, position })
    }
}

impl LengthUnit {
    /// As written in files.
    pub fn name(self) -> &'static str {
        match self {
            LengthUnit::M => "m",
            LengthUnit::Cm => "cm",
            LengthUnit::Mm => "mm",
        }
    }

    pub(super) fn metres(self) -> f64 {
        match self {
            LengthUnit::M => 1.0,
            LengthUnit::Cm => 1e-2,
            LengthUnit::Mm => 1e-3,
        }
    }
}

/// A left leg becomes a right one: Z → −Z.
pub(super) fn mirror(tracks: &mut [MarkerTrack]) {
    tracks.iter_mut().flat_map(|t| t.position.iter_mut().flatten()).for_each(|p| p.z = -p.z);
}

/// Fills gaps of up to `longest` frames that have a seen neighbour on either side: cubic Hermite polynomial with the
/// slopes of the neighbours (one-sided differences; the chord where there is no second neighbour).
fn fill_gaps(path: &mut [Option<Vector3<f64>>], longest: usize) {
    let mut end = 0;
    while let Some(start) = (end..path.len()).find(|&i| path[i].is_none()) {
        end = (start..path.len()).find(|&i| path[i].is_some()).unwrap_or(path.len());
        let length = end - start;
        if start == 0 || end == path.len() || length > longest {
            continue;
        }
        let (Some(a), Some(b)) = (path[start - 1], path[end]) else { continue };
        let span = (length + 1) as f64;
        let chord = (b - a) / span;
        let before = start.checked_sub(2).and_then(|i| path[i]).map_or(chord, |p| a - p);
        let after = path.get(end + 1).copied().flatten().map_or(chord, |p| p - b);
        for i in 0..length {
            let s = (i + 1) as f64 / span;
            let (s2, s3) = (s * s, s * s * s);
            path[start + i] = Some(
                a * (2.0 * s3 - 3.0 * s2 + 1.0)
                    + b * (3.0 * s2 - 2.0 * s3)
                    + before * (span * (s3 - 2.0 * s2 + s))
                    + after * (span * (s3 - s2)),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filled_gap_follows_a_parabola() {
        let point = |t: f64| Vector3::new(t, 2.0 - t, 0.01 * t * t);
        let whole: Vec<_> = (0..20).map(|i| Some(point(i as f64))).collect();
        let mut path = whole.clone();
        path[8..11].fill(None);
        path[15..20].fill(None);
        fill_gaps(&mut path, 3);
        for (i, (filled, true_one)) in path.iter().zip(&whole).enumerate().take(15) {
            let error = (filled.unwrap() - true_one.unwrap()).norm();
            // one-sided slopes are off by the curvature over half a frame
            assert!(error < 0.011, "frame {i}: {error}");
        }
        assert!(path[15..].iter().all(Option::is_none), "the end has no second neighbour");
        path[8..12].fill(None);
        fill_gaps(&mut path, 3);
        assert!(path[8..12].iter().all(Option::is_none), "longer than allowed");
    }
}
