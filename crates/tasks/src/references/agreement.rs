//! Disagreement between the sentence of a task and its goal.
//!
//! A sentence within the grammar is read in the scene and compared with the goal. For any other sentence only the words
//! count: they have to name the objects of the goal, provided that all words are known.

use std::collections::BTreeSet;

use genmanip_core::{Atom, ObjectCard, ReferenceId, Relation, Task};

use super::lexicon::lexicon;
use super::mismatch::in_words;
use super::words;
use super::{Mismatch, ReadAtom, open, read, resembles};
use crate::designer::RULES;

/// Words that name no object and are not in the tables of the grammar: verbs, places, parts and courtesies.
const OTHER_WORDS: [&str; 40] = [
    "it", "them", "is", "are", "be", "that", "which", "there", "here", "table", "surface", "desk", "side", "top",
    "left", "right", "front", "back", "of", "robot's", "directly", "exactly", "so", "ends", "stands", "lies", "end",
    "from", "away", "with", "using", "gripper", "hand", "position", "place", "onto", "scene", "other", "initial",
    "current",
];

/// Reason why the sentence of a task cannot mean its goal; `None` if it does or may mean it.
///
/// A sentence may say less than the goal (`next to` for `left`).
pub fn disagreement(task: &Task) -> Option<String> {
    match read(&task.instruction, &task.objects, &task.scene_graph) {
        Ok(reading) => {
            let groups = open(&reading);
            let meant = &task.goal.alternatives;
            let fits = |read: &ReadAtom, meant: &Atom| {
                resembles(read, meant, &groups, are_compatible) || is_one_side(read, meant)
            };
            let same = |read: &Vec<ReadAtom>, meant: &Vec<Atom>| {
                meant.iter().all(|meant| read.iter().any(|read| fits(read, meant)))
                    && read.iter().all(|read| meant.iter().any(|meant| fits(read, meant)))
            };
            let agrees = meant.iter().all(|meant| reading.goal.iter().any(|read| same(read, meant)));
            (!agrees).then(|| format!("the sentence asks for {}", in_words(&reading.goal)))
        }
        Err(_) => unnamed(task).map(|name| format!("the sentence does not name {name}, which the goal is about")),
    }
}

/// True if a sentence of a person or a language model may mean the goal of its task although the reader does not follow
/// it. An ambiguous phrase is a flaw of the sentence, and designed sentences are always followed.
pub fn is_beyond_the_reader(task: &Task, mismatch: &Mismatch) -> bool {
    let is_ambiguous = matches!(mismatch, Mismatch::Ambiguous { .. });
    task.source != RULES && !is_ambiguous && disagreement(task).is_none()
}

/// True if a sentence with the relation `said` is an acceptable request for a goal with the relation `meant`.
fn are_compatible(said: Relation, meant: Relation) -> bool {
    said == meant || meant.implies(said) || said.implies(meant)
}

/// True if the sentence says *between* and the goal is one side of one of the two references: answers may not use
/// *between*.
fn is_one_side(read: &ReadAtom, meant: &Atom) -> bool {
    match (read, meant) {
        (
            ReadAtom::Place { subject, relations, references },
            Atom::Relation { subject: moved, relation, reference, .. },
        ) => {
            relations.contains(&Relation::Between)
                && subject == moved
                && relation.implies(Relation::Near)
                && references.iter().any(|id| id == reference)
        }
        _ => false,
    }
}

/// Id and name of an object of the goal that no word of the sentence can mean; `None` if there is none, or if an
/// unknown word might mean it.
fn unnamed(task: &Task) -> Option<String> {
    let text = task.instruction.to_lowercase();
    let words: Vec<&str> =
        text.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '\'').filter(|word| !word.is_empty()).collect();
    let spoken: BTreeSet<&str> = words.iter().copied().collect();
    let is_known = |word: &str| {
        words::contains(word)
            || OTHER_WORDS.contains(&word)
            || lexicon().contains(word)
            || task.objects.iter().any(|card| is_named_by(card, word))
    };
    if !spoken.iter().all(|word| is_known(word)) || spoken.iter().any(|word| lexicon().means_anything(word)) {
        return None;
    }
    let ids: BTreeSet<&ReferenceId> = task.goal.alternatives.iter().flatten().flat_map(Atom::ids).collect();
    let is_named = |card: &ObjectCard| spoken.iter().any(|word| lexicon().names(word, card) || is_named_by(card, word));
    let missing = ids.into_iter().find(|id| task.card(id).is_some_and(|card| !is_named(card)))?;
    Some(format!("{missing} ({})", task.name_of(missing)))
}

/// True if a word occurs in the object's name or category.
fn is_named_by(card: &ObjectCard, word: &str) -> bool {
    let named = format!("{} {}", card.name, card.category).to_lowercase();
    named.split(|c: char| !c.is_alphanumeric() && c != '-').any(|own| own == word || format!("{own}s") == word)
        && !lexicon().is_adjective(word)
}

#[cfg(test)]
mod tests {
    use genmanip_assets::Catalogue;
    use genmanip_core::{Seed, TaskKind};

    use super::super::words::PLACES;
    use super::*;
    use crate::designer::{DesignSettings, design_many};

    fn tasks(seed: u64, count: usize) -> Vec<Task> {
        let cards = Catalogue::builtin().cards();
        design_many(&TaskKind::ALL, count, cards, Seed::new(seed), &DesignSettings::default()).unwrap().tasks
    }

    #[test]
    fn designed_tasks_agree_with_their_sentences_and_exchanged_ones_do_not() {
        let tasks = tasks(771_001, 120);
        for task in &tasks {
            assert_eq!(disagreement(task), None, "{}", task.instruction);
        }
        for (task, other) in tasks.iter().zip(tasks.iter().skip(6)) {
            let planted = Task { instruction: other.instruction.clone(), ..task.clone() };
            let is_same = crate::references::check(&planted).is_ok();
            assert!(is_same || disagreement(&planted).is_some() || unresolved(&planted), "{}", planted.instruction);
        }
    }

    /// True if the sentence cannot be read in the scene, but its words name the objects of the goal or are partly
    /// unknown.
    fn unresolved(task: &Task) -> bool {
        read(&task.instruction, &task.objects, &task.scene_graph).is_err() && unnamed(task).is_none()
    }

    #[test]
    fn a_sentence_names_what_its_goal_is_about() {
        let mut task = tasks(771_002, 6).remove(0);
        let [one, other] = [0, 1].map(|index: usize| task.scene_graph.nodes[index].id.clone());
        let called = |id: &ReferenceId| task.card(id).unwrap().name.to_lowercase();
        let sentences = [
            (format!("Move the {} to the table.", called(&other)), true),
            (format!("Shove the {} to the {}.", called(&one), called(&other)), false),
            (format!("Frobnicate the {}.", called(&other)), false),
            ("Put the thing where it belongs.".to_owned(), false),
        ];
        task.goal.alternatives = vec![vec![Atom::Relation {
            subject: one,
            relation: Relation::Top,
            reference: other.into(),
            second_reference: None,
        }]];
        for (sentence, is_flawed) in sentences {
            task.instruction = sentence;
            assert_eq!(disagreement(&task).is_some(), is_flawed, "{}: {:?}", task.instruction, disagreement(&task));
        }
    }

    #[test]
    fn the_tables_know_their_own_words() {
        for (phrase, _) in PLACES {
            assert!(phrase.split(' ').all(|word| words::contains(word) || OTHER_WORDS.contains(&word)), "{phrase}");
        }
    }
}
