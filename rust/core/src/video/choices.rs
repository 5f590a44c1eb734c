//! The constants of videos that are not derived: each with its unit, its meaning, and the measurement that
//! chose it. Those without a measurement were set by hand.

// Frames (`frames`)

/// Share of the pixels: if the wrong share of a map exceeds that of earlier ones by this, the cameras may
/// have been moved.
pub const WORSE: f64 = 0.15;
/// Frames: the longest wait before everything is estimated again, if it did not help the last time.
pub const LONGEST_WAIT: u64 = 64;
/// Most times that a frame is matched again.
pub const MOST_MATCHES: usize = 2;
/// Least share of the pixels at the near end of the range for which a frame is matched again with a larger
/// range.
pub const NEAR_END: f64 = 0.005;

// State (`rig`)

/// Least pixels rms for which rows are straightened, and in standard errors.
pub const STRAIGHTEN_FROM: f64 = 0.2;
/// See [`STRAIGHTEN_FROM`].
pub const STRAIGHTEN_ERRORS: f64 = 4.0;
/// Pixels rms below which rows are not straightened any more.
pub const STRAIGHT_BELOW: f64 = 0.08;
/// Consecutive frames that change a state: which image is softer, whether much is wrong, and whether rows are
/// straightened.
pub const CHANGED_FRAMES: u32 = 3;
/// Consecutive frames with straight rows until straightening stops.
pub const STRAIGHT_FRAMES: u32 = 20;
/// Consecutive frames without swaying rows until the field is followed again.
pub const CALM_FRAMES: u32 = 20;
/// Share of the pixels above which much is wrong,
pub const ILL_FROM: f64 = 0.4;
/// ... until the share falls below this.
pub const WELL_BELOW: f64 = 0.25;
/// Frames over which the health is averaged.
pub const HEALTH_FRAMES: f64 = 8.0;
/// Most events that are kept: the newest.
pub const MOST_EVENTS: usize = 256;
/// Frames within which two changes of one subject count as one event.
pub const SAME_EVENT_FRAMES: u64 = 30;
/// Frames after which the drift of rows is known.
pub const DRIFT_FRAMES: u64 = 20;

// Range (`rig::columns`)

/// Every this many pixels along each axis, one is counted.
pub const COUNTED_STEP: usize = 4;
/// Frames over which the histogram fades.
pub const FADING_FRAMES: i64 = 32;
/// Consecutive frames that need less before the range shrinks.
pub const IDLE_FRAMES: u32 = 90;
/// Least millionths of the pixels for a disparity to exist in a frame,
pub const FEW_NOW: i64 = 4000;
/// ... and in the histogram.
pub const FEW_FADED: i64 = 2000;
/// Least number of disparities beyond the largest one.
pub const LEAST_RESERVE: i64 = 6;
/// Disparities of the range per disparity of the reserve.
pub const RESERVE_DIVISOR: i64 = 12;
/// Disparities beyond the reserve that are cut off after they were not needed for long.
pub const SPARE: i64 = 16;

// Changes (`rig::changes`). With these, 43 of 44 things that entered were found in their own frame, and
// nothing was found in 29 streams that nothing entered; not swept.

/// Least change of the mean of a square, gray levels, where something enters, ...
pub const LEAST_CHANGE: f64 = 0.5;
/// ... and in median changes of the squares.
pub const CHANGE_MEDIANS: f64 = 6.0;
/// Gray levels: the least median change while the cameras are moving or the light is changing.
pub const MOVING_FROM: f64 = 1.0;

// Late cameras (`rig::stopped`). With these, delays of 1 and 2 frames are found within two frames of motion,
// and none in 21 synchronous streams; not swept.

/// Pixels from frame to frame that are tried.
pub const MOTION_REACH: usize = 32;
/// Most frames whose motion is kept.
pub const MOTION_FRAMES: usize = 12;
/// Most frames by which a camera is late.
pub const LATEST: isize = 3;
/// Least difference of the motions of both cameras, square pixels, if one is late, ...
pub const LEAST_APART: f64 = 1.0;
/// ... and its least ratio to the difference with the delay, ...
pub const APART: f64 = 9.0;
/// ... to which this is added per frame.
pub const MOTION_REST: f64 = 0.02;

// Field of rows (`rig::field`)

/// Columns of cells of an image; each cell is searched for a block.
pub const CELL_COLUMNS: usize = 14;
/// Rows of cells.
pub const CELL_ROWS: usize = 9;
/// Frames that take turns with the rows of cells.
pub const ROW_TURNS: usize = 3;
/// Places of a cell along each axis, used one after another over the frames.
pub const CELL_PLACES: usize = 16;
/// Fewest blocks that make an observation.
pub const LEAST_BLOCKS: usize = 12;
/// Pixels at the border without blocks.
pub const SEED_BORDER: usize = 20;
/// Pixels: standard deviations of the coefficients before any observation, of a plane and of the terms that
/// bend it.
pub const UNKNOWN_DEVIATIONS: [f64; 2] = [1.0, 0.05];
/// Shares of the width by which these change from frame to frame.
pub const FIELD_CHANGES: [f64; 2] = [6e-6, 4e-7];
/// Factor on the variance of the mean of neighboring blocks, whose errors are correlated.
pub const ALIKE: f64 = 2.0;
/// Share of a correction that counts as drift,
pub const FOLLOWED: f64 = 0.06;
/// ... and share of the drift that remains from frame to frame.
pub const DAMPED: f64 = 0.995;
/// Share of the standard error: a frame that reduces it further is finding the field, so its correction is
/// not a drift.
pub const FOUND_SHARE: f64 = 0.8;
/// Largest weight of a block, in median weights.
pub const MOST_WEIGHT: f64 = 2.0;
/// Spreads beyond which a residual is a mistake.
pub const CUT_SPREADS: f64 = 3.0;
/// Least change of rows, pixels rms, when the cameras have been moved, and in standard errors.
pub const MOVED_FROM: f64 = 0.2;
/// See [`MOVED_FROM`].
pub const MOVED_ERRORS: f64 = 6.0;

// Temporal filter (`temporal`)

/// Most frames that a disparity averages. Twice this does not steady a static scene more, and lags twice as
/// long; half steadies it less (`phasestereo bench video`).
pub const MEAN_FRAMES: u8 = 8;
/// Pixels: side of the blocks whose disparities may move together.
pub const MOVED_BLOCK: usize = 32;
/// Every this many pixels along each axis of a block, one is compared.
pub const MOVED_STEP: usize = 4;
/// Least pixels that a disparity moves; a block has moved if more than two thirds of its disparities have,
pub const MOVED_BY: f32 = 0.25;
/// ... and the most that is not a mistake.
pub const MOST_MOVED_BY: f32 = 2.0;
/// Fewest known disparities of a block that may have moved.
pub const LEAST_MOVED: u32 = 16;
/// Most pixels by which disparities of one thing differ: the step of integer maps. With less, these flicker
/// more; with more, different things are averaged.
pub const SAME_THING: f32 = 1.0;

// Changes of a view (`temporal::change`)

/// Multiple of the expected square that still counts as no change. A larger one ignores more of the noise,
/// but also more of slow motion. A smaller one lets a static scene flicker (`phasestereo bench video --preset
/// fast --noise 8`).
pub const CHANGE_RATIO: f32 = 3.0;
/// Largest square of one pixel, in units of the noise, so that no float overflows.
pub const LARGEST_SQUARE: f32 = 16384.0;
/// Gray levels: least standard deviation of the noise. Rounding to bytes has 0.29.
pub const LEAST_NOISE: f32 = 0.25;
/// Gray levels: largest standard deviation of the noise. Larger estimates count as texture.
pub const MOST_NOISE: f32 = 10.0;
/// Rows and columns from one place to the next. With 1, the filter follows moving edges better, for half as
/// much time again and more than twice the memory.
pub const CHANGE_STEP: usize = 2;
/// Pixels: side of the blocks in which the noise is estimated.
pub const NOISE_BLOCK: usize = 8;
/// Sufficient number of blocks: in larger images, rows of blocks are skipped.
pub const NOISE_BLOCKS: usize = 256;
/// One of this many blocks counts as quiet, with little but noise.
pub const QUIET_DIVISOR: usize = 20;
/// Ratio of the noise to the mean square of the quiet blocks: less than for noise alone, since most blocks
/// have texture.
pub const NOISE_FACTOR: f32 = 1.25;
/// Least gray level of a pixel that is practically white.
pub const WHITE_FROM: f32 = 250.0;
/// Gray levels below which quotients are unreliable.
pub const DARK_BELOW: f32 = 24.0;
/// Every this many places along each axis, one determines how the exposure changed.
pub const GAIN_STEP: usize = 4;
/// Fewest places that determine it.
pub const LEAST_GAIN_PLACES: usize = 64;
/// Distance of a gain from one below which it is noise.
pub const EVEN_GAIN: f32 = 0.01;
/// Largest difference of the quartiles of the quotients, as a share of their median.
pub const AGREEING_GAINS: f32 = 0.15;
