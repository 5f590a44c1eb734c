"""Writes the results of a demonstration: maps, pictures, and a page that explains them."""

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from phasestereo import __version__
from phasestereo.io import write_disparity, write_image
from phasestereo.io.drafts import replace_text
from phasestereo.settings import PRESETS
from phasestereo.views.picture import Picture, colorize, disparity_picture, error_picture
from phasestereo.views.templating import render_page
from phasestereo_bench.arrays import Map
from phasestereo_bench.demo import trials
from phasestereo_bench.demo.trials import (
    NEIGHBORHOOD,
    NSAD,
    ROBUST,
    SGBM,
    WINDOW,
    Comparison,
    Demo,
    DemoMethod,
)
from phasestereo_bench.report.plots import figure_of, save_plot


def write_demo(demo: Demo, folder: str | os.PathLike[str]) -> list[Path]:
    """Write maps, pictures and ``report.html`` to a folder; replace those of an earlier demo.

    Parameters
    ----------
    demo
        The result of `run_demo`.
    folder
        The folder to write to; it is made if it does not exist.

    Returns
    -------
    list of Path
        The files written, the page last.

    Raises
    ------
    OSError
        If the folder cannot be made or a file cannot be written.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)

    truth = demo.pair.known_truth
    maps = {"truth": truth}
    maps |= {f"disparity_{o.method.key}": o.degraded.disparity for o in demo.outcomes}

    pictures = _pictures(demo)
    names = [*(f"{name}.pfm" for name in maps), *(f"{name}.png" for name in pictures)]
    for name, disparity in maps.items():
        write_disparity(target / f"{name}.pfm", disparity)
    for name, picture in pictures.items():
        write_image(target / f"{name}.png", picture)
    save_plot(_overview(demo), target / "overview.png")
    replace_text(target / "report.html", _page(demo, target))
    return [target / name for name in (*names, "overview.png", "report.html")]


def _pictures(demo: Demo) -> dict[str, Picture]:
    """Return all pictures by file name."""
    pair, truth = demo.pair, demo.pair.known_truth
    nonocc = pair.masks["nonocc"]

    pictures = {
        "left": demo.degraded,
        "left_sharp": pair.left,
        "right": pair.right,
        "nonocc": nonocc.astype(np.uint8) * np.uint8(255),
        "truth": disparity_picture(truth, title="Truth", **_ends(truth)),
    }

    for outcome in demo.outcomes:
        key, disparity = outcome.method.key, outcome.degraded.disparity
        title = _title(outcome)
        pictures[f"disparity_{key}"] = disparity_picture(disparity, title=title, **_ends(truth))
        pictures[f"error_{key}"] = error_picture(disparity, truth, nonocc)

    return pictures


def _overview(demo: Demo) -> Any:
    """Return one figure that shows the whole story."""
    pair, truth = demo.pair, demo.pair.known_truth
    shown = [outcome for outcome in demo.outcomes if outcome.method in (ROBUST, SGBM, NSAD)]
    found = [outcome.degraded.disparity for outcome in shown]

    pictures = [
        demo.degraded,
        pair.right,
        *(colorize(disparity, **_ends(truth)) for disparity in (truth, *found)),
        *(error_picture(disparity, truth, pair.masks["nonocc"]) for disparity in found),
    ]
    titles = [
        "Left: out of focus, dim and noisy",
        "Right: sharp",
        "Truth: far is blue, near is red",
        *map(_title, shown),
        "Errors: white is right, dark red is 4 pixels off or more",
        "Errors",
        "Errors",
    ]

    figure = figure_of(15.0, 12.5)
    figure.suptitle("One image out of focus: what is left of the disparities?", size=16)
    for axes, picture, title in zip(figure.subplots(3, 3).flat, pictures, titles, strict=True):
        axes.imshow(picture)
        axes.set_title(title, loc="left", size=9)
        axes.axis("off")
    return figure


def _title(outcome: Comparison) -> str:
    name = outcome.method.name
    sharp, degraded = outcome.sharp.bad, outcome.degraded.bad
    return f"{name[0].upper()}{name[1:]}: {degraded:.1f} % wrong (both sharp: {sharp:.1f} %)"


def _ends(truth: Map) -> dict[str, float]:
    """Return the limits of the colors, the same for all maps."""
    return {"low": float(truth.min()), "high": float(truth.max())}


def _page(demo: Demo, folder: Path) -> str:
    """Return the page that explains the pictures in the folder."""
    count = demo.pair.num_disparities
    ours = [outcome.method for outcome in demo.outcomes if outcome.method.settings is not None]
    arguments = {"num_disparities": count, **_changes(demo.outcomes[0].method)}

    return render_page(
        "demo.html.j2",
        package="phasestereo_bench",
        demo=demo,
        verdict=trials.verdict(demo),
        folder=folder,
        blur={
            "radius": trials.RADIUS,
            "gain": trials.GAIN,
            "offset": trials.OFFSET,
            "noise": trials.NOISE,
        },
        window=WINDOW,
        neighborhood=NEIGHBORHOOD,
        commands=[_command(count, method) for method in ours],
        arguments=", ".join(f"{name}={value!r}" for name, value in arguments.items()),
        version=__version__,
    )


def _changes(method: DemoMethod) -> dict[str, object]:
    """Return the preset and, by name, the fields that differ from it."""
    preset = PRESETS[method.preset]
    names = [field.name for field in fields(preset)]
    changed = [name for name in names if getattr(method.settings, name) != getattr(preset, name)]
    return {"preset": method.preset, **{name: getattr(method.settings, name) for name in changed}}


def _command(num_disparities: int, method: DemoMethod) -> str:
    options = {"num-disparities": num_disparities, **_changes(method)}
    spelt = " ".join(f"--{name} {value}" for name, value in options.items())
    return f"phasestereo match left.png right.png {spelt} --truth truth.pfm --truth-mask nonocc.png"
