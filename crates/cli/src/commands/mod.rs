//! Subcommands of `genmanip`, one module each.

pub mod ablate;
pub mod agent;
pub mod assets;
pub mod calibrate;
pub mod collect;
pub mod compare;
pub mod data;
pub mod demo;
pub mod doctor;
pub mod edit;
pub mod evaluate;
pub mod export;
pub mod grasps;
pub mod identify;
pub mod launch;
pub mod layout;
pub mod leaderboard;
mod learnability;
pub mod plan;
pub mod real;
pub mod render;
pub mod replay;
pub mod report;
pub mod review;
pub mod robot;
pub mod serve;
pub mod sim2real;
pub mod skills;
pub mod studio;
pub mod suite;
pub mod task;
pub mod task_new;
pub mod teleop;
pub mod train;
pub mod world;

/// A count with its noun: `1 episode`, `2 episodes`.
fn plural(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
