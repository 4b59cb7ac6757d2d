//! `genmanip calibrate`: pose of a camera from views of a calibration board.

mod board;
mod images;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{CameraMount, Pose, RobotModel};
use genmanip_layout::obstacles;
use genmanip_motion::{AllowedCollisions, PlannerSettings, PlanningScene};
use genmanip_real::calibrate::CameraModel;
use genmanip_real::calibrate::{
    Board, Calibration, CalibrationSettings, Candidate, Mounting, Noise, PlanSettings, calibrate, candidates, choose,
};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::worlds::{self, CameraEdit};
use genmanip_workspace::{WorkspaceError, scenarios, text_table};
use serde_json::json;

use crate::args::{CalibrateArguments, CalibrateCommand, CalibratePlanArguments};

pub fn run(arguments: &CalibrateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    match (&arguments.command, &arguments.views) {
        (Some(CalibrateCommand::Plan(arguments)), _) => plan(arguments, printer),
        (Some(CalibrateCommand::Board(arguments)), _) => board::write(arguments, printer),
        (None, Some(views)) => solve(views, arguments, printer),
        (None, None) => Err(Failed::misused("no views").hint("genmanip calibrate VIEWS.json")),
    }
}

fn solve(views: &std::path::Path, arguments: &CalibrateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (file, reasons) = images::read(views, printer)?;
    let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
    let robot = worlds::robot(&world)?;
    let refused = |error| WorkspaceError::input(format!("{} calibrates no camera", views.display())).because(error);
    let (paired, mut skipped) = file.paired(|joints| hand_of(&robot, joints)).map_err(refused)?;
    for view in &mut skipped {
        if let Some(reason) = reasons.get(&view.id) {
            view.reason.clone_from(reason);
        }
    }
    if !(arguments.hand_mm > 0.0 && arguments.hand_deg > 0.0) {
        let (mm, deg) = (arguments.hand_mm, arguments.hand_deg);
        return Err(WorkspaceError::input(format!("--hand-mm {mm} --hand-deg {deg} is not possible"))
            .with_hint("expected positive numbers; no arm is exact")
            .into());
    }
    let settings = CalibrationSettings {
        hand_m: arguments.hand_mm * 1e-3,
        hand_rad: arguments.hand_deg.to_radians(),
        ..CalibrationSettings::default()
    };
    let found = calibrate(&file.camera, file.mounting, &paired, skipped, &settings).map_err(refused)?;
    if let Some(world) = &arguments.world {
        worlds::edit(world, &CameraEdit::Put(Box::new(found.camera.clone())))?;
        printer.say(format!("wrote camera {} into {}", found.camera.name, world.display()));
    }
    printer.data(&found, &describe(&found));
    Ok(ExitStatus::Done)
}

/// Pose of the hand link in the base frame from joint positions of the arm (rad); an error if their number is wrong or
/// one is not finite.
fn hand_of(robot: &RobotModel, joints: &[f64]) -> Result<Pose, String> {
    let wanted = robot.home.len();
    if joints.len() != wanted || !joints.iter().all(|joint| joint.is_finite()) {
        return Err(format!("{} joint positions; {} has {wanted}, in rad", joints.len(), robot.name));
    }
    Ok(robot.tcp_pose(joints) * robot.hand_from_tcp.inverse())
}

fn describe(found: &Calibration) -> String {
    let pose = &found.camera.mount_from_camera;
    let mm = |values: [f64; 3]| values.map(|value| format!("{:.2}", 1e3 * value)).join(", ");
    let degrees = |values: [f64; 3]| values.map(|value| format!("{:.3}", value.to_degrees())).join(", ");
    let [scale, scale_sd] = found.board_scale;
    let mut text = format!(
        "{}\nposition_m        {:?}\norientation_wxyz  {:?}\n95 % along its axes: ± {} mm; about them: ± {} degrees\n\n\
         {} views, {} left out; reprojection {:.2} px{}; noise of a corner {:.2} px\n\
         robot poses corrected by {:.2} mm and {:.3} degrees; board {scale:.4} ± {:.4} times its stated size\n",
        found.statement,
        pose.position.to_array(),
        pose.to_wxyz_array(),
        mm(found.position_sd_m.map(|sd| 1.96 * sd)),
        degrees(found.rotation_sd_rad.map(|sd| 1.96 * sd)),
        found.views.len(),
        found.skipped.len(),
        found.rms_px,
        found.held_out_rms_px.map_or_else(String::new, |px| format!(", {px:.2} px in views held out")),
        found.corner_px,
        1e3 * found.hand_correction_m,
        found.hand_correction_rad.to_degrees(),
        1.96 * scale_sd,
    );
    for start in &found.starts {
        let (mm, degrees) = (1e3 * start.position_m, start.rotation_rad.to_degrees());
        text += &format!("{} alone: {mm:.2} mm and {degrees:.3} degrees away\n", start.method);
    }
    text.extend(found.skipped.iter().map(|it| format!("left out {}: {}\n", it.id, it.reason)));
    text.extend(found.warnings.iter().map(|warning| format!("warning: {warning}\n")));
    text
}

fn plan(arguments: &CalibratePlanArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world(arguments.world.as_deref())?;
    let names = std::slice::from_ref(&arguments.camera);
    worlds::cameras(&world, names)?;
    let Some(camera) = world.camera(&arguments.camera).cloned() else {
        return Err(Failed::new(format!("no camera {}", arguments.camera)));
    };
    let [x, y, z] = arguments.board_at[..] else {
        return Err(Failed::misused("--board-at has no three coordinates").hint("--board-at X,Y,Z in metres"));
    };
    let (columns, rows, spacing_m) = (arguments.columns, arguments.rows, arguments.spacing);
    if !(1e-4..1.0).contains(&spacing_m) {
        return Err(Failed::misused(format!("--spacing {spacing_m} is not possible")).hint("metres, such as 0.025"));
    }
    let board = Board::Grid { columns, rows, spacing_m };
    let middle = board.corners().iter().sum::<DVec3>() / f64::from(columns * rows);
    let mounting = match camera.mount {
        CameraMount::Hand => Mounting::EyeInHand,
        CameraMount::World => Mounting::EyeToHand,
    };
    let mount_from_board = Pose::new(DVec3::new(x, y, z) - middle, DQuat::IDENTITY);
    let model = CameraModel { name: camera.name.clone(), intrinsics: camera.intrinsics, distortion: camera.distortion };
    let poses = [camera.mount_from_camera, mount_from_board];
    let all = candidates(&model, mounting, &board, poses, &Noise::default(), &PlanSettings::default());
    let planner = worlds::planner(&world, &PlannerSettings::default())?;
    let stage = scenarios::empty_stage(world)?;
    let around = obstacles::around(stage.start(), None);
    let nothing = AllowedCollisions::none();
    let free = PlanningScene { world: &around, attached: None, allowed: &nothing, gripper_width: 0.0 };
    let robot = planner.robot();
    let joints_of = |base_from_hand: &Pose| {
        let configs = planner.ik(&(*base_from_hand * robot.hand_from_tcp), &robot.home);
        configs.into_iter().find(|config| planner.check(&free, config).is_none())
    };
    let reachable: Vec<Candidate> = all.iter().filter(|it| joints_of(&it.base_from_hand).is_some()).cloned().collect();
    let (seen, reached) = (all.len(), reachable.len());
    let planned = if reached < 3 { None } else { choose(&reachable, arguments.count) };
    let Some(planned) = planned else {
        return Err(Failed::new(format!(
            "{reached} of {seen} poses that show the whole board are in reach; expected 3"
        ))
        .hint("put the board nearer to the middle of the workspace, or take a smaller one"));
    };
    let configs: Vec<Vec<f64>> = planned.base_from_hand.iter().filter_map(joints_of).collect();
    let mm = planned.position_sd_m.map(|sd| format!("{:.2}", 1.96e3 * sd)).join(", ");
    let degrees = planned.rotation_sd_rad.map(|sd| format!("{:.3}", 1.96 * sd.to_degrees())).join(", ");
    let mut table = vec![["view", "joint positions, rad"].map(String::from).to_vec()];
    for (index, config) in configs.iter().enumerate() {
        let joints = config.iter().map(|joint| format!("{joint:.4}")).collect::<Vec<_>>().join(", ");
        table.push(vec![format!("{index:03}"), joints]);
    }
    let text = format!(
        "{}\n{reached} of {seen} poses that show the whole board are in reach and free\n\
         expected 95 %, along the camera's axes: ± {mm} mm; about them: ± {degrees} degrees\n",
        text_table(&table)
    );
    let data = json!({
        "mounting": mounting,
        "candidates": seen,
        "reachable": reached,
        "joints_rad": configs,
        "base_from_hand": planned.base_from_hand,
        "position_sd_m": planned.position_sd_m,
        "rotation_sd_rad": planned.rotation_sd_rad,
    });
    printer.data(&data, &text);
    Ok(ExitStatus::Done)
}
