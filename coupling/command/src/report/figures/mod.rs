//! The figures of `optimize`: knee ([`knee`]), motion, loads, muscles, activations, other joints, quality.

mod knee;

use std::fmt::Write;

use multibody::emg::{self, Compared};
use multibody::sharing::KKT_TOLERANCE;
use multibody::trial::{Status, Table, Verdict};

use crate::report::STANCE_THRESHOLD;
use crate::report::groups::grouped;
use crate::report::heatmap::{Block, Row, heatmap};
use crate::report::optimize::{View, words};
use crate::report::page::{grid, section};
use crate::report::plot::{Line, Plot, RightAxis, Scale, Size};
use crate::report::svg::{extent, fixed};

const COLOURS: [&str; 6] = ["c1", "c2", "c3", "c4", "c5", "c6"];

/// The same axis of motion or space has the same colour everywhere.
fn colour(name: &str, position: usize) -> &'static str {
    match name {
        "flexion" | "x" | "forward" | "medial" => "c1",
        "adduction" | "y" | "up" | "lateral" => "c2",
        "rotation" | "z" | "right" => "c3",
        "inversion" => "c4",
        "resultant" | "total" => "ink",
        _ => COLOURS[position % COLOURS.len()],
    }
}

pub(super) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |c| c.to_uppercase().chain(chars).collect())
}

impl View<'_> {
    /// `axis`: what the values are, and their unit.
    fn plot<'b>(
        &'b self,
        title: impl Into<String>,
        axis: [&'static str; 2],
        lines: Vec<Line<'b>>,
    ) -> Plot<'b> {
        Plot {
            title: title.into(),
            note: String::new(),
            quantity: axis[0],
            unit: axis[1],
            axis: &self.axis,
            lines,
            bands: Vec::new(),
            size: Size::Normal,
            scale: Scale::FromZero,
            right: None,
            bound: None,
            gap: "no solution",
        }
    }

    /// A figure in N with body weights on the right.
    fn force_plot<'b>(&'b self, title: impl Into<String>, lines: Vec<Line<'b>>) -> String {
        let right = Some(RightAxis { per_unit: self.report.body_weight(), unit: "body weights" });
        Plot { right, ..self.plot(title, ["force", "N"], lines) }.render()
    }

    /// One figure per joint from a table whose columns are named `joint_coordinate`.
    pub(super) fn by_joint(
        &self,
        table: &Table,
        scale: f64,
        axis: [&'static str; 2],
        missing: &dyn Fn(usize) -> bool,
    ) -> Vec<String> {
        let joint = |name: &str| match name.split_once('_').map_or(name, |(joint, _)| joint) {
            "subtalar" => "ankle".to_string(), // drawn beside the other axis of the same ankle
            joint => joint.to_string(),
        };
        let mut joints: Vec<String> = Vec::new();
        for name in &table.columns {
            if !joints.contains(&joint(name)) {
                joints.push(joint(name));
            }
        }
        joints
            .iter()
            .map(|this| {
                let columns = table.columns.iter().enumerate().filter(|(_, name)| joint(name) == *this);
                let lines = columns.enumerate().map(|(position, (j, name))| {
                    let coordinate = name.split_once('_').map_or(name.as_str(), |(_, rest)| rest);
                    let column = table.values.column(j);
                    let values = column.iter().enumerate();
                    Line {
                        name: words(coordinate),
                        class: colour(coordinate, position),
                        time: None,
                        values: values.map(|(i, v)| if missing(i) { f64::NAN } else { v * scale }).collect(),
                    }
                });
                self.plot(capital(this), axis, lines.collect()).render()
            })
            .collect()
    }

    pub(super) fn motion(&self) -> String {
        let motion = self.report.motion;
        let frames = motion.report.clone();
        let reported = Table {
            columns: motion.angles.columns.clone(),
            values: motion.angles.values.rows(frames.start, frames.len()).into_owned(),
        };
        let failed = |i: usize| motion.fit[frames.start + i].failure.is_some();
        let mut figures = self.by_joint(&reported, 1_f64.to_degrees(), ["angle", "deg"], &failed);
        let rms: Vec<f64> = motion.fit[frames.clone()].iter().map(|f| f.marker_rms * 1e3).collect();
        let line = Line { name: "residual".into(), class: "c1", time: None, values: rms };
        figures.push(self.plot("Marker residual, RMS over markers", ["residual", "mm"], vec![line]).render());
        section(
            "Joint angles and marker fit",
            "Posture of least marker error under the joint constraints. Positive: flexion, adduction, inversion, internal rotation; pelvis: front up, right side down, right side forward.",
            &grid("normal", &figures),
        )
    }

    pub(super) fn loads(&self) -> String {
        let loads = self.report.loads;
        let directions = [("forward", "x"), ("up", "y"), ("right", "z")];
        let lines = directions.iter().enumerate().map(|(axis, (name, letter))| Line {
            name: format!("{name} ({letter})"),
            class: colour(name, axis),
            time: Some(&loads.time),
            values: loads.ground_force.iter().map(|f| f[axis]).collect(),
        });
        let mut figures = vec![self.force_plot("Ground reaction", lines.collect())];
        figures.push(self.centre_of_pressure());
        let free: Vec<f64> = loads.free_moment.iter().map(|m| m.y).collect();
        let free = Line { name: "free moment".into(), class: "c1", time: Some(&loads.time), values: free };
        figures.push(self.plot("Free moment, up", ["moment", "N·m"], vec![free]).render());
        for figure in self.by_joint(&loads.moments, 1.0, ["moment", "N·m"], &|_| false) {
            figures.push(figure.replacen("</b>", " moment</b>", 1));
        }
        section(
            "Ground reaction and joint moments",
            "Force of the ground on the foot; moment that the muscles must supply about each joint coordinate.",
            &grid("normal", &figures),
        )
    }

    /// Relative to its first place, in ground axes; only while the foot stands.
    fn centre_of_pressure(&self) -> String {
        let loads = self.report.loads;
        let stands = |i: usize| loads.ground_force[i].y > STANCE_THRESHOLD;
        let first = (0..loads.time.len()).find(|&i| stands(i));
        let lines = [(0, "forward"), (2, "right")].map(|(axis, name)| {
            let place = |i: usize| match first {
                Some(first) if stands(i) => {
                    1e3 * (loads.centre_of_pressure[i][axis] - loads.centre_of_pressure[first][axis])
                }
                _ => f64::NAN,
            };
            let values = (0..loads.time.len()).map(place).collect();
            Line { name: name.into(), class: colour(name, axis), time: Some(&loads.time), values }
        });
        self.plot("Centre of pressure, from its start", ["way", "mm"], lines.into()).render()
    }

    pub(super) fn muscle_forces(&self) -> String {
        let effort = self.report.effort;
        let mut content = String::new();
        for (title, members) in grouped(&effort.forces.columns) {
            let figures: Vec<String> = members.iter().map(|&j| self.muscle_plot(j)).collect();
            let _ = write!(content, "<h3>{title}</h3>\n{}\n", grid("small", &figures));
        }
        section(
            "Muscle forces",
            "Tension in N over % of the gait cycle, each muscle on its own scale. Beside the name: peak force and its fraction of the \
             strength; a dashed line marks the strength where it is on the scale. Hatched: no solution.",
            &content,
        )
    }

    fn muscle_plot(&self, j: usize) -> String {
        let effort = self.report.effort;
        let values: Vec<f64> = effort.forces.values.column(j).iter().copied().collect();
        let strength = self.report.muscles.get(j).map(|m| m.f_max).filter(|f| f.is_finite());
        let note = extent(&values).map_or("no solution".into(), |(_, peak)| match strength {
            Some(f_max) => format!("{} N, {} %", fixed(peak, 0), fixed(100.0 * peak / f_max, 0)),
            None => format!("{} N", fixed(peak, 0)),
        });
        let name = &effort.forces.columns[j];
        let line = Line { name: name.clone(), class: "c1", time: None, values };
        Plot {
            note,
            size: Size::Small,
            bound: strength.map(|f| (f, "strength")),
            ..self.plot(name.clone(), ["force", "N"], vec![line])
        }
        .render()
    }

    pub(super) fn activations(&self) -> String {
        let activations = &self.report.effort.activations;
        let blocks: Vec<Block> = grouped(&activations.columns)
            .into_iter()
            .map(|(title, members)| {
                let row = |j: usize| Row {
                    name: activations.columns[j].clone(),
                    values: activations.values.column(j).iter().copied().collect(),
                };
                Block { title: title.into(), rows: members.into_iter().map(row).collect() }
            })
            .collect();
        if blocks.is_empty() {
            return String::new();
        }
        // Two columns of about equal height.
        let rows = |blocks: &[Block]| blocks.iter().map(|b| b.rows.len() + 2).sum::<usize>();
        let split = (0..=blocks.len())
            .min_by_key(|&k| rows(&blocks[..k]).abs_diff(rows(&blocks[k..])))
            .unwrap_or(blocks.len());
        let (left, right) = blocks.split_at(split);
        let mut figures = vec![heatmap("Activations, first part", &self.axis, left)];
        if !right.is_empty() {
            figures.push(heatmap("Activations, second part", &self.axis, right));
        }
        let key = "<p class=\"lead\">0 %<span class=\"ramp\"></span>100 %; hatched: no solution</p>\n";
        section(
            "Activations",
            "Activation of each muscle at each frame.",
            &format!("{key}{}", grid("half", &figures)),
        )
    }

    /// Envelopes beside forces, each as a fraction of its largest value.
    pub(super) fn emg(&self) -> String {
        let Some(compared) = self.report.emg else { return String::new() };
        let figure = |c: &Compared| {
            let line = |name: &str, class, values: &[f64]| Line {
                name: name.into(),
                class,
                time: None,
                values: values.to_vec(),
            };
            let note = match (c.defect, c.concordance) {
                (Some(defect), _) => defect.words().to_string(),
                (None, Some(part)) => format!("{} %", fixed(100.0 * part, 0)),
                (None, None) => "no solution".into(),
            };
            let lines = vec![line("EMG", "measured", &c.envelope), line("force", "c1", &c.force)];
            Plot {
                note,
                size: Size::Small,
                bound: Some((emg::ON, "on")),
                ..self.plot(c.channel.clone(), ["part of the largest", ""], lines)
            }
            .render()
        };
        let mean = emg::overall(compared).map_or("–".into(), |part| fixed(100.0 * part, 0));
        let lead = format!(
            "Grey: envelope of the electromyogram (20 to 400 Hz, rectified, 6 Hz, delayed), blue: force of its muscles, each as a part of its largest value. \
             Beside the name: fraction of frames in which both are on or both off, above and below the dashed line; in the mean of the channels without \
             defect {mean} %."
        );
        let figures: Vec<String> = compared.iter().map(figure).collect();
        section("Electromyography", &lead, &grid("small", &figures))
    }

    fn reactions_on(&self, panel: Panel) -> Vec<usize> {
        let columns = &self.report.effort.reactions.columns;
        (0..columns.len()).filter(|&j| Panel::of(&columns[j]) == panel).collect()
    }

    /// The columns of one panel, with their resultant where they are the three components of a force.
    fn reaction_plot(&self, panel: Panel, columns: &[usize]) -> String {
        let reactions = &self.report.effort.reactions;
        let mut lines: Vec<Line> = columns
            .iter()
            .enumerate()
            .map(|(position, &j)| {
                let name = panel.short(&reactions.columns[j]);
                Line {
                    name: words(&name),
                    class: colour(&name, position),
                    time: None,
                    values: reactions.values.column(j).iter().copied().collect(),
                }
            })
            .collect();
        if matches!(panel, Panel::Hip | Panel::Ankle) && lines.len() == 3 {
            let norm = |i| lines.iter().map(|line| line.values[i] * line.values[i]).sum::<f64>().sqrt();
            let values = (0..self.axis.time.len()).map(norm).collect();
            lines.push(Line { name: "resultant".into(), class: "ink", time: None, values });
        }
        self.force_plot(panel.title(), lines)
    }

    pub(super) fn other_forces(&self) -> String {
        let mut figures = Vec::new();
        for panel in [Panel::Hip, Panel::Ankle, Panel::AnkleLigaments, Panel::Bones, Panel::Other] {
            let columns = self.reactions_on(panel);
            if !columns.is_empty() {
                figures.push(self.reaction_plot(panel, &columns));
            }
        }
        if figures.is_empty() {
            return String::new();
        }
        section("Hip, ankle and bones", "Joint contact and axial bone forces.", &grid("normal", &figures))
    }

    pub(super) fn quality(&self) -> String {
        let verdicts = &self.report.effort.verdicts;
        let values = |pick: &dyn Fn(&Verdict) -> f64| verdicts.iter().map(pick).collect::<Vec<_>>();
        let line = |name: &str, class, values| Line { name: name.into(), class, time: None, values };
        let solved = |v: &Verdict, value: f64| if v.status == Status::Solved { value } else { f64::NAN };
        let kkt = line("KKT", "c1", values(&|v| solved(v, v.kkt_residual)));
        let equality = line("equality", "c2", values(&|v| solved(v, v.equality_residual)));
        let bounds = line("active bounds", "c3", values(&|v| solved(v, v.active_bounds as f64)));
        let residuals = Plot {
            scale: Scale::Log,
            bound: Some((KKT_TOLERANCE, "tolerance")),
            ..self.plot("Residuals", ["relative residual", ""], vec![kkt, equality])
        };
        let mut figures = vec![
            residuals.render(),
            self.plot("Bounds that hold", ["number of bounds", ""], vec![bounds]).render(),
        ];
        let iterations = line("iterations", "c4", values(&|v| f64::from(v.iterations)));
        figures.push(self.plot("Solver iterations", ["number of iterations", ""], vec![iterations]).render());
        section(
            "Quality of the solution",
            "Relative residuals, recomputed from the answers and not the solver's word.",
            &grid("normal", &figures),
        )
    }
}

/// Which figure shows a reaction.
#[derive(Clone, Copy, PartialEq)]
enum Panel {
    Knee,
    Ligaments,
    Patella,
    Hip,
    Ankle,
    AnkleLigaments,
    Bones,
    Other,
}

impl Panel {
    fn of(column: &str) -> Panel {
        let name = column.strip_suffix("_N").unwrap_or(column);
        match name {
            "knee_medial" | "knee_lateral" => Panel::Knee,
            "acl" | "pcl" | "mcl" => Panel::Ligaments,
            _ if name.starts_with("knee_shear") => Panel::Ligaments,
            "tibiocalcaneal" | "calcaneofibular" => Panel::AnkleLigaments,
            _ if name.contains("axial") || name.contains("bone") => Panel::Bones,
            _ if name.starts_with("patell") => Panel::Patella,
            _ if name.starts_with("hip") => Panel::Hip,
            _ if name.starts_with("ankle") => Panel::Ankle,
            _ => Panel::Other,
        }
    }

    fn title(self) -> &'static str {
        match self {
            Panel::Knee => "Tibiofemoral contact",
            Panel::Ligaments => "Knee ligaments and shear",
            Panel::Patella => "Patella, contact and tendon",
            Panel::Hip => "Hip contact",
            Panel::Ankle => "Ankle contact",
            Panel::AnkleLigaments => "Ankle ligaments",
            Panel::Bones => "Axial bone forces",
            Panel::Other => "Other forces",
        }
    }

    /// The column name without what the title says already.
    fn short(self, column: &str) -> String {
        let name = column.strip_suffix("_N").unwrap_or(column);
        let component = name.rsplit('_').next().filter(|c| matches!(*c, "x" | "y" | "z"));
        match (self, component) {
            (Panel::Hip | Panel::Ankle | Panel::Patella, Some(axis)) => axis.into(),
            (Panel::Patella, None) => name.replace("patellar_", ""),
            (Panel::Bones, _) => name.replace("_axial", "").replace("axial_", ""),
            _ => name.into(),
        }
    }
}
