//! Results that are kept from run to run, by the hash of everything that they depend on.
//!
//! A result is one small file `HASH.toml`, whose first line holds the SHA-256 of the rest. Numbers read back to the last bit, so a
//! run says the same with and without the cache. A file that is damaged is computed anew, with a notice.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fem::mesh::Mesh;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

/// Name of the folder of the cache; it lies beside the output folders.
pub const FOLDER: &str = "calibration-cache";
/// Files larger than this are no entries \[bytes\].
const LARGEST: u64 = 1 << 20;

/// A folder of results.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
}

impl Cache {
    /// The cache of the runs that write beside `output`.
    pub fn beside(output: &Path) -> Cache {
        Cache { folder: output.parent().unwrap_or(Path::new("")).join(FOLDER) }
    }

    /// The result with this hash: as kept, or as `find` computes it, which is kept then. `what` it is, for notices.
    pub fn get_or<T, E>(&self, hash: &str, what: &str, find: impl FnOnce() -> Result<T, E>) -> Result<T, E>
    where
        T: Serialize + DeserializeOwned,
    {
        let file = self.folder.join(hash).with_extension("toml");
        match read(&file) {
            Ok(found) => return Ok(found),
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => crate::say!("note: {}: {e}; {what} is computed anew", file.display()),
        }
        let found = find()?;
        if let Err(e) = self.write(&file, &found) {
            crate::say!("note: {what} is not kept for later runs: {}: {e}", file.display());
        }
        Ok(found)
    }

    fn write<T: Serialize>(&self, file: &Path, found: &T) -> io::Result<()> {
        let text = toml::to_string(found).map_err(io::Error::other)?;
        std::fs::create_dir_all(&self.folder)?;
        // Under a name of its own first: runs may write the same result at the same time.
        let partial = tempfile::NamedTempFile::new_in(&self.folder)?;
        std::fs::write(partial.path(), format!("# {}\n{text}", hex(Sha256::digest(&text))))?;
        partial.persist(file).map_err(|e| e.error)?;
        Ok(())
    }
}

/// An entry; any damage is an error.
fn read<T: DeserializeOwned>(file: &Path) -> io::Result<T> {
    let damaged = || io::Error::new(io::ErrorKind::InvalidData, "the file is damaged");
    let mut text = String::new();
    std::fs::File::open(file)?.take(LARGEST).read_to_string(&mut text)?;
    let (first, rest) = text.split_once('\n').ok_or_else(damaged)?;
    if first.strip_prefix("# ") != Some(&hex(Sha256::digest(rest))) {
        return Err(damaged());
    }
    toml::from_str(rest).map_err(|_| damaged())
}

/// SHA-256 of a mesh, of `rest` and of this program.
///
/// Numbers in `rest` have to be printed so that they read back the same, as `{:?}` does.
pub fn content_hash(mesh: &Mesh, rest: &str) -> String {
    let mut digest = of_mesh(mesh, rest);
    digest.update(program());
    hex(digest.finalize())
}

/// SHA-256 of a text and of this program.
pub fn program_hash(text: &str) -> String {
    hex(Sha256::new().chain_update(text).chain_update(program()).finalize())
}

/// SHA-256 of a mesh and of `rest`, whichever program asks.
pub fn lasting_hash(mesh: &Mesh, rest: &str) -> String {
    hex(of_mesh(mesh, rest).finalize())
}

/// SHA-256 of a text or of bytes, hexadecimal.
pub fn text_hash(text: impl AsRef<[u8]>) -> String {
    hex(Sha256::digest(text))
}

fn of_mesh(mesh: &Mesh, rest: &str) -> Sha256 {
    let mut digest = Sha256::new();
    for x in mesh.points.as_flattened() {
        digest.update(x.to_bits().to_le_bytes());
    }
    for block in &mesh.blocks {
        digest.update(format!("{}{:?}", block.name, block.kind));
        block.nodes.iter().for_each(|node| digest.update(node.to_le_bytes()));
    }
    digest.update(format!("{:?}{:?}{rest}", mesh.node_sets, mesh.surfaces));
    digest
}

static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Says which file holds the code of this program, where that is not its executable: a library that another program has loaded.
pub fn program_is(file: PathBuf) {
    let _ = PROGRAM.set(file); // said already: the same
}

/// Hash of the running program; another one may compute something else.
fn program() -> &'static [u8] {
    static HASH: OnceLock<Vec<u8>> = OnceLock::new();
    HASH.get_or_init(|| {
        let executable = || std::env::current_exe();
        let program = PROGRAM.get().cloned().map_or_else(executable, Ok).and_then(std::fs::read);
        program.map_or(Vec::new(), |bytes| Sha256::digest(bytes).to_vec())
    })
}

fn hex(bytes: impl AsRef<[u8]>) -> String {
    bytes.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    struct Numbers {
        values: Vec<f64>,
    }

    #[test]
    fn what_is_kept_reads_back_to_the_last_bit_and_damage_is_computed_anew() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::beside(&folder.path().join("out"));
        let numbers = Numbers { values: vec![1.0 / 3.0, 1e-300, -0.0, 12.0, f64::MIN_POSITIVE, 1e22 / 7.0] };
        let ask = |given: &Numbers| {
            let mut computed = false;
            let found: Result<Numbers, ()> = cache.get_or("ab", "it", || {
                computed = true;
                Ok(given.clone())
            });
            (found.unwrap(), computed)
        };
        assert_eq!(ask(&numbers), (numbers.clone(), true));
        let other = Numbers { values: Vec::new() };
        let (found, computed) = ask(&other);
        assert!(!computed);
        let bits = |n: &Numbers| n.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found), bits(&numbers));

        let file = folder.path().join(FOLDER).join("ab.toml");
        let whole = std::fs::read(&file).unwrap();
        let mut changed = whole.clone();
        *changed.last_mut().unwrap() ^= 1;
        for damaged in [&whole[..whole.len() - 3], &changed, b"", b"\xff\xfe"] {
            std::fs::write(&file, damaged).unwrap();
            assert_eq!(ask(&numbers), (numbers.clone(), true));
            assert_eq!(std::fs::read(&file).unwrap(), whole, "kept anew");
        }
        assert_eq!(std::fs::read_dir(folder.path().join(FOLDER)).unwrap().count(), 1);
    }

    #[test]
    fn a_cache_that_cannot_be_written_stops_nothing() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FOLDER), "in the way").unwrap();
        let cache = Cache::beside(&folder.path().join("out"));
        let found: Result<Numbers, ()> = cache.get_or("ab", "it", || Ok(Numbers { values: vec![2.0] }));
        assert_eq!(found.unwrap().values, [2.0]);
    }
}
