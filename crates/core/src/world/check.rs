//! Validation of worlds; reports all faults at once.

use std::collections::BTreeSet;

use super::fault::WorldFault;
use super::{ArmPhysics, PhysicsSettings, RelationSettings, SupportSurface, World};
use crate::{AppearanceFactor, AppearanceRandomisation, Camera, CameraSensor, RobotModel};

/// Maximum side length of surfaces and workspaces, metres; larger values indicate a wrong unit.
const MAX_SIDE_M: f64 = 20.0;
/// Maximum image size along one side, pixels.
const MAX_PIXELS: u32 = 8192;

impl World {
    /// All faults of this world with its robot; engine settings are validated by the `sim` crate.
    pub fn faults(&self, robot: &RobotModel) -> Vec<WorldFault> {
        let mut faults = Vec::new();
        self.check_surfaces(&mut faults);
        self.check_workspace(&mut faults);
        self.check_robot(robot, &mut faults);
        check_parts(&self.cameras, Some(&self.physics), Some(&self.relations), &mut faults);
        faults.extend(self.look.as_ref().and_then(fault_of_look));
        faults.extend(self.appearance.iter().flat_map(|appearance| appearance.faults(&self.cameras)));
        faults
    }

    /// All faults that do not depend on the robot.
    pub fn faults_of_parts(&self) -> Vec<WorldFault> {
        let mut faults = Vec::new();
        for (index, surface) in self.surfaces.iter().enumerate() {
            check_surface(surface, &format!("surfaces[{index}]"), &mut faults);
        }
        check_parts(&self.cameras, Some(&self.physics), Some(&self.relations), &mut faults);
        faults.extend(self.look.as_ref().and_then(fault_of_look));
        faults.extend(self.appearance.iter().flat_map(|appearance| appearance.faults(&self.cameras)));
        faults
    }

    fn check_surfaces(&self, faults: &mut Vec<WorldFault>) {
        let Some(table) = self.table() else {
            faults.push(WorldFault::new("surfaces", "at least the table", "none"));
            return;
        };
        if table.id != "table" {
            faults.push(WorldFault::new("surfaces[0].id", "`table`", format!("`{}`", table.id)));
        }
        if table.top_center_m.z != 0.0 {
            let hint = "the world frame's origin is at table height; shift everything else instead";
            faults.push(WorldFault::new("surfaces[0].top_center_m[2]", "0", table.top_center_m.z).hint(hint));
        }
        let mut ids = BTreeSet::new();
        for (index, surface) in self.surfaces.iter().enumerate() {
            let place = format!("surfaces[{index}]");
            if !ids.insert(surface.id.as_str()) {
                faults.push(WorldFault::new(format!("{place}.id"), "a unique id", format!("`{}`", surface.id)));
            }
            check_surface(surface, &place, faults);
            let lowest = surface.bounds().min.z;
            if lowest < self.floor_z_m {
                faults.push(WorldFault::new(
                    "floor_z_m",
                    format!("at most {lowest} m, the lowest point of surface `{}`", surface.id),
                    self.floor_z_m,
                ));
            }
        }
    }

    fn check_workspace(&self, faults: &mut Vec<WorldFault>) {
        let workspace = &self.workspace;
        for (axis, [low, high]) in [("x", workspace.x), ("y", workspace.y)] {
            let is_interval = low.is_finite() && high.is_finite() && low < high && high - low <= MAX_SIDE_M;
            if !is_interval {
                let got = format!("[{low}, {high}]");
                faults.push(WorldFault::new(format!("workspace.{axis}"), "[smaller, larger], metres", got));
                return;
            }
        }
        let Some(table) = self.table() else { return };
        let surface_from_world = table.world_from_surface().inverse();
        let corners = workspace.x.iter().flat_map(|&x| workspace.y.iter().map(move |&y| glam::DVec3::new(x, y, 0.0)));
        let outside = corners.into_iter().find(|&corner| {
            let at = surface_from_world.transform_point(corner).truncate().abs();
            at.cmpgt(table.size_m.truncate() * 0.5 + 1e-9).any()
        });
        if let Some(corner) = outside {
            let hint = "make the table larger or the workspace smaller";
            let got = format!("a corner at x {}, y {}", corner.x, corner.y);
            faults.push(WorldFault::new("workspace", "all of it on the table top", got).hint(hint));
        }
    }

    fn check_robot(&self, robot: &RobotModel, faults: &mut Vec<WorldFault>) {
        if self.robot.name != robot.name {
            faults.push(WorldFault::new("robot.name", format!("`{}`", robot.name), format!("`{}`", self.robot.name)));
        }
        let hash = robot.physics_hash();
        if self.robot.physics_hash != hash {
            let hint = "the world was made with another version of this robot; omit the line to use the current one";
            faults.push(WorldFault::new("robot.physics_hash", hash, &self.robot.physics_hash).hint(hint));
        }
        if self.robot.home.len() != robot.arm_dof() {
            let expected = format!("{} joint positions", robot.arm_dof());
            faults.push(WorldFault::new("robot.home", expected, self.robot.home.len()));
        }
        let start = self.robot.start.as_deref();
        if let Some(start) = start.filter(|start| start.len() != robot.arm_dof()) {
            let expected = format!("{} joint positions", robot.arm_dof());
            faults.push(WorldFault::new("robot.start", expected, start.len()));
        }
        faults.extend(self.physics.arm.iter().flat_map(|arm| arm.faults_of_lengths(robot)));
        for (place, joints) in [("home", Some(self.robot.home.as_slice())), ("start", start)] {
            for (index, (joint, &at)) in robot.arm_joints().zip(joints.unwrap_or_default()).enumerate() {
                if !(joint.lower..=joint.upper).contains(&at) {
                    let expected = format!("{} to {} ({})", joint.lower, joint.upper, joint.name);
                    faults.push(WorldFault::new(format!("robot.{place}[{index}]"), expected, at));
                }
            }
        }
    }
}

/// Adds the faults of the parts that can be validated on their own; `None` for parts that could not be read.
pub(super) fn check_parts(
    cameras: &[Camera],
    physics: Option<&PhysicsSettings>,
    relations: Option<&RelationSettings>,
    faults: &mut Vec<WorldFault>,
) {
    for (index, camera) in cameras.iter().enumerate() {
        let twin = cameras[..index].iter().any(|other| other.name == camera.name);
        check_camera(camera, twin, &format!("cameras[{index}]"), faults);
    }
    if let Some(physics) = physics {
        check_physics(physics, faults);
    }
    if let Some(relations) = relations {
        check_relations(relations, faults);
    }
}

/// All faults of a list of cameras, duplicate names included.
pub fn camera_faults(cameras: &[Camera]) -> Vec<WorldFault> {
    let mut faults = Vec::new();
    check_parts(cameras, None, None, &mut faults);
    faults
}

fn check_surface(surface: &SupportSurface, place: &str, faults: &mut Vec<WorldFault>) {
    let id = surface.id.as_str();
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let is_id = id.len() <= 40 && id.chars().next().is_some_and(|c| c.is_ascii_lowercase()) && id.chars().all(fits);
    if !is_id || ["robot", "floor", "object"].contains(&id) {
        let expected = "lower-case letters, digits and _, starting with a letter; not `robot`, `floor` or `object`";
        faults.push(WorldFault::new(format!("{place}.id"), expected, format!("`{id}`")));
    }
    if surface.name.trim().is_empty() {
        faults.push(WorldFault::new(format!("{place}.name"), "a display name", "an empty name"));
    }
    if !surface.top_center_m.is_finite() || !surface.yaw_rad.is_finite() {
        faults.push(WorldFault::new(format!("{place}.top_center_m"), "finite numbers", surface.top_center_m));
    }
    let is_size = |size: glam::DVec3| size.is_finite() && size.min_element() > 0.0 && size.max_element() <= MAX_SIDE_M;
    if !is_size(surface.size_m) {
        let expected = format!("three lengths above 0 and up to {MAX_SIDE_M} m");
        faults.push(WorldFault::new(format!("{place}.size_m"), expected, surface.size_m));
    }
    for (index, board) in surface.boards.iter().enumerate() {
        if !is_size(board.size_m) || !board.center_m.is_finite() {
            let expected = format!("three lengths above 0 and up to {MAX_SIDE_M} m");
            faults.push(WorldFault::new(format!("{place}.boards[{index}]"), expected, board.size_m));
        }
    }
    if !(surface.friction.is_finite() && surface.friction >= 0.0) {
        faults.push(WorldFault::new(format!("{place}.friction"), "0 or more", surface.friction));
    }
    let half = surface.size_m.truncate().min_element() * 0.5;
    if !(0.0..half.max(f64::MIN_POSITIVE)).contains(&surface.edge_margin_m) {
        let expected = format!("0 to less than half the shorter side, {half} m");
        faults.push(WorldFault::new(format!("{place}.edge_margin_m"), expected, surface.edge_margin_m));
    }
}

/// Validates a camera; `place` is its field path, `twin` is true if an earlier camera has the same name.
fn check_camera(camera: &Camera, twin: bool, place: &str, faults: &mut Vec<WorldFault>) {
    let fits = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if camera.name.is_empty() || camera.name.len() > 40 || !camera.name.chars().all(fits) {
        let expected = "1 to 40 letters, digits, - and _: it names files and columns";
        faults.push(WorldFault::new(format!("{place}.name"), expected, format!("`{}`", camera.name)));
    }
    if twin {
        faults.push(WorldFault::new(format!("{place}.name"), "a unique name", format!("`{}`", camera.name)));
    }
    let k = &camera.intrinsics;
    if ![k.width, k.height].iter().all(|side| (1..=MAX_PIXELS).contains(side)) {
        let expected = format!("1 to {MAX_PIXELS} pixels along each side");
        faults.push(WorldFault::new(format!("{place}.intrinsics"), expected, format!("{}x{}", k.width, k.height)));
    }
    if !(k.fx.is_finite() && k.fx > 0.0 && k.fy.is_finite() && k.fy > 0.0 && k.cx.is_finite() && k.cy.is_finite()) {
        let got = format!("fx {}, fy {}, cx {}, cy {}", k.fx, k.fy, k.cx, k.cy);
        faults.push(WorldFault::new(format!("{place}.intrinsics"), "finite numbers, fx and fy above 0", got));
    }
    if camera.distortion.is_some_and(|lens| lens.pinhole(k).is_none()) {
        let expected = "an invertible lens that stretches no edge more than twofold";
        let got = format!("{:?}", camera.distortion.unwrap_or_default());
        let hint = "coefficients are k1, k2, p1, p2, k3 in the order of OpenCV; |k1| is rarely above 0.4";
        faults.push(WorldFault::new(format!("{place}.distortion"), expected, got).hint(hint));
    }
    for (field, expected, got) in camera.sensor.iter().flat_map(CameraSensor::faults) {
        faults.push(WorldFault::new(format!("{place}.sensor.{field}"), expected, got));
    }
}

fn fault_of_look(look: &AppearanceRandomisation) -> Option<WorldFault> {
    if !(0.0..=1.0).contains(&look.strength) {
        return Some(WorldFault::new("look.strength", "0 to 1", look.strength));
    }
    let has_camera = look.vary.contains(&AppearanceFactor::Camera);
    let fault = || WorldFault::new("look.vary", "light, background, material or objects", "`camera`");
    has_camera.then(|| fault().hint("camera poses are set in `cameras`; change them there"))
}

fn check_physics(physics: &PhysicsSettings, faults: &mut Vec<WorldFault>) {
    let (control, steps) = (physics.control_rate_hz, physics.physics_rate_hz);
    if control == 0 {
        faults.push(WorldFault::new("physics.control_rate_hz", "at least 1", control));
    }
    if steps == 0 || !steps.is_multiple_of(control.max(1)) {
        let expected = format!("a whole multiple of the control rate of {control} Hz");
        faults.push(WorldFault::new("physics.physics_rate_hz", expected, steps));
    }
    if !(0.1..=10.0).contains(&physics.pad_friction) {
        faults.push(WorldFault::new("physics.pad_friction", "a factor of 0.1 to 10", physics.pad_friction));
    }
    faults.extend(physics.arm.iter().flat_map(ArmPhysics::faults_of_values));
    if !physics.gravity_m_s2.is_finite() {
        faults.push(WorldFault::new("physics.gravity_m_s2", "a finite number", physics.gravity_m_s2));
    }
    if !physics.rotational_friction_m.iter().all(|value| value.is_finite() && *value >= 0.0) {
        let got = format!("{:?}", physics.rotational_friction_m);
        faults.push(WorldFault::new("physics.rotational_friction_m", "two numbers of 0 or more", got));
    }
}

impl ArmPhysics {
    /// All faults of these dynamics for the arm of a robot.
    pub fn faults(&self, robot: &RobotModel) -> Vec<WorldFault> {
        let mut faults = self.faults_of_lengths(robot);
        faults.extend(self.faults_of_values());
        faults
    }

    fn faults_of_lengths(&self, robot: &RobotModel) -> Vec<WorldFault> {
        let joints = robot.arm_dof();
        let fault = |(name, values): (&str, &[f64])| {
            let expected = format!("{joints} values, one per joint, or none");
            WorldFault::new(format!("physics.arm.{name}"), expected, values.len())
        };
        self.lists().into_iter().filter(|(_, values)| !values.is_empty() && values.len() != joints).map(fault).collect()
    }

    /// Faults that do not depend on the robot.
    fn faults_of_values(&self) -> Vec<WorldFault> {
        let mut faults = Vec::new();
        for (name, values) in self.lists() {
            if let Some(value) = values.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
                faults.push(WorldFault::new(format!("physics.arm.{name}"), "numbers of 0 or more", value));
            }
        }
        if !(0.0..=Self::MAX_LATENCY_S).contains(&self.latency_s) {
            let expected = format!("0 to {} s", Self::MAX_LATENCY_S);
            faults.push(WorldFault::new("physics.arm.latency_s", expected, self.latency_s));
        }
        faults
    }
}

fn check_relations(relations: &RelationSettings, faults: &mut Vec<WorldFault>) {
    let lengths = [
        ("close_m", relations.close_m),
        ("touching_gap_m", relations.touching_gap_m),
        ("sinking_m", relations.sinking_m),
        ("support_area_ratio", relations.support_area_ratio),
        ("between_angle_rad", relations.between_angle_rad),
        ("state_hysteresis", relations.state_hysteresis),
        ("window_margin_m", relations.window_margin_m),
    ];
    for (name, value) in lengths {
        if !(value.is_finite() && value >= 0.0) {
            faults.push(WorldFault::new(format!("relations.{name}"), "0 or more", value));
        }
    }
    for (name, value) in [("inside_share", relations.inside_share), ("support_overlap", relations.support_overlap)] {
        if !(0.0..=1.0).contains(&value) {
            faults.push(WorldFault::new(format!("relations.{name}"), "a share from 0 to 1", value));
        }
    }
}
