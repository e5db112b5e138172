use glam::{Vec2, Vec3};

use crate::scene::{Geometry, Interior, Material, Scene, TextureRef};
use crate::trace::Hit;

/// Perceptual roughness below this is raised to it: the lobe of a smoother surface is too narrow for f32, and
/// for any renderer that samples lights and lobes.
pub const MIN_ROUGHNESS: f32 = 0.03;

/// Least cosine between a shading normal and the view.
const MIN_COS_VIEW: f32 = 0.01;

/// A point on a surface: what shading needs to know of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Metres, world space.
    pub position: Vec3,
    /// Unit normal of the triangle, on the side that is looked at.
    pub geometric_normal: Vec3,
    /// Unit normal to shade by, interpolated and normal-mapped, on the side that is looked at.
    pub shading_normal: Vec3,
    /// Base colour times `1 - metallic`, textures applied, before the specular lobe takes its share:
    /// [`Self::diffuse`] is what the diffuse lobe reflects.
    pub diffuse_albedo: Vec3,
    /// What [`Self::diffuse_albedo`] would be were [`Material::base_color`] white: textures and `1 - metallic` alone.
    pub white_albedo: Vec3,
    /// Specular reflectance along the normal: the dielectric's, mixed to the base colour by metallic.
    pub specular_f0: Vec3,
    /// Specular reflectance at grazing angles; 1 but for [`Material::specular`].
    pub specular_f90: f32,
    /// [`Material::specular`]: scales how much the dielectric's specular lobe takes from the diffuse one.
    pub dielectric_specular: f32,
    /// Reflectance of the dielectric along the normal, before that scale: 0.04 at the usual refractive index of 1.5.
    pub dielectric_f0: f32,
    /// The part of the light it does not reflect that passes the surface: [`Material::transmission`] of the dielectric part.
    pub passing: f32,
    /// What passes of each colour: that, tinted by the base colour.
    pub transmission: Vec3,
    /// What a transmitting surface bounds.
    pub interior: Interior,
    /// Refractive index of the dielectric.
    pub ior: f32,
    /// How fast the interpolated normal turns along the surface, radians a metre; 0 where it is neither polished nor transmits.
    pub curvature: f32,
    /// Perceptual roughness, [`MIN_ROUGHNESS`]`..=1`; GGX's alpha is its square.
    pub roughness: f32,
    /// Emitted radiance, W/(sr m^2).
    pub emission: Vec3,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Object number.
    pub object: u32,
    /// Whether the triangle's front is looked at.
    pub front: bool,
    /// False at the back of a one-sided surface that transmits nothing. It blocks light but neither reflects nor emits: albedo,
    /// specular and emission are then zero.
    pub lit: bool,
}

/// The surface that a ray along `ray_direction` (any length) hit, turned to where the ray came from.
///
/// A shading normal that points away from the viewer, as normal maps and interpolation make them near
/// silhouettes, is turned by the smallest angle that brings it just into view (cosine 0.01), so that shading
/// changes continuously.
///
/// # Panics
/// If `hit` is a miss or of another geometry.
pub fn surface_at(scene: &Scene, geometry: &Geometry, hit: &Hit, ray_direction: Vec3) -> Surface {
    let front = geometry.area_vector(hit.triangle as usize).dot(ray_direction) <= 0.0;
    let mut surface = surface_on_triangle(scene, geometry, hit.triangle, hit.u, hit.v, front);
    let view = -ray_direction.normalize_or(-surface.geometric_normal);
    surface.shading_normal = turned_into_view(surface.shading_normal, view);
    surface
}

/// The point with barycentric weights `u` and `v` of the second and third corner of `triangle`, seen from its
/// front or its back.
///
/// # Panics
/// If the scene has no such triangle.
pub fn surface_on_triangle(
    scene: &Scene,
    geometry: &Geometry,
    triangle: u32,
    u: f32,
    v: f32,
    front: bool,
) -> Surface {
    let point = TrianglePoint::new(geometry, triangle as usize, u, v);
    let material_id = geometry.materials[triangle as usize];
    let material = &scene.materials[material_id as usize];
    let side = if front { 1.0 } else { -1.0 };
    let mut surface = Surface {
        position: point.interpolate(point.corners),
        geometric_normal: side * point.geometric_normal,
        shading_normal: side * point.shading_normal(scene, geometry, material),
        interior: material.interior,
        ior: material.ior,
        material: material_id,
        object: geometry.objects[triangle as usize],
        front,
        lit: front || material.shows_back(),
        ..Surface::BLACK
    };
    if surface.lit {
        surface.apply_material(scene, material, point.uv(geometry));
        if !front && !material.double_sided {
            surface.emission = Vec3::ZERO;
        }
        if surface.is_polished() || surface.transmission != Vec3::ZERO {
            surface.curvature = point.curvature(geometry);
        }
    }
    surface
}

fn texture_rgb(scene: &Scene, texture: Option<TextureRef>, uv: Vec2) -> Vec3 {
    texture.map_or(Vec3::ONE, |texture| scene.textures[texture.texture].sample(texture.uv(uv)).truncate())
}

fn turned_into_view(normal: Vec3, view: Vec3) -> Vec3 {
    let cos = normal.dot(view);
    if cos >= MIN_COS_VIEW { normal } else { (normal + (MIN_COS_VIEW - cos) * view).normalize_or(view) }
}

impl Surface {
    /// At the origin, facing +Y, reflecting nothing.
    pub const BLACK: Self = Self {
        position: Vec3::ZERO,
        geometric_normal: Vec3::Y,
        shading_normal: Vec3::Y,
        diffuse_albedo: Vec3::ZERO,
        white_albedo: Vec3::ZERO,
        specular_f0: Vec3::ZERO,
        specular_f90: 0.0,
        dielectric_specular: 0.0,
        dielectric_f0: 0.0,
        passing: 0.0,
        transmission: Vec3::ZERO,
        interior: Interior::Thin,
        ior: 1.0,
        curvature: 0.0,
        roughness: 1.0,
        emission: Vec3::ZERO,
        material: 0,
        object: 0,
        front: true,
        lit: false,
    };

    /// The surface with this base colour factor, linear RGB, in place of its material's, in its diffuse lobe alone: the specular one
    /// stays as it is, that of metals too.
    #[must_use]
    pub fn with_base_color(&self, base_color: Vec3) -> Self {
        Self { diffuse_albedo: self.white_albedo * base_color, ..*self }
    }

    fn apply_material(&mut self, scene: &Scene, material: &Material, uv: Vec2) {
        let texel = texture_rgb(scene, material.base_color_texture, uv);
        let base_color = material.base_color.truncate() * texel;
        let factors = texture_rgb(scene, material.metallic_roughness_texture, uv);
        let metallic = (material.metallic * factors.z).clamp(0.0, 1.0);
        let specular = material.specular.clamp(0.0, 1.0);
        let passes = match material.transmission {
            0.0 => 0.0,
            passes => passes * texture_rgb(scene, material.transmission_texture, uv).x,
        };
        self.diffuse_albedo = base_color * ((1.0 - metallic) * (1.0 - passes));
        self.white_albedo = texel * ((1.0 - metallic) * (1.0 - passes));
        self.passing = (1.0 - metallic) * passes;
        self.transmission = base_color * self.passing;
        self.dielectric_f0 = ((self.ior - 1.0) / (self.ior + 1.0)).powi(2);
        self.specular_f0 = Vec3::splat(self.dielectric_f0 * specular).lerp(base_color, metallic);
        self.specular_f90 = specular + (1.0 - specular) * metallic;
        self.dielectric_specular = specular;
        self.roughness = (material.roughness * factors.y).clamp(MIN_ROUGHNESS, 1.0);
        if material.emission != Vec3::ZERO {
            self.emission = material.emission * texture_rgb(scene, material.emission_texture, uv);
        }
    }
}

/// A point on a triangle's front.
struct TrianglePoint {
    vertices: [usize; 3],
    corners: [Vec3; 3],
    weights: [f32; 3],
    geometric_normal: Vec3,
}

impl TrianglePoint {
    fn new(geometry: &Geometry, triangle: usize, u: f32, v: f32) -> Self {
        let corners = geometry.corners(triangle);
        let [a, b, c] = corners;
        Self {
            vertices: geometry.triangles[triangle].map(|vertex| vertex as usize),
            corners,
            weights: [1.0 - u - v, u, v],
            // a triangle without area is never hit; any normal serves
            geometric_normal: (b - a).cross(c - a).normalize_or(Vec3::Y),
        }
    }

    fn interpolate(&self, [a, b, c]: [Vec3; 3]) -> Vec3 {
        a * self.weights[0] + b * self.weights[1] + c * self.weights[2]
    }

    fn uv(&self, geometry: &Geometry) -> Vec2 {
        let [a, b, c] = self.vertices.map(|vertex| geometry.uvs[vertex]);
        a * self.weights[0] + b * self.weights[1] + c * self.weights[2]
    }

    /// The fastest turn of the interpolated normal along an edge, radians a metre.
    fn curvature(&self, geometry: &Geometry) -> f32 {
        let normals = self.vertices.map(|vertex| geometry.normals[vertex]);
        let along = |(from, to): (usize, usize)| {
            let length = self.corners[from].distance(self.corners[to]);
            normals[from].distance(normals[to]) / length.max(f32::MIN_POSITIVE)
        };
        [(0, 1), (1, 2), (2, 0)].into_iter().map(along).fold(0.0, f32::max)
    }

    /// Interpolated normal, on the front whatever the file's winding says, with the normal map applied.
    fn shading_normal(&self, scene: &Scene, geometry: &Geometry, material: &Material) -> Vec3 {
        let smooth = self.interpolate(self.vertices.map(|vertex| geometry.normals[vertex]));
        let smooth = smooth.normalize_or(self.geometric_normal);
        let smooth = if smooth.dot(self.geometric_normal) < 0.0 { -smooth } else { smooth };
        let Some(map) = material.normal_texture else { return smooth };
        let Some((tangent, bitangent)) = self.tangent_frame(geometry, &map, smooth) else { return smooth };
        let texel = scene.textures[map.texture].sample(map.uv(self.uv(geometry))).truncate();
        let local = texel * 2.0 - Vec3::ONE;
        let (x, y) = (local.x * material.normal_scale, local.y * material.normal_scale);
        (tangent * x + bitangent * y + smooth * local.z).normalize_or(smooth)
    }

    /// Unit vectors to the right and up in the normal map: the mesh's tangents, or where it has none the
    /// texture coordinates' gradients; `None` where those vanish too.
    fn tangent_frame(&self, geometry: &Geometry, map: &TextureRef, normal: Vec3) -> Option<(Vec3, Vec3)> {
        let corner_tangents = self.vertices.map(|vertex| geometry.tangents[vertex]);
        let tangent = self.interpolate(corner_tangents.map(|tangent| tangent.truncate()));
        let tangent = tangent.reject_from_normalized(normal).normalize_or_zero();
        if tangent != Vec3::ZERO {
            return Some((tangent, normal.cross(tangent) * corner_tangents[0].w));
        }
        let [a, b, c] = self.corners;
        let [uv_a, uv_b, uv_c] = self.vertices.map(|vertex| map.uv(geometry.uvs[vertex]));
        let (edge1, edge2, uv1, uv2) = (b - a, c - a, uv_b - uv_a, uv_c - uv_a);
        let orientation = uv1.perp_dot(uv2).signum();
        let along_u = (edge1 * uv2.y - edge2 * uv1.y) * orientation;
        let tangent = along_u.reject_from_normalized(normal).normalize_or_zero();
        // v runs down the image, and up is against it
        let mirrored = -orientation;
        (tangent != Vec3::ZERO).then(|| (tangent, normal.cross(tangent) * mirrored))
    }
}

#[cfg(test)]
#[path = "surface_tests.rs"]
mod tests;
