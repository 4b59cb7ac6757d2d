//! HTTP API for the questions of an agent in a folder, which a person answers in place of a model.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, Request as HttpRequest, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use genmanip_llm::{Answered, AnsweringError, FolderAnswers};
use genmanip_workspace::with_causes;
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::Refusal;
use super::requests::{body, work};
use super::studio::Studio;

/// Routes of this module.
pub fn routes() -> Router<Arc<Studio>> {
    Router::new()
        .route("/api/questions", get(list))
        .route("/api/questions/{name}", get(question))
        .route("/api/questions/{name}/images/{image}", get(image))
        .route("/api/questions/{name}/answer", post(answer))
}

type Shared = State<Arc<Studio>>;

async fn list(State(studio): Shared) -> Response {
    work(&studio, |studio| {
        let questions = folder(studio)?;
        Ok(Json(json!({ "folder": questions.folder(), "questions": questions.list()? })).into_response())
    })
    .await
}

async fn question(State(studio): Shared, Path(name): Path<String>) -> Response {
    work(&studio, move |studio| {
        let (question, answer) = folder(studio)?.question(&name)?;
        Ok(Json(json!({ "name": name, "question": question, "answer": answer })).into_response())
    })
    .await
}

async fn image(State(studio): Shared, Path((name, image)): Path<(String, String)>) -> Response {
    work(&studio, move |studio| {
        let bytes = folder(studio)?.image(&name, &image)?;
        let kind = if image.ends_with(".png") { "image/png" } else { "image/jpeg" };
        let head = [(CONTENT_TYPE, kind), (CACHE_CONTROL, "max-age=86400")];
        Ok((head, Body::from(bytes)).into_response())
    })
    .await
}

/// Answer of a person to a question, with the author.
#[derive(Deserialize)]
struct Said {
    answer: Value,
    #[serde(flatten)]
    about: Answered,
}

async fn answer(State(studio): Shared, Path(name): Path<String>, request: HttpRequest) -> Response {
    let Said { answer, about } = match body(request).await {
        Ok(said) => said,
        Err(refusal) => return refusal.into_response(),
    };
    work(&studio, move |studio| {
        let is_empty = answer.is_null() || answer.as_str().is_some_and(|words| words.trim().is_empty());
        if is_empty || about.duration_s.is_nan() || about.duration_s < 0.0 {
            return Err(Refusal::unsuited("expected an answer, and a duration of 0 s or more", ""));
        }
        folder(studio)?.answer(&name, &answer, &about)?;
        Ok(Json(json!({ "name": name })).into_response())
    })
    .await
}

fn folder(studio: &Studio) -> Result<&FolderAnswers, Refusal> {
    let message = "this studio has no questions; start it with --questions FOLDER";
    studio.questions.as_ref().ok_or_else(|| Refusal::Unknown { message: message.into() })
}

impl From<AnsweringError> for Refusal {
    fn from(error: AnsweringError) -> Self {
        let message = with_causes(&error);
        match error {
            AnsweringError::Unknown { .. } => Self::Unknown { message },
            AnsweringError::HasAnswer { name } => {
                Self::Conflict { conflict: json!({ "field": "answer", "name": name }) }
            }
            AnsweringError::Damaged { .. } => Self::unsuited(message, ""),
            AnsweringError::File { .. } => Self::unsuited(message, "check the folder of --questions"),
        }
    }
}
