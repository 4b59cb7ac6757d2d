//! Arguments of `teleop`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `teleop`.
#[derive(Debug, Args)]
pub struct TeleopArguments {
    /// Scenario file
    pub scenario: PathBuf,
    /// The SpaceMouse: its hidraw file, such as /dev/hidraw0, or a named pipe in its place
    #[arg(long, value_name = "FILE")]
    pub device: PathBuf,
    /// File with the HID report descriptor of --device [default: the one that the kernel shows]
    #[arg(long, value_name = "FILE")]
    pub descriptor: Option<PathBuf>,
    /// Policy to hand over to with `t`, with its arguments
    #[arg(long, value_name = "NAME[:KEY=VALUE,…]", default_value = "expert")]
    pub policy: String,
    /// Let --policy begin; take over with `t`
    #[arg(long)]
    pub watch: bool,
    /// Frame of the device at the start: world, or hand
    #[arg(long, default_value = "world", value_parser = ["world", "hand"])]
    pub frame: String,
    /// Folder of the run folders
    #[arg(long, value_name = "DIR", default_value = "teleop")]
    pub out: PathBuf,
    /// Your name or pseudonym, stored with the episode
    #[arg(long, value_name = "NAME", default_value = "somebody")]
    pub author: String,
}
