//! `genmanip ablate`: evaluation of an agent with one of its settings varied at a time.

use genmanip_pipeline::ablate::{ablate, describe};
use genmanip_pipeline::evaluate::{EndingRules, EvaluateOptions, Suite};
use genmanip_workspace::workers;

use crate::args::AblateArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &AblateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let suite = Suite::of_run(&arguments.run)?;
    let options = EvaluateOptions {
        keep_episodes: false,
        shard: None,
        out: Some(arguments.run.clone()),
        workers: workers::workers(arguments.asking.workers),
        at_once: arguments.asking.at_once,
        max_cost: arguments.asking.max_cost,
        keep_going: arguments.asking.keep_going,
        ending: EndingRules::default(),
    };
    let stop = genmanip_terminal::on_interrupt();
    let ablation = ablate(&suite, &arguments.agent, &arguments.vary, &options, printer, &stop)?;
    let Some(ablation) = ablation else { return Ok(ExitStatus::NotMet) };
    printer.data(&ablation, &describe(&ablation));
    Ok(ExitStatus::Done)
}
