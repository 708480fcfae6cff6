//! Muscles that lie on the femur: places all over their sides that stay off its smooth distance.
//!
//! A face is read as four triangles around the mean of its nodes, as contact between muscles reads it, so that what is kept off one is kept off
//! the other.

use std::sync::Arc;

use fem::effect::Effect;
use fem::effect::obstacle::{Layer, Obstacle, Sample};
use fem::geometry::{DistanceField, SearchSurface, Surface};
use fem::plan::{Builder, Term};
use nalgebra::Vector3;

use super::MuscleError;

/// Places are at most so far apart \[m\] in the mesh. Muscles are drawn out to 2.3 times their length on the way; with 2 mm faces crossed the corner
/// of the rim of the cartilage in the last two frames at cells of 4 mm, with 1 mm none does, at 4 and at 10 mm.
const SPACING: f64 = 1e-3;
/// Distance \[m\] at which muscles and femur repel each other, less where a place starts nearer; that of contact everywhere.
const DISTANCE: f64 = 0.3e-3;
/// A place that starts nearer than this \[m\] beside what grows from bone takes no notice of it.
const LEAST: f64 = 0.02e-3;
/// Of the distance at which it starts a place has this part as its own: it starts free of forces.
const PART: f64 = 0.9;

/// Faces of sides with their places.
#[derive(Clone, Debug, Default)]
pub struct Lying {
    nodes: Vec<[u32; 4]>,
    samples: Vec<Vec<Sample<4>>>,
    /// Faces all of whose places take notice of the femur.
    free: Vec<[u32; 4]>,
    /// Places that take no notice of the femur.
    pub left_out: usize,
}

impl Lying {
    /// Adds the faces of a muscle whose nodes are at `points` \[m\]; those all of whose nodes are held are left out.
    pub fn add(
        &mut self,
        muscle: &str,
        faces: &[[u32; 4]],
        points: &[[f64; 3]],
        is_held: &dyn Fn(u32) -> bool,
        (femur, modulus): (&DistanceField, f64),
    ) -> Result<(), MuscleError> {
        for face in faces {
            let n_held = face.iter().filter(|n| is_held(**n)).count();
            if n_held == 4 {
                continue;
            }
            let corners = face.map(|n| Vector3::from(points[n as usize]));
            let (mut samples, before) = (Vec::new(), self.left_out);
            for (weights, area) in places(&corners) {
                let place: Vector3<f64> = (0..4).map(|k| weights[k] * corners[k]).sum();
                let start = femur.near(&place, DISTANCE / PART).map_or(f64::INFINITY, |at| at.distance);
                if start >= LEAST {
                    let layer = Layer::Barrier { modulus, distance: DISTANCE.min(PART * start) };
                    samples.push(Sample { weights, area, layer });
                } else if n_held > 0 {
                    self.left_out += 1;
                } else {
                    return Err(MuscleError::InBone {
                        muscle: muscle.into(),
                        at: place.into(),
                        depth: -start,
                    });
                }
            }
            if self.left_out == before {
                self.free.push(*face);
            }
            if !samples.is_empty() {
                self.nodes.push(*face);
                self.samples.push(samples);
            }
        }
        Ok(())
    }

    /// The effect that keeps them off.
    pub fn term(&self, femur: &Arc<DistanceField>) -> Term {
        let (femur, samples) = (femur.clone(), self.samples.clone());
        let build: Builder = Box::new(move |name, _, nodes, groups| {
            let of = groups.iter().map(|g| samples[*g as usize].clone()).collect();
            let obstacle = Obstacle::new(name, femur.clone(), nodes.as_chunks::<4>().0, of);
            Ok(Box::new(obstacle) as Box<dyn Effect>)
        });
        let nodes = self.nodes.iter().flatten().copied().collect();
        Term { name: "muscles_on_femur".into(), nodes_per_group: 4, nodes, couples: true, build }
    }

    /// Pairs of triangles that intersect (exact): of faces all of whose places take notice of the femur, with the nodes at `x` \[m\], 3 per
    /// node, and of a femur.
    pub fn crossings(&self, x: &[f64], femur: &SearchSurface) -> usize {
        let place = |n: u32| Vector3::from_column_slice(&x[3 * n as usize..][..3]);
        let mut surface = Surface::default();
        for face in &self.free {
            let corners = face.map(place);
            let first = surface.points.len() as u32;
            let middle = corners.iter().sum::<Vector3<f64>>() / 4.0;
            surface.points.extend(corners.iter().chain([&middle]).map(|p| <[f64; 3]>::from(*p)));
            surface.triangles.extend((0..4).map(|k| [first + k, first + (k + 1) % 4, first + 4]));
        }
        SearchSurface::new(surface).intersections(femur).len()
    }

    /// Places there are.
    pub fn n_places(&self) -> usize {
        self.samples.iter().map(Vec::len).sum()
    }
}

/// Places of a face, evenly over its four triangles: weights of its nodes, and the area \[m²\] that each stands for. They are the corners of n² equal
/// triangles in each, so nodes and edges of the face are among them: what is bent over an edge of bone touches it there first.
pub(super) fn places(corners: &[Vector3<f64>; 4]) -> Vec<([f64; 4], f64)> {
    let middle = corners.iter().sum::<Vector3<f64>>() / 4.0;
    let mut places = Vec::new();
    for k in 0..4 {
        let [a, b] = [k, (k + 1) % 4];
        let [u, v] = [corners[b] - corners[a], middle - corners[a]];
        let longest = u.norm().max(v.norm()).max((v - u).norm());
        let n = (longest / SPACING).ceil().max(1.0) as usize;
        let area = 0.5 * u.cross(&v).norm() / (n * n) as f64;
        for i in 0..=n {
            for j in 0..=n - i {
                // Triangles of which it is a corner: six inside, three along a side, one at an end.
                let sides = usize::from(i == 0) + usize::from(j == 0) + usize::from(i + j == n);
                let shared = [6.0, 3.0, 1.0][sides];
                let [p, q] = [i, j].map(|k| k as f64 / n as f64);
                let mut weights = [q / 4.0; 4];
                weights[a] += 1.0 - p - q;
                weights[b] += p;
                places.push((weights, shared * area / 3.0));
            }
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use fem::effect::State;

    #[test]
    fn places_of_a_face_are_close_and_have_its_area_and_its_middle() {
        let corners =
            [[0.0, 0.0], [0.012, 0.0], [0.012, 0.005], [0.0, 0.005]].map(|[x, y]| Vector3::new(x, y, 0.0));
        let places = places(&corners);
        let area: f64 = places.iter().map(|p| p.1).sum();
        assert!((area - 60e-6).abs() < 1e-15, "{area}");
        let at = |w: &[f64; 4]| (0..4).map(|k| w[k] * corners[k]).sum::<Vector3<f64>>();
        let middle = places.iter().map(|(w, a)| at(w) * *a).sum::<Vector3<f64>>() / area;
        assert!((middle - Vector3::new(0.006, 0.0025, 0.0)).norm() < 1e-15, "{middle}");
        for (w, _) in &places {
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15 && w.iter().all(|w| *w > -1e-15));
        }
        // Its nodes are among them.
        for corner in &corners {
            assert!(places.iter().any(|(w, _)| (at(w) - corner).norm() < 1e-15), "{corner}");
        }
        // No point of the face is farther from a place than the middle of a triangle of the spacing is from its corners.
        for i in 0..=24 {
            for j in 0..=10 {
                let p = Vector3::new(0.0005 * f64::from(i), 0.0005 * f64::from(j), 0.0);
                let nearest = places.iter().map(|(w, _)| (at(w) - p).norm()).fold(f64::MAX, f64::min);
                assert!(nearest < SPACING, "{p}: {nearest}");
            }
        }
    }

    #[test]
    fn what_is_between_the_nodes_of_a_face_is_kept_off_and_what_is_held_is_left_alone() {
        // A ball of 20 mm, and faces of 12 mm with the ball below different parts of them.
        let side = Vector3::repeat(0.04);
        let ball = Arc::new(DistanceField::new(-side, side, 1e-3, |p| p.norm() - 0.02));
        let face = |x: f64, y: f64, up: f64| -> Vec<[f64; 3]> {
            let [a, b] = [[x, y], [x + 0.012, y + 0.012]];
            [[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]].map(|[x, y]| [x, y, 0.02 + up]).to_vec()
        };
        let free = |_: u32| false;
        let lying = |points: &[[f64; 3]], is_held: &dyn Fn(u32) -> bool| {
            let mut lying = Lying::default();
            lying.add("m", &[[0, 1, 2, 3]], points, is_held, (&ball, 1e5)).map(|()| lying)
        };
        let energy = |lying: &Lying, points: &[[f64; 3]]| {
            let term = lying.term(&ball);
            let effect = (term.build)("t", points, &term.nodes, &[0]).unwrap();
            effect.energy(&State { x: points.as_flattened(), controls: &[] })
        };
        let start = lying(&face(-0.006, -0.006, 1e-3), &free).unwrap();
        assert_eq!(energy(&start, &face(-0.006, -0.006, 1e-3)), 0.0);
        // From the top of the ball under the middle of the face to the top under places near its sides and corners: all nodes are outside.
        for (x, y) in
            [(-0.006, -0.006), (-0.002, -0.006), (-0.0105, -0.004), (-0.003, -0.010), (-0.0015, -0.0105)]
        {
            let near = energy(&start, &face(x, y, 0.2e-3));
            assert!(near.is_finite() && near > 0.0, "{x} {y}: {near}");
            let through = energy(&start, &face(x, y, -0.2e-3));
            assert!(through.is_infinite(), "{x} {y}: {through}");
        }
        // What starts in the bone is refused, beside what is held left out; a place that starts near has a distance of its own.
        let deep = face(-0.006, -0.006, -0.1e-3);
        assert!(matches!(lying(&deep, &free), Err(MuscleError::InBone { .. })));
        assert!(lying(&deep, &|n| n == 0).unwrap().left_out > 0);
        let near = face(-0.006, -0.006, 0.1e-3);
        assert_eq!(energy(&lying(&near, &free).unwrap(), &near), 0.0);
        assert_eq!(lying(&deep, &|_| true).unwrap().n_places(), 0);
    }
}
