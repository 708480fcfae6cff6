//! A recording as it was read.

use std::path::PathBuf;

use super::names;
use crate::read::{MarkerRecording, c3d};

/// A motion file; the markers already in ground axes, not yet mirrored.
pub(super) struct Recorded {
    pub path: PathBuf,
    pub markers: MarkerRecording,
    /// Plates and analog channels in the axes of the file, where it is a C3D file.
    pub c3d: Option<c3d::C3d>,
}

impl Recorded {
    /// Index of a marker, whose prefix may be left away or be one too many.
    pub fn find(&self, name: &str) -> Option<usize> {
        names::find(&self.markers.names, name).ok().flatten()
    }
}
