"""The same bits on every platform: digests that the core pins, by the wheel that is installed.

The Rust tests check them at every level of instructions; `make test-arm64` on an emulated aarch64.
"""

from phasestereo import _core


def test_matches_are_to_the_bit_those_of_every_platform() -> None:
    seen: list[tuple[int, int]] = []
    assert _core.self_check(lambda *done: seen.append(done)) == []
    done, pairs = seen[-1]
    assert done == pairs > 0
