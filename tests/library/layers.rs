//! The layers of the sources: no file of `src/` imports from a layer (a folder of `src/`) above its
//! own, and no files import each other in a circle. The map in `src/lib.rs` gives the order.
//!
//! An import is a path that begins with `crate`, `self`, `super` or a child module, in a `use` line
//! or in the code. Comments, strings and unit tests do not count. The import leads to the file of
//! the deepest module in the path.

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A module as its path in the crate: `["matrix", "kernel"]`.
type Module = Vec<String>;

/// The text of each module's file.
type Sources = BTreeMap<Module, String>;

/// For each module, the modules that its file imports.
type Imports = BTreeMap<Module, BTreeSet<Module>>;

/// Layers whose files import each other in a circle.
const LAYERS_WITH_CIRCLES: [&str; 0] = [];

#[test]
fn imports_run_downwards_and_not_in_circles() {
    let sources = sources();
    let layers = layers(&sources[&Module::new()]);
    assert_eq!(layers.len(), 14, "{layers:?}");
    let files: BTreeSet<&str> = sources.keys().filter_map(|m| Some(m.first()?.as_str())).collect();
    let named: BTreeSet<&str> = layers.iter().map(String::as_str).collect();
    assert_eq!(files, named, "the layers of src/ and those of the map");
    let imports = imports(&sources);
    let count: usize = imports.values().map(BTreeSet::len).sum();
    assert!(count > 500, "only {count} imports are found");
    assert_none(&upwards(&imports, &layers), "imports of a layer above");
    for layer in &layers {
        let found = circles(&imports, layer);
        if LAYERS_WITH_CIRCLES.contains(&layer.as_str()) {
            assert!(!found.is_empty(), "{layer} has no circle: take it off the list");
        } else {
            assert_none(&found, "circles");
        }
    }
}

fn assert_none(found: &[String], what: &str) {
    assert!(found.is_empty(), "{} {what}:\n{}", found.len(), found.join("\n"));
}

/// All files of `src/` except for unit tests and `main.rs`, which is a separate crate.
fn sources() -> Sources {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut sources = Sources::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in folder.read_dir().expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let below = path.strip_prefix(&root).expect("a path below src").with_extension("");
            let mut module: Module =
                (below.iter()).map(|part| part.to_string_lossy().into_owned()).collect();
            if module == ["lib"] || module.last().is_some_and(|last| last == "mod") {
                module.pop();
            }
            if module != ["main"] && module.iter().all(|part| part != "tests") {
                let text = std::fs::read_to_string(&path).expect("a source file");
                sources.insert(module, text);
            }
        }
    }
    sources
}

/// The layers of the map from top to bottom, in lines ``//! | `layer` | … |``.
fn layers(first_page: &str) -> Vec<String> {
    let name = |line: &str| {
        let (name, _) = line.strip_prefix("//! | `")?.split_once('`')?;
        Some(name.to_owned())
    };
    first_page.lines().filter_map(name).collect()
}

fn imports(sources: &Sources) -> Imports {
    let of_file = |(module, text): (&Module, &String)| {
        let tokens: TokenStream = text.parse().unwrap_or_else(|e| panic!("{module:?}: {e}"));
        let mut paths = Vec::new();
        collect_paths(tokens, &mut paths);
        let found = paths.into_iter().filter_map(|path| target(sources, module, path));
        (module.clone(), found.filter(|target| target != module).collect())
    };
    sources.iter().map(of_file).collect()
}

/// The module to which a path in the file of `module` leads; none if the path leaves the crate or
/// does not start in it.
fn target(sources: &Sources, module: &Module, path: Vec<String>) -> Option<Module> {
    let mut names = path.into_iter().peekable();
    let mut target = match names.peek()?.as_str() {
        "crate" => Module::new(),
        _ => module.clone(),
    };
    let mut relative = false;
    while let Some(name) = names.next_if(|name| ["crate", "self", "super"].contains(&name.as_str()))
    {
        relative = true;
        if name == "super" {
            target.pop()?;
        }
    }
    for name in names {
        target.push(name);
        if !sources.contains_key(&target) {
            target.pop();
            break;
        }
        relative = true;
    }
    relative.then_some(target)
}

/// Collects all paths in `tokens` with more than one name; `use` trees are expanded, and items that
/// are only compiled for tests are left out.
fn collect_paths(tokens: TokenStream, paths: &mut Vec<Vec<String>>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut k = 0;
    while k < tokens.len() {
        if is_test_attribute(&tokens[k..]) {
            k += 2 + item_length(&tokens[k + 2..]);
            continue;
        }
        match &tokens[k] {
            TokenTree::Ident(_) => k += path_at(&tokens[k..], &[], paths),
            TokenTree::Group(group) => {
                collect_paths(group.stream(), paths);
                k += 1;
            }
            _ => k += 1,
        }
    }
}

/// `#[cfg(test)]`.
fn is_test_attribute(tokens: &[TokenTree]) -> bool {
    let [TokenTree::Punct(hash), TokenTree::Group(attribute), ..] = tokens else {
        return false;
    };
    hash.as_char() == '#' && attribute.stream().to_string().replace(' ', "") == "cfg(test)"
}

/// The number of tokens up to the end of an item: a semicolon, or a block in braces.
fn item_length(tokens: &[TokenTree]) -> usize {
    let ends = |token: &TokenTree| match token {
        TokenTree::Punct(punct) => punct.as_char() == ';',
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        _ => false,
    };
    tokens.iter().position(ends).map_or(tokens.len(), |at| at + 1)
}

/// Adds the path, or the tree of paths, that begins at the first token, after `prefix`. Returns the
/// number of its tokens.
fn path_at(tokens: &[TokenTree], prefix: &[String], paths: &mut Vec<Vec<String>>) -> usize {
    let mut path = prefix.to_vec();
    let mut k = 0;
    loop {
        match tokens.get(k) {
            Some(TokenTree::Ident(name)) => path.push(name.to_string()),
            Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace && k > 0 => {
                let tree: Vec<TokenTree> = group.stream().into_iter().collect();
                let comma = |t: &TokenTree| matches!(t, TokenTree::Punct(p) if p.as_char() == ',');
                for branch in tree.split(comma).filter(|branch| !branch.is_empty()) {
                    path_at(branch, &path, paths);
                }
                return k + 1;
            }
            _ => break,
        }
        k += 1;
        let is_colon =
            |at: usize| matches!(tokens.get(at), Some(TokenTree::Punct(p)) if p.as_char() == ':');
        if !(is_colon(k) && is_colon(k + 1)) {
            break;
        }
        k += 2;
    }
    if path.len() > 1 {
        paths.push(path);
    }
    k.max(1)
}

/// The imports from a layer above.
fn upwards(imports: &Imports, layers: &[String]) -> Vec<String> {
    let height = |module: &Module| {
        let layer = module.first()?;
        layers.iter().rev().position(|name| name == layer)
    };
    let mut found = Vec::new();
    for (module, targets) in imports {
        for target in targets {
            // `lib.rs` is above all layers.
            if let Some(own) = height(module)
                && height(target).is_none_or(|other| other > own)
            {
                found.push(format!("{} imports {}", name(module), name(target)));
            }
        }
    }
    found
}

/// The sets of files of a layer in which imports lead from every file to every other one.
fn circles(imports: &Imports, layer: &str) -> Vec<String> {
    let inside = |module: &&Module| module.first().is_some_and(|first| first == layer);
    let reached: BTreeMap<&Module, BTreeSet<&Module>> = (imports.keys().filter(inside))
        .map(|module| (module, reached(imports, module, &inside)))
        .collect();
    let mut found = BTreeSet::new();
    for (module, there) in &reached {
        let back = |other: &&&Module| reached[**other].contains(module);
        let circle: Vec<String> = there.iter().filter(back).map(|other| name(other)).collect();
        if !circle.is_empty() {
            found.insert(circle.join(", "));
        }
    }
    found.into_iter().collect()
}

/// The modules `inside` the layer to which imports of `module` lead, directly or through others.
fn reached<'a>(
    imports: &'a Imports,
    module: &Module,
    inside: &dyn Fn(&&Module) -> bool,
) -> BTreeSet<&'a Module> {
    let mut reached = BTreeSet::new();
    let mut left: Vec<&Module> = imports[module].iter().filter(inside).collect();
    while let Some(next) = left.pop() {
        if reached.insert(next) {
            left.extend(imports[next].iter().filter(inside));
        }
    }
    reached
}

fn name(module: &Module) -> String {
    format!("crate::{}", module.join("::"))
}

/// Sources in memory: `(module, text)`.
fn planted(files: &[(&str, &str)]) -> Sources {
    let module = |path: &str| path.split("::").map(str::to_owned).collect();
    (files.iter()).map(|(path, text)| (module(path), (*text).to_owned())).collect()
}

fn upper_and_lower() -> Vec<String> {
    ["upper", "lower"].map(str::to_owned).to_vec()
}

#[test]
fn a_planted_import_upwards_is_found() {
    for line in [
        "use crate::upper;",
        "pub use crate::{upper::{self, Thing}, lower::other};",
        "fn f() -> usize { crate::upper::g(1) }",
        "fn f() { assert!(crate::upper::g(1) > 0); }",
        "impl super::super::upper::Thing for X {}",
    ] {
        let sources = planted(&[("upper", ""), ("lower", ""), ("lower::a", line)]);
        let found = upwards(&imports(&sources), &upper_and_lower());
        assert_eq!(found, ["crate::lower::a imports crate::upper"], "{line}");
    }
}

#[test]
fn other_imports_are_accepted() {
    for line in [
        "use crate::lower;\nuse std::fs::{self, File};",
        "//! See [`crate::upper`].\n/// And [`crate::upper::Thing`].\nfn f() {} // crate::upper::g",
        "fn f() -> &'static str { \"crate::upper::g\" }",
        "#[cfg(test)]\nmod tests { use crate::upper::Thing; }",
        "#[cfg(test)]\nuse crate::upper::Thing;\nfn f() {}",
        "pub(crate) fn f() { other::upper::g(); }",
    ] {
        let sources =
            planted(&[("upper", "use crate::lower::a;"), ("lower", ""), ("lower::a", line)]);
        let found = upwards(&imports(&sources), &upper_and_lower());
        assert!(found.is_empty(), "{line}: {found:?}");
    }
}

#[test]
fn a_planted_circle_is_found() {
    let circle = |files: &[(&str, &str)]| circles(&imports(&planted(files)), "layer");
    let two =
        [("layer", ""), ("layer::a", "use crate::layer::b::B;"), ("layer::b", "use super::a::A;")];
    assert_eq!(circle(&two), ["crate::layer::a, crate::layer::b"]);
    let three = [
        ("layer", ""),
        ("layer::a", "use crate::layer::b;"),
        ("layer::b", "fn f() { crate::layer::c::g(); }"),
        ("layer::c", "use crate::layer::a::{A, X};"),
    ];
    assert_eq!(circle(&three), ["crate::layer::a, crate::layer::b, crate::layer::c"]);
    // A parent and its child use each other.
    let family =
        [("layer", "mod child;\nfn f() { child::g(); }"), ("layer::child", "use crate::layer::f;")];
    assert_eq!(circle(&family), ["crate::layer, crate::layer::child"]);
    let straight = [
        ("layer", "pub mod a;\npub mod b;"),
        ("layer::a", "use crate::layer::b::B;"),
        ("layer::b", "fn f() -> crate::layer::b::B {}"),
    ];
    assert!(circle(&straight).is_empty());
}
