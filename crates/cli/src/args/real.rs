//! Arguments of `real`.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_terminal::parse;

/// Subcommands of `real`.
#[derive(Debug, Subcommand)]
pub enum RealCommand {
    /// Simulate an arm with cameras behind a bridge, in real time, with the flaws of a real one
    #[command(after_help = "Examples:\n  genmanip real simulate\n  \
                      genmanip real simulate scenario.json --latency-ms 20 --jitter-ms 10 --loss 0.01\n\n\
                      docs/formats/bridge.md has the protocol, for other programs on either side.")]
    Simulate(RealSimulateArguments),
    /// Drive a Franka arm over its own control protocol, behind a bridge
    #[command(after_help = "Examples:\n  genmanip real franka --host 172.16.0.2\n  \
                      genmanip real franka --host 127.0.0.1 --no-realtime --latency-ms 20 --jitter-ms 10\n\n\
                      docs/guides/from-here-to-your-arm.md says what the machine and the arm need.")]
    Franka(RealFrankaArguments),
    /// Run a policy on the arm behind a bridge, and record the episode
    #[command(
        after_help = "Examples:\n  genmanip real run --policy do_nothing --robot tcp://127.0.0.1:4757 --horizon 5\n  \
                      genmanip real run --policy learned:folder=policy --robot tcp://127.0.0.1:4757 --dry-run\n  \
                      genmanip real run --policy openpi:url=ws://127.0.0.1:8000 --robot tcp://127.0.0.1:4757 --slow \\\n    \
                      --world world.toml --cameras cameras.json --instruction \"put the apple on the plate\" --out real\n\n\
                      Enter and Ctrl-C stop the arm. docs/guides/from-here-to-your-arm.md has the way to the first motion."
    )]
    Run(RealRunArguments),
    /// Match a world to photographs of the real workspace: light, camera response, background, materials of objects
    #[command(after_help = "Examples:\n  genmanip real match photos --world world.toml --out matched\n  \
                      genmanip real match static=empty.png --world world.toml --out matched \\\n    \
                      --chart static=chart.png:112,80,200,82,198,140,110,138 \\\n    \
                      --scenario cups.json --objects static=cups.png\n\n\
                      docs/guides/match-your-workspace.md says which photographs to take.")]
    Match(RealMatchArguments),
}

/// Arguments of `real match`.
#[derive(Debug, Args)]
pub struct RealMatchArguments {
    /// Photographs of the empty workspace: CAMERA=FILE, or a folder with CAMERA.png or CAMERA.jpg
    #[arg(required = true, value_name = "PHOTO")]
    pub photos: Vec<String>,
    /// World with the calibrated cameras: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Photograph with a 24-patch colour chart flat on the table, and the pixels of the centres of its corner patches: dark
    /// skin, bluish green, black, white
    #[arg(long = "chart", value_name = "CAMERA=FILE:U,V,U,V,U,V,U,V", value_parser = chart)]
    pub charts: Vec<ChartArgument>,
    /// Scenario with the known objects of the photographs with --objects; once more for the same objects at other places
    #[arg(long = "scenario", value_name = "FILE", requires = "objects")]
    pub scenarios: Vec<PathBuf>,
    /// Photograph with the scenario's objects, otherwise as that of the empty workspace: CAMERA=FILE or a folder; with
    /// several scenarios one for each, in the same order
    #[arg(long, value_name = "PHOTO", requires = "scenarios")]
    pub objects: Vec<String>,
    /// Mean colour of the table, 8-bit sRGB, if no colour chart is at hand
    #[arg(long, value_name = "R,G,B", value_parser = color)]
    pub table_color: Option<[u8; 3]>,
    /// Joint positions of the arm in all photographs, rad [default: where the world's episodes start]
    #[arg(long, value_name = "J,…", allow_hyphen_values = true, value_parser = joints, conflicts_with = "no_arm")]
    pub arm: Option<Joints>,
    /// Opening of the gripper in all photographs, m [default: wide open]
    #[arg(long, value_name = "M", value_parser = parse::number, conflicts_with = "no_arm")]
    pub gripper: Option<f64>,
    /// The robot is in none of the photographs
    #[arg(long)]
    pub no_arm: bool,
    /// Folder for the matched world, the backgrounds and the comparison
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// Joint positions, rad or m.
pub type Joints = std::sync::Arc<[f64]>;

/// Value of `--chart`.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartArgument {
    /// Name of the camera.
    pub camera: String,
    /// Photograph.
    pub file: PathBuf,
    /// Pixels of the four corners.
    pub corners_px: [[f64; 2]; 4],
}

/// Arguments of `real simulate`.
#[derive(Debug, Args)]
pub struct RealSimulateArguments {
    /// Scenario with objects [default: the world without objects]
    pub scenario: Option<PathBuf>,
    /// World of the arm and its cameras: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub world: Option<PathBuf>,
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot"))]
    pub robot: Option<String>,
    #[command(flatten)]
    pub bridge: BridgeArguments,
    /// Time by which the arm lags behind its setpoints, ms
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = milliseconds)]
    pub lag_ms: f64,
    /// Standard deviation of measured joint positions, rad
    #[arg(long, value_name = "RAD", default_value_t = 1e-4, value_parser = share)]
    pub noise_rad: f64,
    /// Contact force at which a reflex stops the arm, N; 0 for no reflexes
    #[arg(long, value_name = "N", default_value_t = 100.0, value_parser = parse::number)]
    pub reflex_n: f64,
    /// Seed of noise, delays and losses
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}

/// Arguments of every bridge.
#[derive(Debug, Args)]
pub struct BridgeArguments {
    /// IP address and TCP port to listen on; port 0 picks a free one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:4757")]
    pub address: SocketAddr,
    /// Allow an address that other machines can reach: anyone there can then move the arm
    #[arg(long)]
    pub allow_others: bool,
    /// Mean delay of messages in each direction, ms
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = milliseconds)]
    pub latency_ms: f64,
    /// Largest deviation from it, ms
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = milliseconds)]
    pub jitter_ms: f64,
    /// Share of commands and states that are lost
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share)]
    pub loss: f64,
    /// Largest share of the joints' speed that clients may ask for
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, value_parser = speed)]
    pub top_speed: f64,
    /// Box that the tool must not leave, metres, in the frame of the robot's base
    #[arg(long, value_name = "X1,Y1,Z1,X2,Y2,Z2", allow_hyphen_values = true, value_parser = corners)]
    pub workspace: Option<[[f64; 3]; 2]>,
}

/// Arguments of `real franka`.
#[derive(Debug, Args)]
pub struct RealFrankaArguments {
    /// Name or IP address of the arm's control unit
    #[arg(long, value_name = "HOST")]
    pub host: String,
    /// Robot with the arm's joint limits and tool
    #[arg(long, value_name = "NAME", default_value = "fr3")]
    pub robot: String,
    /// The arm carries no Franka Hand
    #[arg(long)]
    pub no_gripper: bool,
    /// Speed of the gripper's opening width, m/s
    #[arg(long, value_name = "M/S", default_value_t = 0.1, value_parser = gripper_speed, conflicts_with = "no_gripper")]
    pub gripper_speed: f64,
    /// Force of the gripper when it closes, N
    #[arg(long, value_name = "N", default_value_t = 35.0, value_parser = gripper_force, conflicts_with = "no_gripper")]
    pub gripper_force: f64,
    /// Run without a real-time kernel, for a simulated arm: a real one aborts motions when setpoints come late
    #[arg(long)]
    pub no_realtime: bool,
    #[command(flatten)]
    pub bridge: BridgeArguments,
    /// Seed of delays and losses
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}

/// Arguments of `real run`.
#[derive(Debug, Args)]
pub struct RealRunArguments {
    /// The policy, with arguments if it takes any
    #[arg(long, value_name = "NAME[:KEY=VALUE,…]")]
    pub policy: String,
    /// Address of the bridge
    #[arg(long, value_name = "URL", default_value = "tcp://127.0.0.1:4757")]
    pub robot: String,
    /// Sources of the images of the world's cameras [default: all come from the bridge]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// World with the robot and its calibrated cameras: TOML or JSON [default: the built-in one]
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub world: Option<PathBuf>,
    /// Scenario whose instruction, robot and cameras are used; its objects only with --judge
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Instruction for the policy [default: that of the scenario]
    #[arg(long, value_name = "TEXT")]
    pub instruction: Option<String>,
    /// Time limit, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = seconds)]
    pub horizon: f64,
    /// Check every command and report, but send none: the arm stays still
    #[arg(long)]
    pub dry_run: bool,
    /// Slow mode: a tenth of the joints' speed
    #[arg(long, conflicts_with = "speed")]
    pub slow: bool,
    /// Share of the joints' speed
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, value_parser = speed)]
    pub speed: f64,
    /// Box that the tool must not leave, metres, in the frame of the robot's base
    #[arg(long, value_name = "X1,Y1,Z1,X2,Y2,Z2", allow_hyphen_values = true, value_parser = corners)]
    pub workspace: Option<[[f64; 3]; 2]>,
    /// Ask for the next actions only when the present ones are executed, while the arm waits [default: ask ahead, if the
    /// policy says how many actions of a chunk are executed]
    #[arg(long)]
    pub no_ahead: bool,
    /// Judge the goal by the depth images of the fixed cameras before and after; needs the scenario whose objects lie in
    /// front of the arm. --success stands above it
    #[arg(long, value_name = "HOW", value_parser = ["points"], requires = "scenario")]
    pub judge: Option<String>,
    /// Run folder to add the episode to, one per task and world [default: nothing is recorded]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Recorded images per second of each camera; 0 for none
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub fps: u32,
    /// Judgement of the episode; asked in a terminal, else the episode is stored as not judged
    #[arg(long, value_name = "YES|NO", value_parser = ["yes", "no"])]
    pub success: Option<String>,
    /// Remarks that are stored with the judgement
    #[arg(long, value_name = "TEXT", requires = "success")]
    pub notes: Option<String>,
    /// Seed of the policy
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.trim().parse().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("expected a number from {least} to {most}"))
}

fn milliseconds(text: &str) -> Result<f64, String> {
    within(text, 0.0, 10_000.0)
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.1, 36_000.0)
}

fn share(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1.0)
}

fn speed(text: &str) -> Result<f64, String> {
    within(text, 0.001, 1.0)
}

fn gripper_speed(text: &str) -> Result<f64, String> {
    within(text, 0.005, 0.1)
}

fn gripper_force(text: &str) -> Result<f64, String> {
    within(text, 1.0, 70.0)
}

fn corners(text: &str) -> Result<[[f64; 3]; 2], String> {
    let numbers = text.split(',').map(parse::number).collect::<Result<Vec<_>, _>>()?;
    match numbers[..] {
        [x1, y1, z1, x2, y2, z2] => Ok([[x1, y1, z1], [x2, y2, z2]]),
        _ => Err("expected two corners of a box, X1,Y1,Z1,X2,Y2,Z2".into()),
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(parse::number).collect()
}

fn joints(text: &str) -> Result<Joints, String> {
    numbers(text).map(Into::into)
}

fn color(text: &str) -> Result<[u8; 3], String> {
    let values = text.split(',').map(|value| value.trim().parse()).collect::<Result<Vec<u8>, _>>();
    values.ok().and_then(|values| values.try_into().ok()).ok_or_else(|| "expected R,G,B, each 0 to 255".into())
}

fn chart(text: &str) -> Result<ChartArgument, String> {
    let expected = || "expected CAMERA=FILE:U,V,U,V,U,V,U,V".to_owned();
    let (camera, rest) = text.split_once('=').ok_or_else(expected)?;
    let (file, corners) = rest.rsplit_once(':').ok_or_else(expected)?;
    let [a, b, c, d, e, f, g, h] = numbers(corners)?[..] else { return Err(expected()) };
    let corners_px = [[a, b], [c, d], [e, f], [g, h]];
    Ok(ChartArgument { camera: camera.into(), file: file.into(), corners_px })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_name_camera_file_and_corners() {
        let read = chart("static=C:/a=b.png:1,2,3,4,5,6,7,8.5").unwrap();
        assert_eq!((read.camera.as_str(), read.file.to_str()), ("static", Some("C:/a=b.png")));
        assert_eq!(read.corners_px[3], [7.0, 8.5]);
        for wrong in
            ["static.png:1,2,3,4,5,6,7,8", "static=a.png", "static=a.png:1,2,3", "static=a.png:1,2,3,4,5,6,7,x"]
        {
            assert!(chart(wrong).is_err(), "{wrong}");
        }
        assert_eq!(color("250, 240,0"), Ok([250, 240, 0]));
        assert!(color("250,240").is_err() && color("256,0,0").is_err());
    }
}
