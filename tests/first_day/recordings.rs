use super::check::with_landmarks;
use super::*;

#[test]
fn prefixes_of_marker_names_may_be_left_away_or_be_there() {
    let reference = Walking::new().load().unwrap();
    let mut prefixed = Walking::new();
    prefixed.markers.iter_mut().for_each(|m| m.0 = format!("JW:{}", m.0));
    assert_eq!(prefixed.load().unwrap().markers, reference.markers, "the recording has a prefix");
    let mut written = Walking::new();
    written.replace("\"RASI\", ", "\"JW:RASI\", ");
    written.replace("\"right ASIS\" = \"RASI\"", "\"right ASIS\" = \"JW:RASI\"");
    let paths =
        |t: &multibody::trial::Trial| t.markers.iter().map(|m| m.position.clone()).collect::<Vec<_>>();
    assert_eq!(paths(&written.load().unwrap()), paths(&reference), "the trial file has one");
    let mut two = Walking::new();
    let second: Vec<_> = two.markers.iter().map(|m| (format!("B:{}", m.0), m.1.clone())).collect();
    two.markers.iter_mut().for_each(|m| m.0 = format!("A:{}", m.0));
    two.markers.extend(second);
    let said = two.load().unwrap_err().to_string();
    assert!(said.contains("`A:RASI` and `B:RASI`; write the name with its prefix"), "{said}");
}

#[test]
fn a_standing_trial_may_have_axes_units_and_gaps_of_its_own() {
    let spec = |walking: &Walking| {
        let file = TrialFile::read(&walking.write()).unwrap();
        (file.load(None).unwrap(), file.landmarks(None))
    };
    let mut walking = with_landmarks();
    walking.replace("source = \"markers\"", "source = \"markers\"\nstatic = \"still.trc\"");
    walking.write();
    fs::write(walking.folder().join("still.trc"), with_landmarks().trc()).unwrap();
    let (_, reference) = spec(&walking);
    // The same in a laboratory with z up, walking towards -x, in metres that claim to be millimetres.
    let mut other = with_landmarks();
    other.map(|p| Vector3::new(-p.x, p.z, p.y) * 1e-3);
    fs::write(walking.folder().join("still.trc"), other.trc()).unwrap();
    let refused = TrialFile::read(&walking.write()).unwrap().landmarks(None).unwrap_err().to_string();
    assert!(
        refused.contains("still.trc") && refused.contains("metres were read as millimetres"),
        "{refused}"
    );
    walking.toml +=
        "[[recording]]\nfile = \"still.trc\"\nunits = \"m\"\naxes = { x = \"-x\", y = \"z\", z = \"y\" }\n";
    let (_, turned) = spec(&walking);
    let tracks = |spec: multibody::trial_file::LandmarkSpec| match spec.source {
        multibody::trial_file::Landmarks::Markers { tracks, .. } => tracks,
        other => panic!("{other:?}"),
    };
    for (a, b) in tracks(reference.unwrap()).iter().zip(tracks(turned.unwrap())) {
        for (p, q) in a.position.iter().zip(&b.position) {
            assert!((p.unwrap() - q.unwrap()).norm() < 1e-9, "{}", a.name);
        }
    }
    walking.replace("[[recording]]\nfile = \"still.trc\"", "[[recording]]\nfile = \"stil.trc\"");
    let said = TrialFile::read(&walking.write()).unwrap_err().to_string();
    assert!(said.contains("of `stil.trc`"), "{said}");
}
