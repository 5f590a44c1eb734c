"""Scores blur estimation on scenes with known blur.

    from pathlib import Path

    from phasestereo_bench import run_jobs
    from phasestereo_bench.blur import blur_jobs
    from phasestereo_bench.datasets import find_scenes

    records = run_jobs(blur_jobs(find_scenes("middlebury")), Path("blur.jsonl"))

Data flow: `blur_jobs` -> records, in a store -> `verdict` of each -> `blur_table`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import median
from typing import Any

from phasestereo.rig.estimation import estimate_blur
from phasestereo_bench import cases
from phasestereo_bench.arrays import Array
from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.degradation import Degradation, Kernel, disk_psf, gaussian_psf, motion_psf
from phasestereo_bench.measurement import measured
from phasestereo_bench.report.tables import MISSING, Entry, Table
from phasestereo_bench.runner import Job

KIND = "blur"
"""The kind of the records."""

_ANGLES = (0.0, 30.0, 90.0, 135.0)
_BLURS = (
    *(("gaussian", size, 0.0) for size in (1.0, 1.5, 2.0, 3.0, 4.0)),
    *(("disk", size, 0.0) for size in (2.0, 3.0, 4.0, 6.0, 8.0)),
    *(("motion", size, angle) for size in (5.0, 9.0, 15.0, 21.0) for angle in _ANGLES),
)
_BLURS_OF_BOTH = (
    ("gaussian", 1.5, 0.0),
    ("gaussian", 3.0, 0.0),
    ("disk", 3.0, 0.0),
    ("motion", 9.0, 0.0),
)
_NOISES = (1.0, 2.0)
_SEEDS = {"left": 1, "right": 2}


@dataclass(frozen=True, slots=True)
class BlurTrial:
    """A scene, and the changes to its images.

    Attributes
    ----------
    scene
        The scene.
    family
        "gaussian", "disk", "motion", or "none" for unchanged images.
    size, angle
        Size and angle as in `phasestereo.Blur`.
    side
        The blurred image: "left", "right", "both" or "neither".
    noise
        Standard deviation of the noise that is added to blurred images, gray levels.
    """

    scene: Scene
    family: str
    size: float
    angle: float
    side: str
    noise: float

    @property
    def psf(self) -> Kernel | None:
        """Point-spread function of the blur."""
        match self.family:
            case "gaussian":
                return gaussian_psf(self.size)
            case "disk":
                return disk_psf(self.size)
            case "motion":
                return motion_psf(self.size, self.angle)
        return None

    def views(self, pair: Pair) -> tuple[Array, Array]:
        """Return the left and right images of a pair as the trial changes them."""
        return self._view(pair.left, "left"), self._view(pair.right, "right")

    def _view(self, image: Array, side: str) -> Array:
        if self.side not in (side, "both"):
            return image
        return Degradation(self.psf, noise=self.noise, seed=_SEEDS[side])(image)


def blur_jobs(scenes: Iterable[Scene], *, every: int = 1) -> list[Job]:
    """Return the jobs that blur scenes with known kernels and estimate the blur, one per trial.

    Every scene has trials as it is; with the left or the right image blurred by 26 point-spread
    functions (Gaussians of standard deviation 1 to 4 px, disks of radius 2 to 8 px, motions of 5 to
    21 px in four directions), with noise of 1 or 2 gray levels; and with both images blurred alike,
    where no relative blur is the right answer.

    Parameters
    ----------
    scenes
        As `phasestereo_bench.datasets.find_scenes` returns them.
    every
        Run every N-th trial, 1 or more: 7 gives a quick look at all kinds of them.

    Returns
    -------
    list of Job
        In their records, "kind", "collection", "scene", "family", "size", "angle", "side" and
        "noise" identify a trial, as in `BlurTrial`. Good records have "found" ("side", "kind",
        "size" and "angle" of the blur of the largest area), "kinds" (their number), "areas" (the
        share of each), "certainty", "contrast", "noise_found", "num_disparities", "width",
        "height", "seconds" and "peak_bytes" of the estimation, on one thread.

    Raises
    ------
    ValueError
        If there is no trial, or `every` is less than 1.
    """
    if every < 1:
        raise ValueError(f"every: got {every}; accepts 1 and more")

    trials = [trial for scene in scenes for trial in _trials(scene)][::every]
    if not trials:
        raise ValueError("there is no scene to blur")

    # Files may have changed since an earlier call in this process.
    cases.forget()
    return [
        Job(
            {
                "kind": KIND,
                "collection": trial.scene.collection,
                "scene": trial.scene.name,
                "family": trial.family,
                "size": trial.size,
                "angle": trial.angle,
                "side": trial.side,
                "noise": trial.noise,
            },
            try_out,
            {"trial": trial},
        )
        for trial in trials
    ]


def try_out(trial: BlurTrial) -> dict[str, Any]:
    """Estimate the blur of a trial and return its record."""
    pair = cases.load(trial.scene)
    left, right = trial.views(pair)
    count = pair.num_disparities

    done = measured(lambda: estimate_blur(left, right, num_disparities=count, threads=1))
    estimate, blur = done.answer, done.answer.blur
    height, width = left.shape[:2]

    return {
        "found": {name: getattr(blur, name) for name in ("side", "kind", "size", "angle")},
        "kinds": len(estimate.blurs),
        "areas": estimate.areas(),
        "certainty": estimate.certainty,
        "contrast": estimate.contrast,
        "noise_found": estimate.noise,
        "num_disparities": count,
        "width": width,
        "height": height,
        "seconds": done.seconds,
        "peak_bytes": done.peak_bytes,
    }


def _trials(scene: Scene) -> Sequence[BlurTrial]:
    one_sided = [
        BlurTrial(scene, *blur, side, noise)
        for blur, side, noise in product(_BLURS, ("left", "right"), _NOISES)
    ]
    alike = [BlurTrial(scene, *blur, "both", 1.0) for blur in _BLURS_OF_BOTH]

    return [BlurTrial(scene, "none", 0.0, 0.0, "neither", 0.0), *one_sided, *alike]


SIZE_PIXELS, SIZE_SHARE, ANGLE = 0.5, 0.1, 15.0
"""Largest accepted errors: of a size in pixels, of a size as a share, and of an angle in
degrees."""

_ALIKE_UP_TO = {"gaussian": 1.5, "disk": 2.0}
"""Up to these sizes a Gaussian and a disk of twice its size cannot be distinguished."""


@dataclass(frozen=True, slots=True)
class BlurVerdict:
    """The correct parts of an estimate.

    Attributes
    ----------
    kind
        Whether the family is right: no blur if neither or both of the images are blurred.
    side
        Whether the softer image is right; for no blur, whether the estimate reports no blur.
    size_error
        Error of the size in pixels; None if it has no meaning.
    size
        Whether the size is close enough.
    angle_error
        Error of the angle in degrees, 0 to 90; None if it has no meaning.
    angle
        Whether the angle is close enough.
    single
        Whether the estimate found only this kind of blur.
    """

    kind: bool
    side: bool
    size_error: float | None
    size: bool
    angle_error: float | None
    angle: bool
    single: bool

    @property
    def all(self) -> bool:
        """Whether everything is right."""
        return self.kind and self.side and self.size and self.angle and self.single


def verdict(record: Mapping[str, Any]) -> BlurVerdict:
    """Judge a good record of a trial."""
    found, single = record["found"], record["kinds"] == 1

    if record["side"] in ("neither", "both"):
        none = found["side"] == "none"
        return BlurVerdict(none, none, None, size=True, angle_error=None, angle=True, single=single)

    family, true = record["family"], float(record["size"])
    alike = {found["kind"], family} == set(_ALIKE_UP_TO) and true <= _ALIKE_UP_TO[family]
    kind = found["kind"] == family or alike

    # Compare sizes and angles only if the family is right.
    size = _as(family, found) if kind else None
    error = None if size is None else abs(size - true)
    # A motion forward equals one backward, so angles repeat after 180 degrees.
    turn = (
        abs((found["angle"] - record["angle"] + 90) % 180 - 90)
        if kind and family == "motion"
        else None
    )

    return BlurVerdict(
        kind=kind,
        side=found["side"] == record["side"],
        size_error=error,
        size=error is not None and error <= max(SIZE_PIXELS, SIZE_SHARE * true),
        angle_error=turn,
        angle=family != "motion" or (turn is not None and turn <= ANGLE),
        single=single,
    )


def _as(family: str, found: Mapping[str, Any]) -> float:
    """Return the size of a found blur as another family of the same spread."""
    size = float(found["size"])
    if found["kind"] == family:
        return size
    return 2 * size if family == "disk" else size / 2


Record = Mapping[str, Any]

_FAMILIES = ("gaussian", "disk", "motion", "none")
_HEADER = (
    *("blur", "trials", "kind %", "side %", "size %", "angle %", "one kind %", "all right %"),
    *("size off, px", "angle off, degrees"),
)


def blur_table(records: Iterable[Record]) -> Table:
    """Return the shares of correct answers, a row for each blur, and one for all."""
    groups: dict[str, list[BlurVerdict]] = {}
    for record in sorted(records, key=_order):
        groups.setdefault(_name(record), []).append(verdict(record))

    everything = [judged for group in groups.values() for judged in group]
    rows = [_row(name, group) for name, group in groups.items()]
    return Table(_HEADER, (*rows, _row("all", everything)))


def explain_blur(records: Sequence[Record]) -> str:
    """Explain the figures of the table."""
    scenes = {(record["collection"], record["scene"]) for record in records}
    noises = sorted({record["noise"] for record in records if record["noise"]})
    levels = " or ".join(f"{noise:g}" for noise in noises)

    return (
        f"Trials on {len(scenes)} scenes; a blurred image has 8 bits and noise of {levels or 'no'} "
        "gray levels. %: share of the trials that are right. Size: Gaussians by their standard "
        "deviation, disks by their radius, motions by their length, right if off by no more than "
        f"{SIZE_PIXELS:g} px or {SIZE_SHARE:.0%}; angle: by no more than {ANGLE:g} degrees. "
        "One kind: no part of the image has another blur. Gaussians up to 1.5 and "
        "disks up to 2 px may be taken for each other, a disk for a Gaussian of half its size. "
        "Off: the median of what is right in kind."
    )


def _order(record: Record) -> tuple[int, int, float]:
    alike = record["side"] == "both"
    family = len(_FAMILIES) if alike else _FAMILIES.index(record["family"])
    return family, int(alike), 0.0 if alike else float(record["size"])


def _name(record: Record) -> str:
    if record["side"] == "both":
        return "none: both alike"
    if record["side"] == "neither":
        return "none: as they are"
    return f"{record['family']} {record['size']:g}"


def _row(name: str, group: Sequence[BlurVerdict]) -> tuple[Entry, ...]:
    sized = [judged.size_error for judged in group if judged.size_error is not None]
    turned = [judged.angle_error for judged in group if judged.angle_error is not None]

    # A size needs a blur, and an angle needs a motion.
    blurred = not name.startswith("none")
    moved = name.startswith(("motion", "all"))

    return (
        Entry(name),
        Entry(str(len(group))),
        _share(group, lambda judged: judged.kind),
        _share(group, lambda judged: judged.side),
        _share(group, lambda judged: judged.size) if blurred else Entry(MISSING),
        _share(group, lambda judged: judged.angle) if moved else Entry(MISSING),
        _share(group, lambda judged: judged.single),
        _share(group, lambda judged: judged.all),
        Entry(f"{median(sized):.2f}" if sized else MISSING),
        Entry(f"{median(turned):.1f}" if turned else MISSING),
    )


def _share(group: Sequence[BlurVerdict], right: Callable[[BlurVerdict], bool]) -> Entry:
    """Return the share in %, 100 only of all."""
    count = sum(map(right, group))
    return Entry("100" if count == len(group) else f"{100 * count / len(group):.1f}")
