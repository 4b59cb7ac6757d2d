//! Text of a stage: nested prims with unique names, and the notation of values.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Material, Pose, Texture};

/// A usda file under construction.
#[derive(Default)]
pub(super) struct Writer<'a> {
    pub(super) text: String,
    /// Names of the children of each open prim, outermost first.
    pub(super) taken: Vec<BTreeSet<String>>,
    /// Folder of the texture files, relative to the usda file.
    pub(super) folder: &'a str,
    /// Materials used so far, each written once at the end.
    pub(super) surfaces: Vec<Material>,
    /// Textures used so far; the position is the name of the file.
    pub(super) textures: Vec<Arc<Texture>>,
    /// Name and content (PNG) of the texture files.
    pub(super) files: Vec<(String, Vec<u8>)>,
    /// Friction coefficients of the colliders, as text; each becomes a physics material.
    pub(super) frictions: BTreeSet<String>,
}

impl Writer<'_> {
    pub(super) fn line(&mut self, text: &str) {
        for _ in 0..self.taken.len() {
            self.text.push_str("    ");
        }
        self.text.push_str(text);
        self.text.push('\n');
    }

    /// Opens a prim of type `kind` with metadata and applied schemas; returns its name, which is `name` made a valid
    /// identifier that is unique among its siblings.
    pub(super) fn open(&mut self, kind: &str, name: &str, metadata: &[(&str, &str)], schemas: &[&str]) -> String {
        let mut own: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if !own.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            own.insert(0, '_');
        }
        if let Some(taken) = self.taken.last_mut() {
            let first = own.clone();
            let mut number = 1;
            while !taken.insert(own.clone()) {
                number += 1;
                own = format!("{first}_{number}");
            }
        }
        let names: Vec<String> = schemas.iter().map(|schema| quoted(schema)).collect();
        let applied = format!("[{}]", names.join(", "));
        let mut details: Vec<(&str, &str)> = metadata.to_vec();
        if !schemas.is_empty() {
            details.push(("prepend apiSchemas", &applied));
        }
        if details.is_empty() {
            self.line(&format!("def {kind} \"{own}\""));
        } else {
            self.line(&format!("def {kind} \"{own}\" ("));
            details.iter().for_each(|(key, value)| self.line(&format!("    {key} = {value}")));
            self.line(")");
        }
        self.line("{");
        self.taken.push(BTreeSet::new());
        own
    }

    pub(super) fn close(&mut self) {
        self.taken.pop();
        self.line("}");
    }

    pub(super) fn placed(&mut self, pose: &Pose) {
        self.line(&format!("quatd xformOp:orient = {}", quat(pose.rotation)));
        self.line(&format!("double3 xformOp:translate = {}", triple(pose.position)));
        self.line("uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]");
    }
}

pub(super) fn list<T>(items: impl Iterator<Item = T>, text: impl Fn(T) -> String) -> String {
    let mut all = String::new();
    for item in items {
        let separator = if all.is_empty() { "" } else { ", " };
        let _ = write!(all, "{separator}{}", text(item));
    }
    all
}

pub(super) fn triple(v: DVec3) -> String {
    format!("({}, {}, {})", v.x, v.y, v.z)
}

/// Quaternion in USD's order: real part first.
pub(super) fn quat(q: DQuat) -> String {
    format!("({}, {}, {}, {})", q.w, q.x, q.y, q.z)
}

pub(super) fn quoted(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("\"{}\"", plain.replace('\\', "\\\\").replace('"', "\\\""))
}
