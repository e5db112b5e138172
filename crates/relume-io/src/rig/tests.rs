use relume::glam::Vec3;
use relume::{Emitter, Light, LightKind, MaterialEdit};

use super::*;

fn parse(text: &str) -> Result<LightRig> {
    parse_rig(text, "rig.toml")
}

const SPOT: &str = r#"exposure = -1.5
[[light]]
name = "key"
type = "spot"
position = [1.0, 4, 0.5]
target = [0.0, 0.0, 0.0]
intensity = [60.0, 55.0, 50.0]
inner_angle = 20
outer_angle = 30.0
"#;
const OMNI: &str = r#"[[light]]
name = "fill"
type = "omni"
position = [0, 1, 0]
intensity = [1, 2, 3]
radius = 0.25
enabled = false
"#;
const DISTANT: &str = r#"[[light]]
name = "sun"
type = "distant"
direction = [0, -1, 0]
irradiance = [3, 3, 3]
"#;

fn every_kind() -> LightRig {
    let spot = LightKind::Spot {
        position: Vec3::new(1.0, 4.0, 0.5),
        target: Vec3::ZERO,
        intensity: Vec3::new(60.0, 55.0, 50.0),
        inner_angle: 20.0,
        outer_angle: 30.0,
        radius: 0.0,
    };
    let omni = LightKind::Omni { position: Vec3::Y, intensity: Vec3::new(1.0, 2.0, 3.0), radius: 0.25 };
    let sun = LightKind::Distant { direction: Vec3::NEG_Y, irradiance: Vec3::splat(3.0), angle: 0.0 };
    let light = |name: &str, enabled, kind| Light { name: name.to_owned(), enabled, kind };
    LightRig {
        exposure: -1.5,
        lights: vec![light("key", true, spot), light("fill", false, omni), light("sun", true, sun)],
        emitters: Vec::new(),
        materials: Vec::new(),
    }
}

#[test]
fn reads_every_kind_with_its_defaults() {
    assert_eq!(parse(&format!("{SPOT}{OMNI}{DISTANT}")).unwrap(), every_kind());
    assert_eq!(parse("").unwrap(), LightRig::default());
    let windows = format!("{SPOT}{OMNI}{DISTANT}").replace('\n', "\r\n");
    assert_eq!(parse(&windows).unwrap(), every_kind());
}

#[test]
fn writes_what_it_reads_bit_for_bit() {
    let mut rig = every_kind();
    rig.exposure = 0.1;
    let awkward = Vec3::new(f32::MIN_POSITIVE / 3.0, 1.0 / 3.0, f32::MAX);
    rig.lights[0] = rig.lights[0].with_color(awkward);
    rig.lights[1] = rig.lights[1].with_color(Vec3::new(16_777_217.0, 1e-7, 8.589_973e9));
    rig.lights[2].name = "so \"it\" is\n\\ 日本 ' ''' ".to_owned();
    assert_eq!(parse(&rig_to_toml(&rig)).unwrap(), rig);

    rig.emitters.push(Emitter { material: "neon \"red\"".to_owned(), scale: Vec3::new(0.1, 0.0, 1.0 / 3.0) });
    assert_eq!(parse(&rig_to_toml(&rig)).unwrap(), rig);
    let base_color = Vec3::new(0.1, 1.0, 1.0 / 3.0);
    rig.materials.push(MaterialEdit { name: "wall \"2\"".to_owned(), base_color });
    assert_eq!(parse(&rig_to_toml(&rig)).unwrap(), rig);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    save_rig(&rig, &path).unwrap();
    assert_eq!(load_rig(&path).unwrap(), rig);
    rig.lights[0] = rig.lights[0].with_color(Vec3::ONE);
    assert_ne!(load_rig(&path).unwrap(), rig);
}

#[test]
fn every_f32_survives_the_text() {
    // A step through all exponents and many mantissas.
    for bits in (0..f32::INFINITY.to_bits()).step_by(1_000_003) {
        let rig = LightRig { exposure: f32::from_bits(bits), ..LightRig::default() };
        assert_eq!(parse(&rig_to_toml(&rig)).unwrap().exposure.to_bits(), bits);
    }
}

const EMITTER: &str = "
[[emitter]]
material = \"lamp\"
scale = [0.5, 0.25, 1]
";

#[test]
fn emitters_are_read_and_their_problems_told_with_their_line() {
    let lamp = Emitter { material: "lamp".to_owned(), scale: Vec3::new(0.5, 0.25, 1.0) };
    assert_eq!(parse(&format!("{SPOT}{EMITTER}")).unwrap().emitters, [lamp]);
    let cases = [
        (EMITTER.replace("scale", "scael"), "line 4: unknown key `scael`; did you mean `scale`?"),
        (
            EMITTER.replace("material = \"lamp\"", ""),
            "line 2: this emitter has no `material`; add material = \"lamp\"",
        ),
        (EMITTER.replace("\"lamp\"", "3"), "line 3: `material` must be text in quotes, not one number"),
        (
            EMITTER.replace("\"lamp\"", "\"\""),
            "line 3: `material` must not be empty; name an emissive material of the scene",
        ),
        (
            EMITTER.replace("[0.5, 0.25, 1]", "0.5"),
            "line 4: `scale` must be three numbers, such as [0.5, 0.5, 0.5], not one number",
        ),
        (
            EMITTER.replace("0.25", "-0.25"),
            "line 4: `scale` must not be negative, but has -0.25; use 0 or more",
        ),
        (EMITTER.replace("0.25", "nan"), "line 4: `scale` must be three finite numbers; NaN is none"),
        (
            format!("{EMITTER}{EMITTER}"),
            "line 7: an earlier emitter names the material `lamp` too; keep one of them",
        ),
        (
            EMITTER.replace("[[emitter]]", "[[emiter]]"),
            "line 2: unknown key `emiter`; did you mean `emitter`?",
        ),
    ];
    for (text, message) in cases {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains(message), "{error}\ninstead of\n{message}");
    }
    let rig = LightRig {
        emitters: vec![Emitter { material: "lamp".to_owned(), scale: Vec3::NEG_X }],
        ..LightRig::default()
    };
    let folder = tempfile::tempdir().unwrap();
    assert!(save_rig(&rig, folder.path().join("rig.toml")).is_err());
}

const DOME: &str = r#"[[light]]
name = "sky"
type = "dome"
map = "maps/sky.exr"
intensity = [2, 1, 0]
rotation = -30
"#;

#[test]
fn domes_are_read_with_their_maps_and_written_again() {
    let folder = tempfile::tempdir().unwrap();
    let maps = folder.path().join("maps");
    std::fs::create_dir(&maps).unwrap();
    let mut image = relume::image::Image::new(4, 2);
    image.pixels.fill(Vec3::splat(0.5));
    crate::write_exr_image(maps.join("sky.exr"), &image, &crate::ExrMeta::default()).unwrap();
    let path = folder.path().join("rig.toml");
    let read = |text: &str| parse_rig(text, &path);
    let rig = read(DOME).unwrap();
    let LightKind::Dome { map: Some(map), intensity, rotation } = &rig.lights[0].kind else {
        panic!("{rig:?}")
    };
    assert_eq!((map.size(), map.name(), *rotation), ((4, 2), "maps/sky.exr", -30.0));
    assert_eq!((*intensity, map.radiance(Vec3::Y)), (Vec3::new(2.0, 1.0, 0.0), Vec3::splat(0.5)));
    save_rig(&rig, &path).unwrap();
    assert_eq!(load_rig(&path).unwrap(), rig);
    // twice the same map is read once
    let two = read(&format!("{DOME}{}", DOME.replace("\"sky\"", "\"more\""))).unwrap();
    let maps = two.lights.iter().map(|light| match &light.kind {
        LightKind::Dome { map: Some(map), .. } => std::sync::Arc::as_ptr(map),
        other => panic!("{other:?}"),
    });
    assert_eq!(maps.collect::<std::collections::HashSet<_>>().len(), 1);
    // all but the type may be left out
    let plain = read("[[light]]\nname = \"sky\"\ntype = \"dome\"\n").unwrap();
    assert_eq!(plain.lights[0].kind, LightKind::Dome { map: None, intensity: Vec3::ONE, rotation: 0.0 });
    let told = |from: &str, to: &str| read(&DOME.replace(from, to)).unwrap_err().to_string();
    let missing = told("sky.exr", "none.exr");
    assert!(missing.contains("line 4: `map`: ") && missing.contains("none.exr"), "{missing}");
    assert!(told("\"maps/sky.exr\"", "3").contains("line 4: `map` must be the name of an .hdr or .exr file"));
    assert!(told("-30", "inf").contains("line 6: `rotation` must be a finite number of degrees"));
    assert!(told("rotation", "angle").contains("line 6: `angle` is a key of distant lights"));
    assert!(told("dome", "hdri").contains("did you mean \"dome\"?"));
}

const MATERIAL: &str = "
[[material]]
name = \"wall\"
base_color = [0.7, 0, 1]
";

#[test]
fn materials_are_read_and_their_problems_told_with_their_line() {
    let wall = MaterialEdit { name: "wall".to_owned(), base_color: Vec3::new(0.7, 0.0, 1.0) };
    let rig = parse(&format!("{SPOT}{MATERIAL}{EMITTER}")).unwrap();
    assert_eq!((rig.materials, rig.emitters.len()), (vec![wall], 1));
    let cases = [
        (
            MATERIAL.replace("base_color", "basecolor"),
            "line 4: unknown key `basecolor`; did you mean `base_color`?",
        ),
        (
            format!("{MATERIAL}metallic = 1\n"),
            "line 5: unknown key `metallic`; a material has name, base_color",
        ),
        (
            MATERIAL.replace("base_color = [0.7, 0, 1]", ""),
            "line 2: material `wall` has no `base_color`; add base_color = [0.7, 0.1, 0.1]",
        ),
        (
            MATERIAL.replace("\"wall\"", "\"\""),
            "line 3: `name` must not be empty; name a material of the scene",
        ),
        (
            MATERIAL.replace("[0.7, 0, 1]", "\"red\""),
            "line 4: `base_color` must be three numbers, such as [0.7, 0.1, 0.1], not text",
        ),
        (MATERIAL.replace("0.7", "-0.7"), "line 4: `base_color` must be within 0 to 1, but has -0.7"),
        (MATERIAL.replace("0.7", "1.01"), "line 4: `base_color` must be within 0 to 1, but has 1.01"),
        (MATERIAL.replace("0.7", "inf"), "line 4: `base_color` must be three finite numbers; inf is none"),
        (
            format!("{MATERIAL}{MATERIAL}"),
            "line 7: an earlier [[material]] is named `wall` too; keep one of them",
        ),
        (
            MATERIAL.replace("[[material]]", "[[materials]]"),
            "line 2: unknown key `materials`; did you mean `material`?",
        ),
        ("material = [1]".to_owned(), "line 1: a material must be a table, not one number"),
    ];
    for (text, message) in cases {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains(message), "{error}\ninstead of\n{message}");
    }
    let rig = |base_color| LightRig {
        materials: vec![MaterialEdit { name: "wall".to_owned(), base_color }],
        ..LightRig::default()
    };
    let folder = tempfile::tempdir().unwrap();
    assert!(save_rig(&rig(Vec3::X), folder.path().join("rig.toml")).is_ok());
    assert!(save_rig(&rig(Vec3::X * 2.0), folder.path().join("rig.toml")).is_err());
}

/// A rig with one change, and the message it must end in.
#[test]
fn problems_are_told_with_their_line() {
    let spot = |from: &str, to: &str| {
        assert!(SPOT.contains(from), "{from}");
        SPOT.replace(from, to)
    };
    let distant = |from: &str, to: &str| DISTANT.replace(from, to);
    let cases: &[(String, &str)] = &[
        (spot("intensity", "intesity"), "line 7: unknown key `intesity`; did you mean `intensity`?"),
        (spot("inner_angle", "innerangle"), "line 8: unknown key `innerangle`; did you mean `inner_angle`?"),
        (
            spot("outer_angle", "Outer-Angle"),
            "line 9: unknown key `Outer-Angle`; did you mean `outer_angle`?",
        ),
        (spot("name", "nmae"), "line 3: unknown key `nmae`; did you mean `name`?"),
        (spot("type", "Type"), "line 4: unknown key `Type`; did you mean `type`?"),
        (
            spot("inner_angle = 20", "colour = 3"),
            "line 2: this spot light `key` has no `inner_angle`; add inner_angle = 20.0 (degrees from the axis)",
        ),
        (
            format!("{SPOT}colour = 3\n"),
            "line 10: unknown key `colour`; a light of type \"spot\" has name, type, enabled, position, target, \
             intensity, inner_angle, outer_angle, radius",
        ),
        (
            format!("{SPOT}angle = 3\n"),
            "line 10: `angle` is a key of distant lights; a light of type \"spot\" has name, type, enabled, position, \
             target, intensity, inner_angle, outer_angle, radius",
        ),
        (
            format!("{DISTANT}target = [0, 0, 0]\n"),
            "line 6: `target` is a key of spot lights; a light of type \"distant\" has name, type, enabled, direction, \
             irradiance, angle",
        ),
        (spot("exposure", "exposur"), "line 1: unknown key `exposur`; did you mean `exposure`?"),
        (
            spot("exposure", "gamma"),
            "line 1: unknown key `gamma`; a rig has `exposure`, [[light]], [[emitter]], [[material]] and [[animate]] tables",
        ),
        (OMNI.replace("[[light]]", "[[lights]]"), "line 1: unknown key `lights`; did you mean `light`?"),
        (
            OMNI.replace("[[light]]", "[light]"),
            "line 1: `light` must be a list of tables, not one table; begin each light with [[light]]",
        ),
        (
            "light = [1]".to_owned(),
            "line 1: a light must be a table, not one number; begin each light with [[light]]",
        ),
        (
            spot("intensity = [60.0, 55.0, 50.0]\n", ""),
            "line 2: this spot light `key` has no `intensity`; add intensity = [60.0, 55.0, 50.0] (W/sr)",
        ),
        (
            format!("{OMNI}{}", distant("name = \"sun\"\n", "")),
            "line 8: this distant light has no `name`; add name = \"key\"",
        ),
        (
            spot("type = \"spot\"\n", ""),
            "line 2: this light has no `type`; add type = \"omni\", \"spot\", \"distant\" or \"dome\"",
        ),
        (spot("\"spot\"", "\"spto\""), "line 4: unknown type \"spto\"; did you mean \"spot\"?"),
        (spot("\"spot\"", "\"point\""), "line 4: unknown type \"point\"; did you mean \"omni\"?"),
        (
            spot("\"spot\"", "\"area\""),
            "line 4: unknown type \"area\"; use \"omni\", \"spot\", \"distant\" or \"dome\"",
        ),
        (
            spot("\"spot\"", "7"),
            "line 4: `type` must be \"omni\", \"spot\", \"distant\" or \"dome\", not one number",
        ),
        (spot("60.0,", "nan,"), "line 7: `intensity` must be three finite numbers; NaN is none"),
        (spot("60.0,", "-inf,"), "line 7: `intensity` must be three finite numbers; -inf is none"),
        (spot("60.0,", "1e300,"), "line 7: `intensity` must be three finite numbers; inf is none"),
        (spot("55.0", "-55.0"), "line 7: `intensity` must not be negative, but has -55; use 0 or more"),
        (
            spot("[1.0, 4, 0.5]", "[1.0, inf, 0.5]"),
            "line 5: `position` must be three finite numbers; inf is none",
        ),
        (
            spot("exposure = -1.5", "exposure = nan"),
            "line 1: `exposure` must be a finite number of stops, not NaN",
        ),
        (
            spot("exposure = -1.5", "exposure = \"high\""),
            "line 1: `exposure` must be a number, such as 0.0 (stops), not text",
        ),
        (
            spot("inner_angle = 20", "inner_angle = 40"),
            "line 8: `inner_angle` (40) must not be above `outer_angle` (30); both are degrees from the axis",
        ),
        (spot("30.0", "95.0"), "line 9: `outer_angle` must be from 0 to 90, not 95"),
        (spot("inner_angle = 20", "inner_angle = -1"), "line 8: `inner_angle` must be from 0 to 90, not -1"),
        (
            spot("20", "0").replace("30.0", "0.0"),
            "line 9: `outer_angle` must be above 0: a cone without width lights nothing",
        ),
        (
            spot("[0.0, 0.0, 0.0]", "[1.0, 4.0, 0.5]"),
            "line 6: `target` must differ from `position`: between them is the way the spot shines",
        ),
        (OMNI.replace("0.25", "-0.25"), "line 6: `radius` must be 0 or more, not -0.25"),
        (
            OMNI.replace("0.25", "\"big\""),
            "line 6: `radius` must be a number, such as 0.1 (metres), not text",
        ),
        (OMNI.replace("false", "\"no\""), "line 7: `enabled` must be true or false, not text"),
        (OMNI.replace("\"fill\"", "12"), "line 2: `name` must be text in quotes, not one number"),
        (
            OMNI.replace("\"fill\"", "\"\""),
            "line 2: `name` must not be empty; give the light a name of its own",
        ),
        (
            OMNI.replace("[1, 2, 3]", "5"),
            "line 5: `intensity` must be three numbers, such as [60.0, 55.0, 50.0] (W/sr), not one number",
        ),
        (
            OMNI.replace("[1, 2, 3]", "[1, 2]"),
            "line 5: `intensity` must be three numbers, such as [60.0, 55.0, 50.0] (W/sr), not a list of 2",
        ),
        (
            OMNI.replace("[1, 2, 3]", "[1, 2, true]"),
            "line 5: `intensity` must be three numbers, such as [60.0, 55.0, 50.0] (W/sr), not a list with something \
             other than numbers",
        ),
        (
            distant("[0, -1, 0]", "[0, 0, 0]"),
            "line 4: `direction` has no length; write the way the light travels, such as [0.0, -1.0, 0.0]",
        ),
        (format!("{DISTANT}angle = 200\n"), "line 6: `angle` must be from 0 to 180, not 200"),
        (
            format!("{OMNI}{}", OMNI.replace("[0, 1, 0]", "[0, 2, 0]")),
            "line 9: an earlier light is named `fill` too; give each light a name of its own",
        ),
        // Of two problems, the first in the text, whatever the order of checks.
        (
            format!("{}{}", OMNI.replace("0.25", "-1"), distant("irradiance", "irradianze")),
            "line 6: `radius` must be 0 or more, not -1",
        ),
    ];
    for (text, expected) in cases {
        let error = parse(text).expect_err(text);
        assert!(error.is_bad_input());
        assert_eq!(error.to_string(), format!("rig.toml: {expected}"));
    }
}

#[test]
fn broken_toml_is_told_with_its_line() {
    let cases = [
        (SPOT.replace("30.0", ""), "rig.toml: line 9: not valid TOML: "),
        (format!("{OMNI}radius = 1\n"), "rig.toml: line 8: not valid TOML: duplicate key"),
        (OMNI.replace("[1, 2, 3]", "[1, 2, 3"), "rig.toml: line "),
        (OMNI.replace("\"omni\"", "omni"), "rig.toml: line 3: not valid TOML: "),
        ("[".repeat(100_000), "rig.toml: line 1: not valid TOML: "),
        (format!("x = {}", "[".repeat(100_000)), "rig.toml: line 1: not valid TOML: "),
    ];
    for (text, expected) in cases {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn files_that_are_no_text_and_missing_files_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    std::fs::write(&path, b"exposure = 1\n# caf\xe9\n").unwrap();
    let error = load_rig(&path).unwrap_err().to_string();
    assert!(error.ends_with("line 2: not UTF-8 text; save the rig as UTF-8"), "{error}");
    let error = load_rig(folder.path().join("none.toml")).unwrap_err();
    assert!(error.is_bad_input() && error.to_string().contains("cannot read"), "{error}");
}

#[test]
fn a_rig_that_could_not_be_read_back_is_not_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    let refused = |change: &dyn Fn(&mut LightRig)| {
        let mut rig = every_kind();
        change(&mut rig);
        let error = save_rig(&rig, &path).unwrap_err().to_string();
        assert!(!path.exists());
        error
    };
    assert_eq!(
        refused(&|rig| rig.lights[1].name = "key".to_owned()),
        "two lights are named `key`; give each a name of its own"
    );
    assert_eq!(
        refused(&|rig| rig.lights[2] = rig.lights[2].with_color(Vec3::NEG_ONE)),
        "distant light `sun`: `irradiance` must not be negative, but has -1; use 0 or more"
    );
    assert!(refused(&|rig| rig.exposure = f32::NAN).contains("finite"));
}
