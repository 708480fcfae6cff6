//! The table of a study: a row per run, also per run without results.

use std::collections::BTreeSet;
use std::path::Path;

use super::file::Study;
use super::run::{Done, RunStatus};

/// What came of all runs that are done.
pub struct Rows {
    /// Names of what varies, in the order of the study.
    pub inputs: Vec<String>,
    /// Names of the numbers of solved runs, sorted.
    pub numbers: Vec<String>,
    /// A row per run, in their order; `None`: it is not done.
    pub runs: Vec<Option<Done>>,
}

impl Rows {
    /// Reads what lies below `out`. `key`: that of [`Study::key`].
    pub fn read(study: &Study, key: &str, out: &Path) -> Rows {
        let runs: Vec<Option<Done>> = (0..study.n_runs()).map(|run| Study::done(out, key, run)).collect();
        let names: BTreeSet<&String> = runs.iter().flatten().flat_map(|done| done.numbers.keys()).collect();
        Rows {
            inputs: study.dimensions.iter().map(|d| d.target.column()).collect(),
            numbers: names.into_iter().cloned().collect(),
            runs,
        }
    }

    /// Runs that are done.
    pub fn done(&self) -> impl Iterator<Item = &Done> {
        self.runs.iter().flatten()
    }

    /// How many are solved.
    pub fn solved(&self) -> usize {
        self.done().filter(|done| done.status == RunStatus::Solved).count()
    }

    /// Why runs have no results, the most frequent first: status, reason in which numbers are left out, how many, and the first of them.
    pub fn failures(&self) -> Vec<Failure> {
        let mut found: Vec<Failure> = Vec::new();
        for done in self.done().filter(|done| done.status != RunStatus::Solved) {
            let reason = without_numbers(done.reason.as_deref().unwrap_or("no reason given"));
            match found.iter_mut().find(|f| f.status == done.status && f.reason == reason) {
                Some(failure) => failure.runs.push(done.run),
                None => found.push(Failure { status: done.status, reason, runs: vec![done.run] }),
            }
        }
        found.sort_by_key(|f| std::cmp::Reverse(f.runs.len()));
        found
    }
}

/// Runs without results for one reason.
pub struct Failure {
    /// How they ended.
    pub status: RunStatus,
    /// Why; numbers are left out.
    pub reason: String,
    /// Which.
    pub runs: Vec<usize>,
}

/// A reason without its numbers, so that reasons of one kind are alike.
fn without_numbers(reason: &str) -> String {
    let mut words = String::new();
    let mut in_number = false;
    for c in reason.chars() {
        // A digit behind a letter belongs to a name: gmed1.
        let after_letter = words.chars().last().is_some_and(|l| l.is_alphabetic() || l == '_');
        let digit = c.is_ascii_digit() && !after_letter;
        let inside = in_number && (c.is_ascii_digit() || c == '.' || c == 'e' || c == '-');
        if (digit || inside) && !in_number {
            words.push('#');
        }
        in_number = digit || inside;
        if !in_number {
            words.push(c);
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::without_numbers;

    #[test]
    fn reasons_of_one_kind_are_alike() {
        let words = without_numbers("3 of 101 frames are not solved; gmed1 lacks -1.5e-3 N");
        assert_eq!(words, "# of # frames are not solved; gmed1 lacks -# N");
    }
}
