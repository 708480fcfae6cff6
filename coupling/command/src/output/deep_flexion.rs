//! What `step deep_flexion` writes: `patella.csv`, `measured.csv`, frames for ParaView, a page, and `run.json`.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde_json::json;

use super::OutputError;
use super::atomic::OutputFolder;
use super::claim::KNEE_FRAMES;
use super::run::{RunRecord, Size};
use coupling::knee::deep::{DeepFlexion, Deviation, nrmsd_sum};
use coupling::knee::flexion::Bent;
use coupling::knee::frames::write_frames;
use coupling::knee::pose::{Coordinates, PATELLA};

/// Names of its tables, and the column that all of them begin with.
const PATELLA_FILE: &str = "patella.csv";
const QUADRICEPS_FILE: &str = "quadriceps.csv";
const FLEXION: &str = "knee_flexion_deg";

/// A knee that was bent under load and, along its measured poses, without.
pub struct Results<'a> {
    /// Its data.
    pub scene: &'a DeepFlexion,
    /// To deep flexion.
    pub deep: &'a Bent,
    /// Of every frame the pairs of triangles of both cartilages that intersect.
    pub crossings: Vec<usize>,
    /// Along the measured poses, where there are some.
    pub unloaded: Option<&'a Bent>,
    /// Per coordinate RMSD against the measured poses \[degrees, mm\], and over the mean of the measured values.
    pub against: Option<[Deviation; 6]>,
    /// Forces of the quadriceps \[N\]: deep flexion, measured poses. None where it is tissue.
    pub forces: [f64; 2],
    /// Poses of the tibia that were asked for.
    pub n_poses: usize,
}

/// Tables of a knee that was bent, as another process has written them: column by name, a row per frame.
pub struct Read(BTreeMap<String, Vec<f64>>);

impl Read {
    /// Reads `patella.csv` and, where the quadriceps is tissue, `quadriceps.csv` of a folder.
    pub fn of(folder: &Path) -> Result<Read, String> {
        let mut columns = BTreeMap::new();
        for file in
            [PATELLA_FILE, QUADRICEPS_FILE].map(|name| folder.join(name)).iter().filter(|f| f.is_file())
        {
            let bad = |what: String| format!("{}: {what}", file.display());
            let mut reader = csv::Reader::from_path(file).map_err(|e| bad(e.to_string()))?;
            let names: Vec<String> =
                reader.headers().map_err(|e| bad(e.to_string()))?.iter().map(str::to_string).collect();
            let rows: Vec<csv::StringRecord> =
                reader.records().collect::<Result<_, _>>().map_err(|e| bad(e.to_string()))?;
            for (c, name) in names.into_iter().enumerate() {
                let cell = |row: &csv::StringRecord| {
                    row[c].parse().map_err(|_| bad(format!("`{}` is no number", &row[c])))
                };
                columns.insert(name, rows.iter().map(cell).collect::<Result<_, _>>()?);
            }
        }
        let read = Read(columns);
        match read.column(FLEXION).is_empty() {
            true => Err(format!("{} holds no frames of a knee", folder.display())),
            false => Ok(read),
        }
    }

    /// A column; empty where there is none.
    pub fn column(&self, name: &str) -> &[f64] {
        self.0.get(name).map_or(&[], Vec::as_slice)
    }

    /// A column over the flexion of the knee.
    pub fn curve(&self, name: &str) -> Vec<[f64; 2]> {
        self.column(FLEXION).iter().zip(self.column(name)).map(|(flexion, v)| [*flexion, *v]).collect()
    }
}

/// Writes everything and, last of all, `run.json`.
pub fn write_deep_flexion(
    mut out: OutputFolder,
    results: &Results,
    record: &mut RunRecord,
) -> Result<Vec<String>, OutputError> {
    let started = Instant::now();
    out.write(PATELLA_FILE, |w| patella(w, results.deep, &results.crossings))?;
    if let Some(unloaded) = results.unloaded {
        out.write("measured.csv", |w| measured(w, unloaded, &results.scene.measured.rows))?;
    }
    if let Some(tissue) = &results.deep.knee.muscles {
        out.write(QUADRICEPS_FILE, |w| muscles(w, results.deep))?;
        let plan = &results.deep.knee.plan;
        record.size = Some(Size {
            elements: tissue.n_cells,
            nodes: plan.mesh.points.len(),
            unknowns: plan.n_unknowns(),
        });
    }
    let frames = out.path().join(KNEE_FRAMES[0][0]);
    write_frames(&frames, &results.scene.anatomy, results.deep)
        .map_err(|e| OutputError::at("write the frames in", &frames, std::io::Error::other(e)))?;
    let page = crate::report::deep_flexion::page(results);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    record.verdict = Some(json!({
        "frames_solved": results.deep.frames.len(),
        "frames_asked": results.n_poses,
        "against_measured": results.against.map(|all| {
            let named = PATELLA.into_iter().zip(all);
            named.map(|(name, of)| (name, json!({ "rmsd": of.rmsd, "nrmsd": of.nrmsd }))).collect::<BTreeMap<_, _>>()
        }),
        "nrmsd_sum": results.against.and_then(|all| nrmsd_sum(&all)),
    }));
    let listed = super::names_in(&frames).into_iter().map(|name| format!("{}/{name}", KNEE_FRAMES[0][0]));
    let listed: Vec<String> = listed.collect();
    super::finish_with(out, record, started, listed)
}

/// A row per frame: the patella, its contact, tension and strain of every strand.
fn patella(w: &mut dyn std::io::Write, bent: &Bent, crossings: &[usize]) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    let contact = ["contact_force_N", "contact_area_mm2", "greatest_pressure_MPa", "crossings_of_cartilages"];
    let settled = ["left_force_N", "left_moment_Nmm", "iterations"];
    let strands = bent.knee.strands.iter().flat_map(|s| [format!("{s}_N"), format!("{s}_strain")]);
    let header = std::iter::once(FLEXION).chain(PATELLA).chain(contact).chain(settled);
    csv.write_record(header.map(str::to_string).chain(strands))?;
    let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    for (f, crossings) in bent.frames.iter().zip(crossings) {
        let mut row = vec![f.tibia.flexion];
        row.extend(f.patella.to_array());
        row.extend([
            f.contact.force.norm(),
            1e6 * f.contact.area,
            1e-6 * f.contact.pressure,
            *crossings as f64,
        ]);
        row.extend([norm(f.residual.force), 1e3 * norm(f.residual.moment), f.iterations as f64]);
        row.extend(f.strands.iter().flat_map(|s| [s.tension, s.strain]));
        csv.write_record(row.iter().map(f64::to_string))?;
    }
    csv.flush()
}

/// A row per frame: the muscles.
fn muscles(w: &mut dyn std::io::Write, bent: &Bent) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    csv.write_record([
        FLEXION,
        "rectus_stress_95_Pa",
        "rectus_stress_greatest_Pa",
        "least_volume_ratio",
        "least_det_f",
        "greatest_stretch",
        "crossings_of_heads",
        "crossings_of_head_and_femur",
    ])?;
    for (f, m) in bent.frames.iter().filter_map(|f| Some((f, f.muscles?))) {
        let [heads, femur] = m.crossings.map(|n| n as f64);
        let row = [
            f.tibia.flexion,
            m.stress[0],
            m.stress[1],
            m.least_volume,
            f.least_det_f,
            m.drawn_out.1,
            heads,
            femur,
        ];
        csv.write_record(row.map(|v| v.to_string()))?;
    }
    csv.flush()
}

/// A row per measured pose: computed and measured coordinates.
fn measured(
    w: &mut dyn std::io::Write,
    unloaded: &Bent,
    measured: &[[Coordinates; 2]],
) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(w);
    let beside = PATELLA.map(|c| format!("measured_{c}"));
    let header = std::iter::once(FLEXION).chain(PATELLA).map(str::to_string);
    csv.write_record(header.chain(beside))?;
    for (f, row) in unloaded.frames.iter().zip(measured) {
        let numbers = std::iter::once(f.tibia.flexion).chain(f.patella.to_array()).chain(row[1].to_array());
        csv.write_record(numbers.map(|v| v.to_string()))?;
    }
    csv.flush()
}
