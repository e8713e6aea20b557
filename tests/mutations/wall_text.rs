//! Checks that must hold for any text that is given as a wall file.

use std::path::Path;

/// Longest error: file, place, key, what is wrong and what would be right, each quoting little.
const ERROR_BYTES_MAX: usize = 4096;

/// A wall that can be used, or an error of one line; gives whether it is a wall.
pub fn check(bytes: &[u8]) -> bool {
    let Ok(text) = str::from_utf8(bytes) else { return false };
    match polyptych_wall_file::parse(text, Path::new("wall.toml")) {
        Ok(wall) => {
            assert_eq!(wall.fault(), None);
            for id in wall.channel_ids() {
                let channel = wall.channel(id).expect("its own");
                // Curved screens are drawn in planes of their own.
                let is_flat = wall.screen_of(channel).plane().is_some();
                let frustum = wall.frustum(id, wall.eye);
                assert!(frustum.is_ok() || !is_flat, "{channel:?} has no frustum");
                assert!(wall.channel_mapping(id).is_some(), "{channel:?} has no picture");
            }
            let written = polyptych_wall_file::to_toml(&wall);
            let again = polyptych_wall_file::parse(&written, Path::new("wall.toml"));
            assert!(again.is_ok(), "{again:?} of\n{written}");
            true
        }
        Err(error) => {
            let line = error.to_string();
            assert!(line.starts_with("wall.toml:"), "{line}");
            assert!(!line.contains(char::is_control), "{line:?} is not one line");
            assert!(line.len() < ERROR_BYTES_MAX, "{} bytes: {line}", line.len());
            false
        }
    }
}
