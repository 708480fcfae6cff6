//! The CSV tables: `time_s` first, the unit in every column name, one row per reported frame.
//!
//! Numbers are printed with the fewest digits that read back as the same number, so a table loses nothing and the
//! same results give the same bytes. What is not a number is an empty cell.

use std::io::{self, Write};

use multibody::emg::Compared;
use multibody::loads::Loads;
use multibody::trial::{Effort, Motion, Status, Table};

use coupling::measured::Overlay;
use coupling::samples::{PEAKS, Samples};

/// Named columns over time, as they stand in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Time of each row \[s\].
    pub time: Vec<f64>,
    /// Name, with its unit where it has one, and one value per row.
    pub columns: Vec<(String, Vec<f64>)>,
}

impl Series {
    /// The columns of `table`, each value times `scale`, each name followed by `suffix`.
    fn from_table(time: &[f64], table: &Table, scale: f64, suffix: &str) -> Series {
        let columns = table
            .columns
            .iter()
            .enumerate()
            .map(|(j, name)| {
                let name = format!("{}{suffix}", name.strip_suffix(suffix).unwrap_or(name));
                (name, table.values.column(j).iter().map(|v| v * scale).collect())
            })
            .collect();
        Series { time: time.to_vec(), columns }
    }

    /// The same numbers under names without `_N`, as OpenSim names them.
    pub fn without_units(&self) -> Series {
        let bare = |name: &str| name.strip_suffix("_N").unwrap_or(name).to_string();
        Series {
            time: self.time.clone(),
            columns: self.columns.iter().map(|(name, values)| (bare(name), values.clone())).collect(),
        }
    }
}

/// Joint angles \[deg\] of the reported frames under their bare names; no value where the frame was not fitted.
pub fn angles(motion: &Motion) -> Series {
    let frames = motion.report.clone();
    let columns = motion
        .angles
        .columns
        .iter()
        .enumerate()
        .map(|(j, name)| {
            let angle = |i: usize| match motion.fit[i].failure {
                None => motion.angles.values[(i, j)].to_degrees(),
                Some(_) => f64::NAN,
            };
            (name.clone(), frames.clone().map(angle).collect())
        })
        .collect();
    Series { time: motion.time[frames].to_vec(), columns }
}

/// `kinematics.csv`: joint angles \[deg\] and marker residual \[mm\].
pub fn kinematics(motion: &Motion) -> Series {
    let mut series = angles(motion);
    for (name, _) in &mut series.columns {
        name.push_str("_deg");
    }
    let rms = motion.fit[motion.report.clone()].iter().map(|fit| fit.marker_rms * 1e3).collect();
    series.columns.push(("marker_rms_mm".into(), rms));
    series
}

/// `muscle_forces.csv`: tension \[N\] per muscle.
pub fn muscle_forces(effort: &Effort) -> Series {
    Series::from_table(&effort.time, &effort.forces, 1.0, "_N")
}

/// `activations.csv`: activation per muscle, 0..1, under the muscle's bare name.
pub fn activations(effort: &Effort) -> Series {
    Series::from_table(&effort.time, &effort.activations, 1.0, "")
}

/// `joint_forces.csv`: contact, ligament, tendon and bone forces \[N\].
pub fn joint_forces(effort: &Effort) -> Series {
    Series::from_table(&effort.time, &effort.reactions, 1.0, "_N")
}

/// `reserves.csv`: reserve moments \[N·m\]; `None` where no reserves were asked for.
pub fn reserves(effort: &Effort) -> Option<Series> {
    let series = Series::from_table(&effort.time, &effort.reserves, 1.0, "_Nm");
    (!series.columns.is_empty()).then_some(series)
}

/// `joint_force_bounds.csv`: least and greatest joint forces \[N\] over all admissible sharings.
pub fn joint_force_bounds(time: &[f64], bands: &Table) -> Series {
    Series::from_table(time, bands, 1.0, "_N")
}

/// `passive_moments.csv`: passive joint moments \[N·m\] beside those of the resting muscles that force sharing knows.
pub fn passive_moments(time: &[f64], passive: &Table) -> Series {
    Series::from_table(time, passive, 1.0, "_Nm")
}

/// `emg.csv`: envelope of every channel and force of its muscles, as fractions of their largest values.
pub fn emg(time: &[f64], compared: &[Compared]) -> Series {
    let columns = compared.iter().flat_map(|c| {
        [
            (format!("{}_emg", c.channel), c.envelope.clone()),
            (format!("{}_force", c.channel), c.force.clone()),
        ]
    });
    Series { time: time.to_vec(), columns: columns.collect() }
}

/// `emg_concordance.csv`: a row per channel.
pub fn write_concordance(out: &mut dyn Write, compared: &[Compared]) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["channel", "muscles", "concordance", "defect"])?;
    for c in compared {
        csv.write_record([
            c.channel.clone(),
            c.muscles.join(" "),
            cell(c.concordance.unwrap_or(f64::NAN)),
            c.defect.map_or(String::new(), |defect| defect.words().into()),
        ])?;
    }
    csv.flush()
}

/// `joint_force_samples.csv`: the knee forces of nineteen of twenty samples \[N\].
pub fn sampled_forces(samples: &Samples) -> Series {
    Series::from_table(&samples.time, &samples.bands, 1.0, "_N")
}

/// `samples.csv`: the largest knee forces of every independent sample \[N\].
pub fn write_samples(out: &mut dyn Write, samples: &Samples) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(
        std::iter::once("sample".to_string()).chain(PEAKS.map(|name| format!("{name}_peak_N"))),
    )?;
    for (k, peaks) in samples.peaks.iter().enumerate() {
        csv.write_record(std::iter::once(k.to_string()).chain(peaks.iter().map(|v| cell(*v))))?;
    }
    csv.flush()
}

/// `sobol.csv`: where the scatter of the largest knee forces comes from.
pub fn write_sobol(out: &mut dyn Write, samples: &Samples) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["force", "inputs", "first_order", "first_order_error", "total", "total_error"])?;
    for i in &samples.indices {
        let numbers = [i.first[0], i.first[1], i.total[0], i.total[1]].map(cell);
        csv.write_record([i.quantity.to_string(), i.group.to_string()].into_iter().chain(numbers))?;
    }
    csv.flush()
}

/// `least_violation.csv`: muscle and joint forces \[N\] of the infeasible frames alone, which are no solution; `None` where there are none.
pub fn least_violation(effort: &Effort) -> Option<Series> {
    let answered = |i: &usize| effort.least_violation.values.row(*i).iter().any(|v| v.is_finite());
    let rows: Vec<usize> = (0..effort.time.len()).filter(answered).collect();
    let all = Series::from_table(&effort.time, &effort.least_violation, 1.0, "_N");
    let pick = |values: &[f64]| rows.iter().map(|&i| values[i]).collect::<Vec<f64>>();
    let columns = all.columns.iter().map(|(name, values)| (name.clone(), pick(values))).collect();
    (!rows.is_empty()).then(|| Series { time: pick(&all.time), columns })
}

/// `joint_moments.csv`: the moment that the muscles must supply per joint coordinate \[N·m\].
pub fn joint_moments(loads: &Loads) -> Series {
    Series::from_table(&loads.time, &loads.moments, 1.0, "_Nm")
}

/// `ground_reaction.csv`: force on the foot, centre of pressure and free moment, in ground axes.
pub fn ground_reaction(loads: &Loads) -> Series {
    let mut columns = Vec::new();
    for (values, name, unit) in [
        (&loads.ground_force, "force", "N"),
        (&loads.centre_of_pressure, "centre_of_pressure", "m"),
        (&loads.free_moment, "free_moment", "Nm"),
    ] {
        for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
            columns.push((format!("{name}_{letter}_{unit}"), values.iter().map(|v| v[axis]).collect()));
        }
    }
    Series { time: loads.time.clone(), columns }
}

/// `measured_knee.csv`: measured and modelled knee force \[N\] at the frames that were compared.
pub fn measured_knee(overlay: &Overlay) -> Series {
    let mut columns = Vec::new();
    for (part, curve) in overlay.curves() {
        columns.push((format!("{part}_measured_N"), curve.measured.clone()));
        columns.push((format!("{part}_model_N"), curve.model.clone()));
    }
    Series { time: overlay.time.clone(), columns }
}

/// One number as text: shortest form that reads back equal; empty where it is not finite.
pub fn cell(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { String::new() }
}

/// Writes `series` as CSV with a header line.
pub fn write_csv(out: &mut dyn Write, series: &Series) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(std::iter::once("time_s").chain(series.columns.iter().map(|(name, _)| name.as_str())))?;
    for (i, &t) in series.time.iter().enumerate() {
        csv.write_record(std::iter::once(cell(t)).chain(series.columns.iter().map(|(_, v)| cell(v[i]))))?;
    }
    csv.flush()
}

/// The word for a status, as in every file.
pub fn status_word(status: Status) -> &'static str {
    match status {
        Status::Solved => "solved",
        Status::Infeasible => "infeasible",
        Status::Failed => "failed",
    }
}

/// `verdicts.csv`: how force sharing and marker fit ended, one row per reported frame.
///
/// `shortfall_Nm` lists `coordinate=moment` pairs and `saturated` the muscles at their upper bound, separated by
/// blanks.
pub fn write_verdicts(out: &mut dyn Write, motion: &Motion, effort: &Effort) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record([
        "time_s",
        "status",
        "kkt_residual",
        "equality_residual",
        "iterations",
        "active_bounds",
        "reserve_share",
        "reason",
        "shortfall_Nm",
        "saturated",
        "fit",
        "fit_iterations",
        "fit_residual",
        "constraint",
        "markers_seen",
        "caution",
    ])?;
    let fits = &motion.fit[motion.report.clone()];
    for ((&time, verdict), fit) in effort.time.iter().zip(&effort.verdicts).zip(fits) {
        let shortfall: Vec<_> =
            verdict.shortfall.iter().map(|s| format!("{}={}", s.coordinate, cell(s.missing))).collect();
        csv.write_record([
            cell(time),
            status_word(verdict.status).into(),
            cell(verdict.kkt_residual),
            cell(verdict.equality_residual),
            verdict.iterations.to_string(),
            verdict.active_bounds.to_string(),
            cell(verdict.reserve_share),
            verdict.reason.clone().unwrap_or_default(),
            shortfall.join(" "),
            verdict.saturated.join(" "),
            fit.failure.clone().unwrap_or_else(|| "fitted".into()),
            fit.iterations.to_string(),
            cell(fit.residual),
            cell(fit.constraint),
            fit.markers_seen.iter().sum::<usize>().to_string(),
            fit.caution.clone().unwrap_or_default(),
        ])?;
    }
    csv.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_read_back_equal_and_hold_no_nan() {
        for v in [0.1 + 0.2, 1e-300, -0.0, 1.0, 123456789.123, f64::MAX, f64::MIN_POSITIVE] {
            assert_eq!(cell(v).parse::<f64>().unwrap().to_bits(), v.to_bits(), "{}", cell(v));
        }
        assert_eq!(cell(f64::NAN), "");
        assert_eq!(cell(f64::INFINITY), "");
    }
}
