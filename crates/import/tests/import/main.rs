//! Imports of small valid, damaged and hostile files.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod bent_links;
mod described;
mod hostile;
mod mjcf;
mod rigid;
mod robots;
mod urdf_spellings;
mod usd;
mod usd_physics;
