//! Every function and type that the documentation names exists, in the file that it names with it.

use super::Source;
use super::paths::{pages, spans};

/// Names in README.md and docs/*.md that no source has, or not the one named right after them (`name`, `folder/file.rs`).
pub(super) fn faults(sources: &[Source]) -> Vec<String> {
    let code: Vec<&Source> = sources.iter().filter(|source| source.path.ends_with(".rs")).collect();
    let mut faults = Vec::new();
    for page in pages(sources) {
        for (line, spans) in spans(&page.text) {
            for (place, (name, after)) in spans.iter().enumerate() {
                let Some(segments) = segments(name) else { continue };
                let within = file_of(&spans[place..], after);
                if within.is_none() && !is_clearly_code(name) {
                    continue;
                }
                for segment in segments {
                    let mut files = code.iter().filter(|file| within.is_none_or(|path| file.path == path));
                    if !files.any(|file| has_word(&file.text, segment)) {
                        let place = within.unwrap_or("any source");
                        faults.push(format!("{}:{line}: `{segment}` is not in {place}", page.path));
                    }
                }
            }
        }
    }
    faults
}

/// The parts of a path of identifiers, `None` for anything else.
fn segments(span: &str) -> Option<Vec<&str>> {
    let segments: Vec<&str> = span.trim_end_matches("()").split("::").collect();
    let is_identifier = |part: &&str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic())
            && part.len() > 1
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    segments.iter().all(is_identifier).then_some(segments)
}

/// Whether a name is one of code even where no file is named with it: `Type::function` or `TypeName`.
fn is_clearly_code(name: &str) -> bool {
    let camel = name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().skip(1).any(|c| c.is_ascii_uppercase())
        && name.chars().any(|c| c.is_ascii_lowercase());
    name.contains("::") || camel
}

/// The source file that ends the list of spans which begins with a name: "`a`, `b` and `c`, `folder/file.rs`".
fn file_of<'a>(spans: &[(&'a str, &'a str)], after_name: &str) -> Option<&'a str> {
    let mut between = after_name;
    for &(span, after) in &spans[1..] {
        if !matches!(between.trim(), "," | "and" | ", and") {
            return None;
        }
        if span.contains('/') && span.ends_with(".rs") {
            return Some(span);
        }
        between = after;
    }
    None
}

fn has_word(text: &str, word: &str) -> bool {
    let part_of_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].ends_with(part_of_word) && !text[at + word.len()..].starts_with(part_of_word)
    })
}

#[cfg(test)]
mod tests {
    use super::super::source;
    use super::*;

    #[test]
    fn a_name_must_be_in_the_file_beside_it() {
        let code = source("crates/a/src/b.rs", "struct Cell;\nimpl Cell { fn halve(&self) {} }");
        let other = source("crates/a/src/c.rs", "fn gather() {}");
        let page = |text: &str| source("docs/A.md", text);
        let faults = |text: &str| {
            faults(&[page(text), source(&code.path, &code.text), source(&other.path, &other.text)])
        };
        assert!(faults("| how | `Cell::halve`, `crates/a/src/b.rs` | `gather` | `rows` |").is_empty());
        assert_eq!(
            faults("Fine.\n`gather` and `Cell`, `crates/a/src/b.rs`"),
            ["docs/A.md:2: `gather` is not in crates/a/src/b.rs"]
        );
        assert_eq!(faults("`Cell::gone`"), ["docs/A.md:1: `gone` is not in any source"]);
        assert_eq!(faults("`RowSource`").len(), 1);
        // words of other kinds are no promises
        assert!(faults("`--rows`, `k_d`, `r`, `1 / 2`, `EXR`").is_empty());
    }

    #[test]
    fn a_word_is_whole() {
        assert!(has_word("fn halve(x)", "halve") && !has_word("fn halve_group(x)", "halve"));
    }
}
