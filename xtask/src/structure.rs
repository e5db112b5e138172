//! `cargo xtask structure`: checks of how the repository is built, which no compiler makes.
//!
//! Each check takes what it judges as plain values and returns one sentence for each fault.

mod dependencies;
mod names;
mod paths;
mod sources;
mod words;

use std::path::Path;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// A text file of the repository.
struct Source {
    /// From the root, with forward slashes.
    path: String,
    /// All of it.
    text: String,
}

const TEXT_EXTENSIONS: [&str; 8] = ["rs", "wgsl", "toml", "md", "py", "sh", "yml", "json"];

/// Reads the text files under `folder` in order of their names; what builds leave behind is passed over.
fn read_sources(root: &Path, folder: &Path, sources: &mut Vec<Source>) -> Result<()> {
    let cannot_read = || format!("cannot read {}", folder.display());
    let mut entries =
        folder.read_dir().and_then(Iterator::collect::<Result<Vec<_>, _>>).with_context(cannot_read)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        let kind = entry.file_type().with_context(cannot_read)?;
        if kind.is_dir() {
            if !matches!(name.as_str(), "target" | "out" | ".git" | ".cache") {
                read_sources(root, &path, sources)?;
            }
        } else if kind.is_file() {
            let extension = path.extension().and_then(|extension| extension.to_str());
            let is_text = extension.map_or(folder.file_name().is_some_and(|name| name == ".ci"), |e| {
                TEXT_EXTENSIONS.contains(&e)
            });
            if is_text {
                let text = std::fs::read_to_string(&path)
                    .with_context(|| format!("cannot read {} as text", path.display()))?;
                let parts = path.strip_prefix(root).unwrap_or(&path).components();
                let path = parts.map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>();
                sources.push(Source { path: path.join("/"), text });
            }
        }
    }
    Ok(())
}

/// All faults of the repository, one sentence each.
fn faults() -> Result<Vec<String>> {
    let root = workspace::root();
    let mut sources = Vec::new();
    read_sources(root, root, &mut sources)?;
    let mut faults = dependencies::faults(&dependencies::of_workspace()?);
    faults.extend(sources::faults(&sources));
    faults.extend(paths::faults(&sources, |path| root.join(path).exists()));
    faults.extend(names::faults(&sources));
    faults.extend(words::faults(&sources));
    Ok(faults)
}

/// Prints every fault; fails where there is one.
pub(crate) fn run() -> Result<()> {
    let faults = faults()?;
    for fault in &faults {
        eprintln!("{fault}");
    }
    if !faults.is_empty() {
        bail!("{} faults of structure", faults.len());
    }
    Ok(())
}

#[cfg(test)]
fn source(path: &str, text: &str) -> Source {
    Source { path: path.to_owned(), text: text.to_owned() }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_repository_has_no_faults() {
        let faults = super::faults().unwrap();
        assert!(faults.is_empty(), "{}", faults.join("\n"));
    }
}
