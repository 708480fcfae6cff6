//! Contact of a scene: surfaces and pairs with every name resolved, and the part of each island in it.

use super::error::nearest;
use super::term::check;
use super::{Motion, SceneError};
use crate::contact::surface::{SurfaceInput, collision_triangles};
use crate::contact::{Contact, ContactInput, FREE, Mode, Overlap};
use crate::geometry::tree::Aabb;
use crate::mesh::quality::gauss_dets;
use crate::mesh::{Mesh, edge_counts, unique_nodes};
use crate::scene::{ContactMode, ContactSpec, LawSpec, Scene};
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Surfaces beyond this number are refused: each has a bit in a word.
const MAX_SURFACES: usize = 64;

/// Contact of the whole mesh.
pub struct ContactPlan {
    /// Surfaces over mesh nodes.
    pub surfaces: Vec<ContactSurface>,
    /// Pairs that may meet, by index; at least one side of each can deform.
    pub pairs: Vec<[usize; 2]>,
    mode: Mode,
    distance: f64,
    spacing: Option<f64>,
    attachment: f64,
    repair: f64,
    /// (node, surface) that take no notice of each other because they overlap and cannot be parted.
    ignored: Vec<(u32, usize)>,
}

/// What was changed in the mesh so that no surfaces overlap or touch at the start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repair {
    /// Pairs that did.
    pub overlaps: Vec<Overlap>,
    /// Number of nodes moved.
    pub n_nodes: usize,
    /// The farthest that a node moved \[m\].
    pub farthest: f64,
    /// Nodes at overlaps that could not be parted (near ties): their cells take no notice of the other surface.
    pub n_ignored: usize,
}

/// A surface that takes part.
pub struct ContactSurface {
    /// Name as in the scene.
    pub name: String,
    /// Faces over mesh nodes.
    pub faces: Vec<[u32; 4]>,
    /// Its nodes, ascending.
    pub nodes: Vec<u32>,
    /// Whether some of its nodes are not prescribed.
    pub deforms: bool,
    /// What all its nodes move with, where that is one body or nothing at all ([`Motion::Held`]).
    body: Option<Motion>,
    /// Stiffness \[Pa\] of what lies behind each face; infinite where it does not deform.
    stiffness: Vec<f64>,
    edge: f64,
    /// Edges of its rim; empty where it is closed.
    pub rim: Vec<[u32; 2]>,
}

/// Resolves the contact of a scene.
pub fn contact(
    scene: &Scene,
    mesh: &Mesh,
    motion: &[[Motion; 3]],
) -> Result<Option<ContactPlan>, SceneError> {
    let Some(spec) = &scene.contact else { return Ok(None) };
    let user = "contact";
    check(user, "distance [m]", spec.distance, spec.distance > 0.0, "positive")?;
    check(user, "repair [m]", spec.repair, spec.repair >= 0.0, "at least 0")?;
    check(user, "attachment [m]", spec.attachment, spec.attachment >= 0.0, "at least 0")?;
    spec.stiffness.map_or(Ok(()), |k| check(user, "stiffness [Pa]", k, k > 0.0, "positive"))?;
    check(user, "layer", spec.layer, spec.layer > 0.0, "positive")?;
    spec.spacing.map_or(Ok(()), |h| check(user, "spacing [m]", h, h > 0.0, "positive"))?;
    let n = spec.surfaces.len();
    check(user, "number of surfaces", n as f64, (1..=MAX_SURFACES).contains(&n), "1 to 64; join some")?;
    for (i, name) in spec.surfaces.iter().enumerate() {
        if spec.surfaces[..i].contains(name) {
            return Err(SceneError::Twice { what: "contact surface", name: name.clone() });
        }
    }
    let behind = stiffness_at_nodes(scene, mesh);
    let surfaces: Vec<ContactSurface> = spec
        .surfaces
        .iter()
        .map(|name| surface(name, spec, &behind, mesh, motion))
        .collect::<Result<_, _>>()?;
    // A metre between blocks of a centimetre is answered with their gaps; far beyond that sums over points would not be finite.
    let places: Vec<Vector3<f64>> =
        surfaces.iter().flat_map(|s| &s.nodes).map(|&n| mesh.points[n as usize].into()).collect();
    let whole = Aabb::around(places.iter());
    let most = FARTHEST * (whole.hi - whole.lo).norm();
    check(
        user,
        "distance [m]",
        spec.distance,
        spec.distance < most,
        "below a thousand times what the surfaces measure",
    )?;
    let find = |name: &String| {
        spec.surfaces.iter().position(|s| s == name).ok_or_else(|| SceneError::Unknown {
            user: "contact pair".to_string(),
            what: "contact surface",
            name: name.clone(),
            nearest: nearest(name, spec.surfaces.iter().map(String::as_str)),
        })
    };
    let resolve = |list: &[[String; 2]]| -> Result<Vec<[usize; 2]>, SceneError> {
        list.iter()
            .map(|[a, b]| {
                let (a, b) = (find(a)?, find(b)?);
                Ok([a.min(b), a.max(b)])
            })
            .collect()
    };
    let (wanted, excluded) = (resolve(&spec.pairs)?, resolve(&spec.excluded)?);
    let all = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
    let mut pairs: Vec<[usize; 2]> = if spec.pairs.is_empty() { all.collect() } else { wanted };
    pairs.retain(|pair| {
        let deforms = pair.iter().any(|&s| surfaces[s].deforms);
        deforms && !excluded.contains(pair)
    });
    pairs.sort_unstable();
    pairs.dedup();
    let is_rigid = |s: &usize| surfaces[*s].body.is_some();
    let same_body =
        |[a, b]: &[usize; 2]| surfaces[*a].body.is_some() && surfaces[*a].body == surfaces[*b].body;
    pairs.retain(|pair| !same_body(pair));
    if spec.stiffness.is_none()
        && let Some(pair) = pairs.iter().find(|pair| pair.iter().all(is_rigid))
    {
        return Err(SceneError::RigidPair { pair: pair.map(|s| surfaces[s].name.clone()) });
    }
    let ContactSpec { mode, distance, spacing, attachment, repair, .. } = *spec;
    let mode = if mode == ContactMode::Cheap { Mode::Cheap } else { Mode::Guarded };
    Ok(Some(ContactPlan {
        surfaces,
        pairs,
        mode,
        distance,
        spacing,
        attachment,
        repair,
        ignored: Vec::new(),
    }))
}

fn surface(
    name: &str,
    spec: &ContactSpec,
    behind: &[Option<f64>],
    mesh: &Mesh,
    motion: &[[Motion; 3]],
) -> Result<ContactSurface, SceneError> {
    let faces = match (mesh.surfaces.get(name), mesh.blocks.iter().find(|b| b.name == name)) {
        (Some(faces), _) => faces.clone(),
        (None, Some(block)) => block.boundary()?,
        (None, None) => {
            let known = mesh.surfaces.keys().chain(mesh.blocks.iter().map(|b| &b.name));
            return Err(SceneError::Unknown {
                user: "contact".to_string(),
                what: "surface or block",
                name: name.to_string(),
                nearest: nearest(name, known.map(String::as_str)),
            });
        }
    };
    let nodes = unique_nodes(faces.iter().flatten().copied());
    let user = format!("contact surface `{name}`");
    check(&user, "number of faces", faces.len() as f64, !faces.is_empty(), "positive")?;
    let rim = rim(&user, &faces)?;
    faces.iter().try_for_each(|face| has_area(&user, *face, mesh))?;
    let moves = |n: &&u32| motion[**n as usize].iter().any(Motion::is_unknown);
    let deforms = nodes.iter().any(|n| moves(&n));
    let first = motion[nodes[0] as usize];
    let together = nodes.iter().all(|&n| motion[n as usize] == first);
    let body = Some(first[0])
        .filter(|m| together && first == [*m; 3] && (!deforms || matches!(m, Motion::Rides(_))));
    let rides = |n: u32| matches!(motion[n as usize][0], Motion::Rides(_));
    let alone = |n: &&u32| behind[**n as usize].is_none() && !rides(**n);
    if deforms && let Some(&node) = nodes.iter().filter(moves).find(alone) {
        return Err(SceneError::Loose { user, node });
    }
    // Of cells whose stiffness changes along the surface, a face has that of its own: its other nodes belong to stiffer ones at most.
    let least =
        |face: &[u32; 4]| face.iter().filter_map(|&n| behind[n as usize]).fold(f64::INFINITY, f64::min);
    let layer = if spec.mode == ContactMode::Guarded { spec.layer } else { 1.0 };
    let of_face = |face: &[u32; 4]| match deforms {
        true => spec.stiffness.unwrap_or_else(|| layer * least(face)),
        false => f64::INFINITY,
    };
    let stiffness = faces.iter().map(of_face).collect();
    let length = |a: u32, b: u32| {
        let (p, q) = (mesh.points[a as usize], mesh.points[b as usize]);
        (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt()
    };
    let lengths: Vec<f64> = faces
        .iter()
        .flat_map(|f| (0..4).map(|k| [f[k], f[(k + 1) % 4]]).filter(|[a, b]| a != b))
        .map(|[a, b]| length(a, b))
        .collect();
    let edge = lengths.iter().sum::<f64>() / lengths.len() as f64;
    Ok(ContactSurface { name: name.to_string(), faces, nodes, deforms, body, stiffness, edge, rim })
}

/// Edges that belong to one face only. Refuses surfaces that branch or whose faces turn opposite ways: they have no inside.
fn rim(user: &str, faces: &[[u32; 4]]) -> Result<Vec<[u32; 2]>, SceneError> {
    let mut rim = Vec::new();
    for (nodes, counts) in edge_counts(faces) {
        let user = || user.to_string();
        match counts {
            [1, 1] => {}
            [1, 0] | [0, 1] => rim.push(nodes),
            [2, 0] | [0, 2] => return Err(SceneError::Orientation { user: user(), nodes }),
            [a, b] => return Err(SceneError::Branching { user: user(), nodes, n_faces: a + b }),
        }
    }
    Ok(rim)
}

/// Refuses a face of which a collision triangle has no normal: its corners lie on a line as far as round-off of their coordinates can tell.
fn has_area(user: &str, face: [u32; 4], mesh: &Mesh) -> Result<(), SceneError> {
    let at: [Vector3<f64>; 4] = face.map(|n| mesh.points[n as usize].into());
    let mean = (face[2] != face[3]).then(|| at.iter().sum::<Vector3<f64>>() / 4.0);
    for [a, b, c] in collision_triangles(at, mean) {
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let round_off = f64::EPSILON * a.amax().max(b.amax()).max(c.amax());
        // Twice the area, against that of a triangle as high as the round-off; not above it either where something is no number.
        if !((b - a).cross(&(c - a)).norm() > 4.0 * round_off * longest) {
            return Err(SceneError::FlatFace { user: user.to_string(), nodes: face, place: a.into() });
        }
    }
    Ok(())
}

/// Young's modulus \[Pa\] of the stiffest cell at each node of the mesh; `None`: no solid.
fn stiffness_at_nodes(scene: &Scene, mesh: &Mesh) -> Vec<Option<f64>> {
    let mut at = vec![None; mesh.points.len()];
    for solid in &scene.solids {
        let Some(block) = mesh.blocks.iter().find(|b| b.name == solid.region) else { continue };
        let young = young(&solid.law);
        for (c, cell) in block.cells().enumerate() {
            let stiffness = young * solid.scale.get(c).unwrap_or(&1.0);
            cell.iter()
                .for_each(|&n| at[n as usize] = Some(at[n as usize].unwrap_or(0.0_f64).max(stiffness)));
        }
    }
    at
}

/// Young's modulus \[Pa\] at small strain, along no fibre; of a user's own law the mean over all directions.
fn young(law: &LawSpec) -> f64 {
    let of = |mu: f64, bulk: f64| 9.0 * bulk * mu / (3.0 * bulk + mu);
    match law {
        LawSpec::NeoHookean { young, .. }
        | LawSpec::StableNeoHookean { young, .. }
        | LawSpec::StVenantKirchhoff { young, .. }
        | LawSpec::LinearElastic { young, .. } => *young,
        LawSpec::NeoHookeanUncoupled { mu, bulk } => of(*mu, *bulk),
        LawSpec::MooneyRivlin { c10, c01, bulk } => of(2.0 * (c10 + c01), *bulk),
        LawSpec::MooneyRivlinDyna { a, b, nu } => 4.0 * (a + b) * (1.0 + nu),
        // I₁ J^(-2/3) has μ = 2, J + 1 / J a bulk modulus of 2.
        LawSpec::FoldoverFree { .. } => of(2.0, 2.0),
        LawSpec::Blemker { g1, g2, bulk, .. } => of(g1 + g2, *bulk),
        LawSpec::User(law) => law.mean_young(),
    }
}

/// Activation distances beyond this, over the diagonal of all surfaces, are a slip of the pen.
const FARTHEST: f64 = 1e3;
/// Gap at the start, as a fraction of the activation distance, below which surfaces touch.
const TOUCH: f64 = 0.1;
/// Numbers of what nodes move with that no body has.
const HELD: u32 = u32::MAX - 2;
const CONTROLLED: u32 = u32::MAX - 1;

/// Rounds in which what cannot be parted is left out.
const MAX_TRIES: usize = 8;
/// Distance between samples of guarded contact as a fraction of the edge length of the finer side: half of it, so that ridges that cross meet samples, not
/// only each other's edges, whose barriers are thin.
const SPACING: f64 = 0.5;
/// Fraction of the det of a cell below which moving nodes has folded it.
const FOLDED: f64 = 0.1;
/// Sweeps that carry the displacement of the surfaces into the solids.
const SWEEPS: usize = 40;

/// Nodes of solid cells that are turned inside out, or lose nine tenths of their volume somewhere, with the nodes at `points`.
fn folded_nodes(mesh: &Mesh, points: &[[f64; 3]]) -> BTreeSet<u32> {
    let mut nodes = BTreeSet::new();
    for block in mesh.blocks.iter().filter(|b| b.kind.is_solid()) {
        let dets = |cell: &[u32], points: &[[f64; 3]]| {
            let X: Vec<Vector3<f64>> = cell.iter().map(|&n| points[n as usize].into()).collect();
            gauss_dets(block.kind, &X)
        };
        for cell in block.cells() {
            let moved = cell.iter().any(|&n| points[n as usize] != mesh.points[n as usize]);
            let folds = |((before, _), (after, _)): (&(f64, f64), &(f64, f64))| *after < FOLDED * before;
            if moved && dets(cell, &mesh.points).iter().zip(&dets(cell, points)).any(folds) {
                nodes.extend(cell);
            }
        }
    }
    nodes
}

impl ContactPlan {
    /// Whether surfaces may penetrate each other.
    pub fn is_cheap(&self) -> bool {
        self.mode == Mode::Cheap
    }

    /// Refuses overlaps in the mesh deeper than may be mended; moves its nodes apart where others overlap or touch.
    pub fn mend(&mut self, mesh: &mut Mesh, motion: &[[Motion; 3]]) -> Result<Repair, SceneError> {
        if self.mode == Mode::Cheap {
            return Ok(Repair::default()); // an overlap is a penetration like any other
        }
        let members: Vec<usize> = (0..self.surfaces.len()).collect();
        let Some(contact) = self.on_island(&members, Some, &mesh.points, motion) else {
            return Ok(Repair::default());
        };
        let x = mesh.points.as_flattened().to_vec();
        let gap = TOUCH * self.distance;
        let overlaps = contact.overlaps(&x, gap);
        if overlaps.is_empty() {
            return Ok(Repair::default());
        }
        let allowed = self.repair.max(1e-6 * self.distance);
        let refused = |overlaps: Vec<Overlap>| match overlaps.iter().any(Overlap::is_overlap) {
            true => SceneError::Overlap { overlaps, allowed: self.repair },
            false => SceneError::TooClose { pairs: overlaps, gap, distance: self.distance },
        };
        if overlaps.iter().any(|o| o.depth > allowed) {
            return Err(refused(overlaps));
        }
        // Nodes that are prescribed stay where they are; on a roller they may slide.
        let moves = |n: u32| motion[n as usize].iter().any(|m| matches!(m, Motion::Free));
        let mut tries = 0;
        let (mended, u) = loop {
            let contact =
                self.on_island(&members, Some, &mesh.points, motion).expect("there was contact before");
            let stuck = match contact.untangle(&x, gap, &moves) {
                Ok(u) => {
                    let mut u: Vec<[f64; 3]> = u.as_chunks::<3>().0.to_vec();
                    self.carry_inside(mesh, motion, &mut u);
                    let to = |(p, u): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| p[c] + u[c]);
                    let mended: Vec<[f64; 3]> = mesh.points.iter().zip(&u).map(to).collect();
                    let folded = folded_nodes(mesh, &mended);
                    if folded.is_empty() {
                        break (mended, u);
                    }
                    contact.close_pairs(&x, gap, &|n| folded.contains(&n))
                }
                Err(stuck) => stuck,
            };
            if self.repair == 0.0 || tries == MAX_TRIES || stuck.is_empty() {
                return Err(refused(overlaps));
            }
            self.ignored.extend(stuck);
            tries += 1;
        };
        self.ignored.sort_unstable();
        self.ignored.dedup();
        let farthest = u.iter().map(|u| u.iter().map(|c| c * c).sum::<f64>()).fold(0.0, f64::max).sqrt();
        let n_nodes = u.iter().filter(|u| **u != [0.0; 3]).count();
        mesh.points = mended;
        mesh.check()?;
        Ok(Repair { overlaps, n_nodes, farthest, n_ignored: self.ignored.len() })
    }

    /// Inner nodes follow the mean of their neighbours (Jacobi's method for Laplace's equation).
    fn carry_inside(&self, mesh: &Mesh, motion: &[[Motion; 3]], u: &mut [[f64; 3]]) {
        let mut stays: Vec<bool> = motion.iter().map(|m| !m.iter().all(|m| *m == Motion::Free)).collect();
        self.surfaces.iter().flat_map(|s| &s.nodes).for_each(|&n| stays[n as usize] = true);
        let mut neighbours = vec![Vec::new(); mesh.points.len()];
        for cell in mesh.blocks.iter().filter(|b| b.kind.is_solid()).flat_map(|b| b.cells()) {
            for &n in cell.iter().filter(|n| !stays[**n as usize]) {
                neighbours[n as usize].extend(cell.iter().copied().filter(|m| *m != n));
            }
        }
        for _ in 0..SWEEPS {
            let old = u.to_vec();
            for (n, near) in neighbours.iter().enumerate().filter(|(_, near)| !near.is_empty()) {
                u[n] = std::array::from_fn(|c| {
                    near.iter().map(|&m| old[m as usize][c]).sum::<f64>() / near.len() as f64
                });
            }
        }
    }

    /// The contact of the surfaces `members` (ascending) that belong to one island, over its local nodes; `None` where no pair
    /// of them may meet.
    pub fn on_island(
        &self,
        members: &[usize],
        local: impl Fn(u32) -> Option<u32>,
        points: &[[f64; 3]],
        motion: &[[Motion; 3]],
    ) -> Option<Contact> {
        let at = |s: usize| members.binary_search(&s).ok();
        let pairs: Vec<[usize; 2]> = self.pairs.iter().filter_map(|&[a, b]| Some([at(a)?, at(b)?])).collect();
        if pairs.is_empty() {
            return None;
        }
        let natural = if self.mode == Mode::Guarded { SPACING } else { 1.0 };
        let surfaces = members.iter().enumerate().map(|(m, &s)| {
            let surface = &self.surfaces[s];
            let partners = pairs.iter().filter(|p| p.contains(&m)).flatten();
            let finest = partners.map(|&p| self.surfaces[members[p]].edge).fold(surface.edge, f64::min);
            SurfaceInput {
                name: surface.name.clone(),
                faces: surface
                    .faces
                    .iter()
                    .map(|f| f.map(|n| local(n).expect("a node of a surface is in its island")))
                    .collect(),
                stiffness: surface.stiffness.clone(),
                spacing: self.spacing.unwrap_or(natural * finest),
            }
        });
        let carrier = |m: &[Motion; 3]| match m {
            [Motion::Body(b), ..] => Some(*b as u32),
            [Motion::Rides(b), ..] => Some(FREE + *b as u32),
            [Motion::Held, Motion::Held, Motion::Held] => Some(HELD),
            m if m.iter().any(Motion::is_unknown) => None,
            _ => Some(CONTROLLED),
        };
        let input = ContactInput {
            surfaces: surfaces.collect(),
            distance: self.distance,
            mode: self.mode,
            carrier: motion.iter().map(carrier).collect(),
            muted: self.muted(members, &pairs, &local, points, motion),
            pairs,
        };
        Some(Contact::new(&input, points.as_flattened()))
    }

    /// Nodes at or near nodes tied to a body, with the rigid surfaces of that body.
    fn muted(
        &self,
        members: &[usize],
        pairs: &[[usize; 2]],
        local: impl Fn(u32) -> Option<u32>,
        points: &[[f64; 3]],
        motion: &[[Motion; 3]],
    ) -> Vec<(u32, usize)> {
        let mut muted: Vec<(u32, usize)> = Vec::new();
        for (node, surface) in &self.ignored {
            // Of this island: one whose surface is among the members.
            if let Ok(m) = members.binary_search(surface)
                && let Some(node) = local(*node)
            {
                muted.push((node, m));
            }
        }
        let local = |n: u32| local(n).expect("a node of a surface is in its island");
        for &[a, b] in pairs {
            for (soft, rigid) in [(a, b), (b, a)] {
                let Some(body) = self.surfaces[members[rigid]].body else { continue };
                let nodes: Vec<u32> = self.surfaces[members[soft]].nodes.iter().map(|&n| local(n)).collect();
                let tied: Vec<[f64; 3]> = nodes
                    .iter()
                    .filter(|&&n| motion[n as usize] == [body; 3])
                    .map(|&n| points[n as usize])
                    .collect();
                let near = |p: [f64; 3], q: &[f64; 3]| {
                    (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt() <= self.attachment
                };
                muted.extend(
                    nodes.iter().filter_map(|&n| {
                        tied.iter().any(|q| near(points[n as usize], q)).then_some((n, rigid))
                    }),
                );
            }
        }
        muted
    }
}
