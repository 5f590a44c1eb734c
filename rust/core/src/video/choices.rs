//! The constants of videos that are not derived: each with its unit, its meaning, and the measurement that
//! chose it. Those without a measurement were set by hand.

// Frames (`frames`)

/// Share of the pixels: a map of which this much more is wrong than of those before may be of cameras that
/// were moved.
pub const WORSE: f64 = 0.15;
/// Frames: the longest wait before all is estimated anew again, where that did not help.
pub const LONGEST_WAIT: u64 = 64;
/// How often a frame is matched again at most.
pub const MOST_MATCHES: usize = 2;
/// Share of the pixels at the near end of the range from which on a frame is matched again with a larger
/// range.
pub const NEAR_END: f64 = 0.005;

// State (`rig`)

/// Pixels rms from which on rows are straightened, and in standard errors.
pub const STRAIGHTEN_FROM: f64 = 0.2;
/// See [`STRAIGHTEN_FROM`].
pub const STRAIGHTEN_ERRORS: f64 = 4.0;
/// Pixels rms below which rows are not straightened any more.
pub const STRAIGHT_BELOW: f64 = 0.08;
/// Frames in a row that change a state: which image is softer, whether much is wrong, and whether rows are
/// straightened.
pub const CHANGED_FRAMES: u32 = 3;
/// Frames in a row with straight rows until these are not straightened any more.
pub const STRAIGHT_FRAMES: u32 = 20;
/// Frames in a row whose rows do not sway until the field is followed again.
pub const CALM_FRAMES: u32 = 20;
/// Share of the pixels: from this on much is wrong,
pub const ILL_FROM: f64 = 0.4;
/// ... until less than this is.
pub const WELL_BELOW: f64 = 0.25;
/// Frames over which the health is averaged.
pub const HEALTH_FRAMES: f64 = 8.0;
/// Most events that are kept: the newest.
pub const MOST_EVENTS: usize = 256;
/// Frames within which two changes of one subject are one event.
pub const SAME_EVENT_FRAMES: u64 = 30;
/// Frames after which the drift of rows is known.
pub const DRIFT_FRAMES: u64 = 20;

// Range (`rig::columns`)

/// Pixels along each axis of which one is counted.
pub const COUNTED_STEP: usize = 4;
/// Frames over which the histogram fades.
pub const FADING_FRAMES: i64 = 32;
/// Frames in a row that need less before the range shrinks.
pub const IDLE_FRAMES: u32 = 90;
/// Millionths of the pixels from which on a disparity exists in a frame,
pub const FEW_NOW: i64 = 4000;
/// ... and in the histogram.
pub const FEW_FADED: i64 = 2000;
/// Disparities beyond the largest one: the least number. A lane of the match has 16 disparities.
pub const LEAST_RESERVE: i64 = 6;
/// Disparities of the range for each one of the reserve.
pub const RESERVE_DIVISOR: i64 = 12;
/// Disparities beyond the reserve that are cut off, if they were not needed for long.
pub const SPARE: i64 = 16;

// Changes (`rig::changes`). With these, 43 of 44 things that entered were found in their own frame, and
// nothing in 29 streams into which nothing came; not swept.

/// Gray levels by which the mean of a square changes at least where something enters, ...
pub const LEAST_CHANGE: f64 = 0.5;
/// ... and in median changes of the squares.
pub const CHANGE_MEDIANS: f64 = 6.0;
/// Gray levels: the median change from which on the cameras move, or the light changes.
pub const MOVING_FROM: f64 = 1.0;

// Late cameras (`rig::stopped`). With these, delays of 1 and 2 frames are found within two frames of motion,
// and none in 21 streams that are in time; not swept.

/// Pixels from frame to frame that are tried.
pub const MOTION_REACH: usize = 32;
/// Most frames whose motion is kept.
pub const MOTION_FRAMES: usize = 12;
/// Most frames by which a camera is late.
pub const LATEST: isize = 3;
/// Square pixels by which the motions of both cameras differ at least where one is late, ...
pub const LEAST_APART: f64 = 1.0;
/// ... and how many times more than those with the delay, ...
pub const APART: f64 = 9.0;
/// ... for which this is added of each frame.
pub const MOTION_REST: f64 = 0.02;

// Field of rows (`rig::field`)

/// Columns of cells of an image, in each of which a block is looked for.
pub const CELL_COLUMNS: usize = 14;
/// Rows of cells.
pub const CELL_ROWS: usize = 9;
/// Frames that take the rows of cells in turns.
pub const ROW_TURNS: usize = 3;
/// Places of a cell along each axis, one after another in the frames.
pub const CELL_PLACES: usize = 16;
/// Fewest blocks that are an observation.
pub const LEAST_BLOCKS: usize = 12;
/// Pixels at the border without blocks.
pub const SEED_BORDER: usize = 20;
/// Pixels: standard deviations of the coefficients before anything is known of them, of a plane and of what
/// bends it.
pub const UNKNOWN_DEVIATIONS: [f64; 2] = [1.0, 0.05];
/// Shares of the width by which these change from frame to frame.
pub const FIELD_CHANGES: [f64; 2] = [6e-6, 4e-7];
/// Factor of the variance of the mean of neighboring blocks, which err alike.
pub const ALIKE: f64 = 2.0;
/// Share of a correction that is taken for drift,
pub const FOLLOWED: f64 = 0.06;
/// ... and share of the drift that remains from frame to frame.
pub const DAMPED: f64 = 0.995;
/// Share of the standard error: a frame that leaves less of it finds the field, so that its correction is not
/// a drift.
pub const FOUND_SHARE: f64 = 0.8;
/// Largest weight of a block, in median weights.
pub const MOST_WEIGHT: f64 = 2.0;
/// Spreads beyond which a residual is a mistake.
pub const CUT_SPREADS: f64 = 3.0;
/// Pixels rms by which rows have changed where the cameras have been moved, and in standard errors.
pub const MOVED_FROM: f64 = 0.2;
/// See [`MOVED_FROM`].
pub const MOVED_ERRORS: f64 = 6.0;

// Temporal filter (`temporal`)

/// Most frames that a disparity is the mean of. Twice this does not steady a static scene more, and lags
/// twice as long; half steadies it less (`phasestereo bench video`).
pub const MEAN_FRAMES: u8 = 8;
/// Pixels: side of the blocks whose disparities may move together.
pub const MOVED_BLOCK: usize = 32;
/// Pixels along each axis of a block of which one is compared.
pub const MOVED_STEP: usize = 4;
/// Pixels from which on a disparity has moved; so has a block of which more than two thirds have,
pub const MOVED_BY: f32 = 0.25;
/// ... and from which on it is a mistake.
pub const MOST_MOVED_BY: f32 = 2.0;
/// Fewest known disparities of a block that may have moved.
pub const LEAST_MOVED: u32 = 16;
/// Pixels by which disparities of one thing differ at most: the step of integer maps. With less, these
/// flicker more; with more, different things are averaged.
pub const SAME_DISPARITY: f32 = 1.0;

// Changes of a view (`temporal::change`)

/// Multiple of the expected square that still counts as no change. A larger one ignores more of the noise,
/// and more of slow motion, too. A smaller one lets a static scene flicker (`phasestereo bench video --preset
/// fast --noise 8`).
pub const CHANGE_RATIO: f32 = 3.0;
/// Largest square of one pixel, in units of the noise: no float overflows.
pub const LARGEST_SQUARE: f32 = 16384.0;
/// Gray levels: least standard deviation of the noise. Rounding to bytes has 0.29.
pub const LEAST_NOISE: f32 = 0.25;
/// Gray levels: largest standard deviation of the noise. Larger estimates are taken for texture.
pub const MOST_NOISE: f32 = 10.0;
/// Rows and columns from one place to the next. With 1 the filter follows moving edges better, for half as
/// much time again and more than twice the memory.
pub const CHANGE_STEP: usize = 2;
/// Pixels: side of the blocks in which the noise is estimated.
pub const NOISE_BLOCK: usize = 8;
/// Number of blocks that suffices: of larger images rows of blocks are skipped.
pub const NOISE_BLOCKS: usize = 256;
/// Blocks of which one counts as quiet, with little but noise.
pub const QUIET_DIVISOR: usize = 20;
/// Ratio of the noise to the mean square of the quiet blocks: less than for noise alone, since most blocks
/// have texture.
pub const NOISE_FACTOR: f32 = 1.25;
/// Gray levels from which on a pixel is as good as white.
pub const WHITE_FROM: f32 = 250.0;
/// Gray levels below which quotients are unreliable.
pub const DARK_BELOW: f32 = 24.0;
/// Places along each axis of which one shows how the exposure changed.
pub const GAIN_STEP: usize = 4;
/// Fewest places that do.
pub const LEAST_GAIN_PLACES: usize = 64;
/// Distance of a gain from one below which it is noise.
pub const EVEN_GAIN: f32 = 0.01;
/// Largest difference of the quartiles of the quotients, as a share of their median.
pub const AGREEING_GAINS: f32 = 0.15;
