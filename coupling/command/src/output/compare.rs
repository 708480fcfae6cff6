//! What `compare` writes beside the frames of its configurations: the table, forces for OpenSim users, the page.

use std::io::{self, Write};

use fem::restart::remove_states;

use super::atomic::OutputFolder;
use super::run::{self, RunRecord};
use super::tables::Series;
use super::{OutputError, names_in, sto};
use crate::report::compare::{CompareReport, OneWayRow, compare_page};
use coupling::comparison::ONE_WAY_FOLDER;
use coupling::configuration::Configuration::{self, WithContact, WithoutContact};
use coupling::number::plain;

/// Writes tables, page and, last of all, `run.json` into `out`.
pub fn write_compare(
    mut out: OutputFolder,
    report: &CompareReport,
    mut record: RunRecord,
) -> Result<RunRecord, OutputError> {
    out.write("comparison.csv", |w| write_comparison(w, report))?;
    for c in Configuration::ALL {
        let name = format!("fe_forces_{}", c.folder());
        let file = format!("{name}.sto");
        match forces(report, |row| row.fe[c].map_or(f64::NAN, |f| f.total)) {
            series if report.comparison.solutions[c].is_some() => out.write(&file, |w| {
                sto::write(w, &format!("{} {name} ({})", report.name, report.subject), &series, false)
            })?,
            _ => out.remove(&file)?,
        }
    }
    let rigid = forces(report, |row| row.rigid);
    out.write("rigid_forces.sto", |w| {
        sto::write(w, &format!("{} rigid_forces ({})", report.name, report.subject), &rigid, false)
    })?;
    let before = |of: fn(OneWayRow) -> f64| forces(report, move |row| row.one_way.map_or(f64::NAN, of));
    let coupled = report.comparison.one_way.as_ref().map(|one_way| one_way.configuration);
    let fe = |c: Configuration| format!("fe_forces_{}_one_way", c.folder());
    for (name, is_there, force) in [
        ("rigid_forces_one_way".into(), coupled.is_some(), (|b| b.rigid) as fn(OneWayRow) -> f64),
        (fe(WithoutContact), coupled == Some(WithoutContact), |b| b.fe.map_or(f64::NAN, |f| f.total)),
        (fe(WithContact), coupled == Some(WithContact), |b| b.fe.map_or(f64::NAN, |f| f.total)),
    ] {
        let file = format!("{name}.sto");
        match is_there {
            true => {
                let title = format!("{} {name} ({})", report.name, report.subject);
                let series = before(force);
                out.write(&file, |w| sto::write(w, &title, &series, false))?
            }
            false => out.remove(&file)?,
        }
    }
    let page = compare_page(report);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    record.notes = report.notes.to_vec();
    record.verdict = serde_json::to_value(report.differences()).ok();
    record.settled = serde_json::to_value(report.settled()).expect("plain data");
    record.files = out.files().to_vec();
    let one_way = report.comparison.one_way.as_ref().map(|_| ONE_WAY_FOLDER);
    for folder in Configuration::ALL.map(Configuration::folder).into_iter().chain(one_way) {
        // What a killed run would have gone on from.
        let path = out.path().join(folder);
        remove_states(&path, "thigh").map_err(|e| OutputError::at("remove the states in", &path, e))?;
        record.files.extend(names_in(&path).into_iter().map(|name| format!("{folder}/{name}")));
    }
    record.peak_memory_mib = run::peak_memory_mib();
    out.finish(&record)?;
    Ok(record)
}

/// A force per muscle at the time of each step.
fn forces(report: &CompareReport, force: impl Fn(&crate::report::compare::Row) -> f64) -> Series {
    let rows: Vec<_> = (0..report.comparison.steps.len()).map(|k| report.rows(k)).collect();
    let column = |(i, muscle): (usize, &coupling::thigh::build::ThighMuscle)| {
        (muscle.name.clone(), rows.iter().map(|r| force(&r[i])).collect())
    };
    Series {
        time: report.comparison.steps.iter().map(|s| s.time).collect(),
        columns: report.comparison.thigh.muscles.iter().enumerate().map(column).collect(),
    }
}

/// `comparison.csv`: a row per step and muscle; the parts are those with contact where there is contact. Of a two-way result the columns are
/// those of its last pass, and the one-way result follows.
fn write_comparison(w: &mut dyn Write, report: &CompareReport) -> io::Result<()> {
    writeln!(
        w,
        "step,muscle,activation,rigid_N,fe_no_contact_N,fe_contact_N,difference_no_contact_N,difference_contact_N,\
         fibre_N,matrix_N,shell_N{}",
        match &report.comparison.one_way {
            Some(one_way) =>
                format!(",activation_one_way,rigid_one_way_N,fe_{}_one_way_N", one_way.configuration.folder()),
            None => String::new(),
        }
    )?;
    for (k, step) in report.comparison.steps.iter().enumerate() {
        for row in report.rows(k) {
            let number = |v: Option<f64>| v.map_or(String::new(), |v| plain(v, 3));
            let parts = row.fe.with.or(row.fe.without);
            let columns = [
                number(Some(row.rigid)),
                number(row.fe.without.map(|f| f.total)),
                number(row.fe.with.map(|f| f.total)),
                number(row.difference(Configuration::WithoutContact)),
                number(row.difference(Configuration::WithContact)),
                number(parts.map(|f| f.fibre)),
                number(parts.map(|f| f.matrix)),
                number(parts.map(|f| f.shell)),
            ];
            write!(w, "{},{},{:.4},{}", step.name.name(), row.muscle, row.activation, columns.join(","))?;
            if let Some(before) = row.one_way {
                let [rigid, fe] = [Some(before.rigid), before.fe.map(|f| f.total)].map(number);
                write!(w, ",{:.4},{rigid},{fe}", before.activation)?;
            }
            writeln!(w)?;
        }
    }
    Ok(())
}
