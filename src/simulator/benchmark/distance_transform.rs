//! Exact distances to the nearest pixel of a set, by P. Felzenszwalb and D. Huttenlocher,
//! *Distance Transforms of Sampled Functions*, Theory of Computing 8 (2012), pp. 415-428.

/// The squared distance where the set is empty.
pub(super) const NONE: u32 = u32::MAX;

/// Returns, for each pixel of a picture, the squared Euclidean distance between its centre and the
/// centre of the nearest pixel of a set, in square pixels; [`NONE`] everywhere if the set is empty.
///
/// `is_inside` has a flag for each pixel, row by row, `width` pixels each. Sides are at most
/// 46,340 pixels, so that squares fit.
pub(super) fn squared_distances(is_inside: &[bool], width: usize) -> Vec<u32> {
    let mut squares = squared_column_distances(is_inside, width);
    let mut envelope = Envelope::default();
    for row in squares.chunks_exact_mut(width.max(1)) {
        envelope.transform(row);
    }
    squares
}

/// Returns the squared distances along columns only.
fn squared_column_distances(is_inside: &[bool], width: usize) -> Vec<u32> {
    let mut distances = vec![NONE; is_inside.len()];
    let mut sweep = |rows: &mut dyn Iterator<Item = usize>| {
        let mut last = vec![NONE; width];
        for row in rows {
            for (x, last) in last.iter_mut().enumerate() {
                let at = row * width + x;
                *last = if is_inside[at] { 0 } else { last.saturating_add(1) };
                distances[at] = distances[at].min(*last);
            }
        }
    };
    let height = is_inside.len().checked_div(width).unwrap_or(0);
    sweep(&mut (0..height));
    sweep(&mut (0..height).rev());
    distances.iter().map(|&d| if d == NONE { NONE } else { d * d }).collect()
}

/// The lower envelope of parabolas (x - vertex)² + height, one for each pixel of a row.
#[derive(Debug, Default)]
struct Envelope {
    /// Position and height of the vertices, from left to right.
    parabolas: Vec<(usize, u32)>,
    /// The position from which each parabola is the lowest.
    begins: Vec<f64>,
}

impl Envelope {
    /// Replaces each height of a row by that of the envelope of all.
    fn transform(&mut self, row: &mut [u32]) {
        self.parabolas.clear();
        self.begins.clear();
        for (x, &height) in row.iter().enumerate().filter(|(_, height)| **height != NONE) {
            self.push(x, height);
        }
        if self.parabolas.is_empty() {
            return;
        }
        let mut lowest = 0;
        for (x, value) in row.iter_mut().enumerate() {
            while self.begins.get(lowest + 1).is_some_and(|&begin| begin < x as f64) {
                lowest += 1;
            }
            let (vertex, height) = self.parabolas[lowest];
            *value = (x.abs_diff(vertex) as u32).pow(2) + height;
        }
    }

    fn push(&mut self, x: usize, height: u32) {
        let lifted = |x: usize, height: u32| (x * x) as f64 + f64::from(height);
        let mut begin = f64::NEG_INFINITY;
        while let (Some(&(vertex, low)), Some(&last)) = (self.parabolas.last(), self.begins.last())
        {
            begin = (lifted(x, height) - lifted(vertex, low)) / (2 * (x - vertex)) as f64;
            if begin > last {
                break;
            }
            // The new one is lower wherever the last one was the lowest.
            self.parabolas.pop();
            self.begins.pop();
            begin = f64::NEG_INFINITY;
        }
        self.parabolas.push((x, height));
        self.begins.push(begin);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_brute_force(is_inside: &[bool], width: usize) -> Vec<u32> {
        let place = |at: usize| [at % width, at / width];
        let squared = |a: usize, b: usize| {
            let ([ax, ay], [bx, by]) = (place(a), place(b));
            (ax.abs_diff(bx).pow(2) + ay.abs_diff(by).pow(2)) as u32
        };
        let members = || (0..is_inside.len()).filter(|&at| is_inside[at]);
        let nearest = |at| members().map(|member| squared(at, member)).min();
        (0..is_inside.len()).map(|at| nearest(at).unwrap_or(NONE)).collect()
    }

    #[test]
    fn distances_of_random_sets_are_those_found_by_brute_force() {
        let mut random = fastrand::Rng::with_seed(7);
        for round in 0..400 {
            let (width, height) = (random.usize(1..24), random.usize(1..24));
            // From almost empty to almost full.
            let chance = [0.01, 0.1, 0.5, 0.95][round % 4];
            let set: Vec<bool> = (0..width * height).map(|_| random.f64() < chance).collect();
            let expected = by_brute_force(&set, width);
            assert_eq!(squared_distances(&set, width), expected, "{width} × {height}: {set:?}");
        }
    }

    #[test]
    fn an_empty_set_is_at_no_distance() {
        assert_eq!(squared_distances(&[false; 12], 4), [NONE; 12]);
        assert_eq!(squared_distances(&[], 0), [0_u32; 0]);
    }
}
