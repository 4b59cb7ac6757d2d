//! Planning from a depth image: the planner knows only the camera image and the table.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Intrinsics, Material, Piece, Pose, RgbdImage, RobotModel, Seed, TriMesh, VisualPart};
use genmanip_motion::{AllowedCollisions, CollisionWorld, DepthSettings, Path, Planner, PlanningScene, triangulate};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};
use serde::Serialize;

use super::problems::Problem;
use super::{OPEN, SHOWN, states, timed};
use crate::LabError;

/// Fine point cloud that stands for the visible surfaces when paths are checked: voxel size and point radius, m.
const FINE_CLOUD: (f64, f64) = (0.002, 1e-4);
/// Name of the point cloud as an obstacle.
const SEEN: &str = "what is seen";

/// Results of planning from depth images; only the check knows the true obstacles.
#[derive(Default, Serialize)]
pub struct Depth {
    /// Number of problems rendered.
    pub problems: usize,
    /// Number of problems whose start or goal lies within the inflated cloud; they are not planned.
    pub start_or_goal_in_cloud: usize,
    /// Number of problems planned.
    pub planned: usize,
    /// Number of problems with a path.
    pub solved: usize,
    /// Number of paths with a state, checked every 0.02 rad, that touches the cloud they were planned in.
    pub touching_cloud: usize,
    /// Number of paths that touch a point of the fine cloud.
    pub touching_seen_surfaces: usize,
    /// Number of paths that touch the true geometry, unseen parts included.
    pub touching_anything: usize,
    /// Share of paths that touch no point of the fine cloud, 0 to 1.
    pub clear_of_seen_surfaces: f64,
    /// Median number of points of the planner's cloud.
    pub points: f64,
    /// Median CPU time from the depth image to the planner's collision world, ms.
    pub perceive_ms: f64,
    /// Median CPU time of planning, ms.
    pub plan_ms: f64,
    /// Reasons of the first unsolved problems.
    pub failures: Vec<String>,
}

/// Collected measurements of the problems; [`DepthTally::finish`] summarises them in `depth`.
pub struct DepthTally {
    /// CPU time of each planned problem from the image to a path or failure, ms.
    pub total_ms: Vec<f64>,
    pub depth: Depth,
    /// Planner whose settings give the fine cloud.
    fine: Planner,
    camera: Camera,
    perceive_ms: Vec<f64>,
    plan_ms: Vec<f64>,
    points: Vec<f64>,
}

impl DepthTally {
    pub fn new(planner: &Planner) -> Self {
        let (cell_m, radius_m) = FINE_CLOUD;
        let depth = DepthSettings { cell_m, radius_m, ..planner.settings().depth.clone() };
        // Over the robot's left shoulder, so that openings facing the robot are visible.
        let intrinsics = Intrinsics::from_vertical_fov(640, 480, 55_f64.to_radians());
        let camera = Camera::looking_at("shoulder", DVec3::new(-0.15, 0.6, 1.1), DVec3::new(0.5, 0.0, 0.1), intrinsics);
        Self {
            total_ms: vec![],
            depth: Depth::default(),
            fine: planner.with_depth(depth),
            camera,
            perceive_ms: vec![],
            plan_ms: vec![],
            points: vec![],
        }
    }

    pub fn solve(&mut self, planner: &Planner, index: usize, problem: &Problem, seed: Seed) -> Result<(), LabError> {
        let image = [draw(planner.robot(), problem, &self.camera)?];
        let allowed = AllowedCollisions::none();
        let (start, goals) = (&problem.start, std::slice::from_ref(&problem.goal));
        let perceive = |planner: &Planner| planner.world_seen(&around(&problem.tables, &allowed), start, SEEN, &image);
        let no_cloud = |error| LabError::broken(format!("problem {index} cannot be seen"), error);
        self.depth.problems += 1;
        let (seen, perceive_s) = timed(|| perceive(planner));
        let seen = seen.map_err(no_cloud)?;
        let touches = |world: &CollisionWorld, state: &[f64]| {
            planner.checker(&around(world, &allowed), 0.0).check(state).is_some()
        };
        if touches(&seen, start) || touches(&seen, &problem.goal) {
            self.depth.start_or_goal_in_cloud += 1;
            return Ok(());
        }
        self.depth.planned += 1;
        let (planned, plan_s) = timed(|| planner.plan_joint(&around(&seen, &allowed), start, goals, seed));
        self.total_ms.push((perceive_s + plan_s) * 1e3);
        self.perceive_ms.push(perceive_s * 1e3);
        self.plan_ms.push(plan_s * 1e3);
        self.points.push(seen.facet_count(SEEN).unwrap_or(0) as f64);
        match planned {
            Err(error) if self.depth.failures.len() < SHOWN => {
                self.depth.failures.push(format!("problem {index}: {error}"));
            }
            Err(_) => {}
            Ok(path) => {
                self.depth.solved += 1;
                let pixels = perceive(&self.fine).map_err(no_cloud)?;
                let touches = |world: &CollisionWorld| is_touched_by(planner, &around(world, &allowed), &path);
                self.depth.touching_cloud += usize::from(touches(&seen));
                self.depth.touching_seen_surfaces += usize::from(touches(&pixels));
                self.depth.touching_anything += usize::from(touches(&problem.world));
            }
        }
        Ok(())
    }

    /// Computes medians and shares, once all problems are measured.
    pub fn finish(&mut self) {
        let median = |values: &mut Vec<f64>| super::Spread::of(std::mem::take(values)).median;
        let Depth { solved, touching_seen_surfaces, .. } = self.depth;
        self.depth.clear_of_seen_surfaces = 1.0 - touching_seen_surfaces as f64 / (solved as f64).max(1.0);
        self.depth.points = median(&mut self.points);
        self.depth.perceive_ms = median(&mut self.perceive_ms);
        self.depth.plan_ms = median(&mut self.plan_ms);
    }
}

fn around<'a>(world: &'a CollisionWorld, allowed: &'a AllowedCollisions) -> PlanningScene<'a> {
    PlanningScene { world, attached: None, allowed, gripper_width: OPEN }
}

/// True if anything touches: a state of the path (every 0.02 rad), a waypoint, or a state of the timed trajectory.
fn is_touched_by(planner: &Planner, around: &PlanningScene, path: &Path) -> bool {
    let (exact, trajectory) = (planner.checker(around, 0.0), planner.time(path, 1.0));
    states(path).iter().chain(path.waypoints()).chain(&trajectory.configs).any(|state| exact.check(state).is_some())
}

/// Depth image of the obstacles and of the robot at its start, rendered from collision pieces.
fn draw(robot: &RobotModel, problem: &Problem, camera: &Camera) -> Result<RgbdImage, LabError> {
    let mut drawn = robot.clone();
    for link in &mut drawn.links {
        link.visual = link.pieces.iter().map(visual).collect::<Result<_, _>>()?;
    }
    let obstacles = problem.pieces.iter().map(visual).collect::<Result<Vec<_>, _>>()?;
    // The base link is at the world's origin, so obstacles attached to it keep their world poses.
    drawn.links[0].visual.extend(obstacles);
    let no_picture = |error| LabError::broken("the problem cannot be rendered", error);
    let assets = RenderAssets::new(Arc::new(drawn), &[], None).map_err(no_picture)?;
    let frame = assets.frame_state(&problem.start, OPEN, []).map_err(no_picture)?;
    let mut buffers = [FrameBuffers::default()];
    let mut renderer = Renderer::new(assets, RenderVariation::default());
    renderer.render(&[ViewJob::new(&frame, camera, Channels::GEOMETRY)], &mut buffers).map_err(no_picture)?;
    let [buffers] = buffers;
    Ok(buffers.into_image(camera, camera.mount_from_camera))
}

fn visual(piece: &Piece) -> Result<VisualPart, LabError> {
    let (corners, triangles) =
        triangulate(piece).map_err(|error| LabError::broken("a collision piece cannot be rendered", error))?;
    let positions = corners.iter().map(|corner| corner.as_vec3()).collect();
    let mesh = TriMesh { positions, triangles, ..TriMesh::default() };
    Ok(VisualPart::new("piece", mesh, Material::plain([0.7; 3], 0.5), Pose::IDENTITY))
}
