//! Subcommands of `genmanip-lab`: from arguments to a measurement and its output.

use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_agent::segmentation::{RgbdSegmenter, Segmenter};
use genmanip_agent_sim::{AgentChoice, GraspChoice, MaskChoice, ModelChoice, OracleSegmenter};
use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, Families, panda};
use genmanip_core::{FailureClass, Relation, Seed, Task, TaskKind};
use genmanip_import::robots;
use genmanip_lab::agent::AgentArguments;
use genmanip_lab::answers::Amount;
use genmanip_lab::batch::BatchArguments;
use genmanip_lab::blame::BlameArguments;
use genmanip_lab::bridge::chunks::{self, Chunks};
use genmanip_lab::bridge::drills::{self, Drills};
use genmanip_lab::bridge::motions::{self, Motions};
use genmanip_lab::bridge::paired::{self, Paired};
use genmanip_lab::bridge::streams::{self, Streams};
use genmanip_lab::grasp::{GraspArguments, named};
use genmanip_lab::hostile::HostileArguments;
use genmanip_lab::learn::LearnArguments;
use genmanip_lab::learned_controls::ControlArguments;
use genmanip_lab::motion::{MotionArguments, Source};
use genmanip_lab::strangers::StrangersArguments;
use genmanip_lab::studio::StudioArguments;
use genmanip_lab::teleop::TeleopArguments;
use genmanip_lab::transfer::TransferArguments;
use genmanip_lab::transfer::worth::{self, WorthArguments};
use genmanip_lab::{
    LabError, agent, answers, assets, batch, blame, data, design, environment, expert, fit, grasp, hand_eye, hostile,
    identification, layout, learn, learned_controls, matching, motion, readers, relations, render, rendered, scale,
    segment, statistics, strangers, studio, suite, teleop, transfer, wording,
};
use genmanip_workspace::WorkspaceError;

use crate::args::{self, LabCommand};
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::learn::Length;
use genmanip_terminal::{ExitStatus, Failed};
use genmanip_terminal::{Printer, UrdfArguments};

pub fn run(command: &LabCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        LabCommand::Relations(arguments) => relations_of(arguments, printer)?,
        LabCommand::Blame(arguments) => {
            let world = worlds::read_world(arguments.world.as_deref())?;
            let measured = blame::measure(&blame_arguments(arguments)?, &world, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &blame::describe(&measured));
        }
        LabCommand::Agent(arguments) => {
            let world = worlds::read_world(arguments.world.as_deref())?;
            let measured = agent::measure(&agent_arguments(arguments)?, &world, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &agent::describe(&measured));
        }
        LabCommand::Strangers(arguments) => {
            let strangers = StrangersArguments {
                folder: arguments.folder.clone(),
                urdf: urdf_settings(&arguments.urdf),
                kinds: arguments.kinds.clone(),
                pairs: arguments.pairs,
            };
            let measured = strangers::measure(&strangers, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &strangers::describe(&measured));
        }
        LabCommand::Studio(arguments) => {
            let world = worlds::read_world(arguments.world.as_deref())?;
            let args::LabStudioArguments { operations, faults, sound, .. } = *arguments;
            let amounts = StudioArguments { operations, faults, sound };
            let measured = studio::measure(amounts, &world, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &studio::describe(&measured));
        }
        LabCommand::Batch(arguments) => {
            let world = worlds::read_world(arguments.world.as_deref())?;
            let args::BatchArguments { count, at_once, latency, faults, .. } = *arguments;
            let workers = workers::workers(arguments.workers);
            let batch = BatchArguments { count, at_once, workers, latency_s: latency, faults };
            let measured = batch::measure(&batch, &world, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &batch::describe(&measured));
        }
        LabCommand::Answers(arguments) => {
            let amount = arguments.minutes.map_or(Amount::Texts(arguments.count), Amount::Minutes);
            let measured = answers::measure(&arguments.answers, amount, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &answers::describe(&measured));
        }
        LabCommand::Calibrate(arguments) => {
            let args::LabCalibrateArguments { count, rendered, seed, .. } = *arguments;
            let measured = hand_eye::measure(count, rendered, arguments.out.as_deref(), Seed::new(seed))?;
            printer.data(&measured, &hand_eye::describe(&measured));
        }
        LabCommand::Identify(arguments) => {
            let measured =
                identification::measure(arguments.first, arguments.count, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &identification::describe(&measured));
        }
        LabCommand::Match(arguments) => {
            let seed = Seed::new(arguments.seed);
            let measured = matching::measure(arguments.count, seed, arguments.out.as_deref(), printer)?;
            printer.data(&measured, &matching::describe(&measured));
        }
        LabCommand::Bridge(arguments) => {
            let seed = Seed::new(arguments.seed);
            let streams = (arguments.count > 0).then(|| streams::measure(arguments.count, seed)).transpose()?;
            let policies = arguments.policies.iter().map(|text| PolicyFactory::resolve(text));
            let policies = policies.collect::<Result<Vec<_>, _>>()?;
            let suite = arguments.suite.as_deref().map(Suite::at).transpose()?;
            let paired = suite.iter().flat_map(|suite| {
                policies
                    .iter()
                    .map(|policy| paired::measure(suite, policy, arguments.scenes, arguments.points, printer))
            });
            let paired = paired.collect::<Result<Vec<_>, _>>()?;
            let url = arguments.robot.as_deref();
            let moved = url.filter(|_| arguments.motions > 0);
            let motions = moved.map(|url| motions::measure(url, arguments.motions, seed)).transpose()?;
            let drills = url.zip(arguments.drills.as_deref());
            let drills = drills.map(|(url, place)| drills::measure(url, place == "post")).transpose()?;
            let chunks = (arguments.chunks > 0 && url.is_none()).then(|| chunks::measure(arguments.chunks, seed));
            let chunks = chunks.transpose()?;
            let mut text = motions.as_ref().map(Motions::text).unwrap_or_default();
            text += &streams.as_ref().map(Streams::text).unwrap_or_default();
            text.extend(paired.iter().map(Paired::text));
            text += &chunks.as_ref().map(Chunks::text).unwrap_or_default();
            text += &drills.as_ref().map(Drills::text).unwrap_or_default();
            printer.data(&(&streams, &paired, &motions, &drills, &chunks), &text);
            let flaws = drills.iter().flat_map(Drills::flaws).chain(motions.iter().flat_map(Motions::flaws));
            let flaws = flaws.chain(chunks.iter().flat_map(Chunks::flaws));
            let flaws: Vec<String> = flaws.inspect(|flaw| printer.say(flaw)).collect();
            if !flaws.is_empty() {
                return Ok(ExitStatus::NotMet);
            }
        }
        LabCommand::Wording(arguments) => {
            let cards = catalogue(&arguments.catalog).cards();
            let measured = wording::measure(cards, arguments.count, Seed::new(arguments.seed))?;
            printer.data(&measured, &wording::describe(&measured));
        }
        LabCommand::Design(arguments) => {
            let measured =
                design::measure(catalogue(&arguments.catalog).cards(), arguments.count, Seed::new(arguments.seed))?;
            printer.data(&measured, &design::describe(&measured));
        }
        LabCommand::Environment(arguments) => {
            let measured = match &arguments.store {
                Some(path) => environment::measure_store(path, printer)?,
                None => {
                    let tasks =
                        task_files::designed_tasks(arguments.count, arguments.seed, catalogue(&arguments.catalog))?;
                    environment::measure(&tasks, Seed::new(arguments.seed), printer)?
                }
            };
            printer.data(&measured, &environment::describe(&measured));
        }
        LabCommand::Teleop(arguments) => {
            let args::TeleopArguments { seed, episodes, commands, .. } = *arguments;
            let amounts = TeleopArguments { episodes, commands, out: arguments.out.clone() };
            let measured = teleop::measure(&amounts, Seed::new(seed), printer)?;
            printer.data(&measured, &teleop::describe(&measured));
        }
        LabCommand::Transfer(arguments) => {
            let args::TransferArguments { seed, source_demos, count, ablate, .. } = *arguments;
            let (skills, out) = (arguments.skills.clone(), arguments.out.clone());
            let amounts = TransferArguments { skills, source_demos, count, ablate, out };
            let measured = transfer::measure(&amounts, Seed::new(seed), printer)?;
            printer.data(&measured, &transfer::describe(&measured));
        }
        LabCommand::Worth(arguments) => {
            let args::WorthArguments { seed, source_demos, count, layouts, steps, .. } = *arguments;
            let amounts =
                WorthArguments { skills: arguments.skills.clone(), source_demos, count, layouts, steps: steps as u64 };
            let measured = in_folder("worth", arguments.out.as_deref(), |folder| {
                worth::measure(&amounts, Seed::new(seed), folder, printer)
            })?;
            printer.data(&measured, &worth::describe(&measured));
        }
        LabCommand::Data(arguments) => {
            // Synthetic episodes reuse the layouts of 24 tasks in turn.
            let count = if arguments.synthetic { 24 } else { arguments.episodes };
            let tasks = task_files::designed_tasks(count, arguments.seed, Catalogue::builtin())?;
            let seed = Seed::new(arguments.seed);
            let measured = in_folder("data", arguments.out.as_deref(), |folder| match arguments.synthetic {
                true => data::measure_synthetic((arguments.episodes, arguments.shards), &tasks, seed, folder, printer),
                false => data::measure(&tasks, seed, folder, printer),
            })?;
            printer.data(&measured, &data::describe(&measured));
        }
        LabCommand::Fit(arguments) => {
            let measured = fit::measure(&arguments.trials, &arguments.test, arguments.constant)?;
            printer.data(&measured, &fit::describe(&measured));
        }
        LabCommand::Hostile(arguments) => {
            let stop = genmanip_terminal::on_interrupt();
            let measured = hostile::measure(&hostile_arguments(arguments)?, Seed::new(arguments.seed), printer, &stop)?;
            printer.data(&measured, &hostile::describe(&measured));
        }
        LabCommand::Grasp(arguments) => {
            let (asked, seed) = (grasp_arguments(arguments)?, Seed::new(arguments.seed));
            let grasps = GraspChoice::named(&arguments.grasps, &["rgbd", "http:URL"])?;
            let measured = grasp::measure(&asked, &grasps, &default_world(), seed, printer)?;
            printer.data(&measured, &grasp::describe(&measured));
        }
        LabCommand::Expert(arguments) => {
            let tasks = match arguments.tasks.as_slice() {
                [] => task_files::designed_tasks(arguments.count, arguments.seed, catalogue(&arguments.catalog))?,
                named => task_files::read_tasks(named)?,
            };
            let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
            let seed = Seed::new(arguments.seed);
            let measured = expert::measure(&tasks, &world, arguments.expert, arguments.tries, seed, printer)?;
            printer.data(&measured, &expert::describe(&measured));
        }
        LabCommand::Assets(arguments) => {
            let own = arguments.families.as_deref().map(genmanip_viz::object_images::read_families).transpose()?;
            let families = own.as_ref().unwrap_or_else(|| Families::builtin());
            let (seed, workers) = (Seed::new(arguments.seed), workers::workers(arguments.workers));
            let objects = match &arguments.imported {
                Some(folder) => assets::Objects::Imported(folder),
                None => assets::Objects::New { families, chosen: arguments.family.as_deref(), count: arguments.count },
            };
            let measured = assets::measure(&objects, seed, workers, printer)?;
            printer.data(&measured, &assets::describe(&measured));
        }
        LabCommand::Layout(arguments) => {
            let tasks = layout_tasks(&arguments.tasks, arguments.count, arguments.seed, catalogue(&arguments.catalog))?;
            let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
            let measured = layout::measure(&tasks, &world, arguments.distractors, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &layout::describe(&measured));
        }
        LabCommand::Learn(arguments) => {
            let measured = in_folder("learn", arguments.out.as_deref(), |folder| {
                learn::measure(&learn_arguments(arguments), Seed::new(arguments.seed), folder, printer)
            })?;
            printer.data(&measured, &learn::describe(&measured));
        }
        LabCommand::LearnedControls(arguments) => {
            let controls = ControlArguments {
                policy: arguments.policy.clone(),
                run: arguments.run.clone(),
                suite: arguments.suite.clone(),
                distribution: arguments.distribution.clone(),
                layouts: arguments.layouts,
                only: arguments.only.clone(),
                workers: workers::workers(arguments.workers),
            };
            let measured = learned_controls::measure(&controls, printer)?;
            printer.data(&measured, &learned_controls::describe(&measured));
        }
        LabCommand::Scale(arguments) => {
            let measured = scale::measure(&arguments.run, arguments.episodes, &arguments.out, printer)?;
            printer.data(&measured, &scale::describe(&measured));
        }
        LabCommand::Suite(arguments) => {
            let (seed, workers) = (Seed::new(arguments.seed), workers::workers(arguments.workers));
            let measured = suite::measure(&arguments.suite, arguments.episodes, seed, workers, printer)?;
            printer.data(&measured, &suite::describe(&measured));
        }
        LabCommand::Readers(arguments) => read_cards(arguments, printer)?,
        LabCommand::Statistics(arguments) => {
            let measured = statistics::measure(arguments.repetitions, Seed::new(arguments.seed));
            printer.data(&measured, &statistics::describe(&measured));
        }
        LabCommand::Render(arguments) => {
            let seed = Seed::new(arguments.seed);
            let mut measured = render::measure(seed, printer)?;
            measured.flip = render::judge(seed, arguments.flip, arguments.paths, arguments.out.as_deref(), printer)?;
            if arguments.baselines {
                measured.vs = render::measure_baselines(&arguments.python, seed, printer)?;
            }
            printer.data(&measured, &render::describe(&measured));
        }
        LabCommand::Segment(arguments) => {
            segment_of(arguments, printer)?;
        }
        LabCommand::Motion(arguments) => {
            let measured = motion::measure(&motion_arguments(arguments, printer)?, Seed::new(arguments.seed), printer)?;
            printer.data(&measured, &motion::describe(&measured));
        }
    }
    Ok(ExitStatus::Done)
}

/// Measures in a folder, or in a temporary one that is removed.
fn in_folder<T>(
    name: &str,
    out: Option<&Path>,
    measure: impl FnOnce(&Path) -> Result<T, LabError>,
) -> Result<T, LabError> {
    if let Some(out) = out {
        return measure(out);
    }
    let temporary = std::env::temp_dir().join(format!("genmanip-lab-{name}-{}", std::process::id()));
    let measured = measure(&temporary);
    // A folder that cannot be removed lies in the system's temporary folder.
    let _ = std::fs::remove_dir_all(&temporary);
    measured
}

fn learn_arguments(arguments: &args::LabLearnArguments) -> LearnArguments {
    let steps = arguments.steps.unwrap_or(1) as u64;
    LearnArguments {
        distribution: arguments.distribution.clone(),
        preset: arguments.preset,
        head: arguments.head,
        demos: arguments.demos,
        length: arguments.budget.map_or(Length::Steps(steps), Length::BudgetS),
        labels: !arguments.no_labels,
        layouts: arguments.layouts,
        workers: workers::workers(arguments.workers),
    }
}

fn relations_of(arguments: &args::RelationsArguments, printer: &Printer) -> Result<(), Failed> {
    if let (Some(cases), Some(profile)) = (&arguments.cases, &arguments.profile) {
        let measured = relations::measure(cases, profile)?;
        printer.data(&measured, &relations::describe(&measured));
        return Ok(());
    }
    let tasks = task_files::read_tasks(std::slice::from_ref(&arguments.tasks))?;
    let measured = rendered::measure(&tasks, &default_world(), arguments.count, Seed::new(arguments.seed), printer)?;
    printer.data(&measured, &rendered::describe(&measured));
    Ok(())
}

fn segment_of(arguments: &args::SegmentArguments, printer: &Printer) -> Result<(), Failed> {
    let asked = segment::SegmentArguments {
        count: arguments.count,
        is_noisy: arguments.noise.is_some(),
        out: arguments.out.clone(),
    };
    let (world, seed, rgbd) = (default_world(), Seed::new(arguments.seed), RgbdSegmenter::default());
    if arguments.fit {
        let fitted = segment::fit::fit_weights(&asked, &rgbd, &world, seed, printer)?;
        printer.data(&fitted, &segment::fit::describe(&fitted));
        return Ok(());
    }
    let segmenter: Arc<dyn Segmenter> = match MaskChoice::named(&arguments.masks)? {
        MaskChoice::Rgbd => Arc::new(rgbd),
        MaskChoice::Oracle => Arc::new(OracleSegmenter),
        MaskChoice::Http(service) => service,
    };
    if arguments.extents {
        let measured = segment::extents::measure(&asked, &*segmenter, &world, seed, printer)?;
        printer.data(&measured, &segment::extents::describe(&measured));
        return Ok(());
    }
    let measured = segment::measure(&asked, &*segmenter, &world, seed, printer)?;
    printer.data(&measured, &segment::describe(&measured));
    Ok(())
}

/// Writes cards for human readers into `--out`, or compares the answers of readers with the intended ones.
fn read_cards(arguments: &args::LabReadersArguments, printer: &Printer) -> Result<(), Failed> {
    let about = match (&arguments.suite, &arguments.ends) {
        (Some(suite), _) => readers::About::Starts(suite),
        (None, Some(ends)) => readers::About::Ends(ends, arguments.count),
        // Unreachable: clap requires one of them.
        (None, None) => return Err(WorkspaceError::input("neither --suite nor --ends").into()),
    };
    let seed = Seed::new(arguments.seed);
    match &arguments.out {
        Some(out) => {
            let questions = readers::write(about, seed, out, printer)?;
            let text = format!("{} cards in {}\n", questions.cards.len(), out.display());
            printer.data(&questions, &text);
        }
        None => {
            let compared = readers::compare(about, seed, &arguments.answers)?;
            printer.data(&compared, &readers::describe(&compared));
        }
    }
    Ok(())
}

fn layout_tasks(paths: &[PathBuf], count: usize, seed: u64, from: &Catalogue) -> Result<Vec<Task>, Failed> {
    if paths.is_empty() {
        return Ok(task_files::designed_tasks(count, seed, from)?);
    }
    let known = task_files::read_tasks(paths)?;
    Ok((0..count).flat_map(|_| known.iter().cloned()).collect())
}

fn hostile_arguments(arguments: &args::HostileArguments) -> Result<HostileArguments, Failed> {
    let own = |what: &str, found: std::io::Result<PathBuf>| {
        found.map_err(|error| Failed::because(format!("cannot find {what}"), &error).hint("name it with --project"))
    };
    Ok(HostileArguments {
        program: genmanip_lab::program()?,
        lab: own("this program", std::env::current_exe())?,
        project: own("the project's folder", arguments.project.canonicalize())?,
        minutes: arguments.minutes,
        kind: arguments.kind.clone(),
        refusals: arguments.refusals.clone(),
        found: arguments.found.clone(),
        readers: arguments.readers,
        races: arguments.races,
        kills: arguments.kills,
    })
}

fn choice(arguments: &args::AgentChoiceArguments) -> Result<AgentChoice, Failed> {
    Ok(AgentChoice::named(&arguments.vlm, &arguments.masks, &arguments.path, &arguments.preset)?)
}

fn kinds(arguments: &args::AgentChoiceArguments) -> Result<Vec<TaskKind>, Failed> {
    Ok(arguments.kinds.iter().map(|kind| task_files::task_kind(kind)).collect::<Result<_, _>>()?)
}

fn agent_arguments(arguments: &args::AgentArguments) -> Result<AgentArguments, Failed> {
    let choice = choice(&arguments.agent)?;
    let mut choice =
        AgentChoice { keeps_pictures: arguments.transcripts.is_some() || arguments.page.is_some(), ..choice };
    choice.settings.ctof = arguments.ctof;
    let known = Relation::ALL.map(Relation::name);
    let relation = |name: &String| {
        Relation::named(name).ok_or_else(|| WorkspaceError::unknown("relation", "relations", name, &known))
    };
    let relation = arguments.relation.as_ref().map(relation).transpose()?;
    for error in &arguments.error {
        choice.add_error(error)?;
    }
    Ok(AgentArguments {
        names: [choice.model.name(), choice.masks.name()],
        kinds: kinds(&arguments.agent)?,
        relation,
        count: arguments.count,
        transcripts: arguments.transcripts.clone(),
        page: arguments.page.clone(),
        choice,
    })
}

fn blame_arguments(arguments: &args::BlameArguments) -> Result<BlameArguments, Failed> {
    let mut choice = choice(&arguments.agent)?;
    if arguments.closed_loop == "open" {
        choice.settings = choice.settings.open_loop();
    }
    let known: Vec<FailureClass> =
        FailureClass::ALL.into_iter().filter(|class| *class != FailureClass::Service).collect();
    let named = |name: &String| {
        let class = known.iter().copied().find(|class| class.name() == name);
        let names: Vec<&str> = known.iter().map(|class| class.name()).collect();
        class.ok_or_else(|| WorkspaceError::unknown("class", "classes", name, &names))
    };
    let classes = arguments.classes.iter().map(named).collect::<Result<Vec<_>, _>>()?;
    let is_oracle = matches!(choice.model, ModelChoice::Oracle);
    Ok(BlameArguments {
        kinds: kinds(&arguments.agent)?,
        // Only the oracle supports injected errors.
        classes: if !is_oracle {
            Vec::new()
        } else if classes.is_empty() {
            known
        } else {
            classes
        },
        per_class: arguments.per_class,
        natural: arguments.natural,
        choice,
    })
}

fn grasp_arguments(arguments: &args::GraspArguments) -> Result<GraspArguments, Failed> {
    let all = ["compact", "utensils", "clutter"];
    let classes = arguments.class.as_deref().map_or(all.to_vec(), |class| vec![class]);
    Ok(GraspArguments {
        view: named(&arguments.view)?,
        pick: named(&arguments.pick)?,
        classes: classes.into_iter().map(named).collect::<Result<_, _>>()?,
        count: arguments.count,
        out: arguments.out.clone(),
    })
}

fn urdf_settings(arguments: &UrdfArguments) -> robots::Settings {
    let UrdfArguments { packages, tip, visuals_collide } = arguments.clone();
    robots::Settings::new(&packages, robots::Choices { tip, visuals_collide, visible: false })
}

fn motion_arguments(arguments: &args::MotionArguments, printer: &Printer) -> Result<MotionArguments, Failed> {
    let generated = || Source::Generated {
        is_hard: arguments.generate.as_deref() == Some("hard"),
        count: arguments.count.unwrap_or(100),
        out: arguments.out.clone(),
    };
    let of_file = |path| Source::File { path, count: arguments.count.unwrap_or(usize::MAX) };
    Ok(MotionArguments {
        robot: match &arguments.robot {
            Some(path) => {
                let read = robots::read(path, &urdf_settings(&arguments.urdf))?;
                read.notes.iter().for_each(|note| printer.say(note));
                read.model.into()
            }
            None => panda(),
        },
        problems: arguments.problems.clone().map_or_else(generated, of_file),
        rrt_range: arguments.rrt_range,
        ik_poses: arguments.ik_poses,
        paths: arguments.paths.clone(),
    })
}

fn catalogue(name: &str) -> &'static Catalogue {
    Catalogue::named(name).unwrap_or_else(Catalogue::builtin)
}
