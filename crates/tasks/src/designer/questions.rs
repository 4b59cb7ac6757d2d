//! Checks of a sentence before a scene is composed; what fails is a question to its author.

use std::collections::BTreeSet;

use genmanip_core::{ObjectCard, Relation};

use super::room::{support, why_no_room};
use super::sentence_error::SentenceError;
use super::things::{is_movable, things};
use crate::references::sentence::{Action, Command, Noun, Part, Sentence, Where, changed_state};

/// Maximum number of candidates that a question lists.
const MAX_CANDIDATES: usize = 6;

/// Checks that every phrase fits an object that can have its part in the request.
pub(super) fn check_nouns(sentence: &Sentence) -> Result<(), SentenceError> {
    for noun in &sentence.nouns {
        if noun.meant.is_empty() {
            let candidates = named(noun.alike.iter().copied());
            return Err(SentenceError::NoObject { phrase: noun.phrase.clone(), candidates });
        }
    }
    let unsuitable = |noun: &Noun, why| SentenceError::Unsuitable {
        phrase: noun.phrase.clone(),
        why,
        candidates: named(noun.meant.iter().copied()),
    };
    for command in sentence.alternatives.iter().flatten() {
        match command {
            Command::Put { subject, place } => {
                let subject = &sentence.nouns[*subject];
                if !subject.candidates().iter().any(|card| is_movable(card)) {
                    return Err(unsuitable(subject, "is nothing that the gripper can carry"));
                }
                let Some(&host) = place.references.first() else { continue };
                let host = &sentence.nouns[host];
                // `bring the stapler to the tape` hardly means onto it.
                let is_carrier = |host: &&ObjectCard| things().host(host).is_some() || host.is_container;
                if place.relations == [Relation::In, Relation::On, Relation::Top]
                    && !host.candidates().iter().any(is_carrier)
                {
                    return Err(unsuitable(host, "may be meant as a place next to it or on it: say which"));
                }
                let fits =
                    |host: &ObjectCard| subject.candidates().iter().any(|item| support(place, host, item).is_some());
                if is_support(place) && !host.candidates().iter().any(|host| fits(host)) {
                    return Err(unsuitable(host, why_no_room(place, host.candidates())));
                }
            }
            Command::Change { object, part, action } => {
                let noun = &sentence.nouns[*object];
                if !noun.candidates().iter().any(|card| can_change(card, *part, *action)) {
                    return Err(unsuitable(noun, "has no such state"));
                }
            }
        }
    }
    Ok(())
}

/// Checks that no object is to be in two places or states in the end.
pub(super) fn check_consistency(sentence: &Sentence) -> Result<(), String> {
    let phrase = |noun: usize| &sentence.nouns[noun].phrase;
    for commands in &sentence.alternatives {
        for (index, command) in commands.iter().enumerate() {
            for other in &commands[index + 1..] {
                match (command, other) {
                    (Command::Put { subject, place }, Command::Put { subject: again, place: then })
                        if subject == again && place != then && (is_support(place) || is_support(then)) =>
                    {
                        return Err(format!("`{}` cannot be in two places in the end", phrase(*subject)));
                    }
                    (Command::Change { object, action, .. }, Command::Change { object: again, action: then, .. })
                        if object == again && action != then =>
                    {
                        return Err(format!("`{}` cannot be in two states in the end", phrase(*object)));
                    }
                    _ => {}
                }
            }
        }
    }
    Ok(())
}

pub(super) fn is_support(place: &Where) -> bool {
    place.relations.iter().any(|relation| relation.is_support())
}

/// Names with uids of at most [`MAX_CANDIDATES`] objects, one of each category first.
fn named<'a>(cards: impl Iterator<Item = &'a ObjectCard>) -> Vec<String> {
    let mut categories = BTreeSet::new();
    let (first, more): (Vec<&ObjectCard>, Vec<&ObjectCard>) = cards.partition(|card| categories.insert(&card.category));
    first.iter().chain(&more).take(MAX_CANDIDATES).map(|card| format!("{} ({})", card.name, card.uid)).collect()
}

/// True if an action changes some state of an object; a cabinet with drawers has no door.
pub(super) fn can_change(card: &ObjectCard, part: Option<Part>, action: Action) -> bool {
    let lacks_part = part == Some(Part::Other) && card.states.iter().any(|state| state == "top_open");
    !lacks_part && card.states.iter().any(|now| changed_state(card, part, action, Some(now)).is_some())
}
