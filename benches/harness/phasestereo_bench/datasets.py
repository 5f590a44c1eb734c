"""Finds the scenes of Middlebury, ETH3D and KITTI in the official folder trees, and loads them.

This module knows the files of a dataset, the coding of its truth and the pixels that count;
`phasestereo.io` reads single files, and `phasestereo.metrics` scores. The years differ only in
their rows in `LAYOUTS`; a new year needs a new row.

The data itself is at https://vision.middlebury.edu/stereo/data, https://www.eth3d.net and
https://www.cvlibs.net/datasets/kitti; folders and files must keep their names from
there.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from phasestereo.io import Calibration, read_calibration, read_disparity, read_image, read_truth
from phasestereo.io.files import decoding
from phasestereo_bench.arrays import Image, Map, Mask

__all__ = ["LAYOUTS", "Layout", "MaskFile", "Pair", "Scene", "find_scene", "find_scenes"]


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A rectified pair, with the known parts of its truth.

    Attributes
    ----------
    name
        Name of the pair in a table.
    left, right
        The images, uint8 (H, W) or (H, W, 3).
    truth
        Disparities of the left view in px, float32 (H, W), NaN = unknown; right x = left x - d.
    truth_right
        Disparities of the right view (d >= 0 again, left x = right x + d).
    masks
        The pixels to score by region, bool (H, W): "nonocc" (visible in both images), "all" (with
        the half-occluded ones), "disc" (near a depth discontinuity); those that are known.
    num_disparities
        Number of disparities to search from 0.
    calibration
        The camera pair, if it is known.
    offset
        Px that cropping took off every disparity, if known (2005, 2006): the depth is focal length
        x baseline / (d + offset).
    first
        The rig's own least disparity where `truth` has 0: its right image is this many px farther
        to the left.
    """

    name: str
    left: Image
    right: Image
    truth: Map | None
    truth_right: Map | None
    masks: Mapping[str, Mask]
    num_disparities: int
    calibration: Calibration | None
    offset: float | None = None
    first: int = 0

    @property
    def known_truth(self) -> Map:
        """The truth; raise ValueError if it is unknown."""
        if self.truth is None:
            raise ValueError(f"{self.name}: its truth is missing")
        return self.truth

    @property
    def scored(self) -> tuple[Map, Mask]:
        """The truth, and the mask of the visible pixels; raise ValueError if one is unknown."""
        if "nonocc" not in self.masks:
            raise ValueError(f"{self.name}: its mask of visible pixels is missing")
        return self.known_truth, self.masks["nonocc"]


class MaskFile(NamedTuple):
    """The mask file of a region: a gray image; pixels with a certain level or more are inside."""

    region: str
    file: str
    level: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The files of the scenes in one collection: `collection/<scene>/<file>`.

    If a folder holds many scenes, their names replace `*` in the names of the files.

    Attributes
    ----------
    collection
        Folder of the scenes, relative to the tree's root, with forward slashes.
    left, right
        File names of the images. A folder with the left image is a scene.
    truth, truth_right
        File names of the disparities of either view; a missing file means an unknown truth.
    truth_scale
        A gray level divided by this is a disparity in px, and level 0 is unknown; None for PFM.
    num_disparities
        Number of disparities to search from 0. The collection fixes it, never the truth: the number
        that the 8-bit code can hold (2001, 2003), 240 at full size (2005, 2006), 80 at a quarter of
        it (MiddEval3), 64 (ETH3D), 192 (KITTI). A scene whose calib.txt asks for more gets more.
        None for 2014 and 2021, whose calib.txt gives the number, rounded up to a multiple of 16.
    masks
        Mask files; each may be missing.
    also
        Other folders with the same scenes, as on the site itself, so that a mirror works.
    scenes
        Name of a scene's folder, `*` for any characters.
    calibration
        File name of the calibration.
    offset
        File name of the disparity that cropping took off, in px at full size.
    max_width
        Width of the widest image with this scale of the truth, px, if the folder leaves that open.
    """

    collection: str
    left: str
    right: str
    truth: str
    truth_right: str | None
    truth_scale: int | None
    num_disparities: int | None
    masks: tuple[MaskFile, ...]
    also: tuple[str, ...] = ()
    scenes: str = "*"
    calibration: str | None = None
    offset: str | None = None
    max_width: int | None = None

    def of(self, name: str) -> "Layout":
        """Return the layout with the name of a scene in its files."""
        return replace(
            self,
            left=self.left.replace("*", name),
            right=self.right.replace("*", name),
            truth=self.truth.replace("*", name),
            masks=tuple(mask._replace(file=mask.file.replace("*", name)) for mask in self.masks),
        )


_MASKS = (
    MaskFile("nonocc", "mask_nonocc.png", 1),
    MaskFile("all", "mask_all.png", 1),
    MaskFile("disc", "mask_disc.png", 255),  # 128 is visible, but not near a discontinuity
)
_MASKS_V3 = (MaskFile("nonocc", "mask0nocc.png", 255),)  # 128 is occluded

_ROUNDING = 1e-3  # px; far below the steps of any 8-bit truth, far above float32's at d < 1000

# The same images as those the two-view archives have at the top; others are up to 9 times darker.
_USUAL_LIGHT = {2005: "Illum1/Exp1/", 2006: "Illum1/Exp2/"}

LAYOUTS: tuple[Layout, ...] = (
    *(
        Layout(
            collection="scenes2001",
            also=("scenes2001/data",),
            left=left,
            right=right,
            truth=truth,
            truth_right=truth_right,
            truth_scale=scale,
            num_disparities=256 // scale,
            masks=_MASKS,
        )
        for left, right, truth, truth_right, scale in (
            (
                "scene1.row3.col3.ppm",
                "scene1.row3.col4.ppm",
                "truedisp.row3.col3.pgm",
                None,
                16,
            ),
            ("im2.ppm", "im6.ppm", "disp2.pgm", "disp6.pgm", 8),
            ("im0.pgm", "im1.pgm", "disp0.pgm", "disp1.pgm", 8),
        )
    ),
    *(
        Layout(
            collection="scenes2003",
            also=("scenes2003/newdata", "scenes2003/newdata/full"),
            scenes=scenes,
            left=f"im2.{color}",
            right=f"im6.{color}",
            truth=f"disp2.{gray}",
            truth_right=f"disp6.{gray}",
            truth_scale=scale,
            num_disparities=256 // scale,
            masks=_MASKS,
            max_width=1800 // scale,
        )
        for scenes, scale in (("*F", 1), ("*H", 2), ("*", 4))
        for color, gray in (("png", "png"), ("ppm", "pgm"))
    ),
    *(
        Layout(
            collection=f"scenes{year}/{size}",
            left=f"{light}view1.png",
            right=f"{light}view5.png",
            truth="disp1.png",
            truth_right="disp5.png",
            truth_scale=scale,
            num_disparities=240 // scale,
            masks=_MASKS,
            offset="dmin.txt",
        )
        for year in (2005, 2006)
        for size, scale in (("ThirdSize", 3), ("HalfSize", 2), ("FullSize", 1))
        for light in ("", _USUAL_LIGHT[year])
    ),
    *(
        Layout(
            collection=collection,
            also=also,
            left="im0.png",
            right="im1.png",
            truth="disp0.pfm",
            truth_right="disp1.pfm",
            truth_scale=None,
            num_disparities=None,
            masks=_MASKS_V3,
            calibration="calib.txt",
        )
        for collection, also in (
            ("scenes2014", ("scenes2014/datasets",)),
            ("scenes2021", ("scenes2021/data",)),
        )
    ),
    *(
        Layout(
            collection=f"MiddEval3/{part}{size}",
            left="im0.png",
            right="im1.png",
            truth="disp0GT.pfm",
            truth_right="disp1GT.pfm",
            truth_scale=None,
            num_disparities=80 * factor,
            masks=_MASKS_V3,
            calibration="calib.txt",
        )
        for part in ("training", "test")
        for size, factor in (("Q", 1), ("H", 2), ("F", 4))
    ),
    *(
        Layout(
            collection=f"two_view_{part}",
            left="im0.png",
            right="im1.png",
            truth="disp0GT.pfm",
            truth_right=None,
            truth_scale=None,
            num_disparities=64,
            masks=_MASKS_V3,
            calibration="calib.txt",
        )
        for part in ("training", "test")
    ),
    *(
        Layout(
            collection=f"kitti{year}",
            also=(archive,),
            scenes="t*ing",  # training and testing
            left=f"{image}{left}/*_10.png",
            right=f"{image}{left + 1}/*_10.png",
            truth=f"disp_occ{first}/*_10.png",
            truth_right=None,
            truth_scale=None,
            num_disparities=192,
            masks=(MaskFile("nonocc", f"disp_noc{first}/*_10.png", 1),),
        )
        for year, archive, image, left, first in (
            (2012, "data_stereo_flow", "colored_", 0, ""),
            (2015, "data_scene_flow", "image_", 2, "_0"),
        )
    ),
)


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene of a folder tree, found but not loaded.

    Attributes
    ----------
    name
        The name of its folder, such as "tsukuba" or "Art".
    collection
        The collection it is in, such as "scenes2001" or "scenes2005/ThirdSize".
    folder
        Folder of its files.
    layout
        The names of these files, and the code of the truth.
    """

    name: str
    collection: str
    folder: Path
    layout: Layout

    def __str__(self) -> str:
        """Return "collection/name"."""
        return f"{self.collection}/{self.name}"

    def load(self) -> Pair:
        """Read the images, and the available truth, masks and calibration.

        A pixel counts as "nonocc" if its mask includes it, its truth is known and its match is
        inside the right image (x - d >= 0); without a mask file, if the truths of both views agree:
        |dL(x) - dR(x - dL(x))| <= 1, with the right one taken at the nearest column (which for 2005
        and 2006 gives the very masks in use). It counts as "all" if its mask includes it, or
        anywhere without a mask, and its truth is known: "all" contains half-occluded pixels, and so
        also matches outside the right image. It counts as "disc" if its mask includes it and its
        truth is known. Every mask needs a truth; "nonocc" and "disc" also need their source. (The
        rows of the "-imperfect" pairs of 2014 are a little apart; the truths are still compared
        along the same row.)

        Returns
        -------
        Pair

        Raises
        ------
        OSError
            If a file cannot be read, or an image is missing.
        ValueError
            If a file's content is invalid, or its size is not the left image's; or if the images
            are larger than the known scale of the truth allows; or if nothing gives the number of
            disparities to search.
        """
        layout = self.layout
        path_left = self.folder / layout.left
        path_right = self.folder / layout.right

        left, right = _read_view(path_left), _read_view(path_right)
        _require_shape(path_right, right.shape, left.shape)
        size = left.shape[:2]

        if layout.max_width is not None and size[1] > layout.max_width:
            raise ValueError(
                f"{path_left} is {size[1]} px wide, but the scale of the truth in "
                f"{self.collection} is only known for images up to {layout.max_width} px wide"
            )

        truth = self._read_truth(layout.truth, size)
        truth_right = self._read_truth(layout.truth_right, size)
        calibration = self._read_calibration()

        return Pair(
            name=self.name,
            left=left,
            right=right,
            truth=truth,
            truth_right=truth_right,
            masks={} if truth is None else self._read_masks(truth, truth_right),
            num_disparities=self._num_disparities(calibration),
            calibration=calibration,
            offset=self._read_offset(),
        )

    def _read_truth(self, file: str | None, size: tuple[int, ...]) -> Map | None:
        if file is None or not (self.folder / file).exists():
            return None

        path, scale = self.folder / file, self.layout.truth_scale
        truth = read_disparity(path) if scale is None else read_truth(path, scale=scale)
        _require_shape(path, truth.shape, size)
        return truth

    def _read_calibration(self) -> Calibration | None:
        if self.layout.calibration is None:
            return None

        path = self.folder / self.layout.calibration
        return read_calibration(path) if path.exists() else None

    def _read_offset(self) -> float | None:
        if self.layout.offset is None or not (self.folder / self.layout.offset).exists():
            return None

        path = self.folder / self.layout.offset
        with decoding(path) as file:
            offset = float(file.read())

        if not (math.isfinite(offset) and offset >= 0):
            raise ValueError(f"{path} must hold a number >= 0, got {offset}")

        return offset / (self.layout.truth_scale or 1)

    def _num_disparities(self, calibration: Calibration | None) -> int:
        """Return the collection's number, or calib.txt's to the nearest multiple of 16 if larger.

        It is the nearest multiple, because calib.txt's number is a generous bound. Collections
        without their own number take the next multiple.
        """
        bound = None if calibration is None else calibration.ndisp
        own = self.layout.num_disparities
        if own is not None:
            return own if bound is None else max(own, (bound + 8) // 16 * 16)

        if bound is None:
            raise ValueError(f"{self.folder}: calib.txt must give ndisp, and is missing")
        return (bound + 15) // 16 * 16

    def _read_masks(self, truth: Map, truth_right: Map | None) -> dict[str, Mask]:
        masks = {"all": np.isfinite(truth)}
        if truth_right is not None:
            masks["nonocc"] = _agree(truth, truth_right)

        for region, file, level in self.layout.masks:
            path = self.folder / file
            if path.exists():
                gray = read_image(path)
                _require_shape(path, gray.shape, truth.shape)
                masks[region] = (gray >= level) & np.isfinite(truth)

        # The right image cannot show a match left of the first column.
        if "nonocc" in masks:
            masks["nonocc"] &= _match_column(truth) >= 0

        return masks


def find_scenes(root: str | os.PathLike[str]) -> list[Scene]:
    """Find the scenes of a folder tree, without reading them.

    Parameters
    ----------
    root
        The folder that holds `scenes2001`, `kitti2012` and so on, those that exist; or one of
        these; or one scene in it. The official names of their files and parent folders identify the
        folders.

    Returns
    -------
    list of Scene
        Sorted by collection, then name.

    Raises
    ------
    OSError
        If `root` does not exist, is not a folder or may not be read.
    ValueError
        If there is no scene in it.
    """
    folder = Path(root).absolute()
    if not folder.exists():
        raise FileNotFoundError(f"no such folder: {folder}")
    if not folder.is_dir():
        raise NotADirectoryError(f"root must be a folder, got the file {folder}")

    scenes: dict[tuple[Path, str], Scene] = {}
    for layout in LAYOUTS:
        for candidate in _candidates(folder, layout):
            for scene in _scenes_in(candidate, layout):
                # The first layout that fits counts.
                scenes.setdefault((candidate, scene.name), scene)

    if not scenes:
        wanted = ", ".join(
            f"{layout.collection}/{layout.scenes}/{layout.left}" for layout in LAYOUTS
        )
        raise ValueError(f"no scene in {folder}: looked for {wanted}")

    return sorted(scenes.values(), key=lambda scene: (scene.collection, scene.name))


def find_scene(root: str | os.PathLike[str], name: str) -> Scene:
    """Find one scene by name.

    Parameters
    ----------
    root
        As for `find_scenes`.
    name
        A name such as "tsukuba", in upper or lower case; if several collections have it, with
        enough of the collection in front: "trainingH/Piano", "scenes2005/HalfSize/Art".

    Raises
    ------
    TypeError
        If `name` is not a string.
    OSError
        As `find_scenes`.
    ValueError
        As `find_scenes`, or if no scene has that name, or several have it; the message lists them.
    """
    if not isinstance(name, str):
        raise TypeError(f"name must be a string, got {type(name).__name__}")

    scenes = find_scenes(root)
    ending = f"/{name}".casefold()
    found = [scene for scene in scenes if f"/{scene}".casefold().endswith(ending)]

    if len(found) == 1:
        return found[0]

    problem, choice = ("is ambiguous", found) if found else ("is not a scene", scenes)
    raise ValueError(
        f"name {name!r} {problem} in {Path(root)}: there is {', '.join(map(str, choice))}"
    )


def _scenes_in(folder: Path, layout: Layout) -> Iterator[Scene]:
    """Yield the scene of a folder, or all scenes of a folder that holds many."""
    if "*" not in layout.left and (folder / layout.left).is_file():
        yield Scene(folder.name, layout.collection, folder, layout)
    elif "*" in layout.left:
        for left in folder.glob(layout.left):
            own = layout.of(left.stem.partition("_")[0])
            yield Scene(left.stem, f"{layout.collection}/{folder.name}", folder, own)


def _candidates(root: Path, layout: Layout) -> Iterator[Path]:
    """Yield the folders of a layout at, below or above `root`, which may also be a scene."""
    for collection in (layout.collection, *layout.also):
        for folder in _folders(root, PurePosixPath(collection).parts):
            if fnmatchcase(folder.name, layout.scenes):
                yield folder


def _folders(root: Path, parts: tuple[str, ...]) -> Iterator[Path]:
    for known in range(len(parts) + 1):
        # The last `known` parts of the root's own path are the first of the collection's.
        if root.parts[len(root.parts) - known :] == parts[:known]:
            folder = root.joinpath(*parts[known:])
            if folder.is_dir():
                yield from folder.iterdir()

    # The root may also be a scene itself.
    if root.parent.parts[-len(parts) :] == parts:
        yield root


def _read_view(path: Path) -> Image:
    image = read_image(path)
    if image.dtype != np.uint8:
        raise ValueError(f"{path} must be an image of 8-bit samples, got {image.dtype}")
    return image.astype(np.uint8, copy=False)


def _require_shape(path: Path, shape: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if shape != wanted:
        raise ValueError(f"{path} must have the left image's shape {wanted}, got {shape}")


def _match_column(truth: Map) -> Map:
    """Return x - d: NaN if the truth is unknown, negative left of the right image."""
    return np.arange(truth.shape[1], dtype=np.float32) - truth


def _agree(truth: Map, truth_right: Map) -> Mask:
    """Return the mask of pixels where both truths agree, to 1 px and float32's rounding."""
    width = truth.shape[1]
    column = np.floor(_match_column(truth) + 0.5)
    inside = (column >= 0) & (column < width)

    # Columns outside are read at 0 and masked out at the end.
    at = np.where(inside, column, 0).astype(np.intp)
    seen = np.take_along_axis(truth_right, at, axis=1)
    return inside & (np.abs(truth - seen) <= 1 + _ROUNDING)
