//! The Franka Emika Panda with its hand, from published figures; meshes are our own.
use genmanip_core::RobotModel;
use std::sync::Arc;
/// x
pub fn panda() -> Arc<RobotModel> {
    unimplemented!()
}
