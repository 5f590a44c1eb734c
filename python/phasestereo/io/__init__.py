"""Files in and out: images, disparity and depth maps, ground truth, calibrations, point clouds.

In memory, a disparity map is float32 with NaN for pixels without an estimate; only this package
translates each format's own mark for that (+inf in PFM, 0 in KITTI's PNG). The content of a file
arrives exactly, to the bit, or not at all: nothing is narrowed, rescaled or clipped. Files are
written completely or not at all. Images need the extra ``io``; ``.npy``, ``.npz``, ``.pfm`` and
``.ply`` do not. GeoTIFF is read and written by `phasestereo_large.geotiff`, the extra ``geo``.

Files may be hostile: pictures of more than `max_pixels` pixels are refused, and so are files that
would unpack to more than a picture needs, and files that are not regular.
"""

from __future__ import annotations

from phasestereo.io.calibration import Calibration
from phasestereo.io.depth import LengthUnit, read_depth, write_depth
from phasestereo.io.disparity import read_disparity, read_truth, write_disparity
from phasestereo.io.glb import write_glb
from phasestereo.io.image import read_image, write_image
from phasestereo.io.limits import max_pixels, set_max_pixels
from phasestereo.io.pair import read_pair
from phasestereo.io.pfm import read_pfm, write_pfm
from phasestereo.io.ply import write_ply
from phasestereo.io.results import write_maps
from phasestereo.io.rigs.reading import read_calibration

__all__ = [
    "Calibration",
    "LengthUnit",
    "max_pixels",
    "read_calibration",
    "read_depth",
    "read_disparity",
    "read_image",
    "read_pair",
    "read_pfm",
    "read_truth",
    "set_max_pixels",
    "write_depth",
    "write_disparity",
    "write_glb",
    "write_image",
    "write_maps",
    "write_pfm",
    "write_ply",
]
