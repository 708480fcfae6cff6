//! A file with every key and its meaning, filled in as far as known.

use std::collections::BTreeMap;

use super::{Key, Kind, Need};

/// What is known of a file that is to be written.
#[derive(Clone, Debug, Default)]
pub struct Filled {
    /// Lines at the top, without `#`.
    pub heading: Vec<String>,
    /// Dotted path → value as TOML. A key of `[[sections]]` has its number in the path: `force.columns.0.plate`.
    pub values: BTreeMap<String, String>,
    /// Dotted path → what to say of it, a line each; for a required key without value: what to fill in.
    pub notes: BTreeMap<String, Vec<String>>,
    /// Dotted path → value as TOML of a key that stays commented out, in place of its example.
    pub offers: BTreeMap<String, String>,
}

impl Filled {
    /// Gives a key its value.
    pub fn set(&mut self, path: &str, value: impl Into<String>) {
        self.values.insert(path.to_string(), value.into());
    }

    /// Says something of a key or section.
    pub fn note(&mut self, path: &str, line: impl Into<String>) {
        self.notes.entry(path.to_string()).or_default().push(line.into());
    }

    fn has_below(&self, path: &str) -> bool {
        let below = |p: &String| p.strip_prefix(path).is_some_and(|rest| rest.starts_with('.'));
        self.values.keys().any(below)
    }
}

/// Every key of the table: those that are known or have a default as `key = value`, the others commented out.
pub fn template(keys: &[Key], filled: &Filled) -> String {
    let mut text: String = filled.heading.iter().map(|line| comment(line)).collect();
    values(&mut text, keys, "", "", filled, false);
    for section in keys.iter().filter(|k| k.is_section()) {
        match section.kind {
            Kind::Sections => {
                let numbered = |n: usize| format!("{}.{n}", section.path);
                let count = (0..).take_while(|n| filled.has_below(&numbered(*n))).count();
                head(&mut text, section, filled, count == 0);
                if count == 0 {
                    values(&mut text, keys, section.path, section.path, filled, true);
                }
                for n in 0..count {
                    if n > 0 {
                        text += &format!("\n[[{}]]\n", section.path);
                    }
                    values(&mut text, keys, section.path, &numbered(n), filled, false);
                }
            }
            Kind::Map => {
                let prefix = format!("{}.", section.path);
                let entries: Vec<_> =
                    filled.values.iter().filter_map(|(p, v)| Some((p.strip_prefix(&prefix)?, v))).collect();
                head(&mut text, section, filled, entries.is_empty());
                if entries.is_empty() {
                    text += &format!("# {}\n", section.example);
                }
                entries.iter().for_each(|(item, value)| text += &format!("\"{item}\" = {value}\n"));
            }
            // Sections inside of arrays of tables are left to the page of keys.
            _ if keys.iter().any(|k| k.path == section.section() && matches!(k.kind, Kind::Sections)) => {}
            _ => {
                let open = is_open(keys, section, filled);
                head(&mut text, section, filled, !open);
                values(&mut text, keys, section.path, section.path, filled, !open);
            }
        }
    }
    text
}

/// A section with required keys and none of them known, which may be absent, is commented out as a whole, and all sections inside.
fn is_open(keys: &[Key], section: &Key, filled: &Filled) -> bool {
    let inside = || keys.iter().filter(|k| k.section() == section.path);
    let around = keys.iter().find(|k| k.path == section.section());
    around.is_none_or(|around| is_open(keys, around, filled))
        && (section.need == Need::Required
            || filled.has_below(section.path)
            || inside().all(|k| k.need != Need::Required))
}

/// A line of a comment: what a recording says may hold anything, and a comment ends with its line.
fn comment(line: &str) -> String {
    let plain: String = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("# {plain}").trim_end().to_string() + "\n"
}

fn head(text: &mut String, section: &Key, filled: &Filled, commented: bool) {
    let path = section.path;
    let (open, close) = if matches!(section.kind, Kind::Sections) { ("[[", "]]") } else { ("[", "]") };
    let mark = if commented { "# " } else { "" };
    let absent = match (commented, section.need) {
        (true, Need::Optional(absent)) => format!(" Absent: {absent}."),
        _ => String::new(),
    };
    *text += &format!("\n# {}.{absent}\n", section.meaning);
    notes(text, filled, path);
    *text += &format!("{mark}{open}{path}{close}\n");
}

fn notes(text: &mut String, filled: &Filled, path: &str) {
    for line in filled.notes.get(path).into_iter().flatten() {
        *text += &comment(line);
    }
}

/// The keys of a section that are no sections. `at`: their path in `filled`.
fn values(text: &mut String, keys: &[Key], section: &str, at: &str, filled: &Filled, commented: bool) {
    for key in keys.iter().filter(|k| k.section() == section && !k.is_section()) {
        let path = if at.is_empty() { key.name().to_string() } else { format!("{at}.{}", key.name()) };
        let unit = if key.unit.is_empty() || key.meaning.ends_with(key.unit) {
            String::new()
        } else {
            format!(" [{}]", key.unit)
        };
        notes(text, filled, &path);
        let example = filled.offers.get(&path).map_or(key.example, String::as_str);
        let line = match (filled.values.get(&path), key.need) {
            (Some(value), _) if !commented => format!("{} = {value} # {}{unit}", key.name(), key.meaning),
            (_, Need::Default(value)) if !commented => {
                format!("{} = {value} # {}{unit}", key.name(), key.meaning)
            }
            (_, Need::Required) if !commented => {
                format!("# FILL IN: {} = {example} # {}{unit}", key.name(), key.meaning)
            }
            (_, Need::Optional(absent)) => {
                format!("# {} = {example} # {}{unit}; absent: {absent}", key.name(), key.meaning)
            }
            _ => format!("# {} = {example} # {}{unit}", key.name(), key.meaning),
        };
        *text += &(line + "\n");
    }
}
