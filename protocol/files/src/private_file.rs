//! Files that hold secrets: only their owner may read them, and only this user may own them.

use std::fs::Metadata;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

/// Permissions of the group and of all others.
const OTHERS: u32 = 0o077;

/// Returns why a file must not hold a secret, with the remedy; `None` if it may.
///
/// A file of root is good for everybody who can read it: root could read all secrets anyway.
pub fn fault(path: &Path, facts: &Metadata) -> Option<String> {
    let (ours, owner) = (rustix::process::geteuid().as_raw(), facts.uid());
    let path = path.display();
    if owner != ours && owner != 0 {
        return Some(format!(
            "{path} belongs to another user (id {owner}), who knows its secret; make it anew, or \
             run: chown {ours} {path}"
        ));
    }
    (facts.permissions().mode() & OTHERS != 0)
        .then(|| format!("{path} can be read or changed by other users; run: chmod 600 {path}"))
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};

    use super::*;

    #[test]
    fn files_that_others_can_use_are_refused_with_the_remedy() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("secret");
        fs::write(&path, "x").expect("written");
        for (mode, is_private) in
            [(0o600, true), (0o400, true), (0o640, false), (0o604, false), (0o620, false)]
        {
            fs::set_permissions(&path, Permissions::from_mode(mode)).expect("changed");
            let said = fault(&path, &fs::metadata(&path).expect("facts"));
            assert_eq!(said.is_none(), is_private, "{mode:o}: {said:?}");
            assert!(said.is_none_or(|said| said.contains("run: chmod 600 /")));
        }
        // Only root can give files away.
        if rustix::process::geteuid().is_root() {
            std::os::unix::fs::chown(&path, Some(65534), None).expect("given away");
            let said = fault(&path, &fs::metadata(&path).expect("facts")).expect("refused");
            assert!(said.contains("belongs to another user (id 65534)"), "{said}");
        }
    }
}
