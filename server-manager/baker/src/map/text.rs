//! Lines of numbers: what OBJ and Bourke meshes are made of.

use super::super::error::BakeError;
use super::super::uri::shorten;

/// The lines of a text file, counted from 1; `#` begins a comment.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &str)> {
    let lines = bytes.split(|&byte| byte == b'\n');
    (1..).zip(lines).map(|(number, line)| {
        // What is not UTF-8 can only be a name or a comment, and those are not read.
        let line = std::str::from_utf8(line).unwrap_or_default();
        (number, line.split('#').next().unwrap_or_default().trim())
    })
}

/// Returns the name of a line in messages.
pub(super) fn place(line: usize) -> String {
    format!("line {line}")
}

/// The first `N` numbers of a line; what follows is left alone.
pub(super) fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a str>,
    line: usize,
    right: &str,
) -> Result<[f64; N], BakeError> {
    let mut numbers = [0.0; N];
    for slot in &mut numbers {
        let word = words.next().unwrap_or_default();
        let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
        *slot = number.ok_or_else(|| {
            let what = match word {
                "" => "it has too few numbers".to_owned(),
                word => format!("'{}' is not a finite number", shorten(word)),
            };
            BakeError::at(place(line), what, format!("{right} would be right"))
        })?;
    }
    Ok(numbers)
}
