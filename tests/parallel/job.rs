//! A job of this program under mpirun, with its output and a time limit.

use crate::support::launcher::{by_hydra, mpirun, send};
use std::fs::File;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Environment variable: the number of ranks of a job.
pub const RANKS: &str = "PHASEWARP_TEST_RANKS";
/// Environment variable: the control that a job runs instead of checks.
pub const CONTROL: &str = "PHASEWARP_TEST_CONTROL";
/// A job without output for longer than this is ended.
pub const TIME_LIMIT: Duration = Duration::from_secs(600);

/// Whether the launcher can run this number of ranks on this machine. With another MPI than Open
/// MPI, waiting ranks may not yield their cores to each other.
pub fn bears(ranks: usize) -> bool {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    !by_hydra() || ranks <= cores.max(2)
}

/// A running `mpirun` of this program.
pub struct Job {
    mpirun: Child,
    output: tempfile::TempDir,
}

/// How a job ended.
pub struct Outcome {
    /// `None` if the harness ended the job.
    pub status: Option<ExitStatus>,
    pub stdout: String,
    pub stderr: String,
}

impl Outcome {
    /// Whether the job ended by itself, with exit code 0.
    pub fn success(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// How the job ended and what it wrote, for the report of a failure.
    pub fn report(&self) -> String {
        let ending = match self.status {
            Some(status) => status.to_string(),
            None => format!("ended by the harness, which waits for {TIME_LIMIT:?}"),
        };
        format!("{ending}\n{}{}", self.stdout, self.stderr)
    }
}

impl Job {
    /// Starts this program on `ranks` ranks with variables of the environment and `arguments`.
    pub fn start(ranks: usize, environment: &[(&str, &str)], arguments: &[&str]) -> Self {
        let output = tempfile::tempdir().expect("a directory for output");
        let file = |name: &str| File::create(output.path().join(name)).expect("a file for output");
        let program = std::env::current_exe().expect("a path of this program");
        let mut command = Command::new(mpirun());
        command
            .args(["--bind-to", "none", "-np", &ranks.to_string()])
            .arg(program)
            .args(arguments)
            .env(RANKS, ranks.to_string())
            // Settings of Open MPI 4 and 5 that allow root, and more ranks than cores.
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
            .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
            .env("OMPI_MCA_mpi_yield_when_idle", "1")
            .env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe")
            .envs(environment.iter().copied())
            .stdin(Stdio::null())
            .stdout(file("stdout"))
            .stderr(file("stderr"));
        let mpirun = command.spawn().expect("mpirun starts");
        Self { mpirun, output }
    }

    fn text(&self, name: &str) -> String {
        let bytes = std::fs::read(self.output.path().join(name)).expect("the output is readable");
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Ends `mpirun`, which ends the ranks, by SIGTERM and after five seconds by SIGKILL.
    fn end(&mut self) {
        send("-TERM", self.mpirun.id());
        for _ in 0..50 {
            if let Ok(Some(_)) = self.mpirun.try_wait() {
                return;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        let _ = self.mpirun.kill();
        let _ = self.mpirun.wait();
    }

    /// Waits for the end of the job. Ends it if it writes nothing for the time limit, or if
    /// `enough` holds for its standard output.
    pub fn outcome(mut self, mut enough: impl FnMut(&str) -> bool) -> Outcome {
        let (mut written, mut deadline) = (0, Instant::now() + TIME_LIMIT);
        let status = loop {
            if let Some(status) = self.mpirun.try_wait().expect("mpirun can be waited for") {
                break Some(status);
            }
            let text = self.text("stdout");
            if text.len() > written {
                (written, deadline) = (text.len(), Instant::now() + TIME_LIMIT);
            }
            if Instant::now() > deadline || enough(&text) {
                self.end();
                break None;
            }
            std::thread::sleep(Duration::from_millis(50));
        };
        Outcome { status, stdout: self.text("stdout"), stderr: self.text("stderr") }
    }
}

/// Prints the process of this rank, for [`processes`].
pub fn print_process(rank: usize) {
    println!("process {rank} {}", std::process::id());
}

/// The ranks that have printed their process, and that process, in the order of ranks.
pub fn processes(text: &str) -> Vec<(usize, u32)> {
    let numbers = |line: &str| {
        let (rank, process) = line.strip_prefix("process ")?.split_once(' ')?;
        Some((rank.parse().ok()?, process.trim().parse().ok()?))
    };
    let mut found: Vec<_> = text.lines().filter_map(numbers).collect();
    found.sort();
    found
}

/// The processes that are still there ten seconds later.
pub fn left_of(started: &[(usize, u32)]) -> Vec<u32> {
    let mut left: Vec<u32> = started.iter().map(|&(_, process)| process).collect();
    for _ in 0..100 {
        left.retain(|&process| exists(process));
        if left.is_empty() {
            break;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    left
}

/// Whether a process exists; signal 0 only checks this.
fn exists(process: u32) -> bool {
    let mut kill = Command::new("kill");
    kill.args(["-0", &process.to_string()]).stderr(Stdio::null());
    kill.status().is_ok_and(|status| status.success())
}
