//! Landmarks from a table: local coordinates of markers, joint centres and landmarks per segment
//! (columns `item, kind, segment, x_or_value, y, z`, as in `gait-data/reference_subject.csv`).

use std::collections::HashMap;

use nalgebra::Vector3;
use thiserror::Error;

use super::clusters::pelvis_axes;
use super::shifts::Shifts;
use super::{CalibrationError, HipCentre, apart, hip_centre};
use crate::anatomy::{Anatomy, Cluster, FootAxes, PelvisAxes, ShankAxes, ThighAxes};
use crate::natural::SegmentId;
use crate::read::with_plain_ends;
use crate::trial::Sex;

/// Why a table of landmarks cannot be used.
#[derive(Debug, Error)]
pub enum TableError {
    /// A row cannot be read.
    #[error("line {line}: {what}")]
    Row {
        /// Line in the file, from 1.
        line: u64,
        /// What is wrong and how to mend it.
        what: String,
    },
    /// A landmark is missing.
    #[error(
        "the table lacks `{item}` of the {segment}; add a row `{item},…,{segment},…` with its coordinates in m"
    )]
    Missing {
        /// Item that is missing.
        item: String,
        /// Segment it belongs to.
        segment: String,
    },
    /// Two landmarks that must be apart are not, as shifted.
    #[error(transparent)]
    TooClose(#[from] CalibrationError),
}

/// A row: local position of an item of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct TableItem {
    /// Name of the item.
    pub item: String,
    /// `marker`, `virtual marker`, `landmark`, `joint centre`, …
    pub kind: String,
    /// Segment in whose SCS the position is given.
    pub segment: SegmentId,
    /// Position \[m\].
    pub position: Vector3<f64>,
}

/// Reads the rows with a segment; rows without one (scalars) are skipped.
pub fn read(text: &str) -> Result<Vec<TableItem>, TableError> {
    let text = with_plain_ends(text);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let row_error = |line: u64, what: String| TableError::Row { line, what };
    let headers = reader.headers().map_err(|e| row_error(1, e.to_string()))?.clone();
    let column = |name: &str| {
        headers.iter().position(|h| h == name).ok_or_else(|| {
            row_error(
                1,
                format!(
                    "column `{name}` is missing; the header must name item, kind, segment, x_or_value, y, z"
                ),
            )
        })
    };
    let (item, kind, segment) = (column("item")?, column("kind")?, column("segment")?);
    let position = [column("x_or_value")?, column("y")?, column("z")?];
    let mut items = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(0, |p| p.line());
            row_error(line, e.to_string())
        })?;
        let line = record.position().map_or(0, |p| p.line());
        if record[segment].trim().is_empty() {
            continue;
        }
        let id =
            SegmentId::ALL.into_iter().find(|s| s.name() == record[segment].trim()).ok_or_else(|| {
                row_error(
                    line,
                    format!(
                        "unknown segment `{}`; known: pelvis, thigh, patella, shank, foot",
                        &record[segment]
                    ),
                )
            })?;
        let mut xyz = [0.0; 3];
        for (value, &c) in xyz.iter_mut().zip(&position) {
            *value =
                record[c].trim().parse::<f64>().ok().filter(|v| v.is_finite() && v.abs() < 3.0).ok_or_else(
                    || {
                        row_error(
                            line,
                            format!("`{}` is no coordinate in m (a number between -3 and 3)", &record[c]),
                        )
                    },
                )?;
        }
        items.push(TableItem {
            item: record[item].trim().to_string(),
            kind: record[kind].trim().to_string(),
            segment: id,
            position: Vector3::from(xyz),
        });
    }
    Ok(items)
}

/// Makes the anatomy from table items. `recorded`: recorded marker name of each table item that is a tracked marker.
///
/// The shank's forward axis is normal to its long axis and to the knee axis that the shank carries at zero knee flexion
/// (functional), which the knee model expects. `hip`: `None` takes the hip centre of the table. `shifts` of landmarks are in the SCS.
pub fn anatomy(
    items: &[TableItem],
    recorded: &HashMap<String, String>,
    hip: Option<HipCentre>,
    sex: Sex,
    shifts: &Shifts,
) -> Result<Anatomy, TableError> {
    let find = |segment: SegmentId, names: &[&str]| {
        items
            .iter()
            .find(|i| i.segment == segment && names.contains(&i.item.as_str()))
            .map(|i| i.position)
            .ok_or_else(|| TableError::Missing { item: names[0].into(), segment: segment.name().into() })
    };
    use SegmentId::{Foot, Pelvis, Shank, Thigh};
    let clusters = SegmentId::ALL.map(|segment| {
        let members = items.iter().filter(|i| i.segment == segment && recorded.contains_key(&i.item));
        let (names, points) = members.map(|i| (recorded[&i.item].clone(), i.position)).unzip();
        Cluster { names, points }
    });
    let pair = |segment: SegmentId, [a, b]: [(&str, &'static str); 2], least: f64| {
        let at = |(item, landmark): (&str, &str)| {
            Ok::<_, TableError>(find(segment, &[item])? + shifts.of(landmark))
        };
        let places = (at(a)?, at(b)?);
        if !shifts.is_empty() {
            apart((a.1, &places.0), (b.1, &places.1), least)?;
        }
        Ok::<_, TableError>(places)
    };
    let asis = pair(Pelvis, [("right ASIS", "right_asis"), ("left ASIS", "left_asis")], 0.05)?;
    let psis = || pair(Pelvis, [("right PSIS", "right_psis"), ("left PSIS", "left_psis")], 0.0);
    let origin = 0.5 * (asis.0 + asis.1);
    let width = (asis.0 - asis.1).norm();
    // The SCS of the table stands on the spines; it turns where they are shifted.
    let (pelvis_u, pelvis_w) = match shifts.is_empty() {
        true => (Vector3::x(), Vector3::z()),
        false => {
            let psis = psis()?;
            let (axes, _) = pelvis_axes(&asis.0, &asis.1, &psis.0, &psis.1);
            (axes.column(0).into(), axes.column(2).into())
        }
    };
    let hip = match hip {
        None => find(Pelvis, &["hip centre"])?,
        Some(rule) => {
            let psis = psis()?;
            origin + hip_centre(rule, width, (0.5 * (psis.0 + psis.1) - origin).norm(), sex)
        }
    } + shifts.of("hip_centre");
    let epicondyles =
        [("lateral epicondyle", "lateral_epicondyle"), ("medial epicondyle", "medial_epicondyle")];
    let carried = [
        ("lateral epicondyle carried by the shank at zero knee flexion", "lateral_epicondyle"),
        ("medial epicondyle carried by the shank at zero knee flexion", "medial_epicondyle"),
    ];
    let malleoli = [("lateral malleolus", "lateral_malleolus"), ("medial malleolus", "medial_malleolus")];
    let metatarsals = [("metatarsal head 1", "metatarsal_1"), ("metatarsal head 5", "metatarsal_5")];
    let knee_shift = shifts.between("lateral_epicondyle", "medial_epicondyle");
    let ankle_shift = shifts.between("lateral_malleolus", "medial_malleolus");
    let epicondyles = pair(Thigh, epicondyles, 0.03)?;
    let knee_axis = (epicondyles.0 - epicondyles.1).normalize();
    let (shank_knee, ankle) = (knee_shift, find(Shank, &["ankle centre"])? + ankle_shift);
    let carried = pair(Shank, carried, 0.03)?;
    let shank_u = (shank_knee - ankle).cross(&(carried.0 - carried.1)).normalize();
    let malleoli = pair(Shank, malleoli, 0.03)?;
    let malleoli = (malleoli.0 - malleoli.1).normalize();
    let metatarsals = pair(Foot, metatarsals, 0.02)?;
    let toe = 0.5 * (metatarsals.0 + metatarsals.1);
    Ok(Anatomy {
        clusters,
        pelvis: PelvisAxes {
            u: pelvis_u,
            w: pelvis_w,
            lumbar: find(Pelvis, &["lumbar joint centre (regression)", "lumbar joint centre"])?,
            hip,
            width,
            origin,
        },
        thigh: ThighAxes { knee: find(Thigh, &["knee centre"])? + knee_shift, w: knee_axis },
        shank: ShankAxes { knee: shank_knee, ankle, u: shank_u, w: malleoli },
        foot: FootAxes {
            ankle: ankle_shift,
            toe,
            u: (toe - find(Foot, &["heel"])? - shifts.of("heel")).normalize(),
            w: (metatarsals.1 - metatarsals.0).normalize(),
        },
    })
}
