//! Tables on a terminal, as CSV and in LaTeX.
//!
//! It is our own, because users would lose by a library. A table that is too wide for a terminal is
//! cut into pieces that repeat the first column, where libraries wrap or cut cells: a number stays
//! whole and can be copied. And the label of each number goes with it, as a column of CSV and as a
//! mark in LaTeX.

use crate::base::text::{COLUMNS, csv_field, json_text, short};
use serde_json::Value;
use textwrap::core::display_width;

/// Blanks between columns.
const GAP: usize = 2;

/// A column of a table.
#[derive(Debug)]
pub struct Column {
    /// The name, then a cell a row.
    lines: Vec<String>,
    /// Width of the longest cell.
    width: usize,
    /// Whether cells begin at the left.
    left: bool,
}

impl Column {
    /// A column of numbers, aligned at the right.
    pub fn new(name: &str, cells: impl IntoIterator<Item = String>) -> Self {
        let lines: Vec<String> = std::iter::once(name.to_owned()).chain(cells).collect();
        let width = lines.iter().map(|line| display_width(line)).max().unwrap_or(0);
        Self { lines, width, left: false }
    }

    /// A column of words, aligned at the left.
    pub fn of_words(name: &str, cells: impl IntoIterator<Item = String>) -> Self {
        Self { left: true, ..Self::new(name, cells) }
    }

    fn cell(&self, row: usize) -> String {
        let cell = &self.lines[row];
        let blanks = " ".repeat(self.width - display_width(cell));
        if self.left { format!("{cell}{blanks}") } else { format!("{blanks}{cell}") }
    }
}

/// `columns` split into pieces that fit a terminal, each after the column `first`. All columns have
/// equally many rows.
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

/// A column of values for [`csv`] and [`tabular`].
#[derive(Debug)]
pub struct ColumnValues {
    /// The name, at the top.
    pub name: String,
    /// A value a row; null where there is none.
    pub cells: Vec<Value>,
    /// A label for each row; empty for a column without labels.
    pub labels: Vec<Label>,
}

/// A label of a value.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    /// The word for it.
    pub word: &'static str,
    /// The letter for it, in tables; a blank for none.
    pub mark: char,
}

impl ColumnValues {
    /// A column without labels.
    pub fn new(name: &str, cells: impl IntoIterator<Item = Value>) -> Self {
        let cells = cells.into_iter().collect();
        Self { name: name.to_owned(), cells, labels: Vec::new() }
    }

    /// Whether no row has a value.
    pub fn is_empty(&self) -> bool {
        self.cells.iter().all(Value::is_null)
    }

    /// Whether some values are words.
    fn has_words(&self) -> bool {
        self.cells.iter().any(|cell| cell.is_string() || cell.is_array())
    }

    fn tex_cell(&self, row: usize) -> String {
        let mark = self.labels.get(row).map_or(' ', |label| label.mark);
        tex_number(&self.cells[row], mark)
    }
}

/// Columns as CSV (RFC 4180), all digits of each number: a line of names, then one a row. Labels
/// are a column of their own, `NAME_label`.
pub fn csv(columns: &[ColumnValues]) -> String {
    let mut lines = vec![Vec::new(); 1 + columns.first().map_or(0, |column| column.cells.len())];
    for column in columns {
        lines[0].push(csv_field(&column.name));
        if !column.labels.is_empty() {
            lines[0].push(csv_field(&format!("{}_label", column.name)));
        }
        for (row, cell) in column.cells.iter().enumerate() {
            let text = if cell.is_null() { String::new() } else { json_text(cell) };
            lines[1 + row].push(csv_field(&text));
            let label = column.labels.get(row).map(|label| csv_field(label.word));
            lines[1 + row].extend(label);
        }
    }
    lines.iter().map(|fields| fields.join(",") + "\n").collect()
}

/// Columns as a `tabular` of LaTeX with the rules of booktabs; before each row the text that
/// `before` gives. Marks of labels are superscripts.
pub fn tabular(columns: &[ColumnValues], before: impl Fn(usize) -> String) -> String {
    let sides: String =
        columns.iter().map(|column| if column.has_words() { 'l' } else { 'r' }).collect();
    let names: Vec<String> = columns.iter().map(|column| tex_text(&column.name)).collect();
    let names = names.join(" & ");
    let mut text = format!("\\begin{{tabular}}{{{sides}}}\n\\toprule\n{names} \\\\\n\\midrule\n");
    for row in 0..columns.first().map_or(0, |column| column.cells.len()) {
        let cells: Vec<String> = columns.iter().map(|column| column.tex_cell(row)).collect();
        text += &format!("{}{} \\\\\n", before(row), cells.join(" & "));
    }
    text + "\\bottomrule\n\\end{tabular}\n"
}

/// A value in LaTeX, with the mark of its label.
fn tex_number(value: &Value, mark: char) -> String {
    let Value::Number(number) = value else {
        return if value.is_null() { "--".to_owned() } else { tex_text(&json_text(value)) };
    };
    let text = match number.as_f64().filter(|_| number.is_f64()) {
        Some(number) => short(number),
        None => number.to_string(),
    };
    let mark = if mark == ' ' { String::new() } else { format!("\\;^\\mathrm{{{mark}}}") };
    match text.split_once('e') {
        None => format!("${text}{mark}$"),
        Some(("1", exponent)) => format!("$10^{{{exponent}}}{mark}$"),
        Some((digits, exponent)) => format!("${digits} \\times 10^{{{exponent}}}{mark}$"),
    }
}

/// Text in LaTeX.
fn tex_text(text: &str) -> String {
    let mut shown = String::new();
    for c in text.chars() {
        match c {
            '\\' => shown += "\\textbackslash{}",
            '^' => shown += "\\textasciicircum{}",
            '~' => shown += "\\textasciitilde{}",
            '<' => shown += "\\textless{}",
            '>' => shown += "\\textgreater{}",
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => shown.extend(['\\', c]),
            '\n' => shown.push(' '),
            other => shown.push(other),
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

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

    #[test]
    fn labels_are_words_in_csv_and_letters_in_latex() {
        let labels = vec![
            Label { word: "exact", mark: 'x' },
            Label { word: "model", mark: 'm' },
            Label { word: "unavailable", mark: ' ' },
        ];
        let cells = vec![json!(0.1 + 0.2), json!(1e5), json!(null)];
        let columns = [
            ColumnValues::new("set-up", ["a, b", "50 %", "c_1"].map(Value::from)),
            ColumnValues { labels, ..ColumnValues::new("steps", cells) },
        ];
        let text = "set-up,steps,steps_label\n\"a, b\",0.30000000000000004,exact\n\
                    50 %,100000.0,model\nc_1,,unavailable\n";
        assert_eq!(csv(&columns), text);
        let text = tabular(&columns, |_| String::new());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[..3], ["\\begin{tabular}{lr}", "\\toprule", "set-up & steps \\\\"]);
        assert_eq!(
            lines[4..7],
            [
                "a, b & $0.3\\;^\\mathrm{x}$ \\\\",
                "50 \\% & $10^{5}\\;^\\mathrm{m}$ \\\\",
                "c\\_1 & -- \\\\"
            ]
        );
        assert_eq!(
            tex_text("a\\b{c}_~<"),
            "a\\textbackslash{}b\\{c\\}\\_\\textasciitilde{}\\textless{}"
        );
    }
}
