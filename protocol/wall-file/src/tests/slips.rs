//! The usual slips of people who write TOML: each has its place, and a remedy that mends it.

use super::{check, error};
use crate::load;

/// The text that follows `[wall]` on the second line, the column of the slip, and the error about
/// it.
const SLIPS: &[(&str, u32, &str)] = &[
    // Commas of lists.
    ("a = [4.0 2.25]", 6, "a comma is missing between array elements; write 4.0, 2.25"),
    ("a = [-1 2 3]", 6, "a comma is missing between array elements; write -1, 2, 3"),
    ("a = [1; 2]", 6, "a comma is missing between array elements; write 1, 2"),
    ("a = [[1, 2] [3, 4]]", 13, "a comma is missing between array elements; write one, as in"),
    ("a = [\"x\" \"y\"]", 10, "a comma is missing between array elements; write one, as in"),
    ("a = [1,, 2]", 8, "there is one comma too many; remove it"),
    ("a = 1,5", 6, "a number has a decimal point, not a comma; write 1.5, or a list: [1, 5]"),
    ("a = 1, 2", 6, "a list stands in square brackets; write [1, 2]"),
    ("a = 1 2", 5, "found 1 2, several values where one belongs; write one of them, or a list"),
    ("a = (1, 2)", 5, "a list stands in square brackets; write [ and ]"),
    // Brackets and quotes.
    ("a = [1, 2\nb = 3", 5, "the list that begins here is not closed; write ] behind its last"),
    ("a = [1, 2", 5, "the list that begins here is not closed; write ] behind its last"),
    ("a = [[0, 0],\n  [1, 1]\nb = \"]\"", 5, "the list that begins here is not closed; write ]"),
    ("a = [1, 2]]", 11, "there is one ] too many; remove it"),
    ("a = ]", 5, "there is no [ for this ]; remove it"),
    ("a = { b = 1", 12, "the table in braces is not closed; write } at its end"),
    ("a = { b = 1 c = 2 }", 11, "a comma is missing between the keys in braces; write one"),
    ("a = \"w", 7, "the text is not closed; write a quote at its end"),
    ("a = 'w", 7, "the text is not closed; write a quote at its end"),
    ("a = w\"", 5, "the text does not begin with a quote; write one before it"),
    ("a = front wall", 5, "a text must stand in quotes; write \"front wall\""),
    ("a = “w”", 5, "found the typographic quote “ (U+201C); write straight quotes"),
    ("a = \"C:\\walls\"", 9, "a backslash means a special character; write two of them, or /"),
    // Values of other languages.
    ("a = True", 5, "True is no value; write true"),
    ("a = FALSE", 5, "FALSE is no value; write false"),
    ("a = yes", 5, "yes is no value; write true"),
    ("a = off", 5, "off is no value; write false"),
    ("a = None", 5, "None is no value; leave the key out"),
    ("a = null", 5, "null is no value; leave the key out"),
    ("a = NaN", 5, "NaN is no value; write a number, or leave the key out"),
    ("a = no", 5, "no is no value; write false"),
    ("a = front", 5, "a text must stand in quotes; write \"front\""),
    ("a = [tile, x]", 6, "a text must stand in quotes; write \"tile\""),
    ("a = 1 000", 5, "a number has no spaces; write 1000"),
    ("a = 1920x1080", 5, "a size is a list; write [1920, 1080]"),
    ("a = 1.2.3", 8, "this is no number; write a number such as 0.5"),
    ("a = --1", 6, "there is one sign too many; remove it"),
    ("a = .5", 5, "a number has a digit before its point; write 0.5"),
    ("a = 5.", 7, "a number has a digit behind its point; write 5.0"),
    ("a = 1e", 7, "a number has digits behind its e; write them, as in 1e3"),
    ("a = 05", 5, "a number does not begin with 0; write 5"),
    ("a = 10°", 5, "found 10°: a number stands without its unit; write 10; the key says"),
    ("a = 2 m", 5, "found 2 m: a number stands without its unit; write 2; the key says"),
    ("a = 1.5m", 8, "a number stands without its unit; write the number alone"),
    ("a = 1/2", 5, "1/2 is no number; write a number such as 0.5"),
    ("a = −1", 5, "found − (U+2212) for a minus; write a plain minus, -"),
    // Keys and headers.
    ("a \"w\"", 3, "= is missing between key and value; write a = \"w\""),
    ("a 1", 3, "= is missing between key and value; write a = 1"),
    ("a: 1", 2, "= stands between key and value, not :; write a = 1"),
    ("a", 2, "the key \"a\" has no value; write a = …"),
    ("a =", 4, "the value is missing; write one behind ="),
    ("= 1", 1, "the key is missing before =; write its name there"),
    ("a == 1", 4, "there is one = too many; remove it"),
    ("a b = 1", 3, "\"a b\" is no key; write one word"),
    ("näme = 1", 2, "\"näme\" is no key; write one word"),
    ("a = 1 b = 2", 5, "two keys stand on one line; write each on a line of its own"),
    ("a = 1\na = 2", 1, "the key is given twice; keep one of the two"),
    ("[wall]", 2, "the table is given twice; put all its keys below the first one"),
    ("[[wall]]", 3, "[wall] stands above without double brackets; write [[wall]] there too"),
    ("[[screen]]\n[screen]", 2, "[screen] is one of several; write [[screen]], with double"),
    ("[blend", 7, "the header is not closed; write ] at its end"),
    ("[[screen]", 10, "the header is not closed; write ]] at its end"),
    ("blend]", 6, "the header does not begin with [; write [blend]"),
    ("[screen]]", 9, "there is one ] too many; remove it"),
    ("[a b]", 3, "the name in a header has no spaces; write one word, or put it in quotes"),
    ("[]", 2, "the header has no name; write one, such as [wall]"),
    ("[blend] leak = 0", 9, "a header stands on a line of its own; write the keys on the lines"),
    // Comments and characters.
    ("// a wall", 1, "a comment begins with #; write # before it"),
    ("; a wall", 1, "a comment begins with #; write # before it"),
    ("a = 1 // one", 5, "a comment begins with #; write 1 # one"),
    ("\u{a0}a = 1", 1, "found U+00A0, which looks like a space and is none; write a plain space"),
    ("a =\u{a0}1", 4, "found U+00A0, which looks like a space and is none; write a plain space"),
    ("\u{feff}a = 1", 1, "found U+FEFF, which looks like a space and is none; write a plain"),
    ("a = 1\u{0}", 6, "found the control character U+0000; remove it"),
    ("{ \"a\": 1 }", 1, "this is no TOML; give a wall file, such as polyptych wall writes"),
    ("<html>", 1, "this is no TOML; give a wall file, such as polyptych wall writes"),
];

#[test]
fn each_slip_has_its_place_and_its_remedy() {
    for (text, column, words) in SLIPS {
        // The last line is where a slip over several lines is told, if not at its beginning.
        let is_below = text.contains('\n') && !words.starts_with("the list");
        let line = 2 + if is_below { text.matches('\n').count() } else { 0 };
        for end in ["\n", "\r\n"] {
            let text = format!("[wall]\n{text}\n").replace('\n', end);
            let said = error(&text);
            let place = format!("w.toml:{line}:{column}: ");
            assert!(said.starts_with(&place), "{text:?}\n   found {said}\nexpected {place}");
            assert!(said.contains(&format!(": {words}")), "{text:?}\n   found {said}\n{words}");
            assert!(!said.contains("wanted") && !said.contains(char::is_control), "{said:?}");
        }
    }
}

#[test]
fn marks_tabs_and_line_ends_of_windows_are_read() {
    let text = "\u{feff}[wall]\r\n\tname = \"w\"\t# a tab\r\n";
    check(
        text,
        "1:1: screen: the wall has no screen; add [[screen]] with name, place and channels",
    );
}

#[test]
fn text_that_is_not_utf8_is_told_with_its_place() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("w.toml");
    let utf16: Vec<u8> = "\u{feff}[wall]".encode_utf16().flat_map(u16::to_le_bytes).collect();
    for (bytes, place, words) in [
        (&b"[wall]\nname = \"w\xe4nd\"\n"[..], ":2:10: ", "no UTF-8 text from here on; save it as"),
        (&utf16, ":1:1: ", "the file is UTF-16 text; save it as UTF-8"),
    ] {
        std::fs::write(&path, bytes).expect("written");
        let said = load(&path).expect_err("no text").to_string();
        assert!(said.contains(place) && said.contains(words), "{said}");
    }
}
