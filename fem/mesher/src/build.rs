//! From sections to meshes that keep apart: filling, smoothing, separating.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::grid::{self, Coarser, SectionKind};
use super::separate::{Planes, Skin, planes};
use super::smooth::{Plane, Smoother};
use super::{Bone, Loft, MuscleBlock, MuscleSections, N_OUTLINE, to_mesh};
use fem::geometry::{Gap, SignedDistance};
use fem::mesh::quality::Quality;

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
/// Depth in a bone that attached ends are left \[m\]: less than [`Goals::bone_depth`].
const END_DEPTH: f64 = 1.7e-3;
/// The last interval is cut where a border advances more than this fraction of the muscle's length in it, and more than this many times
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
    /// How far nodes of the surface were moved along their normals to come apart from neighbours and bones: mean and largest \[m\].
    pub moved: [f64; 2],
    /// Volume before that \[m³\].
    pub volume_before: f64,
    /// Least distance to another muscle \[m\] and which; `None` without another. Quadrilaterals read both as two triangles along
    /// a diagonal and as four about the mean of their corners.
    pub gap: Option<(f64, usize)>,
    /// Pairs of triangles of its own surface that meet, in the worse of the two readings.
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
    /// Least distance between two muscles \[m\] and their names; `None` for one muscle.
    pub fn least_gap(&self) -> Option<(f64, [&str; 2])> {
        let name = |m: usize| self.muscles[m].block.name.as_str();
        let gaps =
            self.muscles.iter().enumerate().filter_map(|(i, m)| m.gap.map(|(d, j)| (d, [name(i), name(j)])));
        gaps.min_by(|a, b| a.0.total_cmp(&b.0))
    }

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
    let mut skins: Vec<Skins> = muscles.iter().map(|(m, _)| skins_of(&m.block)).collect();
    let bone_skins: Vec<Skin> = bones.iter().map(Skin::of_bone).collect();
    let alone: Vec<Alone> =
        skins.iter().zip(&muscles).map(|(skins, (m, _))| Alone::of(skins, &m.block)).collect();
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
        skins.par_iter_mut().zip(&muscles).for_each(|(skins, (m, _))| {
            skins.iter_mut().for_each(|skin| skin.update(&m.block.points));
        });
        rounds += 1;
    }
    let gaps = least_gaps(&skins);
    let results: Vec<MuscleResult> = muscles
        .into_par_iter()
        .zip(&skins)
        .zip(gaps)
        .zip(&alone)
        .map(|((((m, kind), skins), gap), alone)| {
            let quality = shape(&m.block);
            let mut away: Vec<f64> = m.deviations().into_iter().map(f64::abs).collect();
            away.sort_by(f64::total_cmp);
            let mean = away.iter().sum::<f64>() / away.len() as f64;
            let deviation = [mean, away[away.len() * 95 / 100], away[away.len() - 1]];
            let crossings = skins.iter().map(|skin| skin.search.self_intersections().len());
            MuscleResult {
                kind,
                quality,
                loft_volume: m.volume,
                deviation,
                moved: alone.moved(&m.block),
                volume_before: alone.volume,
                gap,
                self_crossings: crossings.max().unwrap_or(0),
                block: m.block,
            }
        })
        .collect();
    let bone_crossings = crossings(&results, &skins, &bone_skins);
    Built { muscles: results, bone_crossings, rounds }
}

/// The surface of a muscle in both readings of its quadrilaterals: cut in two and in four.
type Skins = [Skin; 2];

fn skins_of(block: &MuscleBlock) -> Skins {
    [Skin::cut_in_two(block), Skin::cut_in_four(block)]
}

/// A muscle before it met its neighbours.
struct Alone {
    /// Nodes of the surface, where they were and which way was out.
    nodes: Vec<(u32, Vector3<f64>, Vector3<f64>)>,
    volume: f64,
}

impl Alone {
    fn of(skins: &Skins, block: &MuscleBlock) -> Alone {
        let place = |n: u32| Vector3::from(block.points[n as usize]);
        let nodes = skins[0].node_normals().map(|(n, normal)| (n, place(n), normal)).collect();
        Alone { nodes, volume: block.volume() }
    }

    /// Mean and largest way of the nodes along their normals \[m\]: nodes also slide along the surface, which changes nothing.
    fn moved(&self, block: &MuscleBlock) -> [f64; 2] {
        let way = |(n, from, normal): &(u32, Vector3<f64>, Vector3<f64>)| {
            (Vector3::from(block.points[*n as usize]) - from).dot(normal).abs()
        };
        let ways = self.nodes.iter().map(way);
        let mean = ways.clone().sum::<f64>() / self.nodes.len() as f64;
        [mean, ways.fold(0.0, f64::max)]
    }
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

/// The loft up to `s_end`, filled with so many cells across and through: to be measured, not to be solved on.
pub fn sampled(loft: &Loft, [across, through]: [usize; 2], s_end: f64) -> MuscleBlock {
    const LAYERS: usize = 100;
    let fine = SectionKind::Plain { across, through }.grid();
    grid::fill("", loft, &fine, (0..=LAYERS).map(|i| s_end * i as f64 / LAYERS as f64).collect())
}

/// Volume of the loft up to `s_end` \[m³\].
pub fn loft_volume(loft: &Loft, s_end: f64) -> f64 {
    sampled(loft, [20, 8], s_end).volume()
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

/// Pairs of muscles and pairs of muscle and bone whose boxes come within the view.
fn near_pairs(skins: &[Skins], bones: &[Skin]) -> (Vec<[usize; 2]>, Vec<[usize; 2]>) {
    let mut between = Vec::new();
    let mut to_bone = Vec::new();
    for (i, [skin, _]) in skins.iter().enumerate() {
        between.extend((i + 1..skins.len()).filter(|&j| skin.is_near(&skins[j][0], VIEW)).map(|j| [i, j]));
        to_bone.extend((0..bones.len()).filter(|&j| skin.is_near(&bones[j], VIEW)).map(|j| [i, j]));
    }
    (between, to_bone)
}

/// Gives every muscle the planes of its neighbours, and returns the least distances \[m\] (at most the view) between two muscles,
/// and from a muscle but for its end layers to a bone, zero where an end is too deep in one; both readings of the surfaces count.
fn meet(muscles: &mut [(Smoother, SectionKind)], skins: &[Skins], bones: &[Skin]) -> [f64; 2] {
    let (between, to_bone) = near_pairs(skins, bones);
    let aim = AIM * GOALS.gap;
    let in_both = |pairs: Vec<[usize; 2]>| {
        pairs.into_iter().flat_map(|[i, j]| [(i, j, 0), (i, j, 1)]).collect::<Vec<_>>()
    };
    let (between, to_bone) = (in_both(between), in_both(to_bone));
    let of_muscles: Vec<(Planes, f64)> = between
        .par_iter()
        .map(|&(i, j, reading)| {
            let (a, b) = (&skins[i][reading], &skins[j][reading]);
            let pairs = a.search.pairs_within(&b.search, VIEW);
            let least = pairs.iter().map(|p| p.closest.distance).fold(VIEW, f64::min);
            (planes(a, b, &pairs, aim, 0.5), least)
        })
        .collect();
    let of_bones: Vec<(Planes, f64)> = to_bone
        .par_iter()
        .map(|&(i, j, reading)| {
            let (skin, bone) = (&skins[i][reading], &bones[j]);
            let is_end = |n: u32| muscles[i].0.is_end(n);
            let pairs = skin.search.pairs_within(&bone.search, VIEW);
            // Attached ends may reach into their bone, but not deep.
            let (ends, free): (Vec<Gap>, Vec<Gap>) =
                pairs.into_iter().partition(|p| skin.nodes_of(p.a).any(is_end));
            let least = free.iter().map(|p| p.closest.distance).fold(VIEW, f64::min);
            let mut asked = planes(skin, bone, &free, aim, 1.0);
            asked.a.retain(|p| !p.nodes.into_iter().any(is_end));
            let mut of_ends = planes(skin, bone, &ends, -END_DEPTH, 1.0).a;
            of_ends.retain(|p| p.nodes.into_iter().any(is_end));
            let too_deep = |p: &Plane| p.trespass(&muscles[i].0.block.points) > GOALS.bone_depth - END_DEPTH;
            let least = if of_ends.iter().any(too_deep) { 0.0 } else { least };
            asked.a.extend(of_ends);
            (asked, least)
        })
        .collect();
    muscles.iter_mut().for_each(|(m, _)| m.planes.clear());
    let (mut to_muscles, mut to_bones) = (VIEW, VIEW);
    for ((i, j, _), (planes, distance)) in between.into_iter().zip(of_muscles) {
        muscles[i].0.planes.extend(planes.a);
        muscles[j].0.planes.extend(planes.b);
        to_muscles = to_muscles.min(distance);
    }
    for ((i, ..), (planes, distance)) in to_bone.into_iter().zip(of_bones) {
        muscles[i].0.planes.extend(planes.a);
        to_bones = to_bones.min(distance);
    }
    [to_muscles, to_bones]
}

/// Least distance of every muscle to another in both readings \[m\], and which.
fn least_gaps(skins: &[Skins]) -> Vec<Option<(f64, usize)>> {
    let pairs: Vec<[usize; 2]> =
        (0..skins.len()).flat_map(|i| (i + 1..skins.len()).map(move |j| [i, j])).collect();
    let distances: Vec<Option<f64>> = pairs
        .par_iter()
        .map(|&[i, j]| {
            let gap = |r: usize| skins[i][r].search.least_gap(&skins[j][r].search);
            (0..2).filter_map(gap).map(|gap| gap.closest.distance).min_by(f64::total_cmp)
        })
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

/// Where muscles reach into bones: exact test of the triangles, and the deepest point of each in the other, in both readings.
fn crossings(muscles: &[MuscleResult], skins: &[Skins], bones: &[Skin]) -> Vec<BoneCrossing> {
    let (_, to_bone) = near_pairs(skins, bones);
    let found: Vec<Option<BoneCrossing>> = to_bone
        .par_iter()
        .map(|&[muscle, bone]| {
            let (block, other) = (&muscles[muscle].block, &bones[bone]);
            let layer = |n: u32| (n as usize / block.nodes_per_section).min(block.n_layers() - 2);
            let mut crossing: Option<BoneCrossing> = None;
            for skin in &skins[muscle] {
                let met = skin.search.intersections(&other.search);
                if met.is_empty() {
                    continue;
                }
                let depth = |inner: &Skin, outer: &Skin| {
                    let signed = SignedDistance::new(&outer.search).expect("a skin is closed");
                    signed.of(&inner.search.surface().points).iter().map(|d| -d.distance).fold(0.0, f64::max)
                };
                let depth = depth(skin, other).max(depth(other, skin));
                let lowest = |t: u32| skin.nodes_of(t).map(layer).min().expect("a triangle has nodes");
                let at = met.iter().map(|&(triangle, _)| lowest(triangle));
                let layers = at.fold([usize::MAX, 0], |[a, b], l| [a.min(l), b.max(l)]);
                crossing = Some(match crossing {
                    None => BoneCrossing { muscle, bone, depth, layers },
                    Some(c) => BoneCrossing {
                        depth: depth.max(c.depth),
                        layers: [layers[0].min(c.layers[0]), layers[1].max(c.layers[1])],
                        ..c
                    },
                });
            }
            crossing
        })
        .collect();
    found.into_iter().flatten().collect()
}
