//! Objects as a frozen suite keeps them: everything that physics and the judge use, and the recipe of what is drawn.
//!
//! A later version of the program may make an object of a name otherwise; a frozen one stays what it was.

use genmanip_core::{
    AssetHashes, AssetRef, Document, Joint, JointState, MassProperties, ObjectCard, ObjectLink, ObjectModel, Piece,
    Seed,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::parts::Part;
use crate::recipe::Recipe;
use crate::{AssetError, AssetSource, Catalogue};

/// One object of a frozen suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrozenAsset {
    /// What people and language models are told about it.
    pub card: ObjectCard,
    /// Which asset it is.
    pub asset: AssetRef,
    /// Family of the generator that made it.
    pub family: String,
    /// Hash of its physics.
    pub physics_hash: String,
    /// Hash of what the judge uses besides.
    pub judging_hash: String,
    /// Hash of what is drawn.
    pub looks_hash: String,
    /// Sliding friction coefficient against a like surface.
    pub friction: f64,
    /// Its bodies, without what is drawn.
    pub links: Vec<FrozenLink>,
    /// What each state of the card means for the joints.
    pub states: Vec<JointState>,
    /// The parts that it is drawn from, as `data/catalog.json` has them, all expressions worked out.
    pub recipe: Value,
    /// Stream of what the recipe leaves open.
    pub recipe_seed: Seed,
}

/// One body of a frozen object; see [`ObjectLink`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrozenLink {
    /// Its name.
    pub name: String,
    /// How it hangs on its parent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<Joint>,
    /// Convex collision bodies.
    pub pieces: Vec<Piece>,
    /// Convex regions in which something counts as in the object.
    pub cavity: Vec<Piece>,
    /// Mass, its centre and its inertia.
    pub mass: MassProperties,
}

impl Document for FrozenAsset {
    const SCHEMA: &'static str = "genmanip.frozen_asset/1";
}

impl FrozenAsset {
    /// An object as the catalogue makes it now.
    ///
    /// # Errors
    /// When there is no such object, or it was imported: packs keep those.
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

    /// The object, with physics, cavities and states as they were kept, drawn from the recipe that was kept, and by all
    /// triangles where it was frozen so.
    ///
    /// # Errors
    /// [`AssetError::NotFrozen`] when recipe and bodies do not fit, or the object is not the one its hashes name.
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
        let drawn = recipe.build(&self.card, self.recipe_seed);
        if drawn.links.len() != self.links.len() {
            return Err(wrong(format!("{} bodies, and a recipe of {}", self.links.len(), drawn.links.len())));
        }
        let link = |(link, drawn): (&FrozenLink, ObjectLink)| ObjectLink {
            name: link.name.clone(),
            joint: link.joint.clone(),
            visual: drawn.visual,
            pieces: link.pieces.clone(),
            cavity: link.cavity.clone(),
            mass: link.mass,
        };
        let model = ObjectModel {
            card: self.card.clone(),
            family: self.family.clone(),
            asset: self.asset.clone(),
            links: self.links.iter().zip(drawn.links).map(link).collect(),
            friction: self.friction,
            joint_states: self.states.clone(),
        };
        let got = model.hashes();
        for (what, got, kept) in
            [("physics", got.physics, &self.physics_hash), ("judging", got.judging, &self.judging_hash)]
        {
            if got != *kept {
                return Err(wrong(format!("its {what} has hash {got}, not {kept}")));
            }
        }
        if got.looks != self.looks_hash {
            let measured = model.drawn_as_measured();
            if measured.looks_hash() == self.looks_hash {
                return Ok(measured);
            }
        }
        Ok(model)
    }

    /// What differs from another of the same asset, as places in the file, e.g. `links[0].pieces[3]`; at most `most`.
    pub fn differences(&self, other: &Self, most: usize) -> Vec<String> {
        let mut places = Vec::new();
        differ(&self.to_value(), &other.to_value(), String::new(), &mut places);
        places.truncate(most);
        places
    }
}

/// Collects the places where two values differ.
fn differ(a: &Value, b: &Value, place: String, places: &mut Vec<String>) {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) if a.len() == b.len() && a.keys().all(|key| b.contains_key(key)) => {
            for (key, value) in a {
                let dot = if place.is_empty() { "" } else { "." };
                differ(value, &b[key], format!("{place}{dot}{key}"), places);
            }
        }
        // Numbers of a point or a quaternion are one place.
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() && !a.iter().all(Value::is_number) => {
            for (index, (a, b)) in a.iter().zip(b).enumerate() {
                differ(a, b, format!("{place}[{index}]"), places);
            }
        }
        _ if a == b => {}
        _ => places.push(place),
    }
}
