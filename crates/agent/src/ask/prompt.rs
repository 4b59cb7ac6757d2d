//! Prompt files: one per kind of question, with an id, a version and placeholders.
//!
//! A file begins with TOML front matter between two `+++` lines. In the rest, `{instruction}`, `{object_name}`,
//! `{start_point}` and `{arrows}` are substituted; other braces are kept.

use std::path::Path;

use genmanip_core::{hexadecimal, limits};
use genmanip_llm::files::read_text;
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::question_kind::{PromptStamp, QuestionKind};

/// All prompts of the agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PromptSet {
    /// Prompts in the order of [`QuestionKind::ALL`].
    prompts: Vec<Prompt>,
    /// Prompt of [`PromptVariant::Turned`].
    turned: Prompt,
    /// Prompt of [`PromptVariant::FineCell`].
    fine_cell: Prompt,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Prompt {
    stamp: PromptStamp,
    text: String,
}

/// Error in a prompt file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("prompt {file}: {message}")]
pub struct PromptError {
    /// File name of the prompt.
    pub file: String,
    /// Description of the error.
    pub message: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    id: String,
    version: u32,
}

/// Values of the placeholders; empty where a prompt does not use one.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Inputs<'a> {
    pub instruction: &'a str,
    pub object_name: &'a str,
    pub start_point: &'a str,
    pub arrows: &'a str,
}

const BUILT_IN: [(&str, &str); 7] = [
    ("decompose.md", include_str!("../../prompts/decompose.md")),
    ("object.md", include_str!("../../prompts/object.md")),
    ("part.md", include_str!("../../prompts/part.md")),
    ("grab_point.md", include_str!("../../prompts/grab_point.md")),
    ("grid_path.md", include_str!("../../prompts/grid_path.md")),
    ("point_to_point.md", include_str!("../../prompts/point_to_point.md")),
    ("check.md", include_str!("../../prompts/check.md")),
];

/// Variant of a question.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PromptVariant {
    /// The prompt as published.
    #[default]
    Plain,
    /// [`QuestionKind::PointToPoint`] that also asks for the yaw change of the object.
    Turned,
    /// [`QuestionKind::PointToPoint`] on a finer grid.
    FineCell,
}

const TURNED: (&str, &str) = ("place_turned.md", include_str!("../../prompts/place_turned.md"));
const FINE_CELL: (&str, &str) = ("fine_cell.md", include_str!("../../prompts/fine_cell.md"));

impl PromptSet {
    /// Loads the built-in prompts; files of the same name in `folder` replace them.
    ///
    /// # Errors
    /// Fails if a file cannot be read or has no valid front matter.
    pub fn load(folder: Option<&Path>) -> Result<Self, PromptError> {
        let prompt = |(name, built_in): (&str, &str)| {
            let path = folder.map(|folder| folder.join(name)).filter(|path| path.exists());
            let file = path.as_ref().map_or_else(|| name.to_owned(), |path| path.display().to_string());
            let wrong = |message: String| PromptError { file: file.clone(), message };
            match &path {
                None => Prompt::parse(built_in).map_err(wrong),
                Some(path) => {
                    let text = read_text(path, limits::PROMPT).map_err(wrong)?;
                    Prompt::parse(&text).map_err(wrong)
                }
            }
        };
        let prompts = BUILT_IN.into_iter().map(prompt).collect::<Result<_, _>>()?;
        Ok(Self { prompts, turned: prompt(TURNED)?, fine_cell: prompt(FINE_CELL)? })
    }

    /// Fills in the prompt of a kind of question.
    pub(crate) fn fill(&self, stage: QuestionKind, variant: PromptVariant, inputs: Inputs) -> (PromptStamp, String) {
        let Prompt { stamp, text } = match variant {
            PromptVariant::Plain => &self.prompts[stage as usize],
            PromptVariant::Turned => &self.turned,
            PromptVariant::FineCell => &self.fine_cell,
        };
        (stamp.clone(), filled(text, inputs))
    }
}

impl Prompt {
    fn parse(content: &str) -> Result<Self, String> {
        let content = content.replace("\r\n", "\n");
        let (head, text) = content
            .strip_prefix("+++\n")
            .and_then(|rest| rest.split_once("\n+++\n"))
            .ok_or("expected TOML with `id` and `version` between two lines `+++`")?;
        let Head { id, version } = toml::from_str(head).map_err(|error| error.message().to_owned())?;
        let text = text.trim().to_owned();
        let digest = Sha256::digest(text.as_bytes());
        let sha256 = hexadecimal(&digest[..6]);
        Ok(Self { stamp: PromptStamp { id, version, sha256 }, text })
    }
}

/// Substitutes placeholders in one pass, so that braces inside values are kept.
fn filled(text: &str, inputs: Inputs) -> String {
    let values = [
        ("{instruction}", inputs.instruction),
        ("{object_name}", inputs.object_name),
        ("{start_point}", inputs.start_point),
        ("{arrows}", inputs.arrows),
    ];
    let mut words = String::new();
    let mut rest = text;
    while let Some(at) = rest.find('{') {
        words += &rest[..at];
        rest = &rest[at..];
        match values.iter().find(|(name, _)| rest.starts_with(name)) {
            Some((name, value)) => {
                words += value;
                rest = &rest[name.len()..];
            }
            None => {
                words.push('{');
                rest = &rest[1..];
            }
        }
    }
    words + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_filled_once_and_other_braces_stay() {
        let inputs = Inputs { instruction: "put {object_name} {", object_name: "cup", ..Inputs::default() };
        assert_eq!(filled("{instruction}: {\"a\": {object_name}} {x", inputs), "put {object_name} {: {\"a\": cup} {x");
    }

    #[test]
    fn a_folder_replaces_single_prompts_and_says_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("check.md"), "+++\nid = \"mine\"\nversion = 3\n+++\nDone: {instruction}?\n")
            .unwrap();
        let mine = PromptSet::load(Some(folder.path())).unwrap();
        let (stamp, text) =
            mine.fill(QuestionKind::Check, PromptVariant::Plain, Inputs { instruction: "x", ..Inputs::default() });
        assert_eq!((stamp.id.as_str(), stamp.version, text.as_str()), ("mine", 3, "Done: x?"));
        let built_in = PromptSet::load(None).unwrap();
        assert_eq!(mine.prompts[0], built_in.prompts[0]);
        for (stage, prompt) in QuestionKind::ALL.iter().zip(&built_in.prompts) {
            assert_eq!(prompt.stamp.id, format!("agent.{}", stage.name()));
            assert!(prompt.text.contains("{instruction}") || *stage == QuestionKind::GrabPoint, "{}", stage.name());
        }
        std::fs::write(folder.path().join("check.md"), "no head").unwrap();
        let error = PromptSet::load(Some(folder.path())).unwrap_err().to_string();
        assert!(error.contains("check.md") && error.contains("+++"), "{error}");
    }
}
