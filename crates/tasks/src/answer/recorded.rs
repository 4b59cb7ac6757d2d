//! Recorded answers: offered objects, response, and expected verdict.

use genmanip_core::{DocumentError, InstanceId, NamedSurface, ObjectCard, TaskKind, json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TaskRequest;

/// File with one answer of a language model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswer {
    /// Requested kind of task.
    pub task_type: TaskKind,
    /// Uids of the offered objects, one per instance: `001#2` or a second `001` is the second instance of `001`.
    pub objects: Vec<InstanceId>,
    /// Offered support surfaces of the world, other than the table.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Minimum number of objects in the scene graph of the answer.
    pub num_objects: usize,
    /// The response, verbatim.
    pub response: String,
    /// For tests: `valid`, or the name of the only kind of flaw, see [`FlawKind::name`](super::FlawKind::name); `None`
    /// outside tests.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expect: Option<String>,
    /// Remark for readers; not used by programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Reason why a recorded answer cannot be read or checked.
#[derive(Debug, thiserror::Error)]
pub enum RecordedAnswerError {
    /// The file is not a recorded answer.
    #[error("expected a recorded answer {{task_type, objects, num_objects, response}}, got: {0}")]
    Invalid(#[from] serde_json::Error),
    /// The file is not JSON.
    #[error(transparent)]
    NotJson(#[from] DocumentError),
    /// An offered uid is not in the catalogue.
    #[error("offered uid `{uid}` is not among the {known} objects of the catalogue")]
    UnknownOffer {
        /// The id whose asset is not in the catalogue.
        uid: InstanceId,
        /// Number of objects in the catalogue.
        known: usize,
    },
}

impl RecordedAnswerError {
    /// Likely cause of a JSON syntax error; `None` for other errors.
    pub fn hint(&self) -> Option<&'static str> {
        if let Self::NotJson(DocumentError::NotJson { hint, .. }) = self { Some(hint) } else { None }
    }
}

impl RecordedAnswer {
    /// Parses the text of a file.
    ///
    /// # Errors
    /// [`RecordedAnswerError::NotJson`] if the text is not JSON or repeats a key; [`RecordedAnswerError::Invalid`],
    /// with line and column, if it is not a recorded answer.
    pub fn from_json(text: &str) -> Result<Self, RecordedAnswerError> {
        // Parsed twice: only the second parser reports positions, and only the first detects duplicate keys.
        json::parse(text)?;
        Ok(serde_json::from_str(text)?)
    }

    /// Request to which the answer responds, with cards from a catalogue.
    ///
    /// # Errors
    /// [`RecordedAnswerError::UnknownOffer`] if an offered uid has no card.
    pub fn request(&self, id: &str, catalogue: &[ObjectCard]) -> Result<TaskRequest, RecordedAnswerError> {
        let card = |id: &InstanceId| {
            let uid = id.asset();
            catalogue
                .iter()
                .find(|card| card.uid == uid)
                .cloned()
                .ok_or_else(|| RecordedAnswerError::UnknownOffer { uid: id.clone(), known: catalogue.len() })
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
