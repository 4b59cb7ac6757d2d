//! Set points of the drives from recorded commands.

use crate::recording::Recording;

/// Commands as a piecewise linear function of time, constant before the first and after the last one.
pub struct SetPoints<'a> {
    times_s: &'a [f64],
    rows: &'a [Vec<f64>],
    widths_m: &'a [f64],
}

impl<'a> SetPoints<'a> {
    /// Commands of a recording.
    pub fn of(recording: &'a Recording) -> Self {
        Self { times_s: &recording.time_s, rows: &recording.command_rad, widths_m: &recording.width_m }
    }

    /// Row before a time, and the share of the way to the next one.
    fn place(&self, time_s: f64) -> (usize, f64) {
        let last = self.times_s.len() - 1;
        let after = self.times_s.partition_point(|&time| time <= time_s);
        match after {
            0 => (0, 0.0),
            after if after > last => (last, 0.0),
            after => {
                let (from, to) = (self.times_s[after - 1], self.times_s[after]);
                (after - 1, (time_s - from) / (to - from))
            }
        }
    }

    /// Joint positions at a time, rad.
    pub fn positions(&self, time_s: f64) -> Vec<f64> {
        let (row, share) = self.place(time_s);
        let next = &self.rows[(row + 1).min(self.rows.len() - 1)];
        self.rows[row].iter().zip(next).map(|(from, to)| from + (to - from) * share).collect()
    }

    /// Mean velocities from one time to another, rad/s.
    pub fn velocities(&self, from_s: f64, to_s: f64) -> Vec<f64> {
        let (from, to) = (self.positions(from_s), self.positions(to_s));
        from.iter().zip(&to).map(|(from, to)| (to - from) / (to_s - from_s)).collect()
    }

    /// Opening width at a time, m; `None` if the gripper is not commanded.
    pub fn width_m(&self, time_s: f64) -> Option<f64> {
        let (row, share) = self.place(time_s);
        let from = *self.widths_m.get(row)?;
        let to = self.widths_m.get(row + 1).copied().unwrap_or(from);
        Some(from + (to - from) * share)
    }
}
