//! Plain form of a sentence: lower case, one spelling, no contractions, courtesies or adverbs of manner.

use super::super::lexicon::lexicon;

/// Contractions and their full forms.
const CONTRACTIONS: [(&str, &str); 26] = [
    ("there's", "there is"),
    ("that's", "that is"),
    ("which's", "which is"),
    ("it's", "it is"),
    ("what's", "what is"),
    ("where's", "where is"),
    ("who's", "who is"),
    ("here's", "here is"),
    ("he's", "he is"),
    ("she's", "she is"),
    ("let's", "let us"),
    ("i'd", "i would"),
    ("you'd", "you would"),
    ("we'd", "we would"),
    ("i'm", "i am"),
    ("we're", "we are"),
    ("you're", "you are"),
    ("they're", "they are"),
    ("i'll", "i will"),
    ("we'll", "we will"),
    ("don't", "do not"),
    ("dont", "do not"),
    ("doesn't", "does not"),
    ("isn't", "is not"),
    ("wanna", "want to"),
    ("gotta", "have to"),
];

/// Words and phrases with their plain form, tried in this order; an empty one is a courtesy or a filler.
const PHRASES: [(&str, &str); 134] = [
    ("as close as possible to", "close to"),
    ("as near as possible to", "near"),
    ("very close to", "close to"),
    ("really close to", "close to"),
    ("have the robot", ""),
    ("get the robot to", ""),
    ("make the robot", ""),
    ("would it be possible to", ""),
    ("would it be possible for you to", ""),
    ("is it possible to", ""),
    ("is there any chance you could", ""),
    ("can i ask you to", ""),
    ("may i ask you to", ""),
    ("would you be so kind as to", ""),
    ("would you be kind enough to", ""),
    ("be so kind as to", ""),
    ("be a dear and", ""),
    ("be a darling and", ""),
    ("do me a favour and", ""),
    ("do me a favor and", ""),
    ("would you mind", ""),
    ("do you mind", ""),
    ("do you think you could", ""),
    ("i would be grateful if you could", ""),
    ("i would be very grateful if you could", ""),
    ("it would be great if you could", ""),
    ("it would be nice if you could", ""),
    ("it would be lovely if you could", ""),
    ("i would appreciate it if you could", ""),
    ("i would appreciate it if you would", ""),
    ("i would love it if you could", ""),
    ("i would love it if you would", ""),
    ("i would love it if you", ""),
    ("i was wondering if you could", ""),
    ("i wonder if you could", ""),
    ("any chance you could", ""),
    ("if you would not mind", ""),
    ("if you do not mind", ""),
    ("if you would be so kind", ""),
    ("if you please", ""),
    ("if you could", ""),
    ("if you can", ""),
    ("if possible", ""),
    ("when you have a moment", ""),
    ("when you have a minute", ""),
    ("when you have a second", ""),
    ("when you get a chance", ""),
    ("when you have time", ""),
    ("as soon as you can", ""),
    ("as soon as possible", ""),
    ("thank you very much", ""),
    ("thank you so much", ""),
    ("thank you", ""),
    ("thanks a lot", ""),
    ("thanks a million", ""),
    ("many thanks", ""),
    ("thanks in advance", ""),
    ("thanks", ""),
    ("thx", ""),
    ("cheers", ""),
    ("please to", ""),
    ("please", ""),
    ("pls", ""),
    ("plz", ""),
    ("kindly", ""),
    ("for me", ""),
    ("for us", ""),
    ("once more", ""),
    ("whichever is easier", ""),
    ("i want you to", ""),
    ("i would like you to", ""),
    ("i would love you to", ""),
    ("i need you to", ""),
    ("we need you to", ""),
    ("i would like for you to", ""),
    ("i am going to need you to", ""),
    ("you need to", ""),
    ("you have to", ""),
    ("you must", ""),
    ("you should", ""),
    ("you are to", ""),
    ("your task is to", ""),
    ("your job is to", ""),
    ("the task is to", ""),
    ("the robot should", ""),
    ("the robot must", ""),
    ("the robot has to", ""),
    ("go ahead and", ""),
    ("go and", ""),
    ("help me to", ""),
    ("help me", ""),
    ("try to", ""),
    ("remember to", ""),
    ("we need to", ""),
    ("let us", ""),
    ("how about", ""),
    ("why do not you", ""),
    ("all you have to do is", ""),
    ("what i want is", "i want"),
    ("i would like to have", "i want"),
    ("i would like to see", "i want"),
    ("i want to see", "i want"),
    ("i want to have", "i want"),
    ("on to", "onto"),
    ("in to", "into"),
    ("upto", "up to"),
    ("the middle of", ""),
    ("the centre of", ""),
    ("the center of", ""),
    ("the bottom of", ""),
    ("the surface of", ""),
    ("the inside of", ""),
    ("the interior of", ""),
    ("a little to", "to"),
    ("a bit to", "to"),
    ("a little", "little"),
    ("a bit", ""),
    ("a touch", ""),
    ("slightly", ""),
    ("just", ""),
    ("simply", ""),
    ("once you are done", "then"),
    ("when you are done", "then"),
    ("once that is done", "then"),
    ("when that is done", "then"),
    ("after that is done", "then"),
    ("after doing that", "then"),
    ("having done that", "then"),
    ("once done", "then"),
    ("smallest of the two", "smaller of the two"),
    ("largest of the two", "larger of the two"),
    ("biggest of the two", "larger of the two"),
    ("one of the two", "of the two"),
    ("one of the three", "of the three"),
];

/// Spelling variants and other words for the same.
const SPELLINGS: [(&str, &str); 22] = [
    ("gray", "grey"),
    ("donut", "doughnut"),
    ("donuts", "doughnuts"),
    ("jewelry", "jewellery"),
    ("jewellry", "jewellery"),
    ("yogurt", "yoghurt"),
    ("yogurts", "yoghurts"),
    ("yoghourt", "yoghurt"),
    ("color", "colour"),
    ("colored", "coloured"),
    ("aluminum", "aluminium"),
    ("u", "you"),
    ("r", "are"),
    ("&", "and"),
    ("->", "onto"),
    ("righthand", "right"),
    ("lefthand", "left"),
    ("nextto", "next to"),
    ("infront", "in front"),
    ("labelled", "marked"),
    ("labeled", "marked"),
    ("saying", "marked"),
];

/// Numbers of a phrase in figures.
const FIGURES: [(&str, &str); 5] = [("2", "two"), ("3", "three"), ("4", "four"), ("5", "five"), ("6", "six")];

/// Words in `ly` that are no adverbs of manner.
const NO_ADVERBS: [&str; 6] = ["only", "jelly", "family", "early", "curly", "fly"];

/// Tokens of a sentence in plain form; commas, full stops and semicolons are tokens of their own.
pub(super) fn tokens(text: &str) -> Vec<String> {
    let mut spaced = String::with_capacity(text.len() + 16);
    for letter in text.to_lowercase().chars() {
        match letter {
            '’' | '‘' => spaced.push('\''),
            '“' | '”' | '"' | '(' | ')' | '[' | ']' | '*' | '„' | '«' | '»' => spaced.push(' '),
            '—' | '–' | ':' => spaced.push_str(" , "),
            ',' | ';' => spaced.extend([' ', letter, ' ']),
            '.' | '?' | '!' | '\n' => spaced.push_str(" . "),
            '…' => spaced.push(' '),
            _ => spaced.push(letter),
        }
    }
    let mut words: Vec<String> = Vec::new();
    for word in spaced.split_whitespace() {
        let word = word.trim_matches('\'');
        let plain = |table: &[(&'static str, &'static str)]| {
            table.iter().find(|(other, _)| *other == word).map(|(_, plain)| *plain)
        };
        let word = plain(&CONTRACTIONS).or(plain(&SPELLINGS)).or(plain(&FIGURES)).unwrap_or(word);
        let is_known = lexicon().contains(word) || word.starts_with('-') || word == "->";
        if is_known { words.push(word.into()) } else { words.extend(word.split(['-', ' ']).map(String::from)) }
    }
    words.retain(|word| !word.is_empty() && word != "-" && !is_adverb(word));
    let mut plain: Vec<String> = Vec::with_capacity(words.len());
    let mut next = 0;
    'words: while next < words.len() {
        for (phrase, other) in PHRASES {
            let length = phrase.split(' ').count();
            if words[next..].len() >= length && phrase.split(' ').zip(&words[next..]).all(|(one, word)| one == word) {
                plain.extend(other.split(' ').filter(|word| !word.is_empty()).map(String::from));
                next += length;
                continue 'words;
            }
        }
        plain.push(words[next].clone());
        next += 1;
    }
    plain
}

/// True for an adverb of manner, such as `carefully`.
fn is_adverb(word: &str) -> bool {
    word.len() > 5 && word.ends_with("ly") && !NO_ADVERBS.contains(&word) && !lexicon().contains(word)
}

#[cfg(test)]
mod tests {
    use super::tokens;

    #[test]
    fn sentences_have_one_plain_form() {
        let cases = [
            ("Would you mind putting it there?", "putting it there ."),
            ("Carefully park the toy-car on the right-hand side!", "park the toy car on the right hand side ."),
            (
                "There's a dark-red mug; pop it in the gray bowl, please",
                "there is a dark-red mug ; pop it in the grey bowl ,",
            ),
            ("Put 2 eggs in the middle of the plate", "put two eggs in the plate"),
        ];
        for (said, expected) in cases {
            assert_eq!(tokens(said).join(" "), expected, "{said}");
        }
    }
}
