//! Positions that several parts of a mesh have, so that their levels of detail meet there.

use std::collections::HashMap;

/// The part number of a position that several parts have.
const SEVERAL: u32 = u32::MAX;

/// Which part of a mesh has each position.
#[derive(Debug, Default)]
pub(super) struct Borders {
    part_at: HashMap<[u32; 3], u32>,
}

impl Borders {
    /// Adds the positions of a part; a part may be added in several steps.
    pub(super) fn add(&mut self, part: u32, positions: impl Iterator<Item = [f32; 3]>) {
        for position in positions {
            let known = self.part_at.entry(bits(position)).or_insert(part);
            if *known != part {
                *known = SEVERAL;
            }
        }
    }

    /// Returns whether several parts have a position.
    pub(super) fn contains(&self, position: [f32; 3]) -> bool {
        self.part_at.get(&bits(position)) == Some(&SEVERAL)
    }
}

/// Adding zero makes -0 and 0 one.
fn bits(position: [f32; 3]) -> [u32; 3] {
    position.map(|coordinate| (coordinate + 0.0).to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_positions_of_several_parts_are_borders() {
        let mut borders = Borders::default();
        borders.add(0, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]].into_iter());
        borders.add(1, [[2.0, 0.0, 0.0], [-0.0, 0.0, 0.0]].into_iter());
        borders.add(0, [[2.0, 1.0, 0.0]].into_iter());
        assert!(borders.contains([0.0, -0.0, 0.0]));
        for own in [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [9.0; 3]] {
            assert!(!borders.contains(own), "{own:?}");
        }
    }
}
