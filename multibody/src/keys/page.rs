//! The page of keys, as Markdown.

use super::{Key, Kind, Need};

/// A heading, a sentence and a table per section.
pub fn page(title: &str, introduction: &str, keys: &[Key]) -> String {
    let mut text = format!("## {title}\n\n{introduction}\n");
    let mut sections = vec![None];
    sections.extend(keys.iter().filter(|k| k.is_section()).map(Some));
    for section in sections {
        let path = section.map_or("", |s| s.path);
        let inside = || keys.iter().filter(|k| k.section() == path && !k.is_section());
        if let Some(section) = section {
            let heading = match section.kind {
                Kind::Sections => format!("[[{path}]]"),
                _ => format!("[{path}]"),
            };
            text += &format!("\n### `{heading}`\n\n{}.\n{}\n", section.meaning, absence(section));
            if matches!(section.kind, Kind::Map) {
                text += &format!("For example `{}`.\n", section.example);
            }
        }
        if inside().next().is_none() {
            continue;
        }
        text += "\n| key | takes | unit | default | meaning | example |\n|---|---|---|---|---|---|\n";
        for key in inside() {
            let default = match key.need {
                Need::Required => "**must be there**".to_string(),
                Need::Default(value) => format!("`{value}`"),
                Need::Optional(absent) => format!("none: {absent}"),
            };
            text += &format!(
                "| `{}` | {} | {} | {default} | {} | `{}` |\n",
                key.name(),
                key.kind.words(key.unit),
                key.unit,
                key.meaning,
                key.example
            );
        }
    }
    text
}

fn absence(section: &Key) -> String {
    match section.need {
        Need::Required => "It must be there.".to_string(),
        Need::Default(value) => format!("Absent: {value}."),
        Need::Optional(absent) => format!("Absent: {absent}."),
    }
}
