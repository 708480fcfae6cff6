//! What each component of each node does: prescribed, tied to a body, following a plane, or free.

use super::error::Mistakes;
use super::term::{Names, check, set_of};
use super::{Motion, SceneError};
use crate::mesh::Mesh;
use crate::scene::{PlaneSpec, PrescribedSpec, Scene, TieSpec};

/// Motion of every component of every node, from the scene's prescriptions, ties and planes; the first mistake of each is named.
pub fn motions(scene: &Scene, mesh: &Mesh, names: &mut Names) -> Result<Vec<[Motion; 3]>, SceneError> {
    let mut table =
        Table { motion: vec![[Motion::Free; 3]; mesh.points.len()], user: vec![[""; 3]; mesh.points.len()] };
    let mut mistakes = Mistakes::default();
    for spec in &scene.prescribed {
        mistakes.keep(table.prescribe(spec, mesh, names));
    }
    for spec in &scene.ties {
        mistakes.keep(table.tie(spec, mesh, names));
    }
    for spec in &scene.planes {
        mistakes.keep(table.plane(spec, mesh));
    }
    mistakes.end().map(|()| table.motion)
}

/// Motions with the node set that asked for each.
struct Table<'a> {
    motion: Vec<[Motion; 3]>,
    user: Vec<[&'a str; 3]>,
}

impl<'a> Table<'a> {
    fn prescribe(
        &mut self,
        spec: &'a PrescribedSpec,
        mesh: &Mesh,
        names: &mut Names,
    ) -> Result<(), SceneError> {
        let control = spec.control.as_ref().map(|c| names.control(c));
        let user = format!("prescribed set `{}`", spec.nodes);
        let nodes = set_of(mesh, &spec.nodes, &user)?;
        let n = spec.displacement.len();
        if n > 1 && n != nodes.len() || (spec.control.is_some() && n == 0) {
            return Err(SceneError::Count {
                user,
                quantity: "displacement",
                found: n,
                needed: format!("1, or one per node: {}", nodes.len()),
            });
        }
        for (i, &node) in nodes.iter().enumerate() {
            for c in (0..3).filter(|c| spec.components[*c]) {
                let u = spec.displacement.get(if n == 1 { 0 } else { i }).map_or(0.0, |u| u[c]);
                check(&user, "displacement [m]", u, true, "a finite number")?;
                let motion = match control {
                    Some(control) if u != 0.0 => Motion::Control(control, u),
                    None if u != 0.0 => {
                        return Err(SceneError::Value {
                            user,
                            quantity: "displacement [m] without a control".to_string(),
                            value: u,
                            must: "zero, or name the control that scales it",
                        });
                    }
                    _ => Motion::Held,
                };
                self.set(node, c, motion, &spec.nodes)?;
            }
        }
        Ok(())
    }

    fn tie(&mut self, spec: &'a TieSpec, mesh: &Mesh, names: &mut Names) -> Result<(), SceneError> {
        let body = names.body(&spec.body);
        for &node in set_of(mesh, &spec.nodes, &format!("tie to `{}`", spec.body))? {
            for c in 0..3 {
                self.set(node, c, Motion::Body(body), &spec.nodes)?;
            }
        }
        Ok(())
    }

    fn plane(&mut self, spec: &'a PlaneSpec, mesh: &Mesh) -> Result<(), SceneError> {
        let user = format!("plane `{}`", spec.nodes);
        check(&user, "axis", spec.axis as f64, spec.axis < 3, "0, 1 or 2")?;
        let nodes = set_of(mesh, &spec.nodes, &user)?;
        for &node in nodes.iter().skip(1) {
            self.set(node, spec.axis, Motion::Follows(nodes[0]), &spec.nodes)?;
        }
        match nodes.first() {
            Some(&master) if self.motion[master as usize][spec.axis] != Motion::Free => {
                Err(self.conflict(master, spec.axis, &spec.nodes))
            }
            _ => Ok(()),
        }
    }

    /// The same motion twice is fine, as on an edge that two rollers share.
    fn set(&mut self, node: u32, c: usize, motion: Motion, user: &'a str) -> Result<(), SceneError> {
        let old = &mut self.motion[node as usize][c];
        if *old != Motion::Free && *old != motion {
            return Err(self.conflict(node, c, user));
        }
        *old = motion;
        self.user[node as usize][c] = user;
        Ok(())
    }

    fn conflict(&self, node: u32, c: usize, user: &str) -> SceneError {
        SceneError::Conflict {
            node,
            component: ['x', 'y', 'z'][c],
            first: format!("set `{}`", self.user[node as usize][c]),
            second: format!("set `{user}`"),
        }
    }
}
