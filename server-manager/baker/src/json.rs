//! JSON as glTF files have it: an integer may be written as a float, a key stands once in an
//! object, and an error names its path.
//!
//! Exporters of dynamic languages write `1.0` where the schema of glTF has an integer, and JSON
//! has one kind of number. A [`Reader`] around a deserializer takes whole floats for integers,
//! whatever type asks, and remembers where in the tree reading failed. Of a key that stands twice
//! programs take the first or the last value: such a file is refused, unless only its `extras` have
//! one, or what is kept as it stands there, such as extensions that nobody draws.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, EnumAccess, Error, MapAccess, SeqAccess, Visitor};

/// The path and the reason of a value that cannot be read.
#[derive(Debug)]
pub(super) struct JsonError {
    /// The JSON path, as in `accessors[3].count`; empty for the whole text.
    pub path: String,
    /// The reason, with line and column where there is a text.
    pub error: serde_json::Error,
}

/// Reads a whole text.
pub(super) fn from_slice<'de, T: Deserialize<'de>>(text: &'de [u8]) -> Result<T, JsonError> {
    let mut text = serde_json::Deserializer::from_slice(text);
    let value = read(&mut text)?;
    text.end().map_err(|error| JsonError { path: String::new(), error })?;
    Ok(value)
}

/// Reads a value that was parsed before.
pub(super) fn from_value<T: for<'de> Deserialize<'de>>(
    value: &serde_json::Value,
) -> Result<T, JsonError> {
    read(value)
}

fn read<'de, T, D>(inner: D) -> Result<T, JsonError>
where
    T: Deserialize<'de>,
    D: Deserializer<'de, Error = serde_json::Error>,
{
    let track = Track::default();
    let read = T::deserialize(Reader { inner, track: &track, mode: Mode::Plain });
    read.map_err(|error| JsonError { path: track.path(), error })
}

/// The steps from a value that could not be read up to the root, innermost first.
#[derive(Debug, Default)]
struct Track(RefCell<Vec<String>>);

impl Track {
    /// Adds a step if reading failed below it; forgets failures that did not end the reading.
    fn follow<T, E>(&self, result: Result<T, E>, step: impl FnOnce() -> String) -> Result<T, E> {
        let mut steps = self.0.borrow_mut();
        match &result {
            Ok(_) => steps.clear(),
            Err(_) => steps.push(step()),
        }
        result
    }

    fn path(&self) -> String {
        let path: String = self.0.borrow().iter().rev().map(String::as_str).collect();
        path.strip_prefix('.').map_or(path.clone(), str::to_owned)
    }
}

/// The way in which the requested value is read.
#[derive(Clone, Copy)]
enum Mode<'t> {
    /// A value without a special type.
    Plain,
    /// An object whose keys may be any.
    Map,
    /// An integer, which may be written as a float.
    Integer,
    /// A key, which is remembered here.
    Key(&'t RefCell<String>),
}

impl Mode<'_> {
    /// The mode in which an object is read whose keys may be any.
    fn or_map(self) -> Self {
        if let Self::Plain = self { Self::Map } else { self }
    }
}

/// A deserializer that takes whole floats for integers and keeps track of where it is.
struct Reader<'t, D> {
    inner: D,
    track: &'t Track,
    mode: Mode<'t>,
}

impl<'t, D> Reader<'t, D> {
    fn visitor<V>(&self, inner: V, mode: Mode<'t>) -> Watch<'t, V> {
        Watch { inner, track: self.track, mode }
    }
}

macro_rules! deserialize {
    ($mode:expr; $($method:ident($($name:ident: $kind:ty),*)),* $(,)?) => {$(
        fn $method<V: Visitor<'de>>(
            self,
            $($name: $kind,)*
            visitor: V,
        ) -> Result<V::Value, D::Error> {
            let visitor = self.visitor(visitor, $mode(self.mode));
            self.inner.$method($($name,)* visitor)
        }
    )*};
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Reader<'_, D> {
    type Error = D::Error;

    deserialize! { |_| Mode::Integer;
        deserialize_i8(), deserialize_i16(), deserialize_i32(), deserialize_i64(),
        deserialize_u8(), deserialize_u16(), deserialize_u32(), deserialize_u64(),
    }

    // Structs check the keys that they know.
    deserialize! { Mode::or_map; deserialize_map() }

    deserialize! { |mode| mode;
        deserialize_any(), deserialize_bool(), deserialize_f32(), deserialize_f64(),
        deserialize_char(), deserialize_str(), deserialize_string(), deserialize_bytes(),
        deserialize_byte_buf(), deserialize_option(), deserialize_unit(), deserialize_seq(),
        deserialize_identifier(), deserialize_ignored_any(),
        deserialize_unit_struct(name: &'static str),
        deserialize_newtype_struct(name: &'static str),
        deserialize_tuple(len: usize),
        deserialize_tuple_struct(name: &'static str, len: usize),
        deserialize_struct(name: &'static str, fields: &'static [&'static str]),
        deserialize_enum(name: &'static str, variants: &'static [&'static str]),
    }

    fn is_human_readable(&self) -> bool {
        self.inner.is_human_readable()
    }
}

/// A visitor that hands on what it is given, with a [`Reader`] around all that lies below.
struct Watch<'t, V> {
    inner: V,
    track: &'t Track,
    mode: Mode<'t>,
}

impl<V> Watch<'_, V> {
    fn note_key(&self, key: &str) {
        if let Mode::Key(noted) = self.mode {
            key.clone_into(&mut noted.borrow_mut());
        }
    }
}

macro_rules! visit {
    ($($method:ident($kind:ty)),* $(,)?) => {$(
        fn $method<E: Error>(self, value: $kind) -> Result<V::Value, E> {
            self.inner.$method(value)
        }
    )*};
}

/// One more than the largest u64, and the least i64: both are floats.
const U64_END: f64 = 18_446_744_073_709_551_616.0;
const I64_LEAST: f64 = -9_223_372_036_854_775_808.0;

impl<'de, V: Visitor<'de>> Visitor<'de> for Watch<'_, V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.inner.expecting(f)
    }

    visit! {
        visit_bool(bool), visit_i8(i8), visit_i16(i16), visit_i32(i32), visit_i64(i64),
        visit_u8(u8), visit_u16(u16), visit_u32(u32), visit_u64(u64), visit_f32(f32),
        visit_char(char), visit_bytes(&[u8]), visit_borrowed_bytes(&'de [u8]),
        visit_byte_buf(Vec<u8>),
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<V::Value, E> {
        match self.mode {
            Mode::Integer if value.fract() != 0.0 => {
                Err(E::custom(format_args!("{value} is not an integer")))
            }
            Mode::Integer if (0.0..U64_END).contains(&value) => self.inner.visit_u64(value as u64),
            Mode::Integer if (I64_LEAST..0.0).contains(&value) => {
                self.inner.visit_i64(value as i64)
            }
            Mode::Integer => Err(E::custom(format_args!("{value:e} is too large an integer"))),
            _ => self.inner.visit_f64(value),
        }
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<V::Value, E> {
        self.note_key(value);
        self.inner.visit_str(value)
    }

    fn visit_borrowed_str<E: Error>(self, value: &'de str) -> Result<V::Value, E> {
        self.note_key(value);
        self.inner.visit_borrowed_str(value)
    }

    fn visit_string<E: Error>(self, value: String) -> Result<V::Value, E> {
        self.note_key(&value);
        self.inner.visit_string(value)
    }

    fn visit_none<E: Error>(self) -> Result<V::Value, E> {
        self.inner.visit_none()
    }

    fn visit_unit<E: Error>(self) -> Result<V::Value, E> {
        self.inner.visit_unit()
    }

    fn visit_some<D: Deserializer<'de>>(self, inner: D) -> Result<V::Value, D::Error> {
        self.inner.visit_some(Reader { inner, track: self.track, mode: Mode::Plain })
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, inner: D) -> Result<V::Value, D::Error> {
        self.inner.visit_newtype_struct(Reader { inner, track: self.track, mode: self.mode })
    }

    fn visit_seq<A: SeqAccess<'de>>(self, inner: A) -> Result<V::Value, A::Error> {
        self.inner.visit_seq(Elements { inner, track: self.track, count: 0 })
    }

    fn visit_map<A: MapAccess<'de>>(self, inner: A) -> Result<V::Value, A::Error> {
        let key = RefCell::new(String::new());
        let known = matches!(self.mode, Mode::Map).then(BTreeSet::new);
        self.inner.visit_map(Entries { inner, track: self.track, key: &key, known })
    }

    fn visit_enum<A: EnumAccess<'de>>(self, inner: A) -> Result<V::Value, A::Error> {
        self.inner.visit_enum(inner)
    }
}

/// The elements of an array.
struct Elements<'t, A> {
    inner: A,
    track: &'t Track,
    count: usize,
}

impl<'de, A: SeqAccess<'de>> SeqAccess<'de> for Elements<'_, A> {
    type Error = A::Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, A::Error> {
        let seed = Seed { inner: seed, track: self.track, mode: Mode::Plain };
        let index = self.count;
        self.count += 1;
        let element = self.inner.next_element_seed(seed);
        self.track.follow(element, || format!("[{index}]"))
    }

    fn size_hint(&self) -> Option<usize> {
        self.inner.size_hint()
    }
}

/// The entries of an object.
struct Entries<'t, A> {
    inner: A,
    track: &'t Track,
    key: &'t RefCell<String>,
    /// The keys so far; `None` if whoever reads the object checks them.
    known: Option<BTreeSet<String>>,
}

impl<A> Entries<'_, A> {
    /// Refuses a key that the object has already, in the words of serde.
    fn check_key<E: Error>(&mut self) -> Result<(), E> {
        let key = self.key.borrow();
        if self.known.as_mut().is_none_or(|known| known.insert(key.clone())) {
            return Ok(());
        }
        let twice = Err(E::custom(format_args!("duplicate field `{key}`")));
        self.track.follow(twice, || format!(".{key}"))
    }
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Entries<'_, A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, A::Error> {
        let seed = Seed { inner: seed, track: self.track, mode: Mode::Key(self.key) };
        let key = self.inner.next_key_seed(seed)?;
        if key.is_some() {
            self.check_key::<A::Error>()?;
        }
        Ok(key)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        // Extras belong to programs; the last of two values counts.
        let is_foreign = self.key.borrow().as_str() == "extras";
        let value = if is_foreign {
            self.inner.next_value_seed(seed)
        } else {
            let seed = Seed { inner: seed, track: self.track, mode: Mode::Plain };
            self.inner.next_value_seed(seed)
        };
        self.track.follow(value, || format!(".{}", self.key.borrow()))
    }

    fn size_hint(&self) -> Option<usize> {
        self.inner.size_hint()
    }
}

/// The seed of an element, a key or a value, with the mode in which it is read.
struct Seed<'t, S> {
    inner: S,
    track: &'t Track,
    mode: Mode<'t>,
}

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Seed<'_, S> {
    type Value = S::Value;

    fn deserialize<D: Deserializer<'de>>(self, inner: D) -> Result<S::Value, D::Error> {
        self.inner.deserialize(Reader { inner, track: self.track, mode: self.mode })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(default)]
    struct Tree {
        count: Option<u32>,
        list: Vec<Tree>,
        by_name: BTreeMap<String, i64>,
        float: f64,
        #[serde(flatten)]
        others: BTreeMap<String, serde_json::Value>,
    }

    fn failure(text: &str) -> (String, String) {
        let error = from_slice::<Tree>(text.as_bytes()).expect_err(text);
        (error.path, error.error.to_string())
    }

    #[test]
    fn whole_floats_are_integers_everywhere() {
        let text = r#"{ "count": 3.0, "float": 1, "by_name": { "a": -2e0, "b": 4.0 },
            "list": [{ "count": 1e0 }, { "count": 25e-1, "x": 0 }] }"#;
        let (path, _) = failure(text);
        assert_eq!(path, "list[1].count");
        let tree: Tree = from_slice(text.replace("25e-1", "250e-1").as_bytes()).expect("a tree");
        assert_eq!((tree.count, tree.list[1].count, tree.float), (Some(3), Some(25), 1.0));
        assert_eq!(tree.by_name["a"], -2);
        let value = serde_json::json!({ "count": 7.0 });
        assert_eq!(from_value::<Tree>(&value).expect("a tree").count, Some(7));
    }

    #[test]
    fn errors_name_their_path_and_what_is_no_integer() {
        let (path, reason) = failure(r#"{ "list": [{}, { "list": [{ "count": 1.5 }] }] }"#);
        assert_eq!(path, "list[1].list[0].count");
        assert!(reason.starts_with("1.5 is not an integer at line 1"), "{reason}");
        for (number, part) in [("-1.0", "-1"), ("1e300", "too large"), ("4294967296", "4294967296")]
        {
            let (path, reason) = failure(&format!("{{ \"count\": {number} }}"));
            assert_eq!(path, "count");
            assert!(reason.contains(part), "{reason}");
        }
        let (path, _) = failure(r#"{ "by_name": { "wood": "oak" } }"#);
        assert_eq!(path, "by_name.wood");
        assert_eq!(failure("[1]").0, "");
        assert!(from_slice::<Tree>(b"{} x").is_err(), "text goes on behind the value");
    }

    #[test]
    fn keys_that_stand_twice_are_refused_with_their_path_but_in_what_nobody_reads() {
        for (text, key) in [
            (r#"{ "list": [{ "by_name": { "a": 1, "b": 2, "a": 3 } }] }"#, "list[0].by_name.a"),
            (r#"{ "list": [{}, { "count": 1, "list": [], "count": 2 }] }"#, "list[1].count"),
        ] {
            let (path, reason) = failure(text);
            let name = key.rsplit('.').next().expect("a name");
            assert_eq!(path, key);
            assert!(reason.starts_with(&format!("duplicate field `{name}` at line 1")), "{reason}");
        }
        let text = r#"{ "by_name": { "a": 1 }, "list": [{ "by_name": { "a": 2 } }],
            "extras": { "a": 1, "a": { "b": 2, "b": 3 } }, "other": [{ "c": 4, "c": 5 }] }"#;
        let tree: Tree = from_slice(text.as_bytes()).expect("a tree");
        assert_eq!(tree.others["extras"], serde_json::json!({ "a": { "b": 3 } }));
        assert_eq!(tree.others["other"], serde_json::json!([{ "c": 5 }]));
    }
}
