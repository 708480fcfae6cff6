//! Forces shared with what the muscles of the deformable thigh can do, beside those of the rigid leg alone.

use coupling::thigh::lines::lines_of_muscles;
use multibody::trial::Effort;

use super::capital;
use super::knee::resultant;
use crate::report::groups::grouped;
use crate::report::optimize::{View, words};
use crate::report::page::{grid, section};
use crate::report::plot::{Line, Plot, Size};
use crate::report::svg::{extent, fixed};
use crate::report::total_knee_force;

/// Joint forces that are drawn.
const JOINTS: [&str; 4] = ["knee_medial", "knee_lateral", "knee_total", "hip"];

fn joint(effort: &Effort, name: &str) -> Vec<f64> {
    let values = match name {
        "knee_total" => total_knee_force(effort),
        "hip" => resultant(&effort.reactions, name),
        _ => effort.reactions.column(name),
    };
    values.unwrap_or_default()
}

impl View<'_> {
    pub(in crate::report) fn with_thigh(&self) -> String {
        let Some(with_thigh) = self.report.with_thigh else { return String::new() };
        let (alone, with) = (&self.report.effort, &with_thigh.effort);
        let lines = |of: &dyn Fn(&Effort) -> Vec<f64>| {
            let line = |name: &str, class, values| Line { name: name.into(), class, time: None, values };
            vec![line("rigid", "measured", of(alone)), line("with the thigh", "c1", of(with))]
        };
        let of_joint = |name: &&str| {
            self.force_plot(capital(&words(name)), lines(&|effort: &Effort| joint(effort, name)))
        };
        let of_muscles = lines_of_muscles();
        let here: Vec<&String> = with_thigh.capacities.muscles().flat_map(|m| &of_muscles[m]).collect();
        let of_line = |j: usize| {
            let column =
                |effort: &Effort| effort.forces.values.column(j).iter().copied().collect::<Vec<f64>>();
            let peak =
                |effort: &Effort| extent(&column(effort)).map_or("–".into(), |(_, most)| fixed(most, 0));
            Plot {
                note: format!("{} → {} N", peak(alone), peak(with)),
                size: Size::Small,
                ..self.plot(alone.forces.columns[j].clone(), ["force", "N"], lines(&column))
            }
            .render()
        };
        let mut content = grid("normal", &JOINTS.iter().map(of_joint).collect::<Vec<_>>());
        for (title, members) in grouped(&alone.forces.columns) {
            let of_thigh = members.iter().filter(|&&j| here.contains(&&alone.forces.columns[j]));
            let figures: Vec<String> = of_thigh.map(|&j| of_line(j)).collect();
            if !figures.is_empty() {
                content += &format!("<h3>{title}</h3>\n{}\n", grid("small", &figures));
            }
        }
        let between = with_thigh.capacities.between_steps();
        let lead = format!(
            "Dashed: forces of the rigid leg alone. Blue: the same moments shared among muscles of the thigh with the lever arms and the least and greatest tensions that the \
             deformable thigh shows at the steps of compare; between them these are interpolated, which puts lever arms off by up to {} mm ({}) and bounds by up to {} N ({}). \
             {}. Beside the name of a muscle line: peak force alone and with the thigh.",
            fixed(1e3 * between.arm.0, 1),
            words(&between.arm.1),
            fixed(between.bound.0, 0),
            words(&between.bound.1),
            with_thigh.words()
        );
        section("With the deformable thigh", &lead, &content)
    }
}
