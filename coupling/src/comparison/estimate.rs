//! What a thigh takes to be solved: unknowns, entries of factors, operations. Counted on its plan, or on a draft of its mesh.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fem::mesh::CellBlock;
use fem::plan::{LoadedIsland, Plan};
use fem::solve::{Analysis, Pattern, Potential};
use rayon::prelude::*;

use crate::comparison::{STAGES, Sized, coarse_stages};
use crate::configuration::{Configuration, PerConfiguration};
use crate::error::CouplingError;
use crate::scene::{Fibres, Scene};
use crate::steps::RigidStep;
use crate::thigh::build::Thigh;

/// Newton iterations without contact of a muscle, per metre of its length, in a frame that is some way from the one before: long straps wrinkle most. As counted
/// at 12 mm on the walker, without and with fibres: glutei of 0.2 m take 9 and sartorius of 0.5 m takes 45 with them.
const ITERATIONS: f64 = 42.0;
const ITERATIONS_WITH_FIBRES: f64 = 74.0;
/// Time since the frame before up to which iterations grow in proportion \[s\]: `walker_cycle` takes 13 a frame after 0.06 s, the walker 31 after
/// 0.15 s.
const SOON: f64 = 0.14;
/// The share of them that is left where a coarser mesh shows the way, as counted on the walker at 6 mm after 12 mm without contact, and at 6 mm after
/// 12 mm (0.42) and at 3 mm after 6 mm (0.33) with it.
const LED: PerConfiguration<f64> = PerConfiguration { without: 0.4, with: 0.4 };
/// Newton iterations in contact of all muscles together, which take as many as the slowest. Where numbers of single muscles scatter as times of waiting do
/// that is the mean times 1 + 1/2 + ... + 1/n: 22 of three, 29 of 17 muscles were counted with the walker, 31 to 45 with other scenes.
const ITERATIONS_IN_CONTACT: f64 = 10.0;
/// Newton iterations of a muscle in its calibration, both solutions together, per metre of its length.
const CALIBRATION: f64 = 58.0;
/// Factorizations per iteration: the Hessian is indefinite now and then.
const FACTORIZATIONS: f64 = 1.1;
/// Floating-point operations of a factorization per second and core, as measured.
const FLOPS: f64 = 2e10;
/// Seconds of one core per iteration for all else: without contact per element, with it per element and triangle of a bone, as measured.
const ASSEMBLY: PerConfiguration<f64> = PerConfiguration { without: 3.4e-5, with: 6e-5 };
/// Seconds of the rigid leg, and of one core per element for meshing, as measured.
const RIGID_LEG: f64 = 0.03;
const MESHING: f64 = 6.5e-4;
/// Memory beside matrix and factors of the bodies alone, as measured \[bytes per element\]: without contact, and with it, whose pairs
/// join the factors.
const MEMORY: PerConfiguration<f64> = PerConfiguration { without: 6e3, with: 2.8e4 };
/// Memory of the program in any case \[bytes\].
const PROGRAM: f64 = 4e7;

/// [Seconds of an iteration](super::speed::iteration_seconds) on the machine on which all these were measured.
const ITERATION: f64 = 0.053;

/// What a scene is expected to take.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// Hexahedra of the muscles.
    pub elements: usize,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Calibration and configurations, in the order of the run.
    pub stages: Vec<Stage>,
    /// Time of meshing \[s\].
    pub meshing: f64,
    /// Memory of the largest stage.
    pub memory_mib: f64,
}

/// What a scene asks for beside the thigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Frames, as many that are far from the one before as they are worth: one soon after another takes fewer iterations.
    pub frames: f64,
    /// Triangles of the bones, which contact looks at.
    pub bone_triangles: usize,
}

/// A stage that solves.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// One of [`STAGES`], or of a [coarser mesh](super::coarse_stages).
    pub name: String,
    /// What one factorization takes.
    pub work: Work,
    /// Time on the threads of this process \[s\].
    pub seconds: f64,
    /// Memory.
    pub memory_mib: f64,
}

impl Expected {
    /// Of a scene whose thigh takes so much in the configurations that are asked for. `demand`: what it [asks for beside that](Sized::demand).
    /// `iteration`: [seconds of an iteration](super::speed::iteration_seconds) here; `None`: as on the machine on which the constants were
    /// measured.
    pub fn of(
        scene: &Scene,
        thigh: &Thigh,
        works: PerConfiguration<Option<Work>>,
        demand: Demand,
        iteration: Option<f64>,
    ) -> Expected {
        let slower = iteration.map_or(1.0, |s| s / ITERATION);
        let solid = thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid());
        let elements: usize = solid.map(|b| b.n_cells()).sum();
        let threads = rayon::current_num_threads() as f64;
        let touching = PerConfiguration { without: elements, with: elements + demand.bone_triangles };
        let stage = |name: &str, work: Work, c: Configuration, iterations: f64| Stage {
            name: name.to_string(),
            work,
            seconds: slower
                * (FACTORIZATIONS * work.operations / FLOPS + ASSEMBLY[c] * touching[c] as f64)
                * iterations
                / threads,
            // Factors in single precision; the matrix twice, in double.
            memory_mib: (PROGRAM
                + MEMORY[c] * elements as f64
                + 4.0 * work.factors as f64
                + 2.0 * 72.0 * work.blocks as f64)
                / f64::from(1 << 20),
        };
        let length = mean_length(thigh);
        let mut stages = Vec::new();
        let any = works.present().map(|(_, work)| *work).next();
        stages.extend(
            any.filter(|_| scene.fibres != Fibres::None)
                .map(|w| stage(STAGES[2], w, Configuration::WithoutContact, CALIBRATION * length)),
        );
        for (c, work) in works.present() {
            let led = if scene.coarser(c).is_empty() { 1.0 } else { LED[c] };
            let iterations = match (c, scene.fibres) {
                (Configuration::WithContact, _) => ITERATIONS_IN_CONTACT * harmonic(thigh.muscles.len()),
                (Configuration::WithoutContact, Fibres::None) => ITERATIONS * length,
                (Configuration::WithoutContact, _) => ITERATIONS_WITH_FIBRES * length,
            };
            stages.push(stage(c.name(), *work, c, led * iterations * demand.frames));
        }
        Expected {
            elements,
            nodes: thigh.mesh.points.len(),
            meshing: slower * MESHING * elements as f64 / threads,
            memory_mib: stages.iter().map(|s| s.memory_mib).fold(PROGRAM / f64::from(1 << 20), f64::max),
            stages,
        }
    }

    /// The same with this thigh in place of its draft; coarser meshes stay as they were counted.
    pub fn counted(
        self,
        scene: &Scene,
        thigh: &Thigh,
        works: PerConfiguration<Option<Work>>,
        demand: Demand,
        iteration: Option<f64>,
    ) -> Expected {
        let counted = Expected::of(scene, thigh, works, demand, iteration);
        let of = |name: &str| counted.stages.iter().find(|stage| stage.name == name).cloned();
        let stages = self.stages.into_iter().map(|stage| of(&stage.name).unwrap_or(stage)).collect();
        Expected { stages, ..counted }
    }

    /// The same after a configuration was solved on a coarser mesh with edges of `edge` \[m\], which is expected to take `coarse`. Where the other
    /// configuration is solved on it before, its calibration is kept.
    fn after(mut self, coarse: Expected, c: Configuration, edge: f64) -> Expected {
        let place = self.stages.iter().position(|stage| stage.name == c.name());
        let [beforehand, solved] = coarse_stages(c, edge);
        let is_calibrated = Configuration::ALL.into_iter().any(|before| {
            let [calibration, _] = coarse_stages(before, edge);
            self.stages.iter().any(|stage| stage.name == calibration)
        });
        let mut meshing = coarse.meshing;
        let mut own = Vec::new();
        for (of, name) in [(STAGES[2], beforehand), (c.name(), solved)] {
            // A mesh without fibres is made and solved in one go.
            if let Some(stage) = coarse.stages.iter().find(|stage| stage.name == of) {
                let kept = of == STAGES[2] && is_calibrated;
                let seconds = std::mem::take(&mut meshing) + if kept { 0.0 } else { stage.seconds };
                own.push(Stage { name, seconds, ..stage.clone() });
            }
        }
        if let Some(place) = place {
            self.stages.splice(place..place, own);
        }
        self
    }

    /// Time of all stages \[s\].
    pub fn seconds(&self) -> f64 {
        self.stages.iter().map(|s| s.seconds).fold(RIGID_LEG + self.meshing, |sum, s| sum + s)
    }

    /// Time of a stage \[s\].
    pub fn of_stage(&self, name: &str) -> f64 {
        match name {
            _ if name == STAGES[0] => RIGID_LEG,
            _ if name == STAGES[1] => self.meshing,
            _ => self.stages.iter().find(|s| s.name == name).map_or(0.0, |s| s.seconds),
        }
    }
}

/// How long the regions of solids are \[m\], diagonals of their boxes: the mean over all elements.
fn mean_length(thigh: &Thigh) -> f64 {
    let (mut sum, mut elements) = (0.0, 0);
    for block in thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()) {
        let places = || block.nodes.iter().map(|&n| thigh.mesh.points[n as usize]);
        let width = |c: usize| {
            let along = || places().map(|p| p[c]);
            along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
        };
        sum += (0..3).map(|c| width(c).powi(2)).sum::<f64>().sqrt() * block.n_cells() as f64;
        elements += block.n_cells();
    }
    if elements > 0 { sum / elements as f64 } else { 0.0 }
}

/// 1 + 1/2 + ... + 1/n.
fn harmonic(n: usize) -> f64 {
    (1..=n).map(|k| 1.0 / k as f64).sum()
}

impl Sized {
    /// What a scene asks for beside the thigh.
    pub fn demand(&self) -> Demand {
        let soon = |pair: &[RigidStep]| match pair[1].time - pair[0].time {
            // The same instant bent otherwise, or back in time.
            since if since <= 0.0 => 1.0,
            since => (since / SOON).min(1.0),
        };
        let bones = self.limb.iter().flat_map(|limb| &limb.bones);
        Demand {
            frames: 1.0 + self.steps.windows(2).map(soon).sum::<f64>(),
            bone_triangles: bones.map(|bone| bone.surface.triangles.len()).sum(),
        }
    }

    /// What the scene is expected to take, counted on drafts of its meshes, and the draft of its own. `iteration`: as in [`Expected::of`].
    pub fn expected(
        &self,
        asked: PerConfiguration<bool>,
        iteration: Option<f64>,
    ) -> Result<(Thigh, Expected), CouplingError> {
        let thigh = self.draft()?;
        let of = |scene: &Scene, thigh: &Thigh| {
            Expected::of(scene, thigh, Work::of_draft(scene, thigh, asked), self.demand(), iteration)
        };
        let mut expected = of(&self.scene, &thigh);
        for c in Configuration::ALL.into_iter().filter(|c| asked[*c]) {
            for edge in self.scene.coarser(c) {
                let coarse = self.at(edge);
                expected = expected.after(of(&coarse.scene, &coarse.draft()?), c, edge);
            }
        }
        Ok((thigh, expected))
    }
}

/// Sums over the islands of a thigh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Unknowns.
    pub unknowns: usize,
    /// Islands, each solved by itself.
    pub islands: usize,
    /// Entries of all factors.
    pub factors: usize,
    /// Blocks of 3×3 of the matrices.
    pub blocks: usize,
    /// Multiply-adds of one factorization of all.
    pub operations: f64,
}

impl Work {
    fn add(mut self, unknowns: usize, pattern: &Pattern, analysis: &Analysis) -> Work {
        self.unknowns += unknowns;
        self.islands += 1;
        self.factors += analysis.n_values();
        self.blocks += pattern.n_blocks();
        self.operations += analysis.work();
        self
    }

    /// As a plan has them; what contact couples comes on top.
    pub fn of_plan(plan: &Plan) -> Work {
        let rest = plan.load(&[], &[]).expect("nothing is named");
        // What only joins bones has nothing to be solved.
        let solved = plan.islands.iter().filter(|island| island.n_unknowns() > 0);
        solved.fold(Work::default(), |work, island| {
            let loaded = LoadedIsland::new(island.clone(), rest.clone(), rest.clone());
            let places: Vec<f64> = island.nodes.iter().flat_map(|&n| plan.mesh.points[n as usize]).collect();
            let analysis = Analysis::new(loaded.pattern(), &island.free_positions(&places));
            work.add(island.n_unknowns(), loaded.pattern(), &analysis)
        })
    }

    /// As the plan of this thigh would have them, without contact. Nothing is looked at but which nodes its cells have.
    pub fn of_thigh(thigh: &Thigh) -> Work {
        let islands = islands(thigh);
        let counted: Vec<Work> = islands
            .par_iter()
            .map(|island| {
                let pattern = Arc::new(Pattern::new(island.points.len() / 3, island.groups()));
                Work::default().add(island.points.len(), &pattern, &Analysis::new(&pattern, &island.points))
            })
            .collect();
        counted.into_iter().fold(Work::default(), |a, b| Work {
            unknowns: a.unknowns + b.unknowns,
            islands: a.islands + b.islands,
            factors: a.factors + b.factors,
            blocks: a.blocks + b.blocks,
            operations: a.operations + b.operations,
        })
    }

    /// Of a scene on a draft of its thigh, in the configurations that are `asked` for. In contact all islands with a muscle are one; its factors
    /// are taken as those of the islands alone.
    pub fn of_draft(
        scene: &Scene,
        thigh: &Thigh,
        asked: PerConfiguration<bool>,
    ) -> PerConfiguration<Option<Work>> {
        if !scene.deformable {
            return PerConfiguration::default();
        }
        let alone = Work::of_thigh(thigh);
        let sewn = thigh.tendons.len().saturating_sub(1);
        let islands = (alone.islands + sewn + 1).saturating_sub(thigh.muscles.len());
        PerConfiguration {
            without: asked.without.then_some(alone),
            with: asked.with.then_some(Work { islands, ..alone }),
        }
    }
}

/// Free nodes that cells connect.
#[derive(Default)]
struct Connected {
    /// Where they are \[m\], three coordinates each.
    points: Vec<f64>,
    /// Free nodes of each cell, by their place in `points`, one cell after the other.
    nodes: Vec<u32>,
    /// Where each cell ends in `nodes`.
    ends: Vec<usize>,
}

impl Connected {
    fn groups(&self) -> impl Iterator<Item = &[u32]> + Clone {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.nodes[start..end])
    }
}

/// Muscles in grids, as far as they are counted: no matter how well their cubes are filled, and in how many pieces.
struct Grids {
    /// Corners of the cube of every free node in a grid, numbered on from the nodes of the mesh.
    corners: BTreeMap<u32, [u32; 8]>,
    /// Nodes of the mesh, then corners \[m\].
    points: Vec<[f64; 3]>,
    /// Nodes of the elements in each cube, which have one dilatation.
    cubes: Vec<Vec<u32>>,
}

impl Grids {
    fn of(thigh: &Thigh, free: &[bool]) -> Grids {
        let mesh = &thigh.mesh;
        let mut grids = Grids { corners: BTreeMap::new(), points: mesh.points.clone(), cubes: Vec::new() };
        for spec in &thigh.scene.embedded {
            let cube_of = |p: [f64; 3]| p.map(|x| (x / spec.cell).floor() as i64);
            let (mut of_site, mut of_cube) = (BTreeMap::new(), BTreeMap::<_, Vec<u32>>::new());
            let blocks = mesh.blocks.iter().filter(|b| b.name == spec.region);
            for cell in blocks.flat_map(CellBlock::cells) {
                let sum = |c: usize| cell.iter().map(|&n| mesh.points[n as usize][c]).sum::<f64>();
                let centroid = std::array::from_fn(|c| sum(c) / cell.len() as f64);
                of_cube.entry(cube_of(centroid)).or_default().extend(cell);
                for &n in cell.iter().filter(|&&n| free[n as usize]) {
                    let cube = cube_of(mesh.points[n as usize]);
                    let corner = |k: usize| {
                        let site: [i64; 3] = std::array::from_fn(|c| cube[c] + (k >> c & 1) as i64);
                        *of_site.entry(site).or_insert_with(|| {
                            grids.points.push(site.map(|i| i as f64 * spec.cell));
                            grids.points.len() as u32 - 1
                        })
                    };
                    let corners = std::array::from_fn(corner);
                    grids.corners.entry(n).or_insert(corners);
                }
            }
            grids.cubes.extend(of_cube.into_values());
        }
        grids
    }
}

fn islands(thigh: &Thigh) -> Vec<Connected> {
    let mesh = &thigh.mesh;
    let tied: BTreeSet<u32> =
        thigh.scene.ties.iter().flat_map(|t| &mesh.node_sets[&t.nodes]).copied().collect();
    let mut free = vec![true; mesh.points.len()];
    tied.iter().for_each(|&n| free[n as usize] = false);
    let Grids { corners, points, cubes } = Grids::of(thigh, &free);
    let free_of = |cell: &[u32]| {
        let free = cell.iter().copied().filter(|&n| free[n as usize]);
        if !cell.iter().any(|n| corners.contains_key(n)) {
            return free.collect::<Vec<_>>();
        }
        let bearers: BTreeSet<u32> =
            free.flat_map(|n| corners.get(&n).map_or_else(|| vec![n], |c| c.to_vec())).collect();
        bearers.into_iter().collect()
    };
    let is_whole = |block: &&CellBlock| thigh.scene.embedded.iter().all(|e| e.region != block.name);
    let cells = || {
        let of_cells = mesh.blocks.iter().filter(is_whole).flat_map(CellBlock::cells).map(free_of);
        of_cells.chain(cubes.iter().map(|nodes| free_of(nodes))).filter(|cell| !cell.is_empty())
    };
    let mut parent: Vec<u32> = (0..points.len() as u32).collect();
    fn root(parent: &mut [u32], mut n: u32) -> u32 {
        while parent[n as usize] != n {
            parent[n as usize] = parent[parent[n as usize] as usize];
            n = parent[n as usize];
        }
        n
    }
    for cell in cells() {
        for &n in &cell[1..] {
            let (a, b) = (root(&mut parent, cell[0]), root(&mut parent, n));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut islands: Vec<Connected> = Vec::new();
    let mut of_root = vec![u32::MAX; points.len()];
    let mut place = vec![u32::MAX; points.len()];
    for cell in cells() {
        let root = root(&mut parent, cell[0]) as usize;
        if of_root[root] == u32::MAX {
            of_root[root] = islands.len() as u32;
            islands.push(Connected::default());
        }
        let island = &mut islands[of_root[root] as usize];
        for n in cell {
            if place[n as usize] == u32::MAX {
                place[n as usize] = (island.points.len() / 3) as u32;
                island.points.extend(points[n as usize]);
            }
            island.nodes.push(place[n as usize]);
        }
        island.ends.push(island.nodes.len());
    }
    islands
}
