//! Skills: a few takes made into many episodes.
//!
//! ```text
//! Episode ─record─▶ Skill (file) ─fit to a scene─▶ Transfer (policy) ─ordinary loop─▶ verified Episode
//! ```
//!
//! - [`record`](mod@record): an episode is cut into segments by joint position and contact, and the hand's poses are
//!   stored in the frame of the moving link's handle, with the joint's travel as the clock.
//! - [`fit`]: inverse kinematics and collisions of a skill in another scene, before any physics.
//! - [`Transfer`]: the skill that fits best as a [`Policy`](genmanip_core::Policy), with the planner for the approach.
//! - [`SkillSet`]: skills that the expert uses for the moves that they serve.
//! - [`operator`]: scripts of the scripted operator, for tests and measurements.

pub mod carry;
mod cut;
mod error;
pub mod fit;
pub mod handle;
pub mod operator;
pub mod record;
mod record_carry;
mod serve;
mod settings;
mod skill;
pub mod tasks;
mod timing;
mod transfer;
mod way;

pub use error::SkillError;
pub use record::record;
pub use serve::{SkillSet, serves_task};
pub use settings::TransferSettings;
pub use skill::{CarryMotion, Grip, JointMotion, Segments, Skill, SkillSource, Verb};
pub use tasks::serves;
pub use transfer::Transfer;
