//! Wavefront OBJ with MTL to a scene.
//!
//! Polygons become fans of triangles, so they should be convex. Texture coordinates are turned to have v
//! downwards. Vertex colours, points, lines, curves and smoothing groups are left out; meshes without normals are flat.

mod check;
mod mtl;

use std::cell::RefCell;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use relume::glam::{Affine3A, Vec2, Vec3};
use relume::scene::Instance;
use relume::{Error, LightRig, Result, Scene};
use tobj::LoadOptions;

use crate::import::{Imported, read_file};
use crate::mesh_parts::{Built, MeshParts};
use mtl::Library;

const OPTIONS: LoadOptions =
    LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };

/// Reads an `.obj` file and the material libraries it names.
pub(crate) fn load(path: &Path) -> Result<Imported> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut warnings = Vec::new();
    let text = text_of(path)?;
    let text = check::prepare_obj(&text).map_err(|message| Error::file(path, message))?;

    // The parser takes its material loader as `Fn`; what it finds is collected beside it.
    let library = RefCell::new(Library::new(folder));
    let parsed = tobj::load_obj_buf(&mut text.as_bytes(), &OPTIONS, |file| library.borrow_mut().read(file));
    let (models, materials) = parsed
        .map_err(|error| Error::file(path, format!("cannot be read as OBJ: {error}; export it again")))?;
    let mut library = library.into_inner();
    let materials = materials.unwrap_or_default();
    let known: HashSet<&str> = materials.iter().map(|material| material.name.as_str()).collect();
    let used: BTreeSet<&str> =
        text.lines().filter_map(|line| line.strip_prefix("usemtl ")).map(str::trim).collect();
    for name in used.into_iter().filter(|name| !known.contains(name)) {
        warnings.push(format!("material `{name}` is in no material library that was found; it is grey"));
    }
    drop(text);
    let grey = models.iter().any(|model| model.mesh.material_id.is_none_or(|id| id >= materials.len()));
    let (materials, textures) = library.convert(&materials, grey)?;
    warnings.append(&mut library.warnings);

    let parts: Vec<(String, MeshParts)> = models
        .into_iter()
        .map(|model| {
            let material = model.mesh.material_id.filter(|id| *id + usize::from(grey) < materials.len());
            let material = material.unwrap_or(materials.len().saturating_sub(1));
            let normal_map = materials[material].normal_texture.map(|t| t.texture_from_mesh);
            let parts = MeshParts { material, normal_map, ..parts_of(&model, &mut warnings) };
            (model.name, parts)
        })
        .collect();
    let built: Vec<(String, Result<Built, String>)> =
        parts.into_par_iter().map(|(name, parts)| (name, parts.build())).collect();

    let mut scene = Scene { materials, textures, lights: LightRig::default(), ..Scene::default() };
    add_meshes(path, built, &mut scene, &mut warnings)?;
    Ok(Imported { scene, warnings })
}

/// One instance a mesh; meshes of one `o` or `g` with several materials follow each other and are one object.
fn add_meshes(
    path: &Path,
    built: Vec<(String, Result<Built, String>)>,
    scene: &mut Scene,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let mut object = 0_u32;
    let mut last: Option<String> = None;
    for (name, built) in built {
        let built = built.map_err(|message| Error::file(path, message))?;
        warnings.extend(built.warnings);
        let Some(mesh) = built.mesh else { continue };
        if last.as_ref().is_some_and(|last| *last != name) {
            object += 1;
        }
        scene.instances.push(Instance {
            name: name.clone(),
            mesh: scene.meshes.len(),
            world_from_object: Affine3A::IDENTITY,
            object,
        });
        scene.meshes.push(mesh);
        last = Some(name);
    }
    Ok(())
}

/// A text file; bytes that are not UTF-8 are replaced, since only names hold them.
fn text_of(path: &Path) -> Result<String> {
    let bytes = read_file(path)?;
    Ok(String::from_utf8(bytes)
        .unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned()))
}

fn parts_of(model: &tobj::Model, warnings: &mut Vec<String>) -> MeshParts {
    let mesh = &model.mesh;
    let place = format!("object `{}`", model.name);
    let positions: Vec<Vec3> =
        mesh.positions.as_chunks::<3>().0.iter().map(|&p| Vec3::from_array(p)).collect();
    let mut normals: Vec<Vec3> =
        mesh.normals.as_chunks::<3>().0.iter().map(|&n| Vec3::from_array(n)).collect();
    let mut uvs: Vec<Vec2> =
        mesh.texcoords.as_chunks::<2>().0.iter().map(|&[u, v]| Vec2::new(u, 1.0 - v)).collect();
    // The parser adds a corner's normal only where the corner has one, which leaves no way to tell whose it is.
    if !normals.is_empty() && normals.len() != positions.len() {
        warnings.push(format!("{place} has normals at some corners only; flat ones were computed for all"));
        normals.clear();
    }
    if !uvs.is_empty() && uvs.len() != positions.len() {
        warnings.push(format!("{place} has texture coordinates at some corners only; all were left out"));
        uvs.clear();
    }
    MeshParts {
        name: model.name.clone(),
        place,
        positions,
        normals,
        uvs,
        triangles: mesh.indices.as_chunks::<3>().0.to_vec(),
        ..MeshParts::default()
    }
}

/// A path as OBJ and MTL write them, on any system.
fn relative(folder: &Path, name: &str) -> PathBuf {
    folder.join(name.trim().replace('\\', "/"))
}
