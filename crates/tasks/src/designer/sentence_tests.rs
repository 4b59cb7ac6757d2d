//! Sentences of users become tasks that state what they say, or questions.

use genmanip_assets::Catalogue;
use genmanip_core::{Atom, ReferenceId, Seed, Task};

use super::{DesignSettings, phrases_of_sentence, task_from_sentence};
use crate::references;

fn compose(sentence: &str, seed: u64) -> Result<Task, String> {
    let cards = Catalogue::full().cards();
    task_from_sentence(sentence, cards, Seed::new(seed), "task", &DesignSettings::default())
        .map_err(|error| error.to_string())
}

/// The goal with categories instead of ids: `mug left bowl or …`.
fn goal_of(task: &Task) -> String {
    let kind = |id: &ReferenceId| task.card(id).map_or_else(|| id.to_string(), |card| card.category.clone());
    let atom = |atom: &Atom| match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.iter().map(|id| format!(" {}", kind(id))).collect::<String>();
            format!("{} {} {}{second}", kind(subject), relation.name(), kind(reference))
        }
        Atom::State { object, state } => format!("{} {state}", kind(object)),
    };
    let all = |atoms: &Vec<Atom>| atoms.iter().map(atom).collect::<Vec<_>>().join(" and ");
    task.goal.alternatives.iter().map(all).collect::<Vec<_>>().join(" or ")
}

/// True if a goal is as expected: categories and relations in order, `a/b_c` for `a` or `b c`.
fn is_expected(goal: &str, expected: &str) -> bool {
    // Categories consist of words, so that the goal is matched from left to right.
    fn rest<'g>(goal: &'g str, part: &str) -> Vec<&'g str> {
        let strip = |one: &str| goal.strip_prefix(one).or_else(|| goal.strip_prefix(&one.replace('_', " ")));
        part.split('/').filter_map(strip).collect()
    }
    let mut goals = vec![goal];
    let tokens = expected.split_inclusive(' ').map(str::trim);
    for token in tokens {
        let mut next = Vec::new();
        for goal in &goals {
            next.extend(rest(goal.trim_start(), token));
        }
        goals = next;
    }
    goals.iter().any(|goal| goal.trim().is_empty())
}

/// Sentences of `testdata/sentences.txt` with what they state.
#[test]
fn sentences_of_people_are_tasks_or_questions() {
    let (mut wrong, mut made, mut clear) = (Vec::new(), 0, 0);
    let table = include_str!("../../testdata/sentences.txt");
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let (sentence, expected) = line.split_once(" => ").unwrap();
        let question = expected.strip_prefix("? ").or(expected.strip_prefix('?'));
        clear += usize::from(question.is_none());
        match (compose(sentence, 7), question) {
            (Ok(task), None) if is_expected(&goal_of(&task), expected) => {
                assert_eq!(references::check(&task), Ok(()), "{sentence}");
                made += 1;
            }
            (Err(error), Some(part)) if error.contains(part) => {}
            (Ok(task), _) => wrong.push(format!("{sentence}\n    {}\n    expected {expected}", goal_of(&task))),
            (Err(error), _) => wrong.push(format!("{sentence}\n    {error}\n    expected {expected}")),
        }
    }
    assert!(wrong.is_empty(), "{made} of {clear} made, {} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn sentences_become_the_tasks_that_they_state() {
    let cases = [("put the red mug to the left of the bowl", "mug left bowl")];
    let mut wrong = Vec::new();
    for (sentence, expected) in cases {
        for seed in 0..3 {
            match compose(sentence, seed) {
                Ok(task) => {
                    assert_eq!(task.instruction.to_lowercase(), sentence.to_lowercase());
                    assert_eq!(references::check(&task), Ok(()));
                    if goal_of(&task) != expected {
                        wrong.push(format!("{sentence}: {}, expected {expected}", goal_of(&task)));
                    }
                }
                Err(error) => wrong.push(format!("{sentence}: {error}")),
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Sentences that name no object, no place or something impossible are questions, never other tasks.
#[test]
fn unclear_sentences_are_questions() {
    let cases = [
        ("put the gizmo on the plate", "no object of the catalogue is `gizmo`"),
        ("Put the coffee spoon on the plate.", "no object of the catalogue is `coffee spoon`; candidates: Spoon (015)"),
        ("put the microwave on the plate", "`microwave` is nothing that the gripper can carry"),
        ("turn on the banana", "`banana` has no such state"),
        ("put the hammer in the egg cup", "`egg cup` has no room for the object"),
        ("move the mug", "the sentence is not understood"),
        ("put it over there", "the sentence is not understood"),
        ("Place the spoon to the left and to the right of the bowl.", "no scene was found for the sentence"),
        ("Please tidy up a little, thank you so much", "the sentence is not understood"),
        ("", "the sentence is not understood"),
    ];
    for (sentence, expected) in cases {
        let error = compose(sentence, 1).unwrap_err();
        assert!(error.starts_with(expected), "{sentence}: {error}");
    }
}

/// A category may hold more than its name says: salt shakers are listed with pepper shakers.
#[test]
fn objects_called_as_in_the_sentence_come_first() {
    for (sentence, word) in [
        ("Bring the salt shaker close to the pepper mill.", "salt"),
        ("put the tennis ball behind the cereal box", "tennis"),
    ] {
        for seed in 0..4 {
            let task = compose(sentence, seed).unwrap();
            let Atom::Relation { subject, .. } = &task.goal.alternatives[0][0] else { panic!("{sentence}") };
            let name = &task.card(&subject.clone().into()).unwrap().name;
            assert!(name.to_lowercase().contains(word), "{sentence}: {name}");
        }
    }
}

/// A seed decides the scene; the sentence stays.
#[test]
fn seeds_make_different_scenes() {
    let sentence = "put the apple next to the bowl";
    let [one, again, other] = [1, 1, 2].map(|seed| compose(sentence, seed).unwrap());
    assert_eq!(one, again);
    assert_ne!(one.scene_graph, other.scene_graph);
}

#[test]
fn ambiguous_phrases_list_what_they_may_mean() {
    let cards = Catalogue::builtin().cards();
    let phrases = phrases_of_sentence("put the red mug to the left of the bowl", cards).unwrap();
    let [mug, bowl] = &phrases[..] else { panic!("{phrases:?}") };
    assert_eq!((mug.phrase.as_str(), bowl.phrase.as_str()), ("red mug", "bowl"));
    assert!(mug.meant.iter().all(|card| card.name.contains("Mug")), "{:?}", mug.meant);
    assert!(bowl.meant.len() > 1 && bowl.alike.is_empty());
    assert!(bowl.meant[0].name.to_lowercase().contains("bowl"), "{}", bowl.meant[0].name);
    let unknown = phrases_of_sentence("put the purple dragon on the plate", cards).unwrap();
    assert!(unknown[0].meant.is_empty(), "{unknown:?}");
    assert!(phrases_of_sentence("how do you do", cards).is_err());
}
