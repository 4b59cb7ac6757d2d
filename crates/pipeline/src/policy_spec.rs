//! Contract of a policy in another language, read from JSON; every mistake is reported with its key and remedy.

use genmanip_core::names::near_misses;
use genmanip_core::{ActionSpec, CameraRequest, GripperSpec, ImageChannels, Observation, PolicySpec, RotationEncoding};
use genmanip_data::export::choice::ACTIONS;
use genmanip_rollout::Stage;
use genmanip_workspace::WorkspaceError;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

const KEYS: [&str; 7] = ["rate_hz", "action", "cameras", "execute_steps", "privileged", "state_keys", "name"];
const ACTION_KEYS: [&str; 6] = ["space", "delta_from", "frame", "rotation", "gripper", "between"];
const GRIPPER_KEYS: [&str; 2] = ["encoding", "binary_threshold"];
const CAMERA_KEYS: [&str; 3] = ["name", "size", "channels"];
const CHANNELS: [&str; 5] = ["rgb", "depth", "points", "normals", "ids"];
/// Maximum number of actions of a chunk, and of pixels of an image side.
const MAX_COUNT: u64 = 100_000;
/// Maximum length of a wrong value quoted in a message, characters.
const SHOWN: usize = 60;

/// Policy contract given by a program in another language; absent keys are those of native actions at 15 Hz.
///
/// # Errors
/// All mistakes, one per line, each with the key and the expected value.
pub fn read_spec(name: &str, given: &Value) -> Result<PolicySpec, String> {
    let mut spec = PolicySpec::native(name, 15.0);
    let mut mistakes = Mistakes::default();
    let Some(given) = mistakes.object("spec", given, &KEYS, "{\"rate_hz\": 15}") else {
        return Err(mistakes.0.join("\n"));
    };
    for (key, value) in given {
        let wrong = match key.as_str() {
            "rate_hz" => rate(value).map(|rate_hz| spec.rate_hz = rate_hz),
            "execute_steps" => count("execute_steps", value, 0).map(|steps| spec.execute_steps = steps as usize),
            "privileged" => flag("privileged", value).map(|privileged| spec.privileged = privileged),
            "action" => {
                spec.action = mistakes.action(value).unwrap_or(spec.action);
                Ok(())
            }
            "cameras" => {
                spec.cameras = mistakes.cameras(value);
                Ok(())
            }
            "state_keys" if *value == serde_json::json!([Observation::STATE]) => Ok(()),
            "state_keys" => Err(expected("state_keys", &format!("[\"{}\"]", Observation::STATE), value)),
            _ => Ok(()),
        };
        mistakes.0.extend(wrong.err());
    }
    mistakes.0.extend(spec.action.check().err().map(|error| format!("`action`: {error}")));
    if mistakes.0.is_empty() { Ok(spec) } else { Err(mistakes.0.join("\n")) }
}

/// Checks that actions for a robot suit a stage.
///
/// # Errors
/// If the stage has another robot.
pub(crate) fn check_robot(robot: &str, stage: &Stage) -> Result<(), WorkspaceError> {
    if robot == stage.robot.name {
        return Ok(());
    }
    Err(WorkspaceError::input(format!("the policy has actions of robot `{robot}`"))
        .with_hint(format!("scenario {} has robot `{}`", stage.scenario.id, stage.robot.name)))
}

/// Error for a mistake of a policy; the text may end with a line that starts with `hint:`.
pub fn mistaken(policy: &str, mistake: &str) -> WorkspaceError {
    let (what, hint) = mistake.split_once("\nhint: ").unwrap_or((mistake, SPEC_HELP));
    WorkspaceError::Mistaken { policy: policy.into(), what: what.into(), hint: hint.into() }
}

/// Hint that names the documentation of the policy interface.
const SPEC_HELP: &str = "docs/guides/evaluate.md lists all keys of the spec, and what reset and act get and return";

#[derive(Default)]
struct Mistakes(Vec<String>);

impl Mistakes {
    /// The object, if the value is one without unknown keys; otherwise a mistake is added.
    fn object<'a>(&mut self, at: &str, value: &'a Value, known: &[&str], such: &str) -> Option<&'a Map<String, Value>> {
        let Value::Object(object) = value else {
            self.0.push(expected(at, &format!("a dictionary such as {such}"), value));
            return None;
        };
        for key in object.keys().filter(|key| !known.contains(&key.as_str())) {
            let near: String = near_misses(key, known).iter().map(|name| format!("did you mean `{name}`? ")).collect();
            self.0.push(format!("`{at}` has no key `{key}`; {near}its keys are {}", known.join(", ")));
        }
        Some(object)
    }

    fn action(&mut self, value: &Value) -> Option<ActionSpec> {
        let names = ACTIONS.map(|(name, _)| name).join(", ");
        if let Value::String(text) = value {
            let Some((_, space)) = ACTIONS.iter().find(|(name, _)| name == text) else {
                let such = format!("one of {names}, or a dictionary such as {{\"space\": \"ee_delta\", …}}");
                self.0.push(expected("action", &such, value));
                return None;
            };
            let rotation = RotationEncoding::AxisAngle;
            return Some(ActionSpec { rotation, ..ActionSpec::new(*space, genmanip_core::GripperEncoding::WidthM) });
        }
        let such = "{\"space\": \"ee_delta\", \"rotation\": \"axis_angle\", \"gripper\": {\"encoding\": \"width_m\"}}";
        let object = self.object("action", value, &ACTION_KEYS, &format!("{such}, or one of {names}"))?;
        let space = self.required("action.space", object, "space", "\"ee_delta\"");
        let gripper = match object.get("gripper") {
            Some(value) => self.gripper(value),
            None => {
                self.0.push("`action.gripper` is missing: expected e.g. {\"encoding\": \"width_m\"}".into());
                None
            }
        };
        let native = ActionSpec::native();
        Some(ActionSpec {
            space: space.unwrap_or(native.space),
            gripper: gripper.unwrap_or(native.gripper),
            delta_from: self.optional("action.delta_from", object, "delta_from"),
            frame: self.optional("action.frame", object, "frame"),
            rotation: self.optional("action.rotation", object, "rotation"),
            between: self.optional("action.between", object, "between"),
        })
    }

    fn gripper(&mut self, value: &Value) -> Option<GripperSpec> {
        if value.is_string() {
            let encoding = variant("action.gripper", value).map_err(|wrong| self.0.push(wrong)).ok()?;
            return Some(GripperSpec { encoding, binary_threshold: None });
        }
        let such = "{\"encoding\": \"width_m\"}";
        let object = self.object("action.gripper", value, &GRIPPER_KEYS, such)?;
        let encoding = self.required("action.gripper.encoding", object, "encoding", "\"width_m\"")?;
        let binary_threshold = match object.get("binary_threshold") {
            None | Some(Value::Null) => None,
            Some(Value::Number(number)) => number.as_f64(),
            Some(other) => {
                self.0.push(expected("action.gripper.binary_threshold", "a number", other));
                None
            }
        };
        Some(GripperSpec { encoding, binary_threshold })
    }

    fn cameras(&mut self, value: &Value) -> Vec<CameraRequest> {
        let Value::Array(list) = value else {
            let such = "a list such as [{\"name\": \"wrist\", \"size\": [128, 128], \"channels\": {\"depth\": true}}]";
            self.0.push(expected("cameras", such, value));
            return Vec::new();
        };
        let mut requests: Vec<CameraRequest> = Vec::new();
        for (number, value) in list.iter().enumerate() {
            let Some(request) = self.camera(&format!("cameras[{number}]"), value) else { continue };
            if requests.iter().any(|other| other.name == request.name) {
                self.0.push(format!("`cameras[{number}]`: camera `{}` is requested twice", request.name));
            }
            requests.push(request);
        }
        requests
    }

    fn camera(&mut self, at: &str, value: &Value) -> Option<CameraRequest> {
        if let Value::String(name) = value {
            return Some(CameraRequest::new(name, ImageChannels::default()));
        }
        let object = self.object(at, value, &CAMERA_KEYS, "{\"name\": \"wrist\", \"size\": [128, 128]}")?;
        let Some(Value::String(name)) = object.get("name") else {
            self.0.push(format!("`{at}.name` is missing: expected the name of a camera, such as \"static\""));
            return None;
        };
        let channels = object.get("channels").map_or_else(ImageChannels::default, |value| self.channels(at, value));
        let size = match object.get("size") {
            None | Some(Value::Null) => None,
            Some(value) => size(at, value).map_err(|wrong| self.0.push(wrong)).ok(),
        };
        Some(CameraRequest { size, ..CameraRequest::new(name, channels) })
    }

    fn channels(&mut self, at: &str, value: &Value) -> ImageChannels {
        let at = format!("{at}.channels");
        let such = "{\"rgb\": true, \"depth\": true}";
        let named: Map<String, Value> = match value {
            Value::Array(list) if list.iter().all(Value::is_string) => {
                let names = list.iter().filter_map(Value::as_str);
                let off = ("rgb".to_owned(), Value::Bool(false));
                std::iter::once(off).chain(names.map(|name| (name.to_owned(), Value::Bool(true)))).collect()
            }
            Value::Object(object) => object.clone(),
            other => {
                self.0.push(expected(&at, &format!("a dictionary such as {such}, or a list of names"), other));
                return ImageChannels::default();
            }
        };
        self.object(&at, &Value::Object(named.clone()), &CHANNELS, such);
        let mut on = |name: &str| match named.get(name) {
            None => name == "rgb",
            Some(value) => flag(&format!("{at}.{name}"), value).map_err(|wrong| self.0.push(wrong)).unwrap_or_default(),
        };
        ImageChannels {
            rgb: on("rgb"),
            depth: on("depth"),
            points: on("points"),
            normals: on("normals"),
            ids: on("ids"),
        }
    }

    fn required<T: DeserializeOwned>(
        &mut self,
        at: &str,
        object: &Map<String, Value>,
        key: &str,
        such: &str,
    ) -> Option<T> {
        let found = object
            .get(key)
            .map_or_else(|| Err(format!("`{at}` is missing: expected e.g. {such}")), |value| variant(at, value));
        found.map_err(|wrong| self.0.push(wrong)).ok()
    }

    fn optional<T: DeserializeOwned + Default>(&mut self, at: &str, object: &Map<String, Value>, key: &str) -> T {
        let found = object.get(key).map_or_else(|| Ok(T::default()), |value| variant(at, value));
        found.map_err(|wrong| self.0.push(wrong)).unwrap_or_default()
    }
}

/// Value of an enum from the name of a variant.
fn variant<T: DeserializeOwned>(at: &str, value: &Value) -> Result<T, String> {
    match value {
        Value::String(_) => serde_json::from_value(value.clone()).map_err(|error| format!("`{at}`: {error}")),
        other => Err(expected(at, "a text", other)),
    }
}

fn rate(value: &Value) -> Result<f64, String> {
    let rate_hz = value.as_f64().filter(|rate_hz| *rate_hz > 0.0);
    rate_hz.ok_or_else(|| expected("rate_hz", "actions per second, such as 10, 15, 20, 30 or 60", value))
}

fn count(at: &str, value: &Value, least: u64) -> Result<u64, String> {
    let count = value.as_u64().filter(|count| (least..=MAX_COUNT).contains(count));
    count.ok_or_else(|| expected(at, &format!("a whole number from {least}"), value))
}

fn flag(at: &str, value: &Value) -> Result<bool, String> {
    value.as_bool().ok_or_else(|| expected(at, "true or false", value))
}

fn size(at: &str, value: &Value) -> Result<[u32; 2], String> {
    let side = |value: &Value| count("size", value, 1).ok().and_then(|side| u32::try_from(side).ok());
    match value.as_array().map(Vec::as_slice) {
        Some([width, height]) => side(width).zip(side(height)).map(|(width, height)| [width, height]),
        _ => None,
    }
    .ok_or_else(|| expected(&format!("{at}.size"), "[width, height] in pixels", value))
}

fn expected(at: &str, such: &str, got: &Value) -> String {
    let got = got.to_string();
    let shown: String = got.chars().take(SHOWN).collect();
    format!("`{at}`: expected {such}; got {shown}{}", if shown.len() < got.len() { "…" } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn short_forms_and_defaults_are_read() {
        let given = json!({"rate_hz": 20, "action": "ee_delta", "cameras": ["static", {"name": "wrist", "channels": ["depth"]}]});
        let spec = read_spec("mine", &given).unwrap();
        assert_eq!(
            (spec.name.as_str(), spec.rate_hz, spec.action.rotation),
            ("mine", 20.0, RotationEncoding::AxisAngle)
        );
        assert_eq!(spec.cameras[0], CameraRequest::new("static", ImageChannels::RGB));
        let depth = ImageChannels { rgb: false, depth: true, ..ImageChannels::default() };
        assert_eq!(spec.cameras[1], CameraRequest::new("wrist", depth));
        assert_eq!(read_spec("mine", &json!({})).unwrap(), PolicySpec::native("mine", 15.0));
        let full = serde_json::to_value(&spec).unwrap();
        assert_eq!(read_spec("mine", &full).unwrap(), spec, "what is written is read");
    }

    #[test]
    fn mistakes_are_named_with_what_is_expected() {
        let gripper = json!({"encoding": "width_m"});
        let cases = [
            (json!([1]), "`spec`: expected a dictionary such as {\"rate_hz\": 15}; got [1]"),
            (json!({"rate": 15}), "`spec` has no key `rate`; did you mean `rate_hz`?"),
            (json!({"rate_hz": 0}), "`rate_hz`: expected actions per second, such as 10, 15"),
            (json!({"rate_hz": "fast"}), "got \"fast\""),
            (json!({"execute_steps": -1}), "`execute_steps`: expected a whole number from 0; got -1"),
            (json!({"privileged": "yes"}), "`privileged`: expected true or false"),
            (json!({"action": "wheels"}), "`action`: expected one of joint, joint_degrees, joint_delta"),
            (json!({"action": {"space": "ee_delta"}}), "`action.gripper` is missing"),
            (json!({"action": {"gripper": gripper}}), "`action.space` is missing"),
            (json!({"action": {"space": "wheels", "gripper": gripper}}), "`action.space`: unknown variant `wheels`"),
            (json!({"action": {"space": 3, "gripper": gripper}}), "`action.space`: expected a text; got 3"),
            (
                json!({"action": {"space": "ee_delta", "gripper": gripper, "rotations": "6d"}}),
                "did you mean `rotation`",
            ),
            (json!({"action": {"space": "ee_pose", "frame": "end_effector", "gripper": gripper}}), "world for ee_pose"),
            (json!({"cameras": "wrist"}), "`cameras`: expected a list such as"),
            (json!({"cameras": [{"name": "wrist", "depth": true}]}), "`cameras[0]` has no key `depth`"),
            (json!({"cameras": [{"name": "wrist", "channels": ["colour"]}]}), "has no key `colour`; its keys are rgb"),
            (json!({"cameras": [{"name": "wrist", "size": 128}]}), "`cameras[0].size`: expected [width, height]"),
            (json!({"cameras": [{"size": [64, 64]}]}), "`cameras[0].name` is missing"),
            (json!({"cameras": ["wrist", "wrist"]}), "camera `wrist` is requested twice"),
            (json!({"state_keys": ["force"]}), "`state_keys`: expected [\"observation.state\"]"),
        ];
        for (given, wanted) in cases {
            let mistakes = read_spec("mine", &given).unwrap_err();
            assert!(mistakes.contains(wanted) && !mistakes.contains("struct"), "{given}: {mistakes}");
        }
        let two = read_spec("mine", &json!({"rate_hz": -7, "cameras": "wrist"})).unwrap_err();
        assert_eq!(two.lines().count(), 2, "{two}");
    }
}
