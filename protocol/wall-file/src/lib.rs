//! The wall file: TOML in, a checked [`Wall`] out, or an error that names file, line and key.
//!
//! ```text
//! text --source--> TOML with places --document--> sections --check, screen, tiles--> Wall
//!        syntax                       shape                     meaning
//! ```
//!
//! ```
//! let text = r#"
//!     [wall]
//!     name = "desk"
//!     [[screen]]
//!     name = "front"
//!     size = [1.92, 1.08]         # metres
//!     center = [0.0, 0.0, -1.3]
//!     [screen.tiles]
//!     pixels = [1920, 1080]
//! "#;
//! let wall = polyptych_wall_file::parse(text, "desk.toml".as_ref()).unwrap();
//! assert_eq!(wall.channels[0].name, "front");
//!
//! let slip = text.replace("size", "sice");
//! let error = polyptych_wall_file::parse(&slip, "desk.toml".as_ref()).unwrap_err();
//! assert!(error.to_string().starts_with("desk.toml:6:5: screen[0].sice: there is no key"));
//! ```

mod calibration;
mod check;
pub mod check_report;
mod control;
mod cover;
pub mod coverage;
mod curved;
mod device;
pub mod difference;
mod document;
mod error;
mod explicit;
mod files;
mod launch;
mod projector;
mod rotation;
mod schema;
mod screen;
mod source;
mod syntax;
mod tiles;
mod tiling;
mod toml_error;
mod visibility;
mod write;

use std::fs::File;
use std::io::Read;
use std::path::Path;

pub use document::LaunchOutput;
pub use error::WallFileError;
pub use launch::{Launch, ServerLaunch};
pub use schema::schema;
pub use write::to_toml;

use polyptych_wall::Wall;
use source::SourceText;

/// Largest wall file: 1,024 channels by hand take 100 KiB.
pub const WALL_FILE_BYTES_MAX: usize = 1 << 20;

/// Reads and checks a wall file.
///
/// # Errors
/// [`WallFileError`] where the file cannot be read or says no wall.
pub fn load(path: &Path) -> Result<Wall, WallFileError> {
    load_with_launch(path).map(|(wall, _)| wall)
}

/// Reads and checks a wall file, with what it says of starting the wall's processes.
///
/// # Errors
/// Those of [`load`].
pub fn load_with_launch(path: &Path) -> Result<(Wall, Launch), WallFileError> {
    let unreadable = |error: std::io::Error| WallFileError {
        path: path.to_owned(),
        line: 0,
        column: 0,
        key: String::new(),
        what: format!("the file cannot be read: {error}"),
        remedy: "give the path of a wall file".to_owned(),
    };
    let mut bytes = Vec::new();
    // One byte more than allowed tells a file that is too large, and no more is read of it.
    let file = File::open(path).map_err(unreadable)?;
    file.take(WALL_FILE_BYTES_MAX as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    match str::from_utf8(&bytes) {
        Ok(text) => parse_with_launch(text, path),
        Err(_) if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") => {
            Err(WallFileError {
                path: path.to_owned(),
                line: 1,
                column: 1,
                key: String::new(),
                what: "the file is UTF-16 text".to_owned(),
                remedy: "save it as UTF-8".to_owned(),
            })
        }
        Err(error) => {
            let good = String::from_utf8_lossy(&bytes[..error.valid_up_to()]);
            let last_line = good.rsplit('\n').next().unwrap_or_default();
            Err(WallFileError {
                path: path.to_owned(),
                line: good.matches('\n').count() as u32 + 1,
                column: last_line.chars().count() as u32 + 1,
                key: String::new(),
                what: "the file is no UTF-8 text from here on".to_owned(),
                remedy: "save it as UTF-8".to_owned(),
            })
        }
    }
}

/// Checks the text of a wall file. `path` is named in errors, and folders in the file that begin
/// without "/" stand in its folder; nothing is read from it.
///
/// # Errors
/// [`WallFileError`] for the first thing that is wrong: TOML, then shape, then meaning.
pub fn parse(text: &str, path: &Path) -> Result<Wall, WallFileError> {
    parse_with_launch(text, path).map(|(wall, _)| wall)
}

/// Checks the text of a wall file as [`parse`] does, and returns what it says of starting the
/// wall's processes too.
///
/// # Errors
/// Those of [`parse`].
pub fn parse_with_launch(text: &str, path: &Path) -> Result<(Wall, Launch), WallFileError> {
    if text.len() > WALL_FILE_BYTES_MAX {
        return Err(WallFileError {
            path: path.to_owned(),
            line: 1,
            column: 1,
            key: String::new(),
            what: format!("the file is larger than {WALL_FILE_BYTES_MAX} bytes"),
            remedy: "give the path of a wall file".to_owned(),
        });
    }
    let source = SourceText::parse(text, path)?;
    let document = source.document()?;
    let wall = check::wall(&source, &document)?;
    let launch = launch::check(&source, &document, &wall)?;
    Ok((wall, launch))
}

#[cfg(test)]
mod tests;
