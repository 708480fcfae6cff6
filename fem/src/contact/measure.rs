//! What contact does: forces between surfaces, pressure, area, distance.

use super::Contact;
use super::stencil::Law;
use crate::body::Wrench;
use crate::geometry::{self, SearchSurface};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Contact of two surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct PairForce {
    /// The surfaces.
    pub names: [String; 2],
    /// Force \[N\] and moment \[N·m\] on the first; the second has the opposite.
    pub wrench: Wrench,
    /// Area \[m²\] on which they press: the mean of what presses of either, in the reference configuration.
    pub area: f64,
    /// Distance \[m\] at which they press, its mean weighted with the pressure: the layer between them takes so much room, and they press as
    /// if they were thicker by that. Of the cheap mode the mean penetration, negative.
    pub standoff: f64,
    /// Least distance \[m\]; negative the greatest penetration, of the cheap mode.
    pub least_distance: f64,
    /// Greatest pressure \[Pa\] at a collision point of either, per reference area.
    pub peak_pressure: f64,
}

impl Contact {
    /// Contact of every pair of surfaces that are within reach of each other, with the nodes at `x`; moments about `about` \[m\].
    pub fn pair_forces(&self, x: &[f64], about: [f64; 3]) -> Vec<PairForce> {
        let all = &self.surfaces;
        let terms = self.terms(x, 0.0);
        let (p, stencils) = (&terms.p, &terms.stencils);
        let mut pairs = BTreeMap::<[usize; 2], PairForce>::new();
        let mut pressures = BTreeMap::<(u32, usize), f64>::new();
        let mut pushes = BTreeMap::<[usize; 2], [f64; 2]>::new();
        for stencil in stencils {
            let points = stencil.points;
            let edges = stencil.edges > 0.0;
            let other = if edges { points[2] } else { points[1] };
            let (a, b) = (all.surface(points[0]), all.surface(other));
            let key = [a.min(b), a.max(b)];
            let pair = pairs.entry(key).or_insert_with(|| PairForce {
                names: key.map(|s| all.list[s].name.clone()),
                wrench: Wrench::default(),
                area: 0.0,
                standoff: 0.0,
                least_distance: f64::INFINITY,
                peak_pressure: 0.0,
            });
            let sign = if stencil.law == Law::Spring { -1.0 } else { 1.0 };
            pair.least_distance = pair.least_distance.min(sign * stencil.distance());
            let g = stencil.gradient(&points.map(|i| p[i as usize]));
            for i in (0..4).filter(|&i| all.surface(points[i]) == key[0]) {
                let arm = p[points[i] as usize] - Vector3::from(about);
                pair.wrench.add(arm.into(), (-g[i]).into());
            }
            if !edges {
                // Twice: each side bears half.
                let push =
                    -2.0 * sign * g[0].dot(&stencil.closest.w) / stencil.distance().max(f64::MIN_POSITIVE);
                *pressures.entry((points[0], b)).or_default() += push / all.areas[points[0] as usize];
                let [weight, sum] = pushes.entry(key).or_default();
                *weight += push;
                *sum += push * sign * stencil.distance();
            }
        }
        for ((point, other), pressure) in pressures {
            let mine = all.surface(point);
            let pair = pairs.get_mut(&[mine.min(other), mine.max(other)]).expect("it has a term");
            pair.peak_pressure = pair.peak_pressure.max(pressure);
            if pressure > 0.0 {
                pair.area += 0.5 * all.areas[point as usize];
            }
        }
        for (key, [weight, sum]) in pushes.into_iter().filter(|(_, [weight, _])| *weight > 0.0) {
            pairs.get_mut(&key).expect("it has a term").standoff = sum / weight;
        }
        pairs.into_values().collect()
    }

    /// Contact force per reference area \[Pa\] at the nodes of a surface, by local node, with the nodes at `x`; zero where
    /// nothing presses. The force is that of all that touches the surface.
    pub fn pressures(&self, surface: usize, x: &[f64]) -> Vec<(u32, [f64; 3])> {
        let mut g = vec![0.0; x.len()];
        self.add_gradient(x, 0.0, &mut g);
        let mut areas = BTreeMap::<u32, f64>::new();
        for p in self.surfaces.list[surface].samples.clone() {
            for (node, weight) in self.surfaces.points[p].weighted_nodes() {
                *areas.entry(node).or_default() += weight * self.surfaces.areas[p];
            }
        }
        let traction = |(node, area): (u32, f64)| {
            let i = 3 * node as usize;
            (node, std::array::from_fn(|c| -g[i + c] / area))
        };
        areas.into_iter().map(traction).collect()
    }

    /// Index of the surface of this name.
    pub fn surface(&self, name: &str) -> Option<usize> {
        self.surfaces.list.iter().position(|s| s.name == name)
    }

    /// The triangles of a surface with the nodes at `x`: what does not intersect.
    pub fn triangles(&self, surface: usize, x: &[f64]) -> geometry::Surface {
        let s = &self.surfaces.list[surface];
        let first = s.samples.start as u32;
        let triangles = self.surfaces.triangles[s.triangles.clone()].iter().map(|t| t.map(|p| p - first));
        let points = self.surfaces.points[s.samples.clone()].iter().map(|p| p.at(x).into());
        geometry::Surface { points: points.collect(), triangles: triangles.collect() }
    }

    /// Pairs of surfaces with the number of pairs of their triangles that intersect with the nodes at `x`, where they take notice of each
    /// other: exact, and by other means than those that keep them apart.
    pub fn intersections(&self, x: &[f64]) -> Vec<([usize; 2], usize)> {
        let all = &self.surfaces;
        let search: Vec<SearchSurface> =
            (0..all.list.len()).into_par_iter().map(|s| SearchSurface::new(self.triangles(s, x))).collect();
        let pairs = (0..all.list.len())
            .flat_map(|a| self.partners.of[a].iter().filter(move |&&b| a <= b).map(move |&b| [a, b]));
        let pairs: Vec<[usize; 2]> = pairs.collect();
        let count = |&[a, b]: &[usize; 2]| {
            let met =
                if a == b { search[a].self_intersections() } else { search[a].intersections(&search[b]) };
            let corners = |s: usize, t: u32| &all.triangles[all.list[s].triangles.start + t as usize];
            let counts = |&&(t, u): &&(u32, u32)| self.partners.counts(all, corners(a, t), corners(b, u));
            ([a, b], met.iter().filter(counts).count())
        };
        pairs.par_iter().map(count).filter(|(_, n)| *n > 0).collect()
    }
}
