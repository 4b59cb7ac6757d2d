//! Families: data-driven parametric generators of objects.
//!
//! Files `data/families/*.json` have one record per family: parameters with their ranges, and templates of parts and
//! description.
//! [`Families::instance`] turns a family and a seed into an object with annotations; the same seed gives the same
//! object, and fixing a parameter does not change the others.
//! Shapes shared by families (finishes, patterns, handles) are in `shapes.json`, colours in `palettes.json`.

mod expression;
mod family;
mod template;

use std::collections::BTreeMap;
use std::sync::OnceLock;

use genmanip_core::{AssetRef, ObjectCard, ObjectModel, Seed};
use serde_json::Value;

pub use family::Family;
use template::Library;

use crate::AssetError;

/// Names and texts of the family files, one per general category.
const FILES: [(&str, &str); 10] = [
    ("tableware", include_str!("../../data/families/tableware.json")),
    ("kitchen", include_str!("../../data/families/kitchen.json")),
    ("packaged", include_str!("../../data/families/packaged.json")),
    ("food", include_str!("../../data/families/food.json")),
    ("office", include_str!("../../data/families/office.json")),
    ("toys", include_str!("../../data/families/toys.json")),
    ("containers", include_str!("../../data/families/containers.json")),
    ("tools", include_str!("../../data/families/tools.json")),
    ("household", include_str!("../../data/families/household.json")),
    ("articulated", include_str!("../../data/families/articulated.json")),
];

/// All families, with the shapes and colour palettes they share.
#[derive(Debug)]
pub struct Families {
    families: BTreeMap<String, Family>,
    palettes: BTreeMap<String, Value>,
    library: Library,
}

fn refused(family: &str, reason: String) -> AssetError {
    AssetError::NotGenerated { family: family.to_owned(), reason }
}

impl Families {
    /// Families that ship with the program.
    ///
    /// # Panics
    /// Never in a tested build: the data files are compiled in.
    pub fn builtin() -> &'static Self {
        static BUILTIN: OnceLock<Families> = OnceLock::new();
        BUILTIN.get_or_init(|| {
            let shapes = include_str!("../../data/families/shapes.json");
            let palettes = include_str!("../../data/families/palettes.json");
            Self::from_json(&FILES, shapes, palettes).expect("built-in data files are tested")
        })
    }

    /// Parses families from JSON texts given as (name, text), with shared shapes and palettes.
    ///
    /// # Errors
    /// [`AssetError::Data`] with the position of the error.
    pub fn from_json(files: &[(&str, &str)], shapes: &str, palettes: &str) -> Result<Self, AssetError> {
        let mut families = BTreeMap::new();
        for (file, text) in files {
            let records: Vec<Family> = crate::data_file::read(file, text)?;
            for family in records {
                if let Some(twice) = families.insert(family.family.clone(), family) {
                    let message = format!("{}: duplicate family name", twice.family);
                    return Err(AssetError::Data { file: (*file).to_owned(), message });
                }
            }
        }
        let library = crate::data_file::read("shapes", shapes)?;
        let palettes = crate::data_file::read("palettes", palettes)?;
        Ok(Self { families, palettes, library })
    }

    /// All families in the order of their names.
    pub fn all(&self) -> impl Iterator<Item = &Family> {
        self.families.values()
    }

    /// Family with this name; `None` if there is none.
    pub fn get(&self, name: &str) -> Option<&Family> {
        self.families.get(name)
    }

    /// Generates an object of a family from a seed; `params` fixes some of its parameters.
    ///
    /// ```
    /// use genmanip_assets::Families;
    /// use genmanip_core::Seed;
    /// let mug = Families::builtin().instance("mug", &Default::default(), Seed::new(7))?;
    /// assert_eq!((mug.card.category.as_str(), mug.card.uid.as_str()), ("mug", "mug-7"));
    /// # Ok::<(), genmanip_assets::AssetError>(())
    /// ```
    ///
    /// # Errors
    /// [`AssetError::NotGenerated`] with the invalid parameter or template.
    pub fn instance(
        &self,
        family: &str,
        params: &BTreeMap<String, Value>,
        seed: Seed,
    ) -> Result<ObjectModel, AssetError> {
        self.instance_of(family, u32::MAX, params, seed)
    }

    /// [`Families::instance`] with an earlier version of the family; with the current version if `version` does not
    /// exist.
    ///
    /// # Errors
    /// As [`Families::instance`].
    pub fn instance_of(
        &self,
        family: &str,
        version: u32,
        params: &BTreeMap<String, Value>,
        seed: Seed,
    ) -> Result<ObjectModel, AssetError> {
        let known = self.known(family)?.in_version(version);
        known.instance(params, seed, &self.palettes, &self.library).map_err(|reason| refused(family, reason))
    }

    /// Recipe of an object with all expressions evaluated, and the seed of its remaining randomness.
    ///
    /// # Errors
    /// As [`Families::instance_of`].
    pub(crate) fn recipe_of(
        &self,
        family: &str,
        version: u32,
        params: &BTreeMap<String, Value>,
        seed: Seed,
    ) -> Result<(Value, Seed), AssetError> {
        let known = self.known(family)?.in_version(version);
        let recipe = known.recipe(params, seed, &self.palettes, &self.library);
        Ok((recipe.map_err(|reason| refused(family, reason))?, known.stream(seed)))
    }

    fn known(&self, family: &str) -> Result<&Family, AssetError> {
        self.families.get(family).ok_or_else(|| {
            let near: Vec<&str> =
                self.families.keys().map(String::as_str).filter(|name| is_near(name, family)).collect();
            let near = if near.is_empty() { "none".into() } else { near.join(", ") };
            refused(family, format!("unknown family; near misses: {near}"))
        })
    }

    /// Card of the object that a family generates from a seed; the object is generated for it.
    ///
    /// # Errors
    /// As [`Families::instance`].
    pub fn card(&self, family: &str, seed: Seed) -> Result<ObjectCard, AssetError> {
        self.instance(family, &BTreeMap::new(), seed).map(|model| model.card)
    }

    /// First family of a category; `None` if there is none.
    pub fn of_category(&self, category: &str) -> Option<&Family> {
        self.families.values().find(|family| family.category() == category)
    }

    /// Family that generated an asset; `None` if no family did.
    pub fn of(&self, asset: &AssetRef) -> Option<&Family> {
        match asset {
            AssetRef::Generated { family, .. } => self.get(family),
            AssetRef::Builtin { .. } | AssetRef::Imported { .. } => None,
        }
    }
}

/// True if two names share a word or most of their letters.
fn is_near(known: &str, wanted: &str) -> bool {
    let wanted = wanted.to_lowercase();
    let same = known.chars().zip(wanted.chars()).filter(|(a, b)| a == b).count();
    known.split(' ').any(|word| wanted.contains(word)) || 2 * same > known.len()
}
