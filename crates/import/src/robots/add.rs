//! Robot files from a URDF: the arm, with proposed values for properties that a URDF lacks, and one of the program's
//! grippers mounted on it.

use genmanip_assets::AssetError;
use genmanip_assets::robots::{self as registry, PartKind, compose};
use genmanip_core::glam::{DMat3, DQuat, DVec3, EulerRot};
use genmanip_core::{JointKind, MassProperties, Material, Pose, RobotLink, RobotModel};
use genmanip_motion::{AllowedCollisions, CollisionWorld, Planner, PlannerSettings, PlanningScene, triangulate};
use genmanip_workspace::WorkspaceError;
use serde_json::{Value, json};

use super::hulls::hull;
use super::tool_frame::behind_fingers;
use super::{PlannedRobot, mount};
use crate::collision::hull::convex_hull;
use crate::units_and_frame::transformed_mass;

/// Default gripper, and (`SMALL_GRIPPER`) that of an arm whose links are in sum shorter than `SMALL_M`.
pub const GRIPPER: &str = "panda_hand";
const SMALL_GRIPPER: &str = "small_jaws";
const SMALL_M: f64 = 0.6;
/// Density of a link that states no mass, over the volume of its hulls, kg/m³. Chosen by hand.
const DENSITY: f64 = 800.0;
/// Minimum mass of a link, kg, and (`LEAST_INERTIA`) minimum moment of inertia, kg·m². Chosen by hand.
const LEAST_MASS_KG: f64 = 0.01;
const LEAST_INERTIA: f64 = 1e-6;
/// Natural frequency of a driven joint, rad/s; gains give critical damping for the inertia that the joint moves.
const FREQUENCY: f64 = 45.0;
/// Mass of payload and gripper for which the gains are computed, kg. Chosen by hand.
const PAYLOAD_KG: f64 = 1.5;
/// Minimum and maximum proposed acceleration [rad/s² or m/s²], and (`JERK_PER_ACCELERATION`) ratio of jerk to
/// acceleration [1/s]. Chosen by hand.
const ACCELERATIONS: [f64; 2] = [1.0, 12.0];
const JERK_PER_ACCELERATION: f64 = 400.0;
/// Heights (m) of the tool centre point and tilts (rad) of the gripper from pointing down at which a home configuration
/// is sought, in order of preference: an arm that is too short to point down above the objects looks ahead.
/// Chosen by hand.
const HOMES: [(&[f64], &[f64]); 3] = [
    (&[0.45, 0.38, 0.32, 0.25], &[0.0]),
    (&[0.28, 0.24, 0.2], &[0.5, 0.8, 1.1, 1.4]),
    (&[0.18, 0.14, 0.11, 0.09, 0.07], &[0.0]),
];
/// Height of the tool centre point at which the reach is measured, m. Chosen by hand.
const PICK_M: f64 = 0.05;
/// Step between the tested horizontal distances from the base's z axis, m. Chosen by hand.
const STEP_M: f64 = 0.025;
/// Minimum clearance of proposed configurations, m; link pairs within twice this distance at nearly every configuration
/// are excluded from self-collision checks.
const NEAR_M: f64 = 0.003;

/// Files of a new robot.
#[derive(Debug)]
pub struct Proposal {
    /// Name of robot and arm.
    pub name: String,
    /// Contents of `arms/NAME.json`, the arm's file.
    pub arm: Value,
    /// Contents of `NAME.json`, which combines arm and gripper.
    pub robot: Value,
    /// Robot model composed of these files.
    pub model: RobotModel,
    /// Name and value of each proposed property, as text for the user.
    pub proposals: Vec<[String; 2]>,
    /// Assumptions and omissions, one sentence each.
    pub notes: Vec<String>,
}

/// Proposes the files of a robot from its description, which was read with its visible surfaces; `gripper` is chosen by
/// the size of the arm if it is `None`.
///
/// # Errors
/// If no joint moves the tool frame, one of them follows another joint, or the files would be invalid.
pub fn propose(read: PlannedRobot, name: &str, gripper: Option<&str>) -> Result<Proposal, WorkspaceError> {
    let PlannedRobot { model: mut described, mut notes } = read;
    let gripper = gripper.unwrap_or(if stretched_m(&described) < SMALL_M { SMALL_GRIPPER } else { GRIPPER });
    let own_hand = mount::own_hand(&described);
    if let Some(hand) = own_hand {
        // Its shapes would collide with those of the gripper that replaces it.
        let replaced: Vec<usize> = (hand..described.links.len())
            .filter(|&link| link == hand || mount::is_fixed_to(&described, link, hand))
            .filter(|&link| !described.links[link].pieces.is_empty() || !described.links[link].visual.is_empty())
            .collect();
        for &link in &replaced {
            described.links[link].pieces.clear();
            described.links[link].visual.clear();
        }
        if !replaced.is_empty() {
            let names: Vec<&str> = replaced.iter().map(|&link| described.links[link].name.as_str()).collect();
            notes.push(format!(
                "{gripper} replaces the URDF's own hand, whose shapes are left out: {}",
                names.join(", ")
            ));
        }
    }
    let kept = kept_links(&described);
    let dropped: Vec<&str> = (0..described.links.len())
        .filter(|link| !kept.contains(link) && described.links[*link].joint.is_some())
        .map(|link| described.links[link].name.as_str())
        .collect();
    if !dropped.is_empty() {
        notes.push(format!("left out, since no joint of theirs moves the tool frame: {}", dropped.join(", ")));
    }
    let mut coupled = kept.iter().filter_map(|&link| {
        let joint = described.links[link].joint.as_ref()?;
        Some((joint, described.links[joint.mimic?.link].joint.as_ref()?))
    });
    if let Some((joint, leader)) = coupled.next() {
        let reason = format!("joint {} follows {} on the way to the tool frame", joint.name, leader.name);
        return Err(WorkspaceError::input(format!("{} cannot become a robot file", described.name)).because(reason).with_hint(
            "the joints of a robot file move independently; plan --robot FILE.urdf takes such an arm, and --tip names \
             a tool frame before that joint",
        ));
    }
    let mut mount = mount::mount(&described, own_hand, gripper).map_err(refused)?;
    let arm = Arm { described: &described, kept: &kept, name };
    let dynamics = arm.dynamics(&mut notes);
    let mut home: Vec<f64> = arm.joints().map(|link| arm.middle(link)).collect();
    let mut reach = None;
    let written = |home: &[f64], reach: Option<[f64; 3]>, never: &[[String; 2]], mount: &Pose| {
        (arm.file(&dynamics, home, reach), robot_file(name, gripper, mount, never))
    };
    let composed = |files: &(Value, Value)| {
        let find = |kind: PartKind, wanted: &str| match (kind, wanted == name) {
            (PartKind::Arm, true) => Ok(files.0.to_string()),
            _ => registry::find(kind, wanted),
        };
        compose(&format!("{name}.json"), &files.1.to_string(), &find).map_err(refused)
    };
    // First composed with a home at the middle of the joint ranges, to find the link pairs to exclude, then with the
    // home and reach found.
    let reached = |mount: &Pose| {
        let first = composed(&written(&home, None, &[], mount))?;
        let near = genmanip_motion::always_near(&first, 2.0 * NEAR_M)
            .map_err(|error| WorkspaceError::broken("the robot's shapes cannot be compiled", error))?;
        let never: Vec<[String; 2]> =
            near.iter().map(|&(a, b)| [first.links[a].name.clone(), first.links[b].name.clone()]).collect();
        let planner = planner(composed(&written(&home, None, &never, mount))?)?;
        Ok::<_, WorkspaceError>((never, Reached::of(&planner)))
    };
    let (mut never, mut found) = reached(&mount)?;
    if found.is_none() && ends_in_slide(&described) {
        // Where a slide carries the tool, its place does not tell which way it points.
        let over = Pose::new(-mount.position, mount.rotation * DQuat::from_rotation_x(std::f64::consts::PI));
        let (other_never, other) = reached(&over)?;
        if other.is_some() {
            (mount, never, found) = (over, other_never, other);
        }
    }
    if let Some(found) = &found {
        home.clone_from(&found.home);
        reach = Some([found.farthest_m, found.from_above_m[0], found.from_above_m[1]]);
    } else {
        notes.push(
            "no posture with the gripper pointing down was found: home is the middle of every range, and reach is left \
             out; edit the file, or try another --tip"
                .into(),
        );
    }
    let (arm_file, robot) = written(&home, reach, &never, &mount);
    let model = composed(&(arm_file.clone(), robot.clone()))?;
    let rounded = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(", ");
    let mut proposals = vec![
        ["tool frame".into(), described.links[described.hand].name.clone()],
        ["gripper".into(), mounted(gripper, &mount)],
        ["joints".into(), arm.joints().map(|link| arm.joint(link).name.as_str()).collect::<Vec<_>>().join(", ")],
        ["home, rad".into(), rounded(&home)],
        ["kp, N·m/rad".into(), rounded(&dynamics.iter().map(|joint| joint.kp).collect::<Vec<_>>())],
    ];
    if let Some([farthest, near, far]) = reach {
        proposals.push(["reach, m".into(), format!("{farthest:.2}; from above {near:.2} to {far:.2}")]);
    }
    Ok(Proposal { name: name.to_owned(), arm: arm_file, robot, model, proposals, notes })
}

fn refused(error: AssetError) -> WorkspaceError {
    WorkspaceError::input("the robot's files would be refused".to_owned())
        .because(error)
        .with_hint("docs/guides/your-own-robot.md explains every key; --gripper names another gripper")
}

fn planner(model: RobotModel) -> Result<Planner, WorkspaceError> {
    Planner::new(std::sync::Arc::new(model), PlannerSettings::default())
        .map_err(|error| WorkspaceError::broken("the robot cannot be planned for", error))
}

/// Indices of the links that are moved only by joints before the tool frame, without fingers.
fn kept_links(robot: &RobotModel) -> Vec<usize> {
    let mut carriers = vec![robot.hand];
    while let Some(parent) = robot.links[carriers[carriers.len() - 1]].parent {
        carriers.push(parent);
    }
    let fingers = behind_fingers(&robot.links);
    let mut kept: Vec<usize> = Vec::new();
    for (index, link) in robot.links.iter().enumerate() {
        let carries = carriers.contains(&index);
        let rides = link.joint.is_none() && link.parent.is_some_and(|parent| kept.contains(&parent));
        if carries || rides && !fingers[index] || link.parent.is_none() {
            kept.push(index);
        }
    }
    kept
}

/// Sum of the distances between the origins of the links on the way to the tool frame, m.
fn stretched_m(robot: &RobotModel) -> f64 {
    let mut link = robot.hand;
    let mut sum = robot.links[link].parent_from_link.position.length();
    while let Some(parent) = robot.links[link].parent {
        link = parent;
        sum += robot.links[link].parent_from_link.position.length();
    }
    sum
}

/// True if one of the last two joints before the tool frame is a slide.
fn ends_in_slide(robot: &RobotModel) -> bool {
    let mut kinds = Vec::new();
    let mut link = Some(robot.hand);
    while let Some(index) = link {
        kinds.extend(robot.links[index].joint.as_ref().map(|joint| joint.kind));
        link = robot.links[index].parent;
    }
    kinds.iter().take(2).any(|kind| *kind == JointKind::Prismatic)
}

fn rpy_deg(rotation: DQuat) -> [f64; 3] {
    let (yaw, pitch, roll) = rotation.to_euler(EulerRot::ZYX);
    [roll, pitch, yaw].map(f64::to_degrees).map(|angle| (angle * 1e6).round() / 1e6)
}

/// Description of a gripper's mount.
fn mounted(gripper: &str, mount: &Pose) -> String {
    let turned = format!("{gripper}, turned by {:?} deg", rpy_deg(mount.rotation).map(f64::round));
    match mount.position.length() {
        0.0 => turned,
        away => format!("{turned}, {:.0} mm from the tool frame", away * 1e3),
    }
}

fn robot_file(name: &str, gripper: &str, mount: &Pose, never: &[[String; 2]]) -> Value {
    json!({
        "schema": PartKind::Robot.schema(), "name": name, "on": name, "gripper": gripper,
        "mount": {"position": mount.position, "rpy_deg": rpy_deg(mount.rotation)},
        "never_colliding": never,
    })
}

/// Arm from which the files are written.
struct Arm<'a> {
    described: &'a RobotModel,
    kept: &'a [usize],
    name: &'a str,
}

/// Proposed drive of a joint: gains and limits.
struct Dynamics {
    kp: f64,
    kv: f64,
    acceleration: f64,
    effort: f64,
}

impl Arm<'_> {
    fn joints(&self) -> impl Iterator<Item = usize> + '_ {
        self.kept.iter().copied().filter(|link| self.described.links[*link].joint.is_some())
    }

    fn joint(&self, link: usize) -> &genmanip_core::RobotJoint {
        self.described.links[link].joint.as_ref().expect("a moving link")
    }

    fn middle(&self, link: usize) -> f64 {
        let joint = self.joint(link);
        if joint.lower < 0.0 && joint.upper > 0.0 { 0.0 } else { 0.5 * (joint.lower + joint.upper) }
    }

    /// Gains and limits from the inertia that each joint moves at the description's home: 0, or the middle of a range
    /// that excludes 0.
    fn dynamics(&self, notes: &mut Vec<String>) -> Vec<Dynamics> {
        let poses = self.described.link_poses(&self.described.home, 0.0);
        let masses: Vec<(usize, MassProperties)> = self.kept.iter().map(|&link| (link, self.mass(link))).collect();
        let is_behind = |mut link: usize, joint: usize| loop {
            if link == joint {
                return true;
            }
            match self.described.links[link].parent {
                Some(parent) => link = parent,
                None => return false,
            }
        };
        let tool = poses[self.described.hand].position;
        let mut proposed = Vec::new();
        for link in self.joints().collect::<Vec<_>>() {
            let joint = self.joint(link);
            let (origin, axis) = (poses[link].position, poses[link].transform_vector(joint.axis));
            let lever = |at: DVec3| match joint.kind {
                JointKind::Revolute => (at - origin - axis * (at - origin).dot(axis)).length_squared(),
                JointKind::Prismatic => 1.0,
            };
            let own = masses.iter().filter(|(body, _)| is_behind(*body, link));
            let own: f64 =
                own.map(|(body, mass)| mass.mass_kg * lever(poses[*body].transform_point(mass.center))).sum();
            let moved = own + PAYLOAD_KG * lever(tool) + 0.01;
            let weight: f64 =
                9.81 * (moved * (masses.iter().map(|(_, mass)| mass.mass_kg).sum::<f64>() + PAYLOAD_KG)).sqrt();
            let mut effort = joint.max_effort;
            if effort <= 1.0 {
                effort = (3.0 * weight).ceil();
                notes.push(format!("joint {} states no effort: {effort} is assumed", joint.name));
            }
            let spare = (effort - weight).max(0.2 * effort);
            proposed.push(Dynamics {
                kp: (moved * FREQUENCY * FREQUENCY).max(50.0).round(),
                kv: (2.0 * moved * FREQUENCY).max(2.0).round(),
                acceleration: (0.5 * spare / moved).clamp(ACCELERATIONS[0], ACCELERATIONS[1]),
                effort,
            });
        }
        proposed
    }

    /// Mass of a link as stated, or from the volume of its hulls.
    fn mass(&self, link: usize) -> MassProperties {
        let RobotLink { mass, pieces, .. } = &self.described.links[link];
        if mass.mass_kg > LEAST_MASS_KG {
            return *mass;
        }
        let mut sum: Option<MassProperties> = None;
        for piece in pieces {
            let Some((corners, triangles)) = solid(piece) else { continue };
            let loose: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|index| corners[index as usize])).collect();
            let moments = genmanip_assets::solid::Moments::of_surface(&loose);
            if !(moments.volume > 0.0 && moments.center.is_finite()) {
                continue;
            }
            let own = moments.with_mass(moments.volume * DENSITY);
            sum = Some(sum.map_or(own, |sum| crate::formats::urdf::combined(&sum, &own)));
        }
        let small =
            MassProperties { mass_kg: LEAST_MASS_KG, center: DVec3::ZERO, inertia: DMat3::IDENTITY * LEAST_INERTIA };
        sum.filter(|sum| sum.mass_kg > LEAST_MASS_KG).unwrap_or(small)
    }

    fn file(&self, dynamics: &[Dynamics], home: &[f64], reach: Option<[f64; 3]>) -> Value {
        let mut drives = dynamics.iter();
        let name = |link: usize| self.described.links[link].name.as_str();
        let links: Vec<Value> = self
            .kept
            .iter()
            .map(|&link| {
                let RobotLink { parent, parent_from_link, joint, visual, pieces, .. } = &self.described.links[link];
                let mass = transformed_mass(&self.mass(link), &Pose::IDENTITY);
                let inertia = positive(mass.inertia);
                let mut parts: Vec<Value> = visual.iter().map(visible).collect();
                parts.extend(pieces.iter().filter_map(solid).map(|(corners, triangles)| {
                    json!({"mesh": {"positions": corners.iter().map(rounded).collect::<Vec<_>>(), "triangles": triangles, "solid": true}})
                }));
                let mut file = json!({
                    "name": name(link),
                    "position": parent_from_link.position, "rpy_deg": rpy_deg(parent_from_link.rotation),
                    "mass_kg": mass.mass_kg, "center": mass.center, "inertia": inertia, "parts": parts,
                });
                if let Some(parent) = parent {
                    file["parent"] = name(*parent).into();
                }
                if let (Some(joint), Some(drive)) = (joint, joint.as_ref().and_then(|_| drives.next())) {
                    file["joint"] = json!({
                        "name": joint.name, "kind": joint.kind, "axis": joint.axis,
                        "lower": joint.lower, "upper": joint.upper,
                        "max_velocity": joint.max_velocity, "max_acceleration": drive.acceleration,
                        "max_jerk": drive.acceleration * JERK_PER_ACCELERATION, "max_effort": drive.effort,
                    });
                    if joint.continuous {
                        file["joint"]["continuous"] = true.into();
                    }
                }
                file
            })
            .collect();
        let never: Vec<[&str; 2]> = self
            .described
            .never_colliding
            .iter()
            .filter(|(a, b)| self.kept.contains(a) && self.kept.contains(b))
            .map(|&(a, b)| [name(a), name(b)])
            .collect();
        let mut file = json!({
            "schema": PartKind::Arm.schema(), "name": self.name,
            "sources": {
                "kinematics": format!("URDF of {}", self.described.name),
                "drives": "proposed from the inertia that each joint moves; check them against the maker's figures",
                "acceleration": "proposed; not part of URDF",
            },
            "tool_link": name(self.described.hand), "home": home,
            "drives": {
                "kp": dynamics.iter().map(|joint| joint.kp).collect::<Vec<_>>(),
                "kv": dynamics.iter().map(|joint| joint.kv).collect::<Vec<_>>(),
                "armature": 0.01, "damping": 0.1, "hull_friction": 0.3,
            },
            "links": links, "never_colliding": never,
        });
        if let Some([farthest, near, far]) = reach {
            file["reach"] = json!({"max_m": farthest, "from_above_m": [near, far]});
        }
        file
    }
}

/// Vertices of a piece, simplified to the limit of a collision part, and outward-facing triangles. `None` if the piece
/// has no hull.
fn solid(piece: &genmanip_core::Piece) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
    let (corners, _) = triangulate(piece).ok()?;
    convex_hull(&hull(corners)?.corners)
}

/// Inertia as [xx, yy, zz, xy, xz, yz], with diagonal entries of at least `LEAST_INERTIA`; the products of inertia are
/// set to 0 if the matrix would not be positive definite.
fn positive(inertia: DMat3) -> [f64; 6] {
    let [x, y, z] = [inertia.x_axis, inertia.y_axis, inertia.z_axis];
    let least = LEAST_INERTIA;
    let diagonal = [x.x.max(least), y.y.max(least), z.z.max(least)];
    let is_definite = DMat3::from_cols(
        DVec3::new(diagonal[0], x.y, x.z),
        DVec3::new(x.y, diagonal[1], y.z),
        DVec3::new(x.z, y.z, diagonal[2]),
    );
    let minor = diagonal[0] * diagonal[1] - x.y * x.y;
    if minor > 0.0 && is_definite.determinant() > 0.0 {
        return [diagonal[0], diagonal[1], diagonal[2], x.y, x.z, y.z];
    }
    [diagonal[0], diagonal[1], diagonal[2], 0.0, 0.0, 0.0]
}

fn rounded(point: &DVec3) -> [f64; 3] {
    point.to_array().map(|value| (value * 1e6).round() / 1e6)
}

fn visible(part: &genmanip_core::VisualPart) -> Value {
    let positions: Vec<[f64; 3]> = part
        .mesh
        .positions
        .iter()
        .map(|point| {
            rounded(&part.link_from_part.transform_point(point.as_dvec3())).map(|value| (value * 1e4).round() / 1e4)
        })
        .collect();
    let Material { base_color, roughness, metallic, .. } = part.material;
    let [r, g, b] = base_color.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8);
    json!({"mesh": {
        "name": "body", "positions": positions, "triangles": part.mesh.triangles,
        "finish": {"color": format!("#{r:02x}{g:02x}{b:02x}"), "rough": roughness, "metal": metallic > 0.5},
    }})
}

/// Home configuration and range of distances at which the tool reaches down from above.
struct Reached {
    home: Vec<f64>,
    farthest_m: f64,
    from_above_m: [f64; 2],
}

impl Reached {
    fn of(planner: &Planner) -> Option<Self> {
        let robot = planner.robot();
        let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
        let around =
            PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width: robot.gripper.max_width };
        let checker = planner.checker(&around, NEAR_M);
        let down = DQuat::from_rotation_x(std::f64::consts::PI);
        let posture = |distance: f64, height: f64, tilt: f64, reference: &[f64]| {
            let yaws = [0.0, 0.5, 1.0, 1.5].map(|quarter| quarter * std::f64::consts::PI);
            yaws.into_iter().find_map(|yaw| {
                let turned = DQuat::from_rotation_y(-tilt) * DQuat::from_rotation_z(yaw) * down;
                let pose = Pose::new(DVec3::new(distance, 0.0, height), turned);
                planner.ik(&pose, reference).into_iter().find(|config| checker.is_free(config))
            })
        };
        let stretched: f64 = robot.links.iter().map(|link| link.parent_from_link.position.length()).sum();
        let steps = (1..).map(|step| f64::from(step) * STEP_M).take_while(|distance| *distance < stretched);
        let reached: Vec<f64> =
            steps.filter(|distance| posture(*distance, PICK_M, 0.0, &robot.home).is_some()).collect();
        let from_above_m = longest_run(&reached)?;
        let middle = 0.5 * (from_above_m[0] + from_above_m[1]);
        let home = HOMES.into_iter().find_map(|(heights, tilts)| {
            let poses = heights.iter().flat_map(|height| tilts.iter().map(move |tilt| (*height, *tilt)));
            poses.into_iter().find_map(|(height, tilt)| {
                let places = [1.0, 0.85, 1.15, 0.7, 1.3].map(|share| share * middle);
                places.into_iter().find_map(|distance| posture(distance, height, tilt, &robot.home))
            })
        })?;
        Some(Self { home, farthest_m: stretched.min(from_above_m[1] * 1.2), from_above_m })
    }
}

/// Ends of the longest run of distances without a gap; `None` if it is not longer than two steps.
fn longest_run(distances: &[f64]) -> Option<[f64; 2]> {
    let mut best: Option<[f64; 2]> = None;
    let mut start = 0;
    for (index, &distance) in distances.iter().enumerate() {
        if index > 0 && distance - distances[index - 1] > 1.5 * STEP_M {
            start = index;
        }
        let run = [distances[start], distance];
        if best.is_none_or(|best| run[1] - run[0] > best[1] - best[0]) {
            best = Some(run);
        }
    }
    best.filter(|run| run[1] - run[0] > 2.0 * STEP_M)
}
