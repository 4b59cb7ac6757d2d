//! Family of objects: generates objects with annotations from a seed and parameters.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{Aabb, Annotations, AssetRef, AssetUid, CavitySize, ObjectCard, ObjectModel, Pose, Seed};
use glam::DVec3;
use rand::RngExt;
use serde::Deserialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::expression::{Scope, evaluate, is_true, number, takes_an};
use super::template::{Library, expand};
use crate::recipe::Recipe;

/// Maximum depth of parameters that are defined by other parameters.
const MAX_CHAIN: usize = 40;

/// Family of objects, as defined in its data file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Family {
    /// Name of the family, e.g. `mug`; prefix of its objects' uids.
    pub family: String,
    /// Version, incremented when the physics of its objects change.
    pub version: u32,
    /// Earlier versions, so that old scenarios can still be opened.
    #[serde(default)]
    earlier: Vec<Earlier>,
    /// Category path from general to specific, e.g. tableware, drinkware, mug.
    pub path: Vec<String>,
    /// True if the whole family is held out for testing.
    #[serde(default)]
    pub unseen: bool,
    /// True if the objects have joints.
    #[serde(default)]
    pub articulated: bool,
    /// Synonyms of the category, for search and identification.
    pub synonyms: Vec<String>,
    /// Everyday uses of the objects, for search.
    pub uses: Vec<String>,
    /// Accepted answers to "what is this?", besides category and synonyms.
    #[serde(default)]
    pub also_named: Vec<String>,
    /// Affordances by part name, where the name alone does not imply them.
    #[serde(default)]
    pub part_affordances: BTreeMap<String, Vec<String>>,
    /// Parameters: fixed values, ranges `[low, high]` (uniform), lists to choose from, `{"palette": NAMES, "not":
    /// EXPRESSION}` (a colour of these palettes other than this word), `{"whole": [low, high]}` (an integer), or
    /// `=expressions`.
    vars: BTreeMap<String, Value>,
    /// Templates of the objects' descriptions.
    card: CardTemplate,
    /// Templates of the recipe's parts.
    parts: Vec<Value>,
    /// Templates of the moving links.
    #[serde(default)]
    links: Vec<Value>,
    /// Templates of the joint states.
    #[serde(default)]
    states: Vec<Value>,
}

/// Earlier version of a family, stored as the difference from the current one.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Earlier {
    version: u32,
    /// Parameters that were defined differently.
    vars: BTreeMap<String, Value>,
}

/// Templates of an object's description, with expressions.
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
    #[serde(default = "default_friction")]
    friction: Value,
    #[serde(default)]
    container: bool,
    /// True if an 8 cm gripper can grasp the object.
    #[serde(default = "yes")]
    grasp: Value,
    #[serde(default)]
    fragile: Value,
    #[serde(default)]
    upright_only: Value,
    #[serde(default)]
    affordances: Vec<String>,
}

/// Description templates after evaluation.
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
    /// Category of the objects: the last entry of the path.
    pub fn category(&self) -> &str {
        self.path.last().map_or("", String::as_str)
    }

    /// Family as of an earlier version; the current one if there is no such version.
    pub fn in_version(&self, version: u32) -> Cow<'_, Self> {
        let Some(earlier) = self.earlier.iter().find(|earlier| earlier.version == version) else {
            return Cow::Borrowed(self);
        };
        let mut family = Self { version, ..self.clone() };
        family.vars.extend(earlier.vars.clone());
        Cow::Owned(family)
    }

    /// Names of the family's parameters.
    pub fn parameters(&self) -> impl Iterator<Item = &String> {
        self.vars.keys()
    }

    /// Root seed of an object's random streams, different for each family.
    pub(crate) fn stream(&self, seed: Seed) -> Seed {
        seed.fork(&self.family)
    }

    /// Recipe of an object with all expressions evaluated.
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
        self.expand(params, seed, palettes, library).map(|(_, recipe)| recipe)
    }

    /// Generates an object; `params` fixes some of its parameters.
    ///
    /// # Errors
    /// An invalid parameter, or an invalid template.
    pub fn instance(
        &self,
        params: &BTreeMap<String, Value>,
        seed: Seed,
        palettes: &BTreeMap<String, Value>,
        library: &Library,
    ) -> Result<ObjectModel, String> {
        let (words, recipe) = self.expand(params, seed, palettes, library)?;
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

    fn expand(
        &self,
        params: &BTreeMap<String, Value>,
        seed: Seed,
        palettes: &BTreeMap<String, Value>,
        library: &Library,
    ) -> Result<(Words, Value), String> {
        if let Some(unknown) = params.keys().find(|name| !self.vars.contains_key(*name)) {
            let known: Vec<&str> = self.vars.keys().map(String::as_str).collect();
            return Err(format!("unknown parameter `{unknown}`; known parameters: {}", known.join(", ")));
        }
        let seed = self.stream(seed);
        let scope =
            ParameterScope { family: self, params, seed, palettes, known: RefCell::default(), chain: Cell::default() };
        let words = self.words(&scope, library)?;
        let recipe = serde_json::json!({
            "family": self.family,
            "friction": words.friction,
            "parts": expanded(&self.parts, &scope, library)?,
            "links": expanded(&self.links, &scope, library)?,
            "states": expanded(&self.states, &scope, library)?,
        });
        Ok((words, recipe))
    }

    fn words(&self, scope: &ParameterScope, library: &Library) -> Result<Words, String> {
        let card = &self.card;
        let one = |template: &Value| expand(template, scope, library);
        let truth = |template: &Value| one(template).map(|value| Value::Bool(is_true(&value)));
        read(serde_json::json!({
            "name": one(&card.name)?,
            "description": one(&card.description)?,
            "looks": expanded(&card.looks, scope, library)?,
            "colors": distinct(expanded(&card.colors, scope, library)?),
            "materials": distinct(expanded(&card.materials, scope, library)?),
            "shape": one(&card.shape)?,
            "mass_kg": one(&card.mass_kg)?,
            "friction": one(&card.friction)?,
            "grasp": truth(&card.grasp)?,
            "fragile": truth(&card.fragile)?,
            "upright_only": truth(&card.upright_only)?,
        }))
    }

    fn card(&self, words: Words, params: &BTreeMap<String, Value>, seed: Seed, recipe: &Recipe) -> ObjectCard {
        let room: Option<CavitySize> = if self.articulated { None } else { recipe.room() };
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

    /// Uid of an object: family name and seed, with a hash of the fixed parameters if there are any.
    fn uid(&self, params: &BTreeMap<String, Value>, seed: Seed) -> AssetUid {
        let name = self.family.replace(' ', "-");
        if params.is_empty() {
            return format!("{name}-{}", seed.value()).into();
        }
        let text = serde_json::to_string(params).unwrap_or_default();
        let digest = Sha256::digest(text.as_bytes());
        format!("{name}-{}-{:02x}{:02x}{:02x}", seed.value(), digest[0], digest[1], digest[2]).into()
    }
}

/// Parameter values of one object; each is taken from the fixed ones, sampled or derived when it is first used.
struct ParameterScope<'a> {
    family: &'a Family,
    params: &'a BTreeMap<String, Value>,
    seed: Seed,
    palettes: &'a BTreeMap<String, Value>,
    known: RefCell<BTreeMap<String, Value>>,
    chain: Cell<usize>,
}

impl ParameterScope<'_> {
    fn sampled(&self, name: &str, spec: &Value) -> Result<Value, String> {
        let pick = |items: &[Value]| {
            let index = self.seed.fork(name).rng().random_range(0..items.len().max(1));
            items.get(index).cloned().ok_or_else(|| format!("`{name}` has no options"))
        };
        let chosen = match spec {
            Value::Array(items) => match items.as_slice() {
                [low, high] if low.is_number() && high.is_number() => {
                    let (low, high) = (low.as_f64().unwrap_or(0.0), high.as_f64().unwrap_or(0.0));
                    let value = low + (high - low) * self.seed.fork(name).rng().random::<f64>();
                    // Rounded to four decimals: 0.1 mm for lengths, which are in metres.
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

impl Scope for ParameterScope<'_> {
    fn value(&self, name: &str) -> Result<Value, String> {
        if let Some(value) = self.params.get(name).or(self.known.borrow().get(name)) {
            return Ok(value.clone());
        }
        let spec = self.family.vars.get(name).ok_or_else(|| format!("there is no `{name}`"))?;
        if self.chain.get() >= MAX_CHAIN {
            return Err(format!("`{name}` depends on itself"));
        }
        self.chain.set(self.chain.get() + 1);
        let value = self.sampled(name, spec);
        self.chain.set(self.chain.get() - 1);
        let value = value?;
        self.known.borrow_mut().insert(name.to_owned(), value.clone());
        Ok(value)
    }

    fn stream(&self, label: &str) -> Seed {
        self.seed.fork("draw").fork(label)
    }
}

/// Default friction coefficient: painted wood, plastic, glazed ware.
fn default_friction() -> Value {
    number(0.55)
}

fn yes() -> Value {
    Value::Bool(true)
}

/// Expands a list of templates, splicing those that expand to several items.
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

/// Normalises whitespace and punctuation, and picks the matching article `a` or `an`.
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

/// Size (m) rounded to 0.1 mm.
fn rounded(size: DVec3) -> DVec3 {
    (size * 1e4).round() / 1e4
}

/// Reason why a generated object is implausible (size, base height, mass); `None` if it is plausible.
fn flaw_of(bounds: &Aabb, model: &ObjectModel) -> Option<String> {
    let size = bounds.size();
    let masses = model.links.iter().all(|link| link.mass.mass_kg > 0.0 && link.mass.inertia.is_finite());
    match () {
        () if !size.is_finite() || size.min_element() < 0.002 || size.max_element() > 0.6 => {
            Some(format!("its size is {size} m"))
        }
        () if bounds.min.z.abs() > 1e-3 => Some(format!("its lowest point is at z = {} m", bounds.min.z)),
        () if !masses => Some("a link has no mass".into()),
        () => None,
    }
}
