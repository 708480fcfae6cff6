//! Head, tables and lists of the page.

use std::fmt::Write;

use fem::geometry::Surface;
use fem::measure::{fibre_states, pair_forces};
use nalgebra::Vector3;

use super::published::published;
use super::{CARRIES, CONFIGURATIONS, CompareReport, Computed, Row, step_words, words};
use crate::report::page::{section, table};
use crate::report::svg::{escape, fixed};

/// Differences above this are marked and explained \[N\].
const WORTH_EXPLAINING: f64 = 20.0;

/// Title, verdict and tiles.
pub(super) fn headline(report: &CompareReport) -> String {
    let mut out = format!(
        "<header data-start=\"0\" data-end=\"0\">\n<p class=\"eyebrow\">Sartorius · the deformable thigh beside the rigid leg</p>\n<h1>{}</h1>\n",
        escape(report.name)
    );
    let mesh = &report.thigh.mesh;
    let elements: usize = mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
    let steps: Vec<String> = report
        .steps
        .iter()
        .map(|s| {
            let knee = fixed(s.knee_flexion.to_degrees(), 0);
            format!("{} at {} s, knee flexed by {knee}°", step_words(s.name).to_lowercase(), fixed(s.time, 3))
        })
        .collect();
    let _ = writeln!(
        out,
        "<p class=\"subtitle\">{} muscles, {elements} elements, {} nodes; {}</p>",
        report.thigh.muscles.len(),
        mesh.points.len(),
        escape(&steps.join("; "))
    );
    let missed = report.shortcomings();
    let (class, verdict, detail) = if missed.is_empty() {
        let done: Vec<&str> = computed(report).map(|c| CONFIGURATIONS[c]).collect();
        ("ok", "Solved", format!("Every step {} is in equilibrium.", done.join(" and ")))
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
            d.configuration,
            fixed(d.mean, 1),
            fixed(d.largest, 1),
            escape(&words(&d.largest_muscle))
        );
    }
    out.push_str("</div>\n</header>\n");
    out
}

/// Which configurations were computed.
fn computed(report: &CompareReport) -> impl Iterator<Item = usize> {
    (0..2).filter(|c| report.configurations[*c].is_some())
}

/// The table of all muscles per step, and the means beside the published ones.
pub(super) fn comparison(report: &CompareReport) -> String {
    let mut content = String::from("<div class=\"grid tables\">\n");
    for (k, step) in report.steps.iter().enumerate() {
        let rows = report.rows(k);
        let _ = write!(
            content,
            "<div class=\"scroll\"><table class=\"forces\"><caption>{}</caption><thead><tr><th scope=\"col\">Muscle</th>\
             <th scope=\"col\" class=\"n\">Activation</th><th scope=\"col\" class=\"n\">Rigid, N</th>",
            step_words(step.name)
        );
        for name in computed(report).map(|c| CONFIGURATIONS[c]) {
            let _ = write!(
                content,
                "<th scope=\"col\" class=\"n\">FE {name}, N</th><th scope=\"col\" class=\"n\">difference, N</th>"
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
            content.push_str("</tr>\n");
        }
        content.push_str("</tbody></table></div>\n");
    }
    content.push_str("</div>\n<h3>Differences beside those of the publication</h3>\n");
    content.push_str(&summary(report));
    section(
        "Muscle forces",
        "Force through the belly of each muscle, along its line. The rigid column is the vector sum of the muscle's lines of action. Muscles at rest in the rigid leg are grey; differences of more than 20 N are marked and explained below.",
        &content,
    )
}

fn force_cells(row: &Row, configuration: usize) -> String {
    let Some(force) = row.fe[configuration] else {
        return "<td class=\"n\">–</td><td class=\"n\">–</td>".into();
    };
    let difference = force.total - row.rigid;
    let mark = if difference.abs() > WORTH_EXPLAINING { " far" } else { "" };
    let share = if row.rigid >= CARRIES {
        format!(" title=\"{} %\"", fixed(100.0 * difference / row.rigid, 1))
    } else {
        String::new()
    };
    let sign = if difference > 0.0 && fixed(difference, 1) != "0.0" { "+" } else { "" };
    format!(
        "<td class=\"n\">{}</td><td class=\"n{mark}\"{share}>{sign}{}</td>",
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
            let c = CONFIGURATIONS.iter().position(|n| *n == d.configuration).expect("one of both");
            let [mean, largest] = published(d.step, c);
            vec![
                step_words(d.step).into(),
                d.configuration.into(),
                words(&d.largest_muscle),
                fixed(d.mean, 1),
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
    for (c, computed) in report.configurations.iter().enumerate() {
        let Some(Computed { plan, result }) = computed else { continue };
        for (k, step) in report.steps.iter().enumerate() {
            let frame = result.run.frames.iter().find(|f| f.time == 1.0 + k as f64);
            let Some(frame) = frame else { continue };
            let contact = pair_forces(plan, frame.snapshot(), [0.0; 3]);
            for (i, row) in report.rows(k).iter().enumerate() {
                let (Some(force), Some(difference)) = (row.fe[c], row.difference(c)) else { continue };
                if difference.abs() <= WORTH_EXPLAINING {
                    continue;
                }
                let muscle = &report.thigh.muscles[i];
                let own = format!("{}/surface", muscle.name);
                let pushed: Vector3<f64> = contact
                    .iter()
                    .filter(|p| p.names.contains(&own))
                    .map(|p| if p.names[0] == own { 1.0 } else { -1.0 } * Vector3::from(p.wrench.force))
                    .sum();
                let states = fibre_states(plan, frame.snapshot(), &format!("{}/fibres", muscle.name));
                let stretch =
                    states.map_or(f64::NAN, |s| s.iter().map(|f| f.stretch).sum::<f64>() / s.len() as f64);
                let line = step.muscle(&muscle.name).map(|m| m.force());
                let angle = line.map_or(f64::NAN, |line| line.angle(&belly(report, frame, i)).to_degrees());
                rows.push(vec![
                    step_words(step.name).into(),
                    CONFIGURATIONS[c].into(),
                    words(&row.muscle),
                    fixed(row.rigid, 1),
                    fixed(difference, 1),
                    fixed(force.fibre, 1),
                    fixed(force.matrix, 1),
                    fixed(force.shell, 1),
                    fixed(stretch, 3),
                    if row.rigid < CARRIES { "–".into() } else { fixed(angle, 0) },
                    if c == 0 { "–".into() } else { fixed(pushed.norm(), 1) },
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
        "Mean fibre stretch",
        "Angle to rigid line, °",
        "Contact resultant, N",
    ];
    section(
        "What lies behind the differences",
        "For muscles farther than 20 N from the rigid leg: the parts of the section force, how far the fibres are stretched, the angle between the belly and the rigid line of action, and what all others press on the muscle.",
        &table(&header, 3, &rows),
    )
}

/// Direction of a muscle's belly in a frame, from origin to insertion: between the middles of the layers beside the cut.
fn belly(report: &CompareReport, frame: &fem::run::Frame, muscle: usize) -> Vector3<f64> {
    let m = &report.thigh.muscles[muscle];
    let faces = &report.thigh.mesh.surfaces[&format!("{}/surface", m.name)];
    let (at_rest, nodes) = Surface::from_faces(&report.thigh.mesh.points, faces);
    // Nodes of the surface belong to the layer whose centre is nearest.
    let layer = m.layer_at(0.5);
    let (a, b) = (layer.saturating_sub(1), (layer + 1).min(m.line.len() - 1));
    let middle = |layer: usize| {
        let own = |p: &[f64; 3]| {
            let far = |l: &usize| (m.line[*l] - Vector3::from(*p)).norm();
            (0..m.line.len()).min_by(|i, j| far(i).total_cmp(&far(j))) == Some(layer)
        };
        let places: Vec<Vector3<f64>> = at_rest
            .points
            .iter()
            .zip(&nodes)
            .filter(|(p, _)| own(p))
            .map(|(_, &n)| Vector3::from(frame.x.as_chunks::<3>().0[n as usize]))
            .collect();
        places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64
    };
    middle(b) - middle(a)
}

/// What was simulated and what not.
pub(super) fn effects(report: &CompareReport) -> String {
    let mut out = String::from("<div class=\"grid half\"><div><h3>Simulated</h3><ul class=\"plain\">");
    for sentence in report.simulated {
        let _ = write!(out, "<li>{}</li>", escape(sentence));
    }
    out.push_str("</ul></div><div><h3>Left out</h3><ul class=\"plain\">");
    for (what, why) in report.left_out {
        let _ = write!(out, "<li><b>{}</b>: {}</li>", escape(what), escape(why));
    }
    out.push_str("</ul></div></div>\n");
    out
}
