//! Arguments of `skills`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_terminal::parse;

/// Subcommands of `skills`.
#[derive(Debug, Subcommand)]
pub enum SkillsCommand {
    /// Cut skills from recorded episodes: one file per successful episode
    #[command(after_help = "Examples:\n  genmanip skills record out/takes --out out/skills\n  \
                            genmanip skills record out/takes --episode pull-take-00 --out out/skills\n\n\
                            An episode needs a goal with one move; it is cut by joint position and contact.")]
    Record(SkillsRecordArguments),
    /// List skills
    #[command(after_help = "Example:\n  genmanip skills list out/skills")]
    List(SkillsListArguments),
    /// Show a skill: its source, its segments and its motion
    #[command(after_help = "Example:\n  genmanip skills show out/skills/pull-take-00.skill.json")]
    Show(SkillsShowArguments),
    /// Transfer skills to objects that match a query, and keep the episodes that succeed, as a run
    #[command(
        after_help = "Examples:\n  genmanip skills transfer out/skills --to 'drawer cabinet' --count 20 --out out/pulled\n  \
                            genmanip skills transfer out/skills/pull-take-00.skill.json --to drawer-cabinet-5 --out out/one\n\n\
                            Every attempt has a layout of its own and is judged after settling, as any episode."
    )]
    Transfer(SkillsTransferArguments),
}

/// Arguments of `skills record`.
#[derive(Debug, Args)]
pub struct SkillsRecordArguments {
    /// Run folder or episode store
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Episode to cut, instead of all that succeeded; may be repeated
    #[arg(long, value_name = "ID")]
    pub episode: Vec<String>,
    /// Folder of the skill files
    #[arg(long, value_name = "DIR", default_value = "skills")]
    pub out: PathBuf,
}

/// Arguments of `skills list`.
#[derive(Debug, Args)]
pub struct SkillsListArguments {
    /// Skill files, or folders of them
    #[arg(value_name = "SKILL|FOLDER", required = true)]
    pub skills: Vec<PathBuf>,
}

/// Arguments of `skills show`.
#[derive(Debug, Args)]
pub struct SkillsShowArguments {
    /// Skill file
    #[arg(value_name = "SKILL")]
    pub skill: PathBuf,
}

/// Arguments of `skills transfer`.
#[derive(Debug, Args)]
pub struct SkillsTransferArguments {
    /// Skill files, or folders of them
    #[arg(value_name = "SKILL|FOLDER", required = true)]
    pub skills: Vec<PathBuf>,
    /// Objects, in the words of `assets search`
    #[arg(long, value_name = "QUERY")]
    pub to: String,
    /// Number of episodes to keep
    #[arg(long, default_value_t = 20, value_parser = parse::count)]
    pub count: usize,
    /// Folder of the run
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed of the layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// World file [default: the built-in world]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
