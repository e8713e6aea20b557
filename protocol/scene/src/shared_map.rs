//! A sorted map of which copies share what they have in common.
//!
//! A copy costs a pointer for each [`CHUNK_MAX`] entries, a change of a copy one chunk: so a state
//! can be kept beside the one that follows it, however large both are. Encoded as a
//! [`BTreeMap`](std::collections::BTreeMap) is.

use std::cmp::Ordering;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Maximum number of entries that are copied where one of them changes: few enough that a change
/// is cheap, many enough that a million entries are some ten thousand pointers.
const CHUNK_MAX: usize = 32;

/// Entries that follow each other, never none, and the first key again: a search looks into one
/// chunk only.
#[derive(Clone)]
struct Chunk<K, V> {
    first: K,
    entries: Arc<Vec<(K, V)>>,
}

impl<K: Copy, V> Chunk<K, V> {
    fn new(entries: Vec<(K, V)>) -> Option<Self> {
        let first = entries.first()?.0;
        Some(Self { first, entries: Arc::new(entries) })
    }
}

/// A sorted map of which copies share what they have in common.
#[derive(Clone)]
pub struct SharedMap<K, V> {
    /// In rising order.
    chunks: Vec<Chunk<K, V>>,
    len: usize,
}

impl<K, V> Default for SharedMap<K, V> {
    fn default() -> Self {
        Self { chunks: Vec::new(), len: 0 }
    }
}

impl<K: fmt::Debug, V: fmt::Debug> fmt::Debug for SharedMap<K, V> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map()
            .entries(self.chunks.iter().flat_map(|chunk| chunk.entries.iter().map(|(k, v)| (k, v))))
            .finish()
    }
}

impl<K: Ord + Copy, V: Clone> SharedMap<K, V> {
    /// Returns whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The chunk that holds a key, or would.
    fn chunk_of(&self, key: &K) -> usize {
        self.chunks.partition_point(|chunk| chunk.first <= *key).saturating_sub(1)
    }

    /// Returns the value of a key.
    pub fn get(&self, key: &K) -> Option<&V> {
        let chunk = &self.chunks.get(self.chunk_of(key))?.entries;
        let at = chunk.binary_search_by(|(known, _)| known.cmp(key)).ok()?;
        Some(&chunk[at].1)
    }

    /// Puts a value in its place; returns what stood there.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        let at = self.chunk_of(&key);
        let Some(chunk) = self.chunks.get_mut(at) else {
            self.chunks.extend(Chunk::new(vec![(key, value)]));
            self.len += 1;
            return None;
        };
        chunk.first = chunk.first.min(key);
        let chunk = Arc::make_mut(&mut chunk.entries);
        match chunk.binary_search_by(|(known, _)| known.cmp(&key)) {
            Ok(slot) => return Some(std::mem::replace(&mut chunk[slot].1, value)),
            Err(slot) => chunk.insert(slot, (key, value)),
        }
        self.len += 1;
        if chunk.len() > CHUNK_MAX {
            // What comes in rising order leaves full chunks behind.
            let is_last = chunk.last().is_some_and(|(last, _)| *last == key);
            let rest = chunk.split_off(if is_last { CHUNK_MAX } else { CHUNK_MAX / 2 });
            if let Some(rest) = Chunk::new(rest) {
                self.chunks.insert(at + 1, rest);
            }
        }
        None
    }

    /// Takes an entry out; returns its value.
    pub fn remove(&mut self, key: &K) -> Option<V> {
        let at = self.chunk_of(key);
        let chunk = self.chunks.get_mut(at)?;
        let slot = chunk.entries.binary_search_by(|(known, _)| known.cmp(key)).ok()?;
        let entries = Arc::make_mut(&mut chunk.entries);
        let (_, value) = entries.remove(slot);
        self.len -= 1;
        let Some((first, _)) = entries.first() else {
            self.chunks.remove(at);
            return Some(value);
        };
        chunk.first = *first;
        let own = entries.len();
        let next = self.chunks.get(at + 1).map(|next| next.entries.len());
        if next.is_some_and(|next| own + next <= CHUNK_MAX / 2) {
            // Or a map that shrinks would be left with chunks of one entry.
            let rest = self.chunks.remove(at + 1);
            let entries = Arc::make_mut(&mut self.chunks[at].entries);
            entries.extend(Arc::unwrap_or_clone(rest.entries));
        }
        Some(value)
    }

    /// All entries, in rising order.
    pub fn iter(&self) -> impl Iterator<Item = (&K, &V)> + Clone {
        self.chunks.iter().flat_map(|chunk| chunk.entries.iter().map(|(key, value)| (key, value)))
    }

    /// The entries from a key on, in rising order.
    pub fn iter_from(&self, from: K) -> impl Iterator<Item = (&K, &V)> {
        let chunks = &self.chunks[self.chunk_of(&from)..];
        let entries = chunks.iter().flat_map(|chunk| chunk.entries.iter());
        entries.skip_while(move |(key, _)| *key < from).map(|(key, value)| (key, value))
    }

    /// All values, in the order of their keys.
    pub fn values(&self) -> impl Iterator<Item = &V> + Clone {
        self.iter().map(|(_, value)| value)
    }
}

impl<K: Ord + Copy, V: Clone + PartialEq> SharedMap<K, V> {
    /// Visits each key of which two maps differ, in rising order, with the values of both, until
    /// `visit` returns `false`. What they share is passed over. Returns whether all were visited.
    pub fn diff<'a>(
        &'a self,
        other: &'a Self,
        mut visit: impl FnMut(K, Option<&'a V>, Option<&'a V>) -> bool,
    ) -> bool {
        let (mut own, mut its) = (Cursor::new(self), Cursor::new(other));
        loop {
            if own.skip_shared(&mut its) {
                continue;
            }
            let (a, b) = (own.entry(), its.entry());
            let order = match (a, b) {
                (None, None) => return true,
                (Some(_), None) => Ordering::Less,
                (None, Some(_)) => Ordering::Greater,
                (Some((a, _)), Some((b, _))) => a.cmp(b),
            };
            let a = a.filter(|_| order.is_le()).inspect(|_| own.advance());
            let b = b.filter(|_| order.is_ge()).inspect(|_| its.advance());
            let Some((key, _)) = a.or(b) else { return true };
            let (a, b) = (a.map(|(_, value)| value), b.map(|(_, value)| value));
            if a != b && !visit(*key, a, b) {
                return false;
            }
        }
    }
}

/// A place between the entries of a map.
struct Cursor<'a, K, V> {
    chunks: &'a [Chunk<K, V>],
    /// In the first of the chunks.
    at: usize,
}

impl<'a, K, V> Cursor<'a, K, V> {
    fn new(map: &'a SharedMap<K, V>) -> Self {
        Self { chunks: &map.chunks, at: 0 }
    }

    fn entry(&self) -> Option<&'a (K, V)> {
        self.chunks.first()?.entries.get(self.at)
    }

    fn advance(&mut self) {
        self.at += 1;
        if self.chunks.first().is_some_and(|chunk| self.at == chunk.entries.len()) {
            (self.chunks, self.at) = (&self.chunks[1..], 0);
        }
    }

    /// Passes over a chunk where both stand before the same one.
    fn skip_shared(&mut self, other: &mut Self) -> bool {
        let (Some(own), Some(its)) = (self.chunks.first(), other.chunks.first()) else {
            return false;
        };
        let is_shared = self.at == 0 && other.at == 0 && Arc::ptr_eq(&own.entries, &its.entries);
        if is_shared {
            (self.chunks, other.chunks) = (&self.chunks[1..], &other.chunks[1..]);
        }
        is_shared
    }
}

impl<K: Ord + Copy, V: Clone + PartialEq> PartialEq for SharedMap<K, V> {
    fn eq(&self, other: &Self) -> bool {
        self.len == other.len && self.diff(other, |_, _, _| false)
    }
}

impl<K: Ord + Copy, V: Clone> FromIterator<(K, V)> for SharedMap<K, V> {
    fn from_iter<I: IntoIterator<Item = (K, V)>>(entries: I) -> Self {
        let mut map = Self::default();
        for (key, value) in entries {
            map.insert(key, value);
        }
        map
    }
}

impl<K: Ord + Copy + Serialize, V: Clone + Serialize> Serialize for SharedMap<K, V> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let mut map = serializer.serialize_map(Some(self.len))?;
        for (key, value) in self.iter() {
            map.serialize_entry(key, value)?;
        }
        map.end()
    }
}

impl<'de, K, V> Deserialize<'de> for SharedMap<K, V>
where
    K: Ord + Copy + Deserialize<'de>,
    V: Clone + Deserialize<'de>,
{
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries<K, V>(PhantomData<(K, V)>);
        impl<'de, K, V> Visitor<'de> for Entries<K, V>
        where
            K: Ord + Copy + Deserialize<'de>,
            V: Clone + Deserialize<'de>,
        {
            type Value = SharedMap<K, V>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a map")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut from: A) -> Result<Self::Value, A::Error> {
                // Room is made as entries come: what a peer claims is not believed.
                let mut map = SharedMap::default();
                while let Some((key, value)) = from.next_entry()? {
                    map.insert(key, value);
                }
                Ok(map)
            }
        }
        deserializer.deserialize_map(Entries(PhantomData))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use proptest::prelude::*;

    use super::*;

    /// Changes of a map: a key, and its value, or none to take it out.
    fn changes(count: usize) -> impl Strategy<Value = Vec<(u16, Option<u8>)>> {
        prop::collection::vec((0u16..600, prop::option::weighted(0.6, 0u8..4)), 0..count)
    }

    fn change(
        map: &mut SharedMap<u16, u8>,
        model: &mut BTreeMap<u16, u8>,
        changes: &[(u16, Option<u8>)],
    ) {
        for &(key, value) in changes {
            let (got, expected) = match value {
                Some(value) => (map.insert(key, value), model.insert(key, value)),
                None => (map.remove(&key), model.remove(&key)),
            };
            assert_eq!(got, expected, "what was replaced at {key}");
        }
    }

    fn expect_equal(map: &SharedMap<u16, u8>, model: &BTreeMap<u16, u8>) {
        assert!(map.iter().eq(model.iter()));
        assert_eq!((map.len, map.is_empty()), (model.len(), model.is_empty()));
        for chunk in &map.chunks {
            assert!((1..=CHUNK_MAX).contains(&chunk.entries.len()));
            assert_eq!(chunk.first, chunk.entries[0].0);
        }
        for key in 0..600 {
            assert_eq!(map.get(&key), model.get(&key));
        }
        for from in [0, 1, 299, 599, 700] {
            assert!(map.iter_from(from).eq(model.range(from..)));
        }
    }

    proptest! {
        #[test]
        fn is_as_a_map_and_copies_do_not_see_each_others_changes(
            first in changes(900),
            second in changes(60),
            third in changes(60),
        ) {
            let (mut map, mut model) = (SharedMap::default(), BTreeMap::new());
            change(&mut map, &mut model, &first);
            expect_equal(&map, &model);
            let (mut copy, mut its_model) = (map.clone(), model.clone());
            change(&mut copy, &mut its_model, &second);
            change(&mut map, &mut model, &third);
            expect_equal(&map, &model);
            expect_equal(&copy, &its_model);
            let mut differ = Vec::new();
            let all = map.diff(&copy, |key, a, b| {
                differ.push((key, a.copied(), b.copied()));
                true
            });
            prop_assert!(all);
            let keys: BTreeSet<u16> = model.keys().chain(its_model.keys()).copied().collect();
            let both = |key: u16| (key, model.get(&key).copied(), its_model.get(&key).copied());
            let expected = keys.into_iter().map(both).filter(|(_, a, b)| a != b);
            prop_assert_eq!(differ, expected.collect::<Vec<_>>());
            prop_assert_eq!(map == copy, model == its_model);
        }

        #[test]
        fn is_encoded_as_a_tree_is(all in changes(300)) {
            let (mut map, mut model) = (SharedMap::default(), BTreeMap::new());
            change(&mut map, &mut model, &all);
            let bytes = polyptych_codec::encode(&map);
            prop_assert_eq!(&bytes, &polyptych_codec::encode(&model));
            let again = polyptych_codec::decode_within::<SharedMap<u16, u8>, 65536>(&bytes);
            prop_assert_eq!(again.as_ref(), Ok(&map));
        }
    }

    #[test]
    fn a_change_of_a_copy_copies_one_chunk() {
        let map: SharedMap<u32, u32> = (0..10_000).map(|key| (key, 0)).collect();
        assert_eq!(map.chunks.len(), 10_000usize.div_ceil(CHUNK_MAX), "chunks are full");
        let mut copy = map.clone();
        copy.insert(5000, 1);
        let shared = map.chunks.iter().zip(&copy.chunks);
        let shared = shared.filter(|(a, b)| Arc::ptr_eq(&a.entries, &b.entries));
        assert_eq!(shared.count(), map.chunks.len() - 1);
    }
}
