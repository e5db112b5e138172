//! Crates of the workspace depend on each other one way: `relume` ← files and GPU ← programs and bindings.

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::workspace;

/// For each crate the crates of the workspace that it may use. Tests may use any.
const ALLOWED: [(&str, &[&str]); 8] = [
    ("relume", &[]),
    ("relume-io", &["relume"]),
    ("relume-gpu", &["relume"]),
    ("relume-viewer", &["relume", "relume-io", "relume-gpu"]),
    ("relume-cli", &["relume", "relume-io", "relume-gpu", "relume-viewer"]),
    ("relume-py", &["relume", "relume-io", "relume-gpu"]),
    ("relume-tests", &["relume", "relume-io", "relume-gpu"]),
    ("xtask", &[]),
];

/// What `cargo metadata` says of this workspace.
pub(super) fn of_workspace() -> Result<Value> {
    let output = workspace::cargo()
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .output()
        .context("cannot run cargo metadata")?;
    if !output.status.success() {
        bail!("cargo metadata failed: {}", String::from_utf8_lossy(&output.stderr));
    }
    serde_json::from_slice(&output.stdout).context("cannot read what cargo metadata wrote")
}

fn list<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    value[key].as_array().into_iter().flatten()
}

fn name(value: &Value) -> &str {
    value["name"].as_str().unwrap_or_default()
}

/// Dependencies that point the wrong way, and crates that [`ALLOWED`] does not know.
pub(super) fn faults(metadata: &Value) -> Vec<String> {
    let members: Vec<&str> = list(metadata, "packages").map(name).collect();
    let mut faults = Vec::new();
    for package in list(metadata, "packages") {
        let user = name(package);
        let Some((_, allowed)) = ALLOWED.iter().find(|(member, _)| *member == user) else {
            faults.push(format!(
                "{user}: a new crate; say what it may use in xtask/src/structure/dependencies.rs"
            ));
            continue;
        };
        for dependency in list(package, "dependencies") {
            let used = name(dependency);
            let for_tests = dependency["kind"] == "dev";
            if members.contains(&used) && !for_tests && !allowed.contains(&used) {
                faults.push(format!("{user}: must not depend on {used}; turn the dependency round"));
            }
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn workspace(core_uses: Value) -> Value {
        json!({"packages": [
            {"name": "relume", "dependencies": core_uses},
            {"name": "relume-io", "dependencies": [{"name": "relume", "kind": null}]},
        ]})
    }

    #[test]
    fn the_core_depends_on_no_other_crate() {
        assert!(faults(&workspace(json!([{"name": "glam", "kind": null}]))).is_empty());
        assert!(faults(&workspace(json!([{"name": "relume-io", "kind": "dev"}]))).is_empty());
        let wrong = faults(&workspace(json!([{"name": "relume-io", "kind": null}])));
        assert_eq!(wrong.len(), 1);
        assert!(wrong[0].starts_with("relume: must not depend on relume-io"), "{wrong:?}");
    }

    #[test]
    fn an_unknown_crate_is_a_fault() {
        let metadata = json!({"packages": [{"name": "relume-extra", "dependencies": []}]});
        assert_eq!(faults(&metadata).len(), 1);
    }
}
