//! Work on the items of a view, which all cores share where there are many of them.

use rayon::prelude::*;

/// Items that a core looks at before it takes others: some tenths of a millisecond of work, beside
/// which it costs nothing to hand it over.
const PART_ITEMS: usize = 2048;

/// Returns whether there are so many items that cores share them.
pub(crate) fn are_many<I>(items: &[I]) -> bool {
    items.len() > PART_ITEMS
}

/// Does something with all items, some at a time, which are given with the place of the first.
/// Returns the results in the order of the items.
pub(crate) fn parts<I: Sync, T: Send>(items: &[I], of: impl Fn(usize, &[I]) -> T + Sync) -> Vec<T> {
    let of = |(part, some)| of(part * PART_ITEMS, some);
    if are_many(items) {
        items.par_chunks(PART_ITEMS).enumerate().map(of).collect()
    } else {
        items.chunks(PART_ITEMS).enumerate().map(of).collect()
    }
}

/// Returns what is found for each item, in the order of the items.
pub(crate) fn find<T: Send>(items: &[u32], of: impl Fn(u32) -> Option<T> + Sync) -> Vec<T> {
    let some = |_, some: &[u32]| some.iter().filter_map(|&item| of(item)).collect::<Vec<T>>();
    let mut parts = parts(items, some);
    if parts.len() == 1 {
        return parts.swap_remove(0);
    }
    parts.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_found_in_their_order() {
        for count in [0, 1, 2048, 2049, 100_000] {
            let items: Vec<u32> = (0..count).rev().collect();
            let even = |item: u32| item.is_multiple_of(2).then_some(item);
            let wanted: Vec<u32> = items.iter().copied().filter_map(even).collect();
            assert_eq!(find(&items, even), wanted);
            let first = parts(&items, |at, some| (at, some.first().copied()));
            assert!(first.iter().all(|&(at, item)| item == Some(items[at])));
        }
    }
}
