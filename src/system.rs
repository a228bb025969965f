//! What the operating system says about memory.

/// A value of `/proc/…` in bytes, given in kB there.
fn kilobytes(path: &str, key: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find(|l| l.starts_with(key))?;
    let number = line.split_whitespace().nth(1)?.parse::<u64>().ok()?;
    Some(number * 1024)
}

/// Largest resident memory of this process so far, in bytes; 0 where the system does not say.
pub fn peak_memory() -> u64 {
    kilobytes("/proc/self/status", "VmHWM:").unwrap_or(0)
}

/// Memory that processes on this machine may still take, in bytes: what is free, within the control group's limit.
pub fn available_memory() -> u64 {
    let free = kilobytes("/proc/meminfo", "MemAvailable:").unwrap_or(u64::MAX);
    let read = |path: &str| {
        std::fs::read_to_string(path)
            .ok()?
            .trim()
            .parse::<u64>()
            .ok()
    };
    let limits = [
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        (
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.usage_in_bytes",
        ),
    ];
    limits
        .iter()
        .filter_map(|(limit, used)| Some(read(limit)?.saturating_sub(read(used)?)))
        .fold(free, u64::min)
}
