//! Frozen objects of a suite: all inputs of physics and judging, and the rendering recipe.
//!
//! A later version of the program may generate a different object for the same name; a frozen one never changes.

use genmanip_core::{
    AssetHashes, AssetRef, Document, Joint, JointState, MassProperties, ObjectCard, ObjectLink, ObjectModel, Piece,
    Seed,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::parts::Part;
use crate::recipe::Recipe;
use crate::{AssetError, AssetSource, Catalogue};

/// Frozen object of a suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrozenAsset {
    /// Card of the object: description for people and language models.
    pub card: ObjectCard,
    /// Reference by which scenarios name the object.
    pub asset: AssetRef,
    /// Family of the object, e.g. `mug`.
    pub family: String,
    /// Hash of everything that affects the simulation.
    pub physics_hash: String,
    /// Hash of everything else that affects the judgement of success, such as cavities and states.
    pub judging_hash: String,
    /// Hash of the rendered meshes and materials.
    pub looks_hash: String,
    /// Sliding friction coefficient against a surface of the same kind.
    pub friction: f64,
    /// Links with collision geometry, without visuals; the root link is first.
    pub links: Vec<FrozenLink>,
    /// Joint intervals and nominal joint positions of each state named on the card.
    pub states: Vec<JointState>,
    /// Recipe of the visuals, as in `data/catalog.json`, with all expressions evaluated.
    pub recipe: Value,
    /// Seed of random textures in the recipe.
    pub recipe_seed: Seed,
}

/// Link of a frozen object; see [`ObjectLink`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrozenLink {
    /// Name of the link, unique in the object.
    pub name: String,
    /// Joint to the parent link; `None` for the root.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<Joint>,
    /// Convex collision pieces, in the link's frame.
    pub pieces: Vec<Piece>,
    /// Convex regions, in the link's frame, in which an object counts as inside this one.
    pub cavity: Vec<Piece>,
    /// Mass, centre of mass and inertia of the link.
    pub mass: MassProperties,
}

impl Document for FrozenAsset {
    const SCHEMA: &'static str = "genmanip.frozen_asset/1";
}

impl FrozenAsset {
    /// Freezes an object as the catalogue currently generates it.
    ///
    /// # Errors
    /// If there is no such object, or it is a variant of another or imported (packs already store imported objects).
    pub fn of(asset: &AssetRef, catalogue: &Catalogue) -> Result<Self, AssetError> {
        let model = catalogue.model(asset)?;
        let AssetHashes { physics, judging, looks } = catalogue.hashes(asset)?;
        let (recipe, recipe_seed) = catalogue.recipe(asset)?;
        let link = |link: &ObjectLink| FrozenLink {
            name: link.name.clone(),
            joint: link.joint.clone(),
            pieces: link.pieces.clone(),
            cavity: link.cavity.clone(),
            mass: link.mass,
        };
        Ok(Self {
            card: model.card.clone(),
            asset: model.asset.clone(),
            family: model.family.clone(),
            physics_hash: physics,
            judging_hash: judging,
            looks_hash: looks,
            friction: model.friction,
            links: model.links.iter().map(link).collect(),
            states: model.joint_states.clone(),
            recipe,
            recipe_seed,
        })
    }

    /// Model of the object: stored physics, cavities and states, with visuals built from the stored recipe. Visuals
    /// have full resolution if `looks_hash` is that of the full-resolution meshes, and are not checked otherwise.
    ///
    /// # Errors
    /// [`AssetError::NotFrozen`] if the recipe is invalid or does not match the links, or the hash of physics or judging
    /// differs.
    pub fn model(&self) -> Result<ObjectModel, AssetError> {
        let wrong = |message: String| AssetError::NotFrozen { asset: self.asset.clone(), message };
        let recipe: Recipe = serde_json::from_value(self.recipe.clone()).map_err(|error| wrong(error.to_string()))?;
        let mut parts = recipe.parts.iter().chain(recipe.links.iter().flat_map(|link| &link.parts));
        if let Some(flaw) = parts.find_map(Part::flaw) {
            return Err(wrong(format!("recipe: {flaw}")));
        }
        if let Some(flaw) = recipe.flaw(&self.card) {
            return Err(wrong(format!("recipe: {flaw}")));
        }
        let built = recipe.build(&self.card, self.recipe_seed);
        if built.links.len() != self.links.len() {
            return Err(wrong(format!("{} links, but a recipe of {}", self.links.len(), built.links.len())));
        }
        let link = |(link, built): (&FrozenLink, ObjectLink)| ObjectLink {
            name: link.name.clone(),
            joint: link.joint.clone(),
            visual: built.visual,
            pieces: link.pieces.clone(),
            cavity: link.cavity.clone(),
            mass: link.mass,
        };
        let model = ObjectModel {
            card: self.card.clone(),
            family: self.family.clone(),
            asset: self.asset.clone(),
            links: self.links.iter().zip(built.links).map(link).collect(),
            friction: self.friction,
            joint_states: self.states.clone(),
        };
        let got = model.hashes();
        for (what, got, kept) in
            [("physics", got.physics, &self.physics_hash), ("judging", got.judging, &self.judging_hash)]
        {
            if got != *kept {
                return Err(wrong(format!("{what} hash: expected {kept}, got {got}")));
            }
        }
        if got.looks != self.looks_hash {
            let measured = model.with_full_meshes();
            if measured.looks_hash() == self.looks_hash {
                return Ok(measured);
            }
        }
        Ok(model)
    }

    /// Paths of fields that differ from another version of the asset, e.g. `links[0].pieces[3]`; at most `most` of
    /// them.
    pub fn differences(&self, other: &Self, most: usize) -> Vec<String> {
        let mut places = Vec::new();
        differ(&self.to_value(), &other.to_value(), String::new(), &mut places);
        places.truncate(most);
        places
    }
}

/// Adds to `places` the paths at which two values differ; `place` is the path of the values.
fn differ(a: &Value, b: &Value, place: String, places: &mut Vec<String>) {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) if a.len() == b.len() && a.keys().all(|key| b.contains_key(key)) => {
            for (key, value) in a {
                let dot = if place.is_empty() { "" } else { "." };
                differ(value, &b[key], format!("{place}{dot}{key}"), places);
            }
        }
        // A list of numbers, such as a vector or a quaternion, is reported as one path.
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() && !a.iter().all(Value::is_number) => {
            for (index, (a, b)) in a.iter().zip(b).enumerate() {
                differ(a, b, format!("{place}[{index}]"), places);
            }
        }
        _ if a == b => {}
        _ => places.push(place),
    }
}
