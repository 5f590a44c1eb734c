"""``phasestereo rectify``: turns two raw image files into two with corresponding rows."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter, validators

import phasestereo
from phasestereo._images import seen_by_alpha
from phasestereo.cli.errors import WRONG_USAGE, CommandError, claim, refusals, refuse_picture, wrong
from phasestereo.cli.pairing import read_both
from phasestereo.cli.rehearsing import rehearse_images
from phasestereo.cli.terminal import print_json, print_lines, say
from phasestereo.io import write_image
from phasestereo.io.pair import Layout
from phasestereo.rectification import Rectification, rectify as rectify_pair

_MANY = Parameter(consume_multiple=True, show_default=False)
_OPTIONS = frozenset(["calibration", "alpha", "interpolation", "layout"])


def rectify(
    left: Path,
    right: Path | None = None,
    /,
    *,
    output: Annotated[tuple[Path, Path] | None, Parameter(alias="-o")] = None,
    calibration: Annotated[tuple[Path, ...], _MANY] = (),
    images_from: Annotated[tuple[Path, ...], _MANY] = (),
    layout: Layout | None = None,
    masks: tuple[Path, Path] | None = None,
    save: Path | None = None,
    alpha: Annotated[float | None, Parameter(validator=validators.Number(gte=-1, lte=1))] = None,
    interpolation: Literal["linear", "cubic", "lanczos"] | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
) -> None:
    """Rectify a stereo pair, so that a scene point lies on the same row of both images.

    Uses a calibration, or the images alone. Needs at least one of ``--output``, ``--save`` and
    ``--json``, and the extra ``rectify``. For example:

    ```
    phasestereo rectify left.png right.png --calibration stereo.yml -o l.png r.png
    phasestereo rectify left.png right.png -o l.png r.png --save rig.npz
    phasestereo match left2.png right2.png --rectify rig.npz --num-disparities 64 -o out.pfm
    ```

    Parameters
    ----------
    left
        Left image: PNG, JPEG, WebP, HEIF, PBM/PGM/PPM, BMP, TIFF, .npy or PFM; gray or color.
        Without RIGHT, a stereo photograph that holds both views.
    right
        Right image, of the same size and type.
    output
        Files for the rectified images, left and right.
    calibration
        OpenCV's .yml, .xml or .npz; a folder of .npy; a pair of ROS's camera_info or of EuRoC's
        sensor.yaml (left, right); Kalibr's camchain; a saved rectification. Default: from the
        images alone.
    images_from
        More pairs of the same cameras, left and right in turn, to improve the estimate without a
        calibration.
    layout
        How one file holds both views: side-by-side, or top-bottom with the left view above.
    masks
        Files for masks, left and right: 0 at pixels outside the original image.
    save
        File (.npz) for the rectification, for later use: match --rectify FILE.
    alpha
        How much of the images to keep with a calibration, as in OpenCV: from 0, only pixels valid
        everywhere, to 1, all pixels; -1, OpenCV's default.
    interpolation
        How to interpolate between pixels. Default: linear with a calibration, else lanczos.
    as_json
        Print one JSON object on standard output: method, error in rows, sentences, Q, files.
    """
    if not (output or save or as_json):
        raise CommandError("nothing to do: give -o LEFT RIGHT, --save or --json", WRONG_USAGE)
    if masks and not output:
        raise wrong("masks", "has no effect without --output")
    if len(images_from) % 2:
        raise wrong("images_from", "accepts pairs of files, left and right")
    if images_from and calibration:
        raise wrong("images_from", "has no effect beside --calibration")
    for path in calibration:
        refuse_picture("calibration", path)

    targets = [
        *(("output", path) for path in output or ()),
        *(("masks", path) for path in masks or ()),
        ("save", save),
    ]
    sources = [left, right, *calibration, *images_from]
    files = [str(path) for path in claim(targets, sources, {"save": [".npz"]})]

    with refusals(options=_OPTIONS):
        views = read_both(left, right, layout=layout)
        rehearse_images("output", output, [view.image for view in views])
        rehearse_images("masks", masks, [np.zeros((1, 1), np.uint8)] * 2)
        others = zip(images_from[::2], images_from[1::2], strict=True)
        found = rectify_pair(
            views[0].image,
            views[1].image,
            calibration or None,
            alpha=alpha,
            interpolation=interpolation,
            others=list(others),
            left_mask=views[0].mask,
            right_mask=views[1].mask,
        )

    if output and not masks and any(seen_by_alpha(view.image) is not None for view in views):
        say("note: alpha is dropped, and the images show what it hides: --masks writes that")
    with refusals():
        _write(found, output, masks, save)

    if as_json:
        print_json(_as_dict(found, files))
    else:
        print_lines([*found.sentences, *(f"wrote {path}" for path in files)])


def _write(
    found: Rectification,
    output: tuple[Path, Path] | None,
    masks: tuple[Path, Path] | None,
    save: Path | None,
) -> None:
    for path, image in zip(output or (), (found.left, found.right), strict=False):
        write_image(path, image)
    for path, mask in zip(masks or (), (found.left_mask, found.right_mask), strict=False):
        write_image(path, mask.astype(np.uint8) * np.uint8(255))
    if save is not None:
        found.save(save)


def _as_dict(found: Rectification, files: list[str]) -> dict[str, Any]:
    rows, cols = found.left.shape[:2]
    return {
        "version": phasestereo.__version__,
        "width": cols,
        "height": rows,
        **found.as_dict(),
        "q": None if found.Q is None else found.Q.tolist(),
        "interpolation": found.interpolation,
        "inside": [float(mask.mean()) for mask in (found.left_mask, found.right_mask)],
        "files": files,
    }
