//! glTF's seven modes become three: points, line lists, triangle lists.

use polyptych_scene::Topology;

/// Returns the topology that a mode draws, or `None` if there is no such mode.
pub(super) fn of_mode(mode: u32) -> Option<Topology> {
    match mode {
        0 => Some(Topology::Points),
        1..=3 => Some(Topology::Lines),
        4..=6 => Some(Topology::Triangles),
        _ => None,
    }
}

/// Returns the number of indices in one element.
pub(super) fn arity(topology: Topology) -> usize {
    match topology {
        Topology::Points => 1,
        Topology::Lines => 2,
        Topology::Triangles => 3,
    }
}

/// Indices of a list that draws the same. A `restart` index cuts strips, loops and fans.
/// An element that is not complete is dropped.
pub(super) fn to_list(mode: u32, mut indices: Vec<u32>, restart: Option<u32>) -> Vec<u32> {
    match mode {
        0 => indices,
        1 => {
            indices.truncate(indices.len() / 2 * 2);
            indices
        }
        4 => {
            indices.truncate(indices.len() / 3 * 3);
            indices
        }
        _ => {
            let mut list = Vec::with_capacity(indices.len() * if mode < 4 { 2 } else { 3 });
            for run in indices.split(|&index| Some(index) == restart) {
                append(mode, run, &mut list);
            }
            list
        }
    }
}

fn append(mode: u32, run: &[u32], list: &mut Vec<u32>) {
    let pairs = run.windows(2);
    match (mode, run) {
        // A loop is a strip that comes back.
        (2, [first, .., last]) => {
            pairs.for_each(|pair| list.extend(pair));
            list.extend([last, first]);
        }
        (3, _) => pairs.for_each(|pair| list.extend(pair)),
        (5, _) => {
            // Every second triangle of a strip is turned, or it would show its back.
            for (i, triangle) in run.windows(3).enumerate() {
                let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
                list.extend(if i % 2 == 0 { [a, b, c] } else { [a, c, b] });
            }
        }
        (6, [hub, rim @ ..]) => {
            // glTF's order: the hub comes last, which is the same triangle.
            rim.windows(2).for_each(|pair| list.extend([pair[0], pair[1], *hub]));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_fans_and_loops_become_lists() {
        let list = |mode, run: &[u32]| to_list(mode, run.to_vec(), Some(255));
        assert_eq!(list(1, &[0, 1, 2]), [0, 1]);
        assert_eq!(list(2, &[0, 1, 2]), [0, 1, 1, 2, 2, 0]);
        assert_eq!(list(3, &[0, 1, 2]), [0, 1, 1, 2]);
        assert_eq!(list(4, &[0, 1, 2, 3]), [0, 1, 2]);
        assert_eq!(list(5, &[0, 1, 2, 3]), [0, 1, 2, 1, 3, 2]);
        assert_eq!(list(6, &[0, 1, 2, 3]), [1, 2, 0, 2, 3, 0]);
        assert_eq!(list(5, &[0, 1, 2, 255, 3, 4, 5]), [0, 1, 2, 3, 4, 5]);
        assert!(list(2, &[7]).is_empty());
    }
}
