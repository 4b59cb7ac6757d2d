//! The language of tasks: answers of language models, the rule-based designer, an independent reader, and wording.
//!
//! - [`answer`] turns the text of a model into a valid [`genmanip_core::Task`], or lists everything that is wrong with it.
//! - [`designer`] composes tasks by rules from the annotations of a catalogue.
//! - [`references`] reads instructions independently of the designer and checks that they single out their objects.
//! - [`wording`] paraphrases instructions and names the steps of a task.
//!
//! All modules are pure functions: no files, network, clock or hidden state.

pub mod answer;
pub mod designer;
pub mod references;
pub mod wording;
