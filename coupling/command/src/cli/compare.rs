//! `sartorius compare`: the gait steps on the deformable thigh beside the rigid leg, without and with contact.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};

use super::accuracy::Accuracy;
use super::progress::Progress;
use super::scenes::{read_scene, scenes};
use super::{Outcome, RunArguments, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::compare::write_compare;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus, Size};
use crate::report::compare::CompareReport;
use coupling::comparison::compare::MuscleForce;
use coupling::comparison::explain::{write_calibration, write_factors};
use coupling::comparison::{Comparison, Prepared, STAGES, Sized, coarse_stages};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::number::{plain, short};
use coupling::scene::StressFree;
use coupling::scene::{Fibres, RESOLUTIONS, Scene, known_muscle};
use coupling::subject::words;
use coupling::two_way::fixed_point::Scheme;
use coupling::two_way::{Coupling, MOST_PASSES, Pass, write_capacities, write_missing, write_passes};

#[derive(Args)]
pub struct CompareArguments {
    #[arg(help = scenes())]
    scene: Option<PathBuf>,
    /// Length of the edges of the mesh that is aimed at, in mm, in place of the scene's.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    resolution: Option<f64>,
    /// Posture in which the mesh is free of stress, in place of the scene's: standing, or at heel strike as in the publication.
    #[arg(long, value_enum)]
    stress_free: Option<StressFreeChoice>,
    /// Which configurations are computed [default: both where the scene has contact; without where it has none, or with --two-way,
    /// which couples one of them].
    #[arg(long, value_enum)]
    contact: Option<ContactChoice>,
    /// Only these muscles, by name, in place of the scene's.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// Feed the forces and lever arms of the thigh back into force sharing until they no longer change. Needs Hill fibres; goes without contact
    /// unless `--contact with` is given.
    #[arg(long, value_enum, value_name = "SCHEME", num_args = 0..=1, require_equals = true, default_missing_value = "iqn-ils")]
    two_way: Option<SchemeChoice>,
    /// Passes of two-way coupling at most; the first is the one-way result.
    #[arg(long, value_name = "N", default_value_t = MOST_PASSES as u16, value_parser = clap::value_parser!(u16).range(1..=200))]
    passes: u16,
    /// Take the cheapest setting whose section forces above 20 N are within so many percent of the finest one's, by a curve of `cost`, and
    /// check it with one coarser run.
    #[arg(long, value_name = "PERCENT", value_parser = percent, conflicts_with_all = ["resolution", "two_way"])]
    accuracy: Option<f64>,
    /// Curve to choose by: `curve.toml` of a run of `cost`, or the name of a shipped one.
    #[arg(long, value_name = "FILE", default_value = "walker", requires = "accuracy")]
    curve: PathBuf,
    #[command(flatten)]
    run: RunArguments,
}

/// A number of percent, with its sign or without.
fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim();
    number.parse().map_err(|_| format!("`{text}` is no number of percent, such as 5 or 5%"))
}

#[derive(Clone, Copy, ValueEnum)]
enum SchemeChoice {
    IqnIls,
    Aitken,
    Relaxation,
}

#[derive(Clone, Copy, ValueEnum)]
enum StressFreeChoice {
    Standing,
    HeelStrike,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ContactChoice {
    Both,
    With,
    Without,
}

impl CompareArguments {
    /// The scene with what the command line puts in its place, and which configurations are asked for.
    fn scene(&self) -> Result<(Scene, PerConfiguration<bool>), CommandError> {
        let mut scene = match &self.scene {
            None => Scene::walker(),
            Some(file) => read_scene(file, self.run.data.as_deref())?,
        };
        if let Some(mm) = self.resolution {
            if !RESOLUTIONS.contains(&mm) {
                let (least, most) = (RESOLUTIONS.start(), RESOLUTIONS.end());
                return Err(CommandError::Option(format!(
                    "--resolution is {mm} mm; give {least} to {most} mm"
                )));
            }
            scene.resolution = mm * 1e-3;
        }
        for name in &self.only {
            known_muscle(name).map_err(|remedy| {
                CommandError::Option(format!(
                    "--only names `{name}`, which is no muscle of the thigh; {remedy}"
                ))
            })?;
        }
        if !self.only.is_empty() {
            (scene.muscles, scene.deformable) = (self.only.clone(), true);
        }
        if let Some(choice) = self.stress_free {
            let (reading, fibres) = match choice {
                StressFreeChoice::Standing => (StressFree::Standing, Fibres::Hill),
                StressFreeChoice::HeelStrike => (StressFree::HeelStrike, Fibres::Thermal),
            };
            if scene.stress_free != reading && scene.fibres != Fibres::None {
                scene.fibres = fibres;
            }
            scene.stress_free = reading;
        }
        let has_contact = scene.contact.is_some();
        if let (Some(_), Some(ContactChoice::Both)) = (self.two_way, self.contact) {
            return Err(CommandError::Option(
                "--two-way couples the thigh either without contact or with it; give --contact without or --contact with".into(),
            ));
        }
        let [without, with] = match self.contact {
            None => [true, has_contact && self.two_way.is_none()],
            Some(ContactChoice::Without) => [true, false],
            _ if !has_contact => {
                let name = &scene.name;
                return Err(CommandError::Option(format!(
                    "--contact: the scene `{name}` has none; choose without"
                )));
            }
            Some(ContactChoice::Both) => [true, true],
            Some(ContactChoice::With) => [false, true],
        };
        Ok((scene, PerConfiguration { without, with }))
    }
}

/// Factor of relaxation, and of the first pass of Aitken's scheme.
const FIRST_FACTOR: f64 = 0.5;
/// Factor of the first pass of IQN-ILS: the capacity hangs little on what it was asked with.
const FULL: f64 = 1.0;

/// Runs the command.
pub fn run(arguments: &CompareArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let (scene, asked) = arguments.scene()?;
    let two_way = arguments.two_way.map(|choice| {
        let scheme = match choice {
            SchemeChoice::IqnIls => Scheme::IqnIls(FULL),
            SchemeChoice::Aitken => Scheme::Aitken(FIRST_FACTOR),
            SchemeChoice::Relaxation => Scheme::Relaxation(FIRST_FACTOR),
        };
        (scheme, usize::from(arguments.passes))
    });
    if two_way.is_some() && !(scene.deformable && scene.fibres == Fibres::Hill) {
        let why =
            "--two-way needs muscles with Hill fibres: set `fibres = \"hill\"` and muscles in the scene";
        return Err(CommandError::Option(why.into()));
    }
    if let (Some(_), Some(unit)) = (two_way, &scene.controller) {
        return Err(CommandError::Option(format!(
            "--two-way: {} says how hard muscles pull, so that nothing goes back to force sharing; take controller out of the scene",
            unit.display()
        )));
    }
    let Some(wanted) = arguments.accuracy else {
        return carry_out("compare", scene, asked, &arguments.run, two_way, None, quiet);
    };
    if !scene.deformable {
        return Err(CommandError::Option("--accuracy: the scene has no muscles that deform".into()));
    }
    let mut accuracy = Accuracy::choose(wanted, &arguments.curve, asked)?;
    let data = arguments.run.data.as_deref();
    loop {
        if !quiet {
            coupling::say!("{}", accuracy.said());
        }
        let chosen = accuracy.scene(&scene, data)?;
        let outcome = carry_out("compare", chosen, asked, &arguments.run, None, Some(&accuracy), quiet)?;
        if !accuracy.finer() {
            return Ok(outcome);
        }
    }
}

/// Name of the stage of two-way coupling.
const TWO_WAY: &str = "two-way";

/// Stages of a run, in their order.
fn stages(scene: &Scene, asked: PerConfiguration<bool>, two_way: bool) -> Vec<String> {
    let fibres = scene.fibres != Fibres::None;
    let solved = |c: Configuration| {
        let coarser = scene.coarser(c).into_iter().flat_map(move |edge| {
            let [calibrated, solved] = coarse_stages(c, edge);
            fibres.then_some(calibrated).into_iter().chain([solved])
        });
        coarser.chain([c.name().to_string()])
    };
    let mut names = vec![STAGES[0].to_string()];
    if scene.deformable {
        names.push(STAGES[1].to_string());
        names.extend(fibres.then(|| STAGES[2].to_string()));
        names.extend(Configuration::ALL.into_iter().filter(|c| asked[*c]).flat_map(solved));
        names.extend(two_way.then(|| TWO_WAY.to_string()));
    }
    names.push("write".to_string());
    names
}

/// Carries out a scene for `command` and says what came of it. `two_way`: scheme and passes at most.
pub(super) fn carry_out(
    command: &str,
    scene: Scene,
    asked: PerConfiguration<bool>,
    arguments: &RunArguments,
    two_way: Option<(Scheme, usize)>,
    accuracy: Option<&Accuracy>,
    quiet: bool,
) -> Result<Outcome, CommandError> {
    let claim = arguments.out.claim(command, &scene.name)?;
    let folder = &claim.path();
    let mut record = RunRecord::new(command);
    let mut progress = Progress::new(&stages(&scene, asked, two_way.is_some()), quiet);
    let sized = Sized::new(scene, arguments.data.as_deref())?;
    progress.lap(STAGES[0]);
    progress.pause(|| tell(sized.doubts()));
    if progress.is_shown() {
        let (_, expected) = sized.expected(asked, None)?;
        progress.expect(|stage| expected.of_stage(stage));
    }
    let mut prepared = Prepared::of(sized, &mut |stage| progress.lap(stage))?;
    if let Some(unit) = prepared.scene.controller.clone() {
        prepared.control(controlled(&prepared, &unit)?)?;
        record.inputs.push(InputFile::of(&unit)?);
    }
    record.inputs.push(InputFile::of_text(&format!("{}.toml", prepared.scene.name), &prepared.scene.text));
    for file in &prepared.inputs {
        record.inputs.push(InputFile::of(file)?);
    }
    record.of_trial(&prepared.done.case.trial);
    record.again = again(command, &prepared, asked, two_way);
    let ready = prepared.calibrate(asked, folder, &mut |stage| progress.lap(stage))?;
    let mut out = OutputFolder::begin(claim, arguments.resume)?;
    let mut comparison =
        prepared.solve_ready(ready, folder, arguments.resume, &mut |stage| progress.lap(stage))?;
    let runs = || comparison.solutions.present().map(|(_, done)| &done.run);
    let count = |of: &dyn Fn(&fem::run::Run) -> usize| runs().map(of).sum::<usize>() as u64;
    record.iterations.insert("newton".into(), count(&|run| run.iterations.len()));
    record.iterations.insert("frames".into(), count(&|run| run.frames.len()));
    record.iterations.insert("frames taken over".into(), count(&|run| run.taken_over));
    let clock = Instant::now();
    let coupled = if asked.with { Configuration::WithContact } else { Configuration::WithoutContact };
    let coupling =
        two_way.map(|(scheme, most)| prepared.two_way(&comparison, coupled, scheme, most)).transpose()?;
    let Coupling { passes, last, capacities, bounds, shortcomings: unsettled } = coupling.unwrap_or_default();
    if !last.is_empty() {
        prepared.adopt(&mut comparison, coupled, &last, clock.elapsed(), folder)?;
    }
    if two_way.is_some() {
        progress.lap(TWO_WAY);
    }
    record.seconds = progress.seconds().to_vec();
    record.size = Some(Size::of(&comparison));

    let mut settings = prepared.scene.settings();
    settings.insert(0, ("Subject".into(), words(&prepared.done.case.trial)));
    if let Some((scheme, most)) = two_way {
        settings.push(("Two-way coupling".into(), format!("{scheme:?}, at most {most} passes")));
    }
    if let Some((distance, [a, b])) = prepared.made.as_ref().and_then(|made| made.built.least_gap()) {
        settings.push((
            "Least distance of muscles in the mesh".into(),
            format!("{:.1} mm ({a}, {b})", distance * 1e3),
        ));
    }
    let mut notes = notes(&prepared, &comparison);
    let scene = &prepared.scene;
    let may_be_led = |c: Configuration| !scene.coarser(c).is_empty();
    let is_led = Configuration::ALL.into_iter().any(|c| asked[c] && may_be_led(c));
    // Less than twice the edges, where nothing leads without contact either, is how a scene says that the mesh is solved at once.
    let is_wanted =
        scene.deformable && scene.nested_from.is_some() && may_be_led(Configuration::WithoutContact);
    if is_wanted && !is_led {
        notes.push(
            "solver.nested_from_mm led nothing here: coarser meshes do not show the way with cheap contact"
                .into(),
        );
    }
    let mut unsettled = unsettled;
    if let Some(accuracy) = accuracy {
        let (note, missed) =
            accuracy.check(&prepared.scene, &comparison, folder, arguments.data.as_deref())?;
        notes.push(note);
        unsettled.extend(missed);
    }
    let (simulated, left_out) = prepared.scene.effects(&prepared.thigh, asked);
    let seconds = record.seconds.clone();
    let report = CompareReport {
        name: &prepared.scene.name,
        subject: &words(&prepared.done.case.trial),
        comparison: &comparison,
        bones: prepared.made.as_ref().map_or(&[], |m| &m.bones),
        mid_thigh: prepared.mid_thigh(),
        settings: &settings,
        simulated: &simulated,
        left_out: &left_out,
        notes: &notes,
        passes: &passes,
        unsettled: &unsettled,
        seconds: &seconds,
    };
    record.settings = settings.iter().map(|(k, v)| (k.clone(), serde_json::Value::from(v.clone()))).collect();
    let shortcomings = report.shortcomings();
    if !shortcomings.is_empty() {
        record.status = RunStatus::NotConverged;
        record.reason = Some(shortcomings.join("; "));
    }
    out.write("explanation.csv", |w| comparison.write_explanations(w))?;
    out.write("quantities.csv", |w| comparison.write_quantities(w))?;
    out.write("calibration.csv", |w| write_calibration(w, &comparison.thigh, &comparison.calibration))?;
    let factors = &comparison.calibration.matrix;
    if factors.is_empty() {
        out.remove("embedded.csv")?;
    } else {
        out.write("embedded.csv", |w| write_factors(w, factors))?;
    }
    if two_way.is_some() {
        out.write("passes.csv", |w| write_passes(w, &comparison.steps, &passes))?;
        out.write("missing_moments.csv", |w| {
            write_missing(w, &comparison.thigh, &comparison.steps, &passes)
        })?;
        out.write("capacities.csv", |w| {
            write_capacities(w, &comparison.thigh, &comparison.steps, &capacities, &bounds)
        })?;
    } else {
        ["passes.csv", "missing_moments.csv", "capacities.csv"]
            .iter()
            .try_for_each(|file| out.remove(file))?;
    }
    let record = write_compare(out, &report, record)?;
    progress.lap("write");
    drop(progress);
    let mut terminal = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = if arguments.json {
        let verdict = serde_json::json!({
            "scene": prepared.scene.name, "status": record.status, "reason": record.reason,
            "differences": record.verdict, "settled": report.settled(), "notes": notes, "two_way": two_way.map(|_| said_of(&passes, &unsettled)), "seconds": record.seconds.iter().map(|s| s.1).sum::<f64>(),
            "files": folder.join("run.json"),
        });
        writeln!(terminal, "{}", serde_json::to_string_pretty(&verdict).expect("plain data"))
    } else {
        print(&mut terminal, &report, &record, folder).and_then(|()| print_passes(&mut terminal, &passes))
    };
    Ok(if shortcomings.is_empty() { Outcome::Solved } else { Outcome::NotSolved })
}

/// What the controller of a scene says: per step the activation of every muscle.
fn controlled(prepared: &Prepared, unit: &Path) -> Result<Vec<Vec<f64>>, CommandError> {
    let muscles: Vec<&str> = prepared.thigh.muscles.iter().map(|m| m.name.as_str()).collect();
    let rows: Vec<usize> = prepared.steps.iter().map(|step| step.row).collect();
    let said = sartorius_fmi::foreign::activations(unit, &muscles, &prepared.done.effort.time, &rows);
    said.map_err(|e| CommandError::Option(e.to_string()))
}

/// What the reader must know: doubts about the trial, warnings about the mesh.
fn notes(prepared: &Prepared, comparison: &Comparison) -> Vec<String> {
    let mut notes = prepared.done.case.doubts.clone();
    notes.extend(comparison.not_led.iter().cloned());
    for warning in comparison.solutions.present().flat_map(|(_, done)| &done.plan.warnings) {
        let warning = warning.to_string();
        // Both configurations have the same mesh.
        if !notes.contains(&warning) {
            notes.push(warning);
        }
    }
    notes
}

/// What `--json` says of two-way coupling.
fn said_of(passes: &[Pass], unsettled: &[String]) -> serde_json::Value {
    let last = passes.last();
    serde_json::json!({
        "settled": unsettled.is_empty(), "passes": passes.len(), "capacity_change": last.and_then(|p| p.change),
        "largest_missing_Nm": last.map(Pass::largest_missing),
    })
}

/// What computes the same again: the scene as it was carried out, and its trial.
fn again(
    command: &str,
    prepared: &Prepared,
    asked: PerConfiguration<bool>,
    two_way: Option<(Scheme, usize)>,
) -> Again {
    let mut again = Again::default();
    let trial = again.trial(&prepared.done.case.texts).map(|path| format!("../{path}"));
    let scene = format!("scene/{}.toml", prepared.scene.name);
    again.files.insert(scene.clone(), prepared.scene.resolved(trial.as_deref()));
    again.arguments = vec![command.into(), scene];
    if command == "compare" {
        let contact = match (asked.without, asked.with) {
            (true, true) => "both",
            (false, _) => "with",
            (true, false) => "without",
        };
        again.arguments.push(format!("--contact={contact}"));
    }
    if let Some((scheme, most)) = two_way {
        let scheme = match scheme {
            Scheme::IqnIls(_) => "iqn-ils",
            Scheme::Aitken(_) => "aitken",
            Scheme::Relaxation(_) => "relaxation",
        };
        again.arguments.extend([format!("--two-way={scheme}"), format!("--passes={most}")]);
    }
    again
}

/// One line per pass of two-way coupling.
fn print_passes(w: &mut impl Write, passes: &[Pass]) -> std::io::Result<()> {
    for (k, pass) in passes.iter().enumerate() {
        let change = pass.change.map_or("-".into(), |c| format!("{c:.2e}"));
        writeln!(
            w,
            "pass {}: capacity changes by {change}, joint moments of the thigh miss {:.2} N m at most",
            k + 1,
            pass.largest_missing()
        )?;
    }
    Ok(())
}

fn print(
    w: &mut impl Write,
    report: &CompareReport,
    record: &RunRecord,
    folder: &Path,
) -> std::io::Result<()> {
    let thigh = &report.comparison.thigh;
    let elements: usize = thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
    writeln!(
        w,
        "{} ({}): {} muscles, {elements} elements, {} nodes",
        report.name,
        report.subject,
        thigh.muscles.len(),
        thigh.mesh.points.len()
    )?;
    let differences = report.differences();
    for (k, step) in report.comparison.steps.iter().enumerate() {
        writeln!(
            w,
            "\n{} ({:.3} s, knee {} degrees)",
            step.name.name(),
            step.time,
            plain(step.knee_flexion.to_degrees(), 0)
        )?;
        write!(
            w,
            "  {:<28}{:>10}{:>10}{:>14}{:>14}",
            "muscle", "activation", "rigid N", "FE no contact", "FE contact"
        )?;
        let beside = if report.comparison.one_way.is_some() { "  one-way: rigid N   FE N" } else { "" };
        writeln!(w, "{beside}")?;
        for row in report.rows(k) {
            let force = |f: Option<MuscleForce>| f.map_or("-".into(), |f| plain(f.total, 1));
            let (without, with) = (force(row.fe.without), force(row.fe.with));
            write!(
                w,
                "  {:<28}{:>10.3}{:>10}{without:>14}{with:>14}",
                row.muscle,
                row.activation,
                plain(row.rigid, 1)
            )?;
            if let Some(before) = row.one_way {
                write!(w, "{:>18}{:>7}", plain(before.rigid, 1), force(before.fe))?;
            }
            writeln!(w)?;
        }
        for d in differences.iter().filter(|d| d.step == step.name) {
            writeln!(
                w,
                "  {}: mean difference {} N ({:.1} N of all muscles), largest {} N ({}); muscles share {:.1} cm3",
                d.configuration.name(),
                d.mean.map_or("-".into(), |m| plain(m, 1)),
                d.mean_of_all,
                plain(d.largest, 1),
                d.largest_muscle,
                d.shared_volume
            )?;
        }
    }
    writeln!(w)?;
    for m in &report.comparison.calibration.matrix {
        writeln!(
            w,
            "  {} in a grid of {} mm: matrix times {:.3}, {} unknowns in place of {}",
            m.muscle,
            short(m.cell * 1e3),
            m.factor,
            m.unknowns[1],
            m.unknowns[0]
        )?;
    }
    for note in report.notes {
        writeln!(w, "  note: {note}")?;
    }
    for settled in report.settled() {
        writeln!(w, "  {settled}")?;
    }
    for (stage, seconds) in &record.seconds {
        writeln!(w, "  {stage:<18}{seconds:>8.1} s")?;
    }
    if let Some(reason) = &record.reason {
        writeln!(w, "not converged: {reason}")?;
    }
    writeln!(w, "files in {}, open report.html there", folder.display())
}
