//! Matches two PNG files and writes their disparities as a 16-bit PNG, 256 steps per pixel, 0 where missing:
//! the format of KITTI.
//!
//! ```text
//! cargo run --release --package phasestereo --features image,image/png \
//!     --example match_files -- left.png right.png disparity.png
//! ```

use std::error::Error;

use image::{ImageBuffer, Luma};
use phasestereo::{Image, Matcher, Plane, Settings};

/// Steps of the file per pixel of disparity.
const STEPS: f32 = 256.0;

fn main() -> Result<(), Box<dyn Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let [left, right, target] = names.as_slice() else {
        return Err("give three files: left.png right.png disparity.png".into());
    };
    let read = |name: &str| -> Result<Image, Box<dyn Error>> {
        Ok(Image::try_from(image::open(name).map_err(|error| format!("{name}: {error}"))?)?)
    };

    // Everything unknown is estimated from the images.
    let matcher = Matcher::new(Settings::default(), None)?;
    let found = matcher.match_pair(read(left)?, read(right)?, None)?;
    for finding in &found.findings {
        println!("{}", finding.sentence);
    }

    let map = &found.disparity;
    let size = (u32::try_from(map.cols())?, u32::try_from(map.rows())?);
    let steps = map.as_slice().iter().map(|disparity| (disparity * STEPS).round() as u16);
    let file = ImageBuffer::<Luma<u16>, _>::from_raw(size.0, size.1, steps.collect::<Vec<_>>());
    file.ok_or("a map without pixels")?.save(target)?;

    let trusted = found.confidence.iter().flat_map(Plane::as_slice);
    let share = trusted.map(|odds| f64::from(*odds > 0.5)).sum::<f64>() / map.as_slice().len() as f64;
    println!("{target}: {:.0} % of the pixels have a confidence of more than .5", 100.0 * share);
    Ok(())
}
