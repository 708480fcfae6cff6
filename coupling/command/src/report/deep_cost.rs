//! The page of `cost deep_flexion`: how far the patella is from where the most detailed knee has it, against seconds.

use std::io::{self, Write};

use coupling::cost::rung::Taken;
use coupling::knee::pose::PATELLA;
use coupling::number::{fixed, plain, significant};

use super::decades::{Dot, decades, picture};
use super::deep_flexion::{COORDINATES, Curve, figure};
use super::page::{document, grid, list, section, table};
use super::svg::escape;
use crate::output::deep_flexion::Read;

/// Classes of the curves, knee by knee.
const CLASSES: [&str; 6] = ["c1", "c2", "c3", "c4", "c5", "c6"];
/// Coordinates that are alike: what they are, and their unit.
const APART: [(&str, &str, std::ops::Range<usize>); 2] = [("Turn", "degrees", 0..3), ("Shift", "mm", 3..6)];

/// A knee and how it ended.
pub struct Ending {
    /// Name of the knee.
    pub name: &'static str,
    /// What it took, the sum of its deviations from measured poses over their means, where there are some, and its tables; or why there are none.
    pub solved: Result<(Taken, (Option<f64>, Read)), String>,
}

/// Knees from the least to the most detailed one.
pub struct Rungs {
    rows: Vec<Row>,
    /// Name of the knee that the others are measured against.
    reference: &'static str,
}

/// A knee beside the reference.
struct Row {
    name: &'static str,
    solved: Result<Solved, String>,
}

struct Solved {
    tables: Read,
    taken: Taken,
    /// Sum of deviations from measured poses over their means.
    sum: Option<f64>,
    /// Per coordinate from the reference, root mean square over the poses that both have \[degrees, mm\].
    apart: Option<[f64; 6]>,
}

/// Root mean square of the differences of two curves where both have a value.
fn apart(a: &[[f64; 2]], b: &[[f64; 2]]) -> Option<f64> {
    let squares = a.iter().filter_map(|[at, value]| {
        let other = b.iter().find(|[there, _]| there == at)?;
        Some((value - other[1]).powi(2))
    });
    let (n, sum) = squares.fold((0, 0.0), |(n, sum), square| (n + 1, sum + square));
    (n > 0).then(|| (sum / f64::from(n)).sqrt())
}

impl Solved {
    /// From the first pose to the last \[s\].
    fn way_s(&self) -> f64 {
        self.taken.stages.get("bend").copied().unwrap_or(0.0)
    }

    /// The greatest of coordinates that are alike.
    fn largest(&self, which: std::ops::Range<usize>) -> Option<f64> {
        Some(self.apart?[which].iter().copied().fold(0.0, f64::max))
    }

    /// The mean of a column, its sum, or its least value; none where there is no such column.
    fn of(&self, column: &str, f: impl Fn(&[f64]) -> f64) -> Option<f64> {
        let values = self.tables.column(column);
        (!values.is_empty()).then(|| f(values))
    }

    fn iterations(&self) -> Option<f64> {
        self.of("iterations", |v| v.iter().sum::<f64>() / v.len() as f64)
    }

    fn crossings(&self) -> Option<f64> {
        let both = ["crossings_of_heads", "crossings_of_head_and_femur"];
        both.map(|column| self.of(column, |v| v.iter().sum())).into_iter().sum()
    }

    fn least_det_f(&self) -> Option<f64> {
        self.of("least_det_f", |v| v.iter().copied().fold(f64::INFINITY, f64::min))
    }
}

impl Rungs {
    /// The most detailed one that was asked for is what the others are measured against.
    pub fn new(endings: Vec<Ending>) -> Rungs {
        // Whether it was solved or not: another reference would mean other numbers.
        let reference = endings.last();
        let name = reference.map_or("", |e| e.name);
        let poses = |tables: &Read| PATELLA.map(|c| tables.curve(c));
        let against = reference.and_then(|e| e.solved.as_ref().ok()).map(|(_, (_, tables))| poses(tables));
        let solved = |(taken, (sum, tables)): (Taken, (Option<f64>, Read))| {
            let apart_of = |own: [Vec<[f64; 2]>; 6], other: &[Vec<[f64; 2]>; 6]| {
                let mut all = [0.0; 6];
                for (c, value) in all.iter_mut().enumerate() {
                    *value = apart(&own[c], &other[c])?;
                }
                Some(all)
            };
            Solved {
                taken,
                sum,
                apart: against.as_ref().and_then(|other| apart_of(poses(&tables), other)),
                tables,
            }
        };
        let rows = endings.into_iter().map(|e| Row { name: e.name, solved: e.solved.map(solved) }).collect();
        Rungs { rows, reference: name }
    }

    fn solved(&self) -> impl Iterator<Item = (&'static str, &Solved)> {
        self.rows.iter().filter_map(|row| Some((row.name, row.solved.as_ref().ok()?)))
    }

    /// Why there is nothing to measure against.
    pub fn missing(&self) -> Option<String> {
        let row = self.rows.iter().find(|row| row.name == self.reference)?;
        Some(format!("{}: {}", row.name, row.solved.as_ref().err()?))
    }

    /// The table for programs.
    pub fn verdict(&self) -> serde_json::Value {
        let rows = self.solved().map(|(name, s)| {
            serde_json::json!({ "knee": name, "way_s": s.way_s(), "apart": s.apart, "nrmsd_sum": s.sum })
        });
        serde_json::json!({ "reference": self.reference, "knees": rows.collect::<Vec<_>>() })
    }

    /// The table for a terminal.
    pub fn print(&self, w: &mut impl Write) -> io::Result<()> {
        writeln!(w, "patella against that of {}, root mean square over the way", self.reference)?;
        writeln!(
            w,
            "  {:<24}{:>9}{:>9}{:>9}{:>10}{:>10}{:>7}",
            "knee", "elements", "way, s", "MiB", "turn, deg", "shift, mm", "sum"
        )?;
        for row in &self.rows {
            let number = |v: Option<f64>, digits| v.map_or("-".into(), |v| plain(v, digits));
            match &row.solved {
                Ok(s) => writeln!(
                    w,
                    "  {:<24}{:>9}{:>9}{:>9}{:>10}{:>10}{:>7}",
                    row.name,
                    s.taken.elements,
                    plain(s.way_s(), 1),
                    number(s.taken.peak_mib, 0),
                    number(s.largest(0..3), 2),
                    number(s.largest(3..6), 2),
                    number(s.sum, 2)
                )?,
                Err(why) => writeln!(w, "  {:<24}{why}", row.name)?,
            }
        }
        Ok(())
    }

    /// Every knee that has such a number.
    fn dots(&self, of: impl Fn(&Solved) -> Option<f64>) -> Vec<Dot> {
        let dot =
            |(name, s): (&str, &Solved)| Some(Dot { name: name.into(), seconds: s.way_s(), value: of(s)? });
        self.solved().filter_map(dot).collect()
    }

    /// The farthest of coordinates that are alike against seconds.
    fn apart(&self, (what, unit, which): (&str, &str, std::ops::Range<usize>)) -> String {
        let dots = self.dots(|s| s.largest(which.clone()));
        decades(&format!("{what} from the patella of {}", self.reference), unit, dots, false)
    }

    /// The shift against seconds as a picture of its own (SVG); none where no knee is measured against another one.
    pub fn picture(&self) -> Option<String> {
        let [_, shift] = APART;
        let figure = self.apart(shift);
        (!figure.is_empty()).then(|| picture(&figure))
    }

    /// The whole page.
    pub fn page(&self) -> String {
        let mut body =
            "<header><p class=\"eyebrow\">What accuracy costs</p><h1>Deep flexion of a knee</h1></header>\n"
                .to_string();
        let mut figures: Vec<String> = APART.map(|which| self.apart(which)).into();
        let sums = self.dots(|s| s.sum);
        if !sums.is_empty() {
            figures.push(decades("Against the measured poses", "sum of NRMSD", sums, false));
        }
        figures.retain(|figure| !figure.is_empty());
        let lead = "Root mean square over the way of the coordinate that is farthest off, against the seconds of that way. The knee that the others are measured against is no point.";
        if !figures.is_empty() {
            body += &section("Over time spent", lead, &grid("half", &figures));
        }
        body += &section(
            "Knees",
            "Seconds of the way alone, and with reading, measured poses and writing.",
            &self.table(),
        );
        let keys = self.solved().zip(CLASSES).map(|((name, _), class)| {
            format!("<svg class=\"key\" viewBox=\"0 0 18 8\"><path class=\"line {class}\" d=\"M0 4H18\"/></svg>{}", escape(name))
        });
        let keys = format!(
            "<div class=\"legend\">{}</div>\n",
            keys.map(|k| format!("<span>{k}</span>")).collect::<String>()
        );
        let curves = |column: &str, scale: f64| -> Vec<Curve> {
            let scaled =
                |s: &Solved| s.tables.curve(column).into_iter().map(|[x, y]| [x, scale * y]).collect();
            self.solved().zip(CLASSES).map(|((name, s), class)| (name, class, false, scaled(s))).collect()
        };
        let places: Vec<String> = (0..6).map(|c| figure(COORDINATES[c], &curves(PATELLA[c], 1.0))).collect();
        body += &section(
            "Where the patella is",
            "Over the flexion of the knee, degrees.",
            &(keys.clone() + &grid("normal", &places)),
        );
        let loads = [
            figure(("Contact force of its cartilage", "N"), &curves("contact_force_N", 1.0)),
            figure(
                ("Stress below which 95 % of rectus femoris is", "kPa"),
                &curves("rectus_stress_95_Pa", 1e-3),
            ),
            figure(("Greatest stress in it", "kPa"), &curves("rectus_stress_greatest_Pa", 1e-3)),
        ];
        let loads: Vec<String> = loads.into_iter().filter(|f| !f.is_empty()).collect();
        body += &section("Loads", "", &(keys + &grid("normal", &loads)));
        let failed = self
            .rows
            .iter()
            .filter_map(|row| Some(escape(&format!("{}: {}", row.name, row.solved.as_ref().err()?))));
        let failed: Vec<String> = failed.collect();
        if !failed.is_empty() {
            body += &section("Not solved", "", &list(failed.into_iter()));
        }
        document("What accuracy costs: deep flexion", &body)
    }

    fn table(&self) -> String {
        let header = [
            "knee",
            "elements",
            "unknowns",
            "way, s",
            "all, s",
            "MiB",
            "iterations a frame",
            "least det F",
            "crossing triangles",
        ];
        let coordinates = COORDINATES.map(|(name, unit)| format!("{}, {unit}", name.to_lowercase()));
        let header: Vec<&str> =
            header.into_iter().chain(coordinates.iter().map(String::as_str)).chain(["sum"]).collect();
        let number = |v: Option<f64>, digits| v.map_or("–".into(), |v| fixed(v, digits));
        let row = |(name, s): (&str, &Solved)| {
            let mut cells = vec![
                name.to_string(),
                s.taken.elements.to_string(),
                s.taken.unknowns.to_string(),
                fixed(s.way_s(), 1),
                fixed(s.taken.seconds, 1),
                number(s.taken.peak_mib, 0),
                number(s.iterations(), 1),
                number(s.least_det_f(), 2),
                number(s.crossings(), 0),
            ];
            cells.extend((0..6).map(|c| s.apart.map_or("–".into(), |all| significant(all[c], 2))));
            cells.push(number(s.sum, 2));
            cells
        };
        table(&header, 1, &self.solved().map(row).collect::<Vec<_>>())
    }
}

/// `cost.csv`: a row per knee.
pub fn write_cost(w: &mut dyn Write, rungs: &Rungs) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    let taken = [
        "knee",
        "elements",
        "unknowns",
        "way_s",
        "seconds",
        "peak_mib",
        "iterations_per_frame",
        "least_det_f",
        "crossings",
    ];
    let apart = PATELLA.map(|c| format!("apart_{c}"));
    let end = ["nrmsd_sum", "reference", "reason"];
    csv.write_record(taken.into_iter().chain(apart.iter().map(String::as_str)).chain(end))?;
    let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    for row in &rungs.rows {
        let s = row.solved.as_ref().ok();
        let mut cells = vec![row.name.to_string()];
        cells.extend(
            [s.map(|s| s.taken.elements), s.map(|s| s.taken.unknowns)]
                .map(|n| n.map_or(String::new(), |n| n.to_string())),
        );
        cells.extend(
            [s.map(|s| s.way_s()), s.map(|s| s.taken.seconds)]
                .map(|v| v.map_or(String::new(), |v| plain(v, 2))),
        );
        cells.push(s.and_then(|s| s.taken.peak_mib).map_or(String::new(), |v| plain(v, 1)));
        cells.extend(
            [Solved::iterations, Solved::least_det_f, Solved::crossings].map(|of| number(s.and_then(of))),
        );
        cells.extend((0..6).map(|c| number(s.and_then(|s| Some(s.apart?[c])))));
        cells.push(number(s.and_then(|s| s.sum)));
        cells.push(rungs.reference.to_string());
        cells.push(row.solved.as_ref().err().cloned().unwrap_or_default());
        csv.write_record(&cells)?;
    }
    csv.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_compared_where_both_have_a_value() {
        let own = [[0.0, 9.0], [2.5, 1.0], [5.0, 3.0], [7.5, 5.0]];
        let other = [[2.5, 1.0], [5.0, 6.0], [7.5, 1.0], [10.0, 7.0]];
        assert_eq!(apart(&own, &other), Some((25.0_f64 / 3.0).sqrt()));
        assert_eq!(apart(&own[..1], &other), None);
    }
}
