//! A made-up walking cycle with curves of the usual shape and size, not a solution of any model.

use std::f64::consts::TAU;

use command::report::{MuscleInfo, OptimizeReport};
use coupling::measured::Overlay;
use multibody::kinematics::ANGLES;
use multibody::loads::Loads;
use multibody::natural::{Coordinates, SegmentId};
use multibody::read::KneeForces;
use multibody::sharing::REACTIONS;
use multibody::trial::{
    Effort, FitVerdict, GroundReaction, MarkerTrack, Motion, Sex, Shortfall, Side, Status, Subject, Table,
    Trial, Verdict,
};
use nalgebra::{DMatrix, SVector, Vector3};

/// Name, full name, strength \[N\] (gait2392), then what only this test needs: when the muscle peaks as a fraction of
/// the cycle, and at which fraction of its strength.
#[rustfmt::skip]
pub const MUSCLES: [(&str, &str, f64, f64, f64); 43] = [
    ("gmax1", "Gluteus maximus, superior part", 573.0, 0.08, 0.35),
    ("gmax2", "Gluteus maximus, middle part", 819.0, 0.08, 0.3),
    ("gmax3", "Gluteus maximus, inferior part", 552.0, 0.06, 0.3),
    ("gmed1", "Gluteus medius, anterior part", 819.0, 0.2, 0.6),
    ("gmed2", "Gluteus medius, middle part", 573.0, 0.18, 0.55),
    ("gmed3", "Gluteus medius, posterior part", 653.0, 0.15, 0.6),
    ("gmin1", "Gluteus minimus, anterior part", 270.0, 0.25, 0.4),
    ("gmin2", "Gluteus minimus, middle part", 285.0, 0.22, 0.35),
    ("gmin3", "Gluteus minimus, posterior part", 323.0, 0.2, 0.3),
    ("addlong", "Adductor longus", 627.0, 0.65, 0.2),
    ("addbrev", "Adductor brevis", 429.0, 0.6, 0.15),
    ("addmag1", "Adductor magnus, superior part", 381.0, 0.05, 0.2),
    ("addmag2", "Adductor magnus, middle part", 343.0, 0.05, 0.2),
    ("addmag3", "Adductor magnus, inferior (ischiocondylar) part", 488.0, 0.03, 0.3),
    ("pect", "Pectineus", 266.0, 0.6, 0.2),
    ("iliacus", "Iliacus", 1073.0, 0.55, 0.55),
    ("psoas", "Psoas major", 1113.0, 0.56, 0.6),
    ("quadfem", "Quadratus femoris", 381.0, 0.1, 0.1),
    ("gem", "Gemelli (superior and inferior)", 164.0, 0.1, 0.2),
    ("piri", "Piriformis", 444.0, 0.15, 0.4),
    ("tfl", "Tensor fasciae latae", 233.0, 0.35, 0.5),
    ("grac", "Gracilis", 162.0, 0.8, 0.3),
    ("sart", "Sartorius", 156.0, 0.65, 0.5),
    ("semimem", "Semimembranosus", 1288.0, 0.03, 0.45),
    ("semiten", "Semitendinosus", 410.0, 0.95, 0.4),
    ("bflh", "Biceps femoris, long head", 896.0, 0.05, 0.4),
    ("bfsh", "Biceps femoris, short head", 804.0, 0.7, 0.4),
    ("recfem", "Rectus femoris", 1169.0, 0.6, 0.35),
    ("vasmed", "Vastus medialis", 1294.0, 0.14, 0.4),
    ("vasint", "Vastus intermedius", 1365.0, 0.14, 0.3),
    ("vaslat", "Vastus lateralis", 1871.0, 0.14, 0.45),
    ("gasmed", "Gastrocnemius, medial head", 1558.0, 0.46, 0.6),
    ("gaslat", "Gastrocnemius, lateral head", 683.0, 0.46, 0.4),
    ("soleus", "Soleus", 3549.0, 0.5, 0.55),
    ("tibpost", "Tibialis posterior", 1588.0, 0.45, 0.9),
    ("tibant", "Tibialis anterior", 905.0, 0.05, 0.4),
    ("perbrev", "Fibularis (peroneus) brevis", 435.0, 0.45, 0.5),
    ("perlong", "Fibularis (peroneus) longus", 943.0, 0.47, 0.6),
    ("pertert", "Fibularis (peroneus) tertius", 180.0, 0.03, 0.3),
    ("extdig", "Extensor digitorum longus", 512.0, 0.06, 0.3),
    ("exthal", "Extensor hallucis longus", 162.0, 0.07, 0.25),
    ("flexdig", "Flexor digitorum longus", 310.0, 0.5, 0.5),
    ("flexhal", "Flexor hallucis longus", 322.0, 0.5, 0.6),];

pub const FRAMES: usize = 101;
pub const MARGIN: usize = 10;
pub const CYCLE: f64 = 1.242;

/// A made-up walking cycle with curves of the usual shape and size, not a solution of any model.
pub struct Walk {
    pub trial: Trial,
    pub motion: Motion,
    pub loads: Loads,
    pub effort: Effort,
    pub muscles: Vec<MuscleInfo>,
    pub settings: Vec<(String, String)>,
    pub simulated: Vec<String>,
    pub left_out: Vec<(String, String)>,
    pub notes: Vec<String>,
    pub overlay: Option<Overlay>,
}

/// A bump of height 1 at fraction `centre` of the cycle, periodic.
pub fn bump(p: f64, centre: f64, width: f64) -> f64 {
    let d = (p - centre + 0.5).rem_euclid(1.0) - 0.5;
    (-(d / width).powi(2)).exp()
}

pub fn table(columns: &[&str], rows: usize, value: impl Fn(f64, usize) -> f64, offset: usize) -> Table {
    let fraction = |i: usize| (i as f64 - offset as f64) / (FRAMES - 1) as f64;
    Table {
        columns: columns.iter().map(|c| c.to_string()).collect(),
        values: DMatrix::from_fn(rows, columns.len(), |i, j| value(fraction(i), j)),
    }
}

impl Walk {
    pub fn new() -> Walk {
        let all = FRAMES + 2 * MARGIN;
        let step = CYCLE / (FRAMES - 1) as f64;
        let times: Vec<f64> = (0..all).map(|i| (i as f64 - MARGIN as f64) * step).collect();
        let report = MARGIN..MARGIN + FRAMES;
        let time = times[report.clone()].to_vec();
        let ground = |p: f64| {
            let on = if (0.005..0.64).contains(&p) { 1.0 } else { 0.0 };
            let up =
                690.0 * (0.98 * bump(p, 0.15, 0.12) + 0.9 * bump(p, 0.46, 0.13) + 0.45 * bump(p, 0.3, 0.1));
            on * Vector3::new(-90.0 * bump(p, 0.12, 0.08) + 115.0 * bump(p, 0.53, 0.08), up, -0.06 * up)
        };
        let angles = |p: f64, j: usize| {
            let degrees = match ANGLES[j] {
                "hip_flexion" => 17.0 + 19.0 * (TAU * p).cos(),
                "hip_adduction" => 5.0 * (TAU * (p - 0.2)).cos(),
                "hip_rotation" => 3.0 * (TAU * (p - 0.4)).cos(),
                "knee_flexion" => 6.0 + 19.0 * bump(p, 0.14, 0.08) + 58.0 * bump(p, 0.73, 0.12),
                "knee_adduction" => 1.5 * (TAU * p).sin(),
                "knee_rotation" => 4.0 * bump(p, 0.73, 0.15),
                "ankle_flexion" => -6.0 + 13.0 * bump(p, 0.48, 0.15) - 6.0 * bump(p, 0.66, 0.05),
                "ankle_inversion" => 8.0 - 5.0 * bump(p, 0.3, 0.2),
                "patella_flexion" => 10.0 + 40.0 * bump(p, 0.73, 0.12),
                "pelvis_tilt" => -11.0 + (2.0 * TAU * p).sin(),
                "pelvis_rotation" => 4.0 * (TAU * p).cos(),
                _ => 3.0 * (TAU * p).sin(),
            };
            degrees.to_radians()
        };
        let names: Vec<&str> = MUSCLES.iter().map(|m| m.0).collect();
        let activation = |p: f64, j: usize| {
            let (_, _, _, centre, height) = MUSCLES[j];
            height * (0.97 * bump(p, centre, 0.1) + 0.03)
        };
        let reactions = |p: f64, j: usize| match REACTIONS[j].name {
            "knee_medial" => 60.0 + 1150.0 * bump(p, 0.15, 0.09) + 1300.0 * bump(p, 0.47, 0.1),
            "knee_lateral" => 20.0 + 480.0 * bump(p, 0.16, 0.08) + 350.0 * bump(p, 0.49, 0.09),
            "acl" => 90.0 * bump(p, 0.4, 0.2),
            "pcl" => 140.0 * bump(p, 0.7, 0.1),
            "mcl" => 60.0 * bump(p, 0.5, 0.3),
            "patellar_tendon" => 900.0 * bump(p, 0.14, 0.08),
            "patella_x" => 400.0 * bump(p, 0.14, 0.08),
            "patella_y" => -250.0 * bump(p, 0.14, 0.08),
            "patella_z" => -60.0 * bump(p, 0.14, 0.08),
            "ankle_y" => 50.0 + 1100.0 * bump(p, 0.15, 0.1) + 2900.0 * bump(p, 0.48, 0.1),
            "hip_y" => 300.0 + 1900.0 * bump(p, 0.15, 0.1) + 2100.0 * bump(p, 0.5, 0.1),
            "hip_x" | "ankle_x" => 300.0 * bump(p, 0.5, 0.1) - 200.0 * bump(p, 0.1, 0.1),
            "hip_z" | "ankle_z" => 250.0 * bump(p, 0.3, 0.2),
            "tibia_axial" => 900.0 * bump(p, 0.45, 0.15),
            _ => 100.0 * bump(p, 0.45, 0.15),
        };
        let moments = |p: f64, j: usize| match j {
            0 => 45.0 * bump(p, 0.08, 0.1) - 50.0 * bump(p, 0.55, 0.1),
            1 => -55.0 * bump(p, 0.15, 0.1) - 50.0 * bump(p, 0.46, 0.1),
            2 => 6.0 * bump(p, 0.2, 0.1) - 5.0 * bump(p, 0.5, 0.1),
            3 => 40.0 * bump(p, 0.15, 0.07) - 15.0 * bump(p, 0.42, 0.1),
            4 => 8.0 * bump(p, 0.07, 0.05) - 100.0 * bump(p, 0.5, 0.12),
            _ => 12.0 * bump(p, 0.4, 0.2),
        };
        let fit = (0..all).map(|i| FitVerdict {
            failure: None,
            caution: None,
            markers_seen: [4, 3, 0, 3, 4],
            marker_rms: 1e-3 * (4.4 + 1.3 * (i as f64 * 0.21).sin()),
            iterations: 5,
            residual: 1e-12,
            constraint: 1e-12,
        });
        let verdicts = (0..FRAMES).map(|i| Verdict {
            status: Status::Solved,
            reason: None,
            kkt_residual: 1e-11 * (1.0 + (i as f64 * 1.7).sin().powi(2) * 50.0),
            equality_residual: 1e-13 * (1.0 + (i as f64 * 2.3).cos().powi(2) * 9.0),
            iterations: 11 + (i % 4) as u32,
            active_bounds: 24 + i % 7,
            reserve_share: 0.0,
            shortfall: vec![],
            saturated: vec![],
        });
        let ground_force: Vec<_> = (0..FRAMES).map(|i| ground(i as f64 / 100.0)).collect();
        Walk {
            trial: Trial {
                name: "synthetic walk <test>".into(),
                side: Side::Right,
                subject: Subject { name: "S01".into(), mass: 70.0, height: 1.72, sex: Sex::Male },
                time: times.clone(),
                report: report.clone(),
                markers: vec![MarkerTrack {
                    name: "R_Heel".into(),
                    segment: SegmentId::Foot,
                    position: vec![None; all],
                }],
                ground: GroundReaction::default(),
            },
            motion: Motion {
                time: times,
                report,
                Q: vec![Coordinates::zeros(); all],
                Qd: vec![Coordinates::zeros(); all],
                Qdd: vec![Coordinates::zeros(); all],
                angles: table(&ANGLES, all, angles, MARGIN),
                fit: fit.collect(),
            },
            loads: Loads {
                time: time.clone(),
                generalised: vec![SVector::zeros(); FRAMES],
                reduced: vec![None; FRAMES],
                moments: table(&MOMENTS, FRAMES, moments, 0),
                centre_of_pressure: (0..FRAMES)
                    .map(|i| Vector3::new(0.002 * i as f64, 0.0, 0.05) * ground_force[i].y.signum())
                    .collect(),
                free_moment: ground_force.iter().map(|f| Vector3::new(0.0, 0.005 * f.y, 0.0)).collect(),
                ground_force,
            },
            effort: Effort {
                time,
                forces: table(&names, FRAMES, |p, j| MUSCLES[j].2 * activation(p, j), 0),
                activations: table(&names, FRAMES, activation, 0),
                reactions: table(&reaction_names(), FRAMES, reactions, 0),
                reserves: Table { columns: vec![], values: DMatrix::zeros(FRAMES, 0) },
                least_violation: Table { columns: vec![], values: DMatrix::zeros(FRAMES, 0) },
                verdicts: verdicts.collect(),
            },
            muscles: MUSCLES
                .iter()
                .map(|m| MuscleInfo { full_name: m.1.into(), f_max: m.2, clipped: Some(0.0) })
                .collect(),
            settings: vec![
                ("Cost".into(), "Σ f², weights of condition 2".into()),
                ("Ankle".into(), "universal".into()),
            ],
            simulated: vec![
                "43 muscles, bounded by their strength".into(),
                "Knee with sphere-on-plane contacts".into(),
            ],
            left_out: vec![("Reserve moments".into(), "not asked for".into())],
            notes: vec![],
            overlay: None,
        }
    }

    pub fn report(&self) -> OptimizeReport<'_> {
        OptimizeReport {
            trial: &self.trial,
            motion: &self.motion,
            loads: &self.loads,
            effort: &self.effort,
            muscles: &self.muscles,
            cycle: Some([0.0, CYCLE]),
            settings: &self.settings,
            simulated: &self.simulated,
            left_out: &self.left_out,
            notes: &self.notes,
            measured: self.overlay.as_ref(),
            bands: None,
            passive: None,
            emg: None,
            samples: None,
            gait2392: None,
        }
    }

    /// [`UNSOLVED`]: frames 51 to 53 infeasible, 71 failed, 81 and 82 without marker fit.
    pub fn spoil(mut self) -> Walk {
        for i in 50..53 {
            let verdict = &mut self.effort.verdicts[i];
            verdict.status = Status::Infeasible;
            verdict.reason = Some("the loads exceed the strength".into());
            verdict.shortfall = vec![Shortfall { coordinate: "ankle_flexion".into(), missing: -12.34 }];
            verdict.saturated = vec!["soleus".into(), "gasmed".into()];
        }
        self.effort.verdicts[70].status = Status::Failed;
        self.effort.verdicts[70].reason = Some("iteration limit".into());
        self.effort.verdicts[70].kkt_residual = f64::NAN;
        let names = [self.effort.forces.columns.clone(), self.effort.reactions.columns.clone()].concat();
        let mut least = DMatrix::from_element(FRAMES, names.len(), f64::NAN);
        (50..53).for_each(|i| least.row_mut(i).fill(1000.0 + i as f64));
        self.effort.least_violation = Table { columns: names, values: least };
        for table in [&mut self.effort.forces, &mut self.effort.activations, &mut self.effort.reactions] {
            for i in UNSOLVED {
                table.values.row_mut(i).fill(f64::NAN);
            }
        }
        for i in 80..82 {
            self.motion.fit[MARGIN + i].failure = Some("thigh: 1 of 3 markers seen".into());
        }
        self.muscles[0].clipped = Some(0.125);
        self
    }

    pub fn with_measured_knee(mut self) -> Walk {
        let time: Vec<f64> = (0..160).map(|i| i as f64 / 120.0).collect();
        let p = |t: &f64| t / CYCLE;
        let medial = time
            .iter()
            .map(|t| 100.0 + 900.0 * bump(p(t), 0.17, 0.1) + 1050.0 * bump(p(t), 0.49, 0.1))
            .collect();
        let lateral = time
            .iter()
            .map(|t| 60.0 + 500.0 * bump(p(t), 0.16, 0.1) + 300.0 * bump(p(t), 0.5, 0.1))
            .collect();
        let measured = KneeForces { time, medial, lateral };
        self.overlay = Some(Overlay::new(&measured, &self.effort, self.trial.subject.mass).unwrap());
        self
    }
}

/// Frames that [`Walk::spoil`] leaves without a solution, counted from 0.
pub const UNSOLVED: [usize; 6] = [50, 51, 52, 70, 80, 81];

/// The coordinates of the leg with the universal ankle.
pub const MOMENTS: [&str; 6] =
    ["hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion", "ankle_flexion", "subtalar_inversion"];

/// The names that the model gives its reactions, both ankles together.
pub fn reaction_names() -> Vec<&'static str> {
    REACTIONS.iter().map(|reaction| reaction.name).collect()
}
