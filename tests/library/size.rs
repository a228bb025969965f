//! Lines of code and of prose are at most 100 columns wide. Functions in `src/` are at most 70
//! lines long, those of tests, benches and examples at most 100.

use std::path::{Path, PathBuf};

const COLUMNS: usize = 100;
const FUNCTION_LINES: usize = 70;
/// The same in tests, benches and examples.
const TEST_LINES: usize = 100;

#[test]
fn lines_and_functions_are_short() {
    let mut found = Vec::new();
    let mut look = |folder: &str, extension: &str, rules: &[fn(&str) -> Vec<usize>]| {
        let files = files(Path::new(folder), extension);
        assert!(!files.is_empty(), "{folder}: no .{extension} is found");
        for file in files {
            let text = std::fs::read_to_string(&file).expect("a text");
            let lines = rules.iter().flat_map(|rule| rule(&text));
            found.extend(lines.map(|line| format!("{}:{line}", file.display())));
        }
    };
    look("src", "rs", &[too_wide, |text| too_long(text, FUNCTION_LINES)]);
    for folder in ["tests", "benches", "examples"] {
        look(folder, "rs", &[too_wide, |text| too_long(text, TEST_LINES)]);
    }
    look("cases", "toml", &[too_wide]);
    look("python", "py", &[too_wide]);
    for (folder, extensions) in
        [("scripts", ["sh", "py"]), ("jobscripts", ["sh", "sbatch"]), ("tests", ["sh", "py"])]
    {
        extensions.into_iter().for_each(|extension| look(folder, extension, &[too_wide]));
    }
    look("docs", "md", &[too_wide_prose]);
    for page in ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "cases/README.md"] {
        let text = std::fs::read_to_string(page).expect("a page");
        found.extend(too_wide_prose(&text).iter().map(|line| format!("{page}:{line}")));
    }
    assert!(found.is_empty(), "too wide or too long:\n{}", found.join("\n"));
}

#[test]
fn wide_lines_and_long_functions_are_found() {
    let line = "é".repeat(COLUMNS);
    assert!(too_wide(&line).is_empty());
    assert_eq!(too_wide(&format!("a\n{line}é\n")), [2]);
    assert_eq!(too_wide_prose(&format!("|{line}\n![{line}\n{line}é\n")), [3]);
    let function =
        |lines: usize| format!("\n    pub fn f() {{\n{}    }}\n", "        g();\n".repeat(lines));
    for most in [FUNCTION_LINES, TEST_LINES] {
        assert!(too_long(&function(most - 2), most).is_empty());
        assert_eq!(too_long(&function(most - 1), most), [2]);
    }
}

/// The files with this extension below a folder.
pub fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path());
    entries
        .flat_map(|path| if path.is_dir() { files(&path, extension) } else { vec![path] })
        .filter(|path| path.extension().is_some_and(|e| e == extension))
        .collect()
}

/// Numbers of the lines that are too wide.
fn too_wide(text: &str) -> Vec<usize> {
    let lines = text.lines().enumerate();
    lines.filter(|(_, l)| l.chars().count() > COLUMNS).map(|(i, _)| i + 1).collect()
}

/// The same, except for tables and pictures, which cannot be wrapped.
fn too_wide_prose(text: &str) -> Vec<usize> {
    let lines: Vec<&str> = text.lines().collect();
    let is_prose = |line: &usize| !lines[line - 1].trim_start().starts_with(['|', '!']);
    too_wide(text).into_iter().filter(is_prose).collect()
}

/// Numbers of the lines at which functions begin that have more than `most` lines. `cargo fmt` has
/// put the closing brace of a function below its beginning.
fn too_long(text: &str, most: usize) -> Vec<usize> {
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
        if end.is_some_and(|length| length + 1 > most) {
            found.push(begin + 1);
        }
    }
    found
}
