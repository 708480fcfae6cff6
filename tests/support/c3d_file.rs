//! A writer of small C3D files, independent of the reader: markers, six analog channels, one force plate.

/// Byte order of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Little-endian IEEE.
    Intel,
    /// VAX.
    Dec,
    /// Big-endian IEEE.
    Mips,
}

/// What to write.
#[derive(Clone, Debug)]
pub struct C3dFile {
    /// Byte order.
    pub order: Order,
    /// Floating-point storage, else 16-bit integers.
    pub real: bool,
    /// Frames per second \[Hz\].
    pub rate: f32,
    /// Analog samples per frame.
    pub samples: usize,
    /// Integer analog samples run from 0 to 65535 with the zero in the middle.
    pub unsigned: bool,
    /// Number of the first frame.
    pub first_frame: u16,
    /// Unit of the points.
    pub unit: &'static str,
    /// Marker names.
    pub names: Vec<String>,
    /// Positions \[unit\] by marker, then frame; `None` is written as not seen.
    pub points: Vec<Vec<Option<[f64; 3]>>>,
    /// Analog values \[N, N mm\] by channel, then sample; six per plate.
    pub channels: Vec<Vec<f64>>,
    /// Corners of each plate \[unit\].
    pub corners: Vec<[[f64; 3]; 4]>,
    /// ORIGIN of every plate \[unit\].
    pub plate_origin: [f64; 3],
}

impl Default for C3dFile {
    /// Two markers in four frames, one of them missing once; one plate, two samples per frame.
    fn default() -> Self {
        let a = (0..4).map(|i| Some([100.0 + i as f64, -20.5, 300.25])).collect();
        let b = (0..4).map(|i| (i != 2).then_some([-7.0, 80.0 * i as f64, 1.5])).collect();
        let channel = |k: usize| {
            (0..8).map(|i| [3.0, -2.0, -700.0, 12000.0, -9000.0, 500.0][k] * (1.0 + 0.1 * i as f64)).collect()
        };
        Self {
            order: Order::Intel,
            real: true,
            rate: 100.0,
            samples: 2,
            unsigned: false,
            first_frame: 5,
            unit: "mm",
            names: vec!["A".into(), "B".into()],
            points: vec![a, b],
            channels: (0..6).map(channel).collect(),
            corners: vec![[[0.0, 0.0, 0.0], [0.0, 400.0, 0.0], [600.0, 400.0, 0.0], [600.0, 0.0, 0.0]]],
            plate_origin: [0.0; 3],
        }
    }
}

impl C3dFile {
    /// ANALOG:GEN_SCALE.
    const GENERAL_SCALE: f64 = 0.5;
    /// ANALOG:OFFSET of the channels of a plate.
    const ANALOG_OFFSETS: [i16; 6] = [3, 0, -20, 7, 0, 1];
    /// Value of one integer step of each analog channel of a plate, both scales together.
    pub const ANALOG_SCALES: [f64; 6] = [0.05, 0.05, 0.1, 5.0, 5.0, 5.0];
    /// Value of one integer step of a point \[unit\].
    pub const POINT_SCALE: f64 = 0.01;
    /// Offset of the first frame.
    pub const DATA_START: usize = 16 * 512;

    fn u16(&self, v: u16) -> [u8; 2] {
        if self.order == Order::Mips { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn f32(&self, v: f64) -> [u8; 4] {
        match self.order {
            Order::Intel => (v as f32).to_le_bytes(),
            Order::Mips => (v as f32).to_be_bytes(),
            Order::Dec => {
                // four times the IEEE number has the VAX bit pattern; the words are stored high word first
                let [b0, b1, b2, b3] = (4.0 * v as f32).to_le_bytes();
                [b2, b3, b0, b1]
            }
        }
    }

    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        let n_frames = self.points[0].len();
        let scale = if self.real { -Self::POINT_SCALE } else { Self::POINT_SCALE };
        let mut out = vec![2, 0x50];
        let n_channels = self.channels.len();
        for word in [
            self.points.len() as u16,
            (n_channels * self.samples) as u16,
            self.first_frame,
            (self.first_frame as usize + n_frames - 1).min(0xffff) as u16,
            0,
        ] {
            out.extend(self.u16(word));
        }
        out.extend(self.f32(scale));
        out.extend(self.u16((Self::DATA_START / 512 + 1) as u16));
        out.extend(self.u16(self.samples as u16));
        out.extend(self.f32(self.rate as f64));
        out.resize(512, 0);
        let processor = match self.order {
            Order::Intel => 84,
            Order::Dec => 85,
            Order::Mips => 86,
        };
        out.extend([1, 0x50, 15, processor]);
        self.parameters(&mut out, scale, n_frames);
        assert!(out.len() <= Self::DATA_START, "the parameters need {} bytes", out.len());
        out.resize(Self::DATA_START, 0);
        for frame in 0..n_frames {
            for path in &self.points {
                self.point(&mut out, path[frame]);
            }
            for sample in 0..self.samples {
                for (k, channel) in self.channels.iter().enumerate() {
                    let value = channel[frame * self.samples + sample];
                    let steps = value / Self::ANALOG_SCALES[k % 6] + self.offset(k) as f64;
                    if self.real {
                        out.extend(self.f32(steps));
                    } else {
                        out.extend(self.u16(steps.round() as i64 as u16));
                    }
                }
            }
        }
        out.resize(out.len().div_ceil(512) * 512, 0);
        out
    }

    /// Number that is stored for zero.
    fn offset(&self, channel: usize) -> i64 {
        Self::ANALOG_OFFSETS[channel % 6] as i64 + if self.unsigned { 32768 } else { 0 }
    }

    fn point(&self, out: &mut Vec<u8>, place: Option<[f64; 3]>) {
        let xyz = place.unwrap_or([0.0; 3]);
        if self.real {
            xyz.iter().for_each(|v| out.extend(self.f32(*v)));
            out.extend(self.f32(if place.is_some() { 0.0 } else { -1.0 }));
        } else {
            xyz.iter().for_each(|v| out.extend(self.u16((v / Self::POINT_SCALE).round() as i16 as u16)));
            out.extend(self.u16(if place.is_some() { 0 } else { -1i16 as u16 }));
        }
    }

    fn parameters(&self, out: &mut Vec<u8>, scale: f64, n_frames: usize) {
        let n_channels = self.channels.len();
        let n_plates = self.corners.len();
        let reals = |v: &[f64]| v.iter().flat_map(|x| self.f32(*x)).collect::<Vec<u8>>();
        let words = |v: &[u16]| v.iter().flat_map(|x| self.u16(*x)).collect::<Vec<u8>>();
        let texts = |v: &[String], width: usize| {
            v.iter().flat_map(|t| format!("{t:width$}").into_bytes()).collect::<Vec<u8>>()
        };
        let labels: Vec<String> = (0..n_channels)
            .map(|k| format!("{}{}", ["Fx", "Fy", "Fz", "Mx", "My", "Mz"][k % 6], k / 6 + 1))
            .collect();
        let units: Vec<String> =
            (0..n_channels).map(|k| if k % 6 < 3 { "N" } else { "Nmm" }.to_string()).collect();
        let scales: Vec<f64> =
            (0..n_channels).map(|k| Self::ANALOG_SCALES[k % 6] / Self::GENERAL_SCALE).collect();
        let offsets: Vec<u16> = (0..n_channels).map(|k| self.offset(k) as u16).collect();
        let format = if self.unsigned { "UNSIGNED" } else { "SIGNED" };
        let (first, last) = (self.first_frame as usize, self.first_frame as usize + n_frames - 1);
        let long = |frame: usize| words(&[frame as u16, (frame >> 16) as u16]);
        let corners: Vec<f64> = self.corners.iter().flatten().flatten().copied().collect();
        let origins: Vec<f64> = (0..n_plates).flat_map(|_| self.plate_origin).collect();
        let n = |v: usize| v as u8;
        let mut section = Vec::new();
        let mut group = |id: i8, name: &str, parameters: Vec<(&str, i8, Vec<u8>, Vec<u8>)>| {
            section.push((-id, name.to_string(), None));
            section.extend(
                parameters
                    .into_iter()
                    .map(|(p, kind, dims, raw)| (id, p.to_string(), Some((kind, dims, raw)))),
            );
        };
        group(
            1,
            "POINT",
            vec![
                ("USED", 2, vec![], words(&[self.points.len() as u16])),
                ("FRAMES", 2, vec![], words(&[n_frames.min(0xffff) as u16])),
                ("DATA_START", 2, vec![], words(&[(Self::DATA_START / 512 + 1) as u16])),
                ("SCALE", 4, vec![], reals(&[scale])),
                ("RATE", 4, vec![], reals(&[self.rate as f64])),
                ("UNITS", -1, vec![n(self.unit.len())], self.unit.as_bytes().to_vec()),
                ("LABELS", -1, vec![24, n(self.names.len())], texts(&self.names, 24)),
            ],
        );
        group(
            2,
            "ANALOG",
            vec![
                ("USED", 2, vec![], words(&[n_channels as u16])),
                ("GEN_SCALE", 4, vec![], reals(&[Self::GENERAL_SCALE])),
                ("RATE", 4, vec![], reals(&[self.rate as f64 * self.samples as f64])),
                ("SCALE", 4, vec![n(n_channels)], reals(&scales)),
                ("OFFSET", 2, vec![n(n_channels)], words(&offsets)),
                ("FORMAT", -1, vec![n(format.len())], format.as_bytes().to_vec()),
                ("UNITS", -1, vec![4, n(n_channels)], texts(&units, 4)),
                ("LABELS", -1, vec![8, n(n_channels)], texts(&labels, 8)),
            ],
        );
        group(
            3,
            "FORCE_PLATFORM",
            vec![
                ("USED", 2, vec![], words(&[n_plates as u16])),
                ("TYPE", 2, vec![n(n_plates)], words(&vec![2; n_plates])),
                ("CORNERS", 4, vec![3, 4, n(n_plates)], reals(&corners)),
                ("ORIGIN", 4, vec![3, n(n_plates)], reals(&origins)),
                ("CHANNEL", 2, vec![6, n(n_plates)], words(&(1..=6 * n_plates as u16).collect::<Vec<_>>())),
            ],
        );
        group(
            4,
            "TRIAL",
            vec![
                ("ACTUAL_START_FIELD", 2, vec![2], long(first)),
                ("ACTUAL_END_FIELD", 2, vec![2], long(last)),
            ],
        );
        for (id, name, array) in section {
            out.push(name.len() as u8);
            out.push(id as u8);
            out.extend(name.as_bytes());
            match array {
                None => {
                    out.extend(self.u16(3)); // the word itself and an empty description
                    out.push(0);
                }
                Some((kind, dims, raw)) => {
                    out.extend(self.u16((2 + 2 + dims.len() + raw.len() + 1) as u16));
                    out.push(kind as u8);
                    out.push(dims.len() as u8);
                    out.extend(dims);
                    out.extend(raw);
                    out.push(0);
                }
            }
        }
        out.extend([0, 0]);
    }
}
