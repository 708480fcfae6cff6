//! C3D files: header, parameters, points and analog samples.
//!
//! Format: The C3D File Format, User Guide (Motion Lab Systems). Intel, DEC and MIPS byte order, integer and floating-point
//! storage. A point with a negative fourth word was not seen.

use std::path::Path;

use nalgebra::Vector3;

use super::bytes::{ByteOrder, Bytes};
use super::parameters::Parameters;
use super::plate::ForcePlate;
use super::{
    AnalogRecording, LARGEST_POSITION, LARGEST_RATE, MarkerRecording, file_bytes, malformed, metres_per,
};
use crate::error::{InputError, Place};

const BLOCK: usize = 512;

/// All that a C3D file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct C3d {
    /// Markers.
    pub markers: MarkerRecording,
    /// Analog channels; no channels where the file has none.
    pub analog: AnalogRecording,
    /// Force plates.
    pub plates: Vec<ForcePlate>,
    /// The parameter section as written.
    pub parameters: Parameters,
    /// What the file leaves open and how it was read.
    pub notes: Vec<String>,
}

/// Reads a C3D file.
pub fn read(path: &Path) -> Result<C3d, InputError> {
    parse(path, &file_bytes(path)?)
}

/// Reads a C3D file that is in memory; `file` is named in errors.
pub fn parse(file: &Path, data: &[u8]) -> Result<C3d, InputError> {
    let bytes = header(file, data)?;
    let parameters = Parameters::parse(file, bytes, parameter_start(data) + 4)?;
    let mut notes = Vec::new();
    let layout = Layout::new(file, bytes, &parameters)?;
    let markers = points(file, bytes, &parameters, &layout, &mut notes)?;
    let analog = analog(file, bytes, &parameters, &layout, &mut notes)?;
    let plates = plates(file, &parameters, metres_per(&markers.file_unit).unwrap_or(1e-3), &mut notes)?;
    Ok(C3d { markers, analog, plates, parameters, notes })
}

fn parameter_start(data: &[u8]) -> usize {
    (data[0] as usize - 1) * BLOCK
}

/// Checks the first words and finds the byte order.
fn header<'a>(file: &Path, data: &'a [u8]) -> Result<Bytes<'a>, InputError> {
    let export = "export the file again";
    let head = data.get(..BLOCK).ok_or_else(|| {
        malformed(
            file,
            Place::Byte(data.len()),
            format!("the file ends inside its header of {BLOCK} bytes"),
            export,
        )
    })?;
    if head[1] != 0x50 || head[0] == 0 {
        let problem = format!(
            "a C3D file begins with a block number and 80, this one with {} and {}",
            head[0], head[1]
        );
        return Err(malformed(file, Place::Byte(0), problem, "is it a C3D file?"));
    }
    let start = parameter_start(data);
    let order = match data.get(start + 3) {
        Some(84) => ByteOrder::Intel,
        Some(85) => ByteOrder::Dec,
        Some(86) => ByteOrder::Mips,
        Some(other) => {
            let problem = format!("processor type {other}; known are 84 (Intel), 85 (DEC), 86 (MIPS)");
            return Err(malformed(file, Place::Byte(start + 3), problem, export));
        }
        None => {
            let problem =
                format!("the parameter section should begin at byte {start}, the file has {}", data.len());
            return Err(malformed(file, Place::Byte(0), problem, export));
        }
    };
    Ok(Bytes { data, order })
}

/// Where the samples lie. Once made, every frame is known to lie inside the file.
struct Layout {
    n_points: usize,
    n_frames: usize,
    first_frame: usize,
    /// Analog samples per frame of markers.
    n_samples: usize,
    n_channels: usize,
    rate: f64,
    /// True where samples are floating-point numbers of 4 bytes, else integers of 2.
    real: bool,
    point_scale: f64,
    start: usize,
}

impl Layout {
    fn new(file: &Path, bytes: Bytes, parameters: &Parameters) -> Result<Self, InputError> {
        let word = |n: usize| bytes.u16(2 * (n - 1)).unwrap_or(0) as usize; // the header is 512 bytes long
        let lie = |byte: usize, problem: String| {
            Err(malformed(file, Place::Byte(byte), problem, "the header is damaged; export the file again"))
        };
        let n_points = parameters.count("POINT", "USED").unwrap_or(word(2));
        if n_points != word(2) {
            return lie(2, format!("the header counts {} points, POINT:USED {n_points}", word(2)));
        }
        let n_samples = word(10);
        let per_frame = word(3);
        let n_channels = match parameters.count("ANALOG", "USED") {
            Some(n) => n,
            None if n_samples > 0 => per_frame / n_samples,
            None => 0,
        };
        if n_channels * n_samples != per_frame {
            let problem = format!(
                "{n_channels} analog channels with {n_samples} samples do not make the {per_frame} values per frame of the header"
            );
            return lie(4, problem);
        }
        let (first_frame, last_frame) = frame_range(parameters, word(4), word(5));
        if first_frame == 0 || last_frame < first_frame {
            return lie(
                6,
                format!("frames run from {first_frame} to {last_frame}; they should count upwards from 1"),
            );
        }
        let n_frames = last_frame - first_frame + 1;
        if let Some(claimed) = parameters.count("POINT", "FRAMES") {
            let too_many_for_word = n_frames > 0xffff && (claimed == 0xffff || claimed == n_frames & 0xffff);
            if claimed != n_frames && !too_many_for_word {
                return lie(
                    6,
                    format!(
                        "frames {first_frame} to {last_frame} are {n_frames}, POINT:FRAMES says {claimed}"
                    ),
                );
            }
        }
        let rate = parameters.number("POINT", "RATE").or(bytes.f32(20)).unwrap_or(f64::NAN);
        if !(rate > 0.0 && rate <= LARGEST_RATE) {
            return lie(20, format!("the frame rate is {rate} Hz"));
        }
        let scale = parameters.number("POINT", "SCALE").or(bytes.f32(12)).unwrap_or(f64::NAN);
        if !scale.is_finite() || scale == 0.0 {
            return lie(12, format!("the scale of the points is {scale}"));
        }
        let real = scale < 0.0;
        let start = match parameters.count("POINT", "DATA_START").unwrap_or(word(9)) {
            0 => return lie(16, "the samples are said to begin in block 0".to_string()),
            block => (block - 1) * BLOCK,
        };
        let layout = Self {
            n_points,
            n_frames,
            first_frame,
            n_samples,
            n_channels,
            rate,
            real,
            point_scale: scale,
            start,
        };
        let (record, room) = (layout.record(), bytes.data.len().saturating_sub(start));
        if record == 0 {
            return lie(2, "the file holds neither points nor analog channels".to_string());
        }
        if n_frames > room / record {
            let problem = format!(
                "{n_frames} frames of {record} bytes are promised from byte {start}, there is room for {}",
                room / record
            );
            return Err(malformed(
                file,
                Place::Byte(bytes.data.len()),
                problem,
                "the file is cut off; copy or export it again",
            ));
        }
        Ok(layout)
    }

    fn width(&self) -> usize {
        if self.real { 4 } else { 2 }
    }

    /// Bytes per frame.
    fn record(&self) -> usize {
        (4 * self.n_points + self.n_samples * self.n_channels) * self.width()
    }

    fn frame(&self, frame: usize) -> usize {
        self.start + frame * self.record()
    }
}

/// First and last frame. Counts beyond 16 bits are kept in two words of the group TRIAL.
fn frame_range(parameters: &Parameters, first: usize, last: usize) -> (usize, usize) {
    let long = |name: &str| match parameters.get("TRIAL", name)?.counts()?[..] {
        [low, high, ..] if low <= 0xffff && high <= 0xffff => Some(low + (high << 16)),
        _ => None,
    };
    match (long("ACTUAL_START_FIELD"), long("ACTUAL_END_FIELD")) {
        (Some(a), Some(b)) if a & 0xffff == first && (b & 0xffff == last || b > 0xffff) => (a, b),
        _ => (first, last),
    }
}

fn points(
    file: &Path,
    bytes: Bytes,
    parameters: &Parameters,
    layout: &Layout,
    notes: &mut Vec<String>,
) -> Result<MarkerRecording, InputError> {
    let mut names = parameters.texts("POINT", "LABELS");
    names.truncate(layout.n_points);
    if names.len() < layout.n_points {
        notes.push(format!("{} of {} points have no name", layout.n_points - names.len(), layout.n_points));
        names.extend((names.len()..layout.n_points).map(|i| format!("unnamed_{}", i + 1)));
    }
    let file_unit = match parameters.texts("POINT", "UNITS").first().filter(|u| !u.is_empty()) {
        Some(unit) => unit.clone(),
        None => {
            notes.push("POINT:UNITS is absent; read as mm".to_string());
            "mm".to_string()
        }
    };
    let Some(metres) = metres_per(&file_unit) else {
        let byte = parameters.get("POINT", "UNITS").map_or(0, |p| p.byte);
        return Err(malformed(
            file,
            Place::Byte(byte),
            format!("POINT:UNITS is `{file_unit}`"),
            "known are m, cm, mm",
        ));
    };
    let scale = if layout.real { metres } else { metres * layout.point_scale };
    let mut position = Vec::with_capacity(names.len());
    for (marker, name) in names.iter().enumerate() {
        let mut path = Vec::with_capacity(layout.n_frames);
        for frame in 0..layout.n_frames {
            let at = layout.frame(frame) + 4 * marker * layout.width();
            let [x, y, z, seen] = [0, 1, 2, 3].map(|k| sample(bytes, layout, at, k).unwrap_or(f64::NAN));
            if seen < 0.0 {
                path.push(None);
                continue;
            }
            let place = Vector3::new(x, y, z) * scale;
            // Written so that NaN fails.
            if !(place.amax() <= LARGEST_POSITION && seen.is_finite()) || place.iter().any(|c| c.is_nan()) {
                return Err(InputError::BadNumber {
                    file: file.to_path_buf(),
                    at: Place::Frame(layout.first_frame + frame),
                    what: format!("marker `{name}` (byte {at})"),
                    value: format!("({x}, {y}, {z}) {file_unit}, residual {seen}"),
                });
            }
            path.push(Some(place));
        }
        position.push(path);
    }
    let time = (0..layout.n_frames).map(|i| (layout.first_frame - 1 + i) as f64 / layout.rate).collect();
    Ok(MarkerRecording {
        names,
        rate_hz: layout.rate,
        first_frame: layout.first_frame,
        time,
        position,
        file_unit,
    })
}

/// Number `k` of the record at byte `at`.
fn sample(bytes: Bytes, layout: &Layout, at: usize, k: usize) -> Option<f64> {
    if layout.real { bytes.f32(at + 4 * k) } else { bytes.i16(at + 2 * k).map(f64::from) }
}

fn analog(
    file: &Path,
    bytes: Bytes,
    parameters: &Parameters,
    layout: &Layout,
    notes: &mut Vec<String>,
) -> Result<AnalogRecording, InputError> {
    if layout.n_channels == 0 || layout.n_samples == 0 {
        return Ok(AnalogRecording::default());
    }
    let n = layout.n_channels;
    let rate_hz = layout.rate * layout.n_samples as f64;
    if let Some(claimed) =
        parameters.number("ANALOG", "RATE").filter(|r| (r - rate_hz).abs() > 1e-3 * rate_hz)
    {
        let problem = format!(
            "ANALOG:RATE is {claimed} Hz, but {} samples per frame at {} Hz make {rate_hz} Hz",
            layout.n_samples, layout.rate
        );
        let byte = parameters.get("ANALOG", "RATE").map_or(0, |p| p.byte);
        return Err(malformed(file, Place::Byte(byte), problem, "correct the rate; export the file again"));
    }
    let mut names = parameters.texts("ANALOG", "LABELS");
    names.truncate(n);
    names.extend((names.len()..n).map(|i| format!("unnamed_{}", i + 1)));
    let mut file_units = parameters.texts("ANALOG", "UNITS");
    file_units.resize(n, String::new());
    let (units, si): (Vec<String>, Vec<f64>) = file_units.iter().map(|u| si_unit(u)).unzip();
    let general = parameters.number("ANALOG", "GEN_SCALE").unwrap_or(1.0);
    let scales = padded(parameters.numbers("ANALOG", "SCALE"), n, 1.0, "ANALOG:SCALE", notes);
    let unsigned =
        parameters.texts("ANALOG", "FORMAT").first().is_some_and(|f| f.eq_ignore_ascii_case("UNSIGNED"));
    let wrap = |v: f64| if unsigned && v < 0.0 { v + 65536.0 } else { v };
    let offsets = padded(parameters.numbers("ANALOG", "OFFSET"), n, 0.0, "ANALOG:OFFSET", notes);

    let mut values = Vec::with_capacity(n);
    for channel in 0..n {
        let factor = scales[channel] * general * si[channel];
        let offset = wrap(offsets[channel]);
        let mut column = Vec::with_capacity(layout.n_frames * layout.n_samples);
        for frame in 0..layout.n_frames {
            let block = layout.frame(frame) + 4 * layout.n_points * layout.width();
            for i in 0..layout.n_samples {
                let k = i * n + channel;
                let raw = sample(bytes, layout, block, k).unwrap_or(f64::NAN);
                let value = (if layout.real { raw } else { wrap(raw) } - offset) * factor;
                if !value.is_finite() {
                    return Err(InputError::BadNumber {
                        file: file.to_path_buf(),
                        at: Place::Frame(layout.first_frame + frame),
                        what: format!(
                            "analog channel `{}` (byte {})",
                            names[channel],
                            block + k * layout.width()
                        ),
                        value: value.to_string(),
                    });
                }
                column.push(value);
            }
        }
        values.push(column);
    }
    let start = (layout.first_frame - 1) as f64 / layout.rate;
    let time = (0..layout.n_frames * layout.n_samples).map(|i| start + i as f64 / rate_hz).collect();
    Ok(AnalogRecording { names, units, rate_hz, time, values })
}

fn padded(mut v: Vec<f64>, n: usize, default: f64, name: &str, notes: &mut Vec<String>) -> Vec<f64> {
    if v.len() < n {
        notes.push(format!(
            "{name} has {} values for {n} channels; the others are taken as {default}",
            v.len()
        ));
    }
    v.resize(n, default);
    v
}

/// SI unit and factor of a unit as written.
fn si_unit(unit: &str) -> (String, f64) {
    let letters: String = unit.to_lowercase().chars().filter(|c| c.is_alphabetic()).collect();
    let (si, factor) = match letters.as_str() {
        "n" => ("N", 1.0),
        "nmm" => ("N m", 1e-3),
        "ncm" => ("N m", 1e-2),
        "nm" => ("N m", 1.0),
        "v" => ("V", 1.0),
        "mv" => ("V", 1e-3),
        _ => return (unit.to_string(), 1.0),
    };
    (si.to_string(), factor)
}

fn plates(
    file: &Path,
    parameters: &Parameters,
    metres: f64,
    notes: &mut Vec<String>,
) -> Result<Vec<ForcePlate>, InputError> {
    const GROUP: &str = "FORCE_PLATFORM";
    let n = parameters.count(GROUP, "USED").unwrap_or(0);
    if n == 0 {
        return Ok(Vec::new());
    }
    let counts = |name| parameters.get(GROUP, name).and_then(|p| p.counts()).unwrap_or_default();
    let [kinds, channels] = ["TYPE", "CHANNEL"].map(counts);
    let [corners, origins] = ["CORNERS", "ORIGIN"].map(|name| parameters.numbers(GROUP, name));
    // Instrumented types have 6 or 8 channels; the first dimension says how many are stored per plate.
    let per_plate =
        parameters.get(GROUP, "CHANNEL").and_then(|p| p.dimensions.first().copied()).unwrap_or(0) as usize;
    for (name, have, need) in [
        ("TYPE", kinds.len(), n),
        ("CORNERS", corners.len(), 12usize.saturating_mul(n)),
        ("ORIGIN", origins.len(), 3usize.saturating_mul(n)),
        ("CHANNEL", channels.len(), per_plate.max(1).saturating_mul(n)),
    ] {
        if have < need {
            let byte = parameters.get(GROUP, name).map_or(0, |p| p.byte);
            let problem = format!("{n} force plates need {need} values of {GROUP}:{name}, there are {have}");
            return Err(malformed(file, Place::Byte(byte), problem, "correct the group FORCE_PLATFORM"));
        }
    }
    let vector = |v: &[f64], i: usize| Vector3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2]) * metres;
    let mut plates = Vec::new();
    for i in 0..n {
        let mut origin = vector(&origins, i);
        if origin.z > 0.0 {
            notes.push(format!(
                "ORIGIN of force plate {} points upwards; taken with the opposite sign",
                i + 1
            ));
            origin = -origin; // the surface lies above the sensors, and z points down
        }
        let plate = ForcePlate {
            number: i + 1,
            kind: kinds[i],
            corners: [0, 1, 2, 3].map(|k| vector(&corners, 4 * i + k)),
            origin,
            channels: channels[per_plate * i..per_plate * (i + 1)]
                .iter()
                .take(6)
                .map(|c| c.wrapping_sub(1))
                .collect(),
        };
        let sound = plate
            .axes()
            .iter()
            .chain(plate.centre().iter())
            .chain(plate.origin.iter())
            .all(|c| c.is_finite());
        if !sound
            || plate.centre().amax() > LARGEST_POSITION
            || (plate.axes().determinant() - 1.0).abs() > 1e-6
        {
            let byte = parameters.get(GROUP, "CORNERS").map_or(0, |p| p.byte);
            let problem =
                format!("the corners of force plate {} do not make a rectangle: {:?}", i + 1, plate.corners);
            return Err(malformed(file, Place::Byte(byte), problem, "correct FORCE_PLATFORM:CORNERS"));
        }
        plates.push(plate);
    }
    Ok(plates)
}
