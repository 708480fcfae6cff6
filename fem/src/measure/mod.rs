//! Measures: what people want to know of a state. Section forces, reactions, energies, volume, stress, fibre stretch.

mod condensed;
mod field;
mod section;
mod sides;

pub use condensed::condensed_stiffness;
pub use field::{
    EffectEnergy, FibreState, SolidField, energies, fibre_states, kinetic_energy, membrane_field,
    solid_field, volume,
};
pub use section::{Cut, SectionForce, section_force};
pub use sides::Sides;

pub use crate::contact::PairForce;

use crate::body::Wrench;
use crate::effect::State;
use crate::plan::{Load, Motion, Plan, on_supports};

/// Positions of all nodes of the mesh \[m\] under a load: what measures look at.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// Positions \[m\], 3 per node of the mesh.
    pub x: &'a [f64],
    /// The load.
    pub load: &'a Load,
}

/// Contact of every pair of surfaces within reach of each other; moments about `about` \[m\].
pub fn pair_forces(plan: &Plan, at: Snapshot, about: [f64; 3]) -> Vec<PairForce> {
    let of = |island: &std::sync::Arc<crate::plan::Island>| {
        let contact = island.contact.as_ref()?;
        Some(contact.pair_forces(&island.gather(at.x), about))
    };
    plan.islands.iter().filter_map(of).flatten().collect()
}

/// Pairs of surfaces that take part in contact, with how many pairs of their prescribed triangles intersect under a load and did not in
/// the mesh (as ends of muscles in bones do): contact looks at no pair of which both sides are prescribed. Exact.
pub fn prescribed_overlaps(plan: &Plan, load: &Load) -> Vec<([String; 2], usize)> {
    let start = plan.load(&[], &[]).expect("nothing is named");
    let before = prescribed_intersections(plan, &start);
    let mut now = prescribed_intersections(plan, load);
    now.retain(|(names, _)| before.iter().all(|(known, _)| known != names));
    now
}

fn prescribed_intersections(plan: &Plan, load: &Load) -> Vec<([String; 2], usize)> {
    let Some(contact) = plan.contact() else { return Vec::new() };
    let mut places = plan.mesh.points.clone();
    for (n, place) in places.iter_mut().enumerate() {
        load.prescribe(&plan.motion[n], &plan.mesh.points[n], place);
    }
    let is_prescribed =
        |face: &&[u32; 4]| face.iter().all(|&n| !plan.motion[n as usize].iter().any(Motion::is_unknown));
    let surface = |s: &crate::plan::ContactSurface| {
        let faces: Vec<[u32; 4]> = s.faces.iter().filter(is_prescribed).copied().collect();
        let (surface, _) = crate::geometry::Surface::from_faces(&places, &faces);
        crate::geometry::SearchSurface::new(surface)
    };
    let surfaces: Vec<_> = contact.surfaces.iter().map(surface).collect();
    let pairs = (0..surfaces.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
    let counted = pairs.map(|[a, b]| ([a, b], surfaces[a].intersections(&surfaces[b]).len()));
    let names = |pair: [usize; 2]| pair.map(|s| contact.surfaces[s].name.clone());
    counted.filter(|(_, n)| *n > 0).map(|(pair, n)| (names(pair), n)).collect()
}

/// Energy \[J\] of contact; 0 where there is none.
pub fn contact_energy(plan: &Plan, at: Snapshot) -> f64 {
    let of = |island: &std::sync::Arc<crate::plan::Island>| {
        island.contact.as_ref().map(|contact| contact.energy(&island.gather(at.x), 0.0))
    };
    plan.islands.iter().filter_map(of).sum()
}

/// Contact force per reference area \[Pa\] at the nodes of a contact surface: (node of the mesh, vector); empty for a surface
/// that touches nothing. Of a rigid surface only the nodes that something may touch.
pub fn contact_tractions(plan: &Plan, at: Snapshot, surface: &str) -> Vec<(u32, [f64; 3])> {
    let mut all = std::collections::BTreeMap::<u32, [f64; 3]>::new();
    for island in &plan.islands {
        let Some(contact) = &island.contact else { continue };
        let Some(index) = contact.surface(surface) else { continue };
        for (node, t) in contact.pressures(index, &island.gather(at.x)) {
            let sum = all.entry(island.nodes[node as usize]).or_default();
            (0..3).for_each(|c| sum[c] += t[c]);
        }
    }
    all.into_iter().collect()
}

/// The triangles of all contact surfaces by name, as contact sees them: of these no two that may meet intersect.
pub fn collision_surfaces(plan: &Plan, at: Snapshot) -> Vec<(String, crate::geometry::Surface)> {
    let mut all = std::collections::BTreeMap::new();
    for island in &plan.islands {
        let Some(contact) = &island.contact else { continue };
        let x = island.gather(at.x);
        for (index, surface) in contact.surfaces.list.iter().enumerate() {
            all.entry(surface.name.clone()).or_insert_with(|| contact.triangles(index, &x));
        }
    }
    all.into_iter().collect()
}

/// Surfaces that intersect where they take notice of each other: both names and the number of pairs of triangles. Exact, and by other
/// means than those by which contact keeps them apart.
pub fn intersections(plan: &Plan, at: Snapshot) -> Vec<([String; 2], usize)> {
    let mut found = Vec::new();
    for island in &plan.islands {
        let Some(contact) = &island.contact else { continue };
        let name = |s: usize| contact.surfaces.list[s].name.clone();
        let met = contact.intersections(&island.gather(at.x));
        found.extend(met.into_iter().map(|(pair, n)| (pair.map(name), n)));
    }
    found
}

/// ∂Π/∂x \[N\] of all nodes of the mesh, 3 per node: zero at free nodes in equilibrium, the force of the support where
/// a component is prescribed. Inertia is left out: in motion it is what is left at free nodes.
pub fn nodal_forces(plan: &Plan, at: Snapshot) -> Vec<f64> {
    let mut total = vec![0.0; at.x.len()];
    for island in &plan.islands {
        let x = island.gather(at.x);
        let s = State { x: &x, controls: &at.load.controls };
        let effects = (0..island.effects.len()).map(|e| island.effect_gradient(e, &s));
        for g in effects.chain(island.contact_gradient(&x)) {
            for (&n, g) in island.nodes.iter().zip(g.chunks_exact(3)) {
                for i in 0..3 {
                    total[3 * n as usize + i] += g[i];
                }
            }
        }
    }
    total
}

/// Force and moment \[N, N·m, about `about` in m\] of the pressure on a surface, as it is now; `None` where there is none. Its negative is what
/// the same pressure exerts on all openings of the surface together.
pub fn pressure_wrench(plan: &Plan, at: Snapshot, surface: &str, about: [f64; 3]) -> Option<Wrench> {
    let names =
        [crate::effect::Pressure::NAME, crate::effect::PatchPressure::NAME].map(|n| format!("{n}{surface}"));
    let mut wrench = None;
    for island in &plan.islands {
        let x = island.gather(at.x);
        let s = State { x: &x, controls: &at.load.controls };
        for (e, _) in island.effects.iter().enumerate().filter(|(_, e)| names.iter().any(|n| n == e.name())) {
            let sum = wrench.get_or_insert_with(Wrench::default);
            for (x, g) in x.chunks_exact(3).zip(island.effect_gradient(e, &s).chunks_exact(3)) {
                sum.add(std::array::from_fn(|c| x[c] - about[c]), [-g[0], -g[1], -g[2]]);
            }
        }
    }
    wrench
}

/// Force and moment \[N, N·m, about `about` in m\] that the supports exert on the nodes of `nodes`, by what is prescribed of them.
///
/// Pressure acts on the surfaces that the scene names and on nothing else: where such a surface is open, the force of a support along its
/// rim is that of the tissue alone, the resultant of the stress in it, without the pressure on the opening ([`pressure_wrench`] has that).
pub fn support_wrench(plan: &Plan, at: Snapshot, nodes: &[u32], about: [f64; 3]) -> Wrench {
    support_wrench_of(plan, at, &nodal_forces(plan, at), nodes, about)
}

/// The same, given the [`nodal_forces`] `g`: for many supports of one state.
pub fn support_wrench_of(plan: &Plan, at: Snapshot, g: &[f64], nodes: &[u32], about: [f64; 3]) -> Wrench {
    let mut wrench = Wrench::default();
    for &n in nodes {
        let i = 3 * n as usize;
        let motion = &plan.motion[n as usize];
        let slide = match motion[0] {
            Motion::Slides(of) => Some(&plan.slides[of as usize]),
            _ => None,
        };
        let f = on_supports(motion, slide, [g[i], g[i + 1], g[i + 2]].into());
        wrench.add(std::array::from_fn(|c| at.x[i + c] - about[c]), f.into());
    }
    wrench
}

/// A free body under a load.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeBodyState {
    /// Name as in the scene.
    pub name: String,
    /// Its pose: where its points are that are given in the mesh.
    pub pose: crate::body::Pose,
    /// What is left of all forces on it, moments about the place of its origin; also what holds its held coordinates.
    pub residual: Wrench,
    /// Greatest strain of its frame: so far is it from rigid.
    pub strain: f64,
}

/// Every free body, in the order of [`Plan::free_bodies`].
pub fn free_bodies(plan: &Plan, at: Snapshot) -> Vec<FreeBodyState> {
    let g = if plan.free_bodies.is_empty() { Vec::new() } else { nodal_forces(plan, at) };
    let of = |(b, body): (usize, &crate::plan::FreeBody)| {
        let pose = body.pose(at.x);
        let origin = pose * nalgebra::Point3::from(body.origin);
        let rides = |n: &usize| plan.motion[*n][0] == Motion::Rides(b);
        let nodes = (0..plan.motion.len()).filter(rides).chain(body.frame.map(|n| n as usize));
        let mut residual = Wrench::default();
        for n in nodes {
            let arm = std::array::from_fn(|c| at.x[3 * n + c] - origin[c]);
            residual.add(arm, std::array::from_fn(|c| -g[3 * n + c]));
        }
        FreeBodyState { name: body.name.clone(), pose, residual, strain: body.strain(at.x) }
    };
    plan.free_bodies.iter().enumerate().map(of).collect()
}

/// Wrench \[N, N·m, about the current place of the body's `about`, m of the mesh\] of the tissue on each body, in the
/// order of [`Plan::bodies`].
pub fn body_wrenches(plan: &Plan, at: Snapshot, about: &[[f64; 3]]) -> Vec<Wrench> {
    let g = nodal_forces(plan, at);
    let mut wrenches = vec![Wrench::default(); plan.bodies.len()];
    for (n, motion) in plan.motion.iter().enumerate() {
        if let Motion::Body(b) = motion[0] {
            let centre = at.load.poses[b] * nalgebra::Point3::from(about[b]);
            let arm = std::array::from_fn(|c| at.x[3 * n + c] - centre[c]);
            wrenches[b].add(arm, std::array::from_fn(|c| -g[3 * n + c]));
        }
    }
    wrenches
}
