//! Records of the built-in catalogue.

use genmanip_core::{Annotations, AssetRef, AssetUid, ObjectCard};
use glam::DVec3;
use serde::Deserialize;

use crate::recipe::Recipe;

/// Record of an object in the built-in catalogue, one element of its JSON list. Fields without comment are documented
/// at [`ObjectCard`] and, from `looks` to `affordances`, at [`Annotations`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Unique id of the object.
    pub uid: AssetUid,
    /// Version of the object, incremented when pieces, inertia, joints, cavities or states change.
    version: u32,
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
    #[serde(default)]
    looks: Vec<String>,
    #[serde(default)]
    fragile: bool,
    #[serde(default)]
    upright_only: bool,
    #[serde(default)]
    affordances: Vec<String>,
    /// Recipe of the object; an object without one has only a card, and cannot be built.
    #[serde(default)]
    pub recipe: Option<Recipe>,
}

impl Record {
    /// Splits the record into card and recipe.
    pub fn into_parts(self) -> (ObjectCard, Option<Recipe>) {
        let annotations = Annotations {
            looks: self.looks,
            room: self.recipe.as_ref().filter(|_| !self.is_articulated).and_then(Recipe::room),
            fragile: self.fragile,
            upright_only: self.upright_only,
            affordances: self.affordances,
        };
        let card = ObjectCard {
            asset: AssetRef::builtin(self.uid.clone(), self.version),
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
            annotations,
        };
        (card, self.recipe)
    }
}
