//! Every path that the documentation names exists.

use super::Source;

/// Folders of the repository's root; a path in backticks that begins with one is taken for a promise.
const FOLDERS: [&str; 6] = ["crates", "xtask", "assets", "docs", ".ci", ".cargo"];

/// Paths named in README.md and docs/*.md that do not exist.
pub(super) fn faults(sources: &[Source], exists: impl Fn(&str) -> bool) -> Vec<String> {
    let pages = sources.iter().filter(|source| {
        source.path == "README.md"
            || source.path.strip_prefix("docs/").is_some_and(|page| page.ends_with(".md"))
    });
    pages
        .flat_map(|page| {
            named_paths(&page.text)
                .filter(|(_, path)| !exists(path))
                .map(|(line, path)| format!("{}:{line}: {path} does not exist", page.path))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Line numbers and paths in the code spans outside fenced blocks.
fn named_paths(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    let lines = text.lines().enumerate().filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    });
    lines.flat_map(|(index, line)| {
        line.split('`').skip(1).step_by(2).filter_map(as_path).map(move |path| (index + 1, path))
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
