//! Coverage-guided: the text of a wall file. It is a wall, which can be written and read again,
//! or an error of one line.
#![no_main]

#[path = "../../mutations/wall_text.rs"]
mod wall_text;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    wall_text::check(data);
});
