"""Files for the sites of benchmarks: others read them, and find what was matched."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phasestereo.io import write_image
from phasestereo_bench.datasets import find_scenes
from support import Run

cv2 = pytest.importorskip("cv2")

ROWS, COLS = 40, 96
NOISE = np.random.default_rng(0).integers(0, 256, (ROWS, COLS + 5, 3), dtype=np.uint8)


def ramp(left: np.ndarray, _right: np.ndarray, _count: int) -> np.ndarray:
    """Answer with a ramp, whose first row is unknown for gray images."""
    found = np.linspace(1, 9, left.shape[0] * left.shape[1], dtype=np.float32)
    found = found.reshape(left.shape[:2])
    found[0] = np.nan if left.ndim == 2 else found[0]
    return found


def pair(folder: Path, left: str, right: str, *, gray: bool = False) -> None:
    for file, view in ((left, NOISE[:, :-5]), (right, NOISE[:, 5:])):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        write_image(folder / file, view[..., 0] if gray else view)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a folder with a scene of each site, and none of them with a truth."""
    root = tmp_path / "data"
    pair(root / "MiddEval3/testH/Plants", "im0.png", "im1.png")
    pair(root / "MiddEval3/trainingH/Piano", "im0.png", "im1.png")
    pair(root / "two_view_test/lakeside_1l", "im0.png", "im1.png", gray=True)
    pair(root / "kitti2012/testing", "colored_0/000003_10.png", "colored_1/000003_10.png")
    pair(root / "data_scene_flow/testing", "image_2/000007_10.png", "image_3/000007_10.png")
    pair(root / "scenes2003/cones", "im2.png", "im6.png")
    return root


def test_the_zips_are_those_that_sites_take(
    tree: Path, tmp_path: Path, run: Callable[..., Run]
) -> None:
    out = tmp_path / "out"
    method = f"{__name__}:ramp"
    code, _, err = run("bench", "submit", tree, "--method", method, "--name", "Mine", "-o", out)
    assert code == 0, err
    assert "left out, no site takes them: scenes2003/cones" in err
    assert "MiddEval3-H: 2 scenes; the site takes 15 or 30" in err

    inside = {}
    for path in out.glob("*.zip"):
        with zipfile.ZipFile(path) as archive:
            inside[path.stem] = sorted(archive.namelist())
            archive.extractall(tmp_path / path.stem)

    assert inside == {
        "MiddEval3-H": [
            f"{scene}/{file}"
            for scene in ("testH/Plants", "trainingH/Piano")
            for file in ("disp0Mine.pfm", "timeMine.txt")
        ],
        "ETH3D": ["low_res_two_view/lakeside_1l.pfm", "low_res_two_view/lakeside_1l.txt"],
        "KITTI2012": ["000003_10.png"],
        "KITTI2015": ["disp_0/000007_10.png"],
    }

    expected = ramp(NOISE[:, :-5], NOISE, 1)
    found = cv2.imread(str(tmp_path / "MiddEval3-H/testH/Plants/disp0Mine.pfm"), -1)
    np.testing.assert_array_equal(found, expected)
    assert float((tmp_path / "MiddEval3-H/testH/Plants/timeMine.txt").read_text()) >= 0

    sparse = cv2.imread(str(tmp_path / "ETH3D" / inside["ETH3D"][0]), -1)
    assert np.isinf(sparse[0]).all()
    np.testing.assert_array_equal(sparse[1:], expected[1:])
    assert (tmp_path / "ETH3D" / inside["ETH3D"][1]).read_text().startswith("runtime 0.")

    for name in ("KITTI2012/000003_10.png", "KITTI2015/disp_0/000007_10.png"):
        stored = cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)
        np.testing.assert_allclose(stored / 256, expected, atol=1 / 512)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--name", "a/b"], "--name: got 'a/b'; accepts letters, digits, - and _"),
        (
            ["--scene", "cones"],
            "no scene of MiddEval3, ETH3D, KITTI2012, KITTI2015 among scenes2003",
        ),
        (["--method", "none"], "--method: got 'none'"),
    ],
)
def test_refusals(tree: Path, run: Callable[..., Run], arguments: list[str], message: str) -> None:
    code, _, err = run("bench", "submit", tree, *arguments)
    assert code != 0
    assert message in " ".join(err.split())


def test_kittis_scenes_have_their_truth(data: Path) -> None:
    scenes = {str(scene): scene for scene in find_scenes(data / "planes/kitti2012/training")}
    assert list(scenes) == [f"kitti2012/training/{number}_10" for number in ("000027", "000151")]

    loaded = scenes["kitti2012/training/000027_10"].load()
    assert (loaded.left.shape, loaded.num_disparities) == (loaded.truth.shape, 192)
    assert not (loaded.masks["nonocc"] & ~loaded.masks["all"]).any()
    assert 0.1 < loaded.masks["nonocc"].mean() < loaded.masks["all"].mean() < 0.5
