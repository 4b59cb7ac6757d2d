//! GenManip in Rust: robot-manipulation tasks, physically valid scenes, verified demonstrations, datasets and
//! benchmarks, on a CPU.
//!
//! This crate re-exports the public interface of the workspace under short names. The program of the same name does
//! everything below from the command line.
//!
//! | goal | start here |
//! |---|---|
//! | tasks from rules or recorded answers | [`tasks`], [`workspace::task_files`] |
//! | a scene for a task | [`layout::lay_out`] |
//! | demonstrations of the expert in a run folder | [`pipeline::collect::collect`] |
//! | an episode of a policy of your own | [`core::Policy`], [`rollout::run_episode`] |
//! | success rates with intervals | [`pipeline::evaluate::evaluate`] |
//! | datasets | [`data::lerobot::export`], [`dataset_tools`] |
//! | images | [`viz`], [`render`] |
//! | collision-free motions of any arm | [`motion::Planner`] |
//! | objects from files | [`import`](mod@import) |
//!
//! Complete programs are in `examples/rust`: `cargo run --release -p genmanip --example layout`.
//!
//! ```
//! use genmanip::assets::{Catalogue, GraspLibrary, worlds};
//! use genmanip::core::{Seed, TaskKind};
//! use genmanip::layout::{LayoutSettings, lay_out};
//! use genmanip::motion::PlannerSettings;
//! use genmanip::tasks::designer::{DesignSettings, design_many};
//! use genmanip::workspace::worlds::planner;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (catalogue, world, seed) = (Catalogue::builtin(), worlds::default_world(), Seed::new(7));
//! let designed = design_many(&[TaskKind::PickAndPlace], 1, catalogue.cards(), seed, &DesignSettings::default())?;
//! let (task, planner) = (&designed.tasks[0], planner(&world, &PlannerSettings::default())?);
//! let grasps = GraspLibrary::builtin();
//! let scenario = lay_out(task, catalogue, &world, &planner, grasps, seed, &LayoutSettings::default())?;
//! assert_eq!(scenario.objects.len(), task.scene_graph.nodes.len());
//! # Ok(())
//! # }
//! ```
//!
//! Conventions: the world frame is the robot's base frame (x away from the robot, y to its left, z up); units are SI;
//! randomness is a [`core::Seed`]; the same seed gives the same bytes.

pub use genmanip_agent as agent;
pub use genmanip_assets as assets;
pub use genmanip_benchmark as benchmark;
pub use genmanip_core as core;
pub use genmanip_data as data;
pub use genmanip_dataset_tools as dataset_tools;
pub use genmanip_import as import;
pub use genmanip_layout as layout;
pub use genmanip_motion as motion;
pub use genmanip_pipeline as pipeline;
pub use genmanip_relations as relations;
pub use genmanip_render as render;
pub use genmanip_rollout as rollout;
pub use genmanip_sim as sim;
pub use genmanip_tasks as tasks;
pub use genmanip_viz as viz;
pub use genmanip_workspace as workspace;
