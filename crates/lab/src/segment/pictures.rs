//! Images of the worst views: input, ground truth and masks.

use std::fs;
use std::path::Path;

use genmanip_agent::segmentation::Mask;
use genmanip_render::encode;

use super::scenes::SegmentView;
use crate::LabError;

/// Collector of the worst views.
pub struct Worst {
    most: usize,
    /// Mean IoU, view and masks, lowest IoU first.
    views: Vec<(f64, SegmentView, Vec<Mask>)>,
}

impl Worst {
    pub fn new(most: usize) -> Self {
        Self { most, views: Vec::new() }
    }

    /// Keeps the view if it is among the worst.
    pub fn keep(&mut self, mean_iou: f64, view: SegmentView, masks: Vec<Mask>) {
        let place = self.views.partition_point(|(other, ..)| *other <= mean_iou);
        if place < self.most {
            self.views.insert(place, (mean_iou, view, masks));
            self.views.truncate(self.most);
        }
    }

    /// Writes one PNG per view: input, ground truth and masks below each other.
    pub fn write(&self, folder: &Path) -> Result<(), LabError> {
        fs::create_dir_all(folder).map_err(|error| LabError::file("create", folder, error))?;
        for (rank, (mean_iou, view, masks)) in self.views.iter().enumerate() {
            let (width, height) = (view.image.width(), view.image.height());
            let truth: Vec<&Mask> = view.objects.iter().map(|object| &object.mask).collect();
            let found: Vec<&Mask> = masks.iter().collect();
            let panels = [view.image.rgb.clone(), tinted(view, &truth), tinted(view, &found)];
            let png = encode::png_rgb(width, 3 * height, &panels.concat())
                .map_err(|error| LabError::broken("cannot encode a picture", error))?;
            let camera = view.name.replace(' ', "-");
            let path = folder.join(format!("{rank:02}-{:03}-{camera}.png", (mean_iou * 1e3) as u32));
            fs::write(&path, png).map_err(|error| LabError::file("write", &path, error))?;
        }
        Ok(())
    }
}

/// The input in grey, with each mask in a colour of its own and the robot darkened.
fn tinted(view: &SegmentView, masks: &[&Mask]) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(view.image.rgb.len());
    for (index, pixel) in view.image.rgb.chunks_exact(3).enumerate() {
        let grey = pixel.iter().map(|channel| u32::from(*channel)).sum::<u32>() / 3;
        let color = masks.iter().position(|mask| mask.pixels[index]).map(color_of);
        let dim = if view.ignore.get(index) == Some(&true) { 2 } else { 1 };
        for channel in 0..3 {
            let value = color.map_or(grey, |color| (grey + 2 * u32::from(color[channel])) / 3);
            rgb.push((value / dim) as u8);
        }
    }
    rgb
}

/// Distinct colour of a mask: the hue advances by the golden angle.
fn color_of(index: usize) -> [u8; 3] {
    let hue = (index as f64 * 0.381_966).fract() * 6.0;
    let value = |shift: f64| {
        let position = (hue + shift).rem_euclid(6.0);
        ((position.min(4.0 - position).clamp(0.0, 1.0) * 0.8 + 0.2) * 255.0) as u8
    };
    [value(2.0), value(0.0), value(4.0)]
}
