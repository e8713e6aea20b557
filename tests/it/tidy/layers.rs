//! The dependencies that each crate may have: a crate cannot use what it does not depend on.

use super::tree::Tree;

/// The crates of ours that a crate may depend on, and others that it must not have, not even for
/// tests.
struct Layer {
    folder: &'static str,
    ours: &'static [&'static str],
    refused: &'static [&'static str],
}

/// From below. Whatever knows another crate is listed under it.
const LAYERS: &[Layer] = &[
    Layer { folder: "protocol/text", ours: &[], refused: &["tokio", "wgpu"] },
    Layer { folder: "protocol/codec", ours: &[], refused: &["tokio", "wgpu"] },
    Layer { folder: "protocol/files", ours: &[], refused: &["tokio", "wgpu"] },
    Layer {
        folder: "protocol/wall",
        ours: &["files", "text", "wall-file"], // wall-file in its tests only
        refused: &["tokio", "toml", "wgpu"],
    },
    Layer { folder: "protocol/wall-file", ours: &["files", "text", "wall"], refused: &["tokio"] },
    Layer {
        folder: "protocol/object-store",
        ours: &["files"],
        refused: &["bincode", "gltf", "image", "toml", "wgpu"],
    },
    Layer { folder: "protocol/scene", ours: &["codec", "files"], refused: &["tokio", "gltf"] },
    Layer {
        folder: "protocol",
        ours: &["codec", "files", "scene", "text", "wall"],
        refused: &["bincode", "gltf", "image", "toml", "wgpu", "tokio-rustls"],
    },
    Layer {
        folder: "protocol/tls",
        ours: &["files", "protocol", "wall"],
        refused: &["bincode", "gltf", "image", "toml", "wgpu"],
    },
    Layer {
        folder: "client-api",
        ours: &["codec", "protocol", "scene", "text", "tls", "wall", "wall-file"],
        refused: &["bincode", "gltf", "image", "wgpu"],
    },
    Layer {
        folder: "client-api/devices",
        ours: &["protocol", "wall"],
        refused: &["tokio", "toml", "wgpu"],
    },
    Layer {
        folder: "server-manager/core",
        ours: &["codec", "files", "protocol", "scene", "text", "wall"],
        refused: &["tokio", "tokio-util", "bincode", "image", "wgpu"],
    },
    Layer {
        folder: "server-manager/baker",
        ours: &["codec", "files", "scene", "text", "wall"],
        refused: &["tokio", "bincode", "wgpu"],
    },
    Layer {
        folder: "server-manager",
        ours: &["codec", "core", "files", "protocol", "scene", "text", "tls", "wall", "wall-file"],
        refused: &["bincode", "gltf", "image", "wgpu"],
    },
    Layer {
        folder: "render-server/renderer",
        ours: &["files", "scene", "wall"],
        refused: &["tokio", "winit"],
    },
    Layer {
        folder: "render-server",
        ours: &["codec", "files", "object-store", "protocol", "renderer", "scene", "tls", "wall"],
        refused: &["bincode", "gltf"],
    },
];

/// No crate depends on what it is to know nothing of, and versions are named once.
pub fn manifests(tree: &Tree) -> Vec<String> {
    let mut offences = Vec::new();
    for layer in LAYERS {
        let path = format!("{}/Cargo.toml", layer.folder);
        let text = match tree.required(&path, "a crate's dependencies") {
            Ok(text) => text,
            Err(missing) => {
                offences.push(missing);
                continue;
            }
        };
        for (number, name, line) in dependencies(text, is_member_section) {
            let ours = name.strip_prefix("polyptych-");
            let is_known = ours.is_none_or(|name| layer.ours.contains(&name));
            if !is_known || layer.refused.contains(&name) {
                offences.push(format!("{path}:{number}: {name}: this crate must not know it"));
            }
            if !line.contains("workspace = true") {
                offences.push(format!(
                    "{path}:{number}: {name}: versions are named in the workspace's table only"
                ));
            }
        }
    }
    offences
}

/// Every crate that we take from others says why it is here.
pub fn reasons(tree: &Tree) -> Vec<String> {
    let text = match tree.required("Cargo.toml", "the workspace's dependencies") {
        Ok(text) => text,
        Err(missing) => return vec![missing],
    };
    let lines: Vec<&str> = text.lines().collect();
    dependencies(text, |section| section == "[workspace.dependencies]")
        .filter(|(_, _, line)| !line.contains("path ="))
        .filter(|(number, _, line)| {
            let before = number.checked_sub(2).map_or("", |index| lines[index]);
            !line.contains(" # ") && !before.starts_with('#')
        })
        .map(|(number, name, _)| format!("Cargo.toml:{number}: {name}: no comment says why"))
        .collect()
}

fn is_member_section(section: &str) -> bool {
    section.ends_with("dependencies]") && section != "[workspace.dependencies]"
}

/// Line number, name and line of every dependency in the sections that `is_wanted` picks.
fn dependencies(
    text: &str,
    is_wanted: impl Fn(&str) -> bool,
) -> impl Iterator<Item = (usize, &str, &str)> {
    let mut is_inside = false;
    (1..).zip(text.lines()).filter_map(move |(number, line)| {
        if line.starts_with('[') {
            is_inside = is_wanted(line.trim());
        }
        let is_entry = line.starts_with(|c: char| c.is_ascii_alphabetic());
        let name = line.split(['.', '=', ' ']).next()?;
        (is_inside && is_entry).then_some((number, name, line))
    })
}
