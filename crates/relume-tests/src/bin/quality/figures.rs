//! The errors of relit images.

use relume::image::{Image, Layers};
use relume::relight::RelightSettings;
use relume::{Relighter, Result};
use relume_tests::truth::{Truth, unbiased_relative_l2, unbiased_relative_l2_where, uncertainty};
use serde::Serialize;

use crate::arguments::Bounces;
use crate::lights::Case;
use crate::summary::Spread;

/// Relative L2 over linear RGB against the truth, whose noise is taken out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Errors {
    /// Of the indirect layer, over all pixels.
    pub(crate) indirect: f64,
    /// The same without pixels on a geometric edge; `None` where all are.
    pub(crate) indirect_no_edges: Option<f64>,
    /// How much larger `indirect` may be, by one standard error of its square.
    pub(crate) indirect_uncertainty: f64,
    /// Of direct and indirect light together.
    pub(crate) whole: f64,
    /// The same without pixels on a geometric edge.
    pub(crate) whole_no_edges: Option<f64>,
    /// The reference's own noise, which `indirect` is free of.
    pub(crate) indirect_noise: f64,
    /// The same of the whole image.
    pub(crate) whole_noise: f64,
}

/// One light's errors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LightErrors {
    /// The case's name.
    pub(crate) light: String,
    /// Its figures.
    #[serde(flatten)]
    pub(crate) errors: Errors,
}

/// All lights against one truth after one number of bounces.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Column {
    /// Which paths the truth has.
    pub(crate) paths: &'static str,
    /// Indirect bounces; `null` is unlimited.
    pub(crate) bounces: Bounces,
    /// Over the lights.
    pub(crate) summary: Summary,
    /// Light by light.
    pub(crate) lights: Vec<LightErrors>,
}

/// The figures of [`Errors`] over the lights.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Summary {
    pub(crate) indirect: Option<Spread>,
    pub(crate) indirect_no_edges: Option<Spread>,
    pub(crate) indirect_uncertainty: Option<Spread>,
    pub(crate) whole: Option<Spread>,
    pub(crate) whole_no_edges: Option<Spread>,
    pub(crate) indirect_noise: Option<Spread>,
    pub(crate) whole_noise: Option<Spread>,
}

impl Summary {
    /// Of all lights.
    pub(crate) fn of(lights: &[LightErrors]) -> Self {
        let over = |figure: fn(&Errors) -> Option<f64>| {
            Spread::of(lights.iter().filter_map(|light| Some((light.light.as_str(), figure(&light.errors)?))))
        };
        Self {
            indirect: over(|errors| Some(errors.indirect)),
            indirect_no_edges: over(|errors| errors.indirect_no_edges),
            indirect_uncertainty: over(|errors| Some(errors.indirect_uncertainty)),
            whole: over(|errors| Some(errors.whole)),
            whole_no_edges: over(|errors| errors.whole_no_edges),
            indirect_noise: over(|errors| Some(errors.indirect_noise)),
            whole_noise: over(|errors| Some(errors.whole_noise)),
        }
    }
}

impl Errors {
    /// Of a relit frame.
    pub(crate) fn of(relit: &Layers, direct: &Truth, indirect: &Truth) -> Self {
        let truth = direct.plus(indirect);
        let full = relit.full();
        let edges = &relit.edges;
        let without = |image: &Image, truth: &Truth| {
            edges.contains(&false).then(|| unbiased_relative_l2_where(image, truth, |pixel| !edges[pixel]))
        };
        Self {
            indirect: unbiased_relative_l2(&relit.indirect, indirect),
            indirect_no_edges: without(&relit.indirect, indirect),
            indirect_uncertainty: uncertainty(&relit.indirect, indirect),
            whole: unbiased_relative_l2(&full, &truth),
            whole_no_edges: without(&full, &truth),
            indirect_noise: indirect.noise(),
            whole_noise: truth.noise(),
        }
    }
}

/// The shot under one case alone: without what surfaces emit, unless that is the case.
///
/// # Errors
/// As [`Relighter::relight`].
pub(crate) fn relight(relighter: &mut Relighter, case: &Case, bounces: Bounces) -> Result<Layers> {
    let settings =
        RelightSettings { bounces: bounces.0, per_light: !case.emission, ..RelightSettings::default() };
    let mut layers = relighter.relight(&case.rig, &settings)?;
    if !case.emission {
        // the light of emissive surfaces comes after all others
        let lit = |light: &&relume::Light| light.enabled && light.color() != relume::glam::Vec3::ZERO;
        layers.per_light.truncate(case.rig.lights.iter().filter(lit).count());
        let black = Image::new(layers.direct.width, layers.direct.height);
        (layers.direct, layers.indirect) = (black.clone(), black);
        for light in &layers.per_light {
            add(&mut layers.direct, &light.direct);
            add(&mut layers.indirect, &light.indirect);
        }
    }
    Ok(layers)
}

fn add(sum: &mut Image, image: &Image) {
    sum.pixels.iter_mut().zip(&image.pixels).for_each(|(sum, pixel)| *sum += *pixel);
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::LightRig;
    use relume::glam::Vec3;
    use relume_tests::prepared::{flat, mean, prepare, tiny};
    use relume_tests::scenes::{box_room, emissive, empty_room, omni, rig};

    fn case(emission: bool) -> Case {
        let lamp = rig([omni(Vec3::new(1.0, 1.0, 1.0), Vec3::splat(5.0), 0.0)]);
        let rig = if emission { LightRig::default() } else { lamp };
        Case { name: "lamp".into(), rig, emission }
    }

    #[test]
    fn a_case_is_one_light_without_what_surfaces_emit() {
        let scene = |light| empty_room(emissive(Vec3::splat(0.5), Vec3::splat(light)));
        let relit = |light, case: &Case| {
            let mut relighter = Relighter::new(prepare(&scene(light), tiny()));
            mean(&relight(&mut relighter, case, Bounces(Some(1))).unwrap().full())
        };
        let (lamp, emission) = (relit(1.0, &case(false)), relit(1.0, &case(true)));
        assert!((lamp / relit(0.0, &case(false)) - 1.0).abs().max_element() < 0.05, "{lamp}");
        assert!(emission.x > 1.0 && relit(0.0, &case(true)).x == 0.0, "{emission}");
    }

    #[test]
    fn errors_are_zero_of_the_truth_and_not_of_another_image() {
        let mut relighter = Relighter::new(prepare(&box_room(), tiny()));
        let layers = relight(&mut relighter, &case(false), Bounces(None)).unwrap();
        let exact = |image: &Image| Truth { halves: [image.clone(), image.clone()] };
        let errors = |relit: &Layers| Errors::of(relit, &exact(&layers.direct), &exact(&layers.indirect));
        let right = errors(&layers);
        assert_eq!((right.indirect, right.whole, right.indirect_no_edges), (0.0, 0.0, Some(0.0)));
        let mut wrong = layers.clone();
        wrong.indirect.pixels.iter_mut().for_each(|pixel| *pixel *= 1.1);
        let told = errors(&wrong);
        assert!((told.indirect - 0.1).abs() < 1e-4 && told.whole < told.indirect && told.whole > 0.0);
        // an error on edges alone
        let mut wrong = layers.clone();
        let edge = wrong.edges.iter().position(|edge| *edge).unwrap();
        wrong.indirect.pixels[edge] = flat(&wrong.indirect, Vec3::splat(9.0)).pixels[edge];
        let told = errors(&wrong);
        assert!(told.indirect > 0.1 && told.indirect_no_edges == Some(0.0), "{told:?}");
    }
}
