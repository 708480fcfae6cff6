//! What the run cost: seconds per stage, and what the solver did in each frame.

use std::fmt::Write;

use super::{CompareReport, frame_label};
use crate::report::page::{section, table};
use crate::report::svg::{escape, fixed, px};

/// Bars of the stages and a table per frame. The only part of the page that differs between two runs of a scene.
pub(super) fn section_of(report: &CompareReport) -> String {
    let total: f64 = report.seconds.iter().map(|s| s.1).sum();
    let most = report.seconds.iter().map(|s| s.1).fold(1e-9, f64::max);
    let height = 22.0 * report.seconds.len() as f64;
    let mut content = format!(
        "<figure class=\"stages wide\"><svg viewBox=\"0 0 640 {}\" role=\"img\" aria-label=\"seconds per stage\">",
        px(height + 18.0)
    );
    for (i, (stage, seconds)) in report.seconds.iter().enumerate() {
        let y = 22.0 * i as f64;
        let width = (430.0 * seconds / most).max(0.6);
        let _ = write!(
            content,
            "<text class=\"end name\" x=\"132\" y=\"{}\">{}</text><rect class=\"bar c1\" x=\"140\" y=\"{}\" width=\"{}\" height=\"14\"/><text x=\"{}\" y=\"{}\">{} s</text>",
            px(y + 14.0),
            escape(stage),
            px(y + 3.0),
            px(width),
            px(146.0 + width),
            px(y + 14.0),
            fixed(*seconds, if *seconds < 10.0 { 2 } else { 1 })
        );
    }
    let _ = write!(content, "<text x=\"140\" y=\"{}\">wall time, s</text>", px(height + 14.0));
    content.push_str("</svg></figure>\n");
    let mut rows = Vec::new();
    for (configuration, solution) in report.comparison.solutions.present() {
        for frame in &solution.run.frames {
            let sum = |of: &dyn Fn(&fem::solve::Advance) -> f64| frame.islands.iter().map(of).sum::<f64>();
            rows.push(vec![
                configuration.name().into(),
                frame_label(report, frame.time, true),
                frame.islands.len().to_string(),
                fixed(sum(&|a| a.load_steps as f64), 0),
                fixed(sum(&|a| a.iterations as f64), 0),
                fixed(sum(&|a| a.factorizations as f64), 0),
                fixed(sum(&|a| a.linear_iterations as f64), 0),
                fixed(sum(&|a| a.assembly_s), 2),
                fixed(sum(&|a| a.factorization_s), 2),
                fixed(sum(&|a| a.linear_s), 2),
                fixed(sum(&|a| a.contact_s), 2),
            ]);
        }
    }
    let header = [
        "Configuration",
        "Frame",
        "Islands",
        "Load steps",
        "Newton iterations",
        "Factorizations",
        "CG iterations",
        "Assembly, s",
        "Factors, s",
        "CG, s",
        "Contact, s",
    ];
    content.push_str(&table(&header, 2, &rows));
    let unknowns: Vec<String> = report
        .comparison
        .solutions
        .present()
        .map(|(configuration, solution)| format!("{} {}", solution.plan.n_unknowns(), configuration.name()))
        .collect();
    section(
        "Cost",
        &format!(
            "{} s in all; unknowns: {}. Sums over islands, which are solved side by side: their seconds are those of one core.",
            fixed(total, 1),
            unknowns.join(", ")
        ),
        &content,
    )
}
