//! `relume merge`: from the blocks of several machines to one cache.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use relume::transfer::{BlocksOf, Shard};
use relume::{Error, Preparation, Result};

use super::prepare::{BLOCKS, Saved};
use crate::arguments::Threads;
use crate::console::Console;
use crate::interrupt;
use crate::memory::Limit;
use crate::output::{check_output, ending};
use crate::scene_file;

/// Make one cache of the blocks that `relume prepare --shard` has left: the same bytes as of one run.
///
/// The settings are those of the shards. What is quick is done again: reading the scene, what the camera sees, gather samples, training lights.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The scene that was prepared.
    scene: PathBuf,
    /// The blocks of all shards.
    #[arg(value_name = "BLOCKS", required = true)]
    blocks: Vec<PathBuf>,
    /// The cache to write.
    #[arg(short, long, value_name = "CACHE.relume")]
    output: PathBuf,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    memory: Limit,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example, both shards on machines of their own:
  relume prepare assets/arcade.glb -o arcade.relume --shard 1/2
  relume prepare assets/arcade.glb -o arcade.relume --shard 2/2
  relume merge assets/arcade.glb arcade.1-of-2.relume-blocks arcade.2-of-2.relume-blocks -o arcade.relume";

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let began = Instant::now();
    check_output(&arguments.output, "the name of a cache", &["relume"], &[&arguments.scene])?;
    for path in &arguments.blocks {
        if ending(path).as_deref() != Some(BLOCKS) {
            return Err(Error::file(
                path,
                format!(
                    "a file of blocks ends in .{BLOCKS}; name those that `relume prepare --shard` has left"
                ),
            ));
        }
    }
    let headers = arguments.blocks.iter().map(|path| BlocksOf::read(path)).collect::<Result<Vec<_>>>()?;
    let (Some(first), Some((of, _))) = (arguments.blocks.first(), headers.first()) else {
        return Err(Error::Setting("no files of blocks; name those of all shards".to_owned()));
    };
    check_all_there(first, headers.iter().filter_map(|(_, shard)| *shard))?;
    interrupt::listen()?;
    arguments.threads.start()?;
    let imported = scene_file::read(&arguments.scene, console)?;
    let read = began.elapsed().as_secs_f64();
    let preparation = Preparation::new(&imported.scene)
        .name(scene_file::name(&arguments.scene))
        .settings(of.settings.clone())
        .finished_blocks(arguments.blocks.iter().cloned());
    let transfer = arguments.memory.of(preparation)?.merge(&console.progress())?;
    let saved = Saved {
        scene: &arguments.scene,
        cache: &arguments.output,
        began,
        read,
        memory: arguments.memory,
        warnings: &imported.warnings,
    };
    saved.save(&transfer, arguments.json, console)
}

/// Refuses to begin where a shard is missing.
fn check_all_there(first: &Path, shards: impl Iterator<Item = Shard> + Clone) -> Result<()> {
    let Some(of) = shards.clone().map(|shard| shard.of).next() else { return Ok(()) };
    if let Some(other) = shards.clone().find(|shard| shard.of != of) {
        return Err(Error::file(
            first,
            format!("is one of {of} shards, and others are of {}; name those of one preparation", other.of),
        ));
    }
    let there: BTreeSet<u32> = shards.map(|shard| shard.number).collect();
    match (1..=of).find(|number| !there.contains(number)) {
        None => Ok(()),
        Some(missing) => Err(Error::file(
            first,
            format!("is one of {of} shards, of which number {missing} is missing; give those of all shards"),
        )),
    }
}
