//! Relation names and their alternative spellings.

use genmanip_core::Relation;

pub(super) fn relation_words() -> String {
    format!("one of {:?}", Relation::OF_PAIRS.map(Relation::name))
}

/// Unambiguous longer wordings; every prompt states that front is the far side.
pub(super) fn reworded(plain: &str) -> Option<Relation> {
    Some(match plain {
        "in front" | "in front of" | "front of" => Relation::Front,
        "behind" | "in back of" | "back of" => Relation::Back,
        "left of" | "to the left" | "to the left of" | "on the left of" => Relation::Left,
        "right of" | "to the right" | "to the right of" | "on the right of" => Relation::Right,
        "on top" | "on top of" | "top of" => Relation::Top,
        "inside" | "into" | "inside of" => Relation::In,
        "onto" | "upon" => Relation::On,
        _ => return None,
    })
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
