//! Measured knee forces beside the modelled ones.
//!
//! An instrumented prosthesis reports the medial and lateral tibiofemoral force. The measured samples are brought
//! to the frame times of the model by linear interpolation, never beyond their ends, and compared there.

#![allow(non_snake_case)]

use multibody::read::KneeForces;
use multibody::trial::Effort;
use thiserror::Error;

use crate::subject::GRAVITY;

/// Why the two cannot be compared.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeasuredError {
    /// Columns of different length.
    #[error(
        "measured knee force: {time} times, {medial} medial and {lateral} lateral values; one of each per row is needed"
    )]
    Lengths {
        /// Number of times.
        time: usize,
        /// Number of medial values.
        medial: usize,
        /// Number of lateral values.
        lateral: usize,
    },
    /// Time runs backwards, stands still or is not a number.
    #[error("measured knee force: time {time} s in row {row} does not increase; remove or sort such rows")]
    Time {
        /// Row of data, counted from 1.
        row: usize,
        /// The time there \[s\].
        time: f64,
    },
    /// Nothing in common.
    #[error(
        "measured knee force covers {from:.3} to {to:.3} s and shares {frames} frames with the trial \
         ({trial_from:.3} to {trial_to:.3} s); at least 2 are needed: do both use the same clock?"
    )]
    Overlap {
        /// First measured time \[s\].
        from: f64,
        /// Last measured time \[s\].
        to: f64,
        /// Frames in common.
        frames: usize,
        /// First frame \[s\].
        trial_from: f64,
        /// Last frame \[s\].
        trial_to: f64,
    },
    /// Frames in common, but hardly any with a solution: no fault of the input.
    #[error(
        "measured knee force is not compared: of {frames} frames that it covers, {solved} are solved, and at least 2 are needed"
    )]
    Unsolved {
        /// Frames that the measurement covers.
        frames: usize,
        /// Those with a solution.
        solved: usize,
    },
    /// The model gave no such column.
    #[error("the results hold no column `{column}`; they have: {present}")]
    Column {
        /// Wanted.
        column: &'static str,
        /// What is there.
        present: String,
    },
}

/// Measured and modelled force of one compartment at the compared frames, and how well they agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Measured force \[N\].
    pub measured: Vec<f64>,
    /// Modelled force \[N\].
    pub model: Vec<f64>,
    /// Agreement of the two.
    pub agreement: Agreement,
}

/// How well a model follows a measurement, over n frames. Errors are model minus measurement.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Agreement {
    /// Root mean square error √(Σ(mᵢ − yᵢ)²/n) \[N\].
    pub rmse_N: f64,
    /// The same in body weights.
    pub rmse_bw: f64,
    /// Coefficient of determination 1 − Σ(mᵢ − yᵢ)²/Σ(yᵢ − ȳ)², which some call R²; negative where the mean of the measurement
    /// would predict better. `None` where the measurement is constant.
    #[serde(rename = "one_minus_sse_over_sst")]
    pub determination: Option<f64>,
    /// Pearson correlation, which ignores offset and scale. `None` where a curve is constant.
    pub correlation: Option<f64>,
    /// Its square, which others call R².
    pub squared_correlation: Option<f64>,
    /// Largest measured force \[N\].
    pub peak_measured_N: f64,
    /// Largest modelled force \[N\].
    pub peak_model_N: f64,
    /// Modelled less measured peak, wherever in time each of them is \[N\].
    pub peak_error_N: f64,
    /// The same in body weights.
    pub peak_error_bw: f64,
    /// Largest |mᵢ − yᵢ| \[N\].
    pub largest_error_N: f64,
    /// The same in body weights.
    pub largest_error_bw: f64,
}

/// The comparison: three curves on common times.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlay {
    /// Times of the compared frames \[s\].
    pub time: Vec<f64>,
    /// Reported frames that could not be compared: outside the measurement, a sensor gap, or a frame without answer.
    pub frames_left_out: usize,
    /// Medial compartment.
    pub medial: Curve,
    /// Lateral compartment.
    pub lateral: Curve,
    /// Sum of both.
    pub total: Curve,
}

impl Overlay {
    /// Compares `measured` with the columns `knee_medial` and `knee_lateral` of the reactions.
    ///
    /// `mass`: body mass \[kg\], for body weights.
    pub fn new(measured: &KneeForces, effort: &Effort, mass: f64) -> Result<Overlay, MeasuredError> {
        check(measured)?;
        let medial = reaction(effort, "knee_medial")?;
        let lateral = reaction(effort, "knee_lateral")?;
        let (mut time, mut covered) = (Vec::new(), 0);
        let (mut m, mut l) = ((Vec::new(), Vec::new()), (Vec::new(), Vec::new()));
        for (i, &t) in effort.time.iter().enumerate() {
            let (ym, yl) =
                (at(&measured.time, &measured.medial, t), at(&measured.time, &measured.lateral, t));
            if !(ym.is_finite() && yl.is_finite()) {
                continue;
            }
            covered += 1;
            if medial[i].is_finite() && lateral[i].is_finite() {
                time.push(t);
                m.0.push(ym);
                m.1.push(medial[i]);
                l.0.push(yl);
                l.1.push(lateral[i]);
            }
        }
        if time.len() < 2 && covered >= 2 {
            return Err(MeasuredError::Unsolved { frames: covered, solved: time.len() });
        }
        if time.len() < 2 {
            let end = |v: &[f64]| (v.first().copied().unwrap_or(0.0), v.last().copied().unwrap_or(0.0));
            let ((from, to), (trial_from, trial_to)) = (end(&measured.time), end(&effort.time));
            return Err(MeasuredError::Overlap { from, to, frames: covered, trial_from, trial_to });
        }
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<_>>();
        let total = (sum(&m.0, &l.0), sum(&m.1, &l.1));
        let curve = |(measured, model): (Vec<f64>, Vec<f64>)| {
            let agreement = agreement(&measured, &model, mass * GRAVITY);
            Curve { measured, model, agreement }
        };
        Ok(Overlay {
            frames_left_out: effort.time.len() - time.len(),
            time,
            medial: curve(m),
            lateral: curve(l),
            total: curve(total),
        })
    }

    /// The three curves with their names.
    pub fn curves(&self) -> [(&'static str, &Curve); 3] {
        [("medial", &self.medial), ("lateral", &self.lateral), ("total", &self.total)]
    }
}

fn check(measured: &KneeForces) -> Result<(), MeasuredError> {
    let (time, medial, lateral) = (measured.time.len(), measured.medial.len(), measured.lateral.len());
    if medial != time || lateral != time {
        return Err(MeasuredError::Lengths { time, medial, lateral });
    }
    let mut before = f64::NEG_INFINITY;
    for (i, &t) in measured.time.iter().enumerate() {
        if !(t.is_finite() && t > before) {
            return Err(MeasuredError::Time { row: i + 1, time: t });
        }
        before = t;
    }
    Ok(())
}

fn reaction(effort: &Effort, column: &'static str) -> Result<Vec<f64>, MeasuredError> {
    effort
        .reactions
        .column(column)
        .ok_or_else(|| MeasuredError::Column { column, present: effort.reactions.columns.join(", ") })
}

/// Linear interpolation of (`x`, `y`) at `t`; NaN beyond the ends and beside a missing sample.
fn at(x: &[f64], y: &[f64], t: f64) -> f64 {
    let after = x.partition_point(|&v| v < t);
    match (after.checked_sub(1), x.get(after)) {
        (_, Some(&v)) if v == t => y[after],
        (Some(before), Some(_)) => {
            let s = (t - x[before]) / (x[after] - x[before]);
            y[before] + s * (y[after] - y[before])
        }
        _ => f64::NAN,
    }
}

/// Agreement of `model` with `measured` \[N\], equally long and not empty; `weight`: body weight \[N\].
fn agreement(measured: &[f64], model: &[f64], weight: f64) -> Agreement {
    let n = measured.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let peak = |v: &[f64]| v.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (mean_y, mean_m) = (mean(measured), mean(model));
    let (mut sse, mut syy, mut smm, mut sym, mut largest) = (0.0, 0.0, 0.0, 0.0, 0.0_f64);
    for (&y, &m) in measured.iter().zip(model) {
        sse += (m - y).powi(2);
        syy += (y - mean_y).powi(2);
        smm += (m - mean_m).powi(2);
        sym += (y - mean_y) * (m - mean_m);
        largest = largest.max((m - y).abs());
    }
    // A constant curve has no variance but that of rounding its mean.
    let varies = |variance: f64, v: &[f64]| variance > 1e-24 * v.iter().map(|x| x * x).sum::<f64>();
    let (measured_varies, model_varies) = (varies(syy, measured), varies(smm, model));
    let correlation = (measured_varies && model_varies).then(|| sym / (syy * smm).sqrt());
    let rmse_N = (sse / n).sqrt();
    let (peak_measured_N, peak_model_N) = (peak(measured), peak(model));
    let peak_error_N = peak_model_N - peak_measured_N;
    Agreement {
        rmse_N,
        rmse_bw: rmse_N / weight,
        determination: measured_varies.then(|| 1.0 - sse / syy),
        correlation,
        squared_correlation: correlation.map(|r| r * r),
        peak_measured_N,
        peak_model_N,
        peak_error_N,
        peak_error_bw: peak_error_N / weight,
        largest_error_N: largest,
        largest_error_bw: largest / weight,
    }
}

#[cfg(test)]
mod tests {
    use multibody::trial::Table;
    use nalgebra::DMatrix;

    use super::*;

    fn effort(time: &[f64], medial: &[f64], lateral: &[f64]) -> Effort {
        let empty = || Table { columns: vec![], values: DMatrix::zeros(time.len(), 0) };
        let values = DMatrix::from_fn(time.len(), 2, |i, j| if j == 0 { medial[i] } else { lateral[i] });
        Effort {
            time: time.to_vec(),
            forces: empty(),
            activations: empty(),
            reactions: Table { columns: vec!["knee_medial".into(), "knee_lateral".into()], values },
            reserves: empty(),
            least_violation: empty(),
            verdicts: vec![],
        }
    }

    /// Worked by hand. Medial: y = 0, 100, 200, 300 and m = 10, 90, 210, 330, so e = 10, −10, 10, 30:
    /// SSE = 1200, RMSE = √300; ȳ = 150, SST = 50000, R² = 0.976; m̄ = 160, Syy = 50000, Smm = 58800,
    /// Sym = (−150)(−150) + (−50)(−70) + 50·50 + 150·170 = 54000, correlation = 54000/√(50000·58800).
    #[test]
    fn rmse_r2_and_peaks_are_those_worked_by_hand() {
        // The measurement has a sample every 0.5 s, half of them between the frames: 0, 100, 200, 300 at 0, 1, 2, 3.
        let measured = KneeForces {
            time: vec![-0.5, 0.5, 1.5, 2.5, 3.5],
            medial: vec![-50.0, 50.0, 150.0, 250.0, 350.0],
            lateral: vec![100.0; 5],
        };
        let model = effort(
            &[0.0, 1.0, 2.0, 3.0, 9.0],
            &[10.0, 90.0, 210.0, 330.0, 1.0],
            &[100.0, 100.0, 100.0, 120.0, 1.0],
        );
        let mass = 1000.0 / GRAVITY; // a body weight of 1000 N
        let overlay = Overlay::new(&measured, &model, mass).unwrap();
        assert_eq!((overlay.time.len(), overlay.frames_left_out), (4, 1)); // 9 s lies beyond the measurement
        let medial = &overlay.medial.agreement;
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12 * b.abs().max(1.0);
        assert!(close(medial.rmse_N, 300_f64.sqrt()), "{medial:?}");
        assert!(close(medial.rmse_bw, 300_f64.sqrt() / 1000.0));
        assert!(close(medial.determination.unwrap(), 0.976));
        assert!(close(medial.correlation.unwrap(), 54000.0 / (50000.0_f64 * 58800.0).sqrt()));
        assert!(close(medial.squared_correlation.unwrap(), 54000.0 * 54000.0 / (50000.0 * 58800.0)));
        assert!(close(medial.peak_error_N, 30.0) && close(medial.peak_error_bw, 0.03));
        assert!(close(medial.largest_error_N, 30.0));
        let lateral = &overlay.lateral.agreement; // constant measurement: nothing to explain
        assert_eq!((lateral.determination, lateral.correlation), (None, None));
        assert!(close(lateral.rmse_N, 10.0)); // √(20²/4)
        assert!(close(overlay.total.agreement.peak_error_N, 50.0));
    }

    #[test]
    fn a_constant_measurement_has_no_coefficient_of_determination() {
        // The mean of three times 0.1 is not 0.1.
        let constant = vec![0.1; 3];
        assert_ne!(constant.iter().sum::<f64>() / 3.0, 0.1);
        let found = agreement(&constant, &[1.0, 2.0, 3.0], 700.0);
        assert_eq!((found.determination, found.squared_correlation), (None, None));
    }

    #[test]
    fn a_gap_in_the_sensor_or_a_failed_frame_is_left_out_not_bridged() {
        let measured = KneeForces {
            time: vec![0.0, 1.0, 2.0, 3.0, 4.0],
            medial: vec![0.0, f64::NAN, 2.0, 3.0, 4.0],
            lateral: vec![0.0; 5],
        };
        let model = effort(&[0.0, 0.5, 2.0, 3.0, 3.5], &[0.0, 0.0, 2.0, f64::NAN, 3.5], &[0.0; 5]);
        let overlay = Overlay::new(&measured, &model, 70.0).unwrap();
        assert_eq!(overlay.time, [0.0, 2.0, 3.5]);
        assert_eq!(overlay.medial.agreement.rmse_N, 0.0);
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let measured = |time: Vec<f64>| KneeForces { medial: time.clone(), lateral: time.clone(), time };
        let model = effort(&[0.0, 1.0], &[0.0; 2], &[0.0; 2]);
        let error = |time| Overlay::new(&measured(time), &model, 70.0).unwrap_err();
        assert_eq!(error(vec![0.0, 2.0, 1.0]), MeasuredError::Time { row: 3, time: 1.0 });
        assert!(matches!(error(vec![0.0, f64::NAN]), MeasuredError::Time { row: 2, .. }));
        assert!(matches!(error(vec![5.0, 6.0]), MeasuredError::Overlap { frames: 0, .. }));
        assert!(matches!(error(vec![]), MeasuredError::Overlap { frames: 0, .. }));
        let unsolved = effort(&[0.0, 1.0], &[f64::NAN; 2], &[0.0; 2]);
        let error = Overlay::new(&measured(vec![0.0, 2.0]), &unsolved, 70.0).unwrap_err();
        assert_eq!(error, MeasuredError::Unsolved { frames: 2, solved: 0 });
    }
}
