//! Truncation of answers for transcripts and retries.

/// Maximum length of a truncated answer (bytes). Chosen by hand.
const MAX_KEPT_BYTES: usize = 2000;

/// Truncates an answer to [`MAX_KEPT_BYTES`].
pub(crate) fn shortened(text: &str) -> String {
    if text.len() <= MAX_KEPT_BYTES {
        return text.to_owned();
    }
    let end = (0..=MAX_KEPT_BYTES).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    format!("{} … ({} bytes in all)", &text[..end], text.len())
}
