//! Overlays on images: masks, numbers, grid, bounding boxes, grasps, tool path, contact forces and frames.

mod caption;
mod figures;
mod grasps;
mod palette;
mod pen;

use genmanip_agent::grid::Grid;
use genmanip_agent::image::{RgbImage, marks};
use genmanip_agent::segmentation::Mask;
use genmanip_core::glam::DVec3;
use genmanip_core::perception::FIRST_OBJECT;
use genmanip_core::{Camera, Episode, ImageChannels, RgbdImage};
use genmanip_rollout::Stage;
use genmanip_rollout::replay::ContactReplay;
use genmanip_sim::ContactReport;

use self::caption::Caption;
use self::grasps::DrawnGrasp;
use self::palette::PALETTE;
use self::pen::Pen;
use super::moment::{Boxes, Moment};
use crate::scene_images::not_drawn;
use genmanip_workspace::WorkspaceError;

/// Opacity of an object's tint. Chosen by hand: the object's own colour stays recognisable.
const FILL: f64 = 0.35;

/// Kind of overlay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlay {
    /// Tinted and outlined mask of each object.
    Masks,
    /// Number of each object, from 1 in the order of the scenario.
    Numbers,
    /// Grid with lettered cells, as agents get it.
    Grid,
    /// Oriented bounding box of each object.
    Boxes,
    /// Grippers at grasps: tried grasps for a scenario, executed ones for an episode.
    Grasps,
    /// Path of the tool, before and after the moment.
    Path,
    /// Normal forces at contacts.
    Contacts,
    /// Axes of the world, the tool and the other cameras, and the pixel axes.
    Frames,
}

impl Overlay {
    /// All overlays in the order in which they are drawn.
    pub const ALL: [Self; 8] =
        [Self::Masks, Self::Grid, Self::Boxes, Self::Path, Self::Grasps, Self::Contacts, Self::Frames, Self::Numbers];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Masks => "masks",
            Self::Numbers => "numbers",
            Self::Grid => "grid",
            Self::Boxes => "boxes",
            Self::Grasps => "grasps",
            Self::Path => "path",
            Self::Contacts => "contacts",
            Self::Frames => "frames",
        }
    }

    /// True if the overlay shows motion, and thus needs an episode.
    fn is_of_episodes(self) -> bool {
        matches!(self, Self::Path | Self::Contacts)
    }
}

/// Overlays selected for the images of a scenario or an episode.
pub(super) struct Overlays<'a> {
    chosen: Vec<Overlay>,
    stage: &'a Stage,
    episode: Option<&'a Episode>,
    boxes: Boxes<'a>,
    grasps: Vec<DrawnGrasp>,
    replay: Option<ContactReplay<'a>>,
    contacts: Vec<ContactReport>,
    caption: Option<Caption>,
}

impl<'a> Overlays<'a> {
    /// Prepares the overlays; fails if a scenario is to show motion, or if contacts cannot be replayed or grasps not be
    /// found.
    pub(super) fn new(
        stage: &'a Stage,
        episode: Option<&'a Episode>,
        chosen: &[Overlay],
        has_captions: bool,
    ) -> Result<Self, WorkspaceError> {
        if episode.is_none()
            && let Some(overlay) = chosen.iter().find(|overlay| overlay.is_of_episodes())
        {
            let what = format!("--overlay {}: scenario {} has no motion", overlay.name(), stage.scenario.id);
            return Err(WorkspaceError::input(what).with_hint("name an episode, a folder of episodes or a run"));
        }
        let has = |overlay: Overlay| chosen.contains(&overlay);
        let replayed = episode.filter(|_| has(Overlay::Contacts)).map(|episode| ContactReplay::new(stage, episode));
        let replay = replayed.transpose().map_err(|error| not_drawn(&stage.scenario.id, error))?;
        let grasps = has(Overlay::Grasps).then(|| match episode {
            Some(episode) => Ok(grasps::made(episode)),
            None => grasps::tried(stage),
        });
        Ok(Self {
            chosen: Overlay::ALL.into_iter().filter(|overlay| has(*overlay)).collect(),
            stage,
            episode,
            boxes: Boxes::new(stage),
            grasps: grasps.transpose()?.unwrap_or_default(),
            replay,
            contacts: Vec::new(),
            caption: has_captions.then(|| Caption::new(stage, episode)),
        })
    }

    /// Requested channels, and those that the overlays need.
    pub(super) fn channels(&self, asked: ImageChannels) -> ImageChannels {
        let needs = |overlays: &[Overlay]| self.chosen.iter().any(|chosen| overlays.contains(chosen));
        ImageChannels {
            depth: asked.depth || needs(&[Overlay::Boxes, Overlay::Grasps, Overlay::Frames]),
            ids: asked.ids || needs(&[Overlay::Masks, Overlay::Numbers]),
            ..asked
        }
    }

    /// Draws over the colours of a moment's images, one image per camera; must be called in the order of the moments.
    pub(super) fn draw(
        &mut self,
        moment: &Moment,
        cameras: &[Camera],
        images: &mut [RgbdImage],
    ) -> Result<(), WorkspaceError> {
        if self.chosen.is_empty() && self.caption.is_none() {
            return Ok(());
        }
        if let Some(replay) = &mut self.replay {
            let contacts = replay.at(moment.control_step);
            self.contacts = contacts.map_err(|error| not_drawn(&self.stage.scenario.id, error))?;
        }
        for index in 0..images.len() {
            let others = cameras.iter().zip(&*images).enumerate().filter(|(other, _)| *other != index);
            let others: Vec<_> = others.map(|(_, (camera, image))| (camera.name.clone(), image.projection())).collect();
            self.draw_over(moment, &mut images[index], &others);
        }
        Ok(())
    }

    fn draw_over(&self, moment: &Moment, image: &mut RgbdImage, others: &[(String, genmanip_core::Projection)]) {
        let Some(mut picture) = RgbImage::new(image.width(), image.height(), std::mem::take(&mut image.rgb)) else {
            return;
        };
        let masks = self.masks(image);
        for overlay in &self.chosen {
            let mut pen = Pen { picture: &mut picture, projection: image.projection(), depth_m: &image.depth_m };
            match overlay {
                Overlay::Masks => marks::tints(&mut picture, &masks, &PALETTE, FILL),
                Overlay::Numbers => marks::numbers(&mut picture, &masks, &PALETTE),
                Overlay::Grid => marks::lettered(&mut picture, &Grid::usual(image.width(), image.height())),
                Overlay::Boxes => figures::boxes(&mut pen, &self.boxes.at(moment)),
                Overlay::Grasps => self.grasps.iter().for_each(|grasp| figures::gripper(&mut pen, grasp)),
                Overlay::Path => {
                    let frames = self.episode.map_or(&[][..], |episode| &episode.frames);
                    let tools: Vec<DVec3> = frames.iter().map(|frame| frame.tcp.position).collect();
                    figures::path(&mut pen, &tools, moment.control_step);
                }
                Overlay::Contacts => figures::contacts(&mut pen, &self.contacts),
                Overlay::Frames => {
                    let tool = self.stage.robot.link_poses(&moment.arm, moment.width)[self.stage.robot.hand]
                        * self.stage.robot.hand_from_tcp;
                    figures::frames(&mut pen, &tool, others);
                }
            }
        }
        if let Some(caption) = &self.caption {
            caption.draw(&mut picture, moment);
        }
        image.rgb = picture.rgb;
    }

    /// Mask of each object in the order of the scenario; empty if no overlay needs masks.
    fn masks(&self, image: &RgbdImage) -> Vec<Mask> {
        if !self.chosen.iter().any(|chosen| matches!(chosen, Overlay::Masks | Overlay::Numbers)) {
            return Vec::new();
        }
        let mask = |(_, id): (_, u16)| {
            let pixels = image.ids.iter().map(|seen| *seen == id).collect();
            Mask { width: image.width(), height: image.height(), pixels }
        };
        self.stage.scenario.objects.iter().zip(FIRST_OBJECT..).map(mask).collect()
    }
}
