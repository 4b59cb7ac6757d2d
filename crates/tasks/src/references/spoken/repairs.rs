//! Corrections, appositions and contrasts within a sentence: the later words hold.

use super::super::lexicon::lexicon;
use super::listener::Listener;
use super::places::begins_at;
use super::verbs::is_verb;
use super::words::{is_mark, vocabulary};

/// Prepositions of places that hold an object, of which it can have only one.
const HOLDING: [&str; 6] = ["in", "into", "inside", "on", "onto", "on top of"];

/// Prepositions of which one excludes the others.
const SIDES: [&str; 6] = ["in front of", "behind", "to the left of", "to the right of", "left of", "right of"];

/// The tokens of a sentence without what its author took back; an error if it is unclear what that is.
pub(super) fn repaired(tokens: Vec<String>) -> Result<Vec<String>, String> {
    let mut listener = Listener::new(tokens);
    while let Some(marker) = listener.tokens.iter().position(|word| word == "correction" || word == "namely") {
        let (from, to) = replaced(&listener, marker).ok_or("it is unclear what the correction replaces")?;
        listener.tokens.drain(from..to);
    }
    while let Some((from, to)) = alternative(&listener) {
        listener.tokens.drain(from..to);
    }
    while let Some((from, to)) = contrast(&listener) {
        let dropped: Vec<String> = listener.tokens.drain(from..to).collect();
        name_again(&mut listener.tokens[from..], &dropped);
    }
    while let Some((from, to)) = free_choice(&listener).or_else(|| remark(&listener)) {
        listener.tokens.drain(from..to);
    }
    while let Some(tokens) = other_place(&listener).or_else(|| apposition(&listener)).or_else(|| described(&listener)) {
        listener.tokens = tokens;
    }
    Ok(listener.tokens)
}

/// The tokens without a place that is denied: `I do not want it on the plate but in the bowl`, `it should not be on the
/// plate, it should be in the bowl`.
fn other_place(listener: &Listener) -> Option<Vec<String>> {
    let tokens = &listener.tokens;
    let not = tokens.iter().position(|word| word == "not")?;
    let from = if ["do", "does"].contains(&listener.token(not.wrapping_sub(1))) { not - 1 } else { not };
    let end = (not..tokens.len()).find(|&index| is_mark(listener.token(index)))?;
    let denied = (not..end).find(|&index| begins_at(listener, index))?;
    let but = |index: &usize| listener.token(*index) == "but" && begins_at(listener, index + 1);
    if let Some(but) = (denied..(end + 2).min(tokens.len())).find(but) {
        return Some([&tokens[..from], &tokens[not + 1..denied], &tokens[but + 1..]].concat());
    }
    let duty = ["should", "must", "shall"].into_iter().find(|duty| listener.token(not - 1) == *duty)?;
    let again = (end + 1..end + 4).find(|&index| ["it", "they"].contains(&listener.token(index)))?;
    (listener.token(again + 1) == duty).then(|| [&tokens[..not - 1], &tokens[again + 1..]].concat())
}

/// Range of `, any plate` after a phrase with the same noun.
fn free_choice(listener: &Listener) -> Option<(usize, usize)> {
    let start = (1..listener.tokens.len()).find(|&index| {
        listener.at_index(index, ", any").is_some() && listener.token(index - 1) == listener.token(index + 2)
    })?;
    Some((start, start + 3))
}

/// The tokens with `the orange, the one in the bowl,` as `the orange that is in the bowl`.
fn apposition(listener: &Listener) -> Option<Vec<String>> {
    let tokens = &listener.tokens;
    let says = |&index: &usize| {
        listener.at_index(index, ", the one").is_some()
            && (begins_at(listener, index + 3) || ["that", "which"].contains(&listener.token(index + 3)))
    };
    let start = (1..tokens.len()).find(says)?;
    let end = (start + 3..tokens.len()).find(|&index| is_mark(listener.token(index)))?;
    let relative: &[String] = if begins_at(listener, start + 3) { &["that".into(), "is".into()] } else { &[] };
    let rest = if listener.token(end) == "," { end + 1 } else { end };
    Some([&tokens[..start], relative, &tokens[start + 3..end], &tokens[rest..]].concat())
}

/// The tokens with `my mug, the red one, goes there` as `my red mug goes there`.
fn described(listener: &Listener) -> Option<Vec<String>> {
    let tokens = &listener.tokens;
    let (start, end) = (1..tokens.len()).find_map(|start| {
        (listener.at_index(start, ", the").is_some() && lexicon().is_noun(listener.token(start - 1))).then_some(())?;
        let end = (start + 3..start + 6).find(|&index| listener.at_index(index, "one ,").is_some())?;
        tokens[start + 2..end].iter().all(|word| lexicon().is_adjective(word)).then_some((start, end))
    })?;
    let noun = start - 1;
    Some([&tokens[..noun], &tokens[start + 2..end], &tokens[noun..start], &tokens[end + 2..]].concat())
}

/// Range of `, which I need later,`, which says nothing about where or what an object is.
fn remark(listener: &Listener) -> Option<(usize, usize)> {
    let start = (1..listener.tokens.len()).find(|&index| listener.at_index(index, ", which").is_some())?;
    let end = (start + 2..listener.tokens.len()).find(|&index| is_mark(listener.token(index)))?;
    let says = |index: usize| {
        let word = listener.token(index);
        begins_at(listener, index) || lexicon().contains(word) || vocabulary().duties.contains(&word) && word != "need"
    };
    (listener.token(end) == "," && !(start + 2..end).any(says)).then_some((start, end + 1))
}

/// Range of the words up to a marker that the words after it replace: `behind the mug, I mean` before `behind the jug`.
fn replaced(listener: &Listener, marker: usize) -> Option<(usize, usize)> {
    let end = (0..marker).rev().find(|&index| !is_mark(listener.token(index)))? + 1;
    let next = (marker + 1..listener.tokens.len()).find(|&index| !is_mark(listener.token(index)))?;
    let start = clause_start(listener, end);
    if begins_at(listener, next) {
        let [place] = places(listener, start, end)[..] else { return None };
        // `on the white bin, I mean in the bin` means the white one.
        let stop = (next..listener.tokens.len()).find(|&index| is_mark(listener.token(index)));
        let is_same = listener.token(end - 1) == listener.token(stop.unwrap_or(listener.tokens.len()) - 1);
        let is_bare = vocabulary().articles.contains(&listener.token(end - 2));
        return (!is_same || is_bare).then_some((place, next));
    }
    let is_article = |&index: &usize| vocabulary().articles.contains(&listener.token(index));
    let nouns: Vec<usize> = (start..end).filter(is_article).collect();
    let stop = (next..listener.tokens.len()).find(|&index| is_mark(listener.token(index)));
    let names = &listener.tokens[next..stop.unwrap_or(listener.tokens.len())];
    if !is_article(&next) || names.iter().any(|word| word == "one" || word == "ones") {
        return None;
    }
    match (listener.token(marker), nouns.as_slice()) {
        // An apposition belongs to the noun before it.
        ("namely", [.., last]) => Some((*last, next)),
        ("correction", [only]) if places(listener, *only, end).is_empty() => Some((*only, next)),
        _ => None,
    }
}

/// Range of the words that say what is not meant, where the rest of the sentence implies it: `on the book, not on the
/// table`, `not the pepper, the salt`.
fn contrast(listener: &Listener) -> Option<(usize, usize)> {
    let is_article = |index: usize| vocabulary().articles.contains(&listener.token(index));
    let begins = |index: usize| index == 0 || is_mark(listener.token(index - 1)) || listener.token(index - 1) == "and";
    let opens = |&index: &usize| listener.token(index) == "not" && (begins(index) || is_article(index + 1));
    let not = (0..listener.tokens.len()).find(opens)?;
    let end = (not..listener.tokens.len()).find(|&index| is_mark(listener.token(index)));
    let end = end.unwrap_or(listener.tokens.len());
    // `not the green apple but the red one`
    let but = (not..end).find(|&index| listener.token(index) == "but" && is_article(index + 1));
    if let Some(but) = but.filter(|&but| is_article(not + 1) && places(listener, not, but).is_empty()) {
        return Some((not, but + 1));
    }
    if not == 0 && is_article(1) && is_article(end + 1) && places(listener, 0, end).is_empty() {
        return Some((0, end + 1));
    }
    (not > 0 && begins(not)).then_some(())?;
    // `the cup, not the mug, goes there`, `the small bowl, not the large one`
    if is_article(not + 1) && places(listener, not, end).is_empty() && !contains_verb(listener, not, end) {
        return Some((not - 1, if listener.token(end) == "," { end + 1 } else { end }));
    }
    let holds = |index: usize| HOLDING.iter().any(|word| listener.at_index(index, word).is_some());
    let [place] = places(listener, clause_start(listener, not - 1), not - 1)[..] else { return None };
    let [other] = places(listener, not + 1, end)[..] else { return None };
    // `in front of the box, not behind it`
    let is_side = |index: usize| SIDES.iter().any(|word| listener.at_index(index, word).is_some());
    if is_side(place) && is_side(other) && ["it", "them"].contains(&listener.token(end - 1)) {
        return Some((not - 1, end));
    }
    let differs = listener.token(not - 2) != listener.token(end - 1);
    (other == not + 1 && end > not + 3 && holds(place) && holds(other) && differs).then_some((not - 1, end))
}

/// True if a verb of a request is among the words from one index to another.
fn contains_verb(listener: &Listener, start: usize, end: usize) -> bool {
    (start..end).any(|index| is_verb(listener.token(index)))
}

/// Replaces `one` in the rest of a clause by the noun of words that are left out: `not the green apple but the red one`.
fn name_again(rest: &mut [String], dropped: &[String]) {
    let noun = dropped.iter().rev().find(|word| lexicon().is_noun(word));
    let one = rest.iter_mut().take_while(|word| !is_mark(word)).find(|word| *word == "one");
    if let (Some(noun), Some(one), true) = (noun, one, dropped[0] == "not") {
        one.clone_from(noun);
    }
}

/// Range of the words that name what is not wanted: `instead of the apple, …`, `… rather than on the plate`.
fn alternative(listener: &Listener) -> Option<(usize, usize)> {
    let begins = |&index: &usize| {
        ["instead of", "rather than"].iter().any(|phrase| listener.at_index(index, phrase).is_some())
            && listener.token(index.wrapping_sub(1)) != "would"
    };
    let start = (0..listener.tokens.len()).find(begins)?;
    let end = (start..listener.tokens.len()).find(|&index| is_mark(listener.token(index)));
    match end {
        Some(end) if clause_start(listener, start) == start => (listener.token(end) == ",").then_some((start, end + 1)),
        end => (clause_start(listener, start) < start).then_some((start, end.unwrap_or(listener.tokens.len()))),
    }
}

/// Index after the last full stop or semicolon before an index.
fn clause_start(listener: &Listener, end: usize) -> usize {
    (0..end).rev().find(|&index| matches!(listener.token(index), "." | ";")).map_or(0, |index| index + 1)
}

/// Indices from one to another at which places begin.
fn places(listener: &Listener, start: usize, end: usize) -> Vec<usize> {
    // `to the left of` begins at `to`, although `left of` is a place too.
    let is_first = |&index: &usize| begins_at(listener, index) && (index == start || !begins_at(listener, index - 1));
    (start..end).filter(is_first).collect()
}

#[cfg(test)]
mod tests {
    use super::super::normal::tokens;
    use super::repaired;

    #[test]
    fn the_later_words_hold() {
        let cases = [
            ("put the apple in the bowl, I mean on the plate", "put the apple on the plate"),
            ("put the apple, no wait, the pear, in the bowl", "put the pear , in the bowl"),
            ("put it in the toolbox, i.e. the box", "put it in the box"),
            ("I want it on the book, not on the table", "i want it on the book"),
            ("Not the pepper, the salt: stand it there", "the salt , stand it there"),
            ("put it near the bowl, not on the plate", "put it near the bowl , not on the plate"),
            ("take the small bowl, not the large one", "take the small bowl"),
            ("take the small bowl and not the large one", "take the small bowl"),
            ("Not the green apple but the red one goes in", "the red apple goes in"),
            ("I don't want it on the plate but in the bowl.", "i want it in the bowl ."),
            ("The pear shouldn't be on the plate, it should be in the bowl.", "the pear should be in the bowl ."),
            ("My mug, the red one, goes in the box", "my red mug goes in the box"),
            ("The mug, which I need later, goes in the box", "the mug goes in the box"),
            ("Put the lime (the one in the bowl) on the plate", "put the lime that is in the bowl on the plate"),
        ];
        for (said, expected) in cases {
            assert_eq!(repaired(tokens(said)).unwrap().join(" "), expected, "{said}");
        }
    }

    #[test]
    fn unclear_corrections_are_errors() {
        for said in [
            "put the apple in the bowl, I mean the pear",
            "put it on the plate next to the bowl, I mean behind the bowl",
            "put it on the white bin, no wait, in the bin",
            "I mean",
        ] {
            assert!(repaired(tokens(said)).is_err(), "{said}");
        }
    }
}
