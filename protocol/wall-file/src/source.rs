//! A wall file's text with the place of every key, so that each error can point at one.

use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::document::Document;
use super::error::WallFileError;
use super::schema::words_at;
use super::syntax::{Slip, TomlError, diagnose};
use super::toml_error::{Explanation, explain_words, from_serde};

/// The text, and what stands where in it.
pub(super) struct SourceText<'a> {
    path: &'a Path,
    text: &'a str,
    root: Spanned<DeTable<'a>>,
}

impl<'a> SourceText<'a> {
    /// Reads the text as TOML, whatever it may say.
    pub fn parse(text: &'a str, path: &'a Path) -> Result<Self, WallFileError> {
        let (root, errors) = DeTable::parse_recoverable(text);
        let source = Self { path, text, root };
        let spanned = |error: &toml::de::Error| error.span().unwrap_or(0..0);
        let errors: Vec<TomlError<'_>> =
            errors.iter().map(|error| (spanned(error), error.message())).collect();
        let Some(Slip { offset, what, remedy }) = diagnose(text, &errors) else {
            return Ok(source);
        };
        let key = source.key_at(offset).unwrap_or_else(|| source.line_key(offset));
        Err(source.error_at(offset, key, what, remedy))
    }

    /// Reads the TOML as a wall file's shape, whatever its numbers may mean.
    pub fn document(&self) -> Result<Document, WallFileError> {
        self.check_tables()?;
        Document::deserialize(toml::de::Deserializer::from(self.root.clone())).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start);
            let key = self.key_at(offset).unwrap_or_default();
            let complaint = self.words_wanted(&key, offset);
            let is_word = error.message().starts_with("unknown ");
            let complaint = complaint.filter(|_| !is_word);
            let complaint = complaint.unwrap_or_else(|| from_serde(error.message()));
            let Explanation { missing, what, remedy } = complaint;
            match missing {
                // The place is the table's; the key is the one that should be in it. What must
                // stand above all tables is itself a table.
                Some(name) if key.is_empty() => {
                    let remedy = format!("add [{name}] on a line of its own, its keys below");
                    self.error_at(offset, name, what, remedy)
                }
                Some(name) => self.error_at(offset, format!("{key}.{name}"), what, remedy),
                None => self.error_at(offset, key, what, remedy),
            }
        })
    }

    /// An error at a key such as `screen[0].tiles.columns`, or at the nearest table above it where
    /// the file leaves the key out.
    pub fn error(
        &self,
        key: impl Into<String>,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> WallFileError {
        let key = key.into();
        let offset = self.offset_of(&key);
        self.error_at(offset, key, what.into(), remedy.into())
    }

    /// The file, as it was given.
    pub fn path(&self) -> &Path {
        self.path
    }

    fn error_at(&self, offset: usize, key: String, what: String, remedy: String) -> WallFileError {
        let before = &self.text[..self.text.floor_char_boundary(offset)];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        WallFileError {
            path: self.path.to_owned(),
            line: before.matches('\n').count() as u32 + 1,
            column: before[line_start..].chars().count() as u32 + 1,
            key,
            what,
            remedy,
        }
    }

    /// Refuses values where tables belong. serde would take a list for a table, by order.
    fn check_tables(&self) -> Result<(), WallFileError> {
        for (name, value) in self.root.get_ref() {
            let name = name.get_ref().as_ref();
            match name {
                "wall" | "deadline" | "sync" | "network" | "storage" | "blend" => {
                    self.check_table(name, value.get_ref(), name)?;
                }
                "screen" => {
                    self.check_table_list(name, name, value.get_ref())?;
                    for (index, screen) in items(value.get_ref()) {
                        self.check_screen(&format!("screen[{index}]"), screen)?;
                    }
                }
                "channel" => self.check_adjustments(value.get_ref())?,
                "device" => {
                    self.check_table_list(name, name, value.get_ref())?;
                    for (index, device) in items(value.get_ref()) {
                        self.check_device(&format!("device[{index}]"), device)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn check_screen(&self, above: &str, screen: &DeValue<'_>) -> Result<(), WallFileError> {
        for (name, value) in screen.as_table().into_iter().flatten() {
            let name = name.get_ref().as_ref();
            let (key, header) = (format!("{above}.{name}"), format!("screen.{name}"));
            match name {
                "tiles" | "cylinder" | "sphere" => {
                    self.check_table(&key, value.get_ref(), &header)?;
                }
                "channel" | "hidden" => self.check_table_list(&key, &header, value.get_ref())?,
                _ => {}
            }
            for (index, channel) in items(value.get_ref()).filter(|_| name == "channel") {
                let thrown = channel.as_table().and_then(|channel| channel.get("projector"));
                if let Some(thrown) = thrown {
                    let key = format!("{key}[{index}].projector");
                    self.check_table(&key, thrown.get_ref(), "screen.channel.projector")?;
                }
            }
        }
        Ok(())
    }

    fn check_device(&self, above: &str, device: &DeValue<'_>) -> Result<(), WallFileError> {
        for (name, value) in device.as_table().into_iter().flatten() {
            let name = name.get_ref().as_ref();
            if matches!(name, "frame" | "head" | "fly") {
                let key = format!("{above}.{name}");
                self.check_table(&key, value.get_ref(), &format!("device.{name}"))?;
            }
        }
        Ok(())
    }

    fn check_adjustments(&self, channels: &DeValue<'_>) -> Result<(), WallFileError> {
        self.check_table("channel", channels, "channel.NAME")?;
        for (name, channel) in channels.as_table().into_iter().flatten() {
            let key = format!("channel.{}", quoted(name.get_ref()));
            self.check_table(&key, channel.get_ref(), &key)?;
            for part in ["bend", "edges"] {
                let value = channel.get_ref().as_table().and_then(|channel| channel.get(part));
                if let Some(value) = value {
                    let key = format!("{key}.{part}");
                    self.check_table(&key, value.get_ref(), &key)?;
                }
            }
        }
        Ok(())
    }

    fn check_table(
        &self,
        key: &str,
        value: &DeValue<'_>,
        header: &str,
    ) -> Result<(), WallFileError> {
        match value {
            DeValue::Table(_) => Ok(()),
            // [[blend]] for [blend].
            DeValue::Array(items) if items.iter().any(|item| item.get_ref().is_table()) => {
                let what = "found a list of tables where one belongs";
                let remedy = format!("write [{header}] on a line of its own, once");
                Err(self.error(key, what, remedy))
            }
            other => Err(self.no_table(key, other, &format!("[{header}]"))),
        }
    }

    fn check_table_list(
        &self,
        key: &str,
        header: &str,
        value: &DeValue<'_>,
    ) -> Result<(), WallFileError> {
        let header = format!("[[{header}]]");
        let DeValue::Array(items) = value else {
            return Err(self.no_table(key, value, &header));
        };
        let odd = items.iter().enumerate().find(|(_, item)| !item.get_ref().is_table());
        odd.map_or(Ok(()), |(index, item)| {
            Err(self.no_table(&format!("{key}[{index}]"), item.get_ref(), &header))
        })
    }

    fn no_table(&self, key: &str, found: &DeValue<'_>, header: &str) -> WallFileError {
        let kind = match found {
            DeValue::String(_) => "text",
            DeValue::Integer(_) | DeValue::Float(_) => "number",
            DeValue::Array(_) => "list",
            other => other.type_str(),
        };
        let what = match found {
            // [screen] for [[screen]].
            DeValue::Table(_) => "found one table where a list of tables belongs".to_owned(),
            _ => format!("found a {kind} where a table belongs"),
        };
        self.error(key, what, format!("write {header} on a line of its own, its keys below"))
    }

    /// Explains a value that stands where the schema wants one of a few words.
    fn words_wanted(&self, key: &str, offset: usize) -> Option<Explanation> {
        let words = words_at(key);
        if !words.is_empty() {
            return Some(explain_words(&self.value_at(offset), &words));
        }
        let (above, _) = key.rsplit_once('.')?;
        let words = words_at(above);
        (!words.is_empty()).then(|| explain_words("a table", &words))
    }

    /// The value that begins here, in words; of a long one the beginning.
    fn value_at(&self, offset: usize) -> String {
        const CHARS_MAX: usize = 40;
        let rest = self.text[self.text.floor_char_boundary(offset)..].lines().next();
        let value = rest.unwrap_or_default().split(['#', '\n']).next().unwrap_or_default().trim();
        let mut text: String = value.chars().filter(|c| !c.is_control()).take(CHARS_MAX).collect();
        if value.chars().count() > CHARS_MAX {
            text.push('…');
        }
        if value.parse::<f64>().is_ok() { format!("the number {text}") } else { text }
    }

    /// The key whose name or value stands at this place.
    fn key_at(&self, offset: usize) -> Option<String> {
        let mut best = None;
        narrow_table(self.root.get_ref(), "", offset, &mut best);
        best.map(|(_, key)| key)
    }

    /// Returns the key that the lines themselves give here: for text that is no TOML.
    fn line_key(&self, offset: usize) -> String {
        let start = self.text[..self.text.floor_char_boundary(offset)].rfind('\n');
        let (before, here) = self.text.split_at(start.map_or(0, |newline| newline + 1));
        let name = here.lines().next().and_then(|line| line.split_once('='));
        let Some((name, _)) = name else { return String::new() };
        let header = before.lines().rev().find(|line| line.starts_with('['));
        let header = header.map_or("", |line| line.split('#').next().unwrap_or_default());
        let words =
            [header.trim_matches(|c: char| "[]".contains(c) || c.is_whitespace()), name.trim()];
        let key = words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(".");
        key.chars().take(64).filter(|c| !c.is_control()).collect()
    }

    /// Returns the offset of the longest part of the key that exists.
    fn offset_of(&self, key: &str) -> usize {
        let mut offset = 0;
        let mut table = self.root.get_ref();
        for step in steps(key) {
            let mut parts = step.split('[');
            let name = parts.next().unwrap_or_default().trim_matches('"');
            let Some((found, value)) = table.get_key_value(name) else { return offset };
            offset = found.span().start;
            let mut value = value.get_ref();
            for index in parts {
                let index = index.trim_end_matches(']').parse::<usize>().ok();
                let item = index.and_then(|index| value.as_array()?.get(index));
                let Some(item) = item else { return offset };
                offset = item.span().start;
                value = item.get_ref();
            }
            let Some(next) = value.as_table() else { return offset };
            table = next;
        }
        offset
    }
}

/// A name as a step of a key: with quotes where it would be taken for several.
pub(super) fn quoted(name: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if name.chars().all(is_bare) && !name.is_empty() {
        name.to_owned()
    } else {
        format!("{name:?}")
    }
}

/// The steps of a key, which dots between them and not within quotes part.
pub(super) fn steps(key: &str) -> impl Iterator<Item = &str> {
    let mut is_quoted = false;
    key.split(move |c: char| {
        is_quoted ^= c == '"';
        c == '.' && !is_quoted
    })
}

/// The things in a list, with their places.
fn items<'v, 'a>(value: &'v DeValue<'a>) -> impl Iterator<Item = (usize, &'v DeValue<'a>)> {
    let items = value.as_array().into_iter().flatten();
    items.enumerate().map(|(index, item)| (index, item.get_ref()))
}

/// Keeps the smallest thing that stands at `offset`, with the key that leads to it.
fn narrow(best: &mut Option<(usize, String)>, span: &Range<usize>, offset: usize, key: &str) {
    let holds = span.contains(&offset) || (span.is_empty() && span.start == offset);
    if holds && best.as_ref().is_none_or(|(length, _)| span.len() <= *length) {
        *best = Some((span.len(), key.to_owned()));
    }
}

fn narrow_table(
    table: &DeTable<'_>,
    above: &str,
    offset: usize,
    best: &mut Option<(usize, String)>,
) {
    for (name, value) in table {
        let mut key = above.to_owned();
        if !key.is_empty() {
            key.push('.');
        }
        key.push_str(&quoted(name.get_ref()));
        narrow(best, &name.span(), offset, &key);
        narrow_value(value, &key, offset, best);
    }
}

fn narrow_value(
    value: &Spanned<DeValue<'_>>,
    key: &str,
    offset: usize,
    best: &mut Option<(usize, String)>,
) {
    narrow(best, &value.span(), offset, key);
    match value.get_ref() {
        DeValue::Table(table) => narrow_table(table, key, offset, best),
        DeValue::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                narrow_value(item, &format!("{key}[{index}]"), offset, best);
            }
        }
        _ => {}
    }
}
