"""The same bits on every platform: digests of matches, pinned.

`make test` checks them on this machine, `make test-arm64` on an emulated aarch64. A change of the
result changes them, and says why; the failing test prints what they are.
"""

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.selfcheck import DIGESTS, digest, pair


@pytest.mark.parametrize(("kind", "preset"), DIGESTS)
def test_digests_of_matches_are_those_of_every_platform(kind: str, preset: str) -> None:
    left, right = pair(kind)
    result = ps.match(left, right, num_disparities=32, preset=preset)
    assert digest(result) == DIGESTS[kind, preset]


@pytest.mark.parametrize("kind", ["sharp", "defocus", "motion"])
def test_pairs_are_of_the_scene(kind: str) -> None:
    """Digests of nonsense would be the same everywhere, too."""
    result = ps.match(*pair(kind), num_disparities=32)
    assert np.median(result.disparity[45:75, 75:105]) == pytest.approx(11, abs=1)
    assert np.median(result.disparity[:25, 30:]) == pytest.approx(5, abs=1)
