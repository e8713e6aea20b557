//! Lists of a known number of f64, as a JSON text has them; what is wrong is said with its key.
//!
//! The text's own numbers, not those of the `gltf` crate: its types are f32, which is half a metre
//! at the surface of the Earth. Overflow (`1e400`) and words (`NaN`) are faults of the text.

use std::fmt;

use serde::de::{Deserializer, Error, IgnoredAny, SeqAccess, Visitor};

/// A list that may be absent or null; `key` is what messages call it.
fn numbers<'de, D: Deserializer<'de>, const N: usize>(
    from: D,
    key: &'static str,
) -> Result<Option<[f64; N]>, D::Error> {
    from.deserialize_option(NumbersVisitor { key })
}

macro_rules! keys {
    ($($key:ident: $count:literal),* $(,)?) => {$(
        /// The list under this key of a node.
        pub(super) fn $key<'de, D: Deserializer<'de>>(
            from: D,
        ) -> Result<Option<[f64; $count]>, D::Error> {
            numbers(from, stringify!($key))
        }
    )*};
}
keys! { matrix: 16, translation: 3, rotation: 4, scale: 3 }

struct NumbersVisitor<const N: usize> {
    key: &'static str,
}

impl<'de, const N: usize> Visitor<'de> for NumbersVisitor<N> {
    type Value = Option<[f64; N]>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to be an array of {N} numbers", self.key)
    }

    fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Self::Value, D::Error> {
        from.deserialize_seq(self)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
        let key = self.key;
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            let Some(number) = seq.next_element::<f64>()? else {
                let what = format_args!("{key} has {i} numbers, {N} would be right");
                return Err(Error::custom(what));
            };
            *value = number;
        }
        if seq.next_element::<IgnoredAny>()?.is_some() {
            let what = format_args!("{key} has more than {N} numbers, {N} would be right");
            return Err(Error::custom(what));
        }
        Ok(Some(values))
    }
}
