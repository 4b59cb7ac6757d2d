//! Errors of the materials found in photographs of objects.

use genmanip_core::{WorkspaceAppearance, World};
use genmanip_render::object_of_instance;
use genmanip_visual_matching::Matched;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

use super::hidden::Hidden;
use super::views::{Difference, OTHER_POSTURE, difference, drawn, medians};
use crate::quantile::Spread;

/// Errors of the materials of the objects' parts.
#[derive(Clone, Debug, Default, Serialize)]
pub struct MaterialReport {
    /// Number of parts whose material was found.
    pub parts: usize,
    /// Relative error of the base colour, the largest of its channels.
    pub color_error: Spread,
    /// The same of the objects' own materials.
    pub color_error_before: Spread,
    /// Number of parts whose roughness was found; it is named as not identifiable for the others.
    pub roughness_found: usize,
    /// Error of the roughness where it was found.
    pub roughness_error: Spread,
    /// Number of those whose range holds the truth.
    pub roughness_covered: usize,
    /// Median over a held-out view of the objects at other places of their mean ΔE2000, with their own materials and with
    /// the found ones, both in the matched light.
    pub delta_e: [f64; 2],
}

/// Errors of all worlds.
#[derive(Default)]
pub struct Errors {
    color: Vec<f64>,
    color_before: Vec<f64>,
    roughness: Vec<f64>,
    covered: usize,
    views: Vec<[Difference; 2]>,
}

impl Errors {
    /// Adds the errors of one world; none without photographs of objects.
    ///
    /// # Errors
    /// When the held-out view cannot be rendered.
    pub fn add(&mut self, hidden: &Hidden, matched: &Matched) -> Result<(), WorkspaceError> {
        if matched.materials.is_empty() {
            return Ok(());
        }
        for found in &matched.materials {
            let (object, part) = (&found.material.object, &found.material.part);
            let Some(truth) = hidden.materials.iter().find(|truth| truth.is_of(object, part)) else { continue };
            let worst = |factor: [f64; 3]| {
                let shares = factor.iter().zip(truth.color_factor).map(|(found, truth)| (found / truth - 1.0).abs());
                shares.fold(0.0, f64::max)
            };
            self.color.push(worst(found.material.color_factor));
            self.color_before.push(worst([1.0; 3]));
            if let (true, Some(value), Some(truth)) = (found.has_roughness, found.material.roughness, truth.roughness) {
                self.roughness.push((value - truth).abs());
                let holds = found.roughness_range.is_some_and(|[low, high]| (low..=high).contains(&truth));
                self.covered += usize::from(holds);
            }
        }
        let [.., held_out] = &hidden.layouts;
        let truth = hidden.photo(0, Some(&OTHER_POSTURE), held_out, "materials")?;
        let plain = World {
            appearance: matched.world.appearance.clone().map(|it| WorkspaceAppearance { materials: Vec::new(), ..it }),
            ..matched.world.clone()
        };
        let images = [&plain, &matched.world].map(|world| drawn(hidden, world, 0, held_out));
        let [before, after] = images;
        let (before, after) = (before?, after?);
        let counts = |at: usize| object_of_instance(before.instance[at]).is_some();
        self.views.push([&before, &after].map(|image| difference(&truth, image, &counts)));
        Ok(())
    }

    /// Errors over all worlds.
    pub fn report(self) -> MaterialReport {
        MaterialReport {
            parts: self.color.len(),
            color_error: Spread::of(self.color),
            color_error_before: Spread::of(self.color_before),
            roughness_found: self.roughness.len(),
            roughness_error: Spread::of(self.roughness),
            roughness_covered: self.covered,
            delta_e: medians(&self.views, |it| it.delta_e),
        }
    }
}

/// Text summary.
pub fn describe(report: &MaterialReport) -> String {
    format!(
        "colours of objects  {} % in {} parts (median / 95th percentile), {} % before\n\
         roughness           {} (median / 95th percentile), found in {}, {} of them within their range\n\
         objects elsewhere   ΔE2000 {:.2} with their own materials, {:.2} with the found ones\n",
        report.color_error.text(100.0),
        report.parts,
        report.color_error_before.text(100.0),
        report.roughness_error.text(1.0),
        report.roughness_found,
        report.roughness_covered,
        report.delta_e[0],
        report.delta_e[1],
    )
}
