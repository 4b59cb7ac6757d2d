//! What is known of an asset besides its card: where it belongs, what it is for, what its parts are good for.

use std::collections::BTreeMap;

use genmanip_core::{Aabb, AssetRef, ObjectCard, ObjectModel};
use serde::{Deserialize, Serialize};

use crate::families::{Families, Family};
use crate::imported;
use crate::standing::{StablePose, stable_poses};

/// Licence of everything that this project makes.
const OWN_LICENCE: &str = "CC0-1.0";

/// What may be trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For training.
    #[default]
    Train,
    /// For testing: others of its family are trained on.
    UnseenInstance,
    /// For testing: nothing of its family is trained on.
    UnseenFamily,
}

impl Split {
    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::UnseenInstance => "unseen_instance",
            Self::UnseenFamily => "unseen_family",
        }
    }
}

/// What is known of an asset from its family.
#[derive(Clone, Debug, Serialize)]
pub struct Notes {
    /// From general to particular, e.g. tableware, drinkware, mug.
    pub category_path: Vec<String>,
    /// Other words for it.
    pub synonyms: Vec<String>,
    /// What people use it for.
    pub uses: Vec<String>,
    /// What counts as its right name when somebody names it from a picture.
    pub accepted_names: Vec<String>,
    /// Licence of its geometry and looks.
    pub licence: String,
    /// Where it comes from.
    pub source: String,
}

/// A named part of an object.
#[derive(Clone, Debug, Serialize)]
pub struct PartNote {
    /// Its name, e.g. `handle`.
    pub name: String,
    /// The link that it belongs to.
    pub link: String,
    /// Its bounds in the frame of the link, m.
    pub link_bounds: Aabb,
    /// What it is for: `grasp`, `contain`, `support`, `do_not_touch`, `read`, `open`, …
    pub affordances: Vec<String>,
}

/// Everything that `genmanip assets show` says of an object's geometry.
#[derive(Clone, Debug, Serialize)]
pub struct GeometryNotes {
    /// Named parts with what they are for.
    pub parts: Vec<PartNote>,
    /// In which poses it stands by itself.
    pub stable_poses: Vec<StablePose>,
    /// Number of convex collision pieces.
    pub pieces: usize,
}

/// What is known of the asset of a card.
///
/// Built-in objects have the words of the family of their category.
pub fn notes(card: &ObjectCard) -> Notes {
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
    Notes {
        category_path: path,
        synonyms,
        uses: family.map_or_else(Vec::new, |family| family.uses.clone()),
        accepted_names: accepted,
        licence,
        source,
    }
}

/// What is known of an object's geometry.
pub fn geometry_notes(model: &ObjectModel) -> GeometryNotes {
    let families = Families::builtin();
    let family = families.of(&model.asset).or_else(|| families.of_category(&model.card.category));
    GeometryNotes {
        parts: parts(model, family),
        stable_poses: stable_poses(model),
        pieces: model.links.iter().map(|link| link.pieces.len()).sum(),
    }
}

fn parts(model: &ObjectModel, family: Option<&Family>) -> Vec<PartNote> {
    let mut notes = Vec::new();
    for link in &model.links {
        let mut bounds: BTreeMap<&str, Aabb> = BTreeMap::new();
        for part in &link.visual {
            let corners = part.mesh.positions.iter();
            let corners = corners.map(|corner| part.link_from_part.transform_point(corner.as_dvec3()));
            let entry = bounds.entry(part.name.as_str()).or_insert(Aabb::EMPTY);
            *entry = corners.fold(*entry, |bounds, corner| bounds.including(corner));
        }
        notes.extend(bounds.into_iter().map(|(name, link_bounds)| {
            PartNote {
                name: name.to_owned(),
                link: link.name.clone(),
                link_bounds,
                affordances: family
                    .and_then(|family| family.part_affordances.get(name).cloned())
                    .unwrap_or_else(|| usual(name, model)),
            }
        }));
    }
    notes
}

/// What a part of a name is usually for.
fn usual(name: &str, model: &ObjectModel) -> Vec<String> {
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
