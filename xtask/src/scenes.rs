//! `cargo xtask scenes`: makes the demo scene in `assets/`, the same bytes every time.

mod arcade;
mod building;
mod cloth;
mod glb;
mod lathe;
mod mesh;
mod noise;
mod plants;
mod statue;
mod surface_nets;
#[cfg(test)]
mod tests;
mod textures;
mod walls;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// Where the scene lies in the repository.
const ARCADE: &str = "assets/arcade.glb";

/// Writes the scene, or with `check` says whether the committed file is what would be written.
pub(crate) fn run(check: bool) -> Result<()> {
    let path = workspace::root().join(ARCADE);
    let scene = arcade::arcade()?;
    if check {
        let committed = std::fs::read(&path).with_context(|| format!("cannot read {ARCADE}"))?;
        if committed != scene {
            bail!("{ARCADE} is not what its source makes: run `cargo xtask scenes` and commit the file");
        }
        println!("{ARCADE} is up to date");
    } else {
        std::fs::write(&path, &scene).with_context(|| format!("cannot write {ARCADE}"))?;
        println!("wrote {ARCADE}: {} bytes", scene.len());
    }
    Ok(())
}
