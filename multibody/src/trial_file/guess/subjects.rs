//! Subjects whose trials come with the program: what no recording says of them.

/// A subject of the competitions to predict knee loads (Fregly et al., J Orthop Res 2012;30:503-513).
pub(super) struct Subject {
    /// Code, as in the recording or at the start of its file name.
    pub name: &'static str,
    pub mass_kg: &'static str,
    pub height_m: &'static str,
    pub sex: &'static str,
    /// Marker set of the recordings.
    pub set: &'static str,
    /// Table of local coordinates that comes with the program.
    pub table: Option<&'static str>,
    /// Hip centre as TOML, and where it is from.
    pub hip_centre: Option<(&'static str, &'static str)>,
}

const SUBJECTS: [Subject; 2] = [
    Subject {
        name: "DM",
        mass_kg: "70.0",
        height_m: "1.72",
        sex: "\"male\"",
        set: "Grand Challenge 6",
        table: Some("DM.csv"),
        hip_centre: Some(("\"table\"", "as in DM.osim")),
    },
    Subject {
        name: "JW",
        mass_kg: "66.7",
        height_m: "1.68",
        sex: "\"male\"",
        set: "Grand Challenge 4",
        table: None,
        hip_centre: Some((
            "[-0.0772, -0.0900, 0.0731]",
            "that of subject DM scaled with the pelvis width (272.6 / 275.1 mm): of the candidates it leaves the least marker residual",
        )),
    },
];

/// The subject by the name in the recording or at the start of the file name, and by the marker set.
pub(super) fn known(recorded: Option<&str>, stem: &str, set: Option<&str>) -> Option<&'static Subject> {
    let start = stem.split(['_', '-', ' ']).next().unwrap_or("");
    SUBJECTS.iter().find(|s| {
        let named =
            recorded.is_some_and(|r| r.eq_ignore_ascii_case(s.name)) || start.eq_ignore_ascii_case(s.name);
        named && set == Some(s.set)
    })
}
