//! What can be wrong with an input file: which file, where in it, what was found, and how to mend it.

use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

/// Where in a file something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Offset from the start of a binary file, 0-based.
    Byte(usize),
    /// Line of a text file, 1-based.
    Line(usize),
    /// Frame number as the recording counts them.
    Frame(usize),
    /// The file as a whole.
    Whole,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Byte(n) => write!(f, ", byte {n}"),
            Place::Line(n) => write!(f, ", line {n}"),
            Place::Frame(n) => write!(f, ", frame {n}"),
            Place::Whole => Ok(()),
        }
    }
}

/// A file that cannot be used, and why.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// The operating system refuses.
    #[error(
        "{file}: cannot be read ({source}); give the path of a file that is there, may be read and, where it is text, is UTF-8"
    )]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// The name says nothing about the format.
    #[error("{file}: unknown kind of file; wanted one of {wanted}")]
    UnknownKind {
        /// The file.
        file: PathBuf,
        /// Endings that are read.
        wanted: &'static str,
    },
    /// The content breaks the rules of its format.
    #[error("{file}{at}: {problem}; {remedy}")]
    Malformed {
        /// The file.
        file: PathBuf,
        /// Where.
        at: Place,
        /// What was found and what was expected.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// A number that is not finite, or beyond anything measured in a laboratory.
    #[error(
        "{file}{at}: {what} is {value}; a gap must be left empty, and a number must be finite and of human size"
    )]
    BadNumber {
        /// The file.
        file: PathBuf,
        /// Where.
        at: Place,
        /// Which quantity.
        what: String,
        /// As found.
        value: String,
    },
    /// Time stands still or runs backwards.
    #[error("{file}{at}: time {time} s follows {previous} s; times must increase, remove or repair the row")]
    TimeNotIncreasing {
        /// The file.
        file: PathBuf,
        /// Where.
        at: Place,
        /// The time found \[s\].
        time: f64,
        /// The time before it \[s\].
        previous: f64,
    },
    /// A key that the file does not know.
    #[error("{file}, line {line}: unknown key `{key}`; {known}")]
    UnknownKey {
        /// Trial file or scene.
        file: PathBuf,
        /// Line of the key.
        line: usize,
        /// The key.
        key: String,
        /// The known key that is spelt most like it.
        nearest: Option<String>,
        /// What was probably meant, and the keys that may stand there.
        known: String,
    },
    /// A key that must be there and is not.
    #[error("{file}, line {line}: `{key}` is missing{}; {remedy}", within(section))]
    MissingKey {
        /// Trial file or scene.
        file: PathBuf,
        /// Line of the section that lacks it.
        line: usize,
        /// The key.
        key: String,
        /// The section; empty at the top.
        section: String,
        /// What to add.
        remedy: String,
    },
    /// More than one mistake, a line each.
    #[error("{}", lines(.0))]
    Several(Vec<InputError>),
    /// What is wrong with one leg of a trial file of both.
    #[error("{side} leg: {error}")]
    OfLeg {
        /// `right` or `left`.
        side: &'static str,
        /// The mistake.
        error: Box<InputError>,
    },
    /// A value of the trial file that cannot be used.
    #[error("{file}, line {line}: `{key}` is {value}; {remedy}")]
    BadValue {
        /// The trial file.
        file: PathBuf,
        /// Line of the key.
        line: usize,
        /// The key.
        key: String,
        /// As found.
        value: String,
        /// What to do.
        remedy: String,
    },
    /// A path of the trial file that leaves its folder and the data folder.
    #[error(
        "{file}: path `{path}` leaves the folder of the trial file and the data folder; give a path \
         inside one of them (and the folder itself with --data)"
    )]
    PathEscapes {
        /// The trial file.
        file: PathBuf,
        /// The path as written.
        path: PathBuf,
    },
    /// A file that the trial file names and that is in none of the folders searched.
    #[error(
        "{file}: cannot find `{path}`; looked in {searched}; name the folder of the recordings with --data"
    )]
    NotFound {
        /// The trial file.
        file: PathBuf,
        /// The path as written.
        path: PathBuf,
        /// Folders searched.
        searched: String,
    },
    /// A name of the trial file that the recording or the table does not have.
    #[error("{file}, line {line}: `{name}` is not in {within}; {}", did_you_mean(nearest))]
    UnknownName {
        /// The trial file.
        file: PathBuf,
        /// Line of the name.
        line: usize,
        /// The name.
        name: String,
        /// The file that should have it.
        within: PathBuf,
        /// The name there that is spelt most like it.
        nearest: Option<String>,
    },
    /// A marker that is absent in every frame.
    #[error(
        "{file}: marker `{marker}` is not seen in any of {frames} frames; take it out of the trial file{}",
        if *zeros { " (every frame holds exact zeros, which mean missing here)" } else { "" }
    )]
    NeverSeen {
        /// The recording.
        file: PathBuf,
        /// The marker.
        marker: String,
        /// Number of frames.
        frames: usize,
        /// True where it is exact zeros that were taken for missing.
        zeros: bool,
    },
    /// A marker that sits exactly at the origin, which is how some programs write a gap.
    #[error(
        "{file}, frame {frame}: marker `{marker}` is exactly (0, 0, 0), which is how some programs write a gap; set \
         `zeros_missing = true`"
    )]
    ExactZero {
        /// The recording.
        file: PathBuf,
        /// Frame number as in the file.
        frame: usize,
        /// The marker.
        marker: String,
    },
    /// Lengths of the wrong size.
    #[error(
        "{file}: the markers of the leg span {span:.4} m, but the subject is {height} m tall; {guess}, so set \
         `units` in the trial file to what the numbers are"
    )]
    WrongUnits {
        /// The recording.
        file: PathBuf,
        /// Median distance between the two farthest markers \[m\].
        span: f64,
        /// Height of the subject \[m\].
        height: f64,
        /// What probably happened.
        guess: String,
    },
    /// Markers or axes that contradict the anatomy of a walking human.
    #[error("{file}: {problem}; {remedy}")]
    WrongSide {
        /// The recording.
        file: PathBuf,
        /// What contradicts what, with the number that tells.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// Two markers with each other's names.
    #[error(
        "{file}{at}: markers `{first}` and `{second}` seem exchanged: {reason}; exchange their names from there on"
    )]
    Swapped {
        /// The recording.
        file: PathBuf,
        /// Where it begins.
        at: Place,
        /// One marker.
        first: String,
        /// The other.
        second: String,
        /// The numbers that tell.
        reason: String,
    },
    /// Two names for one path.
    #[error(
        "{file}: markers `{first}` and `{second}` are the same point in every frame; take one out of the trial file"
    )]
    Duplicated {
        /// The recording.
        file: PathBuf,
        /// One marker.
        first: String,
        /// The other.
        second: String,
    },
    /// Markers of one segment that do not move together.
    #[error(
        "{file}: marker `{marker}` does not move with the {segment}: its distance to `{other}` varies by {spread_mm:.0} mm \
         (standard deviation); it is mislabelled in part of the trial or belongs to another segment"
    )]
    NotRigid {
        /// The recording.
        file: PathBuf,
        /// The marker.
        marker: String,
        /// The segment that the trial file gives it.
        segment: &'static str,
        /// A marker of the same segment.
        other: String,
        /// Standard deviation of the distance \[mm\].
        spread_mm: f64,
    },
    /// Motion and forces of different times.
    #[error(
        "{motion} runs from {motion_start:.4} to {motion_end:.4} s, {force} from {force_start:.4} to {force_end:.4} s: \
         they do not cover {start:.4} to {end:.4} s together; check that both are of one trial and share one clock"
    )]
    NoOverlap {
        /// The file with the markers.
        motion: PathBuf,
        /// Its first time \[s\].
        motion_start: f64,
        /// Its last time \[s\].
        motion_end: f64,
        /// The file with the forces.
        force: PathBuf,
        /// Its first time \[s\].
        force_start: f64,
        /// Its last time \[s\].
        force_end: f64,
        /// Start of the range wanted \[s\].
        start: f64,
        /// End of the range wanted \[s\].
        end: f64,
    },
    /// No foot on the plate.
    #[error(
        "{file}: plate {plate} is never loaded above {threshold} N for 50 ms (largest vertical force {peak:.1} N); name \
         the plates that the foot steps on in `[force] plates`"
    )]
    NoContact {
        /// The file with the forces.
        file: PathBuf,
        /// Number of the plate.
        plate: usize,
        /// Largest vertical force on the foot \[N\].
        peak: f64,
        /// Threshold of contact \[N\].
        threshold: f64,
    },
    /// Another foot on the plate.
    #[error(
        "{file}: the load on plate {plate} is at least {distance:.2} m from the {side} foot in every step; the other foot \
         stands there, or axes or units of the two files differ. Name the plates of the {side} foot, or correct `side`"
    )]
    WrongFoot {
        /// The file with the forces.
        file: PathBuf,
        /// Number of the plate.
        plate: usize,
        /// Side under study.
        side: &'static str,
        /// Smallest median distance from the centre of pressure to the foot markers \[m\].
        distance: f64,
    },
    /// Forces of the wrong size or sign.
    #[error("{file}: {problem}; {remedy}")]
    WrongForce {
        /// The file with the forces.
        file: PathBuf,
        /// The numbers that tell.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// Fewer heel strikes than the wanted cycle needs.
    #[error(
        "{file}: cycle {wanted} needs {} heel strikes on the named plates, found {found:?} s; name the plate of the next \
         step in `next_plate`, or give `start_s` and `end_s`", wanted + 1
    )]
    NoCycle {
        /// The file with the forces.
        file: PathBuf,
        /// Number of the cycle, 1-based.
        wanted: usize,
        /// Times of the heel strikes \[s\].
        found: Vec<f64>,
    },
}

impl InputError {
    /// Says whose mistake it is; of several, of each.
    pub fn of_leg(self, side: &'static str) -> InputError {
        match self {
            InputError::Several(all) => {
                InputError::Several(all.into_iter().map(|error| error.of_leg(side)).collect())
            }
            one => InputError::OfLeg { side, error: Box::new(one) },
        }
    }
}

fn within(section: &str) -> String {
    if section.is_empty() { String::new() } else { format!(" in [{section}]") }
}

/// A message per line; the first gets its `error:` from whoever prints the whole.
fn lines(errors: &[InputError]) -> String {
    errors.iter().map(InputError::to_string).collect::<Vec<_>>().join("\nerror: ")
}

/// Mistakes found so far: so that a person mends them all at once.
#[derive(Debug, Default)]
pub struct Mistakes(Vec<InputError>);

/// Mistakes that are kept; whoever made more mends these first.
const MOST_MISTAKES: usize = 200;

impl Mistakes {
    /// Adds a mistake; of several each by itself, and none that is there already.
    pub fn note(&mut self, error: InputError) {
        match error {
            InputError::Several(errors) => errors.into_iter().for_each(|e| self.note(e)),
            one if self.names_the_same_pair(&one) => {}
            one => {
                let text = one.to_string();
                if self.0.len() < MOST_MISTAKES && self.0.iter().all(|e| e.to_string() != text) {
                    self.0.push(one);
                }
            }
        }
    }

    /// Two markers that were found exchanged are so by every other measure, too.
    fn names_the_same_pair(&self, error: &InputError) -> bool {
        let pair = |e: &InputError| match e {
            InputError::Swapped { first, second, .. } if first < second => {
                Some((first.clone(), second.clone()))
            }
            InputError::Swapped { first, second, .. } => Some((second.clone(), first.clone())),
            _ => None,
        };
        pair(error).is_some_and(|p| self.0.iter().any(|e| pair(e).as_ref() == Some(&p)))
    }

    /// Takes over what is wrong with each leg of a trial, by its name: what is so with all of them once, the rest with the leg.
    pub fn note_legs(&mut self, legs: Vec<(&'static str, Mistakes)>) {
        let texts: Vec<BTreeSet<String>> =
            legs.iter().map(|(_, own)| own.0.iter().map(InputError::to_string).collect()).collect();
        for (side, own) in legs {
            for error in own.0 {
                let shared = texts.iter().all(|of_leg| of_leg.contains(&error.to_string()));
                self.note(if shared { error } else { error.of_leg(side) });
            }
        }
    }

    /// The value of a result, or its mistake noted.
    pub fn keep<T>(&mut self, result: Result<T, InputError>) -> Option<T> {
        result.map_err(|error| self.note(error)).ok()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// All of them, as one error.
    pub fn finish(mut self) -> Result<(), InputError> {
        match self.0.len() {
            0 => Ok(()),
            1 => Err(self.0.remove(0)),
            _ => Err(InputError::Several(self.0)),
        }
    }

    /// The mistakes.
    pub fn into_inner(self) -> Vec<InputError> {
        self.0
    }
}

fn did_you_mean(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("did you mean `{name}`?"),
        None => "remove it".to_string(),
    }
}

/// What an error says of the name that was probably meant, with a blank behind it; nothing where none is near.
pub fn hint(nearest: Option<String>) -> String {
    nearest.map_or(String::new(), |name| format!("did you mean `{name}`? "))
}

/// The remedy for a name that is none of `known`: the nearest one, then what there is. `what_are`: such as "the muscles of the thigh are".
pub fn unknown<'a>(name: &str, what_are: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let hint = hint(nearest(name, known.clone()));
    format!("{hint}{what_are} {}", known.collect::<Vec<_>>().join(", "))
}

/// The candidate spelt most like `name` (Levenshtein distance, case ignored), if it is near enough to be meant.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let wanted: Vec<char> = name.chars().take(64).flat_map(char::to_lowercase).collect();
    candidates
        .into_iter()
        .map(|c| {
            let letters: Vec<char> = c.chars().take(64).flat_map(char::to_lowercase).collect();
            (edit_distance(&wanted, &letters), letters.len(), c)
        })
        .min_by_key(|(distance, _, _)| *distance)
        .filter(|(distance, length, _)| *distance <= 1 + wanted.len().max(*length) / 3)
        .map(|(_, _, c)| c.to_string())
}

fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (diagonal + usize::from(x != y)).min(above + 1).min(row[j] + 1);
            diagonal = above;
        }
    }
    row[b.len()]
}
