//! How closely the forces of a run balance: what was asked for, what was reached, and how much that is of the forces in play.

use std::fmt;

use serde::Serialize;

use coupling::comparison::compare::{KeptSides, Solution};
use coupling::configuration::Configuration;

/// Where the residual of a configuration is greatest, of all its solved frames and islands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settled {
    /// `without contact` or `with contact`.
    pub configuration: &'static str,
    /// Residual reached \[N\].
    #[serde(rename = "residual_N")]
    pub residual: f64,
    /// Residual asked for \[N\].
    #[serde(rename = "wanted_residual_N")]
    pub wanted: f64,
    /// Forces in play there \[N\].
    #[serde(rename = "forces_in_play_N")]
    pub forces: f64,
    /// Load steps that were cut short on their way and went on from looser equilibrium, all frames together.
    pub loose_load_steps: usize,
    /// Frames all of whose equilibria were tested and are minima of the potential.
    pub frames_tested_for_stability: usize,
    /// Whether everybody has stayed on its side; absent without contact.
    pub sides: Option<KeptSides>,
}

impl Settled {
    /// Of a run; `None` where no frame is solved, or nothing in it can move.
    pub fn new(configuration: Configuration, result: &Solution) -> Option<Settled> {
        let run = &result.run;
        let islands = || run.frames.iter().flat_map(|frame| &frame.islands);
        let worst = islands().max_by(|a, b| a.residual.total_cmp(&b.residual))?;
        Some(Settled {
            configuration: configuration.name(),
            residual: worst.residual,
            wanted: worst.wanted,
            forces: worst.force_scale,
            loose_load_steps: run.count(|island| island.loose_steps),
            frames_tested_for_stability: run.frames_tested_for_stability(),
            sides: result.sides.clone(),
        })
    }
}

impl fmt::Display for Settled {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Settled { configuration, residual, wanted, forces, loose_load_steps, sides, .. } = self;
        let percent = if *forces > 0.0 { 100.0 * residual / forces } else { 0.0 };
        write!(
            f,
            "{configuration}, forces balance to {residual:.2} N of {wanted:.2} N asked for, {percent:.2} % of the forces in play"
        )?;
        match loose_load_steps {
            0 => {}
            1 => write!(f, " (1 load step on the way to 5 % only)")?,
            n => write!(f, " ({n} load steps on the way to 5 % only)")?,
        }
        let Some(sides) = sides else { return Ok(()) };
        let KeptSides { pairs, guesses, wrong_guesses, crossed_pairs, prescribed_overlaps, standoff_mm } =
            sides;
        match crossed_pairs {
            0 => write!(f, "; none of {pairs} pairs has changed sides")?,
            n => write!(
                f,
                "; {n} of {pairs} pairs cross on the straight way from frame to frame, in no guess that was taken"
            )?,
        }
        if *wrong_guesses > 0 {
            let all = guesses + wrong_guesses;
            write!(f, "; {wrong_guesses} of {all} guesses led through a body and were thrown away")?;
        }
        for [a, b] in prescribed_overlaps {
            write!(f, "; {a} and {b} overlap where their places are prescribed")?;
        }
        write!(f, "; surfaces press {standoff_mm:.2} mm apart in the mean")
    }
}
