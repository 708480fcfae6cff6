//! Frames that are not solved, put together to problems: one per run of frames that ended the same way.

use std::ops::Range;

use multibody::trial::{Effort, FitVerdict, Motion, Status, Verdict};

use super::svg::significant;

/// How one frame ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Fitted, and its force sharing is optimal.
    Solved,
    /// No admissible forces carry the load.
    Infeasible,
    /// No answer.
    Failed,
    /// The markers were not fitted, whatever became of force sharing.
    NotFitted,
}

impl Mark {
    /// All, the good one first.
    pub const ALL: [Mark; 4] = [Mark::Solved, Mark::Infeasible, Mark::Failed, Mark::NotFitted];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Mark::Solved => "solved",
            Mark::Infeasible => "infeasible",
            Mark::Failed => "failed",
            Mark::NotFitted => "markers not fitted",
        }
    }
}

/// Reported frames one after the other that ended the same way.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Which, from 0.
    pub frames: Range<usize>,
    /// How they ended.
    pub mark: Mark,
    /// Why they are not solved; empty where they are.
    pub why: String,
}

impl Run {
    /// `52` or `52–61`, counted from 1.
    pub fn numbers(&self) -> String {
        match self.frames.len() {
            1 => self.frames.end.to_string(),
            _ => format!("{}–{}", self.frames.start + 1, self.frames.end),
        }
    }
}

/// Distinct reasons of a problem that are spelt out; `verdicts.csv` has those of every frame.
const REASONS_SHOWN: usize = 3;

/// All reported frames, in order.
pub fn runs(motion: &Motion, effort: &Effort) -> Vec<Run> {
    let fits = &motion.fit[motion.report.clone()];
    let mark = |(verdict, fit): (&Verdict, &FitVerdict)| match (fit.failure.is_some(), verdict.status) {
        (true, _) => Mark::NotFitted,
        (_, Status::Solved) => Mark::Solved,
        (_, Status::Infeasible) => Mark::Infeasible,
        (_, Status::Failed) => Mark::Failed,
    };
    let marks: Vec<Mark> = effort.verdicts.iter().zip(fits).map(mark).collect();
    let mut from = 0;
    let run = |same: &[Mark]| {
        let frames = from..from + same.len();
        from = frames.end;
        let why = match same[0] {
            Mark::Solved => String::new(),
            _ => why(&effort.verdicts[frames.clone()], &fits[frames.clone()], frames.start),
        };
        Run { frames, mark: same[0], why }
    };
    marks.chunk_by(|a, b| a == b).map(run).collect()
}

/// What keeps frames from being solved: moments that they lack at most, muscles at their bounds, and what the verdicts say. `first`: number of
/// the first frame, from 0.
fn why(verdicts: &[Verdict], fits: &[FitVerdict], first: usize) -> String {
    let mut parts: Vec<String> = Vec::new();
    // Coordinate, largest and smallest moment, in how many frames.
    let mut lacks: Vec<(&str, f64, f64, usize)> = Vec::new();
    let mut saturated: Vec<&str> = Vec::new();
    for verdict in verdicts {
        for s in &verdict.shortfall {
            match lacks.iter_mut().find(|l| l.0 == s.coordinate) {
                Some((_, most, least, frames)) => {
                    *frames += 1;
                    if s.missing.abs() > most.abs() {
                        *most = s.missing;
                    }
                    if s.missing.abs() < least.abs() {
                        *least = s.missing;
                    }
                }
                None => lacks.push((&s.coordinate, s.missing, s.missing, 1)),
            }
        }
        saturated.extend(verdict.saturated.iter().map(String::as_str));
    }
    lacks.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    // What is a thousandth of the worst would only clutter the sentence.
    let worth_saying = 1e-3 * lacks.first().map_or(0.0, |l| l.1.abs());
    lacks.retain(|l| l.1.abs() > worth_saying);
    for (coordinate, most, least, frames) in &lacks {
        let up_to = if significant(*most, 3) == significant(*least, 3) { "" } else { "up to " };
        let in_frames =
            if *frames < verdicts.len() { format!(" in {frames} of them") } else { String::new() };
        let coordinate = coordinate.replace('_', " ");
        parts.push(format!("{coordinate} lacks {up_to}{} N·m{in_frames}", significant(*most, 3)));
    }
    let mut reasons: Vec<&str> = Vec::new();
    if lacks.is_empty() {
        let of = |(v, f)| -> [Option<&String>; 2] {
            let (v, f): (&Verdict, &FitVerdict) = (v, f);
            // A frame without marker fit says so twice.
            [f.failure.as_ref(), v.reason.as_ref().filter(|r| f.failure.as_ref() != Some(r))]
        };
        reasons.extend(verdicts.iter().zip(fits).flat_map(of).flatten().map(String::as_str));
        reasons = distinct(reasons);
        parts.extend(reasons.iter().take(REASONS_SHOWN).map(|r| r.to_string()));
        if reasons.len() > REASONS_SHOWN {
            parts.push(format!("{} more reasons in verdicts.csv", reasons.len() - REASONS_SHOWN));
        }
    } else {
        let size = |v: &Verdict| v.shortfall.iter().map(|s| s.missing.abs()).fold(0.0, f64::max);
        let worst =
            (0..verdicts.len()).rev().max_by(|a, b| size(&verdicts[*a]).total_cmp(&size(&verdicts[*b])));
        let (at, worst) = worst.map(|i| (first + i + 1, &verdicts[i])).expect("a run has frames");
        let saturated = distinct(saturated);
        if !saturated.is_empty() {
            parts.push(format!("at their bound: {}", saturated.join(", ")));
        }
        if let Some(reason) = worst.reason.as_ref().filter(|_| verdicts.len() > 1) {
            parts.push(format!("worst, frame {at}: {reason}"));
        }
    }
    if parts.is_empty() { "no reason given".into() } else { parts.join("; ") }
}

/// Each once, in the order of their first appearance.
fn distinct(all: Vec<&str>) -> Vec<&str> {
    let mut seen = std::collections::BTreeSet::new();
    all.into_iter().filter(|one| seen.insert(*one)).collect()
}
