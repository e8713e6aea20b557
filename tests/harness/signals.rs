//! Signals to processes that a test started, and a look at what is left of them.

use std::fs;
use std::path::Path;

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

/// Sends a signal; the process may be gone already.
pub fn send(pid: u32, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid as i32) {
        let _ = kill_process(pid, signal);
    }
}

/// Sends a signal to all processes of a group, which has the number of its first process.
pub fn send_to_group(pid: u32, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid as i32) {
        let _ = kill_process_group(pid, signal);
    }
}

/// The processes that have this text in their environment: a folder of one test only is in that
/// of all that it started, whoever their parents are by now.
pub fn processes_of(folder: &Path) -> Vec<u32> {
    let folder = folder.as_os_str().as_encoded_bytes();
    let ids = fs::read_dir("/proc").expect("/proc is there").filter_map(|entry| {
        let pid: u32 = entry.ok()?.file_name().to_str()?.parse().ok()?;
        // A process that has just ended has none; one of another user is none of ours.
        let environment = fs::read(format!("/proc/{pid}/environ")).ok()?;
        environment.windows(folder.len()).any(|bytes| bytes == folder).then_some(pid)
    });
    ids.collect()
}

/// The threads of a process with the number of the system call in which each waits, to see why it
/// does not end.
pub fn threads_of(pid: u32) -> String {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let thread = |task: fs::DirEntry| {
        let read = |of| fs::read_to_string(task.path().join(of)).unwrap_or_default();
        let call = read("syscall").split(' ').next().map(str::to_owned).unwrap_or_default();
        format!("{}: {}", read("comm").trim(), call.trim())
    };
    tasks.map(thread).collect::<Vec<_>>().join(", ")
}

/// Returns whether a process stands still, as SIGSTOP has it.
pub fn is_stopped(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // The field behind the name.
    stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('T'))
}

/// The arguments of a process; none where it is gone.
pub fn arguments_of(pid: u32) -> Vec<String> {
    let bytes = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    bytes.split(|byte| *byte == 0).map(|part| String::from_utf8_lossy(part).into_owned()).collect()
}

/// Returns the value of a variable in a process's environment; `None` if it is not set or the
/// process is gone.
pub fn variable_of(pid: u32, name: &str) -> Option<String> {
    let bytes = fs::read(format!("/proc/{pid}/environ")).ok()?;
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let mut variables = text.split('\0').filter_map(|variable| variable.split_once('='));
    variables.find(|(key, _)| *key == name).map(|(_, value)| value.to_owned())
}

/// Resident memory of a process in bytes, where it is there.
pub fn memory_bytes_of(pid: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: u64 = line.trim().trim_end_matches(" kB").parse().ok()?;
    Some(kib * 1024)
}
