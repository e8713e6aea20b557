//! Faults of storage that may pass by themselves: a server of files that is started anew, or a
//! process that has too many files open for a moment.

use std::io::{self, ErrorKind};
use std::thread;
use std::time::{Duration, Instant};

/// Maximum time for which an operation is tried again: a server of files is back by then that was
/// started anew, and a supervisor does not wait much longer for a process.
pub const RETRY_TIME_MAX: Duration = Duration::from_secs(5);

/// Pause between two attempts.
pub const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Returns whether another attempt may succeed. `false` if only a person can help, or if storage
/// that works has answered that nothing is there.
pub fn may_pass(error: &io::Error) -> bool {
    !matches!(
        error.kind(),
        ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::ReadOnlyFilesystem
            | ErrorKind::InvalidInput
    )
}

/// Tries again for [`RETRY_TIME_MAX`] what fails with an error that [`may_pass`]; blocks meanwhile.
/// `on_first_fault` is called before the second attempt.
///
/// # Errors
/// That of the last attempt.
pub fn retry<T>(
    attempt: impl FnMut() -> io::Result<T>,
    on_first_fault: impl FnOnce(&io::Error),
) -> io::Result<T> {
    retry_for(RETRY_TIME_MAX, RETRY_PAUSE, attempt, on_first_fault)
}

fn retry_for<T>(
    time: Duration,
    pause: Duration,
    mut attempt: impl FnMut() -> io::Result<T>,
    on_first_fault: impl FnOnce(&io::Error),
) -> io::Result<T> {
    let start = Instant::now();
    let mut on_first_fault = Some(on_first_fault);
    loop {
        match attempt() {
            Err(error) if may_pass(&error) && start.elapsed() < time => {
                if let Some(on_first_fault) = on_first_fault.take() {
                    on_first_fault(&error);
                }
            }
            done => return done,
        }
        thread::sleep(pause);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_mins(1);

    /// Numbers of errors of Linux that come and go: EIO, EMFILE, ESTALE.
    const PASSING: [i32; 3] = [5, 24, 116];

    #[test]
    fn tries_again_what_may_pass_and_tells_once() {
        let mut faults = PASSING.into_iter().map(io::Error::from_raw_os_error);
        let mut told = Vec::new();
        let attempt = || faults.next().map_or(Ok("back"), Err);
        let tell = |error: &io::Error| told.push(error.raw_os_error());
        let done = retry_for(MINUTE, Duration::ZERO, attempt, tell).expect("it is back");
        assert_eq!((done, told), ("back", vec![Some(PASSING[0])]));
    }

    #[test]
    fn returns_at_once_what_only_a_person_can_mend() {
        for kind in [
            ErrorKind::NotFound,
            ErrorKind::PermissionDenied,
            ErrorKind::NotADirectory,
            ErrorKind::InvalidInput,
        ] {
            let mut tried = 0;
            let attempt = || {
                tried += 1;
                Err::<(), io::Error>(kind.into())
            };
            let error = retry_for(MINUTE, Duration::ZERO, attempt, |_| {}).expect_err("refused");
            assert_eq!((error.kind(), tried), (kind, 1));
        }
    }

    #[test]
    fn returns_the_last_error_once_the_time_is_over() {
        let mut tried = 0;
        let attempt = || {
            tried += 1;
            Err::<(), io::Error>(io::Error::from_raw_os_error(PASSING[0]))
        };
        let time = Duration::from_millis(100);
        let error = retry_for(time, Duration::from_millis(1), attempt, |_| {}).expect_err("fails");
        assert_eq!(error.raw_os_error(), Some(PASSING[0]));
        assert!(tried > 1, "{tried}");
    }
}
