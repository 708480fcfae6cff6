//! The surface of a smooth distance as triangles: to mesh around, to be drawn, and to ask whether something goes through.
//!
//! Marching tetrahedra: every cube of a grid is cut into six tetrahedra around its diagonal (Kuhn), which fit those of its neighbours, and a
//! tetrahedron is cut where the distance, linear along its edges, has the level. So the surface is closed and never branches.

use std::collections::BTreeMap;

use fem::geometry::{DistanceField, Surface};
use nalgebra::Vector3;

/// Corners of a cube by the bits of their number, x first; tetrahedra around the diagonal from 0 to 7, all of one orientation.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
/// Corners of the surface stay this part of an edge off its ends, so that no triangle shrinks to a point.
const OFF: f64 = 0.02;

/// The largest connected part of where a smooth distance is `level` \[m\], on a grid of this spacing \[m\], normals outward. It is closed where it
/// stays inside the bounds of the distance.
pub fn level(field: &DistanceField, level: f64, spacing: f64) -> Surface {
    let [lo, hi] = field.bounds();
    let n: [usize; 3] = std::array::from_fn(|c| ((hi[c] - lo[c]) / spacing) as usize);
    let place = |at: [usize; 3]| lo + spacing * Vector3::from(at.map(|k| k as f64));
    let number = |[i, j, k]: [usize; 3]| (i * n[1] + j) * n[2] + k;
    // What is not near the level is outside or inside whatever it is.
    let value = |at: [usize; 3]| {
        field.near(&place(at), level + 4.0 * spacing).map_or(spacing, |p| p.distance - level)
    };
    let mut values = vec![0.0; n[0] * n[1] * n[2]];
    use rayon::prelude::*;
    values.par_chunks_mut(n[1] * n[2]).enumerate().for_each(|(i, plane)| {
        for (e, v) in plane.iter_mut().enumerate() {
            *v = value([i, e / n[2], e % n[2]]);
        }
    });
    let mut surface = Surface::default();
    let mut corners = BTreeMap::<[usize; 2], u32>::new();
    for i in 0..n[0] - 1 {
        for j in 0..n[1] - 1 {
            for k in 0..n[2] - 1 {
                let cube: [[usize; 3]; 8] =
                    std::array::from_fn(|c| [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)]);
                let inside = cube.iter().filter(|at| values[number(**at)] < 0.0).count();
                if inside == 0 || inside == 8 {
                    continue;
                }
                for tetrahedron in TETRAHEDRA {
                    let at = tetrahedron.map(|c| cube[c]);
                    let mut between = |a: usize, b: usize| {
                        let [p, q] = [at[a], at[b]];
                        let (p, q) = if number(p) < number(q) { (p, q) } else { (q, p) };
                        *corners.entry([number(p), number(q)]).or_insert_with(|| {
                            let [u, v] = [p, q].map(|at| values[number(at)]);
                            let t = (u / (u - v)).clamp(OFF, 1.0 - OFF);
                            surface.points.push((place(p) * (1.0 - t) + place(q) * t).into());
                            surface.points.len() as u32 - 1
                        })
                    };
                    surface.triangles.extend(cut(at.map(|at| values[number(at)] < 0.0), &mut between));
                }
            }
        }
    }
    largest(&surface)
}

/// Triangles of a tetrahedron with these corners inside, outward; `between`: the corner of the surface on an edge.
fn cut(inside: [bool; 4], between: &mut impl FnMut(usize, usize) -> u32) -> Vec<[u32; 3]> {
    let of = |which: bool| (0..4).filter(move |c| inside[*c] == which).collect::<Vec<usize>>();
    let (own, others) = (of(true), of(false));
    // Whether the corners, those inside first, are an even permutation: then they are oriented as the tetrahedron is.
    let order: Vec<usize> = own.iter().chain(&others).copied().collect();
    let swaps =
        (0..4).flat_map(|a| (a + 1..4).map(move |b| (a, b))).filter(|&(a, b)| order[a] > order[b]).count();
    let turned = |t: [u32; 3]| if swaps % 2 == 0 { t } else { [t[0], t[2], t[1]] };
    match (own.as_slice(), others.as_slice()) {
        (&[a], &[b, c, d]) => vec![turned([between(a, b), between(a, c), between(a, d)])],
        (&[a, b, c], &[d]) => vec![turned([between(a, d), between(b, d), between(c, d)])],
        (&[a, b], &[c, d]) => {
            let [ac, ad, bc, bd] = [between(a, c), between(a, d), between(b, c), between(b, d)];
            vec![turned([ac, ad, bd]), turned([ac, bd, bc])]
        }
        _ => Vec::new(),
    }
}

/// The connected part of the greatest area, of several the first.
fn largest(surface: &Surface) -> Surface {
    let (of, n) = surface.components();
    let mut areas = vec![0.0; n];
    for t in 0..surface.triangles.len() {
        areas[of[t] as usize] += surface.area_vector(t).norm();
    }
    let Some(best) = (0..n).reduce(|a, b| if areas[b] > areas[a] { b } else { a }) else {
        return surface.clone();
    };
    let kept: Vec<u32> =
        (0..surface.triangles.len() as u32).filter(|t| of[*t as usize] as usize == best).collect();
    surface.subset(&kept).0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of 20 mm and, apart from it, one of 4 mm.
    fn balls() -> DistanceField {
        let (lo, hi) = (Vector3::new(-0.03, -0.03, -0.03), Vector3::new(0.05, 0.03, 0.03));
        let small = Vector3::new(0.035, 0.0, 0.0);
        DistanceField::new(lo, hi, 1e-3, |p| (p.norm() - 0.02).min((p - small).norm() - 0.004))
    }

    #[test]
    fn a_ball_is_closed_and_has_its_volume_and_the_small_one_is_left_out() {
        let surface = level(&balls(), 0.5e-3, 1.1e-3);
        assert!(surface.is_closed() && surface.components().1 == 1);
        // Smooth distances lie too deep by (h²/6) 2/r; chords cut off some h²/(8 r) more.
        let r = 0.0205 - 1e-6 / 6.0 * 2.0 / 0.02;
        let volume = 4.0 / 3.0 * std::f64::consts::PI * r * r * r;
        assert!((surface.volume() / volume - 1.0).abs() < 2e-3, "{} {volume}", surface.volume());
        for t in 0..surface.triangles.len() {
            let middle: Vector3<f64> = surface.corners(t).iter().sum::<Vector3<f64>>() / 3.0;
            assert!(surface.area_vector(t).dot(&middle) > 0.0, "triangle {t} looks inward");
        }
    }
}
