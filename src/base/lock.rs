//! A lock that admits one run at a time to a directory. The system releases it when the process
//! ends, even after a crash.

use crate::base::disk::{clear, refused};
use crate::base::error::Result;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Name of the file that is locked; it says who holds the lock.
pub const NAME: &str = "run.lock";

/// How long to wait for a lock: ranks of a killed job end a moment after the job.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// The lock of a directory, held until it is dropped.
#[derive(Debug)]
pub struct DirectoryLock {
    path: PathBuf,
    /// Locked, if the file system can.
    file: File,
    /// Contents of the file, unique to this lock.
    pub text: String,
    /// Why the file system does not lock.
    pub unlocked: Option<String>,
}

impl DirectoryLock {
    /// Makes `directory` and locks it. By one rank.
    ///
    /// Where the file system has no locks, `unlocked` says why, and other runs are not kept out.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`] where the directory cannot be written, or is still
    /// locked after a few seconds.
    pub fn take(directory: &Path) -> Result<Self> {
        Self::within(directory, LONGEST_WAIT)
    }

    /// Locks `directory` as [`take`](Self::take) does, unless it is locked now.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub fn at_once(directory: &Path) -> Result<Self> {
        Self::within(directory, Duration::ZERO)
    }

    fn within(directory: &Path, wait: Duration) -> Result<Self> {
        let failed = |e: std::io::Error| refused(directory, &e);
        std::fs::create_dir_all(directory).map_err(failed)?;
        let path = directory.join(NAME);
        let start = Instant::now();
        loop {
            let mut file = open(&path).map_err(failed)?;
            let unlocked = match file.try_lock() {
                Ok(()) if is_at(&file, &path) => None,
                Err(TryLockError::Error(why)) => Some(why.to_string()),
                // Locked by another run, or removed by its holder before this one got the lock.
                _ if start.elapsed() < wait => {
                    std::thread::sleep(Duration::from_millis(50));
                    continue;
                }
                _ => return Err(failed(std::io::Error::other(in_use(&mut file)))),
            };
            let mut lock = Self { path, file, text: holder(), unlocked };
            let cleared = lock.file.set_len(0);
            cleared.and_then(|()| lock.file.write_all(lock.text.as_bytes())).map_err(failed)?;
            return Ok(lock);
        }
    }
}

impl Drop for DirectoryLock {
    /// Removes the file while it is locked: a waiting process finds that the file is gone.
    fn drop(&mut self) {
        let _ = clear(&self.path);
    }
}

/// Opens the file, which is made where there is none; no link is followed, and a pipe is refused.
fn open(path: &Path) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    let file = options.custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK).open(path)?;
    if file.metadata()?.is_file() {
        Ok(file)
    } else {
        Err(std::io::Error::other(format!("{NAME} in it is no file")))
    }
}

/// Whether `path` still names the open `file`.
fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(found)) = (file.metadata(), std::fs::symlink_metadata(path)) else {
        return false;
    };
    (open.dev(), open.ino()) == (found.dev(), found.ino())
}

/// This process.
fn holder() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let now = humantime::format_rfc3339_nanos(SystemTime::now());
    format!("process {} on {} since {now}\n", std::process::id(), host.trim())
}

/// The message that another run holds the lock of `file`.
fn in_use(file: &mut File) -> String {
    let mut bytes = [0; 200];
    let read = file.rewind().and_then(|()| file.read(&mut bytes)).unwrap_or(0);
    let plain = bytes[..read].iter().filter(|b| b.is_ascii_graphic() || **b == b' ');
    let holder: String = plain.map(|&b| char::from(b)).collect();
    format!(
        "another run writes into it ({NAME}: {holder}); wait for its end, or give another \
         directory (-o)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time() {
        let place = tempfile::tempdir().expect("a directory");
        let directory = place.path().join("deep/down");
        let first = DirectoryLock::take(&directory).expect("a lock");
        assert!(first.unlocked.is_none(), "{:?}", first.unlocked);
        let refusal = DirectoryLock::take(&directory).expect_err("locked").to_string();
        assert!(refusal.contains(first.text.trim()), "{refusal}");
        let asked = Instant::now();
        assert!(DirectoryLock::at_once(&directory).is_err());
        assert!(asked.elapsed() < LONGEST_WAIT);
        drop(first);
        assert!(!directory.join(NAME).exists());
        // The lock of a killed process is free.
        std::fs::write(directory.join(NAME), "process 1\u{1b}[2J").expect("a file");
        drop(DirectoryLock::take(&directory).expect("a lock"));
        // A waiting process gets the lock as soon as it is free.
        let first = DirectoryLock::take(&directory).expect("a lock");
        std::thread::scope(|scope| {
            let second = scope.spawn(|| DirectoryLock::take(&directory));
            std::thread::sleep(Duration::from_millis(300));
            drop(first);
            assert!(second.join().expect("no panic").is_ok());
        });
    }

    #[test]
    fn links_are_not_followed() {
        let place = tempfile::tempdir().expect("a directory");
        let victim = place.path().join("victim");
        std::fs::write(&victim, "text").expect("a file");
        std::os::unix::fs::symlink(&victim, place.path().join(NAME)).expect("a link");
        assert!(DirectoryLock::take(place.path()).is_err());
        assert_eq!(std::fs::read_to_string(&victim).expect("a file"), "text");
    }
}
