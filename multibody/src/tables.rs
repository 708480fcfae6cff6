//! The tables of `gait-data/` that are built into the program: joints, muscle lines, segment inertia, weights.
//!
//! They are part of the program, so a malformed one is a programming error and panics in the tests of this file.

use std::collections::HashMap;
use std::sync::LazyLock;

use nalgebra::Vector3;

/// Rows of a table as maps from column name to text.
pub(crate) fn rows(text: &str) -> Vec<HashMap<String, String>> {
    csv::Reader::from_reader(text.as_bytes())
        .deserialize()
        .map(|row| row.expect("built-in tables are well formed"))
        .collect()
}

pub(crate) fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    let text = &row[column];
    text.trim().parse().unwrap_or_else(|_| panic!("built-in table: `{column}` holds `{text}`"))
}

/// Points, axes, radii and lengths of the joints (`joints.csv`), right leg, SCS axes \[m\].
pub struct JointTable(HashMap<(String, String), Vector3<f64>>);

impl JointTable {
    /// The built-in table.
    pub fn built_in() -> &'static JointTable {
        static TABLE: LazyLock<JointTable> = LazyLock::new(|| {
            let entries = rows(include_str!("../../gait-data/joints.csv")).into_iter().map(|row| {
                let optional = |column: &str| if row[column].is_empty() { 0.0 } else { number(&row, column) };
                let value = Vector3::new(number(&row, "x_or_value"), optional("y"), optional("z"));
                ((row["joint"].clone(), row["item"].clone()), value)
            });
            JointTable(entries.collect())
        });
        &TABLE
    }

    /// A point \[m\] or a direction.
    pub fn point(&self, joint: &str, item: &str) -> Vector3<f64> {
        *self
            .0
            .get(&(joint.to_string(), item.to_string()))
            .unwrap_or_else(|| panic!("joints.csv lacks `{item}` of `{joint}`"))
    }

    /// A radius or length \[m\].
    pub fn scalar(&self, joint: &str, item: &str) -> f64 {
        self.point(joint, item).x
    }
}

/// One row of `segments.csv` (Dumas & Wojtusch 2018, revised values): fractions of body mass and segment length.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentTable {
    /// Segment mass over body mass.
    pub mass: f64,
    /// Centre of mass in SCS over segment length, from rP.
    pub com: Vector3<f64>,
    /// Radii of gyration over length about the centre of mass: xx, yy, zz.
    pub gyration: Vector3<f64>,
    /// Signed radii of the products of inertia over length: xy, xz, yz.
    pub products: Vector3<f64>,
}

/// Inertia fractions of `segment` ("thigh", "shank" or "foot") for `sex` ("male", "female").
pub fn segment_inertia(segment: &str, sex: &str) -> SegmentTable {
    let table = rows(include_str!("../../gait-data/segments.csv"));
    let row = table
        .iter()
        .find(|r| r["segment"] == segment && r["sex"] == sex && r["table"].contains("revised"))
        .expect("segments.csv lists thigh, shank and foot of both sexes");
    let fraction = |column: &str| number(row, column) / 100.0;
    let triple = |names: [&str; 3]| Vector3::from(names.map(fraction));
    SegmentTable {
        mass: fraction("mass_pct_body"),
        com: triple(["com_x_pctL", "com_y_pctL", "com_z_pctL"]),
        gyration: triple(["rxx_pctL", "ryy_pctL", "rzz_pctL"]),
        products: triple(["Ixy_signed_pctL", "Ixz_signed_pctL", "Iyz_signed_pctL"]),
    }
}

/// Names of the 43 muscle lines, in the order of forces and lever arms (`muscles.csv`).
pub fn muscle_names() -> Vec<String> {
    rows(include_str!("../../gait-data/muscles.csv")).into_iter().map(|row| row["name"].clone()).collect()
}

/// A centre of `pelvis_centres.csv` ("lumbar", "hip_right") as a fraction of the pelvis width, from the midpoint of
/// the ASISs in pelvis axes.
pub fn pelvis_centre(centre: &str, sex: &str) -> Vector3<f64> {
    let table = rows(include_str!("../../gait-data/pelvis_centres.csv"));
    let row = table
        .iter()
        .find(|r| r["centre"] == centre && r["sex"] == sex)
        .expect("pelvis_centres.csv lists both sexes");
    Vector3::from(["x_pct_pelvis_width", "y_pct", "z_pct"].map(|c| number(row, c) / 100.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ligament_lengths_are_the_distances_of_their_points() {
        let table = JointTable::built_in();
        for ligament in ["ACL", "PCL", "MCL"] {
            let origin = table.point("tibiofemoral", &format!("{ligament} origin"));
            let insertion = table.point("tibiofemoral", &format!("{ligament} insertion"));
            let length = table.scalar("tibiofemoral", &format!("{ligament} length"));
            assert!(((origin - insertion).norm() - length).abs() < 1e-9, "{ligament}");
        }
    }
}
