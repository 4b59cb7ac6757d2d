//! Integration tests: the check finds every corruption, edited datasets equal exports, imported ones hold their source.

#![allow(clippy::unwrap_used)] // The exemption for tests does not reach helpers of an integration test.

mod checking;
mod editing;
mod importing;
mod masking;
mod strangers;
#[path = "../../../data/tests/synthetic/mod.rs"]
mod synthetic;
