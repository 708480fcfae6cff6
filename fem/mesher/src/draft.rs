//! The cells of a mesh before it is made: enough to count what it will cost.

use rayon::prelude::*;

use super::grid::{self, SectionKind};
use super::{Loft, MuscleBlock, MuscleSections, mesh_end};

/// The meshes that [`build`](super::build) begins with: the same layers, and the same cells in them unless `build` finds that a plain grid
/// fits a muscle better than rings. Cells are neither smoothed nor kept apart, and some are folded.
pub fn draft(sections: &[MuscleSections], edge: f64) -> Vec<MuscleBlock> {
    let muscle = |muscle: &MuscleSections| {
        let layers = grid::layers(muscle, edge, mesh_end(muscle));
        grid::fill(&muscle.name, &Loft::new(muscle), &SectionKind::rings(muscle, edge).grid(), layers)
    };
    sections.par_iter().map(muscle).collect()
}
