//! The memory that a process may still take: free memory, within all limits.

use rustix::process::{Resource, getrlimit};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// An array and its bytes; in files the pair of both.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(into = "(String, u64)")]
pub struct NamedBytes {
    /// Name of the array.
    pub name: String,
    /// Its bytes.
    pub bytes: u64,
}

impl NamedBytes {
    /// An array of this name and size.
    pub fn new(name: impl Into<String>, bytes: u64) -> Self {
        Self { name: name.into(), bytes }
    }
}

impl From<NamedBytes> for (String, u64) {
    fn from(array: NamedBytes) -> Self {
        (array.name, array.bytes)
    }
}

/// Bytes that may still be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Available {
    /// Bytes for all processes of this job on this machine together.
    pub together: u64,
    /// Bytes for this process, whatever the others take.
    pub alone: u64,
}

/// The free memory of this machine, within the limits of this process's control groups and of the
/// process itself.
pub fn available() -> Available {
    let root = Path::new("/");
    Available {
        together: free(root).min(control_group_room(root)),
        alone: process_room(Resource::As, "VmSize:").min(process_room(Resource::Data, "VmData:")),
    }
}

/// Largest resident memory of a process so far, in bytes; 0 where the system does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peak {
    /// Resident bytes of all pages.
    pub resident: u64,
    /// Resident bytes without pages of files (programs, libraries, mapped files). The kernel maps
    /// these as far as its page cache has them, and drops them where memory is short, whatever the
    /// program does.
    pub anonymous: u64,
}

/// What was seen of this process so far.
static SEEN: Mutex<ProcessMemory> = Mutex::new(ProcessMemory::NOTHING);

/// What was seen of a process so far, in bytes.
#[derive(Debug)]
struct ProcessMemory {
    peak: Peak,
    /// Pages of files at the last look.
    files: u64,
}

impl ProcessMemory {
    const NOTHING: Self = Self { peak: Peak { resident: 0, anonymous: 0 }, files: 0 };

    /// Looks at a file like `/proc/self/status`.
    fn look(&mut self, status: &Path) -> Peak {
        let text = std::fs::read_to_string(status).unwrap_or_default();
        let value = |key: &str| kilobytes_in(&text, key).unwrap_or(0);
        let [resident, files] = [value("VmHWM:"), value("RssFile:")];
        // If the peak has risen, pages of files at that moment are about as many as before or now.
        // The larger number is taken, so that `anonymous` is not too large.
        let at_peak = if resident > self.peak.resident {
            resident.saturating_sub(files.max(self.files))
        } else {
            0
        };
        let now = value("RssAnon:") + value("RssShmem:");
        let anonymous = self.peak.anonymous.max(at_peak).max(now);
        *self = Self { peak: Peak { resident, anonymous }, files };
        self.peak
    }
}

/// The peaks of this process so far. The system does not say afterwards how much of its peak were
/// pages of files: a run also [marks](mark) where it takes much.
pub fn peak() -> Peak {
    let mut seen = SEEN.lock().unwrap_or_else(PoisonError::into_inner);
    seen.look(Path::new("/proc/self/status"))
}

/// Looks at the memory that the process has now, so that [`peak`] counts it. Called after each step
/// of a run, while its arrays are there, and before memory is given back.
pub fn mark() {
    peak();
}

/// Returns freed memory to the system, which the allocator would otherwise keep.
pub fn give_back() {
    mark();
    // SAFETY: a plain call; it may be made at any time.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Returns freed memory and restarts [`peak`]; if the system cannot, the peak stays that of the
/// whole process.
pub fn reset_peak() {
    give_back();
    // Not every kernel lets a process do this.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    *SEEN.lock().unwrap_or_else(PoisonError::into_inner) = ProcessMemory::NOTHING;
}

/// A value of a file of `/proc` in bytes, given in kB there.
fn kilobytes(path: &Path, key: &str) -> Option<u64> {
    kilobytes_in(&std::fs::read_to_string(path).ok()?, key)
}

/// The value of `key` in the text of such a file, in bytes.
fn kilobytes_in(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find(|l| l.starts_with(key))?;
    let number = line.split_whitespace().nth(1)?.parse::<u64>().ok()?;
    Some(number.saturating_mul(1024))
}

/// Free memory; with overcommit off, at most what the system can still commit.
fn free(root: &Path) -> u64 {
    let value = |key: &str| kilobytes(&root.join("proc/meminfo"), key);
    let free = value("MemAvailable:").unwrap_or(u64::MAX);
    let overcommit = std::fs::read_to_string(root.join("proc/sys/vm/overcommit_memory"));
    match (value("CommitLimit:"), value("Committed_AS:")) {
        (Some(limit), Some(committed)) if overcommit.is_ok_and(|text| text.trim() == "2") => {
            free.min(limit.saturating_sub(committed))
        }
        _ => free,
    }
}

/// Bytes left of a limit of this process (`setrlimit`), of which `key` of `/proc/self/status` is
/// used.
fn process_room(resource: Resource, key: &str) -> u64 {
    let Some(limit) = getrlimit(resource).current else { return u64::MAX };
    let taken = kilobytes(Path::new("/proc/self/status"), key).unwrap_or(0);
    limit.saturating_sub(taken)
}

/// The files in which a version of control groups reports limit and use.
struct ControlGroupFiles {
    /// Limits; a text that is not a number means no limit.
    limits: &'static [&'static str],
    /// Bytes in use.
    used: &'static str,
    /// The key in `memory.stat` of the file pages that the system drops when memory runs short.
    reclaimable: &'static str,
}

const VERSION_1: ControlGroupFiles = ControlGroupFiles {
    limits: &["memory.limit_in_bytes"],
    used: "memory.usage_in_bytes",
    reclaimable: "total_inactive_file ",
};

/// Version 2; beyond `memory.high` the system slows a process down until it stands still.
const VERSION_2: ControlGroupFiles = ControlGroupFiles {
    limits: &["memory.max", "memory.high"],
    used: "memory.current",
    reclaimable: "inactive_file ",
};

/// Bytes left of the memory limits of this process's control group and of all groups around it.
/// `root` is where `/proc` and `/sys` are.
fn control_group_room(root: &Path) -> u64 {
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap_or_default();
    let (groups, mounts) = (read("proc/self/cgroup"), read("proc/self/mountinfo"));
    let rooms = groups.lines().flat_map(|line| {
        // "4:cpu,memory:/a/b" of version 1, "0::/a/b" of version 2.
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, own) = (fields.next().unwrap_or(""), fields.next().unwrap_or("/"));
        let files = match controllers {
            "" => VERSION_2,
            _ if controllers.split(',').any(|c| c == "memory") => VERSION_1,
            _ => return Vec::new(),
        };
        let directories = mount_of(&mounts, controllers.is_empty())
            .map_or(Vec::new(), |mount| directories(&mount, own));
        let room = |path: &PathBuf| group_room(&root.join(path), &files);
        directories.iter().map(room).collect()
    });
    rooms.fold(u64::MAX, u64::min)
}

/// A mount of control groups.
struct Mount {
    /// The group mounted at `point`.
    group: String,
    /// A directory, without its leading slash.
    point: String,
}

/// The mount of version 2, or that of the memory controller of version 1, in the lines of
/// `/proc/self/mountinfo`.
fn mount_of(mounts: &str, version_2: bool) -> Option<Mount> {
    mounts.lines().find_map(|line| {
        let (before, after) = line.split_once(" - ")?;
        let mut kind = after.split(' ');
        let (name, options) = (kind.next()?, kind.nth(1)?);
        let fits = if version_2 {
            name == "cgroup2"
        } else {
            name == "cgroup" && options.split(',').any(|o| o == "memory")
        };
        let mut fields = before.split(' ').skip(3);
        let (group, point) = (fields.next()?, fields.next()?);
        fits.then(|| Mount {
            group: group.to_owned(),
            point: point.trim_start_matches('/').to_owned(),
        })
    })
}

/// The directories in `mount` of the group `own` and of all groups above it. A group that the mount
/// does not contain, as in some containers, is the one at its top.
fn directories(mount: &Mount, own: &str) -> Vec<PathBuf> {
    let top = Path::new(&mount.point);
    let below = Path::new(own).strip_prefix(&mount.group).unwrap_or(Path::new(""));
    let below = if own.contains("/..") { Path::new("") } else { below };
    below.ancestors().map(|path| top.join(path)).collect()
}

/// Bytes left of the limits of the group of `directory`; a missing limit leaves all.
fn group_room(directory: &Path, files: &ControlGroupFiles) -> u64 {
    let text = |name: &str| std::fs::read_to_string(directory.join(name)).ok();
    let number = |name: &str| text(name)?.trim().parse::<u64>().ok();
    let Some(limit) = files.limits.iter().filter_map(|name| number(name)).min() else {
        return u64::MAX;
    };
    let statistics = text("memory.stat").unwrap_or_default();
    let line = statistics.lines().find_map(|line| line.strip_prefix(files.reclaimable));
    let reclaimable = line.and_then(|value| value.trim().parse::<u64>().ok()).unwrap_or(0);
    let used = number(files.used).unwrap_or(0).saturating_sub(reclaimable);
    limit.saturating_sub(used)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    /// A directory with these files.
    fn planted(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("a directory");
        for (name, text) in files {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("a directory");
            std::fs::write(path, text).expect("a file");
        }
        root
    }

    fn room(files: &[(&str, &str)]) -> u64 {
        control_group_room(planted(files).path())
    }

    const MOUNT_1: &str = "31 23 0:28 / /sys/fs/cgroup rw - tmpfs tmpfs rw\n\
        32 31 0:29 / /sys/fs/cgroup/cpu rw,relatime - cgroup cgroup rw,cpu\n\
        35 31 0:32 / /sys/fs/cgroup/memory rw,relatime shared:7 - cgroup cgroup rw,memory\n";
    const MOUNT_2: &str =
        "30 23 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n";

    #[test]
    fn version_2_own_group_and_all_above() {
        let job = "sys/fs/cgroup/slurm/job_7";
        let files = |own: &'static str, above: &'static str| {
            room(&[
                ("proc/self/cgroup", "0::/slurm/job_7/step_0\n"),
                ("proc/self/mountinfo", MOUNT_2),
                (&format!("{job}/step_0/memory.max"), own),
                (&format!("{job}/step_0/memory.current"), "104857600\n"),
                (&format!("{job}/memory.max"), above),
                (&format!("{job}/memory.current"), "209715200\n"),
                ("sys/fs/cgroup/slurm/memory.max", "max\n"),
                ("sys/fs/cgroup/slurm/memory.current", "999999999999\n"),
            ])
        };
        assert_eq!(files("max\n", "max\n"), u64::MAX);
        assert_eq!(files("943718400\n", "max\n"), 800 * MIB);
        assert_eq!(files("943718400\n", "943718400\n"), 700 * MIB);
        assert_eq!(files("max\n", "943718400\n"), 700 * MIB);
        assert_eq!(files("943718400\n", "100\n"), 0);
    }

    #[test]
    fn version_2_pages_of_files_are_given_back_and_high_counts() {
        let mut files = vec![
            ("proc/self/cgroup", "0::/a\n"),
            ("proc/self/mountinfo", MOUNT_2),
            ("sys/fs/cgroup/a/memory.max", "943718400\n"),
            ("sys/fs/cgroup/a/memory.current", "314572800\n"),
            ("sys/fs/cgroup/a/memory.stat", "anon 5\nfile 9\ninactive_file 209715200\n"),
        ];
        assert_eq!(room(&files), 800 * MIB);
        files.push(("sys/fs/cgroup/a/memory.high", "419430400\n"));
        assert_eq!(room(&files), 300 * MIB);
    }

    #[test]
    fn version_1_own_group_and_all_above() {
        let none = "9223372036854771712\n";
        let files = |own: &'static str, above: &'static str| {
            let memory = "sys/fs/cgroup/memory";
            room(&[
                ("proc/self/cgroup", "9:name=systemd:/x\n4:memory:/slurm/job\n1:cpu:/y\n0::/z\n"),
                ("proc/self/mountinfo", MOUNT_1),
                (&format!("{memory}/slurm/job/memory.limit_in_bytes"), own),
                (&format!("{memory}/slurm/job/memory.usage_in_bytes"), "314572800\n"),
                (&format!("{memory}/slurm/job/memory.stat"), "total_inactive_file 209715200\n"),
                (&format!("{memory}/slurm/memory.limit_in_bytes"), above),
                (&format!("{memory}/slurm/memory.usage_in_bytes"), "419430400\n"),
                (&format!("{memory}/memory.limit_in_bytes"), none),
                (&format!("{memory}/memory.usage_in_bytes"), "7777777777\n"),
            ])
        };
        assert_eq!(files("943718400\n", none), 800 * MIB);
        assert_eq!(files("943718400\n", "943718400\n"), 500 * MIB);
        assert!(files(none, none) > 1 << 60);
    }

    #[test]
    fn groups_of_containers() {
        // The container's own group is mounted as if it were the root, under both names.
        let mount = "35 31 0:32 /docker/c0 /sys/fs/cgroup/memory ro - cgroup cgroup rw,memory\n";
        let limit = ("sys/fs/cgroup/memory/memory.limit_in_bytes", "943718400\n");
        let deeper = ("sys/fs/cgroup/memory/task/memory.limit_in_bytes", "524288000\n");
        for (own, expected) in
            [("/docker/c0", 900), ("/docker/c0/task", 500), ("/elsewhere", 900), ("/../c1", 900)]
        {
            let group = format!("4:memory:{own}\n");
            let files = [
                ("proc/self/cgroup", group.as_str()),
                ("proc/self/mountinfo", mount),
                limit,
                deeper,
            ];
            assert_eq!(room(&files), expected * MIB, "{own}");
        }
    }

    #[test]
    fn no_control_groups() {
        assert_eq!(room(&[]), u64::MAX);
        assert_eq!(room(&[("proc/self/cgroup", "0::/\n")]), u64::MAX);
        assert_eq!(room(&[("proc/self/cgroup", "nonsense\n\n:::\n")]), u64::MAX);
    }

    #[test]
    fn overcommit() {
        let meminfo = "MemAvailable: 8000 kB\nCommitLimit: 6000 kB\nCommitted_AS: 5000 kB\n";
        for (mode, kilobytes) in [("0\n", 8000), ("1\n", 8000), ("2\n", 1000)] {
            let root =
                planted(&[("proc/meminfo", meminfo), ("proc/sys/vm/overcommit_memory", mode)]);
            assert_eq!(free(root.path()), kilobytes * 1024, "overcommit_memory {mode}");
        }
    }

    #[test]
    fn this_machine() {
        let found = available();
        assert!(found.together > 0 && found.alone > 0, "{found:?}");
        let peak = peak();
        assert!(peak.anonymous > 0 && peak.anonymous < peak.resident, "{peak:?}");
    }

    #[test]
    fn pages_of_files_are_not_anonymous() {
        let mut seen = ProcessMemory::NOTHING;
        let mut look = |peak: u64, [anonymous, files, shared]: [u64; 3]| {
            let text = format!(
                "VmHWM: {peak} kB\nVmRSS: {} kB\nRssAnon: {anonymous} kB\nRssFile: {files} kB\n\
                 RssShmem: {shared} kB\n",
                anonymous + files + shared
            );
            let root = planted(&[("status", &text)]);
            let Peak { resident, anonymous } = seen.look(&root.path().join("status"));
            [resident / 1024, anonymous / 1024]
        };
        // At the peak there were as many pages of files as now: 80 others.
        assert_eq!(look(100, [10, 20, 5]), [100, 80]);
        // No new peak: pages of files that went are not taken for others.
        assert_eq!(look(100, [60, 2, 0]), [100, 80]);
        // More now, with few pages of files: the system's peak does not show it.
        assert_eq!(look(100, [90, 2, 3]), [100, 93]);
        // A new peak, by pages of files alone.
        assert_eq!(look(140, [90, 47, 3]), [140, 93]);
        // A new peak, after which pages of files were dropped.
        assert_eq!(look(160, [10, 5, 0]), [160, 113]);
    }
}
