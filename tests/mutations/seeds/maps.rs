//! Files of walls: one of each kind, in the order of `map_file::KINDS`, written by the harness.

#[path = "../../harness/maps.rs"]
mod files;

use files::{Png, Region, png};

/// Small valid files.
pub fn all() -> Vec<Vec<u8>> {
    let warp = files::pfm([6, 4], 3, true, |x, y| [x as f32 * 0.5, y as f32 * -0.5, -2.0]);
    let obj = files::obj([3, 2], |u, v| ([u * 3.0, 2.0 - v * 2.0, -2.0], [u, 1.0 - v]));
    let node = |x: u32, y: u32| {
        let (u, v) = (f64::from(x) / 3.0, f64::from(y) / 2.0);
        [(u * 2.0 - 1.0) * 1.5, v * 2.0 - 1.0, u, v, 1.0 - u * 0.5]
    };
    let bourke = files::bourke([4, 3], node);
    let texels: Vec<u16> = (0..48).map(|i| i * 1365).collect();
    let uv = Png { size: [4, 4], color: 2, bits: 16, gamma: None, texels: &texels };
    let grey: Vec<u16> = (0..64).map(|i| i * 4).collect();
    let mask = Png { size: [8, 8], color: 0, bits: 8, gamma: Some(45455), texels: &grey };
    vec![
        warp,
        obj.into_bytes(),
        bourke.into_bytes(),
        png(&uv),
        png(&mask),
        super::scenes::everything().glb(),
        archive(&png(&mask)),
    ]
}

fn archive(mask: &[u8]) -> Vec<u8> {
    let region = |id: &str, x: f64| Region {
        id: id.to_owned(),
        size: [8, 8],
        part: [x, 0.0, 0.5, 1.0],
        frustum: Some([10.0, 5.0, 1.0, 20.0, -20.0, 15.0, -15.0]),
        warp: files::pfm([8, 8], 3, false, |x, y| [x as f32, y as f32, -3.0]),
        unit: Some("ft".to_owned()),
        origin: Some("idealEyePoint".to_owned()),
        alpha: Some((mask.to_vec(), 2.2)),
        beta: None,
    };
    let regions = [region("left", 0.0), region("right", 0.5)];
    files::zip(&files::mpcdi_entries("3d", [16, 8], &regions))
}
