"""Matches with MC-CNN-fast, a learned cost of CNES's package `mccnn`, and libSGM's optimization.

The weights come from the package, Apache-2.0. They were trained on Middlebury's own pairs with
their truth, and the scenes of this benchmark are among them, so its figures are those of a training
set.
"""

from importlib import import_module
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo_bench.arrays import Image, Map

WEIGHTS = "onnx_fast_int8"

# The best on cones, Piano and Aloe, sharp; means of bad-1.0 in %:  0.1, 0.5: 9.6   0.15, 1: 8.8
# 0.2, 1.5: 8.5   0.2, 2.5: 8.7   0.3, 2: 8.3   0.4, 4: 8.6;  Pandora's for MC-CNN, 2.3, 42.3: 17.4
PENALTIES = (0.3, 2.0)

SETTINGS: dict[str, Any] = {"weights": WEIGHTS, "P1": PENALTIES[0], "P2": PENALTIES[1]}

_HOW = "which comes with: pip install './benches/harness[mccnn]'"

_GRAY = np.array([0.299, 0.587, 0.114])
_REACH = 5  # px: half of the 11 x 11 that a feature sees; maps are this much smaller
_WORST = 1.0  # the worst cost; costs are similarities from -1 to 1 with their sign changed
_EIGHT = ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1))


def match_mccnn(left: Image, right: Image, num_disparities: int) -> Map:
    """Match with MC-CNN-fast's costs along eight directions, to whole disparities.

    Raises
    ------
    ImportError
        If `mccnn` or `libsgm` is not installed.
    """
    network, weights, sgm = needed()
    gray = [image if image.ndim == 2 else image @ _GRAY for image in (left, right)]
    gray = [np.pad(image.astype(np.float32), _REACH, mode="edge") for image in gray]
    path = str(weights.get_weights(WEIGHTS))
    cost = network.run_mc_cnn_fast(*gray, 1 - num_disparities, 0, path)  # from the largest to 0

    # libSGM takes no NaN, so places without a match cost the most, and are never chosen below.
    outside = np.isnan(cost)
    cost[outside] = _WORST

    shape = (*cost.shape[:2], len(_EIGHT))
    low, high = (np.full(shape, penalty, np.float32) for penalty in PENALTIES)
    whole = np.ones(cost.shape[:2], np.float32)  # one segment
    directions = np.array(_EIGHT, np.int32)
    options = (False, False, False)  # no paths kept, no overcounting, no edges

    total = sgm.sgm_api(cost, low, high, directions, _WORST, whole, *options)["cv"]
    total[outside] = np.inf

    return (num_disparities - 1 - total.argmin(axis=2)).astype(np.float32)


def needed() -> tuple[Any, Any, Any]:
    """Return the modules that the match needs.

    Raises
    ------
    ImportError
        If one is not installed.
    """
    try:
        network = import_module("mc_cnn.run")
        weights = import_module("mc_cnn.weights")
    except ModuleNotFoundError as error:
        if error.name is not None and not error.name.startswith("mc_cnn"):
            raise ImportError(f"mccnn needs {error.name}, {_HOW}") from error
        raise ImportError("mccnn is not installed; pip install --no-deps mccnn") from error

    return network, weights, require("c_libsgm", extra="mccnn", of="./benches/harness")
