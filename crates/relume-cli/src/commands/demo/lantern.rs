use relume::glam::Vec3;
use relume::{Error, LightKind, LightRig, Result};
use relume_io::parse_rig;

/// The rig whose first light moves.
const RIG: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/rigs/arcade_move.toml"));
/// The light that is carried through the courtyard.
const LANTERN: &str = "lantern";
/// Where it is in each frame, metres: along the drapes, then behind the statue.
const PLACES: [Vec3; 5] = [
    Vec3::new(-2.6, 2.1, -0.9),
    Vec3::new(-1.2, 1.9, -1.0),
    Vec3::new(0.2, 1.8, -1.0),
    Vec3::new(1.8, 1.9, -1.1),
    Vec3::new(3.2, 2.2, -0.5),
];

/// The rig of each frame.
pub(super) fn rigs() -> Result<Vec<LightRig>> {
    let rig = parse_rig(RIG, "arcade_move.toml")?;
    PLACES.iter().map(|place| with_lantern_at(&rig, *place)).collect()
}

fn with_lantern_at(rig: &LightRig, place: Vec3) -> Result<LightRig> {
    let mut rig = rig.clone();
    let lantern = rig.lights.iter_mut().find(|light| light.name == LANTERN);
    match lantern.map(|light| &mut light.kind) {
        Some(LightKind::Omni { position, .. } | LightKind::Spot { position, .. }) => *position = place,
        _ => {
            return Err(Error::file("arcade_move.toml", format!("has no light `{LANTERN}` with a position")));
        }
    }
    Ok(rig)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_lantern_moves() {
        let rigs = rigs().unwrap();
        assert_eq!(rigs.len(), PLACES.len());
        for (rig, next) in rigs.iter().zip(&rigs[1..]) {
            for (light, moved) in rig.lights.iter().zip(&next.lights) {
                assert_eq!(light != moved, light.name == LANTERN, "{}", light.name);
            }
        }
    }
}
