//! The page of deep flexion: curves over the flexion of the knee, measured poses beside them.

use std::fmt::Write;

use super::page::{document, grid, section, table};
use super::svg::{Ticks, escape, fixed, px};
use crate::output::deep_flexion::Results;
use coupling::knee::deep::nrmsd_sum;
use coupling::knee::flexion::Bent;
use coupling::knee::muscles::Muscles;

/// Size of a figure, and the margins of its frame.
const SIZE: [f64; 2] = [340.0, 220.0];
const MARGIN: [f64; 4] = [44.0, 12.0, 16.0, 34.0];
/// Titles of the coordinates, with their units.
pub(super) const COORDINATES: [(&str, &str); 6] = [
    ("Flexion", "degrees"),
    ("Rotation", "degrees"),
    ("Medial tilt", "degrees"),
    ("Forward", "mm"),
    ("Up", "mm"),
    ("Sideways", "mm"),
];

/// A curve: its name, class, whether it is drawn as points, and its points.
pub(super) type Curve = (&'static str, &'static str, bool, Vec<[f64; 2]>);

/// The page.
pub fn page(results: &Results) -> String {
    let deep = |c: usize| results.deep.frames.iter().map(move |f| [f.tibia.flexion, f.patella.to_array()[c]]);
    let near = |c: usize| {
        results
            .unloaded
            .iter()
            .flat_map(|u| &u.frames)
            .map(move |f| [f.tibia.flexion, f.patella.to_array()[c]])
    };
    let measured =
        |c: usize| results.scene.measured.rows.iter().map(move |r| [r[0].flexion, r[1].to_array()[c]]);
    let figures: Vec<String> = (0..6)
        .map(|c| {
            let curves = [
                ("deep flexion", "c1", false, deep(c).collect()),
                ("along the measured poses", "c2", false, near(c).collect()),
                ("measured", "ink", true, measured(c).collect()),
            ];
            figure(COORDINATES[c], &curves)
        })
        .collect();
    let loads = [
        figure(
            ("Contact force", "N"),
            &[(
                "deep flexion",
                "c1",
                false,
                results.deep.frames.iter().map(|f| [f.tibia.flexion, f.contact.force.norm()]).collect(),
            )],
        ),
        figure(
            ("Contact area", "mm2"),
            &[(
                "deep flexion",
                "c1",
                false,
                results.deep.frames.iter().map(|f| [f.tibia.flexion, 1e6 * f.contact.area]).collect(),
            )],
        ),
    ];
    let mut body = String::from("<h1>The patella in deep flexion</h1>\n");
    if let Some(stopped) = results.deep.stopped_told() {
        let _ = write!(body, "<p>{}</p>", escape(&stopped));
    }
    let [load, small] = results.forces;
    let pull = match results.deep.knee.muscles {
        None => format!("Quadriceps {load} N to deep flexion"),
        Some(_) => "Quadriceps passive".to_string(),
    };
    let lead = match (results.unloaded, &results.deep.knee.muscles) {
        (None, _) => format!("{pull}; the knee is made by the program."),
        (Some(_), None) => {
            format!("{pull}, {small} N along the measured poses; points: measured, without load.")
        }
        (Some(_), Some(_)) => format!("{pull}; points: measured, without load."),
    };
    body.push_str(&section("Where the patella is", &lead, &grid("normal", &figures)));
    let sections = super::knee_sections::figures(&results.scene.anatomy, results.deep);
    let lead = "Cut from front to back through the middle of the patella at the first frame, seen from lateral; cartilages of the tibia in their middles. Femur and patella grey, cartilage blue and orange; strands are drawn where they go, also beside the plane.";
    body.push_str(&section("The knee", lead, &grid("half", &sections)));
    if let Some(all) = results.against {
        let rows: Vec<Vec<String>> = (COORDINATES.iter().zip(all))
            .map(|((name, unit), of)| {
                let part = of.nrmsd.map_or("none".into(), |part| fixed(part, 2));
                vec![(*name).into(), (*unit).into(), fixed(of.rmsd, 2), part]
            })
            .collect();
        let sum = match nrmsd_sum(&all) {
            Some(sum) => format!("their sum is {sum:.2}. A mean near zero inflates its term."),
            None => "there is no sum, because a mean is zero.".to_string(),
        };
        let lead = format!(
            "Root mean square over all rows, and the same over the mean of the measured values; {sum}"
        );
        body.push_str(&section(
            "Against the measured poses",
            &lead,
            &table(&["coordinate", "unit", "RMSD", "NRMSD"], 2, &rows),
        ));
    }
    body.push_str(&section("Contact of the cartilage", "", &grid("normal", &loads)));
    if let Some(tissue) = &results.deep.knee.muscles {
        body.push_str(&muscles(results.deep, tissue));
    }
    let rows: Vec<Vec<String>> = (results.deep.knee.strands.iter().enumerate())
        .map(|(i, name)| {
            let most = |of: &dyn Fn(&coupling::knee::flexion::FlexionFrame) -> f64| {
                results.deep.frames.iter().map(of).fold(f64::NEG_INFINITY, f64::max)
            };
            vec![
                name.replace('_', " "),
                fixed(most(&|f| f.strands[i].tension), 0),
                fixed(100.0 * most(&|f| f.strands[i].strain), 1),
            ]
        })
        .collect();
    let lead =
        "Greatest tension and strain on the way. Heads of the quadriceps have a given tension and no strain.";
    body.push_str(&section("Strands", lead, &table(&["strand", "N", "%"], 1, &rows)));
    document("The patella in deep flexion", &body)
}

/// The quadriceps as tissue.
fn muscles(bent: &Bent, tissue: &Muscles) -> String {
    let all = || bent.frames.iter().filter_map(|f| Some((f.tibia.flexion, f.muscles?)));
    let stress = |which: usize| all().map(|(at, m)| [at, 1e-3 * m.stress[which]]).collect();
    let curves =
        [("95 % of the volume is below", "c1", false, stress(0)), ("greatest", "c2", false, stress(1))];
    let volume = all().map(|(at, m)| [at, m.least_volume]).collect();
    let figures = [
        figure(("Principal stress in rectus femoris", "kPa"), &curves),
        figure(("Least volume of a cell over that at rest", ""), &[("all heads", "c1", false, volume)]),
    ];
    let [places, left_out] = tissue.places();
    let crossed = |which: usize| all().map(|(_, m)| m.crossings[which]).sum::<usize>();
    let lead = format!(
        "{} hexahedra, {places} places on their sides that stay off the femur and {left_out} beside attachments that do not. Over all frames {} pairs of triangles of two heads intersect, and {} of a head and the femur (an exact test that contact has no part in).",
        tissue.n_cells,
        crossed(0),
        crossed(1)
    );
    section("Muscles", &lead, &grid("normal", &figures))
}

/// Curves over the flexion of the knee.
pub(super) fn figure((title, unit): (&str, &str), curves: &[Curve]) -> String {
    let all = || curves.iter().flat_map(|c| c.3.iter()).filter(|p| p[1].is_finite());
    let ends = |c: usize| {
        let (lo, hi) = all().fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p[c]), hi.max(p[c])));
        if lo < hi { [lo, hi] } else { [lo.min(0.0), lo.max(0.0) + 1.0] }
    };
    if all().next().is_none() {
        return String::new();
    }
    let ([x0, x1], [y0, y1]) = (ends(0), ends(1));
    let [left, right, top, bottom] = MARGIN;
    let x = |v: f64| left + (v - x0) / (x1 - x0) * (SIZE[0] - left - right);
    let y = |v: f64| SIZE[1] - bottom - (v - y0) / (y1 - y0) * (SIZE[1] - top - bottom);
    let mut out = format!(
        "<figure><figcaption>{} <span class=\"quiet\">{}</span></figcaption><svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">",
        escape(title),
        escape(unit),
        SIZE[0],
        SIZE[1],
        escape(title)
    );
    let ticks = Ticks::new(y0, y1, 5);
    super::svg::rows(&mut out, &ticks, [left, SIZE[0] - right], y, |t| ticks.label(t));
    let ticks = Ticks::new(x0, x1, 6);
    for &t in &ticks.at {
        let _ = write!(
            out,
            "<text class=\"mid\" x=\"{}\" y=\"{}\">{}</text>",
            px(x(t)),
            px(SIZE[1] - bottom + 16.0),
            ticks.label(t)
        );
    }
    for (name, class, points, line) in curves {
        let at = line.iter().map(|p| format!("{} {}", px(x(p[0])), px(y(p[1]))));
        if *points {
            for p in line {
                let _ = write!(
                    out,
                    "<circle class=\"{class}\" cx=\"{}\" cy=\"{}\" r=\"2.5\"><title>{name}</title></circle>",
                    px(x(p[0])),
                    px(y(p[1]))
                );
            }
        } else {
            let path: Vec<String> = at.collect();
            let _ = write!(
                out,
                "<path class=\"line {class}\" d=\"M{}\"><title>{name}</title></path>",
                path.join("L")
            );
        }
    }
    out.push_str("</svg></figure>");
    out
}
