//! The Python interface: reads arguments, copies images in, releases the interpreter, runs the core, and
//! returns results.
//!
//! Both images are copied before the interpreter is released: borrowing them would not stop another Python
//! thread from writing into them.

mod arguments;
mod engine;
mod failure;
mod keep;
mod known;
mod objects;
mod preparation;
mod reader;
mod rig;
mod second;
mod settings;
mod supervisor;
mod temporal;
mod third_camera;
mod verification;
mod workers;

use std::cmp::Reverse;
use std::sync::Arc;

use ndarray::{Array2, Array3, arr2};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use self::arguments::{
    Both, Statistics, read_alignment, read_any_images, read_blur_compensation, read_input, read_inputs,
    read_noise, read_pair, read_preset, read_range, read_search, read_volume,
};
use self::failure::{Failure, Result};
use self::keep::kept_pixels;
use self::known::{read_known, read_noise_of_pair};
use self::objects::{Asked, Matched, Object};
use self::preparation::{Back, Ready, prepare_pair};
use self::reader::{Reader, Scale};
use self::rig::Rig;
use self::second::with_second;
use self::settings::{Setting, every_setting, read_settings, write_settings};
use self::supervisor::supervised;
use self::temporal::TemporalFilter;
use self::third_camera::{rays_of_pixels, register_depths};
use self::verification::{observe_maps, verify_map};
use self::workers::{Pool, Workers, release_memory};
use phasestereo::Error;
use phasestereo::internals;
use phasestereo::internals::estimation::blur;
use phasestereo::internals::estimation::compensation_plan::{LARGER, MUCH_LARGER};
use phasestereo::internals::estimation::overview::LEAST_SIZE;
use phasestereo::internals::estimation::{Prepared, complete, complete_source, takes_negative};
use phasestereo::internals::findings;
use phasestereo::internals::match_pair::diagnosed;
use phasestereo::internals::rectification::rectify_views;
use phasestereo::internals::self_check::{CASES, differing};
use phasestereo::internals::verification::verdict;
use phasestereo::internals::video::frames::{Frame, Options, match_frame_as_turned};
use phasestereo::internals::video::temporal::TemporalFilter as Filter;
use phasestereo::{Finding, Topic};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::{Plane, widened};
use phasestereo_match::base::simd::Level;
use phasestereo_match::cost::Costs;
use phasestereo_match::cost::aggregation::{Window, aggregate};
use phasestereo_match::descriptor::{Codes, describe};
use phasestereo_match::image::border;
use phasestereo_match::image::conversion::view_of_input;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::texture::Roughness;
use phasestereo_match::matcher::footprint;
use phasestereo_match::matcher::halo::Halo;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::{Disparity, Execution, Matcher, on_threads};
use phasestereo_match::optimization::{BAND, Penalties, optimize};
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::blur_compensation::{BlurCompensation, MOST_CLASSES};
use phasestereo_match::pair::fitting::resized_right;
use phasestereo_match::pair::overlay::{self, Overlay};
use phasestereo_match::pair::plan::{Demand, Plan};
use phasestereo_match::pair::source;
use phasestereo_match::pair::{Pair, check};
use phasestereo_match::refinement::calibration::{Tally, sampled};
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{MOST_DISPARITIES, Settings};

/// Constants of a module, each with its name.
macro_rules! named {
    ($module:ident: $($name:ident),*) => { [$((stringify!($name), $module::$name)),*] };
}

/// `phasestereo._core`: the stub beside the Python modules documents the arguments and results of each
/// function.
///
/// It does not need the GIL: data shared by several calls is behind mutexes (`Workers`, the shared pool, the
/// spare memory of a matcher) or computed once (tables), and the only unsafe code is in `simd.rs`, which
/// shares nothing. Arrays are copied before a call matches anything; if another thread changes one meanwhile,
/// the copy is half changed, as in `NumPy` itself.
#[pymodule(gil_used = false)]
mod _core {
    use super::{
        BAND, Bound, Finding, IntoPyDict, LARGER, LEAST_SIZE, MOST_CLASSES, MOST_DISPARITIES, MUCH_LARGER,
        Preset, PyModule, PyModuleMethods, Result, Topic, every_setting, flag, verdict, warm_up,
    };

    #[pymodule_export]
    use super::{
        Back, Ready, Rig, Scale, Setting, TemporalFilter, Workers, aggregate_volume, check_blur_compensation,
        check_noise, check_settings, cost_volume, descriptor, estimate_pair, estimate_pair_by_rows,
        find_borders, find_overlays, find_roughness, find_scale, fit_right, halo, kept_pixels, match_pair,
        match_raw, match_rows, observe_maps, optimize_volume, prepare_pair, preset, rays_of_pixels,
        rectify_pairs, register_depths, release_memory, rows_to_tally, self_check, simd_level, verify_map,
        working_memory,
    };

    #[pymodule_init]
    fn constants(module: &Bound<'_, PyModule>) -> Result<()> {
        warm_up(module.py())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("PRESETS", Preset::ALL.map(Preset::name))?;
        module.add("SETTINGS", every_setting())?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))?;
        module.add("BAND_ROWS", BAND)?;
        module.add("LARGER", LARGER)?;
        module.add("MUCH_LARGER", MUCH_LARGER)?;
        module.add("LEAST_SIZE", LEAST_SIZE)?;
        module.add("MOST_CLASSES", MOST_CLASSES)?;
        module.add("MOST_DISPARITIES", MOST_DISPARITIES)?;

        let decisive = Topic::ALL.into_iter().filter(|topic| topic.is_decisive());
        module.add("DECISIVE_TOPICS", decisive.map(Topic::name).collect::<Vec<_>>())?;
        module.add("NO_DEPTH", Finding::NO_DEPTH)?;

        let flags = named!(
            flag: MASKED, NO_CANDIDATE, OUTSIDE, MATCH_MASKED, OCCLUDED, MISMATCHED, LOW_CONFIDENCE,
            AMBIGUOUS, SPECKLE, FILLED, INFERRED, COARSE, SECOND
        );
        module.add("FLAGS", flags.into_py_dict(module.py())?)?;

        let verdicts = named!(verdict: NO_CLAIM, UNKNOWN, SUPPORTED, REFUTED);
        Ok(module.add("VERDICTS", verdicts.into_py_dict(module.py())?)?)
    }
}

/// Initializes now, on the importing thread, everything that is initialized only once: the tables of the
/// array interface, those of the thread pool and of the blur estimation, and the detected instructions.
///
/// A process forked while another thread initializes them would inherit a half-done initialization and wait
/// for its end forever.
fn warm_up(py: Python<'_>) -> Result<()> {
    PyArray2::<u8>::zeros(py, (1, 1), false).try_readonly().map_err(internal)?;
    Level::best();
    blur::prepare();
    Ok(on_threads(1, || ())?)
}

#[pyfunction]
fn simd_level() -> &'static str {
    Level::best().name()
}

/// Pairs whose matches are not bit-identical to those of every platform: their names and digests.
#[pyfunction]
fn self_check(py: Python<'_>, progress: Option<Bound<'_, PyAny>>) -> Result<Vec<String>> {
    let pool = Pool::for_argument(&py.None().into_bound(py))?;
    supervised(py, &pool, CASES.len(), progress, differing)
}

#[pyfunction]
fn check_settings(settings: &Bound<'_, PyAny>) -> Result<()> {
    read_settings(settings).map(drop)
}

/// The settings of a preset, by name.
#[pyfunction]
fn preset<'py>(py: Python<'py>, name: &Bound<'py, PyAny>) -> Result<Bound<'py, PyDict>> {
    write_settings(py, &read_preset(name)?.settings())
}

#[pyfunction]
fn check_blur_compensation(compensation: &Bound<'_, PyAny>) -> Result<()> {
    read_blur_compensation(compensation).map(drop)
}

/// Refuses a wrong `known.noise`.
#[pyfunction]
fn check_noise(noise: &Bound<'_, PyAny>) -> Result<()> {
    read_noise_of_pair(noise).map(drop)
}

/// A whole default match in one call: estimates unknown properties, matches the pair, summarizes the map, and
/// returns the findings. The result has no images. `second` is a map of the left image, a matcher that makes
/// one (see [`with_second`]), or None.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arguments that Python names")]
fn match_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    settings: Object<'py>,
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
    known: Object<'py>,
    temporal: Option<PyRef<'py, TemporalFilter>>,
    rig: Option<PyRef<'py, Rig>>,
    reestimate: u64,
    vertical: Option<bool>,
    second: Option<Object<'py>>,
) -> Result<Object<'py>> {
    let asked = read_settings(&settings)?;
    let search = read_search(&disparities)?;
    // Disparities along columns are checked against these.
    let is_turned = vertical == Some(true);
    let (min, count) = search.filter(|_| !is_turned).unwrap_or((0, 1));
    let inputs = read_inputs(&images, &masks)?;
    let asks = second.as_ref().is_some_and(Bound::is_callable);
    let kept = asks.then(|| inputs.clone());
    let pair = py.detach(|| Pair::of_any(inputs, min, count))?;
    let (rows, cols) = pair.size();
    let size = if is_turned { (cols, rows) } else { (rows, cols) };

    let told = read_known(&known, size, search, vertical)?;

    let pool = Pool::for_argument(threads)?;
    let turns = (
        rig.as_ref().map(|rig| rig.turn()).transpose()?,
        temporal.as_ref().map(|filter| filter.turn()).transpose()?,
    );
    let mut state = turns.0.as_ref().map(|turn| turn.value().clone()).unwrap_or_default();
    let mut filter = turns.1.as_ref().map(|turn| turn.replace(Filter::default()));
    let (frame, state, filter) = supervised(py, &pool, size.0, progress, move |runtime| {
        let options = Options { facts: &told, settings: &asked, reestimate };
        let frame = match_frame_as_turned(&mut state, pair, options, filter.as_mut(), runtime);
        let frame = frame.map(|frame| {
            let is_inverted = takes_negative(&told, &asked, &frame.matched.prepared.estimates);
            (frame, is_inverted)
        });
        Ok((frame, state, filter))
    })?;
    turns.0.map(|turn| turn.replace(state));
    turns.1.zip(filter).map(|(turn, filter)| turn.replace(filter));

    let (frame, is_inverted) = frame?;
    let (frame, said, time) = match second {
        Some(second) => {
            let images = kept.map(|inputs| (inputs, is_inverted));
            with_second(py, frame, &second, images, &pool)?
        }
        None => (frame, vec![], None),
    };
    let Frame { matched: whole, summary, is_reused, support } = frame.turned_back();
    let internals::match_pair::Matched { map, prepared, rectified } = whole;
    let Prepared { pair, estimates, .. } = prepared;
    let mut findings = findings::of_match(&estimates, &summary, pair.size());
    findings.extend(said);
    findings.sort_by_key(|one| Reverse(one.severity));
    let matched = Matched { map, summary, estimates, support, second: time, findings, rectified };

    let asked = Asked { settings, known, is_searched: search.is_some(), is_reused };
    objects::result(py, matched, &asked)
}

/// The cameras of pairs, from their images: matrices as in OpenCV, the expected error in rows, and sentences.
#[pyfunction]
fn rectify_pairs<'py>(
    py: Python<'py>,
    pairs: Vec<Both<'py>>,
) -> Result<(Bound<'py, PyDict>, f64, Vec<String>)> {
    let unmasked = py.None().into_bound(py);
    let masks = (unmasked.clone(), unmasked.clone());
    let read = pairs.iter().map(|images| read_any_images(images, &masks, None));
    let pairs = read.collect::<Result<Vec<Pair>>>()?;

    let pool = Pool::for_argument(&unmasked)?;
    let found = supervised(py, &pool, pairs.len(), None, move |runtime| rectify_views(&pairs, runtime))?;

    let matrices = objects::calibration(py, &found.cameras)?;
    Ok((matrices, found.error, findings::rectification(&found)))
}

/// The right image at the size of the left one, its mask, and the matrix that maps its pixels there.
#[pyfunction]
fn fit_right<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
) -> Result<(Object<'py>, Object<'py>, Object<'py>)> {
    let [left, right] = read_inputs(&images, &masks)?;
    let (fitted, matrix) = resized_right([&left, &right])?;
    let mask = fitted.mask.map(|mask| wrap(py, mask)).transpose()?;
    let mask = mask.map_or_else(|| py.None().into_bound(py), Bound::into_any);
    Ok((objects::pixels(py, fitted.image), mask, arr2(&matrix).into_pyarray(py).into_any()))
}

/// The estimates of a pair, without a match; if requested, of the rectified pair where a match would rectify
/// it.
#[pyfunction]
fn estimate_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    settings: Object<'py>,
    threads: &Bound<'py, PyAny>,
    self_rectify: bool,
) -> Result<Object<'py>> {
    let asked = read_settings(&settings)?;
    let search = read_search(&disparities)?;
    let pair = read_any_images(&images, &masks, search)?;

    let known = py.None().into_bound(py);
    let told = read_known(&known, pair.size(), search, None)?;

    let (pool, rows) = (Pool::for_argument(threads)?, pair.size().0);
    let estimates = supervised(py, &pool, rows, None, move |runtime| {
        if self_rectify {
            return diagnosed(pair, &told, &asked, runtime);
        }
        let (pair, estimates) = complete(pair, &told, &asked, runtime)?;
        Ok(findings::with_findings(estimates, &pair, &asked))
    })?;

    let is_searched = search.is_some();
    objects::estimates(py, estimates, &Asked { settings, known, is_searched, is_reused: false })
}

/// The estimates of a pair that is read by rows.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arguments that Python names")]
fn estimate_pair_by_rows<'py>(
    py: Python<'py>,
    read: Bound<'py, PyAny>,
    size: (usize, usize),
    disparities: Both<'py>,
    settings: Object<'py>,
    scale: &Scale,
    threads: &Bound<'py, PyAny>,
    known: Object<'py>,
    borders: [f64; 2],
    overlays: Vec<(usize, usize, usize, usize)>,
) -> Result<Object<'py>> {
    let asked = read_settings(&settings)?;
    let search = read_search(&disparities)?;
    let told = read_known(&known, size, search, None)?;
    let reader = Reader::new(read, size, search, scale)?;

    let pool = Pool::for_argument(threads)?;
    let as_overlay = |(top, bottom, left, right)| Overlay { rows: top..bottom, columns: left..right };
    let overlays: Vec<_> = overlays.into_iter().map(as_overlay).collect();
    let source = Arc::clone(&reader);
    let estimates = supervised(py, &pool, size.0, None, move |runtime| {
        let mut estimates = complete_source(&*source, &told, &asked, runtime)?;
        estimates.borders = borders;
        estimates.overlays = overlays;
        estimates.findings = findings::of_pair(&estimates, size, None, &asked);
        Ok(estimates)
    });

    let estimates = estimates.map_err(|failure| reader.reason(failure))?;
    let is_searched = search.is_some();
    objects::estimates(py, estimates, &Asked { settings, known, is_searched, is_reused: false })
}

/// How to convert a pair that is read by rows to gray; `images` and `masks` are the first row.
#[pyfunction]
fn find_scale(
    py: Python<'_>,
    images: Both<'_>,
    masks: Both<'_>,
    read: Bound<'_, PyAny>,
    size: (usize, usize),
    disparities: Both<'_>,
) -> Result<Scale> {
    let search = read_search(&disparities)?;
    let first = read_inputs(&images, &masks)?;
    check(first.each_ref())?;

    let reader = Reader::new(read, size, search, &Scale::default())?;
    let found = found_by_rows(py, size, &reader, move |source, runtime| {
        let read = |rows| source.inputs(rows);
        source::conversions(first.each_ref(), source, read, runtime.control)
    });
    Ok(found?.into())
}

/// The result of reading a pair of this size on one thread.
fn found_by_rows<T: Send + 'static>(
    py: Python<'_>,
    size: (usize, usize),
    reader: &Arc<Reader>,
    work: impl FnOnce(&Reader, Runtime<'_>) -> phasestereo::Result<T> + Send + 'static,
) -> Result<T> {
    let source = Arc::clone(reader);
    let found = supervised(py, &Pool::new(1)?, size.0, None, move |runtime| work(&source, runtime));
    found.map_err(|failure| reader.reason(failure))
}

/// The share of the black border of an image, and its runs.
type Side<'py> = (f64, Option<Bound<'py, PyArray1<u32>>>);

/// The black borders of a pair that is read by rows: for each image the share, and the lengths of the runs
/// from the top and the bottom, by column, and from the left and the right, by row; None: it has no border.
#[pyfunction]
fn find_borders<'py>(
    py: Python<'py>,
    read: Bound<'py, PyAny>,
    size: (usize, usize),
    disparities: Both<'py>,
) -> Result<Vec<Side<'py>>> {
    let reader = Reader::new(read, size, read_search(&disparities)?, &Scale::default())?;
    let found = found_by_rows(py, size, &reader, move |source, runtime| {
        let bands: Vec<_> = source::bands(source).collect();
        border::of_rows(size, &bands, |rows| {
            runtime.control.checkpoint()?;
            source.inputs(rows)
        })
    });
    let of_side = |found: Option<(border::Border, f64)>| {
        found.map_or((0.0, None), |(border, share)| (share, Some(border.runs.concat().into_pyarray(py))))
    };
    Ok(found?.map(of_side).into())
}

/// The overlays of a pair that is read by rows: for each one the first row and the one after the last, and
/// the same for its columns.
#[pyfunction]
fn find_overlays(
    py: Python<'_>,
    read: Bound<'_, PyAny>,
    size: (usize, usize),
    disparities: Both<'_>,
    scale: &Scale,
) -> Result<Vec<(usize, usize, usize, usize)>> {
    let reader = Reader::new(read, size, read_search(&disparities)?, scale)?;
    let found =
        found_by_rows(py, size, &reader, |source, runtime| overlay::overlays(source, runtime.control))?;
    let of_one = |Overlay { rows, columns }: Overlay| (rows.start, rows.end, columns.start, columns.end);
    Ok(found.into_iter().map(of_one).collect())
}

/// The roughness of a left image that is read by rows: a sum of differences, and their number.
#[pyfunction]
fn find_roughness(
    py: Python<'_>,
    read: Bound<'_, PyAny>,
    size: (usize, usize),
    disparities: Both<'_>,
    scale: &Scale,
    impulses: f64,
) -> Result<(u64, u64)> {
    let reader = Reader::new(read, size, read_search(&disparities)?, scale)?;
    let found = found_by_rows(py, size, &reader, move |source, runtime| {
        source::roughness(source, impulses, runtime.level(), runtime.control)
    });
    let Roughness { sum, pairs } = found?;
    Ok((sum, pairs))
}

/// The rows of the images on either side that a disparity depends on, and those added by masked rows.
#[pyfunction]
fn halo(
    settings: &Bound<'_, PyAny>,
    compensation: &Bound<'_, PyAny>,
    alignment: &Bound<'_, PyAny>,
) -> Result<(usize, usize)> {
    let settings = read_settings(settings)?;
    let compensation = read_blur_compensation(compensation)?;
    let field = read_alignment(alignment)?;

    let (compensation, alignment) = (compensation.as_ref(), field.as_ref());
    let halo = Halo::new(Plan { settings: &settings, compensation, alignment });
    Ok((halo.rows(), halo.masked))
}

/// The most bytes that `match_rows` takes for this many rows; `itemsize` is the bytes of a pixel, all
/// channels together.
#[pyfunction]
fn working_memory(
    statistics: &Bound<'_, PyAny>,
    rows: usize,
    threads: usize,
    itemsize: usize,
) -> Result<u64> {
    let whole = Statistics::read(statistics)?;
    let (_, cols): (usize, usize) = statistics.getattr("size")?.extract()?;
    let candidates: usize = whole.disparities.1.extract()?;

    let plan = Plan {
        settings: &whole.settings,
        compensation: whole.compensation.as_ref(),
        alignment: whole.alignment.as_ref(),
    };

    Ok(footprint::bytes(&Demand { plan, cols, candidates, pixel: itemsize, threads }, rows))
}

#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arguments that Python names")]
fn match_rows<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    statistics: &Bound<'py, PyAny>,
    first: usize,
    rows: (usize, usize),
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
) -> Result<Object<'py>> {
    let whole = Statistics::read(statistics)?;
    if whole.tally.is_none() && whole.settings.needs_confidence() {
        let accepts = "the tally of the whole pair, with these settings";
        return Err(Error::value("tally", "None", accepts).into());
    }

    let part = PartOfPair::new(&images, &masks, whole, first, rows)?;
    let found = part.matched(py, threads, progress, Matcher::match_rows)?;
    objects::result_of_rows(found, statistics)
}

/// Sums over rows of a map that its confidences depend on: confidences in steps, their number,
/// pixels that failed, those at the ends of the range, all.
type TallyTuple = (u64, u64, u64, u64, u64);

/// The rows that are tallied in a pair of this height.
#[pyfunction]
fn rows_to_tally(height: usize) -> Vec<(usize, usize)> {
    sampled(height).into_iter().map(|rows| (rows.start, rows.end)).collect()
}

/// Like `match_rows`, with uncalibrated confidences, and the sums over them.
#[pyfunction]
fn match_raw<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    statistics: &Bound<'py, PyAny>,
    first: usize,
    rows: (usize, usize),
    threads: &Bound<'py, PyAny>,
) -> Result<(Object<'py>, TallyTuple)> {
    let whole = Statistics::read(statistics)?;
    let part = PartOfPair::new(&images, &masks, whole, first, rows)?;
    let candidates = part.pair.candidates();
    let found = part.matched(py, threads, None, Matcher::match_raw)?;

    let confidence = found.confidence.as_ref().map_or(&[][..], Plane::as_slice);
    let (disparity, flags) = (found.disparity.as_slice(), found.flags.as_slice());
    let Tally { confidence, own, failed, ends, pixels } =
        Tally::new(confidence, disparity, flags, candidates);

    let tally = (confidence, own, failed, ends, pixels);
    Ok((objects::result_of_rows(found, statistics)?, tally))
}

/// Rows of a pair, and those around them, that are matched by themselves.
struct PartOfPair {
    pair: Pair,
    compensation: Option<BlurCompensation>,
    field: Option<Alignment>,
    section: Section,
    settings: Settings,
}

/// A way to match some rows of a pair.
type MatchRows =
    fn(&Matcher, &Pair, &Section, &Settings, Execution, &Control) -> phasestereo::Result<Disparity>;

impl PartOfPair {
    /// The rows `rows` of a whole pair; the images begin at row `first`.
    fn new(
        images: &Both<'_>,
        masks: &Both<'_>,
        whole: Statistics<'_>,
        first: usize,
        rows: (usize, usize),
    ) -> Result<Self> {
        let inputs = read_inputs(images, masks)?;
        check(inputs.each_ref())?;
        let (min, count) = read_range(&whole.disparities)?;
        let pair = Pair::converted(inputs, whole.conversions, min, count)?;
        let compensation = whole.compensation;

        let section = Section {
            rows: rows.0.saturating_sub(first)..rows.1.saturating_sub(first),
            roughness: whole.roughness,
            ranges: None,
            tally: whole.tally,
            first,
        };

        Ok(Self {
            pair: if whole.is_inverted { pair.inverted() } else { pair },
            compensation: compensation.map(|found| found.starting_at_row(first)),
            field: whole.alignment.map(|field| field.starting_at_row(first)),
            section,
            settings: whole.settings,
        })
    }

    fn matched(
        self,
        py: Python<'_>,
        threads: &Bound<'_, PyAny>,
        progress: Option<Bound<'_, PyAny>>,
        by: MatchRows,
    ) -> Result<Disparity> {
        let Self { pair, compensation, field, section, settings } = self;

        let pool = Pool::for_argument(threads)?;
        // Progress counts the matched rows, which are more than those requested.
        let plan = Plan { settings: &settings, compensation: compensation.as_ref(), alignment: None };
        let halo = Halo::new(plan).map;
        let chosen = widened(&section.rows, halo, pair.size().0).len();
        supervised(py, &pool, chosen, progress, move |runtime| {
            let Runtime { matcher, execution, control } = runtime;
            let level = execution.level;
            let pair = matcher.install(|| -> phasestereo::Result<Pair> {
                let pair = pair.with_blur_compensation(compensation, level, control)?;
                match &field {
                    Some(field) => pair.straightened(field, level, control),
                    None => Ok(pair),
                }
            })?;
            by(matcher, &pair, &section, &settings, execution, control)
        })
    }
}

#[pyfunction]
fn descriptor<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    mask: &Bound<'py, PyAny>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyAny>> {
    let settings = read_settings(settings)?;
    let noise = read_noise(noise)?;
    let input = read_input(image, mask, "image")?;
    input.check("image")?;
    let rows = input.size().0;

    let codes = supervised(py, &Pool::for_argument(threads)?, rows, None, move |runtime| {
        let Runtime { execution: Execution { level, .. }, control, .. } = runtime;
        describe(&Gray::of_view(&view_of_input(input)?), &settings, noise, level, control)
    })?;

    Ok(match codes {
        Codes::U16(codes) => wrap(py, codes)?.into_any(),
        Codes::U32(codes) => wrap(py, codes)?.into_any(),
        Codes::U64(codes) => wrap(py, codes)?.into_any(),
    })
}

#[pyfunction]
fn cost_volume<'py>(
    py: Python<'py>,
    images: Both<'py>,
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    compensation: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyArray3<u16>>> {
    let settings = read_settings(settings)?;
    let none = py.None().into_bound(py);
    let pair = read_pair(&images, &(none.clone(), none), &disparities)?;
    let compensation = read_blur_compensation(compensation)?;

    let ((rows, cols), count) = (pair.size(), pair.candidates().count());
    let costs = supervised(py, &Pool::for_argument(threads)?, rows, None, move |runtime| {
        let Runtime { execution: Execution { level, .. }, control, .. } = runtime;
        let pair = pair.with_blur_compensation(compensation, level, control)?;
        let (views, candidates) = (pair.views(), pair.candidates());
        let costs = Costs::new(views, candidates, &settings, pair.blur_compensation(), level, control)?;
        costs.volume(rows, level, control)
    })?;

    let array = Array3::from_shape_vec((rows, cols, count), costs.into_vec());
    Ok(array.map_err(internal)?.into_pyarray(py))
}

#[pyfunction]
fn aggregate_volume<'py>(
    py: Python<'py>,
    costs: &Bound<'py, PyArray3<u16>>,
    settings: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyArray3<u32>>> {
    let settings = read_settings(settings)?;
    let (costs, (rows, cols, count)) = read_volume(costs, "costs")?;
    let window = Window::new((rows, cols), count, &settings, u16::MAX);

    let aggregated = supervised(py, &Pool::new(1)?, rows, None, move |runtime| {
        aggregate(&costs, window, runtime.level(), runtime.control)
    })?;

    let array = Array3::from_shape_vec((rows, cols, count), aggregated.into_vec());
    Ok(array.map_err(internal)?.into_pyarray(py))
}

#[pyfunction]
fn optimize_volume<'py>(
    py: Python<'py>,
    costs: &Bound<'py, PyArray3<u32>>,
    settings: &Bound<'py, PyAny>,
    p1: u64,
    p2: u64,
) -> Result<Bound<'py, PyArray2<u16>>> {
    let settings = read_settings(settings)?;
    let (costs, (rows, _, count)) = read_volume(costs, "costs")?;
    let penalties = Penalties { p1, p2 };

    let chosen = supervised(py, &Pool::new(1)?, rows, None, move |runtime| {
        optimize(&costs, count, settings.optimizer, penalties, runtime.level(), runtime.control)
    })?;

    wrap(py, chosen)
}

fn wrap<T: Element>(py: Python<'_>, plane: Plane<T>) -> Result<Bound<'_, PyArray2<T>>> {
    let (rows, cols) = plane.size();
    Ok(Array2::from_shape_vec((rows, cols), plane.into_vec()).map_err(internal)?.into_pyarray(py))
}

/// An exception for a case that cannot happen, which asks for a report; instead of a panic.
fn internal(fault: impl std::fmt::Display) -> Failure {
    PyRuntimeError::new_err(format!("internal error, please report it: {fault}")).into()
}
