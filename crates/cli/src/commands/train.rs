//! `genmanip train`.

use genmanip_core::Seed;
use genmanip_pipeline::learn::{CheckOptions, Length, TrainOptions, Trained, check, train};
use genmanip_workspace::workers;

use crate::args::TrainArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &TrainArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let preset = arguments.preset;
    let (workers, stop) = (workers::workers(arguments.workers), genmanip_terminal::on_interrupt());
    let Some(out) = &arguments.out else {
        let options = CheckOptions { run: arguments.run.clone(), preset, demonstrations: arguments.count, workers };
        let Some(checked) = check(&options, printer, &stop)? else { return Ok(ExitStatus::NotMet) };
        let is_met = checked.replay_success.value >= checked.expected;
        let text = format!(
            "recorded rows as a learned policy's output solve {} of their layouts; expected at least {:.0} %\n",
            checked.replay_success,
            100.0 * checked.expected
        );
        printer.data(&checked, &text);
        return Ok(if is_met { ExitStatus::Done } else { ExitStatus::NotMet });
    };
    let length = match (arguments.steps, arguments.budget) {
        (_, Some(budget)) => Length::BudgetS(budget),
        (steps, None) => Length::Steps(steps.unwrap_or(1) as u64),
    };
    let options = TrainOptions {
        run: arguments.run.clone(),
        preset,
        length,
        seed: Seed::new(arguments.seed),
        labels: !arguments.no_labels,
        out: out.clone(),
        threads: workers,
    };
    let Some(trained) = train(&options, printer, &stop)? else {
        printer.say("interrupted; start the same call again to continue from the last checkpoint");
        return Ok(ExitStatus::NotMet);
    };
    printer.data(&trained, &describe(&trained));
    Ok(ExitStatus::Done)
}

fn describe(trained: &Trained) -> String {
    let Trained { policy, demonstrations, rows, samples, steps, parameters, final_l1, .. } = trained;
    let folder = policy.display();
    let privileged = match (trained.privileged, trained.labels) {
        (true, _) => ", privileged: it reads simulator truth",
        (false, true) => ", trained with simulator labels",
        (false, false) => "",
    };
    format!(
        "{folder}: {parameters} parameters{privileged}\n\
         {demonstrations} demonstrations of {rows} rows, {steps} steps, {samples} samples; L1 {final_l1:.4}\n\
         evaluate it: genmanip evaluate SCENARIOS --policy learned:{folder}\n"
    )
}
