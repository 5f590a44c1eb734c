"""``phasestereo doctor``: reports the installed parts, their speed, and whether bits are right."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import os
import platform
import re
import time
from importlib.metadata import PackageNotFoundError, distribution, version
from statistics import median
from typing import Annotated, Any, get_args

import numpy as np
from cyclopts import Parameter

from phasestereo import _core
from phasestereo._devices import opened
from phasestereo._extras import require
from phasestereo.cli.errors import CommandError
from phasestereo.cli.terminal import print_json, print_lines, progress_bar
from phasestereo.matching import match
from phasestereo.rig.findings import unwarned
from phasestereo.settings import PresetName

_OURS = (
    "phasestereo",
    "phasestereo-live",
    "phasestereo-large",
    "phasestereo-gpu",
    "phasestereo-bench",
)
_REQUIREMENT = re.compile(
    r"(?P<name>[\w.-]+)(?:\[(?P<extras>[\w,-]+)\])?[^;]*"
    r"(?:;.*?extra == ['\"](?P<extra>[\w-]+)['\"])?"
)
_SIZE = 480, 640  # rows and columns of the pair for timing a match
_ROUNDS = 5
_CLONE = " (in a clone: '.[...]' ./python/phasestereo-{gpu,large,live})"


def doctor(
    *, as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False
) -> None:
    """Report the installed parts, their speed, and whether their results are right.

    The exit code is 1 if a match differs by a bit from other platforms' matches.

    Parameters
    ----------
    as_json
        Print one JSON object on standard output.
    """
    with unwarned(), progress_bar("Checking") as progress:
        found: dict[str, Any] = {
            "versions": _versions(),
            "platform": f"{platform.system()} {platform.machine()}",
            "instructions": _core.simd_level(),
            "processors": os.cpu_count(),
            "adapters": _adapters(),
            "device": _device(),
            "milliseconds": _times(),
            "differing": _core.self_check(progress),
            "missing_extras": _missing(),
        }

    if as_json:
        print_json(found)
    else:
        print_lines(_lines(found))
    if found["differing"]:
        pairs = "; ".join(found["differing"])
        raise CommandError(
            f"matches of {pairs} are not to the bit those of other platforms: please report it"
        )


def _versions() -> dict[str, str]:
    """Return the installed versions of Python, NumPy and our distributions."""
    found = {"python": platform.python_version(), "numpy": np.__version__}
    for name in _OURS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _times() -> dict[str, float]:
    """Return the median time of a match with each preset, in milliseconds."""
    rows, cols = _SIZE
    coarse = np.random.default_rng(0).integers(0, 256, (rows // 4, cols // 4 + 8), np.uint8)
    scene = coarse.repeat(4, axis=0).repeat(4, axis=1)
    left, right = scene[:, :cols], scene[:, 16 : cols + 16]

    times: dict[str, float] = {}
    for preset in get_args(PresetName):
        rounds = []
        for _ in range(_ROUNDS):
            started = time.perf_counter()
            match(left, right, num_disparities=64, preset=preset)
            rounds.append(1000 * (time.perf_counter() - started))
        times[preset] = round(median(rounds), 1)
    return times


def _adapters() -> list[dict[str, str]] | None:
    """Return the adapters that can run searches; None: phasestereo-gpu is not installed."""
    try:
        gpus = require("phasestereo_gpu", extra="gpu")
    except ImportError:
        return None
    keys = "name", "kind", "interface", "driver"
    return [dict(zip(keys, adapter, strict=True)) for adapter in gpus.adapters()]


def _device() -> str:
    """Return the name of the adapter that ``device="auto"`` takes, or "cpu"."""
    device = opened("auto")
    return "cpu" if device is None else device.name


def _missing() -> list[str]:
    """Return the extras with missing packages."""
    extras = distribution("phasestereo").metadata.get_all("Provides-Extra") or ()
    return sorted(
        extra for extra in extras if extra != "all" and not _is_installed("phasestereo", extra)
    )


def _is_installed(name: str, extra: str = "") -> bool:
    """Return whether a distribution is installed, and for ours also its and an extra's packages."""
    try:
        requirements = distribution(name).requires or ()
    except PackageNotFoundError:
        return False
    if name not in _OURS:
        return True

    for text in requirements:
        required = _REQUIREMENT.match(text)
        if required and (required["extra"] or extra) == extra:
            extras = (required["extras"] or "").split(",")
            if not all(_is_installed(required["name"], inner) for inner in extras):
                return False
    return True


def _lines(found: dict[str, Any]) -> list[str]:
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    times = ", ".join(f"{preset} {ms:.0f} ms" for preset, ms in found["milliseconds"].items())
    missing = ",".join(found["missing_extras"])
    adapters = [
        f"{one['name']} ({one['kind']}, {one['interface']})" for one in found["adapters"] or ()
    ]

    return [
        versions,
        f"{found['platform']}, {found['processors']} processors, {found['instructions']}",
        *([f"adapters: {'; '.join(adapters)}; auto takes: {found['device']}"] if adapters else []),
        f"{_SIZE[1]} x {_SIZE[0]} pixels, 64 disparities: {times}",
        "extras: "
        + (f"pip install 'phasestereo[{missing}]' brings the others{_CLONE}" if missing else "all"),
        *([] if found["differing"] else ["matches are to the bit those of every platform"]),
    ]
