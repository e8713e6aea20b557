//! The blend of projectors at the rim of a dome, whose places are bent most.

use glam::DVec2;
use polyptych_wall::blend::{BlendModel, ChannelMasks, blend_map};

/// Maximum error of a weight: that of interpolation, and of 16 bits.
const WEIGHT_ERROR_MAX: f64 = 1.0 / 32768.0 + 1.0 / 65535.0;

/// Pixels between two that are compared, along rows and columns.
const STEP: usize = 7;

#[test]
fn weights_of_a_dome_are_exact() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/dome-5.toml");
    let wall = polyptych_wall_file::load(path.as_ref()).expect("a wall");
    let blend = BlendModel::new(&wall);
    let (mut worst, mut count) = (0.0_f64, 0);
    for id in wall.channel_ids() {
        let map = blend_map(&wall, id, &ChannelMasks::default()).expect("a shared channel");
        let pixels = wall.channel_mapping(id).expect("a projector");
        let columns = || (0..map.size.x).step_by(STEP);
        for (x, y) in (0..map.size.y).step_by(STEP).flat_map(|y| columns().map(move |x| (x, y))) {
            let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let Some(canvas) = pixels.canvas_from_pixel(center) else { continue };
            let weights = blend.weights(id, canvas);
            let (_, due) = weights.iter().find(|(own, _)| *own == id).expect("its own");
            worst = worst.max((map.texel(x, y, 0)[0] - due).abs());
            count += usize::from(weights.len() > 1);
        }
    }
    println!("{count} shared pixels are off by {worst:.2e} at most");
    assert!(count > 60_000 && worst <= WEIGHT_ERROR_MAX, "{worst:e}, {count} shared pixels");
}
