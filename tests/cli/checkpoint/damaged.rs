//! Checkpoints that are damaged, missing, from another run, or cannot be written.

use super::{
    Fault, OFTEN, WHOLE, count, generations, io, manifest, run, same, stopped, with_fault,
};
use crate::support::{
    Job, Summary, case, check_all, copy, datasets, differences, directory_on_disk as directory,
    of_case,
};
use phasewarp::matrix::instruction_set::{INSTRUCTION_SET_VARIABLE, InstructionSet};
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

/// Name of a damage, a function that damages the newest of two generations of a checkpoint on two
/// ranks, and a part of the message about it.
type Damage = (&'static str, fn(&Path, &Path) -> std::io::Result<()>, &'static str);

const DAMAGES: [Damage; 10] = [
    (
        "truncated",
        |newest, _| {
            let path = newest.join("rank-00001.bin");
            let bytes = fs::read(&path)?;
            fs::write(path, &bytes[..bytes.len() / 2])
        },
        "were written",
    ),
    (
        "a bit flipped",
        |newest, _| {
            let path = newest.join("rank-00001.bin");
            let mut bytes = fs::read(&path)?;
            let middle = bytes.len() * 2 / 3;
            bytes[middle] ^= 4;
            fs::write(path, bytes)
        },
        "checksum",
    ),
    (
        "a bit of the header flipped",
        |newest, _| {
            let path = newest.join("rank-00000.bin");
            let mut bytes = fs::read(&path)?;
            bytes[100] ^= 1;
            fs::write(path, bytes)
        },
        "checksum",
    ),
    ("empty", |newest, _| fs::write(newest.join("rank-00000.bin"), b""), "0 bytes"),
    ("missing", |newest, _| fs::remove_file(newest.join("rank-00001.bin")), "No such file"),
    (
        "ranks swapped",
        |newest, _| {
            let [a, b] = ["rank-00000.bin", "rank-00001.bin"].map(|name| newest.join(name));
            let kept = fs::read(&a)?;
            fs::copy(&b, &a)?;
            fs::write(&b, kept)
        },
        "rank-0000",
    ),
    (
        "a file of the older generation",
        |newest, older| {
            fs::copy(older.join("rank-00001.bin"), newest.join("rank-00001.bin")).map(|_| ())
        },
        "rank-00001.bin",
    ),
    (
        "the manifest of the older generation",
        |newest, older| {
            fs::copy(older.join("manifest.json"), newest.join("manifest.json")).map(|_| ())
        },
        "manifest.json is that of",
    ),
    (
        "a number of the manifest changed",
        |newest, _| {
            let path = newest.join("manifest.json");
            let text = fs::read_to_string(&path)?;
            fs::write(path, text.replacen("\"stage\": 0", "\"stage\": 1", 1))
        },
        "not as it was written",
    ),
    (
        "a manifest of 3 GB",
        |newest, _| {
            let file = fs::File::options().write(true).open(newest.join("manifest.json"))?;
            file.set_len(3 << 30)
        },
        "manifest.json: 3221225472 bytes; at most 67108864 are read",
    ),
];

#[test]
fn damaged_checkpoints_are_refused_and_the_older_one_used() {
    LazyLock::force(&WHOLE);
    let sound = stopped(2).expect("a stopped run");
    // Continued alone and on two ranks, by turn.
    let rows: Vec<(usize, &Damage)> = DAMAGES.iter().enumerate().collect();
    check_all(&rows, |(k, (what, damage, printed))| {
        let directory = directory();
        let path = directory.path();
        io(copy(sound.path(), path))?;
        let [newest, older] = &generations(path)[..] else {
            return Err(format!("{what}: two generations expected"));
        };
        io(damage(newest, older))?;
        let older_done = manifest(older)?["matvecs"].as_u64();
        let finished = run().on(1 + k % 2).into(path).with(["--resume"]).succeed()?;
        let name = newest.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        if !(finished.errors.contains(printed) && finished.errors.contains(name)) {
            return Err(finished.report(&format!("{what}: \"{printed}\" expected")));
        }
        let summary = Summary::read(finished, path)?;
        same(path, &summary)?;
        let here = count(&summary, "matvecs_here")?;
        summary.require(older_done == Some((WHOLE.1 - here) as u64), || {
            format!("{what}: the older generation was not used")
        })
    });
}

#[test]
fn without_a_valid_checkpoint_a_run_does_not_go_on() {
    let sound = stopped(2).expect("a stopped run");
    let unfinished = sound.path().to_str().expect("a path");
    let finished = Job::new(["check-result", unfinished]).run().expect("a run");
    assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
    assert!(finished.errors.contains("--resume"), "{}", finished.errors);
    // Both generations are damaged.
    let directory = directory();
    io(copy(sound.path(), directory.path())).expect("a copy");
    for generation in generations(directory.path()) {
        fs::write(generation.join("rank-00000.bin"), b"").expect("a file");
    }
    let go_on = |job: Job, path: &Path| job.into(path).with(["--resume"]).run().expect("a run");
    let finished = go_on(run().on(3), directory.path());
    assert_eq!(finished.code, Some(1), "{}", finished.report("refused"));
    assert!(finished.errors.contains("without --resume"), "{}", finished.errors);
    // The checkpoint of another case.
    let finished = go_on(run().set(&["time.end=0.9"]), sound.path());
    assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
    assert!(finished.errors.contains("time.end is 1 there, 0.9 here"), "{}", finished.errors);
    // Where one of them is damaged, nobody knows whether the case is another one.
    let directory = self::directory();
    io(copy(sound.path(), directory.path())).expect("a copy");
    let newest = generations(directory.path()).remove(0);
    fs::write(newest.join("manifest.json"), b"{}").expect("a file");
    let finished = go_on(run().set(&["time.end=0.9"]), directory.path());
    assert_eq!(finished.code, Some(1), "{}", finished.report("refused"));
    // The checkpoint of a processor that rounds differently.
    if InstructionSet::here() != InstructionSet::Generic {
        let other = run().environment(INSTRUCTION_SET_VARIABLE, InstructionSet::Generic.name());
        let finished = go_on(other, sound.path());
        assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
        let printed = finished.errors.contains("was computed with fused multiply-adds");
        assert!(printed, "{}", finished.errors);
    }
    let alpha = ["solver.warp.alpha=1 - p/1e6"];
    let finished = go_on(run().set(&alpha), sound.path());
    assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
    let wording = "solver.warp.alpha is not given there, \"1 - p/1e6\" here";
    assert!(finished.errors.contains(wording), "{}", finished.errors);
    // The same case, written and stored in another way, is continued.
    let differently = [
        "axis.0.v.cells=24", "output.compression=1", "output.xdmf=true", "checkpoint.minutes=7",
        "solver.tolerance=0.001", "title=another",
    ];
    let copied = self::directory();
    io(copy(sound.path(), copied.path())).expect("a copy");
    let finished = go_on(run().set(&differently), copied.path());
    assert_eq!(finished.code, Some(0), "{}", finished.report("goes on"));
    let printed = finished.errors.contains("going on from");
    assert!(printed, "{}", finished.errors);
    let found = datasets(copied.path()).expect("datasets");
    assert_eq!(found["/f"], WHOLE.0["/f"]);
    // Without any checkpoint, the run starts from the beginning.
    let empty = self::directory();
    let finished = go_on(run(), empty.path());
    assert_eq!(finished.code, Some(0), "{}", finished.report("done"));
    assert!(finished.errors.contains("starts from its beginning"), "{}", finished.errors);
    // Without --resume, the run starts from the beginning, with a warning.
    let finished = run().into(sound.path()).succeed().expect("a run");
    assert!(finished.errors.contains("replaces it"), "{}", finished.errors);
    assert!(!sound.path().join("checkpoint").exists());
}

#[test]
fn a_run_from_a_file_does_not_go_on_from_another() {
    let files = directory();
    let grid = [
        "axis.0.x.cells=24",
        "axis.0.v.cells=18",
        "scheme.interface=conservative",
        "solver.tolerance=1e-2",
        "exact={f='0'}",
    ];
    let field = |name: &str, settings: &[&str]| {
        let place = files.path().join(name);
        let job = Job::new(["run", &case("example1.toml"), "--mode", "full"]).set(&grid);
        // The run that starts from it takes longer, and needs a longer period.
        let profile = ["solver.warp.profile=exponential", "solver.warp.interval=[-4,28]"];
        let job = job.set(&profile).set(&["time.end=0.1"]);
        job.set(settings).solve(&place).expect("a warped field");
        place.join("warped_f.h5")
    };
    let points = "solver.warp.points=1024";
    let written = field("first", &[points]);
    let others =
        [field("values", &[points, "time.end=0.2"]), field("points", &["solver.warp.points=1280"])];
    let start = files.path().join("start.h5");
    fs::copy(&written, &start).expect("a copy");
    let from = format!("initial={{warped='{}'}}", start.display());
    let run = || of_case("run", "example1.toml").set(&grid).set(&[&from]);
    let cut = directory();
    let path = cut.path();
    let job = run().on(2).set(&[OFTEN]).into(path);
    let finished =
        with_fault(&job, Fault::Signal, |_| generations(path).len() == 2).expect("a run");
    assert_eq!(finished.code, Some(75), "{}", finished.report("stopped"));
    let go_on = |ranks: usize| run().on(ranks).into(path).with(["--resume"]).run().expect("a run");
    for other in others {
        fs::copy(other, &start).expect("a copy");
        let finished = go_on(1);
        assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
        let printed = finished.errors.contains("initial.warped has changed");
        assert!(printed, "{}", finished.errors);
    }
    fs::copy(&written, &start).expect("a copy");
    let finished = go_on(3);
    assert_eq!(finished.code, Some(0), "{}", finished.report("goes on"));
    assert!(finished.errors.contains("going on from"), "{}", finished.errors);
    let whole = directory();
    run().on(1).solve(whole.path()).expect("a whole run");
    let [found, expected] = [path, whole.path()].map(|d| datasets(d).expect("datasets"));
    let differing = differences(&found, &expected);
    assert!(differing.is_empty(), "{differing:?}");
}

#[test]
fn only_a_run_that_must_stop_fails_if_its_checkpoint_cannot_be_written() {
    LazyLock::force(&WHOLE);
    // The limit on the size of files is below that of a rank's checkpoint, which holds 82 sums, and
    // above those of the results.
    let wide = || run().on(2).set(&["output.plateau.points=80", OFTEN]).files_up_to(400);
    let directory = directory();
    let finished = wide().into(directory.path()).succeed().expect("a run");
    assert!(finished.errors.contains("the run goes on"), "{}", finished.errors);
    assert!(finished.errors.contains("rank-0000"), "{}", finished.errors);
    let all = datasets(directory.path()).expect("datasets");
    assert_eq!(all["/f"], WHOLE.0["/f"]);

    let directory = self::directory();
    let path = directory.path();
    // In the modes: a signal in the set-up needs no checkpoint.
    let begun = || path.join("checkpoint").exists();
    let finished = with_fault(&wide().into(path), Fault::Signal, |_| begun()).expect("a run");
    assert_eq!(finished.code, Some(1), "{}", finished.report("an error"));
    assert!(finished.errors.contains("rank-0000"), "{}", finished.errors);

    // A file has the name of the directory of checkpoints.
    let directory = self::directory();
    let path = directory.path();
    fs::write(path.join("checkpoint"), b"a file").expect("a file");
    let summary = run().set(&[OFTEN]).solve(path).expect("a run");
    same(path, &summary).expect("the whole run");
}
