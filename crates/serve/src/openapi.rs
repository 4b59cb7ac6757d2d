//! The description of a service for programs, made from the types that are read and written.

use genmanip_agent::services::grasps::{GraspReply, GraspRequest};
use genmanip_agent::services::masks::{SegmentReply, SegmentRequest};
use schemars::{JsonSchema, schema_for};
use serde_json::{Value, json};

use crate::Offer;

/// An OpenAPI 3.1 document of what is offered.
pub fn openapi(offer: &Offer) -> Value {
    let operation = match offer {
        Offer::Segment(_) => operation::<SegmentRequest, SegmentReply>("Masks of the things in an image"),
        Offer::Grasp(_) => operation::<GraspRequest, GraspReply>("Grasps of a thing that is known by its points"),
    };
    let health = json!({"get": {
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
        "paths": {offer.path(): {"post": operation}, "/health": health}
    })
}

fn operation<Q: JsonSchema, A: JsonSchema>(summary: &str) -> Value {
    let failed = |description: &str| {
        json!({"description": description, "content": {"application/json": {"schema": {
            "type": "object",
            "properties": {"error": {"type": "object", "properties": {"message": {"type": "string"}}}}
        }}}})
    };
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
