"""``phasestereo rig test``: takes frames of two cameras and answers go or no-go."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter, Token
from numpy.typing import NDArray

import phasestereo
from phasestereo.cli.errors import UNTRUSTED, CommandError, claim, refusals
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io import read_image
from phasestereo.io.files import target_of
from phasestereo.io.folders import pair_paths, paths_of_rig
from phasestereo.rectification.record import Rectification
from phasestereo.rectification.rectifying import rectify as rectify_pair
from phasestereo.result import Result
from phasestereo.rig.findings import unwarned
from phasestereo.rigs import Rig
from phasestereo.settings import Settings
from phasestereo_live.cli.walls import WallOptions

_OPTIONS = frozenset(["limits", "focal", "preset"])
app = App(name="rig", help="Test two cameras while they run.")
"""The command ``phasestereo rig``; it has one subcommand so far."""

_WALL = Group.create_ordered("Wall")
_NO_WALL = WallOptions()


def _limit(_hint: Any, tokens: Sequence[Token]) -> tuple[tuple[str, float], ...]:
    """Read ``rows=0.5`` as ("rows", 0.5)."""
    limits = []
    for token in tokens:
        name, _, number = token.value.partition("=")
        try:
            limits.append((name, float(number)))
        except ValueError:
            raise ValueError(f"got {token.value}; accepts NAME=NUMBER, as rows=0.5") from None
    return tuple(limits)


@app.command(name="test")
def rig_test(
    frames: Path,
    right: Path | None = None,
    /,
    *,
    limit: Annotated[
        tuple[tuple[str, float], ...], Parameter(converter=_limit, n_tokens=1, negative=())
    ] = (),
    rectify: Path | None = None,
    focal: float | None = None,
    preset: str = "robust",
    save: Path | None = None,
    wall: Annotated[WallOptions, Parameter(name="*", group=_WALL)] = _NO_WALL,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
) -> None:
    """Test two cameras: compare measurements of their frames with limits.

    Prints each quantity with its limit, and exits with 3 if one exceeds it. For example:

    ```
    phasestereo rig test frames/ --rectify calibration.yaml --limit rows=0.2 --limit wrong=0.1
    phasestereo rig test frames/ --rectify calibration.yaml --unit m --wall 1.0m
    ```

    Parameters
    ----------
    frames
        A folder of about twenty pairs or more, as in `calibrate`; with RIGHT, the left camera's
        folder; or a saved rig.
    right
        The right camera's folder.
    limit
        A limit that replaces the default, NAME=NUMBER: rows, error, drift (in 100 frames), blur, in
        pixels; rotation, in degrees; wrong, noise, as shares; exposure, as a ratio; reserve, the
        least number of disparities beyond the nearest object; for a wall: fill, a share; accuracy,
        plane, temporal, percent of its distance; subpixel, pixels. You can repeat it.
    rectify
        The calibration of raw frames; the command also tests the rotation against it.
    focal
        Focal length of rectified frames in pixels, for the rotation and a wall.
    preset
        Preset of the matcher: robust, fast or paper. Fast estimates neither noise nor blur.
    save
        File for the rig, with everything that it learned.
    as_json
        Print one JSON object on standard output.
    """
    has_frames = right is not None or frames.is_dir()
    wall.check(focal=focal, rectify=rectify, has_frames=has_frames)
    claim([("save", save)], [frames, right, rectify])
    with refusals(options=_OPTIONS, renamed={"distance": "wall"}):
        if save is not None:
            target_of(save)
        rig = Rig(settings=Settings.preset(preset)) if has_frames else Rig.load(frames)
        test = None
        for result, found in _follow(rig, frames, right, rectify) if has_frames else ():
            if focal is None and found is not None and found.Q is not None:
                focal = float(found.Q[2, 3])
            test = test or wall.test(result.disparity.shape, focal, found)
            if test is not None:
                test.add(result)

        of_rig, of_wall = wall.split(dict(limit))
        checks = rig.test(of_rig, focal=focal) + (() if test is None else test.test(of_wall))
        if save is not None:
            rig.save(save)

    if as_json:
        print_json(
            {
                "version": phasestereo.__version__,
                "frames": rig.frames,
                "go": all(check.passed is not False for check in checks),
                "checks": [
                    check._asdict() | {"value": None if math.isnan(check.value) else check.value}
                    for check in checks
                ],
                "events": [str(event) for event in rig.events],
            }
        )
    else:
        print_lines([*map(str, checks), *(f"wrote {path}" for path in [save] if path is not None)])
    failed = [check.name for check in checks if check.passed is False]
    if failed:
        raise CommandError(f"no-go: {', '.join(failed)}", UNTRUSTED)


def _follow(
    rig: Rig, left: Path, right: Path | None, calibration: Path | None
) -> Iterator[tuple[Result, Rectification | None]]:
    """Match all frames with a rig; yield each match and the rectification of its frames."""
    found: Rectification | None = None
    for names in (
        paths_of_rig(left, "name both folders") if right is None else pair_paths(left, right)
    ):
        pair: tuple[NDArray[Any], NDArray[Any]] = read_image(names[0]), read_image(names[1])
        masks: dict[str, Any] = {}
        if calibration is not None:
            found = rectify_pair(*pair, calibration if found is None else found)
            pair = found.left, found.right
            masks = {"left_mask": found.left_mask, "right_mask": found.right_mask}
        with unwarned():  # the quantities already count what is wrong with a match
            result = rig.match(*pair, **masks)
        yield result, found
