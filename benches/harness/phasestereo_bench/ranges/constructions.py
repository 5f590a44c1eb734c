"""Makes pairs from scenes: objects before a background, ranges of either sign, faults.

A background is an image (or several, side by side) with a right view of it under a field of
disparities, or a scene as it is. Objects are cut from another image and pasted into both views.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Image
from phasestereo_bench.datasets import Pair
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rigs.sensor import jpeg, noise
from phasestereo_bench.surfaces import gray_of

Views = tuple[Image, Image]
Fault = Callable[[Views], Views]

KINDS = ("near", "poles", "squares", "signed", "same", "parallel", "weak")
"""Near objects by their share of the image; poles; squares; ranges of either sign; the same image
twice; only disparities of zero; weak texture."""

_SHARES = 0.005, 0.01, 0.02, 0.03, 0.05
_NEAR = 45, 90
_SIGNED = (-3.0, 3.0), (-6.0, 18.0), (-8.0, 40.0), (-25.0, 5.0)
_WIDTHS = 450, 1077, 2154, 4021
_THIN = 430, 1240


@dataclass(frozen=True, slots=True, eq=False)
class Construction:
    """A pair whose disparities are known.

    Attributes
    ----------
    kind
        One of `KINDS`.
    name
        Name of the pair.
    left, right
        The views, uint8 (H, W).
    low, high
        Ends of the disparities that the range must hold, px.
    objects
        Disparities of the objects among them, px.
    """

    kind: str
    name: str
    left: Image
    right: Image
    low: float
    high: float
    objects: tuple[float, ...] = ()


def constructions(
    scenes: Sequence[Pair], kinds: Sequence[str] = KINDS, *, held: bool = False
) -> Iterator[Construction]:
    """Make pairs from scenes, deterministically.

    Parameters
    ----------
    scenes
        At least two scenes, the source of textures and backgrounds.
    kinds
        The kinds to make, of `KINDS`.
    held
        Make held-out pairs, on which the search for the range was not developed: other textures,
        places, sizes, and a fault each (blur of one image, noise, JPEG).

    Raises
    ------
    ValueError
        If there are fewer than two scenes.
    """
    if len(scenes) < 2:
        raise ValueError(f"scenes: got {len(scenes)}; accepts two or more")

    makers: dict[str, Callable[..., Iterator[Construction]]] = {
        "near": _near,
        "poles": partial(_thin, "poles"),
        "squares": partial(_thin, "squares"),
        "signed": _signed,
        "same": _same,
        "parallel": _parallel,
        "weak": _weak,
    }
    # A scene in another light would repeat the same scene.
    names = {pair.name for pair in scenes}
    textures = [_gray(pair.left) for pair in scenes if pair.name[:-1] not in names]
    for kind in kinds:
        yield from makers[kind](scenes, textures, held=held)


def _near(pairs: Sequence[Pair], textures: list[Image], *, held: bool) -> Iterator[Construction]:
    """Yield scenes with few disparities and an object that covers a share of the image."""
    backgrounds: list[tuple[str, Views, float, float]] = []
    for pair in pairs:
        known = _known(pair)
        if known is not None and known[1] <= 20:
            views = _gray(pair.left), _gray(pair.right)
            backgrounds.append((pair.name, views, *known))
    for number in range(max(3 - len(backgrounds), 1)):
        views, low, high = _background(textures, (380, 560), (3.0, 19.0), 7 * held + number)
        backgrounds.append((f"made {number}", views, low, high))

    faults = _faults(held=held)
    shares = (0.007, 0.015, 0.025) if held else _SHARES
    for index, ((name, views, low, high), share, near) in enumerate(
        product(backgrounds, shares, (60, 75) if held else _NEAR)
    ):
        rows, columns = views[0].shape
        ratio = (1.0, 0.5, 2.0)[index % 3]
        height, width = (round((share * rows * columns * by) ** 0.5) for by in (ratio, 1 / ratio))
        place = (rows - height) * (1 + index % 3) // 4, max(near + 8, columns // 2)
        patch = _cut(textures[(index + 2) % len(textures)], (height, width), index + 50 * held)
        fault, spoiled = faults[index % len(faults)]
        left, right = spoiled(_pasted(views, patch, place, near))
        what = f"{name}, {share:.1%} at {near} px {fault}".strip()
        yield Construction("near", what, left, right, low, max(high, near), (near,))


def _thin(
    kind: str, _pairs: Sequence[Pair], textures: list[Image], *, held: bool
) -> Iterator[Construction]:
    """Yield wide and narrow backgrounds with one pole or one square."""
    faults = _faults(held=held)
    sizes: tuple[int, ...] = (9, 11, 13) if held else (8, 11, 14)
    if kind == "squares":
        sizes = (26, 34) if held else (24, 32, 40)
    cases = product((520, 1300, 1920) if held else _THIN, sizes, (55, 110) if held else _NEAR)

    for index, (columns, size, near) in enumerate(cases):
        shape = round(columns * (0.3 if columns > 600 else 0.8)), columns
        height = size if kind == "squares" else round(shape[0] * (0.33 + 0.17 * (index % 2)))
        views, low, _ = _background(textures, shape, (3.0, 19.0), index + 31 * held)
        place = (
            (shape[0] - height) * (1 + index % 2) // 3,
            near + (columns - near) * (2 + index % 3) // 6,
        )
        patch = _cut(textures[(index + 3) % len(textures)], (height, size), index + 90 * held)
        fault, spoiled = faults[index % len(faults)]
        left, right = spoiled(_pasted(views, patch, place, near))
        what = f"{columns} columns, {size} px wide at {near} px {fault}".strip()
        yield Construction(kind, what, left, right, low, near, (near,))


def _signed(_: Sequence[Pair], textures: list[Image], *, held: bool) -> Iterator[Construction]:
    widths = (640, 1600, 3000) if held else _WIDTHS
    spans = ((-2.0, 5.0), (-15.0, 15.0), (-5.0, 60.0)) if held else _SIGNED
    for index, (columns, span) in enumerate(product(widths, spans)):
        shape = min(round(columns * 0.6), 900), columns
        (left, right), low, high = _background(textures, shape, span, index + 13 * held)
        what = f"{columns} columns, {span[0]:g} to {span[1]:g} px"
        yield Construction("signed", what, left, right, low, high)


def _same(_: Sequence[Pair], textures: list[Image], *, held: bool) -> Iterator[Construction]:
    for index, sigma in enumerate((0.0, 5.0, 10.0) if held else (0.0, 2.0)):
        image = textures[index + held]
        left, right = (noise(image, seed, sigma=sigma) for seed in (1, 2))
        yield Construction("same", f"noise {sigma:g}", left, right, 0, 0)


def _parallel(_: Sequence[Pair], textures: list[Image], *, held: bool) -> Iterator[Construction]:
    """Yield far scenes: disparities near zero, and other light."""
    for index, columns in enumerate((600, 1500) if held else (450, 1240)):
        (left, right), low, high = _background(
            textures, (columns // 2, columns), (-0.4, 0.4), index + 3 * held
        )
        right = (0.93 * right + 6).astype(np.uint8)
        yield Construction("parallel", f"{columns} columns", left, right, low, high)


def _weak(pairs: Sequence[Pair], _: list[Image], *, held: bool) -> Iterator[Construction]:
    """Yield scenes with little contrast left."""
    for pair in pairs[held::2]:
        known = _known(pair)
        if known is not None:
            left, right = (
                noise(100 + (_gray(side) - 110.0) * 0.06, seed, sigma=0.7)
                for side, seed in ((pair.left, 1), (pair.right, 2))
            )
            yield Construction("weak", pair.name, left, right, *known)


def _known(pair: Pair) -> tuple[float, float] | None:
    """Return the ends of the true disparities, without a thousandth on either side."""
    if pair.truth is None:
        return None

    truth = pair.truth[np.isfinite(pair.truth)]
    low, high = np.percentile(truth, [0.1, 99.9])
    return float(low), float(high)


def _gray(image: NDArray[Any]) -> Image:
    return np.rint(gray_of(image)).astype(np.uint8)


def _background(
    textures: list[Image], shape: tuple[int, int], span: tuple[float, float], seed: int
) -> tuple[Views, float, float]:
    """Return views of a mosaic under a smooth field of disparities, and the ends of the field.

    The field belongs to the right view, so no place of it is seen twice. Linear interpolation
    resamples the left view; the right view is the mosaic.
    """
    rows, columns = shape
    low, high = span
    margin = int(np.ceil(max(abs(low), abs(high)))) + 2

    picture = _mosaic(textures, (rows, columns + 2 * margin), seed)
    y, x = np.mgrid[:rows, :columns] / max(shape)
    wave = 0.15 * np.sin(9 * x + seed) * np.cos(7 * y + 2 * seed)
    level = y * columns / rows if rows < columns else y
    field = low + (high - low) * np.clip(1.3 * level - 0.15 + wave, 0, 1)

    # A far pixel at x - d of the right view is at x of the left one.
    at = np.arange(columns) + margin - field
    base = np.arange(columns + 2 * margin)
    right = picture[:, margin : margin + columns]
    left = np.array([np.interp(where, base, row) for where, row in zip(at, picture, strict=True)])

    views = noise(left, 2 * seed + 1, sigma=1), noise(right, 2 * seed + 2, sigma=1)
    return views, float(field.min()), float(field.max())


def _mosaic(textures: list[Image], shape: tuple[int, int], seed: int) -> Image:
    """Return images side by side, and below one another, until the shape is covered."""
    rows, columns = shape
    order = [textures[(seed + step) % len(textures)] for step in range(len(textures))]

    strips, used, height = [], 0, 0
    while height < rows:
        row: list[Image] = []
        while sum(image.shape[1] for image in row) < columns:
            row.append(order[used % len(order)])
            used += 1
        least = min(image.shape[0] for image in row)
        strips.append(np.hstack([image[:least] for image in row])[:, :columns])
        height += least

    return np.vstack(strips)[:rows]


def _cut(texture: Image, size: tuple[int, int], seed: int) -> Image:
    """Return the part with the most contrast out of several parts of an image."""
    generator = np.random.default_rng(seed)
    rows, columns = (min(wanted, there) for wanted, there in zip(size, texture.shape, strict=True))
    parts = []
    for _ in range(8):
        top = generator.integers(texture.shape[0] - rows + 1)
        start = generator.integers(texture.shape[1] - columns + 1)
        parts.append(texture[top : top + rows, start : start + columns])
    return max(parts, key=lambda part: float(np.abs(np.diff(part.astype(float), axis=1)).mean()))


def _pasted(views: Views, patch: Image, place: tuple[int, int], disparity: int) -> Views:
    """Paste an object into both views."""
    (rows, columns), (top, start) = patch.shape, place
    left, right = (view.copy() for view in views)
    for view, first, seed in ((left, start, 5), (right, start - disparity, 6)):
        part = view[top : top + rows, first : first + columns]
        part[:] = noise(patch, seed, sigma=1)[: part.shape[0], : part.shape[1]]
    return left, right


def _faults(*, held: bool) -> list[tuple[str, Fault]]:
    """Return the faults by name; only held-out pairs get any."""
    known: list[tuple[str, Fault]] = [
        ("", lambda views: views),
        ("blurred", lambda views: (Degradation(disk_psf(2), noise=1)(views[0]), views[1])),
        ("noise 10", lambda views: (noise(views[0], 3, sigma=10), noise(views[1], 4, sigma=10))),
        ("JPEG 70", lambda views: (jpeg(views[0], 0, quality=70), jpeg(views[1], 0, quality=70))),
    ]
    return known if held else known[:1]
