//! The table of `unsafe` blocks in docs/reliability.md names every file of `src/` that has any, and
//! how many.

use crate::size::files;
use std::collections::BTreeMap;
use std::path::Path;

/// The `unsafe` blocks in the code of a text; comments do not count.
fn blocks(text: &str) -> usize {
    let code = text.lines().filter_map(|line| line.split("//").next());
    code.map(|line| line.matches("unsafe {").count()).sum()
}

#[test]
fn unsafe_blocks_are_listed() {
    let page = std::fs::read_to_string("docs/reliability.md").expect("a page");
    let section = page.split("\n## `unsafe`\n").nth(1).expect("a section");
    let section = section.split("\n## ").next().unwrap_or_default();
    let mut listed: BTreeMap<String, usize> = BTreeMap::new();
    let mut all = 0;
    // | number | `file` `file` … | what for |
    for line in section.lines().filter(|line| line.starts_with("| ")) {
        let mut columns = line.split('|').map(str::trim).skip(1);
        let number = columns.next().and_then(|number| number.parse::<usize>().ok());
        let (Some(number), Some(names)) = (number, columns.next()) else { continue };
        let names = names.split('`').skip(1).step_by(2);
        let of_file = |name: &str| {
            let path = format!("src/{name}");
            blocks(&std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}")))
        };
        let found: Vec<(String, usize)> =
            names.map(|name| (name.to_owned(), of_file(name))).collect();
        let sum: usize = found.iter().map(|(_, count)| count).sum();
        assert_eq!(sum, number, "{line}\nhas {found:?}");
        all += number;
        listed.extend(found);
    }
    let sources = files(Path::new("src"), "rs").into_iter().filter_map(|path| {
        let count = blocks(&std::fs::read_to_string(&path).expect("a source file"));
        let name = path.strip_prefix("src").expect("a path below src").display().to_string();
        (count > 0).then_some((name, count))
    });
    assert_eq!(listed, sources.collect());
    assert!(section.contains(&format!("There are {all} blocks")), "there are {all} blocks");
}

#[test]
fn unsafe_blocks_are_found() {
    let text = "// unsafe { }\nlet a = unsafe { f() };\nsync(|| unsafe {\nunsafe fn f() {\n";
    assert_eq!(blocks(text), 2);
}
