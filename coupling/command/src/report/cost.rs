//! The page of `cost`: error against seconds, what every axis buys, what every effect costs, how sure every force is.

use coupling::cost::accuracy::{Errors, errors};
use coupling::cost::curve::{Curve, MARGIN, cheapest, pareto};
use coupling::cost::ladder::{Ladder, Owner};
use coupling::cost::rung::{Deviation, Ending, LEAST_FORCE, SECTION_FORCE, Taken};
use coupling::number::{fixed, significant, with_error};

use super::decades::{Dot, decades, picture};
use super::page::{document, grid, section, table};
use super::svg::escape;

/// Accuracies that a person asks for \[%\].
const WANTED: [f64; 4] = [20.0, 10.0, 5.0, 2.0];

/// Everything that the page shows.
pub struct CostReport<'a> {
    /// The ladder.
    pub ladder: &'a Ladder,
    endings: &'a [Option<Ending>],
    /// The rung that all others are measured against.
    reference: usize,
    /// Errors of the numbers of the base.
    pub errors: Vec<Errors>,
}

/// A rung beside a reference.
#[derive(Clone, Debug)]
pub struct Row<'a> {
    /// Name of the rung.
    pub name: &'a str,
    /// What it took; absent where it has no numbers.
    pub taken: Option<Taken>,
    /// Why it has none.
    pub failed: Option<&'a str>,
    /// How far it is from the reference.
    pub deviation: Option<Deviation>,
}

/// An axis with its rungs, from coarse to fine.
pub struct AxisRows<'a> {
    /// Its name.
    pub name: &'a str,
    /// Whose error shrinks along it.
    pub owner: Owner,
    /// What its rungs are measured against.
    pub reference: &'a str,
    /// Its rungs.
    pub rungs: Vec<Row<'a>>,
}

impl<'a> CostReport<'a> {
    /// Of a ladder and what came of its rungs. `reference`: the one that all others are measured against.
    pub fn new(ladder: &'a Ladder, endings: &'a [Option<Ending>], reference: usize) -> CostReport<'a> {
        CostReport { ladder, endings, reference, errors: errors(ladder, endings) }
    }

    /// Name of the rung that all others are measured against.
    pub fn reference_name(&self) -> &str {
        &self.ladder.rungs[self.reference].name
    }

    fn row(&self, rung: usize, reference: usize) -> Row<'a> {
        let solved = |rung: usize| self.endings.get(rung).and_then(|e| e.as_ref()).and_then(Ending::solved);
        let own = solved(rung);
        Row {
            name: &self.ladder.rungs[rung].name,
            taken: own.map(|(taken, _)| taken.clone()),
            failed: match self.endings.get(rung) {
                Some(Some(Ending::Failed(why))) => Some(why),
                _ => None,
            },
            deviation: own.zip(solved(reference)).and_then(|((_, a), (_, b))| Deviation::of(a, b)),
        }
    }

    /// Every rung against the reference.
    pub fn rows(&self) -> Vec<Row<'a>> {
        (0..self.ladder.rungs.len()).map(|rung| self.row(rung, self.reference)).collect()
    }

    /// Every axis against its last rung; several equilibria against the base.
    pub fn axes(&self) -> Vec<AxisRows<'a>> {
        let of = |axis: &'a coupling::cost::ladder::Axis| {
            let reference = match axis.owner {
                Owner::Path => 0,
                _ => axis.finest(),
            };
            AxisRows {
                name: &axis.name,
                owner: axis.owner,
                reference: &self.ladder.rungs[reference].name,
                rungs: axis.rungs.iter().map(|&rung| self.row(rung, reference)).collect(),
            }
        };
        self.ladder.axes.iter().map(of).collect()
    }

    /// Rungs without which there is no curve.
    pub fn missing(&self) -> Vec<String> {
        let mut needed = vec![0, self.reference];
        needed.dedup();
        let without = |&rung: &usize| {
            let row = self.row(rung, rung);
            row.taken.is_none().then(|| format!("{}: {}", row.name, row.failed.unwrap_or("no numbers")))
        };
        needed.iter().filter_map(without).collect()
    }

    /// Where the error does not fall along an axis.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for axis in self.axes().iter().filter(|axis| axis.owner != Owner::Path) {
            let known: Vec<(&str, f64)> =
                axis.rungs.iter().filter_map(|r| Some((r.name, 100.0 * r.deviation?.largest))).collect();
            for pair in known.windows(2).filter(|pair| pair[1].1 > pair[0].1) {
                notes.push(format!(
                    "along `{}` the error does not fall from {} ({} %) to {} ({} %)",
                    axis.name,
                    pair[0].0,
                    significant(pair[0].1, 2),
                    pair[1].0,
                    significant(pair[1].1, 2)
                ));
            }
        }
        notes
    }

    /// What `compare --accuracy` chooses by.
    pub fn curve(&self) -> Curve {
        Curve::of(self.ladder, self.endings, self.reference)
    }

    /// The curve for programs.
    pub fn verdict(&self) -> serde_json::Value {
        let curve = self.curve();
        let front = pareto(&curve.contact.iter().map(|p| [p.seconds, p.error_percent]).collect::<Vec<_>>());
        let front = front.into_iter().map(|k| {
            let p = &curve.contact[k];
            serde_json::json!({ "setting": p.setting, "seconds": p.seconds, "error_percent": p.error_percent })
        });
        serde_json::json!({ "reference": self.reference_name(), "rungs": self.ladder.rungs.len(), "curve": front.collect::<Vec<_>>() })
    }
}

/// The whole page.
pub fn cost_page(report: &CostReport) -> String {
    let mut body = format!(
        "<header><p class=\"eyebrow\">What accuracy costs</p><h1>{}</h1></header>\n",
        escape(&report.ladder.name)
    );
    let curve = report.curve();
    let answers: Vec<Vec<String>> = WANTED
        .iter()
        .map(|percent| match cheapest(&curve.contact, *percent) {
            Some(p) => vec![
                format!("{percent} %"),
                p.setting.clone(),
                fixed(p.seconds, 1),
                if p.is_reference() { "–".into() } else { significant(p.promise(), 2) },
            ],
            None => vec![format!("{percent} %"), "no rung reaches it".into(), "–".into(), "–".into()],
        })
        .collect();
    let lead = format!(
        "Error: of the section force that is farthest from that of {}, of all above {LEAST_FORCE} N. Seconds without calibration, which is made once per mesh. A setting promises {MARGIN} times what it and every finer one keep: where a finer one is farther off, it was near by chance, and another scene is not this one.",
        report.reference_name()
    );
    body += &section(
        "Cheapest setting",
        &lead,
        &table(&["wanted", "setting", "s", "promised error, %"], 2, &answers),
    );
    let figures = [
        curve_figure(report),
        decades("Memory against seconds", "MiB", dots(report, |row| row.taken.as_ref()?.peak_mib), false),
    ];
    let lead = "Every rung a point; the line joins those that nothing cheaper is as accurate as. Dashed: a method whose error halves when the time doubles.";
    body += &section("Curve", lead, &grid("half", &figures));
    body += &section("Rungs", "", &rungs(report));
    body += &section(
        "Axes",
        "Each axis against its own last rung, everything else as in the base.",
        &axes(report),
    );
    body += &section(
        "What effects cost",
        "Seconds and memory of the base less those without the effect; what its absence does to the section forces.",
        &effects(report),
    );
    let lead = "Value of the base, and how far it may be off as the answer to its scene: discretisation, regularisation, tolerance and path together. What the model leaves out stands apart.";
    body += &section("How sure every force is", lead, &sureness(report));
    let notes = report.notes();
    if !notes.is_empty() {
        body += &section("Notes", "", &super::page::list(notes.iter().map(|n| escape(n))));
    }
    document(&format!("What accuracy costs: {}", report.ladder.name), &body)
}

/// The curve as a picture of its own (SVG), for other pages and for print.
pub fn cost_picture(report: &CostReport) -> String {
    picture(&curve_figure(report))
}

fn curve_figure(report: &CostReport) -> String {
    let error = |row: &Row| row.deviation.map(|d| 100.0 * d.largest);
    decades("Error against seconds", "error, %", dots(report, error), true)
}

/// Every rung that has such a number.
fn dots(report: &CostReport, of: impl Fn(&Row) -> Option<f64>) -> Vec<Dot> {
    let rows = report.rows();
    let dot = |row: &Row| {
        Some(Dot { name: row.name.into(), seconds: row.taken.as_ref()?.seconds, value: of(row)? })
    };
    rows.iter().filter_map(dot).collect()
}

fn rungs(report: &CostReport) -> String {
    let rows: Vec<Vec<String>> = report
        .rows()
        .iter()
        .map(|row| match (&row.taken, row.failed) {
            (Some(t), _) => vec![
                row.name.to_string(),
                t.elements.to_string(),
                t.unknowns.to_string(),
                fixed(t.seconds, 1),
                fixed(t.calibration_seconds, 1),
                t.peak_mib.map_or("–".into(), |m| fixed(m, 0)),
                row.deviation.map_or("–".into(), |d| significant(100.0 * d.largest, 2)),
                row.deviation.map_or("–".into(), |d| significant(100.0 * d.rms, 2)),
            ],
            (None, why) => {
                let mut cells = vec![format!("{}: {}", row.name, why.unwrap_or("not run"))];
                cells.resize(8, "–".into());
                cells
            }
        })
        .collect();
    table(
        &["rung", "elements", "unknowns", "s", "calibration, s", "MiB", "largest error, %", "rms, %"],
        1,
        &rows,
    )
}

fn axes(report: &CostReport) -> String {
    let mut rows = Vec::new();
    for axis in report.axes() {
        for rung in &axis.rungs {
            rows.push(vec![
                axis.name.to_string(),
                axis.owner.name().to_string(),
                rung.name.to_string(),
                rung.taken.as_ref().map_or("–".into(), |t| fixed(t.seconds, 1)),
                rung.deviation.map_or("–".into(), |d| significant(100.0 * d.largest, 2)),
                rung.deviation.map_or("–".into(), |d| significant(100.0 * d.rms, 2)),
            ]);
        }
    }
    table(&["axis", "error", "rung", "s", "largest error, %", "rms, %"], 3, &rows)
}

fn effects(report: &CostReport) -> String {
    let base = report.row(0, 0);
    let mut rows = Vec::new();
    for axis in report.ladder.axes.iter().filter(|a| a.owner == Owner::Modelling && a.with.is_empty()) {
        for &rung in axis.rungs.iter().filter(|&&rung| rung != 0) {
            let row = report.row(rung, 0);
            let (Some(own), Some(all)) = (&row.taken, &base.taken) else { continue };
            rows.push(vec![
                row.name.to_string(),
                fixed(own.seconds - all.seconds, 1),
                own.peak_mib.zip(all.peak_mib).map_or("–".into(), |(own, all)| fixed(own - all, 0)),
                row.deviation.map_or("–".into(), |d| significant(100.0 * d.largest, 2)),
                row.deviation.map_or("–".into(), |d| significant(100.0 * d.rms, 2)),
            ]);
        }
    }
    table(&["in place of the base", "s more", "MiB more", "largest change, %", "rms, %"], 1, &rows)
}

fn sureness(report: &CostReport) -> String {
    let forces = report.errors.iter().filter(|e| e.of[1] == SECTION_FORCE);
    let rows: Vec<Vec<String>> = forces
        .map(|e| {
            let of = |owner: Owner| e.by_owner.get(&owner).map_or("–".into(), |v| significant(*v, 2));
            let mut cells = vec![
                e.of[0].replace('_', " "),
                e.of[2].replace('_', " "),
                with_error(e.value, Some(e.total())),
                e.finest.map_or("–".into(), |v| significant(v, 4)),
                e.order.map_or("none seen".into(), |p| fixed(p, 1)),
            ];
            cells.extend(Owner::ALL.map(of));
            cells
        })
        .collect();
    let owners = Owner::ALL.map(Owner::name);
    let header: Vec<&str> =
        ["step", "muscle", "force, N", "finest mesh, N", "order"].into_iter().chain(owners).collect();
    table(&header, 2, &rows)
}
