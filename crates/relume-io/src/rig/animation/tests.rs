use std::sync::LazyLock;

use relume::glam::Vec3;
use relume::{Light, LightKind};

use super::*;
use crate::rig::{load_rig, parse_rig};

/// Lights, an emitter and a material at rest; the position of `key` is left to what moves it.
pub(super) const AT_REST: &str = r#"exposure = 0.5
[[light]]
name = "key"
type = "spot"
target = [0.0, 0.0, 0.0]
intensity = [60.0, 55.0, 50.0]
inner_angle = 20
outer_angle = 30.0
[[light]]
name = "fill"
type = "omni"
position = [0, 1, 0]
intensity = [1, 2, 3]
[[emitter]]
material = "lamp"
scale = [1, 1, 1]
[[material]]
name = "wall"
base_color = [0.5, 0.5, 0.5]
"#;

const TRACKS: &str = r#"[[animate]]
light = "key"
field = "position"
frames = [1, 5, 9]
values = [[0.0, 4.0, 0.1], [2.0, 4.0, 0.2], [2.0, 0.5, 0.3]]
[[animate]]
light = "fill"
field = "enabled"
frames = [1, 3]
values = [false, true]
[[animate]]
field = "exposure"
interpolation = "linear"
frames = [-2, 2]
values = [0, 1.0]
[[animate]]
emitter = "lamp"
field = "scale"
interpolation = "step"
frames = [1, 8]
values = [[0, 0, 0], [0.25, 0.5, 1]]
[[animate]]
material = "wall"
field = "base_color"
frames = [10]
values = [[0.1, 0.2, 0.3]]
"#;

static RIG: LazyLock<String> = LazyLock::new(|| format!("{AT_REST}{TRACKS}"));

fn animated(text: &str) -> AnimatedRig {
    AnimatedRig::parse(text, "rig.toml").unwrap()
}

fn position(light: &Light) -> Vec3 {
    match light.kind {
        LightKind::Spot { position, .. } | LightKind::Omni { position, .. } => position,
        _ => panic!("{light:?}"),
    }
}

#[test]
fn every_kind_of_field_moves() {
    let animated = animated(&RIG);
    assert_eq!(animated.frames(), Some(-2..=10));
    let at = |frame: f64| animated.rig(frame).unwrap();
    // bit for bit what is written at the keys, and there outside of them
    for (frame, place) in [(-50.0, [0.0, 4.0, 0.1]), (1.0, [0.0, 4.0, 0.1]), (5.0, [2.0, 4.0, 0.2])] {
        assert_eq!(position(&at(frame).lights[0]), Vec3::from(place), "{frame}");
    }
    assert_eq!(position(&at(1000.0).lights[0]), Vec3::new(2.0, 0.5, 0.3));
    let between = position(&at(3.0).lights[0]);
    assert!(between.x > 0.9 && between.x < 1.1 && between.y == 4.0, "{between}");
    assert_eq!([-1.0, 2.9, 3.0, 90.0].map(|frame| at(frame).lights[1].enabled), [false, false, true, true]);
    assert_eq!([-2.0, -1.0, 0.0, 1.5, 2.0].map(|frame| at(frame).exposure), [0.0, 0.25, 0.5, 0.875, 1.0]);
    assert_eq!(at(7.99).emitters[0].scale, Vec3::ZERO);
    assert_eq!(at(8.0).emitters[0].scale, Vec3::new(0.25, 0.5, 1.0));
    assert_eq!(at(3.0).materials[0].base_color, Vec3::new(0.1, 0.2, 0.3));
    // what is not animated stays, and nothing is added
    let plain = parse_rig(RIG.split("[[animate]]").next().unwrap(), "rig.toml");
    assert!(plain.unwrap_err().to_string().contains("has no `position`"), "animated alone, yet needed");
    assert_eq!(at(1.0).lights[0].color(), Vec3::new(60.0, 55.0, 50.0));
    assert!(animated.rig(f64::NAN).unwrap_err().is_bad_input());
}

#[test]
fn other_commands_read_the_first_keyed_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    std::fs::write(&path, &**RIG).unwrap();
    let animated = AnimatedRig::load(&path).unwrap();
    assert_eq!(load_rig(&path).unwrap(), animated.rig(-2.0).unwrap());
    assert_ne!(load_rig(&path).unwrap(), animated.rig(0.0).unwrap());
    assert_eq!(AnimatedRig::parse("exposure = 1", "rig.toml").unwrap().frames(), None);
}

#[test]
fn maps_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["day.exr", "night.exr"] {
        let mut image = relume::image::Image::new(4, 2);
        image.pixels.fill(Vec3::splat(0.5));
        crate::write_exr_image(folder.path().join(name), &image, &crate::ExrMeta::default()).unwrap();
    }
    let text = r#"
[[light]]
name = "sky"
type = "dome"
[[animate]]
light = "sky"
field = "map"
frames = [1, 2]
values = ["day.exr", "night.exr"]
"#;
    let path = folder.path().join("rig.toml");
    let animated = AnimatedRig::parse(text, &path).unwrap();
    let mut files: Vec<PathBuf> = animated.maps().collect();
    files.sort();
    assert_eq!(files, ["day.exr", "night.exr"].map(|name| folder.path().join(name)));
    // from here on they are not needed
    files.iter().for_each(|file| std::fs::remove_file(file).unwrap());
    let name = |frame: f64| match &animated.rig(frame).unwrap().lights[0].kind {
        LightKind::Dome { map: Some(map), .. } => map.name().to_owned(),
        other => panic!("{other:?}"),
    };
    assert_eq!([0.0, 1.9, 2.0].map(name), ["day.exr", "day.exr", "night.exr"]);
    let error = AnimatedRig::parse(text, &path).unwrap_err().to_string();
    assert!(error.contains("line 9: at frame 1: `map`: "), "{error}");
}

/// Alike but for a path between keys on which a direction vanishes.
#[test]
fn what_fails_between_keys_is_told_with_its_frame() {
    let rig = |end: &str| {
        format!(
            "[[light]]\nname = \"sun\"\ntype = \"distant\"\nirradiance = [1, 1, 1]\n[[animate]]\nlight = \"sun\"\n\
             field = \"direction\"\ninterpolation = \"linear\"\nframes = [0, 4]\nvalues = [[1, 0, 0],\n{end}]\n"
        )
    };
    let passes = animated(&rig("[-1, 0, 0]"));
    assert!(passes.rig(1.0).is_ok());
    let error = passes.rig(2.0).unwrap_err();
    assert!(error.is_bad_input());
    assert!(
        error.to_string().starts_with("rig.toml: line 10: at frame 2: `direction` has no length"),
        "{error}"
    );
    assert!(animated(&rig("[-1, 1, 0]")).rig(2.0).is_ok());
}

/// A rig with one change, and the message it must end in.
#[test]
fn problems_are_told_with_their_line() {
    let changed = |from: &str, to: &str| {
        assert!(RIG.contains(from), "{from}");
        RIG.replacen(from, to, 1)
    };
    let cases: &[(String, &str)] = &[
        (
            changed("field = \"position\"", "feild = \"position\""),
            "line 22: unknown key `feild`; did you mean `field`?",
        ),
        (
            changed("field = \"position\"", "curve = 3"),
            "line 22: unknown key `curve`; an animate has light, emitter or material, field, interpolation, frames, values",
        ),
        ("[[animat]]".to_owned(), "line 1: unknown key `animat`; did you mean `animate`?"),
        (
            "animate = 3".to_owned(),
            "line 1: `animate` must be a list of tables, not one number; begin each animate with [[animate]]",
        ),
        (
            "animate = [3]".to_owned(),
            "line 1: an animate must be a table, not one number; begin each animate with [[animate]]",
        ),
        (
            changed("light = \"key\"", "light = \"kye\""),
            "line 21: no [[light]] has name = \"kye\"; did you mean \"key\"?",
        ),
        (
            changed("light = \"key\"", "light = \"sun\""),
            "line 21: no [[light]] has name = \"sun\"; there is \"fill\", \"key\"",
        ),
        (
            "[[animate]]\nmaterial = \"door\"\nfield = \"base_color\"\nframes = [1]\nvalues = [[1, 1, 1]]\n"
                .to_owned(),
            "line 2: no [[material]] has name = \"door\"; add one, begun with [[material]]",
        ),
        (
            changed("light = \"key\"", "light = 3"),
            "line 21: `light` must be a name in quotes, not one number",
        ),
        (
            changed("light = \"key\"", "light = \"key\"\nemitter = \"lamp\""),
            "line 22: an animate has `light` or `emitter`, not both; write another [[animate]]",
        ),
        (
            changed("light = \"key\"\nfield", "field"),
            "line 21: unknown field \"position\"; the rig itself has exposure; for a field of a light add light = \"key\"",
        ),
        (
            changed("\"position\"", "\"positon\""),
            "line 22: unknown field \"positon\"; did you mean \"position\"?",
        ),
        (
            changed("\"position\"", "\"rotation\""),
            "line 22: unknown field \"rotation\"; this light has enabled, position, target, intensity, inner_angle, \
             outer_angle, radius",
        ),
        (
            changed("\"position\"", "\"type\""),
            "line 22: `type` cannot be animated; this light has enabled, position, target, intensity, inner_angle, \
             outer_angle, radius",
        ),
        (
            changed("\"scale\"", "\"material\""),
            "line 37: `material` cannot be animated; this emitter has scale",
        ),
        (
            changed("\"position\"", "7"),
            "line 22: `field` must be the name of a field in quotes, not one number",
        ),
        (
            changed("field = \"position\"\n", ""),
            "line 20: this animate has no `field`; add field = \"intensity\"",
        ),
        (
            changed("frames = [1, 5, 9]\n", ""),
            "line 20: this animate has no `frames`; add frames = [1, 24, 48]",
        ),
        (
            changed("values = [false, true]\n", ""),
            "line 25: this animate has no `values`; add values = [0.0, 1.0, 0.5], one for each frame",
        ),
        (
            changed("[1, 5, 9]", "5"),
            "line 23: `frames` must be a list of whole numbers, such as [1, 24, 48], not one number",
        ),
        (
            changed("[1, 5, 9]", "[]"),
            "line 23: `frames` is empty; write a list of whole numbers, such as [1, 24, 48]",
        ),
        (
            changed("[1, 5, 9]", "[1, 5.5, 9]"),
            "line 23: `frames` must be whole numbers from -1000000 to 1000000, but has 5.5",
        ),
        (
            changed("[1, 5, 9]", "[1, 5, 1e7]"),
            "line 23: `frames` must be whole numbers from -1000000 to 1000000, but has 10000000",
        ),
        (changed("[1, 5, 9]", "[1,\n5, 5]"), "line 24: `frames` must ascend, but 5 comes after 5"),
        (
            changed("[1, 5, 9]", "[1, 5]"),
            "line 24: `frames` has 2 and `values` 3; give one value for each frame",
        ),
        (
            changed("values = [false, true]", "values = true"),
            "line 29: `values` must be a list with one value for each frame, not true",
        ),
        (
            changed("[false, true]", "[false,\n1]"),
            "line 30: values must be alike, but one number comes after false",
        ),
        (
            changed("[2.0, 4.0, 0.2]", "[2.0, 4.0]"),
            "line 24: values must be alike, but a list of 2 comes after a list of 3",
        ),
        (
            changed("[false, true]", "[{}, true]"),
            "line 29: a value must be a number, a list of numbers, text, true or false, not one table",
        ),
        (
            changed("frames = [1, 3]", "frames = [1, 3]\ninterpolation = \"linear\""),
            "line 29: text, true and false can only step; write interpolation = \"step\" or leave it out",
        ),
        (
            changed("\"linear\"", "\"liner\""),
            "line 32: unknown interpolation \"liner\"; did you mean \"linear\"?",
        ),
        (
            changed("\"linear\"", "\"bezier\""),
            "line 32: unknown interpolation \"bezier\"; use \"smooth\", \"linear\" or \"step\"",
        ),
        (
            changed("\"linear\"", "1"),
            "line 32: `interpolation` must be \"smooth\", \"linear\" or \"step\", not one number",
        ),
        (
            format!("{}[[animate]]\nfield = \"exposure\"\nframes = [1]\nvalues = [1]\n", *RIG),
            "line 47: an earlier [[animate]] has this `exposure` too; keep one of them",
        ),
        // of the values themselves the ordinary reader says what is wrong, at any key
        (
            changed("[false, true]", "[0, 1]"),
            "line 29: at frame -2: `enabled` must be true or false, not one number",
        ),
        (
            changed("[0.25, 0.5, 1]", "[0.25, -0.5, 1]"),
            "line 40: at frame 8: `scale` must not be negative, but has -0.5; use 0 or more",
        ),
        (
            changed("[0.1, 0.2, 0.3]", "[0.1, 0.2]"),
            "line 45: at frame -2: `base_color` must be three numbers, such as [0.7, 0.1, 0.1], not a list of 2",
        ),
        (
            changed("[2.0, 0.5, 0.3]", "\n[2.0, inf, 0.3]"),
            "line 25: at frame 9: `position` must be three finite numbers; inf is none",
        ),
        (
            changed("[2.0, 4.0, 0.2]", "\n[2.0, nan, 0.2]"),
            "line 25: at frame 5: `position` must be three finite numbers; NaN is none",
        ),
        (
            changed("[0.0, 4.0, 0.1]", "\n[0.0, -inf, 0.1]"),
            "line 25: at frame -2: `position` must be three finite numbers; -inf is none",
        ),
        // also where another field of the light has a key in between
        (
            changed("[1, 3]", "[1, 8]").replace("[1, 2, 3]", "[1, 2, 3]\nradius = 1").replace(
                "field = \"exposure\"",
                "light = \"fill\"\nfield = \"radius\"\nframes = [1, 9]\nvalues = [1,\n-1]\n[[animate]]\nfield = \"exposure\"",
            ),
            "line 36: at frame 9: `radius` must be 0 or more, not -1",
        ),
        (
            changed("[2.0, 0.5, 0.3]", "[0, 0, 0]"),
            "line 5: at frame 9: `target` must differ from `position`: between them is the way the spot shines",
        ),
        // and of the rest of the rig, as without keys
        (
            changed("inner_angle", "innerangle"),
            "line 7: unknown key `innerangle`; did you mean `inner_angle`?",
        ),
        (changed("name = \"fill\"\n", ""), "line 9: this omni light has no `name`; add name = \"key\""),
        (changed("\"omni\"", "\"omi\""), "line 11: unknown type \"omi\"; did you mean \"omni\"?"),
    ];
    for (text, expected) in cases {
        let error = AnimatedRig::parse(text.as_str(), "rig.toml").expect_err(text);
        assert!(error.is_bad_input());
        assert_eq!(error.to_string(), format!("rig.toml: {expected}"));
        assert_eq!(parse_rig(text, "rig.toml").unwrap_err().to_string(), error.to_string());
    }
}

/// A rig as from a program that bakes every frame: 1000 keys a light, each in a frame of its own.
fn baked(lights: i32) -> String {
    let mut text = String::new();
    for light in 0..lights {
        let frames = (0..1000).map(|frame| (1000 * light + frame).to_string()).collect::<Vec<_>>().join(", ");
        let values = (0..1000).map(|frame| format!("[{frame}, 1, 2]")).collect::<Vec<_>>().join(", ");
        text.push_str(&format!(
            "[[light]]\nname = \"{light}\"\ntype = \"omni\"\nintensity = [1, 1, 1]\n\
             [[animate]]\nlight = \"{light}\"\nfield = \"position\"\nframes = [{frames}]\nvalues = [{values}]\n"
        ));
    }
    text
}

/// The time to read a rig grows with what is in it, and not with its square.
#[test]
fn many_keys_are_read_quickly() {
    let [few, many] = [20, 100].map(|lights| {
        let text = baked(lights);
        // the best of some, which others on the machine disturb least
        let seconds = (0..4).map(|_| {
            let began = std::time::Instant::now();
            let animated = animated(&text);
            let seconds = began.elapsed().as_secs_f64();
            assert_eq!(animated.frames(), Some(0..=1000 * lights - 1));
            assert_eq!(position(&animated.rig(10_590.5).unwrap().lights[10]), Vec3::new(590.5, 1.0, 2.0));
            seconds
        });
        seconds.fold(f64::INFINITY, f64::min)
    });
    println!("20 lights in {few:.3} s, 100 in {many:.3} s");
    assert!(many < 15.0 * few, "five times the keys take {:.1} times the time", many / few);
}
