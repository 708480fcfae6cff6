//! Keys of the files that people write: where each stands, what it takes, its default, its meaning.
//!
//! One table per kind of file. Reading ([`examine`]), the templates ([`template()`]) and the page of keys ([`page()`]) are made from it, and a
//! test compares it with the structs that serde fills.

mod examine;
mod page;
mod template;

pub use examine::{Document, examine, likeness, line_of, top_keys};
pub use page::page;
pub use template::{Filled, template};

/// One key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Dotted path from the top of the file: `subject.mass_kg`. Keys of an array of tables stand under its name.
    pub path: &'static str,
    /// What it takes.
    pub kind: Kind,
    /// Whether it may be absent.
    pub need: Need,
    /// Unit; empty where there is none.
    pub unit: &'static str,
    /// What it means, in one sentence without full stop.
    pub meaning: &'static str,
    /// A value as TOML; empty for sections.
    pub example: &'static str,
}

/// What a key takes.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Any text.
    Text,
    /// Path of a file or folder.
    File,
    /// `true` or `false`.
    Flag,
    /// A number within these bounds.
    Number(f64, f64),
    /// A whole number within these bounds.
    Count(u64, u64),
    /// One of these words.
    Word(&'static [&'static str]),
    /// A list of names.
    Texts,
    /// A list of paths.
    Files,
    /// A list of whole numbers within these bounds.
    Counts(u64, u64),
    /// Three numbers.
    Vector,
    /// Three names.
    Names,
    /// Any of these.
    Either(&'static [Kind]),
    /// A table, `[name]`, with keys of its own.
    Section,
    /// An array of tables, `[[name]]`, with keys of their own.
    Sections,
    /// A table from any name to a text.
    Map,
    /// A list of values of any kind, at least one.
    Values,
    /// A table from any name to a value of any kind, `{ name = value }`.
    Settings,
}

/// Whether a key may be absent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Need {
    /// It must be there (where its section is there).
    Required,
    /// Absent is the same as this, written as TOML.
    Default(&'static str),
    /// It may be absent, and then this holds.
    Optional(&'static str),
}

impl Key {
    /// Name without the sections around it.
    pub fn name(&self) -> &'static str {
        self.path.rsplit('.').next().unwrap_or(self.path)
    }

    /// Path of the section around it; empty at the top.
    pub fn section(&self) -> &'static str {
        self.path.rsplit_once('.').map_or("", |(section, _)| section)
    }

    /// Whether it holds keys instead of a value.
    pub fn is_section(&self) -> bool {
        matches!(self.kind, Kind::Section | Kind::Sections | Kind::Map)
    }
}

impl Kind {
    /// In words, for messages and the page.
    pub fn words(&self, unit: &str) -> String {
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        match self {
            Kind::Text => "text in quotes".into(),
            Kind::File => "a path in quotes".into(),
            Kind::Flag => "true or false".into(),
            Kind::Number(least, most) if *most == f64::MAX && *least == f64::MIN => {
                format!("a number{}", in_unit(&unit))
            }
            Kind::Number(least, most) if *most == f64::MAX && *least == f64::MIN_POSITIVE => {
                format!("a number above 0{unit}")
            }
            Kind::Number(least, most) if *most == f64::MAX => format!("a number, {least}{unit} at least"),
            Kind::Number(least, most) => format!("a number, {least} to {most}{unit}"),
            Kind::Count(least, most) => format!("a whole number, {least} to {most}{unit}"),
            Kind::Word(words) => {
                let quoted: Vec<String> = words.iter().map(|w| format!("\"{w}\"")).collect();
                quoted.join(" or ")
            }
            Kind::Texts => "a list of names".into(),
            Kind::Files => "a list of paths".into(),
            Kind::Counts(least, most) => format!("a list of whole numbers, {least} to {most}"),
            Kind::Vector => format!("three numbers{}", in_unit(&unit)),
            Kind::Names => "a list of three names".into(),
            Kind::Either(kinds) => {
                let words: Vec<String> = kinds.iter().map(|k| k.words(unit.trim())).collect();
                words.join(", or ")
            }
            Kind::Section => "a section".into(),
            Kind::Sections => "any number of sections".into(),
            Kind::Map => "a section of names".into(),
            Kind::Values => "a list of values".into(),
            Kind::Settings => "a table of keys and values".into(),
        }
    }
}

fn in_unit(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" in{unit}") }
}

/// Where the table and the fields of `T` differ, section by section: what a test asserts to be empty.
pub fn differences<T: serde::de::DeserializeOwned>(keys: &[Key]) -> Vec<String> {
    let sections = keys.iter().filter(|k| matches!(k.kind, Kind::Section | Kind::Sections));
    let mut found = Vec::new();
    for path in std::iter::once("").chain(sections.map(|k| k.path)) {
        let mut text = String::new();
        for section in keys.iter().filter(|k| path == k.path || path.starts_with(&format!("{}.", k.path))) {
            text += &match section.kind {
                Kind::Sections => format!("[[{}]]\n", section.path),
                _ => format!("[{}]\n", section.path),
            };
        }
        // unknown field `no_such_key`, expected one of `motion`, `units`, …
        let Err(error) = toml::from_str::<T>(&(text + "no_such_key = 0\n")) else {
            found.push(format!("[{path}] takes any key"));
            continue;
        };
        let fields: Vec<&str> = error.message().split('`').skip(1).step_by(2).skip(1).collect();
        let rows: Vec<&str> = keys.iter().filter(|k| k.section() == path).map(Key::name).collect();
        let lacks = |a: &[&str], b: &[&str]| -> Vec<String> {
            a.iter().filter(|x| !b.contains(x)).map(|x| format!("[{path}] {x}")).collect()
        };
        found.extend(lacks(&fields, &rows).iter().map(|x| format!("{x} has no row")));
        found.extend(lacks(&rows, &fields).iter().map(|x| format!("{x} is no field")));
    }
    found
}

/// Rows of a table of keys, written short.
pub const fn key(
    path: &'static str,
    kind: Kind,
    need: Need,
    unit: &'static str,
    meaning: &'static str,
    example: &'static str,
) -> Key {
    Key { path, kind, need, unit, meaning, example }
}
