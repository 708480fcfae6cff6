//! The right leg of an OpenSim model file as the three tables that `MusculotendonModel::from_tables` reads.
//!
//! Covers what gait2392 uses: three kinds of path points, custom joints with linear, constant, spline and scaled
//! functions.

use std::fmt::Write;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// One XML element.
#[derive(Default)]
struct Element {
    tag: String,
    name: String,
    text: String,
    children: Vec<Element>,
}

impl Element {
    fn child(&self, tag: &str) -> &Element {
        let found = self.children.iter().find(|c| c.tag == tag);
        found.unwrap_or_else(|| panic!("<{} name=\"{}\"> has no <{tag}>", self.tag, self.name))
    }

    /// Depth-first search by tag and name.
    fn find(&self, tag: &str, name: &str) -> Option<&Element> {
        if self.tag == tag && self.name == name {
            return Some(self);
        }
        self.children.iter().find_map(|c| c.find(tag, name))
    }

    /// All descendants with this tag.
    fn all<'a>(&'a self, tag: &str, into: &mut Vec<&'a Element>) {
        if self.tag == tag {
            into.push(self);
        }
        self.children.iter().for_each(|c| c.all(tag, into));
    }

    fn numbers(&self) -> Vec<f64> {
        self.text.split_whitespace().map(|t| t.parse().expect("number")).collect()
    }

    /// Last part of a component path such as `/bodyset/femur_r`.
    fn leaf(&self) -> &str {
        self.text.trim().rsplit('/').next().expect("split yields one part at least")
    }

    fn cells(&self) -> String {
        self.numbers().iter().map(f64::to_string).collect::<Vec<_>>().join(",")
    }
}

fn start(event: &BytesStart) -> Element {
    let name = event.attributes().flatten().find(|a| a.key.as_ref() == "name");
    Element {
        tag: event.name().as_ref().to_string(),
        name: name.map_or(String::new(), |a| a.value.to_string()),
        ..Default::default()
    }
}

fn parse(xml: &str) -> Element {
    let mut reader = Reader::from_str(xml);
    let mut open = vec![Element::default()];
    loop {
        match reader.read_event().expect("well-formed XML") {
            Event::Start(e) => open.push(start(&e)),
            Event::Empty(e) => {
                let element = start(&e);
                open.last_mut().expect("root").children.push(element);
            }
            Event::Text(t) => {
                open.last_mut().expect("root").text.push_str(&t);
            }
            Event::End(_) => {
                let element = open.pop().expect("balanced");
                open.last_mut().expect("balanced").children.push(element);
            }
            Event::Eof => return open.pop().expect("root"),
            _ => {}
        }
    }
}

/// A function as (kind, knots, values); `MultiplierFunction` is multiplied out.
fn function(parent: &Element) -> (&'static str, String, String) {
    if let Some(scaled) = parent.children.iter().find(|c| c.tag == "MultiplierFunction") {
        let scale = scaled.child("scale").numbers()[0];
        return unscaled(scaled.child("function"), scale);
    }
    unscaled(parent, 1.0)
}

fn unscaled(parent: &Element, scale: f64) -> (&'static str, String, String) {
    let join = |v: Vec<f64>| v.iter().map(f64::to_string).collect::<Vec<_>>().join(";");
    for f in &parent.children {
        match f.tag.as_str() {
            "LinearFunction" => {
                assert_eq!(f.child("coefficients").numbers(), [1.0, 0.0]);
                assert_eq!(scale, 1.0);
                return ("LinearFunction", String::new(), String::new());
            }
            "Constant" => {
                assert_eq!(f.child("value").numbers(), [0.0]);
                return ("Constant", String::new(), String::new());
            }
            "SimmSpline" => {
                let values = f.child("y").numbers().iter().map(|y| y * scale).collect();
                return ("SimmSpline", join(f.child("x").numbers()), join(values));
            }
            _ => {}
        }
    }
    panic!("<{} name=\"{}\"> holds no known function", parent.tag, parent.name)
}

/// Tables of muscles (in the order of `names`), points and joints.
pub fn tables(xml: &str, names: &[&str]) -> (String, String, String) {
    let root = parse(xml);
    let mut muscles = String::from(
        "name,model_name,max_isometric_force_N,opt_fibre_length_m,tendon_slack_length_m,pennation_at_opt_rad,\
         vmax_fibre_lengths_per_s,tau_act_s,tau_deact_s\n",
    );
    let mut points = String::from(
        "muscle,order,type,body,x_m,y_m,z_m,coordinate,range_min_rad,range_max_rad,\
         x_knots_rad,x_values_m,y_knots_rad,y_values_m,z_knots_rad,z_values_m\n",
    );
    for name in names {
        let muscle = root.find("Thelen2003Muscle", name).expect("muscle in the model");
        let value = |tag: &str| muscle.child(tag).cells();
        writeln!(
            muscles,
            "{name},{name},{},{},{},{},{},{},{}",
            value("max_isometric_force"),
            value("optimal_fiber_length"),
            value("tendon_slack_length"),
            value("pennation_angle_at_optimal"),
            value("max_contraction_velocity"),
            value("activation_time_constant"),
            value("deactivation_time_constant"),
        )
        .unwrap();
        let path = muscle.child("GeometryPath").child("PathPointSet").child("objects");
        for (i, point) in path.children.iter().enumerate() {
            let head =
                format!("{name},{},{},{}", i + 1, point.tag, point.child("socket_parent_frame").leaf());
            match point.tag.as_str() {
                "MovingPathPoint" => {
                    let spline = |axis: &str| {
                        assert_eq!(
                            point.child(&format!("socket_{axis}_coordinate")).leaf(),
                            point.child("socket_x_coordinate").leaf()
                        );
                        let (kind, knots, values) = function(point.child(&format!("{axis}_location")));
                        assert_eq!(kind, "SimmSpline");
                        format!("{knots},{values}")
                    };
                    let coordinate = point.child("socket_x_coordinate").leaf();
                    let (x, y, z) = (spline("x"), spline("y"), spline("z"));
                    writeln!(points, "{head},,,,{coordinate},,,{x},{y},{z}").unwrap();
                }
                "ConditionalPathPoint" => {
                    let coordinate = point.child("socket_coordinate").leaf();
                    let (at, range) = (point.child("location").cells(), point.child("range").cells());
                    writeln!(points, "{head},{at},{coordinate},{range},,,,,,").unwrap();
                }
                _ => writeln!(points, "{head},{},,,,,,,,,", point.child("location").cells()).unwrap(),
            }
        }
    }
    (muscles, points, joints(&root))
}

fn joints(root: &Element) -> String {
    let mut table = String::from("joint,kind,item,x,y,z,note,knots,values\n");
    for name in ["hip_r", "knee_r", "ankle_r", "subtalar_r", "mtp_r"] {
        let joint = root.find("CustomJoint", name).expect("joint in the model");
        for frame in &joint.child("frames").children {
            assert_eq!(frame.child("orientation").numbers(), [0.0; 3]);
            let body = frame.child("socket_parent").leaf();
            writeln!(table, "{name},offset_frame,{body},{},,,", frame.child("translation").cells()).unwrap();
        }
        let mut axes = Vec::new();
        joint.child("SpatialTransform").all("TransformAxis", &mut axes);
        for axis in axes {
            let (kind, knots, values) = function(axis);
            let (item, direction) = (&axis.name, axis.child("axis").cells());
            let note = format!("coordinate={} function={kind}", axis.child("coordinates").text.trim());
            writeln!(table, "{name},axis,{item},{direction},{note},{knots},{values}").unwrap();
        }
    }
    table
}
