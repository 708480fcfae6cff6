//! A drive as a table: what a file with a row per time says of controls and bodies.
//!
//! A CSV file with a header; lines that begin with `#` are left out. Its columns, in any order:
//!
//! | column | what |
//! |---|---|
//! | `time_s` | time, increasing |
//! | `CONTROL`, `CONTROL_Pa`, `CONTROL_kPa` | value of a control; a bare name in the units of the scene |
//! | `BODY_x_m`, `BODY_y_m`, `BODY_z_m` (or `_mm`) | where the body takes the origin of the mesh |
//! | `BODY_rx_deg`, `BODY_ry_deg`, `BODY_rz_deg` (or `_rad`) | its rotation from the mesh: axis times angle |
//! | `BODY_qw`, `BODY_qx`, `BODY_qy`, `BODY_qz` | the same as a unit quaternion |
//!
//! Controls and bodies without columns are zero and where the mesh has them.

use crate::body::Pose;
use crate::plan::{Load, Plan};
use crate::run::{Drive, DriveFrame};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Deviation of the length of a quaternion from 1 that digits cut short explain.
const UNIT: f64 = 1e-3;

/// What is wrong with a table.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DriveError {
    /// It cannot be read.
    #[error("drive `{path}`: {source}; it must be a table of UTF-8 text, cells apart by commas")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: csv::Error,
    },
    /// All mistakes in it.
    #[error("drive `{path}`: {}", mistakes.iter().map(|(line, what)| format!("line {line}: {what}")).collect::<Vec<_>>().join("; "))]
    Mistakes {
        /// The file.
        path: PathBuf,
        /// Line and mistake, from the first line on.
        mistakes: Vec<(u64, String)>,
    },
}

/// What a column holds, with the factor to SI.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Column {
    Time,
    Control(usize, f64),
    /// Body, part (0 position, 1 rotation vector, 2 quaternion), component.
    Body(usize, usize, usize, f64),
}

/// Endings of the columns of a body: ending, part, component, factor.
fn endings() -> Vec<(String, usize, usize, f64)> {
    let mut all = Vec::new();
    for (c, axis) in ["x", "y", "z"].into_iter().enumerate() {
        all.push((format!("_{axis}_m"), 0, c, 1.0));
        all.push((format!("_{axis}_mm"), 0, c, 1e-3));
        all.push((format!("_r{axis}_rad"), 1, c, 1.0));
        all.push((format!("_r{axis}_deg"), 1, c, 1f64.to_radians()));
    }
    all.extend(
        ["w", "x", "y", "z"].into_iter().enumerate().map(|(c, axis)| (format!("_q{axis}"), 2, c, 1.0)),
    );
    all
}

fn column(name: &str, plan: &Plan) -> Option<Column> {
    let control = |name: &str| plan.controls.iter().position(|c| c == name);
    if name == "time_s" {
        return Some(Column::Time);
    }
    if let Some(at) = control(name) {
        return Some(Column::Control(at, 1.0));
    }
    for (ending, factor) in [("_Pa", 1.0), ("_kPa", 1e3)] {
        if let Some(at) = name.strip_suffix(ending).and_then(control) {
            return Some(Column::Control(at, factor));
        }
    }
    endings().into_iter().find_map(|(ending, part, c, factor)| {
        let body = name.strip_suffix(&ending)?;
        Some(Column::Body(plan.bodies.iter().position(|b| b == body)?, part, c, factor))
    })
}

/// The columns of a header; mistakes are added.
fn columns(
    header: &csv::StringRecord,
    plan: &Plan,
    mistakes: &mut Vec<(u64, String)>,
) -> Vec<Option<Column>> {
    let line = header.position().map_or(1, csv::Position::line);
    let columns: Vec<Option<Column>> = header.iter().map(|name| column(name, plan)).collect();
    for (name, _) in header.iter().zip(&columns).filter(|(_, c)| c.is_none()) {
        let names = |list: &[String]| if list.is_empty() { "none".to_string() } else { list.join(", ") };
        mistakes.push((
            line,
            format!(
                "column `{name}` is nothing that the scene has; known are `time_s`, its controls ({}), and of its bodies ({}) BODY_x_m, BODY_rx_deg, \
                 BODY_qw, ...",
                names(&plan.controls),
                names(&plan.bodies)
            ),
        ));
    }
    let is = |c: &Column, of: &Column| match (c, of) {
        (Column::Control(a, _), Column::Control(b, _)) => a == b,
        (Column::Body(a, p, i, _), Column::Body(b, q, j, _)) => (a, p, i) == (b, q, j),
        _ => c == of,
    };
    for (i, c) in columns.iter().enumerate() {
        if c.as_ref().is_some_and(|c| columns[..i].iter().flatten().any(|o| is(o, c))) {
            mistakes.push((
                line,
                format!("column `{}` gives once more what another gives; keep one of them", &header[i]),
            ));
        }
    }
    if !columns.contains(&Some(Column::Time)) {
        mistakes.push((line, "the column `time_s` is missing; every row needs a time".to_string()));
    }
    for (b, body) in plan.bodies.iter().enumerate() {
        let count = |part: usize| {
            columns
                .iter()
                .flatten()
                .filter(|c| matches!(c, Column::Body(of, p, ..) if (*of, *p) == (b, part)))
                .count()
        };
        for (part, needed, what) in
            [(0, 3, "x, y and z"), (1, 3, "rx, ry and rz"), (2, 4, "qw, qx, qy and qz")]
        {
            if count(part) != 0 && count(part) != needed {
                mistakes.push((line, format!("body `{body}` needs all columns of {what}, or none of them")));
            }
        }
        if count(1) > 0 && count(2) > 0 {
            mistakes.push((line, format!("body `{body}` has a rotation vector and a quaternion; keep one")));
        }
    }
    columns
}

/// A row as time, load and rotation vectors of the bodies, where given; mistakes are added.
fn row(
    values: &[f64],
    columns: &[Option<Column>],
    plan: &Plan,
    line: u64,
    mistakes: &mut Vec<(u64, String)>,
) -> (DriveFrame, Vec<Vector3<f64>>) {
    let mut load =
        Load { controls: vec![0.0; plan.controls.len()], poses: vec![Pose::identity(); plan.bodies.len()] };
    let mut time = 0.0;
    let mut parts = vec![([0.0; 3], [0.0; 3], [1.0, 0.0, 0.0, 0.0]); plan.bodies.len()];
    for (value, column) in values.iter().zip(columns) {
        match *column {
            Some(Column::Time) => time = *value,
            Some(Column::Control(at, factor)) => load.controls[at] = value * factor,
            Some(Column::Body(b, 0, c, factor)) => parts[b].0[c] = value * factor,
            Some(Column::Body(b, 1, c, factor)) => parts[b].1[c] = value * factor,
            Some(Column::Body(b, _, c, _)) => parts[b].2[c] = *value,
            None => {}
        }
    }
    let mut turns = Vec::new();
    for (b, (position, vector, [w, x, y, z])) in parts.into_iter().enumerate() {
        let q = Quaternion::new(w, x, y, z);
        if !((q.norm() - 1.0).abs() <= UNIT) {
            mistakes.push((
                line,
                format!("the quaternion of `{}` has length {:.4}, must be 1", plan.bodies[b], q.norm()),
            ));
        }
        let given = q != Quaternion::identity();
        let rotation = if given {
            UnitQuaternion::from_quaternion(q)
        } else {
            UnitQuaternion::from_scaled_axis(vector.into())
        };
        load.poses[b] = Pose::from_parts(Translation3::from(Vector3::from(position)), rotation);
        turns.push(vector.into());
    }
    (DriveFrame { time, load }, turns)
}

impl Drive {
    /// Reads the table `path` of a plan; see [`crate::drive`] for its columns. All mistakes are named at once, with their lines.
    pub fn read(path: &Path, plan: &Plan) -> Result<Drive, DriveError> {
        let text = |source: csv::Error| DriveError::Read { path: path.to_path_buf(), source };
        // After a return the reader counts the next row as of the line before.
        let bytes = std::fs::read(path).map_err(|source| text(source.into()))?;
        let after = bytes.iter().skip(1).chain([&b' ']);
        let table: Vec<u8> =
            bytes.iter().zip(after).filter(|of| *of != (&b'\r', &b'\n')).map(|of| *of.0).collect();
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(table.as_slice());
        let mut mistakes = Vec::new();
        let header = reader.headers().map_err(text)?.clone();
        let columns = columns(&header, plan, &mut mistakes);
        let mut frames: Vec<(u64, DriveFrame, Vec<Vector3<f64>>)> = Vec::new();
        for record in reader.records() {
            let record = record.map_err(text)?;
            let line = record.position().map_or(0, csv::Position::line);
            if record.len() != header.len() {
                mistakes.push((
                    line,
                    format!("{} fields, must be {} as in the header", record.len(), header.len()),
                ));
                continue;
            }
            let mut values = Vec::new();
            for (name, field) in header.iter().zip(&record) {
                let value = field.parse().ok().filter(|v: &f64| v.is_finite());
                if value.is_none() {
                    mistakes.push((line, format!("`{name}` is `{field}`, must be a finite number")));
                }
                values.push(value.unwrap_or(f64::NAN));
            }
            if values.iter().any(|v| v.is_nan()) {
                continue;
            }
            let (frame, turns) = row(&values, &columns, plan, line, &mut mistakes);
            if let Some((_, before, turned)) = frames.last() {
                if !(frame.time > before.time) {
                    mistakes.push((
                        line,
                        format!("time_s is {}, must be above {}, the one before", frame.time, before.time),
                    ));
                }
                for (body, (a, b)) in plan.bodies.iter().zip(turned.iter().zip(&turns)) {
                    if (b - a).norm() > std::f64::consts::PI {
                        let angle = (b - a).norm().to_degrees();
                        mistakes.push((
                            line,
                            format!(
                                "the rotation vector of `{body}` changes by {angle:.0} degrees, so that its way is not clear; add rows \
                                 less than 180 degrees apart, or write quaternions where it jumps by a whole turn"
                            ),
                        ));
                    }
                }
            }
            frames.push((line, frame, turns));
        }
        if frames.is_empty() && mistakes.is_empty() {
            mistakes.push((1, "there are no rows below the header; every frame needs one".to_string()));
        }
        mistakes.sort_by_key(|m| m.0);
        match mistakes.is_empty() {
            true => Ok(Drive { frames: frames.into_iter().map(|f| f.1).collect() }),
            false => Err(DriveError::Mistakes { path: path.to_path_buf(), mistakes }),
        }
    }

    /// The load at a time between the first and the last frame: controls in proportion, bodies turned about one axis at constant rate while the
    /// centre of the nodes tied to them moves on a straight line; `None` outside.
    pub fn at(&self, plan: &Plan, time: f64) -> Option<Load> {
        let after = self.frames.iter().position(|f| f.time >= time)?;
        let to = &self.frames[after];
        if to.time == time {
            return Some(to.load.clone());
        }
        let from = &self.frames[after.checked_sub(1)?];
        let fraction = (time - from.time) / (to.time - from.time);
        Some(from.load.towards(&to.load, &plan.pivots, fraction))
    }

    /// The same drive with frames in between, evenly, so that none is more than `longest` \[s\] after the one before.
    pub fn refined(&self, plan: &Plan, longest: f64) -> Drive {
        let mut frames: Vec<DriveFrame> = self.frames.iter().take(1).cloned().collect();
        for pair in self.frames.windows(2) {
            let way = pair[1].time - pair[0].time;
            let n = (way / longest).ceil().clamp(1.0, 1e6) as usize;
            for i in 1..=n {
                let time = if i == n { pair[1].time } else { pair[0].time + way * i as f64 / n as f64 };
                let load = self.at(plan, time).unwrap_or_else(|| pair[1].load.clone());
                frames.push(DriveFrame { time, load });
            }
        }
        Drive { frames }
    }
}
