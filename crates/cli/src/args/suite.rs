//! Arguments of `suite`.

use genmanip_terminal::parse;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use genmanip_benchmark::suite_format::ReviewVerdict;
use genmanip_benchmark::suites::{self, Axis};

/// Subcommands of `suite`.
#[derive(Debug, Subcommand)]
pub enum SuiteCommand {
    /// Design tasks, lay them out, let the expert try each, and freeze those that make a balanced suite
    #[command(
        after_help = "Example:\n  genmanip suite build examples/tasks --seed 7 --per-kind 50 --out suites/mine\n\n\
                      Spatial, appearance, common-sense and long-horizon tasks. A task whose sentence means its goal\n\
                      without its need, its places or its traits is refused, and so is what the expert does not solve\n\
                      five times of five. An interrupted build continues: start the same command again."
    )]
    Build(SuiteBuildArguments),
    /// Perturb one property of every scenario of a suite, with a given strength; the unchanged suite is the baseline
    #[command(
        after_help = "Example:\n  genmanip suite perturb suites/mine --axis camera --dial 0.5 --out suites/mine-camera\n  \
                      genmanip evaluate --suite suites/mine-camera --policy expert --out out/camera\n  \
                      genmanip compare out/control/evaluation/expert.json out/camera/evaluation/expert.json\n\n\
                      The axis `instruction` asks for something else; both requests are judged.\n\
                      Scenarios keep their ids, so that `compare` pairs them. One is left out when a thing of the task\n\
                      has fewer than 200 pixels, the expert does not solve it three times of three, or the agent with\n\
                      the oracle's answers and masks does not solve it."
    )]
    Perturb(SuitePerturbArguments),
    /// Design training tasks for a suite that share no instruction, scene graph or unseen object with it
    #[command(after_help = "Example:\n  genmanip suite train suites/mine --per-kind 250 --seed 1 --out train\n  \
                      genmanip collect train/tasks --episodes 4 --out out/train\n\n\
                      Tasks of the suite's four kinds about the objects for training; --check names what given tasks\n\
                      share with the suite instead.")]
    Train(SuiteTrainArguments),
    /// Record a person's verdict on a scenario, in review.json beside the suite
    #[command(
        after_help = "Example:\n  genmanip suite review suites/mine spatial-7-00003-000 --reviewer ada --verdict ambiguous \\\n    \
                      --note \"two mugs are left of the plate\"\n\n\
                      `suite show` counts what was said; `suite check` tells when a scenario is not the one that was\n\
                      looked at."
    )]
    Review(SuiteReviewArguments),
    /// Check that a suite is still as it was frozen, and name every difference
    #[command(
        after_help = "Examples:\n  genmanip suite check suites/mine\n  genmanip suite check genmanip-learn-10 --all\n\n\
                      Of a suite of task distributions, all frozen hashes are compared with each other, and a sample of\n\
                      the layouts is made anew."
    )]
    Check(SuiteCheckArguments),
    /// Store the objects of a suite, and hashes of what its cameras see, beside its scenarios; for a suite of task
    /// distributions the hashes of its layouts
    #[command(after_help = "Example:\n  genmanip suite freeze suites/mine\n\n\
                      From then on the suite is evaluated on with its own objects (collision pieces, inertia, cavities,\n\
                      states, recipes of what is drawn), and `suite check` names every byte, every place in which the\n\
                      catalogue differs, and every camera that sees something else.")]
    Freeze(SuiteFreezeArguments),
    /// Show what a suite contains, how it was chosen, and the distribution of its properties
    Show(SuiteArguments),
    /// Show the differences of two suites, and whether results on them can be compared
    Diff(SuiteDiffArguments),
}

/// Arguments of `suite freeze`.
#[derive(Debug, Args)]
pub struct SuiteFreezeArguments {
    /// Suite and threads
    #[command(flatten)]
    pub work: SuiteWorkArguments,
    /// Recompute the image hashes of a frozen suite, after a change of the renderer; its objects are kept
    #[arg(long)]
    pub images: bool,
}

/// Arguments of `suite check`.
#[derive(Debug, Args)]
pub struct SuiteCheckArguments {
    /// Suite and threads
    #[command(flatten)]
    pub work: SuiteWorkArguments,
    /// Recreate every layout of a suite of task distributions, instead of a sample; other suites are always checked in
    /// full
    #[arg(long)]
    pub all: bool,
}

/// Arguments of `suite check` and `suite freeze`.
#[derive(Debug, Args)]
pub struct SuiteWorkArguments {
    /// Folder of the suite, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub folder: PathBuf,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `suite build`.
#[derive(Debug, Args)]
pub struct SuiteBuildArguments {
    /// Tasks that are taken before designed ones: recorded answers, task documents or folders of them
    pub tasks: Vec<PathBuf>,
    /// Folder to write the suite to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Name of the new suite [default: name of the folder]
    #[arg(long)]
    pub name: Option<String>,
    /// Seed of tasks, layouts and trials
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Number of scenarios of each of the four kinds
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = parse::count)]
    pub per_kind: usize,
    /// Number of candidates per scenario of the suite; those that balance it best are selected
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = parse::count)]
    pub candidates: usize,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
    #[command(flatten)]
    pub catalog: super::assets::CatalogArguments,
}

/// Arguments of `suite train`.
#[derive(Debug, Args)]
pub struct SuiteTrainArguments {
    /// Folder of the test suite, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub folder: PathBuf,
    /// Folder to write the tasks to
    #[arg(long, value_name = "DIR", required_unless_present = "check")]
    pub out: Option<PathBuf>,
    /// Number of tasks of each of the four kinds
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = parse::count)]
    pub per_kind: usize,
    /// Seed of the tasks
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Design nothing: list what these task files, or folders of them, share with the suite
    #[arg(long, value_name = "TASKS", num_args = 1.., conflicts_with_all = ["out", "per_kind", "seed"])]
    pub check: Vec<PathBuf>,
}

/// Arguments of `suite perturb`.
#[derive(Debug, Args)]
pub struct SuitePerturbArguments {
    /// Folder of the suite to perturb, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub folder: PathBuf,
    /// Property to perturb
    #[arg(long, value_name = "AXIS", value_parser = parse::variant(Axis::ALL, Axis::name))]
    pub axis: Axis,
    /// Perturbation strength, above 0 and at most 1, the largest that is meant to be solvable
    #[arg(long, value_name = "D", default_value_t = 1.0)]
    pub dial: f64,
    /// Seed of the random perturbations
    #[arg(long, default_value_t = 0, value_parser = parse::seed)]
    pub seed: u64,
    /// Folder to write the new suite to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Name of the new suite [default: name of the folder]
    #[arg(long)]
    pub name: Option<String>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Arguments of `suite review`.
#[derive(Debug, Args)]
pub struct SuiteReviewArguments {
    /// Folder of the suite, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub folder: PathBuf,
    /// Id of the scenario
    #[arg(value_name = "SCENARIO")]
    pub scenario: String,
    /// Name of the reviewer
    #[arg(long, value_name = "NAME")]
    pub reviewer: String,
    /// Verdict: sound, ambiguous or flawed
    #[arg(long, value_parser = parse_verdict)]
    pub verdict: ReviewVerdict,
    /// Reason for the verdict
    #[arg(long, default_value = "")]
    pub note: String,
}

fn parse_verdict(text: &str) -> Result<ReviewVerdict, String> {
    let names = ReviewVerdict::ALL.map(ReviewVerdict::name);
    let found = ReviewVerdict::ALL.into_iter().find(|verdict| verdict.name() == text);
    found.ok_or_else(|| format!("expected one of {}", names.join(", ")))
}

/// A suite.
#[derive(Clone, Debug, Args)]
pub struct SuiteArguments {
    /// Folder of the suite, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub folder: PathBuf,
}

/// Two suites.
#[derive(Clone, Debug, Args)]
pub struct SuiteDiffArguments {
    /// Folder of the first suite, or its name
    #[arg(value_name = "SUITE", value_parser = suites::parse_folder)]
    pub first: PathBuf,
    /// Folder of the second suite, or its name
    #[arg(value_name = "OTHER", value_parser = suites::parse_folder)]
    pub second: PathBuf,
}
