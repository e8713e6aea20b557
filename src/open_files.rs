//! The limit of open files.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Allows this process and its children as many open files as the system allows this user: a
/// manager has two for each server and `up` four, and the usual limit is 1,024.
pub(crate) fn raise_limit() {
    let limit = getrlimit(Resource::Nofile);
    // Without it all goes on, and who runs out of files is told so by the system.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_files_are_open_as_may_be() {
        raise_limit();
        let limit = getrlimit(Resource::Nofile);
        assert_eq!(limit.current, limit.maximum);
    }
}
