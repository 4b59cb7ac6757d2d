//! Doc comments name their subject with a noun first, so that rustdoc's lists and editors' pop-ups can be scanned.

use super::lexer::{self, Kind};
use super::repository::Entry;
use super::violation::Violation;

/// Opening words that announce a clause instead of naming the subject, with a replacement.
const OPENINGS: [(&str, &str); 9] = [
    ("What", "name it: `The commands of …`"),
    ("Whether", "`True if …`"),
    ("Whose", "name the owner: `Tiles whose …`"),
    ("How", "name the quantity with its unit: `Number of …`, `Distance to … [m]`, `Share of …`"),
    ("Who", "name the actor: `The policy that …`"),
    ("Which", "name it: `Index of …`, `Cameras that …`"),
    ("Where", "name the place with its frame: `Position of … in the world frame`, `Path of …`"),
    ("When", "name the time or the condition: `Time of … [s]`, `Condition for …`"),
    ("That", "name the subject"),
];

/// Doc comments that open with one of [`OPENINGS`].
pub fn check(files: &[Entry]) -> Vec<Violation> {
    let mut found = Vec::new();
    for file in files.iter().filter(|file| file.path.ends_with(".rs")) {
        let text = file.text.as_deref().unwrap_or_default();
        let mut before: Option<(usize, Kind)> = None;
        for piece in lexer::pieces(text) {
            let is_doc = matches!(piece.kind, Kind::Doc | Kind::InnerDoc);
            // Lines below each other are one comment, of which only the first word counts.
            let continues = before == Some((piece.line - 1, piece.kind));
            before = is_doc.then_some((piece.line, piece.kind));
            if !is_doc || continues {
                continue;
            }
            let first = piece.text.split_whitespace().next().unwrap_or_default();
            let first = first.trim_matches(|letter: char| !letter.is_alphanumeric());
            if let Some((word, instead)) = OPENINGS.iter().find(|(word, _)| *word == first) {
                found.push(Violation {
                    place: format!("{}:{}", file.path, piece.line),
                    what: format!("a doc comment opens with `{word}`"),
                    hint: format!("open with a noun of the field: {instead}"),
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clauses_are_no_subjects() {
        let text = "\
//! What this file holds.
//! What a second line says is free.

/// Whether it fits.
fn f() {}
/// Number of parts.
/// How they are counted.
fn g() {} // What other comments say is free.
/// *Where* it lies.
fn h() {}
const T: &str = \"/// What\";
/// Whatever comes.
fn k() {}
";
        let entry = Entry { path: "crates/a/src/lib.rs".into(), text: Some(text.into()) };
        let found = check(&[entry]);
        let places: Vec<&str> = found.iter().map(|one| one.place.rsplit(':').next().unwrap()).collect();
        assert_eq!(places, ["1", "4", "9"], "{found:?}");
        assert!(found[1].hint.contains("True if"));
    }
}
