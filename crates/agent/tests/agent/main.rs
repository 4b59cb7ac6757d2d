//! The agent as others use it: questions and answers, and the marks on pictures.

mod answers;
mod marks;
