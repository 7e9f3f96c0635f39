//! Available memory of the host: what the machine has, and what the control groups of the process leave it.

use std::path::Path;

use crate::error::IoError;
use instgs_vk::scene::gaussians::sh_coefficients;

/// Where control groups are, from the root of the file system.
const CONTROL_GROUPS: &str = "sys/fs/cgroup";
/// Folder of version 1 below it whose groups limit memory.
const V1_MEMORY: &str = "memory";
/// Files of a group with its limit and with what it uses, bytes, by version.
const V1_FILES: [&str; 2] = ["memory.limit_in_bytes", "memory.usage_in_bytes"];
const V2_FILES: [&str; 2] = ["memory.max", "memory.current"];

/// Memory that is available without swapping, bytes: that of the machine, or what the limits of containers and batch jobs
/// (control groups) leave if that is less. `None` if it is unknown, as it is on systems other than Linux.
pub fn available_bytes() -> Option<u64> {
    available_below(Path::new("/"))
}

/// The same for the files of a system below `root`.
fn available_below(root: &Path) -> Option<u64> {
    let of_machine = text_of(&root.join("proc/meminfo")).and_then(|text| available_of(&text));
    let groups = text_of(&root.join("proc/self/cgroup")).unwrap_or_default();
    let left = groups.lines().filter_map(|line| left_by_line(line, &root.join(CONTROL_GROUPS)));
    of_machine.into_iter().chain(left).min()
}

fn text_of(file: &Path) -> Option<String> {
    std::fs::read_to_string(file).ok()
}

/// Parses the text of `/proc/meminfo`; the result is in bytes.
fn available_of(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// What the groups of one line of `/proc/self/cgroup` leave, bytes; `None` if none of them limits memory. Each group above the
/// named one has a limit of its own; in a container, only those above may be visible.
fn left_by_line(line: &str, mount: &Path) -> Option<u64> {
    // The number of the hierarchy, its controllers, of which version 2 names none, and the group's path.
    let mut parts = line.splitn(3, ':').skip(1);
    let (controllers, group) = (parts.next()?, parts.next()?);
    let (top, files) = match controllers {
        "" => (mount.to_owned(), V2_FILES),
        _ if controllers.split(',').any(|name| name == V1_MEMORY) => (mount.join(V1_MEMORY), V1_FILES),
        _ => return None,
    };
    let folder = top.join(group.trim_start_matches('/'));
    let groups = folder.ancestors().take_while(|above| above.starts_with(&top));
    groups.filter_map(|group| left_in(group, files)).min()
}

/// What a group leaves of its limit, bytes; `None` if it has none. What the system gives up when memory is wanted counts as left.
fn left_in(group: &Path, [limit, usage]: [&str; 2]) -> Option<u64> {
    // Without a limit the text is "max" (version 2).
    let bytes = |file: &str| text_of(&group.join(file))?.trim().parse::<u64>().ok();
    let limit = bytes(limit)?;
    let given_up = text_of(&group.join("memory.stat")).map_or(0, |text| given_up_of(&text));
    Some(limit.saturating_sub(bytes(usage).unwrap_or(0).saturating_sub(given_up)))
}

/// Parses the text of a group's `memory.stat`: bytes of files in memory, and of the kernel's own notes, that are given up when memory
/// is wanted, as those of `MemAvailable` are. Version 1 has two numbers of each, of which `total_` includes the groups below, as the
/// usage does.
fn given_up_of(text: &str) -> u64 {
    let bytes = |name: &str| {
        let number = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))?;
        number.trim().parse::<u64>().ok()
    };
    let of = |name: &str| bytes(&format!("total_{name}")).or_else(|| bytes(name)).unwrap_or(0);
    ["inactive_file", "active_file", "slab_reclaimable"].map(of).into_iter().fold(0, u64::saturating_add)
}

/// Bytes of a Gaussian in memory.
pub(crate) fn gaussian_bytes(sh_degree: u32) -> u64 {
    4 * (3 + 4 + 3 + 1 + 3 * sh_coefficients(sh_degree) as u64)
}

/// Checks that reading a file takes no more memory than there is. Both are in bytes; `have` is that of [`available_bytes`].
/// `what` is the beginning of the message, up to the number: "takes", or what of the file takes so much.
///
/// # Errors
/// It takes more than is available.
pub(crate) fn check_reading(path: &Path, what: &str, need: u64, have: Option<u64>) -> Result<(), IoError> {
    match have {
        Some(have) if need > have => {
            let (need, have) = (need >> 20, have >> 20);
            Err(IoError::too_large(path, format!("{what} {need} MiB to read, {have} MiB are available")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn available_memory_is_read_or_unknown() {
        let text = "MemTotal:       16318412 kB\nMemFree:          201044 kB\nMemAvailable:   12021044 kB\n";
        assert_eq!(available_of(text), Some(12_021_044 << 10));
        for text in ["", "MemAvailable: much kB\n", "MemAvailable: 12\n", "MemAvailable: 99999999999999999 kB\n"] {
            assert_eq!(available_of(text), None, "{text}");
        }
    }

    /// A system with 8000 KiB of memory, the process's groups, and files of groups.
    fn system(groups: &str, files: &[(&str, &str)]) -> Result<tempfile::TempDir, std::io::Error> {
        let root = tempfile::tempdir()?;
        let all = [("proc/meminfo", "MemAvailable: 8000 kB\n"), ("proc/self/cgroup", groups)];
        for (file, text) in all.into_iter().chain(files.iter().copied()) {
            let path = root.path().join(file);
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            std::fs::write(path, text)?;
        }
        Ok(root)
    }

    #[test]
    fn limits_of_groups_of_version_2_count_with_those_above() -> Outcome {
        const GROUP: &str = "0::/slurm/job_7/step_0\n";
        let available = |files: &[(&str, &str)]| system(GROUP, files).map(|root| available_below(root.path()));
        assert_eq!(available(&[])?, Some(8_192_000));
        let job = [
            ("sys/fs/cgroup/slurm/job_7/step_0/memory.max", "max\n"),
            ("sys/fs/cgroup/slurm/job_7/step_0/memory.current", "10\n"),
            ("sys/fs/cgroup/slurm/job_7/memory.max", "5000000\n"),
            ("sys/fs/cgroup/slurm/job_7/memory.current", "3000000\n"),
        ];
        assert_eq!(available(&job)?, Some(2_000_000));
        // Files that lie in memory, and what the kernel keeps of them, are no reason to refuse anything.
        let text = "anon 9\ninactive_file 500000\nactive_file 70\nslab_reclaimable 8\nslab_unreclaimable 900000\n";
        let stat = ("sys/fs/cgroup/slurm/job_7/memory.stat", text);
        assert_eq!(available(&[&job[..], &[stat]].concat())?, Some(2_500_078));
        let more = ("sys/fs/cgroup/slurm/job_7/memory.stat", "inactive_file 9000000\n");
        assert_eq!(available(&[&job[..], &[more]].concat())?, Some(5_000_000), "never more than the limit");
        // The least of all, at any height; a group that uses more than its limit has nothing left.
        let above = [("sys/fs/cgroup/slurm/memory.max", "100\n"), ("sys/fs/cgroup/slurm/memory.current", "300\n")];
        assert_eq!(available(&[&job[..], &above[..]].concat())?, Some(0));
        let wide = [("sys/fs/cgroup/slurm/memory.max", "999999999999\n")];
        assert_eq!(available(&wide)?, Some(8_192_000), "the machine has less");
        Ok(())
    }

    /// In a container the named group may be that of the host, of which only the folder of all groups is visible.
    #[test]
    fn limits_of_groups_of_version_1_and_of_containers_count() -> Outcome {
        const GROUPS: &str =
            "9:cpu,cpuacct:/docker/ab\n4:memory:/docker/ab\n1:name=systemd:/docker/ab\n0::/docker/ab\n";
        let own = [
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "4000000\n"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "1000000\n"),
            ("sys/fs/cgroup/memory/memory.stat", "inactive_file 5\ntotal_inactive_file 200000\n"),
            ("sys/fs/cgroup/cpu/docker/ab/memory.limit_in_bytes", "1\n"),
        ];
        assert_eq!(available_below(system(GROUPS, &own)?.path()), Some(3_200_000));
        // No limit is a very large one.
        let none = [("sys/fs/cgroup/memory/docker/ab/memory.limit_in_bytes", "9223372036854771712\n")];
        assert_eq!(available_below(system(GROUPS, &none)?.path()), Some(8_192_000));
        let namespace = [("sys/fs/cgroup/memory.max", "3000\n"), ("sys/fs/cgroup/memory.current", "1000\n")];
        for group in ["0::/\n", "0::/../../elsewhere\n"] {
            assert_eq!(available_below(system(group, &namespace)?.path()), Some(2000), "{group}");
        }
        for group in ["", "0\n", "0:\n", ":::\n"] {
            assert_eq!(available_below(system(group, &[])?.path()), Some(8_192_000), "{group:?}");
        }
        Ok(())
    }

    #[test]
    fn what_does_not_fit_is_an_error_that_says_how_much() {
        let check = |need, have| check_reading(Path::new("x.spz"), "takes", need, have).map_err(|e| e.to_string());
        assert_eq!((check(9, Some(9)), check(u64::MAX, None)), (Ok(()), Ok(())));
        let text = check(3 << 20, Some(1 << 20)).err().unwrap_or_default();
        assert!(text.starts_with("x.spz: takes 3 MiB to read, 1 MiB are available; "), "{text}");
    }
}
