//! Boards drawn through a homography, so that the place of each corner is known exactly.

use genmanip_core::Seed;
use genmanip_core::glam::{DMat3, DVec2};
use rand::RngExt;

use super::*;
use crate::homography::{homography, mapped};

const CHARUCO: Charuco = Charuco { columns: 7, rows: 5, square_m: 0.03, tag_m: 0.0225, first_id: 3 };
const GRID: TagGrid = TagGrid { columns: 4, rows: 3, tag_m: 0.03, gap_m: 0.0075, first_id: 20 };

/// Image of a board: area sampled with 5 x 5 points per pixel, shaded from left to right, with a tone curve.
fn drawn(layout: &Layout, image_from_board: &DMat3, noise: f64, seed: Seed) -> GreyImage {
    const SIZE: [usize; 2] = [400, 300];
    const SUB: usize = 5;
    let board_from_image = image_from_board.inverse();
    // All edges of the two boards are multiples of that.
    const PIXEL_M: f64 = 0.03 / 32.0;
    const BORDER_M: f64 = 16.0 * PIXEL_M;
    let print = layout.raster(PIXEL_M, BORDER_M);
    let printed = |at: DVec2| {
        let pixel = ((at + BORDER_M) / PIXEL_M).floor();
        let is_in = pixel.cmpge(DVec2::ZERO).all() && pixel.x < print.width() as f64 && pixel.y < print.height() as f64;
        is_in.then(|| print.at(pixel.x as usize, pixel.y as usize))
    };
    let light = |at: DVec2| {
        let board = mapped(&board_from_image, at).unwrap();
        let reflected = match printed(board) {
            Some(0) => 0.04,
            Some(_) => 0.8,
            None => 0.25,
        };
        reflected * (0.7 + 0.3 * at.x / SIZE[0] as f64)
    };
    let mut rng = seed.rng();
    let mut values = Vec::new();
    for index in 0..SIZE[0] * SIZE[1] {
        let corner = DVec2::new((index % SIZE[0]) as f64, (index / SIZE[0]) as f64) - 0.5;
        let points =
            (0..SUB * SUB).map(|sub| corner + (DVec2::new((sub % SUB) as f64, (sub / SUB) as f64) + 0.5) / SUB as f64);
        let mean = points.map(light).sum::<f64>() / (SUB * SUB) as f64;
        let jitter: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
        values.push((255.0 * mean.powf(1.0 / 2.2) + noise * jitter).round().clamp(0.0, 255.0) as u8);
    }
    GreyImage::new(SIZE[0], SIZE[1], values).unwrap()
}

/// Homography that shows a board with its corners near those of a rectangle, each moved by up to `skew` pixels.
fn view(layout: &Layout, turns: usize, skew: f64, seed: Seed) -> DMat3 {
    let mut rng = seed.rng();
    let board = Rectangle { at: DVec2::ZERO, size: layout.size_m }.corners();
    let mut image = Rectangle { at: DVec2::new(70.0, 60.0), size: DVec2::new(260.0, 185.0) }.corners();
    image.rotate_left(turns % 4);
    let image = image.map(|at| at + DVec2::new(rng.random_range(-skew..skew), rng.random_range(-skew..skew)));
    homography(board.into_iter().zip(image)).unwrap()
}

/// Corners are found at their places: at least a share of them, with a median and largest error.
fn check(layout: &Layout, noise: f64, share: f64, [median_px, most_px]: [f64; 2]) {
    for index in 0..4 {
        let seed = Seed::new(index);
        let image_from_board = view(layout, index as usize, 45.0, seed.fork("view"));
        let image = drawn(layout, &image_from_board, noise, seed.fork("noise"));
        let found = detect(&image, layout).unwrap();
        let mut errors: Vec<f64> = found
            .iter()
            .map(|(id, pixel)| mapped(&image_from_board, layout.corners[*id as usize].at).unwrap().distance(*pixel))
            .collect();
        errors.sort_by(f64::total_cmp);
        let (count, most) = (errors.len(), errors[errors.len() - 1]);
        let median = errors[count / 2];
        assert!(count as f64 >= share * layout.corners.len() as f64, "view {index}: {count} corners");
        assert!(median < median_px && most < most_px, "view {index}: {median:.3} and {most:.3} px");
    }
}

#[test]
fn corners_are_found_where_they_were_drawn() {
    let (charuco, grid) = (CHARUCO.layout().unwrap(), GRID.layout().unwrap());
    check(&charuco, 0.0, 0.95, [0.06, 0.12]);
    check(&charuco, 4.0, 0.95, [0.06, 0.15]);
    // The tone curve moves all edges of a tag outwards alike; its middle stays.
    check(&grid, 0.0, 0.95, [0.25, 0.7]);
    check(&grid, 4.0, 0.95, [0.25, 0.7]);
}

#[test]
fn images_without_the_board_say_why() {
    let (charuco, grid) = (CHARUCO.layout().unwrap(), GRID.layout().unwrap());
    let image_from_board = view(&grid, 0, 10.0, Seed::new(1));
    let image = drawn(&grid, &image_from_board, 1.0, Seed::new(1));
    assert!(matches!(detect(&image, &charuco), Err(NoBoard::OtherTags { count: 12, .. })));
    let one = TagGrid { columns: 1, rows: 2, first_id: 31, ..GRID }.layout().unwrap();
    assert_eq!(detect(&image, &one), Err(NoBoard::OneTag));
    // Noise of every kind, and stripes.
    for index in 0..20_u64 {
        let mut rng = Seed::new(index).rng();
        let cell = 1 + index as usize;
        let cells: Vec<u8> = (0..400 * 300).map(|_| if rng.random_bool(0.5) { 20 } else { 220 }).collect();
        let values = (0..400 * 300).map(|at| cells[at / 400 / cell * 400 + at % 400 / cell]).collect();
        assert_eq!(detect(&GreyImage::new(400, 300, values).unwrap(), &charuco), Err(NoBoard::NoTag));
    }
    for size in [0, 1, 2, 9] {
        assert_eq!(detect(&GreyImage::new(size, 3, vec![7; size * 3]).unwrap(), &charuco), Err(NoBoard::NoTag));
    }
}

#[test]
fn impossible_boards_are_refused() {
    let refused = [
        Charuco { columns: 2, ..CHARUCO }.layout(),
        Charuco { columns: 12, rows: 12, ..CHARUCO }.layout(),
        Charuco { tag_m: 0.03, ..CHARUCO }.layout(),
        Charuco { square_m: f64::NAN, ..CHARUCO }.layout(),
        TagGrid { gap_m: 0.001, ..GRID }.layout(),
        TagGrid { first_id: u32::MAX, ..GRID }.layout(),
        TagGrid { columns: 1, rows: 1, ..GRID }.layout(),
    ];
    assert!(refused.iter().all(Result::is_err), "{refused:?}");
}
