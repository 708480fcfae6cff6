//! Head, tables and lists of the page.

use std::fmt::Write;

use super::published::published;
use super::{CARRIES, CompareReport, Row, step_words, words};
use crate::report::page::{grid, list, section, table};
use crate::report::svg::{escape, fixed, significant};
use coupling::comparison::explain::explain;
use coupling::configuration::Configuration;

/// Differences above this are marked and explained \[N\].
const WORTH_EXPLAINING: f64 = 20.0;

/// Title, verdict and tiles.
pub(super) fn headline(report: &CompareReport) -> String {
    let mut out = format!(
        "<header data-start=\"0\" data-end=\"0\">\n<p class=\"eyebrow\">Sartorius · the deformable thigh beside the rigid leg</p>\n<h1>{}</h1>\n",
        escape(report.name)
    );
    let mesh = &report.comparison.thigh.mesh;
    let elements: usize = mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
    let steps: Vec<String> = report
        .comparison
        .steps
        .iter()
        .map(|s| {
            let knee = fixed(s.knee_flexion.to_degrees(), 0);
            format!("{} at {} s, knee flexed by {knee}°", step_words(s.name).to_lowercase(), fixed(s.time, 3))
        })
        .collect();
    let _ = writeln!(
        out,
        "<p class=\"subtitle\">{}; {} muscles, {elements} elements, {} nodes; {}</p>",
        escape(report.subject),
        report.comparison.thigh.muscles.len(),
        mesh.points.len(),
        escape(&steps.join("; "))
    );
    let missed = report.shortcomings();
    let (class, verdict, detail) = if missed.is_empty() {
        let done: Vec<String> = report.settled().iter().map(ToString::to_string).collect();
        let mut detail = format!("To the residual asked for: {}.", done.join("; "));
        if let Some(change) = report.passes.last().and_then(|p| p.change) {
            let passes = report.passes.len();
            let _ = write!(
                detail,
                " Two-way: in {passes} passes the capacity of the muscles settled to {}; all forces are those of the last pass.",
                significant(change, 1)
            );
        }
        ("ok", "Solved", detail)
    } else {
        ("bad", "Not solved", missed.join("; "))
    };
    let _ =
        writeln!(out, "<p class=\"verdict {class}\"><b>{verdict}</b><span>{}</span></p>", escape(&detail));
    out.push_str("<div class=\"tiles\">\n");
    for d in report.differences() {
        let _ = writeln!(
            out,
            "<div class=\"tile\"><span>{}, {}</span><b>{} <small>N</small></b><span>mean difference from the rigid leg; largest {} N ({})</span></div>",
            step_words(d.step),
            d.configuration.name(),
            fixed(d.mean.unwrap_or(f64::NAN), 1),
            fixed(d.largest, 1),
            escape(&words(&d.largest_muscle))
        );
    }
    out.push_str("</div>\n</header>\n");
    out
}

/// Which configurations were computed.
fn computed(report: &CompareReport) -> impl Iterator<Item = Configuration> {
    report.comparison.solutions.present().map(|(configuration, _)| configuration)
}

/// The table of all muscles per step, and the means beside the published ones.
pub(super) fn comparison(report: &CompareReport) -> String {
    let mut content = String::from("<div class=\"grid tables\">\n");
    for (k, step) in report.comparison.steps.iter().enumerate() {
        let rows = report.rows(k);
        let _ = write!(
            content,
            "<div class=\"scroll\"><table class=\"forces\"><caption>{}</caption><thead><tr><th scope=\"col\">Muscle</th>\
             <th scope=\"col\" class=\"n\">Activation</th><th scope=\"col\" class=\"n\">Rigid, N</th>",
            step_words(step.name)
        );
        for name in computed(report).map(Configuration::name) {
            let _ = write!(
                content,
                "<th scope=\"col\" class=\"n\">FE {name}, N</th><th scope=\"col\" class=\"n\">difference, N</th>"
            );
        }
        if report.comparison.one_way.is_some() {
            content.push_str(
                "<th scope=\"col\" class=\"n one-way\">one-way: rigid, N</th><th scope=\"col\" class=\"n\">one-way: FE, N</th>",
            );
        }
        content.push_str("</tr></thead><tbody>");
        for row in &rows {
            let quiet = if row.rigid < CARRIES { " class=\"rest\"" } else { "" };
            let _ = write!(
                content,
                "<tr{quiet}><th scope=\"row\">{}</th><td class=\"n\">{}</td><td class=\"n\">{}</td>",
                escape(&words(&row.muscle)),
                fixed(row.activation, 3),
                fixed(row.rigid, 1)
            );
            for c in computed(report) {
                content.push_str(&force_cells(row, c));
            }
            if let Some(before) = row.one_way {
                let fe = before.fe.map_or(f64::NAN, |f| f.total);
                let _ = write!(
                    content,
                    "<td class=\"n one-way\">{}</td><td class=\"n\">{}</td>",
                    fixed(before.rigid, 1),
                    fixed(fe, 1)
                );
            }
            content.push_str("</tr>\n");
        }
        content.push_str("</tbody></table></div>\n");
    }
    content.push_str("</div>\n<h3>Differences beside those of the publication</h3>\n");
    content.push_str(&summary(report));
    let mut lead = String::from(
        "Force through the belly of each muscle, along its line. The rigid column is the vector sum of the muscle's lines of action. Muscles at rest in the rigid leg are grey; differences of more than 20 N are marked and explained below.",
    );
    if report.comparison.one_way.is_some() {
        lead.push_str(
            " Two-way: rigid is what force sharing wants of the muscles with the lever arms, lengths and forces of the thigh, the sum of the tensions of a muscle's lines; activation is the isometric one that drives the muscle. The last columns are the forces before anything was fed back.",
        );
    }
    section("Muscle forces", &lead, &content)
}

fn force_cells(row: &Row, configuration: Configuration) -> String {
    let Some(force) = row.fe[configuration] else {
        return "<td class=\"n\">–</td><td class=\"n\">–</td>".into();
    };
    let difference = force.total - row.rigid;
    let mark = if difference.abs() > WORTH_EXPLAINING { " far" } else { "" };
    let percent = if row.rigid >= CARRIES {
        format!(" title=\"{} %\"", fixed(100.0 * difference / row.rigid, 1))
    } else {
        String::new()
    };
    let sign = if difference > 0.0 && fixed(difference, 1) != "0.0" { "+" } else { "" };
    format!(
        "<td class=\"n\">{}</td><td class=\"n{mark}\"{percent}>{sign}{}</td>",
        fixed(force.total, 1),
        fixed(difference, 1)
    )
}

/// Mean and largest difference beside the published ones.
fn summary(report: &CompareReport) -> String {
    let rows: Vec<Vec<String>> = report
        .differences()
        .iter()
        .map(|d| {
            let [mean, largest] = published(d.step, d.configuration);
            vec![
                step_words(d.step).into(),
                d.configuration.name().into(),
                words(&d.largest_muscle),
                fixed(d.mean.unwrap_or(f64::NAN), 1),
                fixed(d.mean_of_all, 1),
                fixed(d.largest, 1),
                fixed(mean, 1),
                fixed(largest, 1),
                fixed(d.shared_volume, 1),
            ]
        })
        .collect();
    let header = [
        "Step",
        "Configuration",
        "Largest at",
        "Mean, N",
        "Mean of all muscles, N",
        "Largest, N",
        "Published mean, N",
        "Published largest, N",
        "Volume shared by muscles, cm³",
    ];
    let note = "<p class=\"note\">Means are over the muscles that carry force in the rigid leg, as in the publication, whose subject, anatomy and fibres differ: a scale, not a target.</p>\n";
    [table(&header, 3, &rows), note.to_string()].concat()
}

/// What lies behind differences of more than 20 N.
pub(super) fn explanations(report: &CompareReport) -> String {
    let mut rows = Vec::new();
    for (c, solution) in report.comparison.solutions.present() {
        for (k, step) in report.comparison.steps.iter().enumerate() {
            let frame = solution.run.frames.iter().find(|f| f.time == 1.0 + k as f64);
            let Some(frame) = frame else { continue };
            let why = explain(
                &solution.plan,
                &report.comparison.thigh,
                &report.comparison.calibration,
                step,
                frame,
            );
            for (i, row) in report.rows(k).iter().enumerate() {
                let (Some(force), Some(difference)) = (row.fe[c], row.difference(c)) else { continue };
                if difference.abs() <= WORTH_EXPLAINING {
                    continue;
                }
                let why = &why[i];
                let some = |v: Option<f64>, digits| v.map_or("–".into(), |v| fixed(v, digits));
                rows.push(vec![
                    step_words(step.name).into(),
                    c.name().into(),
                    words(&row.muscle),
                    fixed(row.rigid, 1),
                    fixed(difference, 1),
                    fixed(force.fibre, 1),
                    fixed(force.matrix, 1),
                    fixed(force.shell, 1),
                    fixed(why.passive, 1),
                    some(why.rigid_passive, 1),
                    some(why.length_ratio, 3),
                    fixed(why.angle, 0),
                    some(why.contact, 1),
                ]);
            }
        }
    }
    if rows.is_empty() {
        return section(
            "What lies behind the differences",
            "No muscle is farther than 20 N from the rigid leg.",
            "",
        );
    }
    let header = [
        "Step",
        "Configuration",
        "Muscle",
        "Rigid, N",
        "Difference, N",
        "Fibres, N",
        "Matrix, N",
        "Shell, N",
        "Passive, N",
        "Passive in the rigid leg, N",
        "Fibre length over the rigid",
        "Angle of the lines, °",
        "Contact resultant, N",
    ];
    section(
        "What lies behind the differences",
        "For muscles farther than 20 N from the rigid leg: the parts of the section force; what no activation makes, and what the rigid lines would have of it at their length, which force sharing does not know; fibre length beside that of the rigid leg; the angle between the two lines of action; what all others press on the muscle. What a difference means, and how sure it is, stands in docs/concepts.md; `sartorius cost` says how sure every force of a scene is.",
        &table(&header, 3, &rows),
    )
}

/// What the reader must know, what was simulated and what not.
pub(super) fn effects(report: &CompareReport) -> String {
    let mut out = String::new();
    if !report.notes.is_empty() {
        let _ = write!(out, "<h3>Notes</h3>{}", list(report.notes.iter().map(|note| escape(note))));
    }
    let left_out =
        report.left_out.iter().map(|(what, why)| format!("<b>{}</b>: {}", escape(what), escape(why)));
    let lists = [
        format!("<div><h3>Simulated</h3>{}</div>", list(report.simulated.iter().map(|s| escape(s)))),
        format!("<div><h3>Left out</h3>{}</div>", list(left_out)),
    ];
    out + &grid("half", &lists)
}
