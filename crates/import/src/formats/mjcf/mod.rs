//! MJCF, as robosuite, RoboCasa, MolmoSpaces, MetaWorld and gymnasium-robotics write it: bodies with what is drawn and
//! what touches, joints, masses; includes, defaults, meshes and textures. What moves an object (actuators, sensors,
//! equalities) is left out.

mod assets;
mod bodies;
mod settings;

use crate::ImportError;
use crate::files::{Files, beside};
use crate::formats::xml::{self, Element};
use crate::raw::{RawObject, Unit, Up};

/// Deepest chain of files that include each other, and most included files.
const MOST_DEPTH: usize = 16;
const MOST_INCLUDED: usize = 200;

/// Reads the object of an MJCF file: everything in its world is one object, floors apart.
///
/// # Errors
/// With file and line of what cannot be: an unknown class, mesh or material, a number that is none, a missing file.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut included = 0;
    let root = with_includes(path, path, files, 0, &mut included)?;
    if root.tag != "mujoco" {
        return Err(root.wrong("expected <mujoco>; what is made to be included is no object of its own"));
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

/// The tree of a file with those that it includes in their places; names are relative to the main file or, as older
/// files have it, to the including one.
fn with_includes(
    main: &str,
    path: &str,
    files: &mut Files<'_>,
    depth: usize,
    included: &mut usize,
) -> Result<Element, ImportError> {
    let mut root = xml::parse(path, files)?;
    if depth > MOST_DEPTH || *included > MOST_INCLUDED {
        return Err(root.wrong(format!(
            "more than {MOST_INCLUDED} included files, or deeper than {MOST_DEPTH}: do files include each other?"
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
