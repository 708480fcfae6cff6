//! What reserve moments carry in place of muscles: numbers, and their section of the page.

#![allow(non_snake_case)]

use multibody::loads::Loads;
use multibody::trial::Effort;
use serde::Serialize;

use super::greatest;
use super::optimize::{View, words};
use super::page::{grid, section, table};
use super::svg::{fixed, significant};

/// Above this fraction of the largest moment of a coordinate its reserve is marked: OpenSim's documentation ("Reserves and residuals")
/// asks for less than 10 % of the peak joint moment.
pub const MUCH: f64 = 0.1;

/// The most that the reserve of one joint coordinate carries, over solved frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reserve {
    /// Joint coordinate.
    pub coordinate: String,
    /// The largest reserve moment, signed \[N·m\].
    pub largest_Nm: f64,
    /// When \[s\].
    pub time_s: f64,
    /// Moment that is needed there \[N·m\].
    pub needed_Nm: f64,
    /// Reserve over reserve and muscles there, 0..1, as in `reserve_share` of the frame.
    pub fraction: f64,
    /// Reserve over the largest moment that the coordinate needs in a solved frame.
    pub fraction_of_peak: f64,
}

impl Reserve {
    /// Per coordinate, in the order of the table; empty where no reserves were asked for or no frame is solved.
    pub fn of(effort: &Effort, loads: &Loads) -> Vec<Reserve> {
        let columns = effort.reserves.columns.iter().enumerate();
        let reserve = |(j, name): (usize, &String)| {
            let s = effort.reserves.values.column(j);
            let k = loads.moments.columns.iter().position(|c| c == name)?;
            let needed = loads.moments.values.column(k);
            let (largest, i) = greatest(s.iter().enumerate().map(|(i, v)| (v.abs(), i)))?;
            let solved = (0..s.len()).filter(|&i| s[i].is_finite());
            let peak = solved.map(|i| needed[i].abs()).fold(0.0, f64::max);
            let both = largest + (needed[i] - s[i]).abs();
            Some(Reserve {
                coordinate: name.clone(),
                largest_Nm: s[i],
                time_s: effort.time[i],
                needed_Nm: needed[i],
                fraction: if both > 0.0 { largest / both } else { 0.0 },
                fraction_of_peak: if peak > 0.0 { largest / peak } else { 0.0 },
            })
        };
        columns.filter_map(reserve).collect()
    }

    /// Whether it carries so much that the muscle forces are not to be relied on.
    pub fn is_much(&self) -> bool {
        self.fraction_of_peak > MUCH
    }
}

impl View<'_> {
    pub(super) fn reserves(&self) -> String {
        let reserves = &self.report.effort.reserves;
        if reserves.columns.is_empty() {
            return String::new();
        }
        let row = |r: &Reserve| {
            vec![
                words(&r.coordinate),
                significant(r.largest_Nm, 3),
                self.when(r.time_s),
                significant(r.needed_Nm, 3),
                fixed(100.0 * r.fraction, 0),
                fixed(100.0 * r.fraction_of_peak, 0),
                if r.is_much() { "much" } else { "" }.into(),
            ]
        };
        let rows: Vec<_> = self.summary.reserves.iter().map(row).collect();
        let header = [
            "joint coordinate",
            "largest reserve, N·m",
            "at",
            "needed there, N·m",
            "% of it",
            "% of the largest moment needed",
            "",
        ];
        let figures: Vec<String> = (self.by_joint(reserves, 1.0, ["moment", "N·m"], &|_| false).into_iter())
            .map(|figure| figure.replacen("</b>", " reserve</b>", 1))
            .collect();
        let lead = "Moments that no muscle makes. Muscle and joint forces lack what they carry; beyond 10 % of the largest moment that a coordinate needs they are marked.";
        let content = format!("{}\n{}", table(&header, 1, &rows), grid("normal", &figures));
        section("Reserve moments", lead, &content)
    }
}
