//! A muscle of the thigh by itself, as calibration looks at it.

use crate::thigh::build::Thigh;

/// One muscle (by its number) with its tendons and nothing else; nodes are numbered anew in the same order.
pub fn alone(thigh: &Thigh, muscle: usize) -> Thigh {
    let own = &thigh.muscles[muscle];
    let part = format!("{}/", own.name);
    let is_own = |name: &str| name == own.name || name.starts_with(&part);

    let mut mesh = thigh.mesh.clone();
    mesh.blocks.retain(|b| is_own(&b.name));
    mesh.node_sets.retain(|name, _| is_own(name));
    mesh.surfaces.retain(|name, _| is_own(name));
    let mut kept: Vec<u32> = mesh.blocks.iter().flat_map(|b| &b.nodes).copied().collect();
    kept.sort_unstable();
    kept.dedup();
    let number = |n: &mut u32| *n = kept.binary_search(n).expect("parts of a muscle share its nodes") as u32;
    mesh.points = kept.iter().map(|&n| thigh.mesh.points[n as usize]).collect();
    mesh.blocks.iter_mut().flat_map(|b| &mut b.nodes).for_each(number);
    mesh.node_sets.values_mut().flatten().for_each(number);
    mesh.surfaces.values_mut().flatten().flatten().for_each(number);

    let mut scene = thigh.scene.clone();
    scene.solids.retain(|s| is_own(&s.region));
    scene.fibres.retain(|f| is_own(&f.name));
    scene.membranes.retain(|m| is_own(&m.region));
    scene.strands.retain(|s| is_own(&s.region));
    scene.ties.retain(|t| is_own(&t.nodes));
    scene.contact = None;

    let mut muscle = own.clone();
    number(&mut muscle.first_node);
    muscle.tied.values_mut().flatten().for_each(number);
    // Its solid tendon is in mesh and scene; what sews it to others is not.
    Thigh { mesh, scene, muscles: vec![muscle], tendons: Vec::new() }
}
