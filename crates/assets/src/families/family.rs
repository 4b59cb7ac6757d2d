//! One family: from a seed and what its parameters are set to, to an object with its annotations.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{Aabb, Annotations, AssetRef, ObjectCard, ObjectModel, Pose, Room, Seed};
use glam::DVec3;
use rand::RngExt;
use serde::Deserialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::expression::{Scope, evaluate, is_true, number, takes_an};
use super::template::{Library, expand};
use crate::recipe::Recipe;

/// Deepest chain of parameters that follow from one another.
const MAX_CHAIN: usize = 40;

/// A family of objects, as its data file has it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Family {
    /// Its own name, e.g. `mug`; it also starts the uids of its objects.
    pub family: String,
    /// Grows when the physics of its objects change.
    pub version: u32,
    /// What was different before, so that old scenarios still open.
    #[serde(default)]
    earlier: Vec<Earlier>,
    /// Path of its category, general first.
    pub path: Vec<String>,
    /// Whether it is kept for testing: no task of the training split has an object of it.
    #[serde(default)]
    pub unseen: bool,
    /// Whether its objects have joints.
    #[serde(default)]
    pub articulated: bool,
    /// Other words for it that people use.
    pub synonyms: Vec<String>,
    /// What its objects are used for from day to day.
    pub uses: Vec<String>,
    /// Answers to "what is this?" that count as right, besides category and synonyms.
    #[serde(default)]
    pub also_named: Vec<String>,
    /// What a part is for, by the name of the part, where the name alone does not say it.
    #[serde(default)]
    pub part_affordances: BTreeMap<String, Vec<String>>,
    /// Parameters: fixed values, `[low, high]`, lists to choose from, or `=expressions`.
    vars: BTreeMap<String, Value>,
    /// Templates of the card.
    card: CardTemplate,
    /// Template of the recipe's parts.
    parts: Vec<Value>,
    /// Template of its links.
    #[serde(default)]
    links: Vec<Value>,
    /// Template of what its states mean.
    #[serde(default)]
    states: Vec<Value>,
}

/// An earlier version of a family.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Earlier {
    version: u32,
    /// Parameters that were defined otherwise.
    vars: BTreeMap<String, Value>,
}

/// What is said of an object of a family, each a template.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CardTemplate {
    name: Value,
    description: Value,
    #[serde(default)]
    looks: Vec<Value>,
    colors: Vec<Value>,
    materials: Vec<Value>,
    shape: Value,
    mass_kg: Value,
    #[serde(default = "usual_friction")]
    friction: Value,
    #[serde(default)]
    container: bool,
    /// Whether it is meant to be taken by an 8 cm hand.
    #[serde(default = "yes")]
    grasp: Value,
    #[serde(default)]
    fragile: Value,
    #[serde(default)]
    upright_only: Value,
    #[serde(default)]
    affordances: Vec<String>,
}

/// What the words of a card come out as.
#[derive(Deserialize)]
struct Words {
    name: String,
    description: String,
    looks: Vec<String>,
    colors: Vec<String>,
    materials: Vec<String>,
    shape: String,
    mass_kg: f64,
    friction: f64,
    grasp: bool,
    fragile: bool,
    upright_only: bool,
}

impl Family {
    /// Its category, the last of its path.
    pub fn category(&self) -> &str {
        self.path.last().map_or("", String::as_str)
    }

    /// The family as it was in a version; as it is now where there was none.
    pub fn in_version(&self, version: u32) -> Cow<'_, Self> {
        let Some(earlier) = self.earlier.iter().find(|earlier| earlier.version == version) else {
            return Cow::Borrowed(self);
        };
        let mut family = Self { version, ..self.clone() };
        family.vars.extend(earlier.vars.clone());
        Cow::Owned(family)
    }

    /// Names of its parameters.
    pub fn parameters(&self) -> impl Iterator<Item = &String> {
        self.vars.keys()
    }

    /// Stream of everything that is drawn of the object of a seed: its own, so that objects of one seed differ from
    /// family to family.
    pub(crate) fn stream(&self, seed: Seed) -> Seed {
        seed.fork(&self.family)
    }

    /// The recipe of the object of a seed, all expressions worked out.
    ///
    /// # Errors
    /// As [`Family::instance`].
    pub(crate) fn recipe(
        &self,
        params: &BTreeMap<String, Value>,
        seed: Seed,
        palettes: &BTreeMap<String, Value>,
        library: &Library,
    ) -> Result<Value, String> {
        self.worked_out(params, seed, palettes, library).map(|(_, recipe)| recipe)
    }

    /// The object of a seed, with some parameters set.
    ///
    /// # Errors
    /// What is wrong with a parameter or, where the data is wrong, with a template.
    pub fn instance(
        &self,
        params: &BTreeMap<String, Value>,
        seed: Seed,
        palettes: &BTreeMap<String, Value>,
        library: &Library,
    ) -> Result<ObjectModel, String> {
        let (words, recipe) = self.worked_out(params, seed, palettes, library)?;
        let recipe: Recipe = read(recipe)?;
        let parts = recipe.parts.iter().chain(recipe.links.iter().flat_map(|link| &link.parts));
        if let Some(flaw) = parts.enumerate().find_map(|(index, part)| Some((index, part.flaw()?))) {
            return Err(format!("part {}: {}", flaw.0, flaw.1));
        }
        let card = self.card(words, params, seed, &recipe);
        if let Some(flaw) = recipe.flaw(&card) {
            return Err(flaw);
        }
        let mut model = recipe.build(&card, self.stream(seed));
        let closed = vec![0.0; model.joint_count()];
        model.card.size_m = rounded(model.world_bounds(&Pose::IDENTITY, &closed).size());
        let bounds = model.world_bounds(&Pose::IDENTITY, &closed);
        match flaw_of(&bounds, &model) {
            Some(flaw) => Err(flaw),
            None => Ok(model),
        }
    }

    fn worked_out(
        &self,
        params: &BTreeMap<String, Value>,
        seed: Seed,
        palettes: &BTreeMap<String, Value>,
        library: &Library,
    ) -> Result<(Words, Value), String> {
        if let Some(unknown) = params.keys().find(|name| !self.vars.contains_key(*name)) {
            let known: Vec<&str> = self.vars.keys().map(String::as_str).collect();
            return Err(format!("it has no parameter `{unknown}`, only {}", known.join(", ")));
        }
        let seed = self.stream(seed);
        let draw = Draw { family: self, params, seed, palettes, known: RefCell::default(), chain: Cell::default() };
        let words = self.words(&draw, library)?;
        let recipe = serde_json::json!({
            "family": self.family,
            "friction": words.friction,
            "parts": expanded(&self.parts, &draw, library)?,
            "links": expanded(&self.links, &draw, library)?,
            "states": expanded(&self.states, &draw, library)?,
        });
        Ok((words, recipe))
    }

    fn words(&self, draw: &Draw, library: &Library) -> Result<Words, String> {
        let card = &self.card;
        let one = |template: &Value| expand(template, draw, library);
        let truth = |template: &Value| one(template).map(|value| Value::Bool(is_true(&value)));
        read(serde_json::json!({
            "name": one(&card.name)?,
            "description": one(&card.description)?,
            "looks": expanded(&card.looks, draw, library)?,
            "colors": distinct(expanded(&card.colors, draw, library)?),
            "materials": distinct(expanded(&card.materials, draw, library)?),
            "shape": one(&card.shape)?,
            "mass_kg": one(&card.mass_kg)?,
            "friction": one(&card.friction)?,
            "grasp": truth(&card.grasp)?,
            "fragile": truth(&card.fragile)?,
            "upright_only": truth(&card.upright_only)?,
        }))
    }

    fn card(&self, words: Words, params: &BTreeMap<String, Value>, seed: Seed, recipe: &Recipe) -> ObjectCard {
        let room: Option<Room> = if self.articulated { None } else { recipe.room() };
        ObjectCard {
            uid: self.uid(params, seed),
            asset: AssetRef::Generated {
                family: self.family.clone(),
                params: params.clone(),
                seed,
                version: self.version,
            },
            name: tidy(&words.name),
            description: tidy(&words.description),
            category: self.category().to_owned(),
            general_category: self.path.first().cloned().unwrap_or_default(),
            colors: words.colors,
            materials: words.materials,
            shape: words.shape,
            size_m: DVec3::ZERO,
            mass_kg: (words.mass_kg * 1e4).round() / 1e4,
            is_container: self.card.container,
            is_articulated: self.articulated,
            states: recipe.states.iter().map(|state| state.name.clone()).collect(),
            can_grasp: words.grasp,
            annotations: Annotations {
                looks: words.looks.iter().map(|text| tidy(text)).collect(),
                room,
                fragile: words.fragile,
                upright_only: words.upright_only,
                affordances: self.card.affordances.clone(),
            },
        }
    }

    /// Name of family and seed, and a hash of what the parameters are set to.
    fn uid(&self, params: &BTreeMap<String, Value>, seed: Seed) -> String {
        let name = self.family.replace(' ', "-");
        if params.is_empty() {
            return format!("{name}-{}", seed.value());
        }
        let text = serde_json::to_string(params).unwrap_or_default();
        let digest = Sha256::digest(text.as_bytes());
        format!("{name}-{}-{:02x}{:02x}{:02x}", seed.value(), digest[0], digest[1], digest[2])
    }
}

/// The parameters of one object: set, drawn, or derived when they are asked for.
struct Draw<'a> {
    family: &'a Family,
    params: &'a BTreeMap<String, Value>,
    seed: Seed,
    palettes: &'a BTreeMap<String, Value>,
    known: RefCell<BTreeMap<String, Value>>,
    chain: Cell<usize>,
}

impl Draw<'_> {
    fn drawn(&self, name: &str, spec: &Value) -> Result<Value, String> {
        let pick = |items: &[Value]| {
            let index = self.seed.fork(name).rng().random_range(0..items.len().max(1));
            items.get(index).cloned().ok_or_else(|| format!("`{name}` has nothing to choose from"))
        };
        let chosen = match spec {
            Value::Array(items) => match items.as_slice() {
                [low, high] if low.is_number() && high.is_number() => {
                    let (low, high) = (low.as_f64().unwrap_or(0.0), high.as_f64().unwrap_or(0.0));
                    let value = low + (high - low) * self.seed.fork(name).rng().random::<f64>();
                    // A tenth of a millimetre is as fine as anything is made.
                    return Ok(number((value * 1e4).round() / 1e4));
                }
                items => pick(items)?,
            },
            Value::Object(fields) if fields.contains_key("palette") => {
                let wanted = &fields["palette"];
                let names = wanted.as_array().cloned().unwrap_or_else(|| vec![wanted.clone()]);
                let mut colors = Vec::new();
                for palette in names.iter().filter_map(Value::as_str) {
                    let known = self.palettes.get(palette).and_then(Value::as_array);
                    colors.extend(known.ok_or_else(|| format!("there is no palette `{palette}`"))?.clone());
                }
                if let Some(other) = fields.get("not").and_then(Value::as_str) {
                    let other = evaluate(other, self)?;
                    colors.retain(|color| color.get("word") != Some(&other));
                }
                return pick(&colors);
            }
            Value::Object(fields) if fields.contains_key("whole") => {
                let bounds = fields["whole"].as_array().filter(|bounds| bounds.len() == 2);
                let bounds = bounds.and_then(|bounds| Some((bounds[0].as_i64()?, bounds[1].as_i64()?)));
                let (low, high) = bounds.filter(|(low, high)| low <= high).ok_or("`whole` needs [low, high]")?;
                return Ok(number(self.seed.fork(name).rng().random_range(low..=high) as f64));
            }
            spec => spec.clone(),
        };
        expand(&chosen, self, &Library::new())
    }
}

impl Scope for Draw<'_> {
    fn value(&self, name: &str) -> Result<Value, String> {
        if let Some(value) = self.params.get(name).or(self.known.borrow().get(name)) {
            return Ok(value.clone());
        }
        let spec = self.family.vars.get(name).ok_or_else(|| format!("there is no `{name}`"))?;
        if self.chain.get() >= MAX_CHAIN {
            return Err(format!("`{name}` follows from itself"));
        }
        self.chain.set(self.chain.get() + 1);
        let value = self.drawn(name, spec);
        self.chain.set(self.chain.get() - 1);
        let value = value?;
        self.known.borrow_mut().insert(name.to_owned(), value.clone());
        Ok(value)
    }

    fn stream(&self, label: &str) -> Seed {
        self.seed.fork("draw").fork(label)
    }
}

/// Of most things against their like: painted wood, plastic, glazed ware.
fn usual_friction() -> Value {
    number(0.55)
}

fn yes() -> Value {
    Value::Bool(true)
}

/// A list of templates, each spliced where it stands for several.
fn expanded(templates: &[Value], scope: &dyn Scope, library: &Library) -> Result<Vec<Value>, String> {
    match expand(&Value::Array(templates.to_vec()), scope, library)? {
        Value::Array(items) => Ok(items),
        other => Err(format!("expected a list, got {other}")),
    }
}

fn distinct(values: Vec<Value>) -> Vec<Value> {
    let mut seen = BTreeSet::new();
    values.into_iter().filter(|value| seen.insert(value.to_string())).collect()
}

fn read<T: serde::de::DeserializeOwned>(value: Value) -> Result<T, String> {
    serde_path_to_error::deserialize(value).map_err(|error| error.to_string())
}

/// Single spaces, none before a comma or full stop, and the article that fits the word behind it.
fn tidy(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let fitting = |(index, word): (usize, &&str)| match (*word, words.get(index + 1)) {
        ("A" | "An", Some(next)) => if takes_an(next) { "An" } else { "A" }.to_owned(),
        ("a" | "an", Some(next)) => if takes_an(next) { "an" } else { "a" }.to_owned(),
        (word, _) => word.to_owned(),
    };
    let joined = words.iter().enumerate().map(fitting).collect::<Vec<_>>().join(" ");
    joined.replace(" ,", ",").replace(" .", ".")
}

/// To tenths of a millimetre.
fn rounded(size: DVec3) -> DVec3 {
    (size * 1e4).round() / 1e4
}

/// What no object may be, whatever its family's data says.
fn flaw_of(bounds: &Aabb, model: &ObjectModel) -> Option<String> {
    let size = bounds.size();
    let masses = model.links.iter().all(|link| link.mass.mass_kg > 0.0 && link.mass.inertia.is_finite());
    match () {
        () if !size.is_finite() || size.min_element() < 0.002 || size.max_element() > 0.6 => {
            Some(format!("it measures {size} m"))
        }
        () if bounds.min.z.abs() > 1e-3 => Some(format!("it starts at z = {} m", bounds.min.z)),
        () if !masses => Some("a link has no mass".into()),
        () => None,
    }
}
