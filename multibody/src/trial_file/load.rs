//! From a trial file and its recordings to a [`Trial`].

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::{LengthUnit, TrialFile, doubts, force};
use crate::error::{InputError, nearest};
use crate::natural::SegmentId;
use crate::read::{self, MarkerRecording, c3d};
use crate::trial::{MarkerTrack, Side, Trial};

/// A motion file; the markers already in ground axes, not yet mirrored.
pub(super) struct Recorded {
    pub path: PathBuf,
    pub markers: MarkerRecording,
    /// Plates and analog channels in the axes of the file, where it is a C3D file.
    pub c3d: Option<c3d::C3d>,
}

impl TrialFile {
    /// Reads the recordings and makes the trial. `data`: folder of the recordings, besides that of the trial file.
    pub fn load(&self, data: Option<&Path>) -> Result<Trial, InputError> {
        let recorded = self.record(&self.motion, data)?;
        let wanted: Vec<_> = self.markers.all().collect();
        let mut markers = self.tracks(&recorded, &wanted)?;
        let landmarks = self.tracks(&recorded, &self.landmark_markers_of_the_trial())?;
        doubts::examine(self, &recorded, &markers, &landmarks)?;
        self.compare_with_other_sources(&recorded, &markers, data)?;

        self.check_cut_off("motion_hz", self.filter.motion_hz, recorded.markers.rate_hz)?;
        let plates = force::plates(self, &recorded, data)?;
        let steps = force::steps(self, &plates, &recorded.markers, &markers)?;
        let (start, end) = force::range(self, &plates, &steps, &recorded)?;
        let mut ground = force::ground_reaction(&plates, &steps);
        let n = ground.time.len();
        let force_rate = (n - 1) as f64 / (ground.time[n - 1] - ground.time[0]);
        self.check_cut_off("force_hz", self.filter.force_hz, force_rate)?;

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
        Ok(Trial {
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
        if self.zeros_missing {
            markers.zeros_to_gaps();
        }
        let scale = match self.units {
            Some(unit) => unit.metres() / read::metres_per(&markers.file_unit).unwrap_or(1.0),
            None => 1.0,
        };
        let turn = self.axes.rotation() * scale;
        markers.position.iter_mut().flatten().flatten().for_each(|p| *p = turn * *p);
        for plate in c3d.iter_mut().flat_map(|c| &mut c.plates) {
            plate.corners.iter_mut().for_each(|c| *c *= scale);
            plate.origin *= scale;
        }
        Ok(Recorded { path, markers, c3d })
    }

    /// The paths of named markers.
    pub(super) fn tracks(
        &self,
        recorded: &Recorded,
        wanted: &[(&str, SegmentId)],
    ) -> Result<Vec<MarkerTrack>, InputError> {
        let m = &recorded.markers;
        let mut tracks = Vec::with_capacity(wanted.len());
        for &(name, segment) in wanted {
            let Some(index) = m.index(name) else {
                return Err(InputError::UnknownName {
                    file: self.path.clone(),
                    line: self.line_of(name),
                    name: name.to_string(),
                    within: recorded.path.clone(),
                    nearest: nearest(name, m.names.iter().map(String::as_str)),
                });
            };
            if m.names.iter().filter(|n| *n == name).count() > 1 {
                let remedy = "the recording has two markers of that name; rename one of them";
                return Err(self.bad_value(name, "ambiguous", remedy));
            }
            let position = m.position[index].clone();
            let file = recorded.path.clone();
            if position.iter().all(Option::is_none) {
                let zeros = self.zeros_missing;
                return Err(InputError::NeverSeen {
                    file,
                    marker: name.to_string(),
                    frames: position.len(),
                    zeros,
                });
            }
            if let Some(frame) = position.iter().position(|p| *p == Some(Vector3::zeros())) {
                return Err(InputError::ExactZero {
                    file,
                    frame: m.first_frame + frame,
                    marker: name.to_string(),
                });
            }
            tracks.push(MarkerTrack { name: name.to_string(), segment, position });
        }
        Ok(tracks)
    }
}

impl LengthUnit {
    fn metres(self) -> f64 {
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
