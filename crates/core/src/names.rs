//! Valid file names, and suggestions for misspelt names.

/// Maximum length of a file name derived from an id, characters.
pub const MAX_NAME_LENGTH: usize = 200;

/// True if a text is a portable file name without a path: 1 to [`MAX_NAME_LENGTH`] ASCII letters, digits and any of
/// `-_.+=@`, not starting with a dot.
///
/// ```
/// use genmanip_core::names::is_file_name;
/// assert!(is_file_name("017_pick_and_place-000"));
/// assert!(!is_file_name("../../evil") && !is_file_name(".hidden") && !is_file_name(""));
/// ```
pub fn is_file_name(text: &str) -> bool {
    (1..=MAX_NAME_LENGTH).contains(&text.len()) && !text.starts_with('.') && text.chars().all(fits_file_name)
}

/// True for characters allowed in file names, see [`is_file_name`].
pub fn fits_file_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || "-_.+=@".contains(c)
}

/// The known name that was most likely meant, if any is similar.
///
/// Names are similar if one contains the other and the given one has more than two letters, or if the edit distance is
/// at most a third of the known name's length.
///
/// ```
/// assert_eq!(genmanip_core::names::near_misses("expret", &["expert", "replay"]), ["expert"]);
/// ```
pub fn near_misses(got: &str, known: &[&str]) -> Vec<String> {
    let distance = |name: &str| {
        let contained = got.len() > 2 && (name.contains(got) || got.contains(name));
        if contained { 0 } else { edits(got, name) }
    };
    let mut near: Vec<(usize, &str)> = known.iter().map(|name| (distance(name), *name)).collect();
    near.retain(|(distance, name)| 3 * distance <= name.chars().count());
    near.sort();
    near.first().map(|(_, name)| (*name).to_owned()).into_iter().collect()
}

/// Levenshtein distance of two texts, characters.
fn edits(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, letter) in from.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, other) in to.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[to.len()]
}

#[cfg(test)]
mod tests {
    use super::near_misses;

    #[test]
    fn a_misspelt_name_finds_the_intended_one() {
        let known = ["expert", "replay", "do_nothing", "d415"];
        let cases = [
            ("expret", Some("expert")),
            ("Replay", Some("replay")),
            ("nothing", Some("do_nothing")),
            ("do-nothing", Some("do_nothing")),
            ("D415", Some("d415")),
            ("magic", None),
            ("", None),
        ];
        for (got, wanted) in cases {
            assert_eq!(near_misses(got, &known).first().map(String::as_str), wanted, "{got}");
        }
    }
}
