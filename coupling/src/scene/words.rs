//! What a scene simulates and what it leaves out, in words: for the page, for `run.json` and for `plan`.

use fem::scene::ContactMode;
use mesher::part::is_strands;

use super::{Fibres, Scene, StressFree};
use crate::configuration::{Configuration, PerConfiguration};
use crate::number::short;
use crate::thigh::build::Thigh;
use crate::thigh::lines::lines_of_muscles;

impl Scene {
    /// Settings as label and value.
    pub fn settings(&self) -> Vec<(String, String)> {
        let trial = self.trial.as_ref().and_then(|t| t.file_stem());
        let thigh = match (&self.surfaces, self.deformable) {
            (_, false) => "none".to_string(),
            (None, true) => "built in".to_string(),
            (Some(folder), true) => {
                format!("surfaces of {}", folder.file_name().unwrap_or_default().to_string_lossy())
            }
        };
        let stress_free = match self.stress_free {
            StressFree::Standing => "standing, as meshed",
            StressFree::HeelStrike => "at heel strike, as in the publication",
        };
        let fibres = match self.fibres {
            Fibres::Hill => "Hill: force from activation and length",
            Fibres::Thermal => "thermal: force from contraction",
            Fibres::None => "none",
        };
        let contact = match self.contact {
            Some(ContactMode::Guarded) => "guarded: nothing passes through",
            Some(ContactMode::Cheap) => "cheap: a penalty on the penetration",
            None => "none",
        };
        let apart = match self.fibre_spacing {
            1 => String::new(),
            nodes => format!("; one at {nodes} nodes along each row of a section"),
        };
        let distance = match self.contact {
            Some(_) => format!(", from {} mm", short(self.contact_distance * 1e3)),
            None => String::new(),
        };
        let steps: Vec<String> = self
            .steps
            .iter()
            .map(|s| match s.knee_flexion {
                None => s.name.name().to_string(),
                Some(angle) => {
                    format!("{} with the knee flexed by {}°", s.name.name(), short(angle.to_degrees()))
                }
            })
            .collect();
        let activations = self.controller.as_ref().map_or_else(String::new, |unit| {
            format!("of the unit {}", unit.file_name().unwrap_or_default().to_string_lossy())
        });
        let materials = if self.deformable { self.materials.settings(self.shells) } else { Vec::new() };
        let in_grids = self.fidelity.in_words();
        let coarser = self.coarser(Configuration::WithoutContact);
        let is_cheap = self.contact == Some(ContactMode::Cheap);
        let coarser: Vec<String> = coarser.iter().map(|edge| short(edge * 1e3)).collect();
        let is_led = !coarser.is_empty();
        let coarser = match is_led {
            false => "none: solver.nested_from_mm is less than twice the resolution".into(),
            true if is_cheap => format!("{} mm, without contact", coarser.join(" and ")),
            true => format!("{} mm", coarser.join(" and ")),
        };
        let of_thigh = |(label, _): &(&str, String)| match *label {
            "Trial" | "Thigh" | "Steps" => true,
            "Inset of the muscles" => self.deformable && self.inset > 0.0,
            "Activations" => self.deformable && self.controller.is_some(),
            "Muscles in grids" => self.deformable && in_grids.is_some(),
            "Coarser meshes first" => self.deformable && (self.nested_from.is_some() || is_led),
            _ => self.deformable,
        };
        [
            ("Trial", trial.map_or("built-in walker".into(), |t| t.to_string_lossy().into_owned())),
            ("Thigh", thigh),
            ("Activations", activations),
            ("Resolution", format!("{} mm", short(self.resolution * 1e3))),
            (
                "Inset of the muscles",
                format!("by up to {} mm, a third of thickness and width left", short(self.inset * 1e3)),
            ),
            ("Coarser meshes first", coarser),
            ("Muscles in grids", in_grids.clone().unwrap_or_default()),
            (
                "Residual",
                format!(
                    "{} N without contact, {} N with",
                    short(self.residuals.without),
                    short(self.residuals.with)
                ),
            ),
            ("Mesh free of stress", stress_free.into()),
            ("Fibres", format!("{fibres}{apart}")),
            ("Shells", if self.shells { "around every muscle" } else { "none" }.into()),
            ("Contact", format!("{contact}{distance}")),
            ("Steps", steps.join(", ")),
        ]
        .into_iter()
        .filter(of_thigh)
        .map(|(label, value)| (label.to_string(), value))
        .chain(materials)
        .collect()
    }

    /// What is simulated, a sentence each, and what is left out and why. `asked`: which configurations.
    pub fn effects(
        &self,
        thigh: &Thigh,
        asked: PerConfiguration<bool>,
    ) -> (Vec<String>, Vec<(String, String)>) {
        let all = lines_of_muscles();
        let lines: usize = all.values().map(Vec::len).sum();
        let mut simulated = vec![
            "Rigid leg: posture under joint constraints, inverse dynamics, force sharing over 43 muscle lines, joint contact and ligaments, Hill activations.".to_string(),
        ];
        let mut left_out: Vec<(String, String)> = Vec::new();
        let mut leave = |what: &str, why: &str| left_out.push((what.to_string(), why.to_string()));
        if !self.deformable {
            leave("the deformable thigh", "the scene names no muscles: the rigid leg alone");
            return (simulated, left_out);
        }
        let n = thigh.muscles.len();
        simulated.push(format!(
            "{n} muscles as hexahedra of mean dilatation, Mooney-Rivlin matrix, stiffer towards the ends; tied to bone where they grow from it."
        ));
        if let Some(which) = self.fidelity.in_words() {
            simulated.push(format!(
                "Of these in coarse grids of cubes, whose corners move them: {which}; their matrix softened until each alone resists as its mesh does."
            ));
        }
        simulated.push("Bones as rigid bodies that follow the rigid leg.".into());
        let fans = thigh.scene.strands.iter().filter(|s| is_strands(&s.region)).count();
        if fans > 0 {
            simulated.push(format!("{fans} tendons as strands from the end of a muscle to its insertion."));
        }
        if !thigh.tendons.is_empty() {
            simulated.push(format!(
                "Quadriceps tendon as a solid of {} heads sewn together at their edges, with fibres; patellar ligament as three strands.",
                thigh.tendons.len()
            ));
        }
        match self.fibres {
            Fibres::Hill => simulated.push("Fibres along the muscles with the active and passive force-length relation of the Hill model.".into()),
            Fibres::Thermal => simulated.push("Thermal fibres along the muscles: calibrated on each muscle alone, contraction from the wanted force.".into()),
            Fibres::None => leave("fibres and activation", "the scene has `fibres = \"none\"`: passive tissue"),
        }
        if let Some(unit) = &self.controller {
            let unit = unit.file_name().unwrap_or_default().to_string_lossy();
            simulated.push(format!(
                "Activations as the unit {unit} says them, in place of the static optimization's."
            ));
        }
        match self.shells {
            true => simulated.push("Shells around the muscles (aponeuroses).".into()),
            false => leave("shells (aponeuroses)", "the scene has `shells = false`"),
        }
        match (self.contact, asked.with) {
            (Some(ContactMode::Guarded), true) => simulated.push(
                "Frictionless contact between all muscles and bones, guarded: nothing passes through.".into(),
            ),
            (Some(ContactMode::Cheap), true) => simulated.push(
                "Frictionless contact between all muscles and bones by a penalty on the penetration.".into(),
            ),
            (Some(_), false) => leave("contact", "not asked for in this run"),
            (None, _) => leave("contact", "the scene has `contact = \"none\"`: every muscle is solved alone"),
        }
        let (lines_alone, unnamed): (Vec<&String>, Vec<&String>) = all
            .keys()
            .filter(|name| thigh.muscles.iter().all(|m| m.name != **name))
            .partition(|name| self.fidelity.lines.contains(*name));
        for (names, why) in
            [(lines_alone, "lines of the rigid leg alone"), (unnamed, "the scene does not name them")]
        {
            let said: Vec<String> = names.iter().map(|name| name.replace('_', " ")).collect();
            if !said.is_empty() {
                leave(
                    &format!("{} muscles of the thigh", said.len()),
                    &format!("{why}: {}", said.join(", ")),
                );
            }
        }
        leave(
            &format!("the other {} lines of the rigid leg", 43 - lines),
            "the thigh has no mesh of them, tensor fasciae latae among them",
        );
        leave("inertia", "the steps are solved as equilibria");
        leave(
            "gravity on the muscles",
            "the forces compared carry the limb; those of a muscle's weight are a few newtons",
        );
        leave("friction, fat, fascia lata and skin", "not modelled");
        (simulated, left_out)
    }
}
