//! Parts of a scene that views show: what hangs from a node, and what is in some layers.

use polyptych_scene::{Node, NodeId, NodeTraits, SceneSubset};

/// A subset of one scene, for quick tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Selection {
    /// The places in the tree, from the first to before the last; all if `None`.
    places: Option<[u32; 2]>,
    /// One bit for each layer that is shown.
    layers: u64,
    is_whole: bool,
    /// It stands in surroundings that have a sun.
    has_sun: bool,
}

impl Selection {
    /// Returns whether it holds all of the scene.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Its places in the tree, from the first to before the last; `None` if it has all.
    pub fn places(&self) -> Option<[u32; 2]> {
        self.places
    }

    /// Returns whether it shows a layer, given by its bit; 0 is none, which is always shown.
    pub fn has_layer(&self, layer: u64) -> bool {
        layer == 0 || self.layers & layer != 0
    }

    /// Returns whether it stands in surroundings that have a sun.
    pub fn has_sun(&self) -> bool {
        self.has_sun
    }

    /// Returns it in surroundings that have a sun, or none.
    pub fn within(self, has_sun: bool) -> Self {
        Self { has_sun, ..self }
    }

    /// Returns whether it holds a place in the tree.
    pub fn has_place(&self, place: u32) -> bool {
        self.places.is_none_or(|[begin, end]| (begin..end).contains(&place))
    }
}

/// The layers of a scene, and the places of its nodes in its tree.
#[derive(Debug, Default)]
pub(crate) struct SceneTree {
    layers: Vec<(String, bool)>,
    /// For each node, by its number: its place, and the place behind all that hang from it.
    places: Vec<(NodeId, [u32; 2])>,
}

impl SceneTree {
    /// The tree of these nodes, and the place of each in it: parents before their children, and
    /// all that hangs from a node in one stretch.
    pub fn new(nodes: &[Node], traits: &NodeTraits) -> (Self, Vec<u32>) {
        let mut sizes = vec![1u32; nodes.len()];
        for (index, node) in nodes.iter().enumerate().rev() {
            if let Some(parent) = node.parent {
                sizes[parent as usize] += sizes[index];
            }
        }
        let (mut places, mut next) = (Vec::with_capacity(nodes.len()), Vec::new());
        let mut next_top = 0;
        for (node, size) in nodes.iter().zip(&sizes) {
            let free = match node.parent {
                Some(parent) => &mut next[parent as usize],
                None => &mut next_top,
            };
            let place = *free;
            *free += size;
            places.push(place);
            next.push(place + 1);
        }
        let ranges = places.iter().zip(&sizes).map(|(place, size)| [*place, place + size]);
        let mut by_number: Vec<_> = traits.ids.iter().copied().zip(ranges).collect();
        by_number.sort_unstable_by_key(|(id, _)| *id);
        (Self { layers: traits.layers.clone(), places: by_number }, places)
    }

    /// A subset of this scene.
    pub fn select(&self, subset: &SceneSubset) -> Selection {
        let places = subset.root.map(|root| {
            let found = self.places.binary_search_by_key(&root, |(id, _)| *id);
            found.map_or([0, 0], |at| self.places[at].1)
        });
        let is_shown = |(name, is_hidden): &(String, bool)| subset.shows_layer(name, *is_hidden);
        let bits = self.layers.iter().enumerate();
        let layers = bits.filter(|(_, of)| is_shown(of)).fold(0, |all, (bit, _)| all | 1 << bit);
        let is_whole = places.is_none() && self.layers.iter().all(is_shown);
        Selection { places, layers, is_whole, has_sun: false }
    }
}

/// The bit of the layer of each node; 0 of one that is in none.
pub(crate) fn layer_bit(traits: &NodeTraits, node: usize) -> u64 {
    let layer = traits.layer_of.get(node).copied().flatten();
    layer.map_or(0, |layer| 1 << layer)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns whether a node is another, or hangs from it.
    fn hangs_from(nodes: &[Node], node: usize, from: usize) -> bool {
        let up = |at: &usize| nodes[*at].parent.map(|parent| parent as usize);
        std::iter::successors(Some(node), up).any(|at| at == from)
    }

    proptest! {
        #[test]
        fn a_root_selects_what_hangs_from_it(
            parents in prop::collection::vec(any::<prop::sample::Index>(), 1..60),
            tops in prop::collection::vec(any::<bool>(), 60),
        ) {
            let parent = |(at, of): (usize, &prop::sample::Index)| {
                (at > 0 && !tops[at]).then(|| of.index(at) as u32)
            };
            let node = |parent| Node { parent, ..Node::default() };
            let nodes: Vec<Node> = parents.iter().enumerate().map(parent).map(node).collect();
            // Numbers in no order of the nodes.
            let ids: Vec<NodeId> = (0..nodes.len() as u64).map(|n| NodeId(n * 37 % 61)).collect();
            let traits = NodeTraits { ids: ids.clone(), ..NodeTraits::default() };
            let (tree, places) = SceneTree::new(&nodes, &traits);
            for (from, id) in ids.iter().enumerate() {
                let subset = SceneSubset { root: Some(*id), layers: None };
                let selection = tree.select(&subset);
                for (at, place) in places.iter().enumerate() {
                    prop_assert_eq!(selection.has_place(*place), hangs_from(&nodes, at, from));
                }
            }
            let gone = tree.select(&SceneSubset { root: Some(NodeId(99)), layers: None });
            prop_assert!(places.iter().all(|place| !gone.has_place(*place)));
        }
    }

    #[test]
    fn layers_are_those_of_the_view_or_of_the_scene() {
        let layers = [("day", false), ("night", true), ("plan", false)];
        let layers: Vec<_> = layers.map(|(name, hidden)| (name.to_owned(), hidden)).into();
        let layer_of = vec![None, Some(0), Some(1), Some(2)];
        let traits = NodeTraits { layers, layer_of, ..NodeTraits::of_file(4) };
        let (tree, _) = SceneTree::new(&vec![Node::default(); 4], &traits);
        let shown = |layers: Option<&[&str]>| {
            let layers = layers.map(|of| of.iter().map(|name| (*name).to_owned()).collect());
            let selection = tree.select(&SceneSubset { root: None, layers });
            (0..4).map(|node| selection.has_layer(layer_bit(&traits, node))).collect::<Vec<_>>()
        };
        assert_eq!(shown(None), [true, true, false, true]);
        assert_eq!(shown(Some(&["night"])), [true, false, true, false]);
        assert_eq!(shown(Some(&[])), [true, false, false, false]);
        let all = ["day", "night", "plan", "none"].map(str::to_owned);
        let all = SceneSubset { root: None, layers: Some(all.into()) };
        assert!(tree.select(&all).is_whole() && !tree.select(&SceneSubset::default()).is_whole());
    }
}
