//! From sections to meshes that keep apart: filling, smoothing, separating.

use rayon::prelude::*;

use super::grid::{self, Coarser, SectionKind};
use super::separate::{Planes, Skin, planes};
use super::smooth::Smoother;
use super::{Bone, Loft, MuscleBlock, MuscleSections, N_OUTLINE, to_mesh};
use crate::geometry::{SignedDistance, Surface};
use crate::mesh::quality::Quality;

/// Goals that a mesh is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goals {
    /// Least scaled Jacobian of a cell.
    pub least_scaled_jacobian: f64,
    /// Mean scaled Jacobian of a muscle.
    pub mean_scaled_jacobian: f64,
    /// Least distance between muscles \[m\].
    pub gap: f64,
    /// Distance from the loft that 95 % of the surface nodes keep \[m\].
    pub deviation: f64,
    /// Relative error of the volume.
    pub volume: f64,
    /// Deepest crossing of a muscle with a bone at an attached end \[m\].
    pub bone_depth: f64,
}

/// The goals of the built-in thigh.
pub const GOALS: Goals = Goals {
    least_scaled_jacobian: 0.3,
    mean_scaled_jacobian: 0.75,
    gap: 0.2e-3,
    deviation: 1e-3,
    volume: 0.05,
    bone_depth: 2e-3,
};

/// Smoothing before the muscles see each other: sharpness and steps of each round.
const ALONE: [(f64, usize); 5] = [(3.0, 40), (6.0, 40), (12.0, 40), (20.0, 40), (20.0, 60)];
/// The same after a start from a coarser mesh, which meshes with edges shorter than this have \[m\].
const REFINED: [(f64, usize); 2] = [(12.0, 40), (20.0, 60)];
const FINE: f64 = 4.5e-3;
/// Sharpness and steps of a round of smoothing among neighbours, and how many at most.
const TOGETHER: (f64, usize) = (20.0, 30);
const MOST_ROUNDS: usize = 12;
/// Rounds after which surface nodes are anchored.
const SLIDING_ROUNDS: usize = 3;
/// Triangles closer than this are kept in view \[m\].
const VIEW: f64 = 0.8e-3;
/// Distance aimed at, in goals: springs give a little.
const AIM: f64 = 1.3;
/// Distance of a muscle, but for its end layers, to the bones that ends the rounds early \[m\].
const BONE_GAP: f64 = 0.05e-3;
/// The last interval is cut where a border advances more than this share of the muscle's length in it, and more than this many times
/// as far as another: its cells would be slivers.
const MOST_ADVANCE: f64 = 0.25;
const MOST_UNEVEN: f64 = 10.0;
/// Where the line ends when the last interval is cut.
const CUT_END: f64 = 0.95;

/// What became of one muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleResult {
    /// The mesh.
    pub block: MuscleBlock,
    /// How its sections are divided.
    pub kind: SectionKind,
    /// Shape of its cells.
    pub quality: Quality,
    /// Volume of the loft from the origin to the end of the mesh \[m³\].
    pub loft_volume: f64,
    /// Distances of the nodes of the lateral surface from the loft: mean, 95 % and largest \[m\].
    pub deviation: [f64; 3],
    /// Least distance to another muscle \[m\] and which; `None` without another.
    pub gap: Option<(f64, usize)>,
    /// Triangles of its surface that meet others of its own.
    pub self_crossings: usize,
}

/// A muscle that reaches into a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneCrossing {
    /// Index of the muscle.
    pub muscle: usize,
    /// Index of the bone.
    pub bone: usize,
    /// Deepest node of either in the other \[m\]; zero where only edges cross.
    pub depth: f64,
    /// Layers of the muscle's cells that cross, first and last.
    pub layers: [usize; 2],
}

/// Meshes of muscles that keep apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Built {
    /// In the order of the sections.
    pub muscles: Vec<MuscleResult>,
    /// Where muscles reach into bones.
    pub bone_crossings: Vec<BoneCrossing>,
    /// Rounds of smoothing among neighbours.
    pub rounds: usize,
}

impl Built {
    /// Goals that are missed, one sentence each; empty where all are reached.
    pub fn missed(&self, bones: &[Bone]) -> Vec<String> {
        let mut missed = Vec::new();
        for m in &self.muscles {
            let name = &m.block.name;
            let mut check = |reached: bool, what: String| {
                if !reached {
                    missed.push(format!("{name}: {what}"));
                }
            };
            let q = &m.quality;
            let (least, mean) = (GOALS.least_scaled_jacobian, GOALS.mean_scaled_jacobian);
            check(
                q.least_scaled_jacobian >= least,
                format!("least scaled Jacobian {:.3}, wanted {least}", q.least_scaled_jacobian),
            );
            check(
                q.mean_scaled_jacobian >= mean,
                format!("mean scaled Jacobian {:.3}, wanted {mean}", q.mean_scaled_jacobian),
            );
            check(q.least_gauss_det > 0.0, format!("det J {:.2e} m³ at a Gauss point", q.least_gauss_det));
            check(
                m.deviation[1] <= GOALS.deviation,
                format!("95 % of the surface nodes within {:.2} mm of the loft", m.deviation[1] * 1e3),
            );
            let volume = q.volume / m.loft_volume - 1.0;
            check(volume.abs() <= GOALS.volume, format!("volume off by {:.1} %", volume * 100.0));
            if let Some((gap, other)) = m.gap {
                let other = &self.muscles[other].block.name;
                check(
                    gap >= GOALS.gap,
                    format!("gap {:.3} mm to {other}, wanted {} mm", gap * 1e3, GOALS.gap * 1e3),
                );
            }
            check(m.self_crossings == 0, format!("{} pairs of surface triangles cross", m.self_crossings));
        }
        for c in &self.bone_crossings {
            let m = &self.muscles[c.muscle].block;
            let last = m.n_layers() - 2;
            let (name, bone) = (&m.name, &bones[c.bone].name);
            if c.layers != [0, 0] && c.layers != [last, last] {
                missed.push(format!("{name}: crosses {bone} in layers {:?} of {last}", c.layers));
            }
            if !(c.depth <= GOALS.bone_depth) {
                missed.push(format!("{name}: {:.2} mm deep in {bone} at its end", c.depth * 1e3));
            }
        }
        missed
    }
}

/// Meshes muscles with edges of about `edge` \[m\], keeps them [`Goals::gap`] apart and out of the bones.
///
/// The same on any number of threads. Whether the goals are reached stands in the result.
pub fn build(sections: &[MuscleSections], bones: &[Bone], edge: f64) -> Built {
    let mut muscles: Vec<(Smoother, SectionKind)> =
        sections.par_iter().map(|muscle| mesh_alone(muscle, edge)).collect();
    let mut skins: Vec<Skin> = muscles.iter().map(|(m, _)| skin(&m.block)).collect();
    let bone_skins: Vec<Skin> = bones
        .iter()
        .map(|b| Skin::new(b.surface.clone(), (0..b.surface.points.len() as u32).collect()))
        .collect();
    let mut rounds = 0;
    while rounds < MOST_ROUNDS {
        let [to_muscles, to_bones] = meet(&mut muscles, &skins, &bone_skins);
        let apart = to_muscles >= GOALS.gap && to_bones >= BONE_GAP;
        // Moving apart bends cells; they recover in a further round.
        if apart && muscles.par_iter().all(|(m, _)| is_good(&shape(&m.block))) {
            break;
        }
        muscles.par_iter_mut().for_each(|(m, _)| {
            m.anchored = rounds >= SLIDING_ROUNDS;
            m.smooth(TOGETHER.0, TOGETHER.1);
        });
        skins.iter_mut().zip(&muscles).for_each(|(skin, (m, _))| skin.update(&m.block.points));
        rounds += 1;
    }
    let gaps = least_gaps(&skins);
    let results: Vec<MuscleResult> = muscles
        .into_par_iter()
        .zip(&skins)
        .zip(gaps)
        .map(|(((m, kind), skin), gap)| {
            let quality = shape(&m.block);
            let mut away: Vec<f64> = m.deviations().into_iter().map(f64::abs).collect();
            away.sort_by(f64::total_cmp);
            let mean = away.iter().sum::<f64>() / away.len() as f64;
            let deviation = [mean, away[away.len() * 95 / 100], away[away.len() - 1]];
            let self_crossings = skin.search.self_intersections().len();
            MuscleResult {
                kind,
                quality,
                loft_volume: m.volume,
                deviation,
                gap,
                self_crossings,
                block: m.block,
            }
        })
        .collect();
    let bone_crossings = crossings(&results, &skins, &bone_skins);
    Built { muscles: results, bone_crossings, rounds }
}

/// Where the mesh of a muscle ends: at s = 1, or before a last interval whose borders advance too differently.
pub fn mesh_end(sections: &MuscleSections) -> f64 {
    let [.., before, last] = &sections.stations[..] else { return 1.0 };
    let advance = (0..N_OUTLINE).map(|k| (last.outline[k] - before.outline[k]).norm());
    let (least, most) = advance.fold((f64::INFINITY, 0.0f64), |(a, b), d| (a.min(d), b.max(d)));
    if most > MOST_UNEVEN * least && most > MOST_ADVANCE * grid::mean_size(sections)[2] {
        CUT_END.max(before.s)
    } else {
        1.0
    }
}

/// Volume of the loft up to `s_end` \[m³\].
pub fn loft_volume(loft: &Loft, s_end: f64) -> f64 {
    const LAYERS: usize = 100;
    let fine = SectionKind::Plain { across: 20, through: 8 }.grid();
    grid::fill("", loft, &fine, (0..=LAYERS).map(|i| s_end * i as f64 / LAYERS as f64).collect()).volume()
}

/// One muscle by itself: with rings, or plain where rings do not reach the goals and plain is better. Fine meshes start from a
/// coarser one, which has untangled the cells and placed the nodes for little.
fn mesh_alone(sections: &MuscleSections, edge: f64) -> (Smoother, SectionKind) {
    let loft = Loft::new(sections);
    let s_end = mesh_end(sections);
    let volume = loft_volume(&loft, s_end);
    let unsmoothed = |kind: SectionKind| {
        let block = grid::fill(&sections.name, &loft, &kind.grid(), grid::layers(sections, edge, s_end));
        Smoother::new(block, loft.clone(), volume)
    };
    let smoothed = |mut smoother: Smoother, schedule: &[(f64, usize)]| {
        for &(k, steps) in schedule {
            smoother.smooth(k, steps);
        }
        let quality = shape(&smoother.block);
        (smoother, quality)
    };
    if edge < FINE {
        let (coarse, coarse_kind) = mesh_alone(sections, 2.0 * edge);
        let kind = match coarse_kind {
            SectionKind::Rings { .. } => SectionKind::rings(sections, edge),
            SectionKind::Plain { .. } => SectionKind::plain(sections, edge),
        };
        let map = Coarser::new(coarse_kind, kind).expect("kinds are the same");
        let mut fine = unsmoothed(kind);
        fine.start_from(&coarse, &map);
        return (smoothed(fine, &REFINED).0, kind);
    }
    let kind = SectionKind::rings(sections, edge);
    let (rings, quality) = smoothed(unsmoothed(kind), &ALONE);
    if is_good(&quality) {
        return (rings, kind);
    }
    let plain_kind = SectionKind::plain(sections, edge);
    let (plain, plain_quality) = smoothed(unsmoothed(plain_kind), &ALONE);
    if plain_quality.least_scaled_jacobian > quality.least_scaled_jacobian {
        (plain, plain_kind)
    } else {
        (rings, kind)
    }
}

/// Shape of the cells of a muscle.
fn shape(block: &MuscleBlock) -> Quality {
    let mesh = to_mesh(std::slice::from_ref(block));
    mesh.quality(&mesh.blocks[0]).expect("a muscle has cells")
}

fn is_good(quality: &Quality) -> bool {
    quality.least_scaled_jacobian >= GOALS.least_scaled_jacobian
        && quality.mean_scaled_jacobian >= GOALS.mean_scaled_jacobian
        && quality.least_gauss_det > 0.0
}

fn skin(block: &MuscleBlock) -> Skin {
    let (surface, nodes) = Surface::from_faces(&block.points, &block.surface());
    Skin::new(surface, nodes)
}

/// Pairs of muscles and pairs of muscle and bone whose boxes come within the view.
fn near_pairs(skins: &[Skin], bones: &[Skin]) -> (Vec<[usize; 2]>, Vec<[usize; 2]>) {
    let mut between = Vec::new();
    let mut to_bone = Vec::new();
    for (i, skin) in skins.iter().enumerate() {
        between.extend((i + 1..skins.len()).filter(|&j| skin.is_near(&skins[j], VIEW)).map(|j| [i, j]));
        to_bone.extend((0..bones.len()).filter(|&j| skin.is_near(&bones[j], VIEW)).map(|j| [i, j]));
    }
    (between, to_bone)
}

/// Gives every muscle the planes of its neighbours, and returns the least distances \[m\] (at most the view) between two muscles,
/// and from a muscle but for its end layers to a bone.
fn meet(muscles: &mut [(Smoother, SectionKind)], skins: &[Skin], bones: &[Skin]) -> [f64; 2] {
    let (between, to_bone) = near_pairs(skins, bones);
    let aim = AIM * GOALS.gap;
    let of_muscles: Vec<(Planes, f64)> = between
        .par_iter()
        .map(|&[i, j]| {
            let pairs = skins[i].search.pairs_within(&skins[j].search, VIEW);
            let least = pairs.iter().map(|p| p.closest.distance).fold(VIEW, f64::min);
            (planes(&skins[i], &skins[j], &pairs, aim, 0.5), least)
        })
        .collect();
    let of_bones: Vec<(Planes, f64)> = to_bone
        .par_iter()
        .map(|&[i, j]| {
            let mut pairs = skins[i].search.pairs_within(&bones[j].search, VIEW);
            pairs.retain(|p| !skins[i].nodes_of(p.a).iter().any(|&n| muscles[i].0.is_end(n)));
            let least = pairs.iter().map(|p| p.closest.distance).fold(VIEW, f64::min);
            (planes(&skins[i], &bones[j], &pairs, aim, 1.0), least)
        })
        .collect();
    muscles.iter_mut().for_each(|(m, _)| m.planes.clear());
    let (mut to_muscles, mut to_bones) = (VIEW, VIEW);
    for ([i, j], (planes, distance)) in between.into_iter().zip(of_muscles) {
        muscles[i].0.planes.extend(planes.a);
        muscles[j].0.planes.extend(planes.b);
        to_muscles = to_muscles.min(distance);
    }
    for ([i, _], (planes, distance)) in to_bone.into_iter().zip(of_bones) {
        // Attached ends may reach into their bone.
        let m = &mut muscles[i].0;
        let free: Vec<_> = planes.a.into_iter().filter(|p| !p.nodes.iter().any(|&n| m.is_end(n))).collect();
        m.planes.extend(free);
        to_bones = to_bones.min(distance);
    }
    [to_muscles, to_bones]
}

/// Least distance of every muscle to another \[m\], and which.
fn least_gaps(skins: &[Skin]) -> Vec<Option<(f64, usize)>> {
    let pairs: Vec<[usize; 2]> =
        (0..skins.len()).flat_map(|i| (i + 1..skins.len()).map(move |j| [i, j])).collect();
    let distances: Vec<Option<f64>> = pairs
        .par_iter()
        .map(|&[i, j]| skins[i].search.least_gap(&skins[j].search).map(|gap| gap.closest.distance))
        .collect();
    let mut gaps: Vec<Option<(f64, usize)>> = vec![None; skins.len()];
    for ([i, j], distance) in pairs.into_iter().zip(distances) {
        let Some(distance) = distance else { continue };
        for (me, other) in [(i, j), (j, i)] {
            if gaps[me].is_none_or(|(least, _)| distance < least) {
                gaps[me] = Some((distance, other));
            }
        }
    }
    gaps
}

/// Where muscles reach into bones: exact test of the triangles, and the deepest node of each in the other.
fn crossings(muscles: &[MuscleResult], skins: &[Skin], bones: &[Skin]) -> Vec<BoneCrossing> {
    let (_, to_bone) = near_pairs(skins, bones);
    let found: Vec<Option<BoneCrossing>> = to_bone
        .par_iter()
        .map(|&[muscle, bone]| {
            let (skin, other) = (&skins[muscle], &bones[bone]);
            let met = skin.search.intersections(&other.search);
            if met.is_empty() {
                return None;
            }
            let depth = |inner: &Skin, outer: &Skin| {
                let signed = SignedDistance::new(&outer.search).expect("a skin is closed");
                signed.of(&inner.search.surface().points).iter().map(|d| -d.distance).fold(0.0, f64::max)
            };
            let block = &muscles[muscle].block;
            let layers = met.iter().map(|&(triangle, _)| {
                let corners = skin.search.surface().triangles[triangle as usize];
                let lowest = corners.map(|p| skin.nodes[p as usize] as usize / block.nodes_per_section);
                lowest.into_iter().min().unwrap_or(0).min(block.n_layers() - 2)
            });
            let layers = layers.fold([usize::MAX, 0], |[a, b], l| [a.min(l), b.max(l)]);
            let depth = depth(skin, other).max(depth(other, skin));
            Some(BoneCrossing { muscle, bone, depth, layers })
        })
        .collect();
    found.into_iter().flatten().collect()
}
