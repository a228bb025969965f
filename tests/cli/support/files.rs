//! The files in a directory, and their contents.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The files of a run of example1.toml, sorted by name.
pub const RESULT_FILES: [&str; 6] =
    ["fields.xdmf", "grids.h5", "plane_x.xdmf", "result.h5", "space.xdmf", "summary.json"];

/// The names in a directory, sorted; none if it cannot be read.
pub fn names_in(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).into_iter().flatten();
    let mut names: Vec<String> =
        entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    names.sort();
    names
}

/// Whether a directory holds a name that ends so.
pub fn holds(directory: &Path, ending: &str) -> bool {
    names_in(directory).iter().any(|name| name.ends_with(ending))
}

/// A file in a directory that is only partly written.
pub fn half_written(directory: &Path) -> Option<String> {
    names_in(directory).into_iter().find(|name| name.ends_with(".partial"))
}

/// Checks that a run has left nothing that is unfinished: no file that is partly written, and no
/// checkpoint.
pub fn nothing_unfinished(directory: &Path) -> Result<(), String> {
    let checkpoint = || holds(directory, "checkpoint").then(|| "checkpoint".to_owned());
    match half_written(directory).or_else(checkpoint) {
        Some(name) => Err(format!("{name} is still there")),
        None => Ok(()),
    }
}

/// The contents of all files in a directory and below it, by their names.
pub fn contents(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in names_in(directory) {
        let path = directory.join(&name);
        if path.is_dir() {
            let below = contents(&path).into_iter();
            found.extend(below.map(|(file, bytes)| (format!("{name}/{file}"), bytes)));
        } else {
            found.insert(name, fs::read(&path).expect("a file"));
        }
    }
    found
}

/// Writes a case file into a directory, and returns its path.
pub fn written(place: &Path, text: &str) -> Result<String, String> {
    let path = place.join("case.toml");
    fs::write(&path, text).map_err(|e| e.to_string())?;
    Ok(path.display().to_string())
}

/// Copies the contents of a directory.
pub fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

/// The text of a file.
pub fn text_of(path: impl AsRef<Path>) -> Result<String, String> {
    let path = path.as_ref();
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// The value in a file of JSON.
pub fn json_of(path: impl AsRef<Path>) -> Result<Value, String> {
    let path = path.as_ref();
    serde_json::from_str(&text_of(path)?).map_err(|e| format!("{}: {e}", path.display()))
}

/// The number in a value of JSON; NaN if it is none.
pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// The numbers in an array of JSON.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().map(number).collect()
}

/// The plan in a file of results.
pub fn stored_plan(path: impl AsRef<Path>) -> Result<Value, String> {
    let stored = super::datasets_of(path.as_ref())?;
    let text = String::from_utf8_lossy(&stored.get("/plan").ok_or("no /plan")?.bytes);
    serde_json::from_str(text.trim_end_matches('\0')).map_err(|e| format!("/plan: {e}"))
}
