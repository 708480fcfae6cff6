//! Layers of quadrilaterals that fill the sections of a muscle: which cells, and where they start.

use nalgebra::Vector3;

use super::{CORNERS, Loft, MuscleBlock, MuscleSections, N_OUTLINE};

/// How a cross-section is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SectionKind {
    /// A core of `across` × `through` cells inside `rings` rings that follow the outline.
    Rings {
        /// Cells of the core along the broad sides.
        across: usize,
        /// Cells of the core through the thickness.
        through: usize,
        /// Rings around the core.
        rings: usize,
    },
    /// A plain grid of `across` × `through` cells with its corners on the outline.
    Plain {
        /// Cells along the broad sides.
        across: usize,
        /// Cells through the thickness.
        through: usize,
    },
}

/// Mesh of a cross-section in the unit square: ξ along the broad sides from end A to end B, η from side 1 to side 2.
#[derive(Clone, Debug, PartialEq)]
pub struct SectionGrid {
    /// Nodes as (ξ, η); those of the outline carry only their place on it.
    pub nodes: Vec<[f64; 2]>,
    /// Quadrilaterals, counter-clockwise.
    pub cells: Vec<[u32; 4]>,
    /// Boundary nodes, counter-clockwise.
    pub outline: Vec<u32>,
    /// Outline parameter 0..14 of each boundary node.
    pub outline_parameter: Vec<f64>,
    /// Nodes of the rings: node, the node of the core it belongs to, its outline parameter, and how far out it lies (0..1).
    ring: Vec<(u32, u32, f64, f64)>,
}

/// Least cells of the core, so that a section keeps its shape at any resolution.
const LEAST_CORE: [usize; 2] = [8, 2];
/// Least cells of a plain grid.
const LEAST_PLAIN: [usize; 2] = [10, 3];
/// Least layers of cells along a muscle.
const LEAST_LAYERS: usize = 12;

/// Width and thickness of the sections, averaged with weights that favour the wide and the thick, and length of the line through
/// their centres \[m\].
pub fn mean_size(sections: &MuscleSections) -> [f64; 3] {
    let stations = &sections.stations;
    let size = |i: usize| {
        let p = &stations[i].outline;
        let side = |from: usize, to: usize| {
            (from..to).map(|k| (p[k % N_OUTLINE] - p[(k + 1) % N_OUTLINE]).norm()).sum::<f64>()
        };
        let width = (side(0, 5) + side(7, 12)) / 2.0;
        [width, stations[i].polygon_area() / width]
    };
    let (mut mean, mut square, mut length) = ([0.0; 2], [0.0; 2], 0.0);
    for i in 1..stations.len() {
        let ds = stations[i].s - stations[i - 1].s;
        let (a, b) = (size(i - 1), size(i));
        for d in 0..2 {
            mean[d] += ds * (a[d] + b[d]) / 2.0;
            square[d] += ds * (a[d] * a[d] + b[d] * b[d]) / 2.0;
        }
        length += (stations[i].centre - stations[i - 1].centre).norm();
    }
    [square[0] / mean[0], square[1] / mean[1], length]
}

impl SectionKind {
    /// Rings for a target edge length \[m\].
    pub fn rings(sections: &MuscleSections, edge: f64) -> SectionKind {
        let [width, thickness, _] = mean_size(sections);
        let rings = ((thickness / (4.0 * edge)).round() as usize).max(1);
        let core =
            |size: f64, least: usize| ((size / edge).round() as usize).saturating_sub(2 * rings).max(least);
        SectionKind::Rings {
            across: core(width, LEAST_CORE[0]),
            through: core(thickness, LEAST_CORE[1]),
            rings,
        }
    }

    /// A plain grid for a target edge length \[m\].
    pub fn plain(sections: &MuscleSections, edge: f64) -> SectionKind {
        let [width, thickness, _] = mean_size(sections);
        let cells = |size: f64, least: usize| ((size / edge).round() as usize).max(least);
        SectionKind::Plain { across: cells(width, LEAST_PLAIN[0]), through: cells(thickness, LEAST_PLAIN[1]) }
    }

    /// Cells of the core across and through, and rings.
    fn divisions(self) -> [usize; 3] {
        match self {
            SectionKind::Plain { across, through } => [across, through, 0],
            SectionKind::Rings { across, through, rings } => [across, through, rings],
        }
    }

    /// The grid of this kind.
    pub fn grid(self) -> SectionGrid {
        match self {
            SectionKind::Plain { across, through } => core(across, through, 0),
            SectionKind::Rings { across, through, rings } => with_rings(across, through, rings),
        }
    }
}

/// A grid of `n` × `m` cells whose outermost nodes stand `inset` cells inside the unit square.
fn core(n: usize, m: usize, inset: usize) -> SectionGrid {
    let node = |i: usize, j: usize| (i + (n + 1) * j) as u32;
    let fraction = |i: usize, n: usize| (i + inset) as f64 / (n + 2 * inset) as f64;
    let nodes = (0..=m).flat_map(|j| (0..=n).map(move |i| [fraction(i, n), fraction(j, m)])).collect();
    let cells = (0..m)
        .flat_map(|j| (0..n).map(move |i| [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)]))
        .collect();
    let mut outline = Vec::new();
    let mut outline_parameter = Vec::new();
    let mut push = |node: u32, corner: usize, i: usize, n: usize| {
        let end = if corner == 3 { N_OUTLINE as f64 } else { CORNERS[corner + 1] };
        outline.push(node);
        outline_parameter.push(CORNERS[corner] + (end - CORNERS[corner]) * i as f64 / n as f64);
    };
    (0..n).for_each(|i| push(node(i, 0), 0, i, n));
    (0..m).for_each(|j| push(node(n, j), 1, j, m));
    (0..n).for_each(|i| push(node(n - i, m), 2, i, n));
    (0..m).for_each(|j| push(node(0, m - j), 3, j, m));
    SectionGrid { nodes, cells, outline, outline_parameter, ring: Vec::new() }
}

fn with_rings(n: usize, m: usize, rings: usize) -> SectionGrid {
    let mut grid = core(n, m, rings);
    let around = grid.outline.len();
    let rim = grid.outline.clone();
    let mut inner = grid.outline.clone();
    for ring in 1..=rings {
        let first = grid.nodes.len() as u32;
        let out = ring as f64 / rings as f64;
        for k in 0..around {
            grid.nodes.push([f64::NAN; 2]); // has no place in the square: lies between core and outline
            grid.ring.push((first + k as u32, rim[k], grid.outline_parameter[k], out));
        }
        for k in 0..around {
            let next = (k + 1) % around;
            grid.cells.push([inner[k], first + k as u32, first + next as u32, inner[next]]);
        }
        inner = (0..around).map(|k| first + k as u32).collect();
    }
    grid.outline = inner;
    grid
}

/// Fractions of the line, from 0 to `s_end`, of layers about `edge` \[m\] apart.
pub fn layers(sections: &MuscleSections, edge: f64, s_end: f64) -> Vec<f64> {
    let length = mean_size(sections)[2] * s_end;
    let n = ((length / edge).round() as usize).max(LEAST_LAYERS);
    (0..=n).map(|i| s_end * i as f64 / n as f64).collect()
}

/// The loft filled with a grid per layer: transfinite interpolation between the four sides of the outline (Gordon & Hall 1973),
/// rings on straight lines from the core to the outline.
pub fn fill(name: &str, loft: &Loft, grid: &SectionGrid, s: Vec<f64>) -> MuscleBlock {
    let mut points = Vec::with_capacity(grid.nodes.len() * s.len());
    for &s in &s {
        let at = |t: f64| loft.point(t, s).position;
        let first = points.len();
        let corner = CORNERS.map(at);
        for &[xi, eta] in &grid.nodes {
            if xi.is_nan() {
                points.push(Vector3::zeros());
                continue;
            }
            let (side_1, side_2) = (at(5.0 * xi), at(12.0 - 5.0 * xi));
            let (end_a, end_b) = (at(14.0 - 2.0 * eta), at(5.0 + 2.0 * eta));
            let bilinear = (corner[0] * (1.0 - eta) + corner[3] * eta) * (1.0 - xi)
                + (corner[1] * (1.0 - eta) + corner[2] * eta) * xi;
            points.push(side_1 * (1.0 - eta) + side_2 * eta + end_a * (1.0 - xi) + end_b * xi - bilinear);
        }
        for &(node, rim, t, out) in &grid.ring {
            points[first + node as usize] = points[first + rim as usize] * (1.0 - out) + at(t) * out;
        }
    }
    MuscleBlock {
        name: name.into(),
        points: points.into_iter().map(Into::into).collect(),
        nodes_per_section: grid.nodes.len(),
        section_cells: grid.cells.clone(),
        outline: grid.outline.clone(),
        outline_parameter: grid.outline_parameter.clone(),
        s,
    }
}

/// Where a place of a finer grid lies in a coarser one of the same kind: outline nodes by their number.
#[derive(Clone, Copy, Debug)]
pub struct Coarser {
    /// Divisions of the coarse grid: core across, core through, rings.
    from: [usize; 3],
    /// Of the fine grid.
    to: [usize; 3],
}

impl Coarser {
    /// From the coarse kind to the fine one; `None` for different kinds.
    pub fn new(from: SectionKind, to: SectionKind) -> Option<Coarser> {
        let same = matches!(from, SectionKind::Plain { .. }) == matches!(to, SectionKind::Plain { .. });
        same.then(|| Coarser { from: from.divisions(), to: to.divisions() })
    }

    /// Place on the coarse outline, counted in its nodes, of place `k` on the fine one.
    pub fn outline(&self, k: f64) -> f64 {
        let ([n, m, _], [fine_n, fine_m, _]) = (self.from, self.to);
        let sides = [(n, fine_n), (m, fine_m), (n, fine_n), (m, fine_m)];
        let (mut start, mut fine_start) = (0.0, 0.0);
        for (coarse, fine) in sides.map(|(a, b)| (a as f64, b as f64)) {
            if k < fine_start + fine {
                return start + (k - fine_start) / fine * coarse;
            }
            (start, fine_start) = (start + coarse, fine_start + fine);
        }
        start
    }

    /// Node positions of the fine mesh by linear interpolation in the coarse one \[m\]; `n_layers` of the fine mesh.
    pub fn points(&self, coarse: &MuscleBlock, n_layers: usize) -> Vec<[f64; 3]> {
        let ([n, m, rings], [fine_n, fine_m, fine_rings]) = (self.from, self.to);
        let around = 2 * (n + m);
        let rim = core(n, m, 0).outline;
        let in_layer = |layer: usize| {
            let core_at = |u: f64, v: f64| {
                let ((i, a), (j, b)) = (cell(u * n as f64, n), cell(v * m as f64, m));
                let p = |i: usize, j: usize| coarse.point(layer, (i + (n + 1) * j) as u32);
                (p(i, j) * (1.0 - a) + p(i + 1, j) * a) * (1.0 - b)
                    + (p(i, j + 1) * (1.0 - a) + p(i + 1, j + 1) * a) * b
            };
            let ring_at = |k: f64, level: f64| {
                let ((i, a), (l, b)) = ((k.floor() as usize, k - k.floor()), cell(level, rings));
                let p = |k: usize, l: usize| {
                    let k = k % around;
                    let node =
                        if l == 0 { rim[k] } else { ((n + 1) * (m + 1) + (l - 1) * around + k) as u32 };
                    coarse.point(layer, node)
                };
                (p(i, l) * (1.0 - a) + p(i + 1, l) * a) * (1.0 - b)
                    + (p(i, l + 1) * (1.0 - a) + p(i + 1, l + 1) * a) * b
            };
            let mut points = Vec::new();
            for j in 0..=fine_m {
                for i in 0..=fine_n {
                    points.push(core_at(i as f64 / fine_n as f64, j as f64 / fine_m as f64));
                }
            }
            for ring in 1..=fine_rings {
                let level = (ring * rings) as f64 / fine_rings as f64;
                points.extend((0..2 * (fine_n + fine_m)).map(|k| ring_at(self.outline(k as f64), level)));
            }
            points
        };
        let layers: Vec<Vec<Vector3<f64>>> = (0..coarse.n_layers()).map(in_layer).collect();
        let last = coarse.n_layers() - 1;
        let mut points = Vec::new();
        for fine in 0..n_layers {
            let (layer, f) = cell((fine * last) as f64 / (n_layers - 1) as f64, last);
            let between = layers[layer].iter().zip(&layers[layer + 1]);
            points.extend(between.map(|(a, b)| <[f64; 3]>::from(a * (1.0 - f) + b * f)));
        }
        points
    }
}

/// Number of the cell of 0..n that holds `x`, and where in it.
fn cell(x: f64, n: usize) -> (usize, f64) {
    let i = (x.floor() as usize).min(n - 1);
    (i, x - i as f64)
}
