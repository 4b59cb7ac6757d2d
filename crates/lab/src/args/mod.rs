//! The command line of `genmanip-lab`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use genmanip_assets::CATALOGUES;
use genmanip_terminal::parse;

pub use motion::*;
pub use suites::*;

mod motion;
mod suites;

/// Measurements of GenManip on cases that the project has not seen: agreement, validity, success rates, time.
#[derive(Debug, Parser)]
#[command(name = "genmanip-lab", version, about, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done, 1 the request could not be met, 2 the command line was not understood,\n\
                        130 stopped by a second Ctrl-C. Data goes to stdout, the log to stderr.")]
pub struct Arguments {
    /// Print data as JSON on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// No progress, no log; errors only
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Folder with packs of imported objects; without: GENMANIP_PACKS, or `packs` in the current folder if it is there
    #[arg(long, value_name = "DIR", global = true)]
    pub packs: Option<PathBuf>,
    /// Folder with robot files of your own; without: GENMANIP_ROBOTS, or `robots` in the current folder if it is there
    #[arg(long, value_name = "DIR", global = true)]
    pub robots: Option<PathBuf>,
    /// The measurement
    #[command(subcommand)]
    pub command: LabCommand,
}

/// Measurements that take data the project has not seen.
#[derive(Debug, Subcommand)]
pub enum LabCommand {
    /// Compare verdicts: of a profile with recorded ones, or of rendered clouds with posed geometry
    #[command(after_help = "Examples:\n  genmanip-lab relations --cases cases.json --profile genmanip-0.9 --json\n  \
                      genmanip-lab relations --rendered --seed 1 --count 500 --json\n\n\
                      The clouds of cases are read from the archive beside the file: cases.npz.\n\
                      With --rendered, scenes are laid out and drawn, and the clouds that three cameras see are\n\
                      judged by profile seed, as posed geometry is.")]
    Relations(RelationsArguments),
    /// Check hostile answers: how long it takes at worst, and whether anything breaks the reader
    #[command(after_help = "Examples:\n  genmanip-lab answers --seed 1 --count 10000 --json\n  \
                      genmanip-lab answers --seed 1 --minutes 10 --json")]
    Answers(AnswersArguments),
    /// Let the expert (oracle) try tasks, each on fresh layouts until an attempt is verified
    #[command(after_help = "Example:\n  genmanip-lab expert --seed 2000 --count 60 --json\n\n\
                      One thread; processor time covers layout, planning, physics and checks.")]
    Expert(ExpertArguments),
    /// Let the agent do fresh tasks from RGB-D images, its questions answered by an oracle or a model
    #[command(after_help = "Examples:\n  \
                      genmanip-lab agent --seed 7 --count 240 --vlm oracle --masks oracle --json\n  \
                      genmanip-lab agent --seed 7 --count 40 --kinds spatial,long_horizon --path grid --preset paper\n\n\
                      One thread; processor time covers looking, asking, planning and physics, not the layout.")]
    Agent(AgentArguments),
    /// Make one mistake per episode, and see whether the failure analysis, which is not told, finds it
    #[command(after_help = "Examples:\n  \
                      genmanip-lab blame --seed 7 --per-class 30 --json\n  \
                      genmanip-lab blame --seed 7 --classes plan_location --per-class 10 --natural 0\n\n\
                      Each failed episode is restored to the moment before the blamed answer, only that answer is replaced by the \
                      oracle's, and the episode runs on: the share that then succeeds is reported. A mistake without an \
                      answer, such as jammed fingers, cannot be replaced.")]
    Blame(BlameArguments),
    /// Let many agents at once ask one slow model server on this machine, with faults, answered by the oracle
    #[command(
        after_help = "Example:\n  genmanip-lab batch --seed 7 --count 64 --at-once 64 --latency 2 --faults 0.05 --json\n\n\
                      Faults are 429, cut connections, answers that are no JSON, and time-outs after 5 s."
    )]
    Batch(BatchArguments),
    /// Let the rule-based designer compose tasks and judge them: validity, variety, quotas, references
    #[command(after_help = "Example:\n  genmanip-lab design --seed 7 --count 2000 --json")]
    Design(DesignArguments),
    /// Plan motion problems, test every returned path again, and time planning, timing and kinematics
    #[command(after_help = "Examples:\n  genmanip-lab motion --problems problems.json --json\n  \
                      genmanip-lab motion --problems problems.json --robot panda/ --json\n  \
                      genmanip-lab motion --generate hard --seed 7 --count 100 --out problems.json\n\n\
                      A problem holds joint positions start and goal, and obstacles (box: size; cylinder: radius, \
                      length; pos and yaw) in the robot's base frame; --robot is a folder with a URDF, its meshes and \
                      SRDF.")]
    Motion(MotionArguments),
    /// Make new objects of all families and try them: stability, grasps, containers, states, cost of physics
    #[command(after_help = "Example:\n  genmanip-lab assets --seed 7 --count 200 --json\n\n\
                      The families in turn, each with seeds of its own; docs/concepts/assets.md says what is measured.")]
    Assets(LabAssetsArguments),
    /// Lay designed tasks out, once each, and audit what comes of it
    #[command(after_help = "Example:\n  genmanip-lab layout --seed 2000 --count 1000 --json\n\n\
                      One thread; the audit (every edge, state and goal again, 2 s of physics with sleep off, \
                      visibility) is not timed.")]
    Layout(LabLayoutArguments),
    /// Try grasps from points in physics: lift, shake, hold
    #[command(after_help = "Example:\n  genmanip-lab grasp --seed 2000 --count 100 --view one --json\n\n\
                      Things of three classes (compact, utensils, clutter), COUNT each, drawn by seed;\n\
                      docs/concepts/grasps.md says what is measured.")]
    Grasp(GraspArguments),
    /// Step through episodes in the environment: what it costs beside the bare simulation, and whether it is exact
    #[command(after_help = "Examples:\n  genmanip-lab environment --seed 1 --count 10 --json\n  \
                      genmanip-lab environment --store out/run --json\n\n\
                      One thread, processor time, bare and environment by turns, median of five.")]
    Environment(EnvironmentArguments),
    /// Collect episodes, export them, and play every kind of action at every rate back: cost, size, success
    #[command(after_help = "Examples:\n  genmanip-lab data --seed 7 --episodes 60 --json\n  \
                      genmanip-lab data --synthetic --episodes 10000 --json\n\n\
                      Processor time; playback is open loop, from the rows of exported datasets, through the policy\n\
                      interface; docs/formats/lerobot-dataset.md says what is measured.")]
    Data(LabDataArguments),
    /// Hand the program changed files of every kind, in calls of its own under limits of memory and time
    #[command(
        after_help = "Examples:\n  genmanip-lab hostile --seed 1 --minutes 30 --refusals refusals.txt --json\n  \
                      genmanip-lab hostile --seed 1 --minutes 0 --races 200 --kills 50 --json\n\n\
                      Run it in the project's folder; Ctrl-C ends it with what was measured until then.\n\
                      Minutes are processor time of all calls; each may use 1 GiB and 10 s.\n\
                      What once broke something lies in crates/lab/testdata/hostile and is tried first."
    )]
    Hostile(HostileArguments),
    /// Draw an episode over a crowded table and say what its pictures cost, and whether continued ones are exact
    #[command(after_help = "Example:\n  genmanip-lab render --seed 1 --json\n  \
                      genmanip-lab render --seed 1 --flip 10 --out out/flip\n\n\
                      One thread, processor time, medians over the frames of the episode; the static camera is drawn \
                      first and draws the shadows, which the wrist camera shares.")]
    Render(LabRenderArguments),
    /// Fit the weights of the score of grasps from points to trials, and say how true its chances are on others
    #[command(after_help = "Example:\n  genmanip-lab fit dev-1.jsonl dev-2.jsonl --test fresh.jsonl\n\n\
                      The files are written by lab grasp --out; docs/concepts/grasps.md says which.")]
    Fit(FitArguments),
    /// Segment what the data cameras see, from colour and depth, and compare with the renderer's ids
    #[command(after_help = "Examples:\n  genmanip-lab segment --seed 1 --count 60 --json\n  \
                      genmanip-lab segment --seed 1 --count 60 --noise d435 --out out/segment\n\n\
                      Scenes of 5 to 12 objects, two views each; objects with at least 200 visible pixels count.")]
    Segment(SegmentArguments),
    /// Copy a run's episodes to any number, and measure what the report, opening and resuming cost
    #[command(after_help = "Example:\n  genmanip-lab scale --run out/run --episodes 10000 --out out/scaled --json\n\n\
                      The copies are further attempts at the same tasks, under ids of their own; synthetic.json marks \
                      the folder.")]
    Scale(ScaleArguments),
    /// Repeat evaluations with known success rates, and say how often intervals cover and tests err
    #[command(after_help = "Example:\n  genmanip-lab statistics --seed 1 --repetitions 20000 --json\n\n\
                      Rates from 2 to 98 %, 50 and 200 scenarios of one and of five episodes; differences by scenario,\n\
                      which take a bootstrap each, are repeated a tenth as often.")]
    Statistics(LabStatisticsArguments),
    /// Check a frozen suite, and let the expert try its scenarios by streams that they were not chosen by
    #[command(after_help = "Example:\n  genmanip-lab suite --suite suites/mine --json")]
    Suite(LabSuiteArguments),
    /// Draw cards for readers who know nothing but picture and sentence, and compare their answers with what is meant
    #[command(after_help = "Examples:\n  genmanip-lab readers --suite suites/mine --out out/cards\n  \
                      genmanip-lab readers --suite suites/mine --answers one.json,two.json --json\n  \
                      genmanip-lab readers --ends out/evaluated --count 200 --out out/ends\n\n\
                      out/cards/questions.json says what is asked and how it is answered. Episodes come from\n\
                      `evaluate --keep-episodes --out`. Answers belong to the cards of the same seed.")]
    Readers(LabReadersArguments),
}

/// Arguments of `genmanip-lab statistics`.
#[derive(Debug, Args)]
pub struct LabStatisticsArguments {
    /// Seed of the simulation
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Evaluations per setting
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = parse::count)]
    pub repetitions: usize,
}

/// Arguments of `genmanip-lab scale`.
#[derive(Debug, Args)]
pub struct ScaleArguments {
    /// Finished run to copy
    #[arg(long, value_name = "DIR")]
    pub run: PathBuf,
    /// Episodes to copy it to
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub episodes: usize,
    /// Empty folder for the copies: 0.5 MB per episode
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `genmanip-lab segment`.
#[derive(Debug, Args)]
pub struct SegmentArguments {
    /// Seed of tasks, layouts and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Scenes, each seen by two cameras
    #[arg(long, default_value_t = 40, value_parser = parse::count)]
    pub count: usize,
    /// Depth as this camera measures it, instead of the exact one
    #[arg(long, value_parser = ["d435"])]
    pub noise: Option<String>,
    /// Where masks come from; `oracle` is the renderer's truth
    #[arg(long, default_value = "rgbd", value_name = "rgbd|oracle|http:URL")]
    pub masks: String,
    /// Fit the weights by which regions are joined to these scenes, instead of measuring
    #[arg(long, conflicts_with_all = ["masks", "out"])]
    pub fit: bool,
    /// Folder for pictures of the worst views: image, truth, masks
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `genmanip-lab hostile`.
#[derive(Debug, Args)]
pub struct HostileArguments {
    /// Seed of the changes
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Processor time of all calls together, minutes
    #[arg(long, default_value_t = 1.0, value_parser = parse_minutes)]
    pub minutes: f64,
    /// Change only this kind
    #[arg(long, value_parser = genmanip_lab::hostile::KINDS)]
    pub kind: Option<String>,
    /// Write all messages to this file
    #[arg(long, value_name = "FILE")]
    pub refusals: Option<PathBuf>,
    /// Copy what broke something into this folder
    #[arg(long, value_name = "DIR")]
    pub found: Option<PathBuf>,
    /// Also measure every reader on files of its largest size
    #[arg(long)]
    pub readers: bool,
    /// Also race so many pairs of starts with different seeds for one folder
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = parse_few)]
    pub races: usize,
    /// Also kill so many runs at random moments, continue them and compare the bytes
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = parse_few)]
    pub kills: usize,
    /// The project's folder, for its examples
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
    /// Episodes, the kinds in turn, without those that open and shut things
    #[arg(long, default_value_t = 64, value_parser = parse::count)]
    pub count: usize,
    /// Episodes under way at once
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = parse::count)]
    pub at_once: usize,
    /// Cores that they share [default: all]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// How long the server takes to answer, s
    #[arg(long, default_value_t = 2.0, value_name = "S", value_parser = parse_minute)]
    pub latency: f64,
    /// Share of the requests with which something goes wrong, 0 to 1
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
    /// Trials to fit to
    #[arg(required = true, value_name = "FILE")]
    pub trials: Vec<PathBuf>,
    /// Keep the weights in use, and so the ranking: fit only their constant
    #[arg(long)]
    pub constant: bool,
    /// Other trials, to see how true the chances are
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub test: Vec<PathBuf>,
}

/// Arguments of `genmanip-lab environment`.
#[derive(Debug, Args)]
pub struct EnvironmentArguments {
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Designed tasks, one attempt of the expert each
    #[arg(long, default_value_t = 10, value_parser = parse::count)]
    pub count: usize,
    /// Step through the episodes stored here instead: a run, its episodes, or one of them
    #[arg(long, value_name = "DIR")]
    pub store: Option<PathBuf>,
    /// Objects: `builtin` (64 made by hand) or `full` (with those that families make, 1,120 in all)
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `genmanip-lab data`.
#[derive(Debug, Args)]
pub struct LabDataArguments {
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Designed tasks, one attempt of the expert each; with --synthetic episodes
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub episodes: usize,
    /// Made-up episodes of 30 rows with pictures of 64x64, to measure what checking and opening a large dataset costs
    #[arg(long)]
    pub synthetic: bool,
    /// Write the made-up episodes also as so many datasets, and merge these
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
    /// Scenes of which the picture is also compared with a traced one (LDR-FLIP)
    #[arg(long, value_name = "SCENES", default_value_t = 0)]
    pub flip: usize,
    /// Light paths per pixel of the traced pictures
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub paths: u32,
    /// Folder for both pictures of each scene
    #[arg(long, value_name = "DIR", requires = "flip")]
    pub out: Option<PathBuf>,
    /// Also draw a table of 150,000 triangles with MuJoCo's and PyBullet's renderers
    #[arg(long)]
    pub baselines: bool,
    /// Python with the packages mujoco, pybullet and numpy
    #[arg(long, value_name = "PROGRAM", requires = "baselines", default_value = ".python/bin/python")]
    pub python: PathBuf,
}

/// Arguments of `genmanip-lab design`.
#[derive(Debug, Args)]
pub struct DesignArguments {
    /// Seed
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Tasks, the six kinds in turn
    #[arg(long, default_value_t = 300, value_parser = parse::count)]
    pub count: usize,
    /// Objects: `builtin` (64 made by hand) or `full` (with those that families make, 1,120 in all)
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `genmanip-lab answers`.
#[derive(Debug, Args)]
pub struct AnswersArguments {
    /// Seed of the fuzzer
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Texts that the fuzzer makes
    #[arg(long, default_value_t = 10_000, value_parser = parse::count)]
    pub count: usize,
    /// Fuzz for so many minutes of processor time instead
    #[arg(long, conflicts_with = "count")]
    pub minutes: Option<f64>,
    /// Recorded answers to check and to start from: a file or a folder
    #[arg(long, value_name = "PATH", default_value = "examples/tasks")]
    pub answers: PathBuf,
}

/// Arguments of `genmanip-lab relations`.
#[derive(Debug, Args)]
pub struct RelationsArguments {
    /// Recorded cases; the archive of clouds beside it has the ending .npz
    #[arg(long, value_name = "FILE", required_unless_present = "rendered")]
    pub cases: Option<PathBuf>,
    /// Judge: genmanip-0.9, suite-0.2.3 or seed
    #[arg(long, required_unless_present = "rendered")]
    pub profile: Option<String>,
    /// Compare clouds from rendered depth and ids with posed geometry
    #[arg(long, conflicts_with_all = ["cases", "profile"])]
    pub rendered: bool,
    /// Seed of the layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed, requires = "rendered")]
    pub seed: u64,
    /// Scenes that are laid out
    #[arg(long, default_value_t = 500, requires = "rendered", value_parser = parse::count)]
    pub count: usize,
    /// Tasks that are laid out in turn: a file or a folder
    #[arg(long, value_name = "PATH", default_value = "examples/tasks", requires = "rendered")]
    pub tasks: PathBuf,
}

/// Arguments of `genmanip-lab expert`.
#[derive(Debug, Args)]
pub struct ExpertArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's: panda, panda_2f85, ur5e_2f85 or one of --robots
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Seed of tasks, layouts and attempts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Tasks of the rule-based designer, the six kinds in turn
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub count: usize,
    /// Attempts at a task before it counts as not solved
    #[arg(long, default_value_t = 5)]
    pub tries: u64,
    /// Tasks of your own instead of designed ones: files or folders
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
    /// Objects: `builtin` (64 made by hand) or `full` (with those that families make, 1,120 in all)
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// The agent that is measured, and on which kinds of tasks.
#[derive(Debug, Args)]
pub struct AgentChoiceArguments {
    /// Kinds of tasks; `articulated` cannot be done by picking and placing
    #[arg(long, value_delimiter = ',', default_value = "pick_and_place,spatial,appearance,common_sense,long_horizon")]
    pub kinds: Vec<String>,
    /// Who answers: `oracle` (the simulator's truth), or the settings file of a model, which makes its own mistakes
    #[arg(long, default_value = "oracle", value_name = "oracle|FILE")]
    pub vlm: String,
    /// Where masks come from
    #[arg(long, default_value = "rgbd", value_name = "rgbd|oracle|http:URL")]
    pub masks: String,
    /// One cell for the placement, or a path over the grid
    #[arg(long, default_value = "p2p", value_parser = ["p2p", "grid"])]
    pub path: String,
    /// As published, or with everything that makes it sturdier
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
    /// Episodes, the kinds in turn
    #[arg(long, default_value_t = 60, value_parser = parse::count)]
    pub count: usize,
    #[command(flatten)]
    pub agent: AgentChoiceArguments,
    /// Ask for the part to hold, too
    #[arg(long)]
    pub ctof: bool,
    /// Let the oracle answer a share of a stage's asks wrongly, and test the failure analysis by that
    #[arg(long, value_name = "STAGE=SHARE")]
    pub error: Vec<String>,
    /// Write each episode's transcript and pictures into this folder
    #[arg(long, value_name = "FOLDER")]
    pub transcripts: Option<PathBuf>,
    /// Write a page about what failed: causes by kind, an episode with its pictures per cause, relations meant and resulting
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
    /// Failed episodes of each class
    #[arg(long, default_value_t = 30, value_parser = parse::count)]
    pub per_class: usize,
    /// What the mistakes are to make fail [default: all but `service`]
    #[arg(long, value_delimiter = ',', value_name = "CLASS")]
    pub classes: Vec<String>,
    /// Episodes without a mistake on purpose, of which those that fail are taken up again too
    #[arg(long, default_value_t = 60)]
    pub natural: usize,
    #[command(flatten)]
    pub agent: AgentChoiceArguments,
    /// `open` splits the task and picks each thing once, so that a mistake is seldom made good
    #[arg(long = "loop", default_value = "open", value_name = "open|closed", value_parser = ["open", "closed"])]
    pub closed_loop: String,
}

/// Arguments of `genmanip-lab layout`.
#[derive(Debug, Args)]
pub struct LabLayoutArguments {
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's: panda, panda_2f85, ur5e_2f85 or one of --robots
    #[arg(long, value_name = "NAME")]
    pub robot: Option<String>,
    /// Seed of tasks and layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Tasks to design and lay out; with --tasks: layouts of each
    #[arg(long, default_value_t = 100, value_parser = parse::count)]
    pub count: usize,
    /// Tasks instead of designed ones: recorded answers, task documents or folders of them
    #[arg(long, value_name = "PATH")]
    pub tasks: Vec<PathBuf>,
    /// Unmentioned objects to add to each scene
    #[arg(long, default_value_t = 0)]
    pub distractors: usize,
    /// Objects: `builtin` (64 made by hand) or `full` (with those that families make, 1,120 in all)
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
}

/// Arguments of `genmanip-lab assets`.
#[derive(Debug, Args)]
pub struct LabAssetsArguments {
    /// Seed of the objects
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Objects to make, the families in turn
    #[arg(long, default_value_t = 100, value_parser = parse::count)]
    pub count: usize,
    /// Only this family
    #[arg(long, value_name = "NAME")]
    pub family: Option<String>,
    /// Take the families from the data files of this folder
    #[arg(long, value_name = "DIR")]
    pub families: Option<PathBuf>,
    /// Try the imported objects of the packs in this folder instead
    #[arg(long, value_name = "DIR", conflicts_with_all = ["count", "family", "families"])]
    pub imported: Option<PathBuf>,
    /// Threads; the figures in processor time are of one
    #[arg(long, value_name = "N")]
    pub workers: Option<usize>,
}

/// Arguments of `genmanip-lab grasp`.
#[derive(Debug, Args)]
pub struct GraspArguments {
    /// Seed of things, views and noise
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Trials per class
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub count: u64,
    /// Cloud of the target: full surface, one noisy view, or three fused ones
    #[arg(long, default_value = "full", value_parser = ["full", "one", "three"])]
    pub view: String,
    /// Class to try, all without
    #[arg(long, value_parser = ["compact", "utensils", "clutter"])]
    pub class: Option<String>,
    /// Candidate to carry out: the best, or any, for judging the scores
    #[arg(long, default_value = "best", value_parser = ["best", "any"])]
    pub pick: String,
    /// File for one line of JSON per trial
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
