//! Lays out a recorded task and writes the scenario:
//! `cargo run --release -p genmanip --example layout -- examples/tasks/017_pick_and_place.json scenario.json`

use std::error::Error;
use std::path::PathBuf;

use genmanip::assets::{Catalogue, GraspLibrary, worlds};
use genmanip::core::{Document, Seed};
use genmanip::layout::{LayoutSettings, lay_out};
use genmanip::motion::PlannerSettings;
use genmanip::workspace::{documents, task_files, worlds::planner};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let (task, out) = arguments.next().zip(arguments.next()).ok_or("usage: layout TASK.json SCENARIO.json")?;
    let task = task_files::read_task(&task)?;
    let world = worlds::default_world();
    let planner = planner(&world, &PlannerSettings::default())?;
    let (grasps, settings) = (GraspLibrary::builtin(), LayoutSettings::default());
    let scenario = lay_out(&task, Catalogue::builtin(), &world, &planner, grasps, Seed::new(7), &settings)?;
    documents::write_file(&out, scenario.to_json().as_bytes())?;
    Ok(())
}
