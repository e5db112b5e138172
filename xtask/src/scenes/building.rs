//! The courtyard's architecture: two arcades of six bays with vaulted aisles behind them, a gallery of small
//! arches over each, two end walls with niches, open sky in the middle.
//!
//! Surfaces are closed: every wall has two faces and a thickness, so that nothing shines through a corner.

use glam::{Vec2, Vec3};

use super::lathe::Profile;
use super::mesh::Mesh;
use super::walls::{ArchedWall, Back, Frame, Opening, archivolt, groin_vault, vault_edge};

/// Bays of an arcade.
pub(crate) const BAYS: usize = 6;
/// From column to column.
pub(crate) const BAY: f32 = 1.9;
/// Half the courtyard's length inside.
const HALF_LENGTH: f32 = 0.5 * BAYS as f32 * BAY;
/// From the middle of the courtyard to the face of an arcade.
const NAVE: f32 = 2.0;
const ARCADE_THICKNESS: f32 = 0.4;
/// From the middle of the courtyard to the middle of an arcade's wall.
pub(crate) const ARCADE_AXIS: f32 = NAVE + 0.5 * ARCADE_THICKNESS;
/// From the middle of the courtyard to the back wall of an aisle.
const AISLE_FAR: f32 = 4.0;
const AISLE_NEAR: f32 = NAVE + ARCADE_THICKNESS;
/// From the middle of the courtyard to the middle of an aisle.
const AISLE_AXIS: f32 = 0.5 * (AISLE_NEAR + AISLE_FAR);
/// Outer faces.
const OUTER: Vec2 = Vec2::new(HALF_LENGTH + 0.4, AISLE_FAR + 0.3);
/// Height of the step the columns stand on.
const STYLOBATE: f32 = 0.08;
/// Height at which the arches of the arcade and the vaults begin.
const SPRING: f32 = 1.98;
const ARCH_RADIUS: f32 = 0.70;
const VAULT_RISE: f32 = 0.85;
/// Height of the gallery's floor.
const GALLERY: f32 = 3.2;
/// Height of the parapet the colonnettes stand on.
const PARAPET: f32 = 3.5;
const GALLERY_THICKNESS: f32 = 0.3;
const GALLERY_BAY: f32 = 0.5 * BAY;
const GALLERY_SPRING: f32 = 4.27;
const GALLERY_RADIUS: f32 = 0.34;
const GALLERY_CEILING: f32 = 5.1;
/// Height of the walls.
const TOP: f32 = 5.5;
const SIDES: [f32; 2] = [-1.0, 1.0];

fn arcade_frame(side: f32) -> Frame {
    Frame { origin: Vec3::Z * NAVE * side, along: Vec3::X, out: -Vec3::Z * side }
}

fn end_frame(side: f32) -> Frame {
    Frame { origin: Vec3::X * HALF_LENGTH * side, along: Vec3::Z, out: -Vec3::X * side }
}

/// The middle of bay `bay` of `bays`, metres along X.
fn bay_middle(bay: usize, bays: usize) -> f32 {
    (bay as f32 + 0.5) * 2.0 * HALF_LENGTH / bays as f32 - HALF_LENGTH
}

fn arches(bays: usize, radius: f32, spring: f32, sill: f32) -> Vec<Opening> {
    (0..bays).map(|bay| Opening { center: bay_middle(bay, bays), radius, spring, sill }).collect()
}

fn end_niche() -> Opening {
    Opening { center: 0.0, radius: 1.1, spring: 1.55, sill: 0.0 }
}

fn end_windows() -> [Opening; 3] {
    [-1.1, 0.0, 1.1].map(|center| Opening {
        center,
        radius: GALLERY_RADIUS,
        spring: GALLERY_SPRING,
        sill: 3.66,
    })
}

/// The paved ground of courtyard, aisles and niches, out to the outer faces.
pub(crate) fn floor() -> Mesh {
    let mut mesh = Mesh::default();
    level(&mut mesh, 0.0, [-OUTER.x, OUTER.x], [-OUTER.y, OUTER.y], Vec3::Y);
    mesh
}

/// Adds a level rectangle over the ranges `x` and `z`.
fn level(mesh: &mut Mesh, y: f32, x: [f32; 2], z: [f32; 2], normal: Vec3) {
    let corners = [(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])];
    mesh.quad(corners.map(|(x, z)| Vec3::new(x, y, z)), normal);
}

/// Adds an upright rectangle on the face of `frame`.
fn upright(mesh: &mut Mesh, frame: &Frame, s: [f32; 2], y: [f32; 2], depth: f32, normal: Vec3) {
    let corners = [(s[0], y[0]), (s[1], y[0]), (s[1], y[1]), (s[0], y[1])];
    mesh.quad(corners.map(|(s, y)| frame.at(s, y, depth)), normal);
}

/// All of dressed blocks: arcades, galleries, end walls, outer faces, the walls' tops.
pub(crate) fn walls() -> Mesh {
    let mut mesh = Mesh::default();
    for side in SIDES {
        add_side(&mut mesh, side);
        add_end(&mut mesh, side);
    }
    mesh
}

fn add_side(mesh: &mut Mesh, side: f32) {
    let frame = arcade_frame(side);
    let (start, end) = (-HALF_LENGTH, HALF_LENGTH);
    let lunette = |s: f32| {
        let bay = ((s + HALF_LENGTH) / BAY).floor().clamp(0.0, (BAYS - 1) as f32) as usize;
        // A hand's breadth over the vault, so that the faceted edges of both leave no gap.
        vault_edge(s - bay_middle(bay, BAYS), 0.5 * BAY, SPRING, VAULT_RISE) + 0.1
    };
    let lower = ArchedWall {
        frame,
        start,
        end,
        bottom: SPRING,
        top: PARAPET,
        thickness: ARCADE_THICKNESS,
        openings: &arches(BAYS, ARCH_RADIUS, SPRING, 0.0),
        back: Back::Through(&lunette),
    };
    let upper = ArchedWall {
        bottom: GALLERY_SPRING,
        top: TOP,
        thickness: GALLERY_THICKNESS,
        openings: &arches(2 * BAYS, GALLERY_RADIUS, GALLERY_SPRING, 0.0),
        back: Back::Through(&|_| GALLERY_CEILING),
        ..lower
    };
    let behind = ArchedWall {
        frame: Frame { origin: Vec3::Z * AISLE_FAR * side, ..frame },
        bottom: 0.0,
        top: SPRING + VAULT_RISE + 0.05,
        thickness: 0.12,
        openings: &arches(BAYS, ARCH_RADIUS, SPRING, 0.0),
        back: Back::Niche,
        ..lower
    };
    for wall in [lower, upper, behind] {
        mesh.append(&wall.mesh());
    }
    upright(mesh, &frame, [start, end], [GALLERY, PARAPET], GALLERY_THICKNESS, -frame.out);
    let far = AISLE_FAR - NAVE;
    upright(mesh, &frame, [start, end], [GALLERY, GALLERY_CEILING], far, frame.out);
    for end_side in SIDES {
        add_pier(mesh, side, end_side);
    }
    let outer = Frame { origin: Vec3::Z * OUTER.y * side, ..frame };
    upright(mesh, &outer, [-OUTER.x, OUTER.x], [0.0, TOP], 0.0, -frame.out);
    let z = [NAVE * side, OUTER.y * side];
    level(mesh, TOP, [-OUTER.x, OUTER.x], z, Vec3::Y);
    level(mesh, PARAPET, [start, end], [NAVE * side, (NAVE + GALLERY_THICKNESS) * side], Vec3::Y);
    level(mesh, GALLERY, [start, end], [(NAVE + GALLERY_THICKNESS) * side, AISLE_FAR * side], Vec3::Y);
}

/// Adds what carries the last arch of an arcade and of its gallery where they meet an end wall.
fn add_pier(mesh: &mut Mesh, side: f32, end_side: f32) {
    let frame = arcade_frame(side);
    let piers = [
        (BAY, ARCH_RADIUS, STYLOBATE, SPRING, ARCADE_THICKNESS),
        (GALLERY_BAY, GALLERY_RADIUS, PARAPET, GALLERY_SPRING, GALLERY_THICKNESS),
    ];
    for (bay, radius, bottom, top, thickness) in piers {
        let near = (HALF_LENGTH - 0.5 * bay + radius) * end_side;
        let s = [near, HALF_LENGTH * end_side];
        upright(mesh, &frame, s, [bottom, top], 0.0, frame.out);
        upright(mesh, &frame, s, [bottom, top], thickness, -frame.out);
        let corners = [(bottom, 0.0), (bottom, thickness), (top, thickness), (top, 0.0)];
        mesh.quad(corners.map(|(y, depth)| frame.at(near, y, depth)), -frame.along * end_side);
    }
}

fn add_end(mesh: &mut Mesh, side: f32) {
    let frame = end_frame(side);
    let lower = ArchedWall {
        frame,
        start: -NAVE,
        end: NAVE,
        bottom: 0.0,
        top: PARAPET,
        thickness: 0.3,
        openings: &[end_niche()],
        back: Back::Niche,
    };
    let upper = ArchedWall {
        bottom: PARAPET,
        top: TOP,
        thickness: 0.2,
        openings: &end_windows(),
        back: Back::Niche,
        ..lower
    };
    for wall in [lower, upper] {
        mesh.append(&wall.mesh());
    }
    for aisle in SIDES {
        let crown = SPRING + VAULT_RISE + 0.05;
        upright(mesh, &frame, [NAVE * aisle, AISLE_FAR * aisle + 0.12 * aisle], [0.0, crown], 0.0, frame.out);
        let gallery = [(NAVE + GALLERY_THICKNESS) * aisle, AISLE_FAR * aisle];
        upright(mesh, &frame, gallery, [GALLERY, GALLERY_CEILING], 0.0, frame.out);
    }
    let outer = Frame { origin: Vec3::X * OUTER.x * side, ..frame };
    upright(mesh, &outer, [-OUTER.y, OUTER.y], [0.0, TOP], 0.0, -frame.out);
    level(mesh, TOP, [HALF_LENGTH * side, OUTER.x * side], [-NAVE, NAVE], Vec3::Y);
}

/// The vaults of the aisles and the ceilings of the galleries.
pub(crate) fn ceilings() -> Mesh {
    let mut mesh = Mesh::default();
    for side in SIDES {
        for bay in 0..BAYS {
            let center = Vec2::new(bay_middle(bay, BAYS), side * AISLE_AXIS);
            let half = Vec2::new(0.5 * BAY, 0.5 * (AISLE_FAR - AISLE_NEAR));
            mesh.append(&groin_vault(center, half, SPRING, VAULT_RISE));
        }
        let z = [(NAVE + GALLERY_THICKNESS) * side, AISLE_FAR * side];
        level(&mut mesh, GALLERY_CEILING, [-HALF_LENGTH, HALF_LENGTH], z, -Vec3::Y);
    }
    mesh
}

/// All of finer stone that is not a column: steps, archivolts, string courses, cornices, imposts.
pub(crate) fn dressings() -> Mesh {
    let mut mesh = Mesh::default();
    for side in SIDES {
        let z = [side * (NAVE - 0.1), side * (AISLE_NEAR + 0.1)];
        let lo = Vec3::new(-HALF_LENGTH, 0.0, z[0].min(z[1]));
        let hi = Vec3::new(HALF_LENGTH, STYLOBATE, z[0].max(z[1]));
        mesh.chamfered_box(lo, hi, 0.012, false);
        let frame = arcade_frame(side);
        for arch in arches(BAYS, ARCH_RADIUS, SPRING, 0.0) {
            mesh.append(&archivolt(&frame, &arch, 0.15, 0.035));
        }
        for arch in arches(2 * BAYS, GALLERY_RADIUS, GALLERY_SPRING, 0.0) {
            mesh.append(&archivolt(&frame, &arch, 0.09, 0.025));
        }
        mesh.append(&archivolt(&end_frame(side), &end_niche(), 0.20, 0.05));
        for window in end_windows() {
            mesh.append(&archivolt(&end_frame(side), &window, 0.09, 0.025));
        }
        add_courses(&mut mesh, &frame, HALF_LENGTH);
        add_courses(&mut mesh, &end_frame(side), NAVE);
        for end_side in SIDES {
            add_imposts(&mut mesh, side, end_side);
        }
    }
    mesh
}

/// String course, parapet's edge and cornice along `-half..half` of a frame.
fn add_courses(mesh: &mut Mesh, frame: &Frame, half: f32) {
    let string = Profile::default()
        .straight(&[(0.0, 3.00), (0.025, 3.00), (0.025, 3.03)])
        .quarter_round(0.025, 3.03, 3.10, 0.06)
        .straight(&[(0.085, 3.10), (0.10, 3.10), (0.10, 3.16), (0.0, 3.19)]);
    let parapet = Profile::default()
        .straight(&[(0.0, 3.42), (0.04, 3.42), (0.04, 3.45)])
        .half_round(0.04, 3.45, 3.49, 0.8)
        .straight(&[(0.04, 3.49), (0.0, PARAPET)]);
    let cornice = Profile::default()
        .straight(&[(0.0, 5.18), (0.03, 5.18), (0.03, 5.23)])
        .quarter_round(0.03, 5.23, 5.33, 0.08)
        .straight(&[(0.11, 5.33), (0.16, 5.33), (0.16, 5.42)])
        .half_round(0.16, 5.42, 5.47, 0.8)
        .straight(&[(0.16, 5.47), (0.16, TOP), (0.0, TOP)]);
    for profile in [string, parapet, cornice] {
        mesh.append(&profile.moulding(frame.at(-half, 0.0, 0.0), frame.at(half, 0.0, 0.0), frame.out));
    }
}

/// Adds the blocks on the piers at an end of an arcade, level with the columns' capitals.
fn add_imposts(mesh: &mut Mesh, side: f32, end_side: f32) {
    let blocks = [
        (0.5 * BAY - ARCH_RADIUS, SPRING, 0.10, ARCADE_THICKNESS, 0.03),
        (0.5 * GALLERY_BAY - GALLERY_RADIUS, GALLERY_SPRING, 0.06, GALLERY_THICKNESS, 0.02),
    ];
    for (width, top, height, thickness, relief) in blocks {
        let x = [HALF_LENGTH * end_side, (HALF_LENGTH - width - relief) * end_side];
        let z = [(NAVE - relief) * side, (NAVE + thickness + relief) * side];
        let lo = Vec3::new(x[0].min(x[1]), top - height, z[0].min(z[1]));
        let hi = Vec3::new(x[0].max(x[1]), top, z[0].max(z[1]));
        mesh.chamfered_box(lo, hi, 0.008, true);
    }
}

/// Where the columns of both arcades stand.
pub(crate) fn column_feet() -> impl Iterator<Item = Vec3> {
    SIDES.into_iter().flat_map(|side| {
        (1..BAYS).map(move |index| Vec3::new(index as f32 * BAY - HALF_LENGTH, STYLOBATE, side * ARCADE_AXIS))
    })
}

/// Where the colonnettes of both galleries stand.
pub(crate) fn colonnette_feet() -> impl Iterator<Item = Vec3> {
    let axis = NAVE + 0.5 * GALLERY_THICKNESS;
    SIDES.into_iter().flat_map(move |side| {
        (1..2 * BAYS)
            .map(move |index| Vec3::new(index as f32 * GALLERY_BAY - HALF_LENGTH, PARAPET, side * axis))
    })
}

/// A Tuscan column with an Attic base, as high as the arches spring.
pub(crate) fn column() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.chamfered_box(Vec3::new(-0.24, 0.0, -0.24), Vec3::new(0.24, 0.10, 0.24), 0.01, false);
    // Entasis: the shaft swells a little below its middle.
    let shaft = [
        (0.178, 0.285),
        (0.168, 0.30),
        (0.166, 0.34),
        (0.167, 0.60),
        (0.165, 0.85),
        (0.160, 1.10),
        (0.152, 1.35),
        (0.143, 1.58),
        (0.150, 1.60),
    ];
    mesh.append(
        &Profile::default()
            .half_round(0.195, 0.10, 0.175, 1.0)
            .straight(&[(0.205, 0.175), (0.205, 0.185)])
            .half_round(0.198, 0.185, 0.225, -1.0)
            .straight(&[(0.19, 0.225), (0.19, 0.232)])
            .half_round(0.182, 0.232, 0.285, 0.9)
            .smooth(shaft)
            .half_round(0.150, 1.60, 1.635, 1.0)
            .straight(&[(0.143, 1.635), (0.143, 1.695), (0.152, 1.695), (0.152, 1.71)])
            .quarter_round(0.152, 1.71, 1.80, 0.07)
            .straight(&[(0.222, 1.80), (0.222, 1.805)])
            .lathe(28),
    );
    let abacus = [Vec3::new(-0.275, 1.80, -0.235), Vec3::new(0.275, 1.90, 0.235)];
    mesh.chamfered_box(abacus[0], abacus[1], 0.01, true);
    mesh
}

/// A small column for the gallery.
pub(crate) fn colonnette() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.chamfered_box(Vec3::new(-0.11, 0.0, -0.11), Vec3::new(0.11, 0.05, 0.11), 0.006, false);
    mesh.append(
        &Profile::default()
            .half_round(0.088, 0.05, 0.09, 1.0)
            .smooth([(0.085, 0.09), (0.076, 0.10), (0.074, 0.25), (0.070, 0.44), (0.066, 0.60)])
            .half_round(0.066, 0.60, 0.62, 1.0)
            .smooth([(0.066, 0.62), (0.070, 0.65), (0.085, 0.68), (0.112, 0.705)])
            .lathe(18),
    );
    mesh.chamfered_box(Vec3::new(-0.155, 0.705, -0.175), Vec3::new(0.155, 0.77, 0.175), 0.006, true);
    mesh
}
