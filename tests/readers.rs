//! Do the readers give back what was recorded, and refuse what is damaged?

use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::error::Place;
use multibody::read::{self, ForcePlate, MarkerRecording, TimeSeries, c3d};
use nalgebra::Vector3;
use support::allocations::{Counting, with_peak};
use support::c3d_file::{C3dFile, Order};
use support::shared;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// ------------------------------------------------------------------------------------------------ recorded values

enum Recorded {
    C3d(c3d::C3d),
    Trc(MarkerRecording),
    Table(TimeSeries),
}

fn read_recorded(path: &Path) -> Recorded {
    match path.extension().and_then(|e| e.to_str()) {
        Some("c3d") => Recorded::C3d(c3d::read(path).unwrap()),
        Some("trc") => Recorded::Trc(read::read_trc(path).unwrap()),
        _ => Recorded::Table(read::read_series(path).unwrap()),
    }
}

/// The quantity of one row in the unit of the row. `None`: a quantity this test does not know.
fn quantity(file: &Recorded, name: &str, place: &str, unit: &str) -> Option<String> {
    let index = place.split_whitespace().find_map(|w| w.parse::<usize>().ok());
    let markers = match file {
        Recorded::C3d(c) => Some(&c.markers),
        Recorded::Trc(m) => Some(m),
        Recorded::Table(_) => None,
    };
    if let Some(m) = markers {
        let value = match name {
            "marker frames" => m.time.len().to_string(),
            "markers" => m.names.len().to_string(),
            "marker rate" => m.rate_hz.to_string(),
            "marker unit" => m.file_unit.clone(),
            "time of first frame" => m.time[0].to_string(),
            "time of last frame" => m.time[m.time.len() - 1].to_string(),
            "first frame number (1-based)" => m.first_frame.to_string(),
            "last frame number (1-based)" => (m.first_frame + m.time.len() - 1).to_string(),
            "markers missing in every frame" => {
                let mut m = m.clone();
                m.zeros_to_gaps();
                m.position.iter().filter(|p| p.iter().all(Option::is_none)).count().to_string()
            }
            _ => String::new(),
        };
        if !value.is_empty() {
            return Some(value);
        }
        if let Some(rest) = name.strip_prefix("marker ") {
            let (marker, what) = rest.split_once(' ')?;
            let path = &m.position[m.index(marker)?];
            if what == "present" {
                let mut m = m.clone();
                m.zeros_to_gaps();
                let seen = m.position[m.index(marker)?][index?].is_some();
                return Some(if seen { "present" } else { "missing" }.to_string());
            }
            assert_eq!(unit, "mm");
            let axis = ["x", "y", "z"].iter().position(|a| *a == what)?;
            return Some((path[index?]?[axis] * 1e3).to_string());
        }
    }
    match file {
        Recorded::C3d(c) => c3d_quantity(c, name, place, index, unit),
        Recorded::Trc(_) => None,
        Recorded::Table(t) => Some(match name {
            "rows" => t.time.len().to_string(),
            "columns" => (t.columns.len() + 1).to_string(),
            "time" => t.time[index?].to_string(),
            column => t.column(column)?[index?].to_string(),
        }),
    }
}

fn c3d_quantity(c: &c3d::C3d, name: &str, place: &str, index: Option<usize>, unit: &str) -> Option<String> {
    match name {
        "analog channels" => return Some(c.analog.names.len().to_string()),
        "analog samples per channel" => return Some(c.analog.values[0].len().to_string()),
        "analog rate" => return Some(c.analog.rate_hz.to_string()),
        "POINT:SCALE" => return c.parameters.number("POINT", "SCALE").map(|v| v.to_string()),
        "force plates" => return Some(c.plates.len().to_string()),
        "force plate type" => {
            assert_eq!(place, "plate 1");
            return Some(c.plates[0].kind.to_string());
        }
        _ => {}
    }
    if let Some(channel) = name.strip_prefix("analog ") {
        let channel = c.analog.index(channel)?;
        let factor = match (unit, c.analog.units[channel].as_str()) {
            ("Nmm", "N m") => 1e3,
            (file, si) if file == si => 1.0,
            _ => return None,
        };
        return Some((c.analog.values[channel][index?] * factor).to_string());
    }
    let (number, rest) = name.strip_prefix("plate ")?.split_once(' ')?;
    let plate: &ForcePlate = &c.plates[number.parse::<usize>().ok()? - 1];
    let load = plate.loads(Path::new("recorded"), &c.analog).unwrap()[index?];
    let axis = |v: Vector3<f64>| {
        let letter = rest.strip_suffix(" (lab)")?.chars().last()?;
        Some(v["xyz".find(letter)?])
    };
    if rest.starts_with("force on the foot") {
        return axis(plate.force(&load)).map(|v| v.to_string());
    }
    if rest.starts_with("centre of pressure") {
        return axis(plate.centre_of_pressure(&load)? * 1e3).map(|v| v.to_string());
    }
    if rest.starts_with("free moment about plate z") {
        return plate.free_moment(&load).map(|v| (v * 1e3).to_string());
    }
    None
}

/// Tolerance of a row for a value of this size.
fn tolerance(text: &str, unit: &str, value: f64) -> f64 {
    match text {
        "1e-4 relative" => 1e-4 * value.abs(),
        "1e-4 N or 1e-6 m" => match unit {
            "N" => 1e-4,
            "m" => 1e-6,
            other => panic!("unit {other}"),
        },
        number => number.parse().unwrap(),
    }
}

#[test]
fn every_recorded_value_is_reproduced() {
    let (Some(table), Some(gait)) = (shared("model/c3d_expectations.csv"), shared("gait")) else { return };
    let mut rows = csv::Reader::from_path(table).unwrap();
    let mut open: Option<(String, Recorded)> = None;
    let mut handled = 0;
    for row in rows.records() {
        let row = row.unwrap();
        let [file, name, place, expected, unit, within] = [0, 1, 2, 3, 4, 5].map(|i| row[i].to_string());
        if open.as_ref().is_none_or(|(f, _)| *f != file) {
            open = Some((file.clone(), read_recorded(&gait.join(&file))));
        }
        let found = quantity(&open.as_ref().unwrap().1, &name, &place, &unit);
        let found = found.unwrap_or_else(|| panic!("{file}: unknown quantity {name} at {place}"));
        match (found.parse::<f64>(), expected.parse::<f64>()) {
            (Ok(a), Ok(b)) => {
                let allowed = tolerance(&within, &unit, b);
                assert!((a - b).abs() <= allowed, "{file}: {name} at {place}: {a}, expected {b} ± {allowed}");
            }
            _ => assert_eq!(found, expected, "{file}: {name}"),
        }
        handled += 1;
    }
    assert_eq!(handled, 279);
}

#[test]
fn analog_samples_start_with_the_first_frame() {
    let Some(path) = shared("gait/jw/jw_ngait_og3.c3d") else { return };
    let c = c3d::read(&path).unwrap();
    assert!((c.markers.time[0] - 217.0 / 120.0).abs() < 1e-12);
    assert_eq!(c.analog.time[0], c.markers.time[0]);
    assert!((c.analog.time[10] - c.markers.time[1]).abs() < 1e-12);
}

// ------------------------------------------------------------------------------------------------ round trips

#[test]
fn c3d_survives_every_byte_order_and_storage() {
    for order in [Order::Intel, Order::Dec, Order::Mips] {
        for (real, unsigned) in [(true, false), (false, false), (false, true)] {
            let file = C3dFile { order, real, unsigned, ..C3dFile::default() };
            let c = c3d::parse(Path::new("small.c3d"), &file.bytes()).unwrap();
            let what = format!("{order:?}, real: {real}, unsigned: {unsigned}");
            assert_eq!(c.markers.names, ["A", "B"], "{what}");
            assert_eq!(
                (c.markers.first_frame, c.markers.rate_hz, c.markers.time.len()),
                (5, 100.0, 4),
                "{what}"
            );
            assert_eq!(c.markers.time[0], 0.04, "{what}");
            for (m, path) in file.points.iter().enumerate() {
                for (i, point) in path.iter().enumerate() {
                    match (point, c.markers.position[m][i]) {
                        (None, None) => {}
                        // 0.01 mm is the step of the integer files
                        (Some(p), Some(q)) => {
                            let error = (q * 1e3 - Vector3::from(*p)).amax();
                            assert!(error < if real { 1e-4 } else { 5.1e-3 }, "{what}: {error} mm");
                        }
                        (p, q) => panic!("{what}: frame {i}: wrote {p:?}, read {q:?}"),
                    }
                }
            }
            assert_eq!(c.analog.units, ["N", "N", "N", "N m", "N m", "N m"], "{what}");
            for (k, channel) in file.channels.iter().enumerate() {
                for (i, value) in channel.iter().enumerate() {
                    let read = c.analog.values[k][i] * if k < 3 { 1.0 } else { 1e3 };
                    let step = C3dFile::ANALOG_SCALES[k];
                    assert!(
                        (read - value).abs() <= if real { 1e-6 * value.abs() } else { 0.51 * step },
                        "{what}: {read} {value}"
                    );
                }
            }
            assert_eq!(c.plates.len(), 1, "{what}");
        }
    }
}

#[test]
fn c3d_counts_frames_beyond_16_bits() {
    let n = 70_000;
    let file = C3dFile {
        real: false,
        names: vec!["A".into()],
        points: vec![(0..n).map(|i| Some([(i % 100) as f64, 0.0, 1.0])).collect()],
        channels: vec![vec![0.0; n]; 6],
        samples: 1,
        ..C3dFile::default()
    };
    let c = c3d::parse(Path::new("long.c3d"), &file.bytes()).unwrap();
    assert_eq!((c.markers.first_frame, c.markers.time.len(), c.analog.time.len()), (5, n, n));
    assert!((c.markers.position[0][n - 1].unwrap().x - 0.099).abs() < 1e-8); // the scale is in single precision
}

#[test]
fn plate_origin_below_the_surface_moves_the_moment() {
    // A vertical force of 800 N, 30 mm along plate x and -20 mm along plate y, sensors 40 mm under the surface, plus shear.
    let (p, force, depth) = (Vector3::new(0.03, -0.02, 0.0), Vector3::new(50.0, -30.0, -800.0), 0.04);
    let moment = (p - Vector3::new(0.0, 0.0, depth)).cross(&force); // z points down: the sensors are at +depth
    let channels: Vec<Vec<f64>> =
        force.iter().copied().chain(moment.iter().map(|m| m * 1e3)).map(|v| vec![v; 8]).collect();
    for sign in [-1.0, 1.0] {
        let file = C3dFile {
            channels: channels.clone(),
            plate_origin: [0.0, 0.0, sign * depth * 1e3],
            ..C3dFile::default()
        };
        let c = c3d::parse(Path::new("plate.c3d"), &file.bytes()).unwrap();
        let plate = &c.plates[0];
        let load = plate.loads(Path::new("plate.c3d"), &c.analog).unwrap()[0];
        let expected = plate.centre() + plate.axes() * p;
        assert!((plate.centre_of_pressure(&load).unwrap() - expected).amax() < 1e-6);
        assert!(plate.free_moment(&load).unwrap().abs() < 1e-5);
        // about the file origin: r × F alone, as there is no free moment
        let about_origin = expected.cross(&plate.force(&load));
        assert!((plate.moment_about_file_origin(&load) - about_origin).amax() < 1e-4);
        assert!(plate.force(&load).z > 0.0, "the ground pushes upwards");
        assert_eq!(c.notes.len(), usize::from(sign > 0.0), "an upward origin is mentioned: {:?}", c.notes);
    }
}

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\twalk.trc\n\
    DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
    100\t100\t3\t2\tmm\t100\t1\t3\n\
    Frame#\tTime\tA\t\t\tB\t\t\n\
    \t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n\
    7\t0.06\t1\t2\t3\t4\t5\t6\n\
    8\t0.07\t1.5\t-2e1\t3\t\t\t\n\
    9\t0.08\t0\t0\t0\t4\t5\t6\n";

const STO: &str = "walk\nversion=1\nnRows=3\nnColumns=3\ninDegrees=yes\nendheader\n\
    time\tknee angle_in_file\n";

const CSV: &str =
    "# made by hand\ntime_s,force_N,reach_mm,knee_deg,moment_Nmm\n0.0,1,2,180,4\n0.5,-1e3,5,90,7000\n";

fn storage() -> String {
    STO.replace("knee angle_in_file", "knee\thip") + "0.0\t10 20\n0.5   30\t40\n1.0 50 60\n"
}

#[test]
fn trc_keeps_gaps_and_zeros_apart() {
    for text in
        [TRC.to_string(), TRC.replace('\n', "\r\n"), TRC.replacen('\n', "\r\n", 4), format!("\u{feff}{TRC}")]
    {
        let mut m = read::parse_trc(Path::new("walk.trc"), text.as_bytes()).unwrap();
        assert_eq!((m.first_frame, m.rate_hz, m.time.len()), (7, 100.0, 3));
        assert_eq!(m.position[0][1], Some(Vector3::new(0.0015, -0.02, 0.003)));
        assert_eq!(
            m.position[1],
            [Some(Vector3::new(0.004, 0.005, 0.006)), None, Some(Vector3::new(0.004, 0.005, 0.006))]
        );
        assert_eq!(m.position[0][2], Some(Vector3::zeros()));
        m.zeros_to_gaps();
        assert_eq!(m.position[0][2], None);
    }
}

#[test]
fn tables_become_si() {
    let table = read::parse_series(Path::new("a.mot"), storage().as_bytes()).unwrap();
    assert_eq!(table.column("hip").unwrap(), [20.0, 40.0, 60.0]);
    assert!((table.angle("knee").unwrap()[1] - 30f64.to_radians()).abs() < 1e-15);
    let old = "walk\ndatacolumns 2\ndatarows 1\nrange 0 1\nendheader\ntime a\n0 3\n";
    assert_eq!(read::parse_series(Path::new("old.mot"), old.as_bytes()).unwrap().column("a").unwrap(), [3.0]);

    let table = read::parse_series(Path::new("a.csv"), CSV.as_bytes()).unwrap();
    assert_eq!(table.columns, ["force_N", "reach_m", "knee_rad", "moment_Nm"]);
    assert_eq!(table.column("reach_m").unwrap(), [0.002, 0.005]);
    assert_eq!(table.column("moment_Nm").unwrap(), [0.004, 7.0]);
    assert_eq!(table.column("knee_rad").unwrap()[1], 90f64.to_radians());
}

#[test]
fn knee_forces_come_in_two_layouts() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read::read_knee_forces(&path)
    };
    let plain = write("plain.csv", "time_s,medial_N,lateral_N\n0,100,50\n0.1,110,60\n").unwrap();
    assert_eq!((plain.medial, plain.lateral), (vec![100.0, 110.0], vec![50.0, 60.0]));
    let cells = write("cells.csv", "Time(sec),PM,AM,AL,PL,GON,GRFz\n0.5,10,20,30,40,0,0\n").unwrap();
    let pound = 4.4482216;
    assert!(
        (cells.medial[0] - pound * (0.9871 * 20.0 + 0.9683 * 10.0 + 0.0387 * 30.0 + 0.0211 * 40.0)).abs()
            < 1e-9
    );
    assert!(
        (cells.lateral[0] - pound * (0.0129 * 20.0 + 0.0317 * 10.0 + 0.9613 * 30.0 + 0.9789 * 40.0)).abs()
            < 1e-9
    );
    let one = write("one.csv", "time_s,medial_N,lateral_N\n0,100,\n0.1,110,\n").unwrap_err();
    assert!(one.to_string().contains("no row holds a lateral force"), "{one}");
    let beyond = write("beyond.csv", "time_s,medial_N,lateral_N\n0,100,50\n0.1,1e308,60\n").unwrap_err();
    assert!(
        beyond.to_string().contains("line 3") && beyond.to_string().contains("no knee bears that"),
        "{beyond}"
    );
    // As distributed: every line ends in a carriage return and in commas, some rows hold nothing else; cells may be empty.
    let public = "Time(sec),PM,AM,AL,PL,GON,GRFz,,\r0.5,10,20,30,40,1.5,-700,,\r,,,,,,,,\r0.6,11,21,31,41,,,,\r0.7,12,,32,42\r";
    for (name, text) in [
        ("cr.csv", public.to_string()),
        ("crlf.csv", public.replace('\r', "\r\n")),
        ("lf.csv", public.replace('\r', "\n")),
        ("quoted.csv", public.replace("Time(sec)", "\"Time(sec)\"")),
    ] {
        let found = write(name, &text).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(found.time, [0.5, 0.6, 0.7], "{name}");
        assert_eq!((found.medial[0], found.lateral[0]), (cells.medial[0], cells.lateral[0]));
        assert!(
            found.medial[1].is_finite() && found.medial[2].is_nan() && found.lateral[2].is_nan(),
            "a gap is a gap"
        );
        let said = read::check(&folder.path().join(name), None).unwrap();
        assert!(said.contains("3 rows, 0.5000 to 0.7000 s"), "{said}");
    }
    // What is wrong is still told, with its line.
    let error = write("extra.csv", "Time(sec),PM,AM,AL,PL,,\r0.5,1,2,3,4,,\r0.6,1,2,3,4,5,\r")
        .unwrap_err()
        .to_string();
    assert!(error.contains("line 3") && error.contains("`5`"), "{error}");
    let error = write("word.csv", "Time(sec),PM,AM,AL,PL,,\r0.5,1,2,x3,4,,\r").unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("AL") && error.contains("`x3`"), "{error}");
    let error = write("gaps.csv", "Time(sec),PM,AM,AL,PL\r0.5,,,,\r").unwrap_err().to_string();
    assert!(error.contains("no row holds a medial force"), "{error}");
    let error = write("short.csv", "Time(sec),PM,AM,AL\n0.5,10,20,30\n").unwrap_err().to_string();
    assert!(error.contains("line 1") && error.contains("`PL`"), "{error}");
}

// ------------------------------------------------------------------------------------------------ damage (IO2)

/// Any of the readers on bytes in memory.
fn parse_any(name: &str, bytes: &[u8]) -> Result<(), InputError> {
    let file = PathBuf::from(name);
    match file.extension().and_then(|e| e.to_str()) {
        Some("c3d") => {
            let c = c3d::parse(&file, bytes)?;
            for plate in &c.plates {
                for load in plate.loads(&file, &c.analog)? {
                    assert!(plate.moment_about_file_origin(&load).iter().all(|v| v.is_finite()));
                }
            }
            assert!(c.markers.position.iter().flatten().flatten().all(|p| p.iter().all(|v| v.is_finite())));
            Ok(())
        }
        Some("trc") => {
            let m = read::parse_trc(&file, bytes)?;
            assert!(m.position.iter().flatten().flatten().all(|p| p.iter().all(|v| v.is_finite())));
            Ok(())
        }
        _ => {
            let t = read::parse_series(&file, bytes)?;
            assert!(t.values.iter().flatten().all(|v| v.is_finite()));
            Ok(())
        }
    }
}

/// Memory bound of case IO1.
fn parse_bounded(name: &str, bytes: &[u8]) -> Result<(), InputError> {
    let (result, peak) = with_peak(|| parse_any(name, bytes));
    assert!(peak < 10 * bytes.len() + (64 << 20), "{name}: {peak} bytes held for a file of {}", bytes.len());
    result
}

fn small_files() -> Vec<(&'static str, Vec<u8>)> {
    let mut files = vec![
        ("small.trc", TRC.as_bytes().to_vec()),
        ("small.sto", storage().into_bytes()),
        ("small.csv", CSV.as_bytes().to_vec()),
    ];
    for order in [Order::Intel, Order::Dec, Order::Mips] {
        for real in [true, false] {
            files.push(("small.c3d", C3dFile { order, real, ..C3dFile::default() }.bytes()));
        }
    }
    files
}

#[test]
fn files_cut_at_every_byte_are_refused() {
    for (name, bytes) in small_files() {
        // The last line of a table may be cut inside its last number, or be the last of fewer rows where the
        // format has no row count: that is a good file. Everything else must be refused.
        let last_cell =
            bytes.len() - bytes.iter().rev().skip(1).position(|b| b",\t \n".contains(b)).unwrap_or(0) - 1;
        for length in 0..bytes.len() {
            let result = parse_bounded(name, &bytes[..length]);
            let may_be_good = name != "small.c3d" && length >= last_cell;
            let fewer_rows = name == "small.csv";
            // blocks of C3D are padded behind the last sample
            let padding = name == "small.c3d" && bytes[length..].iter().all(|b| *b == 0);
            assert!(
                result.is_err() || may_be_good || fewer_rows || padding,
                "{name} cut at {length} of {}",
                bytes.len()
            );
        }
        assert!(parse_bounded(name, &bytes).is_ok(), "{name}");
    }
}

#[test]
fn recordings_cut_at_many_places_are_refused() {
    for (file, places) in [
        ("gait/jw/jw_ngait_og3.c3d", 10_000),
        ("gait/dm/DM_ngait_og3_new.trc", 300),
        ("gait/dm/DM_ngait_og3_grf.sto", 300),
    ] {
        let Some(path) = shared(file) else { continue };
        let bytes = std::fs::read(path).unwrap();
        for i in 0..places {
            let length = bytes.len() / places * i;
            let result = parse_bounded(file, &bytes[..length]);
            assert!(result.is_err(), "{file} cut at {length}");
        }
    }
}

/// A small generator with a fixed seed (xorshift64*), so that a failure can be repeated.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % n
    }
}

#[test]
fn damaged_bytes_never_panic_or_take_memory() {
    let mut random = Random(20_240_601);
    for (name, bytes) in small_files() {
        let mut refused = 0;
        for round in 0..6_000 {
            let mut damaged = bytes.clone();
            // the parameter section of the C3D files fills the first blocks
            for _ in 0..1 + random.below(4) {
                let at = random.below(damaged.len());
                damaged[at] = match round % 4 {
                    0 => 0,
                    1 => 0xff,
                    2 => 0x80,
                    _ => random.below(256) as u8,
                };
            }
            refused += usize::from(parse_bounded(name, &damaged).is_err());
        }
        assert!(refused > 100, "{name}: only {refused} of 6000 damaged files were refused");
    }
}

#[test]
fn every_byte_of_a_c3d_header_may_lie() {
    let bytes = C3dFile::default().bytes();
    for at in 0..bytes.len().min(4096) {
        for value in [0, 1, 0x7f, 0x80, 0xff] {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            let _ = parse_bounded("lie.c3d", &damaged); // good or refused, but it ends
        }
    }
}

#[test]
fn lies_about_counts_name_the_byte() {
    let file = C3dFile::default();
    let mut many_frames = file.bytes();
    many_frames[8..10].copy_from_slice(&[0xff, 0xff]); // last frame 65535
    let mut loop_back = file.bytes();
    let label = loop_back.windows(6).position(|w| w == b"LABELS").unwrap();
    loop_back[label + 6..label + 8].copy_from_slice(&[1, 0]); // the next parameter begins inside this one
    let mut nan = file.bytes();
    let start = C3dFile::DATA_START;
    nan[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut huge = file.bytes();
    huge[start..start + 4].copy_from_slice(&f32::MAX.to_le_bytes());
    let mut sentry = file.bytes();
    sentry[0] = 255;
    for (what, bytes) in
        [("frames", many_frames), ("loop", loop_back), ("nan", nan), ("huge", huge), ("pointer", sentry)]
    {
        let error = parse_bounded("lie.c3d", &bytes).unwrap_err();
        assert!(error.to_string().contains("byte"), "{what}: {error}");
    }
}

#[test]
fn damaged_text_names_the_line() {
    let trc = |from: &str, to: &str| ("a.trc", TRC.replacen(from, to, 1).into_bytes());
    let sto = |from: &str, to: &str| ("a.sto", storage().replacen(from, to, 1).into_bytes());
    let csv = |from: &str, to: &str| ("a.csv", CSV.replacen(from, to, 1).into_bytes());
    let utf16: Vec<u8> =
        [0xff, 0xfe].into_iter().chain(TRC.encode_utf16().flat_map(|c| c.to_le_bytes())).collect();
    let without_mark: Vec<u8> = TRC.encode_utf16().flat_map(|c| c.to_be_bytes()).collect();
    let cases: Vec<((&str, Vec<u8>), Place)> = vec![
        (trc("-2e1", "NaN"), Place::Line(8)),
        (trc("-2e1", "inf"), Place::Line(8)),
        (trc("-2e1", "1e308"), Place::Line(8)),
        (trc("-2e1", ""), Place::Line(8)),
        (trc("0.08", "0.07"), Place::Line(9)),
        (trc("0.08", "0.09"), Place::Line(9)),
        (trc("\t3\t2\tmm", "\t4294967295\t2\tmm"), Place::Line(3)),
        (trc("\t3\t2\tmm", "\t-3\t2\tmm"), Place::Line(3)),
        (trc("\t3\t2\tmm", "\t3\t4294967295\tmm"), Place::Line(4)),
        (trc("\tmm\t", "\tfurlong\t"), Place::Line(3)),
        (trc("9\t0.08", "9\t0.08\t1"), Place::Line(9)),
        (("a.trc", utf16), Place::Byte(0)),
        (("a.trc", without_mark), Place::Byte(0)),
        (("a.trc", [TRC.as_bytes(), &[0xc3, 0x28]].concat()), Place::Byte(TRC.len())),
        (sto("nRows=3", "nRows=4294967295"), Place::Line(3)),
        (sto("nRows=3", "nRows=NaN"), Place::Line(3)),
        (sto("nColumns=3", "nColumns=-1"), Place::Line(4)),
        (sto("30", "nan"), Place::Line(9)),
        (sto("0.5", "0.0"), Place::Line(9)),
        (sto("0.5", "-0.5"), Place::Line(9)),
        (sto("50 60", "50"), Place::Line(10)),
        (sto("50 60", "50 60 70"), Place::Line(10)),
        (sto("endheader", "endhead"), Place::Whole),
        (csv("-1e3", "1e309"), Place::Line(4)),
        (csv("-1e3", ""), Place::Line(4)),
        (csv("0.5", "0"), Place::Line(4)),
        // As saved by a spreadsheet.
        (("a.csv", CSV.replacen("-1e3", "", 1).replace('\n', "\r\n").into_bytes()), Place::Line(4)),
        (csv("time_s", "frame"), Place::Line(1)),
    ];
    for ((name, bytes), place) in cases {
        let shown = String::from_utf8_lossy(&bytes).to_string();
        let error = parse_bounded(name, &bytes).expect_err(&shown);
        let at = match &error {
            InputError::Malformed { at, .. }
            | InputError::BadNumber { at, .. }
            | InputError::TimeNotIncreasing { at, .. } => *at,
            other => panic!("{other}"),
        };
        assert_eq!(at, place, "{error}\n{shown}");
        assert!(error.to_string().starts_with(name), "{error}");
    }
}

#[test]
fn what_is_no_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let absent = folder.path().join("absent.c3d");
    assert!(matches!(read::check(&absent, None), Err(InputError::Io { .. })));
    let odd = folder.path().join("odd.xyz");
    std::fs::write(&odd, "x").unwrap();
    assert!(matches!(read::check(&odd, None), Err(InputError::UnknownKind { .. })));
    assert!(matches!(
        read::check(Path::new("/dev/zero"), None),
        Err(InputError::UnknownKind { .. } | InputError::Io { .. })
    ));
    let named = folder.path().join("folder.c3d");
    std::fs::create_dir(&named).unwrap();
    assert!(matches!(read::check(&named, None), Err(InputError::Io { .. })));
}

#[test]
fn check_says_what_a_file_holds() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read::check(&path, None).unwrap()
    };
    let c = write("a.c3d", &C3dFile::default().bytes());
    assert!(
        c.contains("2 markers in 4 frames at 100 Hz")
            && c.contains("B 1 frames")
            && c.contains("Force plate 1"),
        "{c}"
    );
    let t = write("a.trc", TRC.as_bytes());
    assert!(
        t.contains("2 markers in 3 frames") && t.contains("B 1 frames") && t.contains("zeros_missing"),
        "{t}"
    );
    let k = write("k.csv", b"Time(sec),PM,AM,AL,PL,GON,GRFz\n0.5,10,20,30,40,0,0\n1.5,10,20,30,40,0,0\n");
    assert!(k.contains("Measured knee forces") && k.contains("2 rows"), "{k}");
    let subject =
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/subjects/DM.csv")).unwrap();
    let l = write("DM.csv", &subject);
    assert!(l.contains("Table of landmarks") && l.contains("pelvis 8"), "{l}");
    let s = write("a.mot", storage().as_bytes());
    assert!(s.contains("2 columns besides time, 3 rows") && s.contains("knee 10.0000 to 50.0000"), "{s}");
}
