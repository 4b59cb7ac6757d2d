//! Whole imports of small files of our own, of damaged ones and of hostile ones.

mod described;
mod hostile;
mod rigid;
