//! Check of all rows, episode by episode.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};

use arrow_array::RecordBatch;
use genmanip_core::RobotModel;

use super::consistency;
use super::findings::Findings;
use super::leaks::Identity;
use super::metadata::{EpisodeEntry, Metadata};
use super::totals::{self, Totals};
use super::v30;
use genmanip_data::columns::{Column, Rows};
use genmanip_data::lerobot::info::INFO;
use genmanip_data::lerobot::stats::Stats;
use genmanip_data::table::Table;

/// Index columns that every LeRobot data set has.
const INDEX_COLUMNS: [&str; 5] = ["timestamp", "frame_index", "episode_index", "index", "task_index"];
/// Tolerance of timestamps against `frame_index / fps`, s; that of LeRobot's own readers.
const TIME_TOLERANCE_S: f64 = 1e-4;

/// Reads all rows; returns their statistics and the identities of the episodes.
pub(super) fn check(
    metadata: &Metadata,
    robot: Option<&RobotModel>,
    findings: &mut Findings,
) -> (Totals, Vec<Identity>) {
    let mut totals = Totals::new(metadata);
    let mut seen: BTreeMap<u64, i64> = BTreeMap::new();
    let mut identities = Vec::new();
    let mut files: BTreeMap<&str, Vec<&EpisodeEntry>> = BTreeMap::new();
    for episode in &metadata.episodes {
        files.entry(episode.data.as_str()).or_default().push(episode);
    }
    for (file, episodes) in &mut files {
        episodes.sort_by_key(|episode| episode.from);
        let mut each = |episode: &EpisodeEntry, rows: &Rows, findings: &mut Findings| {
            check_episode(metadata, episode, rows, findings);
            if let Some(robot) = robot {
                consistency::check(metadata, robot, episode, rows, findings);
            }
            totals.add(rows);
            let content = content(rows);
            if let Some(first) = seen.insert(content, episode.index) {
                let found = format!("the rows of episode {first}");
                findings.add("episodes", &episode.data, episode.place(), "a unique episode", found);
            }
            identities.push(Identity::of(episode, content));
        };
        if let Err(error) = check_file(metadata, file, episodes, findings, &mut each)
            && !error.is_missing()
        {
            findings.add("files", file, "", "a readable table", error);
        }
    }
    identities.sort_by_key(|identity| identity.episode);
    (totals, identities)
}

/// Callback for the rows of one episode.
type Each<'a> = &'a mut dyn FnMut(&EpisodeEntry, &Rows, &mut Findings);

fn check_file(
    metadata: &Metadata,
    file: &str,
    episodes: &[&EpisodeEntry],
    findings: &mut Findings,
    each: Each,
) -> Result<(), genmanip_data::DataError> {
    let table = Table::open(&metadata.root.join(file))?;
    let known = table.names();
    let described = metadata.info.features.iter().filter(|feature| !feature.is_video());
    for feature in described.clone().filter(|feature| !known.contains(&feature.key)) {
        findings.add("features", file, "", format!("column `{}` of info.json", feature.key), "none");
    }
    for column in known.iter().filter(|column| !metadata.info.features.iter().any(|feature| feature.key == **column)) {
        findings.add("features", file, format!("column {column}"), "only columns of info.json", "another");
    }
    let wanted: Vec<&str> = described
        .filter(|feature| !feature.is_image() && known.contains(&feature.key))
        .map(|feature| feature.key.as_str())
        .collect();
    if let Some(missing) = INDEX_COLUMNS.iter().find(|name| !wanted.contains(name)) {
        findings.add("features", INFO, "features", format!("`{missing}`"), "none");
    }
    let mut pending = Rows::new();
    let mut held = 0;
    let mut left = episodes.iter();
    let mut next = left.next();
    for batch in table.columns(&wanted)? {
        let batch = batch?;
        append(metadata, file, &batch, &wanted, &mut pending, findings);
        held += batch.num_rows();
        while let Some(episode) = next
            && let Ok(length) = usize::try_from(episode.length)
            && length <= held
        {
            let rows = split(&mut pending, length);
            each(episode, &rows, findings);
            held -= length;
            next = left.next();
        }
    }
    if let Some(episode) = next {
        let place = format!("rows of {}", episode.place());
        findings.add(
            "rows",
            file,
            place,
            format!("{} rows", episode.length),
            format!("{held} before the end of the file"),
        );
    } else if held > 0 {
        findings.add("rows", file, "after the last episode", "no further rows", format!("{held} rows"));
    }
    Ok(())
}

fn append(
    metadata: &Metadata,
    file: &str,
    batch: &RecordBatch,
    wanted: &[&str],
    pending: &mut Rows,
    findings: &mut Findings,
) {
    for key in wanted {
        let Some(feature) = metadata.info.features.iter().find(|feature| feature.key == *key) else { continue };
        let Some(column) = batch.column_by_name(key) else { continue };
        let Some(column) = Column::of(column) else {
            let expected = format!("{} of shape {:?}, according to info.json", feature.dtype, feature.shape);
            findings.add("features", file, format!("column {key}"), expected, "another type, or null entries");
            continue;
        };
        if column.dtype != feature.dtype || column.width != feature.width() {
            let expected = format!("{} with {} per row, according to info.json", feature.dtype, feature.width());
            let found = format!("{} with {} per row", column.dtype, column.width);
            findings.add("features", file, format!("column {key}"), expected, found);
        }
        let known = pending.entry((*key).to_owned()).or_insert_with(|| Column { values: Vec::new(), ..column });
        if known.width == column.width {
            known.values.extend(column.values);
        }
    }
}

/// Removes and returns the first `length` rows.
fn split(pending: &mut Rows, length: usize) -> Rows {
    let take = |column: &mut Column| {
        let end = (length * column.width).min(column.values.len());
        let rest = column.values.split_off(end);
        Column { values: std::mem::replace(&mut column.values, rest), ..*column }
    };
    pending.iter_mut().map(|(key, column)| (key.clone(), take(column))).collect()
}

/// Expected value of a column in a row; `None` where it is unknown.
type Expected<'a> = &'a dyn Fn(usize) -> Option<f64>;

fn check_episode(metadata: &Metadata, episode: &EpisodeEntry, rows: &Rows, findings: &mut Findings) {
    let file = episode.data.as_str();
    let task =
        metadata.tasks.iter().find(|(_, sentence)| *sentence == episode.sentence).map(|(index, _)| *index as f64);
    let expected: [(&str, Expected); 5] = [
        ("index", &|row| Some(episode.from as f64 + row as f64)),
        ("frame_index", &|row| Some(row as f64)),
        ("episode_index", &|_| Some(episode.index as f64)),
        ("task_index", &|_| task),
        ("timestamp", &|row| Some(row as f64 / metadata.info.fps)),
    ];
    for (key, value) in expected {
        let is_time = key == "timestamp";
        let (check, tolerance) = if is_time { ("timestamps", TIME_TOLERANCE_S) } else { ("rows", 0.0) };
        let Some(column) = rows.get(key) else { continue };
        for (row, found) in column.values.iter().enumerate() {
            let is_off = |expected: f64| (found - expected).abs() > tolerance || found.is_nan();
            if let Some(expected) = value(row).filter(|expected| is_off(*expected)) {
                findings.add(check, file, format!("{}, row {row}, {key}", episode.place()), expected, found);
                break;
            }
        }
    }
    for (key, column) in rows {
        if let Some(entry) = column.values.iter().position(|value| !value.is_finite()) {
            let row = entry / column.width.max(1);
            let place = format!("{}, row {row}, {key}[{}]", episode.place(), entry % column.width.max(1));
            findings.add("values", file, place, "a finite number", column.values[entry]);
        }
    }
    ends(episode, rows, findings);
    steps(metadata, episode, rows, findings);
    let is_whole = |column: &Column| column.values.iter().all(|value| value.is_finite());
    let counted = |column: &Column| column.width > 0 && !column.values.is_empty() && is_whole(column);
    for (key, column) in rows.iter().filter(|(_, column)| counted(column)) {
        let names = ["min", "max", "mean", "std", "q01", "q10", "q50", "q90", "q99", "count"];
        let Some(recorded) = v30::statistics(metadata, episode, key, &names) else {
            if metadata.is_own {
                let place = format!("{}, stats of {key}", episode.place());
                findings.add("statistics", &episode.listed_in.0, place, "statistics", "none");
            }
            continue;
        };
        let stats = Stats::of_vectors(&column.values, column.width);
        let place = |name: &str| format!("{}, {name} of {key}", episode.place());
        for (name, expected) in stats.named.iter().filter(|(name, _)| metadata.is_own || !name.starts_with('q')) {
            let Some(found) = recorded.get(*name) else { continue };
            if !totals::are_equal(expected, found, column) {
                let [expected, found] = [expected, found].map(|numbers| totals::abbreviated(numbers));
                findings.add("statistics", &episode.listed_in.0, place(name), expected, found);
            }
        }
        if let Some(count) = recorded.get("count")
            && count.first() != Some(&(stats.count as f64))
        {
            findings.add("statistics", &episode.listed_in.0, place("count"), stats.count, totals::abbreviated(count));
        }
    }
}

/// Checks that `next.done` is true only in the last row, and `next.success` only there and only if the episode
/// succeeded.
fn ends(episode: &EpisodeEntry, rows: &Rows, findings: &mut Findings) {
    for key in ["next.done", "next.success"] {
        let Some(column) = rows.get(key) else { continue };
        let at_end = if key == "next.done" { Some(true) } else { episode.success };
        let last = column.values.len().saturating_sub(1);
        for (row, value) in column.values.iter().enumerate() {
            let expected = if row == last { at_end } else { Some(false) };
            if expected.is_some_and(|expected| expected != (*value > 0.0)) {
                let place = format!("{}, row {row}, {key}", episode.place());
                findings.add("rows", &episode.data, place, expected.unwrap_or_default(), *value > 0.0);
                break;
            }
        }
    }
}

/// Checks that every row belongs to a step (subtask) listed by its episode.
fn steps(metadata: &Metadata, episode: &EpisodeEntry, rows: &Rows, findings: &mut Findings) {
    let (Some(column), Some(listed)) = (rows.get("subtask_index"), &episode.subtasks) else { return };
    for (row, index) in column.values.iter().enumerate() {
        let text = metadata.subtasks.iter().find(|(known, _)| *known as f64 == *index).map(|(_, text)| text);
        if text.is_none_or(|text| !listed.contains(text)) {
            let place = format!("{}, row {row}, subtask_index", episode.place());
            let found = format!("{index}, {}", text.map_or("which does not exist", String::as_str));
            findings.add("rows", &episode.data, place, format!("a step of {listed:?}"), found);
            break;
        }
    }
}

/// Hash of states and actions, which identifies an episode.
fn content(rows: &Rows) -> u64 {
    let mut hasher = DefaultHasher::new();
    for key in ["observation.state", "action", "frame_index"] {
        let values = rows.get(key).map(|column| column.values.as_slice()).unwrap_or_default();
        hasher.write_usize(values.len());
        values.iter().for_each(|value| hasher.write_u64(value.to_bits()));
    }
    if !rows.contains_key("action") {
        // Without states and actions, only the index of the first row distinguishes episodes.
        let index = rows.get("index").and_then(|column| column.values.first()).copied();
        hasher.write_u64(index.unwrap_or_default().to_bits());
    }
    hasher.finish()
}
