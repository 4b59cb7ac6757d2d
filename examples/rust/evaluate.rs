//! Evaluates built-in policies on scenario files and writes the results with confidence intervals:
//! `cargo run --release -p genmanip --example evaluate -- out/scenarios out/evaluation`

use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use genmanip::pipeline::PolicyFactory;
use genmanip::pipeline::evaluate::{EvaluateOptions, Suite, evaluate, table};
use genmanip::workspace::NoProgress;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let (scenarios, out) = arguments.next().zip(arguments.next()).ok_or("usage: evaluate SCENARIOS OUT")?;
    let suite = Suite::of_scenarios(&[scenarios])?;
    let policies = [PolicyFactory::resolve("expert")?, PolicyFactory::resolve("do_nothing:seconds=1")?];
    let options = EvaluateOptions { out: Some(out.clone()), workers: 2, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &policies, &options, &NoProgress, &AtomicBool::new(false))?;
    std::fs::write(out.join("table.txt"), table(&reports))?;
    Ok(())
}
