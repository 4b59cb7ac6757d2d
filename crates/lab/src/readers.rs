//! Cards for human readers who see only an image and a sentence, and agreement of their answers with the intended
//! meaning.
//!
//! A card is an image of an initial scene with numbered objects, or of an initial scene with the final one below it.
//! Cards are shuffled and numbered, so that neither name nor order reveals anything. Readers write a JSON file as
//! described by [`SCENE_QUESTION`] and [`END_QUESTION`].

use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_agent::image::{RgbImage, marks};
use genmanip_agent::segmentation::Mask;
use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
use genmanip_benchmark::suites;
use genmanip_core::limits::Limit;
use genmanip_core::{
    Atom, CameraRequest, Episode, ImageChannels, ObjectState, PlacedObject, ReferenceId, RgbdImage, Scenario, Seed,
    Task,
};
use genmanip_data::EpisodeStore;
use genmanip_render::FIRST_OBJECT;
use genmanip_rollout::Stage;
use genmanip_rollout::images::{Exposure, StageRenderer};
use genmanip_viz::replay;
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;
use rand::Rng;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::LabError;

/// The camera facing the robot, and one from the side for objects that the first does not see.
const CAMERAS: [&str; 2] = ["overview", "static"];
/// Size of each view on a card, px.
const SIZE_PX: [u32; 2] = [1024, 576];
/// Limit of one reader's answers, bytes.
const ANSWERS: Limit = Limit { what: "answers of a reader", bytes: 1 << 20 };

/// Question about the initial scene of a scenario.
pub const SCENE_QUESTION: &str = "Which things does the sentence ask to be moved, and relative to which thing or things \
is each one's place said? Both views show the same table with the same numbers; the camera of the upper one faces the \
robot, and arrows show the robot's own directions. Where the sentence leaves a choice, take one. Answer \
{\"id\": \"000\", \"moves\": [{\"object\": 3, \"place\": [1]}]}, one move per thing; between two things is \
\"place\": [1, 4].";

/// Question about the end of an episode.
pub const END_QUESTION: &str = "The upper view is before, the lower one after; the same things have the same numbers. Is \
everything that the sentence asks for true in the lower view? The camera faces the robot, and arrows show the robot's own \
directions: front means farther from the robot. Answer {\"id\": \"000\", \"done\": true}.";

/// Input of a reader: `questions.json` beside the images.
#[derive(Clone, Debug, Serialize)]
pub struct Questions {
    /// The question that is on every card, and the JSON format of its answer.
    pub question: &'static str,
    /// Cards in their shuffled order.
    pub cards: Vec<Card>,
}

/// A card: an image with a sentence.
#[derive(Clone, Debug, Serialize)]
pub struct Card {
    /// Number of the card, which its image file is named after.
    pub id: String,
    /// Instruction, the sentence on the card.
    pub sentence: String,
    /// File name of its image.
    pub picture: String,
}

/// Answers file of one reader.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Answers {
    answers: Vec<Answer>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    id: String,
    #[serde(default)]
    moves: Vec<Move>,
    #[serde(default)]
    done: Option<bool>,
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Move {
    object: usize,
    place: BTreeSet<usize>,
}

/// Agreement of readers with the intended meaning or the judge.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number of cards.
    pub cards: usize,
    /// Agreement of each reader with the intended meaning or the judge.
    pub readers: Vec<Reader>,
    /// Agreement of the answers of all readers pooled.
    pub agree: Rate,
}

/// Agreement of one reader.
#[derive(Clone, Debug, Serialize)]
pub struct Reader {
    /// File of the answers.
    pub file: PathBuf,
    /// Share of cards whose answer agrees; a card without an answer counts as wrong.
    pub agree: Rate,
    /// The same share by kind of task.
    pub kinds: BTreeMap<String, Rate>,
    /// Answers that do not agree.
    pub differ: Vec<Difference>,
}

/// An answer that does not agree.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// Number of the card.
    pub card: String,
    /// Path of the scenario, or id of the episode.
    pub of: String,
    /// Instruction on the card.
    pub sentence: String,
    /// Answer of the reader, as text.
    pub answered: String,
    /// Intended meaning, or verdict of the judge.
    pub meant: String,
}

/// Source of the cards.
#[derive(Clone, Copy, Debug)]
pub enum About<'a> {
    /// Initial scenes of a suite's scenarios.
    Starts(&'a Path),
    /// This number of kept episodes of the evaluation in a folder, half of them successes if there are enough.
    Ends(&'a Path, usize),
}

/// Subject of one card, with its correct answer.
enum Subject {
    Start(PathBuf),
    End { store: PathBuf, id: String, is_done: bool },
}

/// Renders the cards into an empty folder.
///
/// # Errors
/// If the suite or the episodes cannot be read, or an image cannot be written.
pub fn write(about: About, seed: Seed, out: &Path, progress: &dyn Progress) -> Result<Questions, LabError> {
    let subjects = subjects(about, seed)?;
    let question = match about {
        About::Starts(_) => SCENE_QUESTION,
        About::Ends(..) => END_QUESTION,
    };
    fs::create_dir_all(out).map_err(|error| LabError::file("create", out, error))?;
    let mut cards = Vec::new();
    progress.begin("drawing cards", subjects.len());
    for (number, subject) in subjects.iter().enumerate() {
        let id = format!("{number:03}");
        let (picture, sentence) = draw(subject)?;
        let file = format!("{id}.png");
        let path = out.join(&file);
        let png = picture.png().map_err(|error| LabError::broken("cannot encode a card", error))?;
        fs::write(&path, png).map_err(|error| LabError::file("write", &path, error))?;
        cards.push(Card { id, sentence, picture: file });
        progress.advance();
    }
    progress.end();
    let questions = Questions { question, cards };
    let path = out.join("questions.json");
    let text = serde_json::to_string_pretty(&questions).map_err(|error| LabError::broken("questions", error))?;
    fs::write(&path, text).map_err(|error| LabError::file("write", &path, error))?;
    Ok(questions)
}

/// Compares answers with the correct ones; `about` and `seed` must be those that the cards were written with.
///
/// # Errors
/// If the answers or the subjects of the cards cannot be read.
pub fn compare(about: About, seed: Seed, answers: &[PathBuf]) -> Result<Report, LabError> {
    let subjects = subjects(about, seed)?;
    let keys = subjects.iter().map(key).collect::<Result<Vec<Key>, _>>()?;
    let mut readers = Vec::new();
    for file in answers {
        let text = documents::read_text(file, ANSWERS)?;
        let read: Answers = serde_json::from_str(&text)
            .map_err(|error| LabError::input(format!("{}: {error}; see questions.json", file.display())))?;
        let by_id: BTreeMap<&str, &Answer> = read.answers.iter().map(|answer| (answer.id.as_str(), answer)).collect();
        let mut counts: BTreeMap<String, [usize; 2]> = BTreeMap::new();
        let mut differ = Vec::new();
        for (number, key) in keys.iter().enumerate() {
            let card = format!("{number:03}");
            let answer = by_id.get(card.as_str()).copied();
            let is_right = answer.is_some_and(|answer| key.is_met_by(answer));
            let [right, all] = counts.entry(key.kind.clone()).or_default();
            *right += usize::from(is_right);
            *all += 1;
            if !is_right {
                let answered = answer.map_or_else(|| "nothing".into(), said);
                differ.push(Difference {
                    card,
                    of: key.of.clone(),
                    sentence: key.sentence.clone(),
                    answered,
                    meant: key.meant(),
                });
            }
        }
        let [right, all] = counts.values().fold([0, 0], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
        let kinds = counts.into_iter().map(|(kind, [right, all])| (kind, rate(right, all))).collect();
        readers.push(Reader { file: file.clone(), agree: rate(right, all), kinds, differ });
    }
    let total = |of: fn(&Rate) -> usize| readers.iter().map(|reader| of(&reader.agree)).sum();
    let agree = rate(total(|rate| rate.successes), total(|rate| rate.trials));
    Ok(Report { cards: keys.len(), readers, agree })
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let mut rows = vec![["reader".to_owned(), "agree".to_owned()]];
    rows.extend(report.readers.iter().map(|reader| [reader.file.display().to_string(), reader.agree.to_string()]));
    rows.push(["all".into(), report.agree.to_string()]);
    let rows: Vec<Vec<String>> = rows.into_iter().map(Vec::from).collect();
    let mut text = format!("{} cards\n{}", report.cards, text_table(&rows));
    for difference in report.readers.iter().flat_map(|reader| &reader.differ) {
        let Difference { card, of, sentence, answered, meant } = difference;
        text += &format!("  {card} ({of}): \"{sentence}\" answered {answered}, meant {meant}\n");
    }
    text
}

fn rate(right: usize, all: usize) -> Rate {
    Rate::new(right, all, &StatisticsSettings::default())
}

/// The subjects of the cards, shuffled.
fn subjects(about: About, seed: Seed) -> Result<Vec<Subject>, LabError> {
    let mut rng = seed.fork("readers").rng();
    let mut subjects = match about {
        About::Starts(folder) => {
            let entries = suites::show(folder)?.file.scenarios;
            entries
                .iter()
                .map(|entry| Subject::Start(folder.join("scenarios").join(format!("{}.json", entry.id))))
                .collect()
        }
        About::Ends(folder, count) => ends(folder, count, &mut rng)?,
    };
    subjects.shuffle(&mut rng);
    Ok(subjects)
}

fn ends(folder: &Path, count: usize, rng: &mut impl Rng) -> Result<Vec<Subject>, LabError> {
    let evaluations = folder.join("evaluation");
    let listed = fs::read_dir(&evaluations).map_err(|error| LabError::file("list", &evaluations, error))?;
    let mut stores: Vec<PathBuf> = listed.flatten().map(|entry| entry.path().join("episodes")).collect();
    stores.retain(|path| path.join("store.json").is_file());
    stores.sort();
    let mut halves = [Vec::new(), Vec::new()];
    for path in stores {
        let unreadable = |error| LabError::broken(format!("cannot read {}", path.display()), error);
        let store = EpisodeStore::open(&path).map_err(unreadable)?;
        for id in store.ids().map_err(unreadable)? {
            let (result, is_kept) = store.read_attempt(&id).map_err(unreadable)?;
            if is_kept {
                let end = Subject::End { store: path.clone(), id, is_done: result.success };
                halves[usize::from(result.success)].push(end);
            }
        }
    }
    let [mut failed, mut solved] = halves;
    failed.shuffle(rng);
    solved.shuffle(rng);
    let of_solved = solved.len().min(count.div_ceil(2).max(count.saturating_sub(failed.len())));
    let of_failed = failed.len().min(count - of_solved);
    if of_solved + of_failed == 0 {
        let what = format!("no kept episodes in {}", evaluations.display());
        return Err(LabError::input(what + "; evaluate with --keep-episodes --out"));
    }
    Ok(solved.drain(..of_solved).chain(failed.drain(..of_failed)).collect())
}

fn read(store: &Path, id: &str) -> Result<Episode, LabError> {
    let episode = EpisodeStore::open(store).and_then(|store| store.read(id));
    episode.map_err(|error| LabError::broken(format!("cannot read episode {id} of {}", store.display()), error))
}

/// Correct answer of a card.
struct Key {
    kind: String,
    of: String,
    sentence: String,
    right: Right,
}

enum Right {
    Moves(Vec<BTreeSet<Move>>),
    Done(bool),
}

impl Key {
    fn is_met_by(&self, answer: &Answer) -> bool {
        match &self.right {
            Right::Moves(ways) => ways.contains(&answer.moves.iter().cloned().collect()),
            Right::Done(is_done) => answer.done == Some(*is_done),
        }
    }

    fn meant(&self) -> String {
        match &self.right {
            Right::Moves(ways) => ways.iter().map(listed).collect::<Vec<_>>().join(" or "),
            Right::Done(is_done) => is_done.to_string(),
        }
    }
}

fn key(subject: &Subject) -> Result<Key, LabError> {
    let (scenario, of, right) = match subject {
        Subject::Start(path) => {
            let scenario = scenarios::read_scenario(path)?;
            let ways = ways(&scenario);
            (scenario, path.display().to_string(), Right::Moves(ways))
        }
        Subject::End { store, id, is_done } => {
            let episode = read(store, id)?;
            (episode.scenario, id.clone(), Right::Done(*is_done))
        }
    };
    let Task { kind, instruction, .. } = scenario.task;
    Ok(Key { kind: kind.name().into(), of, sentence: instruction, right })
}

/// All ways to fulfil a task, each the set of moves of objects by their numbers on the card.
fn ways(scenario: &Scenario) -> Vec<BTreeSet<Move>> {
    let number = |id: &ReferenceId| scenario.index_of(id).map_or(0, |index| index + 1);
    let moved = |atom: &Atom| match atom {
        Atom::Relation { subject, .. } => {
            Some(Move { object: number(subject), place: atom.references().map(number).collect() })
        }
        Atom::State { .. } => None,
    };
    scenario.task.goal.alternatives.iter().map(|atoms| atoms.iter().filter_map(moved).collect()).collect()
}

fn said(answer: &Answer) -> String {
    answer.done.map_or_else(|| listed(&answer.moves.iter().cloned().collect()), |done| done.to_string())
}

fn listed(moves: &BTreeSet<Move>) -> String {
    let one = |it: &Move| {
        let place: Vec<String> = it.place.iter().map(ToString::to_string).collect();
        format!("{} to {}", it.object, place.join("+"))
    };
    moves.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Annotated image and sentence of a card.
fn draw(subject: &Subject) -> Result<(RgbImage, String), LabError> {
    match subject {
        Subject::Start(path) => {
            let stage = scenarios::read_stage(path)?;
            let start = start(&stage);
            let views = CAMERAS.iter().map(|camera| view(&stage, camera, &start)).collect::<Result<Vec<_>, _>>()?;
            Ok((stacked(&views), stage.scenario.task.instruction.clone()))
        }
        Subject::End { store, id, .. } => {
            let episode = read(store, id)?;
            let stage = replay::stage(&episode)?;
            let start = start(&stage);
            let end = episode.frames.last().map_or(start.clone(), |frame| {
                (frame.joint_position.clone(), frame.gripper_width, frame.objects.clone())
            });
            let views = [&start, &end].map(|moment| view(&stage, CAMERAS[0], moment));
            let views = views.into_iter().collect::<Result<Vec<_>, _>>()?;
            Ok((stacked(&views), stage.scenario.task.instruction.clone()))
        }
    }
}

/// Joint positions of the arm, gripper width (m), and states of the objects.
type Moment = (Vec<f64>, f64, Vec<ObjectState>);

fn start(stage: &Stage) -> Moment {
    let state = |placed: &PlacedObject| ObjectState {
        pose: placed.pose,
        joint_positions: placed.joint_positions.clone(),
        speed: 0.0,
        angular_speed: 0.0,
    };
    let objects = stage.scenario.objects.iter().map(state).collect();
    (stage.robot.home.clone(), stage.robot.gripper.max_width, objects)
}

/// Camera image with the objects' numbers and arrows for the directions as seen from the robot.
fn view(stage: &Stage, camera: &str, moment: &Moment) -> Result<RgbImage, LabError> {
    let (arm, width, objects) = moment;
    let channels = ImageChannels { rgb: true, depth: true, ids: true, ..ImageChannels::default() };
    let request = CameraRequest { name: camera.into(), size: Some(SIZE_PX), channels };
    let painted = stage.camera(&request).and_then(|camera| {
        let poses = objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        StageRenderer::new(stage)?.render_state(
            arm,
            *width,
            poses,
            &[(&camera, channels)],
            Exposure::still(Seed::new(0)),
        )
    });
    let image = painted.map_err(|error| LabError::broken("cannot render a card", error))?.swap_remove(0);
    let masks: Vec<Mask> = (0..stage.scenario.objects.len())
        .map(|index| Mask::of_label(image.width(), image.height(), &image.ids, &(FIRST_OBJECT + index as u16)))
        .collect();
    marked(&image, &masks)
}

fn marked(image: &RgbdImage, masks: &[Mask]) -> Result<RgbImage, LabError> {
    let plain = RgbImage::new(image.width(), image.height(), image.rgb.clone())
        .ok_or_else(|| LabError::input("a view without pixels"))?;
    let mut picture = marks::masks(&plain, masks);
    // 0.0: height of the arrows; the table top is at z = 0.
    marks::arrows(&mut picture, image, 0.0);
    Ok(picture)
}

/// Images of equal width stacked vertically.
fn stacked(views: &[RgbImage]) -> RgbImage {
    let width = views.first().map_or(0, |view| view.width);
    let height = views.iter().map(|view| view.height).sum();
    RgbImage { width, height, rgb: views.iter().flat_map(|view| view.rgb.iter().copied()).collect() }
}
