//! What an edit is called, and how figures are written.

use relume::{Light, LightKind, LightRig};

/// What leads from one rig to another, in a few words: "move key".
pub(crate) fn change(before: &LightRig, after: &LightRig) -> String {
    if let Some(light) = lights(before, after) {
        return light;
    }
    if before.exposure != after.exposure {
        return "change exposure".to_owned();
    }
    if before.emitters != after.emitters {
        let changed = after.emitters.iter().find(|emitter| !before.emitters.contains(emitter));
        return changed
            .map_or("reset an emitter".to_owned(), |emitter| format!("change emitter {}", emitter.material));
    }
    let changed = after.materials.iter().find(|edit| !before.materials.contains(edit));
    changed.map_or("reset a material".to_owned(), |edit| format!("change material {}", edit.name))
}

fn lights(before: &LightRig, after: &LightRig) -> Option<String> {
    let (old, new) = (&before.lights, &after.lights);
    if old == new {
        return None;
    }
    let named = |lights: &[Light], name: &str| lights.iter().any(|light| light.name == name);
    let added: Vec<_> = new.iter().filter(|light| !named(old, &light.name)).collect();
    let removed: Vec<_> = old.iter().filter(|light| !named(new, &light.name)).collect();
    Some(match (&added[..], &removed[..]) {
        ([added], []) => format!("add {}", added.name),
        ([], [removed]) => format!("delete {}", removed.name),
        ([to], [from]) if to.kind == from.kind => format!("rename {} to {}", from.name, to.name),
        ([], []) => match old.iter().zip(new).find(|(old, new)| old != new) {
            Some((old, new)) if old.name == new.name => light(old, new),
            _ => "reorder lights".to_owned(),
        },
        _ => "change lights".to_owned(),
    })
}

fn light(old: &Light, new: &Light) -> String {
    let name = &new.name;
    if old.enabled != new.enabled {
        return format!("turn {name} {}", if new.enabled { "on" } else { "off" });
    }
    if old.same_but_for_color(new) {
        return format!("change light of {name}");
    }
    match (&old.kind, &new.kind) {
        (LightKind::Omni { position: from, .. }, LightKind::Omni { position: to, .. }) if from != to => {
            format!("move {name}")
        }
        (LightKind::Spot { position: from, .. }, LightKind::Spot { position: to, .. }) if from != to => {
            format!("move {name}")
        }
        (LightKind::Spot { target: from, .. }, LightKind::Spot { target: to, .. }) if from != to => {
            format!("aim {name}")
        }
        (LightKind::Distant { direction: from, .. }, LightKind::Distant { direction: to, .. })
            if from != to =>
        {
            format!("turn {name}")
        }
        (LightKind::Dome { map: from, .. }, LightKind::Dome { map: to, .. }) if from != to => {
            format!("change map of {name}")
        }
        (LightKind::Dome { .. }, LightKind::Dome { .. }) => format!("turn {name}"),
        _ => format!("change {name}"),
    }
}

/// Bytes, as people read them.
pub(crate) fn bytes(count: u64) -> String {
    match count {
        0..1_000_000 => format!("{:.0} kB", count as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.0} MB", count as f64 / 1e6),
        _ => format!("{:.2} GB", count as f64 / 1e9),
    }
}

/// Seconds, as people read them.
pub(crate) fn duration(seconds: f64) -> String {
    match seconds.round() as u64 {
        0..60 => format!("{seconds:.0} s"),
        whole => format!("{} min {:02} s", whole / 60, whole % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::MaterialEdit;
    use relume::glam::Vec3;

    fn omni(name: &str) -> Light {
        let kind = LightKind::Omni { position: Vec3::ZERO, intensity: Vec3::ONE, radius: 0.0 };
        Light { name: name.to_owned(), enabled: true, kind }
    }

    fn rig(lights: &[Light]) -> LightRig {
        LightRig { lights: lights.to_vec(), ..LightRig::default() }
    }

    #[test]
    fn edits_have_names() {
        let (key, fill) = (omni("key"), omni("fill"));
        let both = rig(&[key.clone(), fill.clone()]);
        let mut moved = key.clone();
        moved.translate(Vec3::X);
        let off = Light { enabled: false, ..fill.clone() };
        let renamed = Light { name: "rim".to_owned(), ..fill.clone() };
        for (after, name) in [
            (rig(std::slice::from_ref(&key)), "delete fill"),
            (rig(&[moved, fill.clone()]), "move key"),
            (rig(&[key.with_color(Vec3::splat(2.0)), fill.clone()]), "change light of key"),
            (rig(&[key.clone(), off]), "turn fill off"),
            (rig(&[key.clone(), renamed]), "rename fill to rim"),
            (rig(&[fill.clone(), key.clone()]), "reorder lights"),
            (rig(&[key.clone(), fill.clone(), omni("rim")]), "add rim"),
        ] {
            assert_eq!(change(&both, &after), name);
        }
        let edit = MaterialEdit { name: "wall".to_owned(), base_color: Vec3::ONE };
        let painted = LightRig { materials: vec![edit], ..both.clone() };
        assert_eq!(change(&both, &painted), "change material wall");
        assert_eq!(change(&painted, &both), "reset a material");
    }

    #[test]
    fn figures_are_short() {
        assert_eq!(bytes(20_400), "20 kB");
        assert_eq!(bytes(1_530_000_000), "1.53 GB");
        assert_eq!(duration(59.4), "59 s");
        assert_eq!(duration(59.6), "1 min 00 s");
        assert_eq!(duration(700.0), "11 min 40 s");
    }
}
