//! The identity of a wall: what it is, wherever its file lies and however its path was typed; and
//! the keys in which two wall files differ.

use polyptych_wall::Wall;
use toml::{Table, Value};

use crate::to_toml;

/// Maximum length of a value in a [`KeyChange`], in characters; longer ones are cut.
const VALUE_CHARS_MAX: usize = 120;

/// One key that two wall files give different values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeyChange {
    /// The key, with names in the place of list indices: `screen.front.channel.left.pixels`.
    pub key: String,
    /// The value in the old file, as TOML; `None` if the key is not set there.
    pub old: Option<String>,
    /// The value in the new file, as TOML; `None` if the key is not set there.
    pub new: Option<String>,
}

/// Returns the keys in which the files of two walls differ, apart from paths, sorted by key.
///
/// Screens and channels are compared by name, so their order does not count. One that only one of
/// the walls has is one change.
pub fn differences(old: &Wall, new: &Wall) -> Vec<KeyChange> {
    let table = |wall: &Wall| {
        let mut text = to_toml(&wall.without_paths()).parse::<Table>().unwrap_or_default();
        text.remove("storage");
        text
    };
    let mut changes = Vec::new();
    compare("", &table(old), &table(new), &mut changes);
    changes
}

fn compare(above: &str, old: &Table, new: &Table, changes: &mut Vec<KeyChange>) {
    let mut keys: Vec<&String> = old.keys().chain(new.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    for name in keys {
        let key = if above.is_empty() { name.clone() } else { format!("{above}.{name}") };
        let (old, new) = (old.get(name), new.get(name));
        // What only one file has is one change, but for lists and `[channel.NAME]`: each of theirs.
        let is_parted = |value: &Value| value.is_array() || key.starts_with("channel");
        let parts = |value: Option<&Value>| match value {
            None => Some(Table::new()),
            Some(value) => by_name(value),
        };
        let is_whole = old.is_some() && new.is_some();
        match (parts(old), parts(new)) {
            (Some(old_parts), Some(new_parts))
                if is_whole || old.or(new).is_some_and(is_parted) =>
            {
                compare(&key, &old_parts, &new_parts, changes);
            }
            _ if old != new => {
                changes.push(KeyChange { key, old: old.map(written), new: new.map(written) });
            }
            _ => {}
        }
    }
}

/// Returns a table as it is, and a list of tables with names as a table; `None` for all else.
fn by_name(value: &Value) -> Option<Table> {
    match value {
        Value::Table(table) => Some(table.clone()),
        Value::Array(items) if !items.is_empty() => items
            .iter()
            .map(|item| {
                let table = item.as_table()?;
                let name = table.get("name")?.as_str()?.to_owned();
                Some((name, item.clone()))
            })
            .collect(),
        _ => None,
    }
}

fn written(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(VALUE_CHARS_MAX) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests;
