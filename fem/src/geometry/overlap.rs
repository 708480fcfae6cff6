//! Volume that two closed surfaces share.

use rayon::prelude::*;
use robust::orient2d;

use super::intersect::flat;
use super::query::SearchSurface;
use super::tree::Aabb;
use super::{Surface, SurfaceError};

/// Volume common to two closed surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// The volume \[m³\].
    pub volume: f64,
    /// Half the difference of the volumes from every other line \[m³\]: how far off the volume may be.
    pub uncertainty: f64,
    /// Longest piece of a line that lies in both \[m\].
    pub longest: f64,
}

/// The volume inside both surfaces, from parallel lines `spacing` \[m\] apart along z: exact along the lines, midpoint rule
/// across.
///
/// A line enters and leaves a closed surface equally often, exactly: a line through an edge or point of the projected
/// triangles counts as shifted by an infinitely small amount.
pub fn overlap(a: &SearchSurface, b: &SearchSurface, spacing: f64) -> Result<Overlap, SurfaceError> {
    a.surface().check_borders()?;
    b.surface().check_borders()?;
    assert!(spacing > 0.0, "the spacing of lines must be positive");
    let (low_a, high_a) = a.surface().bounds();
    let (low_b, high_b) = b.surface().bounds();
    let (low, high) = (low_a.sup(&low_b), high_a.inf(&high_b));
    if !(low.x < high.x && low.y < high.y && low.z < high.z) {
        return Ok(Overlap { volume: 0.0, uncertainty: 0.0, longest: 0.0 });
    }
    // Whole cells over the common box, at least eight each way.
    let cells = |k: usize| ((high[k] - low[k]) / spacing).ceil().max(8.0);
    let (nx, ny) = (cells(0), cells(1));
    let (dx, dy) = ((high.x - low.x) / nx, (high.y - low.y) / ny);
    let columns: Vec<[f64; 3]> = (0..nx as u64)
        .into_par_iter()
        .map(|i| {
            let x = low.x + (i as f64 + 0.5) * dx;
            let mut sums = [0.0f64; 3]; // even lines, odd lines, longest
            for j in 0..ny as u64 {
                let y = low.y + (j as f64 + 0.5) * dy;
                let inside_b = crossings(b, x, y);
                if inside_b.is_empty() {
                    continue;
                }
                for [from, to] in common(&crossings(a, x, y), &inside_b) {
                    sums[((i + j) % 2) as usize] += to - from;
                    sums[2] = sums[2].max(to - from);
                }
            }
            sums
        })
        .collect();
    let sum = |k: usize| columns.iter().map(|c| c[k]).sum::<f64>() * dx * dy;
    Ok(Overlap {
        volume: sum(0) + sum(1),
        uncertainty: (sum(0) - sum(1)).abs() / 2.0,
        longest: columns.iter().map(|c| c[2]).fold(0.0, f64::max),
    })
}

/// Heights z at which the vertical line through (x, y) enters and leaves the surface, in pairs \[m\].
fn crossings(search: &SearchSurface, x: f64, y: f64) -> Vec<[f64; 2]> {
    let surface: &Surface = search.surface();
    let whole = search.tree.whole();
    let line =
        Aabb { lo: nalgebra::Vector3::new(x, y, whole.lo.z), hi: nalgebra::Vector3::new(x, y, whole.hi.z) };
    let mut heights: Vec<f64> = Vec::new();
    search.tree.overlapping(&line, |t| {
        let corners = surface.corners(t as usize);
        let p = robust::Coord { x, y };
        let [a, b, c] = [&corners[0], &corners[1], &corners[2]].map(|v| flat(v, 2));
        let turns = [(a, b), (b, c), (c, a)].map(|(u, v)| passes(u, v, p));
        if turns[0] == turns[1] && turns[1] == turns[2] && orient2d(a, b, c) != 0.0 {
            let n = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let z = corners[0].z - (n.x * (x - corners[0].x) + n.y * (y - corners[0].y)) / n.z;
            let [low, high] = [f64::min, f64::max].map(|f| f(f(corners[0].z, corners[1].z), corners[2].z));
            heights.push(z.clamp(low, high)); // a steep triangle's plane is ill defined, its corners are not
        }
    });
    heights.sort_unstable_by(f64::total_cmp);
    debug_assert!(heights.len().is_multiple_of(2), "a line crosses a closed surface an even number of times");
    heights.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect()
}

/// Is `p` left of the edge from `u` to `v`, when `p` is shifted by (ε, ε²)?
fn passes(u: robust::Coord<f64>, v: robust::Coord<f64>, p: robust::Coord<f64>) -> bool {
    let turn = orient2d(u, v, p);
    if turn != 0.0 {
        return turn > 0.0;
    }
    // The turn grows by ε (u.y - v.y) + ε² (v.x - u.x).
    if u.y != v.y { u.y > v.y } else { v.x > u.x }
}

/// Pieces that lie in both of two ascending lists of intervals.
fn common(a: &[[f64; 2]], b: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut pieces = Vec::new();
    for p in a {
        for q in b {
            let (from, to) = (p[0].max(q[0]), p[1].min(q[1]));
            if from < to {
                pieces.push([from, to]);
            }
        }
    }
    pieces
}
