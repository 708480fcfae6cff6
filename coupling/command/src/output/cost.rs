//! What `cost` writes: a row per rung, a row per rung of every axis, a row per number of the base with its errors.

use std::io::{self, Write};

use coupling::cost::ladder::Owner;
use coupling::number::plain;

use crate::report::cost::CostReport;

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |v| plain(v, digits))
}

/// `cost.csv`: what every rung took, and how far it is from the reference.
pub fn write_cost(w: &mut dyn Write, report: &CostReport) -> io::Result<()> {
    writeln!(
        w,
        "setting,elements,unknowns,seconds,peak_mib,error_percent,reference,rms_percent,calibration_s,reason"
    )?;
    for row in report.rows() {
        let taken = row.taken.as_ref();
        let count = |n: Option<usize>| n.map_or(String::new(), |n| n.to_string());
        let columns = [
            count(taken.map(|t| t.elements)),
            count(taken.map(|t| t.unknowns)),
            number(taken.map(|t| t.seconds), 2),
            number(taken.and_then(|t| t.peak_mib), 1),
            number(row.deviation.map(|d| 100.0 * d.largest), 3),
            report.reference_name().to_string(),
            number(row.deviation.map(|d| 100.0 * d.rms), 3),
            number(taken.map(|t| t.calibration_seconds), 2),
        ];
        let reason = row.failed.unwrap_or_default().replace(['"', '\n'], " ");
        let reason = if reason.contains(',') { format!("\"{reason}\"") } else { reason };
        writeln!(w, "{},{},{reason}", row.name, columns.join(","))?;
    }
    Ok(())
}

/// `axes.csv`: how the error falls along every axis, against its own last rung.
pub fn write_axes(w: &mut dyn Write, report: &CostReport) -> io::Result<()> {
    writeln!(w, "axis,error,setting,seconds,error_percent,rms_percent,reference")?;
    for axis in report.axes() {
        for rung in &axis.rungs {
            writeln!(
                w,
                "{},{},{},{},{},{},{}",
                axis.name,
                axis.owner.name(),
                rung.name,
                number(rung.taken.as_ref().map(|t| t.seconds), 2),
                number(rung.deviation.map(|d| 100.0 * d.largest), 3),
                number(rung.deviation.map(|d| 100.0 * d.rms), 3),
                axis.reference
            )?;
        }
    }
    Ok(())
}

/// `errors.csv`: how sure every number of the base is, by who owns the error.
pub fn write_errors(w: &mut dyn Write, report: &CostReport) -> io::Result<()> {
    let owners = Owner::ALL.map(Owner::name).join(",");
    writeln!(w, "step,quantity,of,value,error,finest,order,{owners}")?;
    for errors in &report.errors {
        let by_owner = Owner::ALL.map(|owner| number(errors.by_owner.get(&owner).copied(), 4)).join(",");
        writeln!(
            w,
            "{},{},{},{},{},{by_owner}",
            errors.of.join(","),
            plain(errors.value, 4),
            plain(errors.total(), 4),
            number(errors.finest, 4),
            number(errors.order, 2)
        )?;
    }
    Ok(())
}
