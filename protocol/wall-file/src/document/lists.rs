//! Lists of numbers of a fixed length, and values that are one number or several.

use std::fmt;
use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// A list of exactly `N`: serde's own arrays ignore what a TOML list has beyond that.
struct Exactly<T, const N: usize> {
    /// What stands in it.
    of: &'static str,
    kind: PhantomData<T>,
}

impl<T, const N: usize> Exactly<T, N> {
    fn of(of: &'static str) -> Self {
        Self { of, kind: PhantomData }
    }
}

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Exactly<T, N> {
    type Value = [T; N];

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of {N} {}", self.of)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
        let mut found = Vec::with_capacity(N);
        while found.len() < N
            && let Some(item) = items.next_element()?
        {
            found.push(item);
        }
        let mut count = found.len();
        while items.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        match found.try_into() {
            Ok(array) if count == N => Ok(array),
            _ => Err(A::Error::invalid_length(count, &self)),
        }
    }
}

pub(super) fn exact<'de, D, T, const N: usize>(deserializer: D) -> Result<[T; N], D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    deserializer.deserialize_seq(Exactly::of("numbers"))
}

pub(super) fn some_exact<'de, D, T, const N: usize>(
    deserializer: D,
) -> Result<Option<[T; N]>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    exact(deserializer).map(Some)
}

pub(super) fn some_points<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<[Pair; 4]>, D::Error> {
    deserializer.deserialize_seq(Exactly::of("points")).map(Some)
}

pub(super) fn some_corners<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<[Row; 2]>, D::Error> {
    deserializer.deserialize_seq(Exactly::of("points")).map(Some)
}

pub(super) fn some_rows<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<[Row; 3]>, D::Error> {
    deserializer.deserialize_seq(Exactly::of("rows")).map(Some)
}

/// [x, y].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Pair(#[serde(deserialize_with = "exact")] pub [f64; 2]);

/// [a, b, c], a row of a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Row(#[serde(deserialize_with = "exact")] pub [f64; 3]);

/// One number for red, green and blue alike, or [red, green, blue].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum ScalarOrRgb {
    /// The same for all three.
    Gray(f64),
    /// [red, green, blue].
    Rgb([f64; 3]),
}

/// [yaw, pitch, roll] in degrees, or a quaternion [x, y, z, w] of length 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Rotation {
    /// [yaw, pitch, roll] in degrees.
    Angles([f64; 3]),
    /// [x, y, z, w].
    Quaternion([f64; 4]),
}

/// serde's own untagged enums do not say what is wrong where.
struct LightVisitor;

impl<'de> Visitor<'de> for LightVisitor {
    type Value = ScalarOrRgb;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, or a list of 3 numbers")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<ScalarOrRgb, E> {
        Ok(ScalarOrRgb::Gray(number))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<ScalarOrRgb, E> {
        Ok(ScalarOrRgb::Gray(number as f64))
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<ScalarOrRgb, E> {
        Ok(ScalarOrRgb::Gray(number as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<ScalarOrRgb, A::Error> {
        exact(SeqAccessDeserializer::new(items)).map(ScalarOrRgb::Rgb)
    }
}

impl<'de> Deserialize<'de> for ScalarOrRgb {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LightVisitor)
    }
}

/// As [`LightVisitor`].
struct RotationVisitor;

impl<'de> Visitor<'de> for RotationVisitor {
    type Value = Rotation;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of 3 angles or of 4 numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Rotation, A::Error> {
        let mut found = Vec::with_capacity(4);
        while found.len() < 4
            && let Some(item) = items.next_element::<f64>()?
        {
            found.push(item);
        }
        let mut count = found.len();
        while items.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        match (count, found.as_slice()) {
            (3, &[yaw, pitch, roll]) => Ok(Rotation::Angles([yaw, pitch, roll])),
            (4, &[x, y, z, w]) => Ok(Rotation::Quaternion([x, y, z, w])),
            _ => Err(A::Error::invalid_length(count, &self)),
        }
    }
}

impl<'de> Deserialize<'de> for Rotation {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(RotationVisitor)
    }
}
