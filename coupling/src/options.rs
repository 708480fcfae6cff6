//! Options of `optimize` by name, as its command line has them: what a study and Python set.

use multibody::error::unknown;
use multibody::keys::Kind::{Flag, Number, Word};
use multibody::keys::Need::{Default as Is, Optional};
use multibody::keys::{Key, key};
use multibody::model::{Ankle, KneeKind};
use multibody::muscle::curves::{Curves, DeGroote2016};
use multibody::muscle::hill::Tendon;
use multibody::sharing::{MuscleCost, ReactionCost};
use multibody::trial_file::HipRule;
use toml::Value;

use crate::changes::number;
use crate::form::{Bounds, Form, Passive};
use crate::optimize::OptimizeOptions;

/// Options of `optimize`, as its command line names them.
#[rustfmt::skip]
pub const OPTIONS: &[Key] = &[
    key("form", Word(&["revised", "published"]), Is("\"revised\""), "", "The rigid leg: with what goes beyond the publication, or as published; runs of `compare` go by the published one", "\"published\""),
    key("knee", Word(&["natural", "implant"]), Optional("that of the trial"), "", "Kind of knee", "\"implant\""),
    key("passive", Word(&["none", "joints", "muscles", "both"]), Optional("that of the form"), "", "Passive forces that sharing knows: moments of the joints, tensions of resting muscles, or both", "\"joints\""),
    key("bounds", Word(&["strength", "state"]), Optional("that of the form"), "", "What bounds muscle forces: the maximal isometric force, or the force at full activation at the length and velocity of the moment", "\"strength\""),
    key("cost", Word(&["force", "activation", "volume"]), Optional("that of the form: volume, or force as published"), "", "What muscle forces cost: their squares, squared activations, or those weighted by volume", "\"activation\""),
    key("joint_weights", Word(&["table", "none"]), Optional("those of the form: none, or the table as published"), "", "What joint forces cost: the published weights, or nothing", "\"table\""),
    key("unbounded", Flag, Is("false"), "", "No upper bounds on muscle forces", "true"),
    key("reserves", Number(f64::MIN_POSITIVE, f64::MAX), Optional("no reserve moments"), "1/(N·m)²", "Weight of squared reserve moments on every joint coordinate", "0.01"),
    key("raise_bounds", Number(1.0, f64::MAX), Optional("strengths stay"), "", "Where a frame is infeasible, raise all strengths by up to this factor", "1.5"),
    key("curves", Word(&["thelen", "degroote"]), Is("\"thelen\""), "", "Muscle curves for activations", "\"degroote\""),
    key("tendon", Word(&["elastic", "rigid"]), Is("\"elastic\""), "", "Tendons for activations", "\"rigid\""),
    key("ankle", Word(&["universal", "parallel"]), Optional("that of the trial"), "", "Joint between shank and foot", "\"parallel\""),
    key("hip_centre", Word(&["table", "regression", "harrington"]), Optional("that of the trial"), "", "Rule for the hip centre", "\"harrington\""),
];

/// The option that others change single parts of: it is set before them.
pub const FORM: &str = "form";

impl OptimizeOptions {
    /// What the command line and Python begin with: the revised leg and its costs.
    pub fn revised() -> OptimizeOptions {
        let mut options = OptimizeOptions::default();
        options.take_form(Form::REVISED);
        options
    }

    /// Takes a form of the leg, with what it says that forces cost.
    fn take_form(&mut self, form: Form) {
        self.form = form;
        (self.sharing.muscle_cost, self.sharing.reaction_cost) = (form.muscle_cost, form.reaction_cost);
    }
}

/// Sets an option by name, the [`FORM`] before all others; an error says what it takes.
pub fn set_option(options: &mut OptimizeOptions, name: &str, value: &Value) -> Result<(), String> {
    let Some(known) = OPTIONS.iter().find(|k| k.path == name) else {
        return Err(unknown(name, "options of optimize are", OPTIONS.iter().map(|k| k.path)));
    };
    let takes = || format!("give {} ({})", known.kind.words(known.unit), known.meaning);
    let word = value.as_str().unwrap_or("");
    let number = number(value);
    let sharing = &mut options.sharing;
    match (name, word) {
        (FORM, "revised") => options.take_form(Form::REVISED),
        (FORM, "published") => options.take_form(Form::PUBLISHED),
        ("knee", "natural") => options.form.knee = Some(KneeKind::Natural),
        ("knee", "implant") => options.form.knee = Some(KneeKind::Implant),
        ("passive", "none") => options.form.passive = Passive::None,
        ("passive", "joints") => options.form.passive = Passive::Joints,
        ("passive", "muscles") => options.form.passive = Passive::Muscles,
        ("passive", "both") => options.form.passive = Passive::Both,
        ("bounds", "strength") => options.form.bounds = Bounds::Strength,
        ("bounds", "state") => options.form.bounds = Bounds::State,
        ("cost", "force") => sharing.muscle_cost = MuscleCost::Force,
        ("cost", "activation") => sharing.muscle_cost = MuscleCost::Activation,
        ("cost", "volume") => sharing.muscle_cost = MuscleCost::Volume,
        ("joint_weights", "table") => sharing.reaction_cost = ReactionCost::Table,
        ("joint_weights", "none") => sharing.reaction_cost = ReactionCost::None,
        ("unbounded", _) => sharing.bounded = !value.as_bool().ok_or_else(takes)?,
        ("reserves" | "raise_bounds", _) => {
            let Number(least, _) = known.kind else { unreachable!("a number in the table") };
            let number = number.filter(|v| v.is_finite() && *v >= least).ok_or_else(takes)?;
            match name {
                "reserves" => sharing.reserves = Some(number),
                _ => sharing.options.raise_bounds = Some(number),
            }
        }
        ("curves", "thelen") => options.hill.curves = Curves::default(),
        ("curves", "degroote") => options.hill.curves = Curves::DeGroote(DeGroote2016::OPENSIM),
        ("tendon", "elastic") => options.hill.tendon = Tendon::Elastic,
        ("tendon", "rigid") => options.hill.tendon = Tendon::Rigid,
        ("ankle", "universal") => options.ankle = Some(Ankle::Universal),
        ("ankle", "parallel") => options.ankle = Some(Ankle::Parallel),
        ("hip_centre", "table") => options.hip_centre = Some(HipRule::Table),
        ("hip_centre", "regression") => options.hip_centre = Some(HipRule::Regression),
        ("hip_centre", "harrington") => options.hip_centre = Some(HipRule::Harrington),
        _ => return Err(takes()),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use toml::Table;

    use super::*;

    #[test]
    fn every_option_is_set_and_what_it_does_not_take_is_refused() {
        for option in OPTIONS {
            let begin = OptimizeOptions::revised;
            let mut options = begin();
            let example: Table = toml::from_str(&format!("v = {}", option.example)).unwrap();
            set_option(&mut options, option.path, &example["v"]).unwrap();
            assert_ne!(format!("{options:?}"), format!("{:?}", begin()), "{}", option.path);
            let refused = set_option(&mut options, option.path, &Value::Array(Vec::new())).unwrap_err();
            assert!(refused.contains(option.meaning), "{refused}");
        }
        let said = set_option(&mut OptimizeOptions::default(), "tendons", &Value::from(1)).unwrap_err();
        assert!(said.contains("did you mean `tendon`"), "{said}");
    }
}
