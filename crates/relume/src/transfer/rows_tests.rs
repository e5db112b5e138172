//! Rows under a lamp that is half hidden, where what is visible is known in closed form.

use glam::{Affine3A, Vec2};

use super::*;
use crate::sample::{CloudMethod, CloudSettings, GatherCloud};
use crate::scene::{Instance, Material, Mesh, Scene};

/// Height of the lamp, metres; the slab hangs half way.
const HEIGHT: f32 = 2.0;
/// Side of the lamp, and so the width of the penumbra below an edge half way up.
const LAMP: f32 = 0.4;
/// Points along each side of the patch of floor.
const SIDE: usize = 64;
const CELLS: usize = 4096;

struct Room {
    scene: Scene,
    geometry: Geometry,
    accel: Accel,
}

/// A floor, a lamp that faces it, and between them a slab over all of the side `x < 0`.
fn room() -> Room {
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    let mut quad = |corner: Vec3, edge_u: Vec3, edge_v: Vec3| {
        scene.instances.push(Instance {
            name: String::new(),
            mesh: scene.meshes.len(),
            world_from_object: Affine3A::IDENTITY,
            object: scene.meshes.len() as u32,
        });
        scene.meshes.push(Mesh {
            positions: vec![corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v],
            normals: vec![edge_u.cross(edge_v).normalize(); 4],
            uvs: vec![Vec2::ZERO; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        });
    };
    quad(Vec3::new(-2.0, 0.0, -2.0), 4.0 * Vec3::Z, 4.0 * Vec3::X);
    quad(Vec3::new(-0.5 * LAMP, HEIGHT, -0.5 * LAMP), LAMP * Vec3::X, LAMP * Vec3::Z);
    quad(Vec3::new(-2.0, 0.5 * HEIGHT, -2.0), 2.0 * Vec3::X, 4.0 * Vec3::Z);
    let geometry = Geometry::new(&scene);
    let accel = Accel::new(&scene, &geometry);
    Room { scene, geometry, accel }
}

/// A patch of floor as wide as the penumbra and across it, in the order of a tree: runs of 64 are squares.
fn penumbra() -> Vec<GatherPoint> {
    let place = |index: usize, bit: usize| (0..6).map(|k| (index >> (2 * k + bit) & 1) << k).sum::<usize>();
    let at = |step: usize| ((step as f32 + 0.5) / SIDE as f32 - 0.5) * LAMP;
    (0..SIDE * SIDE)
        .map(|index| GatherPoint {
            position: Vec3::new(at(place(index, 0)), 0.0, at(place(index, 1))),
            shading_normal: Vec3::Y,
            geometric_normal: Vec3::Y,
            seed: hash(index as u32, 1),
            lobe: None,
        })
        .collect()
}

/// The cells of a room, on which rows are made.
struct Cells {
    cloud: GatherCloud,
    map: CellMap,
    patches: Patches,
}

fn cells(room: &Room) -> Cells {
    let Room { scene, geometry, accel } = room;
    let down = |index: usize| {
        let place = |bits: usize| ((bits % 64) as f32 / 63.0 - 0.5) * 3.0;
        let ray = Ray::new(Vec3::new(place(index), 0.9, place(index / 64)), -Vec3::Y);
        let mut hits = [Hit::MISS];
        accel.closest_batch(&[ray], &mut hits);
        (hits[0], ray.direction)
    };
    let seen: Vec<(Hit, Vec3)> = (0..64 * 64).map(down).collect();
    let settings =
        CloudSettings { count: CELLS, method: CloudMethod::Uniform, sky: true, rays: 20_000_000, seed: 0 };
    let (cloud, map) = GatherCloud::new(scene, geometry, accel, &seen, &settings, &()).unwrap();
    let patches = Patches::new(&cloud, &map);
    Cells { cloud, map, patches }
}

fn source<'a>(room: &'a Room, cells: &'a Cells, spread: Spread, faint: f32) -> RowSource<'a> {
    let settings = RowSettings { hemisphere_rays: 64, tile_rays: 512, lobe_rays: 64, faint, spread };
    let Room { geometry, accel, .. } = room;
    RowSource { accel, geometry, map: &cells.map, patches: &cells.patches, settings }
}

/// Root mean square error of the share of the lamp that points in the middle of the patch see, by their rows.
fn lamp_error(room: &Room, points: &[GatherPoint], spread: Spread, faint: f32) -> f32 {
    let cells = cells(room);
    let Cells { cloud, patches, .. } = &cells;
    let mut rows = vec![0.0; points.len() * CELLS];
    source(room, &cells, spread, faint).block(points, &mut rows, &mut RowScratch::default());
    let of_lamp: Vec<bool> = cloud
        .surfaces()
        .iter()
        .map(|sample| sample.position.y > HEIGHT - 1e-3 && sample.normal.y < 0.0)
        .collect();
    let sum = |row: &[f32]| row.iter().zip(&of_lamp).filter(|&(_, &lamp)| lamp).map(|(f, _)| f).sum::<f32>();
    // where no tile lies beyond the patch that would be near
    let inside = |point: &GatherPoint| point.position.abs().max_element() < 0.25 * LAMP;
    let inner: Vec<_> =
        points.iter().zip(rows.chunks_exact(CELLS)).filter(|(point, _)| inside(point)).collect();
    let squares = inner.iter().map(|(point, row)| {
        let mut whole = vec![0.0; CELLS];
        patches.form_factors(0, point.position, point.shading_normal, &mut whole);
        let visible = sum(row) / sum(&whole);
        let expected = 0.5 + point.position.x / LAMP;
        (visible - expected).powi(2)
    });
    (squares.sum::<f32>() / inner.len() as f32).sqrt()
}

#[test]
fn a_penumbra_is_a_ramp_and_not_steps_as_wide_as_tiles() {
    let (room, points) = (room(), penumbra());
    let error = |tent, faint| lamp_error(&room, &points, Spread { tile: 0.05, tent }, faint);
    let (stepped, ramp) = (error(0.0, 4e-4), error(0.05, 4e-4));
    // one of the lamp's cells answers for several
    let (noisy, smooth) = (error(0.0, 4e-3), error(0.05, 4e-3));
    println!("off by {ramp:.3} of the lamp; steps {stepped:.3}");
    println!("with faint clusters {smooth:.3}; steps {noisy:.3}");
    // measured 0.010 and 0.044; 0.014 and 0.083
    assert!(ramp < 0.02 && smooth < 0.03, "{ramp}, {smooth}");
    assert!(stepped > 0.03 && noisy > 0.05, "steps must be noticed: {stepped}, {noisy}");
}

#[test]
fn rays_are_ordered_by_cell_and_then_by_tile() {
    let asked = [(3, 1.0), (0, 1.0), (3, 2.0), (2, 1.0), (0, 1.0)];
    let mut by_cell = ByCell::default();
    by_cell.sort(&asked, 4);
    assert_eq!(by_cell.order, [1, 4, 3, 0, 2]);
    by_cell.sort(&asked[..2], 4);
    assert_eq!(by_cell.order, [1, 0]);
}

#[test]
fn what_rays_hit_is_known_to_all_tiles_of_their_run() {
    let (room, points) = (room(), penumbra());
    let cells = cells(&room);
    let points = &points[..5 * TILE / 2];
    let mut rows = vec![0.0; points.len() * CELLS];
    let mut scratch = RowScratch { keep: true, ..RowScratch::default() };
    source(&room, &cells, Spread { tile: 0.01, tent: 0.02 }, 4e-3).block(points, &mut rows, &mut scratch);
    assert!(scratch.tiling.tiles.len() > 3, "more tiles than runs");
    let mut expected = vec![0_u64; 3 * CELLS / FAINT_CLUSTER];
    let mut first = 0;
    for (tile, &(end, _)) in scratch.tiling.tiles.iter().zip(&scratch.found_ends) {
        let run = tile[0] as usize / TILE * CELLS;
        for found in &scratch.found[first..end] {
            let place = run + found.cell as usize;
            expected[place / FAINT_CLUSTER] |= 1 << (place % FAINT_CLUSTER);
        }
        first = end;
    }
    assert_eq!(scratch.hit_cells, expected);
    let hit: u32 = expected.iter().map(|bits| bits.count_ones()).sum();
    assert!((1..3 * CELLS as u32).contains(&hit), "{hit}: some cells are hidden and some are not");
}
