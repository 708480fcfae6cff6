//! Where results come from: which program, on which machine, from which files, and how to compute them again.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::LazyLock;
use std::time::SystemTime;

use serde::Serialize;
use sha2::{Digest, Sha256};
use sysinfo::{CpuRefreshKind, MemoryRefreshKind, RefreshKind, System};

use super::OutputError;

/// Version, and the commit that it was compiled from: what `--version` says.
pub fn version() -> &'static str {
    static WORDS: LazyLock<String> = LazyLock::new(|| {
        let program = Program::this();
        let modified = if program.modified == Some(true) { ", modified" } else { "" };
        let commit = program.commit.map_or("unknown", |commit| commit.get(..10).unwrap_or(commit));
        format!("{} (commit {commit}{modified})", program.version)
    });
    &WORDS
}

/// This moment in UTC, ISO 8601, to the second.
pub fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

/// What computed the results.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Program {
    /// `sartorius`.
    pub name: &'static str,
    /// Version.
    pub version: &'static str,
    /// Commit that it was compiled from; absent where it was compiled outside of a repository.
    pub commit: Option<&'static str>,
    /// Whether the sources differed from that commit.
    pub modified: Option<bool>,
}

impl Program {
    /// The running one.
    pub fn this() -> Program {
        let said = |text: &'static str| (!text.is_empty()).then_some(text);
        Program {
            name: "sartorius",
            version: env!("CARGO_PKG_VERSION"),
            commit: said(env!("SARTORIUS_COMMIT")),
            modified: said(env!("SARTORIUS_MODIFIED")).map(|word| word == "yes"),
        }
    }
}

/// Where it was computed; what the system does not tell is absent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Machine {
    /// Operating system with its version.
    pub system: String,
    /// Instruction set.
    pub architecture: &'static str,
    /// Name of the processor.
    pub processor: Option<String>,
    /// Logical cores of this process.
    pub cores: Option<usize>,
    /// Memory \[MiB\].
    pub memory_mib: Option<f64>,
}

impl Machine {
    /// This one.
    pub fn this() -> Machine {
        let kind = RefreshKind::nothing()
            .with_cpu(CpuRefreshKind::nothing())
            .with_memory(MemoryRefreshKind::nothing().with_ram());
        let system = System::new_with_specifics(kind);
        let processor = system.cpus().first().map(|cpu| cpu.brand().trim().to_string());
        Machine {
            system: System::long_os_version().unwrap_or_else(|| std::env::consts::OS.into()),
            architecture: std::env::consts::ARCH,
            processor: processor.filter(|name| !name.is_empty()),
            cores: std::thread::available_parallelism().ok().map(usize::from),
            memory_mib: Some(system.total_memory()).filter(|m| *m > 0).map(|m| m as f64 / 1048576.0),
        }
    }
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
        if let Some(text) = multibody::shipped::text(path) {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            return Ok(InputFile::of_text(&name, text));
        }
        let mut digest = Sha256::new();
        let mut bytes = 0;
        let mut read = || -> io::Result<()> {
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
        Ok(InputFile { name, bytes, sha256: hex(digest) })
    }
}

impl InputFile {
    /// A text that is compiled in or was read already.
    pub fn of_text(name: &str, text: &str) -> InputFile {
        let sha256 = hex(Sha256::new_with_prefix(text));
        InputFile { name: name.into(), bytes: text.len() as u64, sha256 }
    }
}

fn hex(digest: Sha256) -> String {
    digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What computes the same again: write `files` into a folder and run `sartorius` with `arguments` there, with `--data` where recordings or
/// surfaces are read, which are told by their hashes among the inputs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Again {
    /// Arguments of the program.
    pub arguments: Vec<String>,
    /// Text by path in that folder: scene and trial as they were carried out, all keys named, and the table of landmarks.
    pub files: BTreeMap<String, String>,
}

impl Again {
    /// The command line as it was typed, without where the results go and how they are told; for commands whose files are all inputs.
    pub fn as_typed(command_line: &[String]) -> Again {
        let mut arguments = Vec::new();
        let mut typed = command_line.iter().skip(1);
        while let Some(argument) = typed.next() {
            match argument.as_str() {
                "--out" => drop(typed.next()),
                "--json" | "--force" | "--quiet" | "-q" => {}
                other if other.starts_with("--out=") => {}
                _ => arguments.push(argument.clone()),
            }
        }
        Again { arguments, files: BTreeMap::new() }
    }

    /// Adds a trial file and what it names, each by its name in the folder of the trial; returns the path of the trial among the files.
    pub fn trial(&mut self, texts: &[(String, String)]) -> Option<String> {
        let name = |name: &str| format!("trial/{name}");
        self.files.extend(texts.iter().map(|(file, text)| (name(file), text.clone())));
        texts.first().map(|(file, _)| name(file))
    }
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
