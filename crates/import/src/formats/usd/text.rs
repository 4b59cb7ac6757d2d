//! Limits of a text layer (usda): its parser is recursive, so the nesting depth is checked before parsing.

/// Maximum nesting depth of brackets, and maximum number of opening brackets in a variable expression.
const MAX_NESTING: usize = 128;
/// First character of a string that is a variable expression.
const EXPRESSION: u8 = b'`';

/// Checks the nesting of a text layer.
///
/// # Errors
/// If it is nested too deeply.
pub fn check(bytes: &[u8]) -> Result<(), String> {
    let (mut depth, mut place) = (0_usize, 0);
    while let Some(&byte) = bytes.get(place) {
        let rest = &bytes[place..];
        // Brackets in comments, strings, paths and asset paths do not count.
        let skipped = match byte {
            b'#' => to(rest, 1, b"\n"),
            b'/' if rest.starts_with(b"/*") => to(rest, 2, b"*/"),
            b'"' | b'\'' => text(rest, byte)?,
            b'@' if rest.starts_with(b"@@@") => to(rest, 3, b"@@@").or(Some(2)),
            b'@' => to(rest, 1, b"@"),
            b'<' => to(rest, 1, b">"),
            _ => None,
        };
        match byte {
            b'{' | b'[' | b'(' => depth += 1,
            b'}' | b']' | b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_NESTING {
            return Err(format!("nested deeper than {MAX_NESTING}"));
        }
        place += skipped.unwrap_or(1);
    }
    Ok(())
}

/// Checks the number of brackets in a variable expression; other strings are accepted.
///
/// # Errors
/// If there are more than [`MAX_NESTING`].
pub fn check_expression(text: &[u8]) -> Result<(), String> {
    let is_bracket = |byte: &&u8| matches!(**byte, b'(' | b'[');
    if text.first() == Some(&EXPRESSION) && text.iter().filter(is_bracket).count() > MAX_NESTING {
        return Err(format!("an expression of more than {MAX_NESTING} functions and lists"));
    }
    Ok(())
}

/// Length of the part of `rest` up to and including the first `end` at or after `from`; `None` without `end`.
fn to(rest: &[u8], from: usize, end: &[u8]) -> Option<usize> {
    let found = rest.get(from..)?.windows(end.len()).position(|window| window == end)?;
    Some(from + found + end.len())
}

/// Length of a string literal in one or three quotation marks, its marks included; `None` if it is not closed.
///
/// # Errors
/// As [`check_expression`].
fn text(rest: &[u8], mark: u8) -> Result<Option<usize>, String> {
    if let Some(length) = rest.starts_with(&[mark; 3]).then(|| to(rest, 3, &[mark; 3])).flatten() {
        check_expression(rest.get(3..length - 3).unwrap_or_default())?;
        return Ok(Some(length));
    }
    let mut is_escaped = false;
    for (place, &byte) in rest.iter().enumerate().skip(1) {
        if byte == mark && !is_escaped {
            check_expression(&rest[1..place])?;
            return Ok(Some(place + 1));
        }
        is_escaped = byte == b'\\' && !is_escaped;
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brackets_that_nest_are_counted() {
        let deep = |open: &str| format!("#usda 1.0\n{}", open.repeat(200));
        for (open, is_fine) in [
            ("(", false),
            ("{[", false),
            ("( # )\n", false),
            ("( \"\"\"\n)\"\"\" ", false),
            ("( ')' ", false),
            ("( /* ) */ ", false),
            ("( </a)> @b)@ @@@)@c@@@ ", false),
            ("(\"\\\")\" ", false),
            ("()", true),
            ("# ((((\n", true),
            ("\"((( \"", true),
            ("@(((@", true),
        ] {
            assert_eq!(check(deep(open).as_bytes()).is_ok(), is_fine, "{open}");
        }
        assert!(check(format!("\"`{}`\"", "if(".repeat(200)).as_bytes()).is_err(), "an expression");
        // Opening marks that are never closed.
        for open in ["\"", "'''", "@", "@@@", "<", "/*", "\\"] {
            assert!(check(open.as_bytes()).is_ok());
        }
    }
}
