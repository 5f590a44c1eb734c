"""``phasestereo bench video``: rendered videos -> how right and how steady a stream's maps are."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from typing import Annotated

from cyclopts import Parameter, validators

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo.settings import PRESETS
from phasestereo_bench.cases import require_known
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Names, Natural
from phasestereo_bench.video import compared, steadiness_table


def video(
    *,
    preset: Names = ("fast", "robust"),
    noise: Annotated[float, Parameter(validator=validators.Number(gte=0))] = 3.0,
    seed: Natural = 0,
) -> None:
    """Score streams on rendered videos, without and with the temporal filter.

    Three sequences of 12 frames with fresh noise in each: a scene that stands still, a camera that
    moves, an object that moves before a scene that stands still. Every number is given without the
    filter and with it. It takes half a minute:

    ```
    phasestereo bench video
    ```

    Parameters
    ----------
    preset
        Settings to match with, some of the presets; fast and robust without it.
    noise
        Standard deviation of the noise, gray levels.
    seed
        Of the scene and the noise.
    """
    with refusals(options={"preset", "noise", "seed"}):
        require_known("preset", preset, PRESETS)
        say("rendering and matching 3 sequences")
        table = steadiness_table(list(compared(preset, noise, seed)))

    show({f"Frame by frame -> temporal filter, noise {noise:g}": table})
