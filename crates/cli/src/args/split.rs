//! Arguments that choose layouts of a suite of task distributions.

use std::path::Path;

use clap::Args;
use genmanip_benchmark::distributions::{self, Distributions, Split, SplitChoice};
use genmanip_terminal::{Failed, parse};

/// Layouts of a suite of task distributions.
#[derive(Clone, Debug, Args)]
pub struct SplitArguments {
    /// Split of the suite of task distributions given by --suite
    #[arg(long, value_name = "SPLIT", requires = "suite", value_parser = parse::variant(Split::ALL, Split::name))]
    pub split: Option<Split>,
    /// Only this distribution of the suite
    #[arg(long, value_name = "NAME", requires = "split")]
    pub distribution: Option<String>,
    /// Only the first N layouts of each distribution
    #[arg(long, value_name = "N", requires = "split", value_parser = parse::count)]
    pub first: Option<usize>,
}

impl SplitArguments {
    /// Layouts that the arguments name; `None` for a suite of frozen scenarios, and without a suite.
    ///
    /// # Errors
    /// As [`distributions::choose`], and for a split without a suite.
    pub fn choose(&self, suite: Option<&Path>) -> Result<Option<(Distributions, SplitChoice)>, Failed> {
        match (suite, self.split) {
            (Some(suite), split) => Ok(distributions::choose(suite, split, self.distribution.as_deref(), self.first)?),
            // clap does not enforce `requires = "suite"` if an argument that conflicts with --suite is given.
            (None, Some(_)) => {
                Err(Failed::misused("--split chooses layouts of a suite")
                    .hint("name the suite with --suite, and no files"))
            }
            (None, None) => Ok(None),
        }
    }

    /// Layouts that the arguments name, for a command that takes no suite of frozen scenarios; `None` without a suite.
    ///
    /// # Errors
    /// As [`Self::choose`], and for such a suite.
    pub fn layouts(&self, suite: Option<&Path>) -> Result<Option<(Distributions, SplitChoice)>, Failed> {
        match (self.choose(suite)?, suite) {
            (None, Some(suite)) => {
                let name = suite.file_name().unwrap_or_default().display();
                Err(Failed::new(format!("{name} is no suite of task distributions"))
                    .hint("expected one such as genmanip-learn-10; name task files instead of --suite for others"))
            }
            (chosen, _) => Ok(chosen),
        }
    }
}
