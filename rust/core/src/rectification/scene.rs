//! Rendered pairs for tests: a slanted, bumpy surface with texture of all sizes, seen by two cameras.

use super::cameras::Cameras;
use phasestereo_match::base::plane::Plane;

/// Texture at a place: noise on grids of several steps, interpolated.
pub fn texture(x: f64, y: f64, seed: u64) -> f32 {
    let grids = [(3.0, 30.0), (7.0, 40.0), (19.0, 50.0)];
    let value = |(step, height): (f64, f64)| height * noise(x / step, y / step, seed);
    grids.into_iter().map(value).sum::<f64>() as f32
}

fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (column, row) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let [along, down] = [ease(x - column), ease(y - row)];
    let at = |dx: f64, dy: f64| {
        let place = ((column + dx) as i64 as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            ^ ((row + dy) as i64 as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
            ^ seed;
        let mixed = (place ^ (place >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((mixed ^ (mixed >> 32)) % 4096) as f64 / 4096.0
    };
    let above = at(0.0, 0.0) * (1.0 - along) + at(1.0, 0.0) * along;
    let below = at(0.0, 1.0) * (1.0 - along) + at(1.0, 1.0) * along;
    above * (1.0 - down) + below * down
}

/// The disparity of the surface at a place of the rectified left image, which has `cols` columns.
pub fn disparity(x: f64, y: f64, cols: usize) -> f64 {
    let cols = cols as f64;
    0.03 * cols + 0.02 * y + 0.01 * cols * phasestereo_match::base::math::sin(6.0 * x / cols)
}

/// The raw left and right images that cameras take of the surface.
pub fn pair(cameras: &Cameras, (rows, cols): (usize, usize), seed: u64) -> [Plane<f32>; 2] {
    let left = Plane::from_fn(rows, cols, |y, x| {
        let [u, v] = cameras.rectified([x as f64, y as f64], 0);
        texture(u, v, seed)
    });
    let right = Plane::from_fn(rows, cols, |y, x| {
        let [u, v] = cameras.rectified([x as f64, y as f64], 1);
        // The left column whose disparity leads here.
        let left = (0..20).fold(u, |left, _| u + disparity(left, v, cols));
        texture(left, v, seed)
    });
    [left, right]
}
