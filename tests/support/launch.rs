//! Starts the program, alone or under mpirun: with a time limit that ends the job, a cap on its memory, and no more
//! ranks at work at a time, over all tests, than the machine bears.
#![allow(dead_code)] // each test program uses its own part

use serde_json::Value;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Ranks at work at a time. Starting and stopping a job is mostly waiting: more than the two cores of a small machine.
const SLOTS: usize = 6;
/// Address space of mpirun and of each rank where a job is capped.
const MEMORY_CAP: u64 = 8 << 30;

static FREE: Mutex<usize> = Mutex::new(SLOTS);
static FREED: Condvar = Condvar::new();

/// Slots taken until dropped.
struct Slots(usize);

impl Slots {
    fn take(ranks: usize) -> Self {
        let wanted = ranks.clamp(1, SLOTS);
        let mut free = FREE.lock().unwrap_or_else(PoisonError::into_inner);
        while *free < wanted {
            free = FREED.wait(free).unwrap_or_else(PoisonError::into_inner);
        }
        *free -= wanted;
        Self(wanted)
    }
}

impl Drop for Slots {
    fn drop(&mut self) {
        *FREE.lock().unwrap_or_else(PoisonError::into_inner) += self.0;
        FREED.notify_all();
    }
}

/// A call of the program.
#[derive(Clone, Debug)]
pub struct Job {
    ranks: Option<usize>,
    arguments: Vec<String>,
    limit: Duration,
    directory: Option<String>,
    tells_codes: bool,
    capped: bool,
    blocks: Option<u64>,
    pause: u64,
}

impl Job {
    /// The program with `arguments`, without mpirun, for at most a minute.
    pub fn new<S: Into<String>>(arguments: impl IntoIterator<Item = S>) -> Self {
        Self {
            ranks: None,
            arguments: arguments.into_iter().map(Into::into).collect(),
            limit: Duration::from_secs(60),
            directory: None,
            tells_codes: false,
            capped: false,
            blocks: None,
            pause: 5,
        }
    }

    /// More arguments.
    pub fn with<S: Into<String>>(mut self, arguments: impl IntoIterator<Item = S>) -> Self {
        self.arguments.extend(arguments.into_iter().map(Into::into));
        self
    }

    /// `--set` for each of `settings`.
    pub fn set(mut self, settings: &[&str]) -> Self {
        for setting in settings {
            self.arguments
                .extend(["--set".to_owned(), (*setting).to_owned()]);
        }
        self
    }

    /// `-o` a directory.
    pub fn into(self, directory: &Path) -> Self {
        let directory = directory.display().to_string();
        self.with(["-o", &directory])
    }

    /// Under `mpirun -np ranks`.
    pub fn on(mut self, ranks: usize) -> Self {
        self.ranks = Some(ranks);
        self
    }

    /// Killed after this many seconds, which fails the test.
    pub fn within(mut self, seconds: u64) -> Self {
        self.limit = Duration::from_secs(seconds);
        self
    }

    /// Started in this directory.
    pub fn inside(mut self, directory: &Path) -> Self {
        self.directory = Some(directory.display().to_string());
        self
    }

    /// Each rank prints a line "ended with <exit code>" when its program is over, and mpirun sees success.
    pub fn telling_codes(mut self) -> Self {
        self.tells_codes = true;
        self
    }

    /// With a cap on its memory: what would take more must be refused before.
    pub fn capped(mut self) -> Self {
        self.capped = true;
        self
    }

    /// No file of a rank may grow beyond so many KiB.
    pub fn files_up_to(mut self, kibibytes: u64) -> Self {
        self.blocks = Some(kibibytes);
        self
    }

    /// Looked at every millisecond.
    pub fn closely(mut self) -> Self {
        self.pause = 1;
        self
    }

    /// The command line, to be pasted into a shell.
    pub fn command(&self) -> String {
        let mut words: Vec<String> = match self.ranks {
            Some(ranks) => vec![format!("mpirun -np {ranks} --bind-to none")],
            None => Vec::new(),
        };
        words.push("target/release/phasewarp".to_owned());
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:".contains(c);
        words.extend(self.arguments.iter().map(|a| {
            if !a.is_empty() && a.chars().all(plain) {
                a.clone()
            } else {
                format!("'{}'", a.replace('\'', "'\\''"))
            }
        }));
        words.join(" ")
    }

    /// Starts it and waits for its end. An error when it had to be killed.
    pub fn run(&self) -> Result<Finished, String> {
        self.run_while(|_, _| {})
    }

    /// As [`run`](Self::run); meanwhile, every few milliseconds, `meanwhile` gets the process and the time since its start.
    pub fn run_while(
        &self,
        mut meanwhile: impl FnMut(&mut Child, Duration),
    ) -> Result<Finished, String> {
        let program = env!("CARGO_BIN_EXE_phasewarp");
        let mut words: Vec<String> = Vec::new();
        if let Some(ranks) = self.ranks {
            words.extend(["mpirun", "-np"].map(str::to_owned));
            words.push(ranks.to_string());
            words.extend(["--bind-to", "none", "--tag-output"].map(str::to_owned));
        }
        if self.tells_codes {
            let script = "\"$@\"; echo \"ended with $?\"";
            words.extend(["sh", "-c", script, "sh"].map(str::to_owned));
        }
        if let Some(kibibytes) = self.blocks {
            // In units of 512 bytes, as POSIX has it.
            let script = "ulimit -f \"$1\" && shift && exec \"$@\"";
            let blocks = (2 * kibibytes).to_string();
            words.extend(["sh", "-c", script, "sh", &blocks].map(str::to_owned));
        }
        words.push(program.to_owned());
        words.extend(self.arguments.iter().cloned());
        if self.capped {
            // The shell sets the cap and becomes the job.
            let script = "ulimit -v \"$1\" && shift && exec \"$@\"";
            let kibibytes = (MEMORY_CAP >> 10).to_string();
            words.splice(
                0..0,
                ["sh", "-c", script, "sh", &kibibytes].map(str::to_owned),
            );
        }
        let mut command = Command::new(&words[0]);
        command
            .args(&words[1..])
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
            .env("OMPI_MCA_mpi_yield_when_idle", "1")
            // Seconds that mpirun grants the ranks when one failed: they have left MPI together by then.
            .env("OMPI_MCA_odls_base_sigkill_timeout", "0")
            .env("RUST_BACKTRACE", "0")
            .env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe");
        if let Some(directory) = &self.directory {
            command.current_dir(directory);
        }
        // Files, not pipes: nothing to be read while the job runs, nothing that a rank left behind could keep open.
        let fail =
            |what: &str, e: &dyn std::fmt::Display| format!("{}: {what}: {e}", self.command());
        let mut output = tempfile::tempfile().map_err(|e| fail("temporary file", &e))?;
        let mut errors = tempfile::tempfile().map_err(|e| fail("temporary file", &e))?;
        let copy = |file: &std::fs::File| file.try_clone().map_err(|e| fail("temporary file", &e));
        command
            .stdin(Stdio::null())
            .stdout(copy(&output)?)
            .stderr(copy(&errors)?);
        let slots = Slots::take(self.ranks.unwrap_or(1));
        let started = Instant::now();
        let mut child = command.spawn().map_err(|e| fail("not started", &e))?;
        let status = loop {
            match child.try_wait() {
                Ok(Some(status)) => break Some(status),
                Ok(None) if started.elapsed() > self.limit => {
                    end(&mut child);
                    break None;
                }
                Ok(None) => {
                    meanwhile(&mut child, started.elapsed());
                    std::thread::sleep(Duration::from_millis(self.pause));
                }
                Err(e) => return Err(fail("lost", &e)),
            }
        };
        let seconds = started.elapsed().as_secs_f64();
        drop(slots);
        let [mut said, mut complained] = [&mut output, &mut errors].map(|f| untag(&read(f)));
        if self.ranks.is_none() {
            // No mpirun: what is not marked is the program's.
            said.swap(0, 2);
            complained.swap(0, 2);
        }
        let ([output, others, _], [errors, more, launcher]) = (said, complained);
        let finished = Finished {
            command: self.command(),
            code: status.and_then(|s| s.code()),
            output,
            errors,
            others: others + &more,
            launcher,
            seconds,
        };
        match status {
            Some(_) => Ok(finished),
            None => Err(finished.report(&format!("not over after {seconds:.0} s: killed"))),
        }
    }

    /// As [`run`](Self::run), for a run that must end with exit code 0 and nothing said by ranks other than 0.
    pub fn succeed(&self) -> Result<Finished, String> {
        let finished = self.run()?;
        if finished.code != Some(0) {
            return Err(finished.report("exit code 0 expected"));
        }
        if !finished.others.is_empty() {
            return Err(finished.report("only rank 0 speaks"));
        }
        Ok(finished)
    }

    /// As [`succeed`](Self::succeed) for `run … -o directory`, with `summary.json` as the result.
    pub fn solve(&self, directory: &Path) -> Result<Summary, String> {
        let finished = self.clone().into(directory).succeed()?;
        let path = directory.join("summary.json");
        let text = std::fs::read_to_string(&path)
            .map_err(|e| finished.report(&format!("{}: {e}", path.display())))?;
        let value = serde_json::from_str(&text)
            .map_err(|e| finished.report(&format!("{}: {e}", path.display())))?;
        Ok(Summary {
            command: finished.command,
            value,
        })
    }
}

/// Asks mpirun to end its job, then makes it.
fn end(child: &mut Child) {
    let id = child.id().to_string();
    let _ = Command::new("kill").args(["-TERM", &id]).status();
    let asked = Instant::now();
    while asked.elapsed() < Duration::from_secs(5) {
        if let Ok(Some(_)) = child.try_wait() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = child.kill();
    let _ = child.wait();
}

fn read(file: &mut std::fs::File) -> String {
    let mut bytes = Vec::new();
    let _ = file.rewind();
    let _ = file.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// What rank 0, the other ranks and mpirun itself said. mpirun marks every piece it gets from a rank, also in the middle
/// of a line, with `[job,rank]<stdout>:`.
fn untag(text: &str) -> [String; 3] {
    let mut said = [const { String::new() }; 3];
    for line in text.split_inclusive('\n') {
        let (mut speaker, mut rest) = (2, line);
        while !rest.is_empty() {
            if let Some((rank, after)) = mark(rest) {
                (speaker, rest) = (rank.min(1), after);
                continue;
            }
            let next = rest.char_indices().skip(1).find(|&(_, c)| c == '[');
            let (piece, after) = rest.split_at(next.map_or(rest.len(), |(at, _)| at));
            said[speaker].push_str(piece);
            rest = after;
        }
    }
    said
}

/// The rank of a mark at the start of `text`, and what follows it.
fn mark(text: &str) -> Option<(usize, &str)> {
    let (job, after) = text.strip_prefix('[')?.split_once(']')?;
    // A bracket of the text may stand right before a mark.
    if job.contains('[') {
        return None;
    }
    let after = (after.strip_prefix("<stdout>:")).or_else(|| after.strip_prefix("<stderr>:"))?;
    Some((job.rsplit(',').next()?.parse().ok()?, after))
}

/// A job that came to its end.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The command.
    pub command: String,
    /// Exit code of mpirun or of the program; none when a signal ended it.
    pub code: Option<i32>,
    /// Standard output of rank 0.
    pub output: String,
    /// Standard error of rank 0.
    pub errors: String,
    /// What other ranks said, on either.
    pub others: String,
    /// What mpirun itself complained about.
    pub launcher: String,
    /// Seconds from start to end.
    pub seconds: f64,
}

impl Finished {
    /// `what` went wrong, with the command and all that was said.
    pub fn report(&self, what: &str) -> String {
        let ending = match self.code {
            Some(code) => format!("exit code {code}"),
            None => "ended by a signal".to_owned(),
        };
        let mut text = format!(
            "{what}\n  command: {}\n  {ending} after {:.1} s",
            self.command, self.seconds
        );
        // mpirun's own words about an exit code that is not 0 say nothing new.
        let launcher = if self.errors.is_empty() {
            self.launcher.as_str()
        } else {
            ""
        };
        for (who, said) in [
            ("stdout", self.output.as_str()),
            ("stderr", &self.errors),
            ("other ranks", &self.others),
            ("mpirun", launcher),
        ] {
            // Without the frames of a crash.
            let lines = said.lines().filter(|l| !l.starts_with('['));
            let said = lines.collect::<Vec<_>>().join("\n");
            let said: String = said.trim_end().chars().take(1500).collect();
            if !said.is_empty() {
                text += &format!("\n  {who}: {}", said.replace('\n', "\n    "));
            }
        }
        text
    }
}

/// `summary.json` of a run, with the command that made it.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The command.
    pub command: String,
    /// The file.
    pub value: Value,
}

impl Summary {
    /// A number that must be there.
    pub fn number(&self, key: &str) -> Result<f64, String> {
        self.value[key].as_f64().ok_or_else(|| {
            format!(
                "summary.json: {key} is {}, a number expected\n  command: {}",
                self.value[key], self.command
            )
        })
    }

    /// A yes or no that must be there.
    pub fn boolean(&self, key: &str) -> Result<bool, String> {
        self.value[key].as_bool().ok_or_else(|| {
            format!(
                "summary.json: {key} is {}, true or false expected\n  command: {}",
                self.value[key], self.command
            )
        })
    }

    /// An error that names the command, unless `holds`.
    pub fn require(&self, holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
        if holds {
            Ok(())
        } else {
            Err(format!("{}\n  command: {}", what(), self.command))
        }
    }
}

/// Checks every row of a table, several at a time, and fails with all that failed.
pub fn check_all<T: Sync>(rows: &[T], check: impl Fn(&T) -> Result<(), String> + Sync) {
    assert!(!rows.is_empty(), "a table without rows tests nothing");
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..SLOTS.min(rows.len()) {
            scope.spawn(|| {
                while let Some(row) = rows.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(failure) = check(row) {
                        let mut failures = failures.lock().unwrap_or_else(PoisonError::into_inner);
                        failures.push(failure);
                    }
                }
            });
        }
    });
    let failures = failures
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    assert!(
        failures.is_empty(),
        "{} of {} failed:\n\n{}\n",
        failures.len(),
        rows.len(),
        failures.join("\n\n")
    );
}

/// The case files, sorted by name.
pub fn cases() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    names.sort();
    assert!(names.len() >= 7, "cases/: only {names:?}");
    names
}

/// What makes a case small enough for tests that go through all of them, faces still on the jumps; nothing for most.
pub fn shrunk(name: &str) -> &'static [&'static str] {
    match name {
        "barriers.toml" => &["axis.0.x.cells=60", "axis.0.v.cells=41", "time.end=1.2"],
        "harmonic_step.toml" => &["axis.0.x.cells=48", "axis.0.v.cells=43"],
        "lens2d.toml" => &[
            "axis.0.x.cells=18",
            "axis.0.v.cells=7",
            "axis.1.x.cells=7",
            "axis.1.v.cells=4",
            "time.end=1.0",
        ],
        "periodic2d.toml" => &[
            "axis.0.x.cells=12",
            "axis.0.v.cells=7",
            "axis.1.x.cells=5",
            "axis.1.v.cells=5",
        ],
        "quantum_dot2d.toml" => &[
            "axis.0.x.cells=12",
            "axis.0.v.cells=8",
            "axis.1.x.cells=12",
            "axis.1.v.cells=7",
        ],
        "step_slope3d.toml" => &[
            "axis.0.x.cells=6",
            "axis.0.v.cells=5",
            "axis.1.x.cells=4",
            "axis.1.v.cells=4",
            "axis.2.x.cells=3",
            "axis.2.v.cells=4",
        ],
        _ => &[],
    }
}

/// Path of a case file.
pub fn case(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("cases")
        .join(name);
    path.display().to_string()
}

/// A directory of its own below `target/`, deleted when the test is over.
pub fn directory() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a temporary directory below target/")
}
