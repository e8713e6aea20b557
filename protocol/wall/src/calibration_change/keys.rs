//! The keys of a channel's calibration that can be tuned, each by itself.

use crate::ChannelCalibration;

/// A key that can be tuned.
pub(super) struct Key {
    /// The key as commands call it; `gamma` stands for curves too.
    pub name: &'static str,
    /// Measured in pixels of the upright picture, so a change of that picture makes it invalid.
    pub is_in_pixels: bool,
    pub is_same: fn(&ChannelCalibration, &ChannelCalibration) -> bool,
    pub copy: fn(&ChannelCalibration, &mut ChannelCalibration),
}

/// All keys that can be tuned.
pub(super) const KEYS: &[Key] = &[
    Key {
        name: "pin",
        is_in_pixels: true,
        is_same: |a, b| a.pin == b.pin,
        copy: |from, to| to.pin = from.pin,
    },
    Key {
        name: "bend",
        is_in_pixels: true,
        is_same: |a, b| a.bend == b.bend,
        copy: |from, to| to.bend.clone_from(&from.bend),
    },
    Key {
        name: "edge.left",
        is_in_pixels: true,
        is_same: |a, b| a.edges.left == b.edges.left,
        copy: |from, to| to.edges.left = from.edges.left,
    },
    Key {
        name: "edge.right",
        is_in_pixels: true,
        is_same: |a, b| a.edges.right == b.edges.right,
        copy: |from, to| to.edges.right = from.edges.right,
    },
    Key {
        name: "edge.top",
        is_in_pixels: true,
        is_same: |a, b| a.edges.top == b.edges.top,
        copy: |from, to| to.edges.top = from.edges.top,
    },
    Key {
        name: "edge.bottom",
        is_in_pixels: true,
        is_same: |a, b| a.edges.bottom == b.edges.bottom,
        copy: |from, to| to.edges.bottom = from.edges.bottom,
    },
    Key {
        name: "gain",
        is_in_pixels: false,
        is_same: |a, b| a.color.gain == b.color.gain,
        copy: |from, to| to.color.gain = from.color.gain,
    },
    Key {
        name: "matrix",
        is_in_pixels: false,
        is_same: |a, b| a.color.matrix == b.color.matrix,
        copy: |from, to| to.color.matrix = from.color.matrix,
    },
    Key {
        name: "leak",
        is_in_pixels: false,
        is_same: |a, b| a.color.leak == b.color.leak,
        copy: |from, to| to.color.leak = from.color.leak,
    },
    Key {
        name: "gamma",
        is_in_pixels: false,
        is_same: |a, b| a.color.curve == b.color.curve,
        copy: |from, to| to.color.curve.clone_from(&from.color.curve),
    },
];

/// Returns the names of the keys in which two calibrations differ.
pub fn differing_keys(a: &ChannelCalibration, b: &ChannelCalibration) -> Vec<&'static str> {
    KEYS.iter().filter(|key| !(key.is_same)(a, b)).map(|key| key.name).collect()
}

/// Copies a key's value from one calibration to another; nothing if no key has this name.
pub fn copy_key(name: &str, from: &ChannelCalibration, to: &mut ChannelCalibration) {
    if let Some(key) = KEYS.iter().find(|key| key.name == name) {
        (key.copy)(from, to);
    }
}
