//! Does either side by itself say what `compare` says, and does a state that was saved go on to the same bits?

use std::path::Path;
use std::sync::{Arc, OnceLock};

use coupling::comparison::{Comparison, Prepared, Sized};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::Scene;
use coupling::session::{RigidSession, RigidSide, ThighSession, ThighSide};
use coupling::two_way::capacity::MuscleCapacity;
use coupling::two_way::fixed_point::{FixedPoint, Scheme};
use coupling::two_way::{MOST_PASSES, TOLERANCE};
use nalgebra::DVector;

/// Three muscles: two across the hip, one of them across the knee too, and one across the knee.
const SCENE: &str =
    "muscles = [\"adductor_magnus\", \"semimembranosus\", \"vastus_lateralis\"]\nresolution_mm = 20.0\n";

/// What `compare` says of the scene, and the sides of it without and with contact.
struct Known {
    comparison: Comparison,
    prepared: Prepared,
    thighs: [Arc<ThighSide>; 2],
    rigid: Arc<RigidSide>,
    _folder: tempfile::TempDir,
}

fn scene(text: &str) -> Scene {
    Scene::parse(Path::new("mine.toml"), text, None).unwrap()
}

fn known() -> &'static Known {
    static KNOWN: OnceLock<Known> = OnceLock::new();
    KNOWN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let prepared = || Prepared::new(scene(SCENE), None, &mut |_| ()).unwrap();
        let asked = PerConfiguration { without: true, with: true };
        let comparison = prepared().solve(asked, &out, false, &mut |_| ()).unwrap();
        let written = comparison.calibration.written();
        let thigh = |c| Arc::new(ThighSide::new(prepared(), c, Some(written.clone()), &out).unwrap());
        let thighs = Configuration::ALL.map(thigh);
        let rigid =
            Arc::new(RigidSide::new(Sized::new(scene(SCENE), None).unwrap(), written.clone()).unwrap());
        Known { comparison, prepared: prepared(), thighs, rigid, _folder: folder }
    })
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Gives the thigh what the rigid leg says at a time, and solves it.
fn carry(rigid: &mut RigidSession, thigh: &mut ThighSession, time: f64) {
    rigid.go_to(time).unwrap();
    let told = rigid.result().unwrap().clone();
    thigh.set_poses(&told.poses).unwrap();
    thigh.set_activations(&told.drives).unwrap();
    thigh.set_twists(&told.twists).unwrap();
    let knee: Vec<f64> = told.nominal.iter().map(|c| c.lever_arms[3]).collect();
    thigh.set_rigid_knee_arms(&knee).unwrap();
    thigh.solve().unwrap();
}

#[test]
fn either_side_by_itself_says_what_compare_says_to_the_last_bit() {
    let known = known();
    assert!(known.rigid.muscles().iter().map(String::as_str).eq(known.thighs[0].muscles()));
    for (side, (_, solution)) in known.thighs.iter().zip(known.comparison.solutions.present()) {
        let mut rigid = RigidSession::new(known.rigid.clone());
        let mut thigh = ThighSession::new(side.clone());
        for (step, (forces, frame)) in
            known.comparison.steps.iter().zip(solution.steps.iter().zip(solution.at_steps()))
        {
            carry(&mut rigid, &mut thigh, step.time);
            assert_eq!(bits(thigh.positions()), bits(&frame.x));
            let told = rigid.result().unwrap();
            for (m, muscle) in thigh.result().muscles.iter().enumerate() {
                assert_eq!(muscle.section, forces.muscles[m]);
                let line = step.muscle(&known.rigid.muscles()[m]).unwrap();
                assert_eq!(told.muscle_forces[m].to_bits(), line.force().norm().to_bits());
            }
        }
    }
}

#[test]
fn a_state_that_was_saved_goes_on_to_the_same_bits_and_no_other_is_taken() {
    let known = known();
    let [alone, touching] = &known.thighs;
    let mut rigid = RigidSession::new(known.rigid.clone());
    let mut thigh = ThighSession::new(touching.clone());
    let times: Vec<f64> = known.comparison.steps.iter().map(|s| s.time).collect();
    carry(&mut rigid, &mut thigh, times[0]);
    let (saved, saved_rigid) = (thigh.save(), rigid.save());
    let first = thigh.result().clone();
    carry(&mut rigid, &mut thigh, times[1]);
    let second = (bits(thigh.positions()), thigh.result().clone());
    for _ in 0..2 {
        thigh.restore(&saved).unwrap();
        rigid.restore(&saved_rigid).unwrap();
        assert_eq!(thigh.result(), &first);
        carry(&mut rigid, &mut thigh, times[1]);
        assert_eq!((bits(thigh.positions()), thigh.result().clone()), second);
    }
    // Another session of the same thigh takes it; another thigh, and a damaged one, do not.
    let mut other = ThighSession::new(touching.clone());
    other.restore(&saved).unwrap();
    assert_eq!(other.save(), saved);
    let mut stranger = ThighSession::new(alone.clone());
    let before = stranger.save();
    let refused = stranger.restore(&saved).unwrap_err().to_string();
    assert!(refused.contains("another scene, side or version"), "{refused}");
    for damaged in [&saved[..saved.len() - 3], &saved[..5], &[], b"sartorius\0s1\xff\xff\xff\xff\xff\xff"] {
        assert!(other.restore(damaged).unwrap_err().to_string().contains("no state of this thigh"));
    }
    assert_eq!((stranger.save(), other.save()), (before, saved.clone()));
    assert!(rigid.restore(&saved).unwrap_err().to_string().contains("another scene"));
}

#[test]
fn what_cannot_be_is_refused_with_what_it_must_be() {
    let known = known();
    let mut thigh = ThighSession::new(known.thighs[0].clone());
    let before = thigh.save();
    let said = |result: Result<(), coupling::error::CouplingError>| result.unwrap_err().to_string();
    assert!(
        said(thigh.set_activations(&[0.0, 2.0, -1.0]))
            .contains("number 2 is 2, number 3 is -1; must be from 0 to 1.8")
    );
    assert!(said(thigh.set_activations(&[f64::NAN; 3])).contains("number 1 is NaN"));
    assert!(said(thigh.set_activations(&[0.0])).contains("1 numbers, must be 3"));
    let mut poses = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]; 4];
    (poses[1][3], poses[3][0]) = (1.1, f64::INFINITY);
    let words = said(thigh.set_poses(&poses));
    assert!(
        words.contains("pose of thigh") && words.contains("length 1.1") && words.contains("pose of shank"),
        "{words}"
    );
    assert!(said(thigh.set_poses(&poses[..2])).contains("must be 4 (pelvis, thigh, patella, shank)"));
    assert_eq!(thigh.save(), before);
    let mut rigid = RigidSession::new(known.rigid.clone());
    assert!(said(rigid.go_to(100.0)).contains("no frame at 100 s"));
    assert!(said(rigid.go_to(f64::NAN)).contains("NaN"));
    let nothing = MuscleCapacity { through_belly: 0.0, ..MuscleCapacity::default() };
    assert!(said(rigid.set_capacities(Some(&[nothing; 3]))).contains("fractions through the belly"));
    assert_eq!(rigid.time(), known.rigid.times()[0]);
}

#[test]
fn forces_on_the_bones_add_up_to_nothing() {
    let known = known();
    for side in &known.thighs {
        let mut rigid = RigidSession::new(known.rigid.clone());
        let mut thigh = ThighSession::new(side.clone());
        carry(&mut rigid, &mut thigh, known.comparison.steps[1].time);
        let result = thigh.result().clone();
        // Nothing else holds the tissue; what is left is the residual, a norm over all nodes.
        for i in 0..3 {
            let sum: f64 = result.wrenches.iter().map(|w| w[i]).sum();
            let size: f64 = result.wrenches.iter().map(|w| w[i].abs()).sum();
            assert!(sum.abs() < 0.05 * size + 1.0, "axis {i}: {sum} N of {size} N");
        }
    }
}

#[test]
fn passes_between_two_sessions_are_those_of_compare_two_way() {
    let known = known();
    let (scheme, n) = (Scheme::IqnIls(1.0), MuscleCapacity::N);
    let wanted = known
        .prepared
        .two_way(&known.comparison, Configuration::WithoutContact, scheme, MOST_PASSES)
        .unwrap();
    let times: Vec<f64> = known.comparison.steps.iter().map(|s| s.time).collect();
    let mut rigid = RigidSession::new(known.rigid.clone());
    let mut thigh = ThighSession::new(known.thighs[0].clone());
    let m = known.rigid.muscles().len();
    let mut states = Vec::new();
    // What the thigh shows at a step, over what it was asked with.
    let image = |thigh: &mut ThighSession, before: &[MuscleCapacity]| -> (Vec<f64>, Vec<bool>) {
        let (mut x, mut shows) = (Vec::new(), Vec::new());
        for (now, before) in thigh.result().muscles.iter().zip(before) {
            let pulls = now.through_belly.is_some();
            let capacity = MuscleCapacity {
                shift: if pulls { now.elongation } else { before.shift },
                tissue: now.tissue,
                through_belly: now.through_belly.unwrap_or(before.through_belly),
                lever_arms: std::array::from_fn(|c| now.lever_arms[c].unwrap_or(before.lever_arms[c])),
            };
            x.extend(capacity.scaled());
            shows.extend([pulls, true, pulls].into_iter().chain(now.lever_arms.iter().map(Option::is_some)));
        }
        (x, shows)
    };
    let (mut x, mut shown) = (Vec::new(), Vec::new());
    for time in &times {
        carry(&mut rigid, &mut thigh, *time);
        let nominal = rigid.result().unwrap().nominal.clone();
        let (image, shows) = image(&mut thigh, &nominal);
        x.extend(image);
        shown.extend(shows);
        states.push(thigh.save());
    }
    let (mut x, mut ever) = (DVector::from_vec(x), shown.clone());
    let mut fixed_point = FixedPoint::new(scheme);
    let mut changes = Vec::new();
    while changes.len() + 1 < MOST_PASSES {
        let (mut images, mut shows) = (Vec::new(), Vec::new());
        for (k, time) in times.iter().enumerate() {
            let numbers = &x.as_slice()[k * m * n..(k + 1) * m * n];
            let capacities: Vec<MuscleCapacity> = numbers.chunks(n).map(MuscleCapacity::of_scaled).collect();
            rigid.set_capacities(Some(&capacities)).unwrap();
            thigh.restore(&states[k]).unwrap();
            carry(&mut rigid, &mut thigh, *time);
            let (image, seen) = image(&mut thigh, &capacities);
            images.extend(image);
            shows.extend(seen);
            states[k] = thigh.save();
        }
        let image = DVector::from_vec(images);
        let change = (&image - &x).norm() / image.norm();
        changes.push(change);
        if change < TOLERANCE {
            break;
        }
        if shows != shown {
            fixed_point = FixedPoint::new(scheme);
        }
        x = fixed_point.next(&x, &image);
        for i in (0..x.len()).filter(|&i| shows[i] && !std::mem::replace(&mut ever[i], true)) {
            x[i] = image[i];
        }
        shown = shows;
    }
    let of_compare: Vec<f64> = wanted.passes.iter().filter_map(|p| p.change).collect();
    println!("{changes:?} and {of_compare:?}");
    assert_eq!(changes.len(), of_compare.len());
    for (here, there) in changes.iter().zip(&of_compare) {
        assert!((here - there).abs() < 1e-9 * there, "{here} and {there}");
    }
    assert!(*changes.last().unwrap() < TOLERANCE, "not settled");
}

#[test]
fn stiffness_is_the_change_of_the_wrench_between_equilibria() {
    let text = "muscles = [\"vastus_lateralis\"]\nresolution_mm = 20.0\n[accuracy]\nresidual_n = 0.001\n[effects]\ncontact = \"none\"\n";
    let folder = tempfile::tempdir().unwrap();
    let prepared = Prepared::new(scene(text), None, &mut |_| ()).unwrap();
    let side =
        ThighSide::new(prepared, Configuration::WithoutContact, None, &folder.path().join("out")).unwrap();
    let hip = side.prepared().registration.frames().hip;
    let side = Arc::new(side);
    let sized = Sized::new(scene(text), None).unwrap();
    let rigid = RigidSide::new(sized, side.calibration().written()).unwrap();
    let time = side.prepared().steps[1].time;
    let mut thigh = ThighSession::new(side.clone());
    let mut rigid = RigidSession::new(Arc::new(rigid));
    carry(&mut rigid, &mut thigh, time);
    // Taut, so that equilibria are sharp.
    thigh.set_activations(&[0.5]).unwrap();
    thigh.solve().unwrap();
    let stiffness = thigh.stiffness().unwrap();
    let (saved, poses) = (thigh.save(), rigid.result().unwrap().poses);
    // The patella, at which it pulls.
    let patella = 2;
    let h = 2e-5;
    let mut largest: f64 = 0.0;
    for column in 0..6 {
        let wrench = |sign: f64| {
            let mut moved = poses;
            let pose = coupling::session::as_pose(&moved[patella]).unwrap();
            let by = nalgebra::Vector3::from_fn(|i, _| if i == column % 3 { sign * h } else { 0.0 });
            let centre = nalgebra::Translation3::from(hip);
            let turn =
                nalgebra::UnitQuaternion::from_scaled_axis(if column < 3 { Default::default() } else { by });
            let way = nalgebra::Translation3::from(if column < 3 { by } else { Default::default() });
            moved[patella] = coupling::session::numbers(&(way * centre * turn * centre.inverse() * pose));
            let mut thigh = ThighSession::new(side.clone());
            thigh.restore(&saved).unwrap();
            thigh.set_poses(&moved).unwrap();
            thigh.solve().unwrap();
            thigh.result().wrenches[patella]
        };
        let (ahead, behind) = (wrench(1.0), wrench(-1.0));
        for row in 0..6 {
            let found = (ahead[row] - behind[row]) / (2.0 * h);
            let (here, size) = (stiffness[patella][row][column], stiffness[patella][row][row].abs());
            largest = largest.max((here - found).abs() / size);
            println!("{row} {column}: {here:.3} and {found:.3}");
        }
    }
    println!("largest difference {largest:.2e} of the diagonal");
    // Equilibria to 0.001 N, over 2 x 20 micrometres: 25 N/m, of a diagonal of thousands.
    assert!(largest < 0.05, "{largest}");
}
