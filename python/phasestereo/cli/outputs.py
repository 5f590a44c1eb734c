"""The result of ``phasestereo match`` and its output files, which are checked before the match."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from phasestereo.cli.errors import claim
from phasestereo.cli.geometry import Rig
from phasestereo.cli.rehearsing import rehearse
from phasestereo.cli.scoring import Truth
from phasestereo.cli.terminal import say
from phasestereo.io import write_depth, write_glb, write_image, write_maps, write_ply
from phasestereo.io.depth import FARTHEST, meters_in
from phasestereo.io.results import write_map
from phasestereo.metrics import Score
from phasestereo.rectification import Rectification
from phasestereo.result import LAYERS, Result
from phasestereo.settings import Settings
from phasestereo.views.depths import YAW, Selection
from phasestereo.views.page import write_pair_page
from phasestereo.views.picture import disparity_picture

Image = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A result, its pair, and its score.

    Parameters
    ----------
    pair
        The left and the right image.
    result
        The result.
    disparities
        The smallest disparity searched, and the number of disparities.
    truth, score
        The true disparities, if any, and the metrics against them.
    rig
        The geometry of the pair, if it is known.
    place
        The position of the left image on Earth, if its file has one.
    names
        The names of the image files.
    rectified
        The pair's rectification, if it was rectified.
    """

    pair: tuple[Image, Image]
    result: Result
    disparities: tuple[int, int]
    truth: Truth | None = None
    score: Score | None = None
    rig: Rig | None = None
    place: Any = None
    names: tuple[str, str] = ("left", "right")
    rectified: Rectification | None = None


def rehearsal(disparities: tuple[int, int], settings: Settings, rig: Rig | None = None) -> Outcome:
    """Return the smallest outcome that has both the smallest and the largest disparity."""
    low, count = disparities
    high = low + count - 1
    extremes = np.array([[low, low, high, high]] * 2, dtype=np.float32)  # each is a surface
    black = np.zeros(extremes.shape, dtype=np.uint8)
    flags = np.zeros(extremes.shape, dtype=np.uint16)
    ones = np.ones_like(extremes) if settings.confidence else None

    result = Result(extremes, flags, ones, settings, {"matching": 0.0}, uncertainty=ones)

    small = None if rig is None else rig.of_size(extremes.shape)
    return Outcome((black, black), result, disparities, rig=small)


Writer = Callable[[Path, Outcome], None]

_PICTURES = frozenset([".jpg", ".jpeg", ".webp", ".bmp"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """The files to write the disparities to.

    Parameters
    ----------
    output
        File for the disparities in pixels: .pfm, .npy, .tif, .png, .npz. A .tif keeps the
        georeference of the left image, a .png uses KITTI's format (16 bits, 256 d), a .npz holds
        all maps by name: disparity, flags, confidence, uncertainty.
    flags_output
        File for the flags, 16 bits: .tif, .npy, .png.
    confidence_output
        File for the confidences, 0 to 1: .tif, .npy, .pfm.
    uncertainty_output
        File for the error bars in pixels: half the width of the interval that holds the true
        disparity with a probability of 90 %. .tif, .npy, .pfm.
    color
        Image file for the disparities in color, with a scale. Untrusted pixels are hatched; pixels
        without an estimate are gray. Needs the extra ``plot``.
    ply
        File for the points in space, with colors and error bars: .ply. Binary; X right, Y down, Z
        forward, and the nearest and farthest depth of the error bar, in the unit of the baseline.
        Needs a geometry.
    mesh
        File for the surface, textured with the left image: .glb. It stands upright in viewers (glTF
        2.0), and ends where disparities jump. Needs a geometry and the extra ``mesh``.
    depth
        File for the depths: .png, .tif, .pfm, .npy, .npz, .bin. A .png has 16 bits, 0 for no depth,
        in mm or by ``--depth-scale``; the others use the unit of the baseline. A .npz holds depth,
        near and far, the ends of the error bars; a .bin is COLMAP's. Needs a geometry.
    report
        HTML file that shows the pair, its map and points in space. All layers show their values;
        any browser opens it, without a network. Points are to scale with a geometry. Needs the
        extra ``report``.
    json
        Print one JSON object on standard output. It has size, settings, timings, flags, metrics,
        files.
    """

    output: Annotated[Path | None, Parameter(alias="-o")] = None
    flags_output: Path | None = None
    confidence_output: Path | None = None
    uncertainty_output: Path | None = None
    color: Path | None = None
    ply: Path | None = None
    mesh: Path | None = None
    depth: Path | None = None
    report: Path | None = None
    json: Annotated[bool, Parameter(negative=(), show_default=False)] = False

    def use_geometry(self) -> bool:
        """Return whether any output depends on the geometry of the pair."""
        return bool(self.ply or self.mesh or self.depth or self.report)

    def check(self, sources: Iterable[Path | None], rehearsal: Outcome) -> None:
        """Refuse files that cannot or must not be written.

        Parameters
        ----------
        sources
            The files that are read.
        rehearsal
            A small outcome with the extremes of the possible results.

        Raises
        ------
        CommandError
            If a file is a source, is given twice, is a folder, is in a folder that cannot be
            written to, or is in a format that cannot hold all disparities.
        """
        files = self._files()
        claim([(name, path) for name, path, _ in files], sources)
        for name, path, write in files:
            rehearse(name, path, write, rehearsal)

    def write(self, outcome: Outcome) -> dict[str, str]:
        """Write the requested files; return their paths by option."""
        for _, path, write in self._files():
            write(path, outcome)
        if self.depth and self.depth.suffix.lower() == ".png":
            _note_lost(outcome)
        if self.output and self.output.suffix.lower() == ".png" and not self.color:
            say(f"note: {self.output} has 256 d in 16 bits, which viewers show dark: see --color")
        return {name: str(path) for name, path, _ in self._files()}

    def _files(self) -> list[tuple[str, Path, Writer]]:
        files: list[tuple[str, Path | None, Writer]] = [
            ("output", self.output, _write_output),
            *(
                (f"{of}_output", getattr(self, f"{of}_output"), partial(_write_layer, layer=of))
                for of in LAYERS
            ),
            ("color", self.color, _write_color),
            ("ply", self.ply, lambda to, it: write_ply(to, _rig(it).points(it.result, it.pair[0]))),
            (
                "mesh",
                self.mesh,
                lambda to, it: write_glb(to, _rig(it).surface(it.result, it.pair[0])),
            ),
            ("depth", self.depth, _write_depth),
            ("report", self.report, _write_report),
        ]
        return [(name, path, write) for name, path, write in files if path]


def _write_output(path: Path, outcome: Outcome) -> None:
    if (suffix := path.suffix.lower()) in _PICTURES:
        raise ValueError(
            f"got {suffix}; accepts .pfm, .npy, .tif, .png, .npz; see --color for pictures"
        )
    if path.suffix.lower() == ".npz":
        write_maps(path, outcome.result.maps)
    else:
        _write_layer(path, outcome, "disparity")


def _write_layer(path: Path, outcome: Outcome, layer: str) -> None:
    values = outcome.result.maps.get(layer)
    if values is None:
        raise ValueError("got a file, and settings that work none out; needs --confidence")
    write_map(path, layer, values, outcome.place)


def _write_color(path: Path, outcome: Outcome) -> None:
    result = outcome.result
    picture = disparity_picture(result.disparity, title=result.verdict, trusted=result.trusted)
    write_image(path, picture)


def _write_depth(path: Path, outcome: Outcome) -> None:
    rig = _rig(outcome)
    unit = rig.calibration.unit
    if unit is None and path.suffix.lower() == ".png":
        raise ValueError(
            "a .png is in units of a meter: give --unit mm, cm or m, that of the baseline"
        )

    maps = rig.depths(outcome.result)
    if path.suffix.lower() == ".npz":
        write_maps(path, maps)
    else:
        write_depth(path, maps["depth"], unit=unit, depth_scale=rig.depth_scale)


def _note_lost(outcome: Outcome) -> None:
    """Report the number of depths too far for a .png, where they become 0."""
    rig = _rig(outcome)
    per_unit = meters_in(rig.calibration.unit or "m") * rig.depth_scale
    share = np.mean(rig.depths(outcome.result)["depth"] * per_unit >= FARTHEST)
    if share:
        end = FARTHEST / rig.depth_scale
        say(f"note: {share:.1%} of the pixels are beyond {end:.1f} m, where a .png has 0; see .tif")


def _write_report(path: Path, outcome: Outcome) -> None:
    low, count = outcome.disparities
    truth, rig = outcome.truth, outcome.rig
    selection = Selection() if rig is None else rig.selection

    write_pair_page(
        path,
        *outcome.pair,
        outcome.result,
        truth=None if truth is None else truth.disparity,
        mask=None if truth is None else truth.mask,
        calibration=None if rig is None else rig.calibration,
        keep=selection.keep,
        min_depth=selection.min_depth,
        max_depth=selection.max_depth,
        yaw=YAW if rig is None else rig.yaw,
        anchor=None if rig is None else rig.anchor,
        min_disparity=low,
        num_disparities=count,
        title=" and ".join(outcome.names),
    )


def _rig(outcome: Outcome) -> Rig:
    if outcome.rig is None:
        raise ValueError(
            "needs a geometry: give --calib, --rectify FILE, or --focal and --baseline"
        )
    return outcome.rig
