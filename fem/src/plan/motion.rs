//! What each component of each node does: prescribed, tied to a body, following a plane, sliding, or free.

use super::error::Mistakes;
use super::free::FreeBody;
use super::slide::{Along, Slide};
use super::term::{Names, check, set_of, unit};
use super::{Motion, SceneError};
use crate::mesh::Mesh;
use crate::scene::{Direction, PlaneSpec, PrescribedSpec, RollerSpec, Scene, TieSpec};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Motion of every component of every node, from the scene's prescriptions, rollers, ties and planes; those that slide in
/// directions that are no axes in a list of their own. The first mistake of each is named.
pub fn motions(
    scene: &Scene,
    mesh: &Mesh,
    free: &[FreeBody],
    names: &mut Names,
) -> Result<(Vec<[Motion; 3]>, Vec<Slide>), SceneError> {
    let n = mesh.points.len();
    let mut table =
        Table { motion: vec![[Motion::Free; 3]; n], user: vec![[""; 3]; n], oblique: BTreeMap::new() };
    let mut mistakes = Mistakes::default();
    for spec in &scene.prescribed {
        mistakes.keep(table.prescribe(spec, mesh, names));
    }
    for spec in &scene.rollers {
        mistakes.keep(table.roller(spec, mesh, names));
    }
    for spec in &scene.ties {
        mistakes.keep(table.tie(spec, mesh, free, names));
    }
    for (node, c, motion) in free.iter().flat_map(FreeBody::holds) {
        table.motion[node as usize][c] = motion;
    }
    for spec in &scene.planes {
        mistakes.keep(table.plane(spec, mesh));
    }
    mistakes.end()?;
    table.fill_rigid_blocks(scene, mesh)?;
    table.slide()
}

/// A direction as an axis where it is one, otherwise as a vector of unit length.
fn direction(user: &str, v: [f64; 3]) -> Result<Direction, SceneError> {
    let n = unit(user, v)?;
    let axis = (0..3).find(|&c| n[c].abs() == 1.0);
    Ok(axis.map_or(Direction::Vector(n.into()), Direction::Axis))
}

/// A direction, what is prescribed along it, and the node set that asked for it.
type Oblique<'a> = (Vector3<f64>, Along, &'a str);

/// Motions with the node set that asked for each, and constraints along other directions than axes.
struct Table<'a> {
    motion: Vec<[Motion; 3]>,
    user: Vec<[&'a str; 3]>,
    oblique: BTreeMap<u32, Vec<Oblique<'a>>>,
}

impl<'a> Table<'a> {
    /// The inside of a block that is no solid of the scene and whose boundary moves with one body moves with it, too.
    fn fill_rigid_blocks(&mut self, scene: &Scene, mesh: &Mesh) -> Result<(), SceneError> {
        let is_solid = |name: &String| scene.solids.iter().any(|s| s.region == *name);
        for block in mesh.blocks.iter().filter(|b| b.kind.is_solid() && !is_solid(&b.name)) {
            let boundary = block.boundary()?;
            let Some(first) = boundary.first().map(|face| self.motion[face[0] as usize]) else { continue };
            let moves_with_body =
                matches!(first, [Motion::Body(_) | Motion::Rides(_), ..]) && first == [first[0]; 3];
            if moves_with_body && boundary.iter().flatten().all(|&n| self.motion[n as usize] == first) {
                let inner = block.nodes.iter().filter(|n| self.motion[**n as usize] == [Motion::Free; 3]);
                let inner: Vec<u32> = inner.copied().collect();
                inner.into_iter().for_each(|n| self.motion[n as usize] = first);
            }
        }
        Ok(())
    }

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

    fn roller(&mut self, spec: &'a RollerSpec, mesh: &Mesh, names: &mut Names) -> Result<(), SceneError> {
        let control = spec.control.as_ref().map(|c| names.control(c));
        let user = format!("roller `{}`", spec.nodes);
        let n = direction(&user, spec.normal)?;
        let u = spec.displacement;
        check(&user, "displacement [m]", u, true, "a finite number")?;
        let must = "zero, or name the control that scales it";
        check(&user, "displacement [m] without a control", u, u == 0.0 || control.is_some(), must)?;
        let control = control.filter(|_| u != 0.0);
        for &node in set_of(mesh, &spec.nodes, &user)? {
            match n {
                Direction::Axis(c) => {
                    let along = |control| Motion::Control(control, u * spec.normal[c].signum());
                    self.set(node, c, control.map_or(Motion::Held, along), &spec.nodes)?;
                }
                Direction::Vector(n) => {
                    let along = Along::Control(control.map(|control| (control, u)));
                    self.oblique.entry(node).or_default().push((n.into(), along, &spec.nodes));
                }
            }
        }
        Ok(())
    }

    fn tie(
        &mut self,
        spec: &'a TieSpec,
        mesh: &Mesh,
        free: &[FreeBody],
        names: &mut Names,
    ) -> Result<(), SceneError> {
        let motion = match free.iter().position(|body| body.name == spec.body) {
            Some(body) => Motion::Rides(body),
            None => Motion::Body(names.body(&spec.body)),
        };
        for &node in set_of(mesh, &spec.nodes, &format!("tie to `{}`", spec.body))? {
            for c in 0..3 {
                self.set(node, c, motion, &spec.nodes)?;
            }
        }
        Ok(())
    }

    fn plane(&mut self, spec: &'a PlaneSpec, mesh: &Mesh) -> Result<(), SceneError> {
        let user = format!("plane `{}`", spec.nodes);
        let axis = match spec.axis {
            Direction::Axis(axis) => {
                check(&user, "axis", axis as f64, axis < 3, "0, 1 or 2")?;
                axis
            }
            Direction::Vector(n) => match direction(&user, n)? {
                Direction::Axis(axis) => axis,
                Direction::Vector(n) => {
                    return self.follow_obliquely(set_of(mesh, &spec.nodes, &user)?, n.into(), &spec.nodes);
                }
            },
        };
        let nodes = set_of(mesh, &spec.nodes, &user)?;
        for &node in nodes.iter().skip(1) {
            self.set(node, axis, Motion::Follows(nodes[0]), &spec.nodes)?;
        }
        match nodes.first() {
            Some(&master) if self.motion[master as usize][axis] != Motion::Free => {
                Err(self.conflict(master, axis, &spec.nodes))
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

    /// Lets nodes share their displacement along `n` with the first of them that is free to take it.
    fn follow_obliquely(&mut self, nodes: &[u32], n: Vector3<f64>, user: &'a str) -> Result<(), SceneError> {
        let leads = |node: &&u32| {
            let across = |c: usize| n[c].abs() < 1e-12;
            let free = |c: usize| self.motion[**node as usize][c] == Motion::Free;
            !self.oblique.contains_key(*node) && (0..3).all(|c| free(c) || across(c))
        };
        let leader =
            *nodes.iter().find(leads).ok_or_else(|| SceneError::NoLeader { nodes: user.to_string() })?;
        for &node in nodes.iter().filter(|n| **n != leader) {
            self.oblique.entry(node).or_default().push((n, Along::Node(leader), user));
        }
        Ok(())
    }

    /// Puts the constraints of every node that has oblique ones together.
    fn slide(mut self) -> Result<(Vec<[Motion; 3]>, Vec<Slide>), SceneError> {
        let mut slides = Vec::new();
        for (&node, oblique) in &self.oblique {
            let mut constraints = oblique.clone();
            for c in 0..3 {
                let along = match self.motion[node as usize][c] {
                    Motion::Free => continue,
                    Motion::Held => Along::Control(None),
                    Motion::Control(control, u) => Along::Control(Some((control, u))),
                    Motion::Follows(leader) => Along::Node(leader),
                    Motion::Body(_) | Motion::Rides(_) | Motion::Mean(_) | Motion::Slides(_) => {
                        let user = self.user[node as usize][c];
                        return Err(contradiction(node, oblique[0].2, user));
                    }
                };
                constraints.push((Vector3::ith(c, 1.0), along, self.user[node as usize][c]));
            }
            let bare: Vec<_> = constraints.iter().map(|(n, along, _)| (*n, *along)).collect();
            let slide = Slide::new(&bare)
                .map_err(|[a, b]| contradiction(node, constraints[b].2, constraints[a].2))?;
            self.motion[node as usize] = [Motion::Slides(slides.len() as u32); 3];
            slides.push(slide);
        }
        // Whom others follow must not slide itself.
        let leaders = self.motion.iter().flatten().filter_map(|m| match m {
            Motion::Follows(leader) => Some(*leader),
            Motion::Slides(i) => slides[*i as usize].follows.map(|f| f.0),
            _ => None,
        });
        for leader in leaders {
            if let Some(oblique) = self.oblique.get(&leader) {
                return Err(contradiction(leader, oblique[0].2, "that moves as one plane with it in front"));
            }
        }
        Ok((self.motion, slides))
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

fn contradiction(node: u32, first: &str, second: &str) -> SceneError {
    let name = |set: &str| format!("set `{set}`");
    SceneError::Contradiction { node, first: name(first), second: name(second) }
}
