//! Musculotendon lengths and activations of one frame of 43 muscles, on one thread.
//!
//! The gait is a squat between 0 and 60 degrees of knee flexion in 101 frames at 100 Hz. `cargo bench -p
//! sartorius-multibody --bench hill`; times per iteration are for all 101 frames, the item throughput counts frames.

use divan::counter::ItemsCount;
use multibody::muscle::curves::{Curves, DeGroote2016, Thelen2003};
use multibody::muscle::hill::{FibreVelocity, Settings, Tendon, activations, equilibrium, tendon_force};
use multibody::muscle::musculotendon::{GenericPosture, MusculotendonModel};
use nalgebra::DMatrix;

const N_FRAMES: usize = 101;
const RATE: f64 = 100.0;

fn main() {
    divan::main();
}

fn posture(frame: usize) -> GenericPosture {
    let bend = 0.5 * (1.0 - (2.0 * std::f64::consts::PI * frame as f64 / N_FRAMES as f64).cos());
    GenericPosture {
        hip_flexion: bend,
        knee_flexion: 1.05 * bend,
        ankle_dorsiflexion: 0.3 * bend,
        ..Default::default()
    }
}

fn lengths_of_trial() -> DMatrix<f64> {
    let model = MusculotendonModel::generic();
    let rows: Vec<f64> = (0..N_FRAMES).flat_map(|i| model.lengths(&posture(i))).collect();
    DMatrix::from_row_slice(N_FRAMES, model.units.len(), &rows)
}

const fn settings(curves: Curves, tendon: Tendon) -> Settings {
    Settings { curves, tendon, velocity: FibreVelocity::LowPass { cutoff_hz: 6.0 } }
}

const CHOICES: [(&str, Settings); 4] = [
    ("thelen_rigid", settings(Curves::Thelen(Thelen2003::GAIT2392), Tendon::Rigid)),
    ("thelen_elastic", settings(Curves::Thelen(Thelen2003::GAIT2392), Tendon::Elastic)),
    ("degroote_rigid", settings(Curves::DeGroote(DeGroote2016::OPENSIM), Tendon::Rigid)),
    ("degroote_elastic", settings(Curves::DeGroote(DeGroote2016::OPENSIM), Tendon::Elastic)),
];

#[divan::bench]
fn lengths(bencher: divan::Bencher) {
    MusculotendonModel::generic();
    bencher.counter(ItemsCount::new(N_FRAMES)).bench(lengths_of_trial);
}

#[divan::bench(args = CHOICES.map(|c| c.0))]
fn force_to_activation(bencher: divan::Bencher, choice: &str) {
    let settings = CHOICES.iter().find(|c| c.0 == choice).expect("listed above").1;
    let units = &MusculotendonModel::generic().units;
    let lengths = lengths_of_trial();
    let forces = DMatrix::from_fn(N_FRAMES, units.len(), |_, m| 0.3 * units[m].f_max);
    bencher
        .counter(ItemsCount::new(N_FRAMES))
        .bench(|| activations(units, &lengths, &forces, RATE, &settings).expect("shapes agree"));
}

#[divan::bench]
fn activation_to_force(bencher: divan::Bencher) {
    let units = &MusculotendonModel::generic().units;
    let curves = Curves::default();
    bencher.counter(ItemsCount::new(1usize)).bench(|| -> f64 {
        units.iter().map(|u| tendon_force(u, &curves, divan::black_box(0.3), 0.9, -0.1)).sum()
    });
}

#[divan::bench]
fn equilibrium_of_fibre_and_tendon(bencher: divan::Bencher) {
    let units = &MusculotendonModel::generic().units;
    let curves = Curves::default();
    let lengths = MusculotendonModel::generic().lengths(&posture(20));
    bencher.counter(ItemsCount::new(1usize)).bench(|| -> f64 {
        units
            .iter()
            .zip(lengths)
            .filter_map(|(u, l)| equilibrium(u, &curves, l, 0.0, divan::black_box(0.3)).ok())
            .map(|e| e.force)
            .sum()
    });
}
