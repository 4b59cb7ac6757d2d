//! Objects named in a sub-task, for the judgement of decompositions.

/// Indices of the names that occur in a text, in order of occurrence; the longest of overlapping names wins, and the
/// first of equal names.
pub(super) fn named(text: &str, names: &[String]) -> Vec<usize> {
    let text = text.to_lowercase();
    let mut found: Vec<(usize, usize, usize)> = Vec::new();
    let mut order: Vec<(usize, String)> = names.iter().map(|name| name.to_lowercase()).enumerate().collect();
    order.sort_by_key(|(index, name)| (std::cmp::Reverse(name.len()), *index));
    for (index, name) in order.iter().filter(|(_, name)| !name.is_empty()) {
        for (start, _) in text.match_indices(name.as_str()) {
            let end = start + name.len();
            let is_word = |at: Option<char>| at.is_none_or(|letter| !letter.is_alphanumeric());
            let stands_alone = is_word(text[..start].chars().next_back()) && is_word(text[end..].chars().next());
            if stands_alone && found.iter().all(|(from, to, _)| end <= *from || start >= *to) {
                found.push((start, end, *index));
            }
        }
    }
    found.sort_unstable();
    found.into_iter().map(|(_, _, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::named;

    #[test]
    fn longer_names_win_and_parts_of_words_are_none() {
        let names = ["mug", "blue mug", "plate", "can"].map(String::from);
        let cases: [(&str, &[usize]); 5] = [
            ("Pick up the blue mug and place it on the plate.", &[1, 2]),
            ("Put the Mug to the left of the blue mug", &[0, 1]),
            ("Scan the plates", &[]),
            ("between the can and the plate, by the can", &[3, 2, 3]),
            ("", &[]),
        ];
        for (text, expected) in cases {
            assert_eq!(named(text, &names), expected, "{text}");
        }
    }
}
