//! Other sentences for a task: paraphrases of its instruction, and instructions for its single steps.
//!
//! A paraphrase exchanges verbs and prepositions or adds politeness, and keeps the names of objects. Each one is read
//! back by [`references`], which shares no table with this module, and is only used if it states exactly the goal of
//! the task.

use genmanip_core::{Atom, InstanceId, ReferenceId, Relation, RelationKind, Support, Task};

use crate::references;

/// Maximum number of words of an instruction, as for tasks.
const MAX_WORDS: usize = 30;
/// Maximum number of variants tried per task. In designed tasks, all paraphrases needed were found within 40.
const DRAWS: usize = 96;

/// Phrases and their synonyms; longer phrases first.
const SYNONYMS: [(&str, &[&str]); 24] = [
    ("pick up", &["take", "grab", "fetch"]),
    ("take", &["pick up", "grab", "fetch"]),
    ("grab", &["take", "pick up"]),
    ("fetch", &["take", "pick up"]),
    ("put", &["place", "set", "move"]),
    ("place", &["put", "set", "move"]),
    ("set", &["put", "place"]),
    ("move", &["put", "place"]),
    ("next to", &["beside", "close to", "near"]),
    ("close to", &["next to", "beside", "near"]),
    ("beside", &["next to", "close to", "near"]),
    ("near", &["next to", "beside", "close to"]),
    ("on top of", &["on"]),
    ("onto", &["on", "on top of"]),
    ("on", &["on top of"]),
    ("into", &["inside", "in"]),
    ("inside", &["in"]),
    ("in", &["inside"]),
    ("turn", &["switch"]),
    ("switch", &["turn"]),
    ("close", &["shut"]),
    ("shut", &["close"]),
    ("top drawer", &["upper drawer"]),
    ("bottom drawer", &["lower drawer"]),
];

/// Beginnings and ends of requests, weighted towards the plain form.
const MANNERS: [(&str, &str); 8] = [
    ("", "."),
    ("please ", "."),
    ("", "."),
    ("could you ", "?"),
    ("", "."),
    ("can you ", "?"),
    ("could you please ", "?"),
    ("please help me ", "."),
];

/// Instructions for building a tower.
const TOWERS: [&str; 6] =
    ["Build a tower", "Make a tower", "Please build a tower", "Stack a tower", "Please make a tower", "I want a tower"];

/// Polite beginnings of requests.
const POLITE: [&str; 4] = ["please", "could you", "can you", "help me"];

/// Verbs at the beginning of a request.
const VERBS: [&str; 27] = [
    "put", "place", "set", "move", "stack", "bring", "pick", "take", "grab", "find", "fetch", "open", "close", "shut",
    "pull", "push", "lift", "raise", "lower", "flip", "fold", "swing", "turn", "switch", "press", "either", "first",
];

/// Up to `count` other sentences with the same meaning in the task's scene; none if the instruction itself cannot be
/// read.
///
/// The result depends on the task only.
pub fn paraphrases(task: &Task, count: usize) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    if references::check(task).is_err() {
        return found;
    }
    for draw in 1..=DRAWS {
        if found.len() >= count {
            break;
        }
        let said = reworded(&task.instruction, draw);
        let is_new = said != task.instruction && !found.contains(&said);
        if is_new && said.split_whitespace().count() <= MAX_WORDS && references::check_said(task, &said).is_ok() {
            found.push(said);
        }
    }
    found
}

/// Directions as seen by the robot, each with the same direction as seen by a camera that faces it.
const CAMERA_DIRECTIONS: [(&str, &str); 8] = [
    ("to the robot's left of", "to the camera's right of"),
    ("to the robot's right of", "to the camera's left of"),
    ("on the far side of", "on the camera's side of"),
    ("farthest to the robot's left", "farthest to the camera's right"),
    ("farthest to the robot's right", "farthest to the camera's left"),
    ("farthest from the robot", "nearest to the camera"),
    ("nearest to the robot", "farthest from the camera"),
    ("closest to the robot", "farthest from the camera"),
];

/// The instruction with directions as seen by a camera that faces the robot; `None` if it has no directions or would be
/// misread.
pub fn from_the_camera(task: &Task) -> Option<String> {
    let instruction = task.instruction.clone();
    let said = CAMERA_DIRECTIONS.iter().fold(instruction, |said, (robot, camera)| said.replace(robot, camera));
    let is_mixed = said.contains("robot");
    (said != task.instruction && !is_mixed && references::check_said(task, &said).is_ok()).then_some(said)
}

/// The instruction in variant `draw`; clauses without a request stay unchanged.
fn reworded(instruction: &str, draw: usize) -> String {
    let mut sentences = Vec::new();
    let mut is_first = true;
    for sentence in instruction.split_inclusive(['.', '?', '!']).map(str::trim).filter(|text| !text.is_empty()) {
        let end = sentence.len() - sentence.trim_end_matches(['.', '?', '!']).len();
        let (text, end) = sentence.split_at(sentence.len() - end);
        let (before, request) = text.split_once(": ").unwrap_or(("", text));
        let (request, reason) = request.split_once(", because ").unwrap_or((request, ""));
        if before.ends_with("tower") {
            let begin = TOWERS[chosen(draw, 0, TOWERS.len())];
            sentences.push(format!("{begin}: {}{end}", exchanged(request, draw)));
            continue;
        }
        let plain = plain(request, draw);
        if !begins_with_verb(&plain) {
            sentences.push(sentence.to_owned());
            continue;
        }
        let (manner, mark) = if is_first { MANNERS[chosen(draw, 0, MANNERS.len())] } else { ("", ".") };
        is_first = false;
        let request = format!("{manner}{}", exchanged(&plain, draw));
        let request = if before.is_empty() { capitalised(&request) } else { format!("{before}: {request}") };
        let reason = if reason.is_empty() { String::new() } else { format!(", because {reason}") };
        let mark = if end.is_empty() || mark == "?" { mark } else { end };
        sentences.push(format!("{request}{reason}{mark}"));
    }
    sentences.join(" ")
}

/// The request in lower case, without politeness, beginning with its verb: `I want X to be there`, and in every other
/// variant `take X and put it there`, become `put X there`.
fn plain(request: &str, draw: usize) -> String {
    let mut small = lowered(request).trim_end_matches(", please").trim_end_matches(" please").to_owned();
    while let Some(rest) = POLITE.iter().find_map(|words| small.strip_prefix(words)) {
        small = lowered(rest.trim_start_matches([',', ' ']));
    }
    if let Some((thing, place)) = small.strip_prefix("i want ").and_then(|rest| rest.split_once(" to be ")) {
        return format!("put {thing} {place}");
    }
    let taken = ["take ", "pick up ", "grab ", "fetch "].iter().find_map(|verb| small.strip_prefix(verb));
    let put = [" and put it ", " and place it ", " and set it ", " and move it "];
    let parts = taken.and_then(|rest| put.iter().find_map(|words| rest.split_once(words)));
    match parts {
        Some((thing, place)) if chosen(draw, 1, 2) == 0 && !place.contains(" and ") => format!("put {thing} {place}"),
        _ => small,
    }
}

/// The request with each phrase replaced by a synonym or kept, depending on the variant.
fn exchanged(request: &str, draw: usize) -> String {
    let words: Vec<&str> = request.split(' ').collect();
    let mut said: Vec<String> = Vec::new();
    let mut next = 0;
    while next < words.len() {
        let follows = words[next..].join(" ");
        let is_here = |phrase: &str| {
            follows.strip_prefix(phrase).is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', ',', ';']))
        };
        let Some((phrase, others)) = SYNONYMS.iter().find(|(phrase, _)| is_here(phrase)) else {
            said.push(words[next].to_owned());
            next += 1;
            continue;
        };
        let length = phrase.split(' ').count();
        let which = chosen(draw, 2 + next, others.len() + 1);
        let word = if which == 0 { phrase } else { others[which - 1] };
        let mark = words[next + length - 1].trim_start_matches(|c: char| c.is_alphanumeric() || c == '\'');
        said.push(format!("{word}{mark}"));
        next += length;
    }
    said.join(" ")
}

/// Index below `count` that depends on the variant and the place in the sentence, like a random number.
fn chosen(draw: usize, place: usize, count: usize) -> usize {
    let mixed = (draw as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (place as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    usize::try_from((mixed >> 33) % count.max(1) as u64).unwrap_or(0)
}

fn begins_with_verb(request: &str) -> bool {
    let first = request.split([' ', ',']).next().unwrap_or_default();
    VERBS.contains(&first)
}

/// The text with its first letter in lower case.
fn lowered(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Instruction for the next step on one object towards the goal, such as `Put the red mug on the plate.`
///
/// `alternative` is the index of the goal alternative that is attempted. An object that this alternative does not move
/// is assumed to be in the way.
pub fn step(task: &Task, object: &InstanceId, alternative: usize) -> String {
    let twins = task.interchangeable.iter().find(|group| group.contains(object));
    let is_meant = |id: &InstanceId| id == object || twins.is_some_and(|group| group.contains(id));
    let goal = &task.goal.alternatives;
    let aimed = goal.get(alternative).or(goal.first());
    let atom = aimed.into_iter().flatten().find(|atom| is_meant(atom.subject()));
    match atom {
        Some(Atom::Relation { relation, reference, second_reference, .. }) => {
            let other = second_reference.as_ref().map(|second| format!(" and the {}", name(task, second)));
            let (place, other) = (name(task, reference), other.unwrap_or_default());
            let is_hollow = task.card(reference).is_some_and(|card| card.is_container);
            let relation = match relation.kind() {
                RelationKind::Support(Support::OnOrIn) if is_hollow => Relation::In,
                _ => *relation,
            };
            format!("Put the {} {} the {place}{other}.", name(task, object), relation.facts().located[0])
        }
        Some(Atom::State { state, .. }) => {
            let node = task.scene_graph.nodes.iter().find(|node| node.id == *object);
            changed(&name(task, object), state, node.and_then(|node| node.state.as_deref()))
        }
        None => format!("Move the {} out of the way.", name(task, object)),
    }
}

/// Name of an instance or a surface in lower case.
fn name(task: &Task, id: &ReferenceId) -> String {
    let surface = task.surface(id).map(|surface| surface.name.clone());
    surface
        .or_else(|| task.card(id).map(|card| card.name.clone()))
        .unwrap_or_else(|| id.as_str().replace('_', " "))
        .to_lowercase()
}

/// Instruction to change an object from one state to another.
pub(crate) fn changed(name: &str, state: &str, before: Option<&str>) -> String {
    match (state, before) {
        ("open", _) => format!("Open the {name}."),
        ("closed", Some("top_open")) => format!("Close the top drawer of the {name}."),
        ("closed", Some("bottom_open")) => format!("Close the bottom drawer of the {name}."),
        ("closed", _) => format!("Close the {name}."),
        ("top_open", Some("closed")) | ("both_open", Some("bottom_open")) => {
            format!("Open the top drawer of the {name}.")
        }
        ("bottom_open", Some("closed")) | ("both_open", Some("top_open")) => {
            format!("Open the bottom drawer of the {name}.")
        }
        ("top_open", Some("both_open")) => format!("Close the bottom drawer of the {name}."),
        ("bottom_open", Some("both_open")) => format!("Close the top drawer of the {name}."),
        ("both_open", _) => format!("Open both drawers of the {name}."),
        ("on", _) => format!("Turn the {name} on."),
        ("off", _) => format!("Turn the {name} off."),
        ("low", _) => format!("Turn the {name} to low."),
        ("high", _) => format!("Turn the {name} to high."),
        ("pressed", _) => format!("Press the {name}."),
        (other, _) => format!("Bring the {name} into the state {}.", other.replace('_', " ")),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use genmanip_assets::Catalogue;
    use genmanip_core::{Seed, TaskKind};

    use super::*;
    use crate::designer::{DesignSettings, design_many};

    fn tasks(seed: u64, count: usize) -> Vec<Task> {
        let cards = Catalogue::builtin().cards();
        design_many(&TaskKind::ALL, count, cards, Seed::new(seed), &DesignSettings::default()).unwrap().tasks
    }

    #[test]
    fn every_designed_task_can_be_said_in_five_other_ways() {
        let mut poor = Vec::new();
        for task in tasks(760_001, 240) {
            let said = paraphrases(&task, 6);
            if said.len() < 5 {
                poor.push(format!("{}: {said:?}", task.instruction));
            }
            let different: BTreeSet<&String> = said.iter().chain([&task.instruction]).collect();
            assert_eq!(different.len(), said.len() + 1, "{said:#?}");
            for instruction in &said {
                assert!(instruction.starts_with(|c: char| c.is_uppercase()), "{instruction}");
                assert!(instruction.ends_with(['.', '?']), "{instruction}");
                assert_eq!(references::check(&Task { instruction: instruction.clone(), ..task.clone() }), Ok(()));
            }
            assert_eq!(paraphrases(&task, 6), said);
        }
        assert!(poor.is_empty(), "{}", poor.join("\n"));
    }

    /// Checks that only sentences with directions have a camera variant, and that it means the same.
    #[test]
    fn directions_can_be_told_from_the_camera() {
        let spatial: Vec<Task> =
            tasks(760_003, 240).into_iter().filter(|task| task.kind == TaskKind::Spatial).collect();
        // The robot's side has no words from the camera that could not mean the other side.
        let has_words = |task: &&Task| task.instruction.contains("robot") && !task.instruction.contains("robot's side");
        let directed: Vec<&Task> = spatial.iter().filter(has_words).collect();
        assert!(directed.len() > 10, "{}", directed.len());
        for task in directed {
            let said = from_the_camera(task);
            assert!(said.is_some_and(|said| said.contains("camera")), "{}", task.instruction);
        }
        let plain = Task { instruction: "Put the red mug on the plate.".into(), ..spatial[0].clone() };
        assert_eq!(from_the_camera(&plain), None);
    }

    /// Checks that instructions that cannot be read have no paraphrases.
    #[test]
    fn what_is_not_understood_is_not_said_again() {
        let task = Task { instruction: "Frobnicate the mug.".into(), ..tasks(760_002, 1).remove(0) };
        assert_eq!(paraphrases(&task, 6), Vec::<String>::new());
    }

    #[test]
    fn steps_name_what_the_goal_asks_of_an_object() {
        let mut task = tasks(760_003, 1).remove(0);
        let [one, other, third] = [0, 1, 2].map(|index: usize| task.scene_graph.nodes[index].id.clone());
        let called = |id: &ReferenceId| task.card(id).unwrap().name.to_lowercase();
        let [a, b, c] = [called(&one), called(&other), called(&third)];
        let place = |relation| Atom::Relation {
            subject: one.clone(),
            relation,
            reference: other.clone().into(),
            second_reference: None,
        };
        let state = |state: &str| Atom::State { object: other.clone(), state: state.into() };
        task.interchangeable = Vec::new();
        task.scene_graph.nodes[1].state = Some("closed".into());
        task.goal.alternatives =
            vec![vec![place(Relation::On), state("open")], vec![place(Relation::Left), state("top_open")]];
        let cases = [
            (&one, 0, format!("Put the {a} on the {b}.")),
            (&one, 1, format!("Put the {a} to the robot's left of the {b}.")),
            (&other, 0, format!("Open the {b}.")),
            (&other, 1, format!("Open the top drawer of the {b}.")),
            (&third, 0, format!("Move the {c} out of the way.")),
        ];
        for (object, alternative, expected) in cases {
            assert_eq!(step(&task, object, alternative), expected);
        }
    }
}
