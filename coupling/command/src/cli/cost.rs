//! `sartorius cost [LADDER]`: what accuracy costs in time. Every rung is a process of its own, so that its memory is its own and its end ends
//! nothing else.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::progress::Progress;
use super::rung::Rung;
use super::{OutArguments, Outcome, known_names, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::cost::{write_axes, write_cost, write_errors};
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus, peak_memory_mib};
use crate::report::cost::{CostReport, cost_page, cost_picture};
use coupling::comparison::Sized;
use coupling::comparison::estimate::Expected;
use coupling::comparison::speed::iteration_seconds;
use coupling::configuration::PerConfiguration;
use coupling::cost::curve::Curve;
use coupling::cost::ladder::Ladder;
use coupling::cost::rung::{Deviation, Ending, read_numbers};
use coupling::fibres::cache::program_hash;
use coupling::number::plain;

#[derive(Args)]
pub struct CostArguments {
    /// Ladder file (TOML): a scene, and keys of it that go from coarse to fine. Or `deep_flexion`: the knees of `step`, whose quadriceps is more or
    /// less detailed.
    #[arg(default_value = "walker")]
    pub(super) ladder: PathBuf,
    /// Scene in place of the ladder's: a file, or the name of a shipped one.
    #[arg(long, value_name = "SCENE")]
    pub(super) scene: Option<PathBuf>,
    /// Only these axes of the ladder, or these knees, by name.
    #[arg(long, value_name = "AXIS", value_delimiter = ',')]
    pub(super) only: Vec<String>,
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
    #[command(flatten)]
    pub(super) out: OutArguments,
    /// Go on with a ladder that was killed: its solved rungs are taken over.
    #[arg(long)]
    pub(super) resume: bool,
    /// Print the curve as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Name of the rung that all others are measured against.
const FINEST: &str = "finest";
/// A setting on another axis is good enough for a mesh where its own error is at most this fraction of the mesh's: both together are then off by a third
/// more than the mesh alone.
const SMALL: f64 = 1.0 / 3.0;

/// What is known of a rung before it runs.
struct Before {
    /// Text of its scene, with the hash of all that its numbers hang on.
    text: String,
    expected: Expected,
}

impl Before {
    fn of(ladder: &Ladder, rung: usize, data: Option<&Path>) -> Result<(Before, Sized), CommandError> {
        let rung = &ladder.rungs[rung];
        let sized = Sized::new(rung.scene.clone(), data)?;
        let mut files = String::new();
        for input in sized.inputs() {
            files += &InputFile::of(input)?.sha256;
        }
        let hash = program_hash(&format!("{}{files}", rung.scene.text));
        let text = format!("# Rung {} of the ladder {}; {hash}\n{}", rung.name, ladder.name, rung.scene.text);
        let with = rung.scene.contact.is_some();
        let (_, expected) = sized.expected(PerConfiguration { without: !with, with }, None)?;
        Ok((Before { text, expected }, sized))
    }
}

/// Runs the command.
pub fn run(arguments: &CostArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let data = arguments.data.as_deref();
    let mut ladder = Ladder::read(&arguments.ladder, arguments.scene.as_deref(), data)?;
    only(&mut ladder, &arguments.only)?;
    let claim = arguments.out.claim("cost", &ladder.name)?;
    let folder = claim.path();
    let mut record = RunRecord::new("cost");
    let names: Vec<&str> = ladder.rungs.iter().map(|r| r.name.as_str()).collect();
    let mut progress = Progress::new(&names, quiet);
    let mut before = Vec::new();
    for rung in 0..ladder.rungs.len() {
        let (known, sized) = Before::of(&ladder, rung, data)?;
        if rung == 0 {
            progress.pause(|| tell(sized.doubts()));
            record.inputs.push(InputFile::of_text(&format!("{}.toml", ladder.name), &ladder.text));
            for file in sized.inputs() {
                record.inputs.push(InputFile::of(file)?);
            }
        }
        before.push(known);
    }
    progress.expect(|name| {
        let rung = names.iter().position(|n| *n == name);
        rung.map_or(0.0, |rung| before[rung].expected.seconds())
    });
    let iteration_s = iteration_seconds();
    let mut out = OutputFolder::begin(claim, arguments.resume)?;
    let mut endings: Vec<Option<Ending>> = Vec::new();
    for (rung, known) in ladder.rungs.iter().zip(&before) {
        endings.push(Some(ending(&mut out, &rung.name, known, arguments)?));
        progress.lap(&rung.name);
    }
    let reference = ladder.add(FINEST, ladder.finest(), data)?;
    let finest = [(FINEST.to_string(), ladder.finest())];
    for (name, differs) in finest.into_iter().chain(combinations(&ladder, &endings)) {
        let at = ladder.add(&name, differs, data)?;
        if at >= endings.len() {
            let (known, _) = Before::of(&ladder, at, data)?;
            let name = ladder.rungs[at].name.clone();
            endings.push(Some(ending(&mut out, &name, &known, arguments)?));
            progress.lap(&name);
        }
    }
    record.seconds = progress.seconds().to_vec();
    drop(progress);

    let report = CostReport::new(&ladder, &endings, reference);
    out.write("cost.csv", |w| write_cost(w, &report))?;
    out.write("axes.csv", |w| write_axes(w, &report))?;
    out.write("errors.csv", |w| write_errors(w, &report))?;
    // Before the ladder and after it; the faster one counts, as other programs can only make it longer.
    let iteration_s = Some(iteration_s.min(iteration_seconds()));
    let curve = Curve { iteration_s, ..report.curve() };
    let curve = toml::to_string(&curve).expect("plain data");
    out.write("curve.toml", |w| w.write_all(curve.as_bytes()))?;
    out.write("cost.svg", |w| w.write_all(cost_picture(&report).as_bytes()))?;
    let page = cost_page(&report);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    let missing = report.missing();
    if !missing.is_empty() {
        (record.status, record.reason) = (RunStatus::NotConverged, Some(missing.join("; ")));
    }
    record.notes = report.notes();
    record.again = Again { arguments: vec!["cost".into(), "ladder.toml".into()], ..Again::default() };
    record.again.files.insert("ladder.toml".into(), ladder.text.clone());
    record.settings =
        ladder.rungs[0].scene.settings().into_iter().map(|(k, v)| (k, serde_json::Value::from(v))).collect();
    record.verdict = Some(report.verdict());
    record.peak_memory_mib = peak_memory_mib();
    record.files = out.files().to_vec();
    let verdict = record.verdict.clone();
    out.finish(&record)?;
    let mut terminal = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = match arguments.json {
        true => writeln!(terminal, "{}", serde_json::to_string_pretty(&verdict).expect("plain data")),
        false => print(&mut terminal, &report, &folder),
    };
    Ok(if missing.is_empty() { Outcome::Solved } else { Outcome::NotSolved })
}

/// Keeps the axes of these names.
fn only(ladder: &mut Ladder, names: &[String]) -> Result<(), CommandError> {
    if names.is_empty() {
        return Ok(());
    }
    let known = ladder.axes.iter().map(|axis| axis.name.as_str());
    known_names(names, known, ["axis of the ladder", "its axes are"])?;
    ladder.keep_axes(|axis| names.contains(&axis.name));
    Ok(())
}

/// What came of a rung, or of the run that was killed.
fn ending(
    out: &mut OutputFolder,
    name: &str,
    known: &Before,
    arguments: &CostArguments,
) -> Result<Ending, CommandError> {
    let rung = Rung {
        name,
        text: &known.text,
        known: None,
        needed_mib: Some(known.expected.memory_mib),
        data: arguments.data.as_deref(),
        resume: arguments.resume,
    };
    let numbers = |_: &serde_json::Value, folder: &Path| read_numbers(&folder.join("quantities.csv")).ok();
    Ok(match rung.run(out, numbers)? {
        Err(why) => Ending::Failed(why),
        Ok((taken, numbers)) => Ending::Solved { taken, numbers },
    })
}

/// The best combinations: for every mesh the cheapest settings on the other axes whose own errors are small beside that of the mesh.
fn combinations(ladder: &Ladder, endings: &[Option<Ending>]) -> Vec<(String, BTreeMap<String, toml::Value>)> {
    let solved = |rung: usize| endings.get(rung).and_then(|e| e.as_ref()).and_then(Ending::solved);
    let deviation = |rung: usize, reference: usize| {
        Deviation::of(solved(rung)?.1, solved(reference)?.1).map(|d| d.largest)
    };
    let Some(mesh) = ladder.mesh_axis() else { return Vec::new() };
    let finest = mesh.finest();
    let mut found = Vec::new();
    for &rung in mesh.rungs.iter().filter(|&&rung| rung != finest) {
        let Some(error) = deviation(rung, finest) else { continue };
        let mut differs = ladder.rungs[rung].differs.clone();
        let mut words = Vec::new();
        for axis in
            ladder.axes.iter().filter(|a| a.with.is_empty() && a.owner.is_numerical() && a.key != mesh.key)
        {
            let reference = axis.finest();
            let good = |&&r: &&usize| deviation(r, reference).is_some_and(|e| e <= SMALL * error);
            let seconds = |r: usize| solved(r).map_or(f64::INFINITY, |(taken, _)| taken.seconds);
            let cheapest =
                axis.rungs.iter().filter(good).min_by(|a, b| seconds(**a).total_cmp(&seconds(**b)));
            if let Some(&cheapest) = cheapest.filter(|r| **r != 0 && seconds(**r) < seconds(0)) {
                differs.extend(ladder.rungs[cheapest].differs.clone());
                words.push(ladder.rungs[cheapest].name.clone());
            }
        }
        if !words.is_empty() {
            found.push((format!("{}+{}", ladder.rungs[rung].name, words.join("+")), differs));
        }
    }
    found
}

fn print(w: &mut impl Write, report: &CostReport, folder: &Path) -> std::io::Result<()> {
    writeln!(
        w,
        "{}: errors of section forces above 20 N against {}",
        report.ladder.name,
        report.reference_name()
    )?;
    writeln!(
        w,
        "  {:<44}{:>9}{:>9}{:>8}{:>12}{:>9}",
        "setting", "elements", "s", "MiB", "largest, %", "rms, %"
    )?;
    for row in report.rows() {
        let number = |v: Option<f64>, digits| v.map_or("-".into(), |v| plain(v, digits));
        match (&row.taken, &row.failed) {
            (Some(taken), _) => writeln!(
                w,
                "  {:<44}{:>9}{:>9}{:>8}{:>12}{:>9}",
                row.name,
                taken.elements,
                plain(taken.seconds, 1),
                number(taken.peak_mib, 0),
                number(row.deviation.map(|d| 100.0 * d.largest), 1),
                number(row.deviation.map(|d| 100.0 * d.rms), 1)
            )?,
            (None, Some(why)) => writeln!(w, "  {:<44}{why}", row.name)?,
            (None, None) => {}
        }
    }
    for note in report.notes() {
        writeln!(w, "  note: {note}")?;
    }
    for missing in report.missing() {
        writeln!(w, "not solved: {missing}")?;
    }
    writeln!(w, "files in {}, open report.html there", folder.display())
}
