//! Solved frames of a run as files from which it goes on, to the last bit where it would have been.
//!
//! `NAME_0000.state` holds where all nodes are after a frame, in double precision, and what the solver reported on the way. It begins with
//! the caller's key of everything that led there: a state with another key is not taken. Numbers are stored as their bits.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::mesh::MeshError;
use crate::mesh::format::write_whole;
use crate::run::{Advanced, DriveFrame, Frame};
use crate::solve::{Advance, Iteration, Motion};

/// A frame as stored.
#[derive(Deserialize, Serialize)]
struct State {
    key: String,
    frame: usize,
    /// Positions of all nodes \[m\].
    x: Vec<u64>,
    /// Velocities \[m/s\]; empty without inertia.
    v: Vec<u64>,
    islands: Vec<PackedAdvance>,
    iterations: Vec<(String, [u64; 12])>,
    prescribed_overlaps: Vec<([String; 2], usize)>,
}

/// File of a frame.
pub fn state_file(folder: &Path, name: &str, frame: usize) -> PathBuf {
    folder.join(format!("{name}_{frame:04}.state"))
}

/// Removes all states of a run, which nothing else needs once it is complete.
pub fn remove_states(folder: &Path, name: &str) -> std::io::Result<()> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
    };
    for entry in entries {
        let entry = entry?;
        let file_name = entry.file_name();
        let rest = file_name.to_str().and_then(|f| f.strip_prefix(name)?.strip_prefix('_'));
        let digits = rest.and_then(|r| r.strip_suffix(".part").unwrap_or(r).strip_suffix(".state"));
        if digits.is_some_and(|d| d.len() >= 4 && d.bytes().all(|b| b.is_ascii_digit())) {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Stores a solved frame.
pub(crate) fn save(
    folder: &Path,
    name: &str,
    key: &str,
    frame: usize,
    done: &Advanced,
) -> Result<(), MeshError> {
    let state = State {
        key: key.to_string(),
        frame,
        x: done.frame.x.iter().map(|x| x.to_bits()).collect(),
        v: done.frame.v.iter().map(|v| v.to_bits()).collect(),
        islands: done.frame.islands.iter().map(pack_advance).collect(),
        iterations: done.iterations.iter().map(pack_iteration).collect(),
        prescribed_overlaps: done.frame.prescribed_overlaps.clone(),
    };
    let bytes = serde_json::to_vec(&state).expect("a state is plain data");
    write_whole(&state_file(folder, name, frame), &bytes)
}

/// The frame that was stored with this key; `None` where there is none, or not a whole one.
pub(crate) fn load(
    folder: &Path,
    name: &str,
    key: &str,
    frame: usize,
    n: usize,
    to: &DriveFrame,
) -> Option<Advanced> {
    let bytes = std::fs::read(state_file(folder, name, frame)).ok()?;
    let state: State = serde_json::from_slice(&bytes).ok()?;
    let whole = state.x.len() == n && [0, n].contains(&state.v.len());
    if state.key != key || state.frame != frame || !whole {
        return None;
    }
    Some(Advanced {
        frame: Frame {
            time: to.time,
            load: to.load.clone(),
            x: state.x.into_iter().map(f64::from_bits).collect(),
            v: state.v.into_iter().map(f64::from_bits).collect(),
            islands: state.islands.iter().map(unpack_advance).collect(),
            prescribed_overlaps: state.prescribed_overlaps,
        },
        errors: Vec::new(),
        iterations: state.iterations.into_iter().map(unpack_iteration).collect(),
    })
}

/// Counts, states and times; loads of indefinite Hessians and of unstable equilibria; what explicit dynamics says, or nothing.
type PackedAdvance = ([u64; 21], Vec<u64>, Vec<u64>, Vec<u64>);

fn pack_motion(m: &Motion) -> Vec<u64> {
    let values =
        [m.time_step, m.natural_step, m.mass, m.added_mass, m.kinetic, m.stored, m.dissipated, m.work];
    let more = [m.kinetic_before, m.largest_kinetic, m.lag, m.added_kinetic];
    std::iter::once(m.steps as u64).chain(values.into_iter().chain(more).map(f64::to_bits)).collect()
}

fn unpack_motion(packed: &[u64]) -> Option<Motion> {
    let [steps, values @ ..] = packed else { return None };
    let values: [u64; 12] = values.try_into().ok()?;
    let [
        time_step,
        natural_step,
        mass,
        added_mass,
        kinetic,
        stored,
        dissipated,
        work,
        kinetic_before,
        largest,
        lag,
        added_kinetic,
    ] = values.map(f64::from_bits);
    Some(Motion {
        steps: *steps as usize,
        time_step,
        natural_step,
        mass,
        added_mass,
        kinetic,
        stored,
        dissipated,
        work,
        kinetic_before,
        largest_kinetic: largest,
        lag,
        added_kinetic,
    })
}

fn pack_advance(a: &Advance) -> PackedAdvance {
    let counts = [
        a.load_steps,
        a.retries,
        a.loose_steps,
        a.work,
        a.iterations,
        a.linear_iterations,
        a.factorizations,
        usize::from(a.tested_stable),
        a.soft_ways,
        usize::from(a.gone_again),
        a.crossed_pairs,
    ]
    .map(|n| n as u64);
    let state = [a.residual, a.wanted, a.force_scale, a.energy, a.least_det_f];
    let times = [a.assembly_s, a.factorization_s, a.linear_s, a.contact_s, a.total_s];
    let bits = |list: &[f64]| list.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
    let mut numbers = [0; 21];
    let all = counts.into_iter().chain(state.map(f64::to_bits)).chain(times.map(f64::to_bits));
    numbers.iter_mut().zip(all).for_each(|(to, from)| *to = from);
    let motion = a.motion.as_ref().map_or_else(Vec::new, pack_motion);
    (numbers, bits(&a.indefinite_at), bits(&a.unstable_at), motion)
}

fn unpack_advance(packed: &PackedAdvance) -> Advance {
    let (numbers, indefinite, unstable, motion) = packed;
    let [c0, c1, c2, c3, c4, c5, c6, stable, soft_ways, again, crossed, values @ ..] = numbers;
    let values = values.map(f64::from_bits);
    let [residual, wanted, force_scale, energy, least_det_f, times @ ..] = values;
    let [assembly_s, factorization_s, linear_s, contact_s, total_s] = times;
    let list = |bits: &[u64]| bits.iter().map(|b| f64::from_bits(*b)).collect::<Vec<f64>>();
    Advance {
        load_steps: *c0 as usize,
        retries: *c1 as usize,
        loose_steps: *c2 as usize,
        work: *c3 as usize,
        iterations: *c4 as usize,
        linear_iterations: *c5 as usize,
        factorizations: *c6 as usize,
        tested_stable: *stable == 1,
        soft_ways: *soft_ways as usize,
        gone_again: *again == 1,
        crossed_pairs: *crossed as usize,
        residual,
        wanted,
        force_scale,
        energy,
        least_det_f,
        indefinite_at: list(indefinite),
        unstable_at: list(unstable),
        motion: unpack_motion(motion),
        assembly_s,
        factorization_s,
        linear_s,
        contact_s,
        total_s,
    }
}

fn pack_iteration(i: &Iteration) -> (String, [u64; 12]) {
    let values = [i.load, i.residual, i.force_scale, i.energy, i.step_length, i.least_det_f, i.seconds];
    let [v0, v1, v2, v3, v4, v5, v6] = values.map(f64::to_bits);
    let counts = [i.step, i.iteration, i.linear_iterations, i.factorizations].map(|n| n as u64);
    let [c0, c1, c2, c3] = counts;
    (i.island.clone(), [c0, c1, c2, c3, u64::from(i.projected), v0, v1, v2, v3, v4, v5, v6])
}

fn unpack_iteration((island, packed): (String, [u64; 12])) -> Iteration {
    let [c0, c1, c2, c3, projected, values @ ..] = packed;
    let [load, residual, force_scale, energy, step_length, least_det_f, seconds] = values.map(f64::from_bits);
    Iteration {
        island,
        step: c0 as usize,
        load,
        iteration: c1 as usize,
        residual,
        force_scale,
        energy,
        step_length,
        least_det_f,
        linear_iterations: c2 as usize,
        factorizations: c3 as usize,
        projected: projected == 1,
        seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_comes_back_to_the_last_bit() {
        let advance = Advance {
            load_steps: 1,
            retries: 2,
            loose_steps: 12,
            work: 13,
            tested_stable: true,
            soft_ways: 14,
            gone_again: true,
            crossed_pairs: 15,
            wanted: 1e-7,
            iterations: 3,
            linear_iterations: 4,
            factorizations: 5,
            residual: 0.1 + 0.2,
            force_scale: f64::INFINITY,
            energy: -1e-300,
            least_det_f: 6.0,
            indefinite_at: vec![0.25, 1.0 / 3.0],
            unstable_at: vec![0.5],
            motion: Some(Motion { steps: 3, time_step: 0.1, largest_kinetic: -1e-300, ..Motion::default() }),
            assembly_s: 7.0,
            factorization_s: 8.0,
            linear_s: 9.0,
            contact_s: 9.5,
            total_s: 10.0,
        };
        assert_eq!(unpack_advance(&pack_advance(&advance)), advance);
        let iteration = Iteration {
            island: "a, b".into(),
            step: 1,
            load: 0.1,
            iteration: 2,
            residual: 1e-17,
            force_scale: 3.0,
            energy: -0.0,
            step_length: 0.5,
            least_det_f: f64::INFINITY,
            linear_iterations: 4,
            factorizations: 5,
            projected: true,
            seconds: 0.123456789,
        };
        assert_eq!(unpack_iteration(pack_iteration(&iteration)), iteration);
    }
}
