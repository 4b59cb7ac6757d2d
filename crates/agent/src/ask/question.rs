//! Questions to a vision-language model.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::RgbdImage;
use genmanip_llm::{ChatRequest, Image, ImageError, Message, Part, ReplySchema};
use glam::DVec3;
use serde_json::{Map, Value, json};

use super::question_kind::{PromptStamp, QuestionKind};
use super::rejection::RejectedAnswer;
use crate::grid::{Cell, Grid};
use crate::image::RgbImage;
use crate::segmentation::Mask;

/// One question with everything needed to validate its answer.
#[derive(Clone, Debug)]
pub struct Question {
    /// Kind of question.
    pub stage: QuestionKind,
    /// Index of the ask in the episode, retries included, from 0.
    pub ask: usize,
    /// Identity of the prompt that the text was made from.
    pub prompt: PromptStamp,
    /// Text of the question, as sent to the model.
    pub text: String,
    /// Instruction: the whole task, or the sub-task.
    pub instruction: String,
    /// Images sent with the question, in this order.
    pub pictures: Vec<QuestionImage>,
    /// Marks drawn on the images.
    pub marks: Marks,
    /// RGB-D image of the view; not sent to the model.
    pub view: Arc<RgbdImage>,
    /// True to ask for reasoning before the answer.
    pub reasoning: bool,
    /// Rejected answers to this question so far.
    pub refused: Vec<RejectedAnswer>,
}

/// JSON field of the model's reasoning.
pub(super) const REASONING: &str = "reasoning";
/// Instruction appended to the prompt when reasoning is requested.
const REASON: &str = "\n\nPut one more field first into the JSON object: `reasoning`, a text of at most five sentences that \
                      says what you see and why you decide so. Decide only after it.";

/// An image sent with a question.
#[derive(Clone, Debug)]
pub struct QuestionImage {
    /// Name of the image, e.g. `masks`.
    pub name: &'static str,
    /// Pixels of the image.
    pub picture: Arc<RgbImage>,
}

/// The marks that an answer may name.
#[derive(Clone, Debug)]
pub enum Marks {
    /// No marks: the answer is in words.
    None,
    /// Masks, numbered from 1 in this order.
    Masks(Arc<[Mask]>),
    /// Points, numbered from 1 in this order, by pixel index.
    Points(Vec<usize>),
    /// A grid and the placement targets of its cells; cells without a target cannot receive the object.
    Grid {
        /// Grid drawn on the image.
        grid: Grid,
        /// Rest position of the object's footprint centre per cell, world frame.
        targets: BTreeMap<Cell, DVec3>,
        /// Mask of the moved object.
        moved: Mask,
        /// True if the answer also states the yaw change of the object.
        turns: bool,
    },
}

impl Question {
    /// Builds the chat request.
    ///
    /// # Errors
    /// Fails if an image cannot be encoded.
    pub fn request(&self, model: &str, parameters: &Map<String, Value>) -> Result<ChatRequest, ImageError> {
        let unreadable = || ImageError { size_bytes: 0, beginning: String::new() };
        let words = if self.reasoning { format!("{}{REASON}", self.text) } else { self.text.clone() };
        let mut parts = vec![Part::Text(words)];
        for shown in &self.pictures {
            let bytes = shown.picture.png().map_err(|_| unreadable())?;
            parts.push(Part::Image(Image::new(bytes)?));
        }
        let mut messages = vec![Message::user_parts(parts)];
        for RejectedAnswer { answer, rejection } in &self.refused {
            messages.push(Message::assistant(if answer.is_empty() { "(nothing)" } else { answer }));
            messages.push(Message::user(format!(
                "This answer cannot be used: {rejection}. Answer again with the JSON object alone."
            )));
        }
        let reply_schema = Some(ReplySchema::new(self.stage.name(), self.schema()));
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
        // The schema of the answer itself, not of nested objects.
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
            QuestionKind::Decompose => object(json!({"subtasks": {"type": "array", "items": text}})),
            QuestionKind::Object => object(json!({"number": numbers(count, true), "object_name": text, "color": text})),
            QuestionKind::Part => object(json!({"number": numbers(count, true), "part_name": text, "color": text})),
            QuestionKind::GrabPoint => object(json!({"selected_point": numbers(count, false), "reason": text})),
            QuestionKind::GridPath => {
                let number = json!({"type": "number"});
                let item = strict(json!({"grid_number": text, "height_m": number, "claw_orientation": number}));
                object(json!({"path": {"type": "array", "items": item}}))
            }
            QuestionKind::PointToPoint => {
                let kind = json!({"type": "string", "enum": ["grid"]});
                let point = strict(json!({"type": kind, "label": text}));
                match self.marks {
                    Marks::Grid { turns: true, .. } => {
                        object(json!({"selected_point": point, "turn_deg": {"type": "number"}}))
                    }
                    _ => object(json!({"selected_point": point})),
                }
            }
            QuestionKind::Check => object(json!({
                "scene_description": text,
                "finished": {"type": "boolean"},
                "remaining": {"type": "array", "items": text},
            })),
        }
    }
}
