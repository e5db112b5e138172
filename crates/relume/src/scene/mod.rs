//! Geometry, materials, textures, cameras, lights and rigs: plain data.
//!
//! Metres, Y up, right-handed; scene-linear Rec. 709; radiant units (see `docs/ARCHITECTURE.md`).

mod camera;
mod environment;
mod geometry;
mod light;
mod material;
mod named;
mod placement;
mod suns;
mod temperature;
mod texture;

pub use camera::Camera;
pub use environment::{EnvironmentMap, EnvironmentSample};
pub use geometry::Geometry;
pub use light::{Light, LightKind, LightRig};
pub use material::{AlphaMode, Interior, Material, TextureRef};
pub use named::{Emitter, MaterialEdit, NamedFault, NamedList};
pub use placement::SeenPoint;
pub use suns::{Sun, WithoutSuns};
pub use temperature::{TEMPERATURES, black_body_color, nearest_temperature};
pub use texture::{ColorSpace, Texture, Wrap};

use glam::{Affine3A, Vec2, Vec3, Vec4};

/// Triangles that share one material, in object space.
///
/// `normals` has one entry a vertex; `uvs` and `tangents` have one a vertex or are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// The name in the file.
    pub name: String,
    /// Metres, object space.
    pub positions: Vec<Vec3>,
    /// Unit shading normals.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, glTF convention: (0, 0) is the top left of the image.
    pub uvs: Vec<Vec2>,
    /// Unit tangents with the bitangent's sign in `w`.
    pub tangents: Vec<Vec4>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// One placement of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// The node's name in the file.
    pub name: String,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Any invertible transform; mirrored ones turn the winding round.
    pub world_from_object: Affine3A,
    /// Instances of one node share an object number: the object id of view samples.
    pub object: u32,
}

/// A scene as it was read: meshes, where they stand, what they are made of, and who looks at them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Meshes in object space.
    pub meshes: Vec<Mesh>,
    /// Where meshes stand.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Textures.
    pub textures: Vec<Texture>,
    /// Cameras; an importer makes one where the file has none.
    pub cameras: Vec<Camera>,
    /// Lights stored in the file.
    pub lights: LightRig,
}

impl Scene {
    /// Number of the camera that is called so or, where none is, has this number. The first where none is asked for.
    ///
    /// # Errors
    /// A sentence without its beginning, the file, that lists the cameras there are.
    pub fn find_camera(&self, wanted: Option<&str>) -> Result<usize, String> {
        let Some(wanted) = wanted else { return Ok(0) };
        let by_name = self.cameras.iter().position(|camera| camera.name == wanted);
        let by_number = || wanted.parse().ok().filter(|&number: &usize| number < self.cameras.len());
        by_name.or_else(by_number).ok_or_else(|| {
            let named = |(number, camera): (usize, &Camera)| format!("{number} `{}`", camera.name);
            let names: Vec<String> = self.cameras.iter().enumerate().map(named).collect();
            format!("has no camera `{wanted}`; it has {}", names.join(", "))
        })
    }

    /// Which materials are clear, by number: those that let through at least half of the light that meets them, over their texture in the
    /// mean, and do not shine: what shines must be found by light that is gathered. Rays other than those that start at the camera pass their surfaces as if these were not there.
    pub fn clear_materials(&self) -> Vec<bool> {
        let part = |material: &Material| {
            let texture = material.transmission_texture.map(|reference| &self.textures[reference.texture]);
            material.transmission * (1.0 - material.metallic) * texture.map_or(1.0, Texture::mean_red)
        };
        let is_clear = |material: &Material| {
            material.transmission > 0.0 && material.emission == Vec3::ZERO && part(material) >= 0.5
        };
        self.materials.iter().map(is_clear).collect()
    }

    /// The materials by their names, and whether they emit light.
    pub fn named_materials(&self) -> impl Iterator<Item = (&str, bool)> + Clone {
        self.materials.iter().map(|material| (material.name.as_str(), material.emission != Vec3::ZERO))
    }
}
