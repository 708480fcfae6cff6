//! M1: the built-in thigh at the edge of the finest setting of `cost`.

use crate::{Case, Outcome, Tier};

pub const CASES: &[Case] =
    &[Case { id: "M1", title: "the thigh at 6 mm reaches its goals", tier: Tier::Full, run: goals }];

/// Edge \[m\].
const EDGE: f64 = 6e-3;
/// Hexahedra between which they are.
const CELLS: std::ops::Range<usize> = 30_000..40_000;

fn goals() -> Outcome {
    let limb = coupling::thigh::limb().map_err(|e| e.to_string())?;
    let built = mesher::build(&limb.sections, &limb.bones, EDGE);
    let n: usize = built.muscles.iter().map(|m| m.block.n_cells()).sum();
    let missed = built.missed(&limb.bones);
    match missed.is_empty() && CELLS.contains(&n) {
        true => Ok(format!("{n} hexahedra in {} muscles, {} rounds", built.muscles.len(), built.rounds)),
        false => Err(format!("{n} hexahedra, wanted {CELLS:?}; {}", missed.join("; "))),
    }
}
