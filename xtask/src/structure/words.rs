//! Words that have no place in the repository: unfinished work, names that say nothing, one machine's paths.

use super::Source;

/// This file spells them out.
const HERE: &str = "xtask/src/structure/words.rs";
const UNFINISHED: [&str; 6] = ["todo!(", "unimplemented!(", "dbg!(", "FIXME", "XXX", "HACK"];
const MACHINE_PATHS: [&str; 4] = ["/home/", "/root/", "/Users/", "C:\\Users"];
const EMPTY_NAMES: [&str; 9] =
    ["util", "utils", "helper", "helpers", "manager", "managers", "misc", "common", "old"];

/// Faulty words, each with its place.
pub(super) fn faults(sources: &[Source]) -> Vec<String> {
    let mut faults = Vec::new();
    for source in sources.iter().filter(|source| source.path != HERE) {
        let path = &source.path;
        let is_code = path.ends_with(".rs");
        let stems = path.split('/').map(|part| part.split('.').next().unwrap_or(part));
        faults.extend(
            stems
                .filter(|stem| is_code && EMPTY_NAMES.contains(stem))
                .map(|stem| format!("{path}: {stem} says nothing; name the file after what it holds")),
        );
        for (index, line) in source.text.lines().enumerate() {
            let unfinished = UNFINISHED.iter().filter(|word| is_code && line.contains(**word));
            let foreign = MACHINE_PATHS.iter().filter(|word| line.contains(**word));
            faults
                .extend(unfinished.chain(foreign).map(|word| format!("{path}:{}: remove {word}", index + 1)));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::super::source;
    use super::*;

    #[test]
    fn faulty_words_are_found() {
        let right = source("crates/relume/src/scene/mod.rs", "// Doors are told apart by their handles.\n");
        assert!(faults(&[right]).is_empty());
        let wrong = [
            source("crates/relume/src/utils.rs", ""),
            source("crates/relume/src/helpers/mod.rs", ""),
            source("crates/relume/src/a.rs", "fn a() {\n    todo!()\n}\n"),
            source("docs/A.md", "Look in /home/me/scenes.\n"),
        ];
        let found = faults(&wrong);
        assert_eq!(found.len(), 4, "{found:?}");
        assert!(found[2].contains("a.rs:2"), "{found:?}");
    }
}
