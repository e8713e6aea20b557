//! Layers and switches against a look at every node.

use std::collections::BTreeMap;

use proptest::prelude::*;

use crate::limits::LAYERS_MAX;
use crate::{
    AssetManifests, Edit, NewNode, Node, NodeId, Scene, SceneEdits, SceneOutline, SceneSubset,
};

/// Six nodes in a row, each hanging from the one before.
fn base() -> Scene {
    let node = |at: u32| Node { parent: at.checked_sub(1), ..Node::default() };
    Scene { nodes: (0..6).map(node).collect(), ..Scene::default() }
}

fn edit() -> impl Strategy<Value = Edit> {
    let node = || (0..10u64).prop_map(NodeId);
    let layer = || (0..4u8).prop_map(|at| ["a", "b", "c", "d"][usize::from(at)].to_owned());
    let new = |parent| Box::new(NewNode { parent, ..NewNode::default() });
    prop_oneof![
        (node(), prop::option::of(layer()))
            .prop_map(|(node, layer)| Edit::SetLayer { node, layer }),
        (layer(), any::<bool>())
            .prop_map(|(layer, visible)| Edit::SetLayerVisible { layer, visible }),
        (node(), prop::option::of(node()))
            .prop_map(|(node, shown)| Edit::SetSwitch { node, shown }),
        (node(), prop::option::of(node()))
            .prop_map(|(node, parent)| Edit::SetParent { node, parent }),
        (node(), any::<bool>()).prop_map(|(node, visible)| Edit::SetVisible { node, visible }),
        (6..10u64, prop::option::of(node()))
            .prop_map(move |(node, parent)| Edit::Create { node: NodeId(node), new: new(parent) }),
        node().prop_map(Edit::Remove),
    ]
}

/// Returns the node and all that it hangs from, itself first.
fn up(edits: &SceneEdits, base: &Scene, node: NodeId) -> Vec<NodeId> {
    let above = |node: &NodeId| edits.parent_of(base, *node);
    std::iter::successors(Some(node), above).take(64).collect()
}

fn has_edit(outline: &SceneOutline, edits: &SceneEdits, edit: &Edit) -> bool {
    let is_new = |node: NodeId| edits.node(node).is_none_or(|of| of.created.is_none());
    let is_made_once = !matches!(edit, Edit::Create { node, .. } if !is_new(*node));
    is_made_once && outline.check(edits, edit).is_ok()
}

proptest! {
    #[test]
    fn layers_and_switches_fold_to_what_every_node_says(
        all in prop::collection::vec(edit(), 0..60),
    ) {
        let (base, mut edits) = (base(), SceneEdits::default());
        let outline = SceneOutline::from(&base);
        let mut hidden: BTreeMap<String, bool> = BTreeMap::new();
        for edit in all {
            if !has_edit(&outline, &edits, &edit) {
                continue;
            }
            if let Edit::SetLayerVisible { layer, visible } = &edit {
                hidden.insert(layer.clone(), !visible);
            }
            edits.apply(edit);
        }
        // The layers are those of all nodes, and those that are hidden.
        let own = |(_, of): (NodeId, &crate::NodeEdits)| of.layer.clone();
        let mut expected: Vec<String> = edits.nodes().filter_map(own).collect();
        expected.extend(hidden.iter().filter(|(_, is)| **is).map(|(name, _)| name.clone()));
        expected.sort();
        expected.dedup();
        let names: Vec<String> = edits.layers().all().map(|(name, _)| name.to_owned()).collect();
        prop_assert_eq!(names, expected);
        for (name, is_hidden) in edits.layers().all() {
            prop_assert_eq!(is_hidden, hidden.get(name).copied().unwrap_or(false));
        }
        // A node that is drawn is chosen by every switch above it, and in the nearest layer.
        let (scene, ids) = edits.apply_to(&base, &AssetManifests::new());
        let traits = edits.traits(&scene.nodes, ids);
        for (at, id) in traits.ids.iter().enumerate() {
            let above = up(&edits, &base, *id);
            for pair in above.windows(2) {
                let switch = edits.node(pair[1]).and_then(|of| of.switch);
                prop_assert!(switch.is_none_or(|shown| shown == pair[0]));
            }
            let mut layers = above.iter().filter_map(|id| edits.node(*id)?.layer.as_deref());
            let layer = traits.layer_of.get(at).copied().flatten();
            let layer = layer.map(|layer| traits.layers[usize::from(layer)].0.as_str());
            prop_assert_eq!(layer, layers.next());
        }
        // One that is not drawn is hidden, or not chosen, or below one that is.
        let (nodes, _, everything) = edits.all_nodes(&base);
        prop_assert_eq!(nodes.len(), everything.len());
        for id in everything.iter().filter(|id| !traits.ids.contains(id)) {
            let above = up(&edits, &base, *id);
            let is_hidden = above.iter().any(|id| edits.node(*id).is_some_and(|of| of.is_hidden));
            let is_left_out = above.windows(2).any(|pair| {
                edits.node(pair[1]).and_then(|of| of.switch).is_some_and(|is| is != pair[0])
            });
            prop_assert!(is_hidden || is_left_out);
        }
        // A snapshot, whose sums are made anew, has the same.
        let copy: SceneEdits = polyptych_codec::decode_within::<_, 1_000_000>(
            &polyptych_codec::encode(&edits),
        ).expect("whole");
        prop_assert_eq!(&copy, &edits);
    }
}

fn refused(edits: &SceneEdits, edit: &Edit, part: &str) {
    let error = SceneOutline::from(&base()).check(edits, edit).expect_err(part).to_string();
    assert!(error.contains(part), "{error}");
}

#[test]
fn layers_and_switches_that_cannot_be_are_refused() {
    let mut edits = SceneEdits::default();
    let into = |node: u64, layer: &str| Edit::SetLayer {
        node: NodeId(node),
        layer: Some(layer.to_owned()),
    };
    let hide = |layer: &str| Edit::SetLayerVisible { layer: layer.to_owned(), visible: false };
    refused(&edits, &into(9, "a"), "there is no node 9");
    refused(&edits, &into(1, ""), "a layer has a name");
    refused(&edits, &into(1, &"a".repeat(257)), "257 bytes, where 256 can be");
    refused(&edits, &into(1, "a\nb"), "no control characters");
    refused(&edits, &hide("a"), "layer a: no node is in it; of layers there is none");
    for layer in 0..LAYERS_MAX as u64 {
        let node = NodeId(100 + layer);
        edits.apply(Edit::Create { node, new: NewNode::default().into() });
        edits.apply(into(node.0, &format!("layer {layer}")));
    }
    refused(&edits, &into(1, "more"), "64 layers, the most that there can be");
    let outline = SceneOutline::from(&base());
    assert_eq!(outline.check(&edits, &into(1, "layer 3")), Ok(()));
    assert_eq!(outline.check(&edits, &hide("layer 3")), Ok(()));
    refused(&edits, &hide("layer 64"), "there are layer 0, layer 1, layer 10");

    let switch = |shown: u64| Edit::SetSwitch { node: NodeId(1), shown: Some(NodeId(shown)) };
    refused(&edits, &switch(3), "node 1: its switch shows one of its children, and node 3 is none");
    refused(&edits, &switch(77), "there is no node 77");
    assert_eq!(outline.check(&edits, &switch(2)), Ok(()));

    let subset = |root, layer: &str| SceneSubset { root, layers: Some(vec![layer.to_owned()]) };
    let check = |subset| outline.check_subset(&edits, &subset).map_err(|error| error.to_string());
    assert_eq!(check(subset(Some(NodeId(5)), "layer 3")), Ok(()));
    assert!(check(subset(None, "layer 99")).expect_err("none").contains("no node is in it"));
    assert!(check(subset(Some(NodeId(99)), "layer 3")).expect_err("none").contains("no node 99"));
}

#[test]
fn a_chosen_child_that_goes_leaves_nothing_shown() {
    let mut edits = SceneEdits::default();
    let node = NodeId(6);
    edits.apply(Edit::Create {
        node,
        new: NewNode { parent: Some(NodeId(0)), ..NewNode::default() }.into(),
    });
    let count = |edits: &SceneEdits| edits.apply_to(&base(), &AssetManifests::new()).1.len();
    assert_eq!(count(&edits), 7);
    edits.apply(Edit::SetSwitch { node: NodeId(0), shown: Some(node) });
    assert_eq!(count(&edits), 2, "node 1 and what hangs from it is left out");
    edits.apply(Edit::SetParent { node, parent: None });
    assert_eq!(count(&edits), 2, "the switch still shows it, which hangs elsewhere now");
    edits.apply(Edit::Remove(node));
    assert_eq!(count(&edits), 1);
    edits.apply(Edit::SetSwitch { node: NodeId(0), shown: None });
    assert_eq!(count(&edits), 6);
}
