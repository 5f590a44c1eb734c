//! Pairs generated here from integers: a wall, a floor and a box in front of them, and faults that a rig may
//! have.

use ndarray::Array3;

use phasestereo_match::base::plane::{Plane, reflect};
use phasestereo_match::image::pixels::{Image, Input};

/// Disparity of the wall, pixels.
pub const FAR: i32 = 5;
/// Disparity of the box, pixels.
pub const NEAR: i32 = 11;

/// Number of the box among the surfaces.
const BOX: u32 = 3;

/// The faults of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    None,
    /// The left image is out of focus.
    Defocus,
    /// The left lens is focused far, the right one near.
    FocusApart,
    /// The right camera moves sideways.
    Motion,
    /// Both sensors are noisy.
    Noise,
    /// Some pixels of the right sensor are broken.
    Impulses,
    /// The right image is in blocks, like after compression.
    Blocks,
    /// The right image has rows that are too bright or too dark, in a random order.
    Stripes,
    /// The right image is 1 row lower at its left end, 3 rows at its right one.
    Rows,
    /// The right camera is turned about its axis.
    Turned,
    /// The right lens has a longer focal length.
    Zoomed,
    /// Lenses distort, and the right camera looks down.
    Distorted,
    /// Odd rows of the right image are taken later.
    Interlaced,
    /// Pixels of both images are behind filters of different colors.
    Mosaic,
    /// Each image contains a fifth of the other one; texture is coarse.
    Crosstalk,
    /// The right image is darker toward its corners, and has 16 bits.
    Vignetting,
    /// Colors, as floats, the right ones half as large.
    Floats,
    /// The right image is a negative.
    Inverted,
    /// Left is right.
    Swapped,
    /// The right sensor has half the pixels a side.
    Smaller,
    /// Wall and floor have no texture.
    Plain,
    /// The upper left part of the left image is masked.
    Masked,
    /// Both images are black outside an ellipse, as behind a round lens.
    Bordered,
    /// A thin pole is much nearer than all else.
    Pole,
    /// All surfaces have the texture of a fence.
    Fence,
    /// Both images are the left one.
    Twice,
    /// The box is nearer by this disparity, pixels.
    Nearer(i32),
    /// There is hardly any light, and much noise.
    Night,
}

type GrayLevels = Plane<i32>;

/// The scene in this many rows and columns, taken by a rig with a fault. Another `moment` has other noise.
pub fn pair(fault: Fault, size: (usize, usize), moment: u32) -> [Input; 2] {
    let (rows, cols) = (size.0 as i32, size.1 as i32);
    let [left, right] = [0, 1].map(|side| gray(size, |y, x| shown((y, x), side, size, fault)));

    let grain = |seed| move |y, x, value| value + (noise(y, x, seed + 2 * moment) - 128) / 12;
    let dark = |seed| move |y, x, value| value / 32 + noise(y, x, seed + 2 * moment) / 6;
    let [left, right] = match fault {
        Fault::Defocus => [mean(&mean(&left, 5, 5), 3, 3), right],
        Fault::FocusApart => {
            let near = |y, x| surface((y, x), 0, size, fault).1 > FAR;
            let [softer, other] = [&left, &right].map(|image| mean(&mean(image, 5, 5), 3, 3));
            let left = changed(&left, |y, x, sharp| if near(y, x) { at(&softer, y, x) } else { sharp });
            let right = changed(&right, |y, x, sharp| if near(y, x) { sharp } else { at(&other, y, x) });
            [left, right]
        }
        Fault::Motion => [left, mean(&right, 1, 9)],
        Fault::Noise => [changed(&left, grain(21)), changed(&right, grain(22))],
        Fault::Night => [changed(&left, dark(21)), changed(&right, dark(22))],
        Fault::Impulses => {
            let broken = |y, x, value| if noise(y, x, 23) < 2 { 255 * (x % 2) } else { value };
            [left, changed(&right, broken)]
        }
        Fault::Blocks => {
            let coarse = mean(&right, 7, 7);
            let coded = |y: i32, x: i32, value| {
                let block = at(&coarse, y / 8 * 8 + 4, x / 8 * 8 + 4);
                block + (value - block) / 24 * 24
            };
            [left, changed(&right, coded)]
        }
        Fault::Stripes => [left, changed(&right, |y, _, value| value + noise(y, 0, 24) / 12)],
        Fault::Rows => [left, moved(&right, |y, x| (y + 1 + 2 * x / cols, x))],
        Fault::Turned => [left, moved(&right, |y, x| (y + (x - cols / 2) / 30, x - (y - rows / 2) / 30))],
        Fault::Zoomed => {
            let zoom = |place: i32, length: i32| length / 2 + (place - length / 2) * 32 / 33;
            [left, moved(&right, |y, x| (zoom(y, rows), zoom(x, cols)))]
        }
        Fault::Distorted => {
            let bent = |sign: i32, down: i32| {
                move |y: i32, x: i32| {
                    let (y, x) = (y - rows / 2, x - cols / 2);
                    let share = sign * 1000 * (y * y + x * x) / (rows * rows + cols * cols);
                    let scaled = |place: i32| place + place * share / 2500;
                    (rows / 2 + scaled(y) + down, cols / 2 + scaled(x))
                }
            };
            [moved(&left, bent(1, 0)), moved(&right, bent(-1, 6))]
        }
        Fault::Interlaced => [left, moved(&right, |y, x| (y, x + 3 * (y % 2)))],
        Fault::Mosaic => {
            let filter =
                |y: i32, x: i32, value: i32| value * [4, 7, 7, 5][(2 * (y % 2) + x % 2) as usize] / 8;
            [changed(&left, filter), changed(&right, filter)]
        }
        Fault::Crosstalk => {
            let [left, right] = [&left, &right].map(|image| mean(image, 3, 3));
            let mixed = |other| move |y, x, value| (4 * value + at(other, y, x)) / 5;
            [changed(&left, mixed(&right)), changed(&right, mixed(&left))]
        }
        Fault::Vignetting => {
            let darker = |y: i32, x: i32, value: i32| {
                let from = |place: i32, length: i32| (2 * place - length).pow(2) * 100 / length.pow(2);
                value * (300 - from(y, rows) - from(x, cols)) / 400
            };
            [left, changed(&right, darker)]
        }
        Fault::Bordered => {
            let off = |place: i32, length: i32| (2 * place - length).pow(2) * 1000 / length.pow(2);
            let framed = |y, x, value: i32| {
                if off(y, rows) + off(x, cols) < 900 { value.max(1) } else { 0 }
            };
            [changed(&left, framed), changed(&right, framed)]
        }
        Fault::Inverted => [left, changed(&right, |_, _, value| 255 - value)],
        Fault::Swapped => [right, left],
        Fault::Twice => [left.clone(), left],
        Fault::Smaller => {
            let half = gray((size.0 / 2, size.1 / 2), |y, x| {
                let sum = |row| at(&right, row, 2 * x) + at(&right, row, 2 * x + 1);
                (sum(2 * y) + sum(2 * y + 1)) / 4
            });
            [left, half]
        }
        _ => [left, right],
    };

    match fault {
        Fault::Vignetting => [words(&left), words(&right)],
        Fault::Floats => [floats(&left, 256.0), floats(&right, 512.0)],
        Fault::Masked => {
            let is_valid = |y, x| y > size.0 / 4 || x > size.1 / 4;
            let mask = Some(Plane::from_fn(size.0, size.1, is_valid));
            [Input { mask, ..bytes(&left) }, bytes(&right)]
        }
        _ => [bytes(&left), bytes(&right)],
    }
}

/// A disparity map of the scene that is wrong, nearly right, nowhere, or outside the right image in some
/// areas.
pub fn claims(fault: Fault, (rows, cols): (usize, usize)) -> Plane<f32> {
    Plane::from_fn(rows, cols, |y, x| {
        let right = surface((y as i32, x as i32), 0, (rows, cols), fault).1 as f32;
        match (10 * y / rows, 10 * x / cols) {
            (1, 2..=3) => right + 4.0,
            (1, 5..=8) => right + 0.5 + x as f32 / cols as f32,
            (5, 5) => right - 3.0,
            (6, 1..=3) => right + (y % 5) as f32,
            (8, 2..=3) => f32::NAN,
            (8, 6) => 1e6,
            _ => right,
        }
    })
}

/// The surface seen at a place of the left (0) or right (1) image, and its disparity.
fn surface((y, x): (i32, i32), camera: i32, (rows, cols): (usize, usize), fault: Fault) -> (u32, i32) {
    let (rows, cols) = (rows as i32, cols as i32);
    let is_of_pole = fault == Fault::Pole
        && (rows / 10..rows * 9 / 10).contains(&y)
        && (cols / 4..cols / 4 + 5).contains(&(x + camera * 4 * NEAR));
    let near = if let Fault::Nearer(by) = fault { NEAR + by } else { NEAR };
    let is_of_box = (rows * 3 / 10..rows * 7 / 10).contains(&y)
        && (cols * 4 / 10..cols * 7 / 10).contains(&(x + camera * near));
    let into_floor = y - rows * 8 / 10;

    if is_of_pole {
        (4, 4 * NEAR)
    } else if is_of_box {
        (BOX, near)
    } else if into_floor > 0 {
        (2, FAR + into_floor / 4)
    } else {
        (1, FAR)
    }
}

/// The gray value at a place.
fn shown(place: (i32, i32), camera: i32, size: (usize, usize), fault: Fault) -> i32 {
    let (seed, disparity) = surface(place, camera, size, fault);
    let (y, x) = (place.0, place.1 + camera * disparity);
    match fault {
        Fault::Plain if seed != BOX => 60 * seed as i32,
        Fault::Fence => texture(y / 8, x % 18, seed),
        _ => texture(y, x, seed),
    }
}

/// Gray values: coarse and fine noise, interpolated linearly.
fn texture(y: i32, x: i32, seed: u32) -> i32 {
    let grid = |step: i32, seed: u32| {
        let (below, beside) = (y % step, x % step);
        let corner = |dy, dx| noise(y / step + dy, x / step + dx, seed);
        let row = |dy| corner(dy, 0) * (step - beside) + corner(dy, 1) * beside;
        (row(0) * (step - below) + row(1) * below) / (step * step)
    };
    (5 * grid(9, seed) + 3 * grid(3, seed + 10)) / 8
}

/// A byte that is a hash of a place.
fn noise(y: i32, x: i32, seed: u32) -> i32 {
    let [y, x] = [y, x].map(|place| place as u32);
    let place = y.wrapping_mul(73_856_093) ^ x.wrapping_mul(19_349_663);
    let mix = |state: u32, _| (state ^ (state >> 15)).wrapping_mul(0x2C1B_3C6D);
    ((0..2).fold(place ^ seed.wrapping_mul(83_492_791), mix) >> 24) as i32
}

fn gray((rows, cols): (usize, usize), value: impl Fn(i32, i32) -> i32) -> GrayLevels {
    Plane::from_fn(rows, cols, |y, x| value(y as i32, x as i32))
}

/// The value at a place, reflected at the border.
fn at(image: &GrayLevels, y: i32, x: i32) -> i32 {
    image.row(reflect(y as isize, image.rows()))[reflect(x as isize, image.cols())]
}

/// The image with other values.
fn changed(image: &GrayLevels, value: impl Fn(i32, i32, i32) -> i32) -> GrayLevels {
    gray(image.size(), |y, x| value(y, x, at(image, y, x)))
}

/// The image whose pixels are elsewhere.
fn moved(image: &GrayLevels, place: impl Fn(i32, i32) -> (i32, i32)) -> GrayLevels {
    changed(image, |y, x, _| {
        let (y, x) = place(y, x);
        at(image, y, x)
    })
}

/// Means of this many rows and columns, odd numbers.
fn mean(image: &GrayLevels, rows: i32, cols: i32) -> GrayLevels {
    let (above, before) = (rows / 2, cols / 2);
    changed(image, |y, x, _| {
        let row = |y| (x - before..=x + before).map(|x| at(image, y, x)).sum::<i32>();
        (y - above..=y + above).map(row).sum::<i32>() / (rows * cols)
    })
}

fn bytes(image: &GrayLevels) -> Input {
    let pixels = image.as_slice().iter().map(|&value| value.clamp(0, 255) as u8);
    Image::U8(shaped(image, 1, pixels.collect())).into()
}

fn words(image: &GrayLevels) -> Input {
    let pixels = image.as_slice().iter().map(|&value| value.clamp(0, 255) as u16 * 200);
    Image::U16(shaped(image, 1, pixels.collect())).into()
}

fn floats(image: &GrayLevels, white: f32) -> Input {
    let colors = |&value: &i32| [value, value / 2, 255 - value].map(|part| part as f32 / white);
    Image::F32(shaped(image, 3, image.as_slice().iter().flat_map(colors).collect())).into()
}

fn shaped<T>(image: &GrayLevels, channels: usize, pixels: Vec<T>) -> Array3<T> {
    let shape = (image.rows(), image.cols(), channels);
    Array3::from_shape_vec(shape, pixels).expect("as many values as pixels")
}
