//! Typical sizes, masses and materials by category: medians over the catalogue's objects.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::OnceLock;

use genmanip_assets::{Catalogue, Families};
use genmanip_core::ObjectCard;

/// Typical properties of a category.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Name of the category.
    pub category: String,
    /// Super-category.
    pub general_category: String,
    /// Median longest side, m.
    pub longest_m: f64,
    /// Median height as a fraction of the longest side.
    pub height_share: f64,
    /// Median mass, kg.
    pub mass_kg: f64,
    /// Median mass over the volume of the bounding box, kg/m³.
    pub bounds_density: f64,
    /// Most common materials.
    pub materials: Vec<String>,
    /// Most common affordances.
    pub affordances: Vec<String>,
    /// Synonyms of the category, most common first.
    synonyms: Vec<String>,
}

/// Category that matches a name best: by number of matching words, then by a match of the last word, then the category
/// name before synonyms in order, then alphabetically. `None` if no word matches.
pub fn of_name(name: &str) -> Option<&'static Prior> {
    let words: Vec<String> = name.to_lowercase().split(|c: char| !c.is_alphanumeric()).map(singular).collect();
    let last = words.iter().rposition(|word| word.chars().any(char::is_alphabetic));
    let rank = |prior: &Prior| {
        let named = std::iter::once(&prior.category).chain(&prior.synonyms);
        named
            .map(|phrase| {
                let phrase: Vec<String> = phrase.to_lowercase().split_whitespace().map(singular).collect();
                let fits = !phrase.is_empty() && phrase.iter().all(|word| words.contains(word));
                let ends = last.is_some_and(|last| phrase.last() == Some(&words[last]));
                fits.then_some((phrase.len(), ends))
            })
            .enumerate()
            .filter_map(|(place, found)| found.map(|(words, ends)| (words, ends, Reverse(place))))
            .max()
    };
    // Iterate backwards, because `max_by_key` returns the last of several maxima.
    let ranked = priors().iter().rev().filter_map(|prior| Some((rank(prior)?, prior)));
    ranked.max_by_key(|(rank, _)| *rank).map(|(_, prior)| prior)
}

fn singular(word: &str) -> String {
    let cut = if word.ends_with("ss") { word } else { word.strip_suffix('s').unwrap_or(word) };
    cut.to_owned()
}

fn priors() -> &'static [Prior] {
    static PRIORS: OnceLock<Vec<Prior>> = OnceLock::new();
    PRIORS.get_or_init(|| {
        let mut cards: BTreeMap<&str, Vec<&ObjectCard>> = BTreeMap::new();
        for card in Catalogue::full().cards() {
            cards.entry(&card.category).or_default().push(card);
        }
        cards.into_iter().map(|(category, cards)| of_cards(category, &cards)).collect()
    })
}

fn of_cards(category: &str, cards: &[&ObjectCard]) -> Prior {
    let median = |of: &dyn Fn(&ObjectCard) -> f64| {
        let mut values: Vec<f64> = cards.iter().map(|card| of(card)).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    Prior {
        category: category.to_owned(),
        general_category: cards[0].general_category.clone(),
        longest_m: median(&|card| card.size_m.max_element()),
        height_share: median(&|card| card.size_m.z / card.size_m.max_element()),
        mass_kg: median(&|card| card.mass_kg),
        bounds_density: median(&|card| card.mass_kg / card.size_m.element_product().max(1e-9)),
        materials: cards[0].materials.clone(),
        affordances: cards[0].annotations.affordances.clone(),
        synonyms: Families::builtin().of_category(category).map_or_else(Vec::new, |family| family.synonyms.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_find_their_category() {
        let named = [
            ("mug", "mug"),
            ("Bananas", "banana"),
            ("old red mug 3", "mug"),
            ("Hammer", "hammer"),
            // Crisp tubes have "can" only as their last synonym.
            ("Can", "food tin"),
        ];
        for (name, category) in named {
            assert_eq!(of_name(name).map(|prior| prior.category.as_str()), Some(category), "{name}");
        }
        assert_eq!(of_name("xqzw 17"), None);
        let mug = of_name("mug").unwrap();
        assert!((0.06..0.2).contains(&mug.longest_m) && (0.1..0.8).contains(&mug.mass_kg));
    }
}
