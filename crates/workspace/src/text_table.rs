//! Plain-text tables for terminals.

/// Maximum rows on a terminal; longer tables are summarised and show the rows that need attention.
pub const MAX_ROWS: usize = 30;

/// A table with aligned columns; the first row is the header.
pub fn text_table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|column| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for (index, row) in rows.iter().enumerate() {
        let line: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
        text += line.join("  ").trim_end();
        text.push('\n');
        if index == 0 {
            text += &widths.iter().map(|&width| "─".repeat(width)).collect::<Vec<_>>().join("  ");
            text.push('\n');
        }
    }
    text
}

/// Table of the first [`MAX_ROWS`] rows that need attention, and the number of further ones; empty without rows.
pub fn attention(head: &[&str], rows: &[Vec<String>]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let head = head.iter().map(|&head| head.to_owned()).collect::<Vec<_>>();
    let shown: Vec<Vec<String>> = [head].into_iter().chain(rows.iter().take(MAX_ROWS).cloned()).collect();
    let more = rows.len().saturating_sub(MAX_ROWS);
    let more = if more > 0 { format!("and {more} more: --each\n") } else { String::new() };
    format!("{}{more}", text_table(&shown))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [["task", "verified"], ["017", "2/2"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(text_table(&rows), "task  verified\n────  ────────\n017   2/2\n");
    }

    #[test]
    fn what_needs_attention_is_short() {
        assert_eq!(attention(&["task"], &[]), "");
        let rows = |count: usize| (0..count).map(|row| vec![row.to_string()]).collect::<Vec<_>>();
        assert_eq!(attention(&["task"], &rows(30)).lines().count(), 32);
        assert!(attention(&["task"], &rows(33)).ends_with("29\nand 3 more: --each\n"));
    }
}
