//! Coverage-guided: a scene file. It is baked into a sound manifest, or refused in one line.
#![no_main]

#[path = "../../mutations/scene_file.rs"]
mod scene_file;

use libfuzzer_sys::{Corpus, fuzz_target};

fuzz_target!(|data: &[u8]| -> Corpus {
    scene_file::with_place(|place| place.check(data));
    Corpus::Keep
});
