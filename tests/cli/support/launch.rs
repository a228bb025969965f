//! Starts the program, alone or under mpirun: with a time limit that ends the job, a cap on its
//! memory, and no more ranks at work at a time, over all tests, than the machine bears.

use super::outcome::{Finished, Summary, untag, unwrapped};
use crate::launcher::{by_hydra, mpirun, send};
use phasewarp::base::text::quoted;
use std::io::{Read, Seek};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Ranks at work at a time. Starting and stopping a job is mostly waiting: more than the two cores
/// of a small machine.
pub const SLOTS: usize = 6;

/// The launcher, and its options that bind no rank to a core and mark the output of each.
fn launcher() -> Vec<String> {
    let marks: &[&str] = if !by_hydra() {
        &["--bind-to", "none", "--tag-output"]
    } else {
        &["-bind-to", "none", "-prepend-pattern", "[0,%r]<stdout>:"]
    };
    std::iter::once(mpirun()).chain(marks.iter().map(|&word| word.to_owned())).collect()
}

/// Address space of mpirun and of each rank where a job is capped.
const MEMORY_CAP: u64 = 8 << 30;

static TAKEN: Mutex<Taken> = Mutex::new(Taken { slots: 0, tickets: 0, started: 0 });

static CHANGED: Condvar = Condvar::new();

struct Taken {
    slots: usize,
    /// Jobs that came. Each starts after those that came before it: otherwise jobs of few ranks
    /// would keep those of many waiting.
    tickets: usize,
    /// Jobs that were started.
    started: usize,
}

/// Slots taken until dropped.
struct Slots(usize);

impl Slots {
    fn take(ranks: usize, undisturbed: bool) -> Self {
        let wanted = if undisturbed { SLOTS } else { ranks.clamp(1, SLOTS) };
        let mut taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
        let ticket = taken.tickets;
        taken.tickets += 1;
        while taken.started != ticket || taken.slots + wanted > SLOTS {
            taken = CHANGED.wait(taken).unwrap_or_else(PoisonError::into_inner);
        }
        taken.started += 1;
        taken.slots += wanted;
        CHANGED.notify_all();
        Self(wanted)
    }
}

impl Drop for Slots {
    fn drop(&mut self) {
        TAKEN.lock().unwrap_or_else(PoisonError::into_inner).slots -= self.0;
        CHANGED.notify_all();
    }
}

/// A number of ranks and the blocks of space (`--ranks-x`). The other ranks share the modes.
pub type RankMesh = (usize, &'static str);

/// A call of the program.
#[derive(Clone, Debug)]
pub struct Job {
    ranks: Option<usize>,
    arguments: Vec<String>,
    limit: Duration,
    directory: Option<String>,
    apart: Vec<String>,
    reports_codes: bool,
    capped: bool,
    closed: bool,
    blocks: Option<u64>,
    environment: Vec<(String, String)>,
    pause: u64,
    undisturbed: bool,
    nested: bool,
    plugins: bool,
}

impl Job {
    /// The program with `arguments`, without mpirun, killed after five minutes: a busy machine is
    /// no failure, a program that waits for ever is one.
    pub fn new<S: Into<String>>(arguments: impl IntoIterator<Item = S>) -> Self {
        Self {
            ranks: None,
            arguments: arguments.into_iter().map(Into::into).collect(),
            limit: Duration::from_secs(300),
            directory: None,
            apart: Vec::new(),
            reports_codes: false,
            capped: false,
            closed: false,
            blocks: None,
            environment: Vec::new(),
            pause: 5,
            undisturbed: false,
            nested: false,
            plugins: false,
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
            self.arguments.extend(["--set".to_owned(), (*setting).to_owned()]);
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

    /// The number of its ranks.
    pub fn ranks(&self) -> usize {
        self.ranks.unwrap_or(1)
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

    /// Under mpirun, each rank in its own of these directories.
    pub fn apart(mut self, directories: &[&Path]) -> Self {
        self.ranks = Some(directories.len());
        self.apart = directories.iter().map(|d| d.display().to_string()).collect();
        self
    }

    /// Each rank prints a line "ended with <exit code>" when its program is over, and mpirun sees
    /// success.
    pub fn reporting_codes(mut self) -> Self {
        self.reports_codes = true;
        self
    }

    /// With a cap on its memory: what would take more must be refused before.
    pub fn capped(mut self) -> Self {
        self.capped = true;
        self
    }

    /// With its standard streams closed, not only sent elsewhere.
    pub fn without_streams(mut self) -> Self {
        self.closed = true;
        self
    }

    /// No file of a rank may grow beyond so many KiB.
    pub fn files_up_to(mut self, kibibytes: u64) -> Self {
        self.blocks = Some(kibibytes);
        self
    }

    /// With a variable of the environment.
    pub fn environment(mut self, name: &str, value: &str) -> Self {
        self.environment.push((name.to_owned(), value.to_owned()));
        self
    }

    /// Looked at every millisecond.
    pub fn closely(mut self) -> Self {
        self.pause = 1;
        self
    }

    /// While no other job of these tests runs: the clock decides something.
    pub fn undisturbed(mut self) -> Self {
        self.undisturbed = true;
        self
    }

    /// Started while another job waits for it: at once, however many ranks are at work.
    pub fn nested(mut self) -> Self {
        self.nested = true;
        self
    }

    /// With the plugins of hwloc, which load libraries of screens and accelerators: as users start
    /// it. Other jobs do without them, which saves a third of the time that a job takes to start.
    pub fn with_plugins(mut self) -> Self {
        self.plugins = true;
        self
    }

    /// The command line, to be pasted into a shell.
    pub fn command(&self) -> String {
        let mut words: Vec<String> = match self.ranks {
            Some(ranks) => vec![format!("mpirun -np {ranks} --bind-to none")],
            None => Vec::new(),
        };
        words.push("target/release/phasewarp".to_owned());
        words.extend(self.arguments.iter().map(|argument| quoted(argument)));
        words.join(" ")
    }

    /// Starts it and waits for its end. An error when it had to be killed. One rank is started
    /// without mpirun, which takes longer to start than the program.
    pub fn run(&self) -> Result<Finished, String> {
        let alone = Self { ranks: self.ranks.filter(|&ranks| ranks > 1), ..self.clone() };
        alone.run_while(|_, _| {})
    }

    /// As [`run`](Self::run); meanwhile, every few milliseconds, `meanwhile` gets the process and
    /// the time since its start.
    pub fn run_while(
        &self,
        mut meanwhile: impl FnMut(&mut Child, Duration),
    ) -> Result<Finished, String> {
        let fail =
            |what: &str, e: &dyn std::fmt::Display| format!("{}: {what}: {e}", self.command());
        // What a killed process alone leaves goes with this directory.
        let session = tempfile::tempdir().map_err(|e| fail("temporary directory", &e))?;
        let mut command = self.prepared(session.path());
        // Files, not pipes: nothing to be read while the job runs, nothing that a rank left behind
        // could keep open.
        let mut output = tempfile::tempfile().map_err(|e| fail("temporary file", &e))?;
        let mut errors = tempfile::tempfile().map_err(|e| fail("temporary file", &e))?;
        let copy = |file: &std::fs::File| file.try_clone().map_err(|e| fail("temporary file", &e));
        command.stdin(Stdio::null()).stdout(copy(&output)?).stderr(copy(&errors)?);
        let slots = (!self.nested).then(|| Slots::take(self.ranks.unwrap_or(1), self.undisturbed));
        let started = Instant::now();
        let mut child = command.spawn().map_err(|e| fail("not started", &e))?;
        let exit = loop {
            match ended(&child).map_err(|e| fail("lost", &e))? {
                Some(exit) => break Some(exit),
                None if started.elapsed() > self.limit => {
                    end(&mut child);
                    break None;
                }
                None => {
                    meanwhile(&mut child, started.elapsed());
                    std::thread::sleep(Duration::from_millis(self.pause));
                }
            }
        };
        let seconds = started.elapsed().as_secs_f64();
        drop(slots);
        let finished = self.finished(exit.as_ref(), seconds, [&mut output, &mut errors]);
        match exit {
            Some(_) => Ok(finished),
            None => Err(finished.report(&format!("not over after {seconds:.0} s: killed"))),
        }
    }

    /// The words that start it: mpirun, shells that set limits, the program, its arguments.
    fn words(&self) -> Vec<String> {
        let program = env!("CARGO_BIN_EXE_phasewarp");
        let mut words: Vec<String> = Vec::new();
        if let Some(ranks) = self.ranks {
            words = launcher();
            words.extend(["-np".to_owned(), ranks.to_string()]);
        }
        if self.reports_codes {
            let script = "\"$@\"; echo \"ended with $?\"";
            words.extend(["sh", "-c", script, "sh"].map(str::to_owned));
        }
        if let Some(kibibytes) = self.blocks {
            // In units of 512 bytes, as POSIX has it.
            let script = "ulimit -f \"$1\" && shift && exec \"$@\"";
            let blocks = (2 * kibibytes).to_string();
            words.extend(["sh", "-c", script, "sh", &blocks].map(str::to_owned));
        }
        if self.closed {
            let script = "exec \"$@\" <&- >&- 2>&-";
            words.extend(["sh", "-c", script, "sh"].map(str::to_owned));
        }
        words.push(program.to_owned());
        words.extend(self.arguments.iter().cloned());
        if let Some((first, others)) = self.apart.split_first() {
            // mpirun takes several programs, here one a rank.
            let call = words.split_off(launcher().len() + 2);
            words.truncate(launcher().len());
            words.extend(["-np", "1", "-wdir", first].map(str::to_owned));
            words.extend(call.iter().cloned());
            for directory in others {
                words.extend([":", "-np", "1", "-wdir", directory].map(str::to_owned));
                words.extend(call.iter().cloned());
            }
        }
        if self.capped {
            // The shell sets the cap and becomes the job.
            let script = "ulimit -v \"$1\" && shift && exec \"$@\"";
            let kibibytes = (MEMORY_CAP >> 10).to_string();
            words.splice(0..0, ["sh", "-c", script, "sh", &kibibytes].map(str::to_owned));
        }
        words
    }

    /// The command that starts it, with its environment; a process alone keeps the files of Open
    /// MPI in `session`.
    fn prepared(&self, session: &Path) -> Command {
        let words = self.words();
        let mut command = Command::new(&words[0]);
        command
            .args(&words[1..])
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
            .env("OMPI_MCA_mpi_yield_when_idle", "1")
            // Seconds that mpirun grants the ranks when one failed: they have left MPI together by
            // then.
            .env("OMPI_MCA_odls_base_sigkill_timeout", "0")
            .env("RUST_BACKTRACE", "0")
            .env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe");
        if !self.plugins {
            // Nor does hwloc read the configuration of every device, which takes a fifth of a job.
            command.env("HWLOC_PLUGINS_PATH", "/nonexistent").env("HWLOC_COMPONENTS", "-linuxio");
        }
        if self.blocks.is_some() && by_hydra() {
            // These ranks share memory by files, which are larger.
            command.env("UCX_TLS", "tcp,self");
        }
        if self.ranks.is_none() {
            command.env("TMPDIR", session);
        }
        command.envs(self.environment.iter().cloned());
        if let Some(directory) = &self.directory {
            command.current_dir(directory);
        }
        // Tests in the background of a shell would hand on that Ctrl-C is ignored.
        // SAFETY: one call that a signal handler may make, too.
        unsafe {
            command.pre_exec(|| {
                libc::signal(libc::SIGINT, libc::SIG_DFL);
                Ok(())
            });
        }
        command
    }

    /// What is known of a job that has ended, or that was killed (no `exit`).
    fn finished(
        &self,
        exit: Option<&Exit>,
        seconds: f64,
        streams: [&mut std::fs::File; 2],
    ) -> Finished {
        let [mut printed, mut complained] = streams.map(|f| untag(&read(f)));
        if self.ranks.is_none() {
            // No mpirun: what is not marked is the program's.
            printed.swap(0, 2);
            complained.swap(0, 2);
        }
        let ([output, others, _], [errors, more, launcher]) = (printed, complained);
        let status = exit.map(|exit| exit.status);
        Finished {
            command: self.command(),
            code: status.and_then(|s| s.code()),
            shell_code: status.map_or(0, |s| s.code().unwrap_or(128 + s.signal().unwrap_or(0))),
            printed: output.clone() + &errors,
            output: unwrapped(&output),
            errors: unwrapped(&errors),
            others: others + &more,
            launcher,
            seconds,
            processor_seconds: exit.map_or(0.0, |exit| exit.processor_seconds),
        }
    }

    /// As [`run`](Self::run), for a run that must end with exit code 0 and nothing said by ranks
    /// other than 0.
    pub fn succeed(&self) -> Result<Finished, String> {
        let finished = self.run()?;
        if finished.code != Some(0) {
            return Err(finished.report("exit code 0 expected"));
        }
        if !finished.others.is_empty() {
            return Err(finished.report("only rank 0 prints"));
        }
        Ok(finished)
    }

    /// As [`succeed`](Self::succeed) for `run … -o directory`, with `summary.json` as the result.
    pub fn solve(&self, directory: &Path) -> Result<Summary, String> {
        let finished = self.clone().into(directory).succeed()?;
        Summary::read(finished, directory)
    }
}

/// How a process ended.
struct Exit {
    status: ExitStatus,
    /// Processor time of the process and of those it waited for.
    processor_seconds: f64,
}

/// How a process ended, if it did. `child` must not be waited for again after that.
fn ended(child: &Child) -> std::io::Result<Option<Exit>> {
    let (mut status, id) = (0, child.id() as libc::pid_t);
    // SAFETY: a struct of integers, for which zeros are values.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: both places live as long as the call, and the process is a child of this one.
    match unsafe { libc::wait4(id, &mut status, libc::WNOHANG, &mut usage) } {
        -1 => Err(std::io::Error::last_os_error()),
        0 => Ok(None),
        _ => {
            let seconds = |time: libc::timeval| time.tv_sec as f64 + 1e-6 * time.tv_usec as f64;
            let processor_seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime);
            Ok(Some(Exit { status: ExitStatus::from_raw(status), processor_seconds }))
        }
    }
}

/// Asks mpirun to end its job, then makes it.
fn end(child: &mut Child) {
    send("-TERM", child.id());
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

/// All bytes of a file.
pub fn read(file: &mut std::fs::File) -> Vec<u8> {
    let mut bytes = Vec::new();
    let _ = file.rewind();
    let _ = file.read_to_end(&mut bytes);
    bytes
}
