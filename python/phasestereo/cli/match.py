"""``phasestereo match``: makes a disparity map from two image files."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from phasestereo.cli.errors import refusals, refuse_untrusted, show_findings, wrong
from phasestereo.cli.geometry import GeometryOptions
from phasestereo.cli.options import (
    AT_LEAST_ONE,
    PRESET_HELP,
    REASONABLE,
    SETTINGS_HELP,
    Bands,
    Count,
    Overrides,
    Threads,
)
from phasestereo.cli.outputs import Outcome, Outputs, rehearsal
from phasestereo.cli.pairing import OPTIONS, Pairing, names_of, read_both, read_masks
from phasestereo.cli.scoring import Scoring
from phasestereo.cli.summary import show
from phasestereo.cli.terminal import progress_bar
from phasestereo.known import Known
from phasestereo.matching import match as match_pair
from phasestereo.rectification import Rectification
from phasestereo.result import Result
from phasestereo.rig.findings import Finding, denies_depths, unwarned
from phasestereo.settings import PRESET, Settings, resolve

_USUAL, _MOST_USUAL = 10, 200  # the most a disparity usually is: width / 10, and 200 pixels
_VALUES = {"bands", "preset", "num_disparities", "min_disparity", "threads", "device", "noise"}
_VALUES |= {"second", "timeout"}
_NO_DEPTHS = (
    "depths and points are wrong, since disparities of this pair are not a depth: give a "
    "rectified pair, or --rectify with a calibration"
)
_OPTIONS = (_VALUES | OPTIONS).union(field.name for field in fields(Settings))

# The order in help: options that every match needs come first.
_OUTPUT = Group.create_ordered("Output")
_SEARCH = Group.create_ordered("Search")
_PAIR = Group.create_ordered("Pair")
_GEOMETRY = Group.create_ordered("Geometry", help="For --ply, --mesh, --depth and --report.")
_SCORE = Group.create_ordered("Score")
_SETTINGS = Group.create_ordered("Expert settings", help=SETTINGS_HELP)
# Pages show disparities along rows.
_NO_PAGE = "no page is written: got cameras one above the other; accepts cameras side by side"
_OUTPUTS, _NO_GEOMETRY, _SCORING = Outputs(), GeometryOptions(), Scoring()
_AS_IT_IS = Pairing()


def match(
    left: Path,
    right: Path | None = None,
    /,
    *,
    pairing: Annotated[Pairing, Parameter(name="*", group=_PAIR)] = _AS_IT_IS,
    num_disparities: Annotated[Count, Parameter(group=_SEARCH, validator=AT_LEAST_ONE)] = None,
    min_disparity: Annotated[int, Parameter(group=_SEARCH, validator=REASONABLE)] = 0,
    preset: Annotated[str, Parameter(group=_SEARCH, help=PRESET_HELP)] = PRESET,
    left_mask: Annotated[Path | None, Parameter(group=_SEARCH)] = None,
    right_mask: Annotated[Path | None, Parameter(group=_SEARCH)] = None,
    bands: Annotated[Bands | None, Parameter(group=_SEARCH)] = None,
    threads: Annotated[Threads, Parameter(group=_SEARCH)] = None,
    device: Annotated[str, Parameter(group=_SEARCH)] = "cpu",
    noise: Annotated[float | None, Parameter(group=_SEARCH)] = None,
    second: Annotated[str | None, Parameter(group=_SEARCH)] = None,
    timeout: Annotated[float | None, Parameter(group=_SEARCH)] = None,
    strict: Annotated[bool, Parameter(group=_SEARCH, negative=())] = False,
    outputs: Annotated[Outputs, Parameter(name="*", group=_OUTPUT)] = _OUTPUTS,
    geometry: Annotated[GeometryOptions, Parameter(name="*", group=_GEOMETRY)] = _NO_GEOMETRY,
    scoring: Annotated[Scoring, Parameter(name="*", group=_SCORE)] = _SCORING,
    overrides: Annotated[Overrides | None, Parameter(name="*", group=_SETTINGS)] = None,
) -> None:
    """Match a rectified stereo pair.

    The left image is the reference: its pixel (x, y) corresponds to (x - d, y) in the right one.
    Without an output, it only prints the summary. For example:

    ```
    phasestereo match left.png right.png -o out.pfm
    ```

    Parameters
    ----------
    left
        Left image, or a stereo photograph that holds both views. PNG, JPEG, WebP, HEIF,
        PBM/PGM/PPM, BMP, TIFF, .npy or PFM; gray or color.
    right
        Right image; may differ in size and type.
    num_disparities
        Number of disparities to search, or auto, which finds them. 1 to the images' width; auto
        takes the ndisp of --calib, or else a range found in the images.
    min_disparity
        Smallest disparity to search.
    left_mask
        Image as large as the left image, non-zero at valid pixels.
    right_mask
        The same for the right image.
    bands
        Number of the band of GeoTIFF images to match, or 3,2,1 for red, green and blue.
    threads
        Number of threads; default: one per processor.
    device
        Device that searches: cpu, gpu, auto (a GPU if there is one), or part of the name of an
        adapter that `doctor` lists. The map is the same.
    noise
        Standard deviation of the images' noise, in units of their pixels; needed with
        --noise-threshold.
    second
        A second matcher: sgbm, bm, or onnx:net.onnx, a network. It matches the pair as `prepare`
        makes it; its disparity is used where it is more likely right. If it fails, the match stays
        as it is, with a warning.
    timeout
        Time limit of the second matcher, in seconds.
    strict
        Exit with 3 if you should not trust match or depths. It still writes files.
    """
    scoring.check()
    geometry.check(wanted=outputs.use_geometry())

    with refusals(options=_OPTIONS):
        settings = resolve(preset, None, overrides or {})

    sources = [left, right, left_mask, right_mask, *scoring.sources(), *pairing.sources()]
    sources += geometry.sources()
    with refusals(options=_OPTIONS):
        masks = read_masks(left_mask, right_mask)
        raw = read_both(left, right, layout=pairing.layout, bands=bands)
        views, rectified = pairing.straight(raw, masks)
        images = views[0].image, views[1].image
        truth = scoring.read(images[0].shape[:2])

        vertical = pairing.vertical
        if vertical is None and rectified is not None:
            vertical = rectified.vertical
        if vertical and outputs.report:
            raise wrong("report", _NO_PAGE)
        rig = geometry.read(images[0].shape[:2], rectified, views[0].focal)

        num_disparities = num_disparities or (None if rig is None else rig.calibration.ndisp)
        if num_disparities is None:
            # Before the search finds the range, try files with a disparity that has a depth.
            usual = min(images[0].shape[1] // _USUAL, _MOST_USUAL)
            disparities = min_disparity if rig is None else max(rig.farthest(), usual), 1
        else:
            disparities = min_disparity, num_disparities
            if rig is not None:
                rig.check(disparities)

    outputs.check(sources, rehearsal(disparities, settings, rig))

    with refusals(options=_OPTIONS), unwarned(), progress_bar("Matching") as progress:
        result = match_pair(
            *images,
            num_disparities=num_disparities,
            min_disparity=min_disparity,
            settings=settings,
            threads=threads,
            device=device,
            left_mask=views[0].mask,
            right_mask=views[1].mask,
            progress=progress,
            known=Known(noise=noise),
            vertical=vertical,
            second=second,
            timeout=timeout,
        )

    without_page = outputs.report is not None and result.vertical
    if without_page:  # the match itself has found it out, and the map is right
        outputs = replace(outputs, report=None)
    if result.search is not None:
        disparities = result.search.min_disparity, result.search.num_disparities

    result = _doubted(result, rectified, with_depths=rig is not None and outputs.use_geometry())
    show_findings(result.findings)

    with refusals():
        if rig is not None:
            rig.check(disparities)
        score = None if truth is None else truth.score(result.disparity)
        place, names = views[0].place, names_of(left, right)
        outcome = Outcome(images, result, disparities, truth, score, rig, place, names, rectified)
        written = outputs.write(outcome)

    show(outcome, written, as_json=outputs.json)
    if without_page:
        raise wrong("report", _NO_PAGE)
    if strict:
        refuse_untrusted(result.findings)


def _doubted(result: Result, rectified: Rectification | None, *, with_depths: bool) -> Result:
    """Return the result with warnings first, if its cameras are not those of the geometry."""
    said = list(rectified.sentences[:1] if rectified is not None and rectified.refuted else ())
    if with_depths and denies_depths(result.findings):
        said.append(_NO_DEPTHS)
    doubts = [Finding("match", "warning", sentence) for sentence in said]
    return replace(result, findings=(*doubts, *result.findings))
