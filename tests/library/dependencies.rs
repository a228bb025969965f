//! Licences, sources and duplicates of the dependencies are those that deny.toml allows. Advisories
//! need the network: `make deny`.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// What cargo prints with these arguments.
fn printed_by(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().expect("cargo and rustc start");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

fn table(path: &str) -> toml::Table {
    let text = std::fs::read_to_string(path).expect("a file of this repository");
    text.parse().expect("TOML")
}

fn words(list: &toml::Value) -> BTreeSet<&str> {
    list.as_array().into_iter().flatten().filter_map(toml::Value::as_str).collect()
}

/// Whether an SPDX expression holds with the `allowed` licences: `A OR B`, with `A/B` for it in old
/// manifests, and `(A OR B) AND C`.
fn is_allowed(expression: &str, allowed: &BTreeSet<&str>) -> bool {
    expression.split(" AND ").all(|all| {
        let any = all.strip_prefix('(').and_then(|all| all.strip_suffix(')')).unwrap_or(all);
        any.replace('/', " OR ").split(" OR ").any(|licence| allowed.contains(licence))
    })
}

/// Every dependency of this platform has a licence that is allowed and comes from the registry.
#[test]
fn dependencies_have_allowed_licences() {
    let deny = table("deny.toml");
    let allowed = words(&deny["licenses"]["allow"]);
    let version = printed_by("rustc", &["-vV"]);
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).expect("a host");
    let arguments = ["metadata", "--format-version=1", "--locked", "--offline", "--all-features"];
    let arguments = [&arguments[..], &["--filter-platform", host]].concat();
    let cargo = std::env::var("CARGO").unwrap_or("cargo".to_owned());
    let found: Value = serde_json::from_str(&printed_by(&cargo, &arguments)).expect("JSON");
    let packages = found["packages"].as_array().expect("packages");
    assert!(packages.len() > 50, "{} packages", packages.len());
    for package in packages.iter().filter(|package| package["name"] != "phasewarp") {
        let licence = package["license"].as_str().unwrap_or_default();
        assert!(is_allowed(licence, &allowed), "{}: {licence:?}", package["name"]);
        let source = package["source"].as_str().unwrap_or_default();
        assert!(source.starts_with("registry+"), "{}: {source:?}", package["name"]);
    }
}

/// No crate is there in two versions, but for those that deny.toml names, and these are.
#[test]
fn dependencies_have_one_version() {
    let (deny, lock) = (table("deny.toml"), table("Cargo.lock"));
    let mut versions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for package in lock["package"].as_array().expect("packages") {
        let of = |key: &str| package[key].as_str().expect("a text");
        versions.entry(of("name")).or_default().push(of("version"));
    }
    // `crate = "name@1"`: the older version begins with 1.
    for skipped in deny["bans"]["skip"].as_array().expect("a list") {
        let (name, older) =
            skipped["crate"].as_str().and_then(|c| c.split_once('@')).expect("NAME@VERSION");
        let all = versions.get_mut(name).unwrap_or_else(|| panic!("{name} is no dependency"));
        let before = all.len();
        all.retain(|version| !version.starts_with(&format!("{older}.")));
        assert_eq!(all.len() + 1, before, "{name}@{older}: {all:?}");
    }
    versions.retain(|_, versions| versions.len() > 1);
    assert!(versions.is_empty(), "{versions:?}");
}

#[test]
fn licences_are_compared_as_spdx_expressions() {
    let allowed = BTreeSet::from(["MIT", "Unicode-3.0"]);
    for licence in ["MIT", "GPL-3.0 OR MIT", "Unlicense/MIT", "(MIT OR X) AND Unicode-3.0"] {
        assert!(is_allowed(licence, &allowed), "{licence}");
    }
    for licence in
        ["", "GPL-3.0", "MIT WITH X", "MIT AND X", "(X OR Y) AND MIT", "(MIT AND X) OR Y"]
    {
        assert!(!is_allowed(licence, &allowed), "{licence}");
    }
}
