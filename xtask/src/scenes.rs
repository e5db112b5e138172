//! `cargo xtask scenes`: makes the demo scene, its sky and a room of mirrors and glass in `assets/`, the same bytes every time.

mod arcade;
mod building;
mod cloth;
mod glb;
mod lathe;
mod mesh;
mod noise;
mod parlour;
mod plants;
mod sky;
mod statue;
mod surface_nets;
#[cfg(test)]
mod tests;
mod textures;
mod walls;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// Where what is made lies in the repository.
const ARCADE: &str = "assets/arcade.glb";
const PARLOUR: &str = "assets/parlour.glb";
const SKY: &str = "assets/rigs/arcade_sky.hdr";

/// Writes them, or with `check` says whether the committed files are what would be written.
pub(crate) fn run(check: bool) -> Result<()> {
    for (name, made) in [(ARCADE, arcade::arcade()?), (PARLOUR, parlour::parlour()?), (SKY, sky::sky()?)] {
        let path = workspace::root().join(name);
        if check {
            let committed = std::fs::read(&path).with_context(|| format!("cannot read {name}"))?;
            if committed != made {
                bail!("{name} is not what its source makes: run `cargo xtask scenes` and commit the file");
            }
            println!("{name} is up to date");
        } else {
            std::fs::write(&path, &made).with_context(|| format!("cannot write {name}"))?;
            println!("wrote {name}: {} bytes", made.len());
        }
    }
    Ok(())
}
