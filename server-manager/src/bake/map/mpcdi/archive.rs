//! The zip of an MPCDI archive: entries into memory, each within its limit.
//!
//! Nothing of it is written under a name that it gives.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use zip::ZipArchive;
use zip::result::ZipError;

use super::super::super::error::BakeError;
use super::super::super::uri::shorten;

/// Largest archive: those of dozens of projectors have a few hundred megabytes.
const ARCHIVE_BYTES_MAX: u64 = 4 << 30;

/// Most entries; a projector has four.
const ENTRIES_MAX: usize = 4096;

/// Largest `mpcdi.xml`: a projector takes two kilobytes.
const XML_BYTES_MAX: u64 = 4 << 20;

/// Largest map when inflated: 8,192² points of three floats, and the head.
const ENTRY_BYTES_MAX: u64 = (768 << 20) + 256;

/// Most of all entries together, inflated: eighty maps of 4K.
const TOTAL_BYTES_MAX: u64 = 16 << 30;

/// An open archive.
pub(super) struct Archive {
    zip: ZipArchive<BufReader<File>>,
    bytes_left: u64,
}

impl Archive {
    pub fn open(path: &Path) -> Result<Self, BakeError> {
        let file = File::open(path).map_err(|error| BakeError::io(path, error))?;
        let facts = file.metadata().map_err(|error| BakeError::io(path, error))?;
        if !facts.is_file() || facts.len() > ARCHIVE_BYTES_MAX {
            let what = format!("it has {} bytes, or is no file", facts.len());
            let right = format!("a zip of at most {ARCHIVE_BYTES_MAX} would be right");
            return Err(BakeError::at("file", what, right));
        }
        let zip = ZipArchive::new(BufReader::new(file)).map_err(|error| {
            let what = format!("it can't be read as an archive: {error}");
            BakeError::at("file", what, "an MPCDI archive, which is a zip, would be right")
        })?;
        if zip.len() > ENTRIES_MAX {
            let what = format!("it has {} entries", zip.len());
            return Err(BakeError::at("file", what, format!("{ENTRIES_MAX} would be right")));
        }
        Ok(Self { zip, bytes_left: TOTAL_BYTES_MAX })
    }

    /// The text that says what the others are; some programs call it otherwise.
    pub fn xml(&mut self) -> Result<String, BakeError> {
        let names = ["mpcdi.xml", "mpacs.xml"];
        let known = names.iter().find(|name| self.zip.index_for_name(name).is_some());
        let name = known.unwrap_or(&names[0]);
        let bytes = self.read(name, XML_BYTES_MAX, "archive")?;
        String::from_utf8(bytes)
            .map_err(|_| BakeError::at(*name, "it is not UTF-8", "UTF-8 would be right"))
    }

    /// A map that the XML names at `place`.
    pub fn entry(&mut self, path: &str, place: &str) -> Result<Vec<u8>, BakeError> {
        let name = path.trim().replace('\\', "/");
        let name = name.strip_prefix("./").unwrap_or(&name);
        let leaves = |part: &str| part == ".." || part.ends_with(':');
        if name.starts_with('/') || name.is_empty() || name.split('/').any(leaves) {
            let what = format!("the path '{}' leads out of the archive", shorten(path));
            return Err(BakeError::at(place, what, "the name of an entry would be right"));
        }
        self.read(name, ENTRY_BYTES_MAX, place)
    }

    fn read(&mut self, name: &str, bytes_max: u64, place: &str) -> Result<Vec<u8>, BakeError> {
        let shown = format!("entry '{}'", shorten(name));
        let cannot = |error: &dyn std::fmt::Display| {
            let what = format!("it can't be read: {error}");
            BakeError::at(shown.clone(), what, "a whole entry, stored or deflated, is right")
        };
        let entry = match self.zip.by_name(name) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => {
                let what = format!("the archive has no entry '{}'", shorten(name));
                return Err(BakeError::at(place, what, "each file that it names would be right"));
            }
            Err(error) => return Err(cannot(&error)),
        };
        let bytes_max = bytes_max.min(self.bytes_left);
        let too_large = |bytes: u64| {
            let what = format!("it has {bytes} bytes or more when inflated");
            BakeError::at(shown.clone(), what, format!("at most {bytes_max} can be read"))
        };
        // What the head says is not believed, but it refuses an honest bomb for nothing.
        if entry.size() > bytes_max {
            return Err(too_large(entry.size()));
        }
        let mut bytes = Vec::new();
        let inflated = entry.take(bytes_max + 1).read_to_end(&mut bytes);
        inflated.map_err(|error| cannot(&error))?;
        let length = bytes.len() as u64;
        if length > bytes_max {
            return Err(too_large(length));
        }
        self.bytes_left -= length;
        Ok(bytes)
    }
}
