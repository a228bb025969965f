//! No two types of `src/` have the same name; the table of planted faults names its functions.

use crate::size::files;
use std::collections::BTreeMap;
use std::path::Path;

#[test]
fn no_type_name_is_defined_twice() {
    let mut defined: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in files(Path::new("src"), "rs") {
        if file.file_name().is_some_and(|name| name != "tests.rs") {
            let text = std::fs::read_to_string(&file).expect("a source file");
            for name in type_names(&text) {
                defined.entry(name.to_owned()).or_default().push(file.display().to_string());
            }
        }
    }
    assert!(defined.len() > 300, "only {} types are found", defined.len());
    defined.retain(|_, files| files.len() > 1);
    assert!(defined.is_empty(), "names of more than one type: {defined:#?}");
}

#[test]
fn type_names_are_found() {
    let text = "/// struct No;\npub(crate) struct Row<'a> {\nenum Kind {\npub type Sum = f64;\n    \
                type Error = E;\npub unsafe trait Work {\npub fn f() {\n";
    assert_eq!(type_names(text).collect::<Vec<_>>(), ["Row", "Kind", "Sum", "Work"]);
}

/// Each fault of docs/planted-faults.md can be planted again in the function that it names.
#[test]
fn functions_of_planted_faults_are_there() {
    let table = std::fs::read_to_string("docs/planted-faults.md").expect("the table");
    let mut rows = 0;
    for line in table.lines() {
        // | `file` `Type::function` | …
        let mut quoted = line.split('`').skip(1).step_by(2);
        let (Some(file), Some(function)) = (quoted.next(), quoted.next()) else { continue };
        if !line.starts_with("| `") || !file.ends_with(".rs") {
            continue;
        }
        rows += 1;
        let text = std::fs::read_to_string(Path::new("src").join(file)).expect(file);
        let name = function.rsplit("::").next().unwrap_or(function);
        let is_there = ["(", "<"].iter().any(|end| text.contains(&format!("fn {name}{end}")));
        assert!(is_there, "{file} has no function {function}");
    }
    // Of the first table, and of that of newer code, whose rows may have several faults.
    assert_eq!(rows, 130 + 40);
}

/// Names of the types and traits that are defined outside functions, implementations and inline
/// modules.
fn type_names(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| {
        let mut words =
            line.split(' ').skip_while(|word| word.starts_with("pub") || *word == "unsafe");
        let is_type = ["struct", "enum", "trait", "type"].contains(&words.next()?);
        let name = words.next().filter(|_| is_type)?;
        name.split(|c: char| !c.is_alphanumeric()).next()
    })
}
