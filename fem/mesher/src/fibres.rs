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
/// `spacing` 1: every node has one. Above: fibres stand so many cells apart, and each has the fractions of the nodes that are nearest to it.
pub fn fibres(block: &MuscleBlock, section: f64, spacing: usize) -> Fibres {
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
    let nearest = nearest_fibre(&block.section_cells, n, spacing);
    for (k, &at) in nearest.iter().enumerate().filter(|&(k, &at)| k != at as usize) {
        fraction[at as usize] += std::mem::take(&mut fraction[k]);
    }
    for k in (0..n as u32).filter(|&k| nearest[k as usize] == k) {
        for layer in 0..layers - 1 {
            out.segments.push([block.node(layer, k), block.node(layer + 1, k)]);
            out.area.push(fraction[k as usize] * section);
        }
    }
    out
}

/// The node of a section at whose fibre every node of it is: itself, where it has one. Nodes get a fibre in their order where none is nearer than
/// `spacing` cells; the others go to the nearest, the first of those that are equally near.
fn nearest_fibre(cells: &[[u32; 4]], n_nodes: usize, spacing: usize) -> Vec<u32> {
    let mut beside = vec![Vec::new(); n_nodes];
    for cell in cells {
        for &k in cell {
            beside[k as usize].extend(cell.iter().copied().filter(|&other| other != k));
        }
    }
    let mut nearest: Vec<Option<(usize, u32)>> = vec![None; n_nodes];
    for fibre in 0..n_nodes as u32 {
        if nearest[fibre as usize].is_some_and(|(cells, _)| cells < spacing) {
            continue;
        }
        let mut front = vec![fibre];
        for cells in 0.. {
            front.retain(|&k| nearest[k as usize].is_none_or(|(before, _)| cells < before));
            front.sort_unstable();
            front.dedup();
            if front.is_empty() {
                break;
            }
            front.iter().for_each(|&k| nearest[k as usize] = Some((cells, fibre)));
            front = front.iter().flat_map(|&k| beside[k as usize].iter().copied()).collect();
        }
    }
    nearest.into_iter().map(|found| found.expect("sections are connected").1).collect()
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
