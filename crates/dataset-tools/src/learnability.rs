//! Learnability of demonstrations: how well a policy could predict them from the state of the scene.
//!
//! Two measurements per task. *Grasp*: tool pose and joints at the first grasp, regressed by a quadratic polynomial on
//! the picked object's initial position, with 5-fold cross-validation; the residual looks random to a policy.
//! *Neighbours*: the motion of the arm in the next second, predicted by k nearest neighbours among the states of other
//! episodes.

mod fit;
mod neighbours;

use std::collections::BTreeMap;

use genmanip_core::glam::{DMat3, DQuat, DVec2, DVec3};
use genmanip_core::{Atom, Episode, Pose, ReferenceId};
use genmanip_data::{DataError, EpisodeStore, Selection};
use serde::Serialize;

use fit::residuals;
pub use neighbours::Prediction;
use neighbours::{Neighbours, ROWS_HZ, Row};

/// Minimum number of episodes of a task with a grasp for a fit: about three times the 12 coefficients of the larger
/// fit.
const MIN_EPISODES: usize = 40;

/// Learnability of a set of demonstrations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Learnability {
    /// Number of successful episodes, which are measured.
    pub episodes: usize,
    /// Number of successful episodes without a grasp, which do not count in `grasp`.
    pub without_grasp: usize,
    /// Number of tasks with too few episodes for a fit, which do not count in `grasp`.
    pub small_tasks: usize,
    /// Minimum number of episodes per task for a fit.
    pub min_episodes: usize,
    /// Spread of the first grasp; `None` if every task has too few episodes.
    pub grasp: Option<GraspSpread>,
    /// Errors of the prediction by nearest neighbours; `None` if no task has two episodes.
    pub neighbours: Option<Prediction>,
}

/// Spread of the first grasp, and the part of the spread that the scene does not explain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspSpread {
    /// Number of grasps over all tasks.
    pub grasps: usize,
    /// Circular standard deviation of the closing direction's heading, degrees; infinite for uniform headings.
    pub heading_std_deg: f64,
    /// Root mean square angle between the tool's orientation and its mean, degrees.
    pub orientation_rms_deg: f64,
    /// Residuals of the regression on the object's x and y.
    pub from_position: Residuals,
    /// Residuals of the regression on the object's x, y and heading.
    pub from_pose: Residuals,
}

/// Cross-validated root-mean-square residuals of a regression, over all tasks.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Residuals {
    /// Residuals of tool position x, y and z, m.
    pub position_m: Vec<f64>,
    /// Residuals of the six entries of the tool's 6D rotation (the first two columns of its matrix).
    pub direction: Vec<f64>,
    /// Residuals of the arm joints, rad.
    pub joints_rad: Vec<f64>,
}

/// Measures learnability over the successful episodes of a store. `progress` is called after each episode with the
/// number of all.
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

/// Data of one episode that the measurements use.
struct Demonstration {
    grasp: Option<Grasped>,
    rows: Vec<Row>,
}

/// State of the arm when both fingers first touch an object, and initial pose of that object.
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
        let named: Vec<&ReferenceId> = named.flat_map(Atom::ids).collect();
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
                // Harmonics 2 and 4, since boxes have a symmetry of a half turn and cubes of a quarter turn.
                let harmonics = [1.0, 2.0, 4.0].map(|times| (times * y.atan2(x)).sin_cos());
                (position(grasp), harmonics.iter().flat_map(|&(sin, cos)| [sin, cos]).collect())
            }),
        }
    }
}

impl Residuals {
    /// Residuals over all tasks; `features` gives the features that enter with their squares and products, and those
    /// that enter linearly.
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

/// Errors of the prediction by nearest neighbours, over all tasks; `None` if no task has two episodes.
fn predicted(tasks: &BTreeMap<String, Vec<Demonstration>>) -> Option<Prediction> {
    let mut total = Neighbours::default();
    for episodes in tasks.values().filter(|episodes| episodes.len() > 1) {
        total.add(&episodes.iter().map(|episode| episode.rows.as_slice()).collect::<Vec<_>>());
    }
    total.prediction()
}

/// Cosine and sine of the heading of a rotation's x axis, or of its y axis if x is nearly vertical.
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

/// Chordal mean of rotations, approximated by orthonormalising the mean matrix.
fn mean_rotation(rotations: impl Iterator<Item = DQuat>) -> DQuat {
    let sum = rotations.map(DMat3::from_quat).fold(DMat3::ZERO, |sum, matrix| sum + matrix);
    let x = sum.x_axis.normalize_or(DVec3::X);
    let y = (sum.y_axis - x * sum.y_axis.dot(x)).normalize_or(x.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y)))
}
