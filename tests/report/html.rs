//! A small reader of HTML that accepts only what the page may contain.

use std::collections::BTreeMap;

/// Every opening tag is closed in order, every attribute is quoted; returns tag name and attributes of each.
pub fn parse_html(page: &str) -> Vec<(String, BTreeMap<String, String>)> {
    const VOID: [&str; 2] = ["meta", "br"];
    let mut open: Vec<String> = Vec::new();
    let mut found = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").expect("doctype");
    while let Some(at) = rest.find('<') {
        assert!(!rest[..at].contains('>'), "stray > before {}", &rest[at..rest.len().min(at + 60)]);
        rest = &rest[at + 1..];
        if let Some(closing) = rest.strip_prefix('/') {
            let (name, after) = closing.split_once('>').expect("closing tag ends");
            assert_eq!(open.pop().as_deref(), Some(name), "closing tags are in order");
            rest = after;
            continue;
        }
        let name_end = rest.find(|c: char| !c.is_ascii_alphanumeric()).expect("tag ends");
        let name = rest[..name_end].to_string();
        assert!(!name.is_empty(), "stray < before {}", &rest[..rest.len().min(60)]);
        rest = rest[name_end..].trim_start();
        let mut attributes = BTreeMap::new();
        let closed = loop {
            if let Some(after) = rest.strip_prefix("/>") {
                rest = after;
                break true;
            }
            if let Some(after) = rest.strip_prefix('>') {
                rest = after;
                break false;
            }
            let end = rest.find(['=', ' ', '>']).expect("attribute ends");
            let key = rest[..end].to_string();
            rest = &rest[end..];
            let mut value = String::new();
            if let Some(after) = rest.strip_prefix("=\"") {
                let (text, after) = after.split_once('"').expect("quote ends");
                value = text.into();
                rest = after;
            } else {
                assert!(!rest.starts_with('='), "unquoted attribute {key} of {name}");
            }
            assert!(attributes.insert(key.clone(), value).is_none(), "{key} twice in {name}");
            rest = rest.trim_start();
        };
        if name == "style" || name == "script" {
            let end = rest.find(&format!("</{name}>")).expect("raw text ends");
            rest = &rest[end..];
        }
        if !closed && !VOID.contains(&name.as_str()) {
            open.push(name.clone());
        }
        found.push((name, attributes));
    }
    assert!(open.is_empty(), "left open: {open:?}");
    found
}

/// Well formed, self-contained, and all geometry is numbers.
pub fn check_page(page: &str) -> Vec<(String, BTreeMap<String, String>)> {
    for fetch in ["http://", "https://", "url(", "@import", "<link", " src=", "<img", "<iframe"] {
        assert!(!page.contains(fetch), "the page fetches something: {fetch}");
    }
    let tags = parse_html(page);
    for (name, attributes) in &tags {
        for key in
            ["d", "x", "y", "width", "height", "viewBox", "data-frame", "data-domain", "stroke-opacity"]
        {
            if name == "meta" {
                continue;
            }
            let Some(value) = attributes.get(key) else { continue };
            for number in value.split(|c: char| "MLHhvVZ ".contains(c)).filter(|n| !n.is_empty()) {
                assert!(number.parse::<f64>().is_ok_and(f64::is_finite), "{name} {key}: {number} in {value}");
            }
        }
    }
    tags
}

pub fn classed<'a>(
    tags: &'a [(String, BTreeMap<String, String>)],
    class: &'a str,
) -> impl Iterator<Item = &'a BTreeMap<String, String>> {
    tags.iter()
        .map(|(_, a)| a)
        .filter(move |a| a.get("class").is_some_and(|c| c.split(' ').any(|w| w == class)))
}
