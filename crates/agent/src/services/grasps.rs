//! Grasps for an object given by its points: built-in sampler or a server.

use std::sync::Arc;

use genmanip_core::grasp::GraspNetGrasp;
use genmanip_core::{Grasp, Pose};
use genmanip_llm::Service;
use genmanip_motion::{CloudTarget, Planner};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{read, transport_error};

/// Maximum number of grasps in an answer. Bounds the time for invalid answers.
const MAX_GRASPS: usize = 10_000;
/// Maximum distance of a grasp from the camera (m); larger numbers are probably millimetres.
const MAX_DISTANCE_M: f64 = 10.0;
/// Maximum plausible gripper opening (m). Larger numbers are probably millimetres.
const MAX_WIDTH_M: f64 = 0.5;

/// Grasp request: the target object and its surroundings, world frame.
#[derive(Clone, Copy, Debug)]
pub struct GraspQuestion<'a> {
    /// Points on the target.
    pub points: &'a [DVec3],
    /// Points of everything else that the cameras see.
    pub scene: &'a [DVec3],
    /// Pose of the camera that saw most of the target; axes x right, y down, z forward.
    pub world_from_camera: Pose,
    /// Positions of all cameras that saw the target, `world_from_camera` included.
    pub camera_positions: &'a [DVec3],
    /// Height of the target's support, world z (m).
    pub table_height: f64,
}

/// A source of grasp candidates. Calls block and may come from several threads at once.
pub trait GraspSource: Send + Sync {
    /// Grasps in the world frame, best first.
    ///
    /// # Errors
    /// Reports an error; finding no grasp that fits the gripper is not an error.
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError>;
}

/// Reason why a source gives no grasps.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GraspError {
    /// The points are unsuitable, for the given reason.
    #[error("{0}")]
    Unsuited(String),
    /// The service did not answer, or its answer is invalid.
    #[error("the grasp service: {0}")]
    Service(String),
}

/// Built-in sampler: [`Planner::cloud_grasps`].
#[derive(Clone, Debug)]
pub struct SampledGrasps {
    planner: Arc<Planner>,
}

impl SampledGrasps {
    /// Uses the gripper and the settings of a planner.
    pub fn new(planner: Arc<Planner>) -> Self {
        Self { planner }
    }
}

impl GraspSource for SampledGrasps {
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError> {
        let target = CloudTarget {
            points: question.points,
            cameras: question.camera_positions,
            scene: question.scene,
            table_height: question.table_height,
        };
        let found = self.planner.cloud_grasps(&target).map_err(|error| GraspError::Unsuited(error.to_string()))?;
        Ok(found.into_iter().map(|found| found.grasp).collect())
    }
}

/// Request body. Points are in the camera frame (m).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GraspRequest {
    /// Points on the target.
    pub points: Vec<[f32; 3]>,
    /// Points of everything else.
    #[serde(default)]
    pub scene: Vec<[f32; 3]>,
    /// Camera pose; the world's z is up.
    pub world_from_camera: Pose,
    /// Height of the target's support, world z (m).
    pub table_height: f64,
}

/// Response body; additional fields are ignored. A bare list is accepted too, and so are lists named `grasp_groups`, of
/// rows or of objects with `translation`, `rotation_matrix`, `score` and optional `width`, `height` and `depth`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GraspReply {
    /// Rows of 17 numbers in GraspNet's format, in the camera frame; see [`GraspNetGrasp`].
    pub grasps: Vec<[f64; 17]>,
}

impl GraspRequest {
    /// Request body of a question, with points in the camera frame.
    pub fn of(question: &GraspQuestion) -> Self {
        let camera_from_world = question.world_from_camera.inverse();
        let seen = |points: &[DVec3]| {
            points.iter().map(|point| camera_from_world.transform_point(*point).as_vec3().to_array()).collect()
        };
        Self {
            points: seen(question.points),
            scene: seen(question.scene),
            world_from_camera: question.world_from_camera,
            table_height: question.table_height,
        }
    }

    /// Decodes the points of target and surroundings, world frame.
    ///
    /// # Errors
    /// If a number is not finite.
    pub fn read(&self) -> Result<[Vec<DVec3>; 2], String> {
        let Pose { position, rotation } = self.world_from_camera;
        let is_pose = position.is_finite() && rotation.is_finite() && (rotation.length() - 1.0).abs() < 1e-3;
        if !is_pose || !self.table_height.is_finite() {
            return Err("world_from_camera is no finite pose, or table_height is not finite".into());
        }
        let world = |points: &[[f32; 3]]| -> Vec<DVec3> {
            let point = |[x, y, z]: [f32; 3]| DVec3::new(f64::from(x), f64::from(y), f64::from(z));
            points.iter().map(|numbers| self.world_from_camera.transform_point(point(*numbers))).collect()
        };
        Ok([world(&self.points), world(&self.scene)])
    }
}

impl GraspReply {
    /// Builds the response in the camera frame.
    pub fn of(grasps: &[Grasp], world_from_camera: &Pose) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let row = |grasp: &Grasp| {
            let grasp = Grasp { pose: camera_from_world * grasp.pose, ..grasp.clone() };
            // The built-in sampler provides neither finger height nor depth.
            GraspNetGrasp { grasp, height_m: 0.02, depth_m: 0.0, object_id: -1 }.to_graspnet()
        };
        Self { grasps: grasps.iter().map(row).collect() }
    }
}

/// [`GraspSource`] that requests grasps from a service.
#[derive(Clone, Debug)]
pub struct ServiceGrasps<S> {
    service: S,
}

impl<S: Service> ServiceGrasps<S> {
    /// Source that sends its requests to `service`.
    pub fn new(service: S) -> Self {
        Self { service }
    }
}

impl<S: Service> GraspSource for ServiceGrasps<S> {
    fn grasps(&self, question: &GraspQuestion) -> Result<Vec<Grasp>, GraspError> {
        let asked = serde_json::to_value(GraspRequest::of(question))
            .map_err(|error| GraspError::Service(format!("the question cannot be written: {error}")))?;
        let answer = self.service.ask(&asked).map_err(|error| GraspError::Service(transport_error(&error)))?;
        let reply: GraspReply = normalised(answer).and_then(read).map_err(GraspError::Service)?;
        grasps_of(&reply, &question.world_from_camera).map_err(GraspError::Service)
    }
}

/// A grasp as GenManip's and AnyGrasp's servers write it, camera frame; axes of the rotation as in [`GraspNetGrasp`].
#[derive(Deserialize)]
struct GraspWire {
    translation: [f64; 3],
    #[serde(alias = "rotation")]
    rotation_matrix: [[f64; 3]; 3],
    #[serde(default = "unknown_score")]
    score: f64,
    #[serde(default = "unknown_width")]
    width: f64,
    #[serde(default)]
    height: f64,
    /// Distance from the translation to the fingertips along the approach (m); 0 if missing.
    #[serde(default)]
    depth: f64,
}

/// Score of a grasp whose answer gives none: the same for all, so that their order in the answer decides.
fn unknown_score() -> f64 {
    0.0
}

/// Opening of a grasp whose answer gives none (m): that of a common gripper.
fn unknown_width() -> f64 {
    0.08
}

/// Converts an answer in any accepted form to the JSON of [`GraspReply`].
fn normalised(answer: Value) -> Result<Value, String> {
    let mut answer = if answer.is_array() { json!({"grasps": answer}) } else { answer };
    if let (None, Some(groups)) = (answer.get("grasps"), answer.get("grasp_groups").cloned()) {
        answer = json!({"grasps": groups});
    }
    for (index, grasp) in answer.get_mut("grasps").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
        if grasp.is_object() {
            let wire: GraspWire = read(grasp.take()).map_err(|error| format!("grasp {index}: {error}"))?;
            let sizes = [wire.score, wire.width, wire.height, wire.depth];
            let numbers = sizes.into_iter().chain(wire.rotation_matrix.into_iter().flatten()).chain(wire.translation);
            *grasp = numbers.chain([-1.0]).collect();
        }
    }
    Ok(answer)
}

fn grasps_of(reply: &GraspReply, world_from_camera: &Pose) -> Result<Vec<Grasp>, String> {
    if reply.grasps.len() > MAX_GRASPS {
        return Err(format!("the answer has {} grasps, expected at most {MAX_GRASPS}", reply.grasps.len()));
    }
    let mut grasps = Vec::with_capacity(reply.grasps.len());
    for (index, row) in reply.grasps.iter().enumerate() {
        let wrong = |error: String| format!("grasp {index}: {error}");
        let grasp = GraspNetGrasp::from_graspnet(row).map_err(|error| wrong(error.to_string()))?.grasp;
        let distance_m = grasp.pose.position.length();
        if distance_m > MAX_DISTANCE_M {
            return Err(wrong(format!(
                "{distance_m:.1} m from the camera, expected at most {MAX_DISTANCE_M}; in metres?"
            )));
        }
        if !(0.0..=MAX_WIDTH_M).contains(&grasp.width) {
            return Err(wrong(format!("a width of {} m, expected 0 to {MAX_WIDTH_M}", grasp.width)));
        }
        grasps.push(Grasp { pose: *world_from_camera * grasp.pose, ..grasp });
    }
    grasps.sort_by(|one, other| other.score.total_cmp(&one.score));
    Ok(grasps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_llm::ChatError;

    struct Fixed(Value);

    impl Service for Fixed {
        fn ask(&self, _: &Value) -> Result<Value, ChatError> {
            Ok(self.0.clone())
        }
    }

    fn camera() -> Pose {
        genmanip_core::Camera::pose_looking_at(DVec3::new(1.0, 0.3, 0.9), DVec3::new(0.4, 0.0, 0.0))
    }

    fn asked(answer: Value) -> Result<Vec<Grasp>, GraspError> {
        let points = [DVec3::new(0.4, 0.0, 0.02)];
        let question = GraspQuestion {
            points: &points,
            scene: &[],
            world_from_camera: camera(),
            camera_positions: &[camera().position],
            table_height: 0.0,
        };
        ServiceGrasps::new(Fixed(answer)).grasps(&question)
    }

    #[test]
    fn grasps_come_back_in_the_world_best_first() {
        let grasp = |x: f64, score: f64| Grasp {
            pose: Pose::from_axes(DVec3::new(x, 0.1, 0.05), DVec3::X, -DVec3::Y, -DVec3::Z),
            width: 0.04,
            score,
        };
        let sent = [grasp(0.3, 0.2), grasp(0.5, 0.9)];
        let reply = serde_json::to_value(GraspReply::of(&sent, &camera())).unwrap();
        let got = asked(reply).unwrap();
        assert_eq!(got.iter().map(|grasp| grasp.score).collect::<Vec<_>>(), [0.9, 0.2]);
        for (got, sent) in got.iter().zip([&sent[1], &sent[0]]) {
            assert!(got.pose.position.distance(sent.pose.position) < 1e-9 && got.pose.angle_to(&sent.pose) < 1e-6);
        }
    }

    #[test]
    fn grasps_with_and_without_depth_are_those_of_the_rows() {
        let row = [0.9, 0.05, 0.02, 0.03, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.1, 0.2, 0.5, -1.0];
        let named = |mut more: Value| {
            let given =
                json!({"translation": &row[13..16], "rotation_matrix": [&row[4..7], &row[7..10], &row[10..13]]});
            more.as_object_mut().unwrap().extend(given.as_object().unwrap().clone());
            more
        };
        let whole = json!({"score": 0.9, "width": 0.05, "height": 0.02, "depth": 0.03, "id": 7});
        let expected = asked(json!({"grasps": [row]})).unwrap();
        for answer in [
            json!([row]),
            json!({"grasp_groups": [row]}),
            json!({"grasp_groups": [named(whole.clone())]}),
            json!([named(whole)]),
        ] {
            assert_eq!(asked(answer).unwrap(), expected);
        }
        let [without] = &asked(json!({"grasp_groups": [named(json!({"score": 0.9}))]})).unwrap()[..] else { panic!() };
        let tips = expected[0].pose.position - expected[0].approach() * 0.03;
        assert!(without.pose.position.distance(tips) < 1e-9 && without.width == 0.08, "{without:?}");
        let error = asked(json!([{"translation": [0.0, 0.0, 0.5]}])).unwrap_err().to_string();
        assert!(error.contains("grasp 0: its answer is wrong at .: missing field `rotation_matrix`"), "{error}");
    }

    #[test]
    fn points_come_back() {
        let points = [DVec3::new(0.4, 0.1, 0.02), DVec3::new(0.5, -0.2, 0.3)];
        let question = GraspQuestion {
            points: &points,
            scene: &points[..1],
            world_from_camera: camera(),
            camera_positions: &[],
            table_height: 0.0,
        };
        let [target, scene] = GraspRequest::of(&question).read().unwrap();
        assert_eq!((target.len(), scene.len()), (2, 1));
        assert!(target.iter().zip(&points).all(|(one, other)| one.distance(*other) < 1e-6));
    }

    #[test]
    fn hostile_answers_are_one_clear_error() {
        let mut row = vec![0.9, 0.05, 0.02, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -1.0];
        assert_eq!(asked(json!({"grasps": [row]})).map(|grasps| grasps.len()), Ok(1));
        let mut with = |index: usize, value: f64| {
            let before = std::mem::replace(&mut row[index], value);
            let answer = json!({"grasps": [row]});
            row[index] = before;
            answer
        };
        let cases = [
            (json!({"poses": []}), "missing field `grasps`"),
            (json!({"grasps": [[1.0, 2.0]]}), "its answer is wrong at grasps[0]: "),
            (json!({"grasps": [vec![Value::Null; 17]]}), "its answer is wrong at grasps[0][0]: "),
            (with(15, 1000.0), "grasp 0: 1000.0 m from the camera"),
            (with(1, 50.0), "grasp 0: a width of 50 m"),
            (with(4, 0.2), "grasp 0: "),
        ];
        for (answer, expected) in cases {
            let error = asked(answer).unwrap_err().to_string();
            assert!(error.starts_with("the grasp service: ") && error.contains(expected), "{error}");
        }
    }
}
