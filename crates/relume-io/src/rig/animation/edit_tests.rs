use relume::glam::Vec3;
use relume::{Light, LightKind, LightRig};

use super::tests::AT_REST;
use super::*;

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
material = "wall"
field = "base_color"
interpolation = "linear"
frames = [1, 3]
values = [[0, 0, 0], [1, 1, 1]]
"#;

fn animated() -> AnimatedRig {
    AnimatedRig::parse(format!("# a comment\n{AT_REST}{TRACKS}"), "rig.toml").unwrap()
}

fn field(of: Subject, key: &str) -> Field {
    Field { of, key: key.to_owned() }
}

fn light(name: &str, key: &str) -> Field {
    field(Subject::Light(name.to_owned()), key)
}

fn keys(rig: &AnimatedRig, field: &Field) -> Option<Vec<i32>> {
    rig.curves().find(|curve| curve.field == *field).map(|curve| curve.frames.to_vec())
}

fn move_to(light: &mut Light, to: Vec3) {
    match &mut light.kind {
        LightKind::Spot { position, .. } | LightKind::Omni { position, .. } => *position = to,
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_is_written_is_read_as_the_same() {
    let rig = animated();
    let again = AnimatedRig::parse(rig.to_toml(), "rig.toml").unwrap();
    assert_eq!(rig, again, "comments apart");
    for frame in -1..12 {
        assert_eq!(rig.rig(frame.into()).unwrap(), again.rig(frame.into()).unwrap(), "{frame}");
    }
    assert_eq!(rig.to_toml(), again.to_toml());
    assert_ne!(rig, rig.keyed(&light("fill", "radius"), 3).unwrap());
}

#[test]
fn moving_fields_get_keys_and_others_change_at_all_frames() {
    let rig = animated();
    let mut now = rig.rig(3.0).unwrap();
    move_to(&mut now.lights[0], Vec3::new(7.0, 6.0, 5.0));
    move_to(&mut now.lights[1], Vec3::new(-1.0, 2.0, 3.0));
    now.exposure = 2.0;
    let edited = rig.edited(3, &now).unwrap();
    assert_eq!(edited.rig(3.0).unwrap(), now);
    assert_eq!(keys(&edited, &light("key", "position")), Some(vec![1, 3, 5, 9]));
    assert_eq!(keys(&edited, &light("fill", "enabled")), Some(vec![1, 3]), "it was not touched");
    for frame in [-4, 1, 5, 9, 20] {
        let (then, now) = (rig.rig(frame.into()).unwrap(), edited.rig(frame.into()).unwrap());
        assert_eq!(then.lights[0], now.lights[0], "the other keys hold");
        assert_eq!(now.lights[1].position(), Some(Vec3::new(-1.0, 2.0, 3.0)));
        assert_eq!(now.exposure, 2.0);
    }
    // a key that is there takes the value
    let mut again = now.clone();
    again.lights[1].enabled = false;
    let again = edited.edited(3, &again).unwrap();
    assert_eq!(keys(&again, &light("fill", "enabled")), Some(vec![1, 3]));
    assert!(!again.rig(30.0).unwrap().lights[1].enabled);
    assert_eq!(rig.edited(3, &rig.rig(3.0).unwrap()).unwrap(), rig, "nothing was edited");
}

/// However long what comes before them is written.
#[test]
fn what_is_not_touched_gets_no_key() {
    let rig = animated();
    let mut now = rig.rig(2.0).unwrap();
    now.exposure = -0.123_456;
    now.lights[0].name = "a key by another name".to_owned();
    if let LightKind::Spot { target, .. } = &mut now.lights[0].kind {
        *target = Vec3::new(0.333, -1.5, 12.25);
    }
    move_to(&mut now.lights[1], Vec3::new(-1.25, 2.125, 3.0625));
    let edited = rig.edited(2, &now).unwrap();
    assert_eq!(edited.rig(2.0).unwrap(), now);
    let frames = |rig: &AnimatedRig| rig.curves().map(|curve| curve.frames.to_vec()).collect::<Vec<_>>();
    assert_eq!(frames(&edited), frames(&rig));
}

#[test]
fn a_copy_moves_as_its_light_does() {
    let rig = animated();
    let copied = rig.duplicated("key", "copy").unwrap();
    for frame in [-1.0, 1.0, 3.0, 9.0] {
        let (was, now) = (rig.rig(frame).unwrap().lights, copied.rig(frame).unwrap().lights);
        assert_eq!((&now[0], &now[2], now.len()), (&was[0], &was[1], 3));
        assert_eq!((&now[1].kind, &*now[1].name), (&was[0].kind, "copy"));
    }
    assert!(rig.duplicated("gone", "copy").is_err() && rig.duplicated("key", "fill").is_err());
}

#[test]
fn curves_follow_their_lights() {
    let rig = animated();
    let now = rig.rig(5.0).unwrap();
    let mut renamed = now.clone();
    renamed.lights[0].name = "rim \"2\"".to_owned();
    let renamed = rig.edited(5, &renamed).unwrap();
    assert_eq!(keys(&renamed, &light("rim \"2\"", "position")), Some(vec![1, 5, 9]));
    let mut reordered = now.clone();
    reordered.lights.reverse();
    let reordered = rig.edited(5, &reordered).unwrap();
    assert_eq!(keys(&reordered, &light("key", "position")), Some(vec![1, 5, 9]));
    assert_eq!(reordered.rig(9.0).unwrap().lights[1], rig.rig(9.0).unwrap().lights[0]);
    let mut fewer = now.clone();
    fewer.lights.remove(0);
    fewer.materials.clear();
    fewer.emitters.clear();
    let fewer = rig.edited(5, &fewer).unwrap();
    assert_eq!(fewer.curves().map(|curve| curve.field).collect::<Vec<_>>(), [light("fill", "enabled")]);
    let mut other = now;
    let kind = LightKind::Omni { position: Vec3::ONE, intensity: Vec3::ONE, radius: 0.0 };
    other.lights[0] = Light { name: "lamp".to_owned(), enabled: true, kind };
    let other = rig.edited(5, &other).unwrap();
    assert_eq!(keys(&other, &light("lamp", "position")), None, "a light of another type is another light");
}

#[test]
fn keys_come_and_go() {
    let rig = animated();
    let radius = light("fill", "radius");
    let still = rig.rig(4.0).unwrap();
    let keyed = rig.keyed(&radius, 4).unwrap();
    assert_eq!((keys(&keyed, &radius), keyed.rig(4.0).unwrap()), (Some(vec![4]), still));
    let mut wider = rig.rig(14.0).unwrap();
    if let LightKind::Omni { radius, .. } = &mut wider.lights[1].kind {
        *radius = 2.0;
    }
    let moving = keyed.keyed(&radius, 14).unwrap().edited(14, &wider).unwrap();
    let at = |frame: f64| match moving.rig(frame).unwrap().lights[1].kind {
        LightKind::Omni { radius, .. } => radius,
        ref other => panic!("{other:?}"),
    };
    assert_eq!([0.0, 4.0, 9.0, 14.0].map(at), [0.0, 0.0, 1.0, 2.0]);
    let straight = moving.interpolated(&radius, Interpolation::Step).unwrap();
    assert_eq!(straight.rig(13.0).unwrap(), keyed.rig(13.0).unwrap());
    let one = moving.unkeyed(&radius, 4).unwrap();
    assert_eq!(keys(&one, &radius), Some(vec![14]));
    let none = one.unkeyed(&radius, 14).unwrap();
    assert_eq!(
        (keys(&none, &radius), none.rig(20.0).unwrap().lights[1].clone()),
        (None, wider.lights[1].clone())
    );
    assert_eq!(moving.held(&radius, 14).unwrap(), none);
    assert_eq!(rig.unkeyed(&radius, 4).unwrap(), rig, "there was none");
    assert!(rig.interpolated(&light("fill", "enabled"), Interpolation::Linear).is_err());
    for wrong in [
        light("fill", "target"),
        light("fill", "name"),
        light("gone", "radius"),
        field(Subject::Rig, "light"),
    ] {
        assert!(rig.keyed(&wrong, 1).unwrap_err().is_bad_input(), "{wrong:?}");
    }
    let exposure = field(Subject::Rig, "exposure");
    assert_eq!(keys(&rig.keyed(&exposure, -7).unwrap(), &exposure), Some(vec![-7]));
}

#[test]
fn fields_that_can_move_are_known() {
    let rig = animated();
    let of = |subject: &Subject| rig.resting(std::slice::from_ref(subject), 1);
    let keys = |subject: &Subject| of(subject).into_iter().map(|field| field.key).collect::<Vec<_>>();
    assert_eq!(keys(&Subject::Rig), ["exposure"]);
    let (key, fill) = (Subject::Light("key".to_owned()), Subject::Light("fill".to_owned()));
    assert_eq!(keys(&fill), ["position", "intensity", "radius"], "it is switched on and off already");
    assert!(keys(&Subject::Material("wall".to_owned())).is_empty());
    assert!(keys(&Subject::Emitter("gone".to_owned())).is_empty());
    for field in rig.resting(&[Subject::Rig, key, fill], 1) {
        let keyed = rig.keyed(&field, 2).unwrap();
        let curve = keyed.curves().find(|curve| curve.field == field).unwrap();
        assert_eq!(curve.blends, curve.interpolation != Interpolation::Step, "{field:?}");
        assert!(!keyed.resting(std::slice::from_ref(&field.of), 1).contains(&field));
    }
}

/// What is right now, and cannot be at another key.
#[test]
fn edits_that_cannot_be_are_refused() {
    let rig = animated();
    let mut now = rig.rig(1.0).unwrap();
    if let LightKind::Spot { target, .. } = &mut now.lights[0].kind {
        *target = Vec3::new(2.0, 0.5, 0.3); // where it stands at frame 9
    }
    let error = rig.edited(1, &now).unwrap_err();
    assert!(error.is_bad_input() && error.to_string().contains("at frame 9: `target`"), "{error}");
    let nameless = LightRig { lights: vec![Light { name: String::new(), ..now.lights[1].clone() }], ..now };
    assert!(AnimatedRig::still(&nameless, "rig.toml").is_err());
}

#[test]
fn maps_move_with_the_rig() {
    let folder = tempfile::tempdir().unwrap();
    let (old, new) = (folder.path().join("old"), folder.path().join("new"));
    for (folder, maps) in [(&old, &["day.exr", "night.exr"][..]), (&new, &[])] {
        std::fs::create_dir(folder).unwrap();
        for name in maps {
            let mut image = relume::image::Image::new(4, 2);
            image.pixels.fill(Vec3::splat(0.5));
            crate::write_exr_image(folder.join(name), &image, &crate::ExrMeta::default()).unwrap();
        }
    }
    let text = "[[light]]\nname = \"sky\"\ntype = \"dome\"\n[[animate]]\nlight = \"sky\"\nfield = \"map\"\n\
                frames = [1, 2]\nvalues = [\"day.exr\", \"night.exr\"]\n";
    let rig = AnimatedRig::parse(text, old.join("rig.toml")).unwrap();
    let moved = rig.moved_to(new.join("rig.toml")).unwrap();
    moved.save().unwrap();
    let read = AnimatedRig::load(new.join("rig.toml")).unwrap();
    assert_eq!(read, moved);
    let mut files: Vec<PathBuf> = read.maps().collect();
    files.sort();
    assert_eq!(files, ["day.exr", "night.exr"].map(|name| old.join(name)));
    assert_eq!(moved.moved_to(old.join("rig.toml")).unwrap(), rig);
    let mut without = rig.rig(2.0).unwrap();
    if let LightKind::Dome { map, .. } = &mut without.lights[0].kind {
        *map = None;
    }
    let without = rig.edited(2, &without).unwrap();
    assert_eq!((without.curves().count(), without.maps().count()), (0, 0));
}
