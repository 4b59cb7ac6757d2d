//! Episode results of version 1, alone or inside episode records and evaluations.

use serde_json::{Map, Value, json};

use crate::{DocumentError, Upgrade};

/// Upgrade of a result of version 1 to version 2: the single failure becomes a list, and the termination reason follows
/// from its cause.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.result/1", upgrade: from_1 };

/// Upgrades the body of a result, alone or inside another document.
///
/// # Errors
/// If the failure is neither null nor an object with a known cause.
pub fn from_1(result: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let failure = result.shift_remove("failure").unwrap_or(Value::Null);
    let (ending, failures) = match &failure {
        Value::Null => (json!("finished"), json!([])),
        failure => (ending_of(failure)?, json!([failure])),
    };
    result.insert("ending".into(), ending);
    result.insert("failures".into(), failures);
    Ok(())
}

/// Upgrades the body of `genmanip.evaluation/1`, in which every episode was run and none had a reference path.
///
/// # Errors
/// As [`from_1`].
pub fn evaluation_from_1(evaluation: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let results = evaluation.get_mut("results").and_then(Value::as_array_mut).into_iter().flatten();
    results.filter_map(Value::as_object_mut).try_for_each(from_1)?;
    let label = evaluation.get("policy").cloned().unwrap_or_default();
    evaluation.insert("label".into(), label);
    evaluation.insert("cameras".into(), Value::Null);
    evaluation.insert("not_run".into(), json!([]));
    evaluation.entry("reference_paths_m").or_insert_with(|| json!({}));
    Ok(())
}

/// Termination reason from the single cause of version 1, in which causes reported by the policy took precedence; null
/// for a failed layout.
fn ending_of(failure: &Value) -> Result<Value, DocumentError> {
    match failure.get("cause").and_then(Value::as_str) {
        Some("layout") => Ok(Value::Null),
        Some("timeout") => Ok(json!("horizon")),
        Some("no_grasp" | "no_ik" | "no_goal_pose" | "planning" | "policy") => Ok(json!("gave_up")),
        Some("slipped" | "disturbed" | "goal_missed") => Ok(json!("finished")),
        other => Err(DocumentError::Invalid {
            path: "$.failure.cause".into(),
            message: format!("expected a cause of version 1, got {other:?}"),
        }),
    }
}
