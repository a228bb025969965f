//! Lines are at most 100 columns wide and functions at most 100 lines long, in all of `src/`.

use std::path::{Path, PathBuf};

const COLUMNS: usize = 100;
const FUNCTION_LINES: usize = 100;

#[test]
fn lines_and_functions_are_short() {
    let files = files(Path::new("src"));
    assert!(files.len() > 100, "only {} files are seen", files.len());
    let mut found = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).expect("a source file");
        found.extend(too_wide(&text).into_iter().map(|line| format!("{}:{line}", file.display())));
        found.extend(too_long(&text).into_iter().map(|line| format!("{}:{line}", file.display())));
    }
    assert!(found.is_empty(), "too wide or too long:\n{}", found.join("\n"));
}

#[test]
fn what_is_too_wide_or_too_long_is_found() {
    let line = "é".repeat(COLUMNS);
    assert!(too_wide(&line).is_empty());
    assert_eq!(too_wide(&format!("a\n{line}é\n")), [2]);
    let function =
        |lines: usize| format!("\n    pub fn f() {{\n{}    }}\n", "        g();\n".repeat(lines));
    assert!(too_long(&function(FUNCTION_LINES - 2)).is_empty());
    assert_eq!(too_long(&function(FUNCTION_LINES - 1)), [2]);
}

/// The `.rs` files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => files(&path),
            false => vec![path],
        })
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .collect()
}

/// Numbers of the lines that are too wide.
fn too_wide(text: &str) -> Vec<usize> {
    let lines = text.lines().enumerate();
    lines.filter(|(_, l)| l.chars().count() > COLUMNS).map(|(i, _)| i + 1).collect()
}

/// Numbers of the lines at which functions begin that are too long. `cargo fmt` has put the closing
/// brace of a function below its beginning.
fn too_long(text: &str) -> Vec<usize> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (begin, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let words = code.split(['(', ' ']).take_while(|word| !word.starts_with("//"));
        if !words.take(5).any(|word| word == "fn") || line.ends_with(';') {
            continue;
        }
        let closing = format!("{}}}", &line[..line.len() - code.len()]);
        let end = lines[begin..].iter().position(|l| *l == closing);
        if end.is_some_and(|length| length + 1 > FUNCTION_LINES) {
            found.push(begin + 1);
        }
    }
    found
}
