//! Fuzzing: a reader is tried on many inputs in a separate process. No input may make it panic, end
//! the process, or take more than [`SECONDS`] of processor time or more than [`MEMORY`].
//!
//! An input depends on its number only. `PHASEWARP_FUZZ=1000000` sets the number of inputs and
//! `PHASEWARP_FUZZ_FIRST` the number of the first one. If there is only one input, it is printed.
#![allow(dead_code)] // each test program uses a part of it

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

/// Limit on the processor time of an input; a limit in whole seconds allows up to one second more.
const SECONDS: u64 = 5;
/// Limit on the address space of the process: the memory of an input, the program, HDF5 and MPI.
const MEMORY: u64 = 2 << 30;
/// The process is ended if it starts no new input for this long.
const SILENCE: Duration = Duration::from_secs(60);

/// Environment variable: this is the process that tries the inputs.
const CHILD: &str = "PHASEWARP_FUZZ_CHILD";
/// Start of the line that gives the number of an input.
const TRIES: &str = "fuzz tries ";
/// Start of the line with the final report.
const DONE: &str = "fuzz is done: ";

/// A reader that is fuzzed.
pub trait Reader {
    /// The kind of input.
    type Input: Debug;
    /// Number of inputs of a test run by default.
    const INPUTS: u64;
    /// Makes the reader and the data that it needs, once for all inputs.
    fn new() -> Self;
    /// Makes an input from these random numbers.
    fn input(&self, random: &mut Random) -> Self::Input;
    /// Reads the input and returns whether it was accepted; an error if the reader is faulty.
    fn read(&mut self, input: &Self::Input) -> Result<bool, String>;
}

/// Random numbers of one input.
pub struct Random(ChaCha8Rng);

impl Random {
    /// The random numbers of input `number`.
    pub fn of(number: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(number))
    }

    /// A number below `n`, or 0 if `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    /// An item of the list.
    pub fn of_list<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// True with probability `1/n`.
    pub fn once_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

fn variable(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// Fuzzes a reader; `test` is the full name of the test that calls this.
pub fn fuzz<R: Reader>(test: &str) {
    let first = variable("PHASEWARP_FUZZ_FIRST").unwrap_or(0);
    let numbers = first..first + variable("PHASEWARP_FUZZ").unwrap_or(R::INPUTS);
    match tried::<R>(test, numbers) {
        Ok(done) => println!("{test}: {done}"),
        Err(what) => panic!("{what}"),
    }
}

/// Fails unless the fuzzer finds the fault of a faulty reader, with `what` in its message.
pub fn finds<R: Reader>(test: &str, what: &str) {
    let outcome = tried::<R>(test, 0..R::INPUTS);
    let in_child = variable(CHILD).is_some();
    assert!(in_child || outcome.as_ref().is_err_and(|e| e.contains(what)), "{outcome:?}");
}

/// Tries the inputs of these numbers. Returns the final report, or the fault as an error.
fn tried<R: Reader>(test: &str, numbers: Range<u64>) -> Result<String, String> {
    if variable(CHILD).is_some() {
        let work = move || try_all::<R>(numbers);
        // The same size as the stack of the program.
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
                 to repeat it: this test with PHASEWARP_FUZZ=1 PHASEWARP_FUZZ_FIRST={last}"
            ))
        }
    }
}

/// Reads the output of a process up to its end. Returns the number of its last input and its final
/// report, or an error if the output stops.
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
    // The changes have the right size if a reader accepts some of the inputs, but not all.
    if tried >= 1000 && !(accepted * 200 > tried && accepted * 10 < tried * 9) {
        return Err(format!("{accepted} of {tried} are accepted"));
    }
    let seconds = begun.elapsed().as_secs_f64();
    println!(
        "{DONE}{accepted} of {tried} accepted, in {seconds:.0} s, the slowest in {slowest:.3} s"
    );
    Ok(())
}
