//! Instance masks agree with separately rendered ids and depth, and with the recorded poses.

use genmanip_core::glam::DVec3;
use genmanip_core::{AppearanceFactor, CameraRequest, ImageChannels};
use genmanip_data::depth::decode_depth_png;
use genmanip_data::masks::{FIRST_OBJECT, seen};
use genmanip_rollout::images::{Exposure, ImageSettings, StageRenderer, render_masks, render_tracks};

use crate::episodes;

/// One image per second.
fn settings(vary: &[AppearanceFactor]) -> ImageSettings {
    ImageSettings { fps: 1, vary: vary.into(), ..ImageSettings::default() }
}

/// Masks equal the ids of an image rendered with colour and depth, pixel by pixel; and the points of an object's pixels
/// lie in its recorded bounds.
#[test]
fn masks_equal_the_ids_of_the_images() {
    let (stage, episode) = &episodes()[1];
    let settings = settings(&[]);
    let masks = render_masks(stage, episode, &settings).unwrap();
    assert_eq!(masks.len(), 2);
    let everything = ImageChannels { ids: true, ..ImageChannels::RGBD };
    let mut shown = 0;
    for track in &masks {
        let camera = stage.camera(&CameraRequest::new(&track.camera, everything)).unwrap();
        let frames = episode.frames.iter().enumerate().step_by(60);
        assert_eq!(track.png.len(), frames.len());
        for ((index, frame), png) in frames.zip(&track.png) {
            let (width, height, ids) = decode_depth_png(png).unwrap();
            let exposure = Exposure::of(episode, index);
            let image = StageRenderer::new(stage).unwrap().render_frame(frame, &camera, everything, exposure).unwrap();
            assert_eq!((image.width(), image.height()), (width, height));
            assert!(image.ids == ids, "{} at frame {index}", track.camera);
            let scene = stage.posed(&frame.objects);
            let boxes = seen(png, frame.objects.len()).unwrap();
            for (object, seen) in boxes.iter().enumerate() {
                let id = FIRST_OBJECT + object as u16;
                let own = |pixel: &usize| ids[*pixel] == id;
                let pixels: Vec<usize> = (0..ids.len()).filter(own).collect();
                assert_eq!(seen.pixels as usize, pixels.len());
                let bounds = scene.bounds(object).unwrap();
                let (low, high) = (bounds.min, bounds.max);
                for &pixel in &pixels {
                    let (x, y) = (pixel as u32 % width, pixel as u32 / width);
                    let [left, top, right, bottom] = seen.bounds_px;
                    assert!((left..right).contains(&x) && (top..bottom).contains(&y));
                    let point = image.point(pixel).unwrap();
                    // Bounds are those of the collision geometry; the visual geometry may protrude a little.
                    let margin = DVec3::splat(0.01);
                    let is_inside = point.cmpge(low - margin).all() && point.cmple(high + margin).all();
                    assert!(
                        is_inside,
                        "{} at frame {index}: object {object} at {point}, not in {low} to {high}",
                        track.camera
                    );
                }
                shown += usize::from(!pixels.is_empty());
            }
        }
    }
    assert!(shown > 20, "objects were visible only {shown} times");
}

/// With camera randomisation, masks use the moved camera: background ids coincide with missing depth.
#[test]
fn masks_use_the_randomised_camera() {
    let (stage, episode) = &episodes()[1];
    let usual = render_masks(stage, episode, &settings(&[])).unwrap();
    let settings = settings(&[AppearanceFactor::Camera]);
    let (masks, tracks) =
        (render_masks(stage, episode, &settings).unwrap(), render_tracks(stage, episode, &settings).unwrap());
    assert!(masks.iter().zip(&usual).any(|(moved, usual)| moved.png != usual.png), "no camera was moved");
    for (mask, track) in masks.iter().zip(&tracks) {
        assert_eq!((mask.camera.as_str(), mask.png.len()), (track.camera.name.as_str(), track.depth_png.len()));
        for (row, (mask, depth)) in mask.png.iter().zip(&track.depth_png).enumerate() {
            let ((_, _, ids), (_, _, depth_mm)) = (decode_depth_png(mask).unwrap(), decode_depth_png(depth).unwrap());
            let differ = ids.iter().zip(&depth_mm).filter(|(id, mm)| (**id == 0) != (**mm == 0)).count();
            assert_eq!(differ, 0, "{}, row {row}", track.camera.name);
        }
    }
}
