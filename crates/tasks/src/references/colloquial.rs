//! Rewrites colloquial English as plain requests, for the second attempt at a sentence.

/// Phrases and their plain form, in the order in which they are replaced; both are whole words.
const PHRASES: [(&str, &str); 65] = [
    ("->", ""),
    ("&", "and"),
    ("dear assistant", ""),
    ("i would be very grateful if you could", ""),
    ("would you be so kind as to", ""),
    ("would you be so kind to", ""),
    ("would you mind", ""),
    ("do you mind", ""),
    ("if you could", ""),
    ("if possible", ""),
    ("thank you so much", ""),
    ("thank you very much", ""),
    ("thank you", ""),
    ("thanks a lot", ""),
    ("thanks", ""),
    ("thx", ""),
    ("please to", ""),
    ("please", ""),
    ("pls", ""),
    ("plz", ""),
    ("dear", ""),
    ("you must to", ""),
    ("you must", ""),
    ("you need to", ""),
    ("you have to", ""),
    ("i need you to", ""),
    ("i want to see", "i want"),
    ("swap nothing", ""),
    ("just", ""),
    ("yo", ""),
    ("pulling out", "pull out"),
    ("putting", "put"),
    ("placing", "place"),
    ("moving", "move"),
    ("opening", "open"),
    ("closing", "close"),
    ("turning", "turn"),
    ("switching", "switch"),
    ("which is", "that is"),
    ("which lies", "that lies"),
    ("which stands", "that stands"),
    ("to its left", "to the left of it"),
    ("to its right", "to the right of it"),
    ("on its left", "to the left of it"),
    ("on its right", "to the right of it"),
    ("on the right from", "to the right of"),
    ("on the left from", "to the left of"),
    ("left to", "to the left of"),
    ("right to", "to the right of"),
    ("i'm thirsty", "i am thirsty"),
    ("i'm hungry", "i am hungry"),
    ("where is", "about"),
    ("where's", "about"),
    ("quick", ""),
    ("quickly", ""),
    ("whichever is easier", ""),
    ("for me", ""),
    ("once more", ""),
    ("a bit", ""),
    ("a little", ""),
    ("so first", ""),
    ("something to drink", "a drink"),
    ("something to eat", "a food"),
    ("something to write with", "a pen"),
    ("the other", "another"),
];

/// Beginnings of a clause that gives the purpose of a request.
const PURPOSES: [&str; 9] = [
    " so that i ",
    " so that we ",
    " so i ",
    " so we ",
    " so my ",
    " so the others ",
    " so nobody ",
    " so he ",
    " so she ",
];

/// The sentence with everyday phrases replaced; `text` is in lower case.
pub(super) fn plain(text: &str) -> String {
    let mut said = String::with_capacity(text.len() + 8);
    for (before, letter) in std::iter::once(' ').chain(text.chars()).zip(text.chars()) {
        match letter {
            '—' | '–' | '(' | ')' | '[' | ']' | '"' | '*' | '\n' | '\t' => said.push(' '),
            ',' | ';' | '.' | '?' | '!' => said.extend([' ', letter, ' ']),
            ':' if before == ' ' => {}
            _ => said.push(letter),
        }
    }
    let mut said = format!(" {} ", said.split_whitespace().collect::<Vec<_>>().join(" "));
    for (phrase, plain) in PHRASES {
        let plain = if plain.is_empty() { " ".to_owned() } else { format!(" {plain} ") };
        said = said.replace(&format!(" {phrase} "), &plain);
    }
    let end = PURPOSES.iter().filter_map(|purpose| said.find(purpose)).min().unwrap_or(said.len());
    said.truncate(end);
    said
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn everyday_phrases_become_plain_requests() {
        let cases = [
            ("would you mind pulling out the top drawer?", "pull out the top drawer ?"),
            ("dear assistant, kindly put it in the box!!", ", kindly put it in the box ! !"),
            ("put it behind the box so my brother can't see it :)", "put it behind the box"),
            ("press the button & shut it", "press the button and shut it"),
        ];
        for (said, expected) in cases {
            assert_eq!(plain(said).trim(), expected, "{said}");
        }
    }
}
