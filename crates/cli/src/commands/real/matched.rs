//! `genmanip real match`: a world that looks like photographs of the real workspace.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_core::glam::DVec2;
use genmanip_core::{CameraMount, Document, World, limits};
use genmanip_dataset_tools::import::decode_image;
use genmanip_render::color::linear_from_srgb8;
use genmanip_render::encode;
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_visual_matching::report::{ViewReport, reports};
use genmanip_visual_matching::{ChartPhoto, FoundMaterial, MatchRequest, Matched, ObjectScene, Photo, match_workspace};
use genmanip_workspace::{WorkspaceError, documents, scenarios, text_table, worlds};
use serde_json::json;

use crate::args::{ChartArgument, RealMatchArguments};

/// Endings of photographs in a folder.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

pub fn run(arguments: &RealMatchArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let request = request(arguments)?;
    let matched = match_workspace(&request).map_err(|error| {
        WorkspaceError::input("the photographs cannot be matched")
            .because(error)
            .with_hint("docs/guides/match-your-workspace.md says which photographs to take")
    })?;
    let views = reports(&request, &matched)
        .map_err(|error| WorkspaceError::broken("the matched world cannot be compared", error))?;
    write(&arguments.out, &matched, &views)?;
    let found = matched.world.appearance.as_ref();
    let shown = json!({
        "world": arguments.out.join("world.json"),
        "light": found.and_then(|appearance| appearance.light.as_ref()),
        "light_direction_sd_deg": matched.light.as_ref().map(|light| light.direction_sd_deg).filter(|sd| sd.is_finite()),
        "table_color": found.and_then(|appearance| appearance.table_color),
        "cameras": matched.cameras,
        "materials": matched.materials,
        "unidentified": matched.unidentified,
        "views": views,
    });
    printer.data(&shown, &describe(&arguments.out, &matched, &views));
    Ok(ExitStatus::Done)
}

fn request(arguments: &RealMatchArguments) -> Result<MatchRequest, WorkspaceError> {
    let world = worlds::read_world(arguments.world.as_deref())?;
    let robot = worlds::robot(&world)?;
    let arm = match (arguments.no_arm, &arguments.arm) {
        (true, _) => None,
        (false, given) => {
            let joints = given.as_deref().map_or_else(|| world.robot.start().to_vec(), <[f64]>::to_vec);
            if joints.len() != robot.arm_dof() {
                let (got, wanted, name) = (joints.len(), robot.arm_dof(), &robot.name);
                return Err(WorkspaceError::input(format!("--arm has {got} joint positions"))
                    .with_hint(format!("{name} has {wanted}, in rad, base to tip")));
            }
            let widest = robot.gripper.max_width;
            let gripper = arguments.gripper.unwrap_or(widest);
            if !(0.0..=widest).contains(&gripper) {
                return Err(WorkspaceError::input(format!("--gripper {gripper} is not possible"))
                    .with_hint(format!("0 to {widest} m")));
            }
            Some((joints, gripper))
        }
    };
    let table_color = arguments.table_color.map(|color| linear_from_srgb8(color).to_array().map(f64::from));
    Ok(MatchRequest {
        empty: photos(&arguments.photos, &world)?,
        objects: scenes(arguments, &world)?,
        charts: arguments.charts.iter().map(chart).collect::<Result<_, _>>()?,
        robot: Arc::clone(&robot),
        world,
        arm,
        table_color,
    })
}

/// Photographs of known objects: all of one scenario, or one folder or file for each of several.
fn scenes(arguments: &RealMatchArguments, world: &World) -> Result<Vec<ObjectScene>, WorkspaceError> {
    let (files, named) = (&arguments.scenarios, &arguments.objects);
    let groups: Vec<&[String]> = match (files.len(), named.len()) {
        (0, _) => Vec::new(),
        (1, _) => vec![named],
        (several, count) if several == count => named.chunks(1).collect(),
        (several, count) => {
            return Err(WorkspaceError::input(format!("--scenario is given {several} times, --objects {count} times"))
                .with_hint(
                    "with several scenarios, one --objects for each, in the same order: a folder or CAMERA=FILE",
                ));
        }
    };
    let scene = |(path, named): (&PathBuf, &[String])| {
        let stage = scenarios::read_stage(path)?;
        Ok(ObjectScene {
            models: stage.models.clone(),
            poses: stage.scenario.objects.iter().map(|it| (it.pose, it.joint_positions.clone())).collect(),
            photos: photos(named, world)?,
        })
    };
    files.iter().zip(groups).map(scene).collect()
}

fn chart(argument: &ChartArgument) -> Result<ChartPhoto, WorkspaceError> {
    let photo = photo(&argument.camera, &argument.file)?;
    Ok(ChartPhoto { photo, corners_px: argument.corners_px.map(|[u, v]| DVec2::new(u, v)) })
}

/// Photographs named `CAMERA=FILE`, or of folders: every image that is named after a fixed camera.
fn photos(named: &[String], world: &World) -> Result<Vec<Photo>, WorkspaceError> {
    let mut found = Vec::new();
    for name in named {
        match name.split_once('=') {
            Some((camera, file)) => found.push(photo(camera, Path::new(file))?),
            None => found.extend(folder(Path::new(name), world)?),
        }
    }
    Ok(found)
}

fn folder(folder: &Path, world: &World) -> Result<Vec<Photo>, WorkspaceError> {
    if !folder.is_dir() {
        return Err(WorkspaceError::input(format!("{} is no folder", folder.display()))
            .with_hint("name a photograph as CAMERA=FILE, or a folder with CAMERA.png or CAMERA.jpg"));
    }
    let file = |camera: &str| -> Option<PathBuf> {
        ENDINGS.iter().map(|ending| folder.join(format!("{camera}.{ending}"))).find(|path| path.is_file())
    };
    let fixed = world.cameras.iter().filter(|camera| camera.mount == CameraMount::World);
    let found = fixed.clone().filter_map(|camera| Some((&camera.name, file(&camera.name)?)));
    let photos = found.map(|(camera, path)| photo(camera, &path)).collect::<Result<Vec<_>, _>>()?;
    if photos.is_empty() {
        let names: Vec<&str> = fixed.map(|camera| camera.name.as_str()).collect();
        return Err(WorkspaceError::input(format!("{} holds no photograph of a fixed camera", folder.display()))
            .with_hint(format!("name the files after the world's fixed cameras: {}.png or .jpg", names.join(", "))));
    }
    Ok(photos)
}

fn photo(camera: &str, path: &Path) -> Result<Photo, WorkspaceError> {
    let bytes = documents::read_bytes(path, limits::IMPORTED_PICTURE)?;
    let (width, height, rgb) = decode_image(&bytes)
        .map_err(|error| WorkspaceError::input(format!("{} is no photograph", path.display())).because(error))?;
    Ok(Photo { camera: camera.to_owned(), width, height, rgb })
}

/// Writes `world.json`, the backgrounds, one image per photograph, and `match.json`.
fn write(out: &Path, matched: &Matched, views: &[ViewReport]) -> Result<(), WorkspaceError> {
    let broken = |error| WorkspaceError::broken("an image of the comparison cannot be encoded", error);
    documents::write_file(&out.join("world.json"), matched.world.to_json().as_bytes())?;
    for view in views {
        let kind = match view.scene {
            0 => "empty".to_owned(),
            1 => "objects".to_owned(),
            scene => format!("objects_{scene}"),
        };
        let (width, height, rgb) = view.sheet();
        let png = encode::png_rgb(width, height, &rgb).map_err(broken)?;
        documents::write_file(&out.join(format!("{}_{kind}.png", view.camera)), &png)?;
    }
    for entry in matched.world.appearance.iter().flat_map(|appearance| &appearance.cameras) {
        let Some(photograph) = &entry.photograph else { continue };
        let (rgb, [width, height]) = genmanip_render::decoded_photograph(&photograph.jpeg)
            .map_err(|problem| WorkspaceError::input(format!("camera {}: {problem}", entry.camera)))?;
        let png = encode::png_rgb(width, height, &rgb).map_err(broken)?;
        documents::write_file(&out.join("backgrounds").join(format!("{}.png", entry.camera)), &png)?;
    }
    let report = json!({
        "cameras": matched.cameras,
        "materials": matched.materials,
        "unidentified": matched.unidentified,
        "views": views,
    });
    documents::write_file(&out.join("match.json"), format!("{report:#}\n").as_bytes())
}

fn describe(out: &Path, matched: &Matched, views: &[ViewReport]) -> String {
    let mut text = String::new();
    if let Some(light) = matched.world.appearance.as_ref().and_then(|appearance| appearance.light.as_ref()) {
        let share = |color: [f64; 3]| color.map(|value| format!("{value:.2}")).join(", ");
        let [x, y, z] = light.direction;
        text += &format!(
            "light from x {x:.2}, y {y:.2}, z {z:.2}: key {}; ambient {}; {:.1} degrees across\n",
            share(light.key),
            share(light.ambient),
            2.0 * light.angular_radius_rad.to_degrees()
        );
    }
    for camera in &matched.cameras {
        let response = &camera.response;
        let [red, green, blue] = response.white_balance;
        text += &format!(
            "{}: exposure {:.3}, white balance {red:.3}, {green:.3}, {blue:.3}, contrast {:.2}, white at {:.2}, from {}\n",
            camera.camera, response.exposure, response.contrast, response.white, camera.source
        );
    }
    let head = ["camera", "photograph", "region", "pixels", "ΔE2000 before", "after", "FLIP before", "after"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for view in views {
        for (before, after) in view.before.iter().zip(&view.after) {
            rows.push(vec![
                view.camera.clone(),
                if view.scene == 0 { "empty".into() } else { format!("objects {}", view.scene) },
                before.region.clone(),
                before.pixels.to_string(),
                format!("{:.2}", before.delta_e),
                format!("{:.2}", after.delta_e),
                format!("{:.3}", before.flip),
                format!("{:.3}", after.flip),
            ]);
        }
    }
    text += &text_table(&rows);
    text += &materials_table(&matched.materials);
    for open in &matched.unidentified {
        text += &format!("not identifiable: {}: {}\n  {}\n", open.what, open.why, open.remedy);
    }
    text + &format!("wrote {}\n", out.join("world.json").display())
}

/// Found materials, one row per part; empty without any.
fn materials_table(found: &[FoundMaterial]) -> String {
    let head = ["object", "part", "pixels", "base colour", "roughness", "range", "ΔE2000 before", "after"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for entry in found {
        let [before, after] = entry.delta_e;
        rows.push(vec![
            entry.material.object.to_string(),
            entry.material.part.clone(),
            entry.pixels.to_string(),
            entry.base_color.map(|value| format!("{value:.2}")).join(", "),
            entry.material.roughness.map_or_else(|| "as it was".into(), |value| format!("{value:.2}")),
            entry.roughness_range.map_or_else(String::new, |[low, high]| format!("{low:.2}-{high:.2}")),
            format!("{before:.2}"),
            format!("{after:.2}"),
        ]);
    }
    if found.is_empty() { String::new() } else { text_table(&rows) }
}
