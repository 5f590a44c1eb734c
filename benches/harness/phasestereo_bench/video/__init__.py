"""Measures the accuracy and steadiness of a stream's maps, and its reaction time, on videos."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import phasestereo_live as live
from phasestereo.metrics import bad_pixels, end_point_error, temporal_deviation
from phasestereo.settings import PRESETS
from phasestereo_bench.rendering.sequences import MOTIONS, Shot, render_sequence
from phasestereo_bench.report.tables import Entry, Table

__all__ = ["Steadiness", "compared", "steadiness", "steadiness_table"]

_COUNT = 32  # disparities to search in `render_sequence`


@dataclass(frozen=True, slots=True, kw_only=True)
class Steadiness:
    """The scores of one sequence, matched in one way.

    Parameters
    ----------
    bad_1, avgerr
        % of the non-occluded pixels that are more than 1 px off, and mean error in px: means of the
        frames.
    deviation
        `phasestereo.metrics.temporal_deviation` of the pixels with the same truth in all frames,
        px; None without any.
    edges
        % of the non-occluded pixels near the outline of the moving object that are more than 1 px
        off, mean of the frames; None if nothing moves.
    """

    bad_1: float
    avgerr: float
    deviation: float | None
    edges: float | None


def compared(
    presets: Sequence[str], noise: float, seed: int = 0
) -> Iterator[tuple[str, str, Steadiness, Steadiness]]:
    """Match every sequence with every preset, frame by frame and as a stream.

    Yields
    ------
    tuple
        The motion, the preset, and the numbers without and with the temporal filter.
    """
    for motion in MOTIONS:
        shots = list(render_sequence(motion, seed, noise=noise, num_disparities=_COUNT))
        for preset in presets:
            alone, filtered = (
                steadiness(shots, _matched(shots, preset, temporal_filter=used))
                for used in (False, True)
            )
            yield motion, preset, alone, filtered


def steadiness(shots: Sequence[Shot], maps: Sequence[NDArray[np.float32]]) -> Steadiness:
    """Score the maps of a sequence, one for each frame."""
    pairs = list(zip(shots, maps, strict=True))
    static = np.ptp([shot.truth for shot in shots], axis=0) == 0

    outlines = [shot.outline & shot.nonocc for shot in shots]
    edges = [
        bad_pixels(found, shot.truth, 1, outline)
        for (shot, found), outline in zip(pairs, outlines, strict=True)
        if outline.any()
    ]

    return Steadiness(
        bad_1=_mean([bad_pixels(found, shot.truth, 1, shot.nonocc) for shot, found in pairs]),
        avgerr=_mean([end_point_error(found, shot.truth, shot.nonocc) for shot, found in pairs]),
        deviation=temporal_deviation(maps, static) if static.any() else None,
        edges=_mean(edges) if edges else None,
    )


def steadiness_table(
    rows: Sequence[tuple[str, str, Steadiness, Steadiness]],
) -> Table:
    """Return sequences and presets down, the numbers across: without -> with the filter."""
    headings = ("sequence", "preset", "bad-1.0, %", "avgerr, px", "deviation, px")

    entries = [
        (
            Entry(motion),
            Entry(preset),
            _arrow(alone.bad_1, filtered.bad_1, 2),
            _arrow(alone.avgerr, filtered.avgerr, 3),
            _arrow(alone.deviation, filtered.deviation, 3, ratio=True),
            _arrow(alone.edges, filtered.edges, 2),
        )
        for motion, preset, alone, filtered in rows
    ]

    return Table((*headings, "at moving edges, %"), tuple(entries), labels=2)


def _arrow(
    alone: float | None, filtered: float | None, digits: int, *, ratio: bool = False
) -> Entry:
    if alone is None or filtered is None:
        return Entry("-")

    share = f" (x {filtered / alone:.2f})" if ratio and alone else ""
    return Entry(f"{alone:.{digits}f} -> {filtered:.{digits}f}{share}")


def _matched(
    shots: Sequence[Shot], preset: str, *, temporal_filter: bool
) -> list[NDArray[np.float32]]:
    """Return the maps of a stream; estimate blur in every frame, so only one thing differs."""
    pairs = [(shot.left, shot.right) for shot in shots]

    frames = live.stream(
        pairs,
        num_disparities=_COUNT,
        settings=PRESETS[preset],
        reestimate=1,
        temporal_filter=temporal_filter,
        on_error=_refuse,
    )

    return [frame.result.disparity for frame in frames]


def _refuse(failure: live.Failure) -> None:
    """Raise on a failed frame, so the means leave out no frame."""
    raise failure.error


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
