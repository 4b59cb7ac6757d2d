//! Settings of the agent with their defaults.
//!
//! "Chosen" marks values tuned by hand on oracle episodes: kept if they reduced the number of failures.

use genmanip_motion::FeasibilitySettings;
use serde::{Deserialize, Serialize};

use crate::perception::CellSettings;

/// Settings of the agent: questions, views, motions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentSettings {
    /// Preset that these settings start from.
    pub preset: Preset,
    /// Form in which the model answers with a placement.
    pub path: PathKind,
    /// Coarse-to-fine grasping: after the object, the model is asked for the part to grasp.
    pub ctof: bool,
    /// Draw the robot's direction arrows on images.
    pub arrows: bool,
    /// Ask the model to state its reasoning before the answer.
    pub reasoning: bool,
    /// Cameras whose depth is used; the first one is shown to models.
    pub cameras: Vec<String>,
    /// Image width and height (px); `None` for each camera's own.
    pub size: Option<[u32; 2]>,
    /// Standard deviation of a measured depth of 1 m (m); it grows with the square of the depth. 0 for perfect depth.
    /// If not 0, depth is smoothed along surfaces, and points closer to the table or the robot than the error are
    /// attributed to them.
    #[serde(default, skip_serializing_if = "is_perfect")]
    pub depth_error_m: f64,
    /// Maximum number of task decompositions.
    pub rounds: usize,
    /// Maximum picks per sub-task.
    pub picks: usize,
    /// Maximum retries after an invalid answer.
    pub reasks: usize,
    /// Check the gripper width after each pick and pick again if nothing is held.
    pub look_again: bool,
    /// Show the other cameras' images if the object is not found in the first one.
    pub other_views: bool,
    /// Ask for grab point and placement concurrently. The placement question then marks the mask's middle pixel as its
    /// start instead of the grab point.
    pub asks_at_once: bool,
    /// Questions that are asked: all, or those whose answer matters.
    pub asks: Asks,
    /// Start a new round with the remaining sub-tasks reported by the check; otherwise, or if it reports none,
    /// decompose again.
    pub check_splits: bool,
    /// Maximum grasps tried per pick, best first.
    pub grasps: usize,
    /// Maximum distance of a grasp from the grab point (m).
    pub grasp_radius_m: f64,
    /// Settings of the conversion from grid cells to placement targets.
    pub cells: CellSettings,
    /// Ask for a cell of a finer grid where a coarse cell is ambiguous: between objects, where it shows several surfaces,
    /// and where at least two objects stand close to the place.
    #[serde(default)]
    pub fine_cells: bool,
    /// Yaw changes of the object to try if the model does not give one (degrees).
    pub turns_deg: Vec<f64>,
    /// Height of the table surface, world z (m).
    pub table_m: f64,
    /// Motion settings.
    pub motion: MotionSettings,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde asks for")]
fn is_perfect(error_m: &f64) -> bool {
    *error_m == 0.0
}

/// A named set of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// As published: three rounds, only the best grasp, no check after a pick, plain cell centres.
    Paper,
    /// All robustness features, beyond the published agent.
    Full,
}

/// Questions that the agent asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Asks {
    /// All, as published: a grab point for every pick, a check after every placement, everything again after a failure.
    /// Placements are tried one by one, each from all heights, as when the answers that exist were recorded.
    Every,
    /// Those whose answer matters: a grab point if several parts of the object compete for the grasp, a check if the
    /// next sub-task names the object that was placed or none is left, no new placement after a failed grasp. Questions
    /// after a failure say what was tried. All placements are tried low before any is tried from higher up.
    Needed,
}

impl Asks {
    /// All values, in the order of their names in help texts.
    pub const ALL: [Self; 2] = [Self::Every, Self::Needed];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Every => "every",
            Self::Needed => "needed",
        }
    }
}

/// Form in which the model answers with a placement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PathKind {
    /// One cell, where the object is placed.
    P2p,
    /// A path over the grid with heights and yaw.
    Grid,
}

/// Settings of motion planning and execution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSettings {
    /// Feasibility criteria of grasps and placements.
    pub feasibility: FeasibilitySettings,
    /// Fallback clearance if nothing else works (m).
    pub tight_clearance_m: f64,
    /// Fallback length of straight approach and lift motions (m), near the reach limit.
    pub short_m: f64,
    /// Maximum nodes of one RRT search. A failed search uses all of them, and a pick may try many grasps.
    pub search_nodes: usize,
    /// Maximum failed searches per pick; for placements, maximum targets with a failed search.
    pub searches: usize,
    /// Difference between grasp width and commanded width while holding (m).
    pub squeeze_m: f64,
    /// Minimum difference between measured and commanded width that counts as holding an object (m).
    pub held_m: f64,
    /// Maximum release height above an open surface (m); cavities allow any height.
    pub max_open_release_m: f64,
    /// Height above the receiver's rim from which the object is lowered (m).
    pub rim_clearance_m: f64,
    /// Fraction of the joint limits used with an empty gripper.
    pub empty_speed: f64,
    /// Fraction of the joint limits used while holding an object.
    pub loaded_speed: f64,
    /// Fraction of the joint limits used for straight approach, lift, lowering and retreat.
    pub careful_speed: f64,
    /// Control steps for closing or opening the fingers.
    pub finger_steps: usize,
    /// Control steps to wait for the arm to come to rest.
    pub rest_steps: usize,
}

impl AgentSettings {
    /// The settings of a preset.
    pub fn preset(preset: Preset) -> Self {
        let full = Self {
            preset,
            path: PathKind::P2p,
            ctof: false,
            arrows: true,
            // As published: the answer alone.
            reasoning: false,
            cameras: ["overview", "left", "right"].map(String::from).to_vec(),
            size: None,
            depth_error_m: 0.0,
            // As published.
            rounds: 3,
            // Chosen: a fifth pick never helped.
            picks: 4,
            // Chosen: models rarely succeed after three attempts.
            reasks: 2,
            look_again: true,
            other_views: true,
            asks_at_once: true,
            asks: Asks::Needed,
            check_splits: true,
            grasps: 48,
            // The default of GenManip's specification.
            grasp_radius_m: 0.08,
            cells: CellSettings::default(),
            fine_cells: true,
            // The initial yaw first, then other turns; the gripper itself is symmetric under half turns.
            turns_deg: vec![0.0, 90.0, 45.0, -45.0],
            table_m: 0.0,
            motion: MotionSettings::default(),
        };
        match preset {
            Preset::Full => full,
            Preset::Paper => Self {
                picks: 1,
                look_again: false,
                other_views: false,
                asks_at_once: false,
                asks: Asks::Every,
                check_splits: false,
                grasps: 1,
                cells: CellSettings { snap: false, ..CellSettings::default() },
                fine_cells: false,
                turns_deg: vec![0.0],
                ..full
            },
        }
    }
}

impl AgentSettings {
    /// Shows the image of this camera to the models; the depth of all cameras is still used.
    #[must_use]
    pub fn shown_by(mut self, camera: &str) -> Self {
        self.cameras.retain(|other| other != camera);
        self.cameras.insert(0, camera.to_owned());
        self
    }

    /// Open-loop variant: one decomposition, one pick per object, no checks.
    #[must_use]
    pub fn open_loop(self) -> Self {
        Self { rounds: 1, picks: 1, look_again: false, ..self }
    }
}

impl MotionSettings {
    /// Variant with shorter straight motions and less clearance, for poses near the reach limit.
    pub(crate) fn short(&self) -> FeasibilitySettings {
        FeasibilitySettings {
            clearance_m: self.tight_clearance_m,
            approach_m: self.short_m,
            lift_m: self.short_m,
            ..self.feasibility.clone()
        }
    }
}

impl Preset {
    /// Name of the preset in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Full => "full",
        }
    }
}

impl Default for MotionSettings {
    fn default() -> Self {
        Self {
            feasibility: FeasibilitySettings {
                // The object's points were checked against the fingers when the grasp was proposed; its hull is larger
                // than the object, so the gripper may penetrate it.
                object_clearance_m: None,
                finger_room_m: None,
                // Chosen: grasps from points are more expensive to check than precomputed ones.
                wanted: 24,
                configurations: 16,
                configurations_kept: 2,
                // Chosen: near the reach limit most configurations hit a joint limit along a straight motion.
                goal_configurations: 12,
                ..FeasibilitySettings::default()
            },
            // As the expert's.
            tight_clearance_m: 0.001,
            // Chosen: the fingers' length beyond the palm is 4.5 cm.
            short_m: 0.05,
            // Chosen: 50,000 nodes cost minutes per pick without a path, and the 40 episodes in examples/answers have
            // the same outcome.
            search_nodes: 2_000,
            searches: 8,
            squeeze_m: 0.015,
            // Chosen: a fifth of the squeeze; the width is measured to 0.1 mm.
            held_m: 0.003,
            // As the expert's.
            max_open_release_m: 0.02,
            rim_clearance_m: 0.03,
            empty_speed: 0.9,
            loaded_speed: 0.65,
            careful_speed: 0.5,
            finger_steps: 36,
            rest_steps: 6,
        }
    }
}
