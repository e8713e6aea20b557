//! Patterns of answers and facts of pictures, as `tests/conformance/README.md` describes them.

use polyptych_client::Image;
use serde_json::Value;

/// Share by which two numbers that count as equal may differ.
const SHARE: f64 = 1e-9;

/// Returns where a value is not as its pattern says, a sentence each.
pub fn differences(pattern: &Value, value: &Value, place: &str) -> Vec<String> {
    match (pattern, value) {
        (Value::String(any), Value::Null) if any == "*" => vec![format!("{place} is nothing")],
        (Value::String(any), _) if any == "*" => Vec::new(),
        (Value::String(text), Value::String(seen)) if text.starts_with('~') => {
            let is_like = text[1..].split('|').any(|part| seen.contains(part));
            if is_like { Vec::new() } else { vec![format!("{place} is {seen:?}, not like {text}")] }
        }
        (Value::String(text), Value::String(seen)) if text == "#16" => {
            let is_digit = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
            let is_number = seen.len() == 16 && seen.chars().all(is_digit);
            if is_number { Vec::new() } else { vec![format!("{place} is {seen:?}, no digits")] }
        }
        (Value::Object(wanted), Value::Object(given)) => {
            let member = |(name, inner): (&String, &Value)| match given.get(name) {
                Some(of) => differences(inner, of, &format!("{place}.{name}")),
                None => vec![format!("{place} has no {name}")],
            };
            wanted.iter().flat_map(member).collect()
        }
        (Value::Array(wanted), Value::Array(given)) if wanted.len() == given.len() => {
            let pairs = wanted.iter().zip(given).enumerate();
            pairs.flat_map(|(at, (a, b))| differences(a, b, &format!("{place}[{at}]"))).collect()
        }
        (Value::Number(a), Value::Number(b)) if is_near(a.as_f64(), b.as_f64()) => Vec::new(),
        (a, b) if a == b => Vec::new(),
        _ => vec![format!("{place} is {value}, not {pattern}")],
    }
}

fn is_near(a: Option<f64>, b: Option<f64>) -> bool {
    a.zip(b).is_some_and(|(a, b)| (a - b).abs() <= SHARE * a.abs().max(b.abs()).max(1.0))
}

/// Returns which facts do not hold of a picture, a sentence each.
pub fn picture_differences(facts: &Value, image: &Image) -> Vec<String> {
    let size = [image.width, image.height];
    if facts["size"] != serde_json::json!(size) {
        return vec![format!("the picture has {size:?} pixels")];
    }
    let number = |value: &Value| value.as_u64().expect("a number") as usize;
    let mut found = Vec::new();
    for pixel in facts["pixels"].as_array().expect("pixels") {
        let [x, y, tolerance] = [0, 1, 3].map(|index| number(&pixel[index]));
        let at = 4 * (y * image.width as usize + x);
        let seen = &image.rgba[at..at + 3];
        let wanted = pixel[2].as_array().expect("a colour");
        let is_near = |(a, b): (&u8, &Value)| usize::from(*a).abs_diff(number(b)) <= tolerance;
        if !seen.iter().zip(wanted).all(is_near) {
            found.push(format!("pixel {x}, {y} is {seen:?}, not {:?}", pixel[2]));
        }
    }
    found
}
