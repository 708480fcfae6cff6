//! `modelDescription.xml`.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};

use crate::instance::CATEGORIES;
use crate::model::Model;
use crate::variable::{Causality, Kind, UNITS, Variable};

/// Name of the library in a unit.
pub const IDENTIFIER: &str = "sartorius_fmi";

/// What a unit says of itself.
pub struct Description<'a> {
    /// Name of the unit.
    pub name: &'a str,
    /// What it is.
    pub description: &'a str,
    /// Says which resources it was written with.
    pub token: &'a str,
}

impl Description<'_> {
    /// The text of the file.
    pub fn xml(&self, model: &Model) -> std::io::Result<String> {
        let variables = model.side().variables().clone();
        let [start, stop, step] = model.experiment();
        let mut w = Writer::new_with_indent(Vec::new(), b' ', 2);
        w.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        let version = env!("CARGO_PKG_VERSION");
        let top = [
            ("fmiVersion", "3.0"),
            ("modelName", self.name),
            ("description", self.description),
            ("instantiationToken", self.token),
            ("version", version),
            ("generationTool", "sartorius"),
            ("variableNamingConvention", "structured"),
        ];
        w.create_element("fmiModelDescription").with_attributes(top).write_inner_content(|w| {
            let can = [
                ("modelIdentifier", IDENTIFIER),
                ("canGetAndSetFMUState", "true"),
                ("canSerializeFMUState", "true"),
                ("canHandleVariableCommunicationStepSize", "true"),
                ("providesIntermediateUpdate", "true"),
                ("canReturnEarlyAfterIntermediateUpdate", "true"),
            ];
            w.create_element("CoSimulation").with_attributes(can).write_empty()?;
            units(w)?;
            w.create_element("LogCategories").write_inner_content(|w| {
                for (name, description) in CATEGORIES {
                    let of = [("name", name), ("description", description)];
                    w.create_element("Category").with_attributes(of).write_empty()?;
                }
                Ok(())
            })?;
            let numbers = [("startTime", start), ("stopTime", stop), ("stepSize", step)]
                .map(|(k, v)| (k, format!("{v}")));
            let experiment = numbers.iter().map(|(k, v)| (*k, v.as_str()));
            w.create_element("DefaultExperiment").with_attributes(experiment).write_empty()?;
            w.create_element("ModelVariables").write_inner_content(|w| {
                variables.iter().enumerate().try_for_each(|(number, v)| variable(w, number, v))
            })?;
            w.create_element("ModelStructure").write_inner_content(|w| structure(w, &variables))?;
            Ok(())
        })?;
        String::from_utf8(w.into_inner()).map_err(std::io::Error::other)
    }
}

fn units(w: &mut Writer<Vec<u8>>) -> std::io::Result<()> {
    w.create_element("UnitDefinitions").write_inner_content(|w| {
        for (name, exponents) in UNITS {
            w.create_element("Unit").with_attribute(("name", name)).write_inner_content(|w| {
                let texts = exponents.map(|e| e.to_string());
                let named = ["kg", "m", "s", "rad"].into_iter().zip(&texts);
                let base = named.filter(|(_, e)| *e != "0").map(|(k, e)| (k, e.as_str()));
                w.create_element("BaseUnit").with_attributes(base).write_empty()?;
                Ok(())
            })?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Numbers as they read back to the last bit.
fn list(values: &[f64]) -> String {
    values.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(" ")
}

fn variable(w: &mut Writer<Vec<u8>>, number: usize, v: &Variable) -> std::io::Result<()> {
    let element = match v.kind {
        Kind::Float64 => "Float64",
        Kind::Boolean => "Boolean",
        Kind::String => "String",
    };
    let mut attributes = vec![
        ("name", v.name.clone()),
        ("valueReference", number.to_string()),
        ("description", v.description.clone()),
    ];
    // Inputs change between steps, and outputs with them: nothing is a function of time within one.
    let variability = match (v.causality, v.kind) {
        (Causality::Constant, _) => "constant",
        (Causality::Independent, _) => "continuous",
        _ => "discrete",
    };
    attributes.push((
        "causality",
        match v.causality {
            Causality::Independent => "independent",
            Causality::Input => "input",
            Causality::Output | Causality::Constant => "output",
        }
        .into(),
    ));
    attributes.push(("variability", variability.into()));
    if v.causality == Causality::Constant {
        attributes.push(("initial", "exact".into()));
    }
    if !v.unit.is_empty() {
        attributes.push(("unit", v.unit.into()));
    }
    if v.causality == Causality::Input {
        let [least, most] = v.range;
        if v.kind == Kind::Float64 {
            attributes.extend(least.is_finite().then(|| ("min", format!("{least:?}"))));
            attributes.extend(most.is_finite().then(|| ("max", format!("{most:?}"))));
        }
        let start = match v.kind {
            Kind::Boolean => v.start.iter().map(|s| (*s != 0.0).to_string()).collect::<Vec<_>>().join(" "),
            _ => list(&v.start),
        };
        attributes.push(("start", start));
    }
    let element = w.create_element(element).with_attributes(attributes.iter().map(|(k, v)| (*k, v.as_str())));
    if v.dimensions.is_empty() {
        element.write_empty()?;
        return Ok(());
    }
    element.write_inner_content(|w| {
        for size in &v.dimensions {
            w.create_element("Dimension")
                .with_attribute(("start", size.to_string().as_str()))
                .write_empty()?;
        }
        for word in &v.words {
            w.create_element("Start").with_attribute(("value", word.as_str())).write_empty()?;
        }
        Ok(())
    })?;
    Ok(())
}

fn structure(w: &mut Writer<Vec<u8>>, variables: &[Variable]) -> std::io::Result<()> {
    let of =
        |w: &mut Writer<Vec<u8>>, element: &str, which: &dyn Fn(&Variable) -> bool| -> std::io::Result<()> {
            for (number, _) in variables.iter().enumerate().filter(|(_, v)| which(v)) {
                w.create_element(element)
                    .with_attribute(("valueReference", number.to_string().as_str()))
                    .write_empty()?;
            }
            Ok(())
        };
    of(w, "Output", &|v| matches!(v.causality, Causality::Output | Causality::Constant))?;
    of(w, "InitialUnknown", &|v| v.causality == Causality::Output)
}
