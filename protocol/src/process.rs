//! Memory that this process uses.

/// Resident memory in bytes, where the system tells (Linux: `VmRSS`, in KiB).
pub fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib = line.trim().trim_end_matches(" kB").parse::<u64>().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_process_takes_more_than_a_page() {
        assert!(super::resident_bytes() > Some(4096));
    }
}
