//! Does two-way coupling settle, and do the joint moments that the thigh misses fall?

use std::path::Path;

use coupling::comparison::{Comparison, Prepared};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::Scene;
use coupling::two_way::capacity::sewn;
use coupling::two_way::fixed_point::Scheme;
use coupling::two_way::{Pass, TOLERANCE};

/// Muscles across the hip and across the knee, coarse.
const SCENE: &str = "muscles = [\"gluteus_maximus\", \"gluteus_medius\", \"vastus_lateralis\"]\nresolution_mm = 18.0\n[effects]\ncontact = \"none\"\n";

/// The quadriceps, whose tendons are sewn together.
const QUADRICEPS: &str = "muscles = [\"rectus_femoris\", \"vastus_medialis\", \"vastus_intermedius\", \"vastus_lateralis\"]\n\
                          resolution_mm = 20.0\n[effects]\ncontact = \"none\"\n";

fn solved(scene: &str) -> (Prepared, Comparison) {
    solved_in(scene, PerConfiguration { without: true, with: false })
}

fn solved_in(scene: &str, asked: PerConfiguration<bool>) -> (Prepared, Comparison) {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::parse(Path::new("mine.toml"), scene, None).unwrap();
    let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
    let comparison = prepared.solve(asked, &folder.path().join("out"), false, &mut |_| ()).unwrap();
    (prepared, comparison)
}

fn last_change(passes: &[Pass]) -> f64 {
    passes.last().and_then(|p| p.change).unwrap()
}

#[test]
fn iqn_ils_settles_in_fewer_passes_than_relaxation_and_missing_moments_fall() {
    let (prepared, comparison) = solved(SCENE);
    let run =
        |scheme| prepared.two_way(&comparison, Configuration::WithoutContact, scheme, 16).unwrap().passes;
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

/// Seams pass force from head to head of the quadriceps, so at the knee a head alone has no lever arm. As one unit the heads share as the
/// rigid leg does, and the whole has the moment that the mesh makes.
#[test]
fn sewn_heads_are_one_unit_and_none_takes_all() {
    let (prepared, comparison) = solved(QUADRICEPS);
    let plan = &comparison.solutions.without.as_ref().unwrap().plan;
    let units = sewn(plan, &comparison.thigh);
    let names: Vec<Vec<&str>> = units
        .iter()
        .map(|u| u.iter().map(|&m| comparison.thigh.muscles[m].name.as_str()).collect())
        .collect();
    println!("{names:?}");
    let quadriceps = units.iter().find(|u| u.len() > 1).unwrap();
    assert_eq!((units.len(), quadriceps.len()), (1, 4), "{names:?}");
    let coupling =
        prepared.two_way(&comparison, Configuration::WithoutContact, Scheme::IqnIls(1.0), 16).unwrap();
    let (first, last) = (&coupling.passes[0], coupling.passes.last().unwrap());
    for (k, pass) in coupling.passes.iter().enumerate() {
        println!(
            "{}: {:?} {:.3} N m, {:?} N, {:?}",
            k + 1,
            pass.change,
            pass.largest_missing(),
            pass.wanted[1],
            pass.changed_most
        );
    }
    assert!(coupling.shortcomings.is_empty(), "{:?}", coupling.shortcomings);
    let fractions = |forces: &[f64]| {
        let sum: f64 = quadriceps.iter().map(|&m| forces[m]).sum();
        quadriceps.iter().map(|&m| forces[m] / sum).collect::<Vec<_>>()
    };
    // One-way 0.54, 0.11 and 0.35 of medialis, intermedius and lateralis; with lever arms of single heads lateralis had 0.0004.
    for forces in [&last.wanted[1], &last.found[1]] {
        for (one, two) in fractions(&first.wanted[1]).iter().zip(fractions(forces)) {
            assert!(two > 0.5 * one - 1e-3, "one-way {first:?}, two-way {last:?}");
        }
    }
    // At the knee the whole pulls as force sharing counts on.
    let knee: f64 = quadriceps.iter().map(|&m| last.lacking[1][m][3]).sum();
    assert!(knee.abs() < 0.2, "{knee} N m at the knee");
}

/// In contact a muscle moves joints by what it is tied to and by what it presses on. What all of them do is what all bones feel.
#[test]
fn with_contact_passes_settle_and_missing_moments_fall() {
    let scene = "muscles = [\"gluteus_maximus\", \"gluteus_medius\", \"vastus_lateralis\"]\nresolution_mm = 18.0\n\
                 [accuracy]\ncontact_residual_n = 0.5\n";
    let (prepared, comparison) = solved_in(scene, PerConfiguration { without: false, with: true });
    let coupling =
        prepared.two_way(&comparison, Configuration::WithContact, Scheme::IqnIls(1.0), 16).unwrap();
    let passes = &coupling.passes;
    for (k, p) in passes.iter().enumerate() {
        println!("{}: {:?} {:.3} N m {:?}", k + 1, p.change, p.largest_missing(), p.changed_most);
    }
    assert!(coupling.shortcomings.is_empty(), "{:?}", coupling.shortcomings);
    assert!(last_change(passes) < TOLERANCE);
    let (before, after) = (passes[0].largest_missing(), passes[passes.len() - 1].largest_missing());
    assert!(after < 0.1 * before, "{before} N m before, {after} N m after");
}
