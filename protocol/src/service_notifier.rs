//! Tells a supervisor that this process is ready, that it works, and that it ends.
//!
//! systemd listens at the socket that `NOTIFY_SOCKET` names, as `man sd_notify` describes: one
//! datagram for each message. Supervisors that only run a command to learn the same, such as
//! Kubernetes, read a file: its text says how far the process is, and its time of modification
//! when it last worked.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

/// Names the socket of the service manager; `@` begins a name without a file.
const SOCKET_VARIABLE: &str = "NOTIFY_SOCKET";

/// The time without a sign of life after which the service manager ends this process, in
/// microseconds, and the process that it means.
const WATCHDOG_VARIABLE: &str = "WATCHDOG_USEC";
const WATCHDOG_PID_VARIABLE: &str = "WATCHDOG_PID";

/// Number of signs of life in the time that the service manager grants: one or two may be lost.
const SIGNS_PER_WATCHDOG: u32 = 3;

/// Maximum time between two signs of life, without a watchdog too: a status line that a person
/// reads is not older.
const PERIOD_MAX: Duration = Duration::from_secs(2);

/// Minimum time between two signs of life: more often, they would be work in every frame.
const PERIOD_MIN: Duration = Duration::from_millis(10);

/// Maximum bytes of a status: one line of `systemctl status`.
const STATUS_BYTES_MAX: usize = 200;

/// The states of a process in its file.
const STARTING: &str = "starting\n";
const READY: &str = "ready\n";

/// A failure to reach the supervisor.
#[derive(Debug, thiserror::Error)]
pub enum NotifierError {
    /// The socket's address is of no kind that is known.
    #[error("{SOCKET_VARIABLE}={0:?} is no path of a socket, nor a name that begins with \"@\"")]
    Address(String),
    /// The system gave no socket.
    #[error("no socket for {SOCKET_VARIABLE}: {0}")]
    Socket(io::Error),
    /// The file cannot be written.
    #[error("--alive {path}: it cannot be written: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

/// Tells the supervisor of this process about it; every thread may.
///
/// A message that is not taken is dropped, and so costs no thread any time: signs of life come
/// again, and they repeat what was dropped.
#[derive(Debug)]
pub struct ServiceNotifier {
    socket: Option<(UnixDatagram, SocketAddr)>,
    file: Option<PathBuf>,
    period: Duration,
    is_ready: AtomicBool,
    status: Mutex<Status>,
}

/// The last status, which may not have been taken yet.
#[derive(Debug, Default)]
struct Status {
    text: String,
    is_unsent: bool,
}

/// The variables of a service manager.
#[derive(Clone, Copy, Debug, Default)]
struct Environment<'e> {
    socket: Option<&'e OsStr>,
    watchdog_usec: Option<&'e OsStr>,
    watchdog_pid: Option<&'e OsStr>,
}

impl ServiceNotifier {
    /// Returns a notifier for the service manager that the environment names and for this file;
    /// `None` if there is neither.
    ///
    /// # Errors
    /// [`NotifierError`].
    pub fn from_environment(file: Option<&Path>) -> Result<Option<Self>, NotifierError> {
        let [socket, usec, pid] = [SOCKET_VARIABLE, WATCHDOG_VARIABLE, WATCHDOG_PID_VARIABLE]
            .map(|name| std::env::var_os(name).filter(|value| !value.is_empty()));
        let environment = Environment {
            socket: socket.as_deref(),
            watchdog_usec: usec.as_deref(),
            watchdog_pid: pid.as_deref(),
        };
        Self::new(environment, std::process::id(), file)
    }

    fn new(
        environment: Environment<'_>,
        pid: u32,
        file: Option<&Path>,
    ) -> Result<Option<Self>, NotifierError> {
        let socket = environment.socket.map(open).transpose()?;
        if socket.is_none() && file.is_none() {
            return Ok(None);
        }
        let number = |text: Option<&OsStr>| text?.to_str()?.parse::<u64>().ok();
        let is_ours = number(environment.watchdog_pid).is_none_or(|meant| meant == u64::from(pid));
        let watchdog = number(environment.watchdog_usec).filter(|usec| is_ours && *usec > 0);
        let watchdog = watchdog.map(|usec| Duration::from_micros(usec) / SIGNS_PER_WATCHDOG);
        let notifier = Self {
            socket,
            file: file.map(Path::to_owned),
            period: watchdog.unwrap_or(PERIOD_MAX).clamp(PERIOD_MIN, PERIOD_MAX),
            is_ready: AtomicBool::new(false),
            status: Mutex::default(),
        };
        notifier.write_state().map_err(|source| NotifierError::File {
            path: notifier.file.clone().unwrap_or_default(),
            source,
        })?;
        Ok(Some(notifier))
    }

    /// The time between two signs of life, from 10 ms to 2 s.
    pub fn period(&self) -> Duration {
        self.period
    }

    /// Says that this process does what it is there for; again is no harm.
    pub fn ready(&self) {
        if !self.is_ready.swap(true, Ordering::Relaxed) {
            self.send("READY=1\n");
            // A file that can't be written grows old, which says the same.
            let _ = self.write_state();
        }
    }

    /// Says how this process stands, in a line for people; the same as before is not repeated.
    pub fn status(&self, text: &str) {
        let end = text.floor_char_boundary(STATUS_BYTES_MAX);
        let text = text[..end].replace(|c: char| c.is_control(), " ");
        let mut last = self.last_status();
        if last.text != text {
            let is_unsent = !self.send(&format!("STATUS={text}\n"));
            *last = Status { text, is_unsent };
        }
    }

    fn last_status(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says that the loop of this process has come around. To be called from that loop alone: a
    /// thread that calls it while the loop hangs would hide that.
    pub fn alive(&self) {
        let mut message = String::from("WATCHDOG=1\n");
        if self.is_ready.load(Ordering::Relaxed) {
            message.push_str("READY=1\n");
        }
        let mut last = self.last_status();
        if last.is_unsent {
            message.push_str("STATUS=");
            message.push_str(&last.text);
            message.push('\n');
        }
        if self.send(&message) {
            last.is_unsent = false;
        }
        drop(last);
        // A file that can't be touched grows old, which says the same.
        let file = self.file.as_ref().map(|path| File::options().write(true).open(path));
        if let Some(Ok(file)) = file {
            let _ = file.set_modified(SystemTime::now());
        }
    }

    /// Says that this process ends because it was asked to.
    pub fn stopping(&self) {
        self.send("STOPPING=1\n");
        if let Some(path) = &self.file {
            // It may be gone already.
            let _ = std::fs::remove_file(path);
        }
    }

    /// Returns whether the message was taken, or there is no socket for one.
    fn send(&self, message: &str) -> bool {
        let Some((socket, to)) = &self.socket else { return true };
        socket.send_to_addr(message.as_bytes(), to).is_ok()
    }

    /// Writes the file anew, so that no reader sees half of it.
    fn write_state(&self) -> io::Result<()> {
        let Some(path) = &self.file else { return Ok(()) };
        let state = if self.is_ready.load(Ordering::Relaxed) { READY } else { STARTING };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let mut file = tempfile::NamedTempFile::new_in(folder.unwrap_or(Path::new(".")))?;
        file.write_all(state.as_bytes())?;
        file.persist(path).map(drop).map_err(|error| error.error)
    }
}

fn open(address: &OsStr) -> Result<(UnixDatagram, SocketAddr), NotifierError> {
    let unknown = || NotifierError::Address(address.to_string_lossy().into_owned());
    let to = match address.as_bytes() {
        [b'/', ..] => SocketAddr::from_pathname(address),
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name),
        _ => return Err(unknown()),
    };
    let to = to.map_err(|_| unknown())?;
    let socket = UnixDatagram::unbound().map_err(NotifierError::Socket)?;
    socket.set_nonblocking(true).map_err(NotifierError::Socket)?;
    Ok((socket, to))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(socket: &UnixDatagram) -> Vec<String> {
        let mut bytes = [0; 1024];
        let mut all = Vec::new();
        while let Ok(count) = socket.recv(&mut bytes) {
            all.push(String::from_utf8_lossy(&bytes[..count]).into_owned());
        }
        all
    }

    fn listener(address: &SocketAddr) -> UnixDatagram {
        let socket = UnixDatagram::bind_addr(address).expect("bound");
        socket.set_nonblocking(true).expect("set");
        socket
    }

    #[test]
    fn a_service_manager_hears_each_message_at_a_path_or_a_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let name = format!("@polyptych-test-{}", std::process::id());
        let by_name = SocketAddr::from_abstract_name(&name.as_bytes()[1..]).expect("a name");
        let by_path = SocketAddr::from_pathname(&path).expect("a path");
        for (text, address) in [(path.as_os_str(), by_path), (OsStr::new(&name), by_name)] {
            let socket = listener(&address);
            let environment = Environment {
                socket: Some(text),
                watchdog_usec: Some(OsStr::new("600000")),
                watchdog_pid: Some(OsStr::new("7")),
            };
            let notifier = ServiceNotifier::new(environment, 7, None).expect("opened");
            let notifier = notifier.expect("there is a socket");
            assert_eq!(notifier.period(), Duration::from_millis(200));
            notifier.status("no manager\nyet");
            notifier.status("no manager\nyet");
            notifier.alive();
            notifier.ready();
            notifier.ready();
            notifier.alive();
            notifier.stopping();
            let expected = [
                "STATUS=no manager yet\n",
                "WATCHDOG=1\n",
                "READY=1\n",
                "WATCHDOG=1\nREADY=1\n",
                "STOPPING=1\n",
            ];
            assert_eq!(heard(&socket), expected);
        }
    }

    #[test]
    fn what_was_not_taken_comes_with_the_next_sign_of_life() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let environment = Environment { socket: Some(path.as_os_str()), ..Environment::default() };
        let notifier = ServiceNotifier::new(environment, 1, None).expect("opened");
        let notifier = notifier.expect("there is a socket");
        notifier.ready();
        notifier.status("lost");
        let socket = listener(&SocketAddr::from_pathname(&path).expect("a path"));
        notifier.alive();
        notifier.alive();
        let expected = ["WATCHDOG=1\nREADY=1\nSTATUS=lost\n", "WATCHDOG=1\nREADY=1\n"];
        assert_eq!(heard(&socket), expected);
    }

    #[test]
    fn a_file_says_how_far_the_process_is_and_when_it_last_worked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("alive");
        let none = Environment::default();
        let notifier = ServiceNotifier::new(none, 1, Some(&path)).expect("opened").expect("a file");
        let read = || std::fs::read_to_string(&path).expect("a file");
        assert_eq!(read(), "starting\n");
        notifier.ready();
        assert_eq!(read(), "ready\n");
        let old = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let file = File::options().write(true).open(&path).expect("opened");
        file.set_modified(old).expect("set");
        notifier.alive();
        let modified = path.metadata().and_then(|facts| facts.modified()).expect("a time");
        assert!(modified > old + Duration::from_secs(1_000));
        notifier.stopping();
        assert!(!path.exists());
        // A sign of life after the end makes no file again.
        notifier.alive();
        assert!(!path.exists());
    }

    #[test]
    fn an_environment_that_means_another_process_or_nothing_is_told_apart() {
        let none = Environment::default();
        assert!(ServiceNotifier::new(none, 1, None).expect("nothing to open").is_none());
        for odd in ["vsock:2:1234", "notify"] {
            let environment = Environment { socket: Some(OsStr::new(odd)), ..none };
            let made = ServiceNotifier::new(environment, 1, None);
            let error = made.expect_err(odd).to_string();
            assert!(error.contains(odd), "{error}");
        }
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("alive");
        let environment = Environment {
            watchdog_usec: Some(OsStr::new("600000")),
            watchdog_pid: Some(OsStr::new("8")),
            ..none
        };
        let notifier = ServiceNotifier::new(environment, 7, Some(&file)).expect("opened");
        assert_eq!(notifier.expect("a file").period(), PERIOD_MAX);
        let missing = folder.path().join("no/such");
        let error = ServiceNotifier::new(none, 7, Some(&missing)).expect_err("no folder");
        assert!(error.to_string().contains("--alive"), "{error}");
    }
}
