//! The operating system: caches, disks, signals, limits, and the end of the process.

use crate::base::error::CAN_GO_ON;
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use rustix::io::Errno;
use rustix::process::{
    Resource, Rlimit, Signal, getrlimit, set_parent_process_death_signal, setrlimit,
};
use std::collections::BTreeSet;
use std::ffi::CString;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, OnceLock};
use std::time::{Duration, Instant};

/// The part of a run by modes in which a stop signal arrives. It decides what the signal does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RunPart {
    /// The set-up: there is nothing to store, so the signal ends the process at once.
    SetUp,
    /// The modes: the signal raises [`stop_flag`], and the run writes a checkpoint.
    Modes,
    /// A classical run, which makes no checkpoints: SIGTERM and SIGINT end the process at once by
    /// their default action, SIGUSR1 does nothing.
    Classical,
    /// No run yet, or one that is over: the signal raises [`stop_flag`]. A set-up that follows ends
    /// at once; after a run it is too late for a checkpoint.
    Outside,
}

static PART: AtomicU8 = AtomicU8::new(RunPart::Outside as u8);

static MESSAGES: OnceLock<StopMessages> = OnceLock::new();

/// Signals closer to each other count as one: `timeout` and launchers send the same one twice.
const ONE_SIGNAL: Duration = Duration::from_millis(500);

/// Bytes of a core's share of the second-level cache; 1 MiB if that is unknown.
pub fn cache_per_core() -> u64 {
    const USUAL: u64 = 1 << 20;
    share_of_cache("2").unwrap_or(USUAL)
}

/// Bytes of a core's share of the third-level cache; of the second level if there is no third.
pub fn last_cache_per_core() -> u64 {
    share_of_cache("3").unwrap_or_else(cache_per_core)
}

/// Bytes of a core's share of the cache of a level, if known.
fn share_of_cache(level: &str) -> Option<u64> {
    let read = |index: usize, name: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{name}");
        std::fs::read_to_string(path).map_or(String::new(), |text| text.trim().to_owned())
    };
    let index = (0..8).find(|&i| read(i, "level") == level)?;
    let size = read(index, "size");
    let kilobytes: u64 = size.strip_suffix('K')?.parse().ok()?;
    // "0-3,8": the processors that share it.
    let count = |range: &str| {
        let mut ends = range.split('-').map(|end| end.parse::<u64>().ok());
        let first = ends.next().flatten()?;
        Some(ends.next().flatten().unwrap_or(first).saturating_sub(first) + 1)
    };
    let sharing: u64 = (read(index, "shared_cpu_list").split(',').filter_map(count)).sum();
    Some(kilobytes * 1024 / sharing.max(1))
}

/// Bytes that a file in `directory` may grow to: free space, within the process's file-size limit.
pub fn room_for_file(directory: &Path) -> u64 {
    let disk = statvfs(directory).map_or(u64::MAX, |d| d.f_bavail.saturating_mul(d.f_frsize));
    disk.min(getrlimit(Resource::Fsize).current.unwrap_or(u64::MAX))
}

/// Reserves disk space for a file that will grow to `bytes`. The file keeps its size if the file
/// system can reserve space; otherwise (ext2) a zero is written into each new block, if there are
/// not too many.
///
/// # Errors
/// The error of the system: the disk or the user's quota is full.
pub fn reserve(path: &Path, bytes: u64) -> std::io::Result<()> {
    /// Each takes a system call: seconds in all.
    const MOST_BLOCKS: u64 = 1 << 20;
    let file = std::fs::File::options().write(true).open(path)?;
    match fallocate(&file, FallocateFlags::KEEP_SIZE, 0, bytes) {
        Err(full @ (Errno::NOSPC | Errno::DQUOT | Errno::FBIG)) => Err(full.into()),
        Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
            let now = file.metadata()?;
            let block = now.blksize().max(512);
            let blocks = bytes.div_ceil(block);
            if blocks > MOST_BLOCKS {
                return Ok(());
            }
            // The last byte of each new block, and of the file.
            let last_bytes = (now.len() / block..blocks).map(|k| ((k + 1) * block).min(bytes) - 1);
            last_bytes.filter(|&at| at >= now.len()).try_for_each(|at| file.write_all_at(&[0], at))
        }
        _ => Ok(()),
    }
}

/// Waits until what this machine wrote to the file `path` is on the disk.
///
/// # Errors
/// What the system says.
pub fn flush(path: &Path) -> std::io::Result<()> {
    std::fs::File::open(path)?.sync_data()
}

/// Releases the space that [`reserve`] took beyond the file's size.
///
/// # Errors
/// What the system says.
pub fn give_back(path: &Path) -> std::io::Result<()> {
    let file = std::fs::File::options().write(true).open(path)?;
    file.set_len(file.metadata()?.len())
}

/// Turns the signal of a file that outgrows the process's limit into an error of the write.
pub fn catch_file_size_signal() {
    // The flag is not used. Registering fails only for signals that cannot be caught.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// The flag that SIGUSR1 raises instead of ending the process, from the first call on.
pub fn stop_flag() -> Arc<AtomicBool> {
    static FLAG: LazyLock<Arc<AtomicBool>> = LazyLock::new(|| {
        let flag = Arc::new(AtomicBool::new(false));
        // Fails for signals that cannot be caught only.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&flag));
        flag
    });
    Arc::clone(&FLAG)
}

/// What this process writes to standard error when a stop signal arrives; empty on all ranks but
/// one.
#[derive(Clone, Copy, Debug, Default)]
pub struct StopMessages {
    /// The message of a signal in [`RunPart::SetUp`].
    pub set_up: &'static str,
    /// The message of a signal in [`RunPart::Modes`], written once.
    pub modes: &'static str,
}

/// From now on the first SIGTERM or SIGINT (Ctrl-C) raises [`stop_flag`] too, and the next one ends
/// the process at once. An ignored signal stays ignored. In [`RunPart::SetUp`] each of these
/// signals, and SIGUSR1, ends the process at once with the exit code [`CAN_GO_ON`]. The program
/// calls this once, before MPI starts.
pub fn stop_when_terminated() {
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        if !is_ignored(signal) {
            stop_on(signal);
        }
    }
    on_signal(signal_hook::consts::SIGUSR1, end_set_up);
}

/// Sets what stop signals print. The first call counts.
pub fn set_stop_messages(messages: StopMessages) {
    let _ = MESSAGES.set(messages);
}

/// A part of a run begins, which ends the part before. A set-up that begins after a stop signal
/// ends at once.
pub fn begin(part: RunPart) {
    PART.store(part as u8, Ordering::SeqCst);
    if stop_flag().load(Ordering::SeqCst) {
        end_set_up();
    }
}

/// Ends the process if it sets up a run. A signal handler may call it.
fn end_set_up() {
    if PART.load(Ordering::SeqCst) == RunPart::SetUp as u8 {
        write_message(|messages| messages.set_up);
        leave(CAN_GO_ON);
    }
}

/// Writes a message to standard error. A signal handler may call it.
fn write_message(of: impl Fn(&StopMessages) -> &'static str) {
    let message = MESSAGES.get().map_or("", of);
    let _ = rustix::io::write(rustix::stdio::stderr(), message.as_bytes());
}

/// Whether this process ignores a signal, by choice or by inheritance: a bit of its status.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = line.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0);
    ignored >> (signal - 1) & 1 == 1
}

fn stop_on(signal: i32) {
    /// One more than the milliseconds from `start` to the first signal; 0 before it.
    static FIRST: AtomicU64 = AtomicU64::new(0);
    let (flag, start) = (stop_flag(), Instant::now());
    let act = move || {
        if PART.load(Ordering::SeqCst) == RunPart::Classical as u8 {
            let _ = signal_hook::low_level::emulate_default_handler(signal);
            return;
        }
        // In this order: `begin` sets the part and then looks at the flag.
        flag.store(true, Ordering::SeqCst);
        end_set_up();
        let now = start.elapsed().as_millis() as u64 + 1;
        match FIRST.compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed) {
            Ok(_) if PART.load(Ordering::Relaxed) == RunPart::Outside as u8 => {}
            Ok(_) => write_message(|messages| messages.modes),
            Err(first) if now.saturating_sub(first) >= ONE_SIGNAL.as_millis() as u64 => {
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            }
            Err(_) => {}
        }
    };
    on_signal(signal, act);
}

/// Does `act` on a signal, beside what was registered before. It must not allocate, lock or panic.
fn on_signal(signal: i32, act: impl Fn() + Sync + Send + 'static) {
    // SAFETY: the two callers' functions store to atomics, read a clock, write to a descriptor,
    // reset a handler or end the process: nothing that allocates, locks or panics. It fails for
    // signals that cannot be caught only.
    let _ = unsafe { signal_hook::low_level::register(signal, act) };
}

/// Ends the process at once, without the clean-up that waits for other ranks or open files.
pub fn leave(code: i32) -> ! {
    signal_hook::low_level::exit(code)
}

/// Keeps each shared library whose path contains `part` in memory until the process ends, even if
/// its loader unloads it.
pub fn keep_libraries(part: &str) {
    // Lines as "7f…-7f… r-xp 0000 08:01 42   /usr/lib/x.so", one for each part of a library.
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let paths = maps.lines().filter_map(|line| line.find('/').map(|at| &line[at..]));
    let paths: BTreeSet<&str> = paths.filter(|path| path.contains(part)).collect();
    for path in paths.into_iter().filter_map(|path| CString::new(path).ok()) {
        // SAFETY: the path ends with a zero. `RTLD_NOLOAD`: nothing is loaded, so that no code of a
        // library runs. The handle, or null, is not used.
        unsafe {
            libc::dlopen(path.as_ptr(), libc::RTLD_LAZY | libc::RTLD_NOLOAD | libc::RTLD_NODELETE)
        };
    }
}

/// Ends this process when the one that started it ends.
pub fn end_with_parent() {
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
}

/// Limits the address space of this process to `bytes`, and disables core dumps.
pub fn limit_memory(bytes: u64) {
    limit(Resource::As, bytes);
    limit(Resource::Core, 0);
}

/// Seconds of processor time that this process has used.
pub fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Ends this process by SIGXCPU after `seconds` more of processor time, or up to one second later.
pub fn limit_processor_time(seconds: u64) {
    limit(Resource::Cpu, processor_seconds() as u64 + 1 + seconds);
}

/// Sets a limit on a resource of this process, at most the system's own.
fn limit(resource: Resource, most: u64) {
    let Rlimit { maximum, .. } = getrlimit(resource);
    let current = Some(maximum.map_or(most, |maximum| most.min(maximum)));
    // Below the maximum it cannot fail.
    let _ = setrlimit(resource, Rlimit { current, maximum });
}
