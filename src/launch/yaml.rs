//! JSON values as YAML that a person reads: blocks of keys and lists, all texts in JSON's quotes,
//! so that none is taken for a number or a word such as `no`. YAML 1.2 takes JSON's texts as they
//! are.

use serde_json::Value;

/// Returns a value as the text of a YAML document, with a newline at its end.
pub(super) fn to_yaml(value: &Value) -> String {
    let mut text = String::new();
    put(value, 0, &mut text);
    text.trim_start_matches('\n').to_owned() + "\n"
}

fn put(value: &Value, depth: usize, text: &mut String) {
    match value {
        Value::Object(map) if !map.is_empty() => {
            for (key, value) in map {
                begin_line(depth, text);
                text.push_str(&key_text(key));
                text.push(':');
                put_behind(value, depth + 1, text);
            }
        }
        Value::Array(items) if !items.is_empty() => {
            for item in items {
                begin_line(depth, text);
                text.push('-');
                put_item(item, depth + 1, text);
            }
        }
        _ => text.push_str(&value.to_string()),
    }
}

/// Adds a value behind its key: a block stands on the lines below.
fn put_behind(value: &Value, depth: usize, text: &mut String) {
    if !is_block(value) {
        text.push(' ');
    }
    put(value, depth, text);
}

/// Adds a value behind the dash of a list: the first key of a block stands on the same line.
fn put_item(item: &Value, depth: usize, text: &mut String) {
    let mut own = String::new();
    put(item, depth, &mut own);
    text.push(' ');
    text.push_str(own.trim_start());
}

fn is_block(value: &Value) -> bool {
    match value {
        Value::Object(map) => !map.is_empty(),
        Value::Array(items) => !items.is_empty(),
        _ => false,
    }
}

fn begin_line(depth: usize, text: &mut String) {
    text.push('\n');
    text.push_str(&"  ".repeat(depth));
}

/// Returns a key: plain if no reader could take it for anything else.
fn key_text(key: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
    let is_plain = key.starts_with(|c: char| c.is_ascii_alphabetic())
        && key.chars().all(plain)
        && !["y", "n", "yes", "no", "on", "off", "true", "false", "null"]
            .contains(&key.to_ascii_lowercase().as_str());
    if is_plain { key.to_owned() } else { Value::from(key).to_string() }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_become_blocks_with_texts_in_quotes() {
        let value = json!({
            "empty": {},
            "items": [{ "name": "a: b", "port": 80 }, ["x", []], "no\n\"x\""],
            "kind": "List", "none": [], "on": true,
        });
        let expected = "empty: {}\nitems:\n  - name: \"a: b\"\n    port: 80\n  - - \"x\"\n\
                        \x20   - []\n  - \"no\\n\\\"x\\\"\"\nkind: \"List\"\n\
                        none: []\n\"on\": true\n";
        assert_eq!(to_yaml(&value), expected);
        assert_eq!(to_yaml(&json!("x")), "\"x\"\n");
    }
}
