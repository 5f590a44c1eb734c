"""Settings and presets: what they hold, what they refuse, and that they travel."""

from __future__ import annotations

import dataclasses
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import _core
from phasestereo.settings import PresetName
from support import oracle

ROOT = Path(__file__).parents[2]
IMAGE = np.zeros((4, 5), np.uint8)


def test_robust_is_the_default_with_settings_and_without() -> None:
    assert list(ps.PRESETS) == ["robust", "paper", "fast"]
    assert ps.Settings() == ps.Settings.preset("robust")
    without = ps.match(IMAGE, IMAGE, num_disparities=2, uniqueness=5)
    settings = ps.Settings(uniqueness=5)
    assert ps.match(IMAGE, IMAGE, num_disparities=2, settings=settings).settings == settings
    assert without.settings == settings


def test_presets_are_had_by_name() -> None:
    for name in get_args(PresetName):
        settings = ps.PRESETS[name]
        assert ps.Settings.preset(name) == settings
        assert ps.match(IMAGE, IMAGE, num_disparities=2, preset=name).settings == settings

    paper = ps.Settings.preset("paper")
    assert (paper.neighborhood, paper.window, paper.frequencies) == (7, 9, (2, 1))
    assert (paper.power, paper.bits, paper.p1, paper.p2) == (1, 2, 2, 2)

    with pytest.raises(ValueError, match="^preset: got 'blind'; accepts 'robust', 'paper', 'fast'"):
        ps.Settings.preset("blind")


def test_a_preset_beside_settings_is_refused() -> None:
    both: dict[str, Any] = {"preset": "robust", "settings": ps.Settings()}
    with pytest.raises(TypeError, match="^preset: got 'robust' beside settings"):
        ps.match(IMAGE, IMAGE, num_disparities=2, **both)
    with pytest.raises(TypeError, match="^preset: got 'robust' beside settings"):
        ps.Matcher(**both)


def test_fast_fits_bytes_from_costs_to_paths() -> None:
    """What fast is made for; wider integers would be several times as slow."""
    fast = ps.PRESETS["fast"]
    assert (fast.precision, fast.optimizer, fast.confidence) == ("byte", "so", False)

    r, s = fast.frequencies
    ceiling = (r * (2 * s + 1) + s) * 2 ** (fast.bits - 1)
    assert fast.window * ceiling <= 255

    dropped = oracle.dropped_bits(fast.window, ceiling, fast.p2)
    p2 = oracle.window_penalty(fast.p2, fast.window, dropped)
    assert fast.window * (fast.window * ceiling >> dropped) + p2 <= 255


def test_settings_are_frozen_hashable_and_picklable() -> None:
    settings = ps.Settings(window=11, p1=1, p2=2.5, intensity_range=(0, 1))
    assert pickle.loads(pickle.dumps(settings)) == settings  # noqa: S301  # our own bytes
    assert hash(settings) == hash(dataclasses.replace(settings))
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.window = 3  # type: ignore[misc]  # that is the point


def test_overrides_take_precedence() -> None:
    base = ps.Settings(window=5, uniqueness=3)
    result = ps.match(IMAGE, IMAGE, num_disparities=2, settings=base, window=3)
    assert result.settings == ps.Settings(window=3, uniqueness=3)


def test_the_class_and_the_glossary_are_written_from_the_table_of_the_core() -> None:
    program = [sys.executable, str(ROOT / "rust" / "python" / "write_settings.py"), "--check"]
    run = subprocess.run(program, capture_output=True, text=True, check=False)  # noqa: S603 -- ours
    assert (run.returncode, run.stderr) == (0, "")


def test_flags_are_those_of_the_core() -> None:
    assert {flag.name: flag.value for flag in ps.Flag} == _core.FLAGS


BAD_VALUES: list[tuple[dict[str, Any], str]] = [
    ({"neighborhood": 8}, "neighborhood"),
    ({"neighborhood": 1}, "neighborhood"),
    ({"neighborhood": 65}, "neighborhood"),
    ({"neighborhood": -7}, "neighborhood"),
    ({"neighborhood": 10**30}, "neighborhood"),
    ({"window": 4}, "window"),
    ({"window": 0}, "window"),
    ({"window": 65}, "window"),
    ({"frequencies": (0, 0)}, "frequencies"),
    ({"frequencies": (5, 1), "neighborhood": 63}, "frequencies"),
    ({"frequencies": (4, 1)}, "frequencies"),
    ({"frequencies": (-1, 1)}, "frequencies"),
    ({"power": 0}, "power"),
    ({"power": 3}, "power"),
    ({"bits": 0}, "bits"),
    ({"bits": 5}, "bits"),
    ({"noise_threshold": -0.1}, "noise_threshold"),
    ({"noise_threshold": 100.5}, "noise_threshold"),
    ({"noise_threshold": float("nan")}, "noise_threshold"),
    ({"noise_threshold": 10**400}, "noise_threshold"),
    ({"noise_threshold": 1, "bits": 1}, "noise_threshold"),
    ({"noise_threshold": 1, "bits": 3}, "noise_threshold"),
    ({"noise_threshold": 1, "cost": "sad"}, "noise_threshold"),
    ({"noise_threshold": 1, "frequencies": (3, 2)}, "frequencies .* bits"),
    ({"p1": -0.5}, "p1"),
    ({"p1": float("nan")}, "p1"),
    ({"p2": float("inf")}, "p2"),
    ({"intensity_range": (1, 1)}, "intensity_range"),
    ({"intensity_range": (0, float("inf"))}, "intensity_range"),
    ({"intensity_range": (0, 1e306)}, "intensity_range"),
    ({"intensity_range": (0, 10**400)}, "intensity_range"),
    ({"p2": 10**400}, "p2"),
    ({"cost": "ssd"}, "cost"),
    ({"taper": "kaiser"}, "taper"),
    ({"optimizer": "sgd"}, "optimizer"),
    ({"adaptive_p2": -0.1}, "adaptive_p2"),
    ({"adaptive_p2": 1000.5}, "adaptive_p2"),
    ({"adaptive_p2": float("nan")}, "adaptive_p2"),
    ({"lr_check": -1}, "lr_check"),
    ({"lr_check": 16385}, "lr_check"),
    ({"lr_check": 10**30}, "lr_check"),
    ({"uniqueness": -1}, "uniqueness"),
    ({"uniqueness": 101}, "uniqueness"),
    ({"uniqueness": 10**30}, "uniqueness"),
    ({"speckle_size": -1}, "speckle_size"),
    ({"speckle_size": 10**30}, "speckle_size"),
    ({"speckle_range": -1}, "speckle_range"),
    ({"speckle_range": 16384.5}, "speckle_range"),
    ({"speckle_range": float("nan")}, "speckle_range"),
    ({"median": 1}, "median"),
    ({"median": 5}, "median"),
    ({"median": -3}, "median"),
    ({"min_confidence": -0.1}, "min_confidence"),
    ({"min_confidence": 1.1}, "min_confidence"),
    ({"min_confidence": float("nan")}, "min_confidence"),
    ({"budget": -1}, "budget"),
    ({"budget": float("inf")}, "budget"),
    ({"precision": "half"}, "precision"),
    ({"frequencies": (4, 4), "neighborhood": 9}, "frequencies .* bits"),
]

BAD_TYPES: list[dict[str, Any]] = [
    {"neighborhood": 7.0},
    {"neighborhood": True},
    {"neighborhood": "7"},
    {"neighborhood": None},
    {"window": np.float32(9)},
    {"frequencies": 2},
    {"frequencies": (2, 1, 0)},
    {"frequencies": (2.0, 1)},
    {"power": False},
    {"bits": [2]},
    {"noise_threshold": "1"},
    {"noise_threshold": None},
    {"noise_threshold": True},
    {"p1": "2"},
    {"p1": True},
    {"p2": np.bool_(1)},
    {"p2": 1j},
    {"p2": (1, 2)},
    {"p1": None},
    {"intensity_range": 255},
    {"intensity_range": ("0", "1")},
    {"shiftable": 1},
    {"fill": None},
    {"cost": 1},
    {"optimizer": b"dp"},
    {"precision": 8},
    {"adaptive_p2": "1"},
    {"adaptive_p2": None},
    {"adaptive_p2": True},
    {"subpixel": 1},
    {"subpixel": None},
    {"lr_check": 1.0},
    {"lr_check": True},
    {"lr_check": "1"},
    {"uniqueness": 10.0},
    {"uniqueness": True},
    {"uniqueness": None},
    {"speckle_size": 100.0},
    {"speckle_size": None},
    {"speckle_size": True},
    {"speckle_range": "1"},
    {"speckle_range": None},
    {"guided_median": 1},
    {"median": 3.0},
    {"median": True},
    {"median": None},
    {"min_confidence": "0.5"},
    {"min_confidence": None},
    {"min_confidence": False},
    {"confidence": 0},
    {"confidence": None},
]


@pytest.mark.parametrize(("fields", "name"), BAD_VALUES)
def test_bad_values_are_refused_by_name(fields: dict[str, Any], name: str) -> None:
    with pytest.raises(ValueError, match=rf"^{name}.*: got .*; accepts "):
        dataclasses.replace(ps.Settings.preset("paper"), **fields)
    with pytest.raises(ValueError, match=f"^{name}"):
        ps.match(IMAGE, IMAGE, num_disparities=2, preset="paper", **fields)


@pytest.mark.parametrize("fields", BAD_TYPES)
def test_bad_types_are_refused_by_name(fields: dict[str, Any]) -> None:
    name = next(iter(fields))
    with pytest.raises(TypeError, match=f"^{name}: got .*; accepts "):
        ps.Settings(**fields)


def test_integers_of_numpy_are_integers() -> None:
    settings = ps.Settings(window=np.int64(5), p2=np.float32(1.5))  # type: ignore[arg-type]  # numpy's
    assert settings.window == 5


def test_unknown_names_are_refused_with_what_there_is() -> None:
    with pytest.raises(
        ValueError, match="^preset: got 'blind'; accepts 'robust', 'paper', 'fast'$"
    ):
        ps.match(IMAGE, IMAGE, num_disparities=2, preset="blind")  # type: ignore[arg-type]

    with pytest.raises(
        TypeError, match=r"^windows: no such setting .*; accepts cost, neighborhood"
    ):
        ps.match(IMAGE, IMAGE, num_disparities=2, windows=5)  # type: ignore[call-arg]

    with pytest.raises(TypeError, match="^preset: got int"):
        ps.match(IMAGE, IMAGE, num_disparities=2, preset=1)  # type: ignore[arg-type]  # the point

    with pytest.raises(TypeError, match="^settings: got dict"):
        ps.match(IMAGE, IMAGE, num_disparities=2, settings={})  # type: ignore[arg-type]  # the point
