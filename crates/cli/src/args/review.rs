//! Arguments of `review`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use genmanip_studio::review::{Criterion, Reason, ReviewInputs, ReviewerKind};
use genmanip_terminal::parse;
use genmanip_workspace::{Progress, WorkspaceError};

/// Arguments of `review`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
                  genmanip review suites/mine --queue --reviewer ada\n  \
                  genmanip review suites/mine --reviewer ada --approve spatial-7-00003-000 --certify spatial-7-00003-000\n  \
                  genmanip review suites/mine --reviewer bo --reject spatial-7-00003-000 --reason ambiguous\n  \
                  genmanip review suites/mine --agreement --balance --json\n  \
                  genmanip review suites/mine --build suites/reviewed --per-kind 5\n  \
                  genmanip review out/others --plant out/faulty --faults 8 --seed 7\n\n\
                  Reviews are kept in --out, where the studio keeps them too. A reviewer sees the other's review\n\
                  when both have said; an edit of the scenario voids all of them.")]
#[command(override_usage = "genmanip review [OPTIONS] [RUN|SUITE|TASKS|SCENARIO]… <ACTION>…")]
#[command(group(ArgGroup::new("action").required(true).multiple(true).args([
    "queue", "show", "approve", "reject", "send_back", "take_back", "certify", "agreement", "balance", "build", "plant",
])))]
#[command(group(ArgGroup::new("decision").args(["approve", "reject", "send_back", "take_back"])))]
pub struct ReviewArguments {
    /// Scenarios under review, as `studio` takes them [default: the scenarios in --out]
    #[arg(value_name = "RUN|SUITE|TASKS|SCENARIO")]
    pub paths: Vec<PathBuf>,
    /// Folder of the studio: copies of scenarios, and the log `reviews.jsonl`
    #[arg(long, default_value = "studio", value_name = "DIR")]
    pub out: PathBuf,
    /// List the scenarios that wait for --reviewer, and the review status of every scenario
    #[arg(long)]
    pub queue: bool,
    /// Show the reviews of a scenario that the reviewer may see
    #[arg(long, value_name = "KEY")]
    pub show: Option<String>,
    /// Approve a scenario; may be repeated, as the other decisions
    #[arg(long, value_name = "KEY", requires = "reviewer")]
    pub approve: Vec<String>,
    /// Reject a scenario, with --reason
    #[arg(long, value_name = "KEY", requires_all = ["reviewer", "reason"])]
    pub reject: Vec<String>,
    /// Send a scenario back for a change that --note names
    #[arg(long, value_name = "KEY", requires_all = ["reviewer", "note"])]
    pub send_back: Vec<String>,
    /// Withdraw the reviewer's own review of a scenario
    #[arg(long, value_name = "KEY", requires = "reviewer")]
    pub take_back: Vec<String>,
    /// Decide between two reviews that differ
    #[arg(long, requires = "decision")]
    pub adjudicate: bool,
    /// Name of the person, model or script that reviews
    #[arg(long, value_name = "NAME")]
    pub reviewer: Option<String>,
    /// Kind of reviewer: human, model or script
    #[arg(long, value_name = "KIND", default_value = "human", value_parser = parse::variant(ReviewerKind::ALL, ReviewerKind::name))]
    pub reviewer_kind: ReviewerKind,
    /// Version of a model or script
    #[arg(long, value_name = "VERSION")]
    pub reviewer_version: Option<String>,
    /// Reason of a rejection; may be repeated
    #[arg(long, value_name = "REASON", value_parser = parse::variant(Reason::ALL, Reason::name))]
    pub reason: Vec<Reason>,
    /// Judgement of a criterion (instruction_clear, goal_matches, plausible, feasible, looks_right), such as
    /// `plausible=no`; may be repeated
    #[arg(long, value_name = "NAME=yes|no", value_parser = criterion)]
    pub criterion: Vec<(Criterion, bool)>,
    /// Remark kept with the review; --send-back needs it, to say what is to be changed
    #[arg(long, value_name = "TEXT", default_value = "", hide_default_value = true)]
    pub note: String,
    /// Run the expert five times on the scenario KEY, or on `all` without trials; approval needs five successes. May be
    /// repeated
    #[arg(long, value_name = "KEY|all")]
    pub certify: Vec<String>,
    /// Show the agreement of the reviewers: raw share, Cohen's kappa, Gwet's AC1
    #[arg(long)]
    pub agreement: bool,
    /// Show the distribution of the approved scenarios over the axes of balance, and the candidates that would bring it
    /// closest to the targets
    #[arg(long)]
    pub balance: bool,
    #[command(flatten)]
    pub inputs: ReviewInputArguments,
    /// Write a balanced suite of the approved scenarios, for `suite freeze`
    #[arg(long, value_name = "DIR")]
    pub build: Option<PathBuf>,
    /// Number of scenarios of each kind [default: that of the rarest kind among the approved]
    #[arg(long, value_name = "N", requires = "build", value_parser = parse::count)]
    pub per_kind: Option<usize>,
    /// Write scenarios with planted faults into a new folder, and what was planted into DIR.txt, for --planted. The
    /// faults are planted in the named scenarios, which should not be under review themselves
    #[arg(long, value_name = "DIR", requires_all = ["faults", "paths"], conflicts_with_all = [
        "queue", "show", "approve", "reject", "send_back", "take_back", "certify", "agreement", "balance", "build",
    ])]
    pub plant: Option<PathBuf>,
    /// Number of faults to plant, each in another scenario, eight kinds in turn
    #[arg(long, value_name = "N", requires = "plant", value_parser = parse::count)]
    pub faults: Option<usize>,
    /// Seed of planted faults
    #[arg(long, default_value_t = 0, value_parser = parse::seed, requires = "plant")]
    pub seed: u64,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = parse::count)]
    pub workers: Option<usize>,
}

/// Inputs of the review, as `review` and `studio` take them.
#[derive(Debug, Args)]
pub struct ReviewInputArguments {
    /// Evaluations of reference policies, or runs with them: the mean success is the axis `difficulty` of the balance
    #[arg(long, value_name = "EVALUATION|RUN", num_args = 1..)]
    pub results: Vec<PathBuf>,
    /// Target shares as JSON: {"relation": {"left": 0.3, …}, …}
    #[arg(long, value_name = "FILE")]
    pub targets: Option<PathBuf>,
    /// File with the ids of planted faulty scenarios, the first word of each line: gives each reviewer's detections and false alarms,
    /// and keeps them out of suites
    #[arg(long, value_name = "FILE")]
    pub planted: Option<PathBuf>,
}

impl ReviewInputArguments {
    /// Reads the named files.
    ///
    /// # Errors
    /// As [`ReviewInputs::read`].
    pub fn read(&self, progress: &dyn Progress) -> Result<ReviewInputs, WorkspaceError> {
        ReviewInputs::read(&self.results, self.targets.as_deref(), self.planted.as_deref(), progress)
    }
}

/// `NAME=yes` or `NAME=no`.
fn criterion(text: &str) -> Result<(Criterion, bool), String> {
    let names = Criterion::ALL.map(Criterion::name).join(", ");
    let expected = || format!("expected NAME=yes or NAME=no, with one of {names}");
    let (name, value) = text.split_once('=').ok_or_else(expected)?;
    let holds = match value {
        "yes" => true,
        "no" => false,
        _ => return Err(expected()),
    };
    Ok((Criterion::named(name).ok_or_else(expected)?, holds))
}
