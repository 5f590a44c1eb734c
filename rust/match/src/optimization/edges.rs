//! Jumps of the left image's gray values from one pixel to the next: disparities may jump there, too, so P2
//! is lower (adaptive P2; Hirschmüller, PAMI 2008, section 2.2).

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::choices::LARGE_JUMP;
use crate::image::texture::Texture;
use crate::pair::plan::{Bytes, Demand, Plan, Stage};
use crate::settings::Settings;

/// Rows that are classified together.
const ROWS: usize = 32;

/// Neighbors that precede a pixel in row-major order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Neighbor {
    /// Above.
    Above,
    /// To the left.
    Left,
}

impl Neighbor {
    /// The size of the jump from this neighbor: 0 none, 1 small, 2 large.
    #[inline(always)]
    pub fn jump(self, edges: u8) -> u8 {
        edges >> (2 * self as u8) & 3
    }
}

/// The jumps from both neighbors of every pixel, two bits each. Rows below the last one equal the last one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Edges(Plane<u8>);

/// The jumps of the left image's gray values, which already exist.
pub struct TextureAndEdges;

impl Stage for TextureAndEdges {
    fn reach(&self, _: Plan) -> usize {
        // Gray values are compared with those of the row above.
        1
    }

    fn bytes(&self, demand: &Demand) -> Bytes {
        Bytes { read: size_of::<u8>() * demand.cols, ..Bytes::default() }
    }
}

impl Edges {
    /// A jump is small if it exceeds the mean difference of horizontal neighbors times `threshold`, in whole
    /// steps, and large if it exceeds [`LARGE_JUMP`] times that. The mean makes it independent of contrast
    /// and unit.
    pub fn new(texture: &Texture, threshold: f64, level: Level, control: &Control) -> Result<Self> {
        let gray = &texture.gray;
        let (rows, cols) = (gray.rows(), gray.cols());
        // The cast saturates above any difference of gray values.
        let small = (threshold * texture.roughness.mean()) as u32;

        let classes = Plane::by_bands((rows, cols), ROWS, |first, band| {
            control.checkpoint()?;
            for (y, edges) in (first..).zip(band.chunks_mut(cols)) {
                // The first row is its own neighbor above: no jump.
                let above = gray.row(y.saturating_sub(1));
                classify(level, gray.row(y), above, small, edges);
            }

            Ok(())
        })?;

        Ok(Self(classes))
    }

    /// The jumps in an image if the settings lower P2 there; else rows of `cols` columns without jumps.
    pub fn asked_for(
        texture: Option<&Texture>,
        settings: &Settings,
        cols: usize,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        match texture {
            Some(texture) if settings.adaptive_p2 > 0.0 => {
                Self::new(texture, settings.adaptive_p2, level, control)
            }
            _ => Self::nowhere(cols),
        }
    }

    /// Rows of `cols` columns without jumps.
    pub fn nowhere(cols: usize) -> Result<Self> {
        Ok(Self(Plane::new(1, cols)?))
    }

    /// The jumps of row `y`.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[u8] {
        self.0.row(y.min(self.0.rows() - 1))
    }
}

/// Classifies the jumps of a row.
#[leveled]
fn classify(level: Level, here: &[i32], above: &[i32], small: u32, edges: &mut [u8]) {
    let last = here.len() - 1;
    edges.fill(0);

    mark(edges, here, above, small, Neighbor::Above);
    mark(&mut edges[1..], &here[1..], &here[..last], small, Neighbor::Left);
}

/// Writes the class of the difference from one neighbor into the bits of that neighbor.
#[inline(always)]
fn mark(edges: &mut [u8], here: &[i32], there: &[i32], small: u32, neighbor: Neighbor) {
    let large = small.saturating_mul(LARGE_JUMP);

    for ((edges, a), b) in edges.iter_mut().zip(here).zip(there) {
        let difference = a.abs_diff(*b);
        let jump = u8::from(difference > small) + u8::from(difference > large);

        *edges |= jump << (2 * neighbor as u8);
    }
}
