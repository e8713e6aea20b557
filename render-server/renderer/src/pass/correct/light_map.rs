//! The blend weights of a channel on the GPU, and the pixels that need no texel each.

use std::collections::BTreeMap;

use wgpu::util::DeviceExt;

use crate::correction::{BlendMapDesc, CorrectionDesc};
use crate::gpu::Gpu;

/// Side of the squares of texels that are equal or not, in texels: the search takes time for each.
const SQUARE: usize = 8;

/// The smallest share of a picture's pixels that is drawn by itself: five draws cost more than one.
const EVEN_SHARE_MIN: f64 = 0.1;

/// Factors and addends of a channel's pixels.
#[derive(Clone, Debug)]
pub(super) struct LightMap {
    /// One texel that nobody reads where there are no weights.
    pub view: wgpu::TextureView,
    /// The largest part of the picture with equal weights, of those that are worth it.
    pub even: Option<EvenArea>,
}

/// A rectangle of an upright picture whose pixels have the same weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EvenArea {
    /// Left, top, right and bottom, in pixels.
    pub sides: [u32; 4],
    /// Factor and addend of red, green and blue, or three times of all.
    pub weights: [[u16; 2]; 3],
}

impl LightMap {
    pub fn new(gpu: &Gpu, desc: &CorrectionDesc) -> Self {
        let ([width, height], texels) = match &desc.light_map {
            Some(map) => (desc.upright, map.texels.as_slice()),
            None => ([1, 1], [[0; 2]].as_slice()),
        };
        let layers = (texels.len() / (width as usize * height as usize)) as u32;
        // The shader takes the lower byte first, whatever the machine does.
        let mut bytes: Vec<u8> =
            texels.iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
        let layer_bytes = bytes.len() / layers as usize;
        let layers = gpu.array_layers(layers);
        bytes.resize(layers as usize * layer_bytes, 0);
        let descriptor = wgpu::TextureDescriptor {
            label: Some("correct/light_map"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        let order = wgpu::util::TextureDataOrder::default();
        let texture = gpu.device.create_texture_with_data(&gpu.queue, &descriptor, order, &bytes);
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let view =
            texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() });
        let even = desc.light_map.as_ref().and_then(|map| EvenArea::largest(map, desc.upright));
        Self { view, even }
    }
}

impl EvenArea {
    /// The largest rectangle of the most frequent weights, to squares of [`SQUARE`] texels; `None`
    /// if it is too small to be worth draws of its own.
    pub fn largest(map: &BlendMapDesc, upright: [u32; 2]) -> Option<Self> {
        let [width, height] = upright.map(|side| side as usize);
        let (columns, rows) = (width / SQUARE, height / SQUARE);
        let squares: Vec<_> = (0..columns * rows)
            .map(|at| even_weights(map, [width, height], [at % columns, at / columns]))
            .collect();
        let mut counts = BTreeMap::new();
        squares.iter().flatten().for_each(|weights| *counts.entry(*weights).or_insert(0) += 1);
        let (weights, _) = counts.into_iter().max_by_key(|(_, count)| *count)?;
        let is_even: Vec<_> = squares.iter().map(|square| *square == Some(weights)).collect();
        let sides = largest_rectangle(&is_even, columns).map(|side| side * SQUARE);
        let share =
            ((sides[2] - sides[0]) * (sides[3] - sides[1])) as f64 / (width * height) as f64;
        let sides = sides.map(|side| side as u32);
        (share >= EVEN_SHARE_MIN).then_some(Self { sides, weights })
    }

    /// The at most four parts of an upright picture around this one, as [`Self::sides`].
    pub fn others(&self, [width, height]: [u32; 2]) -> impl Iterator<Item = [u32; 4]> {
        let [left, top, right, bottom] = self.sides;
        let around = [
            [0, 0, width, top],
            [0, top, left, bottom],
            [right, top, width, bottom],
            [0, bottom, width, height],
        ];
        around.into_iter().filter(|[left, top, right, bottom]| left < right && top < bottom)
    }

    /// Returns the bytes of each colour's weights as the shader reads them from a map: of the
    /// factor, then of the addend, the lower one first.
    pub fn bytes(&self) -> [[f32; 4]; 3] {
        self.weights.map(|[factor, addend]| {
            let ([a, b], [c, d]) = (factor.to_le_bytes(), addend.to_le_bytes());
            [a, b, c, d].map(|byte| f32::from(byte) / 255.0)
        })
    }
}

/// Returns the weights of a square of texels by its column and row; `None` if they differ.
fn even_weights(
    map: &BlendMapDesc,
    [width, height]: [usize; 2],
    [column, row]: [usize; 2],
) -> Option<[[u16; 2]; 3]> {
    let layers = map.texels.len() / (width * height);
    let of_layer = |layer: usize| {
        let first = layer * width * height + row * SQUARE * width + column * SQUARE;
        let lines = (0..SQUARE).map(|line| &map.texels[first + line * width..][..SQUARE]);
        let weights = map.texels[first];
        lines.flatten().all(|texel| *texel == weights).then_some(weights)
    };
    let red = of_layer(0)?;
    if layers == 1 { Some([red; 3]) } else { Some([red, of_layer(1)?, of_layer(2)?]) }
}

/// Returns left, top, right and bottom of the largest rectangle of `true` in rows of this length:
/// under each row's last run of `true` in each column, rectangles as high as one of the columns.
fn largest_rectangle(is_in: &[bool], columns: usize) -> [usize; 4] {
    let mut best = [0; 4];
    let area = |[left, top, right, bottom]: [usize; 4]| (right - left) * (bottom - top);
    let mut heights = vec![0; columns];
    for (row, line) in is_in.chunks(columns.max(1)).enumerate() {
        for (height, is_in) in heights.iter_mut().zip(line) {
            *height = if *is_in { *height + 1 } else { 0 };
        }
        // Columns from which a rectangle of that height may go on, higher ones later.
        let mut open: Vec<(usize, usize)> = Vec::new();
        for (column, height) in heights.iter().copied().chain([0]).enumerate() {
            let mut left = column;
            while let Some((start, higher)) = open.pop_if(|(_, open)| *open >= height) {
                let candidate = [start, row + 1 - higher, column, row + 1];
                if area(candidate) > area(best) {
                    best = candidate;
                }
                left = start;
            }
            open.push((left, height));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_largest_rectangle_is_found(
            columns in 1_usize..8,
            is_in in prop::collection::vec(prop::bool::weighted(0.7), 0..56),
        ) {
            let is_in = &is_in[..is_in.len() / columns * columns];
            let rows = is_in.len() / columns;
            let area = |[left, top, right, bottom]: [usize; 4]| (right - left) * (bottom - top);
            let is_full = |[left, top, right, bottom]: [usize; 4]| {
                (top..bottom).all(|row| (left..right).all(|column| is_in[row * columns + column]))
            };
            let all = (0..columns).flat_map(|left| (0..rows).map(move |top| (left, top)));
            let all = all.flat_map(|(left, top)| {
                let ends = (left..=columns).flat_map(move |right| {
                    (top..=rows).map(move |bottom| [left, top, right, bottom])
                });
                ends.collect::<Vec<_>>()
            });
            let wanted = all.filter(|sides| is_full(*sides)).map(area).max().unwrap_or(0);
            let found = largest_rectangle(is_in, columns);
            prop_assert!(is_full(found), "{found:?}");
            prop_assert_eq!(area(found), wanted, "{:?}", found);
        }
    }
}
