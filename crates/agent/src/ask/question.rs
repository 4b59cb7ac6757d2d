//! What a model is asked.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::RgbdImage;
use genmanip_llm::{ChatRequest, Image, ImageError, Message, Part, ReplySchema};
use glam::DVec3;
use serde_json::{Map, Value, json};

use super::complaint::Refused;
use super::stage::{PromptStamp, Stage};
use crate::grid::{Cell, Grid};
use crate::picture::Picture;
use crate::segmentation::Mask;

/// One question, with everything that decides whether an answer fits.
#[derive(Clone, Debug)]
pub struct Question {
    /// What it is about.
    pub stage: Stage,
    /// Number of the ask in the episode, repeated asks included, from 0.
    pub ask: usize,
    /// The prompt that was filled in.
    pub prompt: PromptStamp,
    /// The words.
    pub text: String,
    /// The instruction of the stage: the whole task, or the sub-task.
    pub instruction: String,
    /// The pictures, in this order.
    pub pictures: Vec<Shown>,
    /// What is drawn on them.
    pub marks: Marks,
    /// The picture with its depth and its place in space; a model is not shown it.
    pub view: Arc<RgbdImage>,
    /// Whether the answer begins with its reasons.
    pub reasoning: bool,
    /// Answers that did not fit, with what was wrong with them.
    pub refused: Vec<Refused>,
}

/// Name of the field in which a model reasons.
pub(super) const REASONING: &str = "reasoning";
/// What is asked for where a model is to reason before it answers.
const REASON: &str = "\n\nPut one more field first into the JSON object: `reasoning`, a text of at most five sentences that \
                      says what you see and why you decide so. Decide only after it.";

/// A picture that is shown.
#[derive(Clone, Debug)]
pub struct Shown {
    /// What it is, e.g. `masks`.
    pub name: &'static str,
    /// The picture.
    pub picture: Arc<Picture>,
}

/// The marks that an answer may name.
#[derive(Clone, Debug)]
pub enum Marks {
    /// None: the answer is in words.
    None,
    /// Masks, numbered from 1 in this order.
    Masks(Arc<[Mask]>),
    /// Five points, numbered from 1 in this order, by the index of their pixels.
    Points(Vec<usize>),
    /// A grid, and where things come to stand that are put into its cells; in no other cell can anything be put.
    Grid {
        /// The cells.
        grid: Grid,
        /// The point, in the world, over which the middle of the moved thing will come to rest.
        targets: BTreeMap<Cell, DVec3>,
        /// The mask of what is moved.
        moved: Mask,
    },
}

impl Question {
    /// The question as a conversation.
    ///
    /// # Errors
    /// When a picture cannot be encoded.
    pub fn request(&self, model: &str, parameters: &Map<String, Value>) -> Result<ChatRequest, ImageError> {
        let unreadable = || ImageError { size_bytes: 0, beginning: String::new() };
        let words = if self.reasoning { format!("{}{REASON}", self.text) } else { self.text.clone() };
        let mut parts = vec![Part::Text(words)];
        for shown in &self.pictures {
            let bytes = shown.picture.png().map_err(|_| unreadable())?;
            parts.push(Part::Image(Image::new(bytes)?));
        }
        let mut messages = vec![Message::user_parts(parts)];
        for Refused { answer, complaint } in &self.refused {
            messages.push(Message::assistant(if answer.is_empty() { "(nothing)" } else { answer }));
            messages.push(Message::user(format!(
                "This answer cannot be used: {complaint}. Answer again with the JSON object alone."
            )));
        }
        let reply_schema = Some(ReplySchema { name: self.stage.name().into(), schema: self.schema() });
        Ok(ChatRequest { model: model.into(), messages, reply_schema, parameters: parameters.clone() })
    }

    /// JSON Schema of the answer.
    pub fn schema(&self) -> Value {
        let numbers = |count: usize, none: bool| -> Value {
            let first: Option<i64> = none.then_some(-1);
            json!({"type": "integer", "enum": first.into_iter().chain(1..=count as i64).collect::<Vec<_>>()})
        };
        let strict = |properties: Value| {
            let names: Vec<String> =
                properties.as_object().map(|fields| fields.keys().cloned().collect()).unwrap_or_default();
            json!({"type": "object", "properties": properties, "required": names, "additionalProperties": false})
        };
        // Of the answer itself, not of the objects in it.
        let object = |properties: Value| match (self.reasoning, properties) {
            (true, Value::Object(fields)) => {
                let first = [(REASONING.to_owned(), json!({"type": "string"}))];
                strict(Value::Object(first.into_iter().chain(fields).collect()))
            }
            (_, properties) => strict(properties),
        };
        let text = json!({"type": "string"});
        let count = match &self.marks {
            Marks::Masks(masks) => masks.len(),
            Marks::Points(points) => points.len(),
            Marks::None | Marks::Grid { .. } => 0,
        };
        match self.stage {
            Stage::Decompose => object(json!({"subtasks": {"type": "array", "items": text}})),
            Stage::Object => object(json!({"number": numbers(count, true), "object_name": text, "color": text})),
            Stage::Part => object(json!({"number": numbers(count, true), "part_name": text, "color": text})),
            Stage::GrabPoint => object(json!({"selected_point": numbers(count, false), "reason": text})),
            Stage::GridPath => {
                let number = json!({"type": "number"});
                let item = strict(json!({"grid_number": text, "height_m": number, "claw_orientation": number}));
                object(json!({"path": {"type": "array", "items": item}}))
            }
            Stage::PointToPoint => {
                let kind = json!({"type": "string", "enum": ["grid"]});
                object(json!({"selected_point": strict(json!({"type": kind, "label": text}))}))
            }
            Stage::Check => object(json!({
                "scene_description": text,
                "finished": {"type": "boolean"},
                "remaining": {"type": "array", "items": text},
            })),
        }
    }
}
