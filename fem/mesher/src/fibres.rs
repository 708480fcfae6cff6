//! Fibres of a muscle: the chains of edges from origin to insertion, as many at the ends as in the belly.

use super::MuscleBlock;

/// The fibres of one muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Fibres {
    /// Two nodes of the block per segment, fibre by fibre from origin to insertion.
    pub segments: Vec<[u32; 2]>,
    /// Cross-section of every segment \[m²\], the same along a fibre so that it carries one force.
    pub area: Vec<f64>,
}

/// One fibre per node of a section. Its fraction of the section is the mean over the layers of the fraction of the cells around
/// its node, a quarter of each. All fractions make `section` \[m²\], e.g. the [`mean_section`] or a physiological cross-section.
pub fn fibres(block: &MuscleBlock, section: f64) -> Fibres {
    let n = block.nodes_per_section;
    let layers = block.n_layers();
    let mut fraction = vec![0.0; n];
    for layer in 0..layers {
        let mut quarter = vec![0.0; n];
        for cell in &block.section_cells {
            let p = cell.map(|k| block.point(layer, k));
            let area = (p[2] - p[0]).cross(&(p[3] - p[1])).norm() / 2.0;
            cell.iter().for_each(|&k| quarter[k as usize] += area / 4.0);
        }
        let total: f64 = quarter.iter().sum();
        fraction.iter_mut().zip(quarter).for_each(|(s, q)| *s += q / (total * layers as f64));
    }
    let mut out = Fibres { segments: Vec::new(), area: Vec::new() };
    for k in 0..n as u32 {
        for layer in 0..layers - 1 {
            out.segments.push([block.node(layer, k), block.node(layer + 1, k)]);
            out.area.push(fraction[k as usize] * section);
        }
    }
    out
}

/// Mean section of a muscle \[m²\]: volume over length.
pub fn mean_section(block: &MuscleBlock) -> f64 {
    let line = block.centre_line();
    block.volume() / line.windows(2).map(|p| (p[1] - p[0]).norm()).sum::<f64>()
}

/// How many times stiffer than muscle each cell is: tendon-like towards thin ends and in the end layers.
///
/// The end layer is `end` times stiffer, fading geometrically to 1 over `layers` layers; elsewhere (mean section over
/// section)^1.5, at most `end`, where the muscle is thinner than its mean. Both were found necessary for thin ends to
/// carry what the belly pulls.
pub fn end_stiffness(block: &MuscleBlock, end: f64, layers: usize) -> Vec<f64> {
    let n = block.n_layers() - 1;
    let areas: Vec<f64> = (0..n).map(|l| (block.area(l) + block.area(l + 1)) / 2.0).collect();
    let line = block.centre_line();
    let steps: Vec<f64> = line.windows(2).map(|p| (p[1] - p[0]).norm()).collect();
    let mean = areas.iter().zip(&steps).map(|(a, h)| a * h).sum::<f64>() / steps.iter().sum::<f64>();
    (0..n)
        .flat_map(|l| {
            let from_end = l.min(n - 1 - l);
            let fading = end.powf(1.0 - (from_end as f64 / layers as f64).min(1.0));
            let thin = (mean / areas[l]).powf(1.5).clamp(1.0, end);
            std::iter::repeat_n(fading.max(thin), block.section_cells.len())
        })
        .collect()
}

/// How far along its fibre every node of the block lies: 0 at the origin, 1 at the insertion.
pub fn fraction_of_length(block: &MuscleBlock) -> Vec<f64> {
    let mut fraction = vec![0.0; block.points.len()];
    for k in 0..block.nodes_per_section as u32 {
        let mut length = 0.0;
        for layer in 1..block.n_layers() {
            length += (block.point(layer, k) - block.point(layer - 1, k)).norm();
            fraction[block.node(layer, k) as usize] = length;
        }
        (1..block.n_layers()).for_each(|layer| fraction[block.node(layer, k) as usize] /= length);
    }
    fraction
}
