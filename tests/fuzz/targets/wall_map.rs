//! Coverage-guided: a file of a wall, its first byte the kind. It is a sound map, or refused in one
//! line.
#![no_main]

#[path = "../../mutations/map_file.rs"]
mod map_file;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((&kind, bytes)) = data.split_first() else { return };
    map_file::check(usize::from(kind) % map_file::KINDS.len(), bytes);
});
