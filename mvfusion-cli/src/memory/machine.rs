//! The memory that this process may still use, by free memory and the limits of control group and shell, and the most
//! that it has used.
//!
//! Linux tells all of these in files. Other systems are not asked.

use std::fs;
use std::path::Path;

/// The memory that this process may use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Available {
    /// Bytes.
    pub bytes: u64,
    /// What limits it, as the rest of a sentence that begins with the number.
    pub limit: String,
}

impl Available {
    /// The smallest of all that limits this process; `None` if nothing is known.
    pub fn on_this_machine() -> Option<Self> {
        let read = |path: &str| fs::read_to_string(path).ok();
        let (limits, status) = (read("/proc/self/limits"), read("/proc/self/status"));
        let of_shell = |name: &str, used: &str, option: &str| {
            let most = limit_of(limits.as_deref()?, name)?;
            let used = kibibytes(status.as_deref()?, used)?;
            let limit = format!("are left of the limit of the shell (`ulimit {option}`)");
            Some(Self { bytes: most.saturating_sub(used), limit })
        };
        let free = read("/proc/meminfo").and_then(|text| kibibytes(&text, "MemAvailable:"));
        let candidates = [
            free.map(|bytes| Self { bytes, limit: "of memory are free".to_owned() }),
            of_group(Path::new("/sys/fs/cgroup"), &read("/proc/self/cgroup").unwrap_or_default()),
            of_shell("Max address space", "VmSize:", "-v"),
            of_shell("Max data size", "VmData:", "-d"),
        ];
        candidates.into_iter().flatten().min_by_key(|available| available.bytes)
    }

    /// `1.5 GiB of memory are free`.
    pub fn sentence(&self) -> String {
        format!("{} {}", super::size(self.bytes as f64), self.limit)
    }
}

/// The most resident memory that this process has used so far, in bytes; `None` if the system does not tell.
pub fn peak() -> Option<u64> {
    kibibytes(&fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// A line `NAME 123 kB`, in bytes.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// The soft limit of a line of `/proc/self/limits`; `None` if there is none.
fn limit_of(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What is left to the control groups of this process, below `root`, the place where they are mounted. `groups` is
/// `/proc/self/cgroup`. A group has the limits of all groups that it is in.
fn of_group(root: &Path, groups: &str) -> Option<Available> {
    /// Names of the files of a version: the limit, the usage, and the part of the usage that can be dropped.
    struct Files {
        limit: &'static str,
        usage: &'static str,
        droppable: &'static str,
    }
    let second = Files { limit: "memory.max", usage: "memory.current", droppable: "inactive_file" };
    let first =
        Files { limit: "memory.limit_in_bytes", usage: "memory.usage_in_bytes", droppable: "total_inactive_file" };
    let left = |folder: &Path, files: &Files| -> Option<u64> {
        let number = |name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
        let (limit, usage) = (number(files.limit)?, number(files.usage)?);
        let statistics = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
        let droppable = statistics.lines().find_map(|line| line.strip_prefix(files.droppable)?.trim().parse().ok());
        Some(limit.saturating_sub(usage.saturating_sub(droppable.unwrap_or(0))))
    };
    let of_line = |line: &str| -> Option<u64> {
        let mut fields = line.splitn(3, ':');
        let (_, controllers, path) = (fields.next()?, fields.next()?, fields.next()?);
        let (mount, files) = match controllers {
            "" => (root.to_owned(), &second),
            _ if controllers.split(',').any(|controller| controller == "memory") => (root.join("memory"), &first),
            _ => return None,
        };
        // In a container, the path may be that of the machine, and only the mount itself is seen.
        let folders = Path::new(path.trim_start_matches('/')).ancestors().map(|below| mount.join(below));
        folders.filter_map(|folder| left(&folder, files)).min()
    };
    let bytes = groups.lines().filter_map(of_line).min()?;
    Some(Available { bytes, limit: "are left of the limit of the control group (container or job)".to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read_as_linux_writes_them() {
        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                      Max data size             unlimited            unlimited            bytes     \n\
                      Max address space         409600000            unlimited            bytes     \n";
        assert_eq!(limit_of(limits, "Max address space"), Some(409_600_000));
        assert_eq!(limit_of(limits, "Max data size"), None);
        assert_eq!(kibibytes("MemTotal:  24 kB\nMemAvailable:       7 kB\n", "MemAvailable:"), Some(7168));
        assert_eq!(kibibytes("MemTotal:  24 kB\n", "MemAvailable:"), None);
    }

    #[test]
    fn the_smallest_of_the_groups_around_counts_and_what_can_be_dropped_is_free() {
        let root = tempfile::tempdir().expect("folder");
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().expect("in the folder")).expect("made");
            fs::write(path, text).expect("written");
        };
        assert_eq!(of_group(root.path(), "0::/a/job\n"), None);
        write("a/memory.max", "1000\n");
        write("a/memory.current", "700\n");
        write("a/memory.stat", "anon 5\ninactive_file 300\n");
        write("a/job/memory.max", "max\n");
        write("a/job/memory.current", "200\n");
        let left = |groups: &str| of_group(root.path(), groups).map(|available| available.bytes);
        assert_eq!(left("0::/a/job\n"), Some(600));
        write("a/job/memory.max", "500\n");
        assert_eq!(left("0::/a/job\n"), Some(300));
        // The first version, in a container that does not see its own path.
        write("memory/memory.limit_in_bytes", "90\n");
        write("memory/memory.usage_in_bytes", "40\n");
        assert_eq!(left("7:cpu:/x\n4:memory:/elsewhere/1\n"), Some(50));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn something_is_known_of_this_machine() {
        let available = Available::on_this_machine().expect("Linux tells");
        assert!(available.bytes > 1 << 20, "{available:?}");
        assert!(available.sentence().contains("iB "), "{}", available.sentence());
        assert!(peak().expect("Linux tells") > 1 << 20);
    }
}
