//! Records: everything that is known about the assets of the catalogue.

use genmanip_core::{AssetRef, ObjectCard};
use glam::DVec3;
use serde::Deserialize;

use crate::recipe::GENERATOR_VERSION;

/// One object of the catalogue.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    uid: String,
    name: String,
    description: String,
    category: String,
    general_category: String,
    colors: Vec<String>,
    materials: Vec<String>,
    shape: String,
    size_m: DVec3,
    mass_kg: f64,
    is_container: bool,
    is_articulated: bool,
    states: Vec<String>,
    can_grasp: bool,
}

impl Record {
    /// What people and language models are told about it.
    pub fn into_card(self) -> ObjectCard {
        ObjectCard {
            asset: AssetRef::builtin(&self.uid, GENERATOR_VERSION),
            uid: self.uid,
            name: self.name,
            description: self.description,
            category: self.category,
            general_category: self.general_category,
            colors: self.colors,
            materials: self.materials,
            shape: self.shape,
            size_m: self.size_m,
            mass_kg: self.mass_kg,
            is_container: self.is_container,
            is_articulated: self.is_articulated,
            states: self.states,
            can_grasp: self.can_grasp,
        }
    }
}
