"""``phasestereo rig test``: frames of two cameras in, go or no-go out."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token
from numpy.typing import NDArray

import phasestereo
from phasestereo.cli.errors import UNTRUSTED, CommandError, refusals, refuse_taken
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io import read_image
from phasestereo.io.files import target_of
from phasestereo.io.folders import pair_paths, paths_of_rig
from phasestereo.rectification.record import Rectification
from phasestereo.rectification.rectifying import rectify as rectify_pair
from phasestereo.rig.findings import MatchWarning
from phasestereo.rigs import Check, Rig

_OPTIONS = frozenset(["limits", "focal", "preset"])


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
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
) -> None:
    """Test two cameras: what their frames show, against limits.

    Prints each quantity with its limit, and exits with 3 if one is beyond it. For example:

    ```
    phasestereo rig test frames/ --rectify calibration.yaml --limit rows=0.2 --limit wrong=0.1
    ```

    Parameters
    ----------
    frames
        A folder of pairs, as `calibrate` takes them, some twenty or more; with RIGHT, the left
        camera's folder; or a rig that was saved.
    right
        The right camera's folder.
    limit
        A limit in the place of the usual one, NAME=NUMBER: rows, error, drift (in 100 frames),
        blur, in pixels; rotation, in degrees; wrong, noise, as shares; exposure, as a ratio;
        reserve, the least number of disparities beyond the nearest thing. May be given again.
    rectify
        The calibration of raw frames; the rotation against it is tested, too.
    focal
        Focal length of rectified frames in pixels, for the rotation.
    preset
        How frames are matched: robust, fast or paper. Fast estimates neither noise nor blur.
    save
        File for what was learned.
    as_json
        Print one JSON object on standard output.
    """
    if save is not None:
        refuse_taken("save", save, [frames, right, rectify])
    with refusals(options=_OPTIONS):
        if save is not None:
            target_of(save)
        if right is None and not frames.is_dir():
            rig = Rig.load(frames)
        else:
            rig = Rig(preset=preset)
            found = _follow(rig, frames, right, rectify)
            if focal is None and found is not None and found.Q is not None:
                focal = float(found.Q[2, 3])
        checks = rig.test(dict(limit), focal=focal)
        if save is not None:
            rig.save(save)

    if as_json:
        print_json(_as_dict(rig, checks))
    else:
        print_lines([*map(str, checks), *(f"wrote {path}" for path in [save] if path is not None)])
    failed = [check.name for check in checks if check.passed is False]
    if failed:
        raise CommandError(f"no-go: {', '.join(failed)}", UNTRUSTED)


def _follow(
    rig: Rig, left: Path, right: Path | None, calibration: Path | None
) -> Rectification | None:
    """Match all frames by a rig; return how they were rectified."""
    found: Rectification | None = None
    for names in paths_of_rig(left) if right is None else pair_paths(left, right):
        pair: tuple[NDArray[Any], NDArray[Any]] = read_image(names[0]), read_image(names[1])
        masks: dict[str, Any] = {}
        if calibration is not None:
            found = rectify_pair(*pair, calibration if found is None else found)
            pair = found.left, found.right
            masks = {"left_mask": found.left_mask, "right_mask": found.right_mask}
        with warnings.catch_warnings():
            # What is wrong with a match counts among the quantities.
            warnings.simplefilter("ignore", MatchWarning)
            rig.match(*pair, **masks)
    return found


def _as_dict(rig: Rig, checks: Sequence[Check]) -> dict[str, Any]:
    return {
        "version": phasestereo.__version__,
        "frames": rig.frames,
        "go": all(check.passed is not False for check in checks),
        "checks": [
            check._asdict() | {"value": None if math.isnan(check.value) else check.value}
            for check in checks
        ],
        "events": [str(event) for event in rig.events],
    }
