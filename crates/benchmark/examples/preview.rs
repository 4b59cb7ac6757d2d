//! Writes a report with made-up results of real tasks, to inspect its design:
//! `cargo run --release -p genmanip-benchmark --example preview -- FOLDER [TASKS.json]`.

#[path = "../tests/support/mod.rs"]
mod support;

use std::error::Error;
use std::path::PathBuf;

use genmanip_benchmark::{ReportSettings, report_html};
use genmanip_viz::{graph_svg, layout_svg};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: preview FOLDER [TASKS.json]")?);
    let tasks = match arguments.next() {
        Some(path) => support::parse_tasks(&std::fs::read_to_string(path)?),
        None => support::tasks(),
    };
    std::fs::create_dir_all(&folder)?;
    for task in &tasks {
        std::fs::write(folder.join(format!("{}-graph.svg", task.id)), graph_svg(task).as_str())?;
        let layout = layout_svg(&support::top_view(task));
        std::fs::write(folder.join(format!("{}-layout.svg", task.id)), layout.as_str())?;
    }
    std::fs::write(
        folder.join("report.html"),
        report_html(&support::report_input(tasks), &ReportSettings::default())?,
    )?;
    Ok(())
}
