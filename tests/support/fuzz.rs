//! Fuzzing: a reader is tried on many inputs, in a process of its own. For no input may it panic,
//! end the process, take more than [`SECONDS`] of processor time, or more than [`MEMORY`].
//!
//! An input is made of its number alone. `PHASEWARP_FUZZ=1000000` tries so many,
//! `PHASEWARP_FUZZ_FIRST` says from which number on; one alone is shown.
#![allow(dead_code)] // each test crate uses its own part

pub mod mutate;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};
use std::fmt::Debug;
use std::io::{BufRead, BufReader, Read, Seek};
use std::ops::Range;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Most processor time of an input, and up to one second more.
const SECONDS: u64 = 5;
/// Most address space of the process: what an input takes, the program, and HDF5 and MPI.
const MEMORY: u64 = 2 << 30;
/// After so long without a new input the process is ended, at work or not.
const SILENCE: Duration = Duration::from_secs(60);

/// Marks the process that tries the inputs.
const CHILD: &str = "PHASEWARP_FUZZ_CHILD";
/// Before the number of an input.
const TRIES: &str = "fuzz tries ";
/// The mark of the final report.
const DONE: &str = "fuzz is done: ";

/// A reader to be fuzzed.
pub trait Reader {
    /// The kind of input.
    type Input: Debug;
    /// Number of inputs of a test run by default.
    const INPUTS: u64;
    /// The data it needs, made once.
    fn new() -> Self;
    /// The input that these random numbers make.
    fn input(&self, random: &mut Random) -> Self::Input;
    /// Reads the input: whether it was accepted; an error if the reader is faulty.
    fn read(&mut self, input: &Self::Input) -> Result<bool, String>;
}

/// Random numbers of one input.
pub struct Random(ChaCha8Rng);

impl Random {
    /// Those of input `number`.
    pub fn of(number: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(number))
    }

    /// A number below `n`; 0 where there is none.
    pub fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    /// One of several.
    pub fn of_list<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// True once in `n` times.
    pub fn once_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

fn variable(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// Tries a reader; `test` is the full name of the test that calls this.
pub fn fuzz<R: Reader>(test: &str) {
    let first = variable("PHASEWARP_FUZZ_FIRST").unwrap_or(0);
    let numbers = first..first + variable("PHASEWARP_FUZZ").unwrap_or(R::INPUTS);
    match tried::<R>(test, numbers) {
        Ok(done) => println!("{test}: {done}"),
        Err(what) => panic!("{what}"),
    }
}

/// Whether the fuzzer finds faults of a reader.
pub fn finds<R: Reader>(test: &str, what: &str) {
    let outcome = tried::<R>(test, 0..R::INPUTS);
    let in_child = variable(CHILD).is_some();
    assert!(in_child || outcome.as_ref().is_err_and(|e| e.contains(what)), "{outcome:?}");
}

/// Tries the inputs of these numbers: the final report, or the fault.
fn tried<R: Reader>(test: &str, numbers: Range<u64>) -> Result<String, String> {
    if variable(CHILD).is_some() {
        let work = move || try_all::<R>(numbers);
        // As large as the stack of the program.
        let thread = std::thread::Builder::new().stack_size(8 << 20).spawn(work);
        match thread.expect("a thread").join() {
            Ok(outcome) => outcome.expect("nothing is wrong"),
            Err(panic) => std::panic::resume_unwind(panic),
        }
        return Ok(String::new());
    }
    let mut errors = tempfile::tempfile().map_err(|e| e.to_string())?;
    let child = Command::new(std::env::current_exe().map_err(|e| e.to_string())?)
        .args([test, "--exact", "--nocapture", "--test-threads=1"])
        .env(CHILD, "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(errors.try_clone().map_err(|e| e.to_string())?)
        .spawn();
    let mut child = child.map_err(|e| e.to_string())?;
    let (last, done) = watched(&mut child);
    let _ = child.kill();
    let status = child.wait().map_err(|e| e.to_string())?;
    let mut text = Vec::new();
    let _ = errors.rewind().and_then(|()| errors.read_to_end(&mut text));
    match done {
        Ok(Some(done)) => Ok(done),
        ended => {
            let how = ended.err().unwrap_or_else(|| status.to_string());
            let text = String::from_utf8_lossy(&text);
            Err(format!(
                "{test}: input {last}: {how}\n{text}\n\
                 again: PHASEWARP_FUZZ=1 PHASEWARP_FUZZ_FIRST={last}, and this test"
            ))
        }
    }
}

/// Follows a process to its end: the number of its last input, and its final report; an error if
/// its output stops.
fn watched(child: &mut Child) -> (u64, Result<Option<String>, String>) {
    let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        lines.map_while(Result::ok).try_for_each(|line| sender.send(line).ok())
    });
    let (mut last, mut done) = (0, None);
    loop {
        match receiver.recv_timeout(SILENCE) {
            Ok(line) => {
                if let Some(number) = line.strip_prefix(TRIES) {
                    last = number.parse().unwrap_or(last);
                }
                done = done.or(line.strip_prefix(DONE).map(str::to_owned));
            }
            Err(RecvTimeoutError::Disconnected) => return (last, Ok(done)),
            Err(RecvTimeoutError::Timeout) => return (last, Err("does not end".to_owned())),
        }
    }
}

/// Sets a limit on a resource of this process.
fn limit(resource: Resource, most: u64) {
    let Rlimit { maximum, .. } = getrlimit(resource);
    setrlimit(resource, Rlimit { current: Some(most), maximum }).expect("a limit");
}

fn try_all<R: Reader>(numbers: Range<u64>) -> Result<(), String> {
    let mut reader = R::new();
    limit(Resource::As, MEMORY);
    limit(Resource::Core, 0);
    let (mut accepted, mut slowest) = (0, 0.0f64);
    let tried = numbers.end - numbers.start;
    let begun = Instant::now();
    for number in numbers {
        println!("{TRIES}{number}");
        let used = clock_gettime(ClockId::ProcessCPUTime).tv_sec as u64;
        limit(Resource::Cpu, used + 1 + SECONDS);
        let input = reader.input(&mut Random::of(number));
        if tried == 1 {
            eprintln!("input {number}: {input:?}");
        }
        let started = Instant::now();
        match reader.read(&input) {
            Ok(is_accepted) => accepted += u64::from(is_accepted),
            Err(what) => return Err(format!("input {number}: {what}\n{input:?}")),
        }
        slowest = slowest.max(started.elapsed().as_secs_f64());
    }
    // Neither all nor none are accepted: the changes are of the right size.
    if tried >= 1000 && !(accepted * 200 > tried && accepted * 10 < tried * 9) {
        return Err(format!("{accepted} of {tried} are accepted"));
    }
    let seconds = begun.elapsed().as_secs_f64();
    println!(
        "{DONE}{accepted} of {tried} accepted, in {seconds:.0} s, the slowest in {slowest:.3} s"
    );
    Ok(())
}
