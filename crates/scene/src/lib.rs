//! From words to scenes and back: reading a language model's task, and judging how objects stand to each other.
//!
//! - [`answer`] turns the text a model sent into a valid [`genmanip_core::Task`], or says everything that is wrong with it.
//! - [`relations`] judges relations and goals on exact posed geometry, and explains every verdict with numbers.
//! - [`wording`] says an instruction in other words, and what each step of a task is called.
//! - [`observed`] makes point clouds of depth images, which [`relations::CloudScene`] judges like posed geometry.
//! - [`clouds`] reproduces the verdicts of two released evaluators on point clouds.
//!
//! All are pure: values in, values out.

pub mod answer;
pub mod clouds;
pub mod designer;
mod hull;
pub mod observed;
mod planar;
pub mod references;
pub mod relations;
pub mod wording;
