//! Keyword search over objects: names, categories, synonyms, uses, colours, materials; with negation and filters.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::ObjectCard;
use serde::Serialize;

use crate::metadata::{AssetMetadata, Split, asset_metadata};

/// Words that a query ignores.
const STOP_WORDS: &str = "a an the i me my we you it is are be am can could would something anything some any thing things \
                    object objects item that which who what with of for and to in on at from into onto one ones this \
                    these those want need has have having made please find show give kind sort like used use using \
                    as by very really good there where how much many do does";
/// Words that negate the following word.
const NEGATIONS: [&str; 6] = ["not", "no", "without", "isnt", "never", "non"];
/// Phrases in which a stop word matters, with the search word that replaces the phrase.
const PHRASES: [(&str, &str); 8] = [
    ("drink from", "drinkware"),
    ("drink out of", "drinkware"),
    ("drinking from", "drinkware"),
    ("eat from", "dishes"),
    ("eat with", "cutlery"),
    ("write with", "writing"),
    ("draw with", "writing"),
    ("wash with", "washing"),
];
/// Query words, each with an additional word that also matches, with 0.8 of the weight.
const SYNONYMS: [(&str, &str); 44] = [
    ("beverage", "drink"),
    ("drinking", "drink"),
    ("sip", "drink"),
    ("gray", "grey"),
    ("see-through", "transparent"),
    ("clear", "transparent"),
    ("wooden", "wood"),
    ("metallic", "metal"),
    ("steel", "metal"),
    ("fruit", "fruit"),
    ("veggie", "vegetable"),
    ("veg", "vegetable"),
    ("produce", "fruit"),
    ("hold", "container"),
    ("holds", "container"),
    ("store", "container"),
    ("receptacle", "container"),
    ("vessel", "container"),
    ("openable", "opens"),
    ("opened", "opens"),
    ("open", "opens"),
    ("writing", "write"),
    ("cutting", "cut"),
    ("slice", "cut"),
    ("eating", "eat"),
    ("food", "food"),
    ("toy", "toys"),
    ("cutlery", "utensil"),
    ("silverware", "utensil"),
    ("flatware", "utensil"),
    ("dishware", "tableware"),
    ("crockery", "tableware"),
    ("stationery", "office"),
    ("bathroom", "bathroom"),
    ("hygiene", "bathroom"),
    ("wash", "wash"),
    ("washing", "wash"),
    ("cleaning", "clean"),
    ("breakable", "fragile"),
    ("movable", "articulated"),
    ("joint", "articulated"),
    ("tv", "remote"),
    ("cooking", "cook"),
    ("lamp", "light"),
];

/// Conditions that every result meets; `None` for no condition.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Colour word that the card must have.
    pub color: Option<String>,
    /// Material that the card must have.
    pub material: Option<String>,
    /// Word that the category path must contain.
    pub category: Option<String>,
    /// Affordance that the object must have.
    pub affordance: Option<String>,
    /// True for containers only, false for others only.
    pub container: Option<bool>,
    /// True for graspable objects only, false for others only.
    pub graspable: Option<bool>,
    /// True for articulated objects only, false for rigid ones only.
    pub articulated: Option<bool>,
    /// Train/test split of the object.
    pub split: Option<Split>,
    /// Maximum length of the longest side, m.
    pub max_size_m: Option<f64>,
    /// Minimum length of the longest side, m.
    pub min_size_m: Option<f64>,
    /// Licence of the object.
    pub licence: Option<String>,
}

/// Object that a search found.
#[derive(Clone, Debug, Serialize)]
pub struct SearchResult<'a> {
    /// Card of the object.
    pub card: &'a ObjectCard,
    /// Relevance without unit, 0 for a query without words; higher is better.
    pub score: f64,
    /// Words of the query that match the object.
    pub matched: Vec<String>,
}

/// Inverted index over cards.
#[derive(Debug)]
pub struct Index {
    entries: Vec<(ObjectCard, AssetMetadata, Split)>,
    /// Objects that contain each word, by index into `entries`, with the largest weight of a field that contains it.
    postings: BTreeMap<String, Vec<(u32, f32)>>,
}

impl Index {
    /// Index of cards, each with its train/test split.
    pub fn new(cards: impl IntoIterator<Item = (ObjectCard, Split)>) -> Self {
        let mut entries = Vec::new();
        let mut postings: BTreeMap<String, Vec<(u32, f32)>> = BTreeMap::new();
        for (card, split) in cards {
            let metadata = asset_metadata(&card);
            let number = entries.len() as u32;
            let mut words: BTreeMap<String, f32> = BTreeMap::new();
            let mut add = |text: &str, weight: f32| {
                for word in words_of(text) {
                    let known = words.entry(word).or_insert(0.0);
                    *known = known.max(weight);
                }
            };
            add(card.uid.as_str(), 4.0);
            add(&card.name, 3.0);
            add(&card.category, 4.0);
            metadata.synonyms.iter().for_each(|text| add(text, 3.0));
            metadata.category_path.iter().for_each(|text| add(text, 2.5));
            card.colors.iter().for_each(|text| add(text, 2.0));
            card.materials.iter().for_each(|text| add(text, 2.0));
            card.annotations.affordances.iter().for_each(|text| add(text, 2.0));
            metadata.uses.iter().for_each(|text| add(text, 2.0));
            add(&card.shape, 1.0);
            add(&card.description, 1.0);
            card.states.iter().for_each(|text| add(text, 1.0));
            let tags = [
                (card.is_container, "container"),
                (card.is_articulated, "articulated opens"),
                (card.can_grasp, "graspable"),
                (card.annotations.fragile, "fragile"),
                (card.size_m.max_element() < 0.06, "small tiny little"),
                (card.size_m.max_element() > 0.2, "large big long"),
                (card.mass_kg < 0.06, "light"),
                (card.mass_kg > 0.5, "heavy"),
                (card.size_m.z > 2.0 * card.size_m.x.max(card.size_m.y), "tall"),
                (card.size_m.z < 0.25 * card.size_m.x.min(card.size_m.y), "flat"),
            ];
            tags.iter().filter(|(holds, _)| *holds).for_each(|(_, text)| add(text, 1.5));
            for (word, weight) in words {
                postings.entry(word).or_default().push((number, weight));
            }
            entries.push((card, metadata, split));
        }
        Self { entries, postings }
    }

    /// Searches objects: those that match the most query words and pass the filter, best first, at most `limit`;
    /// without words, all that pass the filter.
    ///
    /// "not", "no" and "without" exclude the next word, `-word` excludes a word, `key:value` filters.
    pub fn search(&self, query: &str, filter: &Filter, limit: usize) -> Vec<SearchResult<'_>> {
        let query = Query::read(query, filter);
        let mut scores: BTreeMap<u32, (f64, Vec<usize>)> = BTreeMap::new();
        for (index, word) in query.words.iter().enumerate() {
            for (number, weight) in self.matches(word) {
                let entry = scores.entry(number).or_default();
                entry.0 += weight;
                entry.1.push(index);
            }
        }
        let excluded: BTreeSet<u32> = query.without.iter().flat_map(|word| self.matches_strongly(word)).collect();
        let fits = |number: &u32| {
            let entry = &self.entries[*number as usize];
            !excluded.contains(number) && query.filter.holds(entry)
        };
        let mut found: Vec<(u32, f64, Vec<usize>)> = if query.words.is_empty() {
            (0..self.entries.len() as u32).filter(fits).map(|number| (number, 0.0, Vec::new())).collect()
        } else {
            scores
                .into_iter()
                .filter(|(number, _)| fits(number))
                .map(|(number, (s, words))| (number, s, words))
                .collect()
        };
        let most = found.iter().map(|(_, _, words)| words.len()).max().unwrap_or(0);
        found.retain(|(_, _, words)| words.len() == most);
        found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        found.truncate(limit);
        let shown = |(number, score, words): (u32, f64, Vec<usize>)| SearchResult {
            card: &self.entries[number as usize].0,
            score,
            matched: words.iter().map(|&index| query.words[index].clone()).collect(),
        };
        found.into_iter().map(shown).collect()
    }

    /// Objects that match a word or its synonym, with the field's weight times the word's inverse document frequency.
    fn matches(&self, word: &str) -> BTreeMap<u32, f64> {
        let also = SYNONYMS.iter().filter(|(from, _)| *from == word).map(|(_, to)| (*to, 0.8));
        let mut matches: BTreeMap<u32, f64> = BTreeMap::new();
        for (word, share) in std::iter::once((word, 1.0)).chain(also) {
            let Some(postings) = self.postings.get(word) else { continue };
            let rarity = (1.0 + self.entries.len() as f64 / postings.len() as f64).ln();
            for &(number, weight) in postings {
                let score = matches.entry(number).or_insert(0.0);
                *score = score.max(share * f64::from(weight) * rarity);
            }
        }
        matches
    }

    /// Objects that match a word or its synonym in a field other than shape, description and states (weight above 1.2).
    fn matches_strongly(&self, word: &str) -> Vec<u32> {
        let also = SYNONYMS.iter().filter(|(from, _)| *from == word).map(|(_, to)| *to);
        std::iter::once(word)
            .chain(also)
            .filter_map(|word| self.postings.get(word))
            .flatten()
            .filter(|(_, weight)| *weight > 1.2)
            .map(|(number, _)| *number)
            .collect()
    }
}

struct Query {
    words: Vec<String>,
    without: Vec<String>,
    filter: Filter,
}

impl Query {
    fn read(text: &str, filter: &Filter) -> Self {
        let (mut words, mut without, mut filter) = (Vec::new(), Vec::new(), filter.clone());
        let mut negated = false;
        let text = text.to_lowercase().replace('\'', "");
        let text = PHRASES.iter().fold(text, |text, (phrase, word)| text.replace(phrase, word));
        for raw in text.split_whitespace() {
            if let Some((key, value)) = raw.split_once(':').filter(|(key, value)| filter.set(key, value)) {
                let _ = (key, value);
                continue;
            }
            let (raw, minus) = raw.strip_prefix('-').map_or((raw, false), |rest| (rest, true));
            if NEGATIONS.contains(&raw.trim_matches(|c: char| !c.is_alphanumeric())) {
                negated = true;
                continue;
            }
            for word in words_of(raw) {
                if is_stop(&word) {
                    continue;
                }
                if negated || minus {
                    without.push(word)
                } else {
                    words.push(word)
                }
                negated = false;
            }
            // A comma, semicolon or "but" ends a clause and its negation.
            if raw.ends_with([',', ';']) || raw == "but" {
                negated = false;
            }
        }
        words.retain(|word| word != "but");
        words.dedup();
        Self { words, without, filter }
    }
}

impl Filter {
    /// Sets the condition with this name; returns false for an unknown name.
    pub fn set(&mut self, key: &str, value: &str) -> bool {
        let text = || Some(value.to_owned());
        let truth = || match value {
            "yes" | "true" => Some(true),
            "no" | "false" => Some(false),
            _ => None,
        };
        match key {
            "color" | "colour" => self.color = text(),
            "material" => self.material = text(),
            "category" => self.category = text(),
            "affordance" => self.affordance = text(),
            "licence" | "license" => self.licence = text(),
            "container" => self.container = truth(),
            "graspable" => self.graspable = truth(),
            "articulated" => self.articulated = truth(),
            "split" => {
                let all = [Split::Train, Split::UnseenInstance, Split::UnseenFamily];
                self.split = all.into_iter().find(|split| split.name() == value);
                return self.split.is_some();
            }
            "max-size" => self.max_size_m = value.parse().ok(),
            "min-size" => self.min_size_m = value.parse().ok(),
            _ => return false,
        }
        true
    }

    fn holds(&self, (card, metadata, split): &(ObjectCard, AssetMetadata, Split)) -> bool {
        let has = |wanted: &Option<String>, have: &[&[String]]| {
            let Some(wanted) = wanted else { return true };
            let wanted = words_of(wanted);
            have.iter()
                .flat_map(|texts| texts.iter())
                .any(|text| words_of(text).iter().any(|word| wanted.contains(word)))
        };
        let longest = card.size_m.max_element();
        has(&self.color, &[&card.colors])
            && has(&self.material, &[&card.materials])
            && has(&self.category, &[&metadata.category_path, std::slice::from_ref(&card.category)])
            && has(&self.affordance, &[&card.annotations.affordances])
            && self.licence.as_ref().is_none_or(|wanted| metadata.licence.eq_ignore_ascii_case(wanted))
            && self.container.is_none_or(|wanted| card.is_container == wanted)
            && self.graspable.is_none_or(|wanted| card.can_grasp == wanted)
            && self.articulated.is_none_or(|wanted| card.is_articulated == wanted)
            && self.split.is_none_or(|wanted| *split == wanted)
            && self.max_size_m.is_none_or(|most| longest <= most)
            && self.min_size_m.is_none_or(|least| longest >= least)
    }
}

fn is_stop(word: &str) -> bool {
    STOP_WORDS.split_whitespace().any(|stop| stop == word)
}

/// Words of a text in lower case and singular, including the parts of hyphenated words.
fn words_of(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    for raw in text.split(|c: char| !(c.is_alphanumeric() || c == '-' || c == '_')) {
        let raw = raw.trim_matches('-').to_lowercase();
        if raw.is_empty() {
            continue;
        }
        let parts: Vec<&str> = raw.split(['-', '_']).filter(|part| part.len() > 1).collect();
        if parts.len() > 1 {
            words.extend(parts.iter().map(|part| singular(part)));
        }
        words.push(singular(&raw));
    }
    words
}

fn singular(word: &str) -> String {
    let cut = |suffix: &str| word.strip_suffix(suffix).filter(|rest| rest.len() > 2);
    match () {
        () if word.ends_with("ss") || word.ends_with("us") || word.ends_with("is") => word.to_owned(),
        () if cut("ies").is_some() => format!("{}y", cut("ies").unwrap_or(word)),
        () if word.ends_with("ches") || word.ends_with("shes") || word.ends_with("xes") || word.ends_with("oes") => {
            cut("es").unwrap_or(word).to_owned()
        }
        () => cut("s").unwrap_or(word).to_owned(),
    }
}
