//! What `step deep_flexion` reads of a folder: is what can be no knee refused, with file, line and remedy, all of it at once, before anything is
//! written, and a knee that does not hold its patella told?

use std::collections::HashSet;
use std::path::Path;

use coupling::knee::anatomy::KneeAnatomy;
use coupling::knee::deep::DeepFlexion;
use fem::geometry::Surface;
use fem::mesh::LengthUnit;
use serde_json::{Value, json};
use support::{sartorius, shared};
use tempfile::TempDir;

const PATH: &str = "tibia_path_deep.csv";
const MEASURED: &str = "dynamic_mri_knee.csv";
const MODEL: &str = "knee_model.json";

/// What is done to a model.
type Change<'a> = &'a dyn Fn(&mut Value);

/// The data of a real knee, of which any file can be another one.
struct Folder(TempDir);

impl Folder {
    /// None where the data are absent.
    fn new() -> Option<Folder> {
        let (Some(tables), Some(anatomy)) = (shared("reference/deep"), shared("anatomy")) else {
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        for (from, to) in [(tables, "deep"), (anatomy.join("knee"), "knee"), (anatomy.join("bones"), "bones")]
        {
            std::fs::create_dir(folder.path().join(to)).unwrap();
            for file in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
                let from = file.path().canonicalize().unwrap();
                std::os::unix::fs::symlink(from, folder.path().join(to).join(file.file_name())).unwrap();
            }
        }
        Some(Folder(folder))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    /// Takes a file away.
    fn without(&self, file: &str) {
        std::fs::remove_file(self.path().join(file)).unwrap();
    }

    /// Puts another file in place of one.
    fn put(&self, file: &str, bytes: &[u8]) {
        self.without(file);
        std::fs::write(self.path().join(file), bytes).unwrap();
    }

    /// A table made from that of the data.
    fn table(&self, name: &str, change: &dyn Fn(String) -> String) {
        let text = std::fs::read_to_string(shared("reference/deep").unwrap().join(name)).unwrap();
        self.put(&format!("deep/{name}"), change(text).as_bytes());
    }

    /// A model made from that of the data.
    fn model(&self, change: Change) {
        let text = std::fs::read_to_string(shared("anatomy/knee").unwrap().join(MODEL)).unwrap();
        let mut model = serde_json::from_str(&text).unwrap();
        change(&mut model);
        self.put(&format!("knee/{MODEL}"), model.to_string().as_bytes());
    }

    /// A surface made from that of the data. Binary STL: 80 bytes, the number of triangles, 50 bytes each.
    fn surface(&self, name: &str, change: &dyn Fn(&mut Vec<[u8; 50]>)) {
        let stl = std::fs::read(shared("anatomy").unwrap().join(name)).unwrap();
        let mut triangles: Vec<[u8; 50]> =
            stl[84..].chunks_exact(50).map(|t| t.try_into().unwrap()).collect();
        change(&mut triangles);
        let count = (triangles.len() as u32).to_le_bytes();
        self.put(name, &[&stl[..80], &count, triangles.as_flattened()].concat());
    }

    /// What the command says and ends with.
    fn said(&self) -> (Option<i32>, String) {
        let output = sartorius(&["step", "deep_flexion", "--data", "."], self.path());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).to_string())
    }

    /// Each of these, all of its words in one line, is said, and nothing is written.
    fn is_refused(&self, what: &[&[&str]]) {
        let (code, text) = self.said();
        assert_eq!(code, Some(2), "{text}");
        for words in what {
            assert!(text.lines().any(|line| words.iter().all(|w| line.contains(w))), "{words:?}: {text}");
        }
        assert!(!self.path().join("out").exists());
    }

    /// What is wrong with the knee itself.
    fn anatomy(&self) -> String {
        KneeAnatomy::read(&self.path().join("knee")).unwrap_err().to_string()
    }
}

/// Does something to every point of every spring, given the name of that.
fn points_of(model: &mut Value, change: impl Fn(&str, &mut Value)) {
    for ligament in model["ligaments"].as_array_mut().unwrap() {
        let name = ligament["name"].as_str().unwrap().to_string();
        ligament["points"].as_array_mut().unwrap().iter_mut().for_each(|point| change(&name, point));
    }
}

/// A point of a spring elsewhere in the frame of its body; where it is in that of the surfaces is said no more.
fn put(point: &mut Value, change: impl Fn(usize, f64) -> f64) {
    point.as_object_mut().unwrap().remove("limb");
    for c in 0..3 {
        point["native"][c] = json!(change(c, point["native"][c].as_f64().unwrap()));
    }
}

/// A table with another value in a cell, rows from 0, the header's.
fn spoilt(row: usize, column: &str, value: &str) -> impl Fn(String) -> String {
    let (column, value) = (column.to_string(), value.to_string());
    move |text| {
        let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
        let at = lines[0].split(',').position(|c| c == column).unwrap();
        let mut cells: Vec<String> = lines[row].split(',').map(str::to_string).collect();
        cells[at] = value.clone();
        lines[row] = cells.join(",");
        lines.join("\n") + "\n"
    }
}

/// A table with a column all of whose values are changed.
fn changed(column: &str, change: impl Fn(f64) -> f64) -> impl Fn(String) -> String {
    let column = column.to_string();
    move |text| {
        let (header, rows) = text.split_once('\n').unwrap();
        let at = header.split(',').position(|c| c == column).unwrap();
        let row = |line: &str| {
            let mut cells: Vec<String> = line.split(',').map(str::to_string).collect();
            cells[at] = change(cells[at].parse().unwrap()).to_string();
            cells.join(",") + "\n"
        };
        format!("{header}\n{}", rows.lines().map(row).collect::<String>())
    }
}

#[test]
fn a_folder_without_a_knee_is_told_what_it_lacks() {
    let folder = Folder(tempfile::tempdir().unwrap());
    folder.is_refused(&[&[MODEL], &[PATH], &[MEASURED]]);
}

/// What is wrong with the way, with the reference pose and with poses is told at once.
#[test]
fn mistakes_of_poses_are_told_all_at_once() {
    let Some(folder) = Folder::new() else { return };
    // Row 3 turned by 60 degrees from its neighbours: into it, and out of it. In the other table a tibia that turns.
    folder.table(PATH, &spoilt(3, "knee_internal_rotation_deg", "60.0"));
    folder.table(MEASURED, &spoilt(5, "knee_adduction_deg", "40.0"));
    let turns = "the tibia turns by";
    folder.is_refused(&[
        &[PATH, &format!("line 4: {turns}"), &format!("line 5: {turns}")],
        &[MEASURED, &format!("line 6: {turns}")],
    ]);
    // Rows 5 and 7 with the tibia 16 mm up in the femur and 14 mm down from it, in the other table 15 mm up.
    let both = |text| spoilt(7, "knee_proximal_mm", "-14.0")(spoilt(5, "knee_proximal_mm", "12.0")(text));
    folder.table(PATH, &both);
    folder.table(MEASURED, &spoilt(5, "knee_proximal_mm", "15.0"));
    folder.is_refused(&[
        &[
            PATH,
            "line 6 (20 degrees)",
            "overlaps with the femur by",
            "line 8 (30 degrees)",
            "is off the femur by",
        ],
        &[MEASURED, "line 6", "overlaps with the femur by"],
    ]);
    // The whole table far up, beyond where the smooth distance to the femur is known: it goes through the shaft.
    folder.table(PATH, &changed("knee_proximal_mm", |up| up + 200.0));
    folder.table(MEASURED, &|text| text);
    folder.is_refused(&[&[PATH, "line 6 (20 degrees)", "overlaps with the femur by"]]);
    // A way that is short, poses that are apart, and a patella beside its groove.
    let short = |text: String| text.lines().take(2).map(|line| format!("{line}\n")).collect::<String>();
    folder.table(PATH, &short);
    let aside =
        |text| spoilt(6, "knee_proximal_mm", "-16.0")(changed("patella_lateral_mm", |at| at + 30.0)(text));
    folder.table(MEASURED, &aside);
    folder.is_refused(&[
        &[PATH, "have less than a step of the way from 0 to 137.5"],
        &[MEASURED, "line 7", "is off the femur by"],
        &[MEASURED, "line 3", "the patella is in no groove"],
    ]);
}

#[test]
fn a_way_is_as_long_as_its_table() {
    let Some(folder) = Folder::new() else { return };
    let to = |most: f64, least: f64| {
        move |text: String| -> String {
            let is_kept = |line: &&str| {
                let flexion = line.split(',').next().and_then(|cell| cell.parse::<f64>().ok());
                flexion.is_none_or(|f| (least..=most).contains(&f))
            };
            text.lines().filter(is_kept).map(|line| format!("{line}\n")).collect()
        }
    };
    folder.table(PATH, &to(140.0, 140.0));
    let refused = DeepFlexion::find(folder.path()).unwrap().short_of(0.0).unwrap_err().to_string();
    assert!(refused.contains("have less than a step of the way from 0 to 137.5"), "{refused}");
    folder.table(PATH, &to(5.0, 0.0));
    let (code, text) = folder.said();
    assert!(code == Some(0) && text.contains("note: ") && text.contains("is cut to that"), "{text}");
    // The reference pose is found wherever its row is.
    let turned = |text: String| -> String {
        let (header, rows) = text.split_once('\n').unwrap();
        let rows: Vec<&str> = rows.lines().collect();
        std::iter::once(header).chain(rows.into_iter().rev()).map(|line| format!("{line}\n")).collect()
    };
    let reference = || DeepFlexion::find(folder.path()).unwrap().reference;
    let before = reference();
    folder.table(MEASURED, &turned);
    assert_eq!(reference(), before);
}

/// Inside the femur, beside it, in front of it, far from it, turned over, and with its back to it.
#[test]
fn a_patella_that_is_in_no_groove_is_refused() {
    let Some(folder) = Folder::new() else { return };
    for (column, by, why) in [
        ("patella_anterior_mm", -35.0, "still touches the femur"),
        ("patella_lateral_mm", 30.0, "33.6 mm to lateral"),
        ("patella_anterior_mm", 14.0, "mm off the femur, at most 5.2 mm"),
        ("patella_anterior_mm", 200.0, "not beside the knee"),
        ("patella_rotation_deg", 70.0, "its lateral axis is"),
        ("patella_flexion_deg", 170.0, "its cartilage looks away"),
    ] {
        // All rows alike, so that none jumps.
        folder.table(MEASURED, &changed(column, |value| value + by));
        folder.is_refused(&[&[
            MEASURED,
            "line 3",
            "the patella is in no groove",
            why,
            "in front of the trochlea",
        ]]);
    }
}

/// Springs of other bones, twice, off their bones, in other units; frames that turn nothing or lie far away.
#[test]
fn a_model_that_is_none_of_this_knee_is_refused() {
    let Some(folder) = Folder::new() else { return };
    let spring = |model: &mut Value, name: &str| -> usize {
        model["ligaments"].as_array().unwrap().iter().position(|l| l["name"] == name).unwrap()
    };
    let cases: [(Change, &[&str]); 6] = [
        (
            &|model| {
                let (first, again) = (spring(model, "PT1"), model["ligaments"][0].clone());
                model["ligaments"][first]["points"][0]["native"][1] = json!(0.3);
                model["ligaments"].as_array_mut().unwrap().push(again);
            },
            &["`PT1` has a point whose `native` is", "two springs are called `MCLd1`"],
        ),
        (
            &|model| {
                // 20 mm off, in both frames.
                points_of(model, |name, point| {
                    if name == "mPFL1" {
                        put(point, |c, at| if c == 2 { at - 0.02 } else { at });
                    }
                });
            },
            &["`mPFL1` ends", "mm off femur_distal_r, at most 10", "mm off patella_r, at most 10"],
        ),
        (
            &|model| {
                points_of(model, |_, point| put(point, |_, at| 1e3 * at));
            },
            &["mm off cartilage of the tibia", "in metres"],
        ),
        (&|model| model["body_to_limb"]["patella_r"][0][0] = json!(0.5), &["patella_r", "rotation"]),
        (&|model| model["body_to_limb"]["patella_r"][0][3] = json!(40.0), &["patella_r"]),
        (&|model| model["body_to_limb"]["patella_r"][3][3] = json!(2.0), &["patella_r"]),
    ];
    for (change, words) in cases {
        folder.model(change);
        let said = folder.anatomy();
        for word in words.iter().chain(&[MODEL]) {
            assert!(said.contains(word), "{word}: {said}");
        }
    }
    // Two bones whose frames are exchanged.
    folder.model(&|model| {
        let frames = model["body_to_limb"].as_object_mut().unwrap();
        let [femur, tibia] = ["femur_distal_r", "tibia_proximal_r"].map(|bone| frames[bone].clone());
        frames["femur_distal_r"] = tibia;
        frames["tibia_proximal_r"] = femur;
    });
    assert!(folder.anatomy().contains("`MCLd1` has a point whose `native` is"), "{}", folder.anatomy());
    // A strand of the ligament that goes to the femur in place of the tibia, and a patella beside its groove: both at once.
    folder.model(&|model| {
        let collateral = spring(model, "LCL1");
        let femur = model["ligaments"][collateral]["points"].as_array().unwrap();
        let femur = femur.iter().find(|p| p["body"] == "femur_distal_r").unwrap().clone();
        points_of(model, |name, point| {
            if name == "PT1" && point["body"] == "tibia_proximal_r" {
                *point = femur.clone();
            }
        });
    });
    folder.table(MEASURED, &changed("patella_lateral_mm", |at| at + 30.0));
    folder.is_refused(&[&[MODEL, "no spring `PT1` from"], &[MEASURED, "line 3", "33.6 mm to lateral"]]);
    folder.table(MEASURED, &|text| text);
    // The patella under another name: no spring goes to the bone that it belongs to.
    folder.model(&|model| {
        points_of(model, |_, point| {
            if point["body"] == "patella_r" {
                point["body"] = json!("femur_r");
            }
        });
    });
    folder.is_refused(&[&[MODEL, "no spring", "`PT1`"]]);
}

/// A tubercle 45 mm to lateral pulls the patella out of its groove: exit 3, what a person should know, and the frames before.
#[test]
fn a_patella_that_leaves_its_groove_is_not_solved() {
    let Some(folder) = Folder::new() else { return };
    folder.model(&|model| {
        points_of(model, |name, point| {
            if name.starts_with("PT") && point["body"] == "tibia_proximal_r" {
                put(point, |c, at| if c == 2 { at + 0.045 } else { at });
            }
        });
    });
    let (code, said) = folder.said();
    assert_eq!(code, Some(3), "{said}");
    for word in [
        "not solved: the patella has left its groove",
        "mm to lateral of the middle of the femur",
        "flexion",
        "left on the patella (",
        "contact",
        "strands: patellar_ligament_lateral_1",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    let table = std::fs::read_to_string(folder.path().join("out/step-deep_flexion/patella.csv")).unwrap();
    assert!((10..56).contains(&(table.lines().count() - 1)), "{table}");
}

#[test]
fn surfaces_that_are_no_knee_are_refused() {
    let Some(folder) = Folder::new() else { return };
    // Cartilage of the femur 12 mm forward of its bone, cartilage of the tibia that looks down.
    folder.surface("knee/femoral_cartilage_r.stl", &|triangles| {
        for triangle in triangles {
            for corner in 0..3 {
                let place = 12 + 12 * corner;
                let x = f32::from_le_bytes(triangle[place..place + 4].try_into().unwrap());
                triangle[place..place + 4].copy_from_slice(&(x + 0.012).to_le_bytes());
            }
        }
    });
    folder.surface("knee/tibial_cartilage_medial_r.stl", &|t| turn_round(t));
    let said = folder.anatomy();
    for words in [
        ["femoral_cartilage_r.stl", "cartilage lies on its bone"],
        ["tibial_cartilage_medial_r.stl", "look into"],
    ] {
        assert!(said.lines().any(|line| words.iter().all(|w| line.contains(w))), "{words:?}: {said}");
    }
    folder.surface("bones/femur_r.stl", &|t| t.truncate(t.len() - 1));
    folder.surface("knee/tibial_cartilage_medial_r.stl", &Vec::clear);
    folder.surface("knee/patellar_cartilage_r.stl", &|t| turn_round(t));
    // A triangle whose points are in no border.
    let femoral = shared("anatomy/knee").unwrap().join("femoral_cartilage_r.stl");
    let [place, border] = hole_in(&Surface::read(&femoral, LengthUnit::Metre).unwrap());
    folder.surface("knee/femoral_cartilage_r.stl", &|t| {
        t.remove(place);
    });
    folder.without("knee/tibial_cartilage_lateral_r.stl");
    assert!(border > 100, "{border} edges");
    folder.is_refused(&[
        &["femur_r.stl", "the surface is open"],
        &["tibial_cartilage_medial_r.stl", "no triangles"],
        &["patellar_cartilage_r.stl", "look into the bone"],
        &["femoral_cartilage_r.stl", "2 borders"],
        &["tibial_cartilage_lateral_r.stl"],
    ]);
}

/// Two corners of every triangle change places.
fn turn_round(triangles: &mut [[u8; 50]]) {
    for triangle in triangles {
        let (b, c) = (triangle[24..36].to_vec(), triangle[36..48].to_vec());
        triangle[24..36].copy_from_slice(&c);
        triangle[36..48].copy_from_slice(&b);
    }
}

/// A triangle of an open surface none of whose points is in its border, and the number of edges of that.
fn hole_in(surface: &Surface) -> [usize; 2] {
    let neighbours = surface.neighbours().unwrap();
    let sides = surface.triangles.iter().zip(&neighbours);
    let open = sides.flat_map(|(t, of)| (0..3).filter(|k| of[*k].is_none()).map(|k| [t[k], t[(k + 1) % 3]]));
    let border: HashSet<u32> = open.flatten().collect();
    let inside = surface.triangles.iter().position(|t| t.iter().all(|p| !border.contains(p))).unwrap();
    [inside, border.len()]
}
