//! Learnability of demonstrations: how well a policy could predict them from the scene.
//!
//! Two measurements per task. The *grasp*: tool pose and joints at the first grasp, fitted by a quadratic polynomial of
//! the picked object's initial position, with 5-fold cross-validation; what no such fit explains looks random to a policy.
//! The *neighbours*: what the arm does within the next second, predicted from the most similar states of other episodes.

mod fit;
mod neighbours;

use std::collections::BTreeMap;

use genmanip_core::glam::{DMat3, DQuat, DVec2, DVec3};
use genmanip_core::{Episode, Pose};
use genmanip_data::{DataError, EpisodeStore, Selection};
use serde::Serialize;

use fit::residuals;
pub use neighbours::Prediction;
use neighbours::{Neighbours, ROWS_HZ, Row};

/// Fewest episodes of a task with a grasp for which a fit is made: three times the 12 coefficients of the larger fit.
const MIN_EPISODES: usize = 40;

/// Learnability of a set of demonstrations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Learnability {
    /// Number of successful episodes.
    pub episodes: usize,
    /// Those without a grasp, which are left out of `grasp`.
    pub without_grasp: usize,
    /// Tasks with too few episodes for a fit, which are left out of `grasp`.
    pub small_tasks: usize,
    /// Fewest episodes for a fit.
    pub min_episodes: usize,
    /// The first grasp; `None` if every task is too small.
    pub grasp: Option<GraspSpread>,
    /// Prediction by neighbours; `None` with fewer than two episodes per task.
    pub neighbours: Option<Prediction>,
}

/// Spread of the first grasp, and the part of it that the scene does not explain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspSpread {
    /// Number of grasps.
    pub grasps: usize,
    /// Circular standard deviation of the closing direction's heading, degrees; infinite for uniform headings.
    pub heading_std_deg: f64,
    /// Root mean square angle between the tool's orientation and its mean, degrees.
    pub orientation_rms_deg: f64,
    /// Residuals of the fit from the object's x and y.
    pub from_position: Residuals,
    /// Residuals of the fit from the object's x and y and its heading.
    pub from_pose: Residuals,
}

/// Root mean square residuals of a cross-validated fit.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Residuals {
    /// Tool position, x, y and z, m.
    pub position_m: Vec<f64>,
    /// Entries of the tool's 6d rotation, the first two columns of its matrix.
    pub direction: Vec<f64>,
    /// Arm joints, rad.
    pub joints_rad: Vec<f64>,
}

/// Measures the successful episodes of a store.
///
/// # Errors
/// If an episode cannot be read, or none succeeded.
pub fn learnability(store: &EpisodeStore, progress: &mut dyn FnMut(usize)) -> Result<Learnability, DataError> {
    let ids = Selection::Verified.ids(store)?;
    if ids.is_empty() {
        let what = format!("episodes of {}", store.root().display());
        return Err(DataError::mismatch(what, "at least one that succeeded", "none"));
    }
    let mut tasks: BTreeMap<String, Vec<Demonstration>> = BTreeMap::new();
    for id in &ids {
        let episode = store.read(id)?;
        tasks.entry(episode.result.task_id.clone()).or_default().push(Demonstration::of(&episode));
        progress(ids.len());
    }
    let grasps: Vec<Vec<&Grasped>> =
        tasks.values().map(|episodes| episodes.iter().filter_map(|it| it.grasp.as_ref()).collect()).collect();
    let without_grasp = ids.len() - grasps.iter().map(Vec::len).sum::<usize>();
    let count = grasps.len();
    let grasps: Vec<Vec<&Grasped>> = grasps.into_iter().filter(|grasps| grasps.len() >= MIN_EPISODES).collect();
    Ok(Learnability {
        episodes: ids.len(),
        without_grasp,
        small_tasks: count - grasps.len(),
        min_episodes: MIN_EPISODES,
        grasp: (!grasps.is_empty()).then(|| GraspSpread::of(&grasps)),
        neighbours: predicted(&tasks),
    })
}

/// Excerpt of an episode.
struct Demonstration {
    grasp: Option<Grasped>,
    rows: Vec<Row>,
}

/// The arm when both fingers first press on an object, and that object at the start.
struct Grasped {
    object: Pose,
    tool: Pose,
    joints: Vec<f64>,
}

impl Demonstration {
    fn of(episode: &Episode) -> Self {
        let frames = &episode.frames;
        let grasp = frames.iter().find_map(|frame| {
            let object = frames.first()?.objects.get(frame.grasped?)?.pose;
            Some(Grasped { object, tool: frame.tcp, joints: frame.joint_position.clone() })
        });
        let named = episode.scenario.task.goal.alternatives.iter().flatten();
        let named: Vec<&str> = named.flat_map(|atom| atom.objects()).collect();
        let objects = episode.scenario.objects.iter().enumerate();
        let watched: Vec<usize> =
            objects.filter(|(_, object)| named.contains(&&*object.id)).map(|(index, _)| index).collect();
        let stride = (episode.result.control_rate_hz / ROWS_HZ).round().max(1.0) as usize;
        let rows = frames.iter().step_by(stride).map(|frame| {
            let mut state = frame.joint_position.clone();
            state.push(frame.gripper_width);
            for pose in watched.iter().filter_map(|&index| Some(frame.objects.get(index)?.pose)) {
                state.extend(pose.position.to_array());
                state.extend(heading(pose.rotation));
            }
            let [x, y] = columns(frame.tcp.rotation);
            let tool = [frame.tcp.position, x, y].iter().flat_map(|v| v.to_array()).collect();
            Row { state, joints: frame.joint_position.clone(), tool }
        });
        Self { grasp, rows: rows.collect() }
    }
}

impl GraspSpread {
    fn of(tasks: &[Vec<&Grasped>]) -> Self {
        let all = || tasks.iter().flatten().copied();
        let count = all().count() as f64;
        let headings = all().map(|grasp| grasp.tool.transform_vector(DVec3::Y).truncate().normalize_or_zero());
        let length = (headings.sum::<DVec2>().length() / count).min(1.0);
        let average = mean_rotation(all().map(|grasp| grasp.tool.rotation));
        let square = all().map(|grasp| grasp.tool.rotation.angle_between(average).powi(2)).sum::<f64>() / count;
        let position = |grasp: &Grasped| vec![grasp.object.position.x, grasp.object.position.y];
        Self {
            grasps: count as usize,
            heading_std_deg: (-2.0 * length.ln()).max(0.0).sqrt().to_degrees(),
            orientation_rms_deg: square.sqrt().to_degrees(),
            from_position: Residuals::of(tasks, |grasp| (position(grasp), Vec::new())),
            from_pose: Residuals::of(tasks, |grasp| {
                let [x, y] = heading(grasp.object.rotation);
                // Boxes look the same after half a turn, cubes after a quarter.
                let harmonics = [1.0, 2.0, 4.0].map(|times| (times * y.atan2(x)).sin_cos());
                (position(grasp), harmonics.iter().flat_map(|&(sin, cos)| [sin, cos]).collect())
            }),
        }
    }
}

impl Residuals {
    /// Residuals over all tasks; `features` gives those that enter the fit up to their squares and those that enter once.
    fn of(tasks: &[Vec<&Grasped>], features: impl Fn(&Grasped) -> (Vec<f64>, Vec<f64>)) -> Self {
        let rms = |target: fn(&Grasped) -> Vec<f64>| {
            let (mut squares, mut count): (Vec<f64>, usize) = (Vec::new(), 0);
            for task in tasks {
                let inputs: Vec<Vec<f64>> = task.iter().map(|grasp| fit::quadratic(features(grasp))).collect();
                let targets: Vec<Vec<f64>> = task.iter().map(|grasp| target(grasp)).collect();
                let of_task = residuals(&inputs, &targets);
                squares.resize(of_task.len().max(squares.len()), 0.0);
                for (sum, square) in squares.iter_mut().zip(of_task) {
                    *sum += square;
                }
                count += task.len();
            }
            squares.into_iter().map(|sum| (sum / count as f64).sqrt()).collect()
        };
        Self {
            position_m: rms(|grasp| grasp.tool.position.to_array().to_vec()),
            direction: rms(|grasp| columns(grasp.tool.rotation).iter().flat_map(|axis| axis.to_array()).collect()),
            joints_rad: rms(|grasp| grasp.joints.clone()),
        }
    }
}

/// Prediction by neighbours, over all tasks.
fn predicted(tasks: &BTreeMap<String, Vec<Demonstration>>) -> Option<Prediction> {
    let mut total = Neighbours::default();
    for episodes in tasks.values().filter(|episodes| episodes.len() > 1) {
        total.add(&episodes.iter().map(|episode| episode.rows.as_slice()).collect::<Vec<_>>());
    }
    total.prediction()
}

/// Cosine and sine of the heading of a rotation's x axis; of its y axis where x is vertical.
fn heading(rotation: DQuat) -> [f64; 2] {
    let ahead = (rotation * DVec3::X).truncate();
    let ahead = if ahead.length() > 0.5 { ahead } else { (rotation * DVec3::Y).truncate() };
    ahead.normalize_or_zero().to_array()
}

/// First two columns of a rotation's matrix.
fn columns(rotation: DQuat) -> [DVec3; 2] {
    let matrix = DMat3::from_quat(rotation);
    [matrix.x_axis, matrix.y_axis]
}

/// Rotation with the least squared chordal distance to the others, up to their mean's renormalisation.
fn mean_rotation(rotations: impl Iterator<Item = DQuat>) -> DQuat {
    let sum = rotations.map(DMat3::from_quat).fold(DMat3::ZERO, |sum, matrix| sum + matrix);
    let x = sum.x_axis.normalize_or(DVec3::X);
    let y = (sum.y_axis - x * sum.y_axis.dot(x)).normalize_or(x.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y)))
}
