//! The maximum sizes of a scene, each with its reason.

/// Largest manifest: about a million nodes.
pub const MANIFEST_BYTES_MAX: usize = 512 << 20;

/// Maximum number of draws of a scene, a draw being one primitive in one place. A few kilobytes of
/// glTF can name billions. A render server holds 352 bytes for each draw (its place, its box, its
/// share of the tree that culls it, and its node), 20 more once a node was moved, about 340 more
/// while it stands elsewhere, and at most 360 more while it is on screen: 1.4 GiB in all.
pub const DRAWS_MAX: u64 = 2 << 20;

/// Maximum number of pairs of a draw and a light whose range may reach it: each is tested when a
/// scene is prepared, in about 2 ns.
pub const LIT_DRAWS_MAX: u64 = 8 << 30;

/// Longest side of a texture; what the weakest supported driver can hold.
pub const TEXTURE_SIDE_MAX: u32 = 8192;

/// Maximum number of notes of a scene; a broken exporter repeats itself.
pub const NOTES_MAX: usize = 64;

/// Maximum length of a note in bytes: a line of a terminal and a half. All notes of a scene take
/// 16 KiB of every status.
pub const NOTE_BYTES_MAX: usize = 256;

/// Maximum length of a node's name or of an attribute's key, in bytes: a line of a tree.
pub const NODE_NAME_BYTES_MAX: usize = 256;

/// Maximum length of an attribute's text, in bytes: some lines about a node.
pub const ATTRIBUTE_BYTES_MAX: usize = 1024;

/// Maximum number of attributes that edits give one node.
pub const ATTRIBUTES_MAX: usize = 64;

/// Maximum size of all that was changed of a scene, encoded, in bytes: it goes to a server that
/// joins in one message, beside a wall. Ten thousand nodes that were moved take 1.1 MiB.
pub const EDITS_BYTES_MAX: usize = 3 << 19;

/// Maximum size of what a file says of its nodes beside their picture, as edits of them, encoded,
/// in bytes. The rest of [`EDITS_BYTES_MAX`] is left to edits.
pub const EXTRAS_BYTES_MAX: usize = 1 << 19;

/// Maximum number of nodes above one that is edited. Files have tens; each edit looks at all.
pub const DEPTH_MAX: usize = 256;

/// Maximum number of transactions whose assets are in a scene at a time: an edit looks at all, and
/// a server that joins reads a manifest for each.
pub const ASSET_SETS_MAX: usize = 4096;

/// Maximum number of layers of a scene, those that are hidden and have no nodes any more among
/// them: a view chooses layers by one bit each.
pub const LAYERS_MAX: usize = 64;
