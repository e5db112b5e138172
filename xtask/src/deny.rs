//! `cargo xtask deny`: licences, sources, duplicate versions and known vulnerabilities of all dependencies.
//!
//! The list of vulnerabilities lies in a git repository that not every machine reaches. Where it cannot be
//! fetched that check is skipped by name; everything else must pass.

use std::process::Output;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// What came of the check for vulnerabilities.
#[derive(Debug, PartialEq)]
enum Advisories {
    Passed,
    Unreachable,
    Failed,
}

fn judge(success: bool, report: &str) -> Advisories {
    let fetch_failed = ["failed to fetch advisory database", "failed to open advisory database"];
    if success {
        Advisories::Passed
    } else if fetch_failed.iter().any(|sign| report.contains(sign)) && !report.contains("error[") {
        Advisories::Unreachable
    } else {
        Advisories::Failed
    }
}

fn deny(checks: &[&str]) -> Result<Output> {
    let mut command = workspace::cargo();
    command.args(["deny", "--workspace", "--all-features", "check"]).args(checks);
    command.output().context("cannot run cargo deny")
}

/// Runs both checks, and installs cargo-deny where it is missing.
pub(crate) fn run() -> Result<()> {
    let version = workspace::cargo().args(["deny", "--version"]).output();
    if !version.is_ok_and(|version| version.status.success()) {
        println!("installing cargo-deny, which takes some minutes");
        let status = workspace::cargo().args(["install", "cargo-deny", "--locked"]).status();
        if !status.context("cannot run cargo install")?.success() {
            bail!("cannot install cargo-deny: run `cargo install cargo-deny --locked` to see why");
        }
    }
    let rules = deny(&["licenses", "bans", "sources"])?;
    eprint!("{}", String::from_utf8_lossy(&rules.stderr));
    if !rules.status.success() {
        bail!("cargo deny found a dependency that deny.toml forbids");
    }
    let advisories = deny(&["advisories"])?;
    let report = String::from_utf8_lossy(&advisories.stderr);
    match judge(advisories.status.success(), &report) {
        Advisories::Passed => eprint!("{report}"),
        Advisories::Unreachable => println!("skipped: advisories (database not reachable)"),
        Advisories::Failed => {
            eprint!("{report}");
            bail!("a dependency has a known vulnerability");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_failed_fetch_is_skipped() {
        let fetch = "[ERROR] failed to fetch advisory database https://example.org with cli: failed to clone";
        assert_eq!(judge(false, fetch), Advisories::Unreachable);
        assert_eq!(judge(true, "advisories ok"), Advisories::Passed);
        assert_eq!(judge(false, "error[vulnerability]: a buffer overflow"), Advisories::Failed);
        let both = format!("{fetch}\nerror[vulnerability]: found in an older copy");
        assert_eq!(judge(false, &both), Advisories::Failed);
        assert_eq!(judge(false, "anything else"), Advisories::Failed);
    }
}
