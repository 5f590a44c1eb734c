"""Check, render and write the page, whole or not at all."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phasestereo._extras import require
from phasestereo._images import (
    Map,
    Mask,
    Pixels,
    as_alike,
    as_mask,
    as_numbers,
    on_screens,
    screen_range,
)
from phasestereo._numbers import check_type
from phasestereo.io import Calibration
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath
from phasestereo.metrics.scores import score as score_map
from phasestereo.result import Keep, Result
from phasestereo.views.depths import YAW, Anchor, Selection, ranging
from phasestereo.views.page import facts, layers
from phasestereo.views.page.embedding import photograph_uri
from phasestereo.views.page.scene import ScenePoints, scene_points
from phasestereo.views.templating import check_page_path, render_page

MOST_PIXELS = 2_100_000
"""Maps of more pixels, that is beyond Full HD, are thinned out: a page has to open at once."""

MOST_EXACT = 400_000
"""Pictures of more pixels are compressed with loss: they are most of what a page takes."""


def write_pair_page(
    path: StrPath,
    left: ArrayLike,
    right: ArrayLike,
    result: Result,
    *,
    truth: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    calibration: Calibration | None = None,
    keep: Keep = "trusted",
    min_depth: float | None = None,
    max_depth: float | None = None,
    yaw: float = YAW,
    anchor: Anchor | None = None,
    min_disparity: int = 0,
    num_disparities: int | None = None,
    title: str = "Stereo pair",
) -> None:
    """Write a page that shows a result: one HTML file, which needs no network.

    It has the pair to flick between, disparities, confidences, error bars, flags and errors with
    their values under the cursor, the diagnosis of the blur, metrics, settings and times, and the
    points in three dimensions. It needs a browser of 2023 or later. It gives disparities to
    1/128 px, or as fine as 16 bits allow. For maps of more than 2.1 million pixels, beyond Full HD,
    it shows every n-th pixel of every n-th row, with the values of just these, and says so.

    Parameters
    ----------
    path
        The file: ``.html`` or ``.htm``.
    left, right
        The images, as `phasestereo.match` takes them. Intensities of other types than uint8 are
        stretched for the screen.
    result
        The result of `match` for them.
    truth
        Floats (H, W), the true disparities; NaN or infinite = unknown.
    mask
        bool (H, W), the pixels to score; None: all whose truth is known.
    calibration
        Geometry of the points; without one the page draws them as if the focal length were the
        images' width and the cameras one unit apart, and says so.
    keep
        Which points the page shows at first, as `phasestereo.point_cloud` takes it; readers can
        choose all others there.
    min_depth
        Leaves out points nearer than this, in the unit of the baseline; None: no limit.
    max_depth
        Leaves out points farther than this, in the unit of the baseline; None: those beyond 1.5
        times the 90th percentile of the depths.
    yaw, anchor
        The accuracy of the calibration, as `phasestereo.depth_interval` takes them.
    min_disparity, num_disparities
        The searched range, which the page then names; None: it does not.
    title
        Heading of the page.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If the suffix is different, sizes differ, or nothing remains to score; if you pass a mask
        and no truth.
    OSError
        If the file cannot be written.
    ImportError
        If the extra ``report`` is not installed.
    """
    check_page_path(path)
    for module in ("jinja2", "matplotlib", "PIL"):
        require(module, extra="report")

    pair = as_alike(left, right)
    size = pair[0].shape[:2]
    known, counted = _checked(size, result, truth, mask)
    shown = _Shown(pair, result, known, counted, _step(size))
    selection = Selection(keep=keep, min_depth=min_depth, max_depth=max_depth)

    geometry = None
    if calibration is not None:
        geometry = ranging(
            result.disparity,
            calibration,
            uncertainty=result.uncertainty,
            yaw=yaw,
            anchor=anchor,
        )
    scene = scene_points(
        result.disparity, geometry, step=shown.step, min_depth=min_depth, max_depth=max_depth
    )
    search = None if num_disparities is None else (min_disparity, num_disparities)
    context = _context(shown, scene, search) | {"keep": selection.keep}
    page = render_page("pair.html.j2", title=str(title), **context)
    # Show names of files that are not UTF-8 as the terminal does.
    replace_text(path, page, errors="backslashreplace")


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """The content of the page, and the step between shown pixels."""

    pair: tuple[Pixels, Pixels]
    result: Result
    truth: Map | None
    mask: Mask | None
    step: int


def _checked(
    size: tuple[int, ...], result: Result, truth: ArrayLike | None, mask: ArrayLike | None
) -> tuple[Map | None, Mask | None]:
    """Return truth and mask as arrays, if everything has the size of the images."""
    check_type("result", result, Result, "a Result")
    if result.disparity.shape != size:
        raise ValueError(f"result: got {result.disparity.shape} pixels; accepts the images' {size}")

    counted = as_mask(mask, size, "mask")
    if truth is None:
        if counted is not None:
            raise ValueError("mask: has no effect without truth; accepts None then")
        return None, None

    return as_numbers(truth, "truth", "f", size).astype(np.float32), counted


def _step(size: tuple[int, ...]) -> int:
    """Return the smallest step that leaves no more pixels than a page shows."""
    return next(
        step for step in count(1) if -(-size[0] // step) * -(-size[1] // step) <= MOST_PIXELS
    )


def _context(shown: _Shown, scene: ScenePoints, search: tuple[int, int] | None) -> dict[str, Any]:
    """Return all names that the template refers to."""
    result, truth = shown.result, shown.truth
    scored = None if truth is None else facts.scored_pixels(truth, shown.mask)
    score = None if truth is None else score_map(result.disparity, truth, mask=shown.mask)
    kinds = layers.flag_kinds(result.flags)

    # Show every n-th pixel of large maps; keep small pictures to the bit.
    thin = (slice(None, None, shown.step), slice(None, None, shown.step))
    dtypes = {image.dtype for image in shown.pair}
    is_plain = dtypes == {np.dtype(np.uint8)}
    ends = screen_range(shown.pair) if len(dtypes) == 1 and not is_plain else None
    is_small = shown.pair[0][thin][:, :, 0].size <= MOST_EXACT
    left, right = (
        photograph_uri(picture, exact=is_small)
        for picture in on_screens([image[thin] for image in shown.pair])
    )

    codings = layers.codings_of(result, truth)
    maps = layers.layers_of(result, truth)
    views = layers.views(maps)
    charts = facts.charts(result, truth, scored)
    gray = shown.pair[0].shape[2] == 1, shown.pair[1].shape[2] == 1
    rows, cols = result.disparity.shape

    return {
        "views": views,
        "charts": facts.chart_titles(charts),
        "readout": facts.readout(
            result, truth, exact=is_plain and is_small, metric=not scene.nominal, gray=gray
        ),
        "rows": rows,
        "cols": cols,
        "step": shown.step,
        "left": left,
        "right": right,
        "ends": ends,
        "scene": scene,
        "search": search,
        "kinds": kinds,
        "findings": result.findings,
        "verdict": result.verdict,
        "metric_bars": result.uncertainty is not None,
        "trusted": 100 * float(result.trusted.mean()),
        "unflagged": 100 * float((result.flags == 0).mean()),
        "seconds": sum(result.timings.values()),
        "score": score,
        "metrics": [] if score is None else facts.metric_rows(score),
        "settings": facts.setting_rows(result.settings),
        "preset": facts.preset_of(result.settings),
        "timings": facts.timing_rows(result.timings),
        "versions": facts.versions(),
        "blur": None if result.blur is None else facts.blur_facts(result.blur, (rows, cols)),
        "arrays": layers.arrays_of(result, truth, scored, shown.step, codings),
        "page": {
            "cols": -(-cols // shown.step),
            "rows": -(-rows // shown.step),
            "step": shown.step,
            "exact": is_plain and is_small,
            "gray": dict(zip(("left", "right"), gray, strict=True)),
            "views": views,
            "layers": [asdict(layer) for layer in maps],
            "flags": [asdict(kind) for kind in kinds],
            "charts": charts,
            "codings": {name: [coding.low, coding.step] for name, coding in codings.items()},
            "scene": scene.described(),
        },
    }
