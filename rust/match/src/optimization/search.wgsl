// From phase codes to the chosen candidate of each pixel, with the bits of the core: the optimizers "so" and
// "sgm" where a byte holds every cost and every total.
//
//     aggregate:      for each row, column and candidate k:
//                         cost[y][x][k] = bits in which left code (y, x) and right code (y, x - k) differ,
//                                         summed over a window around (y, x)
//     along_rows:     for each row, panel by panel from the left:
//                         follow a path from COLUMNS_AHEAD columns beyond the panel to its first column
//                         follow the path from the left on
//                         total[y][x][k] = mean of the totals of both
//     climb_columns:  for each column and band ("sgm" alone):
//                         follow a path from ROWS_AHEAD rows below the band to its first row
//                         from_below[y][x][k] = its totals
//     fall_columns:   for each column and band ("sgm" alone):
//                         follow a path from ROWS_AHEAD rows above the band to its last row
//                         total[y][x][k] = mean of itself and of the mean of from_below and the path's totals
//     choose:         for each pixel:
//                         chosen = the first k whose total[y][x][k] is least
//                         found  = chosen, the totals and costs about it, the least total elsewhere
//
// The total of candidate k at a pixel p of a path, after the pixel p-1 (Hirschmüller, PAMI 2008, eq. 13):
//
//     least   = min over i of L(p-1, i)
//     L(p, k) = cost(p, k) - least
//               + min(L(p-1, k), L(p-1, k-1) + P1, L(p-1, k+1) + P1, least + P2)
//
// Before its first pixel a path has totals of 0. P2 is that of the jump of the gray value between the two
// pixels. Panels have PANEL columns, bands BAND rows. Means are rounded up.
//
// Four neighboring candidates lie in the four bytes of a word. A path is followed by WORDS threads, each of
// which has the totals of one word, as a vector. The host puts the constants before this text: WORDS, PATHS
// (of a workgroup), PANEL, BAND, COLUMNS_AHEAD, ROWS_AHEAD, the words, columns and rows that a workgroup sums,
// and the columns that one chooses for. Rows are counted from the first one that was uploaded.

struct Task {
    cols: i32,
    rows: i32,             // of the codes
    candidates: u32,
    code_bytes: u32,
    right_places: u32,     // of a row of right codes, which are unrolled
    radius: i32,           // of the window
    dropped: u32,          // lowest bits of the sum of a column of the window
    p1: u32,
    p2: vec4<u32>,         // after no jump, a small and a large one
    top: i32, bottom: i32, // rows that have costs
    start: i32, end: i32,  // rows to choose for
    band: i32,             // first row of the band of row `start`; it may lie above the image
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> left_codes: array<u32>;   // bytes: row, byte of the code, column
@group(0) @binding(2) var<storage, read> right_codes: array<u32>;  // bytes: version, row, byte of the code, place
@group(0) @binding(3) var<storage, read> pixels: array<u32>;       // bytes: row, column, see `pixel`
@group(0) @binding(4) var<storage, read_write> costs: array<u32>;
@group(0) @binding(5) var<storage, read_write> totals: array<u32>;
@group(0) @binding(6) var<storage, read_write> from_below: array<u32>;
@group(0) @binding(7) var<storage, read_write> found: array<u32>;  // 3 words of each pixel

const EACH = vec4<u32>(0u, 1u, 2u, 3u);

fn unpacked(word: u32) -> vec4<u32> {
    return (vec4<u32>(word) >> (EACH * 8u)) & vec4<u32>(255u);
}

// Totals of candidates beyond the last one exceed a byte, and become its largest number.
fn packed(values: vec4<u32>) -> u32 {
    let bytes = min(values, vec4<u32>(255u)) << (EACH * 8u);
    return bytes.x | bytes.y | bytes.z | bytes.w;
}

// The means of four pairs of bytes, rounded up.
fn mean(a: u32, b: u32) -> u32 {
    return (a | b) - (((a ^ b) >> 1u) & 0x7f7f7f7fu);
}

// The byte of a pixel: in bits 0 and 1 the size of the jump from above, in bits 2 and 3 that from the left, in
// the others the version of the right image that it is compared with.
fn pixel(y: i32, x: i32) -> u32 {
    let at = u32(y * task.cols + x);
    return (pixels[at / 4u] >> (at % 4u * 8u)) & 255u;
}

// The word of the first four candidates of a pixel that has costs.
fn place(y: i32, x: i32) -> u32 {
    return u32((y - task.top) * task.cols + x) * WORDS;
}

// ----------------------------------------------------------------------------------------------- aggregate
// Each thread keeps the sums of one column of windows, of four candidates; each sum over a window is that of
// neighboring threads.

var<workgroup> column_sums: array<u32, SUMMED_WORDS * SUMMED_COLUMNS>;

fn distances(y: i32, x: i32, word: u32) -> u32 {
    let row = clamp(y, 0, task.rows - 1);
    let version = pixel(row, x) >> 4u;
    var sum = 0u;
    for (var i = 0u; i < task.code_bytes; i++) {
        let byte = u32(row) * task.code_bytes + i;
        let left_at = byte * u32(task.cols) + u32(x);
        let left = (left_codes[left_at / 4u] >> (left_at % 4u * 8u)) & 255u;
        // Four bytes from any place on are parts of two words.
        let right_row = version * u32(task.rows) * task.code_bytes + byte;
        let right_at = right_row * task.right_places + u32(task.cols - 1 - x) + 4u * word;
        let shift = right_at % 4u * 8u;
        let low = right_codes[right_at / 4u] >> shift;
        let high = right_codes[right_at / 4u + 1u] << ((32u - shift) % 32u);
        let right = select(low | high, low, shift == 0u);

        var bits = (left * 0x01010101u) ^ right;
        bits -= (bits >> 1u) & 0x55555555u;
        bits = (bits & 0x33333333u) + ((bits >> 2u) & 0x33333333u);
        sum += (bits + (bits >> 4u)) & 0x0f0f0f0fu;
    }
    return sum;
}

@compute @workgroup_size(SUMMED_WORDS, SUMMED_COLUMNS)
fn aggregate(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) id: vec3<u32>) {
    let radius = task.radius;
    let across = i32(SUMMED_COLUMNS) - 2 * radius;
    let column = i32(id.y);
    let x = i32(group.x) * across + column - radius;
    let word = group.y * SUMMED_WORDS + id.x;
    let is_center = column >= radius && column < radius + across && x < task.cols && word < WORDS;
    // Edge columns are repeated; words beyond the last one are not used.
    let seen_x = clamp(x, 0, task.cols - 1);
    let seen_word = min(word, WORDS - 1u);
    // Candidates beyond the last one never win.
    let surplus = 4u * WORDS - task.candidates;
    let beyond = select(0u, 0xffffffffu << (32u - 8u * surplus), word == WORDS - 1u && surplus > 0u);
    let kept = (255u >> task.dropped) * 0x01010101u;

    let first = task.top + i32(group.z) * SUMMED_ROWS;
    var sum = 0u;
    for (var y = first - radius; y < first + radius; y++) {
        sum += distances(y, seen_x, seen_word);
    }
    for (var y = first; y < min(first + SUMMED_ROWS, task.bottom); y++) {
        sum += distances(y + radius, seen_x, seen_word);
        column_sums[id.y * SUMMED_WORDS + id.x] = (sum >> task.dropped) & kept;
        sum -= distances(y - radius, seen_x, seen_word);
        workgroupBarrier();

        if is_center {
            var window = 0u;
            for (var other = column - radius; other <= column + radius; other++) {
                window += column_sums[u32(other) * SUMMED_WORDS + id.x];
            }
            costs[place(y, x) + word] = window | beyond;
        }
        workgroupBarrier();
    }
}

// --------------------------------------------------------------------------------------------------- paths
// What the threads of a path know of one another, by turns: while some still read the values of one step,
// others write those of the next one.

var<workgroup> outermost: array<vec2<u32>, 2u * WORDS * PATHS>;  // first and last total of each word
// By how much the least total is below FAR: 0, as memory begins, where nothing is known.
var<workgroup> depth: array<atomic<u32>, 3u * PATHS>;
const FAR: u32 = 0x10000u;

// P2 after the jump to a pixel, from its byte.
fn p2_from(y: i32, x: i32, shift: u32) -> u32 {
    return task.p2[(pixel(min(y, task.rows - 1), min(x, task.cols - 1)) >> shift) & 3u];
}
fn p2_from_above(y: i32, x: i32) -> u32 { return p2_from(y, x, 0u); }
fn p2_from_left(y: i32, x: i32) -> u32 { return p2_from(y, x, 2u); }

// The totals at the next pixel of a path, in the `turn`th step of a kernel. All threads of a workgroup take
// each step.
fn extended(total: vec4<u32>, cost: vec4<u32>, p2: u32, turn: u32, id: vec3<u32>) -> vec4<u32> {
    let mine = (turn % 2u * PATHS + id.y) * WORDS + id.x;
    let now = turn % 3u * PATHS + id.y;
    outermost[mine] = vec2<u32>(total.x, total.w);
    atomicMax(&depth[now], FAR - min(min(total.x, total.y), min(total.z, total.w)));
    if id.x == 0u {
        atomicStore(&depth[(turn + 1u) % 3u * PATHS + id.y], 0u);
    }
    workgroupBarrier();

    var before = FAR;
    var after = FAR;
    if id.x > 0u { before = outermost[mine - 1u].y; }
    if id.x + 1u < WORDS { after = outermost[mine + 1u].x; }
    let least = FAR - atomicLoad(&depth[now]);
    let changed = min(vec4<u32>(before, total.xyz), vec4<u32>(total.yzw, after)) + vec4<u32>(task.p1);
    return cost + min(min(total, changed) - vec4<u32>(least), vec4<u32>(p2));
}

@compute @workgroup_size(WORDS, PATHS)
fn along_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) id: vec3<u32>) {
    let row = task.start + i32(group.x * PATHS + id.y);
    // Paths beyond the last row follow it, too, and write nothing.
    let y = min(row, task.end - 1);
    var turn = 0u;
    var from_left = vec4<u32>(0u);
    for (var first = 0; first < task.cols; first += PANEL) {
        let end = min(first + PANEL, task.cols);
        var from_right = vec4<u32>(0u);
        for (var x = min(end + COLUMNS_AHEAD, task.cols) - 1; x >= first; x--) {
            let at = place(y, x) + id.x;
            from_right = extended(from_right, unpacked(costs[at]), p2_from_left(y, x + 1), turn, id);
            turn++;
            if row == y && x < end { totals[at] = packed(from_right); }
        }
        for (var x = first; x < end; x++) {
            let at = place(y, x) + id.x;
            from_left = extended(from_left, unpacked(costs[at]), p2_from_left(y, x), turn, id);
            turn++;
            if row == y { totals[at] = mean(totals[at], packed(from_left)); }
        }
    }
}

@compute @workgroup_size(WORDS, PATHS)
fn climb_columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) id: vec3<u32>) {
    let column = i32(group.x * PATHS + id.y);
    let x = min(column, task.cols - 1);
    let band = task.band + i32(group.y) * BAND;
    let first = max(band, task.top);
    var turn = 0u;
    var total = vec4<u32>(0u);
    for (var y = min(band + BAND + ROWS_AHEAD, task.bottom) - 1; y >= first; y--) {
        let at = place(y, x) + id.x;
        total = extended(total, unpacked(costs[at]), p2_from_above(y + 1, x), turn, id);
        turn++;
        if column == x && y < band + BAND { from_below[at] = packed(total); }
    }
}

@compute @workgroup_size(WORDS, PATHS)
fn fall_columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) id: vec3<u32>) {
    let column = i32(group.x * PATHS + id.y);
    let x = min(column, task.cols - 1);
    let band = task.band + i32(group.y) * BAND;
    var turn = 0u;
    var total = vec4<u32>(0u);
    for (var y = max(band - ROWS_AHEAD, task.top); y < min(band + BAND, task.bottom); y++) {
        let at = place(y, x) + id.x;
        total = extended(total, unpacked(costs[at]), p2_from_above(y, x), turn, id);
        turn++;
        if column == x && y >= band {
            totals[at] = mean(totals[at], mean(packed(total), from_below[at]));
        }
    }
}

// -------------------------------------------------------------------------------------------------- choose
// Each thread reads all candidates of a pixel, and writes three words, their parts from the lowest bits on:
//     the chosen candidate, 16 bits; the least total of those that are not next to it
//     the totals of the candidate below, the chosen one and the one above, a byte each
//     their costs, likewise
// At the least candidate these are of the first three, and the host takes no offset at either end.

@compute @workgroup_size(CHOSEN_COLUMNS)
fn choose(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = i32(id.x);
    let y = task.start + i32(id.y);
    if x >= task.cols { return; }
    let at = place(y, x);

    var least = 0xffffffffu;
    for (var word = 0u; word < WORDS; word++) {
        let k = EACH + vec4<u32>(4u * word);
        let keys = (unpacked(totals[at + word]) << vec4<u32>(16u)) | k;
        let real = select(vec4<u32>(0xffffffffu), keys, k < vec4<u32>(task.candidates));
        least = min(least, min(min(real.x, real.y), min(real.z, real.w)));
    }
    let chosen = least & 0xffffu;

    var elsewhere = 255u;
    for (var word = 0u; word < WORDS; word++) {
        let k = EACH + vec4<u32>(4u * word);
        let is_near = (k + vec4<u32>(1u) >= vec4<u32>(chosen)) & (k <= vec4<u32>(chosen + 1u));
        let others = select(unpacked(totals[at + word]), vec4<u32>(255u), is_near);
        elsewhere = min(elsewhere, min(min(others.x, others.y), min(others.z, others.w)));
    }

    var valley = vec2<u32>(0u);
    let below = max(chosen, 1u) - 1u;
    for (var i = 0u; i < 3u; i++) {
        let k = min(below + i, 4u * WORDS - 1u);
        let both = vec2<u32>(totals[at + k / 4u], costs[at + k / 4u]) >> vec2<u32>(k % 4u * 8u);
        valley |= (both & vec2<u32>(255u)) << vec2<u32>(8u * i);
    }
    let pixel = 3u * (id.y * u32(task.cols) + id.x);
    found[pixel] = chosen | (elsewhere << 16u);
    found[pixel + 1u] = valley.x;
    found[pixel + 2u] = valley.y;
}
