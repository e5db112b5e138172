//! A small room of mirrors and glass: a wall mirror, a polished floor, a clear ball and a green one, a chrome ball, a pane before a shelf, and a
//! glowing panel.
//!
//! X runs to the right, the camera looks along -Z. Metres throughout.

use std::f32::consts::{FRAC_PI_2, PI};

use anyhow::Result;
use glam::Vec3;
use libm::{cosf, sinf};
use serde_json::{Value, json};

use super::glb::Glb;
use super::lathe::Profile;
use super::mesh::Mesh;

/// Half the room's width, its height, and the places of its back and its front wall.
const HALF: f32 = 1.7;
const HEIGHT: f32 = 2.5;
const BACK: f32 = -1.6;
const FRONT: f32 = 2.4;

fn material(glb: &mut Glb, name: &str, color: [f32; 3], metallic: f32, roughness: f32, more: Value) -> usize {
    let [r, g, b] = color;
    let surface = json!({
        "baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness
    });
    let mut material = json!({"name": name, "pbrMetallicRoughness": surface});
    if let (Some(material), Value::Object(more)) = (material.as_object_mut(), more) {
        material.extend(more);
    }
    glb.material(material)
}

/// Of refractive index 1.5: a solid that takes on `color` after `metres`.
fn solid_glass(glb: &mut Glb, name: &str, color: [f32; 3], metres: f32) -> usize {
    let extensions = json!({
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_ior": {"ior": 1.5},
        "KHR_materials_volume": {
            "thicknessFactor": 0.2, "attenuationColor": color, "attenuationDistance": metres
        },
    });
    material(glb, name, [1.0; 3], 0.0, 0.0, json!({"extensions": extensions}))
}

fn ball(radius: f32) -> Mesh {
    const STEPS: usize = 32;
    let angle = |step: usize| step as f32 / STEPS as f32 * PI - FRAC_PI_2;
    let arc = (0..=STEPS).map(|step| (radius * cosf(angle(step)).max(0.0), radius * sinf(angle(step))));
    Profile::default().smooth(arc).lathe(64)
}

/// An upright sheet with its front towards +Z, its middle at the origin.
fn upright(width: f32, height: f32) -> Mesh {
    let (x, y) = (Vec3::X * (0.5 * width), Vec3::Y * (0.5 * height));
    let mut sheet = Mesh::default();
    sheet.quad([-x - y, x - y, x + y, y - x], Vec3::Z);
    sheet
}

fn block(lo: [f32; 3], hi: [f32; 3]) -> Mesh {
    let mut block = Mesh::default();
    block.chamfered_box(Vec3::from(lo), Vec3::from(hi), 0.008, true);
    block
}

/// Adds an object of one mesh and one material.
fn add(glb: &mut Glb, name: &str, mesh: &Mesh, material: usize, place: Vec3) {
    let mesh = glb.mesh(name, &[(mesh, material)]);
    glb.node(name, mesh, place);
}

/// The scene as a binary glTF file.
pub(crate) fn parlour() -> Result<Vec<u8>> {
    let mut glb = Glb::default();
    add_room(&mut glb);
    add_mirror(&mut glb);
    add_table(&mut glb);
    add_shelf(&mut glb);
    glb.camera("shot", Vec3::new(-0.55, 1.45, 2.1), Vec3::new(0.1, 0.92, -0.4), 52_f32.to_radians());
    glb.finish("parlour")
}

fn add_room(glb: &mut Glb) {
    let plain = json!({});
    let wall = material(glb, "wall", [0.74, 0.70, 0.62], 0.0, 0.9, plain.clone());
    let red = material(glb, "wall_red", [0.62, 0.11, 0.08], 0.0, 0.9, plain.clone());
    let floor = material(glb, "floor_polished", [0.20, 0.17, 0.15], 0.0, 0.02, plain);
    let (lo, hi) = (Vec3::new(-HALF, 0.0, BACK), Vec3::new(HALF, HEIGHT, FRONT));
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * (hi - lo));
    let mut walls = Mesh::default();
    walls.quad([lo, lo + x, lo + x + y, lo + y], Vec3::Z);
    walls.quad([hi, hi - x, hi - x - y, hi - y], -Vec3::Z);
    walls.quad([hi, hi - z, hi - z - y, hi - y], -Vec3::X);
    walls.quad([hi, hi - x, hi - x - z, hi - z], -Vec3::Y);
    let mut left = Mesh::default();
    left.quad([lo, lo + y, lo + y + z, lo + z], Vec3::X);
    let mut ground = Mesh::default();
    ground.quad([lo, lo + z, lo + z + x, lo + x], Vec3::Y);
    let shell = glb.mesh("room", &[(&walls, wall), (&left, red), (&ground, floor)]);
    glb.node("room", shell, Vec3::ZERO);
}

fn add_mirror(glb: &mut Glb) {
    let silver = material(glb, "mirror", [0.93, 0.94, 0.92], 1.0, 0.0, json!({}));
    let wood = material(glb, "frame_wood", [0.32, 0.17, 0.08], 0.0, 0.6, json!({}));
    let place = Vec3::new(-0.35, 1.45, BACK);
    add(glb, "mirror", &upright(1.3, 1.1), silver, place + 0.02 * Vec3::Z);
    let mut frame = block([-0.71, 0.55, 0.0], [0.71, 0.61, 0.05]);
    frame.append(&block([-0.71, -0.61, 0.0], [0.71, -0.55, 0.05]));
    frame.append(&block([-0.71, -0.55, 0.0], [-0.65, 0.55, 0.05]));
    frame.append(&block([0.65, -0.55, 0.0], [0.71, 0.55, 0.05]));
    add(glb, "frame", &frame, wood, place);
}

fn add_table(glb: &mut Glb) {
    let oak = material(glb, "table_oak", [0.46, 0.30, 0.16], 0.0, 0.45, json!({}));
    let clear = solid_glass(glb, "glass_clear", [1.0; 3], 1.0);
    let green = solid_glass(glb, "glass_green", [0.25, 0.85, 0.40], 0.25);
    let chrome = material(glb, "chrome", [0.72, 0.73, 0.75], 1.0, 0.0, json!({}));
    let blue = material(glb, "box_blue", [0.10, 0.22, 0.62], 0.0, 0.8, json!({}));
    let mut table = block([-0.75, 0.68, -0.40], [0.75, 0.74, 0.40]);
    for (x, z) in [(-0.68, -0.33), (0.62, -0.33), (-0.68, 0.27), (0.62, 0.27)] {
        table.append(&block([x, 0.0, z], [x + 0.06, 0.68, z + 0.06]));
    }
    add(glb, "table", &table, oak, Vec3::ZERO);
    add(glb, "ball_clear", &ball(0.16), clear, Vec3::new(-0.22, 0.901, 0.08));
    add(glb, "ball_green", &ball(0.11), green, Vec3::new(0.17, 0.851, 0.20));
    add(glb, "ball_chrome", &ball(0.14), chrome, Vec3::new(0.48, 0.881, -0.08));
    add(glb, "box", &block([-0.1, 0.0, -0.1], [0.1, 0.26, 0.1]), blue, Vec3::new(0.05, 0.741, -0.22));
}

/// A shelf behind a thin pane, and the panel that glows above it.
fn add_shelf(glb: &mut Glb) {
    let transmission = json!({"KHR_materials_transmission": {"transmissionFactor": 1.0}});
    let pane = material(
        glb,
        "pane",
        [0.92, 0.97, 0.95],
        0.0,
        0.0,
        json!({"extensions": transmission, "doubleSided": true}),
    );
    let white = material(glb, "shelf_white", [0.78, 0.78, 0.76], 0.0, 0.8, json!({}));
    let yellow = material(glb, "vase_yellow", [0.80, 0.55, 0.08], 0.0, 0.5, json!({}));
    let lamp = material(glb, "lamp", [0.0; 3], 0.0, 1.0, json!({"emissiveFactor": [1.0, 0.85, 0.6]}));
    let place = Vec3::new(1.05, 0.0, BACK);
    let mut shelf = block([-0.45, 0.0, 0.0], [0.45, 0.95, 0.04]);
    shelf.append(&block([-0.45, 0.40, 0.0], [0.45, 0.43, 0.34]));
    shelf.append(&block([-0.45, 0.95, 0.0], [0.45, 0.98, 0.34]));
    shelf.append(&block([-0.48, 0.0, 0.0], [-0.45, 0.98, 0.34]));
    shelf.append(&block([0.45, 0.0, 0.0], [0.48, 0.98, 0.34]));
    add(glb, "shelf", &shelf, white, place);
    let vase = Profile::default()
        .smooth([
            (0.0, 0.0),
            (0.06, 0.0),
            (0.10, 0.08),
            (0.11, 0.16),
            (0.06, 0.26),
            (0.05, 0.32),
            (0.07, 0.36),
        ])
        .lathe(48);
    add(glb, "vase", &vase, yellow, place + Vec3::new(-0.15, 0.43, 0.18));
    add(glb, "pane", &upright(0.9, 0.95), pane, place + Vec3::new(0.0, 0.475, 0.35));
    add(glb, "lamp", &upright(0.5, 0.12), lamp, place + Vec3::new(0.0, 1.75, 0.02));
}
