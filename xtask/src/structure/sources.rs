//! What stands where in the core library, and how long a file may be.

use super::Source;

/// Lines a source file may have.
const LONGEST: usize = 600;
/// The BVH library, and the only place that may name it.
const BVH: (&str, &str) = ("obvhs", "crates/relume/src/trace");
/// The path tracer.
const REFERENCE: &str = "crates/relume/src/reference";
/// What the path tracer may use of its own crate, so that it stays a judge of the rest: modules, and the
/// names that the crate's root takes from them.
const REFERENCE_MAY_USE: [&str; 20] = [
    "scene",
    "trace",
    "shade",
    "image",
    "error",
    "progress",
    "reference",
    "Error",
    "Result",
    "Progress",
    "Scene",
    "Camera",
    "Light",
    "LightKind",
    "LightRig",
    "Image",
    "Layers",
    "LightLayers",
    "glam",
    "Geometry",
];
/// The stages it judges.
const REFERENCE_JUDGES: [&str; 3] = ["sample", "transfer", "relight"];

/// Files that are too long, name the BVH library out of place, or let the path tracer lean on what it judges.
pub(super) fn faults(sources: &[Source]) -> Vec<String> {
    let code = sources
        .iter()
        .filter(|source| [".rs", ".wgsl", ".py"].iter().any(|extension| source.path.ends_with(extension)));
    code.flat_map(|source| {
        let mut faults = Vec::new();
        let lines = source.text.lines().count();
        if lines > LONGEST {
            faults.push(format!("{}: {lines} lines; split it by concept below {LONGEST}", source.path));
        }
        if source.path.starts_with("crates/") && !is_under(&source.path, BVH.1) {
            let found = source.text.lines().position(|line| line.contains(BVH.0));
            faults.extend(found.map(|line| {
                format!("{}:{}: names {}, which only {} may", source.path, line + 1, BVH.0, BVH.1)
            }));
        }
        if is_under(&source.path, REFERENCE) {
            faults.extend(reference_faults(source));
        }
        faults
    })
    .collect()
}

/// True for the module `folder.rs` and everything in `folder/`.
fn is_under(path: &str, folder: &str) -> bool {
    path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/') || rest == ".rs")
}

fn reference_faults(source: &Source) -> Vec<String> {
    let used = names_after(&source.text, "crate::").into_iter();
    let foreign = used.filter(|name| !REFERENCE_MAY_USE.contains(&name.as_str()));
    let is_root = source.path.ends_with("/mod.rs") || source.path.ends_with("reference.rs");
    let up = if is_root { "super::" } else { "super::super::" };
    let siblings = names_after(&source.text, up).into_iter();
    let judged = siblings.filter(|name| REFERENCE_JUDGES.contains(&name.as_str()));
    foreign
        .chain(judged)
        .map(|name| format!("{}: the path tracer must not use {name}", source.path))
        .collect()
}

/// The first names of the paths that follow `root`, those in braces one by one.
fn names_after(text: &str, root: &str) -> Vec<String> {
    let identifier = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let mut names = Vec::new();
    for (at, _) in text.match_indices(root) {
        let rest = &text[at + root.len()..];
        if !rest.starts_with('{') {
            names.push(identifier(rest));
            continue;
        }
        let mut depth = 0;
        for (index, c) in rest.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                break;
            }
            if depth == 1 && matches!(c, '{' | ',') {
                names.push(identifier(&rest[index + 1..]));
            }
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

#[cfg(test)]
mod tests {
    use super::super::source;
    use super::*;

    fn faults_of(path: &str, text: &str) -> usize {
        faults(&[source(path, text)]).len()
    }

    #[test]
    fn long_files_are_faults() {
        assert_eq!(faults_of("crates/relume/src/a.rs", &"\n".repeat(600)), 0);
        assert_eq!(faults_of("crates/relume/src/a.rs", &"\n".repeat(601)), 1);
    }

    #[test]
    fn only_trace_names_the_bvh_library() {
        let text = "use obvhs::cwbvh::CwBvh;";
        assert_eq!(faults_of("crates/relume/src/trace/accel.rs", text), 0);
        assert_eq!(faults_of("crates/relume/src/sample/cloud.rs", text), 1);
        assert_eq!(faults_of("crates/relume/src/tracery.rs", text), 1);
    }

    #[test]
    fn the_path_tracer_uses_nothing_it_judges() {
        let path = "crates/relume/src/reference/path.rs";
        assert_eq!(faults_of(path, "use crate::{error::Result, scene::{Scene, Light}, trace::Accel};"), 0);
        assert_eq!(faults_of(path, "use crate::sample::GatherCloud;"), 1);
        assert_eq!(faults_of(path, "use crate::{scene::Scene, transfer::{Haar, Rows}, Relighter};"), 2);
        assert_eq!(faults_of(path, "use super::super::relight::Relighter;"), 1);
        assert_eq!(faults_of("crates/relume/src/reference/mod.rs", "use super::sample::ViewSamples;"), 1);
        assert_eq!(faults_of("crates/relume/src/relight/mod.rs", "use crate::sample::ViewSamples;"), 0);
    }
}
