//! `genmanip data`: check, show, edit, import and transfer datasets.

use genmanip_workspace::documents;
use genmanip_workspace::workers;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::robots;
use genmanip_benchmark::{FilmStrip, dataset_page};
use genmanip_core::{RobotModel, Seed};
use genmanip_data::lerobot::{self, RECORD};
use genmanip_data::{DataError, ExportReport};
use genmanip_dataset_tools::check::{self, DatasetCheck, Finding, Overview, Strip};
use genmanip_dataset_tools::edit::{self, By, Condition};
use genmanip_dataset_tools::import::{self, ImportReport, ImportSettings};
use genmanip_pipeline::rerender::{self, RerenderOptions};
use genmanip_s3::{Access, Address, Bucket, RetryPolicy, S3Error, TransferSummary};
use genmanip_viz::replay::{self, Replayed};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;
use serde_json::json;

use super::plural;
use crate::args::{
    DataCardArguments, DataCheckArguments, DataCommand, DataConvertArguments, DataDeleteArguments, DataFilterArguments,
    DataImportArguments, DataPullArguments, DataPushArguments, DataRerenderArguments, DataShowArguments,
    DataSplitArguments,
};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Maximum number of leaks in the text output; JSON has all.
const LISTED_LEAKS: usize = 12;
/// Maximum number of tasks in the text output; JSON has all.
const LISTED_TASKS: usize = 20;
/// Length of the longest bar of a histogram, characters.
const BAR: usize = 30;

pub fn run(command: &DataCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        DataCommand::Check(arguments) => check_all(arguments, printer),
        DataCommand::Show(arguments) => show(arguments, printer),
        DataCommand::Merge(arguments) => {
            edited(printer, |progress| Ok(vec![edit::merge(&arguments.datasets, &arguments.out, progress)?]))
        }
        DataCommand::Split(DataSplitArguments { dataset, out, fractions, seed, by }) => {
            let by = if by == "task" { By::Task } else { By::Episode };
            edited(printer, |progress| edit::split(dataset, fractions, by, Seed::new(*seed), out, progress))
        }
        DataCommand::Filter(DataFilterArguments { dataset, conditions, sources, out }) => {
            let names: Vec<&str> = sources.names.iter().map(|source| source.name()).collect();
            let source = Condition { key: "source".into(), value: names.join(",") };
            let sources = (!names.is_empty()).then_some(source);
            let conditions = &conditions.iter().cloned().chain(sources).collect::<Vec<_>>();
            edited(printer, |progress| Ok(vec![edit::filter(dataset, conditions, out, progress)?]))
        }
        DataCommand::Import(DataImportArguments { dataset, out, ffmpeg }) => {
            taken_over(("import", dataset, ffmpeg), printer, |settings, progress| {
                import::import(dataset, settings, out, progress)
            })
        }
        DataCommand::Convert(DataConvertArguments { dataset, to: _, out, ffmpeg }) => {
            taken_over(("convert", dataset, ffmpeg), printer, |settings, progress| {
                import::to_v21(dataset, settings, out, progress)
            })
        }
        DataCommand::Rerender(arguments) => rerender(arguments, printer),
        DataCommand::Card(DataCardArguments { dataset }) => {
            let card = lerobot::write_card(dataset).map_err(|error| {
                Failed::because("cannot write the card", &error)
                    .or_hint("genmanip data check says what is wrong with it")
            })?;
            let text: String = card.written.iter().map(|path| format!("{}\n", path.display())).collect();
            printer.data(&card, &text);
            Ok(ExitStatus::Done)
        }
        DataCommand::Push(DataPushArguments { folder, address, at_once }) => {
            moved(("send", "sent", address), printer, |bucket, prefix, progress| {
                genmanip_s3::push(bucket, folder, prefix, *at_once, progress)
            })
        }
        DataCommand::Pull(DataPullArguments { address, folder, at_once }) => {
            moved(("fetch", "fetched", address), printer, |bucket, prefix, progress| {
                genmanip_s3::pull(bucket, prefix, folder, *at_once, progress)
            })
        }
        DataCommand::Delete(DataDeleteArguments { dataset, episodes, out }) => {
            let episodes = edit::numbers(episodes).map_err(|why| Failed::misused(format!("--episodes: {why}")))?;
            edited(printer, |progress| Ok(vec![edit::delete(dataset, &episodes, out, progress)?]))
        }
    }
}

/// Uploads a folder to S3 storage or downloads it, and prints the amount of data.
fn moved(
    (what, done, address): (&str, &str, &str),
    printer: &Printer,
    work: impl FnOnce(&Bucket, &str, &(dyn Fn(usize) + Sync)) -> Result<TransferSummary, S3Error>,
) -> Result<ExitStatus, Failed> {
    let failed = |error: S3Error| {
        let hint = error.hint();
        Failed::because(format!("cannot {what} the folder"), &error).hint(hint)
    };
    let place = Address::parse(address).map_err(|error| Failed::misused(error.to_string()).hint(error.hint()))?;
    let bucket = Bucket::new(&place.bucket, Access::from_environment().map_err(failed)?, RetryPolicy::default());
    let begun = std::sync::Once::new();
    let progress = |all: usize| {
        begun.call_once(|| printer.begin(&format!("{what}ing files"), all));
        printer.advance();
    };
    let moved = work(&bucket, &place.prefix, &progress).map_err(failed)?;
    printer.end();
    let TransferSummary { files, bytes, moved: count } = moved;
    let there = files - count;
    let megabytes = bytes as f64 / 1e6;
    printer
        .data(&moved, &format!("{address}: {count} files {done}, {there} there already; {megabytes:.1} MB in all\n"));
    Ok(ExitStatus::Done)
}

/// Converts a dataset with `take`, decoding its videos with `ffmpeg` if given, and prints the result.
fn taken_over(
    (what, dataset, ffmpeg): (&str, &Path, &Option<PathBuf>),
    printer: &Printer,
    take: impl FnOnce(&ImportSettings, &mut dyn FnMut(usize)) -> Result<ImportReport, DataError>,
) -> Result<ExitStatus, Failed> {
    let settings = ImportSettings { ffmpeg: ffmpeg.clone(), ..ImportSettings::default() };
    let taken = take(&settings, &mut counted(&format!("{what}ing episodes"), printer));
    let made = taken.map_err(|error| {
        let is_of_video = ffmpeg.is_none() && error.to_string().starts_with("video");
        let hint = match is_of_video {
            true => "nothing was written; --ffmpeg PROGRAM decodes what is not plain H.264",
            false => "nothing was written; genmanip data check says more of a LeRobot dataset",
        };
        Failed::because(format!("cannot {what} {}", dataset.display()), &error).or_hint(hint)
    })?;
    let mut text = line(&made.written);
    text += &made.imported.notes.iter().map(|note| format!("  {note}\n")).collect::<String>();
    printer.data(&made, &text);
    Ok(ExitStatus::Done)
}

fn line(made: &ExportReport) -> String {
    format!("{}: {}, {} rows\n", made.dataset.display(), plural(made.episodes, "episode"), made.frames)
}

/// Progress callback: begins the activity `what` at the first of `total` episodes, and advances it at each.
fn counted<'a>(what: &'a str, printer: &'a Printer) -> impl FnMut(usize) + 'a {
    let mut copied = 0_usize;
    move |total: usize| {
        if copied.is_multiple_of(total) {
            printer.begin(what, total);
        }
        copied += 1;
        printer.advance();
        if copied.is_multiple_of(total) {
            printer.end();
        }
    }
}

/// Renders the images of a dataset again, and prints the result.
fn rerender(arguments: &DataRerenderArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let options = RerenderOptions {
        look: arguments.look,
        vary: if arguments.plain { Vec::new() } else { super::collect::vary(&arguments.vary) },
        cameras: arguments.cameras.clone(),
        workers: workers::workers(arguments.workers),
    };
    let stop = genmanip_terminal::on_interrupt();
    let Some(made) = rerender::rerender(&arguments.dataset, &options, &arguments.out, printer, &stop)? else {
        printer.say("interrupted; pictures that were drawn are kept, start again to continue");
        return Ok(ExitStatus::NotMet);
    };
    printer.data(&made, &line(&made));
    Ok(ExitStatus::Done)
}

/// Runs an edit that makes datasets from others, and prints the result.
fn edited(
    printer: &Printer,
    make: impl FnOnce(edit::Progress) -> Result<Vec<ExportReport>, DataError>,
) -> Result<ExitStatus, Failed> {
    let made = make(&mut counted("copying episodes", printer)).map_err(|error| {
        Failed::because("cannot make the dataset", &error)
            .or_hint("nothing was changed; genmanip data check says more of a dataset")
    })?;
    printer.data(&made, &made.iter().map(line).collect::<String>());
    Ok(ExitStatus::Done)
}

fn check_all(arguments: &DataCheckArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let mut checked = Vec::new();
    for dataset in &arguments.datasets {
        printer.say(format!("checking {}", dataset.display()));
        let mut one = read(dataset)?;
        one.findings.extend(replayed(dataset, arguments.replays, printer)?);
        checked.push(one);
    }
    let mut leaks = Vec::new();
    for (number, later) in checked.iter().enumerate() {
        leaks.extend(checked[..number].iter().flat_map(|earlier| check::leaks(earlier, later)));
    }
    let mut text = String::new();
    for one in &checked {
        let DatasetCheck { dataset, format, episodes, frames, findings, further, .. } = one;
        let verdict = match findings.len() + further {
            0 => "sound".to_owned(),
            count => plural(count, "finding"),
        };
        text += &format!("{dataset}: {format}, {}, {frames} rows: {verdict}\n", plural(*episodes, "episode"));
        text += &findings.iter().map(describe).collect::<String>();
        if *further > 0 {
            text += &format!("  and {further} more of these\n");
        }
    }
    text += &leaks.iter().take(LISTED_LEAKS).map(describe).collect::<String>();
    if leaks.len() > LISTED_LEAKS {
        text += &format!("  and {} more leaks\n", leaks.len() - LISTED_LEAKS);
    }
    let is_sound = leaks.is_empty() && checked.iter().all(|one| one.findings.is_empty());
    printer.data(&json!({"datasets": checked, "leaks": leaks}), &text);
    Ok(if is_sound { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// Findings from replaying `count` of a dataset's recorded episodes; none if `count` is 0.
fn replayed(dataset: &Path, count: usize, printer: &Printer) -> Result<Vec<Finding>, Failed> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let record = dataset.join(RECORD);
    if !record.is_dir() {
        return Err(Failed::new(format!("{} has no {RECORD} to replay", dataset.display()))
            .hint("leave --replays away, or take a dataset that this program collected"));
    }
    let rows = replay::sample(&record, count, workers::workers(None), printer)?;
    let unsound = rows.iter().filter(|row| !row.is_sound());
    let finding = |row: &Replayed| Finding {
        check: "replay",
        file: format!("{RECORD}/{}", row.episode),
        place: "final state".into(),
        expected: "the recorded one, bit for bit".into(),
        found: row.describe(),
    };
    Ok(unsound.map(finding).collect())
}

fn describe(finding: &Finding) -> String {
    let Finding { check, file, place, expected, found } = finding;
    let place = if place.is_empty() { String::new() } else { format!(", {place}") };
    format!("  {check}: {file}{place}: expected {expected}; found {found}\n")
}

fn show(arguments: &DataShowArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    if arguments.learnability {
        let mut progress = counted("reading episodes", printer);
        return super::learnability::show(&arguments.dataset, &mut progress, printer);
    }
    let checked = read(&arguments.dataset)?;
    let overview = &checked.overview;
    let groups = groups(overview);
    let ranges = ranges(overview);
    let about = format!(
        "{}: {}, {}, {} rows at {} Hz, robot {}",
        checked.dataset,
        checked.format,
        plural(checked.episodes, "episode"),
        checked.frames,
        overview.fps,
        overview.robot
    );
    let action = overview.action.as_ref().map_or(String::new(), |action| format!("action: {action}\n"));
    let images = images(overview);
    let findings = match checked.findings.len() + checked.further {
        0 => "sound".to_owned(),
        count => format!("{}: see genmanip data check", plural(count, "finding")),
    };
    if let Some(path) = &arguments.html {
        let (tasks, lengths) = (tasks(&overview.tasks, usize::MAX), lengths(overview));
        let tables = [
            ("Episodes", groups.as_slice()),
            ("Lengths", &lengths),
            ("Tasks", &tasks),
            ("States and actions", &ranges),
        ];
        let sheet = sheet(&arguments.dataset)?;
        let page = dataset_page(&about, &format!("{action}{images}{findings}"), &tables, &sheet);
        documents::write_file(path, page.as_bytes())?;
        printer.say(format!("wrote {}", path.display()));
        return Ok(ExitStatus::Done);
    }
    let mut tables = vec![groups, lengths(overview)];
    // Without kinds, the groups already are the tasks.
    if overview.tasks.iter().map(|task| &task.kind).ne(overview.groups.iter().map(|group| &group.kind)) {
        tables.push(tasks(&overview.tasks, LISTED_TASKS));
    }
    tables.push(ranges);
    let tables: Vec<String> = tables.iter().map(|table| text_table(table)).collect();
    let text = format!("{about}\n{action}{images}{findings}\n\n{}", tables.join("\n"));
    printer.data(&json!({"dataset": checked, "overview": overview}), &text);
    Ok(ExitStatus::Done)
}

/// Text of the cameras with their image sizes.
fn images(overview: &Overview) -> String {
    let image = |image: &check::ImageFeature| {
        let sizes: Vec<String> = image.shape.iter().map(usize::to_string).collect();
        format!("{} {} ({})", image.key, sizes.join("×"), image.stored_as)
    };
    match overview.images.iter().map(image).collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => "images: none\n".into(),
        images => format!("images: {images}\n"),
    }
}

/// Film strips of some episodes, each captioned with the episode's instruction.
fn sheet(dataset: &Path) -> Result<Vec<FilmStrip>, Failed> {
    let strips = check::contact_sheet(dataset).map_err(|error| {
        Failed::because("cannot show pictures", &error).hint("genmanip data check says what is wrong with them")
    })?;
    let caption = |strip: &Strip| {
        let end = strip.success.map_or("", |success| if success { ", succeeded" } else { ", failed" });
        format!("{}: {}{end}", strip.episode, strip.sentence)
    };
    Ok(strips.into_iter().map(|strip| FilmStrip { caption: caption(&strip), pictures: strip.pictures }).collect())
}

/// Table rows, one per task, lowest success rate first; at most `most`.
fn tasks(tasks: &[check::Group], most: usize) -> Vec<Vec<String>> {
    let share = |task: &check::Group| task.succeeded.map_or(1.0, |count| count as f64 / task.episodes.max(1) as f64);
    let mut sorted: Vec<&check::Group> = tasks.iter().collect();
    sorted.sort_by(|a, b| share(a).total_cmp(&share(b)));
    let row = |task: &&check::Group| {
        let succeeded = task.succeeded.map_or("–".to_owned(), |count| count.to_string());
        vec![task.episodes.to_string(), succeeded, task.kind.clone()]
    };
    let mut rows = vec![["episodes", "succeeded", "task"].map(String::from).to_vec()];
    rows.extend(sorted.iter().take(most).map(row));
    if let Some(more) = tasks.len().checked_sub(most).filter(|more| *more > 0) {
        rows.push(vec![String::new(), String::new(), format!("and {more} more; all with --json or --html")]);
    }
    rows
}

/// Table rows of the histogram of episode lengths, with bars.
fn lengths(overview: &Overview) -> Vec<Vec<String>> {
    let most = overview.lengths.iter().map(|bin| bin.episodes).max().unwrap_or(0).max(1);
    let row = |bin: &check::Bin| {
        let [from, to] = bin.seconds;
        vec![format!("{from:.1} to {to:.1}"), bin.episodes.to_string(), "█".repeat((bin.episodes * BAR).div_ceil(most))]
    };
    let head = ["length, s", "episodes", ""].map(String::from).to_vec();
    std::iter::once(head).chain(overview.lengths.iter().map(row)).collect()
}

fn groups(overview: &Overview) -> Vec<Vec<String>> {
    let head = ["kind", "episodes", "succeeded", "sentences", "shortest", "median", "longest, s"].map(String::from);
    let row = |group: &check::Group| {
        let succeeded = group.succeeded.map_or("–".to_owned(), |count| count.to_string());
        let counts = [group.kind.clone(), group.episodes.to_string(), succeeded, group.sentences.to_string()];
        counts.into_iter().chain(group.seconds.map(|seconds| format!("{seconds:.1}"))).collect()
    };
    std::iter::once(head.to_vec()).chain(overview.groups.iter().map(row)).collect()
}

fn ranges(overview: &Overview) -> Vec<Vec<String>> {
    let row = |range: &check::Range| vec![range.name.clone(), format!("{:.4}", range.min), format!("{:.4}", range.max)];
    std::iter::once(["column", "least", "most"].map(String::from).to_vec())
        .chain(overview.ranges.iter().map(row))
        .collect()
}

fn read(dataset: &Path) -> Result<DatasetCheck, Failed> {
    let robots: Vec<Arc<RobotModel>> = robots::names().iter().filter_map(|name| robots::named(name).ok()).collect();
    check::check(dataset, &robots).map_err(|error| {
        let hint = "give the folder of a LeRobot dataset (with meta/info.json) or of a zarr group";
        let hint = error.hint().filter(|_| !matches!(error, DataError::Io { .. })).unwrap_or_else(|| hint.into());
        Failed::because(format!("cannot check {}", dataset.display()), &error).hint(hint)
    })
}
