//! Metadata of an asset beyond its card: category path, uses, part affordances, licence.

use std::collections::BTreeMap;

use genmanip_core::{Aabb, AssetRef, ObjectCard, ObjectModel};
use serde::{Deserialize, Serialize};

use crate::families::{Families, Family};
use crate::imported;
use crate::stable_poses::{StablePose, stable_poses};

/// Licence of everything that this project creates.
const OWN_LICENCE: &str = "CC0-1.0";

/// Train/test split of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// The object is used for training.
    #[default]
    Train,
    /// The object is held out for testing; other objects of its family are used for training.
    UnseenInstance,
    /// The object is held out for testing together with its whole family.
    UnseenFamily,
}

impl Split {
    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::UnseenInstance => "unseen_instance",
            Self::UnseenFamily => "unseen_family",
        }
    }
}

/// Metadata of an asset, mostly from its family.
#[derive(Clone, Debug, Serialize)]
pub struct AssetMetadata {
    /// Category path from general to specific, e.g. tableware, drinkware, mug.
    pub category_path: Vec<String>,
    /// Synonyms of the category; empty for an object without family.
    pub synonyms: Vec<String>,
    /// Everyday uses; empty for an object without family.
    pub uses: Vec<String>,
    /// Names accepted as correct when the object is to be identified from an image.
    pub accepted_names: Vec<String>,
    /// Licence of geometry and appearance.
    pub licence: String,
    /// Origin of the asset in words, e.g. from which files it was imported.
    pub source: String,
}

/// Named part of an object.
#[derive(Clone, Debug, Serialize)]
pub struct PartMetadata {
    /// Name of the part, e.g. `handle`.
    pub name: String,
    /// Name of the link that the part belongs to.
    pub link: String,
    /// Bounding box in the link's frame, m.
    pub link_bounds: Aabb,
    /// Affordances: `grasp`, `contain`, `support`, `do_not_touch`, `read`, `open`, …
    pub affordances: Vec<String>,
}

/// Geometry section of `genmanip assets show`.
#[derive(Clone, Debug, Serialize)]
pub struct GeometryMetadata {
    /// Named parts with their affordances.
    pub parts: Vec<PartMetadata>,
    /// Stable poses on a level surface.
    pub stable_poses: Vec<StablePose>,
    /// Number of convex collision pieces of all links.
    pub pieces: usize,
}

/// Metadata of the asset that a card describes.
///
/// Built-in objects have the metadata of the first family of their category.
pub fn asset_metadata(card: &ObjectCard) -> AssetMetadata {
    let families = Families::builtin();
    let family = families.of(&card.asset).or_else(|| families.of_category(&card.category));
    let (source, licence) = match &card.asset {
        AssetRef::Builtin { .. } => ("made by hand for this project".to_owned(), OWN_LICENCE.to_owned()),
        AssetRef::Generated { .. } => {
            ("made by a parametric family of this project".to_owned(), OWN_LICENCE.to_owned())
        }
        AssetRef::Imported { hash } => imported::origin(hash).map_or_else(
            || ("imported".to_owned(), "unknown".to_owned()),
            |origin| (format!("imported from {}", origin.source), origin.licence),
        ),
    };
    let path =
        family.map_or_else(|| vec![card.general_category.clone(), card.category.clone()], |family| family.path.clone());
    let synonyms = family.map_or_else(Vec::new, |family| family.synonyms.clone());
    let mut accepted = vec![card.category.clone()];
    accepted.extend(synonyms.iter().cloned());
    accepted.extend(family.map_or_else(Vec::new, |family| family.also_named.clone()));
    AssetMetadata {
        category_path: path,
        synonyms,
        uses: family.map_or_else(Vec::new, |family| family.uses.clone()),
        accepted_names: accepted,
        licence,
        source,
    }
}

/// Named parts, stable poses and collision pieces of an object.
pub fn geometry_metadata(model: &ObjectModel) -> GeometryMetadata {
    let families = Families::builtin();
    let family = families.of(&model.asset).or_else(|| families.of_category(&model.card.category));
    GeometryMetadata {
        parts: parts(model, family),
        stable_poses: stable_poses(model),
        pieces: model.links.iter().map(|link| link.pieces.len()).sum(),
    }
}

fn parts(model: &ObjectModel, family: Option<&Family>) -> Vec<PartMetadata> {
    let mut parts = Vec::new();
    for link in &model.links {
        let mut bounds: BTreeMap<&str, Aabb> = BTreeMap::new();
        for part in &link.visual {
            let corners = part.mesh.positions.iter();
            let corners = corners.map(|corner| part.link_from_part.transform_point(corner.as_dvec3()));
            let entry = bounds.entry(part.name.as_str()).or_insert(Aabb::EMPTY);
            *entry = corners.fold(*entry, |bounds, corner| bounds.including(corner));
        }
        parts.extend(bounds.into_iter().map(|(name, link_bounds)| {
            PartMetadata {
                name: name.to_owned(),
                link: link.name.clone(),
                link_bounds,
                affordances: family
                    .and_then(|family| family.part_affordances.get(name).cloned())
                    .unwrap_or_else(|| default_affordances(name, model)),
            }
        }));
    }
    parts
}

/// Affordances of a part that follow from its name.
fn default_affordances(name: &str, model: &ObjectModel) -> Vec<String> {
    let words: &[&str] = match name {
        "handle" if model.card.is_articulated => &["grasp", "open"],
        "handle" | "grip" | "shaft" => &["grasp"],
        "inside" | "floor" if model.is_hollow() => &["contain"],
        "rim" => &["pinch"],
        "blade" | "tip" | "point" | "bristles" => &["do_not_touch"],
        "label" | "print" | "dial" => &["read"],
        "lid" | "cap" => &["close"],
        "spout" => &["pour"],
        "body" | "outside" if model.card.can_grasp => &["grasp"],
        _ => &[],
    };
    words.iter().map(|word| (*word).to_owned()).collect()
}
