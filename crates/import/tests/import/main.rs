//! Whole imports of small files of our own, of damaged ones and of hostile ones.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod described;
mod hostile;
mod rigid;
