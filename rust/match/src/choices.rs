//! The choices of this crate: numbers that neither follow from a definition nor are learned.
//!
//! Each has its unit and the evidence that chose it. Sizes of buffers, lanes and fixed-point steps follow
//! from the algorithms and are defined beside them.

/// Makes a documented constant of each entry.
macro_rules! choices {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident: $type:ty = $value:expr, in $unit:literal, evidence $reason:literal;
    )+) => {
        $(
            $(#[doc = $doc])+
            #[doc = concat!("\n\nUnit: ", $unit, ". Evidence: ", $reason, ".")]
            pub const $name: $type = $value;
        )+
    };
}

// Images.
choices! {
    /// Least border that is masked, of black ones.
    LEAST_BORDER: f64 = 0.004, in "share of the image",
        evidence "of 108 photographs none has such runs of its least value over more than 0.16 %";

    /// Fewest rows and columns of an image that is searched for borders and overlays.
    LEAST_MASKED: usize = 48, in "pixels", evidence "estimates need these";

    /// Shortest piece of a border along a side.
    SHORTEST_BORDER: usize = 8, in "pixels",
        evidence "noise about black has shorter pieces, since each ends at a brighter pixel on the side";

    /// Farthest that a border continues with nearly black pixels.
    RIM: usize = 16, in "pixels", evidence "blocks of JPEG and video whose colors are halved";

    /// Brightest of these pixels, above the border.
    RIM_LEVELS: f64 = 12.0, in "gray levels",
        evidence "JPEG 90 leaves 0.9 % of the black beside photographs brighter, JPEG 50 2.2 %; 8 levels 1.9 %, 4.1 %";

    /// Most that the outline of a border deviates from a convex or concave one.
    RAGGED_BORDER: f64 = 0.22, in "share of the area",
        evidence "frames, circles, turned and bent rectangles have up to 0.02, after JPEG 0.2; houses and trees before a \
               black sky 0.28 and more";
}

// Overlays. They were tried on 21 scenes with clocks, captions, boxes and logos, and on some 2 900 pairs
// without any.
choices! {
    /// Side of the cells in which edges are counted.
    OVERLAY_CELL: usize = 8, in "pixels", evidence "the blocks of JPEG";

    /// Columns from one side of an edge to the other.
    EDGE_WIDTH: usize = 2, in "pixels", evidence "the edge of a letter is softened over one between; not swept";

    /// Rows and columns of cells up to which two of them belong to one area.
    JOINED_CELLS: (usize, usize) = (3, 5), in "cells", evidence "letters of one line are as near; not swept";

    /// Rows by which the right image is moved to count edges that are equal by chance.
    ROWS_OFF: [isize; 4] = [-24, -12, 12, 24], in "pixels", evidence "not swept";

    /// Cells around an area that are searched for the disparity of the scene.
    CELLS_AROUND: usize = 3, in "cells", evidence "not swept";

    /// Rows and columns beside an edge of both images within which edges may be its own.
    EDGE_MARGIN: (usize, usize) = (1, 3), in "pixels", evidence "not swept";

    /// Divisor of the width that gives the largest disparity tried, on either side.
    OVERLAY_REACH: usize = 4, in "1", evidence "not swept";

    /// Least height of a sharp edge along a row.
    SHARP_EDGE: i32 = 24, in "gray levels", evidence "letters have more; noise of 4 has none";

    /// Most by which two equal pixels differ; an eighth of the height of the edge, if that is more.
    EQUAL_LEVELS: i32 = 3, in "gray levels", evidence "what JPEG 70 changes beside edges of 24";

    /// Fewest edges of an overlay at the same place in both images, and in squares of 16 x 16 pixels.
    LEAST_EDGES: u32 = 12, in "pixels",
        evidence "of 40 photographed pairs, 27 have no square with 12; a line of text has 30 to 100 in one";

    /// Least ratio of the edges of an overlay to those expected by chance.
    CLEAR_EDGES: f64 = 3.0, in "times",
        evidence "letters have 3 to 40 times as many; of 40 photographed pairs one has 2.4 times";

    /// Least evidence that the edges of an overlay are not there by chance.
    CERTAIN_EDGES: f64 = 200.0, in "bits", evidence "lines of text have 200 to 10 000; without an overlay, 137";

    /// Gray levels that nearly all edges of an overlay have.
    OVERLAY_COLORS: usize = 3, in "gray levels", evidence "letters, their shadow and a box around them";

    /// Most by which pixels of one color differ from it.
    COLOR_LEVELS: usize = 5, in "gray levels", evidence "what JPEG 70 changes beside letters";

    /// Least share of the edges of letters that are equal on one side only: the scene is on the other.
    LEAST_OUTLINE: f64 = 0.25, in "share of the edges",
        evidence "most lines of text have 0.33 to 0.82; what is seen of another scene at disparity 0, 0.06 to 0.3";

    /// Least share of edges with a side of such a color: of those, and of others.
    LEAST_PAINTED: [f64; 2] = [0.8, 0.9], in "share of the edges",
        evidence "captions have 0.73 to 1, those in boxes 0.9; what is seen of another scene, 0.49 to 0.87";

    /// Least height of the edges that show where the scene is.
    FAINT_EDGE: i32 = 3, in "gray levels", evidence "noise of 1.5 gray levels reaches it at one pixel in ten";

    /// Least evidence that the surroundings of an overlay are at another disparity.
    CERTAIN_BESIDE: f64 = 20.0, in "bits", evidence "200 disparities are tried; by chance one has 12";

    /// Least ratio of this evidence to that for disparity 0.
    ELSEWHERE: f64 = 32.0, in "times",
        evidence "of 1 000 pairs with a scene at disparity 0 behind near things, none that is painted has as much";

    /// Largest rectangle around an overlay.
    MOST_OVERLAID: f64 = 0.2, in "share of the image", evidence "a caption of 24 px along images of 360 x 240 has 14 %";
}

// Costs and their optimization.
choices! {
    /// Largest magnitude of normalized gray values.
    LARGEST_DEVIATION: u16 = 16, in "standard deviations",
        evidence "only windows of more than 16 pixels can reach it";

    /// Largest sum over a window at byte precision.
    LARGEST_BYTE_SUM: u64 = 170, in "steps", evidence "two thirds of a byte, so that P2 fits as well";

    /// Least largest sum for which one further bit is dropped.
    LEAST_BYTE_SUM: u64 = 80, in "steps", evidence "below it costs are too coarse";

    /// Rows of a band, which is matched by itself.
    BAND: usize = 64, in "rows", evidence "panels of up to about 128 disparities fit in a second-level cache";

    /// Bands that an engine other than the core searches at a time.
    ENGINE_BANDS: usize = 16, in "bands",
        evidence "not swept: an image of 1024 rows with `\"sgm\"` is one chunk, and a cancelled match ends soon";

    /// Columns of a panel, the part of a band whose costs exist at one time.
    PANEL: usize = 64, in "columns", evidence "as that of `BAND`";

    /// Rows above and below a band where its vertical paths start.
    LOOKAHEAD_ROWS: usize = 16, in "rows", evidence "hardly less accurate than whole paths";

    /// A jump of the gray value beyond this many thresholds is large.
    LARGE_JUMP: u32 = 3, in "thresholds",
        evidence "of 12 scenes under 5 faults 0.12 points fewer pixels are wrong with 2, and 0.02 more with 4";

    /// Divisors of P2 after no jump, a small one and a large one.
    P2_DIVISORS: [u64; 3] = [1, 2, 3], in "ratio", evidence "not swept";

    /// Weight of the costs of the pixel alone against the mean of the path totals, which P1 draws to whole
    /// disparities.
    SUBPIXEL_COST_WEIGHT: u32 = 2, in "1",
        evidence "with more, fractions are more even on rendered pairs, and real pairs have a few more wrong \
               pixels";

    /// How much steeper than a V the interpolation is at the candidate; halfway to the next one it is flatter
    /// by as much.
    SUBPIXEL_STEEPNESS: f32 = 0.3, in "1",
        evidence "fractions are most even on rendered and on real pairs together";
}

// Refinement.
choices! {
    /// Neighboring disparities that differ by more form a jump.
    JUMP: f32 = 1.0, in "pixels", evidence "the largest difference of disparities on one surface";

    /// Most rows between a row without a trusted pixel and the row it copies.
    FILLING_REACH: usize = 32, in "rows",
        evidence "such rows are rare, and rows further away say nothing about them";

    /// Least mean difference of neighbors that serves as the unit for gray values.
    LEAST_ROUGHNESS: f64 = 1.0 / 16.0, in "steps of gray values", evidence "keeps the scale of flat images finite";

    /// Rows and columns on either side over which surfaces are smoothed.
    SURFACE_REACH: usize = 3, in "pixels", evidence "larger ones bend curved surfaces";

    /// Pixels by which near surfaces are eroded and dilated, in each direction of a square.
    SYNTHESIS_RADIUS: usize = 4, in "pixels",
        evidence "fewer repair less of a wide blur; several radii in turn repair a little more and take as much \
               longer";

    /// Side of the window over which maps are compared.
    SYNTHESIS_WINDOW: usize = 15, in "pixels", evidence "from 11 to 19 it makes no difference";

    /// Largest difference of disparities that count as the same.
    SAME_DISPARITY: f32 = 0.5, in "pixels",
        evidence "slopes stay as they are, which helps sub-pixel disparities more than it costs elsewhere";

    /// Columns on either side of a gap in the right view to which its brightness is adapted.
    BESIDE_GAP: usize = 16, in "columns",
        evidence "it counts where the contrast of the images differs; under 5 faults 11 and 21 change 0.03 points";

    /// Lead of the best candidate over all others at which a pixel has half a vote.
    HALF_VOTE: f32 = 4.0, in "units of the mean cost (bits, for phase codes of 16 bits)",
        evidence "from half to twice of it makes no difference";

    /// How far up, down, left and right votes count.
    CONFIDENCE_RADIUS: usize = 4, in "pixels",
        evidence "further votes blur sharp maps, nearer ones are too few for noise";

    /// Distance of the rows and columns within this radius that count.
    CONFIDENCE_STEP: usize = 2, in "pixels", evidence "all pixels take three times as long and are no better";

    /// Largest difference of disparities that agree.
    AGREEMENT: f32 = 1.0, in "pixels", evidence "with less, steps of slopes disagree";

    /// Difference of gray values at which a vote counts half.
    SIMILAR_GRAY: f64 = 2.0, in "mean differences of horizontal neighbors", evidence "hardly matters";

    /// The cube of the support at which half of all disparities are right.
    HALF_SUPPORT: f32 = 0.01, in "cube of a share",
        evidence "logistic regression of right and wrong on the logarithm of the support, half of the weight on \
               sharp and half on degraded pairs";

    /// Rows from one sampled row to the next.
    SAMPLE_PERIOD: usize = 64, in "rows", evidence "all rows take a fifth longer";

    /// Columns on either side of a jump whose disparities are less sure than they seem.
    OUTLINE_REACH: usize = 8, in "pixels",
        evidence "of 576 spoiled pairs, scenes left out, the mean logarithmic loss of confidences is 0.3146 without \
               outlines, 0.3143, 0.3136 and 0.3117 with 2, 4 and 8; within 4 pixels of an outline 0.042 too much is \
               claimed without, 0.017 too little with 8";

    /// Images up to this height are summed whole.
    FEW_ROWS: usize = 768, in "rows", evidence "not swept";

    /// Bands of rows that are summed in taller images.
    SAMPLED_BANDS: usize = 3, in "bands", evidence "not swept";

    /// Rows of such a band.
    SAMPLED_BAND_ROWS: usize = 96, in "rows", evidence "not swept";

    /// The odds of a mean raw confidence below which a pair has probably failed.
    LOW_ODDS: f64 = 1.5, in "logarithm of odds", evidence "not swept";

    /// Least mean raw confidence that is distinguished.
    LEAST_MEAN_CONFIDENCE: f64 = 0.4, in "1",
        evidence "of 582 pairs of which the weights were learned the least is 0.49; lines continued from there \
               would cross";

    /// Least distance of a share from 0 and 1.
    LEAST_SHARE: f64 = 0.004, in "ratio", evidence "not swept";

    /// Noise that counts as zero.
    NO_NOISE: f64 = 0.3, in "gray levels of 256", evidence "the noise of rounding to 8 bits is 0.29";

    /// Smoothing that counts as none.
    NO_SMOOTHING: f64 = 0.1, in "gray levels of 256", evidence "not swept";

    /// Share at the ends of the searched range that counts as none.
    NONE_AT_ENDS: f64 = 0.003, in "share of the pixels", evidence "not swept";
}
