//! The operating system: caches, disks, signals, limits, and the end of the process.

use std::ffi::{CStr, CString};
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Once};
use std::time::{Duration, Instant};

/// Whether the first signal comes too late for a checkpoint.
static NO_CHECKPOINT: AtomicBool = AtomicBool::new(false);

/// Signals closer to each other count as one: `timeout` and launchers send the same one twice.
const ONE_SIGNAL: Duration = Duration::from_millis(500);

/// Bytes of the largest cache that a core has to itself, its share of the second level; 1 MiB where
/// the system does not say.
pub fn cache_per_core() -> u64 {
    const USUAL: u64 = 1 << 20;
    let read = |index: usize, name: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{name}");
        std::fs::read_to_string(path).map_or(String::new(), |text| text.trim().to_owned())
    };
    let Some(index) = (0..8).find(|&i| read(i, "level") == "2") else {
        return USUAL;
    };
    let size = read(index, "size");
    let Some(Ok(kilobytes)) = size.strip_suffix('K').map(str::parse::<u64>) else {
        return USUAL;
    };
    // "0-3,8": the processors that share it.
    let count = |range: &str| {
        let mut ends = range.split('-').map(|end| end.parse::<u64>().ok());
        let first = ends.next().flatten()?;
        Some(ends.next().flatten().unwrap_or(first).saturating_sub(first) + 1)
    };
    let sharing: u64 = (read(index, "shared_cpu_list").split(',').filter_map(count)).sum();
    kilobytes * 1024 / sharing.max(1)
}

/// Bytes that a file in `directory` may grow to: free space, within the process's file-size limit.
pub fn room_for_file(directory: &Path) -> u64 {
    let mut room = u64::MAX;
    if let Ok(path) = CString::new(directory.as_os_str().as_bytes()) {
        // SAFETY: the path is a terminated text; the structure is read only where the call filled
        // it.
        unsafe {
            let mut disk = std::mem::zeroed::<libc::statvfs>();
            if libc::statvfs(path.as_ptr(), &mut disk) == 0 {
                room = (disk.f_bavail as u64).saturating_mul(disk.f_frsize as u64);
            }
        }
    }
    // SAFETY: as above.
    unsafe {
        let mut limit = std::mem::zeroed::<libc::rlimit>();
        if libc::getrlimit(libc::RLIMIT_FSIZE, &mut limit) == 0 {
            room = room.min(limit.rlim_cur as u64);
        }
    }
    room
}

/// Reserves space on disk for a file that is to grow to `bytes`; its size stays. Does nothing where
/// the file system cannot.
///
/// # Errors
/// What the system says: that the disk is full, or the user's share of it.
pub fn reserve(path: &Path, bytes: u64) -> std::io::Result<()> {
    let file = std::fs::File::options().write(true).open(path)?;
    // SAFETY: a plain call on an open file.
    let status = unsafe {
        libc::fallocate(file.as_raw_fd(), libc::FALLOC_FL_KEEP_SIZE, 0, bytes as libc::off_t)
    };
    let error = std::io::Error::last_os_error();
    match error.raw_os_error() {
        Some(libc::ENOSPC | libc::EDQUOT | libc::EFBIG) if status != 0 => Err(error),
        _ => Ok(()),
    }
}

/// Releases the space that [`reserve`] took beyond the file's size.
///
/// # Errors
/// What the system says.
pub fn give_back(path: &Path) -> std::io::Result<()> {
    let file = std::fs::File::options().write(true).open(path)?;
    file.set_len(file.metadata()?.len())
}

/// A file that grows beyond the process's limit shall give an error, not end the process.
pub fn ignore_file_size_signal() {
    // SAFETY: ignoring a signal has no handler that could do harm.
    unsafe {
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
    }
}

/// The flag that SIGUSR1 raises, from the first call on, instead of ending the process.
pub fn stop_flag() -> Arc<AtomicBool> {
    static FLAG: LazyLock<Arc<AtomicBool>> = LazyLock::new(|| {
        let flag = Arc::new(AtomicBool::new(false));
        // Fails for signals that cannot be caught only.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&flag));
        flag
    });
    Arc::clone(&FLAG)
}

/// From now on the first SIGTERM or SIGINT (Ctrl-C) raises [`stop_flag`] too, and the next one ends
/// the process at once. A signal that is ignored stays so. `message` is written to standard error as
/// soon as the first one comes.
pub fn stop_when_terminated(message: &'static str) {
    static BEGUN: Once = Once::new();
    BEGUN.call_once(|| {
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            if !is_ignored(signal) {
                stop_on(signal, message);
            }
        }
    });
}

/// From now on a signal asks for nothing: the run is over. `mpirun` sends SIGTERM to the others
/// when the first rank ends with an error.
pub fn no_more_checkpoints() {
    NO_CHECKPOINT.store(true, Ordering::Relaxed);
}

/// Whether this process, or who started it, chose to ignore a signal.
fn is_ignored(signal: i32) -> bool {
    // SAFETY: the structure is read only where the call filled it.
    unsafe {
        let mut action = std::mem::zeroed::<libc::sigaction>();
        libc::sigaction(signal, std::ptr::null(), &mut action) == 0
            && action.sa_sigaction == libc::SIG_IGN
    }
}

fn stop_on(signal: i32, message: &'static str) {
    /// Milliseconds, and one, from `start` to the first signal; 0 before.
    static FIRST: AtomicU64 = AtomicU64::new(0);
    let (flag, start) = (stop_flag(), Instant::now());
    let act = move || {
        flag.store(true, Ordering::Relaxed);
        let now = start.elapsed().as_millis() as u64 + 1;
        match FIRST.compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed) {
            Ok(_) if NO_CHECKPOINT.load(Ordering::Relaxed) => {}
            // SAFETY: a plain call, which signals may interrupt.
            Ok(_) => unsafe {
                libc::write(libc::STDERR_FILENO, message.as_ptr().cast(), message.len());
            },
            Err(first) if now.saturating_sub(first) >= ONE_SIGNAL.as_millis() as u64 => {
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            }
            Err(_) => {}
        }
    };
    // SAFETY: it stores to atomics, reads a clock, writes to a descriptor, and resets a handler:
    // nothing that allocates, locks or panics. It fails for signals that cannot be caught only.
    let _ = unsafe { signal_hook::low_level::register(signal, act) };
}

/// Ends the process at once, without the clean-up that waits for other ranks or open files.
pub fn leave(code: i32) -> ! {
    // SAFETY: nothing runs afterwards.
    unsafe { libc::_exit(code) }
}

/// Keeps each shared library whose path contains `part` in memory until the process ends, also
/// where whoever loaded it unloads it.
pub fn keep_libraries(part: &str) {
    /// Adds the path of a library to the list that `paths` points to.
    unsafe extern "C" fn add(
        library: *mut libc::dl_phdr_info,
        _size: libc::size_t,
        paths: *mut libc::c_void,
    ) -> libc::c_int {
        // SAFETY: `paths` is the list below, which nothing else refers to during the call; the name
        // is null or ends with a zero.
        unsafe {
            let paths = &mut *paths.cast::<Vec<CString>>();
            if !(*library).dlpi_name.is_null() {
                paths.push(CStr::from_ptr((*library).dlpi_name).to_owned());
            }
        }
        0
    }
    let mut paths: Vec<CString> = Vec::new();
    // SAFETY: `add` has the type that is called, and `paths` outlives the call.
    unsafe { libc::dl_iterate_phdr(Some(add), (&raw mut paths).cast()) };
    for path in paths.iter().filter(|path| path.to_string_lossy().contains(part)) {
        // SAFETY: the library is there already: no code of it runs. The handle is never closed.
        unsafe {
            libc::dlopen(path.as_ptr(), libc::RTLD_LAZY | libc::RTLD_NOLOAD | libc::RTLD_NODELETE)
        };
    }
}

/// Ends this process when the one that started it ends.
pub fn end_with_parent() {
    // SAFETY: a plain call.
    unsafe {
        libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
    }
}

/// Limits the address space of this process to `bytes`, and leaves no core when it fails.
pub fn limit_memory(bytes: u64) {
    limit(libc::RLIMIT_AS, bytes);
    limit(libc::RLIMIT_CORE, 0);
}

/// Ends this process by SIGXCPU when it has used so many `seconds` of processor time more, or up to
/// one more.
pub fn limit_processor_time(seconds: u64) {
    // SAFETY: the structure is read after the call has filled it.
    let used = unsafe {
        let mut used = std::mem::zeroed::<libc::rusage>();
        libc::getrusage(libc::RUSAGE_SELF, &mut used);
        used.ru_utime.tv_sec + used.ru_stime.tv_sec
    };
    limit(libc::RLIMIT_CPU, used as u64 + 1 + seconds);
}

/// Sets a limit on a resource of this process, within what the system lets it have.
fn limit(resource: libc::__rlimit_resource_t, most: u64) {
    // SAFETY: the structure is read only where the call filled it.
    unsafe {
        let mut limit = std::mem::zeroed::<libc::rlimit>();
        if libc::getrlimit(resource, &mut limit) == 0 {
            limit.rlim_cur = (most as libc::rlim_t).min(limit.rlim_max);
            libc::setrlimit(resource, &limit);
        }
    }
}
