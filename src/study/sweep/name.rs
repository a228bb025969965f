//! Names of the directories of a sweep: its values, and a checksum of the whole case.
//!
//! The checksum is that of `[case, mode]` as JSON text: keys in order, no blanks, floating-point
//! numbers as Python writes them. `python/src/phasewarp/sweep.py` computes the same.

use crate::base::checksum;
use crate::base::text::{compact_json, json_text};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The largest number of characters of the values in a name.
const MOST_SHOWN: usize = 80;

/// The directory name of the run of `case`, whose varied `keys` have these `values`.
pub fn run_name(case: &Value, mode: Option<&str>, keys: &[String], values: &[Value]) -> String {
    let checksum = checksum::of_text(compact_json(&json!([case, mode])).as_bytes());
    let last = |key: &String| key.rsplit('.').next().unwrap_or_default().trim().to_owned();
    let words = keys.iter().zip(values);
    let words: Vec<String> =
        words.map(|(key, value)| format!("{}={}", last(key), json_text(value))).collect();
    let shown: String = without_special(&words.join("_")).chars().take(MOST_SHOWN).collect();
    format!("{shown}_{}", checksum::text(checksum))
}

/// Makes the paths in a case absolute; they are relative to the directory of its file `file`.
pub fn with_absolute_paths(case: &mut Value, file: &Path) {
    let folder = file.parent().filter(|path| !path.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let keys = ["/initial/warped", "/initial/field", "/initial/table/file", "/inflow/table/file"];
    let regions = case.pointer("/potential").and_then(Value::as_array).map_or(0, Vec::len);
    let tables = (0..regions).map(|i| format!("/potential/{i}/table/file"));
    for key in keys.map(str::to_owned).into_iter().chain(tables) {
        if let Some(Value::String(path)) = case.pointer_mut(&key) {
            let absolute: PathBuf = folder.join(&*path).components().collect();
            *path = absolute.display().to_string();
        }
    }
}

/// `text` with one `-` for each sequence of characters that a shell or a file system may take for
/// something else.
fn without_special(text: &str) -> String {
    let mut name = String::new();
    let mut special = false;
    for c in text.chars() {
        let is_plain = c.is_ascii_alphanumeric() || ".,=+_-".contains(c);
        if is_plain || !special {
            name.push(if is_plain { c } else { '-' });
        }
        special = !is_plain;
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same case and name as in `python/tests/test_sweep.py`.
    #[test]
    fn names_are_those_of_the_python_package() {
        let case = json!({
            "time": {"end": 1e-5}, "title": "é \"\u{7f}\n", "solver": {"verify": true},
            "output": {"field_times": [0.1, 2]},
        });
        let keys = ["time.end", "output.field_times", "title"].map(str::to_owned);
        let values = [json!(1e-5), json!([0.1, 2]), json!("é \"\u{7f}\n")];
        let name = run_name(&case, Some("full"), &keys, &values);
        assert_eq!(name, "end=1e-05_field_times=-0.1,2-_title=-_f18ba48d0e2ddcc6");
        assert_ne!(run_name(&case, None, &keys, &values), name);
    }

    /// The same paths as in `python/src/phasewarp/case.py`.
    #[test]
    fn paths_of_all_tables_are_absolute() {
        let table = || json!({"table": {"file": "./t.csv"}});
        let mut case = json!({
            "initial": {"field": "a.h5", "warped": "/w.h5", "table": {"file": "../t.csv"}},
            "inflow": table(), "potential": [{"value": "0"}, table()],
        });
        with_absolute_paths(&mut case, Path::new("/data/case.toml"));
        let absolute = || json!({"table": {"file": "/data/t.csv"}});
        assert_eq!(
            case,
            json!({
                "initial": {
                    "field": "/data/a.h5", "warped": "/w.h5", "table": {"file": "/data/../t.csv"},
                },
                "inflow": absolute(), "potential": [{"value": "0"}, absolute()],
            })
        );
    }

    #[test]
    fn names_have_no_special_characters() {
        let value = json!("$(rm -r /); `a`\n../é");
        let name = run_name(&json!({}), None, &["title".to_owned()], &[value]);
        assert!(name.starts_with("title=-rm--r-a-..-_"), "{name}");
        let long = run_name(&json!({}), None, &["title".to_owned()], &[json!("x".repeat(300))]);
        assert_eq!(long.len(), MOST_SHOWN + 17);
    }
}
