//! Assets that a transaction brings: bakes them as any scene, and says what there is to place.

use std::path::PathBuf;

use bytes::Bytes;
use glam::{DAffine3, DMat3};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::transaction::{AssetSource, BakedAssets, NewAssets, Transaction};
use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_scene::{EXPOSURE_NOTE, NewNode, OVERVIEW_NOTE, Scene, provisional_asset};
use polyptych_text::counted;

use crate::import::{self, Baker};
use crate::scene_export::place_of;

/// Most nodes of a file that are made below another: each is an edit, and all changes of a scene
/// together are limited.
const PLACED_NODES_MAX: usize = 10_000;

/// The thickness of a node that is scaled flat, as a part of its longest axis: too little to be
/// seen, and enough for an edit, which takes no flat node.
const THICKNESS: f64 = 1e-6;

/// The volume between the axes of a node, as a part of that of a box with their lengths, up to
/// which they are flat: more than what edits refuse, so that rounding does not decide.
const FLAT_MAX: f64 = 1e-11;

/// Bakes the assets of a transaction. Gives the transaction with what was made of them, and the
/// blobs that servers may now ask for.
///
/// # Errors
/// Why they cannot be, and what would be right.
pub(crate) async fn bake(
    mut transaction: Transaction,
    assets: NewAssets,
    roots: &[PathBuf],
    baker: &Baker,
) -> Result<(Transaction, Vec<BlobHash>), String> {
    let manifest = match assets.source {
        AssetSource::File(path) => {
            let file = import::resolve(&path, roots)?;
            import::bake_added(&file, baker).await?
        }
        AssetSource::Glb(bytes) => bake_bytes(bytes, baker).await?,
        AssetSource::Baked(_) => {
            return Err("assets come as a glTF file, or as the bytes of one".into());
        }
    };
    let store = BlobStore::new(baker.store.join("blobs"));
    let scene = tokio::task::spawn_blocking(move || import::read_scene(&store, manifest)).await;
    let scene = scene.map_err(|error| error.to_string())??;
    let mut notes: Vec<String> =
        scene.notes.iter().filter(|note| concerns_assets(note)).cloned().collect();
    notes.extend(notes_of_motion(&scene));
    let has_meshes = !scene.meshes.is_empty();
    if let Some(below) = assets.below {
        let left_out = place(&scene, *below, &mut transaction)?;
        if left_out > 0 {
            let nodes = counted(left_out, "node");
            let line = "a line or a point by its scale, or hangs from such a one";
            notes.push(format!("nodes: {nodes} left out: each is {line}"));
        }
    } else if !has_meshes {
        return Err("no node of the file shows a mesh, so nothing could use its assets".into());
    }
    // Of lights and places for others servers need no blob, and the core takes the notes alone.
    let blobs = std::iter::once(manifest).chain(scene.blobs()).filter(|_| has_meshes).collect();
    let source = AssetSource::Baked(BakedAssets {
        manifest,
        primitives: scene.meshes.iter().map(|mesh| mesh.primitives.len() as u32).collect(),
        materials: scene.materials.len() as u32,
        textures: scene.textures.len() as u32,
        notes,
    });
    transaction.assets = Some(NewAssets { source, below: None });
    Ok((transaction, blobs))
}

/// Returns whether a note is of assets too, and not of light and camera of a scene alone.
fn concerns_assets(note: &str) -> bool {
    ![EXPOSURE_NOTE, OVERVIEW_NOTE].iter().any(|start| note.starts_with(start))
}

/// Notes of what moves or changes in a scene, and stands still once its file is added to another.
fn notes_of_motion(scene: &Scene) -> Vec<String> {
    let (clips, variants) = (scene.animations.clips.len(), scene.variants.len());
    let mut notes = Vec::new();
    if clips > 0 {
        let clips = counted(clips, "clip");
        notes.push(format!("animations: {clips} not played in a scene that the file is added to"));
    }
    if variants > 0 {
        let variants = counted(variants, "look");
        notes.push(format!("variants: {variants} left out of a scene that the file is added to"));
    }
    notes
}

/// Bakes the bytes of a file from a folder of its own, so that it can name no other.
async fn bake_bytes(bytes: Bytes, baker: &Baker) -> Result<BlobHash, String> {
    let cannot = |error: std::io::Error| format!("the assets cannot be written: {error}");
    let write = tokio::task::spawn_blocking(move || {
        let folder = tempfile::Builder::new().prefix("polyptych-assets-").tempdir()?;
        let file = folder.path().join("assets.glb");
        std::fs::write(&file, &bytes)?;
        std::io::Result::Ok((folder, file))
    });
    let written = write.await.map_err(|error| error.to_string())?;
    let (folder, file) = written.map_err(cannot)?;
    let baked = import::bake_added(&file, baker).await;
    let path = file.display().to_string();
    drop(folder);
    // Where it lay is of no use to who sent it.
    baked.map_err(|reason| reason.replace(&path, "the assets"))
}

/// Makes the nodes of a scene below a node that is made for them. Returns the number of nodes and
/// copies that are left out: those without any area, and what hangs from them.
fn place(scene: &Scene, below: NewNode, transaction: &mut Transaction) -> Result<u64, String> {
    let copies: usize = scene.nodes.iter().map(|node| node.instances.len() + 1).sum();
    if copies > PLACED_NODES_MAX {
        return Err(format!(
            "{}: it has {copies} nodes and instances, where {PLACED_NODES_MAX} can be put below \
             another; open it as a scene",
            scene.name
        ));
    }
    let root = transaction.create(below);
    let mut ids = Vec::with_capacity(scene.nodes.len());
    let mut extras = scene.extras.iter().peekable();
    let (hidden_at_rest, mut left_out) = (scene.animations.hidden_at_rest(), 0);
    for (index, node) in (0..).zip(&scene.nodes) {
        let extras = extras.next_if(|of| of.node == index);
        // Parents come before their children.
        let parent = match node.parent {
            Some(parent) => ids.get(parent as usize).copied().flatten(),
            None => Some(root),
        };
        let (Some(parent), Some(local)) = (parent, with_thickness(node.local)) else {
            ids.push(None);
            left_out += 1;
            continue;
        };
        let light = node.light.and_then(|light| scene.lights.get(light as usize)).cloned();
        let mesh = node.mesh.map(provisional_asset);
        // As other programs write them; nodes that are made have none.
        let name = node.name.replace(char::is_control, " ");
        let id = transaction.create(NewNode {
            parent: Some(parent),
            name: first_bytes(&name, NODE_NAME_BYTES_MAX).to_owned(),
            local,
            mesh: mesh.filter(|_| node.instances.is_empty()),
            light,
        });
        ids.push(Some(id));
        transaction.edits.extend(extras.into_iter().flat_map(|of| of.edits(id)));
        if hidden_at_rest.contains(&index) {
            transaction.set_visible(id, false);
        }
        for instance in &node.instances {
            let Some(local) = with_thickness(place_of(instance)) else {
                left_out += 1;
                continue;
            };
            let copy = NewNode { parent: Some(id), local, mesh, ..NewNode::default() };
            transaction.create(copy);
        }
    }
    Ok(left_out)
}

/// Returns the transform, with [`THICKNESS`] across its surface if it is flat. `None` if it leaves
/// no more than a line or a point.
fn with_thickness(local: DAffine3) -> Option<DAffine3> {
    let is_flat = |of: &DMat3| {
        let box_of_lengths = of.x_axis.length() * of.y_axis.length() * of.z_axis.length();
        of.determinant().abs() <= FLAT_MAX * box_of_lengths
    };
    if !is_flat(&local.matrix3) {
        return Some(local);
    }
    let mut axes = [local.matrix3.x_axis, local.matrix3.y_axis, local.matrix3.z_axis];
    let others = |at: usize| (axes[(at + 1) % 3], axes[(at + 2) % 3]);
    // The largest surface between two axes; the third axis is zero, or lies in it.
    let area = |at: &usize| {
        let (a, b) = others(*at);
        a.cross(b).length_squared()
    };
    let third = (0..3).max_by(|a, b| area(a).total_cmp(&area(b)))?;
    let (a, b) = others(third);
    axes[third] += a.cross(b).try_normalize()? * (THICKNESS * a.length().max(b.length()));
    let [x, y, z] = axes;
    let matrix3 = DMat3::from_cols(x, y, z);
    (!is_flat(&matrix3)).then_some(DAffine3 { matrix3, ..local })
}

/// Returns the beginning of a text that fits into this number of bytes.
fn first_bytes(text: &str, bytes_max: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes_max)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Quat, Vec3};
    use polyptych_scene::{
        AnimatedProperty, Clip, Edit, Instance, Node, NodeId, PropertyKind, SceneEdits,
        SceneOutline, Variant,
    };

    use super::*;

    fn placed(scene: &Scene) -> (Vec<Edit>, u64) {
        let mut transaction = Transaction::default();
        let left_out = place(scene, NewNode::default(), &mut transaction).expect("placed");
        (transaction.edits, left_out)
    }

    #[test]
    fn flat_nodes_are_placed_and_those_without_an_area_are_counted() {
        let turned = DAffine3::from_rotation_x(1.0);
        let node = |scale: [f64; 3], parent| {
            let local = turned * DAffine3::from_scale(DVec3::from(scale));
            Node { local, parent, ..Node::default() }
        };
        let mut sheared = node([1.0; 3], None);
        sheared.local.matrix3.z_axis = sheared.local.matrix3.x_axis * 0.5;
        let (translation, rotation) = (Vec3::X, Quat::IDENTITY);
        let instance = |scale| Instance { translation, rotation, scale, crowd: 0.0 };
        sheared.instances = [Vec3::new(0.0, 1.0, 1.0), Vec3::ZERO].map(instance).into();
        let flat = node([3.0, 0.0, 1e-3], None);
        let nodes = vec![flat, sheared, node([0.0, 0.0, 1.0], None), node([1.0; 3], Some(2))];
        let (edits, left_out) = placed(&Scene { nodes: nodes.clone(), ..Scene::default() });
        assert_eq!(left_out, 3, "a line, what hangs from it, and a copy that is a point");
        let locals = edits.iter().filter_map(|edit| match edit {
            Edit::Create { new, .. } => Some(new.local),
            _ => None,
        });
        let locals: Vec<DAffine3> = locals.collect();
        assert_eq!(locals.len(), 4, "the node for all, two flat ones and a flat copy");
        let outline = SceneOutline::from(&Scene { nodes, ..Scene::default() });
        for local in locals {
            let edit = Edit::SetTransform { node: NodeId(0), local };
            let checked = outline.check(&SceneEdits::default(), &edit);
            assert!(checked.is_ok() && local.matrix3.determinant() > 0.0, "{checked:?} {local:?}");
        }
    }

    #[test]
    fn what_clips_show_later_is_hidden_and_notes_say_what_stands_still() {
        let mut scene = Scene { nodes: vec![Node::default(); 2], ..Scene::default() };
        scene.animations.clips = vec![Clip::default(); 2];
        scene.variants = vec![Variant::default()];
        let of = |target, rest| AnimatedProperty {
            kind: PropertyKind::Visible,
            targets: vec![target],
            rest: vec![rest],
        };
        scene.animations.properties = vec![of(0, 1.0), of(1, 0.0)];
        let (edits, _) = placed(&scene);
        let hides = |edit: &&Edit| !matches!(edit, Edit::Create { .. });
        let hidden: Vec<&Edit> = edits.iter().filter(hides).collect();
        let node = NodeId::provisional(2);
        assert_eq!(hidden, [&Edit::SetVisible { node, visible: false }]);
        let notes = notes_of_motion(&scene).join("; ");
        assert!(notes.contains("2 clips not played") && notes.contains("1 look left"), "{notes}");
    }
}
