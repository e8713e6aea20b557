//! Slots of the contents of a scene: equal ones are on the GPU once.

use std::collections::HashMap;

/// The slots of described things; equal ones share one.
#[derive(Debug)]
pub(super) struct Slots {
    /// Slot of each described thing, in the order of the description.
    pub of: Vec<usize>,
    pub count: usize,
}

impl Slots {
    pub fn new<K: std::hash::Hash + Eq>(names: impl Iterator<Item = K>) -> Self {
        let (mut of, mut count) = (Vec::new(), 0);
        let mut known = HashMap::new();
        for name in names {
            let next = count;
            let slot = *known.entry(name).or_insert(next);
            count += usize::from(slot == next);
            of.push(slot);
        }
        Self { of, count }
    }

    /// For each slot, that of the same name among others. `names` are those of what is described.
    pub fn shared<K: std::hash::Hash + Eq>(
        &self,
        names: impl Iterator<Item = K>,
        others: &HashMap<K, usize>,
    ) -> Vec<Option<usize>> {
        let mut shared = vec![None; self.count];
        for (name, &slot) in names.zip(&self.of) {
            shared[slot] = others.get(&name).copied();
        }
        shared
    }

    /// Returns the first described thing whose slot is empty.
    pub fn first_missing<T>(&self, filled: &[Option<T>]) -> Option<usize> {
        self.of.iter().position(|&slot| filled[slot].is_none())
    }
}
