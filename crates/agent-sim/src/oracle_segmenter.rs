//! Ground-truth segmentation from the simulator: an oracle that isolates the effect of segmentation errors.

use std::collections::BTreeMap;

use genmanip_agent::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};
use genmanip_render::FIRST_OBJECT;

/// Segmenter that returns one mask per object visible in the renderer's ids; the image must have its `ids` channel.
///
/// Asked for parts of a mask, it returns the objects within that mask, since ids do not distinguish parts.
#[derive(Clone, Copy, Debug, Default)]
pub struct OracleSegmenter;

impl Segmenter for OracleSegmenter {
    /// Returns one mask per object, in the order of the objects.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError> {
        let SegmentQuestion { image, ignore, within } = *question;
        let (width, height) = (image.width(), image.height());
        let count = width as usize * height as usize;
        if image.ids.len() != count {
            return Err(SegmentError::Unsuited {
                needed: format!("{count} ids, which only the simulator knows"),
                found: format!("{} ids", image.ids.len()),
            });
        }
        let mut masks: BTreeMap<u16, Vec<bool>> = BTreeMap::new();
        for (index, &id) in image.ids.iter().enumerate() {
            let is_asked = within.is_none_or(|mask| mask.pixels.get(index) == Some(&true));
            if id >= FIRST_OBJECT && is_asked && ignore.get(index) != Some(&true) {
                masks.entry(id).or_insert_with(|| vec![false; count])[index] = true;
            }
        }
        Ok(masks.into_values().map(|pixels| Mask { width, height, pixels }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::{Intrinsics, Pose, RgbdImage};

    fn image(ids: &[u16]) -> RgbdImage {
        let intrinsics = Intrinsics::from_vertical_fov(ids.len() as u32, 1, 0.5);
        RgbdImage { ids: ids.to_vec(), ..RgbdImage::of_depth(intrinsics, Pose::IDENTITY, vec![]) }
    }

    fn columns(masks: &[Mask]) -> Vec<Vec<usize>> {
        let inside = |mask: &Mask| (0..mask.pixels.len()).filter(|&index| mask.pixels[index]).collect();
        masks.iter().map(inside).collect()
    }

    #[test]
    fn objects_are_told_apart_and_what_is_ignored_is_left_out() {
        let image = image(&[0, 4, 4, 3, 1, 3, 2, 9]);
        let asked = SegmentQuestion { image: &image, ignore: &[], within: None };
        assert_eq!(columns(&OracleSegmenter.segment(&asked).unwrap()), [vec![3, 5], vec![1, 2], vec![7]]);
        let ignore: Vec<bool> = (0..8).map(|index| index == 5 || index == 7).collect();
        let asked = SegmentQuestion { ignore: &ignore, ..asked };
        assert_eq!(columns(&OracleSegmenter.segment(&asked).unwrap()), [vec![3], vec![1, 2]]);
        let within = Mask { width: 8, height: 1, pixels: (0..8).map(|index| index < 2).collect() };
        let asked = SegmentQuestion { within: Some(&within), ..asked };
        assert_eq!(columns(&OracleSegmenter.segment(&asked).unwrap()), [vec![1]]);
    }

    #[test]
    fn an_image_without_ids_is_refused() {
        let image = image(&[]);
        let image = RgbdImage { intrinsics: Intrinsics::from_vertical_fov(8, 1, 0.5), ..image };
        let error = OracleSegmenter.segment(&SegmentQuestion { image: &image, ignore: &[], within: None }).unwrap_err();
        assert_eq!(error.to_string(), "segmentation needs 8 ids, which only the simulator knows in the image: 0 ids");
    }
}
