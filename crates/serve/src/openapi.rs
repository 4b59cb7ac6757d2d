//! OpenAPI description of a service, generated from its request and response types.

use genmanip_agent::services::agent_request::ActRequest;
use genmanip_agent::services::grasps::{GraspReply, GraspRequest};
use genmanip_agent::services::masks::{SegmentReply, SegmentRequest};
use schemars::{JsonSchema, schema_for};
use serde_json::{Value, json};

use crate::Endpoint;
use crate::env::EnvRequest;
use crate::jobs::{JobView, MAX_ENDED, MAX_OPEN, MAX_WAIT_S};

/// OpenAPI 3.1 document of an endpoint.
pub fn openapi(endpoint: &Endpoint) -> Value {
    let path = endpoint.path();
    let mut paths = match endpoint {
        Endpoint::Segment(_) => {
            json!({path: {"post": operation::<SegmentRequest, SegmentReply>("Masks of the objects in an image")}})
        }
        Endpoint::Grasp(_) => {
            json!({path: {"post": operation::<GraspRequest, GraspReply>("Grasps of an object given by its points")}})
        }
        Endpoint::Agent(_) => jobs(path),
        Endpoint::Env(_) => json!({path: {"post": environment()}}),
    };
    paths["/health"] = json!({"get": {
        "summary": "Service name and version",
        "responses": {"200": {"description": "The service is running", "content": {"application/json": {"schema": {
            "type": "object",
            "properties": {"service": {"type": "string"}, "version": {"type": "string"}},
            "required": ["service", "version"]
        }}}}}
    }});
    json!({
        "openapi": "3.1.0",
        "info": {"title": format!("genmanip serve {}", endpoint.name()), "version": env!("CARGO_PKG_VERSION")},
        "paths": paths
    })
}

/// Operation of the environment service. `ask` selects the request, whose description in [`EnvRequest`] lists the
/// response.
fn environment() -> Value {
    let mut asked = operation::<EnvRequest, Value>("Control an environment; requests and responses are MessagePack");
    for content in ["/requestBody/content", "/responses/200/content"] {
        if let Some(content) = asked.pointer_mut(content).and_then(Value::as_object_mut) {
            let json = content.shift_remove("application/json").unwrap_or_default();
            content.insert("application/msgpack".into(), json);
        }
    }
    asked
}

/// Operations to start a job, to poll it, and to fetch its images.
fn jobs(path: &str) -> Value {
    let mut begin = operation::<ActRequest, Value>("Plan one pick and one placement without executing them");
    let responses = &mut begin["responses"];
    responses["202"] = json!({
        "description": "The job has started; poll it at `state_at`",
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
        "description": "Respond when the job has ended, or after this many seconds"});
    let gone = failed(&format!("Unknown job, or {MAX_ENDED} later jobs have ended"));
    json!({
        path: {"post": begin},
        format!("{path}/jobs/{{job}}"): {"get": {
            "summary": "State and result of a job",
            "parameters": [text("job"), wait],
            "responses": {
                "200": {"description": "The job", "content": {"application/json": {"schema": schema_for!(JobView)}}},
                "400": failed("Invalid request"),
                "404": gone.clone()
            }
        }},
        format!("{path}/jobs/{{job}}/pictures/{{name}}"): {"get": {
            "summary": "An image that was shown to the model",
            "parameters": [text("job"), text("name")],
            "responses": {"200": {"description": "The image", "content": {"image/png": {}}}, "404": gone}
        }}
    })
}

fn operation<Q: JsonSchema, A: JsonSchema>(summary: &str) -> Value {
    json!({
        "summary": summary,
        "requestBody": {"required": true, "content": {"application/json": {"schema": schema_for!(Q)}}},
        "responses": {
            "200": {"description": "The response", "content": {"application/json": {"schema": schema_for!(A)}}},
            "400": failed("Invalid request; the message names the location"),
            "413": {"description": "The request exceeds the size limit"},
            "422": failed("The request cannot be processed"),
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
