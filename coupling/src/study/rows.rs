//! The table of a study: a row per run, also per run without results. Columns are named once and rows hold their cells alone, so that a million of them fit
//! in memory.

use std::collections::BTreeMap;
use std::path::Path;

use super::file::Study;
use super::indices::{Index, index};
use super::run::{Done, RunStatus, Set};

/// A value of what varies.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A number.
    Number(f64),
    /// A word.
    Word(String),
}

/// One run.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Place in [`Study::subjects`].
    pub subject: usize,
    /// Place in [`Study::settings`].
    pub setting: usize,
    /// Which sample.
    pub sample: usize,
    /// Whose values of the sample.
    pub set: Set,
    /// How it ended.
    pub status: RunStatus,
    /// Why, when it is not solved.
    pub reason: Option<String>,
    /// Wall time \[s\].
    pub seconds: f64,
    /// Values of [`Rows::inputs`].
    pub values: Vec<Cell>,
    /// Numbers, by their place in the order in which runs had them first.
    numbers: Vec<f64>,
}

/// What came of all runs that are done.
pub struct Rows {
    /// Names of what varies, in the order of the study.
    pub inputs: Vec<String>,
    /// Names of the numbers of solved runs, sorted.
    pub numbers: Vec<String>,
    /// A row per run, in their order; `None`: it is not done.
    pub runs: Vec<Option<Row>>,
    /// Place in a row of every name of `numbers`.
    places: Vec<usize>,
}

impl Rows {
    /// Reads what lies below `out`. `key`: that of [`Study::key`].
    pub fn read(study: &Study, key: &str, out: &Path) -> Rows {
        let inputs: Vec<String> = study.dimensions.iter().map(|d| d.target.column()).collect();
        let mut known: BTreeMap<String, usize> = BTreeMap::new();
        let mut row = |run: usize| {
            let done = Study::done(out, key, run)?;
            let mut numbers = vec![f64::NAN; known.len()];
            for (name, number) in &done.numbers {
                let place = match known.get(name) {
                    Some(place) => *place,
                    None => {
                        known.insert(name.clone(), known.len());
                        numbers.push(f64::NAN);
                        known.len() - 1
                    }
                };
                numbers[place] = *number;
            }
            if done.numbers.is_empty() {
                numbers.clear();
            }
            Some(Row::of(study, run, done, &inputs, numbers))
        };
        let runs: Vec<Option<Row>> = (0..study.n_runs()).map(&mut row).collect();
        let (numbers, places) = known.into_iter().unzip();
        Rows { inputs, numbers, runs, places }
    }

    /// Runs that are done, with their numbers in the study.
    pub fn done(&self) -> impl Iterator<Item = (usize, &Row)> {
        self.runs.iter().enumerate().filter_map(|(run, row)| Some((run, row.as_ref()?)))
    }

    /// A number of a run by its place in [`Rows::numbers`], where it has one.
    pub fn number(&self, row: &Row, k: usize) -> Option<f64> {
        row.numbers.get(self.places[k]).copied().filter(|v| v.is_finite())
    }

    /// How many are solved.
    pub fn solved(&self) -> usize {
        self.done().filter(|(_, row)| row.status == RunStatus::Solved).count()
    }

    /// Sobol indices of every number by subject, setting and group, where the study asks for them.
    pub fn indices(&self, study: &Study) -> Vec<OfGroup> {
        let mut all = Vec::new();
        if !study.indices {
            return all;
        }
        for number in 0..self.numbers.len() {
            for subject in 0..study.subjects.len() {
                for setting in 0..study.settings.len() {
                    let value = |sample: usize, set: Set| {
                        let row = self.runs[study.run(sample, set, subject, setting)].as_ref()?;
                        self.number(row, number).filter(|_| row.status == RunStatus::Solved)
                    };
                    let of_sample = |sample: usize| {
                        study.sets().map(|set| value(sample, set)).collect::<Option<Vec<f64>>>()
                    };
                    let solved: Vec<Vec<f64>> = (0..study.samples).filter_map(of_sample).collect();
                    let column = |k: usize| solved.iter().map(|values| values[k]).collect::<Vec<f64>>();
                    let (first, second) = (column(0), column(1));
                    for group in 0..study.groups.len() {
                        let Some(index) = index(&first, &second, &column(2 + group)) else { continue };
                        all.push(OfGroup { number, subject, setting, group, samples: solved.len(), index });
                    }
                }
            }
        }
        all
    }

    /// Why runs have no results, the most frequent first.
    pub fn failures(&self) -> Vec<Failure> {
        let mut found: Vec<Failure> = Vec::new();
        for (run, row) in self.done().filter(|(_, row)| row.status != RunStatus::Solved) {
            let reason = without_numbers(row.reason.as_deref().unwrap_or("no reason given"));
            match found.iter_mut().find(|f| f.status == row.status && f.reason == reason) {
                Some(failure) => failure.runs.push(run),
                None => found.push(Failure { status: row.status, reason, runs: vec![run] }),
            }
        }
        found.sort_by_key(|f| std::cmp::Reverse(f.runs.len()));
        found
    }
}

impl Row {
    fn of(study: &Study, run: usize, done: Done, inputs: &[String], numbers: Vec<f64>) -> Row {
        let task = study.task(run);
        let cell = |name: &String| match &done.values[name] {
            serde_json::Value::String(word) => Cell::Word(word.clone()),
            value => Cell::Number(value.as_f64().unwrap_or(f64::NAN)),
        };
        Row {
            subject: task.subject,
            setting: task.setting,
            sample: task.sample,
            set: task.set,
            status: done.status,
            reason: done.reason,
            seconds: done.seconds,
            values: inputs.iter().map(cell).collect(),
            numbers,
        }
    }
}

/// The index of one number, of one subject and setting, for one group.
#[derive(Clone, Debug, PartialEq)]
pub struct OfGroup {
    /// Place in [`Rows::numbers`].
    pub number: usize,
    /// Place in [`Study::subjects`].
    pub subject: usize,
    /// Place in [`Study::settings`].
    pub setting: usize,
    /// Place in [`Study::groups`].
    pub group: usize,
    /// Samples of which all sets are solved; the others are left out.
    pub samples: usize,
    /// The index.
    pub index: Index,
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
