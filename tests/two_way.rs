//! Does two-way coupling settle, and do the joint moments that the thigh misses fall?

use std::path::Path;

use coupling::fixed_point::Scheme;
use coupling::scene::Scene;
use coupling::study::{Prepared, Study};
use coupling::two_way::{Pass, TOLERANCE};

/// Muscles across the hip and across the knee, coarse.
const SCENE: &str = "muscles = [\"gluteus_maximus\", \"gluteus_medius\", \"vastus_lateralis\"]\nresolution_mm = 18.0\n[effects]\ncontact = \"none\"\n";

fn solved() -> (Prepared, Study) {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::parse(Path::new("mine.toml"), SCENE, None).unwrap();
    let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
    let study = prepared.solve([true, false], &folder.path().join("out"), false, &mut |_| ()).unwrap();
    (prepared, study)
}

fn last_change(passes: &[Pass]) -> f64 {
    passes.last().and_then(|p| p.change).unwrap()
}

#[test]
fn iqn_ils_settles_in_fewer_passes_than_relaxation_and_missing_moments_fall() {
    let (prepared, study) = solved();
    let run = |scheme| prepared.two_way(&study, scheme, 16).unwrap().passes;
    let (quick, slow) = (run(Scheme::IqnIls(1.0)), run(Scheme::Relaxation(0.5)));
    for (name, passes) in [("IQN-ILS", &quick), ("relaxation", &slow)] {
        for (k, p) in passes.iter().enumerate() {
            println!("{name} {}: {:?} {:.3} N m {:?}", k + 1, p.change, p.largest_missing(), p.changed_most);
        }
    }
    // Which muscles keep moments missing is told completely: what force sharing counts on is all that it asks of the thigh.
    for pass in quick.iter().chain(&slow) {
        for (missing, lacking) in pass.missing.iter().zip(&pass.lacking) {
            for (c, m) in missing.iter().enumerate() {
                let sum: f64 = lacking.iter().map(|l| l[c]).sum();
                assert!((sum - m).abs() < 1e-6, "coordinate {c}: {m} N m, of all muscles {sum}");
            }
        }
    }
    // README, docs/results.md: at most 8 passes, fewer than relaxation, at most a tenth of the moments missing.
    assert!(last_change(&quick) < TOLERANCE && quick.len() <= 8, "{} passes", quick.len());
    assert!(last_change(&slow) < TOLERANCE && slow.len() > quick.len(), "{} passes", slow.len());
    let (before, after) = (quick[0].largest_missing(), quick[quick.len() - 1].largest_missing());
    assert!(after < 0.1 * before, "{before} N m before, {after} N m after");
}
