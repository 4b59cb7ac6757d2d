//! `render`: boxes, point clouds, what is drawn over pictures, captions and turns.

use std::fs;
use std::path::Path;

use genmanip_agent::image::RgbImage;
use genmanip_core::Document;
use genmanip_core::geometry::OrientedBox;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::perception::ImageLabels;
use serde_json::Value;

use crate::{assert_same_tree, finished_run, genmanip, tree};

/// The scenario of the run, in its own folder of a folder.
const ID: &str = "021_spatial-000";
/// Tolerance of points outside of boxes, m: depth and poses are single-precision numbers.
const OUTSIDE_M: f64 = 1e-4;

fn draw(folder: &Path, source: &str, out: &str, size: &str, more: &[&str]) -> Value {
    let usual = ["render", source, "--out", out, "--size", size, "--json"];
    genmanip(folder, &[&usual[..], more].concat()).json(0)
}

fn scenario() -> String {
    finished_run().join(format!("scenarios/{ID}.json")).to_str().unwrap().to_owned()
}

fn lines(folder: &Path) -> Vec<ImageLabels> {
    let text = fs::read_to_string(folder.join("labels.jsonl")).unwrap();
    text.lines().map(|line| ImageLabels::from_json(line).unwrap()).collect()
}

/// Points of a binary PLY file with colours.
fn points(file: &Path) -> Vec<DVec3> {
    let bytes = fs::read(file).unwrap();
    let end = bytes.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
    let number = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
    let point = |row: &[u8]| DVec3::new(number(&row[..4]), number(&row[4..8]), number(&row[8..12]));
    bytes[end..].chunks_exact(15).map(point).collect()
}

/// Pixels, boxes and points say the same, for a pinhole and through a lens.
#[test]
fn labels_fit_pixels_points_and_each_other() {
    let folder = tempfile::tempdir().unwrap();
    for (out, more) in [("pinhole", &[][..]), ("lens", &["--distortion=-0.1,0.01,0.001,0"])] {
        let channels = ["--cameras", "static,overview", "--channels", "rgb,boxes,clouds"];
        draw(folder.path(), &scenario(), out, "192x108", &[&channels[..], more].concat());
        let folder = folder.path().join(out).join(ID);
        assert!(!folder.join("static_depth.png").exists() && folder.join("static.png").exists());
        let lines = lines(&folder);
        assert_eq!(lines.iter().map(|line| line.camera.as_str()).collect::<Vec<_>>(), ["overview", "static"]);
        let mut hidden = 0;
        for line in &lines {
            for label in &line.objects {
                let (Some(whole), Some(visible)) = (label.whole_box_px, label.visible_box_px) else { continue };
                let of = format!("{out}: {} by {}", label.id, line.camera);
                let is_around = (0..2).all(|side| whole[side] <= visible[side] && whole[side + 2] >= visible[side + 2]);
                assert!(is_around && label.visible_pixels <= label.whole_pixels, "{of}: {label:?}");
                hidden += label.whole_pixels - label.visible_pixels;
                let cloud = points(&folder.join(format!("{}_clouds/{}.ply", line.camera, label.id)));
                assert_eq!(cloud.len(), label.visible_pixels as usize, "{of}");
                for point in &cloud {
                    let inside = label.world_from_box.inverse().transform_point(*point).abs();
                    let (pixel, depth_m) = line.projection.pixel(*point).unwrap();
                    // A lens takes the depth of the nearest pixel of a pinhole, half a diagonal away at most.
                    let aside_m = line.projection.distortion.map_or(0.0, |_| depth_m / line.projection.intrinsics.fx);
                    let most = 0.5 * label.size_m + OUTSIDE_M + 0.75 * aside_m;
                    assert!(inside.cmple(most).all(), "{of}: {inside} of {most}");
                    let [left, top, right, bottom] = visible.map(f64::from);
                    let (low, high) = (DVec2::new(left, top) - 1.0, DVec2::new(right, bottom));
                    assert!(pixel.cmpge(low).all() && pixel.cmple(high).all(), "{of}: {pixel}");
                }
                // The corners of the box are shown around the whole object.
                let around = OrientedBox { outer_from_box: label.world_from_box, size: label.size_m };
                let corners = around.corners().map(|corner| line.projection.pixel(corner).unwrap().0);
                let low = corners.into_iter().reduce(DVec2::min).unwrap();
                let high = corners.into_iter().reduce(DVec2::max).unwrap();
                let [left, top, right, bottom] = whole.map(f64::from);
                assert!(low.x <= left + 1.0 && low.y <= top + 1.0, "{of}: {low} {whole:?}");
                assert!(high.x >= right - 2.0 && high.y >= bottom - 2.0, "{of}: {high} {whole:?}");
            }
        }
        assert!(hidden > 0, "something stands before something");
        assert!(lines.iter().flat_map(|line| &line.objects).any(|label| label.visible_share == Some(1.0)));
    }
}

/// A line per picture and camera, the objects moving; films with all that can be drawn over them, by any number of
/// workers.
#[test]
fn episodes_get_labels_overlays_and_captions() {
    let folder = tempfile::tempdir().unwrap();
    let episode = finished_run().join("episodes").join(ID);
    let all = "masks,numbers,grid,boxes,grasps,path,contacts,frames";
    let more = ["--cameras", "static,wrist", "--fps", "10", "--channels", "rgb,boxes", "--captions", "--overlay", all];
    let rows = draw(folder.path(), episode.to_str().unwrap(), "one", "128x72", &more);
    let again =
        draw(folder.path(), episode.to_str().unwrap(), "two", "128x72", &[&more[..], &["--workers", "1"]].concat());
    assert_eq!(rows[0]["frames"], again[0]["frames"]);
    assert_same_tree(&tree(&folder.path().join("one")), &tree(&folder.path().join("two")));
    let lines = lines(&folder.path().join("one").join(ID));
    let count = rows[0]["frames"].as_u64().unwrap() as usize;
    assert_eq!(lines.len(), 2 * count);
    assert!(lines.iter().enumerate().all(|(row, line)| line.picture == row / 2 && line.objects.len() > 1));
    let (first, last) = (&lines[0], &lines[lines.len() - 2]);
    let moved = first.objects.iter().zip(&last.objects);
    let way = |(a, b): (&genmanip_core::perception::ObjectLabel, &genmanip_core::perception::ObjectLabel)| {
        a.world_from_box.position.distance(b.world_from_box.position)
    };
    assert!(moved.map(way).any(|way_m| way_m > 0.02) && last.time_s > 1.0);
    let card: Value =
        serde_json::from_slice(&fs::read(folder.path().join("one").join(ID).join("render.json")).unwrap()).unwrap();
    assert_eq!(card["overlays"].as_array().unwrap().len(), 8);
    draw(folder.path(), episode.to_str().unwrap(), "plain", "128x72", &["--cameras", "static", "--fps", "10"]);
    let film = |out: &str| fs::read(folder.path().join(out).join(ID).join("static.mp4")).unwrap();
    assert_ne!(film("one"), film("plain"));
}

/// Looks may improve: run once with `GENMANIP_UPDATE_GOLDEN=1`, look at the picture, commit it.
#[test]
fn what_is_drawn_over_a_still_looks_as_it_did() {
    let folder = tempfile::tempdir().unwrap();
    let more = ["--cameras", "static", "--captions", "--overlay", "masks,numbers,boxes,grasps"];
    draw(folder.path(), &scenario(), "out", "512x288", &more);
    let drawn = fs::read(folder.path().join("out").join(ID).join("static.png")).unwrap();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/overlay.png");
    if std::env::var_os("GENMANIP_UPDATE_GOLDEN").is_some() {
        fs::write(&golden, &drawn).unwrap();
    }
    let [drawn, golden] = [drawn, fs::read(golden).unwrap()].map(|png| RgbImage::of_png(&png).unwrap());
    assert_eq!((golden.width, golden.height), (drawn.width, drawn.height));
    let differences: Vec<u8> = golden.rgb.iter().zip(&drawn.rgb).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = differences.iter().map(|value| f64::from(*value)).sum::<f64>() / differences.len() as f64;
    let far = differences.iter().filter(|value| **value > 24).count() as f64 / differences.len() as f64;
    // Steady within half a step of 255; a figure that is missing changes more than one pixel of 200.
    assert!(mean < 0.5 && far < 0.005, "mean {mean:.2} of 255, {:.2} % differ by more than 24", 100.0 * far);
}

#[test]
fn a_turn_is_a_film_and_its_first_picture() {
    let folder = tempfile::tempdir().unwrap();
    let rows = draw(folder.path(), &scenario(), "out", "128x72", &["--turntable", "6"]);
    assert_eq!(rows[0]["frames"], 6);
    let drawn = tree(&folder.path().join("out").join(ID));
    assert_eq!(drawn.keys().collect::<Vec<_>>(), ["render.json", "turntable.mp4", "turntable.png"]);
    let card: Value = serde_json::from_slice(&drawn["render.json"]).unwrap();
    assert_eq!((card["cameras"].as_array().unwrap().len(), &card["fps"]), (6, &15.into()));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (scenario, run) = (scenario(), finished_run().to_str().unwrap());
    let cases: [(&str, &[&str], &[&str]); 8] = [
        (&scenario, &["--overlay", "contacts"], &["--overlay contacts", ID, "no motion", "episode"]),
        (&scenario, &["--overlay", "masks,path"], &["--overlay path", "no motion"]),
        (run, &["--turntable", "4"], &["--turntable", "expected the file of a scenario", "scenarios"]),
        (&scenario, &["--turntable", "4", "--cameras", "static"], &["--turntable", "--cameras"]),
        (&scenario, &["--turntable", "4", "--channels", "rgb,boxes"], &["--turntable", "--channels"]),
        (&scenario, &["--turntable", "4", "--size", "95x54"], &["95x54", "even"]),
        (&scenario, &["--channels", "boxes", "--overlay", "masks"], &["colours", "rgb"]),
        (&scenario, &["--channels", "depth", "--captions"], &["colours", "rgb"]),
    ];
    for (source, more, wanted) in cases {
        let arguments = [&["render", source, "--out", "refused"][..], more].concat();
        genmanip(folder.path(), &arguments).assert_refused(wanted);
        assert!(!folder.path().join("refused").exists(), "{more:?}");
    }
    let arguments = ["render", &scenario, "--out", "refused", "--overlay", "mask"];
    assert_eq!(genmanip(folder.path(), &arguments).code, Some(2), "an unknown name is none of the command line's");
}
