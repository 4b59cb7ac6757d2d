//! The model's answers for one sub-task, located in 3D.

use std::sync::Arc;

use genmanip_core::{AgentStage, FailedStage, Seed, StageCause};
use glam::DVec3;
use rand::RngExt;

use super::arm_state::{self, ArmState};
use super::destination::{Placement, PlacementQuestion, Places, unexpected};
use super::{Agent, QuestionDraft};
use crate::ask::{Answer, Marks, PathCell, QuestionImage, QuestionKind};
use crate::image::{RgbImage, marks};
use crate::perception::{ObservedObject, PlacementTarget, SegmentedViews, View};
use crate::segmentation::{Mask, SegmentQuestion};
use crate::settings::Asks;

/// Number of grab-point candidates sampled in a mask, as published.
const POINTS: usize = 5;
/// Pixels sampled per candidate; the one farthest from the candidates so far is kept (farthest-point sampling).
const SAMPLES_PER_POINT: usize = 12;
/// Minimum overlap (IoU) of an object's masks before and after for it to count as standing where it stood. Chosen by hand.
const UNMOVED_IOU: f64 = 0.8;

/// One pick and one place.
#[derive(Clone, Debug)]
pub(super) struct Subtask {
    /// Name that the model gives the object.
    pub name: String,
    /// The object at its observed pose.
    pub object: ObservedObject,
    /// Points above the table that belong to neither the object nor the robot, world frame.
    pub around: Vec<DVec3>,
    /// Camera of the view shown to the model.
    camera: String,
    /// Mask of the object in that view.
    mask: Mask,
    /// Mask of the object or of the part to grasp, in that view.
    pub grasp_mask: Mask,
    /// Grab point, world frame; `None` if any grasp of the object is acceptable.
    pub grab: Option<DVec3>,
    /// Pixel indices of the numbered grab points, and index of the chosen one; `None` if the model was not asked.
    points: Option<(Vec<usize>, usize)>,
    /// Answers to the placement questions.
    pub placement: Placement,
    /// Placement target that the answers refer to, in 3D.
    pub target: PlacementTarget,
    /// Waypoints of the carry path without its start cell: points on the table below the path with heights and yaw; the
    /// last one is the placement. Empty when the model was asked for one cell only.
    pub path: Vec<(DVec3, PathCell)>,
}

/// The object of a pick or placement that failed, as it was seen before.
#[derive(Clone, Debug)]
pub(super) struct Retry {
    name: String,
    camera: String,
    mask: Mask,
    grab: Option<DVec3>,
    /// Pixel indices of the numbered grab points; `None` if the model was not asked.
    points: Option<Vec<usize>>,
    /// True if the object was not between the fingers after the pick.
    is_slipped: bool,
}

/// Choice of the object to pick.
#[derive(Clone, Copy)]
pub(super) enum ObjectChoice<'a> {
    /// The model is asked; `is_last_view` if there is no other view to show.
    Asked { is_last_view: bool },
    /// The object of a failed attempt, which stands where it stood, by its mask in the view shown to the model.
    Kept { mask: usize, retry: &'a Retry },
}

impl Retry {
    pub(super) fn new(subtask: Subtask, is_slipped: bool) -> Self {
        let Subtask { name, camera, mask, grab, points, .. } = subtask;
        Self { name, camera, mask, grab, points: points.map(|(points, _)| points), is_slipped }
    }

    /// Views with the one first in which the object was chosen; `None` if that camera is gone.
    pub(super) fn shown(&self, views: &SegmentedViews) -> Option<SegmentedViews> {
        let index = views.views.iter().position(|view| view.camera == self.camera)?;
        Some(if index == 0 { views.clone() } else { views.with_shown_view(index) })
    }

    /// Mask of the object in the first of [`Self::shown`] views; `None` if it does not stand where it stood.
    pub(super) fn found(&self, shown: &SegmentedViews) -> Option<usize> {
        let overlaps = shown.views.first()?.masks.iter().map(|mask| mask.iou(&self.mask)).enumerate();
        let (mask, _) = overlaps.filter(|(_, iou)| *iou >= UNMOVED_IOU).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(mask)
    }
}

impl Subtask {
    pub(super) fn asked(
        agent: &Agent,
        views: &SegmentedViews,
        view: &View,
        choice: ObjectChoice,
        state: &ArmState,
        seed: Seed,
    ) -> Result<Self, FailedStage> {
        let settings = &agent.settings;
        let subtask = agent.subtasks.get(agent.current).map_or("", String::as_str);
        let image = agent.annotated_view(view);
        let (mask, name, retry) = match choice {
            ObjectChoice::Kept { mask, retry } => (mask, retry.name.clone(), Some(retry)),
            ObjectChoice::Asked { is_last_view } => {
                let (mask, name) = choose_object(agent, view, &image, subtask, is_last_view)?;
                (mask, name, None)
            }
        };
        let world = arm_state::table_world(settings);
        let around = agent
            .planner
            .points_seen(&arm_state::empty_gripper(&world, state.width_m), &state.arm, &views.without(mask))
            .map_err(|error| FailedStage::new(AgentStage::Look, StageCause::Unsuited, error.to_string()))?;
        let object = ObservedObject::new(views.points(mask), &around, settings.table_m).ok_or_else(|| {
            FailedStage::new(
                AgentStage::Object,
                StageCause::TooSmall,
                format!("too little is seen of {name} to take hold of it"),
            )
        })?;
        // Remaining pixels at the object's own outline are not obstacles to it.
        let mut with_object = world.clone();
        let added = with_object.add(arm_state::OBJECT, &object.pieces, &object.pose);
        added
            .map_err(|error| FailedStage::new(AgentStage::Object, StageCause::TooSmall, format!("{name}: {error}")))?;
        let around = agent
            .planner
            .points_seen(&arm_state::empty_gripper(&with_object, state.width_m), &state.arm, &views.without(mask))
            .map_err(|error| FailedStage::new(AgentStage::Look, StageCause::Unsuited, error.to_string()))?;
        let grasp_mask =
            if settings.ctof { choose_part(agent, view, mask, subtask)? } else { view.masks[mask].clone() };
        let places = Places { agent, views, view, mask, object: &object, around: &around };
        let targets = places.of(&places.grid());
        let is_asked = match (settings.asks, retry) {
            (Asks::Every, _) => true,
            (Asks::Needed, _) if settings.ctof => false,
            // After a failed grasp, another one is asked for; after a failed placement, the grasp was right.
            (Asks::Needed, Some(retry)) => retry.is_slipped && is_large(agent, &object),
            (Asks::Needed, None) => parts_compete(agent, view, mask, &object)?,
        };
        let grab_question = match retry.and_then(|retry| retry.points.clone()) {
            // The points keep their numbers, since the question names the one that failed.
            Some(points) => GrabPointQuestion { view, image: &image, name: &name, points },
            None => GrabPointQuestion::new(view, &image, &grasp_mask, &name, seed)?,
        };
        let placement_question = PlacementQuestion { places, targets: &targets, image: &image, name: &name, subtask };
        let middle = view.masks[mask].middle().unwrap_or(grab_question.points[0]);
        // The placement is still valid, unless the placement itself failed.
        let kept = agent
            .placement
            .clone()
            .filter(|kept| settings.asks == Asks::Needed && placement_question.place(&kept.answer).is_ok());
        let asked = |answer: Answer| Placement { answer, fine: None };
        let (chosen, placement) = match (is_asked, kept) {
            (true, Some(kept)) => (Some(grab_question.chosen(agent.ask(view, grab_question.asked())?)?), kept),
            (true, None) if settings.asks_at_once => {
                // The placement question does not depend on the grab point.
                let start = placement_question.start(middle);
                let [grab, place] = agent.ask_two(view, [grab_question.asked(), placement_question.asked(&start)]);
                (Some(grab_question.chosen(grab?)?), asked(place?))
            }
            (true, None) => {
                let chosen = grab_question.chosen(agent.ask(view, grab_question.asked())?)?;
                let start = placement_question.start(grab_question.points[chosen]);
                (Some(chosen), asked(agent.ask(view, placement_question.asked(&start))?))
            }
            (false, Some(kept)) => (None, kept),
            (false, None) => {
                (None, asked(agent.ask(view, placement_question.asked(&placement_question.start(middle)))?))
            }
        };
        let (target, path) = placement_question.place(&placement.answer)?;
        let start = chosen.map_or(middle, |chosen| grab_question.points[chosen]);
        let (placement, target) = placement_question.refined(placement, target, &placement_question.start(start))?;
        let point = |pixel: usize| view.image.point(pixel).unwrap_or(object.pose.position);
        let grab = match chosen {
            Some(chosen) => Some(point(grab_question.points[chosen])),
            // Centre of the part to grasp, which the model chose.
            None if settings.ctof => grasp_mask.middle().map(point),
            None => retry.and_then(|retry| retry.grab),
        };
        let points = chosen.map(|chosen| (grab_question.points, chosen));
        let (camera, mask) = (view.camera.clone(), view.masks[mask].clone());
        Ok(Self { name, object, around, camera, mask, grasp_mask, grab, points, placement, target, path })
    }

    /// Number of the chosen grab point, as the beginning of a sentence about it; `None` if the model was not asked.
    pub(super) fn point_words(&self) -> Option<String> {
        self.points.as_ref().map(|(_, chosen)| format!("point {}: ", chosen + 1))
    }

    /// Asks for another grab point on the same object, if one was asked for; the answers about object and placement are
    /// kept.
    pub(super) fn regrasp(self, agent: &Agent, view: &View, seed: Seed) -> Result<Self, FailedStage> {
        let Some((points, _)) = &self.points else { return Ok(self) };
        let image = agent.annotated_view(view);
        let question = match agent.settings.asks {
            Asks::Every => GrabPointQuestion::new(view, &image, &self.grasp_mask, &self.name, seed)?,
            // The points keep their numbers, since the question names the one that failed.
            Asks::Needed => GrabPointQuestion { view, image: &image, name: &self.name, points: points.clone() },
        };
        let chosen = question.chosen(agent.ask(view, question.asked())?)?;
        let grab = view.image.point(question.points[chosen]).or(self.grab);
        let points = Some((question.points, chosen));
        Ok(Self { grab, points, ..self })
    }
}

fn choose_object(
    agent: &Agent,
    view: &View,
    image: &QuestionImage,
    subtask: &str,
    is_last_view: bool,
) -> Result<(usize, String), FailedStage> {
    if view.masks.is_empty() {
        return Err(FailedStage::new(
            AgentStage::Object,
            StageCause::NoMasks,
            "segmentation found nothing in the picture".into(),
        ));
    }
    let numbered = QuestionImage { name: "masks", picture: Arc::new(marks::masks(&view.picture(), &view.masks)) };
    let asked = QuestionDraft {
        pictures: vec![image.clone(), numbered],
        marks: Marks::Masks(Arc::clone(&view.masks)),
        is_last_view,
        ..QuestionDraft::new(QuestionKind::Object, subtask)
    };
    match agent.ask(view, asked)? {
        Answer::Mark(answer) => Ok((answer.mask, answer.name)),
        other => Err(unexpected(QuestionKind::Object, &other)),
    }
}

/// Asks for the part to grasp; returns the whole object if it has fewer than two parts.
fn choose_part(agent: &Agent, view: &View, mask: usize, subtask: &str) -> Result<Mask, FailedStage> {
    let whole = &view.masks[mask];
    let parts = parts(agent, view, whole)?;
    if parts.len() < 2 {
        return Ok(whole.clone());
    }
    let [image, numbered] = marks::crops(&view.picture(), whole, &parts);
    let shown = |name, picture: RgbImage| QuestionImage { name, picture: Arc::new(picture) };
    let asked = QuestionDraft {
        pictures: vec![shown("crop", image), shown("parts", numbered)],
        marks: Marks::Masks(parts.clone().into()),
        ..QuestionDraft::new(QuestionKind::Part, subtask)
    };
    match agent.ask(view, asked)? {
        Answer::Mark(answer) => Ok(parts[answer.mask].clone()),
        other => Err(unexpected(QuestionKind::Part, &other)),
    }
}

/// True if the object has several parts that a grab point can distinguish.
fn parts_compete(agent: &Agent, view: &View, mask: usize, object: &ObservedObject) -> Result<bool, FailedStage> {
    Ok(is_large(agent, object) && parts(agent, view, &view.masks[mask])?.len() >= 2)
}

/// True if an object is larger than the distance within which a grasp counts as being at the grab point, so that the
/// point matters.
fn is_large(agent: &Agent, object: &ObservedObject) -> bool {
    2.0 * object.half.extend(object.height_m / 2.0).length() > agent.settings.grasp_radius_m
}

/// Masks of an object's parts, from the segmentation source.
fn parts(agent: &Agent, view: &View, whole: &Mask) -> Result<Vec<Mask>, FailedStage> {
    let question = SegmentQuestion { image: &view.image, ignore: &[], within: Some(whole) };
    let parts = agent.services.segmenter.segment(&question);
    parts.map_err(|error| FailedStage::new(AgentStage::Segmentation, StageCause::Service, error.to_string()))
}

/// Question in which the model chooses a grab point.
struct GrabPointQuestion<'a> {
    view: &'a View,
    image: &'a QuestionImage,
    name: &'a str,
    /// Pixel indices of the numbered candidates, at least one.
    points: Vec<usize>,
}

impl<'a> GrabPointQuestion<'a> {
    fn new(
        view: &'a View,
        image: &'a QuestionImage,
        mask: &Mask,
        name: &'a str,
        seed: Seed,
    ) -> Result<Self, FailedStage> {
        let points = sample_points(view, mask, seed);
        if points.is_empty() {
            return Err(FailedStage::new(
                AgentStage::GrabPoint,
                StageCause::NoDepth,
                format!("no pixel of {name} has a depth"),
            ));
        }
        Ok(Self { view, image, name, points })
    }

    fn asked(&self) -> QuestionDraft<'a> {
        let numbered =
            QuestionImage { name: "points", picture: Arc::new(marks::points(&self.view.picture(), &self.points)) };
        QuestionDraft {
            object_name: self.name,
            pictures: vec![self.image.clone(), numbered],
            marks: Marks::Points(self.points.clone()),
            ..QuestionDraft::new(QuestionKind::GrabPoint, self.name)
        }
    }

    /// Index of the chosen point.
    fn chosen(&self, answer: Answer) -> Result<usize, FailedStage> {
        match answer {
            Answer::GrabPoint(answer) => Ok(answer.point),
            other => Err(unexpected(QuestionKind::GrabPoint, &other)),
        }
    }
}

/// Samples grab-point candidates in a mask, far from each other and away from its edge where possible.
fn sample_points(view: &View, mask: &Mask, seed: Seed) -> Vec<usize> {
    let seen = |index: &usize| view.image.point(*index).is_some();
    let all: Vec<usize> = mask.indices().filter(seen).collect();
    let width = mask.width as usize;
    let is_inner = |index: &usize| {
        [index.checked_sub(1), Some(index + 1), index.checked_sub(width), Some(index + width)]
            .into_iter()
            .all(|other| other.is_some_and(|other| mask.pixels.get(other) == Some(&true)))
    };
    let inner: Vec<usize> = all.iter().copied().filter(is_inner).collect();
    let pool = if inner.len() >= 2 * POINTS { inner } else { all };
    let rng = &mut seed.fork("points").rng();
    let mut chosen: Vec<usize> = Vec::new();
    while !pool.is_empty() && chosen.len() < POINTS {
        let place = |index: usize| ((index % width) as f64, (index / width) as f64);
        let apart = |index: usize| {
            let (x, y) = place(index);
            let distances = chosen.iter().map(|&other| (x - place(other).0).hypot(y - place(other).1));
            distances.fold(f64::INFINITY, f64::min)
        };
        let draws: Vec<usize> = (0..SAMPLES_PER_POINT).map(|_| pool[rng.random_range(0..pool.len())]).collect();
        chosen.extend(draws.into_iter().max_by(|a, b| apart(*a).total_cmp(&apart(*b))));
    }
    chosen
}
