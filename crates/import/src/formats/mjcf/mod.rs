//! MJCF as written by robosuite, RoboCasa, MolmoSpaces, MetaWorld and gymnasium-robotics: bodies with visual and
//! collision geoms, joints and masses; includes, defaults, meshes and textures. Actuators, sensors and equality
//! constraints are ignored.

mod assets;
mod bodies;
mod settings;

use crate::ImportError;
use crate::files::{Files, beside};
use crate::formats::xml::{self, Element};
use crate::raw::{RawObject, Unit, Up};

/// Maximum nesting depth of includes, and maximum number of included files.
const MAX_DEPTH: usize = 16;
const MAX_INCLUDED: usize = 200;

/// Reads an MJCF file as one object, ignoring floors.
///
/// # Errors
/// With file and line of an unknown class, mesh or material, an invalid number or a missing file.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut included = 0;
    let root = with_includes(path, path, files, 0, &mut included)?;
    if root.tag != "mujoco" {
        return Err(root.wrong("expected <mujoco>; an include file is not a complete object"));
    }
    let settings = settings::Settings::of(&root)?;
    let mut notes = Vec::new();
    let assets = assets::Assets::of(&root, path, &settings);
    let links = bodies::links(&root, path, &settings, &assets, files, &mut notes)?;
    Ok(RawObject {
        name: root.attribute("model").unwrap_or_default().to_owned(),
        links,
        unit: Unit::Metre,
        up: Up::Z,
        licence: None,
        creator: None,
        notes,
    })
}

/// Parses a file and expands its includes; names are relative to the main file or, in older files, to the including
/// file.
fn with_includes(
    main: &str,
    path: &str,
    files: &mut Files<'_>,
    depth: usize,
    included: &mut usize,
) -> Result<Element, ImportError> {
    let mut root = xml::parse(path, files)?;
    if depth > MAX_DEPTH || *included > MAX_INCLUDED {
        return Err(root.wrong(format!(
            "more than {MAX_INCLUDED} included files, or deeper than {MAX_DEPTH}: do files include each other?"
        )));
    }
    expand(&mut root, main, path, files, depth, included)?;
    Ok(root)
}

fn expand(
    element: &mut Element,
    main: &str,
    path: &str,
    files: &mut Files<'_>,
    depth: usize,
    included: &mut usize,
) -> Result<(), ImportError> {
    let mut children = Vec::new();
    for mut child in std::mem::take(&mut element.children) {
        if child.tag != "include" {
            expand(&mut child, main, path, files, depth, included)?;
            children.push(child);
            continue;
        }
        let named = child.attribute("file").ok_or_else(|| child.wrong("expected a file"))?;
        *included += 1;
        let from_main = beside(main, named)?;
        let found = match with_includes(main, &from_main, files, depth + 1, included) {
            Err(error) if error.file == from_main && path != main => {
                let from_here = beside(path, named)?;
                with_includes(main, &from_here, files, depth + 1, included).map_err(|_| error)?
            }
            found => found?,
        };
        children.extend(found.children);
    }
    element.children = children;
    Ok(())
}
