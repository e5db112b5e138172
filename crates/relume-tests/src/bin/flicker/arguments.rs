//! The command line.

use std::path::{Path, PathBuf};

use clap::Parser;
use relume::glam::Vec3;
use relume::transfer::{Quality, Settings};
use relume::{Error, Light, LightKind, Result};
use relume_tests::command_line::{gather_count, image_size, named};

/// Measure how much indirect light flickers while a spot moves in small steps.
///
/// The spot moves along a straight line, by default over the floor's edge with the steps of the demo scene's plinth. After every step the
/// shot is relit, one indirect bounce, with 16, 4 and 1 sub-samples for each gather sample. What flickers is told by the second difference over
/// time of the image, against that of an exact transfer: fixed rays from every pixel, and a shadow ray for each of the points that they hit.
/// Paths on the command line are taken from the root of the workspace.
#[derive(Parser, Clone, Debug)]
#[command(name = "cargo xtask flicker", bin_name = "cargo xtask flicker", after_help = EXAMPLE, max_term_width = 100)]
pub(crate) struct Arguments {
    /// The scene: .glb, .gltf or .obj.
    #[arg(value_name = "SCENE", default_value = "assets/arcade.glb")]
    pub(crate) scene: PathBuf,
    /// Number of the camera in the scene.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) camera: usize,
    /// Width and height of the image in pixels.
    #[arg(long, value_name = "WxH", default_value = "48x36", value_parser = image_size)]
    pub(crate) size: (usize, usize),
    /// Gather samples, a power of four.
    #[arg(long, value_name = "N", default_value = "65536", value_parser = gather_count)]
    pub(crate) gather: usize,
    /// How much time and space to spend on the preparation: glance, draft, standard or final.
    #[arg(long, value_name = "QUALITY", default_value = "standard", value_parser = named::<Quality>)]
    pub(crate) quality: Quality,
    /// Steps that the spot makes; there is one more image than steps.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub(crate) steps: u32,
    /// Where the spot begins, metres.
    #[arg(long, value_name = "X,Y,Z", default_value = "-1.5,3,0.8", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) position: Vec3,
    /// What it is aimed at to begin with, metres.
    #[arg(long, value_name = "X,Y,Z", default_value = "-0.2,0,0.3", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) target: Vec3,
    /// How far it moves each step, metres.
    #[arg(long, value_name = "X,Y,Z", default_value = "0.01,0,0", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) step: Vec3,
    /// How far its target moves each step, metres [default: as far as the spot].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) target_step: Option<Vec3>,
    /// Where the spot's light begins to fade and where it ends, degrees from its axis.
    #[arg(long, value_name = "INNER,OUTER", default_value = "5,8", value_parser = angles)]
    pub(crate) angles: (f32, f32),
    /// Rays from each pixel in either of the two independent sets of the exact transfer; more have less grain.
    #[arg(long, value_name = "N", default_value_t = 8192, value_parser = clap::value_parser!(u32).range(16..=1 << 20))]
    pub(crate) rays: u32,
    /// Sub-samples for each gather sample, a row each: 1, 4, 16.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "16,4,1", value_parser = sub_samples)]
    pub(crate) sub_samples: Vec<usize>,
    /// Seed of the preparation and of the exact transfer's rays.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u32,
    /// Where to write flicker.md, flicker.json and flicker.svg.
    #[arg(long, value_name = "DIR", default_value = "out/flicker")]
    pub(crate) out: PathBuf,
    /// Threads to work on [default: one a processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print flicker.json on stdout instead of the table.
    #[arg(long)]
    pub(crate) json: bool,
}

const EXAMPLE: &str = "\
A minute's try on the scene that comes with Relume:
  cargo xtask flicker --gather 4096 --quality draft --rays 1024
Another scene and another spot, of which only the target moves:
  cargo xtask flicker sponza.glb --position -3,4,0.5 --target 0,0,0 --step 0,0,0 --target-step 0,0,0.02";

impl Arguments {
    /// The spot after each step, the place it begins at first. White: what is measured does not depend on its colour.
    ///
    /// # Errors
    /// [`Error::Setting`] where it does not move, or reaches its own target.
    pub(crate) fn lights(&self) -> Result<Vec<Light>> {
        let target_step = self.target_step.unwrap_or(self.step);
        if self.step == Vec3::ZERO && target_step == Vec3::ZERO {
            return Err(Error::Setting("the spot does not move; give a --step or a --target-step".into()));
        }
        let (inner_angle, outer_angle) = self.angles;
        let light = |number: u32| {
            let position = self.position + self.step * number as f32;
            let target = self.target + target_step * number as f32;
            if position.distance_squared(target) < 1e-8 {
                return Err(Error::Setting(format!(
                    "after step {number} the spot is where its target is; move --position or --target"
                )));
            }
            let intensity = Vec3::splat(100.0);
            let kind = LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius: 0.0 };
            Ok(Light { name: "spot".to_owned(), enabled: true, kind })
        };
        (0..=self.steps).map(light).collect()
    }

    /// What the transfer is prepared with: diffuse light alone, as the exact transfer has it.
    pub(crate) fn settings(&self) -> Settings {
        Settings {
            size: self.size,
            camera: self.camera,
            gather: self.gather,
            quality: self.quality,
            glossy: false,
            seed: self.seed,
            ..Settings::default()
        }
    }

    /// The scene's name: its file without folder and ending.
    pub(crate) fn name(&self) -> String {
        let name = self.scene.file_stem().map(Path::new).unwrap_or(&self.scene);
        name.display().to_string()
    }
}

fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let numbers: Vec<f32> =
        text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    let numbers: [f32; N] = numbers.try_into().ok()?;
    numbers.iter().all(|number| number.is_finite() && number.abs() <= 1e6).then_some(numbers)
}

fn vector(text: &str) -> Result<Vec3, String> {
    let vector = numbers::<3>(text).map(Vec3::from);
    vector.ok_or_else(|| "write three numbers with commas between them, as 0.5,2,-1".to_owned())
}

fn angles(text: &str) -> Result<(f32, f32), String> {
    let both = numbers::<2>(text).map(|[inner, outer]| (inner, outer));
    both.filter(|&(inner, outer)| 0.0 <= inner && inner <= outer && outer > 0.0 && outer <= 90.0)
        .ok_or_else(|| "write two angles in degrees, 0 to 90, the larger one last, as 5,8".to_owned())
}

fn sub_samples(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| [1, 4, 16].contains(count));
    count.ok_or_else(|| "must be 1, 4 or 16".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        Arguments::try_parse_from(std::iter::once("flicker").chain(line.split_whitespace()))
    }

    #[test]
    fn every_example_is_a_command_line() {
        Arguments::command().debug_assert();
        let examples = EXAMPLE.lines().filter_map(|line| line.trim().strip_prefix("cargo xtask flicker"));
        let examples: Vec<_> = examples.collect();
        assert_eq!(examples.len(), 2);
        for example in examples {
            parse(example).unwrap().lights().unwrap();
        }
        for wrong in [
            "--steps 1",
            "--position 1,2",
            "--target 1,2,nan",
            "--angles 8,5",
            "--angles 0,0",
            "--angles 5,91",
            "--sub-samples 2",
            "--rays 8",
            "--size 48",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_spot_moves_step_by_step() {
        let lights = |line: &str| parse(line).unwrap().lights();
        let ends = |line: &str| {
            let lights = lights(line).unwrap();
            let LightKind::Spot { position, target, .. } = lights[lights.len() - 1].kind else {
                panic!("a spot")
            };
            (lights.len(), position, target)
        };
        let line = "--position 0,2,0 --target 0,0,0 --steps 4 --step 0,0,-0.5";
        assert_eq!(ends(line), (5, Vec3::new(0.0, 2.0, -2.0), Vec3::new(0.0, 0.0, -2.0)));
        let alone = format!("{line} --target-step 0,0,0.25");
        assert_eq!(ends(&alone), (5, Vec3::new(0.0, 2.0, -2.0), Vec3::new(0.0, 0.0, 1.0)));
        for (line, said) in [
            ("--step 0,0,0", "does not move"),
            ("--position 0,2,0 --target 0,0,0 --step 0,-1,0 --target-step 0,0,0", "after step 2"),
        ] {
            assert!(lights(line).unwrap_err().to_string().contains(said), "{line}");
        }
    }
}
