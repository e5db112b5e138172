//! Fingerprints of the library's sources, so that what `quality` keeps between runs is used only by the code that made
//! it.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::io::Result;
use std::path::Path;

/// What a path-traced reference depends on.
const REFERENCE: [&str; 4] = ["scene", "trace", "shade", "reference"];
/// What a prepared transfer depends on.
const PREPARATION: [&str; 5] = ["scene", "trace", "shade", "sample", "transfer"];

fn main() -> Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=RELUME_REFERENCE_SOURCES={:016x}", fingerprint(&REFERENCE)?);
    println!("cargo::rustc-env=RELUME_PREPARATION_SOURCES={:016x}", fingerprint(&PREPARATION)?);
    Ok(())
}

fn fingerprint(modules: &[&str]) -> Result<u64> {
    let library = Path::new("../relume/src");
    let mut hasher = DefaultHasher::new();
    for module in modules {
        let folder = library.join(module);
        println!("cargo::rerun-if-changed={}", folder.display());
        hash_folder(&folder, &mut hasher)?;
    }
    Ok(hasher.finish())
}

/// Takes in names and contents of all files, in the order of their names.
fn hash_folder(folder: &Path, hasher: &mut DefaultHasher) -> Result<()> {
    let mut entries = folder.read_dir()?.collect::<Result<Vec<_>>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        entry.file_name().hash(hasher);
        if entry.file_type()?.is_dir() {
            hash_folder(&entry.path(), hasher)?;
        } else {
            std::fs::read(entry.path())?.hash(hasher);
        }
    }
    Ok(())
}
