//! Time of each stage by itself, on one thread, in (pixel x candidate) or pixels a second.
//!
//! One group a stage, as the files of `rust/`; `cargo bench -- scanline` runs one of them.

use divan::Bencher;
use divan::counter::ItemsCount;
use phasestereo::aggregation::{Window, aggregate as aggregate_volume};
use phasestereo::control::Control;
use phasestereo::matcher::{Execution, Pair, on_threads, run};
use phasestereo::plane::Plane;
use phasestereo::settings::Settings;
use phasestereo::view::{Image, View};

const ROWS: usize = 120;
const COLS: usize = 640;

fn main() {
    divan::main();
}

/// Values without any structure: no stage's time depends on what the images show.
fn noise<T>(rows: usize, cols: usize, mut value: impl FnMut(u32) -> T) -> Plane<T> {
    let mut state = 1u32;
    Plane::from_fn(rows, cols, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        value(state >> 16)
    })
}

fn window(candidates: usize) -> Window {
    let settings = Settings::default();
    Window::new((ROWS, COLS), candidates, &settings, settings.code_length() as u16)
}

fn evaluations(candidates: usize) -> ItemsCount {
    ItemsCount::new(ROWS * COLS * candidates)
}

mod descriptor {
    use super::{Bencher, COLS, Control, ItemsCount, ROWS, Settings, noise, on_threads};
    use phasestereo::descriptor::describe as describe_plane;

    #[divan::bench(args = [7, 15, 31])]
    fn describe(bencher: Bencher, neighborhood: usize) {
        let gray = noise(ROWS, COLS, |value| 1000 * (value as i32 % 256));
        let settings = Settings { neighborhood, ..Settings::default() };
        let control = Control::default();
        bencher
            .counter(ItemsCount::new(ROWS * COLS))
            .bench(|| on_threads(1, || describe_plane(&gray, &settings, &control)));
    }
}

mod aggregation {
    use super::{Bencher, COLS, Control, ROWS, aggregate_volume, evaluations, noise, window};

    #[divan::bench(args = [16, 64, 256])]
    fn aggregate(bencher: Bencher, candidates: usize) {
        let costs = noise(ROWS, COLS * candidates, |value| (value % 15) as u16);
        bencher
            .counter(evaluations(candidates))
            .bench(|| aggregate_volume(&costs, window(candidates), &Control::default()));
    }
}

mod scanline {
    use super::{Bencher, COLS, Control, ROWS, Settings, evaluations, noise, window};
    use phasestereo::scanline::{Steps, optimize};
    use phasestereo::settings::Optimizer;

    #[divan::bench(args = [16, 64, 256])]
    fn dynamic_programming(bencher: Bencher, candidates: usize) {
        let costs = noise(ROWS, COLS * candidates, |value| value % 1134);
        let steps = Steps::new(Settings::default().penalty, window(candidates), 1);
        let optimizer = Optimizer::DynamicProgramming;
        bencher
            .counter(evaluations(candidates))
            .bench(|| optimize(&costs, candidates, optimizer, steps, &Control::default()));
    }
}

mod matcher {
    use super::{
        Bencher, COLS, Control, Execution, Image, Pair, ROWS, Settings, View, evaluations, noise,
        run,
    };

    #[divan::bench(args = [16, 64, 256])]
    fn paper(bencher: Bencher, candidates: usize) {
        let scene = noise(ROWS, COLS + 8, |value| value as u8);
        let view = |shift: usize| View {
            image: Image::U8(ndarray::Array3::from_shape_fn((ROWS, COLS, 1), |(y, x, _)| {
                scene.row(y)[x + shift]
            })),
            mask: None,
        };
        let pair = Pair::new(view(0), view(8), 0, candidates as i64).expect("a legal pair");
        let (settings, control) = (Settings::default(), Control::default());
        let how = Execution { threads: 1, band_rows: None };
        bencher.counter(evaluations(candidates)).bench(|| run(&pair, &settings, how, &control));
    }
}
