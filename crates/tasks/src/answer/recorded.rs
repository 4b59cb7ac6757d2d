//! Recorded answers: what was offered, what came back, and what is to be made of it.

use genmanip_core::asset::uid_of;
use genmanip_core::{DocumentError, NamedSurface, ObjectCard, TaskKind, json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TaskRequest;

/// A file with one answer of a language model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswer {
    /// Kind of task that was asked for.
    pub task_type: TaskKind,
    /// Uids of the offered objects, one per instance: `001#2` or a second `001` is the second copy of `001`.
    pub objects: Vec<String>,
    /// Support surfaces of the world, other than the table, that were offered to put things on or near.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Smallest number of nodes.
    pub num_objects: usize,
    /// The text as it came.
    pub response: String,
    /// For tests: `valid`, or the one flaw in the answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expect: Option<String>,
    /// A remark for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Why a recorded answer cannot be read or checked.
#[derive(Debug, thiserror::Error)]
pub enum RecordedAnswerError {
    /// The file is no recorded answer.
    #[error("expected a recorded answer {{task_type, objects, num_objects, response}}, got: {0}")]
    Invalid(#[from] serde_json::Error),
    /// The file is no JSON.
    #[error(transparent)]
    NotJson(#[from] DocumentError),
    /// An offered uid is not in the catalogue.
    #[error("offered uid `{uid}` is not among the {known} objects of the catalogue")]
    UnknownOffer {
        /// The uid.
        uid: String,
        /// Size of the catalogue.
        known: usize,
    },
}

impl RecordedAnswerError {
    /// What most likely is wrong with a text that is no JSON.
    pub fn hint(&self) -> Option<&'static str> {
        if let Self::NotJson(DocumentError::NotJson { hint, .. }) = self { Some(hint) } else { None }
    }
}

impl RecordedAnswer {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`RecordedAnswerError::Invalid`] with line and column.
    pub fn from_json(text: &str) -> Result<Self, RecordedAnswerError> {
        // Twice, since only the second knows where a value stands, and only the first that a key stands twice.
        json::parse(text)?;
        Ok(serde_json::from_str(text)?)
    }

    /// The request the answer belongs to, with cards from a catalogue.
    ///
    /// # Errors
    /// [`RecordedAnswerError::UnknownOffer`] when an offered uid has no card.
    pub fn request(&self, id: &str, catalogue: &[ObjectCard]) -> Result<TaskRequest, RecordedAnswerError> {
        let card = |uid: &String| {
            catalogue
                .iter()
                .find(|card| card.uid == uid_of(uid))
                .cloned()
                .ok_or_else(|| RecordedAnswerError::UnknownOffer { uid: uid.clone(), known: catalogue.len() })
        };
        Ok(TaskRequest {
            id: id.into(),
            kind: self.task_type,
            offered: self.objects.iter().map(card).collect::<Result<_, _>>()?,
            surfaces: self.surfaces.clone(),
            min_objects: self.num_objects,
            between: false,
            source: format!("recorded answer {id}"),
        })
    }
}
