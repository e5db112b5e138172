//! One primitive of a glTF mesh to one mesh of the scene.

use ::gltf::Semantic;
use ::gltf::json::Index;
use ::gltf::json::mesh::{Mode, Primitive};
use ::gltf::json::validation::Checked;
use relume::glam::{Vec2, Vec3, Vec4};

use super::accessor::Accessor;
use super::document::Document;
use super::material::Coordinates;
use crate::mesh_parts::{Built, MeshParts};

/// The most vertices and indices all primitives of a file may have together.
pub(super) const MOST_ELEMENTS: u64 = 1 << 29;

/// Vertices and indices that `primitive` asks for, before anything is read.
pub(super) fn element_count(document: &Document<'_>, primitive: &Primitive) -> u64 {
    let count = |index: usize| document.root.accessors.get(index).map_or(0, |accessor| accessor.count.0);
    let vertices = accessor_of(primitive, &Semantic::Positions).map_or(0, count);
    vertices.saturating_add(primitive.indices.map_or(0, |index| count(index.value())))
}

fn accessor_of(primitive: &Primitive, semantic: &Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic.clone())).map(|index| index.value())
}

/// Reads, checks and completes a primitive. Points and lines give a warning and no mesh.
pub(super) fn convert(
    document: &Document<'_>,
    (mesh_index, primitive_index): (usize, usize),
    material: usize,
    coordinates: Coordinates,
) -> Result<Built, String> {
    let mesh = &document.root.meshes[mesh_index];
    let primitive = &mesh.primitives[primitive_index];
    let label = super::label(Index::<()>::new(mesh_index as u32), mesh.name.as_ref());
    let place = format!("mesh {label}, primitive {primitive_index}");
    let Some(mode) = triangle_mode(primitive) else {
        let warnings = vec![format!("{place} has points or lines, which are left out")];
        return Ok(Built { mesh: None, warnings });
    };

    let (mut parts, mut warnings) = read_attributes(document, primitive, coordinates, &place)?;
    let corners = match primitive.indices {
        Some(index) => Accessor::new(document, index.value())
            .and_then(|accessor| accessor.indices())
            .map_err(|message| format!("{place}, indices: {message}; export the mesh again"))?,
        None => (0..u32::try_from(parts.positions.len()).unwrap_or(u32::MAX)).collect(),
    };
    if mode == Mode::Triangles && corners.len() % 3 != 0 {
        warnings.push(format!(
            "{place}: the last {} indices make no triangle and were left out",
            corners.len() % 3
        ));
    }
    parts.triangles = triangles(mode, &corners);
    parts.name = mesh.name.clone().unwrap_or_else(|| format!("mesh {mesh_index}"));
    parts.place = place;
    parts.material = material;
    parts.normal_map = coordinates.normal_map;
    let mut built = parts.build()?;
    warnings.append(&mut built.warnings);
    Ok(Built { mesh: built.mesh, warnings })
}

fn triangle_mode(primitive: &Primitive) -> Option<Mode> {
    match primitive.mode {
        Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => Some(mode),
        _ => None,
    }
}

fn read_attributes(
    document: &Document<'_>,
    primitive: &Primitive,
    coordinates: Coordinates,
    place: &str,
) -> Result<(MeshParts, Vec<String>), String> {
    let positions = attribute::<3>(document, primitive, &Semantic::Positions, place)?
        .ok_or_else(|| format!("{place} has no positions; export the mesh again"))?;
    let mut parts = MeshParts {
        positions: positions.into_iter().map(Vec3::from_array).collect(),
        ..MeshParts::default()
    };
    let count = parts.positions.len();
    if let Some(normals) = attribute::<3>(document, primitive, &Semantic::Normals, place)? {
        parts.normals = normals.into_iter().map(Vec3::from_array).collect();
        same_count(place, "NORMAL", parts.normals.len(), count)?;
    }
    let mut warnings = Vec::new();
    if coordinates.textured {
        let semantic = Semantic::TexCoords(coordinates.set);
        match attribute::<2>(document, primitive, &semantic, place)? {
            Some(uvs) => parts.uvs = uvs.into_iter().map(Vec2::from_array).collect(),
            None => warnings.push(format!(
                "{place} has no TEXCOORD_{}, which its material reads; the textures' corner texel is used",
                coordinates.set
            )),
        }
        if !parts.uvs.is_empty() {
            same_count(place, "TEXCOORD", parts.uvs.len(), count)?;
        }
    }
    if coordinates.normal_map.is_some()
        && let Some(tangents) = attribute::<4>(document, primitive, &Semantic::Tangents, place)?
    {
        parts.tangents = tangents.into_iter().map(Vec4::from_array).collect();
        same_count(place, "TANGENT", parts.tangents.len(), count)?;
    }
    if accessor_of(primitive, &Semantic::Colors(0)).is_some() {
        warnings.push(format!("{place} has vertex colours, which are left out"));
    }
    Ok((parts, warnings))
}

/// An attribute that is present but has no elements is an error too, not an attribute that is missing.
fn same_count(place: &str, name: &str, has: usize, positions: usize) -> Result<(), String> {
    if has == positions {
        return Ok(());
    }
    Err(format!("{place} has {has} values of {name} for {positions} positions; export the mesh again"))
}

fn attribute<const N: usize>(
    document: &Document<'_>,
    primitive: &Primitive,
    semantic: &Semantic,
    place: &str,
) -> Result<Option<Vec<[f32; N]>>, String> {
    accessor_of(primitive, semantic)
        .map(|index| Accessor::new(document, index)?.vectors::<N>())
        .transpose()
        .map_err(|message| format!("{place}, {}: {message}; export the mesh again", semantic.to_string()))
}

/// Triangles of a list, a strip or a fan, as section 3.7.2.1 of the specification orders their corners.
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => corners
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
            .collect(),
        Mode::TriangleFan => match corners {
            [center, rim @ ..] => rim.windows(2).map(|w| [w[0], w[1], *center]).collect(),
            [] => Vec::new(),
        },
        _ => corners.as_chunks::<3>().0.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_the_winding() {
        let strip = triangles(Mode::TriangleStrip, &[0, 1, 2, 3, 4]);
        assert_eq!(strip, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        let fan = triangles(Mode::TriangleFan, &[7, 1, 2, 3]);
        assert_eq!(fan, [[1, 2, 7], [2, 3, 7]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3]), [[0, 1, 2]]);
        assert!(triangles(Mode::TriangleFan, &[]).is_empty());
        assert!(triangles(Mode::TriangleStrip, &[0, 1]).is_empty());
    }
}
