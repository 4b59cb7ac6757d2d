//! How long work is heard of: whoever calls a stage may listen, and the stage itself prints nothing.

/// Hears how far work is; called from any worker thread.
pub trait Progress: Sync {
    /// Work of `total` equal parts begins.
    fn begin(&self, what: &str, total: usize);
    /// One part is done.
    fn advance(&self);
    /// The work that began last has ended.
    fn end(&self);
    /// How things stand beside the number of parts, a few words that replace those before.
    fn tell(&self, _state: &str) {}
    /// Something that a person who waits may want to know.
    fn note(&self, text: &str);
}

/// Nobody listens.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _what: &str, _total: usize) {}
    fn advance(&self) {}
    fn end(&self) {}
    fn note(&self, _text: &str) {}
}
