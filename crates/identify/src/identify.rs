//! Identification: parameters of the simulator from recordings.

use std::cell::RefCell;
use std::ops::Range;

use genmanip_core::{RobotModel, World};
use serde::Serialize;

use crate::curve::Coefficient;
use crate::error::IdentifyError;
use crate::friction;
use crate::parameters::{Parameter, Values};
use crate::problem::{Measured, Problem, Unknown};
use crate::recording::{Motion, Recording};
use crate::replay::{bare, replay};
use crate::restitution;
use crate::search::{SearchSettings, Solution, coarse, fine};
use crate::slide;
use crate::structure::{Whiteness, channel_of, whiteness};
use crate::uncertainty::{Uncertainty, WIDEST, Z};

/// Share of every free motion that is used when no recording is held out; the rest is.
const USED: f64 = 0.75;
/// Standard deviation, in typical sizes, above which a parameter changes nothing that is measured.
const INVISIBLE: f64 = 4.0;
/// Distance from a bound, in typical sizes, below which a value counts as at it.
const AT_BOUND: f64 = 1e-3;

/// Parameters identified from recordings.
#[derive(Clone, Debug, Serialize)]
pub struct Identification {
    /// Identified parameters.
    pub parameters: Vec<Estimate>,
    /// Parameters that the recordings do not determine.
    pub unidentified: Vec<Unidentified>,
    /// Searches behind them: one for the arm, one for each kind of friction.
    pub fits: Vec<Fit>,
    /// Tracking error of the arm in recordings, or parts of them, that were not used; `None` without free motions.
    pub held_out: Option<HeldOut>,
    /// Damping ratio of the contacts with which the simulated block bounces as much as the recorded one; `None` without
    /// a restitution, or if no ratio bounces as much.
    pub contact_damping: Option<f64>,
    /// True if the residuals of free motions have structure that no values of the parameters explain, such as backlash;
    /// the intervals then do not hold. Contacts are too erratic for such a test.
    pub is_structure_wrong: bool,
    /// All values: identified ones, and those of the world elsewhere.
    #[serde(skip)]
    pub values: Values,
}

/// One identified parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Name, such as `joint3.damping`.
    pub name: String,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Value of the world before.
    pub before: f64,
    /// Identified value.
    pub value: f64,
    /// 95 % interval.
    pub interval: [f64; 2],
    /// True if the value lies at a bound of the search: the interval is then one-sided at best.
    pub is_at_bound: bool,
    /// The parameter.
    #[serde(skip)]
    pub parameter: Parameter,
}

/// One parameter that the recordings do not determine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unidentified {
    /// Name, such as `joint7.kp`.
    pub name: String,
    /// Reason in words.
    pub reason: String,
    /// Motion that would show it.
    pub motion: String,
    /// The parameter.
    #[serde(skip)]
    pub parameter: Parameter,
}

/// One search.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// Kinds of recordings.
    pub motions: Vec<Motion>,
    /// Ratio of the largest to the smallest singular value of the scaled Jacobian; `null` if infinite.
    pub condition_number: f64,
    /// Parameters that only change together, or not at all, in these recordings.
    pub flat_directions: Vec<Vec<String>>,
    /// Residuals of each joint (rad) or axis (m).
    pub channels: Vec<Whiteness>,
    /// Root-mean-square residuals from each start of the coarse search, rad or m.
    pub starts_rms: Vec<f64>,
}

/// Tracking error of the simulated arm against measurements that were not used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HeldOut {
    /// Root-mean-square error over all joints with the values before, rad.
    pub before_rad: f64,
    /// The same with the identified values, rad.
    pub after_rad: f64,
}

impl HeldOut {
    /// Error before over error after.
    pub fn ratio(&self) -> f64 {
        self.before_rad / self.after_rad.max(f64::MIN_POSITIVE)
    }
}

/// Identifies all parameters that the kinds of the recordings can show, in a world with its robot. `held_out`
/// recordings of free motions only measure the tracking error; without them, the last quarter of each free motion does.
///
/// # Errors
/// For recordings that do not fit the robot, and when no start can be simulated.
pub fn identify(
    world: &World,
    robot: &RobotModel,
    recordings: &[Recording],
    held_out: &[Recording],
    settings: &SearchSettings,
) -> Result<Identification, IdentifyError> {
    for recording in recordings.iter().chain(held_out) {
        recording.check_robot(robot)?;
        if !recording.is_measured() {
            return Err(IdentifyError::Recording { message: "it is a motion without measurements".into() });
        }
    }
    if let Some(other) = held_out.iter().find(|it| !matches!(it.motion, Motion::Arm | Motion::Payload)) {
        let message = format!("a held-out recording is a `{}`; expected a free motion", other.motion.name());
        return Err(IdentifyError::Recording { message });
    }
    let nominal = Values::of(world, robot).with_center_of(recordings);
    let mut found = Identification {
        parameters: Vec::new(),
        unidentified: Vec::new(),
        fits: Vec::new(),
        held_out: None,
        contact_damping: None,
        is_structure_wrong: false,
        values: nominal.clone(),
    };
    let of = |motions: &[Motion]| -> Vec<&Recording> {
        recordings.iter().filter(|recording| motions.contains(&recording.motion)).collect()
    };
    let free = of(&[Motion::Arm, Motion::Payload]);
    if !free.is_empty() {
        arm(world, robot, &free, held_out, &nominal, settings, &mut found)?;
    }
    let slips = of(&[Motion::Slip]);
    if !slips.is_empty() {
        let slipped = slips.into_iter().filter(|slip| slip.is_block_moved()).map(|slip| (slip, 0..slip.landed()));
        let shown = (Parameter::PadFriction, Measured::Block);
        let fit = contact(world, robot, slipped.collect(), shown, settings, &mut found)?;
        found.coefficient(Parameter::PadFriction, fit.as_slice(), &nominal, robot);
    }
    let (gravity, least_noise) = (world.physics.gravity_m_s2, settings.least_noise);
    let pushes = of(&[Motion::Push]);
    if !pushes.is_empty() {
        // The arm as a scale of the force of friction, then the slide.
        let latency_s = found.values.arm.latency_s;
        let end = |push: &Recording| slide::released(push, robot, latency_s).unwrap_or(push.len());
        let felt = pushes
            .iter()
            .filter(|push| push.is_block_moved() && !push.joint_rad.is_empty())
            .map(|&push| (push, push.settled()..end(push).max(push.settled())));
        let shown = (Parameter::TableFriction, Measured::Joints);
        let mut each = Vec::from_iter(contact(world, robot, felt.collect(), shown, settings, &mut found)?);
        each.extend(pushes.iter().filter_map(|push| slide::measured(push, robot, latency_s, gravity, least_noise)));
        found.coefficient(Parameter::TableFriction, &each, &nominal, robot);
    }
    if let drops @ [first, ..] = &of(&[Motion::Drop])[..] {
        let bounced = drops.iter().filter_map(|drop| restitution::measured(drop, gravity, least_noise));
        let bare = bare(robot, false);
        let own = restitution::simulated(first, world, &bare, &nominal, nominal.contact_damping)?;
        let before = Values { restitution: own.unwrap_or(0.0), ..nominal.clone() };
        let value = found.coefficient(Parameter::Restitution, &bounced.collect::<Vec<_>>(), &before, robot);
        if let Some(value) = value {
            found.contact_damping = restitution::damping_of(first, world, &bare, &nominal, value)?;
        }
    }
    for (motion, parameter) in [
        (Motion::Drop, Parameter::Restitution),
        (Motion::Payload, Parameter::PayloadMass),
        (Motion::Payload, Parameter::PayloadCenter(0)),
        (Motion::Payload, Parameter::PayloadCenter(1)),
        (Motion::Payload, Parameter::PayloadCenter(2)),
        (Motion::Push, Parameter::TableFriction),
        (Motion::Slip, Parameter::PadFriction),
    ] {
        if of(&[motion]).is_empty() {
            let reason = format!("no recording is a `{}`", motion.name());
            found.unidentified.push(unidentified(parameter, robot, reason));
        }
    }
    Ok(found)
}

/// Gains, friction, latency and payload from free motions.
fn arm(
    world: &World,
    robot: &RobotModel,
    recordings: &[&Recording],
    held_out: &[Recording],
    nominal: &Values,
    settings: &SearchSettings,
    found: &mut Identification,
) -> Result<(), IdentifyError> {
    let bare = bare(robot, false);
    let share = if held_out.is_empty() { USED } else { 1.0 };
    let used = |recording: &Recording| {
        let settled = recording.settled();
        settled..settled + ((recording.len() - settled) as f64 * share).ceil() as usize
    };
    let mut problem = Problem {
        recordings: recordings.iter().map(|&recording| (recording, used(recording))).collect(),
        world,
        robot: &bare,
        measured: Measured::Joints,
        unknowns: Vec::new(),
        base: nominal.clone(),
        noise: vec![1e-3; robot.arm_dof()],
        held: Vec::new(),
        derivatives: RefCell::default(),
    };
    // A joint that stands still is held by friction of any amount: the model holds it, too.
    let still: Vec<usize> = (0..robot.arm_dof()).filter(|&joint| problem.stands_still(joint)).collect();
    problem.held = still.clone();
    let is_held = |it: &Parameter| it.joint().is_some_and(|joint| still.contains(&joint));
    let (held, parameters): (Vec<_>, Vec<_>) = parameters_of(recordings, robot).into_iter().partition(is_held);
    for parameter in held {
        found.unidentified.push(unidentified(parameter, robot, "the joint stands still in these recordings".into()));
    }
    for &joint in &still {
        let friction = Parameter::FrictionLoss(joint);
        problem.base.set(friction, friction.bounds()[1] * friction.scale(nominal, robot));
    }
    let (start, starts_rms) = coarse(&problem, &parameters, nominal, robot, settings).ok_or(IdentifyError::Start)?;
    problem.unknowns = parameters.iter().map(|&parameter| unknown(parameter, nominal, robot, &start)).collect();
    let solution = fine(&mut problem, settings, starts_rms).ok_or(IdentifyError::Start)?;
    let best = problem.values(&solution.point);
    report(&problem, &solution, robot, nominal, found);
    let channels = found.fits.iter().flat_map(|fit| fit.channels.iter().enumerate());
    // How a held joint yields within its friction is no structure of the others.
    found.is_structure_wrong = channels.filter(|(joint, _)| !still.contains(joint)).any(|(_, it)| it.is_structured);
    let error = |values: &Values| {
        let pairs = |recording: &Recording, skipped: usize| -> Result<Vec<f64>, IdentifyError> {
            let track = replay(recording, world, &bare, values)?;
            let rows = recording.joint_rad.iter().zip(&track.joints).skip(skipped);
            Ok(rows.flat_map(|(real, sim)| real.iter().zip(sim).map(|(real, sim)| real - sim)).collect())
        };
        let unused: Vec<(&Recording, usize)> = match held_out {
            [] => recordings.iter().map(|&recording| (recording, used(recording).end)).collect(),
            _ => held_out.iter().map(|recording| (recording, recording.settled())).collect(),
        };
        let errors = unused.into_iter().map(|(recording, skipped)| pairs(recording, skipped));
        let errors = errors.collect::<Result<Vec<_>, _>>()?.concat();
        Ok::<_, IdentifyError>((errors.iter().map(|it| it * it).sum::<f64>() / errors.len().max(1) as f64).sqrt())
    };
    found.held_out = Some(HeldOut { before_rad: error(nominal)?, after_rad: error(&best)? });
    Ok(())
}

/// One coefficient of friction from simulated contacts, with the arm as identified so far; `None` without recordings.
fn contact(
    world: &World,
    robot: &RobotModel,
    recordings: Vec<(&Recording, Range<usize>)>,
    (parameter, measured): (Parameter, Measured),
    settings: &SearchSettings,
    found: &mut Identification,
) -> Result<Option<Coefficient>, IdentifyError> {
    if recordings.is_empty() {
        return Ok(None);
    }
    let bare = bare(robot, true);
    let mut problem = Problem {
        recordings,
        world,
        robot: &bare,
        measured,
        unknowns: vec![unknown(parameter, &found.values, robot, &found.values)],
        base: found.values.clone(),
        noise: Vec::new(),
        held: Vec::new(),
        derivatives: RefCell::default(),
    };
    problem.noise = vec![1e-3; problem.channels()];
    let fit = friction::fit(&problem, settings).ok_or(IdentifyError::Start)?;
    let scale = problem.unknowns[0].members[0].1;
    found.fits.push(Fit {
        motions: kinds(&problem),
        condition_number: 1.0,
        flat_directions: Vec::new(),
        channels: fit.channels,
        starts_rms: fit.starts_rms,
    });
    Ok(Some(Coefficient { value: fit.value * scale, sd: fit.sd * scale }))
}

/// Kinds of the recordings of a problem.
fn kinds(problem: &Problem) -> Vec<Motion> {
    let mut motions: Vec<Motion> = problem.recordings.iter().map(|(recording, _)| recording.motion).collect();
    motions.sort_unstable();
    motions.dedup();
    motions
}

impl Identification {
    /// Adds an identified parameter; value and standard deviation are in multiples of its typical size.
    fn add(&mut self, (parameter, scale): (Parameter, f64), name: String, nominal: &Values, at: f64, sd: f64) {
        let [low, high] = parameter.bounds();
        self.parameters.push(Estimate {
            name,
            unit: parameter.unit(),
            before: nominal.get(parameter),
            value: at * scale,
            interval: [at - Z * sd, at + Z * sd].map(|end| end.max(low.min(0.0)) * scale),
            is_at_bound: at - low < AT_BOUND || high - at < AT_BOUND,
            parameter,
        });
        self.values.set(parameter, at * scale);
    }

    /// Adds a coefficient that each of several measurements shows by itself: the mean, weighed by information, and less
    /// certain if they disagree (Birge, 1932). `None` if they do not determine it.
    fn coefficient(
        &mut self,
        parameter: Parameter,
        each: &[Coefficient],
        nominal: &Values,
        robot: &RobotModel,
    ) -> Option<f64> {
        let scale = parameter.scale(nominal, robot);
        let information: f64 = each.iter().map(|it| it.sd.powi(-2)).sum();
        let value = each.iter().map(|it| it.value * it.sd.powi(-2)).sum::<f64>() / information;
        let squares: f64 = each.iter().map(|it| ((it.value - value) / it.sd).powi(2)).sum();
        let birge = (squares / each.len().saturating_sub(1).max(1) as f64).max(1.0);
        let sd = (birge / information).sqrt();
        if Z * sd <= WIDEST * value.max(scale) {
            self.add((parameter, scale), parameter.name(robot), nominal, value / scale, sd / scale);
            return Some(value);
        }
        let reason = match sd.is_finite() && sd < INVISIBLE * scale {
            true => format!("known to ± {:.2} only", Z * sd),
            false => "it changes nothing in these recordings".into(),
        };
        self.unidentified.push(unidentified(parameter, robot, reason));
        None
    }
}

/// Parameters that free motions can show.
pub(crate) fn parameters_of(recordings: &[&Recording], robot: &RobotModel) -> Vec<Parameter> {
    let mut parameters = Parameter::of_arm(robot.arm_dof());
    let has_payload = recordings.iter().any(|recording| recording.motion == Motion::Payload);
    if has_payload {
        parameters.push(Parameter::PayloadMass);
        parameters.extend((0..3).map(Parameter::PayloadCenter));
    }
    parameters
}

/// Unknown of a single parameter, which starts inside its bounds.
pub(crate) fn unknown(parameter: Parameter, nominal: &Values, robot: &RobotModel, start: &Values) -> Unknown {
    let scale = parameter.scale(nominal, robot);
    let bounds = parameter.bounds();
    let inside = [bounds[0] + 0.05, 0.9 * bounds[1]];
    Unknown {
        members: vec![(parameter, scale)],
        start: (start.get(parameter) / scale).clamp(inside[0], inside[1]),
        bounds,
    }
}

fn unidentified(parameter: Parameter, robot: &RobotModel, reason: String) -> Unidentified {
    Unidentified { name: parameter.name(robot), reason, motion: parameter.advice(robot), parameter }
}

/// Adds the parameters of a solved problem to the result.
fn report(problem: &Problem, solution: &Solution, robot: &RobotModel, nominal: &Values, found: &mut Identification) {
    let uncertainty = Uncertainty::of(&solution.evaluation, &solution.noise, &solution.point);
    let members: Vec<(Parameter, f64)> = problem.unknowns.iter().map(|unknown| unknown.members[0]).collect();
    let name = |index: &usize| members[*index].0.name(robot);
    for (index, &(parameter, scale)) in members.iter().enumerate() {
        let at = solution.point[index];
        let sd = uncertainty.as_ref().map_or(f64::INFINITY, |it| it.sd[index]);
        let is_dead = solution.evaluation.columns[index].is_empty() || sd > INVISIBLE;
        if is_dead || Z * sd > WIDEST * at.abs().max(1.0) {
            let partners =
                uncertainty.iter().flat_map(|it| &it.flat).find(|(flat, _)| flat.contains(&index) && flat.len() > 1);
            let reason = match partners {
                _ if is_dead => "it changes nothing in these recordings".into(),
                Some((flat, _)) => {
                    let others: Vec<String> = flat.iter().filter(|&other| *other != index).map(name).collect();
                    format!("only together with {}", others.join(", "))
                }
                None => format!("known to ± {:.3} {} only", Z * sd * scale, parameter.unit()),
            };
            found.unidentified.push(unidentified(parameter, robot, reason));
            continue;
        }
        found.add((parameter, scale), name(&index), nominal, at, sd);
    }
    let channels = problem.channels();
    let whiteness = (0..channels).map(|channel| {
        whiteness(&channel_of(&solution.evaluation.residuals, channels, channel), problem.resolution(channel))
    });
    found.fits.push(Fit {
        motions: kinds(problem),
        condition_number: uncertainty.as_ref().map_or(f64::INFINITY, |it| it.condition_number),
        flat_directions: uncertainty
            .iter()
            .flat_map(|it| &it.flat)
            .map(|(flat, _)| flat.iter().map(name).collect())
            .collect(),
        channels: whiteness.collect(),
        starts_rms: solution.starts_rms.clone(),
    });
}
