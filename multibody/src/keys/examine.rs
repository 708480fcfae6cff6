//! A file held against its table of keys: every mistake, not only the first.

use std::path::Path;

use toml::Spanned;
use toml::de::{DeArray, DeInteger, DeTable, DeValue};

use super::{Key, Kind, Need};
use crate::error::{InputError, Mistakes, Place, hint, nearest};

/// Syntax errors that are named at most; what follows them is often their echo.
const SYNTAX_ERRORS: usize = 10;
/// Longest value that is quoted in a message \[characters\].
const LONGEST_VALUE: usize = 60;

/// What is left of a file once unknown keys and optional ones with unusable values are taken out.
pub struct Document<'a> {
    table: Spanned<DeTable<'a>>,
    /// Every required key is there with a value of its kind.
    usable: bool,
}

impl<'a> Document<'a> {
    /// Fills a struct; `None` where a required key is missing or of another kind. Whatever the table of keys let through and the struct does
    /// not take is a mistake, too.
    pub fn fill<T: serde::Deserialize<'a>>(self, file: &Path, text: &str, wrong: &mut Mistakes) -> Option<T> {
        if !self.usable {
            return None;
        }
        match T::deserialize(toml::Deserializer::from(self.table)) {
            Ok(filled) => Some(filled),
            Err(error) => {
                let at = Place::Line(error.span().map_or(1, |s| line_of(text, s.start)));
                let (file, problem) = (file.to_path_buf(), error.message().to_string());
                let remedy = "see the page of keys, docs/keys.md".to_string();
                wrong.note(InputError::Malformed { file, at, problem, remedy });
                None
            }
        }
    }
}

/// Reads `text` as TOML and compares it with `keys`. `None` where it is no TOML.
pub fn examine<'a>(file: &Path, text: &'a str, keys: &[Key], wrong: &mut Mistakes) -> Option<Document<'a>> {
    let (mut table, errors) = DeTable::parse_recoverable(text);
    let mut last_line = 0;
    for error in errors.iter().take(SYNTAX_ERRORS) {
        let line = error.span().map_or(1, |s| line_of(text, s.start));
        if line == last_line {
            continue; // one line, one mistake: the rest is its echo
        }
        last_line = line;
        wrong.note(InputError::Malformed {
            file: file.to_path_buf(),
            at: Place::Line(line),
            problem: format!("not TOML: {}", error.message()),
            remedy: "write `key = value`; text in quotes, sections as [name]".to_string(),
        });
    }
    if !errors.is_empty() {
        return None;
    }
    let mut walk = Walk { file, text, keys, wrong, usable: true };
    walk.table("", table.get_mut(), 1);
    let usable = walk.usable;
    Some(Document { table, usable })
}

/// How much the keys at the top of `text` are those of the table: 4 for each, 1 for one that is misspelt.
pub fn likeness(text: &str, keys: &[Key]) -> usize {
    let top: Vec<&str> = keys.iter().filter(|k| k.section().is_empty()).map(Key::name).collect();
    let of = |name: &str| match top.contains(&name) {
        true => 4,
        false => usize::from(nearest(name, top.iter().copied()).is_some()),
    };
    top_keys(text).iter().map(|name| of(name)).sum()
}

/// The keys at the top of a TOML file, also of one that breaks the rules further down.
pub fn top_keys(text: &str) -> Vec<String> {
    let (table, _) = DeTable::parse_recoverable(text);
    table.get_ref().keys().map(|k| k.get_ref().to_string()).collect()
}

/// Line of a byte, 1-based.
pub fn line_of(text: &str, byte: usize) -> usize {
    1 + text.get(..byte).unwrap_or(text).matches('\n').count()
}

struct Walk<'w> {
    file: &'w Path,
    text: &'w str,
    keys: &'w [Key],
    wrong: &'w mut Mistakes,
    usable: bool,
}

impl Walk<'_> {
    fn table(&mut self, section: &str, table: &mut DeTable, header: usize) {
        let keys = self.keys;
        let here: Vec<&Key> = keys.iter().filter(|k| k.section() == section).collect();
        // A misspelt key is taken for the one that was meant, so that its value is examined, too, and nothing else seems missing.
        let unknown: Vec<(String, usize)> = table
            .keys()
            .filter(|name| here.iter().all(|k| k.name() != name.get_ref().as_ref()))
            .map(|name| (name.get_ref().to_string(), line_of(self.text, name.span().start)))
            .collect();
        for (name, line) in unknown {
            let meant = self.unknown(section, &name, &here, line);
            if let (Some((written, value)), Some(meant)) = (table.remove_entry(name.as_str()), meant)
                && !table.contains_key(meant)
            {
                table.insert(Spanned::new(written.span(), meant.into()), value);
            }
        }
        let mut unusable = Vec::new();
        for (name, value) in table.iter_mut() {
            let line = line_of(self.text, name.span().start);
            let Some(key) = here.iter().find(|k| k.name() == name.get_ref().as_ref()) else { continue };
            if !self.value(key, value, line) {
                match key.need {
                    Need::Default(_) => unusable.push(key.name()),
                    Need::Required | Need::Optional(_) => self.usable = false,
                }
            }
        }
        for name in unusable {
            table.remove(name);
        }
        for key in here.iter().filter(|k| k.need == Need::Required && !table.contains_key(k.name())) {
            self.usable = false;
            self.wrong.note(InputError::MissingKey {
                file: self.file.to_path_buf(),
                line: header,
                key: key.name().to_string(),
                section: section.to_string(),
                remedy: match key.is_section() {
                    true => format!("add [{}] ({})", key.path, key.meaning),
                    false => format!("add for example `{} = {}` ({})", key.name(), key.example, key.meaning),
                },
            });
        }
    }

    /// Notes an unknown key; returns the known one that was probably meant.
    fn unknown(&mut self, section: &str, name: &str, here: &[&Key], line: usize) -> Option<&'static str> {
        let meant = nearest(name, here.iter().map(|k| k.name()));
        let elsewhere = || self.keys.iter().find(|k| k.name() == name && !k.section().is_empty());
        let hint = match (&meant, elsewhere()) {
            (Some(meant), _) => format!("did you mean `{meant}`? "),
            (None, Some(key)) => format!("it belongs into [{}]; ", key.section()),
            (None, None) => String::new(),
        };
        let place = if section.is_empty() { "at the top".to_string() } else { format!("in [{section}]") };
        let known: Vec<&str> = here.iter().map(|k| k.name()).collect();
        self.wrong.note(InputError::UnknownKey {
            file: self.file.to_path_buf(),
            line,
            key: name.to_string(),
            nearest: meant.clone(),
            known: format!("{hint}keys known {place}: {}", known.join(", ")),
        });
        here.iter().map(|k| k.name()).find(|k| meant.as_deref() == Some(*k))
    }

    /// Whether the value can be used; what is only out of bounds is noted and can.
    fn value(&mut self, key: &Key, value: &mut Spanned<DeValue>, line: usize) -> bool {
        let span = value.span();
        match (key.kind, value.get_mut()) {
            (Kind::Section, DeValue::Table(table)) => {
                self.table(key.path, table, line);
                true
            }
            (Kind::Sections, DeValue::Array(array)) if array.iter().all(|v| v.get_ref().is_table()) => {
                for element in array.iter_mut() {
                    let line = line_of(self.text, element.span().start);
                    if let DeValue::Table(table) = element.get_mut() {
                        self.table(key.path, table, line);
                    }
                }
                true
            }
            (Kind::Map, DeValue::Table(table)) => {
                let mut good = true;
                for (name, value) in table.iter() {
                    if value.get_ref().as_str().is_none() {
                        good = false;
                        let line = line_of(self.text, name.span().start);
                        self.bad(line, name.get_ref(), self.shown(value), "give text in quotes".into());
                    }
                }
                good
            }
            (kind, found) => match judge(&kind, found) {
                Verdict::Good => true,
                verdict => {
                    // Inside a list, the line of the element.
                    let at = match verdict {
                        Verdict::Element(k) => found.as_array().and_then(|a| a.get(k)).map(|v| v.span()),
                        _ => None,
                    };
                    let line = at.map_or(line, |s| line_of(self.text, s.start));
                    let remedy = self.remedy(key, found);
                    let value = Spanned::new(span, found.clone());
                    self.bad(line, key.name(), self.shown(&value), remedy);
                    matches!(verdict, Verdict::Bounds)
                }
            },
        }
    }

    fn remedy(&self, key: &Key, found: &DeValue) -> String {
        let meant = match (key.kind, found.as_str()) {
            (Kind::Word(words), Some(word)) => nearest(word, words.iter().copied()),
            (Kind::Either(kinds), Some(word)) => {
                let words =
                    kinds.iter().filter_map(|k| if let Kind::Word(words) = k { Some(*words) } else { None });
                nearest(word, words.flatten().copied())
            }
            _ => None,
        };
        let meant = hint(meant);
        format!("{meant}give {} ({})", key.kind.words(key.unit), key.meaning)
    }

    fn shown(&self, value: &Spanned<DeValue>) -> String {
        match value.get_ref() {
            DeValue::String(word) => format!("`{word}`"),
            DeValue::Float(_) | DeValue::Integer(_) => match number(value.get_ref()) {
                Some(number) => number.to_string(),
                None => self.text.get(value.span()).unwrap_or("").to_string(),
            },
            _ => {
                let text: String =
                    self.text.get(value.span()).unwrap_or("a table").chars().take(LONGEST_VALUE).collect();
                text.split_whitespace().collect::<Vec<_>>().join(" ")
            }
        }
    }

    fn bad(&mut self, line: usize, key: &str, value: String, remedy: String) {
        let (file, key) = (self.file.to_path_buf(), key.to_string());
        self.wrong.note(InputError::BadValue { file, line, key, value, remedy });
    }
}

enum Verdict {
    Good,
    /// Of the right kind, but too small or too large.
    Bounds,
    /// Another kind of value.
    Kind,
    /// Element of a list.
    Element(usize),
}

fn judge(kind: &Kind, value: &DeValue) -> Verdict {
    let all = |of: &dyn Fn(&DeValue) -> bool, count: Option<usize>| match value.as_array() {
        Some(list) if count.is_some_and(|n| n != list.len()) => Verdict::Kind,
        Some(list) => first_bad(list, of).map_or(Verdict::Good, Verdict::Element),
        None => Verdict::Kind,
    };
    let good = |yes: bool| if yes { Verdict::Good } else { Verdict::Kind };
    let is_count = |v: &DeValue, least: u64, most: u64| {
        v.as_integer().and_then(whole).is_some_and(|n| (i128::from(least)..=i128::from(most)).contains(&n))
    };
    match kind {
        Kind::Text | Kind::File => good(value.is_str()),
        Kind::Flag => good(value.is_bool()),
        Kind::Number(least, most) => match number(value) {
            Some(x) if (least..=most).contains(&&x) => Verdict::Good,
            Some(_) => Verdict::Bounds,
            None => Verdict::Kind,
        },
        Kind::Count(least, most) => match value.as_integer().and_then(whole) {
            Some(n) if (i128::from(*least)..=i128::from(*most)).contains(&n) => Verdict::Good,
            Some(n) if (0..=i128::from(i64::MAX)).contains(&n) => Verdict::Bounds,
            _ => Verdict::Kind,
        },
        Kind::Word(words) => good(value.as_str().is_some_and(|w| words.contains(&w))),
        Kind::Texts | Kind::Files => all(&|v| v.is_str(), None),
        Kind::Counts(least, most) => all(&|v| is_count(v, *least, *most), None),
        Kind::Vector => all(&|v| number(v).is_some_and(f64::is_finite), Some(3)),
        Kind::Names => all(&|v| v.is_str(), Some(3)),
        Kind::Either(kinds) => {
            let verdicts = || kinds.iter().map(|kind| judge(kind, value));
            if verdicts().any(|v| matches!(v, Verdict::Good)) {
                return Verdict::Good;
            }
            verdicts().find(|v| !matches!(v, Verdict::Kind)).unwrap_or(Verdict::Kind)
        }
        Kind::Values => good(value.as_array().is_some_and(|list| !list.is_empty())),
        Kind::Settings => good(value.is_table()),
        Kind::Section | Kind::Sections | Kind::Map => Verdict::Kind,
    }
}

fn first_bad(list: &DeArray, good: &dyn Fn(&DeValue) -> bool) -> Option<usize> {
    list.iter().position(|v| !good(v.get_ref()))
}

fn whole(integer: &DeInteger) -> Option<i128> {
    i128::from_str_radix(integer.as_str(), integer.radix()).ok()
}

/// A number, whole or not. NaN and infinity are numbers of TOML.
fn number(value: &DeValue) -> Option<f64> {
    match value {
        DeValue::Integer(integer) => whole(integer).map(|n| n as f64),
        DeValue::Float(float) => float.as_str().replace('_', "").parse().ok(),
        _ => None,
    }
}
