//! The zip of an MPCDI archive: entries into memory, each within its limit.
//!
//! Nothing of it is written under a name that it gives. A file that is no zip but the text itself
//! (`NAME.mpcdi.xml`, as programs write that send the maps to projectors) has no other entries.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
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

/// Names of the text that programs give it, the standard's first.
const XML_NAMES: [&str; 2] = ["mpcdi.xml", "mpacs.xml"];

/// Bytes of an entry of a central directory before its name: *APPNOTE.TXT*, 4.3.12.
const DIRECTORY_HEAD_BYTES: usize = 46;

/// An open archive.
pub(super) struct Archive {
    /// `None` of a text without maps.
    zip: Option<ZipArchive<BufReader<File>>>,
    bytes_left: u64,
    /// The folder of the text, from which paths begin if not from the top.
    folder: String,
}

impl Archive {
    pub fn open(path: &Path) -> Result<Self, BakeError> {
        let mut file = File::open(path).map_err(|error| BakeError::io(path, error))?;
        let facts = file.metadata().map_err(|error| BakeError::io(path, error))?;
        if !facts.is_file() || facts.len() > ARCHIVE_BYTES_MAX {
            let what = format!("it has {} bytes, or is no file", facts.len());
            let right = format!("a zip of at most {ARCHIVE_BYTES_MAX} would be right");
            return Err(BakeError::at("file", what, right));
        }
        let is_text = is_text(&mut file).map_err(|error| BakeError::io(path, error))?;
        let folder = String::new();
        if is_text {
            return Ok(Self { zip: None, bytes_left: TOTAL_BYTES_MAX, folder });
        }
        let mut zip = ZipArchive::new(BufReader::new(file)).map_err(|error| {
            let what = format!("it can't be read as an archive: {error}");
            BakeError::at("file", what, "an MPCDI archive, which is a zip, would be right")
        })?;
        if zip.len() > ENTRIES_MAX {
            let what = format!("it has {} entries", zip.len());
            return Err(BakeError::at("file", what, format!("{ENTRIES_MAX} would be right")));
        }
        if let Some(name) = twice(path, &mut zip)? {
            let what = format!("the entry '{}' is there twice", shorten(&name));
            return Err(BakeError::at("file", what, "each name once would be right"));
        }
        Ok(Self { zip: Some(zip), bytes_left: TOTAL_BYTES_MAX, folder })
    }

    /// The text that says what the others are, and a note where it has another name.
    pub fn xml(&mut self, path: &Path, notes: &mut Vec<String>) -> Result<String, BakeError> {
        let Some(zip) = &self.zip else {
            let text = std::fs::read(path).map_err(|error| BakeError::io(path, error))?;
            notes.push("it is the text of an archive alone, without maps".to_owned());
            return text_of(text, "file");
        };
        let mut names = names(zip);
        names.sort();
        let name_only = |name: &str| name.rsplit(['/', '\\']).next().unwrap_or(name).to_owned();
        let known = |name: &&String| {
            XML_NAMES.iter().any(|known| name_only(name).eq_ignore_ascii_case(known))
        };
        let is_xml = |name: &&String| name.to_ascii_lowercase().ends_with(".xml");
        let exact = XML_NAMES.iter().find_map(|known| names.iter().find(|name| name == known));
        let found = exact.or_else(|| names.iter().find(known));
        let mut others = names.iter().filter(is_xml);
        let name = match (found, others.next(), others.next()) {
            (Some(name), ..) | (None, Some(name), None) => name.clone(),
            (None, Some(_), Some(_)) => {
                let what = "it has several XML, and none is called mpcdi.xml";
                return Err(BakeError::at("archive", what, "mpcdi.xml would be right"));
            }
            (None, None, _) => XML_NAMES[0].to_owned(),
        };
        if name != XML_NAMES[0] && names.contains(&name) {
            notes.push(format!(
                "its text is called '{}', where the standard says mpcdi.xml",
                shorten(&name)
            ));
        }
        self.folder = name.rfind('/').map_or(String::new(), |end| name[..=end].to_owned());
        let bytes = self.read(&name, XML_BYTES_MAX, "archive")?;
        text_of(bytes, &name)
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
        let found = self.found(name).unwrap_or_else(|| name.to_owned());
        self.read(&found, ENTRY_BYTES_MAX, place)
    }

    /// The entry that a path means: from the top, from the folder of the text, or in other
    /// capitals where that is one.
    fn found(&self, name: &str) -> Option<String> {
        let zip = self.zip.as_ref()?;
        let beside = format!("{}{name}", self.folder);
        let exact = [name, &beside].into_iter().find(|name| zip.index_for_name(name).is_some());
        let alike = || {
            let is_like = |known: &String| {
                let known = known.replace('\\', "/");
                known.eq_ignore_ascii_case(name) || known.eq_ignore_ascii_case(&beside)
            };
            let mut like = names(zip).into_iter().filter(is_like);
            like.next().filter(|_| like.next().is_none())
        };
        exact.map(str::to_owned).or_else(alike)
    }

    fn read(&mut self, name: &str, bytes_max: u64, place: &str) -> Result<Vec<u8>, BakeError> {
        let shown = format!("entry '{}'", shorten(name));
        let cannot = |error: &dyn std::fmt::Display| {
            let what = format!("it can't be read: {error}");
            BakeError::at(shown.clone(), what, "a whole entry, stored or deflated, is right")
        };
        let missing = || {
            let what = format!("the archive has no entry '{}'", shorten(name));
            BakeError::at(place, what, "each file that it names would be right")
        };
        let zip = self.zip.as_mut().ok_or_else(missing)?;
        let entry = match zip.by_name(name) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => return Err(missing()),
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

/// The names of all entries that can be read.
fn names(zip: &ZipArchive<BufReader<File>>) -> Vec<String> {
    zip.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect()
}

fn text_of(bytes: Vec<u8>, name: &str) -> Result<String, BakeError> {
    let text = String::from_utf8(bytes)
        .map_err(|_| BakeError::at(name, "it is not UTF-8", "UTF-8 would be right"))?;
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}

/// Returns whether a file begins as XML does; it is left at its beginning.
fn is_text(file: &mut File) -> std::io::Result<bool> {
    let length = file.metadata()?.len();
    let mut head = Vec::new();
    file.take(64).read_to_end(&mut head)?;
    file.seek(SeekFrom::Start(0))?;
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&head);
    Ok(length <= XML_BYTES_MAX && head.trim_ascii_start().starts_with(b"<"))
}

/// A name that two entries have, of which a reader shows one only.
fn twice(path: &Path, zip: &mut ZipArchive<BufReader<File>>) -> Result<Option<String>, BakeError> {
    let mut directory = Vec::new();
    let mut read = || {
        let mut file = File::open(path)?;
        file.seek(SeekFrom::Start(zip.central_directory_start()))?;
        // Names and comments of so many entries take no more.
        file.take((ENTRIES_MAX as u64) << 12).read_to_end(&mut directory)
    };
    read().map_err(|error| BakeError::io(path, error))?;
    let mut names = BTreeSet::new();
    let mut rest = directory.as_slice();
    while let Some(head) = rest.get(..DIRECTORY_HEAD_BYTES)
        && head.starts_with(b"PK\x01\x02")
    {
        let side = |at: usize| usize::from(u16::from_le_bytes([head[at], head[at + 1]]));
        let (name, others) = (side(28), side(30) + side(32));
        let end = DIRECTORY_HEAD_BYTES + name;
        let Some(bytes) = rest.get(DIRECTORY_HEAD_BYTES..end) else { break };
        if !names.insert(bytes) {
            return Ok(Some(String::from_utf8_lossy(bytes).into_owned()));
        }
        rest = rest.get(end + others..).unwrap_or_default();
    }
    Ok(None)
}
