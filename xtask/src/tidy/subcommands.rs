//! Subcommands of a program, read from the enums that its command line is derived from.

use super::lexer::{self, Kind, Piece};
use std::collections::BTreeMap;

/// Subcommands by enum; names and aliases, with the enum of the subcommands below.
#[derive(Debug, Default)]
pub struct Subcommands {
    root: String,
    enums: BTreeMap<String, Vec<(String, Option<String>)>>,
}

impl Subcommands {
    /// Reads Rust sources; `root` is the enum of the first level.
    pub fn read(sources: &[&str], root: &str) -> Self {
        let mut enums = BTreeMap::new();
        for source in sources {
            let pieces: Vec<Piece> = lexer::pieces(source)
                .into_iter()
                .filter(|piece| matches!(piece.kind, Kind::Name | Kind::Mark | Kind::Literal))
                .collect();
            for (at, window) in pieces.windows(3).enumerate() {
                if window[0].text == "enum" && window[1].text.ends_with("Command") && window[2].text == "{" {
                    enums.insert(window[1].text.clone(), variants(&pieces[at + 3..]));
                }
            }
        }
        Self { root: root.into(), enums }
    }

    /// Names that may follow the subcommands in `path`; `None` where none do.
    pub fn below(&self, path: &[&str]) -> Option<Vec<&str>> {
        let mut level = &self.root;
        for name in path {
            level = self.enums.get(level)?.iter().find(|(one, _)| one == name)?.1.as_ref()?;
        }
        let names = self.enums.get(level)?.iter().map(|(name, _)| name.as_str());
        Some(names.collect())
    }
}

/// Variants up to the brace that closes the enum.
fn variants(pieces: &[Piece]) -> Vec<(String, Option<String>)> {
    let mut found: Vec<(String, Option<String>)> = Vec::new();
    let mut given: Vec<String> = Vec::new();
    let (mut open, mut in_attribute) = (0, false);
    for (at, piece) in pieces.iter().enumerate() {
        match piece.text.as_str() {
            "}" if piece.kind == Kind::Mark && open == 0 => break,
            "{" | "(" | "[" if piece.kind == Kind::Mark => {
                in_attribute |= open == 0 && piece.text == "[";
                open += 1;
            }
            "}" | ")" | "]" if piece.kind == Kind::Mark => {
                open -= 1;
                in_attribute &= open > 0;
            }
            // `name = "x"`, `alias = "x"`, `visible_alias = "x"` of a variant's attribute.
            _ if in_attribute && piece.kind == Kind::Literal && at >= 2 => {
                let key = &pieces[at - 2].text;
                given.extend(matches!(key.as_str(), "name" | "alias" | "visible_alias").then(|| piece.text.clone()));
            }
            name if open == 0 && piece.kind == Kind::Name => {
                found.push((kebab_case(name), None));
                found.extend(given.drain(..).map(|name| (name, None)));
            }
            name if open > 0 && !in_attribute && name.ends_with("Command") && piece.kind == Kind::Name => {
                if let Some((_, below)) = found.last_mut() {
                    *below = Some(name.to_owned());
                }
            }
            _ => {}
        }
    }
    found
}

/// As clap names the subcommand of a variant.
fn kebab_case(variant: &str) -> String {
    let mut name = String::new();
    for letter in variant.chars() {
        if letter.is_uppercase() && !name.is_empty() {
            name.push('-');
        }
        name.extend(letter.to_lowercase());
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_levels_and_aliases() {
        let first = r#"
            /// Subcommands
            pub enum Command {
                /// Lay out
                #[command(after_help = "Example: {}", alias = "place")]
                LayOut(LayOutArguments),
                Task {
                    #[command(subcommand)]
                    command: TaskCommand,
                },
                Doctor,
            }
            enum Other { A }
        "#;
        let second = "enum TaskCommand { New, Show(ShowArguments) }";
        let read = Subcommands::read(&[first, second], "Command");
        assert_eq!(read.below(&[]).unwrap(), ["lay-out", "place", "task", "doctor"]);
        assert_eq!(read.below(&["task"]).unwrap(), ["new", "show"]);
        assert_eq!(read.below(&["doctor"]), None);
        assert_eq!(read.below(&["task", "new"]), None);
        assert_eq!(Subcommands::read(&[], "Command").below(&[]), None);
    }
}
