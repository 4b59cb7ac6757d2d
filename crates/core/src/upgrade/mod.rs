//! How documents of the version before become today's, one module per kind of document.
//!
//! What an older version did not say is filled in with what was fixed when it was current.

pub mod result;
