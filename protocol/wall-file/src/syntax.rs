//! Text that is no TOML: the usual slips, each with its place, what is wrong, and what to write.
//!
//! The `toml` crate says what it expected next. What a person has done differs often from that:
//! `[4.0 2.25]` is a missing comma, not a text without quotes.

use std::ops::Range;

/// One mistake in the text of a wall file.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Slip {
    /// Offset of the mistake in bytes.
    pub offset: usize,
    /// The fault.
    pub what: String,
    /// The text to write instead.
    pub remedy: String,
}

/// Longest part of the text that is repeated in a message, in characters.
const QUOTED_CHARS_MAX: usize = 40;

/// Characters that look like a space, or like nothing.
const ODD_SPACES: &[char] = &[
    '\u{a0}', '\u{1680}', '\u{2000}', '\u{2001}', '\u{2002}', '\u{2003}', '\u{2004}', '\u{2005}',
    '\u{2006}', '\u{2007}', '\u{2008}', '\u{2009}', '\u{200a}', '\u{200b}', '\u{200c}', '\u{200d}',
    '\u{2028}', '\u{2029}', '\u{202f}', '\u{205f}', '\u{2060}', '\u{3000}', '\u{feff}',
];

/// Characters that word processors write instead of a quote.
const ODD_QUOTES: &[char] = &['“', '”', '„', '‟', '«', '»', '‘', '’', '‚', '`', '´'];

/// Characters that word processors write instead of a minus.
const ODD_MINUSES: &[char] = &['−', '–', '—', '‐', '‑'];

/// An error of the `toml` crate: where it stands, and what it says.
pub(super) type TomlError<'e> = (Range<usize>, &'e str);

/// Returns the first mistake in a text that has these errors; `None` if there are none.
pub(super) fn diagnose(text: &str, errors: &[TomlError<'_>]) -> Option<Slip> {
    // The parser goes on behind a mistake, and may then take a table for a second one.
    let order = |(span, message): &&TomlError<'_>| (*message == "duplicate key", span.start);
    let (span, message) = errors.iter().min_by_key(order)?;
    if let Some(slip) = unclosed_list(text, span.start, errors) {
        return Some(slip);
    }
    let place = Place::new(text, span);
    let (message, expected) = message.split_once(", expected ").unwrap_or((message, ""));
    let slip = place.odd_character().or_else(|| match message {
        "string values must be quoted" => Some(place.bare_value()),
        "unexpected key or value" => Some(place.rest_of_line()),
        "key with no value" | "invalid unquoted key" => Some(place.key()),
        "duplicate key" => Some(place.duplicate()),
        _ => place.by_message(message),
    });
    slip.or_else(|| {
        let remedy = if expected.is_empty() {
            "this line must be TOML".to_owned()
        } else {
            format!("expected {expected}")
        };
        Some(place.slip(message, remedy))
    })
}

/// A list that goes on into the lines of other keys: its end is missing, whatever comes of that.
fn unclosed_list(text: &str, first: usize, errors: &[TomlError<'_>]) -> Option<Slip> {
    let tells = |(_, message): &TomlError<'_>| {
        message.starts_with("unexpected `=` in array") || message.starts_with("unclosed array,")
    };
    let (span, _) = errors.iter().find(|error| tells(error))?;
    let offset = open_bracket(text, span.start)?;
    (offset <= first).then(|| Slip {
        offset,
        what: "the list that begins here is not closed".to_owned(),
        remedy: "write ] behind its last element".to_owned(),
    })
}

/// The last bracket before this place that nothing has closed.
fn open_bracket(text: &str, end: usize) -> Option<usize> {
    let mut open = Vec::new();
    let (mut quote, mut is_comment) = (None, false);
    for (at, c) in text.char_indices().take_while(|(at, _)| *at < end) {
        match c {
            '\n' => (quote, is_comment) = (None, false),
            _ if is_comment => {}
            '"' | '\'' if quote.is_none() => quote = Some(c),
            _ if quote.is_some() => quote = quote.filter(|quote| *quote != c),
            '#' => is_comment = true,
            '[' => open.push(at),
            ']' => drop(open.pop()),
            _ => {}
        }
    }
    open.pop()
}

/// The surroundings of an error.
struct Place<'t> {
    offset: usize,
    /// The text that the error is about.
    found: &'t str,
    /// The line before it, without leading spaces.
    before: &'t str,
    /// The line from it on.
    rest: &'t str,
    text: &'t str,
}

impl<'t> Place<'t> {
    fn new(text: &'t str, span: &Range<usize>) -> Self {
        let offset = text.floor_char_boundary(span.start);
        let end = text.floor_char_boundary(span.end.max(offset));
        let line = text[..offset].rfind('\n').map_or(0, |newline| newline + 1);
        let rest = text[offset..].lines().next().unwrap_or_default();
        let found = text[offset..end].lines().next().unwrap_or_default();
        Self { offset, found, before: text[line..offset].trim_start(), rest, text }
    }

    fn slip(&self, what: impl Into<String>, remedy: impl Into<String>) -> Slip {
        Slip { offset: self.offset, what: what.into(), remedy: remedy.into() }
    }

    /// Returns whether it is an element of a list.
    fn is_in_list(&self) -> bool {
        let before = self.text[..self.offset].trim_end();
        before.ends_with(['[', ',']) && open_bracket(self.text, self.offset).is_some()
    }

    /// A character that looks like another one, or like none.
    fn odd_character(&self) -> Option<Slip> {
        let until = self.found.len().max(self.rest.chars().next().map_or(0, char::len_utf8));
        let part = &self.rest[..self.rest.floor_char_boundary(until)];
        let (at, odd) = part.char_indices().find(|(_, c)| {
            ODD_SPACES.contains(c)
                || ODD_QUOTES.contains(c)
                || ODD_MINUSES.contains(c)
                || (c.is_control() && !matches!(c, '\t' | '\r'))
        })?;
        let code = format!("U+{:04X}", u32::from(odd));
        let (what, remedy) = if ODD_SPACES.contains(&odd) {
            (format!("found {code}, which looks like a space and is none"), "write a plain space")
        } else if ODD_QUOTES.contains(&odd) {
            (format!("found the typographic quote {odd} ({code})"), "write straight quotes, \"…\"")
        } else if ODD_MINUSES.contains(&odd) {
            (format!("found {odd} ({code}) for a minus"), "write a plain minus, -")
        } else {
            (format!("found the control character {code}"), "remove it")
        };
        Some(Slip { offset: self.offset + at, what, remedy: remedy.to_owned() })
    }

    /// A value that is no number, no text in quotes and nothing else of TOML.
    fn bare_value(&self) -> Slip {
        let found = self.found.trim();
        let value = shortened(found);
        if let Some(slip) = self.word(found) {
            return slip;
        }
        let words: Vec<&str> = found.split([' ', '\t', ';']).filter(|w| !w.is_empty()).collect();
        let are_values = words.len() > 1 && words.iter().all(|word| is_value(word));
        if found.is_empty() {
            return self.slip("the value is missing", "write one behind =");
        }
        let are_thousands = |words: &[&str]| {
            let is_group = |word: &&str| word.len() == 3 && word.parse::<u32>().is_ok();
            words.iter().skip(1).all(is_group) && words.iter().skip(1).any(|w| w.starts_with('0'))
        };
        if are_values && are_thousands(&words) {
            return self.slip("a number has no spaces", format!("write {}", words.concat()));
        }
        if self.is_in_list() && are_values {
            let remedy = format!("write {}", shortened(&words.join(", ")));
            return self.slip("a comma is missing between array elements", remedy);
        }
        if let Some(at) = found.find("//").or_else(|| found.find(" ;")).filter(|at| *at > 0) {
            let (value, comment) = found.split_at(at);
            let comment = shortened(comment.trim_start_matches([' ', '/', ';']));
            let remedy = format!("write {} # {comment}", value.trim_end());
            return self.slip("a comment begins with #", remedy);
        }
        if found.starts_with('(') {
            let remedy = "write [ and ], with commas between";
            return self.slip("a list stands in square brackets", remedy);
        }
        let behind = self.rest.get(self.found.len()..).unwrap_or_default().trim_start();
        if behind.starts_with('=') {
            return self.two_keys();
        }
        if are_values {
            let remedy = format!("write one of them, or a list: [{}]", words.join(", "));
            return self.slip(format!("found {value}, several values where one belongs"), remedy);
        }
        if let Some(number) = number_before_unit(found) {
            let what = format!("found {value}: a number stands without its unit");
            return self.slip(what, format!("write {number}; the key says in which unit"));
        }
        if let Some([width, height]) = size(found) {
            return self.slip("a size is a list", format!("write [{width}, {height}]"));
        }
        if found.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) {
            let remedy = "write a number such as 0.5, or a text in quotes";
            return self.slip(format!("{value} is no number"), remedy);
        }
        self.slip("a text must stand in quotes", format!("write \"{value}\""))
    }

    /// A word that means a value in other languages.
    fn word(&self, found: &str) -> Option<Slip> {
        let remedy = match found.to_lowercase().as_str() {
            "true" | "yes" | "y" | "on" => "write true",
            "false" | "no" | "n" | "off" => "write false",
            "none" | "null" | "nil" | "undefined" => "leave the key out",
            "nan" | "inf" | "infinity" => "write a number, or leave the key out",
            _ => return None,
        };
        Some(self.slip(format!("{found} is no value"), remedy))
    }

    fn two_keys(&self) -> Slip {
        if self.before.contains('{') {
            return self.slip("a comma is missing between the keys in braces", "write one");
        }
        self.slip("two keys stand on one line", "write each on a line of its own")
    }

    /// Explains the text behind a whole value or header.
    fn rest_of_line(&self) -> Slip {
        let value = self.before.split_once('=').map_or("", |(_, value)| value.trim());
        if let Some(rest) = self.rest.strip_prefix(',') {
            let is_decimal = rest.starts_with(|c: char| c.is_ascii_digit())
                && value.chars().all(|c| c.is_ascii_digit() || "+-".contains(c));
            let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
            if is_decimal && rest.trim_end() == digits {
                let remedy = format!("write {value}.{digits}, or a list: [{value}, {digits}]");
                return self.slip("a number has a decimal point, not a comma", remedy);
            }
            let list = shortened(format!("{value}{}", self.rest).trim_end().trim_end_matches(','));
            return self.slip("a list stands in square brackets", format!("write [{list}]"));
        }
        if self.rest.starts_with(']') {
            return self.slip("there is one ] too many", "remove it");
        }
        if self.rest.starts_with('}') {
            return self.slip("there is one } too many", "remove it");
        }
        if self.before.starts_with('[') && value.is_empty() {
            let what = "a header stands on a line of its own";
            return self.slip(what, "write the keys on the lines below");
        }
        if self.rest.contains('=') {
            return self.two_keys();
        }
        let what = format!("found {} behind the value", shortened(self.rest.trim_end()));
        self.slip(what, "write one value, and comments behind #")
    }

    /// A key that has no value, or is none.
    fn key(&self) -> Slip {
        let line = [self.before, self.rest].concat();
        let line = line.trim_end();
        let name = line.split([' ', '\t', ':', '=', ']']).next().unwrap_or_default();
        let name = shortened(name);
        if line.starts_with("//") || line.starts_with([';', '%']) {
            return self.slip("a comment begins with #", "write # before it");
        }
        if line.starts_with(['<', '{']) {
            return self.slip("this is no TOML", "give a wall file, such as polyptych wall writes");
        }
        if line.starts_with(['"', '\'']) && line.matches(&name[..1]).count() == 1 {
            return self.slip("the key is not closed", "write a quote at its end");
        }
        if self.rest.starts_with(':') {
            let remedy = if self.before.contains('{') {
                "write =".to_owned()
            } else {
                format!("write {name} = {}", shortened(self.rest[1..].trim()))
            };
            return self.slip("= stands between key and value, not :", remedy);
        }
        if self.rest.starts_with(']') {
            return self.slip("the header does not begin with [", format!("write [{name}]"));
        }
        if self.rest.trim().is_empty() {
            return self
                .slip(format!("the key {name:?} has no value"), format!("write {name} = …"));
        }
        if let Some((words, _)) = line.split_once('=') {
            let words = shortened(words.trim());
            let remedy = "write one word of letters a–z, digits, - and _, or put it in quotes";
            return self.slip(format!("{words:?} is no key"), remedy);
        }
        let value = shortened(self.rest.trim());
        self.slip("= is missing between key and value", format!("write {name} = {value}"))
    }

    /// A key or a table that the file has twice.
    fn duplicate(&self) -> Slip {
        let is_list = self.before.starts_with("[[");
        if !self.before.starts_with('[') {
            return self.slip("the key is given twice", "keep one of the two");
        }
        let name = shortened(self.found.trim());
        let header = format!("[[{name}]]");
        if is_list {
            let remedy = format!("write {header} there too, or put all keys below the first");
            return self.slip(format!("[{name}] stands above without double brackets"), remedy);
        }
        if self.text[..self.offset].contains(&header) {
            let remedy = format!("write {header}, with double brackets");
            return self.slip(format!("[{name}] is one of several"), remedy);
        }
        self.slip("the table is given twice", "put all its keys below the first one")
    }

    /// Explains the mistake by the parser's message alone.
    #[expect(clippy::too_many_lines, reason = "one table of what each message means")]
    fn by_message(&self, message: &str) -> Option<Slip> {
        let line = shortened(self.before.split_once('=').map_or("", |(_, value)| value.trim()));
        let digits = |text: &str| -> String {
            text.chars().take_while(|c| c.is_ascii_digit() || "._+-eE".contains(*c)).collect()
        };
        let (what, remedy) = match message {
            "missing comma between array elements" => {
                ("a comma is missing between array elements", "write one, as in [1, 2]".to_owned())
            }
            "extra comma in array" => ("there is one comma too many", "remove it".to_owned()),
            "invalid mantissa" => {
                let rest = digits(self.rest.trim_start_matches(['+', '-']));
                ("a number has a digit before its point", format!("write 0{rest}"))
            }
            "invalid fraction" => {
                let whole = line.trim_end_matches('.').rsplit([' ', '[', ',']).next();
                let whole = whole.unwrap_or_default();
                ("a number has a digit behind its point", format!("write {whole}.0"))
            }
            "invalid exponent" => {
                ("a number has digits behind its e", "write them, as in 1e3".to_owned())
            }
            "unexpected leading zero" => {
                let number = digits(self.rest.trim_start_matches('0'));
                ("a number does not begin with 0", format!("write {number}"))
            }
            "invalid boolean" => return Some(self.bare_value()),
            "invalid float" if self.found.starts_with(char::is_alphabetic) => {
                // The middle of "1.5m", or a word that begins as nan does.
                return Some(if self.before.ends_with(|c: char| c.is_ascii_digit()) {
                    let remedy = "write the number alone; the key says in which unit";
                    self.slip("a number stands without its unit", remedy)
                } else {
                    self.bare_value()
                });
            }
            "invalid float" => {
                let remedy = "write a number such as 0.5, or a text in quotes";
                return Some(self.slip("this is no number", remedy));
            }
            "redundant numeric sign" => ("there is one sign too many", "remove it".to_owned()),
            "invalid basic string"
            | "invalid literal string"
            | "invalid multi-line basic string"
            | "invalid multi-line literal string" => {
                ("the text is not closed", "write a quote at its end".to_owned())
            }
            "missing opening quote" => {
                ("the text does not begin with a quote", "write one before it".to_owned())
            }
            "missing escaped value" | "too few unicode value digits" => {
                let remedy = "write two of them, or / in a path, or put the text in single quotes";
                ("a backslash means a special character", remedy.to_owned())
            }
            "unquoted keys cannot be empty" if self.before.starts_with('[') => {
                ("the header has no name", "write one, such as [wall]".to_owned())
            }
            "unquoted keys cannot be empty" => {
                ("the key is missing before =", "write its name there".to_owned())
            }
            "extra `=`" => ("there is one = too many", "remove it".to_owned()),
            "unclosed table" | "unclosed array table" if !self.rest.trim().is_empty() => {
                let remedy = "write one word, or put it in quotes";
                ("the name in a header has no spaces", remedy.to_owned())
            }
            "unclosed table" => ("the header is not closed", "write ] at its end".to_owned()),
            "unclosed array table" => {
                ("the header is not closed", "write ]] at its end".to_owned())
            }
            "unclosed inline table" => {
                ("the table in braces is not closed", "write } at its end".to_owned())
            }
            "carriage return must be followed by newline" => {
                let what = "the line ends with a carriage return alone";
                (what, "save the file with line ends of Unix or Windows".to_owned())
            }
            "missing comma between key-value pairs"
            | "extra assignment between key-value pairs" => {
                ("a comma is missing between the keys in braces", "write one".to_owned())
            }
            "missing assignment between key-value pairs" => {
                ("= is missing between key and value", "write one".to_owned())
            }
            "missing inline table opening" => ("there is no { for this }", "remove it".to_owned()),
            "missing array opening" => ("there is no [ for this ]", "remove it".to_owned()),
            "invalid key-value pair" => {
                let remedy = "give a wall file, such as polyptych wall writes";
                ("this is no TOML", remedy.to_owned())
            }
            _ => return None,
        };
        Some(self.slip(what, remedy))
    }
}

/// Returns whether a word is a value of TOML by itself: a number, true, false, or in quotes.
fn is_value(word: &str) -> bool {
    let word = word.trim_end_matches(',');
    let is_quoted = word.len() > 1 && word.starts_with(['"', '\'']) && word.ends_with(['"', '\'']);
    is_quoted || ["true", "false"].contains(&word) || word.replace('_', "").parse::<f64>().is_ok()
}

/// The numbers in "1920x1080".
fn size(text: &str) -> Option<[u32; 2]> {
    let (width, height) = text.split_once(['x', 'X', '×'])?;
    Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
}

/// The number in "10°", "2 m" or "30%".
fn number_before_unit(text: &str) -> Option<&str> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c)))?;
    let (number, unit) = text.split_at(end);
    let is_unit = |c: char| c.is_alphabetic() || "°%\"'".contains(c);
    let is_number = number.parse::<f64>().is_ok() && !unit.trim().is_empty();
    (is_number && unit.trim().chars().all(is_unit)).then_some(number)
}

/// The beginning of a text, fit for one line.
fn shortened(text: &str) -> String {
    let plain = text.chars().filter(|c| !c.is_control());
    let mut short: String = plain.take(QUOTED_CHARS_MAX).collect();
    if text.chars().count() > QUOTED_CHARS_MAX {
        short.push('…');
    }
    short
}
