//! Dense stereo matching on quantised local phase.
//!
//! The story of one disparity map, each step a module, in the order in which the data flows:
//!
//! 1. Two rectified images of any type ([`view`]) become integer planes ([`intensity`]); masked pixels take
//!    the values of their neighbours ([`masking`]). Blur can be added to them ([`convolution`]), to each part of
//!    an image another one ([`versions`]).
//! 2. Around every pixel a local Fourier transform ([`basis`], [`spectrum`]) is taken, of which only the
//!    phase is kept, coarsely ([`quantiser`]): symmetric blur and contrast leave it alone. The levels are
//!    packed into one word per pixel ([`descriptor`]).
//! 3. A pixel and a candidate ([`candidates`]) in the other image cost as many bits as differ ([`cost`]);
//!    or, for comparison, what their intensities or local contrasts ([`normalisation`]) differ by.
//! 4. Costs are summed over a window, of which the best of five positions counts ([`aggregation`]).
//! 5. The sum of the totals of a few paths chooses a candidate for every pixel, or dynamic programming along the row
//!    does ([`optimization`]); paths jump more easily at edges of the image ([`edges`]).
//! 6. What was chosen becomes a disparity with its flags ([`refinement`]), between candidates where their costs
//!    tell ([`subpixel`]).
//! 7. Of a whole map, pixels that cannot be right are told: those whose match belongs to another pixel
//!    ([`consistency`]) and small regions that stand out ([`speckles`]). They are filled from the pixels beside
//!    them ([`filling`]), edges in depth are drawn to those of the image ([`guided`]), what is still alone
//!    gives way to its neighbours ([`median`]). Where one image is blurred it is made again by the map, by which jumps are
//!    put right ([`synthesis`], [`outlines`]). Every disparity is given a confidence ([`confidence`]).
//!
//! Before all that, [`estimation`] may find out what nobody told: which disparities there are, and how the rows of the
//! images lie to one another, by which the right one is straightened ([`alignment`]). [`blur`] finds out from spectra which image is the softer one, where, and by which
//! point-spread function ([`psf`]), so that the other one can be given the same; and whether there are impulses, which are
//! repaired ([`impulses`]), how much noise, and what compression has left of its blocks ([`blocking`]), both of which
//! are smoothed away ([`smoothing`]).
//!
//! From 3 on, everything is worked out on panels of columns in bands of rows, the candidates of a pixel in neighboring
//! lanes, in integers as narrow as the settings allow ([`value`]), in memory that is used again ([`memory`]), by loops
//! that are compiled for every instruction set ([`simd`]).
//!
//! [`matcher`] runs these bands on threads, under the eyes of [`control`], and writes a [`map`]. All arithmetic is that of integers
//! (the descriptor's may be carried out in floats that hold them exactly): the result is the same to the bit
//! for any number of threads, any part of a pair and any instructions, and equal to that of
//! [`reference`](mod@reference), which does the same in the most obvious way.
//!
//! So a [`section`] of a pair that is larger than memory comes out as it does in the whole, given as many rows around it
//! as it depends on ([`reach`]), in memory that is known before ([`footprint`]). What is the same for all sections is
//! found out before from the [`source`] of the pair: rows, range and blur, the range of floats, and how rough the
//! [`texture`] of the left image is. What a map says of itself as a whole is its [`summary`].
//!
//! M. Pedone, J. Heikkilä: *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008.

pub mod error;
pub mod memory;
pub mod plane;
pub mod value;

pub mod candidates;
pub mod presets;
pub mod settings;

pub mod blocking;
pub mod convolution;
pub mod impulses;
pub mod intensity;
pub mod masking;
pub mod normalisation;
pub mod smoothing;
pub mod texture;
pub mod versions;
pub mod view;

pub mod basis;
pub mod descriptor;
pub mod quantiser;
pub mod spectrum;

pub mod aggregation;
pub mod confidence;
pub mod cost;
pub mod edges;
pub mod evidence;
pub mod optimization;
pub mod refinement;
pub mod subpixel;
pub mod votes;

pub mod consistency;
pub mod filling;
pub mod guided;
pub mod jumps;
pub mod median;
pub mod outlines;
pub mod speckles;
pub mod synthesis;

pub mod alignment;
pub mod blur;
pub mod estimation;
pub mod psf;

pub mod control;
pub mod map;
pub mod matcher;
pub mod platform;
pub mod simd;

pub mod footprint;
pub mod reach;
pub mod section;
pub mod source;
pub mod summary;

pub mod reference;

#[cfg(feature = "c")]
mod c;
#[cfg(feature = "python")]
mod python;
