//! Every path that the documentation names exists.

use super::Source;

/// Folders of the repository's root; a path in backticks that begins with one is taken for a promise.
const FOLDERS: [&str; 6] = ["crates", "xtask", "assets", "docs", ".ci", ".cargo"];

/// The documentation: README.md and docs/*.md.
pub(super) fn pages(sources: &[Source]) -> impl Iterator<Item = &Source> {
    sources.iter().filter(|source| {
        source.path == "README.md"
            || source.path.strip_prefix("docs/").is_some_and(|page| page.ends_with(".md"))
    })
}

/// Paths that the documentation names and that do not exist.
pub(super) fn faults(sources: &[Source], exists: impl Fn(&str) -> bool) -> Vec<String> {
    let mut faults = Vec::new();
    for page in pages(sources) {
        for (line, spans) in spans(&page.text) {
            let paths = spans.iter().filter_map(|(span, _)| as_path(span));
            faults.extend(
                paths
                    .filter(|path| !exists(path))
                    .map(|path| format!("{}:{line}: {path} does not exist", page.path)),
            );
        }
    }
    faults
}

/// Line numbers and code spans outside fenced blocks, each with the text between it and the next.
pub(super) fn spans(text: &str) -> impl Iterator<Item = (usize, Vec<(&str, &str)>)> {
    let mut fenced = false;
    let lines = text.lines().enumerate().filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    });
    lines.map(|(index, line)| {
        let parts: Vec<&str> = line.split('`').collect();
        let spans = parts[1..].chunks(2).map(|pair| (pair[0], pair.get(1).copied().unwrap_or_default()));
        (index + 1, spans.collect())
    })
}

/// The path that a code span names, without a line number or an anchor.
fn as_path(span: &str) -> Option<&str> {
    let path = span.split(['#', ':']).next().unwrap_or(span);
    let plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "._-/".contains(c));
    let (first, _) = path.split_once('/')?;
    (plain && (FOLDERS.contains(&first) || (path.ends_with(".rs") && first != ".."))).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::super::source;
    use super::*;

    #[test]
    fn a_named_path_must_exist() {
        let exists = |path: &str| ["docs/CACHE.md", "crates/relume/src/lib.rs", "assets/"].contains(&path);
        let right = "See `docs/CACHE.md`, `crates/relume/src/lib.rs:12`, `assets/` and `cargo run`; `a/b` is \
                     division.\n```\n`crates/none.rs`\n```\n";
        assert!(faults(&[source("docs/A.md", right)], exists).is_empty());
        let wrong = "Fine.\nSee `crates/relume/src/gone.rs` and `src/gone.rs`.";
        let found = faults(&[source("README.md", wrong)], exists);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0], "README.md:2: crates/relume/src/gone.rs does not exist");
    }

    #[test]
    fn only_documentation_is_read() {
        assert!(faults(&[source("CHANGELOG.md", "`crates/gone.rs`")], |_| false).is_empty());
    }
}
