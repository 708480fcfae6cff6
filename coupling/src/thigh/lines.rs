//! Which muscle lines of the rigid leg belong to which muscle of the thigh.

use std::collections::BTreeMap;

use csv::StringRecord;

/// For every muscle of the thigh that the table names, the names of its lines, in the order of the table
/// (`gait-data/muscles.csv`, column `fe_thigh_muscle`).
pub fn lines_of_muscles() -> BTreeMap<String, Vec<String>> {
    let mut lines = BTreeMap::<String, Vec<String>>::new();
    each_line("name", |muscle, name| lines.entry(muscle).or_default().push(name.to_string()));
    lines
}

/// Physiological cross-section of every muscle of the thigh \[m²\], the sum over its lines (`gait-data/muscles.csv`).
pub fn physiological_sections() -> BTreeMap<String, f64> {
    let mut sections = BTreeMap::<String, f64>::new();
    each_line("pcsa_cm2", |muscle, cm2| {
        *sections.entry(muscle).or_default() += 1e-4 * cm2.parse::<f64>().expect("built-in table");
    });
    sections
}

/// Calls `see` with the muscle and one column of every line that belongs to a muscle of the thigh.
fn each_line(column: &str, mut see: impl FnMut(String, &str)) {
    let mut reader = csv::Reader::from_reader(include_str!("../../../gait-data/muscles.csv").as_bytes());
    let headers = reader.headers().expect("built-in table").clone();
    let cell = |row: &StringRecord, name: &str| {
        let i = headers.iter().position(|h| h == name).expect("built-in table");
        row[i].to_string()
    };
    for row in reader.records() {
        let row = row.expect("built-in table");
        let muscle = cell(&row, "fe_thigh_muscle");
        if !muscle.is_empty() {
            see(muscle.replace(' ', "_"), &cell(&row, column));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::lines_of_muscles;

    #[test]
    fn seventeen_muscles_have_twenty_five_lines() {
        let lines = lines_of_muscles();
        assert_eq!(lines.len(), 17);
        // Three each for the glutei and the great adductor, one for the others.
        assert_eq!(lines.values().map(Vec::len).sum::<usize>(), 4 * 3 + 13);
        assert_eq!(lines["adductor_magnus"], ["addmag1", "addmag2", "addmag3"]);
    }
}
