//! Arguments of `robot`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_terminal::UrdfArguments;

/// Subcommands of `robot`.
#[derive(Debug, Subcommand)]
pub enum RobotCommand {
    /// Write the files of a robot from a URDF, with proposals for home, gains and reach, and an image of them
    #[command(after_help = "Examples:\n  genmanip robot add examples/robots/six_axis.urdf --out robots\n  \
                      genmanip robot add xarm7.urdf --tip link_eef --gripper robotiq_2f85 --name xarm7\n\n\
                      The files are yours to edit; docs/guides/your-own-robot.md explains every key.\n\
                      --robot NAME then works in layout, collect, plan and world init.")]
    Add(RobotAddArguments),
}

/// Arguments of `robot add`.
#[derive(Debug, Args)]
pub struct RobotAddArguments {
    /// URDF of the arm, or the folder that holds it
    pub urdf: PathBuf,
    /// Name of the robot [default: the URDF's, in lower case]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Gripper at the tool frame: panda_hand, robotiq_2f85, small_jaws [default: small_jaws for arms of less than
    /// 0.6 m, else panda_hand]
    #[arg(long, value_name = "NAME")]
    pub gripper: Option<String>,
    /// Folder to write the robot's files to
    #[arg(long, value_name = "DIR", default_value = "robots")]
    pub out: PathBuf,
    /// Folders of the meshes, and choices of the reader
    #[command(flatten)]
    pub places: UrdfArguments,
}
