//! One muscle alone, both end faces held: how it bears being stretched and being contracted.

use fem::measure::{Cut, section_force};
use fem::plan::Plan;
use fem::run::{DriveFrame, Frame, Session};
use fem::scene::{PrescribedSpec, Scene, SolidSpec};
use fem::solve::Settings;
use mesher::MusclePart;
use mesher::fibres::{end_stiffness, fraction_of_length};
use mesher::{MuscleBlock, to_mesh};
use nalgebra::Vector3;

use super::build::add_fibres;
use super::tissue::{END_LAYERS, END_STIFFNESS, FIBRE_TOE, FIBRE_YOUNG, MATRIX};

/// Newton's method ends where the residual is this fraction of the forces in play, which are taken to be at least `LEAST_FORCE` \[N\].
pub const TOLERANCE: f64 = 1e-4;
/// See [`TOLERANCE`].
pub const LEAST_FORCE: f64 = 10.0;
/// Tries to find the contraction for a force.
const MOST_TRIES: usize = 8;
/// How near a force is met.
const MET: f64 = 0.02;

/// What is done to a muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// The insertion is moved away from the origin, along the straight line between their centres, by this fraction of their distance;
    /// fibres are passive.
    Stretch(f64),
    /// The fibres contract until this force passes through the belly \[N\], within 2 %.
    Force(f64),
}

/// What became of a muscle. The counts are those of one computation from the unloaded mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Increments of the load.
    pub increments: usize,
    /// Newton iterations of all increments, those of retries included.
    pub iterations: usize,
    /// Least det F over all Gauss points.
    pub least_det_f: f64,
    /// Corners of cells that are turned over.
    pub turned_corners: usize,
    /// Force through the belly, towards the insertion \[N\].
    pub force: f64,
    /// Positions of the nodes \[m\].
    pub x: Vec<f64>,
}

/// One muscle between two held ends.
pub struct MuscleAlone<'a> {
    block: &'a MuscleBlock,
    fibre_area: f64,
    /// From the centre of the origin to that of the insertion \[m\].
    way: Vector3<f64>,
}

impl<'a> MuscleAlone<'a> {
    /// `fibre_area`: section of all fibres \[m²\].
    pub fn new(block: &'a MuscleBlock, fibre_area: f64) -> MuscleAlone<'a> {
        let line = block.centre_line();
        MuscleAlone { block, fibre_area, way: line[line.len() - 1] - line[0] }
    }

    /// Does the task; the message says why there is no equilibrium.
    pub fn run(&self, task: Task) -> Result<Trial, String> {
        match task {
            Task::Stretch(fraction) => {
                let plan = self.plan(vec![self.way.into()])?;
                self.compute(&plan, ("stretch", fraction), Some(self.spread(fraction)))
            }
            Task::Force(wanted) => {
                let plan = self.plan(Vec::new())?;
                let stiffness = FIBRE_YOUNG * self.fibre_area;
                // Half the toe is slack; more goes into straightening, which the tries find out.
                let mut contraction = FIBRE_TOE / 2.0 + wanted / stiffness;
                let mut last: Option<(f64, f64)> = None;
                for _ in 0..MOST_TRIES {
                    let trial = self.compute(&plan, (&self.block.name, contraction), None)?;
                    if (trial.force / wanted - 1.0).abs() <= MET {
                        return Ok(trial);
                    }
                    let slope = last.map_or(stiffness, |(c, f)| (trial.force - f) / (contraction - c));
                    last = Some((contraction, trial.force));
                    contraction += (wanted - trial.force) / slope.clamp(0.2 * stiffness, stiffness);
                }
                Err(format!("no contraction found for {wanted:.0} N, last {last:?}"))
            }
        }
    }

    /// First guess of a stretched muscle: every node moves with the insertion by how far along its fibre it lies, so that the stretch is
    /// spread over the length. The tangent at rest is no guess for a muscle whose fibres lie slack and bent: of sartorius it
    /// makes a zigzag with a hundred times the energy.
    fn spread(&self, stretch: f64) -> Vec<f64> {
        let moved = self.block.points.iter().zip(fraction_of_length(self.block));
        moved.flat_map(|(p, s)| <[f64; 3]>::from(Vector3::from(*p) + self.way * (s * stretch))).collect()
    }

    /// Matrix, fibres, and ends of which the insertion moves by `moved` \[m\] per unit of the control `stretch`.
    fn plan(&self, moved: Vec<[f64; 3]>) -> Result<Plan, String> {
        let block = self.block;
        let mut mesh = to_mesh(std::slice::from_ref(block));
        mesh.surfaces.clear();
        let held = |end: MusclePart, displacement: Vec<[f64; 3]>| PrescribedSpec {
            nodes: end.of(&block.name),
            components: [true; 3],
            control: (!displacement.is_empty()).then(|| "stretch".into()),
            displacement,
        };
        let mut scene = Scene {
            solids: vec![SolidSpec {
                scale: end_stiffness(block, END_STIFFNESS, END_LAYERS),
                ..SolidSpec::new(&block.name, MATRIX)
            }],
            prescribed: vec![held(MusclePart::Origin, vec![]), held(MusclePart::Insertion, moved)],
            ..Scene::default()
        };
        add_fibres(block, self.fibre_area, 1, 0, &mut mesh, &mut scene);
        Plan::new(&scene, mesh).map_err(|e| e.to_string())
    }

    /// The equilibrium under a control, from rest or from a guess for that load \[m\].
    fn compute(&self, plan: &Plan, control: (&str, f64), guess: Option<Vec<f64>>) -> Result<Trial, String> {
        let block = self.block;
        let to = DriveFrame { time: 1.0, load: plan.load(&[control], &[]).map_err(|e| e.to_string())? };
        let settings = Settings { tolerance: TOLERANCE, least_force: LEAST_FORCE, ..Settings::default() };
        let mut session = match guess {
            None => Session::new(plan, &settings, None),
            Some(x) => {
                let guess = Frame { load: to.load.clone(), x, ..Frame::default() };
                Session::from_frame(plan, &settings, &guess, 0)
            }
        }
        .map_err(|e| e.to_string())?;
        let done = session.advance(&to);
        if let Some(error) = done.errors.first() {
            return Err(error.to_string());
        }
        let [report] = &done.frame.islands[..] else { return Err("the muscle is in pieces".into()) };
        let line = block.centre_line();
        let far = |l: &usize| (block.s[*l] - 0.5).abs();
        let belly =
            (1..line.len() - 1).min_by(|a, b| far(a).total_cmp(&far(b))).expect("a muscle has layers");
        let tangent = (line[belly + 1] - line[belly - 1]).normalize();
        let effects = [MusclePart::Belly, MusclePart::Fibres].map(|part| part.of(&block.name)).to_vec();
        let cut = Cut { point: line[belly].into(), normal: tangent.into(), effects };
        Ok(Trial {
            increments: report.load_steps,
            iterations: report.iterations,
            least_det_f: report.least_det_f,
            turned_corners: turned_corners(block, &done.frame.x),
            force: section_force(plan, done.frame.snapshot(), &cut).along(tangent.into()),
            x: done.frame.x,
        })
    }
}

/// Corners of cells that are turned over at `x` \[m\].
fn turned_corners(block: &MuscleBlock, x: &[f64]) -> usize {
    // Neighbours of the corners along the three directions of the cell, so that a good corner has a positive product.
    const NEIGHBOURS: [[usize; 3]; 8] =
        [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]];
    let at = |n: u32| Vector3::from_row_slice(&x[3 * n as usize..3 * n as usize + 3]);
    let corner = |cell: &[u32; 8], k: usize| {
        let [a, b, c] = NEIGHBOURS[k].map(|j| at(cell[j]) - at(cell[k]));
        a.dot(&b.cross(&c)) <= 0.0
    };
    block.cells().map(|cell| (0..8).filter(|&k| corner(&cell, k)).count()).sum()
}
