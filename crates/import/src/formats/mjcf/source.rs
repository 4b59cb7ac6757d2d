//! Text and files for MuJoCo's compiler: includes are expanded, and files are read through [`Files`] and renamed, so
//! that the compiler opens none by itself. Sections that do not describe an object are omitted.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::Texture;
use genmanip_core::limits::IMPORTED_MESH;
use genmanip_sim::SimError;

use super::{LEAST_INERTIA, LEAST_MASS_KG};
use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::formats::xml::{self, Element};
use crate::formats::{extension, obj};

/// Maximum nesting depth of includes and attached models, and (`MAX_INCLUDED`) maximum number of them. Bounds time for
/// hostile files.
const MAX_DEPTH: usize = 16;
const MAX_INCLUDED: usize = 200;
/// Maximum number of elements of the world bodies, with replicas counted. Bounds time and memory for hostile files.
const MAX_PARTS: f64 = 20_000.0;
/// Maximum side of a procedural texture, pixels. Bounds memory for hostile files.
const MAX_DRAWN: f64 = 256.0;
/// Maximum parameter of a procedural mesh, such as its subdivisions. Bounds time and memory for hostile files.
const MAX_PARAMETER: f64 = 64.0;
/// Height of the placeholder of the first texture file, pixels. The compiler keeps image sizes, so the height
/// identifies the file.
const FIRST_HEIGHT: u32 = 1001;
/// Sections that are not passed to the compiler and whose omission is noted.
const NOTED: [&str; 7] = ["actuator", "sensor", "equality", "tendon", "contact", "deformable", "extension"];
/// Elements of bodies that are passed to the compiler, and (`NOTED_PARTS`) those whose omission is noted.
const PARTS: [&str; 8] = ["body", "geom", "joint", "freejoint", "inertial", "frame", "replicate", "attach"];
const NOTED_PARTS: [&str; 2] = ["composite", "flexcomp"];
/// Settings of the compiler that are kept; folders and threads are not.
const COMPILER: [&str; 11] = [
    "angle",
    "autolimits",
    "eulerseq",
    "inertiafromgeom",
    "inertiagrouprange",
    "balanceinertia",
    "boundmass",
    "boundinertia",
    "settotalmass",
    "alignfree",
    "fitaabb",
];

/// Input of the compiler.
pub struct Source {
    /// Name of the model; may be empty.
    pub model: String,
    /// MJCF text with one opening tag per line.
    pub xml: String,
    /// Contents of meshes and attached models, by the names used in the text.
    pub files: Vec<(String, Vec<u8>)>,
    /// Textures from files, by the height of their placeholders.
    pub textures: BTreeMap<u32, Arc<Texture>>,
    /// Original file and line of each line of the text.
    places: Vec<(String, u32)>,
}

impl Source {
    /// Gathers a file and everything it refers to.
    ///
    /// # Errors
    /// If a file is missing, no XML or outside the root, or there are too many parts.
    pub fn of(path: &str, files: &mut Files<'_>, notes: &mut Vec<String>) -> Result<Self, ImportError> {
        let mut gatherer = Gatherer {
            files,
            notes,
            given: Vec::new(),
            known: BTreeMap::new(),
            textures: BTreeMap::new(),
            included: 0,
        };
        let root = gatherer.model(path, 0)?;
        let (mut xml, mut places) = (String::new(), Vec::new());
        write(&root, &mut xml, &mut places);
        Ok(Self {
            model: root.attribute("model").unwrap_or_default().to_owned(),
            xml,
            files: gatherer.given,
            textures: gatherer.textures,
            places,
        })
    }

    /// Text with a smallest mass and inertia of moving bodies; lines keep their numbers.
    pub fn with_least_mass(&self) -> String {
        let bounds = format!("<compiler boundmass=\"{LEAST_MASS_KG}\" boundinertia=\"{LEAST_INERTIA}\"/>");
        let (head, rest) = self.xml.split_once('\n').unwrap_or((&self.xml, ""));
        format!("{head}{bounds}\n{rest}")
    }

    /// Import error for a rejection by the compiler, with file and line of the original.
    pub fn refused(&self, main: &str, error: &SimError) -> ImportError {
        let said = error.to_string();
        let file = self.place(&said).map_or(main, |(file, _)| file.as_str());
        ImportError::new(file, self.located(&said)).hint("MuJoCo itself refuses the file; its documentation says why")
    }

    /// A message of the compiler on one line, with the line of the original file.
    pub fn located(&self, said: &str) -> String {
        let mut text: String = said.split_whitespace().collect::<Vec<_>>().join(" ");
        if let (Some((_, line)), Some(at)) = (self.place(said), text.rfind("line ")) {
            text.truncate(at);
            text += &format!("line {line}");
        }
        text
    }

    fn place(&self, said: &str) -> Option<&(String, u32)> {
        let number = said.rsplit_once("line ")?.1;
        let end = number.find(|c: char| !c.is_ascii_digit()).unwrap_or(number.len());
        self.places.get(number[..end].parse::<usize>().ok()?.checked_sub(1)?)
    }
}

struct Gatherer<'a, 'b> {
    files: &'a mut Files<'b>,
    notes: &'a mut Vec<String>,
    given: Vec<(String, Vec<u8>)>,
    /// Names used in the text, by path.
    known: BTreeMap<String, String>,
    textures: BTreeMap<u32, Arc<Texture>>,
    included: usize,
}

/// Folders of assets, relative to the main file of their model.
#[derive(Default)]
struct Folders {
    meshes: String,
    textures: String,
}

impl Gatherer<'_, '_> {
    /// Element of a model, the main file or an attached one.
    fn model(&mut self, path: &str, depth: usize) -> Result<Element, ImportError> {
        let root = self.with_includes(path, path, depth)?;
        if root.tag != "mujoco" {
            return Err(root.wrong("expected <mujoco>; an include file is not a complete object"));
        }
        let mut folders = Folders::default();
        for compiler in root.all("compiler") {
            if let Some(folder) = compiler.attribute("assetdir") {
                (folders.meshes, folders.textures) = (folder.to_owned(), folder.to_owned());
            }
            folders.meshes = compiler.attribute("meshdir").unwrap_or(&folders.meshes).to_owned();
            folders.textures = compiler.attribute("texturedir").unwrap_or(&folders.textures).to_owned();
        }
        let worlds = worlds(&root, path, self.notes);
        let mut made = Element { children: Vec::new(), ..root.clone() };
        made.attributes.retain(|name, _| name == "model");
        for section in &root.children {
            match section.tag.as_str() {
                "compiler" => made.children.push(compiler(section)),
                "default" => made.children.push(defaults(section)),
                "asset" => {
                    let assets = self.assets(section, path, &folders, depth)?;
                    made.children.push(assets);
                }
                "worldbody" if worlds.contains(&section.place) => {
                    made.children.push(part(section, self.notes));
                }
                "worldbody" => {}
                other if NOTED.contains(&other) && !section.children.is_empty() => {
                    self.notes.push(format!("<{other}> is not used"));
                }
                _ => {}
            }
        }
        let parts: f64 = made.all("worldbody").map(count).sum();
        if parts > MAX_PARTS {
            return Err(root.wrong(format!("more than {MAX_PARTS} parts, replicas counted")));
        }
        Ok(made)
    }

    /// Parses a file and expands its includes. Names are relative to the main file or, in older files, to the including
    /// file.
    fn with_includes(&mut self, main: &str, path: &str, depth: usize) -> Result<Element, ImportError> {
        let mut root = xml::parse(path, self.files)?;
        if depth > MAX_DEPTH || self.included > MAX_INCLUDED {
            return Err(root.wrong(format!(
                "more than {MAX_INCLUDED} included files, or deeper than {MAX_DEPTH}: do files include each other?"
            )));
        }
        self.expand(&mut root, main, path, depth)?;
        Ok(root)
    }

    fn expand(&mut self, element: &mut Element, main: &str, path: &str, depth: usize) -> Result<(), ImportError> {
        let mut children = Vec::new();
        for mut child in std::mem::take(&mut element.children) {
            if child.tag != "include" {
                self.expand(&mut child, main, path, depth)?;
                children.push(child);
                continue;
            }
            let named = child.attribute("file").ok_or_else(|| child.wrong("expected a file"))?;
            self.included += 1;
            let from_main = beside(main, named)?;
            let found = match self.with_includes(main, &from_main, depth + 1) {
                Err(error) if error.file == from_main && path != main => {
                    let from_here = beside(path, named)?;
                    self.with_includes(main, &from_here, depth + 1).map_err(|_| error)?
                }
                found => found?,
            };
            children.extend(found.children);
        }
        element.children = children;
        Ok(())
    }

    fn assets(
        &mut self,
        section: &Element,
        main: &str,
        folders: &Folders,
        depth: usize,
    ) -> Result<Element, ImportError> {
        let mut made = Element { children: Vec::new(), ..section.clone() };
        for asset in &section.children {
            let mut asset = asset.clone();
            match asset.tag.as_str() {
                "mesh" => self.mesh(&mut asset, main, folders)?,
                "texture" => self.texture(&mut asset, main, folders),
                "material" => {}
                "model" => self.attached(&mut asset, main, depth)?,
                other => {
                    self.notes.push(format!("an asset of type {} is not used", shortened(other)));
                    continue;
                }
            }
            made.children.push(asset);
        }
        Ok(made)
    }

    fn mesh(&mut self, mesh: &mut Element, main: &str, folders: &Folders) -> Result<(), ImportError> {
        mesh.children.clear();
        for name in ["params", "maxhullvert"] {
            if mesh.attribute("builtin").is_some()
                && mesh.numbers(name)?.is_some_and(|all| all.iter().any(|it| *it > MAX_PARAMETER))
            {
                return Err(mesh.wrong(format!("{name}: expected at most {MAX_PARAMETER}")));
            }
        }
        let Some(file) = mesh.attribute("file").map(str::to_owned) else { return Ok(()) };
        let path = asset_path(main, &folders.meshes, &file, mesh)?;
        name_after(mesh, &file);
        let bytes = self.files.bytes(&path, IMPORTED_MESH)?;
        let given = self.known.get(&path).cloned().unwrap_or_else(|| {
            let name = format!("mesh{}.{}", self.given.len(), extension(&path));
            self.given.push((name.clone(), bytes.to_vec()));
            name
        });
        self.known.insert(path, given.clone());
        mesh.attributes.insert("file".into(), given);
        Ok(())
    }

    /// Replaces a texture from files by a placeholder; a missing one becomes grey, with a note.
    fn texture(&mut self, texture: &mut Element, main: &str, folders: &Folders) {
        let file = ["file", "fileright", "filefront", "fileup"].into_iter().find_map(|name| texture.attribute(name));
        let Some(file) = file.map(str::to_owned) else {
            for name in ["width", "height"] {
                if texture.number(name, 0.0).map_or(true, |side| side > MAX_DRAWN) {
                    texture.attributes.insert(name.into(), MAX_DRAWN.to_string());
                }
            }
            return;
        };
        name_after(texture, &file);
        let height = FIRST_HEIGHT + self.textures.len() as u32;
        let found = match asset_path(main, &folders.textures, &file, texture) {
            _ if self.files.geometry_only => None,
            Ok(path) => obj::image(&path, self.files, self.notes),
            Err(error) => {
                self.notes.push(format!("texture ignored: {error}"));
                None
            }
        };
        texture.attributes.retain(|name, _| name == "name");
        let mut height_px = 1;
        if let Some(found) = found {
            self.textures.insert(height, found);
            height_px = height;
        }
        let flat = [("type", "2d"), ("builtin", "flat"), ("rgb1", "0.8 0.8 0.8"), ("width", "1")];
        texture.attributes.extend(flat.map(|(name, value)| (name.to_owned(), value.to_owned())));
        texture.attributes.insert("height".into(), height_px.to_string());
    }

    fn attached(&mut self, model: &mut Element, main: &str, depth: usize) -> Result<(), ImportError> {
        let file = model.attribute("file").map(str::to_owned).ok_or_else(|| model.wrong("expected a file"))?;
        let path = beside(main, &file)?;
        name_after(model, &file);
        self.included += 1;
        let root = self.model(&path, depth + 1)?;
        let name = format!("model{}.xml", self.given.len());
        let (mut xml, mut places) = (String::new(), Vec::new());
        write(&root, &mut xml, &mut places);
        self.given.push((name.clone(), xml.into_bytes()));
        model.attributes.retain(|name, _| name == "name");
        model.attributes.insert("file".into(), name);
        Ok(())
    }
}

/// Files and lines of the `worldbody` elements that hold the object; one from an included file is the surrounding
/// scene.
fn worlds(root: &Element, main: &str, notes: &mut Vec<String>) -> Vec<(String, u32)> {
    let bodies = |world: &Element| {
        world.children.iter().filter(|child| child.tag != "geom" && PARTS.contains(&&*child.tag)).count()
    };
    let is_own = |world: &&Element| world.place.0 == main && bodies(world) > 0;
    let has_own = root.all("worldbody").any(|world| is_own(&world));
    let (kept, scene): (Vec<&Element>, Vec<&Element>) =
        root.all("worldbody").partition(|world| !has_own || is_own(world));
    let ignored: usize = scene.into_iter().map(bodies).sum();
    if ignored > 0 {
        notes.push(format!("ignored {ignored} bodies of the surrounding scene"));
    }
    kept.into_iter().map(|world| world.place.clone()).collect()
}

/// Settings of the compiler without folders, and with a single thread.
fn compiler(section: &Element) -> Element {
    let mut made = Element { children: Vec::new(), ..section.clone() };
    made.attributes.retain(|name, _| COMPILER.contains(&name.as_str()));
    made.attributes.insert("usethread".into(), "false".into());
    made
}

/// Defaults of the elements that are passed to the compiler.
fn defaults(section: &Element) -> Element {
    let kept = |child: &&Element| ["default", "geom", "joint", "mesh", "material"].contains(&child.tag.as_str());
    let child = |child: &Element| match child.tag.as_str() {
        "default" => defaults(child),
        _ => Element { children: Vec::new(), ..child.clone() },
    };
    Element { children: section.children.iter().filter(kept).map(child).collect(), ..section.clone() }
}

/// Copy of a world or body with the elements that describe an object.
fn part(element: &Element, notes: &mut Vec<String>) -> Element {
    let mut made = Element { children: Vec::new(), ..element.clone() };
    for child in &element.children {
        let unbounded = ["hfield", "sdf"].into_iter().find(|kind| child.attribute("type") == Some(kind));
        match (child.tag.as_str(), unbounded) {
            ("geom", Some(kind)) => notes.push(format!("a geom of type {kind} is ignored")),
            (tag, _) if PARTS.contains(&tag) => made.children.push(part(child, notes)),
            (tag, _) if NOTED_PARTS.contains(&tag) => notes.push(format!("a <{tag}> is not used")),
            _ => {}
        }
    }
    made
}

/// Number of elements below an element, with replicas counted.
fn count(element: &Element) -> f64 {
    let copies = match element.tag.as_str() {
        "replicate" => element.number("count", 1.0).map_or(f64::INFINITY, |copies| copies.max(1.0)),
        _ => 1.0,
    };
    copies * (1.0 + element.children.iter().map(count).sum::<f64>())
}

/// Names an asset after its original file, as the compiler would, before the file is renamed.
fn name_after(asset: &mut Element, file: &str) {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned();
    asset.attributes.entry("name".into()).or_insert(stem);
}

/// Path of a file in an asset folder, relative to the root.
fn asset_path(main: &str, folder: &str, file: &str, element: &Element) -> Result<String, ImportError> {
    let named = if folder.is_empty() { file.to_owned() } else { format!("{}/{file}", folder.trim_end_matches('/')) };
    beside(main, &named).map_err(|error| ImportError { file: element.place.0.clone(), ..error })
}

/// Writes an element, with its opening tag on a line of its own.
fn write(element: &Element, xml: &mut String, places: &mut Vec<(String, u32)>) {
    if !places.is_empty() {
        xml.push('\n');
    }
    places.push(element.place.clone());
    *xml += &format!("<{}", element.tag);
    for (name, value) in &element.attributes {
        let value = value.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        *xml += &format!(" {name}=\"{}\"", value.split_whitespace().collect::<Vec<_>>().join(" "));
    }
    xml.push('>');
    element.children.iter().for_each(|child| write(child, xml, places));
    *xml += &format!("</{}>", element.tag);
}
