//! Helpers shared by the tests of the workspace.

pub mod allocations;
pub mod c3d_file;
pub mod contact_scenes;
pub mod fem_scenes;
pub mod goldfarb_idnani;
pub mod grid_cases;
pub mod independent;
pub mod motion_cases;
pub mod random_scenes;
pub mod results;
pub mod sharing_cases;

pub mod sharing_problems;
pub mod side_scenes;
pub mod walking;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Set to anything where the tests are to do without `../shared`.
const WITHOUT_DATA: &str = "SARTORIUS_WITHOUT_DATA";

/// A file or folder under `../shared`, the read-only reference material beside the repository.
///
/// Fails where it is absent, unless `SARTORIUS_WITHOUT_DATA` is set: then `None`, with a printed notice, and the calling test returns without a
/// verdict.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared").join(relative);
    if path.exists() {
        return Some(path);
    }
    assert!(
        std::env::var_os(WITHOUT_DATA).is_some(),
        "{} is absent: put the data there, or leave out what needs it with {WITHOUT_DATA}=1",
        path.display()
    );
    eprintln!("notice: {} is absent; this check is skipped", path.display());
    None
}

/// A shipped trial file by its name.
pub fn shipped_trial(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../gait-data/trials").join(name).with_extension("toml")
}

/// Order at which `|f(h) - f(0) - h * slope|` falls: 2 when `slope` is f'(0), clearly less when it is not.
///
/// `h`: first step, small against the length over which `f` bends.
pub fn taylor_order(f: impl Fn(f64) -> f64, slope: f64, h: f64) -> f64 {
    let [r0, r1, r2] = [h, h / 2.0, h / 4.0].map(|h| (f(h) - f(0.0) - h * slope).abs());
    if r0 <= 1e-12 * (f(0.0).abs() + slope.abs()) {
        return f64::INFINITY; // exactly linear
    }
    (r0 / r1).log2().min((r1 / r2).log2()) // twice: no pass by cancellation
}

/// A small seeded generator (SplitMix64), so that random cases repeat exactly.
pub struct Random(u64);

impl Random {
    /// Generator of a seed.
    pub fn new(seed: u64) -> Random {
        // The first draw becomes the state, so that the streams of neighbouring seeds are not shifts of each other.
        let mut random = Random(seed ^ 0xD134_2543_DE82_EF95);
        random.0 = random.bits();
        random
    }

    /// Next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in −1..1.
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Uniform in low..high.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * 0.5 * (self.uniform() + 1.0)
    }

    /// 10 to a power uniform in low..high.
    pub fn power(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.between(low, high))
    }

    /// An integer in low..=high.
    pub fn integer(&mut self, low: usize, high: usize) -> usize {
        low + (self.bits() % (high - low + 1) as u64) as usize
    }

    /// An integer in 0..n.
    pub fn below(&mut self, n: usize) -> usize {
        self.integer(0, n - 1)
    }

    /// True with probability p.
    pub fn chance(&mut self, p: f64) -> bool {
        self.between(0.0, 1.0) < p
    }

    /// Standard normal (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        let (a, b) = (0.5 * (self.uniform() + 1.0), self.uniform());
        (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::PI * b).cos()
    }

    /// Three components uniform in −size..size.
    pub fn vector(&mut self, size: f64) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(self.uniform(), self.uniform(), self.uniform()) * size
    }
}

/// What a program printed.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The program itself, run to its end.
pub fn sartorius(arguments: &[&str], folder: &Path) -> Output {
    Command::new(program()).args(arguments).current_dir(folder).output().expect("the program starts")
}

/// The program, built once by the cargo that runs these tests.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
        let status = Command::new(cargo)
            .args(["build", "--quiet", "--release", "-p", "sartorius-command", "--bin", "sartorius"])
            .current_dir(&root)
            .status()
            .expect("cargo runs");
        assert!(status.success(), "the program does not build");
        // target/<profile>/deps/this-test
        let target = std::env::current_exe().unwrap().ancestors().nth(3).unwrap().to_path_buf();
        target.join("release/sartorius")
    })
}
