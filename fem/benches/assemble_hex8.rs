//! How long do energy, forces and stiffness of a hexahedron of mean dilatation take?
//!
//! `cargo bench -p sartorius-fem --bench assemble_hex8`; divide by the number of elements in the name. One thread.

use divan::{Bencher, black_box};
use fem::effect::{Effect, Solid, State, solid::Uniform};
use fem::element::{Formulation, shape};
use fem::material::{Isotropic, MooneyRivlin, MooneyRivlinDyna};

const N: usize = 10;

fn main() {
    divan::main();
}

/// N³ elements, slightly deformed.
fn block<L: Isotropic + 'static>(law: L) -> (impl Effect, Vec<f64>) {
    let at = |i: usize, j: usize, k: usize| (i + (N + 1) * (j + (N + 1) * k)) as u32;
    let mut points = Vec::new();
    for n in 0..(N + 1).pow(3) {
        let p = [n % (N + 1), n / (N + 1) % (N + 1), n / (N + 1).pow(2)];
        points.push(p.map(|p| 0.001 * p as f64));
    }
    let cells = (0..N * N * N).map(|c| {
        let (i, j, k) = (c % N, c / N % N, c / (N * N));
        let ring = |k| [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k)];
        let (a, b) = (ring(k), ring(k + 1));
        [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
    });
    let x =
        points.iter().flat_map(|p| [1.05 * p[0] + 0.02 * p[1], 0.97 * p[1], p[2] - 0.01 * p[0]]).collect();
    let solid =
        Solid::new("b", Uniform(law), Formulation::MeanDilatation, &shape::hex8(), &points, cells.collect());
    (solid.expect("good shape"), x)
}

const MOONEY: MooneyRivlin = MooneyRivlin { c10: 3e3, c01: 0.75e3, bulk: 747.5e3 };

#[divan::bench]
fn energy_1000(bencher: Bencher) {
    let (solid, x) = block(MOONEY);
    bencher.bench_local(|| black_box(solid.energy(&State { x: &x, controls: &[] })));
}

#[divan::bench]
fn forces_1000(bencher: Bencher) {
    let (solid, x) = block(MOONEY);
    let mut out = vec![0.0; 24 * N * N * N];
    bencher.bench_local(|| solid.forces(&State { x: &x, controls: &[] }, 0, black_box(&mut out)));
}

#[divan::bench(args = [0.0, 1.0])]
fn stiffness_1000(bencher: Bencher, convexity: f64) {
    let (solid, x) = block(MOONEY);
    let mut out = vec![0.0; 576 * 16];
    bencher.bench_local(|| {
        for first in (0..N * N * N).step_by(16) {
            let n = 16.min(N * N * N - first);
            solid.stiffness(
                &State { x: &x, controls: &[] },
                convexity,
                first,
                black_box(&mut out[..576 * n]),
            );
        }
    });
}

#[divan::bench]
fn stiffness_of_a_coupled_law_1000(bencher: Bencher) {
    let (solid, x) = block(MooneyRivlinDyna { a: 3e3, b: 0.75e3, nu: 0.495 });
    let mut out = vec![0.0; 576];
    bencher.bench_local(|| {
        for first in 0..N * N * N {
            solid.stiffness(&State { x: &x, controls: &[] }, 0.0, first, black_box(&mut out));
        }
    });
}
