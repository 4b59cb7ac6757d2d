//! Prompt files with a name, a version and declared inputs.
//!
//! A file begins with TOML front matter between two `+++` lines; in the text `{{name}}` stands for an input. The
//! built-in files are in `prompts/`; a user folder may replace any of them with a file of the same name.

use std::path::Path;

use genmanip_core::{NamedSurface, ObjectCard, ReferenceId, TaskKind, hexadecimal, limits};
use genmanip_llm::ReplySchema;
use genmanip_llm::files::read_text;
use genmanip_tasks::answer::TaskRequest;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::grammar::reply_grammar;

/// All prompts of the task writer.
#[derive(Clone, Debug, PartialEq)]
pub struct PromptSet {
    /// System message: role, format, conventions and rules. Input: `max_words`.
    pub system: Prompt,
    /// Request for one task. Inputs: `objects`, `min_objects`, `kind`.
    pub request: Prompt,
    /// Repair request with the violations of an answer. Input: `violations`.
    pub repair: Prompt,
    /// Request for a new answer after a repair that changed hardly anything. Input: `violations`.
    pub restart: Prompt,
    /// Paragraphs on each kind of task.
    pub kinds: KindPrompts,
    /// JSON Schema of the answer; `{{uids}}` and `{{states}}` in its enums stand for those of the offered objects.
    pub schema: Value,
}

/// Paragraphs on each kind of task, without inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct KindPrompts {
    /// Paragraph on [`TaskKind::PickAndPlace`].
    pub pick_and_place: Prompt,
    /// Paragraph on [`TaskKind::Spatial`].
    pub spatial: Prompt,
    /// Paragraph on [`TaskKind::Appearance`].
    pub appearance: Prompt,
    /// Paragraph on [`TaskKind::CommonSense`].
    pub common_sense: Prompt,
    /// Paragraph on [`TaskKind::LongHorizon`].
    pub long_horizon: Prompt,
    /// Paragraph on [`TaskKind::Articulated`].
    pub articulated: Prompt,
}

/// One prompt file: front matter and text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Prompt {
    /// Name, version and inputs.
    pub head: PromptHead,
    /// The text with its placeholders.
    pub text: String,
}

/// Front matter of a prompt file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptHead {
    /// Prompt id, e.g. `tosg.system`.
    pub id: String,
    /// Version, incremented with every change of the text.
    pub version: u32,
    /// Placeholder names, each of which occurs in the text.
    pub inputs: Vec<String>,
    /// Name of the file with the JSON Schema of the answer; `None` for other prompts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_schema: Option<String>,
}

/// Identity of a prompt, for provenance.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PromptStamp {
    /// Prompt id, see [`PromptHead::id`].
    pub id: String,
    /// Version of the prompt.
    pub version: u32,
    /// First twelve hexadecimal digits of the SHA-256 of the text, which differ even if the version was not
    /// incremented.
    pub sha256: String,
}

/// Error in a prompt file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PromptError {
    /// The front matter is invalid.
    #[error("expected TOML front matter between two `+++` lines: {message}: {file}")]
    Head {
        /// Description of the problem.
        message: String,
        /// Name of the file.
        file: String,
    },
    /// Declared or used inputs differ from those provided.
    #[error("expected the inputs {expected:?}, but {declared:?} are declared and {used:?} are used: {file}")]
    Inputs {
        /// Names of the inputs that the program provides.
        expected: Vec<String>,
        /// Names declared in the front matter.
        declared: Vec<String>,
        /// Names used in the text.
        used: Vec<String>,
        /// Name of the file.
        file: String,
    },
    /// The file cannot be read.
    #[error("{message}: {file}")]
    File {
        /// Description of the problem.
        message: String,
        /// Name of the file.
        file: String,
    },
}

impl PromptSet {
    /// Loads the built-in prompts; files of the same name in `folder` replace them.
    ///
    /// # Errors
    /// [`PromptError`] with the file and the problem.
    pub fn load(folder: Option<&Path>) -> Result<Self, PromptError> {
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            return Err(PromptError::File { message: "no such folder".into(), file: folder.display().to_string() });
        }
        let text = |(file, builtin): (&str, Option<&str>)| {
            match folder.map(|folder| folder.join(file)).filter(|path| path.exists()) {
                Some(path) => read_text(&path, limits::PROMPT).map_err(|message| (message, path.display().to_string())),
                None => builtin.map(str::to_owned).ok_or_else(|| ("no such file".into(), file.to_owned())),
            }
            .map_err(|(message, file)| PromptError::File { message, file })
        };
        let prompt =
            |(file, builtin): (&str, &str), inputs: &[&str]| Prompt::parse(file, &text((file, Some(builtin)))?, inputs);
        let request = prompt(builtin!("request.md"), &["objects", "min_objects", "kind"])?;
        let (builtin_file, builtin_schema) = builtin!("tosg_answer.schema.json");
        let schema_file = request.head.output_schema.clone().unwrap_or_else(|| builtin_file.into());
        let schema = text((&schema_file, (schema_file == builtin_file).then_some(builtin_schema)))?;
        Ok(Self {
            system: prompt(builtin!("system.md"), &["max_words"])?,
            repair: prompt(builtin!("repair.md"), &["violations"])?,
            restart: prompt(builtin!("restart.md"), &["violations"])?,
            kinds: KindPrompts {
                pick_and_place: prompt(builtin!("kind_pick_and_place.md"), &[])?,
                spatial: prompt(builtin!("kind_spatial.md"), &[])?,
                appearance: prompt(builtin!("kind_appearance.md"), &[])?,
                common_sense: prompt(builtin!("kind_common_sense.md"), &[])?,
                long_horizon: prompt(builtin!("kind_long_horizon.md"), &[])?,
                articulated: prompt(builtin!("kind_articulated.md"), &[])?,
            },
            schema: serde_json::from_str(&schema)
                .map_err(|error| PromptError::File { message: error.to_string(), file: schema_file })?,
            request,
        })
    }

    /// System message: role, format, conventions and rules. `max_words` limits instructions.
    pub fn system_text(&self, max_words: usize) -> String {
        self.system.render(&[("max_words", &max_words.to_string())])
    }

    /// Request for one task with the offered objects and surfaces.
    pub fn request_text(&self, request: &TaskRequest) -> String {
        self.request.render(&[
            ("objects", &object_list(request)),
            ("min_objects", &request.min_objects.to_string()),
            ("kind", &self.kinds.of(request.kind).text),
        ])
    }

    /// Repair request; `violations` has one line each.
    pub fn repair_text(&self, violations: &str) -> String {
        self.repair.render(&[("violations", violations)])
    }

    /// Request for a new answer after a failed repair; `violations` has one line each.
    pub fn restart_text(&self, violations: &str) -> String {
        self.restart.render(&[("violations", violations)])
    }

    /// Stamps of the prompts used for this kind of task.
    pub fn stamps(&self, kind: TaskKind) -> Vec<PromptStamp> {
        [&self.system, &self.request, self.kinds.of(kind), &self.repair, &self.restart].map(Prompt::stamp).into()
    }

    /// Schema of an answer with the offered objects and surfaces; the built-in schema is accompanied by a more
    /// restrictive one.
    pub fn reply_schema(&self, request: &TaskRequest) -> ReplySchema {
        let uids = request.ids();
        let mut states: Vec<&str> = Vec::new();
        for state in request.offered.iter().flat_map(|card| &card.states) {
            if !states.contains(&state.as_str()) {
                states.push(state);
            }
        }
        let schema = filled(
            &self.schema,
            &[("{{uids}}", uids.iter().map(ReferenceId::as_str).collect()), ("{{states}}", states)],
        );
        // The contents of a user's schema are unknown, so it gets no restrictive variant.
        let is_builtin =
            serde_json::from_str(builtin!("tosg_answer.schema.json").1).is_ok_and(|own: Value| own == self.schema);
        let grammar = is_builtin.then(|| reply_grammar(request)).flatten();
        ReplySchema { grammar, ..ReplySchema::new("tosg_answer", schema) }
    }
}

impl KindPrompts {
    /// Paragraph on a kind of task.
    pub fn of(&self, kind: TaskKind) -> &Prompt {
        match kind {
            TaskKind::PickAndPlace => &self.pick_and_place,
            TaskKind::Spatial => &self.spatial,
            TaskKind::Appearance => &self.appearance,
            TaskKind::CommonSense => &self.common_sense,
            TaskKind::LongHorizon => &self.long_horizon,
            TaskKind::Articulated => &self.articulated,
        }
    }
}

/// Name and text of a file in `prompts/`; a missing file is a compile error.
macro_rules! builtin {
    ($file:literal) => {
        ($file, include_str!(concat!("../prompts/", $file)))
    };
}
use builtin;

impl Prompt {
    fn parse(file: &str, content: &str, expected: &[&str]) -> Result<Self, PromptError> {
        let wrong = |message: &str| PromptError::Head { message: message.into(), file: file.into() };
        let content = content.replace("\r\n", "\n");
        let rest = content.strip_prefix("+++\n").ok_or_else(|| wrong("the first line is not `+++`"))?;
        let (head, text) = rest.split_once("\n+++\n").ok_or_else(|| wrong("the second `+++` is missing"))?;
        let head: PromptHead = toml::from_str(head).map_err(|error| wrong(error.message()))?;
        let prompt = Self { head, text: text.trim_end().to_owned() };
        if prompt.head.id.trim().is_empty() || prompt.head.version == 0 {
            return Err(wrong("`id` must be a name and `version` at least 1"));
        }
        if prompt.text.trim().is_empty() {
            return Err(wrong("the prompt text is empty"));
        }
        let sorted = |names: &[String]| {
            let mut names = names.to_vec();
            names.sort();
            names.dedup();
            names
        };
        let expected = sorted(&expected.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        let (declared, used) = (sorted(&prompt.head.inputs), sorted(&prompt.placeholders()));
        if declared != expected || used != expected {
            return Err(PromptError::Inputs { expected, declared, used, file: file.into() });
        }
        Ok(prompt)
    }

    fn placeholders(&self) -> Vec<String> {
        let pieces = self.text.split("{{").skip(1);
        pieces.filter_map(|piece| Some(piece.split_once("}}")?.0.to_owned())).collect()
    }

    /// Substitutes inputs in one pass, so that braces inside values are kept. [`Prompt::parse`] has checked that there
    /// are no other placeholders; they would be kept.
    fn render(&self, inputs: &[(&str, &str)]) -> String {
        let mut pieces = self.text.split("{{");
        let mut text = pieces.next().unwrap_or_default().to_owned();
        for piece in pieces {
            match piece
                .split_once("}}")
                .and_then(|(name, rest)| Some((inputs.iter().find(|(input, _)| *input == name)?.1, rest)))
            {
                Some((value, rest)) => text.extend([value, rest]),
                None => text.extend(["{{", piece]),
            }
        }
        text
    }

    fn stamp(&self) -> PromptStamp {
        let digest = Sha256::digest(self.text.as_bytes());
        PromptStamp { id: self.head.id.clone(), version: self.head.version, sha256: hexadecimal(&digest[..6]) }
    }
}

/// Object list for the prompt, one line each, followed by the surfaces.
fn object_list(request: &TaskRequest) -> String {
    let ids = request.ids();
    let line = |(card, id): (&ObjectCard, &ReferenceId)| {
        let yes = |value: bool| if value { "yes" } else { "no" };
        let states = if card.states.is_empty() { "none".to_owned() } else { card.states.join(", ") };
        let copy =
            if *id == card.uid.as_str() { String::new() } else { format!(" Another one just like {:?}.", card.uid) };
        format!(
            "- uid {:?}: {}. {} Can be picked up: {}. Holds things: {}. States: {states}.{copy}",
            id,
            card.name,
            card.description,
            yes(card.can_grasp && !card.is_articulated),
            yes(card.is_container),
        )
    };
    let surface = |surface: &NamedSurface| {
        format!(
            "- uid {:?}: {}. Fixed, beside the table. Only as obj2, with top or near; it has no node.",
            surface.id, surface.name
        )
    };
    let objects = request.offered.iter().zip(&ids).map(line);
    objects.chain(request.surfaces.iter().map(surface)).collect::<Vec<_>>().join("\n")
}

/// Replaces placeholder items of lists in a schema by the values they stand for.
fn filled(schema: &Value, lists: &[(&str, Vec<&str>)]) -> Value {
    match schema {
        Value::Array(items) => {
            let expand = |item: &Value| match lists.iter().find(|(name, _)| item.as_str() == Some(name)) {
                Some((_, values)) => values.iter().map(|value| Value::from(*value)).collect(),
                None => vec![filled(item, lists)],
            };
            items.iter().flat_map(expand).collect()
        }
        Value::Object(fields) => fields.iter().map(|(name, value)| (name.clone(), filled(value, lists))).collect(),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_and_inputs_are_checked() {
        let head = |inputs: &str| format!("+++\nid = \"x\"\nversion = 1\ninputs = {inputs}\n+++\n");
        let check = |content: String, part: &str| {
            let error = Prompt::parse("x.md", &content, &["a"]).unwrap_err().to_string();
            assert!(error.contains(part) && error.ends_with("x.md"), "{error}");
        };
        check("Hello {{a}}".into(), "the first line is not `+++`");
        check("+++\nid = 1".into(), "the second `+++` is missing");
        check("+++\nid = 1\n+++\n".into(), "invalid type");
        check(head("[\"a\"]") + "no placeholder", "[] are used");
        check(head("[]") + "{{a}}", "[] are declared");
        check(head("[\"a\", \"b\"]") + "{{a}} {{b}}", "expected the inputs [\"a\"]");
        let prompt = Prompt::parse("x.md", &(head("[\"a\"]") + "<{{a}}> {1} <{{a}}>\n\n"), &["a"]).unwrap();
        assert_eq!(prompt.render(&[("a", "{{a}}")]), "<{{a}}> {1} <{{a}}>");
    }

    #[test]
    fn a_folder_replaces_single_files() {
        let folder = tempfile::tempdir().unwrap();
        let text = "+++\nid = \"mine\"\nversion = 7\ninputs = [\"violations\"]\n+++\nMend {{violations}}!\n";
        std::fs::write(folder.path().join("repair.md"), text).unwrap();
        let (mine, builtin) = (PromptSet::load(Some(folder.path())).unwrap(), PromptSet::load(None).unwrap());
        assert_eq!(mine.repair.render(&[("violations", "x")]), "Mend x!");
        assert_eq!(mine.system, builtin.system);
        let stamp = |set: &PromptSet| set.stamps(TaskKind::Spatial)[3].clone();
        assert_eq!((stamp(&mine).version, stamp(&builtin).version), (7, 1));
        assert!(PromptSet::load(Some(&folder.path().join("none"))).is_err());
    }
}
