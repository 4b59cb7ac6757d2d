//! The command line of `genmanip-lab`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use genmanip_assets::CATALOGUES;
use genmanip_core::ExpertStyle;
use genmanip_terminal::{GlobalArguments, parse};

pub use design::*;
pub use learn::*;
pub use motion::*;
pub use perception::*;
pub use suites::*;
pub use transfer::*;

mod design;
mod learn;
mod motion;
mod perception;
mod suites;
mod transfer;

use motion::{BRIDGE_HELP, IDENTIFY_HELP, MATCH_HELP};
use transfer::{TRANSFER_HELP, WORTH_HELP};

/// Measurements of GenManip on unseen seeds and files: agreement, validity, success rates, time
#[derive(Debug, Parser)]
#[command(name = "genmanip-lab", version, about, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done, 1 the request could not be met, 2 the command line was not understood,\n\
                        130 stopped by a second Ctrl-C. Data goes to stdout, the log to stderr.")]
pub struct Arguments {
    /// Options of every subcommand
    #[command(flatten)]
    pub global: GlobalArguments,
    /// The measurement
    #[command(subcommand)]
    pub command: LabCommand,
}

/// Measurements on unseen seeds and files.
#[derive(Debug, Subcommand)]
pub enum LabCommand {
    /// Compare verdicts: of a profile with recorded ones, or on rendered clouds with posed geometry
    #[command(after_help = "Examples:\n  genmanip-lab relations --cases cases.json --profile genmanip-0.9 --json\n  \
                      genmanip-lab relations --rendered --seed 1 --count 500 --json\n\n\
                      The clouds of cases are read from the archive beside the file: cases.npz.\n\
                      With --rendered, scenes are laid out and rendered by three cameras, and their clouds and the\n\
                      posed geometry are judged by profile seed.")]
    Relations(RelationsArguments),
    /// Check hostile answers: worst-case time, and robustness against a fuzzer
    #[command(after_help = "Examples:\n  genmanip-lab answers --seed 1 --count 10000 --json\n  \
                      genmanip-lab answers --seed 1 --minutes 10 --json")]
    Answers(AnswersArguments),
    /// Run the expert (oracle) on tasks, each on fresh layouts until an attempt is verified
    #[command(after_help = "Example:\n  genmanip-lab expert --seed 2000 --count 60 --json\n\n\
                      One thread; CPU time covers layout, planning, physics and checks.")]
    Expert(ExpertArguments),
    /// Run the agent on fresh tasks from RGB-D images, its questions answered by an oracle or a model
    #[command(after_help = "Examples:\n  \
                      genmanip-lab agent --seed 7 --count 240 --vlm oracle --masks oracle --json\n  \
                      genmanip-lab agent --seed 7 --count 40 --kinds spatial,long_horizon --path grid --preset paper\n  \
                      genmanip-lab agent --seed 7 --count 60 --relation between\n\n\
                      One thread; CPU time covers perception, questions, planning and physics, not the layout.")]
    Agent(AgentArguments),
    /// Inject one error per episode, and measure how often the failure analysis attributes the failure to it
    #[command(after_help = "Examples:\n  \
                      genmanip-lab blame --seed 7 --per-class 30 --json\n  \
                      genmanip-lab blame --seed 7 --classes plan_location --per-class 10 --natural 0\n\n\
                      Each failed episode is restored to the moment before the blamed answer, only that answer is replaced by the \
                      oracle's, and the episode continues; the share that then succeeds is reported. An error without \
                      an answer, such as jammed fingers, cannot be replaced.")]
    Blame(BlameArguments),
    /// Run many agents concurrently against one slow, faulty local model server that answers as the oracle
    #[command(
        after_help = "Example:\n  genmanip-lab batch --seed 7 --count 64 --at-once 64 --latency 2 --faults 0.05 --json\n\n\
                      Faults are 429, dropped connections, answers that are not JSON, and time-outs after 5 s."
    )]
    Batch(BatchArguments),
    /// Calibrate cameras of random setups with known truth, on the hand and beside the robot; refuse degenerate sets
    #[command(after_help = "Examples:\n  genmanip-lab calibrate --seed 7 --count 200 --json\n  \
                      genmanip-lab calibrate --seed 7 --count 1 --rendered 20 --out sets\n\n\
                      COUNT sets of 15 to 20 views for each mounting and noise, and as many degenerate ones of all kinds.")]
    Calibrate(LabCalibrateArguments),
    /// Identify hidden simulated arms from noisy recordings: errors, coverage, what cannot be identified, wrong models
    #[command(after_help = IDENTIFY_HELP)]
    Identify(LabIdentifyArguments),
    /// Match worlds to photographs of hidden worlds with known truth: response, light, held-out views
    #[command(after_help = MATCH_HELP)]
    Match(LabMatchArguments),
    /// Send random streams of commands to the bridge of an arm, and run policies behind it and directly
    #[command(after_help = BRIDGE_HELP)]
    Bridge(BridgeArguments),
    /// Compose tasks with the rule-based designer and check validity, variety, quotas and references
    #[command(after_help = "Example:\n  genmanip-lab design --seed 7 --count 2000 --json")]
    Design(DesignArguments),
    /// Plant mismatches of sentence and goal in designed tasks, and count those that the answer check reports
    Wording(DesignArguments),
    /// Plan motion problems, check every path again, and time planning, time parameterisation and kinematics
    #[command(after_help = "Examples:\n  genmanip-lab motion --problems problems.json --json\n  \
                      genmanip-lab motion --problems problems.json --robot panda/ --json\n  \
                      genmanip-lab motion --generate hard --seed 7 --count 100 --out problems.json\n\n\
                      A problem holds joint positions start and goal, and obstacles (box: size; cylinder: radius, \
                      length; pos and yaw) in the robot's base frame; --robot is a folder with a URDF, its meshes and \
                      SRDF.")]
    Motion(MotionArguments),
    /// Read a folder of other people's robots, objects and datasets, and plan random motions of the arms
    #[command(after_help = "Example:\n  genmanip-lab strangers robots/ --kinds robot --pairs 20 --json\n\n\
                      Refused files name their reason; silent counts files of which something was dropped without a note.\n\
                      A pair is solvable if the planner, or a plain RRT-Connect in 20 s, joins it.")]
    Strangers(StrangersArguments),
    /// Generate objects of all families and test them: stability, grasps, containers, states, cost of physics
    #[command(after_help = "Example:\n  genmanip-lab assets --seed 7 --count 200 --json\n\n\
                      The families in turn, each with its own seeds; docs/concepts/assets.md describes the figures.")]
    Assets(LabAssetsArguments),
    /// Edit laid out tasks at random, judge every edit, plant faults and repair them
    #[command(after_help = "Example:\n  genmanip-lab studio --seed 1 --operations 500 --json\n\n\
                      CPU time of one thread. Verdicts are compared with the audit of layouts and the independent\n\
                      reader; faults of eight kinds are planted in turn; keys that need a browser are null.")]
    Studio(LabStudioArguments),
    /// Lay designed tasks out, once each, and audit the layouts
    #[command(after_help = "Example:\n  genmanip-lab layout --seed 2000 --count 1000 --json\n\n\
                      One thread; the audit (edges, states, goal, 2 s of physics, visibility) is not timed.")]
    Layout(LabLayoutArguments),
    /// Try grasps from point clouds in physics: lift, shake, hold
    #[command(after_help = "Example:\n  genmanip-lab grasp --seed 2000 --count 100 --view one --json\n\n\
                      Random objects of three classes (compact, utensils, clutter), COUNT each;\n\
                      docs/concepts/grasps.md describes the trials.")]
    Grasp(GraspArguments),
    /// Teleoperate by virtual devices: directions, cross-talk, return, faults, and episodes of a scripted operator
    #[command(after_help = "Examples:\n  genmanip-lab teleop --seed 7 --json\n  \
                      genmanip-lab teleop --seed 7 --episodes 200 --out out/teleop\n\n\
                      HID reports, gamepad states and key events go in where those of a device would. The scripted \
                      operator has a reaction time, a tremor, overshoot and pauses, and reads poses from the \
                      simulator (oracle).")]
    Teleop(TeleopArguments),
    /// Transfer skills from a few takes to many scenes, against the analytic skills and MimicGen as published
    #[command(after_help = TRANSFER_HELP)]
    Transfer(TransferArguments),
    /// Train policies on a few takes, on episodes transferred from them, and on as many of the analytic expert
    #[command(after_help = WORTH_HELP)]
    Worth(WorthArguments),
    /// Step through episodes in the environment: cost relative to the bare simulation, and exactness
    #[command(after_help = "Examples:\n  genmanip-lab environment --seed 1 --count 10 --json\n  \
                      genmanip-lab environment --store out/run --json\n\n\
                      One thread, CPU time, bare simulation and environment in alternation, median of five.")]
    Environment(EnvironmentArguments),
    /// Collect episodes, export them, and play back every kind of action at every rate: cost, size, success
    #[command(after_help = "Examples:\n  genmanip-lab data --seed 7 --episodes 60 --json\n  \
                      genmanip-lab data --synthetic --episodes 10000 --json\n\n\
                      CPU time; playback is open loop, from the rows of exported datasets, through the policy\n\
                      interface; docs/formats/lerobot-dataset.md describes the actions.")]
    Data(LabDataArguments),
    /// Pass mutated files of every kind to the program, each in a process with limits of memory and time
    #[command(
        after_help = "Examples:\n  genmanip-lab hostile --seed 1 --minutes 30 --refusals refusals.txt --json\n  \
                      genmanip-lab hostile --seed 1 --minutes 0 --races 200 --kills 50 --json\n\n\
                      Run it in the project's folder; Ctrl-C ends it with the results so far.\n\
                      Minutes are CPU time of all calls; each may use 1 GiB and 10 s.\n\
                      Inputs that once broke something are in crates/lab/testdata/hostile and come first."
    )]
    Hostile(HostileArguments),
    /// Render an episode over a crowded table: cost per image, and exactness of frames that reuse previous ones
    #[command(after_help = "Example:\n  genmanip-lab render --seed 1 --json\n  \
                      genmanip-lab render --seed 1 --flip 10 --out out/flip\n\n\
                      One thread, CPU time, medians over the frames of the episode; the static camera is rendered \
                      first and computes the shadows, which the wrist camera shares.")]
    Render(LabRenderArguments),
    /// Fit the weights of the score of grasps from point clouds to trials, and test its calibration on others
    #[command(after_help = "Example:\n  genmanip-lab fit dev-1.jsonl dev-2.jsonl --test fresh.jsonl\n\n\
                      The files are written by genmanip-lab grasp --out; docs/concepts/grasps.md names them.")]
    Fit(FitArguments),
    /// Segment images of the data cameras from colour and depth, and compare with the renderer's ids
    #[command(after_help = "Examples:\n  genmanip-lab segment --seed 1 --count 60 --json\n  \
                      genmanip-lab segment --seed 1 --count 60 --noise d435 --out out/segment\n  \
                      genmanip-lab segment --seed 1 --count 50 --extents --json\n\n\
                      Scenes of 5 to 12 objects, two views each; objects with at least 200 visible pixels count.")]
    Segment(SegmentArguments),
    /// Learn one distribution of genmanip-learn-10 from nothing: demonstrations, training, success on unseen layouts
    #[command(
        after_help = "Example:\n  genmanip-lab learn --seed 1 --preset state --demos 300 --budget 15m --json\n\n\
                      Needs a build with learned policies: cargo xtask install --learn. The time limit is three times the\n\
                      expert's median. Evaluation is no part of CPU times."
    )]
    Learn(LabLearnArguments),
    /// Compare a learned policy with itself without images, with those of another layout, with other numbers of
    /// executed actions, and with the replay of the nearest demonstration
    #[command(
        after_help = "Example:\n  genmanip-lab learned-controls out/policy --run out/run --distribution into --json"
    )]
    LearnedControls(LabControlArguments),
    /// Copy a run's episodes to any number, and measure the cost of report, opening and resuming
    #[command(after_help = "Example:\n  genmanip-lab scale --run out/run --episodes 10000 --out out/scaled --json\n\n\
                      The copies are further attempts at the same tasks, with their own ids; synthetic.json marks \
                      the folder.")]
    Scale(ScaleArguments),
    /// Simulate evaluations with known success rates: coverage of intervals, type I error of tests
    #[command(after_help = "Example:\n  genmanip-lab statistics --seed 1 --repetitions 20000 --json\n\n\
                      Rates from 2 to 98 %, 50 and 200 scenarios of one and of five episodes; differences by scenario,\n\
                      which need a bootstrap each, are repeated a tenth as often.")]
    Statistics(LabStatisticsArguments),
    /// Check a frozen suite, and run the expert on its scenarios with fresh random streams
    #[command(after_help = "Example:\n  genmanip-lab suite --suite suites/mine --json")]
    Suite(LabSuiteArguments),
    /// Make cards for readers who see only image and sentence, and compare their answers with the intended meaning
    #[command(after_help = "Examples:\n  genmanip-lab readers --suite suites/mine --out out/cards\n  \
                      genmanip-lab readers --suite suites/mine --answers one.json,two.json --json\n  \
                      genmanip-lab readers --ends out/evaluated --count 200 --out out/ends\n\n\
                      out/cards/questions.json holds the question and the answer format. Episodes come from\n\
                      `evaluate --keep-episodes --out`. Answers belong to the cards of the same seed.")]
    Readers(LabReadersArguments),
}

/// Arguments of `genmanip-lab statistics`.
#[derive(Debug, Args)]
pub struct LabStatisticsArguments {
    /// Seed of the simulation
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of simulated evaluations per setting
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = parse::count)]
    pub repetitions: usize,
}

/// Arguments of `genmanip-lab hostile`.
#[derive(Debug, Args)]
pub struct HostileArguments {
    /// Seed of the mutations
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Total CPU time of all calls, minutes, 0 to 10000
    #[arg(long, default_value_t = 1.0, value_parser = parse_minutes)]
    pub minutes: f64,
    /// Mutate only inputs of this kind [default: all kinds]
    #[arg(long, value_parser = genmanip_lab::hostile::KINDS)]
    pub kind: Option<String>,
    /// Write all messages to this file
    #[arg(long, value_name = "FILE")]
    pub refusals: Option<PathBuf>,
    /// Copy inputs that broke something into this folder
    #[arg(long, value_name = "DIR")]
    pub found: Option<PathBuf>,
    /// Also measure every reader on files at its size limit
    #[arg(long)]
    pub readers: bool,
    /// Also start N pairs of runs with different seeds at the same time in one folder
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = parse_few)]
    pub races: usize,
    /// Also kill N runs at random moments, continue them and compare the bytes
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = parse_few)]
    pub kills: usize,
    /// Folder of the project's sources, for its examples
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub project: PathBuf,
}

fn parse_minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.0..=10_000.0).contains(&minutes) => Ok(minutes),
        _ => Err("expected minutes from 0 to 10000".into()),
    }
}

fn parse_few(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 0..=100_000) => Ok(count),
        _ => Err("expected a whole number from 0 to 100000".into()),
    }
}

/// Arguments of `genmanip-lab batch`.
#[derive(Debug, Args)]
pub struct BatchArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Seed of tasks, layouts, episodes and faults
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of episodes; the kinds of tasks in turn, without articulated ones
    #[arg(long, default_value_t = 64, value_parser = parse::count)]
    pub count: usize,
    /// Maximum number of concurrent episodes
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = parse::count)]
    pub at_once: usize,
    /// Number of CPU cores that the episodes share [default: all]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Response time of the server, 0 to 60 s
    #[arg(long, default_value_t = 2.0, value_name = "S", value_parser = parse_minute)]
    pub latency: f64,
    /// Share of requests with a fault, 0 to 1
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = parse_share)]
    pub faults: f64,
}

fn parse_minute(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=60.0).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds from 0 to 60".into()),
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("expected a share from 0 to 1".into()),
    }
}

/// Arguments of `genmanip-lab fit`.
#[derive(Debug, Args)]
pub struct FitArguments {
    /// Files of trials to fit to, as written by `genmanip-lab grasp --out`
    #[arg(required = true, value_name = "FILE")]
    pub trials: Vec<PathBuf>,
    /// Fit only the constant (bias); the other weights, and with them the ranking of grasps, stay as they are
    #[arg(long)]
    pub constant: bool,
    /// Files of other trials, to test the calibration
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub test: Vec<PathBuf>,
}

/// Arguments of `genmanip-lab environment`.
#[derive(Debug, Args)]
pub struct EnvironmentArguments {
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of designed tasks; the expert attempts each once
    #[arg(long, default_value_t = 10, value_parser = parse::count)]
    pub count: usize,
    /// Step through the episodes stored here instead: a run, its episodes, or one of them
    #[arg(long, value_name = "DIR")]
    pub store: Option<PathBuf>,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `genmanip-lab teleop`.
#[derive(Debug, Args)]
pub struct TeleopArguments {
    /// Seed of tasks, layouts and operators
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of episodes of the scripted operator, the devices in turn
    #[arg(long, default_value_t = 20, value_parser = parse::count)]
    pub episodes: usize,
    /// Number of random commands; the second half are the opposites of the first half in reverse order
    #[arg(long, default_value_t = 10_000, value_parser = parse::count)]
    pub commands: usize,
    /// Keep the episodes in this new folder, an episode store
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `genmanip-lab data`.
#[derive(Debug, Args)]
pub struct LabDataArguments {
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of designed tasks, each attempted once by the expert; with --synthetic: number of episodes
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub episodes: usize,
    /// Write synthetic episodes of 30 rows with images of 64x64 pixels instead, to measure the cost of checking and
    /// opening a large dataset
    #[arg(long)]
    pub synthetic: bool,
    /// Also write the synthetic episodes as N datasets, and merge them
    #[arg(long, value_name = "N", value_parser = parse::count, requires = "synthetic")]
    pub shards: Option<usize>,
    /// Keep episodes and dataset in this new folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `genmanip-lab render`.
#[derive(Debug, Args)]
pub struct LabRenderArguments {
    /// Seed of objects, layout and episode
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of scenes whose image is also compared with a path-traced one (LDR-FLIP)
    #[arg(long, value_name = "SCENES", default_value_t = 0)]
    pub flip: usize,
    /// Number of light paths per pixel of the path-traced images
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub paths: u32,
    /// Folder to write both images of each scene to
    #[arg(long, value_name = "DIR", requires = "flip")]
    pub out: Option<PathBuf>,
    /// Also render a table of at least 150,000 triangles with MuJoCo's and PyBullet's renderers
    #[arg(long)]
    pub baselines: bool,
    /// Python interpreter with the packages mujoco, pybullet and numpy
    #[arg(long, value_name = "PROGRAM", requires = "baselines", default_value = ".python/bin/python")]
    pub python: PathBuf,
}

/// Arguments of `genmanip-lab answers`.
#[derive(Debug, Args)]
pub struct AnswersArguments {
    /// Seed of the fuzzer
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of mutated texts
    #[arg(long, default_value_t = 10_000, value_parser = parse::count)]
    pub count: usize,
    /// CPU time of the fuzzer, minutes, instead of a number of texts
    #[arg(long, conflicts_with = "count")]
    pub minutes: Option<f64>,
    /// Recorded answers to check and to start from: a file or a folder
    #[arg(long, value_name = "PATH", default_value = "examples/tasks")]
    pub answers: PathBuf,
}

/// Arguments of `genmanip-lab relations`.
#[derive(Debug, Args)]
pub struct RelationsArguments {
    /// Recorded cases; their clouds are in the .npz archive beside the file
    #[arg(long, value_name = "FILE", required_unless_present = "rendered")]
    pub cases: Option<PathBuf>,
    /// Relation profile that judges: genmanip-0.9, suite-0.2.3, or seed (the relations of this project)
    #[arg(long, required_unless_present = "rendered")]
    pub profile: Option<String>,
    /// Compare clouds from rendered depth and ids with posed geometry
    #[arg(long, conflicts_with_all = ["cases", "profile"])]
    pub rendered: bool,
    /// Seed of the layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed, requires = "rendered")]
    pub seed: u64,
    /// Number of layouts; each gives up to two scenes, before and after the moves that the goal asks for
    #[arg(long, default_value_t = 500, requires = "rendered", value_parser = parse::count)]
    pub count: usize,
    /// Tasks to lay out in turn: a file or a folder
    #[arg(long, value_name = "PATH", default_value = "examples/tasks", requires = "rendered")]
    pub tasks: PathBuf,
}

/// Arguments of `genmanip-lab expert`.
#[derive(Debug, Args)]
pub struct ExpertArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot instead of the world's"))]
    pub robot: Option<String>,
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of tasks of the rule-based designer, the six kinds in turn
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub count: usize,
    /// Maximum number of attempts at a task before it counts as unsolved
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    pub tries: u64,
    /// Choices of the expert, as `genmanip collect --expert`
    #[arg(long, value_name = "STYLE", default_value = "default", value_parser = parse::variant(ExpertStyle::ALL, ExpertStyle::name))]
    pub expert: ExpertStyle,
    /// Task files, or folders of them, instead of designed tasks
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// The agent and the kinds of tasks.
#[derive(Debug, Args)]
pub struct AgentChoiceArguments {
    /// Kinds of tasks; the agent cannot do `articulated` ones
    #[arg(long, value_delimiter = ',', default_value = "pick_and_place,spatial,appearance,common_sense,long_horizon")]
    pub kinds: Vec<String>,
    /// Source of the answers: `oracle` (simulator truth), or the settings file of a model
    #[arg(long, default_value = "oracle", value_name = "oracle|FILE")]
    pub vlm: String,
    /// Source of the masks: `rgbd` (built in, from colour and depth), `oracle` (simulator truth) or a server
    #[arg(long, default_value = "rgbd", value_name = "rgbd|oracle|http:URL")]
    pub masks: String,
    /// Form of the model's answer for a placement: one grid cell (`p2p`), or a path over the grid with heights and
    /// rotations (`grid`)
    #[arg(long, default_value = "p2p", value_parser = ["p2p", "grid"])]
    pub path: String,
    /// Preset of the agent: `paper` as published, `full` with all robustness features
    #[arg(long, default_value = "full", value_parser = ["full", "paper"])]
    pub preset: String,
}

/// Arguments of `genmanip-lab agent`.
#[derive(Debug, Args)]
pub struct AgentArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Seed of tasks, layouts and episodes
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of episodes, the kinds in turn
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub count: usize,
    #[command(flatten)]
    pub agent: AgentChoiceArguments,
    /// Only tasks whose goal has a condition of this relation
    #[arg(long, value_name = "RELATION")]
    pub relation: Option<String>,
    /// Also ask which part of the object to grasp (coarse-to-fine grasping)
    #[arg(long)]
    pub ctof: bool,
    /// Inject errors into a share of the oracle's answers to one kind of question, and test the failure analysis
    #[arg(long, value_name = "STAGE=SHARE")]
    pub error: Vec<String>,
    /// Write each episode's transcript and images into this folder
    #[arg(long, value_name = "FOLDER")]
    pub transcripts: Option<PathBuf>,
    /// Write a failure page: causes by kind, one episode with images per cause, intended and actual relations
    #[arg(long, value_name = "FILE")]
    pub page: Option<PathBuf>,
}

/// Arguments of `genmanip-lab blame`.
#[derive(Debug, Args)]
pub struct BlameArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Seed of tasks, layouts and episodes
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of failed episodes of each class
    #[arg(long, default_value_t = 30, value_parser = parse::count)]
    pub per_class: usize,
    /// Classes of injected errors [default: all but `service`]
    #[arg(long, value_delimiter = ',', value_name = "CLASS")]
    pub classes: Vec<String>,
    /// Number of episodes without injected errors; failed ones are repeated too
    #[arg(long, default_value_t = 60)]
    pub natural: usize,
    #[command(flatten)]
    pub agent: AgentChoiceArguments,
    /// Control loop of the agent: `open` decomposes the task and picks each object once, so that errors are rarely
    /// corrected; `closed` checks the outcome and tries again
    #[arg(long = "loop", default_value = "open", value_name = "open|closed", value_parser = ["open", "closed"])]
    pub closed_loop: String,
}

/// Arguments of `genmanip-lab layout`.
#[derive(Debug, Args)]
pub struct LabLayoutArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot instead of the world's"))]
    pub robot: Option<String>,
    /// Seed of tasks and layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of tasks to design and lay out; with --tasks: number of layouts of each
    #[arg(long, default_value_t = 100, value_parser = parse::count)]
    pub count: usize,
    /// Tasks instead of designed ones: recorded answers, task documents or folders of them
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
    /// Number of objects to add to each scene that the instruction does not mention
    #[arg(long, default_value_t = 0)]
    pub distractors: usize,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `genmanip-lab assets`.
#[derive(Debug, Args)]
pub struct LabAssetsArguments {
    /// Seed of the objects
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of objects to generate, the families in turn
    #[arg(long, default_value_t = 100, value_parser = parse::count)]
    pub count: usize,
    /// Generate objects of this family only
    #[arg(long, value_name = "NAME")]
    pub family: Option<String>,
    /// Take the families from the data files of this folder
    #[arg(long, value_name = "DIR")]
    pub families: Option<PathBuf>,
    /// Test the imported objects of the packs in this folder instead
    #[arg(long, value_name = "DIR", conflicts_with_all = ["count", "family", "families"])]
    pub imported: Option<PathBuf>,
    /// Worker threads; reported CPU times are those of a single thread [default: all cores]
    #[arg(long, value_name = "N")]
    pub workers: Option<usize>,
}
