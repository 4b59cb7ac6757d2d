//! Least-squares problem: residuals of recordings, and their derivatives by finite differences on the simulator.

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;

use genmanip_core::{RobotModel, World};
use genmanip_real::least_squares::Normal;
use genmanip_sim::SimError;

use crate::parameters::{Parameter, Values};
use crate::recording::Recording;
use crate::replay::replay;
use crate::structure::{noise_of, resolution};

/// Step of the finite differences, in multiples of a parameter's typical size: far above the solver's tolerance, far
/// below any curvature.
const STEP: f64 = 1e-3;
/// Range of the measured positions within which a joint stands still, rad: its friction yields a little under load, and
/// sensors are noisy.
const STILL_RAD: f64 = 3e-3;
/// Noise of a channel that is not compared, rad: ten thousand times that of a sensor.
const UNCOMPARED_RAD: f64 = 1.0;
/// Distance, as a share of the value or of the typical size, within which derivatives are reused (chord method): steps
/// then converge linearly, but cost one simulation instead of one per unknown.
const NEARBY: f64 = 1.5;
/// Standard deviation of the weak prior about the start, in typical sizes: it keeps a search from running away along
/// directions that the recordings do not show, and takes less than 0.3 % off the distance of an identified parameter
/// from its start.
pub const PRIOR_SD: f64 = 5.0;

/// Unknown of the search: parameters that share one value, in multiples of their typical sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Parameters with their typical sizes.
    pub members: Vec<(Parameter, f64)>,
    /// Value at the start, in typical sizes, about which the prior is centred.
    pub start: f64,
    /// Smallest and largest value, in typical sizes.
    pub bounds: [f64; 2],
}

/// Measured quantity that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measured {
    /// Joint positions.
    Joints,
    /// Position of the block.
    Block,
}

/// Recordings with the unknowns that explain them.
pub struct Problem<'a> {
    /// Recordings, each with the range of its moments that are used.
    pub recordings: Vec<(&'a Recording, Range<usize>)>,
    /// World of the recordings.
    pub world: &'a World,
    /// Robot, without geometry that nothing touches.
    pub robot: &'a RobotModel,
    /// Compared quantity.
    pub measured: Measured,
    /// Unknowns of the search.
    pub unknowns: Vec<Unknown>,
    /// Values of all parameters that are no unknown.
    pub base: Values,
    /// Standard deviation of the noise of each channel: joint, or axis of the block's position.
    pub noise: Vec<f64>,
    /// Channels that are not compared: joints that stand still.
    pub held: Vec<usize>,
    /// Latest derivatives, with their point.
    pub derivatives: RefCell<Option<(Vec<f64>, Rc<Columns>)>>,
}

/// Derivatives of the simulated values by each unknown, in the order of the residuals; empty for an unknown that changes
/// nothing.
pub type Columns = Vec<Vec<f64>>;

/// Residuals and derivatives at a point.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Normal equations, with the prior.
    pub normal: Normal,
    /// Residuals, measured minus simulated, by recording, moment and channel.
    pub residuals: Vec<f64>,
    /// Derivatives, there or nearby.
    pub columns: Rc<Columns>,
}

impl AsRef<Normal> for Evaluation {
    fn as_ref(&self) -> &Normal {
        &self.normal
    }
}

impl Problem<'_> {
    /// Number of channels per moment.
    pub fn channels(&self) -> usize {
        match self.measured {
            Measured::Joints => self.robot.arm_dof(),
            Measured::Block => 3,
        }
    }

    /// Resolution of one channel's sensor, rad or m.
    pub fn resolution(&self, channel: usize) -> f64 {
        let each = self.recordings.iter().flat_map(|(recording, rows)| {
            let measured = |row: usize| match (self.measured, &recording.block) {
                (Measured::Block, Some(block)) => block.track_m[row][channel],
                _ => recording.joint_rad[row][channel],
            };
            rows.clone().map(measured)
        });
        resolution(each)
    }

    /// Starting point of the search.
    pub fn start(&self) -> Vec<f64> {
        self.unknowns.iter().map(|unknown| unknown.start).collect()
    }

    /// Values of all parameters at a point.
    pub fn values(&self, point: &[f64]) -> Values {
        let mut values = self.base.clone();
        for (unknown, multiple) in self.unknowns.iter().zip(point) {
            unknown.members.iter().for_each(|&(parameter, scale)| values.set(parameter, multiple * scale));
        }
        values
    }

    /// Point moved by a step that is limited to half a typical size or half the value, and by the bounds.
    pub fn moved(&self, point: &[f64], change: &[f64]) -> Vec<f64> {
        let limit = |multiple: f64| 0.5 * multiple.abs().max(1.0);
        self.unknowns
            .iter()
            .zip(point.iter().zip(change))
            .map(|(unknown, (at, change))| {
                (at + change.clamp(-limit(*at), limit(*at))).clamp(unknown.bounds[0], unknown.bounds[1])
            })
            .collect()
    }

    /// Residuals at a point; `None` where the simulation diverges.
    pub fn residuals(&self, point: &[f64]) -> Option<Vec<f64>> {
        let values = self.values(point);
        let each = self.recordings.iter().map(|(recording, rows)| self.residuals_of(recording, rows, &values));
        Some(each.collect::<Result<Vec<_>, _>>().ok()?.concat())
    }

    /// Residuals of moments of a recording, measured minus simulated.
    fn residuals_of(&self, recording: &Recording, rows: &Range<usize>, values: &Values) -> Result<Vec<f64>, SimError> {
        let track = replay(recording, self.world, self.robot, values)?;
        let rows = rows.clone();
        Ok(match (self.measured, &recording.block) {
            (Measured::Block, Some(block)) => rows
                .flat_map(|row| (0..3).map(move |axis| (row, axis)))
                .map(|(row, axis)| block.track_m[row][axis] - track.block[row][axis])
                .collect(),
            _ => rows
                .flat_map(|row| recording.joint_rad[row].iter().zip(&track.joints[row]))
                .map(|(real, sim)| real - sim)
                .collect(),
        })
    }

    /// Sum of squared residuals in units of the noise, with the prior.
    pub fn cost(&self, point: &[f64], residuals: &[f64]) -> f64 {
        let channels = self.channels();
        let data: f64 = residuals.iter().enumerate().map(|(row, it)| (it / self.noise[row % channels]).powi(2)).sum();
        data + self.prior(point).map(|(off, weight)| weight * off * off).sum::<f64>()
    }

    /// Distance from the start, and weight, of each unknown.
    fn prior(&self, point: &[f64]) -> impl Iterator<Item = (f64, f64)> {
        self.unknowns.iter().zip(point).map(|(unknown, at)| (at - unknown.start, PRIOR_SD.powi(-2)))
    }

    /// Residuals and derivatives at a point; `None` where the simulation diverges or the cost exceeds `highest`.
    /// Derivatives of a nearby point are reused.
    pub fn evaluate(&self, point: &[f64], highest: f64) -> Option<Evaluation> {
        let residuals = self.residuals(point)?;
        if self.cost(point, &residuals) > highest {
            return None;
        }
        let is_near = |known: &[f64]| {
            known.iter().zip(point).all(|(known, at)| (known - at).abs() <= NEARBY * known.abs().max(1.0))
        };
        let known = self.derivatives.borrow().as_ref().filter(|(known, _)| is_near(known)).map(|(_, it)| Rc::clone(it));
        let columns = match known {
            Some(columns) => columns,
            None => {
                let each = (0..point.len()).map(|index| self.column(point, &residuals, index));
                let columns = Rc::new(each.collect::<Result<Vec<_>, _>>().ok()?);
                *self.derivatives.borrow_mut() = Some((point.to_vec(), Rc::clone(&columns)));
                columns
            }
        };
        Some(self.assemble(point, residuals, columns))
    }

    /// Estimates the noise of the channels from residuals; those that are not compared get no weight.
    pub fn estimate_noise(&mut self, residuals: &[f64], least_noise: f64) {
        self.noise = noise_of(residuals, self.channels(), least_noise);
        self.held.iter().for_each(|&channel| self.noise[channel] = UNCOMPARED_RAD);
    }

    /// The same residuals and derivatives with the present noise.
    pub fn weighed(&self, point: &[f64], evaluation: Evaluation) -> Evaluation {
        self.assemble(point, evaluation.residuals, evaluation.columns)
    }

    fn assemble(&self, point: &[f64], residuals: Vec<f64>, columns: Rc<Columns>) -> Evaluation {
        let channels = self.channels();
        let mut normal = Normal::new(point.len());
        let active: Vec<usize> = (0..columns.len()).filter(|&index| !columns[index].is_empty()).collect();
        let mut row_of = Vec::with_capacity(active.len());
        for (row, residual) in residuals.iter().enumerate() {
            row_of.clear();
            row_of.extend(active.iter().map(|&index| (index, -columns[index][row])));
            normal.add(*residual, &row_of, self.noise[row % channels].powi(-2));
        }
        for (index, (off, weight)) in self.prior(point).enumerate() {
            normal.add(off, &[(index, 1.0)], weight);
        }
        Evaluation { normal, residuals, columns }
    }

    /// Derivatives of the simulated values by an unknown; empty if it changes nothing.
    ///
    /// A joint that is never commanded to move is held by its dry friction, often at the edge of what that can hold: a
    /// change to one side then shows, one to the other side does not. Such an inequality is no measurement, so the
    /// smaller of both derivatives counts.
    fn column(&self, point: &[f64], residuals: &[f64], index: usize) -> Result<Vec<f64>, SimError> {
        let unknown = &self.unknowns[index];
        let towards = if point[index] + STEP > unknown.bounds[1] { -STEP } else { STEP };
        let forward = self.difference(point, residuals, index, towards)?;
        let size = |column: &[f64]| column.iter().map(|value| value * value).sum::<f64>();
        let is_still = |(parameter, _): &(Parameter, f64)| parameter.joint().is_some_and(|joint| self.is_still(joint));
        let column = if unknown.members.iter().all(is_still) && point[index] - STEP > unknown.bounds[0] {
            let backward = self.difference(point, residuals, index, -STEP)?;
            if size(&backward) < size(&forward) { backward } else { forward }
        } else {
            forward
        };
        let is_dead = column.iter().all(|value| *value == 0.0);
        Ok(if is_dead { Vec::new() } else { column })
    }

    /// Quotient of the differences of all simulated values and of an unknown.
    fn difference(&self, point: &[f64], residuals: &[f64], index: usize, by: f64) -> Result<Vec<f64>, SimError> {
        let mut beside = point.to_vec();
        beside[index] += by;
        let values = self.values(&beside);
        let mut column = Vec::with_capacity(residuals.len());
        for (recording, rows) in &self.recordings {
            let here = &residuals[column.len()..column.len() + rows.len() * self.channels()];
            if self.unknowns[index].members.iter().any(|(it, _)| it.is_shown_by(recording.motion)) {
                let there = self.residuals_of(recording, rows, &values)?;
                column.extend(here.iter().zip(&there).map(|(here, there)| (here - there) / by));
            } else {
                column.extend(std::iter::repeat_n(0.0, here.len()));
            }
        }
        Ok(column)
    }

    /// True if no recording commands a joint to move, and it was measured to stay where it is.
    pub fn stands_still(&self, joint: usize) -> bool {
        let stays = |(recording, rows): &(&Recording, Range<usize>)| {
            let measured = recording.joint_rad[rows.clone()].iter().map(|row| row[joint]);
            let (low, high) = measured.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), it| (a.min(it), b.max(it)));
            high - low < STILL_RAD
        };
        self.is_still(joint) && self.recordings.iter().all(stays)
    }

    /// True if no recording commands a joint to move.
    fn is_still(&self, joint: usize) -> bool {
        let mut rows = self.recordings.iter().flat_map(|(recording, _)| recording.command_rad.windows(2));
        rows.all(|two| two[0][joint] == two[1][joint])
    }
}
