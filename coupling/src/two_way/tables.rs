//! Tables of two-way coupling.

use std::io::{self, Write};

use crate::steps::RigidStep;
use crate::thigh::build::Thigh;
use crate::two_way::Pass;
use crate::two_way::capacity::{COORDINATES, MuscleCapacity};

/// `passes.csv`: a row per pass.
pub fn write_passes(w: &mut dyn Write, steps: &[RigidStep], passes: &[Pass]) -> io::Result<()> {
    write!(w, "pass,capacity_change,changed_most,largest_missing_Nm,mean_difference_N")?;
    for step in steps {
        for coordinate in COORDINATES {
            write!(w, ",{}_{coordinate}_missing_Nm", step.name.name())?;
        }
    }
    writeln!(w)?;
    for (k, pass) in passes.iter().enumerate() {
        let change = pass.change.map_or(String::new(), |c| format!("{c:.6}"));
        let pairs = pass.wanted.iter().flatten().zip(pass.found.iter().flatten());
        let n = pass.found.iter().flatten().count().max(1) as f64;
        let mean = pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / n;
        let most = pass.changed_most.as_deref().unwrap_or("");
        write!(w, "{},{change},{most},{:.5},{mean:.4}", k + 1, pass.largest_missing())?;
        for v in pass.missing.iter().flatten() {
            write!(w, ",{v:.5}")?;
        }
        writeln!(w)?;
    }
    Ok(())
}

/// `missing_moments.csv`: a row per pass, step and muscle, which muscles keep moments missing.
pub fn write_missing(
    w: &mut dyn Write,
    thigh: &Thigh,
    steps: &[RigidStep],
    passes: &[Pass],
) -> io::Result<()> {
    write!(w, "pass,step,muscle,wanted_N,found_N")?;
    COORDINATES.iter().try_for_each(|coordinate| write!(w, ",{coordinate}_missing_Nm"))?;
    writeln!(w)?;
    for (p, pass) in passes.iter().enumerate() {
        for (k, step) in steps.iter().enumerate() {
            for (m, muscle) in thigh.muscles.iter().enumerate() {
                let (wanted, found) = (pass.wanted[k][m], pass.found[k][m]);
                write!(w, "{},{},{},{wanted:.3},{found:.3}", p + 1, step.name.name(), muscle.name)?;
                pass.lacking[k][m].iter().try_for_each(|v| write!(w, ",{v:.5}"))?;
                writeln!(w)?;
            }
        }
    }
    Ok(())
}

/// `capacities.csv`: what every muscle can do at every step as the last pass shows it, to the last bit. `bounds`: least and greatest tension
/// of every muscle at every step \[N\].
pub fn write_capacities(
    w: &mut dyn Write,
    thigh: &Thigh,
    steps: &[RigidStep],
    capacities: &[Vec<MuscleCapacity>],
    bounds: &[Vec<[f64; 2]>],
) -> io::Result<()> {
    write!(w, "step,muscle,elongation_m,tissue_N,through_belly")?;
    COORDINATES.iter().try_for_each(|coordinate| write!(w, ",{coordinate}_m"))?;
    writeln!(w, ",least_N,greatest_N,time_s,knee_flexion_deg")?;
    for (step, (of_step, bounds)) in steps.iter().zip(capacities.iter().zip(bounds)) {
        for (muscle, (c, [least, greatest])) in thigh.muscles.iter().zip(of_step.iter().zip(bounds)) {
            let MuscleCapacity { shift, tissue, through_belly, lever_arms } = c;
            write!(w, "{},{},{shift:?},{tissue:?},{through_belly:?}", step.name.name(), muscle.name)?;
            lever_arms.iter().try_for_each(|arm| write!(w, ",{arm:?}"))?;
            let knee = step.knee_flexion.to_degrees();
            writeln!(w, ",{least:?},{greatest:?},{:?},{knee:?}", step.time)?;
        }
    }
    Ok(())
}
