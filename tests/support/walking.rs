//! The built-in walker as a recording on disk: markers as TRC, forces as STO, landmarks as a table, and a trial file
//! that joins them. A test changes one thing and loads it.

use std::path::PathBuf;

use multibody::trial::Trial;
use multibody::walker::{Knee, walker};
use multibody::{InputError, TrialFile};
use nalgebra::Vector3;

/// Number of the plate that takes the right foot.
pub const RIGHT_PLATE: usize = 1;
/// Number of the plate that takes the left foot.
pub const LEFT_PLATE: usize = 2;

/// A recording that has not been written yet.
pub struct Walking {
    /// Trial file.
    pub toml: String,
    /// Unit that the TRC file claims.
    pub unit: &'static str,
    /// Times of the frames \[s\].
    pub time: Vec<f64>,
    /// Names and positions \[mm\].
    pub markers: Vec<(String, Vec<Option<Vector3<f64>>>)>,
    /// Times of the force samples \[s\].
    pub force_time: Vec<f64>,
    /// Force \[N\] and point of application \[m\] on the right and the left plate.
    pub plates: [Vec<(Vector3<f64>, Vector3<f64>)>; 2],
    folder: tempfile::TempDir,
}

/// Recorded name of an item of the table.
fn recorded_name(item: &str) -> String {
    match item {
        "right ASIS" => "RASI".to_string(),
        "left ASIS" => "LASI".to_string(),
        "right PSIS" => "RPSI".to_string(),
        "left PSIS" => "LPSI".to_string(),
        other => other.replace(' ', "_"),
    }
}

impl Walking {
    /// The walker as it is.
    pub fn new() -> Self {
        let (trial, _) = walker(Knee::Hinge);
        let markers: Vec<_> = trial
            .markers
            .iter()
            .map(|m| (recorded_name(&m.name), m.position.iter().map(|p| p.map(|p| p * 1e3)).collect()))
            .collect();
        let right: Vec<_> =
            trial.ground.force.iter().zip(&trial.ground.moment).map(|(f, m)| (*f, pressure(f, m))).collect();
        // The left foot does the same half a cycle (50 frames) and half a stride (0.63 m) later, mirrored.
        let n = right.len();
        let left = (0..n)
            .map(|i| {
                let ((f, p), ahead) = if i >= 50 { (right[i - 50], 0.627) } else { (right[i + 50], -0.627) };
                (Vector3::new(f.x, f.y, -f.z), Vector3::new(p.x + ahead, p.y, -p.z))
            })
            .collect();
        let by_segment = |segment: &str| {
            let on = trial.markers.iter().filter(|m| m.segment.name() == segment);
            on.map(|m| format!("\"{}\"", recorded_name(&m.name))).collect::<Vec<_>>().join(", ")
        };
        let rename: String = trial
            .markers
            .iter()
            .filter(|m| recorded_name(&m.name) != m.name)
            .map(|m| format!("\"{}\" = \"{}\"\n", m.name, recorded_name(&m.name)))
            .collect();
        let columns: String = (1..=2)
            .map(|k| {
                let triple = |p: &str| ["x", "y", "z"].map(|a| format!("\"f{k}_{p}{a}\"")).join(", ");
                format!(
                    "[[force.columns]]\nplate = {k}\nforce = [{}]\npoint = [{}]\n",
                    triple("v"),
                    triple("p")
                )
            })
            .collect();
        let toml = format!(
            "motion = \"walk.trc\"\n\n[subject]\nname = \"walker\"\nmass_kg = 70\nheight_m = 1.72\nsex = \"male\"\nside = \"right\"\n\n\
             [range]\ncycle = 1\n\n[force]\nfile = \"walk.sto\"\nplates = [1]\n{columns}\n[markers]\npelvis = [{}]\nthigh = [{}]\n\
             shank = [{}]\nfoot = [{}]\n\n[landmarks]\nsource = \"table\"\ntable = \"DM.csv\"\n[landmarks.rename]\n{rename}",
            by_segment("pelvis"),
            by_segment("thigh"),
            by_segment("shank"),
            by_segment("foot"),
        );
        Self {
            toml,
            unit: "mm",
            time: trial.time.clone(),
            markers,
            force_time: trial.ground.time.clone(),
            plates: [right, left],
            folder: tempfile::tempdir().unwrap(),
        }
    }

    /// Two legs at once, the left one the mirror image of the right one at every instant: markers `M_…`, forces on the left plate, and
    /// `[left]` in the trial file.
    pub fn with_mirror_image(mut self) -> Self {
        let image = |p: Vector3<f64>| Vector3::new(p.x, p.y, -p.z);
        let images: Vec<_> = self
            .markers
            .iter()
            .map(|(name, path)| (format!("M_{name}"), path.iter().map(|p| p.map(image)).collect()))
            .collect();
        self.plates[1] = self.plates[0].iter().map(|(f, p)| (image(*f), image(*p))).collect();
        let rows = |key: &str| {
            let line = self.toml.lines().find(|l| l.starts_with(&format!("{key} = ["))).unwrap();
            line.replace("[\"", "[\"M_").replace(", \"", ", \"M_")
        };
        // The mirror image of the right ASIS is a left one.
        let (_, rename) = self.toml.split_once("[landmarks.rename]\n").unwrap();
        let rename = rename
            .replace("\"right ", "\"RIGHT ")
            .replace("\"left ", "\"right ")
            .replace("\"RIGHT ", "\"left ")
            .replace(" = \"", " = \"M_");
        let left = format!(
            "\n[left.markers]\n{}\n{}\n{}\n{}\n[left.force]\nplates = [2]\n[left.landmarks.rename]\n{rename}",
            rows("pelvis"),
            rows("thigh"),
            rows("shank"),
            rows("foot")
        );
        // Items that are called like their markers are so no longer.
        let names = |key: &str| rows(key).split('"').skip(1).step_by(2).map(|n| n[2..].to_string()).collect();
        let own: Vec<Vec<String>> = ["thigh", "shank", "foot"].map(names).into();
        let items: String = own
            .concat()
            .iter()
            .filter(|marker| !rename.contains(&format!("\"M_{marker}\"")))
            .map(|marker| format!("\"{marker}\" = \"M_{marker}\"\n"))
            .collect();
        self.toml += &(left + &items);
        self.markers.extend(images);
        self
    }

    /// Replaces text of the trial file, which must be there.
    pub fn replace(&mut self, from: &str, to: &str) -> &mut Self {
        assert!(self.toml.contains(from), "`{from}` is not in\n{}", self.toml);
        self.toml = self.toml.replacen(from, to, 1);
        self
    }

    /// Path of a marker \[mm\].
    pub fn marker(&mut self, name: &str) -> &mut Vec<Option<Vector3<f64>>> {
        &mut self.markers.iter_mut().find(|m| m.0 == name).unwrap().1
    }

    /// Exchanges the names of two markers from a frame on.
    pub fn exchange(&mut self, a: &str, b: &str, from: usize) -> &mut Self {
        let (mut first, mut second) = (self.marker(a).clone(), self.marker(b).clone());
        first[from..].swap_with_slice(&mut second[from..]);
        *self.marker(a) = first;
        *self.marker(b) = second;
        self
    }

    /// Changes every seen position \[mm\].
    pub fn map(&mut self, change: impl Fn(Vector3<f64>) -> Vector3<f64>) -> &mut Self {
        self.markers.iter_mut().flat_map(|m| m.1.iter_mut().flatten()).for_each(|p| *p = change(*p));
        self
    }

    /// Folder of the trial file.
    pub fn folder(&self) -> PathBuf {
        self.folder.path().join("trials")
    }

    /// The TRC file.
    pub fn trc(&self) -> String {
        let rate = (self.time.len() - 1) as f64 / (self.time[self.time.len() - 1] - self.time[0]);
        let names: String = self.markers.iter().map(|m| format!("\t{}\t\t", m.0)).collect();
        let mut text = format!(
            "PathFileType\t4\t(X/Y/Z)\twalk.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n{rate}\t{rate}\t{}\t{}\t{}\n\
             Frame#\tTime{names}\n\t\tX1\tY1\tZ1\n\n",
            self.time.len(),
            self.markers.len(),
            self.unit,
        );
        for (i, time) in self.time.iter().enumerate() {
            text += &format!("{}\t{time}", i + 1);
            for (_, path) in &self.markers {
                match path[i] {
                    Some(p) => text += &format!("\t{}\t{}\t{}", p.x, p.y, p.z),
                    None => text += "\t\t\t",
                }
            }
            text += "\n";
        }
        text
    }

    /// The STO file.
    pub fn sto(&self) -> String {
        let names: String = (1..=2)
            .flat_map(|k| ["vx", "vy", "vz", "px", "py", "pz"].map(|c| format!("\tf{k}_{c}")))
            .collect();
        let mut text = format!(
            "walk\nnRows={}\nnColumns=13\ninDegrees=no\nendheader\ntime{names}\n",
            self.force_time.len()
        );
        for (i, time) in self.force_time.iter().enumerate() {
            text += &time.to_string();
            for plate in &self.plates {
                let (f, p) = plate[i];
                text += &format!("\t{}\t{}\t{}\t{}\t{}\t{}", f.x, f.y, f.z, p.x, p.y, p.z);
            }
            text += "\n";
        }
        text
    }

    /// Writes all files; returns the path of the trial file.
    pub fn write(&self) -> PathBuf {
        let (folder, subjects) = (self.folder(), self.folder.path().join("subjects"));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::create_dir_all(&subjects).unwrap();
        let table = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../gait-data/subjects/DM.csv");
        std::fs::copy(table, subjects.join("DM.csv")).unwrap();
        std::fs::write(folder.join("walk.trc"), self.trc()).unwrap();
        std::fs::write(folder.join("walk.sto"), self.sto()).unwrap();
        let path = folder.join("walk.toml");
        std::fs::write(&path, &self.toml).unwrap();
        path
    }

    /// Writes and loads.
    pub fn load(&self) -> Result<Trial, InputError> {
        TrialFile::read(&self.write())?.load(None)
    }
}

impl Default for Walking {
    fn default() -> Self {
        Self::new()
    }
}

/// Where a force without free moment pierces the floor (Y = 0), from its moment about the origin.
fn pressure(force: &Vector3<f64>, moment: &Vector3<f64>) -> Vector3<f64> {
    if force.y <= 0.0 {
        return Vector3::zeros();
    }
    // M = p × F with p.y = 0: Mx = −p.z Fy, Mz = p.x Fy
    Vector3::new(moment.z / force.y, 0.0, -moment.x / force.y)
}
