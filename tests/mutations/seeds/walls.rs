//! Wall files: with every key, by hand and by tiles, by corners and by angles.

/// Each is a valid wall file.
pub const SEEDS: &[&str] = &[
    r#"
[wall]
name = "seed"
eye = [0.0, 0.1, 0.2]
near = 0.05
samples = 4
[deadline]
factor = 4.0
min_ms = 50
max_ms = 2000
[network]
listen = "127.0.0.1:7878"
heartbeat_ms = 2000
[storage]
stores = ["blobs"]
scenes = ["."]
[[screen]]
name = "a"
size = [1.92, 1.08]
center = [0.0, 0.0, -1.304]
rotation = [0.0, 0.0, 0.0]
projection = "shared"
[screen.tiles]
columns = 2
rows = 1
pixels = [64, 64]
bezel = [0.02, 0.0]
[[screen]]
name = "b"
lower_left = [-3.0, -0.5, 2.0]
lower_right = [-3.0, -0.5, -2.0]
upper_left = [-3.0, 0.5, 2.0]
[screen.tiles]
pixels = [64, 48]
names = ["b"]
servers = ["pc-1"]
"#,
    r#"
wall = { name = "inline", samples = 1 }
[[screen]]
name = "hand"
size = [2.0, 1.0]
center = [0.0, 0.0, -2.0]
pixels = [200, 100]
[[screen.channel]]
name = "left"
origin = [0, 0]
pixels = [90, 100]
server = "pc"
[[screen.channel]]
name = "right"
origin = [110, 0]
pixels = [90, 100]
[[screen.hidden]]
origin = [90, 0]
pixels = [20, 100]
"#,
    include_str!("../../../protocol/wall-file/src/tests/every-key.toml"),
    include_str!("../../../configs/bezel-2x2.toml"),
    include_str!("../../../configs/cave-4.toml"),
    include_str!("../../../configs/wall-3x1.toml"),
    include_str!("../../../configs/dome-5.toml"),
    include_str!("../../../configs/powerwall-overlap.toml"),
];
