//! `genmanip evaluate`: success of policies on a run, scenario files or a suite.

use std::sync::atomic::Ordering;

use genmanip_core::Document;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{
    EndingRules, EvaluateOptions, Suite, evaluate, results_file, table, table_of_traits,
};
use genmanip_workspace::{workers, worlds};

use crate::args::EvaluateArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &EvaluateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let named = arguments.policies.iter().map(|text| PolicyFactory::resolve(text));
    let named = named.collect::<Result<Vec<_>, _>>()?;
    let run = match &arguments.paths[..] {
        _ if arguments.suite.is_some() => None,
        [only] if only.join("run.json").is_file() || !only.exists() => Some(only),
        _ => None,
    };
    let stop = genmanip_terminal::on_interrupt();
    let workers = workers::workers(arguments.asking.workers);
    let chosen = arguments.layouts.choose(arguments.suite.as_deref())?;
    let mut suite = match (&chosen, &arguments.suite, run) {
        (Some((suite, choice)), _, _) => match Suite::of_split(suite, choice, workers, printer, &stop)? {
            Some(suite) => suite,
            None => return Ok(ExitStatus::NotMet),
        },
        (None, Some(suite), _) => Suite::frozen(suite)?,
        (None, None, Some(run)) => Suite::of_run(run)?,
        (None, None, None) => Suite::of_scenarios(&arguments.paths)?,
    };
    for scenario in &suite.scenarios {
        worlds::check_robot(&scenario.world, arguments.robot.as_deref())?;
    }
    if let Some(file) = &arguments.cameras {
        suite = suite.with_cameras(file)?;
    }
    suite = suite.with_episodes(arguments.episodes_per_scenario);
    let policies = if named.is_empty() { PolicyFactory::all(suite.is_recorded())? } else { named };
    let out = match (run, &arguments.out) {
        (Some(run), Some(_)) => {
            return Err(Failed::new(format!("{} keeps its evaluations itself", run.display()))
                .hint("omit --out, or name its scenarios/ instead of the run"));
        }
        (None, None) if arguments.keep_episodes => {
            return Err(Failed::new("there is no folder to keep episodes in").hint("name one with --out DIR"));
        }
        (None, None) if arguments.shard.is_some() => {
            return Err(Failed::new("there is no folder that the shards could share").hint("name one with --out DIR"));
        }
        (run, out) => run.or(out.as_ref()),
    };
    let shard = arguments.shard.map(|choice| choice.resolve(&genmanip_terminal::environment)).transpose()?;
    let options = EvaluateOptions {
        keep_episodes: arguments.keep_episodes || run.is_none() && out.is_some(),
        out: out.cloned(),
        shard,
        workers,
        at_once: arguments.asking.at_once,
        max_cost: arguments.asking.max_cost,
        keep_going: arguments.asking.keep_going,
        ending: EndingRules {
            horizon_s: arguments.horizon,
            stop_on_success: arguments.stop_on_success,
            stop_on_unreachable: arguments.stop_on_unreachable,
        },
    };
    let reports = evaluate(&suite, &policies, &options, printer, &stop)?;
    let values: Vec<_> = reports.iter().map(Document::to_value).collect();
    let of_traits = table_of_traits(&reports);
    let more =
        if of_traits.is_empty() { String::new() } else { format!("\nsuccess at end by scenario trait\n{of_traits}") };
    printer.data(&values, &(table(&reports) + &more));
    for report in reports.iter().filter(|_| shard.is_none()) {
        if let Some(out) = &options.out {
            printer.say(format!("results in {}", results_file(out, &report.label).display()));
        }
    }
    if let Some(shard) = shard.filter(|_| !stop.load(Ordering::Relaxed)) {
        printer
            .say(format!("{shard} is kept; the same call without --shard gathers all shards and writes the results"));
    }
    let is_left = reports.iter().any(|report| !report.not_run.is_empty());
    Ok(if is_left || stop.load(Ordering::Relaxed) { ExitStatus::NotMet } else { ExitStatus::Done })
}
