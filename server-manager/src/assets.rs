//! Assets that a transaction brings: bakes them as any scene, and says what there is to place.

use std::path::PathBuf;

use bytes::Bytes;
use glam::DAffine3;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::transaction::{AssetSource, BakedAssets, NewAssets, Transaction};
use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_scene::{EXPOSURE_NOTE, NewNode, OVERVIEW_NOTE, Scene, provisional_asset};

use crate::import::{self, Baker};

/// Most nodes of a file that are made below another: each is an edit, and all changes of a scene
/// together are limited.
const PLACED_NODES_MAX: usize = 10_000;

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
            import::bake_scene(&file, None, baker, |_| {}).await?
        }
        AssetSource::Glb(bytes) => bake_bytes(bytes, baker).await?,
        AssetSource::Baked(_) => {
            return Err("assets come as a glTF file, or as the bytes of one".into());
        }
    };
    let store = BlobStore::new(baker.store.join("blobs"));
    let scene = tokio::task::spawn_blocking(move || import::read_scene(&store, manifest)).await;
    let scene = scene.map_err(|error| error.to_string())??;
    if let Some(below) = assets.below {
        place(&scene, *below, &mut transaction)?;
        if scene.meshes.is_empty() {
            // Lights and places for others bring nothing that could be used.
            return Ok((transaction, Vec::new()));
        }
    }
    let blobs = std::iter::once(manifest).chain(scene.blobs()).collect();
    let source = AssetSource::Baked(BakedAssets {
        manifest,
        primitives: scene.meshes.iter().map(|mesh| mesh.primitives.len() as u32).collect(),
        materials: scene.materials.len() as u32,
        textures: scene.textures.len() as u32,
        notes: scene.notes.into_iter().filter(|note| concerns_assets(note)).collect(),
    });
    transaction.assets = Some(NewAssets { source, below: None });
    Ok((transaction, blobs))
}

/// Returns whether a note is of assets too, and not of light and camera of a scene alone.
fn concerns_assets(note: &str) -> bool {
    ![EXPOSURE_NOTE, OVERVIEW_NOTE].iter().any(|start| note.starts_with(start))
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
    let baked = import::bake_scene(&file, None, baker, |_| {}).await;
    let path = file.display().to_string();
    drop(folder);
    // Where it lay is of no use to who sent it.
    baked.map_err(|reason| reason.replace(&path, "the assets"))
}

/// Makes the nodes of a scene below a node that is made for them.
fn place(scene: &Scene, below: NewNode, transaction: &mut Transaction) -> Result<(), String> {
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
    for (index, node) in (0..).zip(&scene.nodes) {
        let extras = extras.next_if(|of| of.node == index);
        // Parents come before their children. What has no size shows nothing, and neither does
        // what hangs from it.
        let parent = match node.parent {
            Some(parent) => ids.get(parent as usize).copied().flatten(),
            None => Some(root),
        };
        let parent = parent.filter(|_| node.local.matrix3.determinant() != 0.0);
        let Some(parent) = parent else {
            ids.push(None);
            continue;
        };
        let light = node.light.and_then(|light| scene.lights.get(light as usize)).cloned();
        let mesh = node.mesh.map(provisional_asset);
        // As other programs write them; nodes that are made have none.
        let name = node.name.replace(char::is_control, " ");
        let id = transaction.create(NewNode {
            parent: Some(parent),
            name: first_bytes(&name, NODE_NAME_BYTES_MAX).to_owned(),
            local: node.local,
            mesh: mesh.filter(|_| node.instances.is_empty()),
            light,
        });
        ids.push(Some(id));
        transaction.edits.extend(extras.into_iter().flat_map(|of| of.edits(id)));
        let shown = node
            .instances
            .iter()
            .filter(|of| of.scale.to_array().iter().all(|scale| *scale != 0.0));
        for instance in shown {
            let local = DAffine3::from_scale_rotation_translation(
                instance.scale.as_dvec3(),
                instance.rotation.as_dquat(),
                instance.translation.as_dvec3(),
            );
            let copy = NewNode { parent: Some(id), local, mesh, ..NewNode::default() };
            transaction.create(copy);
        }
    }
    Ok(())
}

/// Returns the beginning of a text that fits into this number of bytes.
fn first_bytes(text: &str, bytes_max: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes_max)).unwrap_or_default()
}
