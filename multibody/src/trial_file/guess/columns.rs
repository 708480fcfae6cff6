//! Which columns of a force table belong to which plate: names that end in vx, px, and those of moments.

use crate::read::TimeSeries;

/// Columns of one plate.
#[derive(Debug, PartialEq)]
pub(super) struct Columns {
    /// The number in the names, or the place in the file.
    pub plate: usize,
    pub force: [String; 3],
    pub point: [String; 3],
    /// `None`: the table has none, or they hold nothing but zeros.
    pub moment: Option<[String; 3]>,
}

/// The plates of a table, by number.
pub(super) fn plates(series: &TimeSeries) -> Vec<Columns> {
    let mut found: Vec<Columns> = Vec::new();
    for name in &series.columns {
        // ground_force_1_vx, 1_ground_force_vx, FP1_vx
        let Some(stem) = name.strip_suffix("vx") else { continue };
        let triple = |stem: &str, letter: &str| ["x", "y", "z"].map(|axis| format!("{stem}{letter}{axis}"));
        let there = |names: &[String; 3]| names.iter().all(|n| series.column(n).is_some());
        let (force, point) = (triple(stem, "v"), triple(stem, "p"));
        if !there(&force) || !there(&point) {
            continue;
        }
        let moments = [
            triple(&stem.replace("force", "torque"), ""),
            triple(&stem.replace("force", "moment"), ""),
            triple(&stem.replace("force", "torque"), "m"),
            triple(stem, "m"),
        ];
        let says = |names: &[String; 3]| {
            names.iter().any(|n| series.column(n).is_some_and(|v| v.iter().any(|x| *x != 0.0)))
        };
        let moment = moments.into_iter().find(|m| there(m) && says(m));
        let digits: String = stem.chars().filter(char::is_ascii_digit).collect();
        let free = |n: &usize| *n > 0 && found.iter().all(|c| c.plate != *n);
        let plate = digits.parse().ok().filter(free).unwrap_or_else(|| (1..).find(free).unwrap_or(1));
        found.push(Columns { plate, force, point, moment });
    }
    found.sort_by_key(|c| c.plate);
    found
}
