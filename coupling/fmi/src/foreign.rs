//! A unit of somebody else (co-simulation, FMI 2 or 3) that says how hard the muscles of the thigh pull.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use multibody::error::nearest;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use crate::error::UnitError;
use crate::host::{Library, Version};

/// What a unit says of itself, as far as it is asked for.
#[derive(Debug, Default, PartialEq)]
struct Described {
    version: String,
    token: String,
    /// Name of its library; empty: it is none for co-simulation.
    identifier: String,
    /// Scalar outputs of double precision with their value references.
    outputs: BTreeMap<String, u32>,
}

/// Activations of `muscles` at the frames `rows` of `times` \[s\], rising, per row. The unit starts at the first of the times and goes from
/// frame to frame; each muscle is a scalar output of its name.
pub fn activations(
    file: &Path,
    muscles: &[&str],
    times: &[f64],
    rows: &[usize],
) -> Result<Vec<Vec<f64>>, UnitError> {
    let bad = |why: String| UnitError::Wrong(format!("the controller {}: {why}", file.display()));
    let folder = tempfile::tempdir().map_err(|e| bad(e.to_string()))?;
    let archive = std::fs::File::open(file).map_err(|e| bad(e.to_string()))?;
    let archive = zip::ZipArchive::new(archive).and_then(|mut zip| zip.extract(folder.path()));
    archive.map_err(|e| bad(format!("it is no unit: {e}")))?;
    let xml = folder.path().join("modelDescription.xml");
    let xml =
        std::fs::read_to_string(&xml).map_err(|e| bad(format!("it has no modelDescription.xml: {e}")))?;
    let described = describe(&xml).map_err(|e| bad(format!("modelDescription.xml: {e}")))?;
    let version = match described.version.split('.').next() {
        Some("2") => Version::Two,
        Some("3") => Version::Three,
        _ => {
            let found = &described.version;
            return Err(bad(format!(
                "it is a unit of FMI {found}; a controller is one for co-simulation of FMI 2 or 3"
            )));
        }
    };
    if described.identifier.is_empty() {
        return Err(bad("it is a unit for model exchange; a controller is one for co-simulation".into()));
    }
    let missing: Vec<String> = muscles
        .iter()
        .filter(|m| !described.outputs.contains_key(**m))
        .map(|m| match nearest(m, described.outputs.keys().map(String::as_str)) {
            Some(near) => format!("`{m}` (did you mean `{near}`?)"),
            None => format!("`{m}`"),
        })
        .collect();
    if !missing.is_empty() {
        return Err(bad(format!(
            "it has no scalar output of the name {}; every muscle of the scene needs one",
            missing.join(", ")
        )));
    }
    let references: Vec<u32> = muscles.iter().map(|m| described.outputs[*m]).collect();
    let library = folder.path().join(binary(version, &described.identifier));
    if !library.is_file() {
        let here = binary(version, &described.identifier);
        return Err(bad(format!("it has no library for this machine, {}", here.display())));
    }
    let resources = folder.path().join("resources");
    let mut unit = Library::instantiate(&library, version, &described.token, &resources).map_err(bad)?;
    let mut found = Vec::new();
    unit.initialize(times[0]).map_err(bad)?;
    for (row, time) in times.iter().enumerate() {
        if let Some(before) = row.checked_sub(1) {
            unit.step(times[before], time - times[before]).map_err(bad)?;
        }
        if rows.contains(&row) {
            found.push(unit.get(&references).map_err(bad)?);
        }
        if rows.iter().all(|r| *r <= row) {
            break;
        }
    }
    Ok(found)
}

/// Where the library for this machine is in a unit.
fn binary(version: Version, identifier: &str) -> PathBuf {
    let (architecture, system) = (std::env::consts::ARCH, std::env::consts::OS);
    let folder = match (version, system) {
        (Version::Two, "macos") => "darwin64".to_string(),
        (Version::Two, "windows") => "win64".to_string(),
        (Version::Two, other) => format!("{other}64"),
        (Version::Three, "macos") => format!("{architecture}-darwin"),
        (Version::Three, other) => format!("{architecture}-{other}"),
    };
    Path::new("binaries").join(folder).join(format!("{identifier}{}", std::env::consts::DLL_SUFFIX))
}

fn describe(xml: &str) -> Result<Described, String> {
    let mut described = Described::default();
    let mut reader = Reader::from_str(xml);
    // The output that is being read: FMI 2 says its type in an element below, FMI 3 its dimensions.
    let mut open: Option<(String, u32)> = None;
    loop {
        let event = reader.read_event().map_err(|e| e.to_string())?;
        match &event {
            Event::Eof => return Ok(described),
            Event::Start(e) | Event::Empty(e) => {
                let is_empty = matches!(event, Event::Empty(_));
                match e.name().as_ref() {
                    "fmiModelDescription" => {
                        described.version = attribute(e, "fmiVersion").unwrap_or_default();
                        let token = attribute(e, "instantiationToken").or_else(|| attribute(e, "guid"));
                        described.token = token.unwrap_or_default();
                    }
                    "CoSimulation" => {
                        described.identifier = attribute(e, "modelIdentifier").unwrap_or_default();
                    }
                    "ScalarVariable" => open = output(e),
                    "Real" => described.outputs.extend(open.take()),
                    "Float64" if is_empty => described.outputs.extend(output(e)),
                    "Float64" => open = output(e),
                    "Dimension" => open = None,
                    _ => {}
                }
            }
            Event::End(e) if e.name().as_ref() == "Float64" => described.outputs.extend(open.take()),
            _ => {}
        }
    }
}

/// Name and value reference of an output.
fn output(e: &BytesStart) -> Option<(String, u32)> {
    let is_output = attribute(e, "causality").is_some_and(|c| c == "output");
    let reference = attribute(e, "valueReference")?.parse().ok()?;
    is_output.then_some((attribute(e, "name")?, reference))
}

fn attribute(e: &BytesStart, name: &str) -> Option<String> {
    let found = e.try_get_attribute(name).ok()??;
    found.normalized_value(XmlVersion::Implicit1_0).ok().map(|value| value.into_owned())
}

#[cfg(test)]
mod tests {
    use super::describe;

    #[test]
    fn scalar_outputs_of_both_versions_are_found_and_nothing_else() {
        let two = r#"<fmiModelDescription fmiVersion="2.0" guid="{g}"><CoSimulation modelIdentifier="c"/><ModelVariables>
            <ScalarVariable name="a" valueReference="1" causality="output"><Real/></ScalarVariable>
            <ScalarVariable name="b" valueReference="2" causality="output"><Integer/></ScalarVariable>
            <ScalarVariable name="c" valueReference="3" causality="input"><Real start="0"/></ScalarVariable>
            </ModelVariables></fmiModelDescription>"#;
        let three = r#"<fmiModelDescription fmiVersion="3.0" instantiationToken="{g}"><CoSimulation modelIdentifier="c"/><ModelVariables>
            <Float64 name="a" valueReference="1" causality="output"/>
            <Float64 name="b" valueReference="2" causality="output"><Dimension start="3"/></Float64>
            <Float64 name="d" valueReference="4" causality="output"><Alias name="e"/></Float64>
            <Float64 name="c" valueReference="3" causality="local"/></ModelVariables></fmiModelDescription>"#;
        for (xml, version, names) in [(two, "2.0", &["a"][..]), (three, "3.0", &["a", "d"])] {
            let found = describe(xml).unwrap();
            assert_eq!(
                (found.version.as_str(), found.token.as_str(), found.identifier.as_str()),
                (version, "{g}", "c")
            );
            assert!(found.outputs.keys().eq(names), "{:?}", found.outputs);
        }
        assert!(describe("<fmiModelDescription").is_err());
    }
}
