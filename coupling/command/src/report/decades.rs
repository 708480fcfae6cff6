//! A number against seconds, both in decades: every setting a point with its name.

use std::fmt::Write;

use coupling::cost::curve::pareto;
use coupling::number::{fixed, significant};

use super::svg::{escape, px};

/// A point of a figure.
pub struct Dot {
    /// Its name.
    pub name: String,
    /// What it took.
    pub seconds: f64,
    /// Above zero, or it is left out.
    pub value: f64,
}

/// A figure of decades: every rung a point with its name. `ideal`: with the line of a method whose error halves when the time doubles.
pub fn decades(title: &str, quantity: &str, mut points: Vec<Dot>, ideal: bool) -> String {
    const SIZE: [f64; 2] = [560.0, 380.0];
    const BOX: [f64; 4] = [52.0, 8.0, 546.0, 340.0]; // left, top, right, bottom
    points.retain(|p| p.seconds > 0.0 && p.value > 0.0);
    points.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    if points.is_empty() {
        return String::new();
    }
    // From a 1, 2 or 5 below the least value to one above the greatest.
    let reach = |of: fn(&Dot) -> f64| {
        let round = |v: f64, up: bool| {
            let decade = v.log10().floor();
            let steps = [1.0, 2.0, 5.0, 10.0].map(|k| k * 10f64.powf(decade));
            let found = if up { steps.iter().find(|s| **s >= v) } else { steps.iter().rfind(|s| **s <= v) };
            found.copied().unwrap_or(v).log10()
        };
        let low = round(points.iter().map(of).fold(f64::INFINITY, f64::min), false);
        let high = round(points.iter().map(of).fold(0.0, f64::max), true);
        [low, high.max(low + 0.5)]
    };
    let (across, up) = (reach(|p| p.seconds), reach(|p| p.value));
    let x = |v: f64| BOX[0] + (v.log10() - across[0]) / (across[1] - across[0]) * (BOX[2] - BOX[0]);
    let y = |v: f64| BOX[3] - (v.log10() - up[0]) / (up[1] - up[0]) * (BOX[3] - BOX[1]);
    let mut svg = format!(
        "<figure><figcaption><b>{}</b></figcaption><svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">",
        escape(title),
        px(SIZE[0]),
        px(SIZE[1]),
        escape(title)
    );
    for (range, is_across) in [(across, true), (up, false)] {
        for decade in range[0].floor() as i32..=range[1].ceil() as i32 {
            for k in 1..10 {
                let v = f64::from(k) * 10f64.powi(decade);
                if v > 10f64.powf(range[1]) * 1.001 || v < 10f64.powf(range[0]) * 0.999 {
                    continue;
                }
                let _ = match is_across {
                    true => write!(
                        svg,
                        "<path class=\"gridline\" d=\"M{} {}V{}\"/>",
                        px(x(v)),
                        px(BOX[1]),
                        px(BOX[3])
                    ),
                    false => write!(
                        svg,
                        "<path class=\"gridline\" d=\"M{} {}H{}\"/>",
                        px(BOX[0]),
                        px(y(v)),
                        px(BOX[2])
                    ),
                };
                if matches!(k, 1 | 2 | 5) {
                    let text = coupling::number::short(v);
                    let _ = match is_across {
                        true => write!(
                            svg,
                            "<path class=\"axis\" d=\"M{} {}v4\"/><text class=\"mid\" x=\"{}\" y=\"{}\">{text}</text>",
                            px(x(v)),
                            px(BOX[3]),
                            px(x(v)),
                            px(BOX[3] + 15.0)
                        ),
                        false => write!(
                            svg,
                            "<text class=\"end\" x=\"{}\" y=\"{}\">{text}</text>",
                            px(BOX[0] - 6.0),
                            px(y(v) + 3.5)
                        ),
                    };
                }
            }
        }
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{} {}V{}H{}\"/><text class=\"mid\" x=\"{}\" y=\"{}\">time, s</text>\
         <text class=\"mid\" transform=\"translate(11 {}) rotate(-90)\">{}</text>",
        px(BOX[0]),
        px(BOX[1]),
        px(BOX[3]),
        px(BOX[2]),
        px(0.5 * (BOX[0] + BOX[2])),
        px(SIZE[1] - 6.0),
        px(0.5 * (BOX[1] + BOX[3])),
        escape(quantity)
    );
    if ideal {
        let front = pareto(&points.iter().map(|p| [p.seconds, p.value]).collect::<Vec<_>>());
        let path: Vec<String> = front
            .iter()
            .map(|&k| format!("{} {}", px(x(points[k].seconds)), px(y(points[k].value))))
            .collect();
        let _ = write!(svg, "<path class=\"line c1\" d=\"M{}\"/>", path.join("L"));
        let (low, high) = (10f64.powf(across[0]), 10f64.powf(across[1]));
        // Through the middle of the figure, as far as it reaches.
        let middle = 10f64.powf(0.5 * (across[0] + across[1]) + 0.5 * (up[0] + up[1]));
        let (from, to) = (low.max(middle / 10f64.powf(up[1])), high.min(middle / 10f64.powf(up[0])));
        let _ = write!(
            svg,
            "<path class=\"bound\" d=\"M{} {}L{} {}\"/>",
            px(x(from)),
            px(y(middle / from)),
            px(x(to)),
            px(y(middle / to))
        );
    }
    // What is there: left, right, top and bottom of points and names.
    let mut taken: Vec<[f64; 4]> = points
        .iter()
        .map(|p| (x(p.seconds), y(p.value)))
        .map(|(at, up)| [at - 4.0, at + 4.0, up - 4.0, up + 4.0])
        .collect();
    for p in &points {
        let (at, up) = (x(p.seconds), y(p.value));
        let _ = write!(
            svg,
            "<circle class=\"c2\" cx=\"{}\" cy=\"{}\" r=\"3.2\"><title>{}: {} s, {}</title></circle>",
            px(at),
            px(up),
            escape(&p.name),
            fixed(p.seconds, 1),
            significant(p.value, 3)
        );
        let width = 5.0 * p.name.chars().count() as f64;
        // The nearest free place on either side; a point without one keeps its name as a tooltip.
        let places = [0.0, -9.0, 9.0, -18.0, 18.0].into_iter().flat_map(|d| [(false, d), (true, d)]);
        let place = places
            .map(|(to_left, d)| {
                let from = if to_left { at - 7.0 - width } else { at + 7.0 };
                (to_left, [from, from + width, up + d - 5.0, up + d + 5.0])
            })
            .find(|(_, [from, to, top, bottom])| {
                let inside = *from >= BOX[0] && *to <= BOX[2] && *top >= BOX[1] - 5.0 && *bottom <= BOX[3];
                inside && taken.iter().all(|t| *to < t[0] || *from > t[1] || *bottom < t[2] || *top > t[3])
            });
        if let Some((to_left, name)) = place {
            taken.push(name);
            let class = if to_left { "end minor" } else { "minor" };
            let _ = write!(
                svg,
                "<text class=\"{class}\" x=\"{}\" y=\"{}\">{}</text>",
                px(if to_left { name[1] } else { name[0] }),
                px(name[2] + 8.5),
                escape(&p.name.replace('_', " "))
            );
        }
    }
    svg.push_str("</svg></figure>");
    svg
}

/// A figure as a picture of its own (SVG), for other pages and for print.
pub fn picture(figure: &str) -> String {
    let from = figure.find("<svg").unwrap_or(0);
    let to = figure.find("</figure>").unwrap_or(figure.len());
    let opened = figure[from..to].replacen(
        "<svg ",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"840\" height=\"570\" ",
        1,
    );
    let style = "<style>text{font:11px sans-serif;fill:#5c6670}.mid{text-anchor:middle}.end{text-anchor:end}.minor{font-size:9.5px}.axis{stroke:#5c6670;fill:none}\
                 .gridline{stroke:#e9ecef;fill:none}.bound{stroke:#1b1f24;stroke-dasharray:5 3;stroke-opacity:.65;fill:none}.line{fill:none;stroke-width:1.9}\
                 .c1{stroke:#0072b2}.c2{stroke:#d55e00;fill:#d55e00}path.c1{fill:none}</style>\
                 <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>";
    match opened.find('>') {
        Some(end) => format!("{}{style}{}\n", &opened[..=end], &opened[end + 1..]),
        None => opened,
    }
}
