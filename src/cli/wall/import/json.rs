//! JSON as a [`Tree`]: `serde_json` says whether it is JSON, a second pass where each value stands.

use std::path::Path;

use anyhow::anyhow;

use super::tree::{DEPTH_MAX, Node, Spot, Tree, Value};

/// Reads a JSON text.
pub(super) fn parse(path: &Path, text: &str) -> anyhow::Result<Tree> {
    if let Err(error) = serde_json::from_str::<serde_json::Value>(text) {
        let (line, column) = (error.line(), error.column());
        let what = error.to_string();
        let what = what.split(" at line ").next().unwrap_or_default();
        let remedy = "mend the JSON there";
        return Err(anyhow!("{}:{line}:{column}: file: {what}; {remedy}", path.display()));
    }
    let mut scanner = Scanner { text: text.as_bytes(), at: 0, line: 1, line_start: 0 };
    let root = scanner.value(0).ok_or_else(|| {
        let Spot { line, column } = scanner.spot();
        let what = format!("values lie in each other more than {DEPTH_MAX} deep");
        anyhow!("{}:{line}:{column}: file: {what}; flatten it", path.display())
    })?;
    Ok(Tree::new(path, false, root))
}

/// A text that is JSON, and how far it is read.
struct Scanner<'t> {
    text: &'t [u8],
    at: usize,
    line: u32,
    line_start: usize,
}

impl Scanner<'_> {
    fn spot(&self) -> Spot {
        Spot { line: self.line, column: (self.at - self.line_start) as u32 + 1 }
    }

    /// The next byte that is no white space.
    fn peek(&mut self) -> Option<u8> {
        loop {
            let byte = *self.text.get(self.at)?;
            if !byte.is_ascii_whitespace() {
                return Some(byte);
            }
            self.at += 1;
            if byte == b'\n' {
                (self.line, self.line_start) = (self.line + 1, self.at);
            }
        }
    }

    /// Returns whether the next byte is this one, which is then read.
    fn takes(&mut self, byte: u8) -> Option<bool> {
        let is_next = self.peek()? == byte;
        self.at += usize::from(is_next);
        Some(is_next)
    }

    /// The text of a string, a number or a word.
    fn scalar(&mut self) -> Option<&str> {
        let start = self.at;
        if self.peek()? == b'"' {
            self.at += 1;
            while *self.text.get(self.at)? != b'"' {
                self.at += 1 + usize::from(self.text[self.at] == b'\\');
            }
            self.at += 1;
        } else {
            let is_inside = |byte: &u8| !byte.is_ascii_whitespace() && !b",]}".contains(byte);
            while self.text.get(self.at).is_some_and(is_inside) {
                self.at += 1;
            }
        }
        std::str::from_utf8(self.text.get(start..self.at)?).ok()
    }

    /// `None` where values lie too deep in each other.
    fn value(&mut self, depth: usize) -> Option<Node> {
        if depth > DEPTH_MAX {
            return None;
        }
        let first = self.peek()?;
        let spot = self.spot();
        let value = match first {
            b'{' => {
                self.at += 1;
                let mut entries = Vec::new();
                while !self.takes(b'}')? {
                    let name: String = serde_json::from_str(self.scalar()?).ok()?;
                    self.takes(b':')?;
                    entries.push((name.to_lowercase(), self.value(depth + 1)?));
                    self.takes(b',')?;
                }
                Value::Object(entries)
            }
            b'[' => {
                self.at += 1;
                let mut items = Vec::new();
                while !self.takes(b']')? {
                    items.push(self.value(depth + 1)?);
                    self.takes(b',')?;
                }
                Value::List(items)
            }
            _ => match serde_json::from_str(self.scalar()?).ok()? {
                serde_json::Value::Bool(flag) => Value::Flag(flag),
                serde_json::Value::Number(number) => Value::Number(number.as_f64()?),
                serde_json::Value::String(text) => Value::Text(text),
                _ => Value::Null,
            },
        };
        Some(Node { spot, value })
    }
}
