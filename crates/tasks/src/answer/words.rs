//! Relation names and their alternative spellings.

use genmanip_core::Relation;

pub(super) fn relation_words() -> String {
    format!("one of {:?}", Relation::OF_PAIRS.map(Relation::name))
}

/// Relation to one reference by its name or a longer spelling; `None` for other words.
pub(super) fn relation(plain: &str) -> Option<Relation> {
    let is_meant = |relation: &Relation| relation.name() == plain || relation.facts().spellings.contains(&plain);
    Relation::OF_PAIRS.into_iter().find(is_meant)
}

pub(super) fn is_table(name: &str) -> bool {
    let name = name.trim().to_ascii_lowercase();
    matches!(name.strip_prefix("the ").unwrap_or(&name), "table" | "tabletop" | "table top" | "desk" | "surface")
}

pub(super) fn same_name(one: &str, other: &str) -> bool {
    one.trim().eq_ignore_ascii_case(other.trim())
}

/// Beginning of a text, for messages.
pub(super) fn shortened(text: &str) -> String {
    if text.chars().count() <= 60 { text.to_owned() } else { text.chars().take(57).chain("...".chars()).collect() }
}
