//! Which marker is which, by the names of common marker sets (`gait-data/marker_sets.csv`).

use std::sync::LazyLock;

use crate::natural::SegmentId;
use crate::trial::Side;
use crate::trial_file::names::bare;

/// One name of a set. `{S}` in it stands for the side, R or L.
pub(super) struct Row {
    pub set: String,
    name: String,
    /// `None`: the patella, which moves by itself.
    pub segment: Option<SegmentId>,
    /// Whether it moves with its segment, and so carries it.
    pub track: bool,
    /// Landmarks that it stands for, as keys of `[landmarks]`.
    pub landmarks: Vec<String>,
    /// Item of the subject's table.
    pub item: Option<String>,
}

static ROWS: LazyLock<Vec<Row>> = LazyLock::new(|| {
    let rows = crate::tables::rows(include_str!("../../../../gait-data/marker_sets.csv"));
    let segment = |name: &str| match name {
        "pelvis" => Some(SegmentId::Pelvis),
        "thigh" => Some(SegmentId::Thigh),
        "shank" => Some(SegmentId::Shank),
        "foot" => Some(SegmentId::Foot),
        _ => None,
    };
    let row = |row: std::collections::HashMap<String, String>| Row {
        set: row["set"].clone(),
        name: row["name"].clone(),
        segment: segment(&row["segment"]),
        track: row["track"] == "yes",
        landmarks: row["landmark"].split_whitespace().map(str::to_string).collect(),
        item: Some(row["item"].clone()).filter(|i| !i.is_empty()),
    };
    rows.into_iter().map(row).collect()
});

/// A set found in a recording, for one leg.
pub(super) struct Found {
    pub set: &'static str,
    /// Row and recorded name, in the order of the table.
    pub markers: Vec<(&'static Row, String)>,
}

impl Found {
    /// Recorded names that carry a segment.
    pub fn tracked(&self, segment: SegmentId) -> Vec<&str> {
        let on = |(row, _): &&(&Row, String)| row.segment == Some(segment) && row.track;
        self.markers.iter().filter(on).map(|(_, name)| name.as_str()).collect()
    }

    /// Recorded name of a landmark.
    pub fn landmark(&self, key: &str) -> Option<&str> {
        let stands = |(row, _): &&(&Row, String)| row.landmarks.iter().any(|l| l == key);
        self.markers.iter().find(stands).map(|(_, name)| name.as_str())
    }
}

/// The set of which most names are among the recorded ones; of equals the one whose spelling is exactly that of the recording.
pub(super) fn recognise(recorded: &[&str], side: Side) -> Option<Found> {
    let mut best: Option<((usize, usize), Found)> = None;
    let mut sets: Vec<&'static str> = ROWS.iter().map(|r| r.set.as_str()).collect();
    sets.dedup();
    for set in sets {
        let mut markers = Vec::new();
        let mut exact = 0;
        for row in ROWS.iter().filter(|r| r.set == set) {
            let name = row.name.replace("{S}", if side == Side::Right { "R" } else { "L" });
            if let Some(found) = recorded.iter().find(|r| plain(bare(r)) == plain(&name)) {
                exact += usize::from(bare(found) == name);
                if markers.iter().all(|(_, n)| n != found) {
                    markers.push((row, found.to_string()));
                }
            }
        }
        let score = (markers.len(), exact);
        if !markers.is_empty() && best.as_ref().is_none_or(|b| score > b.0) {
            best = Some((score, Found { set, markers }));
        }
    }
    best.map(|b| b.1)
}

/// Letters and digits in lower case: `R.Knee_Lat` is `rkneelat`.
fn plain(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}
