"""The engine for GPUs through Python: the bits of the core, what it refuses, what `doctor` says.

On the adapter that the environment variable ``PHASESTEREO_GPU`` names a part of; by default Mesa's
software driver for Vulkan, which computes on the processor. `make test-gpu` builds and installs it.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from support import ENVIRONMENT, Run, counterpart

phasestereo_gpu = counterpart("phasestereo_gpu")
NAME = os.environ.get("PHASESTEREO_GPU", "llvmpipe")

Images = tuple[NDArray[Any], NDArray[Any]]


@pytest.fixture(autouse=True)
def adapter() -> str:
    """Return the name of the adapter."""
    for name, *_ in phasestereo_gpu.adapters():
        if NAME.lower() in name.lower():
            return str(name)
    pytest.skip(f"no adapter {NAME!r}: apt-get install mesa-vulkan-drivers")


class Counting:
    """A device that counts what it is asked."""

    tasks = 0

    def __init__(self, name: str | None) -> None:
        self.gpu = _GPU(name)
        self.name, self.limits = self.gpu.name, self.gpu.limits

    def search(self, *task: Any) -> bytes:
        type(self).tasks += 1
        return bytes(self.gpu.search(*task))


_GPU = phasestereo_gpu.Gpu


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], int]]:
    """Return a function that returns the number of tasks since it was called last."""
    monkeypatch.setattr(phasestereo_gpu, "Gpu", Counting)

    def count() -> int:
        counted, Counting.tasks = Counting.tasks, 0
        return counted

    count()
    yield count
    count()


def pair(rows: int, cols: int, dtype: str = "u1", seed: int = 0) -> Images:
    """Return a textured pair with blocks at disparities of 2 to 11, and some noise."""
    rng = np.random.default_rng(seed)
    scale = 257 if dtype == "u2" else 1
    texture = scale * rng.integers(0, 240, (rows, cols + 16))
    blocks = rng.integers(2, 12, (rows // 24 + 1, cols // 30 + 1))
    shift = blocks.repeat(24, axis=0).repeat(30, axis=1)[:rows, :cols]
    left = np.take_along_axis(texture, np.arange(cols) + shift, axis=1)
    noise = scale * rng.integers(0, 15, (rows, cols))
    return left.astype(dtype), (texture[:, :cols] + noise).astype(dtype)


CASES: list[tuple[int, int, dict[str, Any], bool]] = [
    (150, 201, {"preset": "fast"}, True),
    (150, 201, {"preset": "robust"}, True),
    (65, 63, {"preset": "fast", "optimizer": "sgm"}, True),
    (129, 97, {"preset": "robust", "num_disparities": 33, "min_disparity": -7}, True),
    (48, 150, {"preset": "robust", "num_disparities": None}, True),
    (131, 80, {"preset": "fast", "num_disparities": 1}, True),
    (1, 64, {"preset": "fast", "num_disparities": 3}, True),
    (90, 120, {"preset": "paper"}, False),
    (90, 120, {"preset": "fast", "window": 33, "precision": "full"}, False),
]


@pytest.mark.parametrize(("rows", "cols", "given", "is_taken"), CASES)
def test_a_match_has_the_bits_of_the_core(
    rows: int, cols: int, given: dict[str, Any], is_taken: object, tasks: Callable[[], int]
) -> None:
    asked: dict[str, Any] = {"num_disparities": 20} | given
    search = {
        name: asked.pop(name) for name in ("num_disparities", "min_disparity") if name in asked
    }
    matcher = ps.Matcher(device=NAME, **asked)
    values = 0
    for dtype in ("u1", "u2"):
        left, right = pair(rows, cols, dtype, seed=rows)
        mask = np.arange(rows * cols).reshape(rows, cols) % 11 > 0
        choices: list[dict[str, Any]] = [{}, {"left_mask": mask}]
        for masks in choices:
            expected = ps.match(left, right, **search, **asked, **masks)
            found = matcher.match(left, right, **search, **masks)
            assert found.findings == expected.findings
            for name, bits in expected.maps.items():
                if bits is not None:
                    assert found.maps[name].tobytes() == bits.tobytes(), (name, dtype, masks)
                    values += bits.size
    assert (tasks() > 0) == is_taken
    print(f"{rows} x {cols}, {given}: {values} values, none differs")  # noqa: T201 -- for -s


def test_a_video_has_the_bits_of_the_core(tasks: Callable[[], int]) -> None:
    rigs = [ps.Rig(preset="fast", num_disparities=20, device=device) for device in ("cpu", NAME)]
    for seed in range(3):
        images = pair(100, 140, seed=seed)
        expected, found = (rig.match(*images).disparity for rig in rigs)
        assert found.tobytes() == expected.tobytes()
    assert tasks() > 0


def test_an_adapter_is_opened_by_a_part_of_its_name(adapter: str) -> None:
    assert ps.Matcher(device=adapter[1:].upper()).device == adapter
    with pytest.raises(
        ValueError, match="^device: got nothing of the kind; accepts a part of"
    ) as e:
        ps.Matcher(device="nothing of the kind")
    assert adapter in str(e.value)

    kinds = {kind for _, kind, *_ in phasestereo_gpu.adapters()}
    if kinds == {"cpu"}:  # software drivers are slower than the core
        with pytest.raises(ValueError, match="^device: got gpu; accepts a GPU; software") as e:
            ps.Matcher(device="gpu")
        assert adapter in str(e.value)
        assert ps.Matcher(device="auto").device == "cpu"


def test_tasks_that_are_not_whole_are_refused() -> None:
    gpu = phasestereo_gpu.Gpu(NAME)
    good = [8, 4, 4, 1, 12, 1, 0, 2, 9, 5, 3, 3, 0, 4, 0, 4, 0, 1, 0, 0]
    codes = bytes(8 * 4), bytes(12 * 4), bytes(8 * 4)
    assert len(gpu.search(good, *codes)) == 8 * 4 * 3 * 4
    for index, value in [(0, 9), (1, 5), (2, 0), (3, 2), (4, 13), (5, 16), (14, 4), (15, 5)]:
        wrong = [value if at == index else number for at, number in enumerate(good)]
        with pytest.raises(ValueError, match="^numbers: got sizes that are not those"):
            gpu.search(wrong, *codes)


def test_doctor_and_the_command_line(
    run: Callable[..., Run], adapter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasestereo._core.self_check", lambda _: [])
    monkeypatch.setattr("phasestereo.cli.doctor._ROUNDS", 1)
    code, out, _ = run("doctor", "--json")
    found = json.loads(out)
    assert code == 0
    assert adapter in [one["name"] for one in found["adapters"]]
    version = found["versions"].get("phasestereo-gpu", ps.__version__)  # unless it is on the path
    assert version == phasestereo_gpu.__version__ == ps.__version__
    assert found["device"] == ps.Matcher(device="auto").device
    code, out, _ = run("doctor")
    assert f"auto takes: {found['device']}" in " ".join(out.split())

    for name, image in zip(("left.npy", "right.npy"), pair(90, 120), strict=True):
        np.save(tmp_path / name, image)
    files = tmp_path / "left.npy", tmp_path / "right.npy"
    for device in ("cpu", NAME):
        more = "--device", device, "--output", tmp_path / f"{device}.pfm"
        done = run("match", *files, "--num-disparities", 20, *more)
        assert done[0] == 0, done
    assert (tmp_path / f"{NAME}.pfm").read_bytes() == (tmp_path / "cpu.pfm").read_bytes()
    code, _, err = run("match", *files, "--device", "nothing of the kind")
    assert (code, adapter in err) == (2, True)
    assert "--device: got nothing of the kind" in err


def python(program: str, **environment: str) -> str:
    """Run a program in a process of its own, and return its output."""
    done = subprocess.run(  # noqa: S603 -- our own
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT | environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_without_a_driver_the_processor_matches() -> None:
    program = (
        "import phasestereo as ps, phasestereo_gpu\n"
        "print(phasestereo_gpu.adapters(), ps.Matcher(device='auto').device)\n"
        "try: ps.Matcher(device='gpu')\n"
        "except ValueError as error: print(error)"
    )
    nowhere = dict.fromkeys(["VK_DRIVER_FILES", "VK_ICD_FILENAMES"], "/nonexistent.json")
    said = python(program, **nowhere)
    assert said.startswith(
        "[] cpu\ndevice: got gpu; accepts an adapter of Vulkan or Metal, of which"
    )


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_leaves_the_device_to_its_parent() -> None:
    program = f"""
import os, numpy as np, phasestereo as ps
images = np.random.default_rng(0).integers(0, 256, (2, 70, 90), np.uint8)
matcher = ps.Matcher(preset="fast", device={NAME!r})
def run():
    found = matcher.match(*images, num_disparities=8)
    print(hash(found.disparity.tobytes()), [one.sentence[:19] for one in found.findings
          if "before this process was forked" in one.sentence], flush=True)
run()
child = os.fork()
if not child:
    run()
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
run()
"""
    before, child, after = python(program, PYTHONHASHSEED="0").splitlines()
    assert before == after
    assert before.endswith(" []")
    assert child == before.replace("[]", "['the GPU failed, and']")
