//! Random baseline: a model that chooses marks at random, to measure the contribution of the agent's other components.

use genmanip_agent::ask::{Marks, ModelReply, Question, QuestionKind, ServiceError, VisionModel};
use genmanip_core::Seed;
use rand::RngExt;
use serde_json::json;

/// Height (m) of a path in the middle and at its ends, the same as the oracle's.
const CARRY_M: f64 = 0.28;
const END_M: f64 = 0.2;

/// Model that chooses a random mark of the image, by seed and question number, and answers *finished* at each check.
pub struct RandomMarks(pub Seed);

impl VisionModel for RandomMarks {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        let mut rng = self.0.fork("random marks").fork_index(question.ask as u64).rng();
        let mut below = |count: usize| if count == 0 { 0 } else { rng.random_range(0..count) };
        let chosen = match &question.marks {
            Marks::None => 0,
            Marks::Masks(masks) => below(masks.len()),
            Marks::Points(points) => below(points.len()),
            Marks::Grid { targets, .. } => below(targets.len()),
        };
        let cell = match &question.marks {
            Marks::Grid { targets, .. } => targets.keys().nth(chosen).map_or("none".to_owned(), ToString::to_string),
            _ => "none".to_owned(),
        };
        let number = match &question.marks {
            Marks::Masks(masks) if masks.is_empty() => -1,
            _ => chosen as i64 + 1,
        };
        let answer = match question.stage {
            QuestionKind::Decompose => json!({"subtasks": [question.instruction]}),
            QuestionKind::Object => json!({"number": number, "object_name": "any", "color": "any"}),
            QuestionKind::Part => json!({"number": number, "part_name": "any", "color": "any"}),
            QuestionKind::GrabPoint => json!({"selected_point": number, "reason": "any"}),
            QuestionKind::GridPath => {
                let step = |height_m: f64| json!({"grid_number": cell, "height_m": height_m, "claw_orientation": 0.0});
                json!({"path": [step(CARRY_M), step(END_M)]})
            }
            QuestionKind::PointToPoint => json!({"selected_point": {"type": "grid", "label": cell}}),
            QuestionKind::Check => json!({"scene_description": "any", "finished": true, "remaining": []}),
        };
        Ok(ModelReply { text: answer.to_string(), usage: None, cut_off: false })
    }
}
