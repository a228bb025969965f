//! Hostile input: damaged or malicious HDF5 files, control characters in a case, and grids that are
//! too fine to evaluate. Each job ends soon, with one message.

use crate::support::{
    Job, case, change_hdf5, check_all, copy, directory, ended_by_one_message,
    number_from_environment, of_case, on_results, small_run, soon, text_of,
};
use hdf5::plist::dataset_create::Layout;
use phasewarp::base::checksum::run_checksum;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use tempfile::TempDir;

fn small() -> Job {
    small_run().set(&["exact={f='0'}"])
}

/// A run of all kinds of files.
fn full() -> Job {
    small().set(&["output.warped_field=true", "readout={cells=[[3]]}"])
}

/// Results of a run, with a warped field.
static RESULTS: LazyLock<TempDir> = LazyLock::new(|| {
    let place = directory();
    full().solve(place.path()).expect("a run");
    place
});

/// A copy of these results.
fn copied() -> TempDir {
    let place = directory();
    copy(RESULTS.path(), place.path()).expect("a copy");
    place
}

/// Name of a harmful change, the change of a file, and a text of the message about it.
type Harm = (&'static str, Change, &'static str);
type Change = fn(&hdf5::File) -> hdf5::Result<()>;

fn huge(file: &hdf5::File, name: &str, length: usize) -> hdf5::Result<()> {
    if file.link_exists(name) {
        file.unlink(name)?;
    }
    let dataset = file.new_dataset::<f64>().shape([length]).chunk([1024]).create(name)?;
    dataset.new_attr::<u64>().create("checksum")?.write_scalar(&1)
}

/// Changes the middle value of a dataset, and its checksum to match.
fn plant(file: &hdf5::File, name: &str, value: f64) -> hdf5::Result<()> {
    let dataset = file.dataset(name)?;
    let mut values = dataset.read_dyn::<f64>()?;
    if let Some(middle) = values.iter_mut().nth(dataset.size() / 2) {
        *middle = value;
    }
    dataset.write(&values)?;
    let sum = run_checksum(0, values.iter().map(|v| v.to_bits()));
    dataset.attr("checksum")?.write_scalar(&sum)
}

/// Few numbers in a chunk of 64 MiB of deflated zeros.
fn large_chunk(file: &hdf5::File) -> hdf5::Result<()> {
    let builder = file.new_dataset::<f64>().shape(hdf5::SimpleExtents::resizable([8]));
    let dataset = builder.chunk([1 << 23]).deflate(4).create("zeros")?;
    dataset.write(&[0.0; 8])?;
    dataset.new_attr::<u64>().create("checksum")?.write_scalar(&run_checksum(0, [0; 8].into_iter()))
}

fn nested(file: &hdf5::File) -> hdf5::Result<()> {
    let mut group = file.create_group("g")?;
    for _ in 1..20_000 {
        group = group.create_group("g")?;
    }
    Ok(())
}

fn elsewhere(file: &hdf5::File, name: &str) -> hdf5::Result<()> {
    let shape = file.dataset(name)?.shape();
    file.unlink(name)?;
    let builder = file.new_dataset::<f64>().shape(&shape[..]);
    let whole = || hdf5::Selection::All;
    let dataset = builder
        .layout(Layout::Virtual)
        .virtual_map("other.h5", name, &shape[..], whole(), &shape[..], whole())
        .create(name)?;
    dataset.new_attr::<u64>().create("checksum")?.write_scalar(&1)
}

const HARMS: [Harm; 13] = [
    ("a large chunk", large_chunk, "chunks of 67108864 bytes"),
    ("2^50 numbers", |file| huge(file, "huge", 1 << 50), "0 bytes of it are there"),
    ("2^40 densities", |file| huge(file, "density", 1 << 40), "0 bytes of it are there"),
    ("2^40 points", |file| huge(file, "axis/x", 1 << 40), "0 bytes of it are there"),
    ("nested groups", nested, "groups in each other"),
    ("a soft link to the root", |file| file.link_soft("/", "loop"), "/loop leads elsewhere"),
    ("a hard link to the root", |file| file.link_hard("/", "loop"), "groups in each other"),
    (
        "a link to a file",
        |file| file.link_external("/dev/zero", "/", "far"),
        "/far leads elsewhere",
    ),
    (
        "many groups",
        |file| (0..2000).try_for_each(|k| file.create_group(&format!("g{k}")).map(drop)),
        "objects",
    ),
    ("NaN", |file| plant(file, "f", f64::NAN), "holds NaN"),
    ("infinity", |file| plant(file, "density", f64::INFINITY), "holds inf"),
    ("1e308", |file| plant(file, "axis/vx", 1e308), "holds 1e308"),
    ("a virtual dataset", |file| elsewhere(file, "f"), "in another file"),
];

/// `check-result` refuses each file, and `plot` and `report`, which have the same reader, some of
/// them. `summary.json` has no checksum of the file.
#[test]
fn hostile_results_are_refused() {
    let rows: Vec<(usize, &Harm)> = HARMS.iter().enumerate().collect();
    check_all(&rows, |(k, (what, harm, wording))| {
        let place = copied();
        let path = place.path();
        fs::write(path.join("summary.json"), "{}").map_err(|e| e.to_string())?;
        change_hdf5(&path.join("result.h5"), *harm).map_err(|e| format!("{what}: {e}"))?;
        let commands: &[&str] = match k {
            0 => &["check-result", "plot"],
            9 => &["check-result", "report"],
            _ => &["check-result"],
        };
        for command in commands {
            let finished = on_results(command, path).run()?;
            ended_by_one_message(&finished, &[1, 2], &[wording])
                .map_err(|e| format!("{what}: {e}"))?;
        }
        Ok(())
    });
}

/// A zero length among the texts of the file puts the HDF5 library into an endless loop. Every
/// command that reads them ends the attempt.
#[test]
fn a_file_that_hdf5_never_finishes_reading_is_refused() {
    let place = copied();
    let path = place.path();
    let mut bytes = fs::read(path.join("result.h5")).expect("a file");
    // Texts of any length are in a collection that begins with this mark and its size, 16 bytes in
    // all. The number and the length of the first text follow.
    let mark = bytes.windows(4).position(|word| word == b"GCOL").expect("texts");
    bytes[mark + 16..mark + 32].fill(0);
    fs::write(path.join("result.h5"), bytes).expect("a file");
    fs::write(path.join("summary.json"), "{}").expect("a file");
    let other = directory();
    let continued = Job::new(["run", "--until", "0.31", "--continue"]);
    let from = path.display().to_string();
    let (endless, foreign) = ("result.h5: reading it makes no progress", "not phasewarp's");
    let jobs = [
        (on_results("plot", path), endless),
        (full().with(["--resume"]).into(path), foreign),
        (full().into(path), foreign),
        (continued.with([from]).into(other.path()), endless),
    ];
    check_all(&jobs, |(job, wording)| ended_by_one_message(&job.run()?, &[2], &[wording]));
}

/// A file of the wrong size is not read: each command refuses it as soon as a small one, or
/// computes the run anew.
#[test]
fn files_of_any_size_are_refused_without_reading_them() {
    const BYTES: u64 = 60 << 30;
    let names = [
        "result.h5", "warped_f.h5", "fields.xdmf", "grids.h5", "readout.csv", "space.xdmf",
        "summary.json",
    ];
    check_all(&names, |name| {
        let place = copied();
        let path = place.path();
        let file = fs::File::options().write(true).open(path.join(name));
        file.and_then(|file| file.set_len(BYTES)).map_err(|e| e.to_string())?;
        let named = format!("{name}: ");
        for command in ["check-result", "plot", "report"] {
            let finished = on_results(command, path).run()?;
            ended_by_one_message(&finished, &[1], &[&named, &format!("{BYTES} bytes")])?;
        }
        let again = full().with(["--resume"]).into(path).succeed()?;
        soon(&again)?;
        again.contains(&again.errors, &["is damaged and is computed anew", &named])?;
        on_results("check-result", path).succeed().map(drop)
    });
}

/// A file with some changed words is refused, or drawn if they have no meaning, within the time
/// limit. `PHASEWARP_FUZZ=1000 cargo test --release --test cli changed_words` tries 1000 files.
#[test]
fn changed_words_of_results_are_refused_or_drawn() {
    let first = number_from_environment("PHASEWARP_FUZZ_FIRST", 0);
    let trials = first..first + number_from_environment("PHASEWARP_FUZZ", 12);
    let trials: Vec<u64> = trials.collect();
    let whole = fs::read(RESULTS.path().join("result.h5")).expect("a file");
    let drawn = AtomicU64::new(0);
    check_all(&trials, |&trial| {
        let place = copied();
        let mut random = ChaCha8Rng::seed_from_u64(trial);
        let mut below = |n: usize| (random.next_u64() % n as u64) as usize;
        let mut bytes = whole.clone();
        for _ in 0..=below(4) {
            // Half of the changes are at the beginning of the file, in its structure.
            let end = [bytes.len(), 4096][below(2)];
            let length = [1, 2, 4, 8, 512][below(5)];
            let at = below(end - length);
            let value = [0, 1, 0x7f, 0xff, below(256) as u8][below(5)];
            bytes[at..at + length].fill(value);
        }
        fs::write(place.path().join("result.h5"), bytes).map_err(|e| e.to_string())?;
        fs::write(place.path().join("summary.json"), "{}").map_err(|e| e.to_string())?;
        let finished = on_results("plot", place.path()).run()?;
        if finished.code == Some(0) {
            drawn.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        ended_by_one_message(&finished, &[1, 2], &[]).map_err(|e| format!("trial {trial}: {e}"))
    });
    println!("{} of {} drawn", drawn.into_inner(), trials.len());
}

/// `check-result` finds a change of any byte of any file, also in attributes and in the structure
/// of HDF5.
#[test]
fn every_changed_byte_is_found() {
    const EACH: usize = 2;
    let mut rows = Vec::new();
    for name in [
        "result.h5", "warped_f.h5", "summary.json", "fields.xdmf", "grids.h5", "space.xdmf",
        "readout.csv",
    ] {
        rows.extend((0..EACH).map(|k| (name, k)));
    }
    check_all(&rows, |&(name, k)| {
        let place = copied();
        let path = place.path().join(name);
        let mut bytes = fs::read(&path).map_err(|e| e.to_string())?;
        // One change is near the beginning of the file. White space of the summary has no meaning.
        let mut at = bytes.len() * (2 * k + 1) / if k == 0 { 40 } else { 2 * EACH };
        while bytes[at].is_ascii_whitespace() {
            at += 1;
        }
        bytes[at] ^= 1;
        fs::write(&path, bytes).map_err(|e| e.to_string())?;
        let finished = on_results("check-result", place.path()).run()?;
        ended_by_one_message(&finished, &[1], &[name]).map_err(|e| format!("byte {at}: {e}"))
    });
    let whole = on_results("check-result", RESULTS.path());
    whole.succeed().expect("nothing is changed");
}

/// A run refuses to start from a malicious warped field.
#[test]
fn hostile_warped_fields_are_refused() {
    fn far(file: &hdf5::File) -> hdf5::Result<()> {
        let axis = file.dataset("axis/p")?;
        let count = axis.size();
        let far: Vec<f64> = (0..count).map(|j| (j as f64 - 3.0) * 1e299).collect();
        axis.write(&far)
    }
    const HARMS: [Harm; 6] = [
        ("2^40 points", |file| huge(file, "axis/p", 1 << 40), "0 bytes of it are there"),
        ("NaN", |file| plant(file, "w", f64::NAN), "/w is NaN"),
        ("infinity", |file| plant(file, "w", f64::INFINITY), "/w is inf"),
        ("1e308", |file| plant(file, "w", 1e308), "1e308"),
        ("an axis to 1e300", far, "/axis/p goes from"),
        ("a virtual dataset", |file| elsewhere(file, "w"), "in another file"),
    ];
    check_all(&HARMS, |(what, harm, wording)| {
        let place = copied();
        let start = place.path().join("warped_f.h5");
        change_hdf5(&start, *harm).map_err(|e| format!("{what}: {e}"))?;
        let from = format!("initial={{warped='{}'}}", start.display());
        let finished = small().set(&[&from]).into(&place.path().join("out")).run()?;
        ended_by_one_message(&finished, &[2], &[wording]).map_err(|e| format!("{what}: {e}"))
    });
}

/// Control characters in a title, a formula or a name are not copied to the terminal or to files.
#[test]
fn control_characters_of_a_case_are_not_printed() {
    const OBEYED: [char; 5] = ['\u{1b}', '\u{7}', '\u{9b}', '\u{202e}', '\u{2066}'];
    let none = |what: &str, text: &str| {
        let found = text.chars().find(|c| OBEYED.contains(c));
        assert!(found.is_none(), "{what}: {found:?} in {text}");
    };
    let place = directory();
    let path = place.path();
    let hostile = r#""a\u001b[31m\u0007b\u009b2J\u202ec\u2066""#;
    let title = format!("title={hostile}");
    let run = small().set(&[&title]).with(["-v"]).into(path).succeed().expect("a run");
    none("run", &(run.output + &run.errors));
    let at = path.display().to_string();
    for command in ["plot", "report"] {
        let done = Job::new([command, &at]).succeed().expect("an end");
        none(command, &(done.output + &done.errors));
    }
    let exports = ["export-matrix", "export-quantum"].map(|command| {
        let small = ["axis.0.x.cells=8", "axis.0.v.cells=4", "solver.tolerance=1e-2", &title];
        let folder = path.join(command);
        of_case(command, "example1.toml").set(&small).into(&folder).succeed().expect("an export");
        folder
    });
    let mut texts = 0;
    for folder in [path.to_owned(), path.join("plots")].into_iter().chain(exports) {
        for entry in fs::read_dir(folder).expect("a directory") {
            let name = entry.expect("an entry").path();
            let ending = name.extension().and_then(|e| e.to_str()).unwrap_or_default();
            if ["html", "svg", "xdmf", "json", "csv", "mtx"].contains(&ending) {
                none(&name.display().to_string(), &text_of(&name).unwrap());
                texts += 1;
            }
        }
    }
    assert!(texts > 8, "{texts} texts");
    for setting in ["potential.0.where", "solver.warp.profile", "initial.f"] {
        let job = of_case("check", "example1.toml");
        let refused = job.set(&[&format!("{setting}={hostile}")]).run().expect("an end");
        assert_eq!(refused.code, Some(2), "{}", refused.report(setting));
        none(setting, &refused.errors);
    }
}

/// A budget also limits the evaluation of the case on its grid.
#[test]
fn evaluating_a_fine_grid_is_limited_by_the_budget() {
    let place = directory();
    let fine = ["axis.0.x.cells=9000", "axis.1.x.cells=9000"];
    let coarse = ["axis.0.v.cells=2", "axis.1.v.cells=2"];
    let at = |command: &str| Job::new([command, &case("barrier2d.toml"), "--budget", "1s"]);
    let stability = at("stability").into(place.path()).set(&fine).set(&coarse).run();
    let stability = stability.expect("an end");
    ended_by_one_message(&stability, &[2], &["evaluating V and bounds on 8.100e7 cells of space"])
        .unwrap();
    let long = |command: &str| {
        let job = of_case(command, "example1.toml").with(["--budget", "2s"]);
        job.set(&["axis.0.x.cells=4000000", "axis.0.v.cells=8"])
    };
    for job in [long("advise").with(["--accuracy", "0.1"]), long("chart").into(place.path())] {
        ended_by_one_message(&job.run().expect("an end"), &[2], &["--budget 2 s: "]).unwrap();
    }
    let square = ["axis.0.x.cells=4000", "axis.0.v.cells=4000"];
    // Nothing is begun that is expected to take longer than the budget.
    let short = |command| of_case(command, "example1.toml").with(["--budget", "1s"]).set(&square);
    let chart = short("chart").into(place.path()).run().expect("an end");
    ended_by_one_message(&chart, &[2], &["--budget 1 s: a run on 1000 x 1000"]).unwrap();
    let advice = short("advise").with(["--accuracy", "0.1"]).run().expect("an end");
    for finished in [chart, advice] {
        let used = finished.processor_seconds;
        assert!(used < 2.0, "{}", finished.report(&format!("{used:.1} s of a processor")));
    }
    // An algorithm that visits every line of the grid for each line would take minutes.
    let check = of_case("plan", "example1.toml").set(&square);
    check.succeed().expect("a plan");
}

/// A pipe with the name of a file is refused; the program does not wait for its data.
#[test]
fn a_pipe_in_the_place_of_a_file_is_refused() {
    let pipe = |path: &Path| {
        let made = std::process::Command::new("mkfifo").arg(path).status();
        assert!(made.is_ok_and(|status| status.success()));
    };
    let place = copied();
    let summary = place.path().join("summary.json");
    fs::remove_file(&summary).expect("a file");
    pipe(&summary);
    let at = place.path().display().to_string();
    let finished = Job::new(["check-result", &at]).run().expect("an end");
    ended_by_one_message(&finished, &[1], &["summary.json"]).unwrap();
    // The error of a field from which a run starts is not known without its summary.
    let other = directory();
    let from = format!("initial.field='{at}/result.h5'");
    let later = small().set(&[&from, "time.start=0.3", "time.end=0.31"]).into(other.path());
    let later = later.succeed().expect("a run");
    let unknown = "error inherited from before t = 0.3: not known";
    later.contains(&later.output, &[unknown]).unwrap();
    // A checkpoint with a pipe in it is not complete.
    let checkpoint = directory();
    let generation = checkpoint.path().join("checkpoint/000001");
    fs::create_dir_all(&generation).expect("a directory");
    pipe(&generation.join("manifest.json"));
    let resumed = small().with(["--resume"]).into(checkpoint.path()).succeed().expect("a run");
    assert!(resumed.printed.contains("is not complete"), "{}", resumed.report("a warning"));
}
