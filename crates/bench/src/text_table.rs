//! Tables of plain text.

/// A table with aligned columns; the first row is the head.
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

#[cfg(test)]
mod tests {
    use super::text_table;

    #[test]
    fn columns_line_up() {
        let rows = [["task", "verified"], ["017", "2/2"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(text_table(&rows), "task  verified\n────  ────────\n017   2/2\n");
    }
}
