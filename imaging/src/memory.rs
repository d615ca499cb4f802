//! How much memory is there for a plan, as Linux tells it.

use std::fs;
use std::path::Path;

/// Where control groups are.
const CGROUPS: &str = "/sys/fs/cgroup";
/// Bytes of a megabyte.
const MB: f64 = 1e6;

/// Memory that can be taken without swapping, MB: what Linux calls available, or less where a control group (version 2)
/// allows less. `None` where neither is told, as on other systems.
pub fn available_memory_mb() -> Option<f64> {
    let read = |path: &Path| fs::read_to_string(path).ok();
    let machine = read(Path::new("/proc/meminfo")).and_then(|text| number_after(&text, "MemAvailable:"));
    let own = read(Path::new("/proc/self/cgroup"));
    let group = own.as_deref().and_then(|text| text.lines().find_map(|line| line.strip_prefix("0::/")));
    // a group may take no more than each of those that it lies in
    let groups = group
        .into_iter()
        .flat_map(|group| Path::new(CGROUPS).join(group).ancestors().map(Path::to_owned).collect::<Vec<_>>());
    let left = groups.take_while(|path| path.starts_with(CGROUPS)).filter_map(|path| {
        let file = |name| read(&path.join(name));
        left_in_group(
            &file("memory.max")?,
            &file("memory.current")?,
            &file("memory.stat").unwrap_or_default(),
        )
    });
    machine.map(|kb| kb * 1e3 * 1.024 / MB).into_iter().chain(left).reduce(f64::min)
}

/// What a control group leaves, MB: its limit less what is taken; files that are only cached can be given up.
fn left_in_group(max: &str, current: &str, stat: &str) -> Option<f64> {
    let (max, current): (f64, f64) = (max.trim().parse().ok()?, current.trim().parse().ok()?);
    let cached = number_after(stat, "inactive_file").unwrap_or(0.0);
    Some((max - (current - cached).max(0.0)).max(0.0) / MB)
}

/// The number that follows a name at the start of a line.
fn number_after(text: &str, name: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_after_a_name_is_found() {
        let text = "MemTotal:       24689764 kB\nMemFree:         1 kB\nMemAvailable:   23000000 kB\n";
        assert_eq!(number_after(text, "MemAvailable:"), Some(23_000_000.0));
        assert_eq!(number_after(text, "SwapFree:"), None);
        assert_eq!(number_after("MemAvailable: many kB", "MemAvailable:"), None);
    }

    #[test]
    fn a_control_group_leaves_its_limit_less_what_is_taken_and_not_cached() {
        let stat = "anon 100\ninactive_file 300000000\nactive_file 5\n";
        assert_eq!(left_in_group("2000000000\n", "800000000\n", stat), Some(1500.0));
        assert_eq!(left_in_group("max\n", "800000000\n", stat), None);
        assert_eq!(left_in_group("100000000\n", "800000000\n", ""), Some(0.0));
    }
}
