//! A law of a user's own, verified: problem 1 of Land et al., Proc. R. Soc. A 471 (2015) 20150641.
//!
//! `cargo run --release -p sartorius-fem --example land_beam`
//!
//! A beam of 10 × 1 × 1 mm of Guccione's law, fibres along it, held at x = 0, pressed from below by 4 Pa that stay normal to the bent face.
//! Number to expect, asserted on the finest mesh: the end of the line (10, 0.5, 1) mm comes to lie at z = 4.14 to 4.20 mm.

mod beam;
mod laws;

use beam::{PRESSURE, PUBLISHED, beam, tip};
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::solve::Settings;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("| cells | bulk modulus, kPa | tip z, mm | iterations | seconds |\n|---|---:|---:|---:|---:|");
    let mut last = 0.0;
    for (n, bulk) in [
        ([20, 1, 2], 1e6),
        ([40, 2, 4], 1e5),
        ([40, 2, 4], 1e6),
        ([40, 2, 4], 1e7),
        ([80, 2, 4], 1e6),
        ([80, 4, 8], 1e6),
    ] {
        let start = Instant::now();
        let (scene, mesh) = beam(n, bulk);
        let tip = tip(&mesh);
        let plan = Plan::new(&scene, mesh)?;
        let drive = Drive::once(plan.load(&[("p", PRESSURE)], &[])?);
        let done = run(&plan, &drive, &Settings::default(), None, &mut |_| {});
        let Some(frame) = done.last() else { return Err(done.errors[0].to_string().into()) };
        last = 1e3 * frame.x[3 * tip + 2];
        let iterations: usize = frame.islands.iter().map(|i| i.iterations).sum();
        let [x, y, z] = n;
        let seconds = start.elapsed().as_secs_f64();
        println!("| {x} x {y} x {z} | {:.0} | {last:.4} | {iterations} | {seconds:.1} |", bulk / 1e3);
    }
    match (PUBLISHED[0]..=PUBLISHED[1]).contains(&last) {
        true => Ok(()),
        false => Err(format!("{last:.4} mm is not in {PUBLISHED:?} mm").into()),
    }
}
