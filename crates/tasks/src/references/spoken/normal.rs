//! Plain form of a sentence: lower case, one spelling, no contractions, courtesies or adverbs of manner.

use super::super::lexicon::lexicon;
use super::words::vocabulary;

/// Beginnings of words in parentheses that say which object is meant.
const APPOSITIONS: [&str; 6] = ["the one", "that ", "which ", "currently ", "now ", "it is "];

/// Tokens of a sentence in plain form; commas, full stops and semicolons are tokens of their own.
pub(super) fn tokens(text: &str) -> Vec<String> {
    let mut spaced = String::with_capacity(text.len() + 16);
    let mut is_apposition = false;
    let text = text.replace(" - ", " , ").to_lowercase().lines().map(unnumbered).collect::<Vec<_>>().join("\n");
    for (index, letter) in text.char_indices() {
        match letter {
            // `the orange (the one in the bowl)`
            '(' => {
                is_apposition = APPOSITIONS.iter().any(|opening| text[index + 1..].trim_start().starts_with(opening));
                spaced.push_str(if is_apposition { " , " } else { " " });
            }
            ')' => spaced.push_str(if is_apposition { " , " } else { " " }),
            '’' | '‘' => spaced.push('\''),
            '“' | '”' | '"' | '[' | ']' | '*' | '„' | '«' | '»' => spaced.push(' '),
            '—' | '–' | ':' => spaced.push_str(" , "),
            ',' | ';' => spaced.extend([' ', letter, ' ']),
            '.' | '?' | '!' | '\n' => spaced.push_str(" . "),
            '→' | '⇒' => spaced.push_str(" -> "),
            '…' => spaced.push(' '),
            _ => spaced.push(letter),
        }
    }
    let mut words: Vec<String> = Vec::new();
    let mut rest = spaced.split_whitespace().peekable();
    while let Some(word) = rest.next() {
        // `the light's off`
        if let Some(noun) = word.strip_suffix("'s").filter(|noun| lexicon().is_noun(noun))
            && rest.peek().is_some_and(|next| vocabulary().predicates.contains(next))
        {
            words.extend([noun, "is"].map(String::from));
            continue;
        }
        // `the lemon's place is in the basket`
        let mut ahead = rest.clone();
        if let Some(noun) = word.strip_suffix("'s").filter(|noun| lexicon().is_noun(noun))
            && ahead.next().is_some_and(|next| ["place", "home", "spot", "position"].contains(&next))
            && ahead.next() == Some("is")
        {
            words.extend([noun, "belongs"].map(String::from));
            rest = ahead;
            continue;
        }
        let word = &unstretched(word.trim_matches('\''));
        let plain = |table: &[(&'static str, &'static str)]| {
            table.iter().find(|(other, _)| *other == word).map(|(_, plain)| *plain)
        };
        let tables = [&vocabulary().contractions, &vocabulary().spellings, &vocabulary().figures];
        let word = tables.into_iter().find_map(|table| plain(table)).unwrap_or(word);
        let is_known = lexicon().contains(word) || word.starts_with('-') || word == "->";
        if is_known { words.push(word.into()) } else { words.extend(word.split(['-', ' ']).map(String::from)) }
    }
    words.retain(|word| !word.is_empty() && word != "-" && !is_adverb(word));
    let mut plain: Vec<String> = Vec::with_capacity(words.len());
    let mut next = 0;
    while next < words.len() {
        let rest = &words[next..];
        let stands = |phrase: &str| {
            let length = phrase.split(' ').count();
            let is_one_of = |(words, word): (&str, &String)| words.split('|').any(|one| one == word);
            (rest.len() >= length && phrase.split(' ').zip(rest).all(is_one_of)).then_some(length)
        };
        let found = vocabulary().phrases.iter().filter_map(|(phrase, other)| Some((stands(phrase)?, *other)));
        let (length, other) = found.max_by_key(|(length, _)| *length).unwrap_or((1, rest[0].as_str()));
        plain.extend(other.split(' ').filter(|word| !word.is_empty()).map(String::from));
        next += length;
    }
    plain
}

/// A line whose steps are not numbered: `1. open the drawer 2. …`, `(a) …`.
fn unnumbered(line: &str) -> String {
    let is_number = |word: &str| {
        let inner = word.trim_start_matches('(').trim_end_matches(['.', ')']);
        let is_short = inner.len() == 1 || inner.len() == 2 && inner.chars().all(|c| c.is_ascii_digit());
        inner.len() < word.len() && word.ends_with(['.', ')']) && is_short && inner.chars().all(char::is_alphanumeric)
    };
    let words: Vec<&str> = line.split_whitespace().collect();
    let plain = |(index, word): (usize, &&str)| {
        let begins = index == 0 || words[index - 1].ends_with([':', '.', ',', ';', '!']) || word.ends_with(')');
        let is_step = begins && index + 1 < words.len() && is_number(word);
        if is_step { ".".to_owned() } else { (*word).to_owned() }
    };
    words.iter().enumerate().map(plain).collect::<Vec<_>>().join(" ")
}

/// A word without letters that are repeated for emphasis: `pleeease`.
fn unstretched(word: &str) -> String {
    let letters: Vec<char> = word.chars().collect();
    let is_stretched =
        letters.windows(3).any(|three| three[0].is_alphabetic() && three.iter().all(|one| *one == three[0]));
    if !is_stretched {
        return word.to_owned();
    }
    let mut plain = letters;
    plain.dedup();
    plain.into_iter().collect()
}

/// True for an adverb of manner, such as `carefully`.
fn is_adverb(word: &str) -> bool {
    word.len() > 5 && word.ends_with("ly") && !vocabulary().no_adverbs.contains(&word) && !lexicon().contains(word)
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
            ("To do: (1) close it, 2. open it", "to do , . close it , . open it"),
            ("The lemon's place is in the bowl", "the lemon belongs in the bowl"),
            ("Put 2 eggs in the middle of the plate", "put two eggs in the plate"),
        ];
        for (said, expected) in cases {
            assert_eq!(tokens(said).join(" "), expected, "{said}");
        }
    }
}
