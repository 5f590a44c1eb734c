//! Images: the callers' pixels, and all that is done to them before they are described.

pub mod blocking;
pub mod border;
pub mod conversion;
pub mod convolution;
pub mod gray_scale;
pub mod impulses;
pub mod intensity;
pub mod intensity_range;
pub mod masking;
pub mod pixels;
pub mod regions;
pub mod resampling;
pub mod smoothing;
pub mod texture;
pub mod view;
pub mod window_sums;

/// Largest side of a kernel that an image is convolved with.
pub const LARGEST_KERNEL: usize = 129;
