//! `genmanip skills`: skills cut from episodes, and episodes that they were transferred to.

use genmanip_core::{Document, Seed};
use genmanip_pipeline::skills::{self, TransferRequest};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_skills::{Grip, Skill};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{documents, text_table, workers, worlds};

use crate::args::{
    SkillsCommand, SkillsListArguments, SkillsRecordArguments, SkillsShowArguments, SkillsTransferArguments,
};

pub fn run(command: &SkillsCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        SkillsCommand::Record(arguments) => record(arguments, printer),
        SkillsCommand::List(arguments) => list(arguments, printer),
        SkillsCommand::Show(arguments) => show(arguments, printer),
        SkillsCommand::Transfer(arguments) => transfer(arguments, printer),
    }
}

fn record(arguments: &SkillsRecordArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let rows = skills::record(&arguments.run, &arguments.episode, &arguments.out)?;
    let mut table = vec![vec!["episode".to_owned(), "skill".to_owned()]];
    table.extend(rows.iter().map(|row| {
        let file = row.file.as_ref().map(|file| file.display().to_string());
        vec![row.episode.clone(), file.or(row.reason.clone()).unwrap_or_default()]
    }));
    printer.data(&rows, &text_table(&table));
    Ok(if rows.iter().any(|row| row.file.is_some()) { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn list(arguments: &SkillsListArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let known = skills::read(&arguments.skills)?;
    let head = ["skill", "verb", "object", "operator", "episode"];
    let mut table = vec![head.map(str::to_owned).to_vec()];
    table.extend(known.iter().map(|skill| {
        let operator = skill.source.operator.map_or(skill.source.policy.as_str(), |operator| operator.name());
        let (verb, family) = (skill.verb.name(), skill.source.family.as_str());
        [skill.name.as_str(), verb, family, operator, skill.source.episode.as_str()].map(str::to_owned).to_vec()
    }));
    printer.data(&known, &text_table(&table));
    Ok(ExitStatus::Done)
}

fn show(arguments: &SkillsShowArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let skill: Skill = documents::read_document(&arguments.skill, Skill::LIMIT)?;
    printer.data(&skill.to_value(), &described(&skill));
    Ok(ExitStatus::Done)
}

/// Text about a skill.
fn described(skill: &Skill) -> String {
    let rate_hz = skill.source.control_rate_hz;
    let seconds = |[from, to]: [usize; 2]| format!("{:.1} to {:.1} s", from as f64 / rate_hz, to as f64 / rate_hz);
    let grip = match skill.grip {
        Grip::Grasp { width_m, .. } => format!("grasps at {:.1} mm", width_m * 1e3),
        Grip::Fixed { width_m } => format!("fingers at {:.1} mm", width_m * 1e3),
    };
    let motion = match (&skill.motion, &skill.carry) {
        (Some(motion), _) => {
            let ([from, to], [low, high]) = (&motion.states, motion.from_to);
            format!("{from} to {to}, joint from {low:.3} to {high:.3}")
        }
        (None, Some(carry)) => {
            let [x, y, z] = (carry.object_half_m * 2e3).to_array();
            format!("carries an object of {x:.0} x {y:.0} x {z:.0} mm, {}", carry.relation.name())
        }
        (None, None) => String::new(),
    };
    let rows = [
        ("skill", skill.name.clone()),
        ("verb", skill.verb.name().to_owned()),
        ("object", skill.source.family.clone()),
        ("episode", format!("{}, record {}", skill.source.episode, skill.source.record_hash)),
        ("operator", skill.source.operator.map_or(skill.source.policy.clone(), |operator| operator.name().to_owned())),
        ("motion", motion),
        ("gripper", grip),
        ("approach", seconds(skill.segments.approach)),
        ("contact", seconds(skill.segments.contact)),
        ("manipulate", seconds(skill.segments.manipulate)),
        ("release", seconds(skill.segments.release)),
        ("retreat", seconds(skill.segments.retreat)),
    ];
    text_table(&rows.map(|(what, value)| vec![what.to_owned(), value]))
}

fn transfer(arguments: &SkillsTransferArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let request = TransferRequest {
        skills: skills::read(&arguments.skills)?,
        query: arguments.to.clone(),
        count: arguments.count,
        seed: Seed::new(arguments.seed),
        workers: workers::workers(arguments.workers),
    };
    let settings = PipelineSettings::in_world(worlds::read_world(arguments.world.as_deref())?);
    let stop = genmanip_terminal::on_interrupt();
    let made = skills::transfer(&request, settings, &arguments.out, printer, &stop)?;
    made.failures.iter().for_each(|failure| printer.say(failure));
    let summary =
        format!("{} episodes kept of {} attempts: {}", made.kept.len(), made.attempts, arguments.out.display());
    printer.data(&made, &summary);
    Ok(if made.kept.len() == request.count { ExitStatus::Done } else { ExitStatus::NotMet })
}
