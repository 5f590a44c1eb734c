"""``phasestereo rig``: what two cameras are, and whether they are as they should be."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

import phasestereo
from phasestereo._images import ImageOrPath
from phasestereo.cli.errors import UNTRUSTED, WRONG_USAGE, CommandError, refusals, refuse_picture
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.cli.trust import unwarned
from phasestereo.io.folders import pair_paths, paths_of_rig
from phasestereo.rectification import Rectification, rectify
from phasestereo.rigs import Check, Rig

_MANY = Parameter(consume_multiple=True, show_default=False)

app = App(name="rig", help="Two cameras: whether they are as they should be.")


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits other than the usual ones; with one, its quantity fails also where it is not told.

    Parameters
    ----------
    rows
        Rows that do not correspond, px rms. Usual: 0.75, from which on match warns.
    error
        Standard error of the rows, px. Usual: 0.1, a third of what harms a match.
    drift
        Rows that change, px in 100 frames; told from the 20th frame on. Usual: 0.3, what harms a
        match.
    rotation
        Pitch and roll against --calibration, degrees. Usual: 0.05, which moves rows by 0.75 px at a
        focal length of 860 px.
    wrong
        Share of the pixels that is probably wrong. Usual: 0.25, from which on match warns.
    reserve
        Disparities beyond the nearest thing, at least. Usual: 2, by which a fraction of a pixel is
        found.
    noise
        Noise of the worse image, as a share of black to white. Usual: 0.05, from which on match
        warns.
    exposure
        How many times brighter one image is. Usual: 1.42, from which on match warns.
    blur
        Blur of one image beside the other, px rms. Usual: 0.7, from which on match warns.
    """

    rows: float | None = None
    error: float | None = None
    drift: float | None = None
    rotation: float | None = None
    wrong: float | None = None
    reserve: float | None = None
    noise: float | None = None
    exposure: float | None = None
    blur: float | None = None

    def given(self) -> dict[str, float]:
        """Return those that are given."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


_OPTIONS = frozenset([each.name for each in fields(Limits)] + ["num_disparities"])


@app.command(name="test")
def check(
    left: Path | None = None,
    right: Path | None = None,
    /,
    *,
    rig: Path | None = None,
    calibration: Annotated[tuple[Path, ...], _MANY] = (),
    num_disparities: int | None = None,
    min_disparity: int = 0,
    save: Path | None = None,
    limits: Limits = Limits(),
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
) -> None:
    """Test a rig: go, exit code 0, or no-go, exit code 3.

    Prints a line for each quantity, which begins with ``go``, ``no-go`` or ``unknown``: what
    cannot be told passes, but for rows, their error, the share of wrong pixels, and what has a
    limit of its own. For example:

    ```
    phasestereo rig test recording --calibration stereo.yml --rows 0.3 --save rig.txt
    phasestereo rig test --rig rig.txt
    ```

    Parameters
    ----------
    left
        A folder of pairs (in folders left and right, cam0 and cam1, or named so); or, with RIGHT,
        the left image, or the folder of left ones.
    right
        The right image, or the folder of right ones.
    rig
        File of a rig, as phasestereo.Rig.save writes it: it is tested as it is, or goes on with the
        pairs.
    calibration
        By what the pairs are rectified first, as rectify takes it. Rotations are told against it.
    num_disparities
        Number of disparities to search. Default: as many as are found.
    min_disparity
        The least of them.
    save
        File for the rig after the test.
    as_json
        Print one JSON object on standard output.
    """
    if left is None and rig is None:
        raise CommandError("nothing to test: give pairs, or --rig FILE", WRONG_USAGE)
    if left is None and (calibration or save):
        raise CommandError("--calibration, --save: have no effect without pairs", WRONG_USAGE)
    for path in calibration:
        refuse_picture("calibration", path)

    search: dict[str, Any] = {"num_disparities": num_disparities, "min_disparity": min_disparity}
    with refusals(options=_OPTIONS), unwarned():
        tested = Rig(**search) if rig is None else Rig.load(rig, **search)
        focal = None if left is None else _watch(tested, _pairs(left, right), calibration)
        checks = tested.check(focal=focal, **limits.given())
        if save is not None:
            tested.save(save)

    if as_json:
        print_json(_as_dict(tested, checks))
    else:
        print_lines([*map(str, checks), *map(str, tested.events)])
    failed = [one.quantity for one in checks if one.passed is False]
    if failed:
        raise CommandError(f"no-go: {', '.join(failed)}", UNTRUSTED)


def _pairs(left: Path, right: Path | None) -> list[tuple[Path, Path]]:
    if right is None:
        return paths_of_rig(left)
    return pair_paths(left, right) if left.is_dir() else [(left, right)]


def _watch(rig: Rig, pairs: list[tuple[Path, Path]], calibration: tuple[Path, ...]) -> float | None:
    """Match pairs; return the focal length in pixels of rectified ones, if they are rectified."""
    if not calibration:
        for left, right in pairs:
            rig.match(left, right)
        return None

    found: Rectification | None = None
    for left, right in pairs:
        found = rectify(left, right, calibration) if found is None else found
        images: tuple[ImageOrPath, ImageOrPath] = found.apply(left, right)
        rig.match(*images, left_mask=found.left_mask, right_mask=found.right_mask)
    return None if found is None or found.Q is None else float(found.Q[2, 3])


def _as_dict(rig: Rig, checks: tuple[Check, ...]) -> dict[str, Any]:
    def told(value: float) -> float | None:
        return None if math.isnan(value) else value

    return {
        "version": phasestereo.__version__,
        "go": all(one.passed is not False for one in checks),
        "frames": rig.frames,
        "checks": [
            {
                "quantity": one.quantity,
                "unit": one.unit,
                "meaning": one.meaning,
                "value": told(one.value),
                "limit": one.limit,
                "passed": one.passed,
            }
            for one in checks
        ],
        "events": [
            {"subject": event.subject, "frame": event.frame, "sentence": event.sentence}
            for event in rig.events
        ],
    }
