//! Options of commands that read a robot from its URDF.

use std::path::PathBuf;

use clap::Args;

use crate::parse;

/// Places of the meshes, and choices of the reader.
#[derive(Clone, Debug, Default, Args)]
pub struct UrdfArguments {
    /// Folder of a ROS package that the URDF names by package://; repeatable. Others are sought in the folders above
    /// the URDF and in ROS_PACKAGE_PATH
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = parse::package)]
    pub packages: Vec<(String, PathBuf)>,
    /// Link of the URDF that is the tool frame [default: the SRDF's end effector, or the frame before the fingers]
    #[arg(long, value_name = "LINK")]
    pub tip: Option<String>,
    /// Links of the URDF without collision geometry collide as the hulls of what is visible
    #[arg(long)]
    pub visuals_collide: bool,
}
