//! Images and export files of single assets: portraits, contact sheets, OBJ and MJCF.

use std::path::Path;
use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{AssetSource, Families};
use genmanip_core::glam::DVec3;
use genmanip_core::{AssetUid, Camera, Intrinsics, ObjectModel, PhysicsFactors, Pose, limits};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, encode};

use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::task_files;

/// Vertical field of view of a portrait, rad: narrow, so that perspective hardly distorts shapes.
const PORTRAIT_FOV: f64 = 0.42;
/// Quality of JPEG images, 1-100; no artefacts are visible at labels.
const JPEG_QUALITY: u8 = 88;
/// Radius of an object's bounding sphere relative to the camera's distance in a portrait.
const PORTRAIT_FILL: f64 = 0.19;

/// Reads the families in the data files of a folder: `shapes.json`, `palettes.json` and every other `*.json`.
///
/// # Errors
/// When a file is missing, cannot be read or is invalid.
pub fn read_families(folder: &Path) -> Result<Families, WorkspaceError> {
    let mut files = Vec::new();
    for path in task_files::expand(&[folder.to_owned()])? {
        files.push((documents::stem(&path), documents::read_text(&path, limits::FAMILIES)?));
    }
    let named = |name: &str| {
        let found = files.iter().find(|(stem, _)| stem == name).map(|(_, text)| text.clone());
        found.ok_or_else(|| WorkspaceError::input(format!("no {name}.json in {}", folder.display())))
    };
    let (shapes, palettes) = (named("shapes")?, named("palettes")?);
    let families: Vec<(&str, &str)> = files
        .iter()
        .filter(|(stem, _)| stem != "shapes" && stem != "palettes")
        .map(|(stem, text)| (stem.as_str(), text.as_str()))
        .collect();
    Families::from_json(&families, &shapes, &palettes).map_err(|error| {
        WorkspaceError::input(format!("the families in {} cannot be used", folder.display())).because(error)
    })
}

/// Portrait of one object on the table, seen from the robot's side: a square image of `pixels` × `pixels`, 8-bit RGB
/// row by row. `joints` are the positions of the object's joints, rad or m.
///
/// # Errors
/// When the object cannot be rendered.
pub fn portrait(model: &Arc<ObjectModel>, joints: &[f64], pixels: u32) -> Result<Vec<u8>, WorkspaceError> {
    // Fronts of articulated objects face the robot; handles of cups point away from it, and labels face its right.
    let direction = if model.card.is_articulated { [-0.8, -0.42, 0.62] } else { [-0.36, -0.82, 0.62] };
    portrait_from(model, &Pose::from_position(DVec3::new(0.5, 0.0, 0.0)), joints, DVec3::from_array(direction), pixels)
}

/// [`portrait`] of an object at a pose in the world; `direction` leads from the object to the camera.
///
/// # Errors
/// As [`portrait`].
pub fn portrait_from(
    model: &Arc<ObjectModel>,
    pose: &Pose,
    joints: &[f64],
    direction: DVec3,
    pixels: u32,
) -> Result<Vec<u8>, WorkspaceError> {
    let broken = |error| WorkspaceError::broken(format!("cannot draw object {}", model.card.uid), error);
    let bounds = model.world_bounds(pose, joints);
    let radius = bounds.size().length() / 2.0;
    let eye = bounds.center() + direction.normalize() * (radius / PORTRAIT_FILL);
    // Rendered at twice the size and then reduced, for smoother edges.
    let intrinsics = Intrinsics::from_vertical_fov(2 * pixels, 2 * pixels, PORTRAIT_FOV);
    let camera = Camera::looking_at("portrait", eye, bounds.center(), intrinsics);
    let assets = RenderAssets::without_robot(&[Arc::clone(model)], Some(&default_world())).map_err(broken)?;
    let frame = assets.frame_state(&[], 0.0, [(*pose, joints)]).map_err(broken)?;
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(&frame, &camera, Channels::RGB);
    Renderer::new(assets, RenderVariation::default()).render(&[job], &mut out).map_err(broken)?;
    let [out] = out;
    encode::resize_rgb([2 * pixels; 2], &out.rgb, [pixels; 2]).map_err(|error| {
        WorkspaceError::broken(format!("cannot resize the portrait of object {}", model.card.uid), error)
    })
}

/// Portraits in a grid, row by row, as one image: JPEG if the path ends in .jpg or .jpeg, else PNG. `cell` is the size
/// of a portrait, pixels.
///
/// # Errors
/// As [`portrait`].
pub fn sheet(
    models: &[Arc<ObjectModel>],
    columns: usize,
    cell: u32,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Vec<u8>, WorkspaceError> {
    progress.begin("drawing", models.len());
    let mut pictures = Vec::new();
    for model in models {
        pictures.push(portrait(model, &vec![0.0; model.joint_count()], cell)?);
        progress.advance();
    }
    progress.end();
    tiled(&pictures, columns, cell, path)
}

/// Square images of `cell` × `cell` pixels in a grid, row by row, as one image: JPEG if the path ends in .jpg or .jpeg,
/// else PNG.
///
/// # Errors
/// When the image cannot be encoded.
pub fn tiled(pictures: &[Vec<u8>], columns: usize, cell: u32, path: &Path) -> Result<Vec<u8>, WorkspaceError> {
    let columns = columns.clamp(1, pictures.len().max(1));
    let rows = pictures.len().div_ceil(columns);
    let (width, height) = (columns * cell as usize, rows * cell as usize);
    let mut sheet = vec![255; width * height * 3];
    for (index, picture) in pictures.iter().enumerate() {
        let (left, top) = (index % columns * cell as usize, index / columns * cell as usize);
        for (row, pixels) in picture.chunks_exact(cell as usize * 3).enumerate() {
            let start = ((top + row) * width + left) * 3;
            sheet[start..start + pixels.len()].copy_from_slice(pixels);
        }
    }
    let is_jpeg = path.extension().is_some_and(|ending| ending == "jpg" || ending == "jpeg");
    let (width, height) = (width as u32, height as u32);
    let encoded = if is_jpeg {
        encode::jpeg_rgb(width, height, &sheet, JPEG_QUALITY)
    } else {
        encode::png_rgb(width, height, &sheet)
    };
    encoded.map_err(|error| WorkspaceError::broken("the picture cannot be encoded", error))
}

/// Model of an object in a catalogue.
///
/// # Errors
/// When the catalogue has no object with this uid.
pub fn model(catalogue: &genmanip_assets::Catalogue, uid: &AssetUid) -> Result<Arc<ObjectModel>, WorkspaceError> {
    catalogue.build(uid).map_err(|error| {
        WorkspaceError::input(format!("no object {uid}"))
            .because(error)
            .with_hint("`genmanip assets list --catalog full` names them all")
    })
}

/// Texts of a Wavefront OBJ file and of its material file, whose name is `mtl`. Joints are at 0; units are metres, z is
/// up.
pub fn obj(model: &ObjectModel, mtl: &str) -> (String, String) {
    let (mut text, mut materials) = (format!("# {}\nmtllib {mtl}\n", model.card.name), String::new());
    let mut offset = 1;
    for (link, pose) in model.links.iter().zip(model.link_poses(&vec![0.0; model.joint_count()])) {
        for (index, part) in link.visual.iter().enumerate() {
            let name = format!("{}_{}_{index}", link.name, part.name).replace(' ', "_");
            let object_from_part = pose * part.link_from_part;
            let mean = |texture: &genmanip_core::Texture| {
                let pixels = (texture.rgb.len() / 3).max(1) as f32 * 255.0;
                [0, 1, 2].map(|i| texture.rgb.iter().skip(i).step_by(3).map(|&v| f32::from(v)).sum::<f32>() / pixels)
            };
            let [r, g, b] = part.material.texture.as_deref().map_or(part.material.base_color, mean);
            let opacity = part.material.opacity;
            materials += &format!("newmtl {name}\nKd {r:.4} {g:.4} {b:.4}\nd {opacity:.3}\n\n");
            text += &format!("o {name}\nusemtl {name}\n");
            for position in &part.render_mesh.positions {
                let p = object_from_part.transform_point(position.as_dvec3());
                text += &format!("v {:.6} {:.6} {:.6}\n", p.x, p.y, p.z);
            }
            for uv in &part.render_mesh.uvs {
                text += &format!("vt {:.5} {:.5}\n", uv.x, 1.0 - uv.y);
            }
            for normal in &part.render_mesh.normals {
                let n = object_from_part.transform_vector(normal.as_dvec3());
                text += &format!("vn {:.4} {:.4} {:.4}\n", n.x, n.y, n.z);
            }
            for triangle in &part.render_mesh.triangles {
                let [a, b, c] = triangle.map(|index| index + offset);
                text += &format!("f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n");
            }
            offset += part.render_mesh.positions.len() as u32;
        }
    }
    (text, materials)
}

/// MJCF of a simulator scene that contains only this object.
///
/// # Errors
/// When the simulator cannot build the scene.
pub fn mjcf(model: &Arc<ObjectModel>) -> Result<String, WorkspaceError> {
    let object = genmanip_sim::SceneObject {
        name: model.card.uid.to_string(),
        model: Arc::clone(model),
        pose: Pose::from_position(DVec3::new(0.5, 0.0, 0.0)),
        joint_positions: vec![0.0; model.joint_count()],
        physics: PhysicsFactors::default(),
    };
    let scene = genmanip_sim::Model::compile_without_robot(&default_world(), &[object]);
    let scene = scene.map_err(|error| WorkspaceError::broken("the simulator refuses the object", error))?;
    Ok(scene.mjcf().to_owned())
}

/// Hashes of an object in a catalogue.
///
/// # Errors
/// As [`model`].
pub fn hashes(
    catalogue: &genmanip_assets::Catalogue,
    model: &ObjectModel,
) -> Result<genmanip_core::AssetHashes, WorkspaceError> {
    catalogue.hashes(&model.asset).map_err(|error| WorkspaceError::input("no such object").because(error))
}
