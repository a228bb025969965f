//! Reads the case of a command, and names the default directory of its results.

use crate::base::checksum;
use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::command::cli::{CaseArgs, Changes, Mode};
use crate::parallel::communicator::World;
use crate::problem::case::file::keys_of;
use crate::problem::case::reader::{is_within, key_of, number_of};
use crate::problem::case::{self, Case};
use crate::problem::exported::ExportOwner;
use crate::results::dataset::RESULT;
use crate::results::table_file::{checksum_name, file_name, with_tables};
use crate::results::untrusted;
use crate::solve::checkpoint::store;
use crate::study::files::refuse_to_replace_study;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Reads the case file and the tables that it names on rank 0, for all ranks. Collective.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read; as [`Case::parse`] and [`with_tables`], the
/// same on all ranks.
pub fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let text = load_text(world, &args.case)?;
    let case = Case::parse(&args.case.display().to_string(), &text, &overrides(&args.changes))?;
    Ok(with_tables(&world.group(), &case)?.into_owned())
}

/// Reads the text of a case file on rank 0, for all ranks. Collective.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read, the same on all ranks.
pub fn load_text(world: &World, path: &Path) -> Result<String> {
    world.group().of_first_rank(|| case::read_text(path))
}

/// The `--set` options that make these changes.
fn overrides(changes: &Changes) -> Vec<String> {
    let mode = (changes.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    changes.set.iter().cloned().chain(mode).collect()
}

/// The case of a run that continues from the results in a directory.
#[derive(Serialize, Deserialize)]
struct Continuation {
    /// The name of its case file.
    name: String,
    /// The case file.
    text: String,
    /// The `--set` options.
    overrides: Vec<String>,
    /// Keys of the first part that are left out.
    left_out: Vec<String>,
    /// The key for whose change the exact solution is left out.
    without_exact: Option<String>,
    /// Checksums of the tables of the first part that the second part reads too, by key.
    tables: BTreeMap<String, String>,
}

/// Keys of a continued run that DIR and `--until` give.
const KEYS_OF_CONTINUATION: [&str; 3] = ["initial.field", "time.start", "time.end"];
/// Keys that list output times of the first part.
const KEYS_OF_TIMES: [&str; 2] = ["output.moment_times", "output.field_times"];
/// Beginnings of the keys on which the exact solution by characteristics depends.
const KEYS_OF_PATHS: [&str; 5] = ["potential", "inflow", "constants", "initial", "axis"];
/// Ends of keys of axes on which it does not depend, or which a continued run cannot change.
const KEYS_OF_GRID: [&str; 4] = [".cells", ".degree", ".lower", ".upper"];
/// Keys by which a part chooses its own exact solution.
const KEYS_OF_EXACT: [&str; 3] = ["exact", "exact.kind", "exact.f"];

/// The case of the results in `directory`, from their time until `until`, changed by `changes`.
/// `until` is a number or a formula of the constants of the case. Every dataset there is compared
/// with its checksum. Collective.
///
/// # Errors
/// [`Error::Input`] if there is no finished result, or `until` is not later; [`Error::Output`] if
/// the result is damaged.
pub fn load_continued(
    world: &World,
    directory: &Path,
    until: &str,
    changes: &Changes,
) -> Result<Case> {
    let group = world.group();
    let found = group.of_first_rank(|| continuation(directory, until, changes))?;
    let case = Case::parse(&found.name, &found.text, &found.overrides)?;
    if group.is_first() && !found.left_out.is_empty() {
        let keys = found.left_out.join(" and ");
        eprint_wrapped(&format!("--continue: {keys} left out; they list times of the first part"));
    }
    if let (true, Some(key)) = (group.is_first(), &found.without_exact) {
        eprint_wrapped(&format!(
            "--continue: exact left out, as --set {key} may change the case: characteristics would \
             be traced back to t = 0 with the new one"
        ));
    }
    let case = with_tables(&group, &case)?.into_owned();
    for file in &case.tables {
        let (key, sum) = (file.of.key(), file.checksum.map(checksum::text));
        if found.tables.get(&key).is_some_and(|before| sum.as_ref() != Some(before)) {
            return Err(Error::Input(format!(
                "--continue {}: {key}.file = \"{}\" has changed since the first part; \
                 --set {key}.file=… takes the other values on purpose",
                directory.display(),
                file.path.display()
            )));
        }
    }
    Ok(case)
}

/// The result in `directory` that a run continues from. Not collective.
fn continuation(directory: &Path, until: &str, changes: &Changes) -> Result<Continuation> {
    let wrong = |what: &dyn std::fmt::Display| {
        Error::Input(format!("--continue {}: {what}", directory.display()))
    };
    let stored = untrusted::open(directory)?;
    if store::is_begun(directory) {
        return Err(wrong(&"a run there is not finished; --resume finishes it"));
    }
    stored.summary.as_ref().map_err(|e| wrong(e))?;
    let case = stored.case.as_ref().map_err(|e| wrong(e))?;
    let time = stored.time;
    let own = overrides(changes);
    let given: BTreeSet<String> = own.iter().flat_map(|set| keys_of(set)).collect();
    let keys: Vec<&str> = given.iter().map(String::as_str).collect();
    let until = end_time(until, case, time, &keys)
        .map_err(|what| wrong(&format!("--until {until}: {what}")))?;
    if let Some(key) = keys.iter().find(|key| KEYS_OF_CONTINUATION.contains(key)) {
        return Err(wrong(&format!(
            "--set {key}: that follows from DIR and --until; leave it out"
        )));
    }
    if case.is_measure_valued() {
        return Err(wrong(&format!(
            "measure-valued data are several fields, and a run continues from /f only; run its \
             case again with --set time.end={until}"
        )));
    }
    if case.warped_start.is_some() && !keys.iter().any(|key| key.starts_with("initial")) {
        return Err(wrong(&format!(
            "its run began from initial.warped, so that the formula of f at t = 0 is not known, \
             which a continued run needs; run its case again with --set time.end={until}"
        )));
    }
    let path = std::fs::canonicalize(directory.join(RESULT)).map_err(|e| wrong(&e))?;
    let path = path.to_str().ok_or_else(|| wrong(&"its path is no UTF-8 text"))?;
    let is_given =
        |key: &&str| case.settings.keys().any(|k| k.starts_with(*key)) && !keys.contains(key);
    let left_out: Vec<String> =
        KEYS_OF_TIMES.iter().filter(|key| is_given(key)).map(|key| (*key).to_owned()).collect();
    let is_traced = case.traces_exact() && !keys.iter().any(|key| KEYS_OF_EXACT.contains(key));
    let without_exact = keys.iter().filter(|_| is_traced).find(|key| changes_paths(key));
    let without_exact = without_exact.map(|key| (*key).to_owned());
    let before = stored.overrides.iter().cloned();
    let before = before.filter(|set| !KEYS_OF_CONTINUATION.contains(&key_of(set).as_str()));
    let (files, tables) = carried_tables(case, &stored.provenance, &keys);
    let overrides = before
        .chain(files)
        .chain(left_out.iter().map(|key| format!("{key}=[]")))
        .chain(without_exact.iter().map(|_| "exact={}".to_owned()))
        .chain(own)
        .chain([
            format!("initial.field={}", serde_json::Value::from(path)),
            format!("time.start={time:?}"),
            format!("time.end={until:?}"),
        ])
        .collect();
    let name = stored.provenance.get("case_file").map_or("case", String::as_str).to_owned();
    Ok(Continuation { name, text: stored.text, overrides, left_out, without_exact, tables })
}

/// Whether the exact solution by characteristics depends on a key.
fn changes_paths(key: &str) -> bool {
    KEYS_OF_PATHS.iter().any(|start| key.starts_with(start))
        && !KEYS_OF_GRID.iter().any(|end| key.ends_with(end))
}

/// The end of a run that continues the results of `case` at `time`. `keys` are changed.
///
/// # Errors
/// What is wrong with `until`.
fn end_time(
    until: &str,
    case: &Case,
    time: f64,
    keys: &[&str],
) -> std::result::Result<f64, String> {
    if until.parse::<f64>().is_err() && keys.iter().any(|key| key.starts_with("constants")) {
        return Err("a formula of constants that --set changes; a number expected".into());
    }
    let until = number_of(until, &case.constants)?;
    if !(until > time && until.is_finite()) {
        return Err(format!("its results are at t = {time}; a later time expected"));
    }
    Ok(until)
}

/// The `--set` options of the tables of `case` that a continued run reads too, as none of `keys`
/// changes them, and their checksums by key. The stored path replaces that of the case file, which
/// is relative to another directory.
fn carried_tables(
    case: &Case,
    provenance: &BTreeMap<String, String>,
    keys: &[&str],
) -> (Vec<String>, BTreeMap<String, String>) {
    let mut files = Vec::new();
    let mut tables = BTreeMap::new();
    for of in case.tables.iter().map(|file| file.of) {
        let key = of.key();
        let is_kept = !keys.iter().any(|set| is_within(&key, set) || is_within(set, &key));
        let known = [file_name(of), checksum_name(of)].map(|name| provenance.get(&name));
        if let (true, [Some(path), Some(sum)]) = (is_kept, known) {
            files.push(format!("{key}.file={}", serde_json::Value::from(path.as_str())));
            tables.insert(key, sum.clone());
        }
    }
    (files, tables)
}

/// `DIR-until-TIME`: the default directory of a continued run.
pub fn default_directory_until(directory: &Path, until: f64) -> PathBuf {
    // `components` drops a slash at the end; `.` and `..` are replaced by the directory's name.
    let path: PathBuf = directory.components().collect();
    let path = match path.file_name() {
        Some(_) => path,
        None => std::fs::canonicalize(&path).unwrap_or(path),
    };
    let mut name = path.into_os_string();
    name.push(format!("-until-{until}"));
    name.into()
}

/// `results/NAME` of the case file.
pub fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

/// `results/NAME-what`.
pub fn default_directory_of(case: &str, what: &str) -> PathBuf {
    let mut name = default_directory(case).into_os_string();
    name.push(format!("-{what}"));
    name.into()
}

/// Makes the directory of a study of the case file `case`: `output`, or `results/NAME-what`. Fails
/// before minutes are spent on measurements if it holds files of another case and `force` is not
/// given. Collective.
///
/// # Errors
/// As [`refuse_to_replace_study`] and [`disk::make`], the same on all ranks.
pub fn make_study_directory(
    world: &World,
    output: Option<&PathBuf>,
    owner: &ExportOwner,
    case: &str,
    force: bool,
) -> Result<PathBuf> {
    let by_default = || default_directory_of(case, &owner.export.word());
    let directory = output.cloned().unwrap_or_else(by_default);
    world.group().on_first_rank(|| {
        if !force {
            refuse_to_replace_study(&directory, owner)?;
        }
        disk::make(&directory)
    })?;
    Ok(directory)
}
