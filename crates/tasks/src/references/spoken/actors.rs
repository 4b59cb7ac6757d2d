//! Sentences about what the robot does or is to do, as requests to the robot itself.

use super::super::lexicon::lexicon;
use super::listener::Listener;
use super::verbs::{Class, base_of_third_person, is_verb};
use super::words::{is_boundary, is_mark, vocabulary};

/// Words that open a clause about the robot: `have the robot put …`, `ask the arm to …`.
const LEADS: [&str; 13] =
    ["have", "make", "let", "get", "ask", "tell", "instruct", "order", "command", "direct", "program", "want", "use"];

/// The tokens of a sentence with every clause about the robot as a request: `the robot takes the mug and puts it on the
/// tray` becomes `take the mug and put it on the tray`.
pub(super) fn addressed(tokens: Vec<String>) -> Vec<String> {
    let listener = Listener::new(obliged(tokens));
    let mut said: Vec<String> = Vec::with_capacity(listener.tokens.len());
    let mut is_about_robot = false;
    let mut next = 0;
    while next < listener.tokens.len() {
        let begins = said.last().is_none_or(|last| is_mark(last) || is_boundary(last));
        let order = if begins { order(&listener, next, is_about_robot) } else { None };
        match order {
            Some((index, verb)) => {
                is_about_robot = true;
                said.push(verb);
                next = index + 1;
            }
            None => {
                said.push(listener.token(next).to_owned());
                next += 1;
            }
        }
    }
    said
}

/// The tokens with `is picked up and placed` as `should be picked up and placed`: two steps are no state of the scene.
fn obliged(mut tokens: Vec<String>) -> Vec<String> {
    let is_taken = |word: &String| ["picked", "grasped", "lifted", "grabbed", "gripped"].contains(&word.as_str());
    let passive = (1..tokens.len()).find(|&index| {
        let rest = tokens[index..].iter().take_while(|word| !is_mark(word)).collect::<Vec<_>>();
        let goes_on = rest.windows(2).any(|pair| pair[0] == "and" && Class::Carry.base(pair[1]).is_some());
        ["is", "are", "gets"].contains(&tokens[index - 1].as_str()) && is_taken(&tokens[index]) && goes_on
    });
    if let Some(index) = passive {
        tokens.splice(index - 1..index, ["should", "be"].map(String::from));
    }
    tokens
}

/// Index of the verb of a clause about the robot that begins at an index, and its base form.
fn order(listener: &Listener, start: usize, is_about_robot: bool) -> Option<(usize, String)> {
    let any =
        |index: usize, phrases: &[&str]| phrases.iter().filter_map(|phrase| listener.at_index(index, phrase)).max();
    let lead = any(start, &LEADS).unwrap_or(0);
    let mut next = start + lead;
    next += any(next, &["the", "a", "our", "my", "your", "this"]).unwrap_or(0);
    let actor = any(next, &vocabulary().robots);
    let pronoun = any(start, &["it", "he", "she", "this"]).filter(|_| is_about_robot);
    // `picks up the mug and places it on the tray` tells what the robot does without naming it.
    let is_omitted = actor.is_none() && pronoun.is_none();
    next = if is_omitted { start } else { next + actor.unwrap_or(0) };
    next = if let (None, Some(length)) = (actor, pronoun) { start + length } else { next };
    next += any(next, &["then", "now", "first", "also"]).filter(|_| !is_omitted).unwrap_or(0);
    let modal = any(next, &vocabulary().robot_modals).filter(|_| actor.is_some()).unwrap_or(0);
    next += modal;
    let word = listener.token(next);
    let follows = listener.token(next + 1);
    let is_told = lead > 0 && actor.is_some() || modal > 0;
    if actor.is_some() && is_verb(word) && (is_told || listener.is_determined(next + 1)) {
        return Some((next, word.to_owned()));
    }
    let has_object = listener.is_determined(next + 1)
        || ["up", "down", "out", "away", "back", "hold", "off", "open", "on"].contains(&follows);
    let is_free = !is_omitted || has_object && (is_about_robot || start == 0) && !lexicon().is_noun(word);
    let base = base_of_third_person(word).filter(|_| lead == 0 && modal == 0 && is_free)?;
    Some((next, base.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::super::normal::tokens;
    use super::addressed;

    #[test]
    fn what_the_robot_does_is_a_request() {
        let cases = [
            ("The robot takes the mug and puts it on the tray.", "take the mug and put it on the tray ."),
            ("Have the robot arm place the mug there", "place the mug there"),
            ("The gripper is to carry it over", "carry it over"),
            ("Picks up the lemon, then drops it in the pot", "pick up the lemon , then drop it in the pot"),
            ("The apple is picked up and placed there", "the apple should be picked up and placed there"),
            ("There is a mug. The robot moves it.", "there is a mug . move it ."),
            ("Take the mug nearest to the robot", "take the mug nearest to the robot"),
            ("The mug stands on the tray and goes in the box", "the mug stands on the tray and goes in the box"),
        ];
        for (said, expected) in cases {
            assert_eq!(addressed(tokens(said)).join(" "), expected, "{said}");
        }
    }
}
