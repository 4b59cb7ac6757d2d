//! The agent as others use it: questions and answers, and the marks on pictures.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod answers;
mod marks;
mod recorded;
