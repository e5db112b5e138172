//! The demo scene: an arcaded courtyard with drapes, a statue, potted plants and a bronze bowl.
//!
//! X runs along the courtyard, the middle of its floor is the origin. Metres throughout.

use std::f32::consts::PI;

use anyhow::Result;
use glam::Vec3;
use serde_json::json;

use super::building;
use super::cloth::{Drape, rod};
use super::glb::Glb;
use super::lathe::Profile;
use super::mesh::Mesh;
use super::{plants, statue, textures};

/// Indices of the materials in the file.
struct Materials {
    paving: usize,
    ashlar: usize,
    marble: usize,
    plaster: usize,
    statue: usize,
    bronze: usize,
    drapes: [usize; 3],
    trim: usize,
    terracotta: usize,
    soil: usize,
    leaf: usize,
}

/// A material without textures: linear colour, metallic, roughness.
fn plain(glb: &mut Glb, name: &str, color: [f32; 3], metallic: f32, roughness: f32) -> usize {
    let [r, g, b] = color;
    let surface = json!({
        "baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness
    });
    glb.material(json!({"name": name, "pbrMetallicRoughness": surface}))
}

/// Dressed stone with a base colour and a normal map.
fn stone(glb: &mut Glb, name: &str, stone: &textures::Stone, roughness: f32) -> usize {
    let color = glb.texture(&format!("{name}_base_color"), &stone.base_color);
    let normal = glb.texture(&format!("{name}_normal"), &stone.normal);
    let surface = json!({
        "baseColorTexture": {"index": color}, "metallicFactor": 0.0, "roughnessFactor": roughness
    });
    glb.material(json!({"name": name, "pbrMetallicRoughness": surface, "normalTexture": {"index": normal}}))
}

impl Materials {
    fn new(glb: &mut Glb) -> Result<Self> {
        let marble = glb.texture("marble_base_color", &textures::marble()?);
        let marble = json!({
            "baseColorTexture": {"index": marble}, "metallicFactor": 0.0, "roughnessFactor": 0.8
        });
        let fabric = glb.texture("fabric_base_color", &textures::fabric()?);
        let drape = |glb: &mut Glb, name: &str, [r, g, b]: [f32; 3]| {
            let surface = json!({
                "baseColorTexture": {"index": fabric}, "baseColorFactor": [r, g, b, 1.0],
                "metallicFactor": 0.0, "roughnessFactor": 0.9
            });
            glb.material(json!({"name": name, "pbrMetallicRoughness": surface, "doubleSided": true}))
        };
        let drapes = [
            drape(glb, "drape_red", [0.86, 0.055, 0.035]),
            drape(glb, "drape_green", [0.07, 0.50, 0.10]),
            drape(glb, "drape_blue", [0.05, 0.14, 0.80]),
        ];
        let trim = drape(glb, "drape_trim", [0.90, 0.62, 0.18]);
        let leaf = glb.texture("leaf_base_color", &textures::leaf()?);
        let leaf = json!({
            "baseColorTexture": {"index": leaf}, "metallicFactor": 0.0, "roughnessFactor": 0.8
        });
        Ok(Self {
            paving: stone(glb, "floor_paving", &textures::paving()?, 0.5),
            ashlar: stone(glb, "ashlar", &textures::ashlar()?, 0.9),
            marble: glb.material(json!({"name": "marble", "pbrMetallicRoughness": marble})),
            plaster: plain(glb, "plaster", [0.72, 0.66, 0.56], 0.0, 0.9),
            statue: plain(glb, "statue_marble", [0.76, 0.72, 0.65], 0.0, 0.4),
            bronze: plain(glb, "bronze", [0.70, 0.46, 0.22], 1.0, 0.35),
            drapes,
            trim,
            terracotta: plain(glb, "terracotta", [0.56, 0.23, 0.12], 0.0, 0.85),
            soil: plain(glb, "soil", [0.07, 0.045, 0.03], 0.0, 0.9),
            leaf: glb.material(json!({
                "name": "leaf", "pbrMetallicRoughness": leaf,
                "alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": true
            })),
        })
    }
}

/// The scene as a binary glTF file.
pub(crate) fn arcade() -> Result<Vec<u8>> {
    let mut glb = Glb::default();
    let materials = Materials::new(&mut glb)?;
    add_building(&mut glb, &materials);
    add_drapes(&mut glb, &materials);
    add_statue(&mut glb, &materials);
    add_plants(&mut glb, &materials);
    add_bowl(&mut glb, &materials);
    glb.camera("shot", Vec3::new(-5.0, 1.82, 1.2), Vec3::new(1.0, 1.24, -0.62), 48_f32.to_radians());
    glb.finish("arcade")
}

fn add_building(glb: &mut Glb, materials: &Materials) {
    let floor = glb.mesh("floor", &[(&building::floor(), materials.paving)]);
    glb.node("floor", floor, Vec3::ZERO);
    let shell = glb.mesh(
        "building",
        &[
            (&building::walls(), materials.ashlar),
            (&building::dressings(), materials.marble),
            (&building::ceilings(), materials.plaster),
        ],
    );
    glb.node("building", shell, Vec3::ZERO);
    let column = glb.mesh("column", &[(&building::column(), materials.marble)]);
    for (index, foot) in building::column_feet().enumerate() {
        glb.node(&format!("column_{index}"), column, foot);
    }
    let colonnette = glb.mesh("colonnette", &[(&building::colonnette(), materials.marble)]);
    for (index, foot) in building::colonnette_feet().enumerate() {
        glb.node(&format!("colonnette_{index}"), colonnette, foot);
    }
}

fn add_drapes(glb: &mut Glb, materials: &Materials) {
    const ROD: f32 = 1.93;
    let drapes = [
        ("red", -0.5, Drape { width: 1.32, drop: 1.70, pleats: 7.0, phase: 0.4, drawn: -0.9 }),
        ("green", 0.5, Drape { width: 1.32, drop: 1.70, pleats: 8.0, phase: 2.1, drawn: 0.0 }),
        ("blue", 1.5, Drape { width: 1.32, drop: 1.70, pleats: 7.0, phase: 4.0, drawn: 0.9 }),
    ];
    let rod = glb.mesh("rod", &[(&rod(building::BAY - 0.53, 0.018), materials.bronze)]);
    for ((name, bay, drape), material) in drapes.into_iter().zip(materials.drapes) {
        let foot = Vec3::new(bay * building::BAY, ROD, -building::ARCADE_AXIS);
        let [cloth, trim] = drape.meshes();
        let mesh = glb.mesh(&format!("drape_{name}"), &[(&cloth, material), (&trim, materials.trim)]);
        glb.node(&format!("drape_{name}"), mesh, foot);
        glb.node(&format!("rod_{name}"), rod, foot);
    }
}

fn add_statue(glb: &mut Glb, materials: &Materials) {
    let place = Vec3::new(1.0, 0.0, 0.0);
    let mut plinth = Mesh::default();
    let steps = [
        (0.72, 0.00, 0.12, 0.015),
        (0.58, 0.12, 0.24, 0.015),
        (0.46, 0.24, 0.34, 0.03),
        (0.40, 0.34, 0.84, 0.012),
        (0.46, 0.84, 0.90, 0.02),
        (0.50, 0.90, 0.97, 0.012),
    ];
    for (half, bottom, top, chamfer) in steps {
        let (lo, hi) = (Vec3::new(-half, bottom, -half), Vec3::new(half, top, half));
        // What overhangs the step below has an underside.
        plinth.chamfered_box(lo, hi, chamfer, bottom >= 0.84);
    }
    let plinth = glb.mesh("plinth", &[(&plinth, materials.marble)]);
    glb.node("plinth", plinth, place);
    let statue = glb.mesh("statue", &[(&statue::statue(), materials.statue)]);
    let node = glb.node("statue", statue, place + Vec3::Y * 0.97);
    glb.turn(node, PI + 0.45);
}

fn add_plants(glb: &mut Glb, materials: &Materials) {
    let (pot, soil) = (plants::pot(), plants::soil());
    for (seed, place, turn) in [
        (101, Vec3::new(-2.2, 0.0, -1.55), 0.0),
        (102, Vec3::new(1.95, 0.0, 1.50), 2.0),
        (103, Vec3::new(5.0, 0.0, -1.2), 4.0),
    ] {
        let leaves = plants::leaves(seed);
        let parts = [(&pot, materials.terracotta), (&soil, materials.soil), (&leaves, materials.leaf)];
        let plant = glb.mesh(&format!("plant_{seed}"), &parts);
        let node = glb.node(&format!("plant_{seed}"), plant, place);
        glb.turn(node, turn);
    }
}

fn add_bowl(glb: &mut Glb, materials: &Materials) {
    let place = Vec3::new(-1.15, 0.0, 1.2);
    let mut stand = Mesh::default();
    stand.chamfered_box(Vec3::new(-0.24, 0.0, -0.24), Vec3::new(0.24, 0.10, 0.24), 0.012, false);
    stand.append(
        &Profile::default()
            .half_round(0.17, 0.10, 0.16, 1.0)
            .straight(&[(0.17, 0.16), (0.15, 0.16)])
            .smooth([(0.15, 0.16), (0.115, 0.22), (0.10, 0.32), (0.105, 0.44), (0.12, 0.52)])
            .quarter_round(0.12, 0.52, 0.59, 0.08)
            .straight(&[(0.20, 0.59), (0.20, 0.63), (0.0, 0.63)])
            .lathe(32),
    );
    let stand = glb.mesh("stand", &[(&stand, materials.marble)]);
    glb.node("stand", stand, place);
    let outside = [(0.11, 0.03), (0.20, 0.07), (0.27, 0.13), (0.305, 0.20), (0.315, 0.27)];
    let inside = [(0.295, 0.27), (0.285, 0.20), (0.25, 0.14), (0.18, 0.085), (0.09, 0.055), (0.0, 0.048)];
    let bowl = Profile::default()
        .smooth([(0.12, 0.0), (0.115, 0.015), (0.11, 0.03)])
        .smooth(outside)
        .straight(&[(0.315, 0.27), (0.335, 0.28), (0.335, 0.295), (0.295, 0.295), (0.295, 0.27)])
        .smooth(inside)
        .lathe(56);
    let bowl = glb.mesh("bowl", &[(&bowl, materials.bronze)]);
    glb.node("bowl", bowl, place + Vec3::Y * 0.63);
}
