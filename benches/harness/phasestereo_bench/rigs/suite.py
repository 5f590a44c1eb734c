"""Lists the faults of the suites "rigs" and "rigs-2", and their strengths."""

from collections.abc import Mapping
from functools import partial

from phasestereo_bench.degradation import disk_psf, motion_psf
from phasestereo_bench.rigs import capture, optics, sensor
from phasestereo_bench.rigs.corruptions import CORRUPTIONS
from phasestereo_bench.rigs.depth import DepthOfField, Pasted, Raised, Redrawn
from phasestereo_bench.rigs.fault import Both, Fault, One, Step
from phasestereo_bench.rigs.geometry import Bent, Misaligned, barrel

_SIDEWAYS = 8  # px: none of these rigs moves columns by more in images of 741 px
_ZOOMED = 24

_NOISE_10 = Both(partial(sensor.noise, sigma=10))

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
    "both disk 3": (Both(partial(optics.blurred, psf=disk_psf(3))),),
    "disk 5 and 3": (
        Both(partial(optics.blurred, psf=disk_psf(5)), partial(optics.blurred, psf=disk_psf(3))),
    ),
    "motion 15 across": (
        Both(
            partial(optics.blurred, psf=motion_psf(15)),
            partial(optics.blurred, psf=motion_psf(15, 90)),
        ),
    ),
    "motion 30": (One(partial(optics.blurred, psf=motion_psf(30))),),
    "annulus 6 3": (One(partial(optics.blurred, psf=disk_psf(6, 3))),),
    "annulus 6 4.5": (One(partial(optics.blurred, psf=disk_psf(6, 4.5))),),
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
        One(partial(optics.blurred, psf=disk_psf(2))),
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
        One(partial(optics.blurred, psf=motion_psf(7))),
        Both(partial(sensor.scaled, gain=0.4)),
        Both(partial(sensor.photons, white=250)),
        Both(partial(sensor.hot, share=0.001)),
    ),
}

_CODED: dict[str, tuple[Step, ...]] = {
    **{
        f"{name} {crf}": (Both(partial(capture.video, codec=codec, crf=crf)),)
        for name, codec in (("h264", "libx264"), ("h265", "libx265"))
        for crf in (23, 28, 33)
    },
    "one h264 33": (One(partial(capture.video, codec="libx264", crf=33)),),
    "one denoised": (_NOISE_10, One(partial(capture.denoised, strength=10))),
    "both denoised": (_NOISE_10, Both(partial(capture.denoised, strength=10))),
}

_CAPTURED: dict[str, tuple[Step, ...]] = {
    "bayer noise 6": (Both(partial(capture.bayer, sigma=6)),),
    "photons 20": (Both(partial(sensor.photons, white=20)),),
    "chroma noise 30": (Both(partial(capture.chroma_noise, sigma=30)),),
    "contrast 8%": (Both(partial(capture.pale, share=0.08)),),
    "over-exposed 1.6": (One(partial(sensor.scaled, gain=1.6)),),
    "over-exposed 2.5": (One(partial(sensor.scaled, gain=2.5)),),
    "near infrared": (One(partial(capture.band, shares=capture.INFRARED)),),
    "red and blue": (
        Both(
            partial(capture.band, shares=(1.0, 0.0, 0.0)),
            partial(capture.band, shares=(0.0, 0.0, 1.0)),
        ),
    ),
}

_BUILT: dict[str, tuple[Step, ...]] = {
    "barrel 0.05": (Misaligned(distortion=-0.05, margin=_SIDEWAYS),),
    "both barrel 0.2": (Bent(partial(barrel, bend=-0.2)),),
    "raised 5%": (Raised(0.05),),
    "half resolution": (One(partial(capture.small, part=2)),),
    "third resolution": (One(partial(capture.small, part=3)),),
    "lenses apart 3": (DepthOfField(3, opposite=True),),
    "lenses apart 5": (DepthOfField(5, opposite=True),),
    "range -3..9": (Redrawn(12, first=-3), Both(partial(sensor.noise, sigma=2))),
    "near things": (Pasted(6, size=32, ahead=16), Both(partial(sensor.noise, sigma=2))),
}

_STEPS: dict[str, dict[str, dict[str, tuple[Step, ...]]]] = {
    "rigs": {
        "sharp": {"sharp": ()},
        "rows": _ROWS,
        "sensor": _SENSOR,
        "coding": _CODING,
        "focus": _FOCUS,
        "light": _LIGHT,
        "composites": _COMPOSITES,
    },
    "rigs-2": {
        "coded": _CODED,
        "captured": _CAPTURED,
        "built": _BUILT,
        "corruptions": CORRUPTIONS,
    },
}

RIGS: Mapping[str, Mapping[str, Fault]] = {
    suite: {
        name: Fault(name, group, steps)
        for group, faults in groups.items()
        for name, steps in faults.items()
    }
    for suite, groups in _STEPS.items()
}
"""The faults of both suites by name; faults of a group are adjacent and share a table."""

FAULTS = RIGS["rigs"]
"""Faults of the first suite."""

QUICK_SCENES = frozenset(("scenes2001/tsukuba", "scenes2003/cones", "scenes2006/ThirdSize/Aloe"))
"""Three small scenes, for a run that takes minutes."""
