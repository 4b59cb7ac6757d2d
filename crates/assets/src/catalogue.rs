//! Catalogue of objects: cards of all objects, and models that are built on demand.

use std::borrow::Borrow;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use genmanip_core::{AssetHashes, AssetRef, AssetUid, ObjectCard, ObjectModel, Seed};

use crate::built_models::BuiltModels;
use crate::data_file::read;
use crate::imported;
use crate::instances::generated_instances;
use crate::metadata::Split;
use crate::parts::Part;
use crate::recipe::Recipe;
use crate::record::Record;
use crate::search::Index;
use crate::variant::{VARIANT_OF, variant};
use crate::{AssetError, AssetSource, Families};
use serde_json::Value;

const RECORDS: &str = include_str!("../data/catalog.json");

/// Name of the catalogue's built-in data file in error messages.
const FILE: &str = "records";

/// Catalogue of objects by uid. Models are built on first use and stay in memory while they are held or among the last
/// used ones; the hash maps are never iterated.
#[derive(Debug)]
pub struct Catalogue {
    cards: Vec<ObjectCard>,
    recipes: BTreeMap<AssetUid, Recipe>,
    models: Mutex<BuiltModels>,
    /// Models that are rendered with their full-resolution meshes.
    full_mesh_models: Mutex<BuiltModels>,
    hashes: Mutex<HashMap<AssetRef, AssetHashes>>,
    /// Appearance hashes of [`Self::full_mesh_models`].
    full_mesh_looks: Mutex<HashMap<AssetRef, String>>,
}

/// Names of the catalogues, as [`Catalogue::named`] takes them.
pub const CATALOGUES: [&str; 4] = ["builtin", "full", "imported", "all"];

impl Catalogue {
    /// Catalogue of the hand-written objects that ship with the program.
    ///
    /// # Panics
    /// Never in a tested build: the data files are compiled in.
    pub fn builtin() -> &'static Self {
        static BUILTIN: OnceLock<Catalogue> = OnceLock::new();
        BUILTIN.get_or_init(|| Self::from_json(RECORDS).expect("built-in data files are tested"))
    }

    /// Catalogue of the hand-written objects and the listed instances of the families: 1,000 rigid and 120 articulated
    /// objects in total.
    ///
    /// # Panics
    /// Never in a tested build: the data files are compiled in.
    pub fn full() -> &'static Self {
        static FULL: OnceLock<Catalogue> = OnceLock::new();
        FULL.get_or_init(|| {
            let mut full = Self::from_json(RECORDS).expect("built-in data files are tested");
            full.cards.extend(generated_instances().iter().map(|one| one.card.clone()));
            full
        })
    }

    /// Catalogue of the objects in the opened packs, see [`imported::open`]; empty if no pack is open.
    ///
    /// # Panics
    /// As [`Catalogue::builtin`].
    pub fn imported() -> &'static Self {
        static IMPORTED: OnceLock<Catalogue> = OnceLock::new();
        IMPORTED.get_or_init(|| {
            let mut own = Self::from_json("[]").expect("an empty list is a list");
            own.cards.extend_from_slice(imported::cards());
            own
        })
    }

    /// Catalogue of the objects of [`Catalogue::full`] and [`Catalogue::imported`].
    ///
    /// # Panics
    /// As [`Catalogue::builtin`].
    pub fn all() -> &'static Self {
        static ALL: OnceLock<Catalogue> = OnceLock::new();
        ALL.get_or_init(|| {
            let mut all = Self::from_json(RECORDS).expect("built-in data files are tested");
            all.cards.extend(generated_instances().iter().map(|one| one.card.clone()));
            all.cards.extend_from_slice(imported::cards());
            all
        })
    }

    /// Catalogue by name: `builtin`, `full`, `imported` or `all`; `None` for another name.
    pub fn named(name: &str) -> Option<&'static Self> {
        match name {
            "builtin" => Some(Self::builtin()),
            "full" => Some(Self::full()),
            "imported" => Some(Self::imported()),
            "all" => Some(Self::all()),
            _ => None,
        }
    }

    /// Train/test split of an object; `Train` for hand-written, imported and unknown objects.
    pub fn split<Q: AsRef<str> + ?Sized>(&self, uid: &Q) -> Split
    where
        AssetUid: Borrow<Q>,
    {
        generated_instances().iter().find(|one| one.card.uid == *uid.as_ref()).map_or(Split::Train, |one| one.split)
    }

    /// Index for keyword search over the cards, with their train/test splits.
    pub fn index(&self) -> Index {
        let splits: BTreeMap<&AssetUid, Split> =
            generated_instances().iter().map(|one| (&one.card.uid, one.split)).collect();
        let split = |card: &ObjectCard| splits.get(&card.uid).copied().unwrap_or_default();
        Index::new(self.cards.iter().map(|card| (card.clone(), split(card))))
    }

    /// Parses a catalogue from a JSON list of records.
    ///
    /// # Errors
    /// [`AssetError::Data`] with the position of the error.
    pub fn from_json(records: &str) -> Result<Self, AssetError> {
        let records: Vec<Record> = read(FILE, records)?;
        let (mut cards, mut recipes) = (Vec::new(), BTreeMap::new());
        for record in records {
            let wrong = |message: String| AssetError::Data { file: FILE.into(), message };
            if let Some(recipe) = &record.recipe {
                check_parts(FILE, record.uid.as_str(), &recipe.parts)?;
                for link in &recipe.links {
                    check_parts(FILE, &format!("{}.{}", record.uid, link.name), &link.parts)?;
                }
            }
            let (card, recipe) = record.into_parts();
            if card.uid.as_str().contains(['#', '/']) || cards.iter().any(|other: &ObjectCard| other.uid == card.uid) {
                return Err(wrong(format!("{}: expected a unique uid without # and /", card.uid)));
            }
            if let Some(recipe) = recipe {
                if let Some(message) = recipe.flaw(&card) {
                    return Err(wrong(format!("{}: {message}", card.uid)));
                }
                recipes.insert(card.uid.clone(), recipe);
            }
            cards.push(card);
        }
        Ok(Self {
            cards,
            recipes,
            models: Mutex::default(),
            full_mesh_models: Mutex::default(),
            hashes: Mutex::default(),
            full_mesh_looks: Mutex::default(),
        })
    }

    /// Cards of all objects: hand-written ones, then listed instances of families, then imported ones.
    pub fn cards(&self) -> &[ObjectCard] {
        &self.cards
    }

    /// Card of an object by uid; `None` for an unknown uid.
    pub fn card<Q: AsRef<str> + ?Sized>(&self, uid: &Q) -> Option<&ObjectCard>
    where
        AssetUid: Borrow<Q>,
    {
        self.cards.iter().find(|card| card.uid == *uid.as_ref())
    }

    /// Model of an object by uid; the same `Arc` as long as one is held.
    ///
    /// # Errors
    /// [`AssetError::UnknownUid`], [`AssetError::NotYetGenerated`], or an error of generating or loading the object.
    pub fn build<Q: AsRef<str> + ?Sized>(&self, uid: &Q) -> Result<Arc<ObjectModel>, AssetError>
    where
        AssetUid: Borrow<Q>,
    {
        let card = self.card(uid).ok_or_else(|| self.unknown(uid.as_ref()))?;
        if !matches!(card.asset, AssetRef::Builtin { .. }) {
            return self.model(&card.asset);
        }
        let recipe = self.recipes.get::<AssetUid>(&card.uid).ok_or_else(|| AssetError::NotYetGenerated {
            uid: card.uid.clone(),
            name: card.name.clone(),
            missing: self.without_recipe(),
        })?;
        built(&self.models, &card.asset, || Ok(recipe.build(card, seed_of(&card.uid))))
    }

    /// Generates an object of a family, or a [`variant`] of a built-in object if the only parameter is `of`, its uid.
    fn generate(
        &self,
        family: &str,
        version: u32,
        params: &BTreeMap<String, Value>,
        seed: Seed,
    ) -> Result<ObjectModel, AssetError> {
        let refused = |reason: String| AssetError::NotGenerated { family: family.to_owned(), reason };
        let Some(of) = params.get(VARIANT_OF) else {
            return Families::builtin().instance_of(family, version, params, seed);
        };
        let Some(of) = of.as_str().filter(|_| params.len() == 1) else {
            return Err(refused(format!("expected only the parameter `{VARIANT_OF}`, the uid of a built-in object")));
        };
        let base = self.build(of)?;
        if base.family != family {
            return Err(refused(format!("object {of} is of family {}", base.family)));
        }
        if base.card.is_articulated {
            return Err(refused(format!("object {of} is articulated, which has no variants")));
        }
        Ok(variant(&base, seed))
    }

    /// Recipe of an object with all expressions evaluated, and the seed of its remaining randomness.
    ///
    /// # Errors
    /// If there is no such object, or it is imported or a variant, which have no recipe of their own.
    pub(crate) fn recipe(&self, asset: &AssetRef) -> Result<(Value, Seed), AssetError> {
        match asset {
            AssetRef::Builtin { uid, .. } => {
                let records: Vec<Value> = read(FILE, RECORDS)?;
                let record = records.into_iter().find(|record| record["uid"] == uid.as_str());
                let record = record.ok_or_else(|| self.unknown(uid.as_str()))?;
                Ok((record["recipe"].clone(), seed_of(uid)))
            }
            AssetRef::Generated { family, params, seed, version } if !params.contains_key(VARIANT_OF) => {
                Families::builtin().recipe_of(family, *version, params, *seed)
            }
            _ => Err(AssetError::NoRecipe { asset: asset.clone() }),
        }
    }

    fn without_recipe(&self) -> Vec<AssetUid> {
        let is_builtin = |card: &&ObjectCard| matches!(card.asset, AssetRef::Builtin { .. });
        let missing = self.cards.iter().filter(is_builtin).filter(|card| !self.recipes.contains_key(&card.uid));
        missing.map(|card| card.uid.clone()).collect()
    }

    fn unknown(&self, uid: &str) -> AssetError {
        AssetError::UnknownUid { got: uid.into(), near: self.near_misses(uid) }
    }

    /// Up to three suggestions `uid (name)`: names that contain the text or share a word with it, then similar uids.
    fn near_misses(&self, text: &str) -> Vec<String> {
        let wanted = text.to_lowercase();
        let mut scored: Vec<(usize, &ObjectCard)> = self
            .cards
            .iter()
            .filter_map(|card| {
                let name = card.name.to_lowercase();
                let shares_word = wanted.split_whitespace().any(|word| word.len() > 2 && name.contains(word));
                let uid = card.uid.as_str();
                let same_number = wanted.trim_start_matches('0') == uid.trim_start_matches('0');
                let typos = uid.chars().zip(wanted.chars()).filter(|(a, b)| a != b).count();
                match () {
                    () if same_number || name == wanted => Some((0, card)),
                    () if shares_word => Some((1, card)),
                    () if wanted.len() == uid.len() && typos == 1 => Some((2, card)),
                    () => None,
                }
            })
            .collect();
        scored.sort_by_key(|(score, _)| *score);
        scored.iter().take(3).map(|(_, card)| format!("{} ({})", card.uid, card.name)).collect()
    }
}

impl AssetSource for Catalogue {
    fn cards(&self) -> &[ObjectCard] {
        &self.cards
    }

    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError> {
        match asset {
            AssetRef::Builtin { uid, .. } => self.build(uid),
            AssetRef::Generated { family, params, seed, version } => {
                built(&self.models, asset, || self.generate(family, *version, params, *seed))
            }
            AssetRef::Imported { .. } => match imported::source() {
                Some(source) => source.model(asset),
                None => Err(AssetError::NotImported { asset: asset.clone() }),
            },
        }
    }

    fn hashes(&self, asset: &AssetRef) -> Result<AssetHashes, AssetError> {
        if let Some(hashes) = locked(&self.hashes).get(asset) {
            return Ok(hashes.clone());
        }
        let hashes = self.model(asset)?.hashes();
        locked(&self.hashes).insert(asset.clone(), hashes.clone());
        Ok(hashes)
    }

    fn full_mesh_model(&self, asset: &AssetRef) -> Result<(Arc<ObjectModel>, String), AssetError> {
        let model = built(&self.full_mesh_models, asset, || Ok(self.model(asset)?.with_full_meshes()))?;
        let looks = || model.looks_hash();
        let looks = locked(&self.full_mesh_looks).entry(asset.clone()).or_insert_with(looks).clone();
        Ok((model, looks))
    }
}

/// Model from the built ones, or built now. No lock is held meanwhile, since a variant asks for its base.
fn built(
    models: &Mutex<BuiltModels>,
    asset: &AssetRef,
    build: impl FnOnce() -> Result<ObjectModel, AssetError>,
) -> Result<Arc<ObjectModel>, AssetError> {
    if let Some(model) = locked(models).get(asset) {
        return Ok(model);
    }
    let model = build()?;
    Ok(locked(models).add(asset, model))
}

/// A panic of another thread leaves these values consistent, so a poisoned lock is used.
fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns an error for the first part that cannot be built.
pub(crate) fn check_parts(file: &str, owner: &str, parts: &[Part]) -> Result<(), AssetError> {
    match parts.iter().enumerate().find_map(|(index, part)| Some((index, part.flaw()?))) {
        Some((index, flaw)) => {
            Err(AssetError::Data { file: file.to_owned(), message: format!("{owner}.parts[{index}]: {flaw}") })
        }
        None => Ok(()),
    }
}

/// Seed of a built-in object: its uid if that is a number, so that the seed in a scenario is meaningful; otherwise
/// derived from the uid.
fn seed_of(uid: &AssetUid) -> Seed {
    let uid = uid.as_str();
    uid.parse().map_or_else(|_| Seed::new(0).fork(uid), Seed::new)
}
