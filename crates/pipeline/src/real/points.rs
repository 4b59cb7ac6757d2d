//! Goal verdict on RGB-D images of a real workspace, without simulator truth.
//!
//! The first images show which pixels are which object: each stands where the scenario has it, or is reported. The last
//! images are compared with them: an object whose surface is still there has not moved; one that is gone is looked for
//! among the surfaces that are new, by its colours. The clouds of both go to the verdict that simulated episodes get.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_agent::segmentation::RobotSilhouette;
use genmanip_core::perception::FIRST_OBJECT;
use genmanip_core::{
    Camera, CameraMount, CameraRequest, CloudVerdict, ImageChannels, InstanceId, Observation, RgbdImage,
};
pub use genmanip_rollout::cloud_verdict::is_shown;
use genmanip_rollout::cloud_verdict::verdict_of_views;
use genmanip_rollout::images::{Exposure, StageRenderer};
use genmanip_rollout::{RobotInterface, RolloutError, Stage};
use serde::{Deserialize, Serialize};

/// Largest difference of a measured depth from that of the scenario's object in the first images, m: noise of the camera,
/// and error of a person who lays the scene out.
const LAID_OUT_M: f64 = 0.02;
/// Smallest share of an object's pixels that must show it there.
const LAID_OUT_SHARE: f64 = 0.5;
/// Smallest difference of two depths of a pixel that counts as a change, m: several times the noise of a depth camera.
const CHANGE_M: f64 = 0.012;
/// Share of an object's still visible pixels that are gone, from which it has moved.
const MOVED_SHARE: f64 = 0.3;
/// Fewest pixels from which anything is concluded.
const FEWEST_PIXELS: usize = 20;
/// Edge of the cells by which points belong together if they are next to each other, m.
const CELL_M: f64 = 0.01;
/// Smallest similarity of the colours of a new surface and of the object that it may be, 0 to 1.
const ALIKE: f64 = 0.15;
/// Largest distance of an object's nearest point from the tool of a closed gripper that holds it, m.
const HELD_M: f64 = 0.015;
/// Share of the largest opening below which a gripper counts as closed.
const CLOSED: f64 = 0.95;

/// Images of the fixed cameras at one moment, with what the arm reported then.
#[derive(Clone, Debug)]
pub struct Moment {
    /// Arm joint positions, rad.
    pub arm: Vec<f64>,
    /// Opening of the gripper, m.
    pub width_m: f64,
    /// Colour and depth by each camera of [`judging_cameras`], in their order.
    pub images: Vec<RgbdImage>,
}

/// Images of a robot now, by the cameras of a stage that is judged.
///
/// # Errors
/// If a camera gives no depth.
pub fn moment(robot: &mut impl RobotInterface, stage: &Stage) -> Result<Moment, RolloutError> {
    let request = |camera: &Camera| CameraRequest::new(&camera.name, ImageChannels::RGBD);
    let requests: Vec<CameraRequest> = judging_cameras(stage).map(request).collect();
    let mut observation = robot.observe(&requests)?;
    let state = observation.state.get(Observation::STATE).and_then(|state| state.split_last());
    let Some((width_m, arm)) = state else { return Err(failed("the robot reports no joint positions")) };
    let (arm, width_m) = (arm.to_vec(), *width_m);
    let images = requests.iter().filter_map(|request| observation.images.remove(&request.name));
    Ok(Moment { arm, width_m, images: images.map(Arc::unwrap_or_clone).collect() })
}

/// Verdict on images, with what they did not show.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointVerdict {
    /// Verdict; its `unseen` objects are hidden or lost at the end.
    pub verdict: CloudVerdict,
    /// Objects that have moved.
    pub moved: Vec<InstanceId>,
    /// Objects that the first images do not show where the scenario has them: nothing is known about them.
    pub not_laid_out: Vec<InstanceId>,
    /// Object that the closed gripper seems to hold; conditions on it do not hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held: Option<InstanceId>,
}

/// Cameras whose images are judged: those that stand still.
pub fn judging_cameras(stage: &Stage) -> impl Iterator<Item = &Camera> {
    stage.scenario.world.cameras.iter().filter(|camera| camera.mount == CameraMount::World)
}

/// Judge of a run, which has seen its first images.
pub struct PointJudge<'a> {
    stage: &'a Stage,
    silhouette: RobotSilhouette,
    start: Vec<RgbdImage>,
    /// Object of each pixel of the first images; 0 for none.
    ids: Vec<Vec<u16>>,
    /// Pixels of the arm in the first images.
    arm: Vec<Vec<bool>>,
    /// True for each object that is where the scenario has it.
    is_laid_out: Vec<bool>,
}

impl<'a> PointJudge<'a> {
    /// Finds the objects of a stage in the first images of a run. Clouds show no joint states: see [`is_shown`].
    ///
    /// # Errors
    /// If the expected images cannot be rendered, or none were given.
    pub fn begin(stage: &'a Stage, first: Moment) -> Result<Self, RolloutError> {
        let cameras: Vec<&Camera> = judging_cameras(stage).collect();
        if cameras.is_empty() || first.images.len() != cameras.len() {
            return Err(failed("points cannot be judged without a fixed camera that gives depth"));
        }
        let silhouette = RobotSilhouette::new(&stage.robot)
            .map_err(|error| failed(format!("the silhouette of the robot: {error}")))?;
        let mut renderer = StageRenderer::new(stage)?;
        let channels = ImageChannels { rgb: false, depth: true, ids: true, ..ImageChannels::RGB };
        // Real images come with the lens that the calibration found, and so does the expected one.
        let views: Vec<_> = cameras.iter().map(|camera| Camera { sensor: None, ..(*camera).clone() }).collect();
        let views: Vec<_> = views.iter().map(|camera| (camera, channels)).collect();
        let objects = stage.scenario.objects.iter().map(|it| (it.pose, it.joint_positions.as_slice()));
        let exposure = Exposure::still(stage.scenario.seed);
        let expected = renderer.render_state(&first.arm, first.width_m, objects, &views, exposure)?;
        let count = stage.scenario.objects.len();
        let (mut agreeing, mut visible) = (vec![0_usize; count], vec![0_usize; count]);
        let (mut all_ids, mut arm) = (Vec::new(), Vec::new());
        for (image, expected) in first.images.iter().zip(&expected) {
            let robot = silhouette.pixels(&first.arm, first.width_m, image);
            let mut ids = vec![0; image.depth_m.len()];
            for (at, id) in expected.ids.iter().enumerate() {
                let Some(object) = id.checked_sub(FIRST_OBJECT).map(usize::from).filter(|it| *it < count) else {
                    continue;
                };
                let Some(depth_m) = depth(image, at).filter(|_| !robot[at]) else { continue };
                visible[object] += 1;
                if (depth_m - f64::from(expected.depth_m[at])).abs() <= LAID_OUT_M {
                    agreeing[object] += 1;
                    ids[at] = *id;
                }
            }
            all_ids.push(ids);
            arm.push(robot);
        }
        let is_there = |(agreeing, visible): (&usize, &usize)| {
            *agreeing >= FEWEST_PIXELS && *agreeing as f64 >= LAID_OUT_SHARE * *visible as f64
        };
        let is_laid_out = agreeing.iter().zip(&visible).map(is_there).collect();
        Ok(Self { stage, silhouette, start: first.images, ids: all_ids, arm, is_laid_out })
    }

    /// Stage whose goal is judged.
    pub fn stage(&self) -> &'a Stage {
        self.stage
    }

    /// Judges the last images of the run.
    pub fn judge(&self, last: Moment) -> PointVerdict {
        let count = self.is_laid_out.len();
        let robot: Vec<Vec<bool>> =
            last.images.iter().map(|image| self.silhouette.pixels(&last.arm, last.width_m, image)).collect();
        let (mut same, mut gone) = (vec![0_usize; count], vec![0_usize; count]);
        // Pixels of each image by what became of them.
        let changes: Vec<Vec<Change>> = (0..last.images.len())
            .map(|view| {
                (0..last.images[view].depth_m.len()).map(|at| self.change(view, at, &last, &robot[view])).collect()
            })
            .collect();
        for (changes, ids) in changes.iter().zip(&self.ids) {
            for (change, id) in changes.iter().zip(ids) {
                let Some(object) = id.checked_sub(FIRST_OBJECT).map(usize::from) else { continue };
                same[object] += usize::from(*change == Change::Same);
                gone[object] += usize::from(*change == Change::Farther);
            }
        }
        let has_moved = |object: &usize| {
            let seen = same[*object] + gone[*object];
            self.is_laid_out[*object] && seen >= FEWEST_PIXELS && gone[*object] as f64 > MOVED_SHARE * seen as f64
        };
        let moved: Vec<usize> = (0..count).filter(has_moved).collect();
        let surfaces = self.new_surfaces(&last, &changes, &moved);
        let found = self.recognised(&last, &surfaces, &moved);
        let mut views = last.images;
        for (view, image) in views.iter_mut().enumerate() {
            let still = |at: usize| {
                let id = self.ids[view][at];
                let object = id.checked_sub(FIRST_OBJECT).map(usize::from);
                let is_still = object.is_some_and(|it| self.is_laid_out[it] && !moved.contains(&it));
                if is_still && changes[view][at] == Change::Same { id } else { 0 }
            };
            image.ids = (0..image.depth_m.len()).map(still).collect();
        }
        for (object, surface) in &found {
            for &(view, at) in &surfaces[*surface].pixels {
                views[view].ids[at] = FIRST_OBJECT + *object as u16;
            }
        }
        let tool = self.stage.robot.tcp_pose(&last.arm).position;
        let is_closed = last.width_m < CLOSED * self.stage.robot.gripper.max_width;
        let is_held = |(_, surface): &&(usize, usize)| {
            let mut points = surfaces[*surface].pixels.iter().filter_map(|&(view, at)| views[view].point(at));
            is_closed && points.any(|point| point.distance(tool) < HELD_M)
        };
        let held = found.iter().find(is_held).map(|(object, _)| *object);
        let id = |object: usize| self.stage.scenario.objects[object].id.clone();
        PointVerdict {
            verdict: verdict_of_views(self.stage, &views, held),
            moved: moved.iter().copied().map(id).collect(),
            not_laid_out: (0..count).filter(|object| !self.is_laid_out[*object]).map(id).collect(),
            held: held.map(id),
        }
    }

    fn change(&self, view: usize, at: usize, last: &Moment, robot: &[bool]) -> Change {
        if robot[at] || self.arm[view][at] {
            return Change::Unknown;
        }
        match (depth(&self.start[view], at), depth(&last.images[view], at)) {
            (Some(before_m), Some(now_m)) if now_m < before_m - CHANGE_M => Change::Nearer,
            (Some(before_m), Some(now_m)) if now_m > before_m + CHANGE_M => Change::Farther,
            (Some(_), Some(_)) => Change::Same,
            _ => Change::Unknown,
        }
    }

    /// Surfaces that the last images show and the first ones do not, largest first.
    fn new_surfaces(&self, last: &Moment, changes: &[Vec<Change>], moved: &[usize]) -> Vec<Surface> {
        let mut cells: BTreeMap<[i64; 3], Vec<(usize, usize)>> = BTreeMap::new();
        let was_moved = |view: usize, at: usize| {
            let object = self.ids[view][at].checked_sub(FIRST_OBJECT).map(usize::from);
            object.is_some_and(|object| moved.contains(&object))
        };
        for (view, image) in last.images.iter().enumerate() {
            for (at, change) in changes[view].iter().enumerate() {
                // An object that moved by less than its size is seen behind its own place, too.
                let is_candidate = match change {
                    Change::Nearer => true,
                    Change::Farther | Change::Same => was_moved(view, at),
                    Change::Unknown => false,
                };
                let Some(point) = image.point(at).filter(|_| is_candidate) else { continue };
                if *change != Change::Nearer && point.z < CHANGE_M {
                    continue;
                }
                cells
                    .entry((point / CELL_M).floor().to_array().map(|index| index as i64))
                    .or_default()
                    .push((view, at));
            }
        }
        let mut surfaces: Vec<Surface> =
            connected(cells).into_iter().map(|pixels| Surface { pixels }).filter(|it| it.is_new(changes)).collect();
        surfaces.sort_by_key(|surface| std::cmp::Reverse(surface.pixels.len()));
        surfaces
    }

    /// Pairs of moved objects and new surfaces: the most similar colours first.
    fn recognised(&self, last: &Moment, surfaces: &[Surface], moved: &[usize]) -> Vec<(usize, usize)> {
        let colors: Vec<Colors> = surfaces.iter().map(|surface| Colors::of(&last.images, &surface.pixels)).collect();
        let before = |object: usize| {
            let id = FIRST_OBJECT + object as u16;
            let pixels = self.ids.iter().enumerate().flat_map(|(view, ids)| {
                ids.iter().enumerate().filter(move |(_, other)| **other == id).map(move |(at, _)| (view, at))
            });
            Colors::of(&self.start, &pixels.collect::<Vec<_>>())
        };
        let mut pairs = Vec::new();
        for &object in moved {
            let known = before(object);
            for (surface, colors) in colors.iter().enumerate() {
                let alike = known.alike(colors);
                if alike >= ALIKE {
                    pairs.push((alike, object, surface));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.cmp(&b.2)));
        let mut found: Vec<(usize, usize)> = Vec::new();
        for (_, object, surface) in pairs {
            if found.iter().all(|(other, taken)| *other != object && *taken != surface) {
                found.push((object, surface));
            }
        }
        found
    }
}

impl std::fmt::Debug for PointJudge<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PointJudge").field("is_laid_out", &self.is_laid_out).finish_non_exhaustive()
    }
}

impl PointVerdict {
    /// The verdict in a sentence, with what the images did not show.
    pub fn text(&self) -> String {
        let list = |ids: Vec<String>| ids.join(", ");
        let mut text = match self.verdict.success {
            true => "the images show the goal as met".to_owned(),
            false => format!("the images show {:.0} % of the goal's conditions as met", 100.0 * self.verdict.score),
        };
        if !self.verdict.unseen.is_empty() {
            let unseen = self.verdict.unseen.iter().map(ToString::to_string).collect();
            text += &format!("; not seen at the end, so that conditions on it count as not met: {}", list(unseen));
        }
        if !self.not_laid_out.is_empty() {
            let missing = self.not_laid_out.iter().map(ToString::to_string).collect();
            text += &format!("; not seen at the start where the scenario has it: {}", list(missing));
        }
        if let Some(held) = &self.held {
            text += &format!("; the gripper seems to hold {held}");
        }
        text
    }
}

/// Change of a pixel between the first and the last images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    Same,
    Nearer,
    Farther,
    /// The arm, or no depth, in one of the two.
    Unknown,
}

/// New surface: view and index of each pixel.
struct Surface {
    pixels: Vec<(usize, usize)>,
}

impl Surface {
    fn is_new(&self, changes: &[Vec<Change>]) -> bool {
        let nearer = self.pixels.iter().filter(|(view, at)| changes[*view][*at] == Change::Nearer).count();
        nearer >= FEWEST_PIXELS && 2 * nearer >= self.pixels.len()
    }
}

/// Distribution of the colours of pixels, over hue and lightness.
struct Colors {
    shares: BTreeMap<[u8; 3], f64>,
}

impl Colors {
    /// Distribution over pixels, given by view and index.
    fn of(images: &[RgbdImage], pixels: &[(usize, usize)]) -> Self {
        let mut shares: BTreeMap<[u8; 3], f64> = BTreeMap::new();
        for (view, at) in pixels {
            let Some(&[r, g, b]) = images[*view].rgb.as_chunks::<3>().0.get(*at) else { continue };
            let sum = (f64::from(r) + f64::from(g) + f64::from(b)).max(1.0);
            let part = |value: u8| (8.0 * f64::from(value) / sum) as u8;
            *shares.entry([part(r), part(g), (sum / 192.0) as u8]).or_default() += 1.0 / pixels.len() as f64;
        }
        Self { shares }
    }

    /// Overlap of two distributions, 0 to 1.
    fn alike(&self, other: &Self) -> f64 {
        self.shares.iter().map(|(bin, share)| share.min(*other.shares.get(bin).unwrap_or(&0.0))).sum()
    }
}

fn depth(image: &RgbdImage, at: usize) -> Option<f64> {
    let depth_m = f64::from(*image.depth_m.get(at)?);
    (depth_m.is_finite() && depth_m > 0.0).then_some(depth_m)
}

/// Groups of the contents of cells that are next to each other.
fn connected(mut cells: BTreeMap<[i64; 3], Vec<(usize, usize)>>) -> Vec<Vec<(usize, usize)>> {
    let mut groups = Vec::new();
    while let Some((first, content)) = cells.pop_first() {
        let (mut group, mut edge) = (content, vec![first]);
        while let Some([x, y, z]) = edge.pop() {
            for (i, j, k) in (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| (i, j, k)))) {
                let next = [x + i, y + j, z + k];
                if let Some(content) = cells.remove(&next) {
                    group.extend(content);
                    edge.push(next);
                }
            }
        }
        groups.push(group);
    }
    groups
}

fn failed(why: impl Into<String>) -> RolloutError {
    RolloutError::Robot(why.into().into())
}
