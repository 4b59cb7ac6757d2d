//! Golden-image tests of the marks at both usual image sizes, with a tolerance.
//!
//! After an intended change, run once with `GENMANIP_UPDATE_GOLDEN=1`, review the images and commit them.

use genmanip_agent::grid::Grid;
use genmanip_agent::image::{RgbImage, marks};
use genmanip_agent::segmentation::Mask;
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Intrinsics, RgbdImage};

/// A white table with single-colour objects: a large one, a thin one, three small ones side by side, and one in the
/// lower right corner.
struct Scene {
    picture: RgbImage,
    masks: Vec<Mask>,
    image: RgbdImage,
}

fn scene(width: u32, height: u32) -> Scene {
    let unit = f64::from(height) / 288.0;
    let mut picture = RgbImage::plain(width, height, [236, 232, 226]);
    let things: [([f64; 4], [u8; 3]); 6] = [
        ([150.0, 90.0, 240.0, 170.0], [70, 110, 170]),
        ([300.0, 100.0, 380.0, 106.0], [130, 130, 130]),
        ([320.0, 180.0, 332.0, 192.0], [200, 60, 50]),
        ([336.0, 180.0, 348.0, 192.0], [80, 160, 70]),
        ([352.0, 180.0, 364.0, 192.0], [220, 180, 40]),
        ([480.0, 262.0, 511.0, 287.0], [120, 80, 60]),
    ];
    let mut masks = Vec::new();
    for (corners, color) in things {
        let [left, top, right, bottom] = corners.map(|side| side * unit);
        picture.rectangle([left, top], [right, bottom], color, 1.0);
        let inside = |index: u32| {
            let (x, y) = (f64::from(index % width), f64::from(index / width));
            x >= left.round() && x < right.round() && y >= top.round() && y < bottom.round()
        };
        masks.push(Mask { width, height, pixels: (0..width * height).map(inside).collect() });
    }
    let intrinsics = Intrinsics::from_vertical_fov(width, height, 0.32);
    let overview = Camera::looking_at("overview", DVec3::new(2.16, 0.0, 1.76), DVec3::new(0.46, 0.0, 0.08), intrinsics);
    let image = RgbdImage::of_depth(intrinsics, overview.mount_from_camera, Vec::new());
    Scene { picture, masks, image }
}

fn all(width: u32, height: u32) -> Vec<(&'static str, RgbImage)> {
    let Scene { picture, masks, image } = scene(width, height);
    let at = |x: f64, y: f64| {
        let unit = f64::from(height) / 288.0;
        (y * unit) as usize * width as usize + (x * unit) as usize
    };
    let points = [at(160.0, 100.0), at(230.0, 100.0), at(195.0, 130.0), at(160.0, 160.0), at(230.0, 160.0)];
    let mut arrows = picture.clone();
    marks::arrows(&mut arrows, &image, 0.0);
    let half = |part: bool| Mask {
        pixels: masks[0]
            .pixels
            .iter()
            .enumerate()
            .map(|(index, inside)| *inside && (index % width as usize > at(195.0, 0.0)) == part)
            .collect(),
        ..masks[0].clone()
    };
    let [_, parts] = marks::crops(&picture, &masks[0], &[half(false), half(true)]);
    let grab = [195.0, 130.0].map(|side| side * f64::from(height) / 288.0);
    vec![
        ("masks", marks::masks(&picture, &masks)),
        ("points", marks::points(&picture, &points)),
        ("grid", marks::grid(&picture, &Grid::usual(width, height), grab)),
        ("arrows", arrows),
        ("parts", parts),
    ]
}

#[test]
fn marks_look_as_they_did() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/agent/golden");
    for (width, height) in [(512, 288), (1280, 720)] {
        for (name, picture) in all(width, height) {
            let path = folder.join(format!("{name}_{height}.png"));
            if std::env::var_os("GENMANIP_UPDATE_GOLDEN").is_some() {
                std::fs::write(&path, picture.png().unwrap()).unwrap();
            }
            let golden = decode(&path);
            assert_eq!((golden.width, golden.height), (picture.width, picture.height), "{}", path.display());
            let pairs = golden.rgb.iter().zip(&picture.rgb);
            let differing = pairs.filter(|(a, b)| a.abs_diff(**b) > 24).count();
            let share = differing as f64 / golden.rgb.len() as f64;
            assert!(share < 0.001, "{} differs in {:.2} % of its values", path.display(), 100.0 * share);
        }
    }
}

#[test]
fn labels_never_hide_small_things() {
    for (width, height) in [(512, 288), (1280, 720)] {
        let Scene { picture, masks, .. } = scene(width, height);
        let marked = marks::masks(&picture, &masks);
        // The dark ground of a label is the only near-black there is.
        let is_dark = |index: usize| marked.rgb[index * 3..index * 3 + 3].iter().all(|channel| *channel < 70);
        for (index, mask) in masks.iter().enumerate() {
            let area = mask.indices().count();
            let hidden = mask.indices().filter(|&pixel| is_dark(pixel)).count();
            assert!(hidden as f64 <= 0.2 * area as f64, "thing {} at {width}: {hidden} of {area}", index + 1);
        }
    }
}

fn decode(path: &std::path::Path) -> RgbImage {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    RgbImage::new(info.width, info.height, rgb).unwrap()
}

#[test]
fn the_viewpoint_is_that_of_the_camera() {
    let check = |eye: [f64; 3], expected: &str| {
        let intrinsics = Intrinsics::from_vertical_fov(64, 36, 0.32);
        let camera = Camera::looking_at("any", DVec3::from_array(eye), DVec3::new(0.5, 0.0, 0.0), intrinsics);
        let image = RgbdImage::of_depth(intrinsics, camera.mount_from_camera, Vec::new());
        let words = marks::directions(&image);
        assert!(words.starts_with(expected) && words.contains("Arrows in the picture"), "{eye:?}: {words}");
    };
    check([2.16, 0.0, 1.76], "The camera faces the robot.");
    check([-0.5, 0.1, 1.0], "The camera looks away from the robot.");
    check([0.65, 1.1, 0.75], "The camera looks across the table from the robot's left.");
    check([0.65, -1.1, 0.75], "The camera looks across the table from the robot's right.");
    check([0.55, 0.05, 1.5], "The camera looks straight down.");
}
