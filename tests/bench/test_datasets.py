"""Datasets: every real scene as it is described, and made-up trees for what is not at hand."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import math
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from phasestereo.io import write_disparity, write_image
from phasestereo_bench.datasets import Pair, Scene, find_scene, find_scenes

REAL = {
    # (height, width), least and largest disparity, disparities to search
    "MiddEval3/trainingQ/Motorcycle": ((497, 741), 9.18, 62.88, 80),
    "MiddEval3/trainingQ/MotorcycleE": ((497, 741), 9.18, 62.88, 80),
    "MiddEval3/trainingQ/Piano": ((481, 707), 10.13, 51.44, 80),
    "MiddEval3/trainingQ/Playroom": ((476, 699), 9.76, 73.58, 80),
    "scenes2001/tsukuba": ((288, 384), 5.0, 14.0, 16),
    "scenes2001/venus": ((383, 434), 3.0, 19.75, 32),
    "scenes2003/cones": ((375, 450), 5.5, 55.0, 64),
    "scenes2005/ThirdSize/Art": ((370, 463), 24.33, 74.67, 80),
    "scenes2005/ThirdSize/Moebius": ((370, 463), 21.33, 72.67, 80),
    "scenes2006/ThirdSize/Aloe": ((370, 427), 14.33, 70.33, 80),
    "scenes2006/ThirdSize/Baby1": ((370, 413), 8.33, 45.33, 80),
    "scenes2006/ThirdSize/Lampshade1": ((370, 433), 14.00, 64.67, 80),
    "scenes2006/ThirdSize/Rocks1": ((370, 425), 19.33, 56.67, 80),
}
V2 = ("scenes2001/tsukuba", "scenes2001/venus", "scenes2003/cones")


@pytest.fixture(scope="module")
def pairs(data: Path) -> dict[str, Pair]:
    return {str(scene): scene.load() for scene in find_scenes(data / "middlebury")}


def test_every_real_scene_is_found_in_order(data: Path) -> None:
    assert [str(scene) for scene in find_scenes(data / "middlebury")] == list(REAL)


@pytest.mark.parametrize("name", REAL)
def test_a_real_scene_has_its_size_its_disparities_and_its_range(
    pairs: dict[str, Pair], name: str
) -> None:
    pair = pairs[name]

    size, least, largest, num_disparities = REAL[name]
    assert pair.name == name.rsplit("/", 1)[1]
    assert pair.left.shape == pair.right.shape == (*size, 3)
    assert pair.left.dtype == pair.right.dtype == np.uint8

    assert pair.truth.shape == size
    assert pair.truth.dtype == np.float32
    assert np.nanmin(pair.truth) == pytest.approx(least, abs=0.006)
    assert np.nanmax(pair.truth) == pytest.approx(largest, abs=0.006)
    assert not np.isinf(pair.truth).any()

    assert pair.num_disparities == num_disparities


def test_no_pixel_is_scored_without_a_truth_and_none_visible_left_out_of_all(
    pairs: dict[str, Pair],
) -> None:
    for name, pair in pairs.items():
        column = np.arange(pair.truth.shape[1])

        for region, mask in pair.masks.items():
            assert mask.dtype == np.bool_, name
            assert mask.shape == pair.truth.shape, name
            assert np.isfinite(pair.truth[mask]).all(), (name, region)
        assert ((column - pair.truth)[pair.masks["nonocc"]] >= 0).all(), name

        occluded = pair.masks["all"] & ~pair.masks["nonocc"]
        assert occluded.mean() > 0.015, name
        assert not (pair.masks["nonocc"] & ~pair.masks["all"]).any(), name


@pytest.mark.parametrize(
    ("name", "nonocc", "everywhere", "disc"),
    [
        ("scenes2001/tsukuba", 77.26, 79.3, 14.28),
        ("scenes2001/venus", 88.69, 90.41, 6.34),
        ("scenes2003/cones", 85.24, 96.78, 27.96),
    ],
)
def test_regions_of_version_2_have_their_shares(
    pairs: dict[str, Pair], name: str, nonocc: float, everywhere: float, disc: float
) -> None:
    masks = pairs[name].masks
    shares = [round(100 * float(masks[region].mean()), 2) for region in ("nonocc", "all", "disc")]
    assert shares == [nonocc, everywhere, disc]


@pytest.mark.parametrize("name", REAL)
def test_the_truth_takes_the_right_image_to_the_left_one(pairs: dict[str, Pair], name: str) -> None:
    pair = pairs[name]

    still = warp_error(pair, np.zeros_like(pair.truth))
    right_order = warp_error(pair, pair.truth)
    swapped = warp_error(pair, -pair.truth)
    wrong_scale = min(warp_error(pair, pair.truth * factor) for factor in (0.75, 1.25))

    exposure = name.endswith("MotorcycleE")  # here much of the error is the change of contrast
    assert right_order < (0.8 if exposure else 0.5) * min(still, swapped)
    assert right_order < 0.9 * wrong_scale


def warp_error(pair: Pair, disparity: npt.NDArray[np.float32]) -> float:
    """Mean gray-level difference of the left image and the right one taken at x - d."""
    left, right = pair.left.mean(axis=2), pair.right.mean(axis=2)
    column = np.arange(left.shape[1]) - disparity
    inside = pair.masks["nonocc"] & (column >= 0) & (column <= left.shape[1] - 1)
    at = np.where(inside, column, 0).round().astype(int)
    return float(np.mean(np.abs(left - np.take_along_axis(right, at, axis=1))[inside]))


# --- made-up trees -----------------------------------------------------------------------------

SIZE = (2, 12)
CALIBRATION = """cam0=[100 0 6; 0 100 1; 0 0 1]
cam1=[100 0 6; 0 100 1; 0 0 1]
doffs=0
baseline=100
width=12
height=2
ndisp={ndisp}
"""


def levels(*row: float) -> npt.NDArray[np.uint8]:
    return np.tile(np.array(row, np.uint8), (2, 1))


def put(folder: Path, **files: npt.NDArray[Any] | str) -> Path:
    """Write files into a folder, `_` standing for the dot of their names."""
    folder.mkdir(parents=True, exist_ok=True)
    for key, content in files.items():
        path = folder / ".".join(key.rsplit("_", 1))
        if isinstance(content, str):
            path.write_text(content)
        elif path.suffix == ".pfm":
            write_disparity(path, content)
        else:
            write_image(path, content)
    return folder


def plain(channels: int | None = 3) -> npt.NDArray[np.uint8]:
    return np.zeros(SIZE if channels is None else (*SIZE, channels), np.uint8)


def cones(root: Path, **more: npt.NDArray[Any] | str) -> Scene:
    """Make a scene of the layout of 2003: a truth of 1 px, 4 px and unknown."""
    files: dict[str, npt.NDArray[Any] | str] = {
        "im2_png": plain(),
        "im6_png": plain(),
        "disp2_png": levels(4, 4, 4, 4, 16, 16, 16, 16, 0, 0, 4, 4),
    }

    folder = put(root / "scenes2003" / "made up", **files | more)
    (scene,) = find_scenes(folder)
    return scene


@pytest.mark.parametrize(
    ("collection", "files", "scale", "num_disparities"),
    [
        ("scenes2001", "im2.ppm im6.ppm disp2.pgm disp6.pgm", 8, 32),
        ("scenes2001", "im0.pgm im1.pgm disp0.pgm disp1.pgm", 8, 32),
        ("scenes2003", "im2.png im6.png disp2.png disp6.png", 4, 64),
        ("scenes2003", "im2.ppm im6.ppm disp2.pgm disp6.pgm", 4, 64),
        ("scenes2005/ThirdSize", "view1.png view5.png disp1.png disp5.png", 3, 80),
        ("scenes2005/HalfSize", "view1.png view5.png disp1.png disp5.png", 2, 120),
        ("scenes2006/HalfSize", "view1.png view5.png disp1.png disp5.png", 2, 120),
        ("scenes2006/FullSize", "view1.png view5.png disp1.png disp5.png", 1, 240),
        ("MiddEval3/trainingH", "im0.png im1.png disp0GT.pfm disp1GT.pfm", None, 160),
        ("MiddEval3/trainingF", "im0.png im1.png disp0GT.pfm disp1GT.pfm", None, 320),
    ],
)
def test_layouts_that_are_not_at_hand(
    tmp_path: Path, collection: str, files: str, scale: int | None, num_disparities: int
) -> None:
    left, right, truth, truth_right = files.split()
    folder = tmp_path / collection / "Made-up"
    folder.mkdir(parents=True)

    image = plain(None if left.endswith("pgm") else 3)
    write_image(folder / left, image + np.uint8(1))
    write_image(folder / right, image + np.uint8(2))

    disparity = np.full(SIZE, 6, np.float32)
    disparity[0, 0] = math.nan
    for file, values in ((truth, disparity), (truth_right, disparity + 1)):
        if scale is None:
            write_disparity(folder / file, values)
        else:
            write_image(folder / file, (np.nan_to_num(values) * scale).astype(np.uint8))

    (scene,) = find_scenes(tmp_path)
    assert (scene.name, str(scene)) == ("Made-up", f"{collection}/Made-up")

    pair = scene.load()
    assert (pair.left.max(), pair.right.max()) == (1, 2)

    np.testing.assert_array_equal(pair.truth, disparity)
    assert (pair.truth_right[1, 1], pair.num_disparities) == (7, num_disparities)


@pytest.mark.parametrize(("name", "scale"), [("cones", 4), ("conesH", 2), ("conesF", 1)])
def test_the_sizes_of_2003_follow_from_the_names_of_their_folders(
    tmp_path: Path, name: str, scale: int
) -> None:
    put(
        tmp_path / "scenes2003" / name,
        im2_ppm=plain(),
        im6_ppm=plain(),
        disp2_pgm=levels(0, *[40] * 11),
    )

    (scene,) = find_scenes(tmp_path)
    pair = scene.load()

    assert (scene.name, pair.num_disparities) == (name, 256 // scale)
    assert np.isnan(pair.truth[0, 0])
    assert pair.truth[0, 1] == 40 / scale


@pytest.mark.parametrize(("size", "most"), [("cones", 450), ("conesH", 900), ("conesF", 1800)])
def test_a_size_of_2003_is_not_wider_than_its_name_tells(
    tmp_path: Path, size: str, most: int
) -> None:
    for width, refused in (
        (most, nullcontext()),
        (most + 1, pytest.raises(ValueError, match=f"up to {most} px wide")),
    ):
        wide = np.zeros((2, width, 3), np.uint8)
        put(tmp_path / "scenes2003" / size, im2_ppm=wide, im6_ppm=wide)
        (scene,) = find_scenes(tmp_path)
        with refused:
            assert scene.load().left.shape == wide.shape


@pytest.mark.parametrize(
    ("folder", "left", "collection"),
    [
        ("scenes2001/data/venus", "im2_ppm", "scenes2001"),
        ("scenes2003/newdata/cones", "im2_png", "scenes2003"),
        ("scenes2003/newdata/full/conesF", "im2_ppm", "scenes2003"),
        ("scenes2014/datasets/Pipes-perfect", "im0_png", "scenes2014"),
        ("scenes2021/data/chess1", "im0_png", "scenes2021"),
    ],
)
def test_a_mirror_of_the_site_has_the_same_scenes(
    tmp_path: Path, folder: str, left: str, collection: str
) -> None:
    path = put(tmp_path / folder, **{left: plain()})
    for root in (tmp_path, *path.parents[: len(path.relative_to(tmp_path).parts) - 1], path):
        assert [(str(scene), scene.folder) for scene in find_scenes(root)] == [
            (f"{collection}/{path.name}", path)
        ]


def disparities(value: float) -> npt.NDArray[np.float32]:
    return np.full(SIZE, value, np.float32)


@pytest.mark.parametrize(("ndisp", "expected"), [(160, 160), (161, 176), (290, 304), (15, 16)])
def test_scenes_of_2014_are_searched_as_far_as_their_calibration_tells(
    tmp_path: Path, ndisp: int, expected: int
) -> None:
    for scene in ("Pipes-perfect", "Pipes-imperfect"):
        put(
            tmp_path / "scenes2014" / scene,
            im0_png=plain(),
            im1_png=plain(),
            disp0_pfm=disparities(3),
            disp1_pfm=disparities(3),
            calib_txt=CALIBRATION.format(ndisp=ndisp),
        )

    found = find_scenes(tmp_path)
    assert [scene.name for scene in found] == ["Pipes-imperfect", "Pipes-perfect"]

    for pair in (scene.load() for scene in found):
        assert pair.num_disparities == expected
        assert np.flatnonzero(pair.masks["nonocc"][0]).tolist() == list(range(3, 12))
        assert pair.offset is None


@pytest.mark.parametrize("calibration", [None, CALIBRATION.replace("ndisp={ndisp}\n", "")])
def test_without_a_calibration_nothing_tells_how_far_to_search_2014(
    tmp_path: Path, calibration: str | None
) -> None:
    folder = put(tmp_path / "scenes2014" / "Pipes-perfect", im0_png=plain(), im1_png=plain())
    if calibration is not None:
        put(folder, calib_txt=calibration)
    (scene,) = find_scenes(tmp_path)
    with pytest.raises(ValueError, match=r"Pipes-perfect: calib.txt must give ndisp"):
        scene.load()


def full_folder(root: Path, collection: str, name: str) -> Path:
    """Make a scene with all its images, each of its own gray level."""
    folder = root / collection / name
    for light in (1, 2, 3):
        for exposure in (0, 1, 2):
            views = {
                f"view{view}_png": plain() + np.uint8(60 * light + 10 * exposure + view)
                for view in (0, 1, 5)
            }
            put(folder / f"Illum{light}" / f"Exp{exposure}", **views)

    return put(folder, disp1_png=levels(*[6] * 12), dmin_txt="270\n")


@pytest.mark.parametrize(
    ("collection", "level", "offset"),
    [
        ("scenes2005/ThirdSize", 70, 90),
        ("scenes2006/HalfSize", 80, 135),
        ("scenes2006/FullSize", 80, 270),
    ],
)
def test_a_full_folder_of_2005_or_2006_has_a_usual_light(
    tmp_path: Path, collection: str, level: int, offset: float
) -> None:
    full_folder(tmp_path, collection, "Art")

    (scene,) = find_scenes(tmp_path)
    pair = scene.load()
    assert (pair.name, pair.left.max(), pair.right.max()) == ("Art", level + 1, level + 5)
    assert pair.truth is not None
    assert pair.offset == offset


@pytest.mark.parametrize("content", ["", "two", "nan", "-3", "inf", "1 2"])
def test_a_damaged_offset_is_refused(tmp_path: Path, content: str) -> None:
    folder = full_folder(tmp_path, "scenes2005/ThirdSize", "Art")
    put(folder, dmin_txt=content)
    (scene,) = find_scenes(tmp_path)
    with pytest.raises(ValueError, match="dmin.txt"):
        scene.load()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    root = tmp_path / "middlebury"

    for name in ("teddy", "cones"):
        put(root / "scenes2003" / name, im2_png=plain(), im6_png=plain())
    for size in ("ThirdSize", "HalfSize"):
        put(root / "scenes2005" / size / "Art", view1_png=plain(), view5_png=plain())

    put(root / "scenes2005" / "ThirdSize" / "Dolls", view1_png=plain(), view5_png=plain())
    put(root / "MiddEval3" / "testQ" / "Teddy", im0_png=plain(), im1_png=plain())

    put(root / "scenes2003" / "no images")
    put(root / "scenes1999" / "cones", im2_png=plain(), im6_png=plain())

    (root / "scenes2003" / "README").write_text("not a scene")
    return root


@pytest.mark.parametrize(
    ("below", "expected"),
    [
        (
            ".",
            "MiddEval3/testQ/Teddy scenes2003/cones scenes2003/teddy scenes2005/HalfSize/Art "
            "scenes2005/ThirdSize/Art scenes2005/ThirdSize/Dolls",
        ),
        ("scenes2003", "scenes2003/cones scenes2003/teddy"),
        (
            "scenes2005",
            "scenes2005/HalfSize/Art scenes2005/ThirdSize/Art scenes2005/ThirdSize/Dolls",
        ),
        ("scenes2005/ThirdSize", "scenes2005/ThirdSize/Art scenes2005/ThirdSize/Dolls"),
        ("scenes2005/ThirdSize/Dolls", "scenes2005/ThirdSize/Dolls"),
        ("MiddEval3/testQ/Teddy", "MiddEval3/testQ/Teddy"),
    ],
)
def test_the_root_is_a_tree_a_collection_or_a_scene(tree: Path, below: str, expected: str) -> None:
    scenes = find_scenes(tree / below)
    assert [str(scene) for scene in scenes] == expected.split()
    assert all(scene.folder == tree / str(scene) for scene in scenes)
    assert [str(scene) for scene in find_scenes(str(tree / below))] == expected.split()


def test_a_root_without_scenes_is_refused(tree: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no such folder: .*nowhere"):
        find_scenes(tree / "nowhere")
    with pytest.raises(NotADirectoryError, match="README"):
        find_scenes(tree / "scenes2003" / "README")
    with pytest.raises(ValueError, match=r"no images: looked for .*scenes2003/\*/im2.png"):
        find_scenes(tree / "scenes2003" / "no images")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("DOLLS", "scenes2005/ThirdSize/Dolls"),
        ("scenes2003/teddy", "scenes2003/teddy"),
        ("halfsize/art", "scenes2005/HalfSize/Art"),
        ("scenes2005/ThirdSize/Art", "scenes2005/ThirdSize/Art"),
    ],
)
def test_a_scene_is_found_by_name(tree: Path, name: str, expected: str) -> None:
    assert str(find_scene(tree, name)) == expected


def test_a_name_that_is_not_one_scene_is_refused(tree: Path) -> None:
    with pytest.raises(
        ValueError,
        match=r"'art' is ambiguous .* \S+/HalfSize/Art, \S+/ThirdSize/Art$",
    ):
        find_scene(tree, "art")

    for name in ("doll", "olls", "", "scenes2003"):
        with pytest.raises(ValueError, match=r"is not a scene .* MiddEval3/testQ/Teddy, .*/Dolls$"):
            find_scene(tree, name)

    with pytest.raises(TypeError, match=r"name must be a string, got \w+Path"):
        find_scene(tree, tree)  # type: ignore[arg-type] # what is tested


def test_a_pair_may_come_without_truth_and_calibration(tree: Path) -> None:
    pair = find_scene(tree, "testQ/Teddy").load()
    assert (pair.truth, pair.truth_right, pair.calibration) == (None, None, None)
    assert (pair.masks, pair.num_disparities) == ({}, 80)


@pytest.mark.parametrize("top", [1, 255])
def test_masks_hold_what_is_not_zero_is_known_and_has_its_match_in_the_image(
    tmp_path: Path, top: int
) -> None:
    nonocc = levels(1, 1, 0, 1, 1, 1, 1, 1, 1, 0, 1, 0)
    everywhere = levels(1, 1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1)
    pair = cones(tmp_path, mask_nonocc_png=nonocc * top, mask_all_png=everywhere * top).load()
    # d = 1 from x = 0 on, 4 from 4 on, unknown from 8 on, 1 from 10 on

    assert pair.masks["nonocc"][0].tolist() == [
        bool(v) for v in (0, 1, 0, 1, 1, 1, 1, 1, 0, 0, 1, 0)
    ]

    assert pair.masks["all"][0].tolist() == [bool(v) for v in (1, 1, 1, 0, 1, 1, 1, 1, 0, 0, 1, 1)]
    assert "disc" not in pair.masks


def test_of_three_levels_only_the_highest_is_near_a_discontinuity(tmp_path: Path) -> None:
    disc = levels(0, 255, 128, 0, 255, 128, 0, 255, 255, 0, 1, 254)
    masks = cones(tmp_path, mask_disc_png=disc).load().masks
    assert np.flatnonzero(masks["disc"][0]).tolist() == [1, 4, 7]  # 8 has no truth


def test_the_mask_of_middeval3_says_255_for_visible(tmp_path: Path) -> None:
    folder = put(
        tmp_path / "MiddEval3" / "trainingQ" / "Made-up",
        im0_png=plain(),
        im1_png=plain(),
        disp0GT_pfm=np.where(levels(*range(12)) < 10, 2, math.nan).astype(np.float32),
        mask0nocc_png=levels(255, 255, 255, 128, 0, 255, 1, 254, 255, 255, 255, 0),
    )
    (scene,) = find_scenes(folder)

    masks = scene.load().masks
    assert np.flatnonzero(masks["nonocc"][0]).tolist() == [2, 5, 8, 9]
    assert np.flatnonzero(masks["all"][0]).tolist() == list(range(10))


def test_without_a_mask_the_truths_of_both_views_tell_what_is_visible(tmp_path: Path) -> None:
    # A near thing (d = 4) at x = 4..7 of the left view and 0..3 of the right; behind it d = 1.
    right = levels(16, 16, 16, 12, 4, 4, 12, 0, 4, 4, 4, 4)
    pair = cones(tmp_path, disp6_png=right).load()
    # x = 0 leaves the image; 1, 2 meet the near thing, and 3 too; 4..7 find it (7 finds 3: off by
    # one is agreement); 8, 9 are unknown; 10, 11 find d = 1 at 9, 10.
    assert np.flatnonzero(pair.masks["nonocc"][0]).tolist() == [4, 5, 6, 7, 10, 11]
    assert np.flatnonzero(pair.masks["all"][0]).tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 10, 11]


def test_the_nearest_column_of_the_right_truth_is_compared(tmp_path: Path) -> None:
    # d = 2.5 meets x = 10 at 7.5: column 8, not 7; d = 2.25 meets it at 7.75.
    for level in (9, 10):
        left, right = levels(*[0] * 12), levels(*[80] * 12)
        left[:, 10], right[:, 8] = level, level
        masks = cones(tmp_path, disp2_png=left, disp6_png=right).load().masks
        assert np.flatnonzero(masks["nonocc"][0]).tolist() == [10]


def test_a_mask_file_is_preferred_to_what_the_truths_tell(tmp_path: Path) -> None:
    pair = cones(
        tmp_path, disp6_png=levels(*[255] * 12), mask_nonocc_png=levels(*[0, 255] * 6)
    ).load()
    assert np.flatnonzero(pair.masks["nonocc"][0]).tolist() == [1, 3, 5, 7, 11]


def test_without_a_source_there_is_no_mask_but_all(tmp_path: Path) -> None:
    masks = cones(tmp_path).load().masks
    assert (list(masks), np.flatnonzero(~masks["all"][0]).tolist()) == (["all"], [8, 9])


def test_the_derived_masks_are_those_in_use_for_2005_and_2006(data: Path, tmp_path: Path) -> None:
    for name in ("Art", "Aloe"):
        scene = find_scene(data / "middlebury", name)
        copy = tmp_path / scene.collection / name
        copy.mkdir(parents=True)
        for path in scene.folder.glob("[vd]i*.png"):  # all but the mask
            (copy / path.name).symlink_to(path)

        (bare,) = find_scenes(copy)
        derived, given = bare.load().masks["nonocc"], scene.load().masks["nonocc"]
        assert np.array_equal(derived, given), name


@pytest.mark.parametrize(
    ("ndisp", "expected"), [(65, 80), (83, 80), (87, 80), (88, 96), (160, 160), (190, 192)]
)
def test_a_calibration_asks_for_more_disparities_but_never_for_fewer(
    tmp_path: Path, ndisp: int, expected: int
) -> None:
    folder = tmp_path / "MiddEval3" / "trainingQ" / "Made-up"
    calibration = CALIBRATION.format(ndisp=ndisp)
    put(folder, im0_png=plain(), im1_png=plain(), calib_txt=calibration)
    (scene,) = find_scenes(folder)

    pair = scene.load()
    assert (pair.num_disparities, pair.calibration.ndisp) == (expected, ndisp)


def damaged(scene: Scene) -> Iterator[tuple[str, type[Exception], str]]:
    """Spoil one file after another, each made good again before the next."""
    small, deep = plain()[:, :5], np.zeros((*SIZE, 3), np.uint16)
    for file, content, error, message in (
        ("im6.png", None, FileNotFoundError, "im6.png"),
        ("im6.png", small, ValueError, r"im6.png must have .* \(2, 12, 3\), got \(2, 5, 3\)"),
        ("im6.png", plain(None), ValueError, "im6.png must have the left image's shape"),
        ("im2.png", b"\x89PNG\r\n\x1a\n", ValueError, "im2.png"),
        ("im2.png", deep[..., 0], ValueError, "im2.png must be an image of 8-bit samples"),
        ("disp2.png", small[..., 0], ValueError, r"disp2.png must have .* got \(2, 5\)"),
        ("disp2.png", plain(), ValueError, "disp2.png"),
        ("disp2.png", b"nothing", ValueError, "disp2.png"),
        ("disp6.png", small[..., 0], ValueError, "disp6.png must have"),
        ("mask_disc.png", small[..., 0], ValueError, "mask_disc.png must have"),
        ("mask_all.png", b"", ValueError, "mask_all.png"),
    ):
        path = scene.folder / file
        before = path.read_bytes() if path.exists() else None
        path.unlink(missing_ok=True)
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            write_image(path, content)

        yield file, error, message

        path.unlink(missing_ok=True)
        if before is not None:
            path.write_bytes(before)


def test_a_file_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    scene = cones(tmp_path)
    for file, error, message in damaged(scene):
        with pytest.raises(error, match=message):
            scene.load()
        assert file in message
    scene.load()
