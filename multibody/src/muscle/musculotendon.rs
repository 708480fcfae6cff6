//! Musculotendon lengths: the full muscle paths of the gait2392 model on its own joints.
//!
//! gait2392 (Delp et al., IEEE Trans Biomed Eng 1990;37:757 and later revisions) has three kinds of path points: fixed
//! in a body, fixed but present only in a range of a joint coordinate, and moving with a coordinate along cubic
//! splines (the patella, which the model does not have as a body). Paths are straight between points. All numbers
//! come from tables (`gait-data/muscles_gait2392*.csv`, `joints_gait2392.csv`), so a scaled model runs through the
//! same code.
//!
//! Frames: X forward, Y up, Z right; positions in m, in the frame of the body; lengths are found in the pelvis.

#![allow(non_snake_case)]

use std::sync::LazyLock;

use nalgebra::{Rotation3, Unit, Vector3};
use thiserror::Error;

use super::{MuscleTendon, N_MUSCLES};

/// Joint coordinates of the gait2392 right leg, in our signs \[rad\]; the toes stay straight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GenericPosture {
    /// Hip flexion, positive forward.
    pub hip_flexion: f64,
    /// Hip adduction.
    pub hip_adduction: f64,
    /// Hip internal rotation.
    pub hip_rotation: f64,
    /// Knee flexion, positive when bent (gait2392 counts extension positive).
    pub knee_flexion: f64,
    /// Ankle dorsiflexion.
    pub ankle_dorsiflexion: f64,
    /// Subtalar inversion.
    pub subtalar: f64,
}

impl GenericPosture {
    /// Coordinates in the order of [`COORDINATES`], with the signs of gait2392.
    fn coordinates(&self) -> [f64; 7] {
        [
            self.hip_flexion,
            self.hip_adduction,
            self.hip_rotation,
            -self.knee_flexion,
            self.ankle_dorsiflexion,
            self.subtalar,
            0.0,
        ]
    }
}

/// What is wrong with a table of muscles, points or joints.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TableError {
    /// Not CSV, or a missing column.
    #[error("table of {table}: {source}")]
    Csv {
        /// `muscles`, `points` or `joints`.
        table: &'static str,
        /// What the reader says, with the line.
        source: csv::Error,
    },
    /// A row that means nothing.
    #[error("table of {table}, line {line}: {reason}")]
    Row {
        /// `muscles`, `points` or `joints`.
        table: &'static str,
        /// Line of the table, counted from 1.
        line: u64,
        /// What is wrong and what is expected.
        reason: String,
    },
    /// The table as a whole is incomplete.
    #[error("table of {table}: {reason}")]
    Incomplete {
        /// `muscles`, `points` or `joints`.
        table: &'static str,
        /// What is missing.
        reason: String,
    },
}

/// Bodies from the pelvis to the toes; body i + 1 hangs on body i by joint i.
const BODIES: [&str; 6] = ["pelvis", "femur_r", "tibia_r", "talus_r", "calcn_r", "toes_r"];
const JOINTS: [&str; 5] = ["hip_r", "knee_r", "ankle_r", "subtalar_r", "mtp_r"];
const COORDINATES: [&str; 7] = [
    "hip_flexion_r",
    "hip_adduction_r",
    "hip_rotation_r",
    "knee_angle_r",
    "ankle_angle_r",
    "subtalar_angle_r",
    "mtp_angle_r",
];

/// OpenSim keeps a conditional point this much beyond its range \[rad\] (`ConditionalPathPoint::isActive`).
const RANGE_SLACK: f64 = 1e-5;

/// Cubic spline through knots, extended by straight lines; OpenSim's `SimmSpline`.
///
/// The third derivative of the first and last piece is that of the cubic through the four outermost knots (SPLINE of
/// Forsythe, Malcolm, Moler, Computer Methods for Mathematical Computations, 1977). Two knots give a line, three a
/// parabola.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    x: Vec<f64>,
    /// Per knot: value, slope, half the second derivative, a sixth of the third (to its right).
    coefficients: Vec<[f64; 4]>,
}

impl Spline {
    /// Through the points (x, y); `None` unless there are as many x as y, two at least, finite, with x increasing.
    pub fn new(x: &[f64], y: &[f64]) -> Option<Self> {
        let n = x.len();
        let finite = x.iter().chain(y).all(|v| v.is_finite());
        if n < 2 || y.len() != n || !finite || x.windows(2).any(|w| w[0] >= w[1]) {
            return None;
        }
        let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
        let chord: Vec<f64> = (0..n - 1).map(|i| (y[i + 1] - y[i]) / h[i]).collect();
        let sigma = sixth_of_second_derivative(x, &h, &chord);
        let mut coefficients: Vec<[f64; 4]> = (0..n - 1)
            .map(|i| {
                let slope = chord[i] - h[i] * (sigma[i + 1] + 2.0 * sigma[i]);
                [y[i], slope, 3.0 * sigma[i], (sigma[i + 1] - sigma[i]) / h[i]]
            })
            .collect();
        let last = chord[n - 2] + h[n - 2] * (sigma[n - 2] + 2.0 * sigma[n - 1]);
        coefficients.push([y[n - 1], last, 0.0, 0.0]);
        Some(Self { x: x.to_vec(), coefficients })
    }

    /// The value at `x`.
    pub fn value(&self, x: f64) -> f64 {
        let i = self.x.partition_point(|&knot| knot <= x);
        let [a, b, c, d] = self.coefficients[i.max(1) - 1];
        let dx = x - self.x[i.max(1) - 1];
        if i == 0 { a + dx * b } else { a + dx * (b + dx * (c + dx * d)) }
    }
}

/// σ = S''/6 at the knots: continuity of the slope inside, prescribed third derivatives in the outer pieces.
fn sixth_of_second_derivative(x: &[f64], h: &[f64], chord: &[f64]) -> Vec<f64> {
    let n = x.len();
    if n == 2 {
        return vec![0.0; 2];
    }
    let mut diagonal = vec![0.0; n];
    let mut right = vec![0.0; n];
    for i in 1..n - 1 {
        diagonal[i] = 2.0 * (h[i - 1] + h[i]);
        right[i] = chord[i] - chord[i - 1];
    }
    diagonal[0] = -h[0];
    diagonal[n - 1] = -h[n - 2];
    if n > 3 {
        // Third divided difference of the four knots from i on.
        let third = |i: usize| {
            let second = |j: usize| (chord[j + 1] - chord[j]) / (x[j + 2] - x[j]);
            (second(i + 1) - second(i)) / (x[i + 3] - x[i])
        };
        right[0] = h[0] * h[0] * third(0);
        right[n - 1] = -h[n - 2] * h[n - 2] * third(n - 4);
    }
    // Symmetric tridiagonal elimination; the off-diagonals are h.
    for i in 1..n {
        let t = h[i - 1] / diagonal[i - 1];
        diagonal[i] -= t * h[i - 1];
        right[i] -= t * right[i - 1];
    }
    right[n - 1] /= diagonal[n - 1];
    for i in (0..n - 1).rev() {
        right[i] = (right[i] - h[i] * right[i + 1]) / diagonal[i];
    }
    right
}

/// A spline of one joint coordinate (index in [`COORDINATES`]).
type Function = (usize, Spline);

/// A joint of the chain: X_parent_child = offset · translate(t(q)) · rotate(axis₁) rotate(axis₂) rotate(axis₃).
#[derive(Clone, Debug, Default)]
struct Joint {
    offset: Vector3<f64>,
    rotations: Vec<(Unit<Vector3<f64>>, usize)>,
    translations: Vec<(Vector3<f64>, Function)>,
}

#[derive(Clone, Debug)]
enum Place {
    Fixed(Vector3<f64>),
    Moving([Function; 3]),
}

#[derive(Clone, Debug)]
struct PathPoint {
    body: usize,
    place: Place,
    /// Coordinate and its range in which the point is part of the path.
    active: Option<(usize, f64, f64)>,
}

/// Muscle paths and joints of a gait2392-like right leg.
#[derive(Clone, Debug)]
pub struct MusculotendonModel {
    /// Parameters of the muscles, in the order of the muscle table.
    pub units: Vec<MuscleTendon>,
    joints: [Joint; 5],
    paths: Vec<Vec<PathPoint>>,
}

impl MusculotendonModel {
    /// The generic gait2392 right leg.
    pub fn generic() -> &'static Self {
        static MODEL: LazyLock<MusculotendonModel> = LazyLock::new(|| {
            MusculotendonModel::from_tables(
                include_str!("../../../gait-data/muscles_gait2392.csv"),
                include_str!("../../../gait-data/muscles_gait2392_points.csv"),
                include_str!("../../../gait-data/joints_gait2392.csv"),
            )
            .expect("built-in tables are well formed")
        });
        &MODEL
    }

    /// From three tables in the form of `muscles_gait2392.csv`, `muscles_gait2392_points.csv`, `joints_gait2392.csv`.
    pub fn from_tables(muscles: &str, points: &str, joints: &str) -> Result<Self, TableError> {
        let units = super::read_units(muscles)?;
        let paths = read_paths(points, &units)?;
        Ok(Self { units, joints: read_joints(joints)?, paths })
    }

    /// Length of each muscle with its tendons \[m\], in the order of `units`.
    pub fn lengths(&self, posture: &GenericPosture) -> [f64; N_MUSCLES] {
        self.lengths_at(&posture.coordinates())
    }

    fn lengths_at(&self, q: &[f64; 7]) -> [f64; N_MUSCLES] {
        let poses = self.poses(q);
        std::array::from_fn(|m| {
            let mut length = 0.0;
            let mut previous: Option<Vector3<f64>> = None;
            for point in self.paths[m].iter().filter(|p| p.is_active(q)) {
                let local = match &point.place {
                    Place::Fixed(local) => *local,
                    Place::Moving(functions) => {
                        Vector3::from_fn(|i, _| functions[i].1.value(q[functions[i].0]))
                    }
                };
                let (R, p) = &poses[point.body];
                let here = R * local + p;
                length += previous.map_or(0.0, |last| (here - last).norm());
                previous = Some(here);
            }
            length
        })
    }

    /// Rotation and origin of every body in the pelvis.
    fn poses(&self, q: &[f64; 7]) -> [(Rotation3<f64>, Vector3<f64>); 6] {
        let mut poses = [(Rotation3::identity(), Vector3::zeros()); 6];
        for (i, joint) in self.joints.iter().enumerate() {
            let (R_parent, p_parent) = poses[i];
            let mut p = joint.offset;
            for (axis, (coordinate, spline)) in &joint.translations {
                p += axis * spline.value(q[*coordinate]);
            }
            let mut R = Rotation3::identity();
            for (axis, coordinate) in &joint.rotations {
                R *= Rotation3::from_axis_angle(axis, q[*coordinate]);
            }
            poses[i + 1] = (R_parent * R, R_parent * p + p_parent);
        }
        poses
    }
}

impl PathPoint {
    fn is_active(&self, q: &[f64; 7]) -> bool {
        self.active.is_none_or(|(coordinate, from, to)| {
            (from - RANGE_SLACK..=to + RANGE_SLACK).contains(&q[coordinate])
        })
    }
}

/// One row of a table, with its line for messages.
pub(super) struct Row {
    table: &'static str,
    line: u64,
    cells: std::collections::HashMap<String, String>,
}

impl Row {
    pub(super) fn error(&self, reason: impl Into<String>) -> TableError {
        TableError::Row { table: self.table, line: self.line, reason: reason.into() }
    }

    pub(super) fn text(&self, column: &str) -> Result<&str, TableError> {
        let cell = self.cells.get(column).ok_or_else(|| self.error(format!("no column `{column}`")))?;
        Ok(cell.trim())
    }

    pub(super) fn number(&self, column: &str) -> Result<f64, TableError> {
        let text = self.text(column)?;
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.error(format!("`{column}` holds `{text}`, expected a number"))),
        }
    }

    fn vector(&self, columns: [&str; 3]) -> Result<Vector3<f64>, TableError> {
        Ok(Vector3::new(self.number(columns[0])?, self.number(columns[1])?, self.number(columns[2])?))
    }

    fn index(&self, name: &str, names: &[&str]) -> Result<usize, TableError> {
        let known = || self.error(format!("`{name}` is not one of {}", names.join(", ")));
        names.iter().position(|n| *n == name).ok_or_else(known)
    }

    fn spline(&self, knots: &str, values: &str) -> Result<Spline, TableError> {
        let list = |column: &str| -> Result<Vec<f64>, TableError> {
            let text = self.text(column)?;
            let numbers = text.split(';').map(|part| part.trim().parse::<f64>().ok()).collect::<Option<_>>();
            numbers.ok_or_else(|| {
                self.error(format!("`{column}` holds `{text}`, expected numbers separated by semicolons"))
            })
        };
        Spline::new(&list(knots)?, &list(values)?).ok_or_else(|| {
            let rule = "need equally many finite numbers, two at least, with increasing knots";
            self.error(format!("`{knots}` and `{values}` {rule}"))
        })
    }
}

/// Rows of a CSV table; lines that start with `#` are comments.
pub(super) fn rows(table: &'static str, text: &str) -> Result<Vec<Row>, TableError> {
    let csv = |source| TableError::Csv { table, source };
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let columns: Vec<String> = reader.headers().map_err(csv)?.iter().map(String::from).collect();
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(csv)?;
        let line = record.position().map_or(0, csv::Position::line);
        let cells = columns.iter().cloned().zip(record.iter().map(String::from)).collect();
        rows.push(Row { table, line, cells });
    }
    Ok(rows)
}

fn read_paths(text: &str, units: &[MuscleTendon]) -> Result<Vec<Vec<PathPoint>>, TableError> {
    let mut paths = vec![Vec::new(); units.len()];
    for row in rows("points", text)? {
        let name = row.text("muscle")?;
        let muscle = units.iter().position(|u| u.name == name);
        let muscle =
            muscle.ok_or_else(|| row.error(format!("muscle `{name}` is not in the muscle table")))?;
        let path: &mut Vec<PathPoint> = &mut paths[muscle];
        if row.number("order")? != (path.len() + 1) as f64 {
            return Err(row.error(format!("point out of order, expected number {}", path.len() + 1)));
        }
        let coordinate = || row.index(row.text("coordinate")?, &COORDINATES);
        let (place, active) = match row.text("type")? {
            "PathPoint" => (Place::Fixed(row.vector(["x_m", "y_m", "z_m"])?), None),
            "ConditionalPathPoint" => {
                let range = (coordinate()?, row.number("range_min_rad")?, row.number("range_max_rad")?);
                (Place::Fixed(row.vector(["x_m", "y_m", "z_m"])?), Some(range))
            }
            "MovingPathPoint" => {
                let function = |knots, values| Ok((coordinate()?, row.spline(knots, values)?));
                let functions = [
                    function("x_knots_rad", "x_values_m")?,
                    function("y_knots_rad", "y_values_m")?,
                    function("z_knots_rad", "z_values_m")?,
                ];
                (Place::Moving(functions), None)
            }
            other => {
                let kinds = "PathPoint, ConditionalPathPoint, MovingPathPoint";
                return Err(row.error(format!("type `{other}` is not one of {kinds}")));
            }
        };
        path.push(PathPoint { body: row.index(row.text("body")?, &BODIES)?, place, active });
    }
    for (unit, path) in units.iter().zip(&paths) {
        if path.iter().filter(|p| p.active.is_none()).count() < 2 {
            let reason = format!("muscle `{}` has fewer than two permanent points", unit.name);
            return Err(TableError::Incomplete { table: "points", reason });
        }
    }
    Ok(paths)
}

fn read_joints(text: &str) -> Result<[Joint; 5], TableError> {
    let mut joints: [Joint; 5] = Default::default();
    let mut placed = [false; 5];
    for row in rows("joints", text)? {
        let j = row.index(row.text("joint")?, &JOINTS)?;
        let item = row.text("item")?;
        let vector = row.vector(["x", "y", "z"])?;
        let note = row.text("note")?;
        if row.text("kind")? == "offset_frame" {
            if item == BODIES[j] {
                joints[j].offset = vector;
                placed[j] = true;
            } else if vector != Vector3::zeros() {
                return Err(row.error("the joint must sit at the origin of its child body"));
            }
            continue;
        }
        let field = |key: &str| note.split(' ').find_map(|part| part.strip_prefix(key)).unwrap_or("");
        let (coordinate, function) = (field("coordinate="), field("function="));
        if function == "Constant" {
            continue; // all constants of the model are zero
        }
        let coordinate = row.index(coordinate, &COORDINATES)?;
        let rotation = item.starts_with("rotation");
        match function {
            "LinearFunction" if rotation => {
                let axis = Unit::try_new(vector, 1e-6).ok_or_else(|| row.error("the axis has no length"))?;
                joints[j].rotations.push((axis, coordinate));
            }
            "SimmSpline" if !rotation => {
                let spline = row.spline("knots", "values")?;
                joints[j].translations.push((vector, (coordinate, spline)));
            }
            other => return Err(row.error(format!("`{item}` cannot be driven by `{other}`"))),
        }
    }
    match placed.iter().position(|p| !p) {
        Some(j) => {
            let reason = format!("joint `{}` has no offset frame on `{}`", JOINTS[j], BODIES[j]);
            Err(TableError::Incomplete { table: "joints", reason })
        }
        None => Ok(joints),
    }
}
