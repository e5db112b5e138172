//! The program that is measured, as a process of its own for each job: its peak memory is then that job's alone.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use relume::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::points::Point;

/// `relume`.
pub(crate) struct Program {
    pub(crate) path: PathBuf,
    pub(crate) quality: String,
    pub(crate) frames: u32,
    pub(crate) threads: Option<u16>,
}

/// A part of a preparation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Stage {
    pub(crate) name: String,
    pub(crate) seconds: f64,
}

/// What `relume prepare --json` says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Prepared {
    /// From reading the scene to the cache on disk.
    pub(crate) seconds: f64,
    /// `null` where the system does not tell.
    pub(crate) peak_rss_bytes: Option<u64>,
    pub(crate) cache_bytes: u64,
    /// Of all operators.
    pub(crate) bytes_per_pixel: f64,
    pub(crate) triangles: u64,
    pub(crate) receivers: u64,
    pub(crate) threads: usize,
    pub(crate) stages: Vec<Stage>,
}

/// What `relume bench --json` says; medians over frames in which one light moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Relit {
    /// The light that moved.
    pub(crate) light: String,
    pub(crate) frame_ms: f64,
    /// The slowest of 95 frames in 100.
    pub(crate) frame_p95_ms: f64,
    pub(crate) direct_ms: f64,
    pub(crate) cloud_ms: f64,
    /// With `cloud_ms`.
    pub(crate) bounces_ms: f64,
    pub(crate) gather_ms: f64,
    pub(crate) upsample_ms: f64,
    pub(crate) sum_ms: f64,
    pub(crate) color_change_ms: f64,
    pub(crate) shadow_rays: u64,
    /// `null` where the system does not tell.
    pub(crate) peak_rss_bytes: Option<u64>,
}

impl Relit {
    /// Bounces within the cloud and the final gather: the part of a frame in which the transfer is applied.
    pub(crate) fn transfer_ms(&self) -> f64 {
        (self.bounces_ms - self.cloud_ms).max(0.0) + self.gather_ms
    }
}

impl Program {
    /// Prepares a scene.
    ///
    /// # Errors
    /// What the program says, or that it cannot be run.
    pub(crate) fn prepare(&self, scene: &Path, cache: &Path, point: &Point) -> Result<Prepared> {
        let (width, height) = point.size;
        let mut command = self.command("prepare");
        command.args([scene, Path::new("--output"), cache]);
        command.args(["--size", &format!("{width}x{height}"), "--gather", &point.gather.to_string()]);
        command.args(["--quality", &self.quality]);
        // a job that goes on from what an earlier one left would be no measurement
        command.arg("--no-checkpoint");
        said(command)
    }

    /// Relights a cache.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub(crate) fn relight(&self, cache: &Path, rig: &Path) -> Result<Relit> {
        let mut command = self.command("bench");
        command.args([cache, Path::new("--rig"), rig]);
        command.args(["--frames", &self.frames.to_string()]);
        said(command)
    }

    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(&self.path);
        command.args([name, "--json"]);
        if let Some(threads) = self.threads {
            command.args(["--threads", &threads.to_string()]);
        }
        command
    }
}

/// Runs a command and reads the JSON that it prints.
fn said<T: DeserializeOwned>(mut command: Command) -> Result<T> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| Error::io(Path::new(command.get_program()), "run", error))?;
    let words: Vec<_> = command.get_args().map(OsStr::to_string_lossy).collect();
    let failed =
        |why: &str| Error::io(Path::new(command.get_program()), "measure", other(&words.join(" "), why));
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().rfind(|line| !line.trim().is_empty());
        return Err(failed(last.unwrap_or("it failed and did not say why")));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| failed(&error.to_string()))
}

fn other(command: &str, why: &str) -> std::io::Error {
    std::io::Error::other(format!("`{command}`: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transfer_s_part_leaves_out_light_on_the_cloud() {
        let text = r#"{"light": "key", "frame_ms": 95, "frame_p95_ms": 99, "direct_ms": 17, "cloud_ms": 20,
            "bounces_ms": 61, "gather_ms": 16.5, "upsample_ms": 8, "sum_ms": 1, "color_change_ms": 0.7,
            "shadow_rays": 88409, "peak_rss_bytes": null, "something": "new"}"#;
        let relit: Relit = serde_json::from_str(text).unwrap();
        assert_eq!(relit.transfer_ms(), 57.5);
    }

    #[test]
    fn a_program_that_is_not_there_is_named() {
        let program =
            Program { path: "no/such/relume".into(), quality: "draft".into(), frames: 1, threads: None };
        let error = program.relight(Path::new("a.relume"), Path::new("b.toml")).unwrap_err();
        assert!(error.to_string().starts_with("no/such/relume: cannot run"), "{error}");
    }
}
