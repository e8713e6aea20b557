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
    r#"[wall]
name = "w"
eye_separation = 0.065
dither = true
[blend]
exponent = 1.5
leak = 0.003
[[screen]]
name = "round"
cylinder = { radius = 3.0, degrees = [-45, 45], height = [-1.2, 1.2], rotation = [10, 0, 0] }
tiles = { columns = 2, pixels = [400, 320], overlap = [40, 0] }
[[screen]]
name = "dome"
pixels = [800, 400]
[screen.sphere]
center = [0.0, 0.1, 0.0]
radius = 4.0
azimuth = [-60, 60]
elevation = [0, 60]
[[screen.channel]]
name = "beam"
pixels = [640, 480]
server = "pc"
projector = { position = [0, 0, 0], look_at = [0, 2, -3], degrees = [40, 30], shift = [0, 0.1] }
[[screen.channel]]
name = "mapped"
pixels = [640, 480]
[[screen]]
name = "hull"
mesh = "hull.obj"
tiles.pixels = [64, 64]
[channel.round-1-1]
turn = "left"
mirror = true
stereo = "side-by-side"
pin = [[1, 2], [0, 0], [-3.5, 0], [0, 1]]
bend = { points = [2, 3], moves = [[0, 0], [1, 0], [0, 0], [0, 2], [0, 0], [0, 0]] }
edges = { left = 0, right = 30.5 }
gain = [1.0, 0.9, 0.8]
matrix = [[1, 0.1, 0], [0, 1, 0], [0.05, 0, 0.95]]
gamma = 2.2
alpha = "masks/a.png"
beta = "masks/b.png"
[channel.round-2-1]
curve = [0, [0.2, 0.25, 0.3], 1]
edges.right = 0
[channel.mapped]
warp = "maps/mapped.pfm"
alpha = "masks/a.png"
"#,
    include_str!("../../../configs/bezel-2x2.toml"),
    include_str!("../../../configs/cave-4.toml"),
    include_str!("../../../configs/wall-3x1.toml"),
    include_str!("../../../configs/dome-5.toml"),
    include_str!("../../../configs/powerwall-overlap.toml"),
];
