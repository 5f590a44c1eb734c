"""Which faults the suite "rigs" has, and how strong they are."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

from phasestereo_bench.rigs import optics, sensor
from phasestereo_bench.rigs.depth import DepthOfField
from phasestereo_bench.rigs.fault import Both, Fault, One
from phasestereo_bench.rigs.geometry import Misaligned

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo_bench.rigs.fault import Step

_SIDEWAYS = 8  # px: more than any of these rigs moves columns by in images of 741 px
_ZOOMED = 24

_ROWS: dict[str, tuple[Step, ...]] = {
    "rows 0.5": (Misaligned(down=0.5),),
    "rows 1": (Misaligned(down=1),),
    "rows 2": (Misaligned(down=2),),
    "turn 0.5": (Misaligned(turn=0.5, margin=_SIDEWAYS),),
    "turn 1": (Misaligned(turn=1, margin=_SIDEWAYS),),
    "focal 1%": (Misaligned(focal=0.01, margin=_SIDEWAYS),),
    "focal 2%": (Misaligned(focal=0.02, margin=_SIDEWAYS),),
    "zoom 5%": (Misaligned(focal=0.05, margin=_ZOOMED),),
    "keystone 4": (Misaligned(keystone=4, margin=_SIDEWAYS),),
    "distortion 0.03": (Misaligned(distortion=0.03, margin=_SIDEWAYS),),
    "wobble 1": (Misaligned(wobble=1),),
    "wobble 2": (Misaligned(wobble=2),),
}

_SENSOR: dict[str, tuple[Step, ...]] = {
    "noise 2": (Both(partial(sensor.noise, sigma=2)),),
    "noise 5": (Both(partial(sensor.noise, sigma=5)),),
    "noise 20": (Both(partial(sensor.noise, sigma=20)),),
    "one noise 20": (One(partial(sensor.noise, sigma=20)),),
    "photons 100": (Both(partial(sensor.photons, white=100)),),
    "bits 4": (Both(partial(sensor.bits, count=4)),),
    "hot 0.1%": (Both(partial(sensor.hot, share=0.001)),),
    "hot 1%": (Both(partial(sensor.hot, share=0.01)),),
    "dead columns": (One(sensor.dead_columns),),
}

_CODING: dict[str, tuple[Step, ...]] = {
    "jpeg 90": (Both(partial(sensor.jpeg, quality=90)),),
    "jpeg 70": (Both(partial(sensor.jpeg, quality=70)),),
    "jpeg 30": (Both(partial(sensor.jpeg, quality=30)),),
    "one jpeg 30": (One(partial(sensor.jpeg, quality=30)),),
}

_FOCUS: dict[str, tuple[Step, ...]] = {
    "both disk 3": (Both(partial(optics.disk, radius=3)),),
    "disk 5 and 3": (Both(partial(optics.disk, radius=5), partial(optics.disk, radius=3)),),
    "motion 15 across": (
        Both(partial(optics.motion, length=15), partial(optics.motion, length=15, angle=90)),
    ),
    "motion 30": (One(partial(optics.motion, length=30)),),
    "annulus 6 3": (One(partial(optics.annulus, outer=6, inner=3)),),
    "annulus 6 4.5": (One(partial(optics.annulus, outer=6, inner=4.5)),),
    "depth 4": (DepthOfField(4),),
    "depth 8 opposite": (DepthOfField(8, opposite=True),),
}

_LIGHT: dict[str, tuple[Step, ...]] = {
    "haze": (One(optics.haze),),
    "rain": (One(optics.rain),),
    "dirt": (One(optics.dirt),),
    "vignette": (One(optics.vignette),),
    "clipped 20%": (One(partial(sensor.clipped, share=0.2)),),
    "inverted": (One(sensor.inverted),),
}

_COMPOSITES: dict[str, tuple[Step, ...]] = {
    "webcam": (
        Misaligned(down=1, turn=0.5, margin=_SIDEWAYS),
        One(partial(optics.disk, radius=2)),
        Both(partial(sensor.noise, sigma=4)),
        Both(partial(sensor.jpeg, quality=70)),
    ),
    "two phones": (
        Misaligned(down=2, turn=-0.3, focal=0.01, margin=_SIDEWAYS),
        One(partial(sensor.scaled, gain=0.8, gamma=1.3)),
        Both(partial(sensor.noise, sigma=3)),
        Both(partial(sensor.jpeg, quality=80)),
    ),
    "cheap module": (
        Misaligned(down=1.3, turn=0.3, focal=0.005, distortion=0.01, margin=_SIDEWAYS),
        Both(optics.vignette),
        Both(partial(sensor.noise, sigma=3)),
        Both(partial(sensor.hot, share=0.001)),
    ),
    "night": (
        One(partial(optics.motion, length=7)),
        Both(partial(sensor.scaled, gain=0.4)),
        Both(partial(sensor.photons, white=250)),
        Both(partial(sensor.hot, share=0.001)),
    ),
}

GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "sharp": "As they are",
        "rows": "Rows that do not correspond",
        "sensor": "Sensors",
        "coding": "JPEG",
        "focus": "Focus and motion",
        "light": "Light and what is on the lens",
        "composites": "Whole rigs",
    }
)
"""The tables of the suite by name, and what they are about."""

_STEPS: dict[str, dict[str, tuple[Step, ...]]] = {
    "sharp": {"sharp": ()},
    "rows": _ROWS,
    "sensor": _SENSOR,
    "coding": _CODING,
    "focus": _FOCUS,
    "light": _LIGHT,
    "composites": _COMPOSITES,
}

FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        name: Fault(name, group, steps)
        for group, faults in _STEPS.items()
        for name, steps in faults.items()
    }
)
"""The faults of the suite by name, those of a group next to each other."""

QUICK_SCENES = frozenset(("scenes2001/tsukuba", "scenes2003/cones", "scenes2006/ThirdSize/Aloe"))
"""Three small scenes, for a look that takes minutes."""
