//! Vocabulary of the independent reader, from `data/references/lexicon.json`. The designer does not use it.

mod authors;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use genmanip_core::{InstanceId, ObjectCard};
use serde::Deserialize;

#[allow(clippy::expect_used)]
static LEXICON: LazyLock<Lexicon> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../../data/references/lexicon.json")).expect("valid; a test reads it")
});

/// Share of the largest volume among objects of its kind below which an object is `small`. Chosen by hand.
const SMALL: f64 = 0.6;

/// Words that compare the size of an object with that of another one.
pub(super) const COMPARATIVES: [&str; 6] = ["larger", "bigger", "largest", "biggest", "smaller", "smallest"];

/// Words without a meaning of their own inside a description.
const EMPTY: [&str; 15] =
    ["the", "a", "an", "of", "its", "and", "with", "my", "some", "at", "each", "both", "one", "in", "on"];

/// Words that introduce a description of the appearance after the noun.
const TRAITS: [&str; 7] = ["with", "without", "lettered", "marked", "full", "in", "on"];

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Lexicon {
    /// Nouns and the sorts that they may mean, in the syntax of [`is_of`].
    heads: BTreeMap<String, Vec<String>>,
    /// Nouns that may mean any object.
    everything: Vec<String>,
    /// Nouns of objects that are not in the catalogue, and the sorts that come closest: offered, never taken.
    nearby: BTreeMap<String, Vec<String>>,
    /// Nouns, and sorts that they may also mean in a scene, but that the author of a sentence does not mean.
    unlikely: BTreeMap<String, Vec<String>>,
    /// Words before `of` that say in which form or amount something is there: `pack of crisps`.
    amounts: Vec<String>,
    /// Nouns that may mean several objects although they are no plurals: `all the fruit`.
    collective: Vec<String>,
    /// Nouns that always mean several objects: `the cutlery`.
    always_collective: Vec<String>,
    /// Irregular plurals, each with its singular.
    plurals: BTreeMap<String, String>,
    colors: BTreeSet<String>,
    small: Vec<String>,
    large: Vec<String>,
    /// Adjectives and the words of a card's text that confirm them; `*` always holds.
    synonyms: BTreeMap<String, Vec<String>>,
    /// Noun phrases whose meaning depends on the context, such as a need stated before.
    vague: Vec<String>,
    /// Sorts of objects, each with the beginnings of phrases that state a need which the sort meets.
    helps: BTreeMap<String, Vec<String>>,
}

/// An object of the scene with its card.
#[derive(Clone, Copy, Debug)]
pub(super) struct SceneObject<'c, Id = &'c InstanceId> {
    /// Id of the object in the graph; `()` for an object of a catalogue.
    pub id: Id,
    /// Card of the object.
    pub card: &'c ObjectCard,
}

/// Words of a noun phrase before the descriptions that follow its noun: `the mug` of `the mug with a red rim`.
fn undescribed<'p, 'w>(words: &'p [&'w str]) -> &'p [&'w str] {
    let end = words.iter().position(|word| TRAITS.contains(word) || *word == "of");
    &words[..end.unwrap_or(words.len())]
}

/// True if the word names a colour.
pub(super) fn is_color(word: &str) -> bool {
    LEXICON.colors.contains(word)
}

pub(super) fn lexicon() -> &'static Lexicon {
    &LEXICON
}

impl Lexicon {
    /// Objects that a noun phrase without relative clause may mean; `None` if its noun is unknown.
    pub fn denote<'c, Id: Copy>(
        &self,
        words: &[&str],
        context: &str,
        things: &[SceneObject<'c, Id>],
    ) -> Option<Vec<SceneObject<'c, Id>>> {
        if self.vague.contains(&words.join(" ")) {
            return Some(self.by_need(context, things));
        }
        let with = words.iter().position(|word| TRAITS.contains(word)).unwrap_or(words.len());
        let (core, trait_words) = words.split_at(with);
        let of = core.iter().position(|word| *word == "of").unwrap_or(core.len());
        let (front, tail) = core.split_at(of);
        let (head, adjectives) = self.head(front)?;
        let (mut meant, tail) = match self.by_head(&head, things) {
            Some(meant) => (meant, tail),
            // The noun after `of` says what a pack contains: `pack of crisps`.
            None if !self.amounts.contains(&head) => return None,
            None => (self.by_head(&self.singular(tail.last()?), things)?, &tail[..0]),
        };
        // `can of tuna` means a flat tin, although `can` alone does not.
        let is_content =
            |thing: &SceneObject<'c, Id>| tail.iter().skip(1).all(|word| self.is_borne_out(word, thing.card));
        if let Some(content) = tail.last().filter(|_| tail.len() == 2 && !meant.iter().any(is_content))
            && let Some(sorts) = self.heads.get(*content)
        {
            meant = things.iter().copied().filter(|thing| sorts.iter().any(|sort| is_of(sort, thing.card))).collect();
        }
        let extra = tail.iter().chain(trait_words).filter(|word| !EMPTY.contains(word) && **word != "without");
        // Colours of parts are listed in the description, colours of the object in the card's own field.
        meant.retain(|thing| extra.clone().all(|word| self.is_borne_out(word, thing.card)));
        let split: Vec<&str> = adjectives.iter().flat_map(|word| self.parts(word, things)).collect();
        let (colors, others): (Vec<&str>, Vec<&str>) = split.into_iter().partition(|word| self.colors.contains(*word));
        for word in others.iter().filter(|word| !EMPTY.contains(word)) {
            meant = self.restrict(word, meant);
        }
        for color in colors {
            meant = with_color(color, meant);
        }
        // `cream jar` is a category as well as a colour and a noun.
        if meant.is_empty() {
            let category = words.join(" ");
            meant = things.iter().filter(|thing| thing.card.category == category).copied().collect();
        }
        Some(meant)
    }

    /// Noun of a phrase, of up to three words such as `chess piece`, and the words before it; `None` without words.
    fn head<'p, 'w>(&self, phrase: &'p [&'w str]) -> Option<(String, &'p [&'w str])> {
        let (last, before) = phrase.split_last()?;
        let last = self.singular(last);
        let joined = |count: usize| {
            let (rest, front) = before.split_at(before.len().checked_sub(count)?);
            let noun = format!("{} {last}", front.join(" "));
            self.heads.contains_key(&noun).then_some((noun, rest))
        };
        Some(joined(2).or_else(|| joined(1)).unwrap_or((last, before)))
    }

    /// True if the word is in the vocabulary.
    pub fn contains(&self, word: &str) -> bool {
        self.heads.contains_key(&self.singular(word)) || self.is_adjective(word) || EMPTY.contains(&word)
    }

    /// True if the word names objects.
    pub fn is_noun(&self, word: &str) -> bool {
        self.heads.contains_key(&self.singular(word))
    }

    /// True if the word describes an object without naming it.
    pub fn is_adjective(&self, word: &str) -> bool {
        self.colors.contains(word)
            || self.synonyms.contains_key(word)
            || TRAITS.contains(&word)
            || COMPARATIVES.contains(&word)
            || self.small.iter().chain(&self.large).any(|size| size == word)
    }

    /// True if the word describes the size of an object among others of its kind.
    pub fn is_size(&self, word: &str) -> bool {
        self.small.iter().chain(&self.large).any(|size| size == word)
    }

    /// True if the word may mean any object.
    pub fn means_anything(&self, word: &str) -> bool {
        self.everything.iter().any(|any| *any == self.singular(word)) || ["what", "one", "ones"].contains(&word)
    }

    /// True if the noun may mean the object.
    pub fn names(&self, noun: &str, card: &ObjectCard) -> bool {
        self.heads.get(&self.singular(noun)).is_some_and(|sorts| sorts.iter().any(|sort| is_of(sort, card)))
    }

    fn by_head<'c, Id: Copy>(&self, head: &str, things: &[SceneObject<'c, Id>]) -> Option<Vec<SceneObject<'c, Id>>> {
        if self.everything.iter().any(|word| word == head) {
            return Some(things.to_vec());
        }
        let named = |thing: &&SceneObject<'_, Id>| thing.card.name.to_lowercase().split(' ').next_back() == Some(head);
        match self.heads.get(head) {
            Some(sorts) => {
                let meant: Vec<SceneObject<'_, Id>> =
                    things.iter().copied().filter(|thing| sorts.iter().any(|sort| is_of(sort, thing.card))).collect();
                let exact: Vec<SceneObject<'_, Id>> = meant.iter().filter(named).copied().collect();
                // `novel`, `cookbook` and `dictionary` mean objects whose name ends in that word, although the category
                // is `book`.
                let is_sort = ["novel", "cookbook", "dictionary", "paperback"].contains(&head);
                if is_sort && head != "paperback" {
                    return Some(exact);
                }
                if head == "paperback" {
                    return Some(meant.into_iter().filter(|thing| text(thing.card).contains("paperback")).collect());
                }
                Some(meant)
            }
            None => {
                let exact: Vec<SceneObject<'_, Id>> = things.iter().filter(named).copied().collect();
                let labelled =
                    |thing: &&SceneObject<'_, Id>| thing.card.name.to_lowercase().split(' ').any(|word| word == head);
                let meant = if exact.is_empty() { things.iter().filter(labelled).copied().collect() } else { exact };
                (!meant.is_empty()).then_some(meant)
            }
        }
    }

    /// Objects that meet the need stated in the context; all objects if the context states no known need.
    fn by_need<'c, Id: Copy>(&self, context: &str, things: &[SceneObject<'c, Id>]) -> Vec<SceneObject<'c, Id>> {
        let is_word = |c: char| c.is_alphanumeric() || c == '\'' || c == '-';
        let words: Vec<&str> = context.split(|c| !is_word(c)).filter(|word| !word.is_empty()).collect();
        let said = format!(" {} ", words.join(" "));
        let known = |phrase: &String| said.contains(&format!(" {phrase}"));
        let remedies: Vec<&String> =
            self.helps.iter().filter(|(_, phrases)| phrases.iter().any(known)).map(|(sort, _)| sort).collect();
        let fits =
            |thing: &&SceneObject<'_, Id>| remedies.is_empty() || remedies.iter().any(|sort| is_of(sort, thing.card));
        things.iter().filter(fits).copied().collect()
    }

    fn restrict<'c, Id: Copy>(&self, word: &str, meant: Vec<SceneObject<'c, Id>>) -> Vec<SceneObject<'c, Id>> {
        let volume = |card: &ObjectCard| card.size_m.element_product();
        let largest = meant.iter().map(|thing| volume(thing.card)).fold(0.0, f64::max);
        let smallest = meant.iter().map(|thing| volume(thing.card)).fold(f64::INFINITY, f64::min);
        let by = |keep: &dyn Fn(&ObjectCard) -> bool| {
            meant.iter().copied().filter(|thing| keep(thing.card)).collect::<Vec<_>>()
        };
        let says = |card: &ObjectCard| self.is_borne_out(word, card);
        if self.small.iter().any(|small| small == word) && meant.len() > 1 {
            let small = by(&|card| volume(card) < SMALL * largest || (says(card) && volume(card) < largest));
            return if small.is_empty() { by(&says) } else { small };
        }
        if self.large.iter().any(|large| large == word) && meant.len() > 1 {
            return by(&|card| SMALL * volume(card) > smallest && volume(card) > 0.8 * largest);
        }
        match word {
            "larger" | "bigger" | "largest" | "biggest" => by(&|card| volume(card) == largest && largest > smallest),
            "smaller" | "smallest" => by(&|card| volume(card) == smallest && largest > smallest),
            _ if self.small.iter().chain(&self.large).any(|size| size == word) => meant,
            _ => by(&says),
        }
    }

    /// True if the text of the card contains the word or a synonym of it.
    fn is_borne_out(&self, word: &str, card: &ObjectCard) -> bool {
        let known = self.synonyms.get(word).map_or(&[][..], Vec::as_slice);
        if known.iter().any(|word| word == "*") {
            return true;
        }
        let text = text(card);
        let tokens: Vec<String> = text.split(|c: char| !c.is_alphanumeric() && c != '-').map(stem).collect();
        let stated = |word: &str| {
            let wanted = stem(word);
            tokens.iter().any(|token| *token == wanted || token.split('-').any(|part| stem(part) == wanted))
        };
        stated(word) || known.iter().any(|word| stated(word))
    }

    /// Splits a hyphenated word: `dark-red` is one word if an object of the scene has that colour, otherwise two.
    fn parts<'w, Id: Copy>(&self, word: &'w str, things: &[SceneObject<'_, Id>]) -> Vec<&'w str> {
        let is_color =
            self.colors.contains(word) && things.iter().any(|thing| thing.card.colors.iter().any(|c| c == word));
        match is_color || self.synonyms.contains_key(word) {
            true => vec![word],
            false => word.split('-').collect(),
        }
    }

    /// The noun of a phrase without its descriptions; phrases that depend on the context stay complete.
    pub fn bare<'w>(&self, words: &[&'w str]) -> Vec<&'w str> {
        if self.vague.contains(&words.join(" ")) {
            return words.to_vec();
        }
        undescribed(words).last().copied().into_iter().collect()
    }

    /// True if the word is the plural of a noun for whole objects rather than for the content of one.
    pub fn is_plural(&self, word: &str) -> bool {
        let one = self.singular(word);
        let sorts = self.heads.get(&one);
        let is_content = |sort: &String| {
            sort.split_once(':').is_some_and(|(category, own)| (own == one || own == word) && category != one)
        };
        one != word && !sorts.is_some_and(|sorts| sorts.iter().all(is_content))
    }

    /// True if the noun may mean several objects, although it is no plural.
    pub fn is_collective(&self, word: &str) -> bool {
        self.collective.iter().chain(&self.always_collective).any(|noun| noun == word)
    }

    /// True if the noun means several objects, although it is no plural.
    pub fn is_always_collective(&self, word: &str) -> bool {
        self.always_collective.iter().any(|noun| noun == word)
    }

    /// Singular of a plural; any other word unchanged.
    pub fn singular(&self, word: &str) -> String {
        if let Some(one) = self.plurals.get(word) {
            return one.clone();
        }
        let one = word.strip_suffix('s').unwrap_or(word);
        if self.heads.contains_key(word) || !self.heads.contains_key(one) { word.to_owned() } else { one.to_owned() }
    }
}

/// True if the object is of a sort: a category, `category:word` with a word of its name, or `category:!word` without
/// that word.
fn is_of(sort: &str, card: &ObjectCard) -> bool {
    let Some((category, word)) = sort.split_once(':') else { return sort == card.category };
    let name = card.name.to_lowercase();
    let named = |wanted: &str| name.split(|c: char| !c.is_alphanumeric()).any(|word| word == wanted);
    category == card.category && word.strip_prefix('!').map_or_else(|| named(word), |other| !named(other))
}

/// Objects with this main colour; if there are none, objects with it as one of their colours.
fn with_color<'c, Id: Copy>(color: &str, meant: Vec<SceneObject<'c, Id>>) -> Vec<SceneObject<'c, Id>> {
    let main: Vec<SceneObject<'_, Id>> =
        meant.iter().copied().filter(|thing| thing.card.colors.first().is_some_and(|first| first == color)).collect();
    if main.is_empty() {
        meant.into_iter().filter(|thing| thing.card.colors.iter().any(|c| c == color)).collect()
    } else {
        main
    }
}

fn text(card: &ObjectCard) -> String {
    format!("{} {} {} {} {}", card.name, card.description, card.category, card.materials.join(" "), card.shape)
        .to_lowercase()
}

fn stem(word: &str) -> String {
    let word = word.strip_suffix("ed").or_else(|| word.strip_suffix("es")).unwrap_or(word);
    word.strip_suffix('s').unwrap_or(word).to_owned()
}
