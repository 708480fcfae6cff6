//! Poses of the bones of a knee against its femur, in clinical coordinates, and tables of them.

#![allow(non_snake_case)]

use std::path::Path;

use multibody::InputError;
use multibody::error::Place;
use multibody::read::with_plain_ends;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::error::CouplingError;

/// Turn between neighbouring rows \[degrees\] beyond which a table is refused.
pub(super) const LONGEST_TURN: f64 = 20.0;
/// The same of a shift \[mm\]: so far the origin of the patella goes, 60 mm from the middle of the femur, while the knee turns by as much.
pub(super) const LONGEST_SHIFT: f64 = 20.0;

/// A bone against the femur: R = Rz(−flexion) Rx(`turn_x`) Ry(`turn_y`), then the place of its origin, x forward, y up, z lateral.
///
/// Of the tibia `turn_x` is adduction and `turn_y` internal rotation, of the patella rotation (upper pole to lateral) and medial tilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// Degrees.
    pub flexion: f64,
    /// Degrees.
    pub turn_x: f64,
    /// Degrees.
    pub turn_y: f64,
    /// Millimetres: forward, up, lateral.
    pub place: [f64; 3],
}

impl Coordinates {
    /// As numbers: three angles \[degrees\] and three lengths \[mm\].
    pub fn to_array(self) -> [f64; 6] {
        let [x, y, z] = self.place;
        [self.flexion, self.turn_x, self.turn_y, x, y, z]
    }

    /// The inverse of [`to_array`](Coordinates::to_array).
    pub fn from_array([flexion, turn_x, turn_y, x, y, z]: [f64; 6]) -> Coordinates {
        Coordinates { flexion, turn_x, turn_y, place: [x, y, z] }
    }

    /// From the frame of the bone into that of the femur \[m\].
    pub fn pose(self) -> Isometry3<f64> {
        let about = |axis, degrees: f64| UnitQuaternion::from_axis_angle(&axis, degrees.to_radians());
        let rotation = about(Vector3::z_axis(), -self.flexion)
            * about(Vector3::x_axis(), self.turn_x)
            * about(Vector3::y_axis(), self.turn_y);
        Isometry3::from_parts(Translation3::from(1e-3 * Vector3::from(self.place)), rotation)
    }

    /// Turn \[degrees\] and shift \[mm\] since another pose.
    pub fn step_from(&self, other: &Coordinates) -> [f64; 2] {
        let [a, b] = [self, other].map(|c| c.pose());
        let shift = a.translation.vector - b.translation.vector;
        [a.rotation.angle_to(&b.rotation).to_degrees(), 1e3 * shift.norm()]
    }

    /// This pose and those between it and another, at most `stride` degrees of flexion apart, without that one.
    pub fn towards(&self, other: &Coordinates, stride: f64) -> Vec<Coordinates> {
        let [from, to] = [self, other].map(|c| c.to_array());
        let n = ((to[0] - from[0]).abs() / stride).ceil().max(1.0);
        let at = |k: usize| std::array::from_fn(|c| from[c] + (to[c] - from[c]) * k as f64 / n);
        (0..n as usize).map(|k| Coordinates::from_array(at(k))).collect()
    }

    /// The coordinates of a pose; `turn_x` from -90 to 90 degrees.
    pub fn of(pose: &Isometry3<f64>) -> Coordinates {
        let R: Matrix3<f64> = Rotation3::from(pose.rotation).into_inner();
        Coordinates {
            flexion: R[(0, 1)].atan2(R[(1, 1)]).to_degrees(),
            turn_x: R[(2, 1)].clamp(-1.0, 1.0).asin().to_degrees(),
            turn_y: (-R[(2, 0)]).atan2(R[(2, 2)]).to_degrees(),
            place: (1e3 * pose.translation.vector).into(),
        }
    }
}

/// Poses of the tibia by flexion of the knee, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct TibiaPath {
    rows: Vec<Coordinates>,
    /// Line of each in its file; of a made path its number.
    lines: Vec<usize>,
}

/// Columns of a table of poses, in the order of [`Coordinates::to_array`].
const COLUMNS: [&str; 6] = [
    "knee_flexion_deg",
    "knee_adduction_deg",
    "knee_internal_rotation_deg",
    "knee_anterior_mm",
    "knee_proximal_mm",
    "knee_lateral_mm",
];

impl TibiaPath {
    /// Reads a table of poses (CSV); all mistakes at once. Other columns are left alone.
    pub fn read(file: &Path) -> Result<TibiaPath, CouplingError> {
        TibiaPath::parse(&text_of(file)?, file)
    }

    /// The same of its text.
    pub fn parse(text: &str, file: &Path) -> Result<TibiaPath, CouplingError> {
        let [rows] = columns(text, file, [COLUMNS])?.try_into().expect("one group of columns");
        TibiaPath::new(rows, file)
    }

    /// A path that is known to be good: flexion increases, and rows are close to each other.
    pub(super) fn of(rows: Vec<Coordinates>) -> TibiaPath {
        TibiaPath { lines: (1..=rows.len()).collect(), rows }
    }

    /// Refuses rows whose flexion does not increase, and neighbours that are farther apart than a way is.
    fn new(rows: Vec<(usize, Coordinates)>, file: &Path) -> Result<TibiaPath, CouplingError> {
        let mut problems = Vec::new();
        for pair in rows.windows(2) {
            let [(_, a), (line, b)] = [pair[0], pair[1]];
            if b.flexion <= a.flexion {
                problems.push(format!(
                    "line {line}: knee_flexion_deg is {}, must be above {} of the row before",
                    b.flexion, a.flexion
                ));
            }
        }
        problems.extend(jumps("tibia", &rows));
        if rows.is_empty() {
            problems.push("no rows".to_string());
        }
        if problems.is_empty() {
            let (lines, rows) = rows.into_iter().unzip();
            return Ok(TibiaPath { rows, lines });
        }
        Err(malformed(
            file,
            problems,
            "give poses in the order of flexion, close enough to follow each other",
        ))
    }

    /// Least and greatest flexion \[degrees\].
    pub fn range(&self) -> [f64; 2] {
        [self.rows[0].flexion, self.rows[self.rows.len() - 1].flexion]
    }

    /// Rows as they are.
    pub fn rows(&self) -> &[Coordinates] {
        &self.rows
    }

    /// Line of every row in its file; of a made path its number.
    pub fn lines(&self) -> &[usize] {
        &self.lines
    }

    /// The pose at a flexion \[degrees\]; that of the nearest end outside. Between rows cubic, with the slope at a row of the parabola through it
    /// and its neighbours: a tibia whose velocity jumps at every row would let the contact force of the patella zigzag between rows.
    pub fn at(&self, flexion: f64) -> Coordinates {
        let [first, last] = self.range();
        let flexion = flexion.clamp(first, last);
        let next = self.rows.partition_point(|r| r.flexion < flexion).max(1).min(self.rows.len() - 1);
        let before = next.saturating_sub(1);
        let [a, b] = [before, next].map(|k| self.rows[k].to_array());
        let h = b[0] - a[0];
        if h <= 0.0 {
            return self.rows[before];
        }
        let t = (flexion - a[0]) / h;
        let [p, q] = [before, next].map(|k| self.slope(k));
        let between = |c: usize| {
            let chord = b[c] - a[c];
            // What the slopes at both ends have more than the chord.
            let [more_p, more_q] = [h * p[c] - chord, h * q[c] - chord];
            a[c] + t * chord + t * (1.0 - t) * ((1.0 - t) * more_p - t * more_q)
        };
        Coordinates::from_array(std::array::from_fn(|c| if c == 0 { flexion } else { between(c) }))
    }

    /// Slope of every coordinate over flexion at a row: that of the parabola through it and its two neighbours, at an end through the last three
    /// rows; of two rows that of their line.
    fn slope(&self, row: usize) -> [f64; 6] {
        let n = self.rows.len();
        let middle = row.clamp(1, n.saturating_sub(2).max(1));
        let secant = |k: usize| {
            let [a, b] = [k, k + 1].map(|k| self.rows[k].to_array());
            std::array::from_fn::<f64, 6, _>(|c| (b[c] - a[c]) / (b[0] - a[0]))
        };
        if n < 3 {
            return secant(0);
        }
        let at = |k: usize| self.rows[k].flexion;
        let [left, right] = [secant(middle - 1), secant(middle)];
        std::array::from_fn(|c| {
            let bend = (right[c] - left[c]) / (at(middle + 1) - at(middle - 1));
            left[c] + bend * (2.0 * at(row) - at(middle - 1) - at(middle))
        })
    }
}

/// Columns of a table that hold the patella, measured or computed.
pub const PATELLA: [&str; 6] = [
    "patella_flexion_deg",
    "patella_rotation_deg",
    "patella_medial_tilt_deg",
    "patella_anterior_mm",
    "patella_proximal_mm",
    "patella_lateral_mm",
];

/// Measured poses of tibia and patella, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Tibia and patella.
    pub rows: Vec<[Coordinates; 2]>,
    /// Line of each in its file.
    pub lines: Vec<usize>,
    /// Of every row, from how many frames of a recording it is a mean, where that is said.
    pub frames: Vec<f64>,
}

/// Column of [`Measured::frames`].
const FRAMES: &str = "frames";
/// A mean of more frames than this counts as a reference.
const FEW_FRAMES: f64 = 2.0;

impl Measured {
    /// Reads a table (CSV); all mistakes at once. Other columns are left alone.
    pub fn read(file: &Path) -> Result<Measured, CouplingError> {
        let text = text_of(file)?;
        let groups = columns(&text, file, [COLUMNS, PATELLA])?;
        let mut problems = jumps("tibia", &groups[0]);
        problems.extend(jumps("patella", &groups[1]));
        let frames = counted(&text, &mut problems);
        if groups[0].is_empty() {
            problems.push("no rows".to_string());
        }
        if !problems.is_empty() {
            return Err(malformed(file, problems, "give poses that follow each other closely"));
        }
        let rows = groups[0].iter().zip(&groups[1]).map(|((_, tibia), (_, patella))| [*tibia, *patella]);
        let lines = groups[0].iter().map(|row| row.0).collect();
        Ok(Measured { rows: rows.collect(), lines, frames })
    }

    /// The row nearest to extension that is a mean of more than two frames, or where that is not said the one nearest to extension.
    pub fn reference(&self) -> Option<usize> {
        let is_mean = |k: &usize| self.frames.get(*k).is_none_or(|n| *n > FEW_FRAMES);
        let flexion = |k: usize| self.rows[k][0].flexion;
        (0..self.rows.len()).filter(is_mean).min_by(|a, b| flexion(*a).total_cmp(&flexion(*b)))
    }
}

/// The column [`FRAMES`] of a table; nothing where there is none.
fn counted(text: &str, problems: &mut Vec<String>) -> Vec<f64> {
    let mut reader = reader(text);
    let at = reader.headers().ok().and_then(|header| header.iter().position(|h| h.trim() == FRAMES));
    let Some(at) = at else { return Vec::new() };
    let mut number = |row: csv::StringRecord| {
        let cell = row.get(at).unwrap_or("").trim();
        let count = cell.parse::<f64>().ok().filter(|n| n.is_finite() && *n >= 0.0);
        count.unwrap_or_else(|| {
            let line = row.position().map_or(0, |p| p.line());
            problems.push(format!("line {line}: {FRAMES} is `{cell}`, must be a number from 0 on"));
            0.0
        })
    };
    reader.records().flatten().map(&mut number).collect()
}

/// Jumps between neighbouring rows, in words.
fn jumps(bone: &str, rows: &[(usize, Coordinates)]) -> Vec<String> {
    let jumped = rows.windows(2).flat_map(|pair| {
        let [(_, a), (line, b)] = [pair[0], pair[1]];
        let [turn, shift] = b.step_from(&a);
        let turned = (turn > LONGEST_TURN).then(|| {
            format!(
                "line {line}: the {bone} turns by {turn:.1} degrees from the row before, must be at most {LONGEST_TURN}"
            )
        });
        let shifted = (shift > LONGEST_SHIFT).then(|| {
            format!(
                "line {line}: the {bone} moves by {shift:.1} mm from the row before, must be at most {LONGEST_SHIFT}"
            )
        });
        turned.into_iter().chain(shifted)
    });
    jumped.collect()
}

fn text_of(file: &Path) -> Result<String, InputError> {
    let text =
        std::fs::read_to_string(file).map_err(|source| InputError::Io { file: file.into(), source })?;
    Ok(with_plain_ends(&text))
}

/// Reads a table in which a cell that is missing is told like one that is empty.
fn reader(text: &str) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes())
}

/// Rows of a table with their lines, one list per group of six columns.
pub(super) fn columns<const N: usize>(
    text: &str,
    file: &Path,
    groups: [[&str; 6]; N],
) -> Result<Vec<Vec<(usize, Coordinates)>>, CouplingError> {
    let mut reader = reader(text);
    let header = reader.headers().map_err(|e| malformed(file, vec![e.to_string()], "give a header"))?.clone();
    let mut problems = Vec::new();
    let mut place = |name: &str| {
        let mut all = header.iter().enumerate().filter(|(_, h)| h.trim() == name).map(|(at, _)| at);
        let at = all.next();
        if at.is_none() {
            problems.push(format!("column `{name}` is missing"));
        }
        if all.next().is_some() {
            problems.push(format!("column `{name}` is there twice"));
        }
        at.unwrap_or(0)
    };
    let places = groups.map(|group| group.map(&mut place));
    if !problems.is_empty() {
        return Err(malformed(file, problems, "give all columns of the table, each once"));
    }
    let mut out = vec![Vec::new(); N];
    for row in reader.records() {
        let row = match row {
            Ok(row) => row,
            Err(e) => {
                problems.push(e.to_string());
                continue;
            }
        };
        let line = row.position().map_or(0, |p| p.line() as usize);
        for (group, list) in places.iter().zip(&mut out) {
            let mut number = |column: usize| {
                let cell = row.get(column).unwrap_or("").trim();
                let value = cell.parse::<f64>().ok().filter(|v| v.is_finite() && v.abs() <= 1e3);
                value.unwrap_or_else(|| {
                    problems.push(format!(
                        "line {line}: {} is `{cell}`, must be a number from -1000 to 1000",
                        &header[column]
                    ));
                    f64::NAN
                })
            };
            let values = group.map(&mut number);
            list.push((line, Coordinates::from_array(values)));
        }
    }
    if !problems.is_empty() {
        return Err(malformed(file, problems, "mend these cells"));
    }
    let problems: Vec<String> = out.iter().flat_map(|rows| other_units(rows)).collect();
    match problems.is_empty() {
        true => Ok(out),
        false => {
            Err(malformed(file, problems, "give degrees and millimetres, and more than 3 degrees of a way"))
        }
    }
}

/// What can be no degrees or millimetres of a group of columns, in words: a way of several rows on which nothing turns by more than half a circle in
/// radians, or all places are between a millimetre and a decimetre in metres.
fn other_units(rows: &[(usize, Coordinates)]) -> Vec<String> {
    let most = |of: fn(&[f64; 6]) -> &[f64]| {
        let all = rows.iter().flat_map(|row| of(&row.1.to_array()).to_vec());
        all.fold(0.0, |most: f64, v| most.max(v.abs()))
    };
    let [turn, shift] = [most(|row| &row[..3]), most(|row| &row[3..])];
    let mut problems = Vec::new();
    if rows.len() > 1 && turn > 0.0 && turn <= std::f64::consts::PI {
        problems.push(format!("no angle is above {turn}, as if they were radians"));
    }
    if rows.len() > 1 && shift > 1e-3 && shift < 0.1 {
        problems.push(format!("no place is beyond {shift}, as if they were metres"));
    }
    problems
}

fn malformed(file: &Path, problems: Vec<String>, remedy: &str) -> CouplingError {
    let problem = problems.join("; ");
    InputError::Malformed { file: file.into(), at: Place::Whole, problem, remedy: remedy.into() }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_come_back_from_their_pose() {
        let given = [70.0, -12.0, 8.0, 53.0, -17.0, 4.0];
        let found = Coordinates::of(&Coordinates::from_array(given).pose()).to_array();
        assert!(given.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        // Flexion takes what is proximal forward.
        let bent = Coordinates::from_array([90.0, 0.0, 0.0, 0.0, 0.0, 0.0]).pose();
        let tip = bent * nalgebra::Point3::new(0.0, 1.0, 0.0);
        assert!((tip - nalgebra::Point3::new(1.0, 0.0, 0.0)).norm() < 1e-12, "{tip}");
    }

    #[test]
    fn a_path_is_smooth_between_its_rows_and_its_mistakes_are_named_all_at_once() {
        let header = COLUMNS.join(",");
        let path = |rows: &str| TibiaPath::parse(&format!("{header}\n{rows}"), "t.csv".as_ref());
        let good = path("0,0,0,1,2,3\n10,1,4,2,0,3\n").unwrap();
        assert_eq!(good.at(2.5).to_array(), [2.5, 0.25, 1.0, 1.25, 1.5, 3.0]);
        assert_eq!([good.at(-5.0), good.at(50.0)], [good.rows()[0], good.rows()[1]]);
        // A parabola is itself, over rows that are not evenly spaced, and nothing but its rows is known where it ends.
        let bent = |f: f64| 0.01 * f * f - 0.3 * f + 1.0;
        let rows: String =
            [0.0, 4.0, 10.0, 13.0].iter().map(|f| format!("{f},{},0,0,0,0\n", bent(*f))).collect();
        let curved = path(&rows).unwrap();
        for f in [0.0, 1.0, 3.9, 4.0, 4.1, 7.0, 12.0, 13.0] {
            assert!((curved.at(f).turn_x - bent(f)).abs() < 1e-12, "{f}: {}", curved.at(f).turn_x);
        }
        // Nowhere does its velocity jump, whatever the rows.
        let wild = path("0,0,0,0,0,0\n5,0,0,3,0,0\n7,0,0,-1,0,0\n12,0,0,0,0,0\n").unwrap();
        let x = |f: f64| wild.at(f).place[0];
        for row in [5.0, 7.0] {
            let h = 1e-6;
            let [before, after] = [(x(row) - x(row - h)) / h, (x(row + h) - x(row)) / h];
            assert!((before - after).abs() < 1e-4, "{row}: {before} {after}");
        }
        let said = path("0,0,0,1,2,3\n-1,0,0,0,0,0\n40,0,0,0,0,0\n").unwrap_err().to_string();
        let needed =
            ["t.csv", "line 3: knee_flexion_deg is -1, must be above 0", "line 4: the tibia turns by 41.0"];
        assert!(needed.iter().all(|n| said.contains(n)), "{said}");
        let said = path("0,0,x,1,2,3\n1,0,0,NaN,0,0\n").unwrap_err().to_string();
        let needed = ["line 2: knee_internal_rotation_deg is `x`", "line 3: knee_anterior_mm is `NaN`"];
        assert!(needed.iter().all(|n| said.contains(n)), "{said}");
        let said = TibiaPath::parse("knee_flexion_deg\n1\n", "t.csv".as_ref()).unwrap_err().to_string();
        assert!(said.contains("column `knee_lateral_mm` is missing"), "{said}");
        let twice = TibiaPath::parse(&format!("{header},{}\n", COLUMNS[4]), "t.csv".as_ref());
        assert!(twice.unwrap_err().to_string().contains("column `knee_proximal_mm` is there twice"));
    }

    #[test]
    fn radians_and_metres_are_refused() {
        let header = COLUMNS.join(",");
        let said = |rows: &str| {
            TibiaPath::parse(&format!("{header}\n{rows}"), "t.csv".as_ref()).err().map(|e| e.to_string())
        };
        let radians = said("0,0,0,1,2,3\n0.3,0.1,0,4,2,3\n").unwrap();
        let [turn, shift] = ["as if they were radians", "as if they were metres"];
        assert!(radians.contains(turn) && !radians.contains(shift), "{radians}");
        let metres = said("0,0,0,0.001,0.002,0.003\n10,1,0,0.004,0.002,0.003\n").unwrap();
        assert!(metres.contains(shift) && !metres.contains(turn), "{metres}");
        // A tibia that stays where it is, but for round-off, is none of both, and neither is a way of one pose.
        assert_eq!([said("0,0,0,1e-15,0,0\n10,0,0,0,0,0\n"), said("0.3,0,0,0.01,0,0\n")], [None, None]);
        // Nor does the tibia tell of the units of the patella.
        let both = [&COLUMNS[..], &PATELLA[..]].concat().join(",");
        let text = format!("{both}\n10,0,0,1,2,3,0.2,0,0,50,5,3\n20,0,0,1,2,3,0.3,0,0,50,5,3\n");
        let patella = columns(&text, "m.csv".as_ref(), [COLUMNS, PATELLA]).unwrap_err().to_string();
        assert!(patella.contains("no angle is above 0.3"), "{patella}");
    }

    /// Lines are counted as an editor does, whatever they end with, and cells that are missing are told as those that are empty.
    #[test]
    fn a_table_of_another_system_is_told_of_by_its_lines() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("m.csv");
        let header = [&COLUMNS[..], &PATELLA[..], &[FRAMES]].concat().join(",");
        let rows = ["10,0,0,1,2,3,10,0,0,50,5,3,4", "12,0,0,1,2,x,10,0,0,50,5,3,4", "14,0,0,1,2,3,12"];
        for end in ["\n", "\r\n"] {
            std::fs::write(&file, [COLUMNS.join(",").as_str(), "0,0,0,1,2,3", "9,0,0,1,2,x"].join(end))
                .unwrap();
            let wrong = TibiaPath::read(&file).unwrap_err().to_string();
            assert!(wrong.contains("line 3: knee_lateral_mm is `x`"), "{wrong}");
            let said = |n: usize| {
                std::fs::write(&file, [&[header.as_str()], &rows[..n]].concat().join(end)).unwrap();
                Measured::read(&file).map_err(|error| error.to_string())
            };
            assert_eq!(said(1).unwrap().lines, [2]);
            let wrong = said(3).unwrap_err();
            for words in ["line 3: knee_lateral_mm is `x`", "line 4: patella_lateral_mm is ``"] {
                assert!(wrong.contains(words), "{words}: {wrong}");
            }
        }
        std::fs::write(&file, format!("{header}\n10,0,0,1,2,3,10,0,0,50,5,3,-4\n")).unwrap();
        let wrong = Measured::read(&file).unwrap_err().to_string();
        assert!(wrong.contains("line 2: frames is `-4`"), "{wrong}");
        // Millimetres at once.
        std::fs::write(&file, format!("{header}\n{0}\n{0}\n", rows[0]).replacen("50,5", "50,30", 1)).unwrap();
        let wrong = Measured::read(&file).unwrap_err().to_string();
        assert!(wrong.contains("line 3: the patella moves by 25.0 mm"), "{wrong}");
    }
}
