//! From a pair to its disparity map: bands of rows on threads, what a part of a pair must know of the whole, memory.

pub mod control;
pub mod fitting;
pub mod footprint;
pub mod halo;
pub mod map;
pub mod matcher;
pub mod memory;
pub mod pair;
pub mod platform;
pub mod runtime;
pub mod section;
pub mod source;
pub mod summary;
pub mod temporal;
