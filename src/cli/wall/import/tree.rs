//! A foreign configuration, JSON or XML, as one tree whose every value knows its line.
//!
//! Keys are in small letters: writers of the formats spell `masterAddress` and `masteraddress`.

use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::anyhow;
use glam::{DVec2, DVec3};

/// Largest configuration that is read, in bytes; those of real sites take some kilobytes.
pub(super) const CONFIG_BYTES_MAX: u64 = 4 << 20;

/// How deep values may lie in each other; real configurations reach 10.
pub(super) const DEPTH_MAX: usize = 64;

/// A line and a column, both from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Spot {
    pub line: u32,
    pub column: u32,
}

/// A value and its spot in the file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    pub spot: Spot,
    pub value: Value,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Null,
    Flag(bool),
    Number(f64),
    Text(String),
    List(Vec<Node>),
    /// In the order of the file; of XML, children of one name follow each other under it.
    Object(Vec<(String, Node)>),
}

/// A whole configuration, and what the reader has to tell the user about it.
#[derive(Debug)]
pub(super) struct Tree {
    pub path: PathBuf,
    /// XML: numbers are texts, and names that are not known are told, not refused, as the programs
    /// that read such files pass over them.
    pub is_xml: bool,
    pub root: Node,
    /// What is left out, a plain sentence each.
    pub notes: RefCell<Vec<String>>,
    /// What makes the wall look other than it did.
    pub warnings: RefCell<Vec<String>>,
    /// Files that it names and that were looked for, which an import must not replace.
    pub inputs: RefCell<Vec<PathBuf>>,
}

impl Tree {
    pub fn new(path: &Path, is_xml: bool, root: Node) -> Self {
        let [notes, warnings] = [RefCell::default(), RefCell::default()];
        let inputs = RefCell::default();
        Self { path: path.to_owned(), is_xml, root, notes, warnings, inputs }
    }

    /// The root, from where all other values are reached.
    pub fn at(&self) -> At<'_> {
        At { tree: self, key: String::new(), node: &self.root }
    }

    /// Tells once that something is left out.
    pub fn note(&self, sentence: impl Into<String>) {
        push_new(&self.notes, sentence.into());
    }

    /// Tells once that something makes the wall look other than it did.
    pub fn warn(&self, sentence: impl Into<String>) {
        push_new(&self.warnings, sentence.into());
    }

    /// Tells once that channels with this kind of stereo show none.
    pub fn warn_of_stereo(&self, kind: &str) {
        self.warn(format!(
            "stereo {kind} is not known: its channels show what is seen between the eyes; \
             stereo = \"side-by-side\" or eye = \"left\" of [channel] change that"
        ));
    }
}

fn push_new(list: &RefCell<Vec<String>>, sentence: String) {
    let mut list = list.borrow_mut();
    if !list.contains(&sentence) {
        list.push(sentence);
    }
}

/// A place in a tree: a value, and how it is reached.
#[derive(Clone)]
pub(super) struct At<'t> {
    pub tree: &'t Tree,
    /// Such as `nodes[0].windows[1].size`.
    pub key: String,
    pub node: &'t Node,
}

impl fmt::Debug for At<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.key)
    }
}

impl<'t> At<'t> {
    /// One line: file, place, key, what is wrong and what to do.
    pub fn error(&self, what: impl fmt::Display, remedy: impl fmt::Display) -> anyhow::Error {
        let Spot { line, column } = self.node.spot;
        let key = if self.key.is_empty() { "file" } else { &self.key };
        anyhow!("{}:{line}:{column}: {key}: {what}; {remedy}", self.tree.path.display())
    }

    fn below(&self, name: &str, node: &'t Node) -> At<'t> {
        let dot = if self.key.is_empty() { "" } else { "." };
        At { tree: self.tree, key: format!("{}{dot}{name}", self.key), node }
    }

    /// The names and values of an object; nothing of any other value.
    pub fn entries(&self) -> &'t [(String, Node)] {
        match &self.node.value {
            Value::Object(entries) => entries,
            _ => &[],
        }
    }

    /// The value of this name, if there is one that is not null.
    pub fn get(&self, name: &str) -> Option<At<'t>> {
        let (_, node) = self.entries().iter().find(|(key, _)| key == name)?;
        (node.value != Value::Null).then(|| self.below(name, node))
    }

    /// The value of the first of these names that is there.
    pub fn get_any(&self, names: &[&str]) -> Option<At<'t>> {
        names.iter().find_map(|name| self.get(name))
    }

    /// The value of this name.
    pub fn need(&self, name: &str) -> anyhow::Result<At<'t>> {
        self.get(name).ok_or_else(|| {
            let key = if self.key.is_empty() { name } else { &format!("{}.{name}", self.key) };
            At { key: key.to_owned(), ..self.clone() }.error("the key is missing", "add it here")
        })
    }

    /// The elements of a list: in JSON of the list `many`, in XML all elements named `one`.
    pub fn list(&self, many: &str, one: &str) -> anyhow::Result<Vec<At<'t>>> {
        if self.tree.is_xml {
            let elements = self.entries().iter().filter(|(key, _)| key == one);
            let named = |(at, (_, node)): (usize, &'t (String, Node))| {
                self.below(&format!("{one}[{at}]"), node)
            };
            return Ok(elements.enumerate().map(named).collect());
        }
        self.get(many).map_or(Ok(Vec::new()), |list| list.items())
    }

    /// The elements of a JSON list.
    pub fn items(&self) -> anyhow::Result<Vec<At<'t>>> {
        let Value::List(items) = &self.node.value else {
            return Err(self.error("this is no list", "write its elements in [ and ]"));
        };
        let item = |(at, node)| At { tree: self.tree, key: format!("{}[{at}]", self.key), node };
        Ok(items.iter().enumerate().map(item).collect())
    }

    /// Checks that it is an object with no other names than these, and none twice.
    pub fn check_keys(&self, known: &[&str]) -> anyhow::Result<()> {
        let Value::Object(entries) = &self.node.value else {
            return Err(self.error("this is no object", "write keys and values in { and }"));
        };
        for (at, (name, node)) in entries.iter().enumerate() {
            let here = self.below(name, node);
            if matches!(name.as_str(), "include" | "includes" | "$include" | "xi:include") {
                let what = "configurations that include others are not read";
                return Err(here.error(what, "put the other file's text in its place"));
            }
            if !known.contains(&name.as_str()) {
                if self.tree.is_xml {
                    self.tree.note(format!("{name} is not known, and is left out"));
                    continue;
                }
                return Err(here.error("the key is not known", remedy(name, known)));
            }
            if !self.tree.is_xml && entries[..at].iter().any(|(before, _)| before == name) {
                return Err(here.error("the key is given twice", "keep one of the two"));
            }
        }
        Ok(())
    }

    /// Notes the sentences of what is there and switched on, but is left out.
    pub fn leave_out(&self, sentences: &[(&str, &str)]) {
        for (name, sentence) in sentences {
            if self.get(name).is_some_and(|at| at.is_on()) {
                self.tree.note(*sentence);
            }
        }
    }

    /// Returns whether it is anything but false, 0, −1, "none" or empty.
    pub fn is_on(&self) -> bool {
        match &self.node.value {
            Value::Null | Value::Flag(false) => false,
            Value::Number(number) => *number > 0.0,
            Value::Text(text) => {
                let text = text.to_lowercase();
                !["", "0", "-1", "false", "none"].contains(&text.as_str())
            }
            Value::Flag(true) => true,
            Value::List(items) => !items.is_empty(),
            Value::Object(entries) => !entries.is_empty(),
        }
    }

    pub fn text(&self) -> anyhow::Result<&'t str> {
        match &self.node.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.error("this is no text", "write it in quotes")),
        }
    }

    pub fn flag(&self) -> anyhow::Result<bool> {
        match &self.node.value {
            Value::Flag(flag) => Ok(*flag),
            Value::Text(text) if self.tree.is_xml => match text.trim().to_lowercase().as_str() {
                "true" | "1" => Ok(true),
                "false" | "0" => Ok(false),
                _ => Err(self.error(format!("{text:?} is neither"), "write true or false")),
            },
            _ => Err(self.error("this is neither true nor false", "write one of them")),
        }
    }

    /// A finite number.
    pub fn number(&self) -> anyhow::Result<f64> {
        let number = match &self.node.value {
            Value::Number(number) => Some(*number),
            Value::Text(text) if self.tree.is_xml => f64::from_str(text.trim()).ok(),
            Value::Text(text) if f64::from_str(text).is_ok() => {
                return Err(self.error("a number stands in quotes", format!("write {text}")));
            }
            _ => None,
        };
        let finite = number.filter(|number| number.is_finite());
        finite.ok_or_else(|| self.error("this is no number", "write one, such as 1.5"))
    }

    /// A number of pixels or a count, within a range.
    pub fn integer(&self, range: std::ops::RangeInclusive<i64>) -> anyhow::Result<i64> {
        let number = self.number()?;
        let whole = number as i64;
        if number.fract() != 0.0 || !range.contains(&whole) {
            let (low, high) = range.into_inner();
            let remedy = format!("whole numbers of {low} to {high} would be right");
            return Err(self.error(format!("found {number}"), remedy));
        }
        Ok(whole)
    }

    /// The number of this name, or another where there is none.
    pub fn number_or(&self, name: &str, default: f64) -> anyhow::Result<f64> {
        self.get(name).map_or(Ok(default), |at| at.number())
    }

    /// The flag of this name; false where there is none.
    pub fn has(&self, name: &str) -> anyhow::Result<bool> {
        self.get(name).map_or(Ok(false), |at| at.flag())
    }

    /// x and y.
    pub fn pair(&self) -> anyhow::Result<DVec2> {
        Ok(DVec2::new(self.need("x")?.number()?, self.need("y")?.number()?))
    }

    /// x, y and z: a point or a vector in metres.
    pub fn vector(&self) -> anyhow::Result<DVec3> {
        let [x, y, z] = ["x", "y", "z"].map(|axis| self.need(axis).and_then(|at| at.number()));
        let vector = DVec3::new(x?, y?, z?);
        const REACH_M: f64 = 1e5;
        if vector.abs().max_element() > REACH_M {
            let remedy = format!("coordinates within {REACH_M} metres would be right");
            return Err(self.error(format!("{vector} is no place of a room"), remedy));
        }
        Ok(vector)
    }

    /// The vector of this name, or zero where there is none.
    pub fn vector_or_zero(&self, name: &str) -> anyhow::Result<DVec3> {
        self.get(name).map_or(Ok(DVec3::ZERO), |at| at.vector())
    }
}

/// What to write instead of a key that is not known.
fn remedy(name: &str, known: &[&str]) -> String {
    let near = known.iter().min_by_key(|known| distance(name, known));
    match near.filter(|near| distance(name, near) <= 2) {
        Some(near) => format!("perhaps {near} is meant"),
        None => format!("these are: {}", known.join(", ")),
    }
}

/// How many letters differ: Levenshtein's distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let cost = corner + usize::from(x != *y);
            corner = row[j + 1];
            row[j + 1] = cost.min(row[j] + 1).min(corner + 1);
        }
    }
    row[b.len()]
}
