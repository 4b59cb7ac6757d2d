//! Public interface of the agent: questions and answers, and the marks on images.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod answers;
mod marks;
mod recorded;
