//! A muscle of the thigh by itself, as calibration looks at it.

use mesher::part::muscle_of;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::fibres::cache::{Cache, content_hash};
use crate::thigh::build::Thigh;

/// One muscle (by its number) with its tendons and nothing else; nodes are numbered anew in the same order.
pub fn alone(thigh: &Thigh, muscle: usize) -> Thigh {
    let own = &thigh.muscles[muscle];
    let is_own = |name: &str| muscle_of(name) == own.name;

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
    scene.embedded.retain(|e| is_own(&e.region));
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

/// Calibrates some muscles of a thigh, by their numbers, each by itself and all in parallel: as `cache` has it, or by `find`, which gets the number of the
/// muscle and the muscle [`alone`]. `depends` says what the result depends on besides that, with numbers that read back the same.
pub fn calibrate_each<T, E>(
    thigh: &Thigh,
    which: &[usize],
    cache: Option<&Cache>,
    depends: impl Fn(usize) -> String + Sync,
    find: impl Fn(usize, &Thigh) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E>
where
    T: Serialize + DeserializeOwned + Send,
    E: Send,
{
    let one = |&i: &usize| {
        let muscle = alone(thigh, i);
        let Some(cache) = cache else { return find(i, &muscle) };
        let rest = format!("{}{:?}{:?}", depends(i), muscle.scene, muscle.muscles);
        let what = format!("the calibration of {}", muscle.muscles[0].name);
        cache.get_or(&content_hash(&muscle.mesh, &rest), &what, || find(i, &muscle))
    };
    // One muscle after the other on each core: they differ tenfold in work.
    let all: Vec<_> = which.par_iter().with_max_len(1).map(one).collect();
    all.into_iter().collect()
}
