//! What will actually be computed: a scene with every name resolved, every mistake found, and every effect that the
//! scene does not call for left out; split into islands that nothing connects.

#![allow(non_snake_case)]

mod contact;
mod embed;
mod error;
mod followers;
mod free;
mod grid;
mod inertia;
mod island;
mod lines;
mod load;
mod loaded;
mod motion;
pub mod predictor;
mod rim;
mod slide;
mod solids;
mod surfaces;
mod term;
mod tied;
mod warning;

pub use contact::{ContactPlan, ContactSurface, Repair};
pub use error::SceneError;
pub use free::FreeBody;
pub use grid::EmbeddedRegion;
pub use inertia::Inertia;
pub use island::Island;
pub(crate) use load::on_supports;
pub use load::{Load, Mean, Motion};
pub use loaded::{LoadedIsland, Watch};
pub use slide::Slide;
pub use solids::Weights;
pub use term::{Builder, Names, OwnTerms, Term};
pub use warning::Warning;

use crate::effect::{DeadLoad, Effect, NO_NODE};
use crate::mesh::Mesh;
use crate::scene::{Course, ForceSpec, Scene};
use embed::Embedding;
use error::{Mistakes, nearest};
use load::Motions;
use std::path::Path;
use std::sync::Arc;

/// What will be computed.
pub struct Plan {
    /// The mesh.
    pub mesh: Mesh,
    /// Names of the controls, in the order of [`Load::controls`].
    pub controls: Vec<String>,
    /// Names of the bodies, in the order of [`Load::poses`].
    pub bodies: Vec<String>,
    /// Islands, by their first node.
    pub islands: Vec<Arc<Island>>,
    /// What each component of each node of the mesh does.
    pub motion: Vec<[Motion; 3]>,
    /// Bodies whose poses are unknowns; see [`Motion::Rides`].
    pub free_bodies: Vec<FreeBody>,
    /// Regions whose nodes are means of those of a grid.
    pub embedded: Vec<EmbeddedRegion>,
    /// Nodes that are fixed means of others, as these; see [`Motion::Mean`].
    pub means: Vec<Mean>,
    /// How nodes move that slide in directions that are no axes; see [`Motion::Slides`].
    pub slides: Vec<Slide>,
    /// Centre of the nodes tied to each body \[m\], about which it turns between loads.
    pub(crate) pivots: Arc<Vec<[f64; 3]>>,
    /// Weight of every solid cell, for cuts; empty without gravity.
    pub weights: Vec<Weights>,
    /// Masses and first velocities; absent: every frame is an equilibrium.
    pub inertia: Option<Inertia>,
    /// Name and number of groups (elements, segments, loaded nodes) of each effect.
    pub effects: Vec<(String, usize)>,
    /// What was changed in the mesh so that no surfaces touch at the start.
    pub repair: Repair,
    /// Regions of lines that are strands, not fibres.
    pub strands: std::collections::BTreeSet<String>,
    /// Kinds of effects that the scene does not call for.
    pub absent: Vec<&'static str>,
    /// Nodes of no island of which something is prescribed, as those inside rigid blocks.
    idle: Vec<u32>,
    /// Surfaces that take part in contact, and which of them may meet; absent where nothing can.
    contact: Option<ContactPlan>,
    /// What was accepted and is probably a mistake; each is also a warning of `tracing`.
    pub warnings: Vec<Warning>,
}

impl Plan {
    /// Compiles a scene over a mesh \[m\]. Of every part of the scene the first mistake is named, all in one error.
    pub fn new(scene: &Scene, mesh: Mesh) -> Result<Plan, SceneError> {
        Plan::with_terms(scene, mesh, &|_, _| Ok(Vec::new()))
    }

    /// The same with terms of the caller's own, which may number controls and bodies; no file of this crate has to know them.
    pub fn with_terms(scene: &Scene, mut mesh: Mesh, own: OwnTerms) -> Result<Plan, SceneError> {
        mesh.check()?;
        let mut with_frames: Scene;
        let (mut scene, mut free_bodies) = (scene, Vec::new());
        if !scene.free_bodies.is_empty() {
            with_frames = scene.clone();
            free_bodies = free::add(&mut with_frames, &mut mesh)?;
            scene = &with_frames;
        }
        let mut warnings = warning::of_mesh(scene, &mesh);
        let mut mistakes = Mistakes::default();
        // Numbered anew below: here it only matters what is prescribed.
        let motion = mistakes.keep(motion::motions(scene, &mesh, &free_bodies, &mut Names::default()));
        let contact = motion.as_ref().and_then(|(m, _)| mistakes.keep(contact(scene, &mut mesh, m)));
        let embedding = match &motion {
            Some((motion, slides)) if !scene.embedded.is_empty() => {
                mistakes.keep(grid::embed(scene, &mut mesh, motion, slides)).unwrap_or_default()
            }
            _ => grid::Embedding::default(),
        };
        let mut names = Names::default();
        let weights = weights(scene, &mesh, &mut names, &mut mistakes);
        let mut terms = terms(
            scene,
            &mesh,
            motion.as_ref().map(|(m, s)| (m.as_slice(), s.as_slice())),
            (&weights, &embedding),
            own,
            &mut names,
            &mut mistakes,
        );
        for spec in &scene.body_forces {
            terms.extend(mistakes.keep(free::force(spec, &free_bodies, &mut names)));
        }
        let inertia = mistakes.keep(inertia::inertia(scene, &mesh));
        let motion = mistakes.keep(motion::motions(scene, &mesh, &free_bodies, &mut names));
        let (Some((contact, repair)), Some(inertia), Some((mut motion, slides)), true) =
            (contact, inertia, motion, mistakes.is_empty())
        else {
            return Err(mistakes.into_error());
        };
        let grid::Embedding { means, nodes, regions: embedded, .. } = embedding;
        for (node, of) in nodes.into_iter().zip(0..) {
            motion[node as usize] = [Motion::Mean(of); 3];
        }
        let pivots = Arc::new(pivots(&mesh, &motion, names.bodies.len()));
        let motions = Motions { motion: &motion, slides: &slides, free: &free_bodies, means: &means };
        let islands = islands(&mesh, &terms, motions, &pivots, names.controls.len(), contact.as_ref())?;
        let effects = terms.iter().map(|t| (t.name.clone(), t.nodes.len() / t.nodes_per_group)).collect();
        let mut idle: std::collections::BTreeSet<u32> = (0..mesh.points.len() as u32).collect();
        islands.iter().flat_map(|i| &i.nodes).for_each(|n| {
            idle.remove(n);
        });
        idle.retain(|n| !motion[*n as usize].iter().all(Motion::is_unknown));
        let idle = idle.into_iter().collect();
        let Names { controls, bodies } = names;
        let absent = absent(scene);
        let strands = scene.strands.iter().map(|s| s.region.clone()).collect();
        warnings.extend(warning::of_forces(scene, &motion));
        warnings.extend(contact.iter().flat_map(|c| &c.surfaces).filter_map(warning::of_surface));
        warnings.extend(embedded.iter().filter_map(warning::of_grid));
        warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        Ok(Plan {
            strands,
            mesh,
            controls,
            bodies,
            islands,
            motion,
            free_bodies,
            embedded,
            means,
            slides,
            pivots,
            weights,
            inertia,
            effects,
            repair,
            absent,
            idle,
            contact,
            warnings,
        })
    }

    /// Sets what is prescribed of nodes that belong to no island; `x`: positions \[m\] of all nodes.
    pub(crate) fn prescribe_idle(&self, load: &Load, x: &mut [f64]) {
        let places = x.as_chunks_mut::<3>().0;
        for &n in &self.idle {
            load.prescribe(&self.motion[n as usize], &self.mesh.points[n as usize], &mut places[n as usize]);
        }
    }

    /// Surfaces that take part in contact, and which of them may meet.
    pub fn contact(&self) -> Option<&ContactPlan> {
        self.contact.as_ref()
    }

    /// Compiles a scene file over the mesh that it names.
    pub fn read(path: &Path) -> Result<Plan, SceneError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| SceneError::Read { path: path.to_path_buf(), source })?;
        let scene = Plan::parse(&text, path)?;
        let file = scene.mesh.as_ref().ok_or_else(|| SceneError::NoMesh { path: path.to_path_buf() })?;
        let folder = path.parent().unwrap_or(Path::new("."));
        Plan::new(&scene, Mesh::read(&folder.join(file), scene.mesh_unit)?)
    }

    /// Reads a scene from TOML text; `path` is for messages.
    pub fn parse(text: &str, path: &Path) -> Result<Scene, SceneError> {
        toml::from_str(text).map_err(|e| SceneError::Parse { path: path.to_path_buf(), source: Box::new(e) })
    }

    /// A load with the named controls and bodies; those not named are zero and where the mesh has them.
    pub fn load(
        &self,
        controls: &[(&str, f64)],
        poses: &[(&str, crate::body::Pose)],
    ) -> Result<Load, SceneError> {
        let mut load = Load {
            controls: vec![0.0; self.controls.len()],
            poses: vec![Default::default(); self.bodies.len()],
        };
        let mut mistakes = Mistakes::default();
        for (name, value) in controls {
            if let Some(at) = mistakes.keep(find(&self.controls, name, "control")) {
                load.controls[at] = *value;
            }
        }
        for (name, pose) in poses {
            if self.free_bodies.iter().any(|body| body.name == *name) {
                mistakes.add(SceneError::FreePose { body: name.to_string() });
            } else if let Some(at) = mistakes.keep(find(&self.bodies, name, "body")) {
                load.poses[at] = *pose;
            }
        }
        mistakes.keep(self.check_load(&load));
        mistakes.end().map(|()| load)
    }

    /// Refuses a load that is not of this plan: as many controls and poses as the plan has, all finite, and rotations that only turn.
    pub fn check_load(&self, load: &Load) -> Result<(), SceneError> {
        let counts = [
            ("controls", load.controls.len(), self.controls.len()),
            ("poses", load.poses.len(), self.bodies.len()),
        ];
        if let Some((quantity, found, n)) = counts.into_iter().find(|(_, found, n)| found != n) {
            let needed = format!("one per name of the plan: {n}");
            return Err(SceneError::Count { user: "drive".to_string(), quantity, found, needed });
        }
        let mut mistakes = Mistakes::default();
        for (name, value) in self.controls.iter().zip(&load.controls) {
            let what = format!("control `{name}`");
            mistakes.keep(term::check("drive", &what, *value, true, "a finite number"));
        }
        for (name, pose) in self.bodies.iter().zip(&load.poses) {
            let user = format!("drive, pose of body `{name}`");
            for (axis, value) in ["x", "y", "z"].iter().zip(&pose.translation.vector) {
                let what = format!("translation along {axis} [m]");
                mistakes.keep(term::check(&user, &what, *value, true, "a finite number"));
            }
            let norm = pose.rotation.norm();
            let is_unit = (norm - 1.0).abs() < UNIT;
            mistakes.keep(term::check(&user, "length of the rotation's quaternion", norm, is_unit, "1"));
        }
        mistakes.end()
    }

    /// Nodes of the mesh on which a force on one acts in the balance, with the part of it: those of which the node is a fixed mean
    /// ([`Motion::Mean`]), otherwise itself.
    pub(crate) fn bearers(&self, node: u32) -> Mean {
        match self.motion[node as usize][0] {
            Motion::Mean(of) => self.means[of as usize].clone(),
            _ => vec![(node, 1.0)],
        }
    }

    /// Number of unknowns of all islands.
    pub fn n_unknowns(&self) -> usize {
        self.islands.iter().map(|i| i.n_unknowns()).sum()
    }

    /// Positions \[m\] of all nodes as meshed, 3 per node.
    pub fn reference(&self) -> Vec<f64> {
        self.mesh.points.as_flattened().to_vec()
    }
}

/// How far from 1 the length of a rotation's quaternion may be: single precision is enough.
const UNIT: f64 = 1e-6;

fn find(list: &[String], name: &str, what: &'static str) -> Result<usize, SceneError> {
    list.iter().position(|n| n == name).ok_or_else(|| SceneError::Unknown {
        user: "drive".to_string(),
        what,
        name: name.to_string(),
        nearest: nearest(name, list.iter().map(String::as_str)),
    })
}

fn absent(scene: &Scene) -> Vec<&'static str> {
    [
        ("solids", scene.solids.is_empty()),
        ("fibres", scene.fibres.is_empty()),
        ("membranes", scene.membranes.is_empty()),
        ("strands", scene.strands.is_empty()),
        ("gravity", scene.gravity.is_none()),
        ("inertia", scene.inertia.is_none()),
        ("pressures", scene.pressures.is_empty()),
        ("patch pressures", scene.patch_pressures.is_empty()),
        ("forces", scene.forces.is_empty()),
        ("free bodies", scene.free_bodies.is_empty()),
        ("embedded regions", scene.embedded.is_empty()),
        ("contact", scene.contact.is_none()),
    ]
    .into_iter()
    .filter_map(|(name, absent)| absent.then_some(name))
    .collect()
}

/// Contact of a scene, and what had to be changed in the mesh for it.
fn contact(
    scene: &Scene,
    mesh: &mut Mesh,
    motion: &[[Motion; 3]],
) -> Result<(Option<ContactPlan>, Repair), SceneError> {
    let mut contact = contact::contact(scene, mesh, motion)?;
    let repair = contact.as_mut().map(|c| c.mend(mesh, motion)).transpose()?.unwrap_or_default();
    Ok((contact, repair))
}

/// Weights of all solids; none without gravity.
fn weights(scene: &Scene, mesh: &Mesh, names: &mut Names, mistakes: &mut Mistakes) -> Vec<Weights> {
    let Some(gravity) = &scene.gravity else { return Vec::new() };
    let control = names.control(&gravity.control);
    for (axis, a) in ["x", "y", "z"].iter().zip(gravity.acceleration) {
        let what = format!("acceleration along {axis} [m/s^2]");
        mistakes.keep(term::check("gravity", &what, a, true, "a finite number"));
    }
    let of = |spec| mistakes.keep(solids::weights(spec, mesh, gravity.acceleration, control));
    scene.solids.iter().filter_map(of).collect()
}

fn terms(
    scene: &Scene,
    mesh: &Mesh,
    motion: Option<(&[[Motion; 3]], &[Slide])>,
    (weights, embedded_in_grids): (&[Weights], &grid::Embedding),
    own: OwnTerms,
    names: &mut Names,
    mistakes: &mut Mistakes,
) -> Vec<Term> {
    let mut terms = Vec::new();
    for spec in &scene.solids {
        let clusters = embedded_in_grids.clusters_of(&spec.region);
        terms.extend(mistakes.keep(solids::term(spec, mesh, clusters, names)));
    }
    let embedded = scene.fibres.iter().any(|f| matches!(f.course, Course::Embedded(_)));
    let regions: Vec<&str> =
        if embedded { scene.solids.iter().map(|s| s.region.as_str()).collect() } else { vec![] };
    let embedding = Embedding::new(mesh, &regions);
    for spec in &scene.fibres {
        terms.extend(mistakes.keep(lines::fibres(spec, mesh, &embedding, names)));
    }
    for spec in &scene.membranes {
        terms.extend(mistakes.keep(surfaces::membrane(spec, mesh)));
    }
    for spec in &scene.strands {
        terms.extend(mistakes.keep(lines::strands(spec, mesh)));
    }
    let n_deformable = scene.solids.len() + scene.fibres.len() + scene.membranes.len() + scene.strands.len();
    if n_deformable == 0 {
        mistakes.add(SceneError::Empty);
    }
    for spec in &scene.pressures {
        terms.extend(mistakes.keep(surfaces::pressure(spec, mesh, motion, names)));
    }
    for spec in &scene.patch_pressures {
        terms.extend(mistakes.keep(surfaces::patch_pressure(spec, mesh, names)));
    }
    if let Some(first) = weights.first() {
        let mut loads = vec![[0.0; 3]; mesh.points.len()];
        for (&node, force) in weights.iter().flat_map(|w| w.nodes.iter().zip(&w.forces)) {
            for i in 0..3 {
                loads[node as usize][i] += force[i];
            }
        }
        let loads = (0..).zip(loads).filter(|(_, f)| *f != [0.0; 3]).collect();
        terms.push(dead_load("gravity", first.control, loads));
    }
    for spec in &scene.forces {
        let control = names.control(&spec.control);
        if mistakes.keep(check_forces(spec, mesh)).is_some() {
            terms.push(dead_load(&spec.name, control, spec.loads.clone()));
        }
    }
    terms.extend(mistakes.keep(own(mesh, names)).into_iter().flatten());
    for (i, t) in terms.iter().enumerate() {
        if terms[..i].iter().any(|o| o.name == t.name) {
            mistakes.add(SceneError::Twice { what: "effect", name: t.name.clone() });
        }
    }
    terms
}

/// Refuses forces on nodes that the mesh lacks, and what is not a number.
fn check_forces(spec: &ForceSpec, mesh: &Mesh) -> Result<(), SceneError> {
    let (user, n) = (format!("force `{}`", spec.name), mesh.points.len());
    for (node, force) in &spec.loads {
        term::check(&user, "node", f64::from(*node), (*node as usize) < n, "a node of the mesh")?;
        force.iter().try_for_each(|f| term::check(&user, "force [N]", *f, true, "a finite number"))?;
    }
    Ok(())
}

fn dead_load(name: &str, control: usize, loads: Vec<(u32, [f64; 3])>) -> Term {
    let nodes = loads.iter().map(|l| l.0).collect();
    let build: term::Builder = Box::new(move |name, _, nodes, groups| {
        let loads: Vec<_> = groups.iter().zip(nodes).map(|(&g, &n)| (n, loads[g as usize].1)).collect();
        Ok(Box::new(DeadLoad::new(name, control, &loads)) as Box<dyn Effect>)
    });
    Term { name: name.to_string(), nodes_per_group: 1, nodes, couples: false, build }
}

/// Centre of the nodes that move with each body.
fn pivots(mesh: &Mesh, motion: &[[Motion; 3]], n_bodies: usize) -> Vec<[f64; 3]> {
    let mut sums = vec![([0.0; 3], 0.0); n_bodies];
    for (m, p) in motion.iter().zip(&mesh.points) {
        if let Motion::Body(b) = m[0] {
            for i in 0..3 {
                sums[b].0[i] += p[i];
            }
            sums[b].1 += 1.0;
        }
    }
    sums.into_iter().map(|(sum, n): ([f64; 3], f64)| sum.map(|s| s / n.max(1.0))).collect()
}

/// Splits the terms into islands: nodes connected through groups, without passing through nodes that are prescribed.
fn islands(
    mesh: &Mesh,
    terms: &[Term],
    motions: Motions,
    pivots: &Arc<Vec<[f64; 3]>>,
    n_controls: usize,
    contact: Option<&ContactPlan>,
) -> Result<Vec<Arc<Island>>, SceneError> {
    let n = mesh.points.len();
    let is_free = |node: u32| motions.motion[node as usize].iter().any(Motion::is_unknown);
    let mut parent: Vec<u32> = (0..n as u32).collect();
    let mut unite = |a: u32, b: u32| {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b) as usize] = a.min(b);
    };
    for node in 0..n as u32 {
        for leader in motions.leaders(node) {
            unite(node, leader);
        }
    }
    for term in terms.iter().filter(|t| t.couples) {
        for group in term.nodes.chunks_exact(term.nodes_per_group) {
            let mut free = group.iter().filter(|&&n| n != NO_NODE && is_free(n));
            if let Some(first) = free.next() {
                free.for_each(|n| unite(*first, *n));
            }
        }
    }
    // Surfaces that may touch make one island of what they belong to.
    for &[a, b] in contact.iter().flat_map(|c| &c.pairs) {
        let surfaces = &contact.expect("it has pairs").surfaces;
        let mut free = surfaces[a].nodes.iter().chain(&surfaces[b].nodes).filter(|n| is_free(**n));
        if let Some(first) = free.next() {
            free.for_each(|n| unite(*first, *n));
        }
    }
    // The island of a group is that of its free nodes; one without any goes with an island that has its nodes among the
    // prescribed ones.
    let mut at_prescribed = std::collections::BTreeMap::<u32, u32>::new();
    for group in terms.iter().flat_map(|t| t.nodes.chunks_exact(t.nodes_per_group)) {
        if let Some(&free) = group.iter().find(|&&n| n != NO_NODE && is_free(n)) {
            let root = root(&mut parent, free);
            for &n in group.iter().filter(|&&n| n != NO_NODE && !is_free(n)) {
                at_prescribed.entry(n).or_insert(root);
            }
        }
    }
    let mut root_of = |group: &[u32]| match group.iter().find(|&&n| n != NO_NODE && is_free(n)) {
        Some(&free) => root(&mut parent, free),
        None => group.iter().find_map(|n| at_prescribed.get(n)).copied().unwrap_or(group[0]),
    };
    let mut of_root = std::collections::BTreeMap::<u32, Vec<Vec<u32>>>::new();
    for (t, term) in terms.iter().enumerate() {
        for (g, group) in term.nodes.chunks_exact(term.nodes_per_group).enumerate() {
            let groups = of_root.entry(root_of(group)).or_insert_with(|| vec![vec![]; terms.len()]);
            groups[t].push(g as u32);
        }
    }
    // What is a mean of nodes of an island moves with it, whether something acts on it or not.
    let mut led = std::collections::BTreeMap::<u32, Vec<u32>>::new();
    for node in (0..n as u32).filter(|&n| matches!(motions.motion[n as usize][0], Motion::Mean(_))) {
        led.entry(root(&mut parent, node)).or_default().push(node);
    }
    let mut islands = Vec::new();
    for (of, groups) in of_root {
        let members = contact.map_or(Vec::new(), |c| {
            let mine =
                |s: &usize| c.surfaces[*s].nodes.iter().any(|&n| is_free(n) && root(&mut parent, n) == of);
            let soft: Vec<usize> = (0..c.surfaces.len()).filter(mine).collect();
            let meets =
                |s: &usize| c.pairs.iter().any(|p| p.contains(s) && p.iter().any(|o| soft.contains(o)));
            (0..c.surfaces.len())
                .filter(|s| meets(s) && (soft.contains(s) || !c.surfaces[*s].deforms))
                .collect()
        });
        let members = contact.map(|c| (c, members.as_slice())).filter(|(_, m)| !m.is_empty());
        islands.push(Arc::new(island(
            mesh,
            terms,
            motions,
            pivots,
            n_controls,
            groups,
            (members, led.remove(&of).unwrap_or_default()),
        )?));
    }
    Ok(islands)
}

fn root(parent: &mut [u32], mut n: u32) -> u32 {
    while parent[n as usize] != n {
        parent[n as usize] = parent[parent[n as usize] as usize];
        n = parent[n as usize];
    }
    n
}

/// The island of some groups of each term.
fn island(
    mesh: &Mesh,
    terms: &[Term],
    motions: Motions,
    pivots: &Arc<Vec<[f64; 3]>>,
    n_controls: usize,
    groups: Vec<Vec<u32>>,
    (contact, led): (Option<(&ContactPlan, &[usize])>, Vec<u32>),
) -> Result<Island, SceneError> {
    let Motions { motion, slides, free, .. } = motions;
    let members = |t: usize| {
        let m = terms[t].nodes_per_group;
        groups[t].iter().flat_map(move |&g| &terms[t].nodes[m * g as usize..m * (g as usize + 1)]).copied()
    };
    let mut nodes: Vec<u32> = (0..terms.len()).flat_map(members).filter(|&n| n != NO_NODE).collect();
    if let Some((plan, members)) = contact {
        members.iter().for_each(|&s| nodes.extend(&plan.surfaces[s].nodes));
    }
    nodes.extend(led);
    nodes.sort_unstable();
    nodes.dedup();
    let leaders: Vec<u32> = nodes.iter().flat_map(|&n| motions.leaders(n)).collect();
    nodes.extend(leaders);
    nodes.sort_unstable();
    nodes.dedup();
    let local = |n: u32| if n == NO_NODE { NO_NODE } else { nodes.binary_search(&n).expect("listed") as u32 };
    let points: Vec<[f64; 3]> = nodes.iter().map(|&n| mesh.points[n as usize]).collect();
    let (mut effects, mut cells, mut name) = (Vec::new(), Vec::new(), None);
    for (t, term) in terms.iter().enumerate().filter(|(t, _)| !groups[*t].is_empty()) {
        let places: Vec<u32> = members(t).map(local).collect();
        let effect = (term.build)(&term.name, &points, &places, &groups[t])?;
        cells.push(effect.cells().map_or_else(|| groups[t].clone(), <[u32]>::to_vec));
        effects.push(effect);
        name.get_or_insert(&term.name);
    }
    let mut sliding = std::collections::BTreeMap::new();
    for (i, &n) in (0..).zip(&nodes) {
        if let Motion::Slides(of) = motion[n as usize][0] {
            let mut slide = slides[of as usize].clone();
            if let Some((leader, ..)) = &mut slide.follows {
                *leader = local(*leader);
            }
            sliding.insert(i, slide);
        }
    }
    let means = (0..).zip(&nodes).filter_map(|(i, &n)| {
        let mean = motions.mean(n, mesh.points[n as usize])?;
        Some((i, mean.into_iter().map(|(of, w)| (local(of), w)).collect()))
    });
    let means = means.collect();
    let motion = nodes.iter().map(|&n| {
        motion[n as usize].map(|m| match m {
            Motion::Follows(master) => Motion::Follows(local(master)),
            other => other,
        })
    });
    let (name, motion) = (name.cloned().unwrap_or_default(), motion.collect());
    let X = points.as_flattened().to_vec();
    let motion: Vec<[Motion; 3]> = motion;
    let contact = contact.and_then(|(plan, members)| {
        plan.on_island(members, |n| nodes.binary_search(&n).ok().map(|i| i as u32), &points, &motion)
    });
    let bodies = free.iter().filter(|body| nodes.binary_search(&body.frame[0]).is_ok());
    let bodies = bodies.map(|body| FreeBody { frame: body.frame.map(local), ..body.clone() }).collect();
    let mut island =
        Island::new(name, nodes, X, effects, cells, motion, sliding, means, pivots.clone(), n_controls);
    (island.bodies, island.contact) = (bodies, contact.map(Arc::new));
    Ok(island)
}
