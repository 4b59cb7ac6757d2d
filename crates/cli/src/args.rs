//! Command-line arguments.

use genmanip_assets::CATALOGUES;
use genmanip_core::AssetUid;
use genmanip_terminal::{GlobalArguments, parse};
use std::path::PathBuf;

use clap::builder::{ArgPredicate, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use genmanip_pipeline::policies;
use split::SplitArguments;

pub use agent::*;
pub use assets::*;
pub use calibrate::*;
pub use collect::*;
pub use data::*;
pub use edit::*;
pub use evaluate::*;
pub use export::*;
pub use identify::*;
pub use launch::*;
pub use plan::*;
pub use real::*;
pub use render::*;
pub use review::*;
pub use robot::*;
pub use serve::*;
pub use skills::*;
pub use studio::*;
pub use suite::*;
pub use teleop::*;
pub use train::*;
pub use world::*;

mod agent;
mod assets;
mod calibrate;
mod collect;
mod data;
mod edit;
mod evaluate;
mod export;
mod identify;
mod launch;
mod parse_values;
mod plan;
mod real;
mod render;
mod review;
mod robot;
mod serve;
mod skills;
mod sources;
mod split;
mod studio;
mod suite;
mod teleop;
mod train;
mod world;

/// Manipulation tasks from one sentence to verified demonstrations, datasets and fair evaluations – on a CPU.
#[derive(Debug, Parser)]
#[command(name = "genmanip", version, about, max_term_width = 100)]
#[command(after_help = "Exit codes: 0 done, 1 the request could not be met, 2 the command line was not understood,\n\
                        130 stopped by a second Ctrl-C. Data goes to stdout, messages to stderr.")]
pub struct Arguments {
    /// Options of every subcommand
    #[command(flatten)]
    pub global: GlobalArguments,
    /// Subcommand
    #[command(subcommand)]
    pub command: Command,
}

/// Subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the whole pipeline on recorded language-model answers: tasks, layouts, demonstrations, dataset, evaluation,
    /// report
    #[command(after_help = "Example:\n  genmanip demo --out out/demo")]
    Demo(DemoArguments),
    /// Invent, check and show tasks
    Task {
        /// Subcommand
        #[command(subcommand)]
        command: TaskCommand,
    },
    /// Lay tasks out: poses for every object such that the whole scene graph holds
    #[command(after_help = "Example:\n  genmanip layout examples/tasks --count 4 --seed 7 --out out/scenarios")]
    Layout(LayoutArguments),
    /// Plan one motion of the arm, in a scenario or an empty world: to a grasp, to a point or to joint positions
    #[command(
        after_help = "Examples:\n  genmanip plan out/scenarios/017_pick_and_place-000.json --pick 032 --picture plan.png\n  \
                      genmanip plan SCENARIO --to 0.5,-0.2,0.15 --yaw 45 --animation plan.mp4\n  \
                      genmanip plan --robot ur5e_2f85 --to 0.5,-0.2,0.15 --picture plan.png\n\n\
                      The robot's base frame: x ahead, y to its left, z up, the table at z = 0."
    )]
    Plan(PlanArguments),
    /// Collect verified demonstrations with the expert and export them as LeRobotDataset v3.0
    #[command(
        after_help = "An interrupted run continues where it stopped: start the same command again.\n\nExample:\n  \
                      genmanip collect examples/tasks --episodes 2 --seed 7 --out out/run\n  \
                      genmanip collect examples/tasks --seed 7 --out out/shards --shard 0/3"
    )]
    Collect(CollectArguments),
    /// Merge the shards of a run and write its dataset: the same bytes as an undivided run
    #[command(
        after_help = "Examples:\n  genmanip collect TASKS --out out/shards --shard 0/3   # and 1/3, 2/3, anywhere\n  \
                      genmanip merge out/shards --out out/run\n\n\
                      Missing pieces are named, and nothing is merged; --finish makes them here. Episodes are linked\n\
                      where the disk allows that, and the shards stay as they are."
    )]
    Merge(MergeArguments),
    /// Divide `collect` among the machines of a cluster: a job array with time and memory from a measured sample
    #[command(
        after_help = "Examples:\n  genmanip launch --slurm --shards 100 -- collect tasks --seed 7 --out /shared/shards\n  \
                      genmanip launch --local --shards 8 --at-once 4 --dry-run -- collect tasks --out out/shards\n  \
                      genmanip merge /shared/shards --out out/run\n\n\
                      A few attempts are made first, in OUT/sample, to learn what the others need. The job is then written\n\
                      into OUT and submitted. A shard that was killed goes on where it stopped; submit the job again to\n\
                      finish what is missing."
    )]
    Launch(LaunchArguments),
    /// Evaluate policies on the scenarios of a run, or on any scenario files
    #[command(after_help = evaluate_help())]
    Evaluate(EvaluateArguments),
    /// Compare two policies from their evaluations on the same scenarios
    #[command(
        after_help = "Example:\n  genmanip compare out/run/evaluation/agent.json out/run/evaluation/do_nothing.json\n\n\
                      Episodes are paired by scenario and seed; tests are exact, by scenario where scenarios have\n\
                      several episodes. docs/guides/evaluate.md says how."
    )]
    Compare(CompareArguments),
    /// Measure the agreement of success rates in simulation and in reality: MMRV, correlations, rank violations,
    /// intervals
    #[command(
        name = "sim2real",
        after_help = "Examples:\n  genmanip sim2real examples/sim2real/rates.csv --svg out/agreement.svg\n  \
                      genmanip sim2real examples/sim2real/pairs.csv --json\n\n\
                      Columns are found by name, in any order:\n  \
                      task, policy, world (sim or real), trials, successes\n  \
                      task, policy, sim, real (rates from 0 to 1), trials or sim_trials and real_trials\n  \
                      first, second, world, first_wins, second_wins, ties: preferences between two policies\n\
                      Task, trials of rates and ties may be left out; docs/guides/sim-against-real.md has the rest."
    )]
    SimToReal(SimToRealArguments),
    /// Build, check and show suites of frozen scenarios
    Suite {
        /// Subcommand
        #[command(subcommand)]
        command: SuiteCommand,
    },
    /// Write a table of all evaluations below a folder, one for each suite
    #[command(after_help = "Example:\n  genmanip leaderboard out --html out/leaderboard.html > leaderboard.md\n\n\
                      Policies that read simulator truth stand in a table of their own.")]
    Leaderboard(LeaderboardArguments),
    /// Let the agent plan from image files, without a simulator
    Agent {
        /// Subcommand
        #[command(subcommand)]
        command: AgentCommand,
    },
    /// Compare the agent with variants that differ in one setting (ablation), on the scenarios of a run
    #[command(after_help = "Examples:\n  \
                      genmanip ablate out/run --agent vlm=model.toml,masks=rgbd --at-once 16\n  \
                      genmanip ablate out/run --vary path,loop --json\n\n\
                      Settings: ctof, path (grid), loop (open), reasoning, camera (left, right), preset (paper). The \
                      evaluations are kept in the run like any other, and are not run again.")]
    Ablate(AblateArguments),
    /// Replay a recorded episode, or check that its commands lead to the identical final state
    #[command(after_help = "Example:\n  genmanip replay --check out/run/episodes")]
    Replay(ReplayArguments),
    /// Render scenarios and recorded episodes without physics, in the original or a randomised appearance
    #[command(after_help = "Examples:\n  genmanip render out/run --out out/films --variation 7\n  \
                      genmanip render SCENARIO --out out/pictures --cameras static --size 1280x720 --channels rgb,depth,ids\n\n\
                      Parts of a look: light, background (walls), material (of the table), objects (tint and gloss), camera.\n\
                      render.json beside the pictures says what was drawn; docs/guides/render.md has the rest.")]
    Render(RenderArguments),
    /// Write the HTML report of a run
    #[command(
        after_help = "Examples:\n  genmanip report out/run\n  genmanip report out/run --only 017_pick_and_place-000"
    )]
    Report(ReportArguments),
    /// Export a run as a dataset, or a scenario to another program's format
    #[command(after_help = "Examples:\n  genmanip export out/run --to lerobot --action ee --rotation 6d --rate 15\n  \
                      genmanip evaluate out/run --policy playback:dataset=out/run/exports/lerobot-ee-6d-15hz\n  \
                      genmanip export --mjcf out/run/scenarios/017_pick_and_place-000.json > scene.xml\n  \
                      genmanip export --glb out/run/scenarios/017_pick_and_place-000.json --out scene.glb\n  \
                      genmanip export --usd out/run/scenarios/017_pick_and_place-000.json --out scene.usda\n\n\
                      Pictures of another rate are drawn from the recorded states; docs/formats/lerobot-dataset.md\n\
                      says what the columns mean.")]
    Export(ExportArguments),
    /// Train a policy on the demonstrations of a run or a suite; needs a build with learned policies: cargo xtask
    /// install --learn
    #[command(after_help = "Examples:\n  genmanip train out/run --preset state --check\n  \
                      genmanip train out/run --preset state --budget 15m --out out/policy\n  \
                      genmanip evaluate out/unseen --policy learned:out/policy\n  \
                      genmanip train genmanip-learn-10 --distribution into --demos 300 --preset state --budget 15m \\\n    \
                      --out out/into\n\n\
                      A training that was interrupted or killed continues where it stopped: start the same command\n\
                      again. Same seed and number of steps: same weights, bit for bit. DIR/metrics.csv holds the losses.")]
    Train(TrainArguments),
    /// Check datasets and show what is in them
    Data {
        /// Subcommand
        #[command(subcommand)]
        command: DataCommand,
    },
    /// Test grasps of the catalogue's objects in physics in advance, and show them
    Grasps {
        /// Subcommand
        #[command(subcommand)]
        command: GraspsCommand,
    },
    /// List, find, show, draw, export and audit objects
    Assets {
        /// Subcommand
        #[command(subcommand)]
        command: AssetsCommand,
    },
    /// Add robots from their URDF
    Robot {
        /// Subcommand
        #[command(subcommand)]
        command: RobotCommand,
    },
    /// Write, check and show worlds: support surfaces, robot, cameras, physics and relation settings
    World {
        /// Subcommand
        #[command(subcommand)]
        command: WorldCommand,
    },
    /// Change a scenario by operations that can be undone, judge it, and repair it
    Edit(EditArguments),
    /// Review scenarios independently, measure agreement and balance, and write a suite of what was approved
    Review(ReviewArguments),
    /// List, change and preview the cameras of worlds and scenarios
    Camera {
        /// Subcommand
        #[command(subcommand)]
        command: CameraCommand,
    },
    /// Moved: measurements are the program `genmanip-lab`
    #[command(hide = true, disable_help_flag = true)]
    Lab {
        /// Ignored arguments
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        rest: Vec<String>,
    },
    /// Calibrate the pose of a camera, on the hand or beside the robot, from views of a board and robot states
    #[command(after_help = "Examples:\n  genmanip calibrate plan --camera wrist --board-at 0.5,0,0\n  \
                      genmanip calibrate examples/calibrate/wrist.json --world world.toml\n  \
                      genmanip calibrate board --out board.svg\n\n\
                      Views are paired by id. Sets that cannot determine the pose are refused with the motion that is\n\
                      missing. docs/guides/calibrate-a-camera.md has the file and the frames.")]
    Calibrate(CalibrateArguments),
    /// Identify parameters of the simulated arm from recorded commands and joint positions
    #[command(after_help = "Examples:\n  genmanip identify excite --out motion.json\n  \
                      genmanip identify rehearse motion.json --world truth.toml --out recording.json\n  \
                      genmanip identify recording.json --out world.toml\n\n\
                      Gains, damping, dry friction, latency, payload, friction of pads and table: what the recordings\n\
                      do not show is named, with a motion that would. docs/guides/identify-your-arm.md")]
    Identify(IdentifyArguments),
    /// Run policies on a real arm behind a bridge, or on a simulated one in its place
    Real {
        /// Subcommand
        #[command(subcommand)]
        command: RealCommand,
    },
    /// Open scenarios in the browser: see each scene, change it, and see at once if the task still works
    #[command(after_help = "Examples:\n  genmanip studio out/run\n  genmanip studio genmanip-200-rc --no-open\n\n\
                            docs/guides/studio.md has the parts of the page and every operation over HTTP.")]
    Studio(StudioArguments),
    /// Move the robot of a scenario with a SpaceMouse, without a browser, and keep what you did as an episode
    #[command(
        after_help = "Examples:\n  genmanip teleop out/run/scenarios/017_pick_and_place-000.json --device /dev/hidraw0\n  \
                            genmanip teleop out/run/scenarios/017_pick_and_place-000.json --device /dev/hidraw0 --watch\n\n\
                            Type a letter and Enter: p pause or go on, b back 5 s, t take over or hand over, n begin anew,\n\
                            k keep, l keep without idle ends, x discard. docs/guides/teleoperate.md"
    )]
    Teleop(TeleopArguments),
    /// Serve masks, grasps, motions or environments to other programs over HTTP; local only by default
    Serve {
        /// Service to run
        #[command(subcommand)]
        command: ServeCommand,
    },
    /// Cut skills from a few takes and transfer them to many scenes
    Skills {
        /// Subcommand
        #[command(subcommand)]
        command: SkillsCommand,
    },
    /// Check this machine: what is available, what is missing and how to fix it
    #[command(after_help = "Example:\n  genmanip doctor")]
    Doctor,
}

/// Help of `--objects`, which means the same everywhere.
const OBJECTS: &str = "Objects: uids separated by commas, or words as with `assets search`";

/// Subcommands of `task`.
#[derive(Debug, Subcommand)]
pub enum TaskCommand {
    /// Invent tasks and write them as task documents
    #[command(after_help = "Example:\n  genmanip task new --kind all --count 60 --seed 7 --out out/tasks")]
    New(NewArguments),
    /// Judge language-model answers against every rule; exit 1 when any is rejected
    #[command(after_help = "Examples:\n  genmanip task check examples/tasks/*.json\n  \
                            genmanip task check tasks.jsonl --json\n  \
                            genmanip task check answer.txt --objects 001,019,051 --kind pick_and_place")]
    Check(CheckArguments),
    /// Show a task: instruction, goal and scene graph
    #[command(after_help = "Example:\n  genmanip task show examples/tasks/017_pick_and_place.json --svg graph.svg")]
    Show(ShowArguments),
}

/// Subcommands of `grasps`.
#[derive(Debug, Subcommand)]
pub enum GraspsCommand {
    /// Test grasp candidates of every graspable object in several physics trials with small pose errors, and store how
    /// often each held
    #[command(
        after_help = "An interrupted run continues where it stopped: start the same command again.\n\nExamples:\n  \
                      genmanip grasps bake --out crates/assets/data/grasps.json\n  \
                      genmanip grasps bake --out out/mug.json --objects 001 --count 100\n  \
                      genmanip grasps bake --out out/cartons.json --catalog full --objects egg-carton-1,egg-carton-2 --brief"
    )]
    Bake(BakeArguments),
    /// Show the tested grasps of an object; with --json also as rows in GraspNet's convention
    #[command(after_help = "Example:\n  genmanip grasps show 001 --json")]
    Show(ShowGraspsArguments),
}

/// Arguments of `grasps bake`.
#[derive(Debug, Args)]
pub struct BakeArguments {
    /// File to write; objects already in it are kept if they were tried with the same settings
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Seed of candidates and trials
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Maximum number of grasp candidates per object
    #[arg(long, default_value_t = 24, value_parser = parse::count)]
    pub count: usize,
    /// Number of trials per candidate, 1 to 1000
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub trials: u32,
    /// Keep four grasps per object that held in all of three trials with mass and friction changed by up to 20 %: about
    /// 2 s of CPU time per object
    #[arg(long, conflicts_with_all = ["count", "trials"])]
    pub brief: bool,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all`
    #[arg(long, value_name = "NAME", default_value = "builtin", value_parser = CATALOGUES)]
    pub catalog: String,
    #[arg(long, value_name = "UID,…|QUERY", help = format!("{OBJECTS} [default: all that can be grasped]"))]
    pub objects: Option<String>,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Robot whose gripper tries them
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot whose gripper tries them"))]
    pub robot: Option<String>,
}

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowGraspsArguments {
    /// Uid of the object
    pub uid: AssetUid,
    /// File of `grasps bake` instead of the grasps that come with the program
    #[arg(long, value_name = "FILE")]
    pub file: Option<PathBuf>,
}

/// Arguments of `task new`.
#[derive(Debug, Args)]
pub struct NewArguments {
    /// A request in plain words, such as "put the red mug to the left of the bowl": its objects are taken from the
    /// catalogue and a scene is composed for it; directions are as seen from the robot
    #[arg(long, value_name = "SENTENCE", conflicts_with_all = ["kind", "copies", "fill", "include", "world"])]
    pub text: Option<String>,
    /// Kind of tasks: pick_and_place, spatial, appearance, common_sense, long_horizon, articulated, or all in turn
    #[arg(long, default_value = "all")]
    pub kind: String,
    /// Number of tasks; of scenes for the sentence of --text [default for --text: 1]
    #[arg(long, default_value_t = 12, default_value_if("text", ArgPredicate::IsPresent, "1"), value_parser = parse::count)]
    pub count: usize,
    /// Seed of the tasks
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Task designer: `rules` (rule-based), or `llm` (a language model)
    #[arg(long, default_value = "rules")]
    pub designer: String,
    /// Share of scenes with a second copy of something, 0 to 1; only with --designer rules
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub copies: f64,
    /// Make tasks of the other kinds if the designer finds no further task of a kind; only with --designer rules
    #[arg(long)]
    pub fill: bool,
    /// Print a row per task even if there are more than 30
    #[arg(long)]
    pub each: bool,
    /// Settings of the language model, TOML; only with --designer llm
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// Source of the model's answers, instead of that in the settings: `live` (ask the model), `record` (also store its
    /// answers) or `replay` (use stored answers only)
    #[arg(long, value_name = "MODE")]
    pub cassettes: Option<String>,
    /// Answer the questions yourself: they are written into this folder, and an answer.json is awaited beside each
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// Objects: `builtin` (64 made by hand), `full` (with those that families make, 1,120 in all), `imported` (of
    /// --packs) or `all` [default for --text: full]
    #[arg(
        long,
        value_name = "NAME",
        default_value = "builtin",
        default_value_if("text", ArgPredicate::IsPresent, "full"),
        value_parser = CATALOGUES
    )]
    pub catalog: String,
    #[arg(long, value_name = "UID,…|QUERY", help = format!("{OBJECTS} [default: all of the catalogue]"))]
    pub objects: Option<String>,
    /// Object that the goal of every task involves; only with --designer rules
    #[arg(long, value_name = "UID")]
    pub include: Option<AssetUid>,
    #[arg(
        long,
        value_name = "NAME",
        help = genmanip_terminal::robot_help("Robot to design for: its reach and what its gripper holds; only with --designer rules")
    )]
    pub robot: Option<String>,
    /// World whose further support surfaces tasks may name; only with --designer llm
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Folder for the task documents
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `task check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// Task documents, recorded answers, folders of both, or lists with a task document per line, *.jsonl; or bare
    /// answers together with --objects
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Print a row per answer even if there are more than 30, valid ones included
    #[arg(long)]
    pub each: bool,
    #[arg(long, value_name = "UID,…|QUERY", help = format!("{OBJECTS}; those that were offered, for a bare answer"))]
    pub objects: Option<String>,
    /// World whose further support surfaces were offered too, for a bare answer
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Kind of task that was asked for, for a bare answer
    #[arg(long, default_value = "pick_and_place")]
    pub kind: String,
    /// Minimum number of objects that was asked for, for a bare answer [default: 2, or 1 if one was offered]
    #[arg(long, value_name = "N")]
    pub min_objects: Option<usize>,
    /// File for the checked task, repaired if need be; needs a single answer or document
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Arguments of `task show`.
#[derive(Debug, Args)]
pub struct ShowArguments {
    /// A recorded answer or a task document
    pub file: PathBuf,
    /// Also write the scene graph to this SVG file
    #[arg(long)]
    pub svg: Option<PathBuf>,
}

/// Arguments of `layout`.
#[derive(Debug, Args)]
pub struct LayoutArguments {
    /// Tasks: recorded answers, task documents or folders of them
    #[arg(required_unless_present = "suite")]
    pub tasks: Vec<PathBuf>,
    /// Suite of task distributions whose layouts are written, folder or name, instead of tasks
    #[arg(long, value_name = "NAME|DIR", conflicts_with_all = ["tasks", "count", "seed", "distractors"], value_parser = genmanip_benchmark::suites::parse_folder)]
    pub suite: Option<PathBuf>,
    #[command(flatten)]
    pub layouts: SplitArguments,
    /// Number of layouts per task
    #[arg(long, default_value_t = 1, value_parser = parse::count)]
    pub count: usize,
    /// World in which layouts are made: TOML or JSON, see `genmanip world init` [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    pub world: Option<PathBuf>,
    /// Robot instead of the world's
    #[arg(long, value_name = "NAME", help = genmanip_terminal::robot_help("Robot instead of the world's"))]
    pub robot: Option<String>,
    /// Seed of the layouts
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Folder for the scenario files
    #[arg(long)]
    pub out: PathBuf,
    /// Number of objects to add to each scene, 0 to 20, that the instruction does not mention and that do not make it
    /// ambiguous
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=20).map(usize::from))]
    pub distractors: usize,
    /// Also write an SVG per layout: the scene graph beside the layout, or the reason why there is none
    #[arg(long)]
    pub explain: bool,
    /// Print a row per layout even if there are more than 30
    #[arg(long)]
    pub each: bool,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Help after the options of `evaluate`: the policies of the registry, and examples.
fn evaluate_help() -> String {
    let policies: String = policies::describe().lines().map(|line| format!("  {line}\n")).collect();
    format!(
        "Policies:\n{policies}\nExamples:\n  genmanip evaluate out/run --policy expert --policy replay\n  \
         genmanip evaluate scenarios/ --policy do_nothing:seconds=2 --out out/still\n\n\
         Results are kept as they come: start again to continue. With --out, episodes are kept too;\n\
         genmanip replay OUT/evaluation/POLICY --strip film.jpg shows them, genmanip report OUT all."
    )
}

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct DemoArguments {
    /// Folder to write the run to
    #[arg(long, default_value = "out/demo")]
    pub out: PathBuf,
    /// Task files, or folders of them, instead of the built-in examples
    #[arg(long)]
    pub tasks: Vec<PathBuf>,
    /// Number of attempts per task
    #[arg(long, default_value_t = 2, value_parser = parse::count)]
    pub episodes: usize,
    /// Seed of layouts and motion planning
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Rate of images and dataset rows, Hz: 10, 15, 20, 30 or 60
    #[arg(long, alias = "fps", value_name = "HZ", default_value_t = 15, value_parser = parse_values::parse_rate)]
    pub rate: u32,
}

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// Episode folder, or a folder of episodes
    pub episodes: PathBuf,
    /// Apply the commands in a fresh simulation and compare the final state bit by bit
    #[arg(long)]
    pub check: bool,
    /// Write a film strip of the episode as JPEG
    #[arg(long, value_name = "FILE")]
    pub strip: Option<PathBuf>,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    /// Print a row per episode even if there are more than 30
    #[arg(long)]
    pub each: bool,
}

/// Arguments of `report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArguments {
    /// Folder of a run made by `collect`
    pub run: PathBuf,
    /// Report only this task or episode of the run, given by its id, in RUN/report-ID.html
    #[arg(long, value_name = "ID")]
    pub only: Option<String>,
    /// Write a folder with a page per episode, RUN/report; existing pages are kept, only those of new episodes are made
    #[arg(long, conflicts_with = "only")]
    pub full: bool,
    /// Output path [default: RUN/report.html; with --full: RUN/report]
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Worker threads of --full; the result does not depend on it [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}
