//! What the pair lacks (blur, rows, range, noise): how it is estimated, and how it is compensated for.

pub mod alignment;
pub mod blur;
pub mod blur_compensation;
pub mod estimation;
pub mod photometry;
pub mod psf;
pub mod rectification;
pub mod state;
