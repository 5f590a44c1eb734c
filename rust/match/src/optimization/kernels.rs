//! The kernels that devices search with: their WGSL text, their buffers, and the order in which they run.

use crate::optimization::tasks::{MOST_RADIUS, Task};
use crate::optimization::{BAND, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, PANEL};

/// All kernels, with their documentation; to be compiled after the [`constants`].
pub const SHADER: &str = include_str!("search.wgsl");

/// Buffers of a task, by their bindings: its numbers, left and right codes, pixels; costs, totals, totals
/// from below, and results.
pub const BUFFERS: usize = 8;
/// The buffer of results.
pub const FOUND: usize = BUFFERS - 1;

/// Bytes of the largest volume of costs or totals, unless a device has its own limit. Not swept, for lack of
/// a device.
pub const MOST_BYTES: u64 = 256 << 20;

/// Minimum threads of a workgroup: those of one path, or of several. It is the width of most GPUs.
const THREADS: u32 = 32;
/// Words and columns of a workgroup that sums, and rows that it sums one after another. Not swept, like the
/// next one, for lack of a device.
const SUMMED_WORDS: u32 = 8;
const SUMMED_COLUMNS: u32 = 32;
// Some of the summed columns must be those of window centers.
const _: () = assert!(SUMMED_COLUMNS > 2 * MOST_RADIUS as u32);
const SUMMED_ROWS: u32 = 64;
/// Columns of a workgroup that chooses.
const CHOSEN_COLUMNS: u32 = 64;

/// Paths of a workgroup, each with this many threads.
fn paths(words: u32) -> u32 {
    (THREADS / words).max(1)
}

/// The constants that the kernels are compiled with, for a number of words of a pixel's candidates.
pub fn constants(words: u32) -> String {
    let paths = paths(words);
    format!(
        "const WORDS: u32 = {words}u;\nconst PATHS: u32 = {paths}u;\nconst PANEL: i32 = {PANEL};\n\
         const BAND: i32 = {BAND};\nconst COLUMNS_AHEAD: i32 = {LOOKAHEAD_COLUMNS};\n\
         const ROWS_AHEAD: i32 = {LOOKAHEAD_ROWS};\nconst SUMMED_WORDS: u32 = {SUMMED_WORDS}u;\n\
         const SUMMED_COLUMNS: u32 = {SUMMED_COLUMNS}u;\nconst SUMMED_ROWS: i32 = {SUMMED_ROWS};\n\
         const CHOSEN_COLUMNS: u32 = {CHOSEN_COLUMNS}u;\n"
    )
}

/// Bytes of each buffer.
pub fn sizes(task: &Task) -> [u64; BUFFERS] {
    let [left, right, pixels] = [task.left, task.right, task.pixels].map(|bytes| bytes.len() as u64);
    let volume = task.volume_bytes();
    let from_below = if task.is_along_columns() { volume } else { 4 };
    let numbers = size_of_val(&task.numbers) as u64;
    [numbers, left, right, pixels, volume, volume, from_below, 4 * task.found_words() as u64]
}

/// The kernels that a task runs, one after another, each with its workgroups.
pub fn steps(task: &Task) -> Vec<(&'static str, [u32; 3])> {
    let (cols, rows, words) = (task.cols(), task.rows(), task.words());
    let summed = SUMMED_COLUMNS - 2 * task.radius();
    let sums = [cols.div_ceil(summed), words.div_ceil(SUMMED_WORDS), task.seen_rows().div_ceil(SUMMED_ROWS)];
    let along_rows = [rows.div_ceil(paths(words)), 1, 1];
    let choices = [cols.div_ceil(CHOSEN_COLUMNS), rows, 1];

    let mut steps = vec![("aggregate", sums), ("along_rows", along_rows)];
    if task.is_along_columns() {
        let along_columns = [cols.div_ceil(paths(words)), task.bands(), 1];
        steps.extend([("climb_columns", along_columns), ("fall_columns", along_columns)]);
    }
    steps.push(("choose", choices));
    steps
}
