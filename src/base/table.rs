//! Tables on a terminal.

use crate::base::text::COLUMNS;
use textwrap::core::display_width;

/// Blanks between columns.
const GAP: usize = 2;

/// A column of a table.
#[derive(Debug)]
pub struct Column {
    /// The name, then a cell a row.
    lines: Vec<String>,
    /// Of the longest.
    width: usize,
    /// Whether cells begin at the left.
    left: bool,
}

impl Column {
    /// Of numbers, which end at the right.
    pub fn new(name: &str, cells: impl IntoIterator<Item = String>) -> Self {
        let lines: Vec<String> = std::iter::once(name.to_owned()).chain(cells).collect();
        let width = lines.iter().map(|line| display_width(line)).max().unwrap_or(0);
        Self { lines, width, left: false }
    }

    /// Of words, which begin at the left.
    pub fn of_words(name: &str, cells: impl IntoIterator<Item = String>) -> Self {
        Self { left: true, ..Self::new(name, cells) }
    }

    fn cell(&self, row: usize) -> String {
        let cell = &self.lines[row];
        let blanks = " ".repeat(self.width - display_width(cell));
        if self.left { format!("{cell}{blanks}") } else { format!("{blanks}{cell}") }
    }
}

/// `columns` in pieces that fit a terminal, each behind the column `first`. All have as many rows.
pub fn in_pieces(first: &Column, columns: &[Column]) -> String {
    let mut text = String::new();
    let mut rest = columns;
    while !rest.is_empty() {
        let mut width = first.width;
        let fits = |column: &&Column| {
            width += GAP + column.width;
            width <= COLUMNS
        };
        let (piece, others) = rest.split_at(rest.iter().take_while(fits).count().max(1));
        if rest.len() < columns.len() {
            text.push('\n');
        }
        for row in 0..first.lines.len() {
            let cells = std::iter::once(first).chain(piece).map(|column| column.cell(row));
            let line = cells.collect::<Vec<_>>().join(&" ".repeat(GAP));
            text += &format!("{}\n", line.trim_end());
        }
        rest = others;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_shown_once_in_lines_that_fit() {
        let column = |k: usize| Column::new(&format!("c{k}"), ["x".repeat(20 + k), "y".to_owned()]);
        let columns: Vec<Column> = (10..20).map(column).collect();
        let text = in_pieces(&Column::of_words("run", ["1", "12"].map(str::to_owned)), &columns);
        assert!(text.lines().all(|line| line.len() <= COLUMNS), "{text}");
        assert!((10..20).all(|k| text.matches(&format!("c{k}")).count() == 1), "{text}");
        let pieces: Vec<&str> = text.split("\n\n").collect();
        assert!(
            pieces.len() > 3 && pieces.iter().all(|piece| piece.starts_with("run  ")),
            "{text}"
        );
        assert!(
            pieces.iter().all(|piece| piece.lines().nth(2).is_some_and(|l| l.starts_with("12 ")))
        );
    }
}
