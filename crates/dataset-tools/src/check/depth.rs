//! Check of the depth sibling of a data set.

use std::sync::Arc;

use genmanip_core::RobotModel;

use super::findings::Findings;
use super::metadata::{self, Metadata, Version};
use super::{paths, record, v30};
use genmanip_data::DataError;
use genmanip_data::export::ExtraColumns;
use genmanip_data::lerobot::depth_path;

pub(super) fn check(metadata: &Metadata, robots: &[Arc<RobotModel>], findings: &mut Findings) -> Result<(), DataError> {
    let has_images = metadata.info.features.iter().any(super::metadata::Feature::is_image);
    if metadata.info.version != Version::V30 || has_images {
        return Ok(());
    }
    let Some(settings) = record::settings(metadata).filter(|settings| settings.export.has_sibling()) else {
        return Ok(());
    };
    let sibling = depth_path(&metadata.root);
    let name = format!("../{}", sibling.file_name().unwrap_or_default().to_string_lossy());
    if !sibling.is_dir() {
        findings.add("depth", &name, "", "the depth data set named in the settings", "nothing");
        return Ok(());
    }
    match super::check(&sibling, robots) {
        Ok(checked) => findings.adopt(&name, checked.findings, checked.further),
        Err(error) => {
            findings.add("depth", &name, "", "a data set", error);
            return Ok(());
        }
    }
    // The checks of either data set have recorded their findings; here only the lists of episodes are compared.
    let mut ignored = Findings::default();
    let info = metadata::read_info(&sibling, &mut ignored)?;
    let has_masks = settings.export.columns.contains(&ExtraColumns::Masks);
    let kinds = [("depth", settings.export.depth), ("mask", has_masks)].into_iter().filter(|(_, is_there)| *is_there);
    let keys = kinds.flat_map(|(kind, _)| {
        settings.export.cameras.iter().map(move |camera| format!("observation.images.{camera}_{kind}"))
    });
    for key in keys {
        if !info.features.iter().any(|feature| feature.key == key) {
            findings.add("depth", &name, "features", format!("`{key}`"), "none");
        }
    }
    let depths = v30::read(&sibling, info, &paths::list(&sibling)?, &mut ignored);
    findings.require("depth", &name, "episodes", &metadata.episodes.len(), &depths.episodes.len());
    for (color, depth) in metadata.episodes.iter().zip(&depths.episodes) {
        let [a, b] = [color, depth].map(|episode| (episode.length, &episode.store_id, &episode.sentence));
        findings.require("depth", &name, &format!("{}, length, store_id, tasks", color.place()), &a, &b);
    }
    Ok(())
}
