//! The shell of a page: one file with style and script inside, and small HTML helpers.

use std::fmt::Write;

use super::svg::escape;

/// The whole document around `body`, which is HTML already.
pub fn document(title: &str, body: &str) -> String {
    document_with(title, body, "")
}

/// A [`document`] with a script of its own.
pub fn document_with(title: &str, body: &str, script: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n{body}</main>\n\
         <div id=\"tip\" hidden></div>\n<script>\n{}{script}</script>\n</body>\n</html>\n",
        escape(title),
        include_str!("style.css"),
        include_str!("hover.js"),
    )
}

/// A section with a heading, which is also its anchor, and a sentence below it (may be empty).
pub fn section(title: &str, lead: &str, content: &str) -> String {
    let lead =
        if lead.is_empty() { String::new() } else { format!("<p class=\"lead\">{}</p>\n", escape(lead)) };
    let id = title.to_lowercase().replace(|c: char| !c.is_ascii_alphanumeric(), "-");
    format!("<section id=\"{id}\">\n<h2>{}</h2>\n{lead}{content}\n</section>\n", escape(title))
}

/// Figures side by side; `class` says how wide.
pub fn grid(class: &str, figures: &[String]) -> String {
    format!("<div class=\"grid {class}\">\n{}\n</div>", figures.join("\n"))
}

/// A list; its items are HTML already.
pub fn list(items: impl Iterator<Item = String>) -> String {
    let items: String = items.map(|item| format!("<li>{item}</li>")).collect();
    format!("<ul class=\"plain\">{items}</ul>\n")
}

/// Two columns without header: label and value.
pub fn label_table(caption: &str, rows: &[(String, String)]) -> String {
    let mut out = format!("<table class=\"labels\"><caption>{}</caption>", escape(caption));
    for (label, value) in rows {
        let _ = write!(out, "<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(label), escape(value));
    }
    out.push_str("</table>");
    out
}

/// A table with header; the first `text_columns` columns are left-aligned, the others are numbers.
pub fn table(header: &[&str], text_columns: usize, rows: &[Vec<String>]) -> String {
    let class = |i: usize| if i < text_columns { "" } else { " class=\"n\"" };
    let mut out = String::from("<div class=\"scroll\"><table><thead><tr>");
    for (i, name) in header.iter().enumerate() {
        let _ = write!(out, "<th scope=\"col\"{}>{}</th>", class(i), escape(name));
    }
    out.push_str("</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        for (i, cell) in row.iter().enumerate() {
            let _ = write!(out, "<td{}>{}</td>", class(i), escape(cell));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>");
    out
}
