//! The description of a service for programs, made from the types that are read and written.

use genmanip_agent::services::agent_request::ActRequest;
use genmanip_agent::services::grasps::{GraspReply, GraspRequest};
use genmanip_agent::services::masks::{SegmentReply, SegmentRequest};
use schemars::{JsonSchema, schema_for};
use serde_json::{Value, json};

use crate::Offer;
use crate::env::EnvRequest;
use crate::jobs::{JobView, MAX_ENDED, MAX_OPEN, MAX_WAIT_S};

/// An OpenAPI 3.1 document of what is offered.
pub fn openapi(offer: &Offer) -> Value {
    let path = offer.path();
    let mut paths = match offer {
        Offer::Segment(_) => {
            json!({path: {"post": operation::<SegmentRequest, SegmentReply>("Masks of the things in an image")}})
        }
        Offer::Grasp(_) => {
            json!({path: {"post": operation::<GraspRequest, GraspReply>("Grasps of a thing that is known by its points")}})
        }
        Offer::Agent(_) => jobs(path),
        Offer::Env(_) => json!({path: {"post": environment()}}),
    };
    paths["/health"] = json!({"get": {
        "summary": "What is offered",
        "responses": {"200": {"description": "The service is there", "content": {"application/json": {"schema": {
            "type": "object",
            "properties": {"service": {"type": "string"}, "version": {"type": "string"}},
            "required": ["service", "version"]
        }}}}}
    }});
    json!({
        "openapi": "3.1.0",
        "info": {"title": format!("genmanip serve {}", offer.name()), "version": env!("CARGO_PKG_VERSION")},
        "paths": paths
    })
}

/// A request of a session; `ask` says which, and its description what is answered.
fn environment() -> Value {
    let mut asked = operation::<EnvRequest, Value>("Drive an environment; requests and answers are MessagePack");
    for content in ["/requestBody/content", "/responses/200/content"] {
        if let Some(content) = asked.pointer_mut(content).and_then(Value::as_object_mut) {
            let json = content.shift_remove("application/json").unwrap_or_default();
            content.insert("application/msgpack".into(), json);
        }
    }
    asked
}

/// A question that begins a job, the job, and its pictures.
fn jobs(path: &str) -> Value {
    let mut begin = operation::<ActRequest, Value>("Plan one pick and one placement; nothing is moved");
    let responses = &mut begin["responses"];
    responses["202"] = json!({
        "description": "The job has begun; ask about it at `state_at`",
        "content": {"application/json": {"schema": {
            "type": "object",
            "properties": {"job": {"type": "string"}, "state_at": {"type": "string"}},
            "required": ["job", "state_at"]
        }}}
    });
    responses["503"] = failed(&format!("{MAX_OPEN} jobs are open"));
    for never in ["200", "422", "500"] {
        responses.as_object_mut().and_then(|responses| responses.shift_remove(never));
    }
    let text = |name: &str| json!({"name": name, "in": "path", "required": true, "schema": {"type": "string"}});
    let wait = json!({"name": "wait_s", "in": "query", "schema": {"type": "number", "minimum": 0, "maximum": MAX_WAIT_S},
        "description": "Answer when the job has ended, or after so many seconds"});
    let gone = failed(&format!("Never begun, or {MAX_ENDED} later jobs have ended"));
    json!({
        path: {"post": begin},
        format!("{path}/jobs/{{job}}"): {"get": {
            "summary": "How far a job is, and what came of it",
            "parameters": [text("job"), wait],
            "responses": {
                "200": {"description": "The job", "content": {"application/json": {"schema": schema_for!(JobView)}}},
                "400": failed("Not what is described here"),
                "404": gone.clone()
            }
        }},
        format!("{path}/jobs/{{job}}/pictures/{{name}}"): {"get": {
            "summary": "A picture that was shown to the model",
            "parameters": [text("job"), text("name")],
            "responses": {"200": {"description": "The picture", "content": {"image/png": {}}}, "404": gone}
        }}
    })
}

fn operation<Q: JsonSchema, A: JsonSchema>(summary: &str) -> Value {
    json!({
        "summary": summary,
        "requestBody": {"required": true, "content": {"application/json": {"schema": schema_for!(Q)}}},
        "responses": {
            "200": {"description": "The answer", "content": {"application/json": {"schema": schema_for!(A)}}},
            "400": failed("Not what is described here; the message names the place"),
            "413": {"description": "Larger than this server takes"},
            "422": failed("Nothing can be computed from it"),
            "500": failed("The computation failed")
        }
    })
}

fn failed(description: &str) -> Value {
    json!({"description": description, "content": {"application/json": {"schema": {
        "type": "object",
        "properties": {"error": {"type": "object", "properties": {"message": {"type": "string"}}}}
    }}}})
}
