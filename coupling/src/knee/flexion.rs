//! A knee bent from pose to pose of its tibia: the patella in equilibrium at each.

use fem::body::{Pose, Wrench};
use fem::effect::obstacle::Pressed;
use fem::measure::free_bodies;
use fem::plan::Load;
use fem::run::{Drive, DriveFrame, Frame, Run, Session};
use fem::solve::{Settings, SolveError};
use nalgebra::Point3;

use super::muscles::{MUSCLES, MuscleState};
use super::pose::{Coordinates, LONGEST_SHIFT, LONGEST_TURN};
use super::rigid::{RigidKnee, StrandState, out_of_groove};

/// Flexion from step to step on the way to the first pose \[degrees\].
const APPROACH: f64 = 2.5;
/// How often the force is doubled before: where a thousand newtons come at once the patella is thrown out of its groove.
const DOUBLED: i32 = 5;
/// Strain beyond which a strand is told of.
const STRETCHED: f64 = 0.3;
/// Stretch beyond which a muscle is told of: at 1.7 times the length at which they pull best, filaments of a fibre overlap no more (frog, 2.1 to 3.65 µm,
/// Gordon et al. 1966), and twice is beyond what any leg asks of a muscle.
const DRAWN_OUT: f64 = 2.0;

/// The patella at a pose of the tibia.
#[derive(Clone, Debug)]
pub struct FlexionFrame {
    /// The pose that was asked for.
    pub tibia: Coordinates,
    /// Where the patella is.
    pub patella: Coordinates,
    /// What is left of all forces on it \[N, N·m\], moments about its origin.
    pub residual: Wrench,
    /// Contact of its cartilage.
    pub contact: Pressed,
    /// Every strand, in the order of [`RigidKnee::strands`].
    pub strands: Vec<StrandState>,
    /// Where each goes \[m\], in the frame of the femur.
    pub ways: Vec<Vec<Point3<f64>>>,
    /// Its muscles, where they are tissue and the frame was solved.
    pub muscles: Option<MuscleState>,
    /// Iterations of Newton's method.
    pub iterations: usize,
    /// Least det F at the points where the law of a muscle is asked; infinite without muscles.
    pub least_det_f: f64,
}

impl FlexionFrame {
    /// The frame that was not solved: with its load all at once on the last good state.
    fn failed(knee: &RigidKnee, tibia: &Coordinates, frame: &Frame) -> FlexionFrame {
        let mut whole = frame.clone();
        for (n, motion) in knee.plan.motion.iter().enumerate() {
            let x = (&mut whole.x[3 * n..3 * n + 3]).try_into().expect("three components");
            frame.load.prescribe(motion, &knee.plan.mesh.points[n], x);
        }
        FlexionFrame::of(knee, tibia, &whole)
    }

    fn of(knee: &RigidKnee, tibia: &Coordinates, frame: &Frame) -> FlexionFrame {
        let at = frame.snapshot();
        let state = free_bodies(&knee.plan, at).remove(0);
        FlexionFrame {
            tibia: *tibia,
            patella: knee.coordinates(&state.pose),
            residual: state.residual,
            contact: knee.pressed(at.x),
            strands: knee.strand_states(at.x, &at.load.controls),
            ways: knee.ways(at.x),
            muscles: None,
            iterations: frame.count(|island| island.iterations),
            least_det_f: frame.islands.iter().map(|island| island.least_det_f).fold(f64::INFINITY, f64::min),
        }
    }

    /// Turn \[degrees\] and shift \[mm\] of the patella since another frame.
    pub fn step_from(&self, other: &FlexionFrame) -> [f64; 2] {
        self.patella.step_from(&other.patella)
    }

    /// Why this is no patella in its groove; `before`: where it was a frame ago.
    fn dislocated(&self, before: &Coordinates, quadriceps: f64, is_beside: bool) -> Option<String> {
        let jump = || {
            let [turn, shift] = self.patella.step_from(before);
            (turn > LONGEST_TURN || shift > LONGEST_SHIFT).then(|| {
                format!(
                    "it jumps by {turn:.1} degrees and {shift:.1} mm from the frame before, at most {LONGEST_TURN} and {LONGEST_SHIFT}"
                )
            })
        };
        let lost = || {
            (quadriceps > 0.0 && self.contact.area == 0.0)
                .then(|| "nothing of its cartilage presses on the femur".to_string())
        };
        let away = || (!is_beside).then(|| "it is not beside the knee of the femur".to_string());
        out_of_groove(&self.patella).or_else(away).or_else(jump).or_else(lost)
    }
}

/// Why a knee was not bent to the end.
#[derive(Debug)]
pub enum Stopped {
    /// There is no equilibrium that the solver finds; the patella where it last was in equilibrium, with the tibia at the pose that was asked for.
    NoEquilibrium(SolveError, Option<Box<FlexionFrame>>),
    /// The patella has left its groove, or the knee, or jumped: in what way.
    Dislocated(String, Box<FlexionFrame>),
    /// A strand, by its number, finds no way over the femur.
    NoWay(usize, Box<FlexionFrame>),
}

impl Stopped {
    /// What a person should know: where, what is left of the forces, contact and strands there.
    pub fn told(&self, knee: &RigidKnee) -> String {
        let state = |f: &FlexionFrame| {
            let strand = |(name, s): (&String, &StrandState)| match s.tension.is_finite() {
                true => format!("{name} {:.0} N at {:.1} %", s.tension, 100.0 * s.strain),
                false => format!("{name} has no way"),
            };
            let strands: Vec<String> = knee.strands.iter().zip(&f.strands).map(strand).collect();
            let three = |v: [f64; 3], scale: f64| v.map(|v| format!("{:.3}", scale * v)).join(", ");
            let is_known = f.residual.force.iter().chain(&f.residual.moment).all(|v| v.is_finite());
            let left = match is_known {
                true => format!(
                    "left on the patella ({}) N and, about its origin, ({}) N mm",
                    three(f.residual.force, 1.0),
                    three(f.residual.moment, 1e3)
                ),
                false => "what is left on the patella is not known".to_string(),
            };
            format!(
                "flexion {:.1} degrees, {left}, contact {:.0} N over {:.0} mm2; strands: {}",
                f.tibia.flexion,
                f.contact.force.norm(),
                1e6 * f.contact.area,
                strands.join(", ")
            )
        };
        match self {
            Stopped::NoEquilibrium(error, None) => format!("the patella finds no equilibrium: {error}"),
            Stopped::NoEquilibrium(error, Some(f)) => {
                format!(
                    "the patella finds no equilibrium: {error}; with the tibia there and the patella where it last was in equilibrium: {}",
                    state(f)
                )
            }
            Stopped::NoWay(strand, f) => {
                format!("`{}` finds no way over the femur: {}", knee.strands[*strand], state(f))
            }
            Stopped::Dislocated(why, f) => format!(
                "the patella has left its groove: {why}; {:.1} mm forward, {:.1} mm up and {:.1} mm to lateral of the middle of the femur: {}",
                f.patella.place[0],
                f.patella.place[1],
                f.patella.place[2],
                state(f)
            ),
        }
    }
}

/// A knee that was bent.
pub struct Bent {
    /// The knee. Its strings go on from the last equilibrium, so another one is bent the next time.
    pub knee: RigidKnee,
    /// What was measured, frame by frame.
    pub frames: Vec<FlexionFrame>,
    /// What was asked for.
    pub drive: Drive,
    /// What was solved.
    pub run: Run,
    /// Why it ends early.
    pub stopped: Option<Stopped>,
}

impl Bent {
    /// Where the patella is, frame by frame.
    pub fn patellas(&self) -> Vec<Coordinates> {
        self.frames.iter().map(|f| f.patella).collect()
    }

    /// Strands that are stretched beyond 30 % somewhere: their names, the greatest strain and the flexion \[degrees\] there.
    pub fn stretched(&self) -> Vec<(&str, f64, f64)> {
        let strands = self.knee.strands.iter().enumerate();
        let stretched = strands.filter_map(|(i, name)| {
            let all = self.frames.iter().map(|f| (f.strands[i].strain, f.tibia.flexion));
            let most = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
            (most.0 > STRETCHED).then_some((name.as_str(), most.0, most.1))
        });
        stretched.collect()
    }

    /// The muscle that is drawn out most somewhere, if beyond twice its length: its name, to how many times, and the flexion \[degrees\] there.
    pub fn drawn_out(&self) -> Option<(&'static str, f64, f64)> {
        let all = self.frames.iter().filter_map(|f| Some((f.muscles?.drawn_out, f.tibia.flexion)));
        let ((head, most), flexion) = all.max_by(|a, b| a.0.1.total_cmp(&b.0.1))?;
        (most > DRAWN_OUT).then_some((MUSCLES[head], most, flexion))
    }

    /// Why it ends early, in words.
    pub fn stopped_told(&self) -> Option<String> {
        self.stopped.as_ref().map(|stopped| stopped.told(&self.knee))
    }
}

/// Takes the tibia through some poses under a constant force of the quadriceps \[N\].
pub fn flex(knee: RigidKnee, poses: &[Coordinates], quadriceps: f64, settings: &Settings) -> Bent {
    flex_told(knee, poses, quadriceps, settings, &mut |_| {})
}

/// The same; `tell` is told every frame as soon as it is solved.
pub fn flex_told(
    knee: RigidKnee,
    poses: &[Coordinates],
    quadriceps: f64,
    settings: &Settings,
    tell: &mut dyn FnMut(&FlexionFrame),
) -> Bent {
    let (frames, drive, run, stopped) = course(&knee, poses, quadriceps, settings, tell);
    Bent { knee, frames, drive, run, stopped }
}

/// A knee on its way.
struct Course<'a> {
    knee: &'a RigidKnee,
    session: Session<'a>,
    /// Where the patella was last.
    before: Coordinates,
    run: Run,
}

impl Course<'_> {
    /// The equilibrium under a load: the tibia at a pose, and a force \[N\] of the quadriceps.
    fn step(
        &mut self,
        tibia: &Coordinates,
        load: Load,
        force: f64,
    ) -> Result<(FlexionFrame, Frame), Stopped> {
        let knee = self.knee;
        let mut advanced = self.session.advance(&DriveFrame { time: tibia.flexion, load });
        self.run.iterations.append(&mut advanced.iterations);
        if !advanced.errors.is_empty() {
            let frame = FlexionFrame::failed(knee, tibia, &advanced.frame);
            self.run.unsolved = Some(advanced.frame);
            return Err(Stopped::NoEquilibrium(advanced.errors.remove(0), Some(Box::new(frame))));
        }
        let x = advanced.frame.snapshot().x;
        let (frame, is_beside) = (FlexionFrame::of(knee, tibia, &advanced.frame), knee.is_beside_femur(x));
        let lost = frame.strands.iter().position(|s| !s.tension.is_finite() || !s.strain.is_finite());
        let stopped = match lost {
            Some(lost) => Some(Stopped::NoWay(lost, Box::new(frame.clone()))),
            None => {
                let why = frame.dislocated(&self.before, force, is_beside);
                why.map(|why| Stopped::Dislocated(why, Box::new(frame.clone())))
            }
        };
        if let Some(stopped) = stopped {
            self.run.unsolved = Some(advanced.frame);
            return Err(stopped);
        }
        knee.settle(x);
        self.before = frame.patella;
        Ok((frame, advanced.frame))
    }
}

fn course(
    knee: &RigidKnee,
    poses: &[Coordinates],
    quadriceps: f64,
    settings: &Settings,
    tell: &mut dyn FnMut(&FlexionFrame),
) -> (Vec<FlexionFrame>, Drive, Run, Option<Stopped>) {
    let (mut frames, mut drive) = (Vec::new(), Drive::default());
    let session = match Session::new(&knee.plan, settings, None) {
        Ok(session) => session,
        Err(error) => return (frames, drive, Run::default(), Some(Stopped::NoEquilibrium(error, None))),
    };
    let before = knee.coordinates(&Pose::identity());
    let mut course = Course { knee, session, before, run: Run::default() };
    let load = |tibia: &Coordinates, force: f64, step: usize| {
        let refused = |source| SolveError::Load { step, source: Box::new(source) };
        knee.load(tibia, force).map_err(|source| Stopped::NoEquilibrium(refused(source), None))
    };
    // Where the patella is, is known in the reference pose: the force comes there, doubled from part to part, and the tibia goes to the first
    // pose in small steps.
    let way = poses.first().map_or(Vec::new(), |first| knee.reference.towards(first, APPROACH));
    let doubled = if quadriceps > 0.0 { DOUBLED } else { 0 };
    let parts = (1..=doubled).rev().map(|k| (knee.reference, quadriceps * 0.5_f64.powi(k)));
    for (tibia, force) in parts.chain(way.into_iter().map(|tibia| (tibia, quadriceps))) {
        if let Err(stopped) = load(&tibia, force, 0).and_then(|load| course.step(&tibia, load, force)) {
            return (frames, drive, course.run, Some(stopped));
        }
    }
    for tibia in poses {
        let asked = load(tibia, quadriceps, frames.len());
        let solved = asked.and_then(|load| {
            drive.frames.push(DriveFrame { time: tibia.flexion, load: load.clone() });
            course.step(tibia, load, quadriceps)
        });
        let (mut frame, whole) = match solved {
            Ok(solved) => solved,
            Err(stopped) => return (frames, drive, course.run, Some(stopped)),
        };
        frame.muscles = knee.muscles.as_ref().map(|m| MuscleState::of(&knee.plan, whole.snapshot(), m));
        course.run.frames.push(whole);
        tell(&frame);
        frames.push(frame);
    }
    (frames, drive, course.run, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame with the patella where the coordinates say, cartilage pressed over 100 mm².
    fn frame(patella: [f64; 6]) -> FlexionFrame {
        let contact = Pressed { area: 1e-4, ..Pressed::default() };
        FlexionFrame {
            tibia: Coordinates::from_array([60.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            patella: Coordinates::from_array(patella),
            residual: Wrench::default(),
            contact,
            strands: Vec::new(),
            ways: Vec::new(),
            muscles: None,
            iterations: 1,
            least_det_f: f64::INFINITY,
        }
    }

    /// Every way in which a patella can leave its groove is told by itself, and one that follows is in it.
    #[test]
    fn a_patella_that_is_no_more_in_its_groove_is_told_why() {
        let start = [45.0, 0.0, 0.0, 45.0, -15.0, 3.0];
        let before = Coordinates::from_array(start);
        let moved = |c: usize, by: f64| {
            let mut at = start;
            at[c] += by;
            frame(at)
        };
        let follows = moved(0, 5.0);
        assert_eq!(follows.dislocated(&before, 200.0, true), None);
        let told =
            |frame: &FlexionFrame, force, is_beside| frame.dislocated(&before, force, is_beside).unwrap();
        assert!(told(&moved(5, 20.0), 200.0, true).contains("23.0 mm to lateral"));
        assert!(told(&moved(1, 50.0), 200.0, true).contains("its lateral axis is 50.0 degrees off"));
        assert!(told(&moved(0, 150.0), 200.0, true).contains("its cartilage looks away"));
        assert!(told(&moved(0, 21.0), 200.0, true).contains("it jumps by 21.0 degrees and 0.0 mm"));
        assert!(told(&moved(4, -21.0), 200.0, true).contains("it jumps by 0.0 degrees and 21.0 mm"));
        assert!(told(&follows, 200.0, false).contains("not beside the knee"));
        let free = FlexionFrame { contact: Pressed::default(), ..follows };
        assert!(told(&free, 200.0, true).contains("nothing of its cartilage presses"));
        // Without a force nothing has to press.
        assert_eq!(free.dislocated(&before, 0.0, true), None);
    }
}
