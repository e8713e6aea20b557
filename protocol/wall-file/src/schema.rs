//! The JSON Schema of wall files, and what it allows at a key.

use serde_json::Value;

use super::document::Document;
use super::source::steps;

/// The JSON Schema of wall files, as it stands in `configs/wall.schema.json`.
pub fn schema() -> String {
    format!("{:#}\n", value())
}

fn value() -> Value {
    schemars::schema_for!(Document).to_value()
}

/// Returns the words that a key can have as its value, such as `shared` and `own`; none if it takes
/// something else. List indices and names of channels in the key may be any.
pub(super) fn words_at(key: &str) -> Vec<String> {
    let root = value();
    let mut at = resolved(&root, &root);
    for step in steps(key) {
        let (name, indices) = step
            .split_once('[')
            .map_or((step, 0), |(name, rest)| (name, 1 + rest.matches('[').count()));
        let named = at["properties"].get(name).unwrap_or(&at["additionalProperties"]);
        at = resolved(&root, named);
        for _ in 0..indices {
            at = resolved(&root, &at["items"]);
        }
    }
    let word = |value: &Value| value.as_str().map(str::to_owned);
    let choices = at["oneOf"].as_array().into_iter().flatten();
    let described = choices.filter_map(|choice| word(&choice["const"]));
    let listed = at["enum"].as_array().into_iter().flatten().filter_map(word);
    described.chain(listed).collect()
}

/// Returns the value that a reference, or a choice between one value and null, stands for.
fn resolved<'v>(root: &'v Value, value: &'v Value) -> &'v Value {
    if let Some(name) = value["$ref"].as_str().and_then(|path| path.strip_prefix("#/$defs/")) {
        return resolved(root, &root["$defs"][name]);
    }
    let choices = value["anyOf"].as_array().into_iter().flatten();
    match choices.filter(|choice| choice["type"] != "null").collect::<Vec<_>>()[..] {
        [one] => resolved(root, one),
        _ => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_a_key_are_found_through_lists_and_names() {
        assert_eq!(words_at("channel.front.turn"), ["none", "left", "right", "half"]);
        assert_eq!(words_at("channel.\"a.b\".eye"), ["center", "left", "right"]);
        assert_eq!(words_at("screen[3].projection"), ["shared", "own"]);
        for key in ["", "wall.name", "screen[0].channel[1].pixels[0]", "channel.a.gain", "no.such"]
        {
            assert_eq!(words_at(key), <[String; 0]>::default(), "{key}");
        }
    }
}
