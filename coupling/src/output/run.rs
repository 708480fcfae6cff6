//! `run.json`: verdict, versions, settings, seconds per stage, peak memory and what was read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::OutputError;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// Every frame solved; exit code 0.
    Solved,
    /// Something did not converge or a verdict failed; exit code 3.
    NotConverged,
}

/// One file that was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputFile {
    /// File name without its folder, so that the record does not depend on where the data lie.
    pub name: String,
    /// Size in bytes.
    pub bytes: u64,
    /// SHA-256 of the content, hexadecimal; the number that `sha256sum` prints.
    pub sha256: String,
}

impl InputFile {
    /// Reads the whole file once, in pieces; shipped ones are known.
    pub fn of(path: &Path) -> Result<InputFile, OutputError> {
        let mut digest = Sha256::new();
        let mut bytes = 0;
        let mut read = || -> io::Result<()> {
            if let Some(text) = multibody::shipped::text(path) {
                digest.update(text);
                bytes = text.len() as u64;
                return Ok(());
            }
            let mut file = File::open(path)?;
            let mut buffer = vec![0; 1 << 16];
            loop {
                let n = file.read(&mut buffer)?;
                if n == 0 {
                    return Ok(());
                }
                digest.update(&buffer[..n]);
                bytes += n as u64;
            }
        };
        read().map_err(|e| OutputError::at("read", path, e))?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let sha256 = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(InputFile { name, bytes, sha256 })
    }
}

/// The content of `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunRecord {
    /// The command, e.g. `optimize`.
    pub command: String,
    /// How it ended.
    pub status: RunStatus,
    /// Why, when it is not solved.
    pub reason: Option<String>,
    /// The numbers that decide: the summary that heads the report.
    pub verdict: Option<serde_json::Value>,
    /// Name and version of what computed this.
    pub versions: BTreeMap<String, String>,
    /// Every setting that was in force, as the command line understood it.
    pub settings: serde_json::Value,
    /// Files that were read.
    pub inputs: Vec<InputFile>,
    /// Stage and wall seconds, in the order of the run.
    #[serde(serialize_with = "as_map")]
    pub seconds: Vec<(String, f64)>,
    /// Threads that were used.
    pub threads: usize,
    /// Iterations per stage, e.g. of the marker fit and of force sharing, summed over frames.
    pub iterations: BTreeMap<String, u64>,
    /// Largest resident memory of the process \[MiB\]; absent where the system does not tell.
    pub peak_memory_mib: Option<f64>,
    /// Files that were written beside this one.
    pub files: Vec<String>,
}

impl RunRecord {
    /// An empty record of a solved run of `command` by this version of the program.
    pub fn new(command: &str) -> RunRecord {
        let versions = BTreeMap::from([
            ("sartorius".to_string(), env!("CARGO_PKG_VERSION").to_string()),
            ("platform".to_string(), format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)),
        ]);
        RunRecord {
            command: command.to_string(),
            status: RunStatus::Solved,
            reason: None,
            verdict: None,
            versions,
            settings: serde_json::Value::Null,
            inputs: Vec::new(),
            seconds: Vec::new(),
            threads: 1,
            iterations: BTreeMap::new(),
            peak_memory_mib: None,
            files: Vec::new(),
        }
    }

    /// Notes the wall time of a stage.
    pub fn stage(&mut self, name: &str, took: Duration) {
        self.seconds.push((name.to_string(), took.as_secs_f64()));
    }
}

/// Stages as an object in the order of the run, which a sorted map would lose.
fn as_map<S: serde::Serializer>(stages: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().map(|(name, seconds)| (name, seconds)))
}

/// Largest resident memory of this process so far \[MiB\]. Linux only: `VmHWM` of `/proc/self/status`.
pub fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_the_published_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("abc.txt");
        std::fs::write(&path, "abc").unwrap();
        let input = InputFile::of(&path).unwrap();
        // FIPS 180-2, appendix B.1
        assert_eq!(input.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!((input.name.as_str(), input.bytes), ("abc.txt", 3));
        let error = InputFile::of(&dir.path().join("absent.c3d")).unwrap_err().to_string();
        assert!(error.contains("absent.c3d"), "{error}");
    }
}
