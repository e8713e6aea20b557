//! Values that are measured once: a map of them has a fingerprint and a size that cost what
//! changes, not what there is.

use std::cell::RefCell;
use std::sync::Arc;

use serde::{Serialize, Serializer};
use twox_hash::XxHash3_64;

use crate::shared_map::SharedMap;

/// A value of an entry, with what the entry adds to the sums. Encoded as the value is.
#[derive(Debug, PartialEq)]
pub struct Measured<T> {
    pub value: T,
    /// Hash of key and value; entries that differ hardly ever share it.
    pub print: u64,
    /// Encoded size of key and value.
    pub bytes: u64,
}

impl<T: Serialize> Measured<T> {
    /// Measures the entry of this key.
    pub fn new<K: Serialize>(key: &K, value: T) -> Self {
        thread_local! {
            static ROOM: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
        }
        let (print, bytes) = ROOM.with_borrow_mut(|room| {
            polyptych_codec::encode_into(&(key, &value), room);
            (XxHash3_64::oneshot(room), room.len() as u64)
        });
        Self { value, print, bytes }
    }

    /// Measures all entries of a map.
    pub fn all<K: Ord + Copy + Serialize>(map: &SharedMap<K, T>) -> SharedMap<K, Arc<Self>>
    where
        T: Clone,
    {
        let entries = map.iter().map(|(key, value)| (*key, Self::new(key, value.clone()).into()));
        entries.collect()
    }
}

impl<T: Serialize> Serialize for Measured<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.value.serialize(serializer)
    }
}
