//! All ranks refuse a wrong command line, and one of them prints the message. Help is printed once.

use crate::support::{
    Finished, Job, case, check_all, directory, names_in, number_from_environment, plan, refused,
    require, run, text_of,
};
use clap::{CommandFactory, Parser};
use phasewarp::base::text::{COLUMNS, wrapped};
use phasewarp::command::cli::Cli;
use std::path::{Path, PathBuf};

/// The values of placeholders in a command line.
struct Places {
    folder: String,
    out: String,
}

impl Places {
    /// Replaces a word of a command line or of a message: words in capitals are paths, and `~` is a
    /// space.
    fn word(&self, word: &str) -> String {
        match word {
            "EXAMPLE" => case("example1.toml"),
            "PLANE" => case("barrier2d.toml"),
            "NOWHERE" => format!("{}/nowhere.toml", self.folder),
            "FOLDER" => self.folder.clone(),
            "OUT" => self.out.clone(),
            "EMPTY" => String::new(),
            other => other.replace('~', " "),
        }
    }

    /// The job of a command line.
    fn job(&self, line: &str) -> Job {
        Job::new(line.split(' ').map(|word| self.word(word)))
    }
}

/// A command line that is refused.
struct RefusedLine {
    line: &'static str,
    /// Words of the refusal.
    wording: &'static [&'static str],
    /// Number of ranks on which it is tried.
    ranks: usize,
}

/// A line that is refused on one rank.
const fn alone(line: &'static str, wording: &'static [&'static str]) -> RefusedLine {
    RefusedLine { line, wording, ranks: 1 }
}

/// A line that is refused on two ranks, by one message.
const fn on_two(line: &'static str, wording: &'static [&'static str]) -> RefusedLine {
    RefusedLine { line, wording, ranks: 2 }
}

/// Mistakes that the parser of the command line finds.
const NOT_PARSED: [RefusedLine; 16] = [
    alone("check", &["<CASE>"]),
    alone("check EXAMPLE --frobnicate", &["'--frobnicate'"]),
    alone("run EXAMPLE --ouput x", &["'--ouput'", "'--output'"]),
    alone("plan EXAMPLE --ranks 0", &["'0'", "--ranks", "1..="]),
    alone("plan EXAMPLE --ranks -1", &["-1"]),
    alone("plan EXAMPLE --ranks two", &["'two'", "--ranks"]),
    alone("plan EXAMPLE --ranks 1,2,x", &["'x'", "--ranks", "1..64"]),
    alone("plan EXAMPLE --ranks 4..2", &["4..2", "--ranks", "larger"]),
    alone("plan EXAMPLE --force", &["--sbatch"]),
    alone("plan EXAMPLE --memory-per-rank 4~parsecs", &["4 parsecs", "--memory-per-rank", "GiB"]),
    alone("plan EXAMPLE --memory-per-node 256", &["256 has no unit", "--memory-per-node", "GiB"]),
    alone("run EXAMPLE -o OUT --ranks-x one", &["--ranks-x", "'one'"]),
    alone("run EXAMPLE -o OUT --mode fast", &["--mode", "'fast'", "streamed"]),
    alone("spectrum EXAMPLE --steps 1", &["--steps", "'1'"]),
    alone("spectrum EXAMPLE --refine 1,0", &["--refine", "'0'", "1 to 64"]),
    alone("spectrum EXAMPLE --refine 1,two", &["--refine", "'two'", "1 to 64"]),
];

/// Mistakes that the program finds; the first is one for the parser.
const MISTAKES: [RefusedLine; 13] = [
    on_two("chekc EXAMPLE", &["'chekc'", "'check'"]),
    alone("check NOWHERE", &["nowhere.toml", "No such file"]),
    on_two("run NOWHERE", &["nowhere.toml", "No such file"]),
    alone("check FOLDER", &["FOLDER", "directory"]),
    alone("plan EXAMPLE --ranks 6 --ranks-x 4", &["--ranks-x", "4", "6", "1, 2, 3, 6"]),
    on_two("run EXAMPLE -o OUT --ranks-x 3", &["--ranks-x", "3 blocks", "2 ranks", "1, 2"]),
    alone("run EXAMPLE -o OUT --ranks-x 0", &["--ranks-x", "0", "1 to 128"]),
    alone("run EXAMPLE -o OUT --ranks-x 129", &["--ranks-x", "129", "128 cells"]),
    alone("run EXAMPLE -o OUT --ranks-x 1,2", &["--ranks-x", "2 numbers", "1 x-axes"]),
    on_two("run PLANE -o OUT --ranks-x 2,2", &["--ranks-x", "4 blocks", "2 ranks"]),
    alone("run PLANE -o OUT --ranks-x 1,99999999999999999999", &["--ranks-x"]),
    alone("run PLANE -o OUT --ranks-x 4294967296,4294967296", &["--ranks-x", "4294967296"]),
    alone("run EXAMPLE -o EMPTY", &["--output"]),
];

#[test]
fn mistakes_on_the_command_line_are_refused() {
    let place = directory();
    let places = Places {
        folder: place.path().display().to_string(),
        out: place.path().join("out").display().to_string(),
    };
    for RefusedLine { line, wording, .. } in NOT_PARSED {
        let words = line.split(' ').map(|word| places.word(word));
        let parsed = Cli::try_parse_from(std::iter::once("phasewarp".to_owned()).chain(words));
        let refusal = parsed.err().unwrap_or_else(|| panic!("accepted: {line}"));
        let printed = refusal.to_string();
        assert_eq!(refusal.exit_code(), 2, "{line}");
        assert_eq!(printed.matches("error: ").count(), 1, "{printed}");
        assert!(wording.iter().all(|words| printed.contains(words)), "{line}: {printed}");
    }
    check_all(&MISTAKES, |RefusedLine { line, wording, ranks }| {
        let wording: Vec<String> = wording.iter().map(|word| places.word(word)).collect();
        let wording: Vec<&str> = wording.iter().map(String::as_str).collect();
        places.job(line).on(*ranks).is_refused(&wording)
    });
    assert!(!Path::new(&places.out).exists(), "a refused run made its output directory");
    // A plan for more ranks than cells and modes can occupy: at most 3 blocks for 128 ranks.
    let small = ["axis.0.x.cells=3", "axis.0.v.cells=2"];
    let finished = plan("example1.toml", 128).set(&small).run().unwrap();
    if finished.code != Some(0) {
        refused(&finished, &["128 ranks"]).unwrap();
    }
}

/// Every rank ends with exit code 2, also if only one of them found the mistake.
#[test]
fn every_rank_ends_with_the_code() {
    let place = directory();
    let folder = place.path().display().to_string();
    let places = Places { out: folder.clone(), folder };
    let rows = [
        "chekc",
        "check EXAMPLE --set solver.tolerance=0",
        "run EXAMPLE -o OUT --ranks-x 2",
        "run EXAMPLE -o OUT --set axis.0.x.cells=10000000",
        "run EXAMPLE -o OUT --ranks-x 3 --set initial.f=sqrt(1.4~-~x)",
        "run EXAMPLE -o OUT --ranks-x 3 --set initial.f=sqrt(x~+~1.4)",
    ];
    check_all(&rows, |line| {
        let job = places.job(line).on(3);
        let finished = job.reporting_codes().run()?;
        let printed = finished.output.clone() + &finished.others;
        let codes = printed.matches("ended with 2").count();
        require(codes == 3, &finished, || format!("{codes} of 3 ranks ended with 2"))?;
        let messages = finished.errors.matches("error: ").count();
        require(messages == 1, &finished, || format!("{messages} messages"))
    });
}

/// Without a subcommand, the usage is printed and the exit code is 2. Help and version are printed
/// once, with exit code 0.
#[test]
fn help_is_printed_once() {
    let finished = Job::new([""; 0]).on(2).run().unwrap();
    assert!(
        finished.code == Some(2) && finished.errors.matches("Usage:").count() == 1,
        "{}",
        finished.report("usage expected")
    );
    let help = Job::new(["--help"]).on(2).succeed().unwrap();
    assert_eq!(help.output.matches("Usage:").count(), 1, "{}", help.report("--help"));
    let version = Job::new(["--version"]).succeed().unwrap();
    assert_eq!(version.output.matches(env!("CARGO_PKG_VERSION")).count(), 1, "{}", version.output);
}

/// All printed lines fit 100 columns, in any dimension and with a long title. Only a single word
/// may be wider, such as a quoted title in a command.
#[test]
fn no_line_is_wider_than_a_terminal() {
    let title = "A title that is longer than a line of a terminal can be. ".repeat(4);
    let title = format!("title={title}");
    let coarse = ["axis.0.x.cells=8", "axis.0.v.cells=8"];
    let cases: [(&str, &[&str]); 3] =
        [("example1.toml", &coarse), ("barrier2d.toml", &[]), ("step3d.toml", &[])];
    // By every case, and by one of the cases each.
    let every = ["check", "run --verbose -o OUT", "plan --ranks 1..8"];
    let by_turn = [
        "run --resume -o OUT",
        "run -o REFUSED --ranks-x 9999",
        "plan",
        "plan --ranks 4 --calibrate --memory-per-node 4GiB --ranks-per-node 2",
        "plan --memory-per-rank 1MiB",
        "sweep --vary solver.tolerance=1e-3,5 --vary time.end=0.1,0.2 -o SWEEP",
        "spectrum",
        "resources",
        "resources --optimise",
        "stability --budget 1s -o STABILITY",
        "chart --budget 1s -o CHART",
        "advise --budget 1s --accuracy 0.3",
        "export-matrix -o MATRIX",
    ];
    let on_results = ["report OUT", "movie OUT", "check-result OUT"];
    let cases: Vec<_> = cases.iter().enumerate().collect();
    check_all(&cases, |(k, (name, settings))| {
        let place = directory();
        let path = case(name);
        for command in every.iter().chain(by_turn.iter().skip(*k).step_by(3)) {
            let mut words = command.split(' ');
            let first = words.next().map(str::to_owned);
            let job = Job::new(first.into_iter().chain([path.clone()]))
                .with(words)
                .set(settings)
                .set(&[&title])
                .inside(place.path());
            fits_a_terminal(&job.run()?)?;
        }
        fits_a_terminal(&Job::new(on_results[*k].split(' ')).inside(place.path()).run()?)
    });
    let place = directory();
    for words in [["init", "a file.toml"], ["man", "OUT"]] {
        fits_a_terminal(&Job::new(words).inside(place.path()).run().unwrap()).unwrap();
    }
    fits_a_terminal(&Job::new(["--help"]).succeed().unwrap()).unwrap();
    let mut program = Cli::command();
    program.build();
    for command in program.get_subcommands_mut() {
        let help = wrapped(command.render_long_help().to_string().trim_end());
        assert!(wide_line(&help).is_none(), "{:?}", wide_line(&help));
        assert!(help.contains("Usage:"), "{help}");
    }
}

/// A line of more than 100 columns that is not one word.
fn wide_line(printed: &str) -> Option<&str> {
    let is_word = |line: &str| !line.contains(' ') || line.starts_with("--set '");
    printed.lines().find(|line| line.chars().count() > COLUMNS && !is_word(line.trim()))
}

/// Checks that all printed lines fit 100 columns.
fn fits_a_terminal(finished: &Finished) -> Result<(), String> {
    match wide_line(&finished.printed) {
        Some(line) => Err(finished.report(&format!("more than {COLUMNS} columns: {line}"))),
        None => require(!finished.printed.is_empty(), finished, || "no output".to_owned()),
    }
}

/// An output directory that cannot be written is refused before the solve. Existing files stay.
#[test]
fn an_output_directory_that_cannot_be_written_is_refused() {
    let place = directory();
    let file = place.path().join("file");
    std::fs::write(&file, "kept").unwrap();
    let made = |name: &str| {
        let path = place.path().join(name);
        std::fs::create_dir_all(path.join("result.h5")).unwrap();
        path
    };
    // A third of them on two ranks.
    let rows = [
        file.clone(),
        file.join("below"),
        file.join("far/below"),
        PathBuf::from("/proc/nowhere"),
        PathBuf::from("/proc"),
        PathBuf::from("/dev/null"),
        made("occupied"),
    ];
    let rows: Vec<(usize, &PathBuf)> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, path)| {
        let job = run("example1.toml").into(path).on(if k % 3 == 0 { 2 } else { 1 });
        job.is_refused(&["output", &path.display().to_string()])
    });
    assert_eq!(text_of(&file).unwrap(), "kept");
}

/// Processes without a launcher start no daemon. Many at once come to their ends, and leave nothing
/// in the directory of temporary files, which may be one of Open MPI's own.
#[test]
fn processes_without_a_launcher_do_not_disturb_each_other() {
    let place = directory();
    let text = place.path().display().to_string();
    let trials = number_from_environment("PHASEWARP_TRIALS", 12);
    check_all(&(0..trials).collect::<Vec<_>>(), |trial| {
        let base = ["TMPDIR", "OMPI_MCA_orte_tmpdir_base"][*trial as usize % 2];
        let start = |words: [&str; 2]| Job::new(words).environment(base, &text).within(60).run();
        match trial % 3 {
            0 => start(["check", "no such case"])?.ended(2, &["no such case"]),
            _ => start(["help", "run"])?.ended(0, &[]),
        }
    });
    assert_eq!(names_in(place.path()), Vec::<String>::new());
}

/// A full disk behind the standard output is an error. A pipe closed by its reader is not.
#[test]
fn output_that_cannot_be_printed_is_an_error() {
    let program = env!("CARGO_BIN_EXE_phasewarp");
    let example = case("example1.toml");
    check_all(&["schema", "plan --json CASE", "check CASE", "--help"], |line| {
        let words =
            line.split(' ').map(|word| if word == "CASE" { example.as_str() } else { word });
        let mut command = std::process::Command::new(program);
        command.args(words);
        let full = std::fs::File::create("/dev/full").map_err(|e| e.to_string())?;
        let failed = command.stdout(full).output().map_err(|e| e.to_string())?;
        let printed = String::from_utf8_lossy(&failed.stderr).into_owned();
        if failed.status.code() != Some(1) || !printed.contains("standard output could not be") {
            return Err(format!("{line}: {:?}: {printed}", failed.status));
        }
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::null());
        let mut child = command.spawn().map_err(|e| e.to_string())?;
        drop(child.stdout.take());
        let status = child.wait().map_err(|e| e.to_string())?;
        if status.success() { Ok(()) } else { Err(format!("{line}: {status:?}")) }
    });
}
