//! The light cases of a measurement: made by a seeded generator, or read from rigs.

use std::f32::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use relume::glam::Vec3;
use relume::image::Layers;
use relume::reference::{Paths, Settings, render};
use relume::scene::EnvironmentMap;
use relume::{Error, Light, LightKind, LightRig, Result};
use relume_io::{check_materials, load_rig};

use crate::arguments::no_folder;
use crate::shot::Shot;
use crate::space::{Draws, FreeSpace};
use crate::summary::median;

/// The name of the case of light that surfaces emit.
pub(crate) const EMISSION: &str = "emission";
/// A light whose response is below this share of the median is replaced.
const WEAK: f64 = 0.05;
/// Tries to replace a weak light; the strongest one tried stays.
const ATTEMPTS: u32 = 8;
/// Radiant flux of every light made, W; a sun's is that through a disc as wide as what the camera sees.
const FLUX: f32 = 100.0;
/// From the middle of the dome's sun to its rim, degrees.
const SUN: f32 = 1.0;

/// One light, or one rig, that images are compared under.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Case {
    /// Unique among the cases of a scene.
    pub(crate) name: String,
    /// The lights; none for the emission.
    pub(crate) rig: LightRig,
    /// Whether surfaces emit. They do so in a case of their own and in no other.
    pub(crate) emission: bool,
}

/// Kinds of lights that are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Family {
    /// A spot of 8 to 15 degrees.
    Narrow,
    /// A spot of 30 to 50 degrees.
    Wide,
    Omni,
    /// An omni 10 cm from a surface.
    Near,
    Sun,
}

impl Family {
    fn of(light: u32) -> Self {
        match (light, light % 5) {
            (3, _) => Self::Near,
            (_, 0) => Self::Narrow,
            (_, 2) => Self::Omni,
            (_, 4) => Self::Sun,
            _ => Self::Wide,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Narrow => "narrow",
            Self::Wide => "wide",
            Self::Omni => "omni",
            Self::Near => "near",
            Self::Sun => "sun",
        }
    }
}

/// The cases of `shot`: its lights, each alone, a dome, where there is `sky` to let it in, and what its surfaces emit.
///
/// # Errors
/// Where a draft cannot be traced.
pub(crate) fn made(
    shot: &mut Shot,
    (count, seed): (u32, u32),
    size: (usize, usize),
    sky: bool,
) -> Result<Vec<Case>> {
    shot.set_emission(false);
    let cases = made_in_the_dark(shot, (count, seed), size, sky);
    shot.set_emission(true);
    Ok(with_emission(shot, cases?))
}

/// The lights alone, of a scene that emits nothing.
fn made_in_the_dark(
    shot: &Shot,
    (count, seed): (u32, u32),
    size: (usize, usize),
    sky: bool,
) -> Result<Vec<Case>> {
    let Some(camera) = shot.scene.cameras.first() else {
        return Err(Error::Setting(format!("the scene {} has no camera; add one to it", shot.name)));
    };
    let space = FreeSpace::new(&shot.geometry, &shot.accel, camera, size);
    let lights = generate(&space, count, seed, |light| response(shot, light, size))?;
    let dome = dome()?;
    let reaches = sky && response(shot, &dome, size)? > 0.0;
    let cases = lights.into_iter().chain(reaches.then_some(dome)).map(|light| Case {
        name: light.name.clone(),
        rig: LightRig { lights: vec![light], ..LightRig::default() },
        emission: false,
    });
    Ok(cases.collect())
}

/// A sky with a sun in it, brighter towards one side.
fn dome() -> Result<Light> {
    const SIZE: (usize, usize) = (256, 128);
    let black = vec![Vec3::ZERO; SIZE.0 * SIZE.1];
    let plan = EnvironmentMap::new("sky", SIZE.0, SIZE.1, black)?;
    let sun = Vec3::new(0.4, 0.8, -0.3).normalize();
    let radiance = |texel: usize| {
        let direction = plan.direction((texel % SIZE.0) as f64 + 0.5, (texel / SIZE.0) as f64 + 0.5);
        let cos = direction.dot(sun);
        let sky = Vec3::new(0.3, 0.5, 0.9) * (0.3 + direction.y.max(0.0))
            + Vec3::splat(2.0 * cos.max(0.0).powi(16));
        if cos > SUN.to_radians().cos() { sky + Vec3::new(1.0, 0.9, 0.7) * 5000.0 } else { sky }
    };
    let map = EnvironmentMap::new("sky", SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(radiance).collect())?;
    let kind = LightKind::Dome { map: Some(Arc::new(map)), intensity: Vec3::ONE, rotation: 0.0 };
    Ok(Light { name: "dome".to_owned(), enabled: true, kind })
}

/// The rigs in a folder, or the one that `rigs` is, by the names of their files, and what surfaces of `shot` emit.
///
/// # Errors
/// Where there is no such folder, no rig in it, or one that cannot be used.
pub(crate) fn from_rigs(shot: &Shot, rigs: &Path) -> Result<Vec<Case>> {
    let paths = if rigs.is_file() { vec![rigs.to_owned()] } else { rigs_in(rigs)? };
    let read = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let rig = load_rig(path)?;
        if !rig.emitters.is_empty() {
            return Err(Error::file(
                path,
                "has emitters; what surfaces emit is a case of its own, so take them out",
            ));
        }
        check_materials(&rig, path, shot.scene.named_materials())?;
        Ok(Case { name, rig, emission: false })
    };
    let cases = paths.iter().map(read).collect::<Result<Vec<_>>>()?;
    Ok(with_emission(shot, cases))
}

fn rigs_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = folder.read_dir().map_err(|_| no_folder(folder, "--rigs"))?;
    let paths = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>();
    let mut paths = paths.map_err(|error| Error::io(folder, "read", error))?;
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "toml"));
    paths.sort();
    if paths.is_empty() {
        return Err(Error::file(folder, "holds no rig; put .toml files there or name another folder"));
    }
    Ok(paths)
}

fn with_emission(shot: &Shot, cases: impl IntoIterator<Item = Case>) -> Vec<Case> {
    let emission = Case { name: EMISSION.to_owned(), rig: LightRig::default(), emission: true };
    cases.into_iter().chain(shot.emits().then_some(emission)).collect()
}

/// Norm of the whole image under the light alone, by a draft of a few paths a pixel whose noise is taken out: a light
/// that shows only as fireflies is a weak one. Emission counts if it is on.
fn response(shot: &Shot, light: &Light, size: (usize, usize)) -> Result<f64> {
    const WIDTH: usize = 64;
    let settings = Settings {
        width: WIDTH,
        height: (WIDTH * size.1).div_ceil(size.0),
        spp: 32,
        bounces: Some(2),
        aa: 1,
        paths: Paths::Transfer,
        ..Settings::default()
    };
    let rig = LightRig { lights: vec![light.clone()], ..LightRig::default() };
    let reference = render(&shot.scene, &shot.geometry, &shot.accel, &rig, &settings, &())?;
    let [a, b] = reference.halves.each_ref().map(Layers::full);
    let square: f64 = a.pixels.iter().zip(&b.pixels).map(|(a, b)| a.as_dvec3().dot(b.as_dvec3())).sum();
    Ok(square.max(0.0).sqrt())
}

/// `count` lights. Those to which the view answers weakly, as `response` has it for a light of the flux that all
/// are made with, are replaced by others, up to [`ATTEMPTS`] times.
fn generate(
    space: &FreeSpace<'_>,
    count: u32,
    seed: u32,
    response: impl Fn(&Light) -> Result<f64>,
) -> Result<Vec<Light>> {
    let mut lights = Vec::new();
    let mut strengths = Vec::new();
    for number in 0..count {
        let light = draw(space, number, seed, 0);
        strengths.push(response(&light)?);
        lights.push(light);
    }
    for attempt in 1..=ATTEMPTS {
        let least = WEAK * median(&strengths);
        let weak: Vec<_> = (0..strengths.len()).filter(|&light| strengths[light] < least).collect();
        if weak.is_empty() {
            break;
        }
        for number in weak {
            let light = draw(space, number as u32, seed, attempt);
            let strength = response(&light)?;
            if strength > strengths[number] {
                (lights[number], strengths[number]) = (light, strength);
            }
        }
    }
    Ok(lights)
}

/// Light `number` at try `attempt`. A sun that no sky lets in and a lamp that finds no room at a wall become wide spots.
fn draw(space: &FreeSpace<'_>, number: u32, seed: u32, attempt: u32) -> Light {
    let mut draws = Draws::new(seed, number, attempt);
    let family = Family::of(number);
    let made = match family {
        Family::Narrow => Some(spot(space, &mut draws, (8.0, 15.0))),
        Family::Wide => None,
        Family::Omni => Some(omni(space.place(&mut draws))),
        Family::Near => space.place_near(&mut draws).map(omni),
        Family::Sun => space.sun(&mut draws).map(|direction| sun(direction, space.radius)),
    };
    let (family, kind) = match made {
        Some(kind) => (family, kind),
        None => (Family::Wide, spot(space, &mut draws, (30.0, 50.0))),
    };
    Light { name: format!("{}-{number:02}", family.name()), enabled: true, kind }
}

fn omni(position: Vec3) -> LightKind {
    LightKind::Omni { position, intensity: Vec3::splat(FLUX / (4.0 * PI)), radius: 0.0 }
}

fn sun(direction: Vec3, radius: f32) -> LightKind {
    LightKind::Distant { direction, irradiance: Vec3::splat(FLUX / (PI * radius * radius)), angle: 0.0 }
}

/// A spot whose outer angle lies between `angles`, degrees.
fn spot(space: &FreeSpace<'_>, draws: &mut Draws, angles: (f32, f32)) -> LightKind {
    let position = space.place(draws);
    let target = space.target(position, draws);
    let outer_angle = draws.between(angles.0, angles.1);
    let inner_angle = outer_angle * draws.between(0.4, 0.9);
    let (inner, outer) = (inner_angle.to_radians().cos(), outer_angle.to_radians().cos());
    // full within the inner cone; the square of a ramp between the two is a third of its width
    let solid_angle = TAU * ((1.0 - inner) + (inner - outer) / 3.0);
    let intensity = Vec3::splat(FLUX / solid_angle);
    LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::NEAR;
    use relume::trace::Ray;
    use relume_tests::scenes::{TestScene, box_room, emissive, empty_room};

    const SIZE: (usize, usize) = (64, 48);

    fn space(built: &TestScene) -> FreeSpace<'_> {
        FreeSpace::new(&built.geometry, &built.accel, &built.scene.cameras[0], SIZE)
    }

    fn position(light: &Light) -> Vec3 {
        match light.kind {
            LightKind::Omni { position, .. } | LightKind::Spot { position, .. } => position,
            LightKind::Distant { .. } | LightKind::Dome { .. } => {
                panic!("a closed room lets no sun in: {light:?}")
            }
        }
    }

    #[test]
    fn the_same_seed_makes_the_same_lights() {
        let lights = |seed| made(&mut Shot::new("room", box_room().scene), (10, seed), SIZE, true).unwrap();
        assert_eq!(lights(3), lights(3));
        assert_ne!(lights(3), lights(4));
        let names: Vec<_> = lights(3).iter().map(|case| case.name.clone()).collect();
        assert_eq!(names.len(), 10, "no sky is let in");
        assert_eq!(names[..5], ["narrow-00", "wide-01", "omni-02", "near-03", "wide-04"]);
        let scene = empty_room(emissive(Vec3::splat(0.5), Vec3::ONE)).scene;
        let mut shot = Shot::new("room", scene.clone());
        let shining = made(&mut shot, (2, 0), SIZE, true).unwrap();
        assert_eq!(shot.scene, scene, "it shines again");
        assert_eq!(shining[2], Case { name: EMISSION.into(), rig: LightRig::default(), emission: true });
    }

    /// Lights stand in the room, not in its walls or its box, and one of them 10 cm from a surface.
    #[test]
    fn lights_stand_free_and_one_is_near() {
        let built = box_room();
        let lights = generate(&space(&built), 16, 0, |_| Ok(1.0)).unwrap();
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        for light in &lights {
            let position = position(light);
            let inside = position.cmpgt(Vec3::ZERO).all() && position.cmplt(Vec3::new(4.0, 3.0, 5.0)).all();
            assert!(inside, "{light:?}");
            let free = axes
                .iter()
                .flat_map(|axis| [*axis, -*axis])
                .map(|axis| built.accel.closest(&Ray::new(position, axis)).t)
                .fold(f32::INFINITY, f32::min);
            let near = light.name.starts_with("near");
            assert_eq!((free - NEAR).abs() < 0.01 * NEAR, near, "{light:?} has {free} m");
        }
        assert_eq!(lights.iter().filter(|light| light.name.starts_with("near")).count(), 1);
    }

    #[test]
    fn weak_lights_are_replaced() {
        let built = box_room();
        let space = space(&built);
        let is_left = |light: &Light| position(light).x < 1.5;
        let from_the_right = |light: &Light| Ok(if is_left(light) { 0.04 } else { 1.0 });
        let lights = generate(&space, 16, 0, from_the_right).unwrap();
        assert!(!lights.iter().any(is_left), "{lights:?}");
        // what is not weak stays, on whichever side
        let nearly_as_strong = |light: &Light| Ok(if is_left(light) { 0.06 } else { 1.0 });
        assert!(generate(&space, 16, 0, nearly_as_strong).unwrap().iter().any(is_left));
    }

    /// The flux of a spot, summed over directions, is what it was made with.
    #[test]
    fn spots_have_the_flux_of_omnis() {
        let built = box_room();
        let LightKind::Spot { intensity, inner_angle, outer_angle, .. } =
            spot(&space(&built), &mut Draws::new(0, 0, 0), (30.0, 50.0))
        else {
            panic!("a spot");
        };
        let [inner, outer] = [inner_angle, outer_angle].map(|angle| angle.to_radians().cos());
        let steps = 100_000;
        let sum: f32 = (0..steps)
            .map(|step| 1.0 - (step as f32 + 0.5) / steps as f32)
            .map(|cos| ((cos - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2))
            .sum();
        let flux = intensity.x * TAU * sum / steps as f32;
        assert!((flux / FLUX - 1.0).abs() < 1e-3, "{flux}");
    }

    #[test]
    fn rigs_are_read_in_order_and_missing_ones_told() {
        let shot = Shot::new("room", box_room().scene);
        let folder = tempfile::tempdir().unwrap();
        let error = from_rigs(&shot, folder.path()).unwrap_err();
        assert!(error.to_string().contains("holds no rig"), "{error}");
        let light = Light { name: "a".into(), enabled: true, kind: omni(Vec3::ONE) };
        let rig = LightRig { lights: vec![light], ..LightRig::default() };
        for name in ["b.toml", "a.toml"] {
            relume_io::save_rig(&rig, folder.path().join(name)).unwrap();
        }
        let cases = from_rigs(&shot, folder.path()).unwrap();
        assert_eq!(cases.iter().map(|case| case.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(cases[0].rig, rig);
        assert_eq!(from_rigs(&shot, &folder.path().join("b.toml")).unwrap(), cases[1..]);
        assert!(from_rigs(&shot, &folder.path().join("none")).unwrap_err().to_string().contains("--rigs"));
    }
}
