//! Progress callbacks: stages report, callers print.

/// Receiver of progress reports; called from any worker thread.
pub trait Progress: Sync {
    /// Starts a task of `total` equal units, named `what`.
    fn begin(&self, what: &str, total: usize);
    /// Reports one finished unit.
    fn advance(&self);
    /// Ends the task started last.
    fn end(&self);
    /// Replaces the status text shown beside the number of units.
    fn tell(&self, _state: &str) {}
    /// Reports a message to the user.
    fn note(&self, text: &str);
}

/// [`Progress`] that discards all reports.
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _what: &str, _total: usize) {}
    fn advance(&self) {}
    fn end(&self) {}
    fn note(&self, _text: &str) {}
}
