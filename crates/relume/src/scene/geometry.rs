use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec4};

use super::Scene;

/// All instances of a scene as one list of world-space triangles.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Metres, world space.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, world space, one a vertex.
    pub normals: Vec<Vec3>,
    /// One a vertex; zero where the mesh has none.
    pub uvs: Vec<Vec2>,
    /// World space, one a vertex; zero where the mesh has none.
    pub tangents: Vec<Vec4>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`], one a triangle.
    pub materials: Vec<u32>,
    /// Object number, one a triangle.
    pub objects: Vec<u32>,
    /// How many triangles are of clear materials ([`Scene::clear_materials`]): the last ones.
    pub clear: usize,
}

impl Geometry {
    /// Flattens `scene`: positions by the transform, normals by its inverse transpose, winding kept
    /// counter-clockwise under mirrored transforms.
    pub fn new(scene: &Scene) -> Self {
        let mut geometry = Self::default();
        let (clear, mut opaque) = (scene.clear_materials(), 0);
        for clear_ones in [false, true] {
            for instance in &scene.instances {
                if clear[scene.meshes[instance.mesh].material] == clear_ones {
                    geometry.add_instance(scene, instance.mesh, instance.object, &instance.world_from_object);
                }
            }
            if !clear_ones {
                opaque = geometry.triangles.len();
            }
        }
        geometry.clear = geometry.triangles.len() - opaque;
        geometry
    }

    /// The geometry that rays meet which do not start at the camera, where it is another: all but clear surfaces. Its triangles keep their
    /// numbers.
    pub fn without_clear(&self) -> Option<Self> {
        let count = self.triangles.len().saturating_sub(self.clear);
        (self.clear > 0).then(|| {
            let mut opaque = Self { clear: 0, ..self.clone() };
            opaque.triangles.truncate(count);
            opaque.materials.truncate(count);
            opaque.objects.truncate(count);
            opaque
        })
    }

    fn add_instance(&mut self, scene: &Scene, mesh: usize, object: u32, world_from_object: &Affine3A) {
        let mesh = &scene.meshes[mesh];
        let base = self.positions.len() as u32;
        let mirrored = world_from_object.matrix3.determinant() < 0.0;
        let normal_from_object: Mat3A = world_from_object.matrix3.inverse().transpose();
        let count = mesh.positions.len();
        self.positions.extend(mesh.positions.iter().map(|&p| world_from_object.transform_point3(p)));
        self.normals.extend(mesh.normals.iter().map(|&n| (normal_from_object * n).normalize_or_zero()));
        if mesh.uvs.is_empty() {
            self.uvs.resize(self.uvs.len() + count, Vec2::ZERO);
        } else {
            self.uvs.extend_from_slice(&mesh.uvs);
        }
        if mesh.tangents.is_empty() {
            self.tangents.resize(self.tangents.len() + count, Vec4::ZERO);
        } else {
            let sign = if mirrored { -1.0 } else { 1.0 };
            self.tangents.extend(mesh.tangents.iter().map(|&t| {
                let tangent = world_from_object.transform_vector3(t.truncate());
                tangent.normalize_or_zero().extend(t.w * sign)
            }));
        }
        self.triangles.extend(mesh.triangles.iter().map(|&[a, b, c]| {
            let (b, c) = if mirrored { (c, b) } else { (b, c) };
            [a + base, b + base, c + base]
        }));
        let triangles = self.triangles.len();
        self.materials.resize(triangles, mesh.material as u32);
        self.objects.resize(triangles, object);
    }

    /// The corners of a triangle, world space.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize])
    }

    /// Twice the area times the unit normal of a triangle's front.
    pub fn area_vector(&self, triangle: usize) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Smallest and largest corner of all positions; `None` for an empty scene.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p))))
    }
}
