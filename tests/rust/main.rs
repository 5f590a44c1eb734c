//! The tests of the core, in one binary: as twenty of them they took four times as long to compile.

mod aggregation;
mod bands;
mod blocking;
mod blur;
mod common;
mod confidence;
mod consistency;
mod convolution;
mod cost;
mod descriptor;
mod estimation;
mod filling;
mod guided;
mod impulses;
mod intensity;
mod masking;
mod matcher;
mod median;
mod normalisation;
mod optimization;
mod outlines;
mod smoothing;
mod source;
mod speckles;
mod subpixel;
mod synthesis;
