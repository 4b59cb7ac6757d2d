//! Hand-eye calibration: pose of a camera from views of a board and robot states.
//!
//! Two closed-form solutions (Park and Martin, Daniilidis) initialise a joint least-squares refinement of the camera,
//! the board and the true robot poses by the reprojection error. Images and robot states are paired by view id. Sets of
//! views that do not determine the pose are refused; the error names the missing motion.

mod board_pose;
mod closed_form;
mod error;
mod intrinsics;
mod joint;
mod plan;
mod turns;
mod views;

#[cfg(test)]
mod tests;

pub use board_pose::{BoardPose, board_pose};
pub use closed_form::{Motion, daniilidis, motions, park_martin};
pub use error::CalibrationError;
pub use intrinsics::{IntrinsicsCheck, check_intrinsics};
pub use joint::{Noise, Refined, Setup, carrier, refine};
pub use plan::{Candidate, PlanSettings, Planned, candidates, choose};
pub use views::{Board, BoardViews, CameraModel, Mounting, RobotState, Skipped, View};

use genmanip_core::{Camera, Pose};
use serde::{Deserialize, Serialize};

use crate::least_squares::tangent;

/// Assumed noise and thresholds of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationSettings {
    /// Assumed standard deviation of each coordinate of the hand's position, m.
    pub hand_m: f64,
    /// Assumed standard deviation of the hand's orientation about each axis, rad.
    pub hand_rad: f64,
    /// Minimum standard deviation of a corner, px; the actual noise is estimated from the views.
    pub least_corner_px: f64,
    /// Minimum difference of log-likelihoods between a board pose and its flipped pose; below it, the view is
    /// ambiguous.
    pub flip_margin: f64,
    /// Reduced χ² above which other explanations are tried, and a warning is given.
    pub warn_chi2: f64,
    /// Reduced χ² above which the views are refused.
    pub refuse_chi2: f64,
    /// Reprojection error with corrected robot poses above which the views are refused, px; the limit is at least
    /// `outlier` times the corner noise.
    pub refuse_px: f64,
    /// Maximum relative error of the board's size; beyond it, the views are refused.
    pub scale_error: f64,
    /// Multiple of the median error above which a view is dropped as an outlier; at most a quarter of the views.
    pub outlier: f64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        let noise = Noise::default();
        Self {
            hand_m: noise.hand_m,
            hand_rad: noise.hand_rad,
            // Below that, the bias of corner detectors dominates.
            least_corner_px: 0.02,
            // A log-likelihood difference of 8 corresponds to four standard deviations.
            flip_margin: 8.0,
            // Robot poses are three times as noisy as stated.
            warn_chi2: 9.0,
            // Robot poses are twenty times as noisy as stated: 2 mm and 1 degree.
            refuse_chi2: 400.0,
            // More means corners that are not those of the board, or robot poses of other images.
            refuse_px: 2.0,
            scale_error: 0.01,
            outlier: 5.0,
        }
    }
}

/// Calibrated pose of the camera, with its uncertainty and diagnostics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Sentence that states direction and frames of the pose.
    pub statement: String,
    /// Camera as in a world file, with the calibrated pose `mount_from_camera`.
    pub camera: Camera,
    /// Pose of the board in the frame that it is fixed to.
    pub mount_from_board: Pose,
    /// Standard deviation of the camera's position along its own axes, m.
    pub position_sd_m: [f64; 3],
    /// Standard deviation of the camera's orientation about its own axes, rad.
    pub rotation_sd_rad: [f64; 3],
    /// Covariance of rotation vector (rad) and translation (m) of the camera in its own frame, row by row.
    pub covariance: [[f64; 6]; 6],
    /// Root-mean-square reprojection error with the stated robot poses, px.
    pub rms_px: f64,
    /// Cross-validated reprojection error, of views held out of the fit, px; `None` with fewer than 8 views.
    pub held_out_rms_px: Option<f64>,
    /// Estimated standard deviation of a corner, px.
    pub corner_px: f64,
    /// Root-mean-square correction of the robot's positions, m.
    pub hand_correction_m: f64,
    /// Root-mean-square correction of the robot's orientations, rad.
    pub hand_correction_rad: f64,
    /// Estimated size of the board divided by its stated size, from the robot's motion, and the standard deviation of
    /// this ratio.
    pub board_scale: [f64; 2],
    /// Check of the intrinsics; `None` if the views do not determine them.
    pub intrinsics: Option<IntrinsicsCheck>,
    /// Distances of the closed-form solutions (Park and Martin, Daniilidis) from the result.
    pub starts: Vec<StartError>,
    /// Used views with their errors.
    pub views: Vec<ViewError>,
    /// Views that were not used, with the reasons.
    pub skipped: Vec<Skipped>,
    /// Warnings for the user, one sentence each; empty if the result can be trusted.
    pub warnings: Vec<String>,
}

/// Distance of a closed-form solution from the result.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StartError {
    /// Name of the closed-form method.
    pub method: &'static str,
    /// Distance of the camera positions, m.
    pub position_m: f64,
    /// Angle between the camera orientations, rad.
    pub rotation_rad: f64,
}

/// Reprojection error of a view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewError {
    /// Id of the view in the input.
    pub id: String,
    /// Number of corners detected in the view.
    pub corners: usize,
    /// Root-mean-square reprojection error with the stated robot pose, px.
    pub rms_px: f64,
}

/// Calibrates a camera; `skipped` are views that were omitted before.
///
/// # Errors
/// [`CalibrationError`] if the views cannot determine the pose, or contradict each other.
pub fn calibrate(
    camera: &CameraModel,
    mounting: Mounting,
    views: &[View],
    skipped: Vec<Skipped>,
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    turns::check(views, mounting)?;
    let mut skipped = skipped;
    let posed = Posed::of(camera, views, settings, &mut skipped)?;
    turns::check(&posed.views, mounting)?;
    let mut fit = Fit::new(camera, mounting, posed, settings)?;
    let mut warnings = Vec::new();
    fit.drop_outliers(&mut skipped, settings)?;
    if fit.chi2() > settings.warn_chi2 {
        fit.explain(settings)?;
        warnings.push(format!(
            "the robot poses deviate by {:.1} times their stated noise: give the accuracy of the arm, and let it stand \
             still before each image",
            fit.chi2().sqrt()
        ));
    }
    let scale = fit.scale(settings)?;
    let found = fit.refined.setup.clone();
    let factor = fit.chi2().max(1.0);
    let covariance: [[f64; 6]; 6] =
        std::array::from_fn(|row| std::array::from_fn(|column| factor * fit.refined.covariance.get(row, column)));
    let sd = |index: usize| covariance[index][index].sqrt();
    let views: Vec<ViewError> = fit
        .views
        .iter()
        .map(|view| ViewError {
            id: view.id.clone(),
            corners: view.corners.len(),
            rms_px: found.rms_px(camera, mounting, view, &view.base_from_hand),
        })
        .collect();
    let intrinsics = check_intrinsics(camera, &fit.views.iter().collect::<Vec<_>>(), &fit.boards);
    if let Some(check) = intrinsics.as_ref().filter(|check| check.is_suspicious) {
        let list = |values: [f64; 4]| values.map(|value| format!("{value:.1}")).join(", ");
        warnings.push(format!(
            "the board asks for other intrinsics (fx, fy, cx, cy): {} instead of {} px",
            list(check.estimated),
            list(check.stated)
        ));
    }
    if scale[1] > settings.scale_error {
        let percent = 100.0 * scale[1];
        warnings.push(format!("the robot's travel fixes the board's size to {percent:.1} % alone; move it farther"));
    }
    let (hand_correction_m, hand_correction_rad) = fit.corrections();
    Ok(Calibration {
        statement: format!(
            "mount_from_camera maps points FROM the camera (x right, y down, z ahead) TO the {} of the robot; metres",
            match mounting {
                Mounting::EyeInHand => "hand link",
                Mounting::EyeToHand => "base",
            }
        ),
        camera: camera.placed(mounting, found.mount_from_camera),
        mount_from_board: found.mount_from_board,
        position_sd_m: [sd(3), sd(4), sd(5)],
        rotation_sd_rad: [sd(0), sd(1), sd(2)],
        covariance,
        rms_px: mean_square(views.iter().map(|view| view.rms_px)),
        held_out_rms_px: fit.held_out_rms_px(),
        corner_px: fit.noise.corner_px,
        hand_correction_m,
        hand_correction_rad,
        board_scale: scale,
        intrinsics,
        starts: fit.starts(&found.mount_from_camera),
        views,
        skipped,
        warnings,
    })
}

/// Root mean square of values.
fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Views with the estimated pose of the board in each.
struct Posed {
    views: Vec<View>,
    boards: Vec<Pose>,
    /// For each view, true unless the board's pose is ambiguous.
    is_clear: Vec<bool>,
    corner_px: f64,
}

impl Posed {
    fn of(
        camera: &CameraModel,
        views: &[View],
        settings: &CalibrationSettings,
        skipped: &mut Vec<Skipped>,
    ) -> Result<Self, CalibrationError> {
        let mut posed: Vec<(View, BoardPose)> = Vec::new();
        for view in views {
            match board_pose(camera, view) {
                Some(pose) => posed.push((view.clone(), pose)),
                None => skipped.push(Skipped { id: view.id.clone(), reason: "the corners fit no board".into() }),
            }
        }
        // Median over views of the corner noise; each view's pose takes six degrees of freedom.
        let mut noise: Vec<f64> = posed
            .iter()
            .map(|(view, pose)| {
                let count = view.corners.len() as f64;
                pose.rms_px * (count / (2.0 * count - 6.0)).sqrt()
            })
            .collect();
        noise.sort_by(f64::total_cmp);
        let corner_px = noise.get(noise.len() / 2).copied().unwrap_or_default().max(settings.least_corner_px);
        let is_clear = |(view, pose): &(View, BoardPose)| {
            let excess = pose.flipped_rms_px.powi(2) - pose.rms_px.powi(2);
            view.corners.len() as f64 * excess / (2.0 * corner_px.powi(2)) > settings.flip_margin
        };
        let clear: Vec<bool> = posed.iter().map(is_clear).collect();
        let ambiguous = clear.iter().filter(|clear| !**clear).count();
        if posed.len() - ambiguous < 3 && ambiguous > 0 {
            return Err(CalibrationError::PlanarFlip { ambiguous, views: posed.len() });
        }
        let boards = posed.iter().map(|(_, pose)| pose.camera_from_board).collect();
        Ok(Self { views: posed.into_iter().map(|(view, _)| view).collect(), boards, is_clear: clear, corner_px })
    }
}

/// A fit of all views, with the data to repeat it.
struct Fit<'a> {
    camera: &'a CameraModel,
    mounting: Mounting,
    views: Vec<View>,
    boards: Vec<Pose>,
    is_clear: Vec<bool>,
    noise: Noise,
    refined: Refined,
}

impl<'a> Fit<'a> {
    fn new(
        camera: &'a CameraModel,
        mounting: Mounting,
        posed: Posed,
        settings: &CalibrationSettings,
    ) -> Result<Self, CalibrationError> {
        let Posed { views, boards, is_clear, corner_px } = posed;
        let noise = Noise { corner_px, hand_m: settings.hand_m, hand_rad: settings.hand_rad };
        let refined = best_of_starts(camera, mounting, &views, &boards, &is_clear, &noise);
        let Some(refined) = refined else {
            let worst = views.first().map_or_else(String::new, |view| view.id.clone());
            return Err(CalibrationError::Inconsistent { rms_px: f64::INFINITY, robot_mm: f64::INFINITY, worst });
        };
        Ok(Self { camera, mounting, views, boards, is_clear, noise, refined })
    }

    /// Reduced χ²: weighted sum of squares over the degrees of freedom; about 1 if the noise is as assumed.
    fn chi2(&self) -> f64 {
        let corners: usize = self.views.iter().map(|view| view.corners.len()).sum();
        self.refined.cost / (2.0 * corners as f64 - 12.0).max(1.0)
            + tension(&self.views, &self.refined.setup, &self.noise)
    }

    /// Drops views whose error is far above the median, and fits again after each.
    fn drop_outliers(
        &mut self,
        skipped: &mut Vec<Skipped>,
        settings: &CalibrationSettings,
    ) -> Result<(), CalibrationError> {
        let most = self.views.len() / 4;
        for _ in 0..most {
            let errors: Vec<f64> = self.views.iter().map(|view| self.error_px(view)).collect();
            let mut sorted = errors.clone();
            sorted.sort_by(f64::total_cmp);
            let limit = settings.outlier * sorted[sorted.len() / 2].max(self.noise.corner_px);
            let worst = (0..errors.len()).max_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            let Some(worst) = worst.filter(|&worst| errors[worst] > limit) else { break };
            let view = self.views.remove(worst);
            self.boards.remove(worst);
            self.is_clear.remove(worst);
            let reason = format!("off by {:.1} px, far more than the others: did the arm still move?", errors[worst]);
            skipped.push(Skipped { id: view.id, reason });
            turns::check(&self.views, self.mounting)?;
            let Self { camera, mounting, views, boards, is_clear, noise, .. } = self;
            if let Some(refined) = best_of_starts(camera, *mounting, views, boards, is_clear, noise) {
                self.refined = refined;
            }
        }
        Ok(())
    }

    fn error_px(&self, view: &View) -> f64 {
        self.refined.setup.rms_px(self.camera, self.mounting, view, &view.base_from_hand)
    }

    /// Error that explains a bad fit, if one of the known causes fits better.
    fn explain(&self, settings: &CalibrationSettings) -> Result<(), CalibrationError> {
        let Self { camera, mounting, views, boards, is_clear, noise, refined } = self;
        let error = |setup: &Setup, mounting: Mounting| {
            mean_square(views.iter().map(|view| setup.rms_px(camera, mounting, view, &view.base_from_hand)))
        };
        let stated_px = error(&refined.setup, *mounting);
        if let Some(other) = best_of_starts(camera, mounting.other(), views, boards, is_clear, noise) {
            let other_px = error(&other.setup, mounting.other());
            if other_px < stated_px / 2.0 {
                let (stated, other) = (mounting.name(), mounting.other().name());
                return Err(CalibrationError::OtherMounting { stated, other, stated_px, other_px });
            }
        }
        self.scale(settings)?;
        let corrected = views.iter().zip(&refined.setup.hands);
        let corrected_px =
            mean_square(corrected.map(|(view, hand)| refined.setup.rms_px(camera, *mounting, view, hand)));
        let most_px = settings.refuse_px.max(settings.outlier * noise.corner_px);
        if self.chi2() > settings.refuse_chi2 || corrected_px > most_px {
            let worst = views.iter().max_by(|a, b| self.error_px(a).total_cmp(&self.error_px(b)));
            let worst = worst.map_or_else(String::new, |view| view.id.clone());
            let robot_mm = 1e3 * self.corrections().0;
            return Err(CalibrationError::Inconsistent { rms_px: stated_px, robot_mm, worst });
        }
        Ok(())
    }

    /// Estimated size of the board divided by its stated size, with its standard deviation; an error if it is wrong
    /// beyond the tolerance.
    fn scale(&self, settings: &CalibrationSettings) -> Result<[f64; 2], CalibrationError> {
        let Self { camera, mounting, views, noise, refined, .. } = self;
        let Some(free) = refine(camera, *mounting, views, refined.setup.clone(), noise, true) else {
            return Ok([1.0, f64::INFINITY]);
        };
        let corners: usize = views.iter().map(|view| view.corners.len()).sum();
        let chi2 = free.cost / (2.0 * corners as f64 - 13.0).max(1.0) + tension(views, &free.setup, noise);
        let sd = (chi2.max(1.0) * free.covariance.get(12, 12)).sqrt();
        let scale = free.setup.log_scale.exp();
        let is_wrong = (scale - 1.0).abs() > settings.scale_error && free.setup.log_scale.abs() > 4.0 * sd;
        if is_wrong { Err(CalibrationError::Scale { scale }) } else { Ok([scale, sd]) }
    }

    /// Root mean square corrections of the robot's positions (m) and orientations (rad).
    fn corrections(&self) -> (f64, f64) {
        let corrections: Vec<[f64; 6]> = self
            .views
            .iter()
            .zip(&self.refined.setup.hands)
            .map(|(view, hand)| tangent(&(view.base_from_hand.inverse() * *hand)))
            .collect();
        let length = |at: usize| {
            mean_square(
                corrections.iter().map(|it| it[at..at + 3].iter().map(|value| value * value).sum::<f64>().sqrt()),
            )
        };
        (length(3), length(0))
    }

    /// Cross-validated root-mean-square error (px): that of every fifth view in a fit of the others.
    fn held_out_rms_px(&self) -> Option<f64> {
        let is_out = |index: usize| index % 5 == 2;
        if self.views.len() < 8 {
            return None;
        }
        let of = |out: bool| -> Vec<View> {
            let all = self.views.iter().enumerate();
            all.filter(|(index, _)| is_out(*index) == out).map(|(_, view)| view.clone()).collect()
        };
        let (kept, out) = (of(false), of(true));
        let hands = kept.iter().map(|view| view.base_from_hand).collect();
        let start = Setup { hands, ..self.refined.setup.clone() };
        let setup = refine(self.camera, self.mounting, &kept, start, &self.noise, false)?.setup;
        Some(mean_square(out.iter().map(|view| setup.rms_px(self.camera, self.mounting, view, &view.base_from_hand))))
    }

    fn starts(&self, found: &Pose) -> Vec<StartError> {
        let motions = closed_form_motions(self.mounting, &self.views, &self.boards, &self.is_clear);
        let methods: [(&'static str, Option<Pose>); 2] =
            [("Park and Martin", park_martin(&motions)), ("Daniilidis", daniilidis(&motions))];
        let error = |(method, pose): (&'static str, Option<Pose>)| {
            let pose = pose?;
            let (position_m, rotation_rad) = (pose.position.distance(found.position), pose.angle_to(found));
            Some(StartError { method, position_m, rotation_rad })
        };
        methods.into_iter().filter_map(error).collect()
    }
}

/// Mean squared correction of the robot poses in units of their assumed variance, minus 1, its expected maximum.
fn tension(views: &[View], setup: &Setup, noise: &Noise) -> f64 {
    let excess = views.iter().zip(&setup.hands).map(|(view, hand)| {
        let change = tangent(&(view.base_from_hand.inverse() * *hand));
        let square =
            |at: usize, sigma: f64| change[at..at + 3].iter().map(|value| (value / sigma).powi(2)).sum::<f64>();
        (square(0, noise.hand_rad) + square(3, noise.hand_m)) / 6.0
    });
    (excess.sum::<f64>() / views.len().max(1) as f64 - 1.0).max(0.0)
}

fn closed_form_motions(mounting: Mounting, views: &[View], boards: &[Pose], is_clear: &[bool]) -> Vec<Motion> {
    let clear = views.iter().zip(boards).zip(is_clear).filter(|(_, clear)| **clear);
    let posed: Vec<(Pose, Pose)> =
        clear.map(|((view, board), _)| (carrier(mounting, &view.base_from_hand), *board)).collect();
    motions(&posed)
}

/// The better of the refinements that start from the two closed-form solutions.
fn best_of_starts(
    camera: &CameraModel,
    mounting: Mounting,
    views: &[View],
    boards: &[Pose],
    is_clear: &[bool],
    noise: &Noise,
) -> Option<Refined> {
    let motions = closed_form_motions(mounting, views, boards, is_clear);
    let refined = |start: Pose| {
        // The initial board pose is that of the view that agrees best with all other views.
        let clear = (0..views.len()).filter(|&index| is_clear[index]);
        let setups = clear.map(|index| Setup {
            mount_from_camera: start,
            mount_from_board: carrier(mounting, &views[index].base_from_hand) * start * boards[index],
            log_scale: 0.0,
            hands: views.iter().map(|view| view.base_from_hand).collect(),
        });
        let error = |setup: &Setup| -> f64 {
            views.iter().map(|view| setup.rms_px(camera, mounting, view, &view.base_from_hand).min(1e4)).sum()
        };
        let setup = setups.min_by(|a, b| error(a).total_cmp(&error(b)))?;
        refine(camera, mounting, views, setup, noise, false)
    };
    let starts = [park_martin(&motions), daniilidis(&motions)];
    starts.into_iter().flatten().filter_map(refined).min_by(|a, b| a.cost.total_cmp(&b.cost))
}
