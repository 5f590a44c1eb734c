"""Calibrations from makers of cameras, data sets and measuring software.

Each function takes the contents of a file by name (`phasestereo.io.rigs.documents`) and returns a
camera pair by OpenCV's conventions: the center of the first pixel is (0, 0), and ``R``, ``T`` lead
from the left camera to the right one. Lengths become meters where the format defines their unit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from phasestereo._extras import require
from phasestereo.io.calibration import of_middlebury
from phasestereo.io.rigs.cameras import Cameras, Matrix
from phasestereo.io.rigs.documents import COLMAP, MIDDLEBURY, NUMBERS, XML, Document, numbers
from phasestereo.io.rigs.names import as_cameras
from phasestereo.io.rigs.singles import joined, moved, pose_of

_ZED = {
    "HD": (1280, 720), "2K": (2208, 1242), "FHD": (1920, 1080), "FHD1200": (1920, 1200),
    "SVGA": (960, 600), "VGA": (672, 376),
}  # fmt: skip
"""Columns and rows of the images, by the names of Stereolabs."""

_RADTAN = "k1", "k2", "p1", "p2", "k3"


class Placed(NamedTuple):
    """A camera as `joined` takes it, and the pose that leads from the world to it, (4, 4)."""

    camera: Document
    pose: Matrix


def cameras_of_maker(documents: list[Document]) -> Cameras | None:
    """Return the camera pair of a file in a maker's conventions; None: the maker is unknown.

    Parameters
    ----------
    documents
        The contents of one or two files.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is one of these, and incomplete.
    """
    if len(documents) == 2:
        if all("lensmodel" in document for document in documents):
            return _pair([_of_mrcal(document) for document in documents], "m")
        return None

    for is_it, read in _MAKERS:
        if is_it(documents[0]):
            return read(documents[0])
    return None


def _inverse(pose: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _pose(rotation: Any, translation: Any) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def _camera(
    focal: tuple[float, float],
    center: tuple[float, float],
    distortion: Any,
    size: tuple[Any, Any] | None,
    model: str = "radtan",
) -> Document:
    """Return a camera as `joined` takes it."""
    k = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]], np.float64)
    return {"K": k, "D": numbers(distortion, "distortion").ravel(), "size": size, "model": model}


def _pair(cameras: list[Placed], unit: Any) -> Cameras:
    left, right = cameras
    return joined([left.camera, right.camera], moved(right.pose @ _inverse(left.pose)), unit)


def _in_order(cameras: list[Placed], kind: str) -> Cameras:
    """Return the pair of two cameras in any order: the left one, or the upper one, is the first."""
    if len(cameras) != 2:
        raise ValueError(f"{kind} of {len(cameras)} images; accepts one of two, left and right")
    one, other = cameras
    place = (one.pose @ _inverse(other.pose))[:3, 3]  # of the other one, in the first one's frame
    is_first = place[int(abs(place[1]) > abs(place[0]))] > 0
    return _pair(cameras if is_first else [other, one], None)


def _of_middlebury(document: Document) -> Cameras:
    found = of_middlebury(document[MIDDLEBURY])
    size = found.width, found.height
    left, right = (np.array(camera) for camera in (found.cam0, found.cam1))
    return Cameras.rectified(left, right, found.baseline, size=size, unit="mm")


def _of_numbers(document: Document) -> Cameras:
    """Return the cameras of FoundationStereo's K.txt: K by rows, then the baseline in m."""
    values = document[NUMBERS]
    if len(values) != 10:
        what = "a matrix K without a baseline" if len(values) == 9 else f"{len(values)} numbers"
        raise ValueError(
            f"holds {what}; accepts the 9 numbers of K and the baseline in m, or the 16 of Q"
        )
    camera = np.reshape(values[:9], (3, 3))
    return Cameras.rectified(camera, camera, values[9], unit="m")


def _is_kitti(document: Document) -> bool:
    return any(all(name in document for name in (f"P{a}", f"P{a + 1}")) and isinstance(
        document[f"P{a}"], str) for a in (0, 2))  # fmt: skip


def _projected(left: Matrix, right: Matrix, **more: Any) -> Cameras:
    """Return rectified cameras from their projections, (3, 4); neither needs to be at 0."""
    x = [np.linalg.solve(p[:, :3], p[:, 3])[0] for p in (left, right)]
    return Cameras.rectified(left[:, :3], right[:, :3], x[0] - x[1], unit="m", **more)


def _row(document: Document, name: str, *shape: int) -> Matrix:
    return numbers(str(document[name]).split(), name).reshape(*shape)


def _of_kitti(document: Document) -> Cameras:
    a, b, note = (2, 3, "color") if "P3" in document else (0, 1, "gray")
    said = f"P{a} and P{b} are taken, those of KITTI's {note} images (image_{a}, image_{b})"
    both = (_row(document, f"P{n}", 3, 4) for n in (a, b))
    return _projected(*both, note=said if "P0" in document and "P3" in document else "")


def _of_kitti_raw(document: Document) -> Cameras:
    """Return the cameras of calib_cam_to_cam.txt, for raw images and for rectified ones."""
    a, b = ("02", "03") if "P_rect_03" in document else ("00", "01")
    size, raw = (tuple(_row(document, f"{s}_{a}", 2).astype(int)) for s in ("S_rect", "S"))
    note = f"cameras {a} and {b} of KITTI are taken"
    rectified = _projected(
        *(_row(document, f"P_rect_{n}", 3, 4) for n in (a, b)), size=size, note=note
    )

    poses: list[Matrix] = []
    found: Document = {}
    for side, n in (("1", a), ("2", b)):
        poses.append(_pose(_row(document, f"R_{n}", 3, 3), _row(document, f"T_{n}", 3)))
        found |= {
            f"K{side}": _row(document, f"K_{n}", 3, 3),
            f"D{side}": _row(document, f"D_{n}", 5),
        }
        found[f"R{side}"] = _row(document, f"R_rect_{n}", 3, 3)
        found[f"P{side}"] = rectified.matrices[f"P{side}"]
    pair = moved(poses[1] @ _inverse(poses[0]))
    unrectified = as_cameras(found | pair, size=raw, unit="m")
    return replace(rectified, also=(replace(unrectified, note=note),))


def _of_zed(document: Document) -> Cameras:
    """Return the cameras of a ZED, one pair for each size of images; lengths are in mm.

    As Stereolabs' zed-opencv-native reads them: RX, CV (of convergence) and RZ are a vector after
    Rodrigues, and T points from the left camera to the right one.
    """
    stereo, found = document["STEREO"], []
    for name, size in _ZED.items():
        keys = [f"{side}_CAM_{name}" for side in ("LEFT", "RIGHT")]
        if not all(key in document for key in keys):
            continue

        def of_pair(key: str, name: str = name) -> float:
            return float(stereo.get(f"{key}_{name}", stereo.get(key, 0)))

        vector = [of_pair(key) for key in ("RX", "CV", "RZ")]
        translation = [-float(stereo["BASELINE"]), -of_pair("TY"), -of_pair("TZ")]
        pair = {"R": np.array(vector), "T": np.array(translation) / 1000}
        cameras = [
            _camera(
                (float(one["FX"]), float(one["FY"])),
                (float(one["CX"]), float(one["CY"])),
                [float(one.get(key.upper(), 0)) for key in _RADTAN],
                size,
            )
            for one in (document[key] for key in keys)
        ]
        found.append(joined(cameras, pair))

    if not found:
        raise ValueError(f"has no sections LEFT_CAM and RIGHT_CAM of {', '.join(_ZED)}")
    return replace(found[0], also=tuple(found[1:]))


def _of_oak(document: Document) -> Cameras:
    """Return the stereo pair of an OAK; lengths are in cm."""
    every = dict(document["cameraData"])
    stereo = document["stereoRectificationData"]
    sockets = [stereo[f"{side}CameraSocket"] for side in ("left", "right")]
    if not all(socket in every for socket in sockets):
        raise ValueError("holds no stereo pair: leftCameraSocket and rightCameraSocket are not set")

    placed = []
    for socket in sockets:
        one = every[socket]
        if one["cameraType"] not in (0, 1):
            raise ValueError(f"cameraType: got {one['cameraType']}; accepts 0, perspective, or 1")
        k = numbers(one["intrinsicMatrix"], "intrinsicMatrix")
        coefficients = one["distortionCoeff"][: 4 if one["cameraType"] else 14]
        model = ("radtan", "equidistant")[one["cameraType"]]
        camera = _camera((k[0, 0], k[1, 1]), (k[0, 2], k[1, 2]), coefficients,
                         (one["width"], one["height"]), model)  # fmt: skip
        placed.append(Placed(camera, _oak_pose(every, socket)))
    return _pair(placed, "m")


def _oak_pose(every: Mapping[int, Any], socket: int) -> Matrix:
    """Return the pose of a camera relative to the end of its chain of extrinsics, m."""
    chain = np.eye(4)
    for _ in every:
        extrinsics = every[socket]["extrinsics"]
        if extrinsics["toCameraSocket"] not in every:
            return _inverse(chain)
        turn = numbers(extrinsics["rotationMatrix"], "rotationMatrix")
        step = _pose(turn, [extrinsics["translation"][axis] / 100 for axis in "xyz"])
        chain, socket = step @ chain, extrinsics["toCameraSocket"]
    raise ValueError("toCameraSocket: the cameras refer to each other in a circle")


def _of_orb(document: Document) -> Cameras:
    """Return the cameras of ORB-SLAM2's and 3's settings; lengths are in m."""
    if "LEFT.K" in document:
        names = {f"{side}.{name}" for side in ("LEFT", "RIGHT") for name in "KDRP"}
        sides = int(document["LEFT.width"]), int(document["LEFT.height"])
        both = {name: document[name] for name in names if name in document}
        return as_cameras(both, size=sides, unit="m")

    first = "Camera1." if "Camera1.fx" in document else "Camera."
    size: tuple[int, int] | None = None
    if "Camera.width" in document:
        size = int(document["Camera.width"]), int(document["Camera.height"])
    if "Stereo.T_c1_c2" in document:
        pose = _inverse(pose_of(document["Stereo.T_c1_c2"], "Stereo.T_c1_c2"))
        return joined([_of_orb_camera(document, f"Camera{n}.", size) for n in (1, 2)], moved(pose))

    if any(document.get(f"{first}{name}") for name in _RADTAN):
        raise ValueError("holds one camera with distortion, and none named LEFT and RIGHT")
    k = _of_orb_camera(document, first, size)["K"]
    if "Stereo.b" not in document and "Camera.bf" not in document:
        raise ValueError("holds one camera of ORB-SLAM, and no baseline: it is not a stereo rig")
    baseline = document.get("Stereo.b") or float(document["Camera.bf"]) / k[0, 0]
    return Cameras.rectified(k, k, float(baseline), size=size, unit="m")


def _of_orb_camera(document: Document, prefix: str, size: tuple[int, int] | None) -> Document:
    fx, fy, cx, cy = (float(document[f"{prefix}{name}"]) for name in ("fx", "fy", "cx", "cy"))
    is_fisheye = document.get("Camera.type") == "KannalaBrandt8"
    names = ("k1", "k2", "k3", "k4") if is_fisheye else _RADTAN
    distortion = [float(document.get(f"{prefix}{name}", 0)) for name in names]
    return _camera((fx, fy), (cx, cy), distortion, size, "equidistant" if is_fisheye else "radtan")


def _of_okvis(document: Document) -> Cameras:
    """Return the first two cameras of OKVIS; T_SC leads from a camera to the rig, m."""
    placed = []
    for one in document["cameras"][:2]:
        model = str(one["distortion_type"]).removesuffix("8")
        camera = _camera(one["focal_length"], one["principal_point"],
                         one["distortion_coefficients"], one["image_dimension"],
                         {"radialtangential": "radtan"}.get(model, model))  # fmt: skip
        pose = pose_of(np.reshape(one["T_SC"], (4, 4)), "T_SC")
        placed.append(Placed(camera, _inverse(pose)))
    if len(placed) != 2:
        raise ValueError("holds one camera of OKVIS; accepts two")
    return _pair(placed, "m")


def _of_vins(document: Document) -> Cameras:
    del document
    raise ValueError(
        "is a configuration of VINS, whose cameras are in other files; accepts what these were "
        "made of, Kalibr's camchain"
    )


def _of_toolbox(document: Document) -> Cameras:
    """Return the cameras of Bouguet's toolbox for MATLAB (Calib_Results_stereo.mat)."""
    cameras = []
    for side in ("left", "right"):
        if document.get(f"alpha_c_{side}", 0):
            raise ValueError(f"alpha_c_{side}: pixels are skewed, which OpenCV does not know")
        size = (document["nx"], document["ny"]) if "nx" in document else None
        cameras.append(_camera(document[f"fc_{side}"], document[f"cc_{side}"],
                               document[f"kc_{side}"], size))  # fmt: skip
    return joined(cameras, {name: np.asarray(document[name]) for name in "RT"}, None)


def _of_matlab(document: Document) -> Cameras:
    """Return the cameras of MATLAB's stereoParameters as a structure.

    There points are rows, so matrices are transposed, and the first pixel is (1, 1).
    """
    cameras = []
    for name in ("CameraParameters1", "CameraParameters2"):
        one = document[name]
        k = np.asarray(one["K"] if "K" in one else np.transpose(one["IntrinsicMatrix"]), np.float64)
        if k[0, 1]:
            raise ValueError(f"{name}: pixels are skewed, which OpenCV does not know")
        radial, tangential = (
            np.ravel(one[f"{kind}Distortion"]) for kind in ("Radial", "Tangential")
        )
        coefficients = [*radial[:2], *tangential, *radial[2:]]
        rows_columns = np.ravel(one.get("ImageSize", ())).tolist()
        size = rows_columns[::-1] or None
        cameras.append(_camera((k[0, 0], k[1, 1]), (k[0, 2] - 1, k[1, 2] - 1), coefficients, size))
    if "RotationOfCamera2" in document:
        rotation, shift = (
            np.transpose(document["RotationOfCamera2"]),
            document["TranslationOfCamera2"],
        )
    else:
        pose = document["PoseCamera2"]
        rotation, shift = pose["R"], pose["Translation"]
    return joined(cameras, {"R": rotation, "T": np.ravel(shift)}, None)


def _of_mrcal(document: Document) -> Placed:
    """Return one camera of mrcal's; ``rt_cam_ref`` (once ``extrinsics``) leads to it, m."""
    model = str(document["lensmodel"])
    known = {"LENSMODEL_PINHOLE": 0} | {f"LENSMODEL_OPENCV{n}": n for n in (4, 5, 8, 12)}
    if model not in known:
        raise ValueError(
            f"lensmodel: got {model}; accepts {', '.join(known)}: mrcal-convert-lensmodel"
        )
    fx, fy, cx, cy, *distortion = document["intrinsics"]
    vector = numbers(document.get("rt_cam_ref", document.get("extrinsics")), "extrinsics")
    pose = _pose(require("cv2", extra="rectify").Rodrigues(vector[:3])[0], vector[3:])
    size = document["imagersize"]
    return Placed(_camera((fx, fy), (cx, cy), distortion, (size[0], size[1])), pose)


def _of_colmap(document: Document) -> Cameras:
    """Return the cameras of a model of COLMAP; there the corner of the first pixel is (0, 0)."""
    pycolmap = require("pycolmap", extra="rigs")
    try:
        model = pycolmap.Reconstruction(str(document[COLMAP]))
    except (RuntimeError, ValueError, IndexError) as error:
        raise ValueError(f"is a damaged model of COLMAP ({error})") from error

    placed = []
    for image in model.images.values():
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().matrix()
        placed.append(Placed(_of_colmap_camera(model.cameras[image.camera_id]), pose))
    return _in_order(placed, "a model of COLMAP")


def _of_colmap_camera(camera: Any) -> Document:
    name, values = camera.model.name, list(camera.params)
    shared, models = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"), {
        "PINHOLE": "radtan", "OPENCV": "radtan", "FULL_OPENCV": "radtan",
        "OPENCV_FISHEYE": "equidistant",
    }  # fmt: skip
    if name in shared:
        values = [values[0], *values]
    elif name not in models:
        raise ValueError(f"camera model: got {name}; accepts {', '.join((*shared, *models))}")
    fx, fy, cx, cy, *distortion = values
    if name in shared:
        distortion = [*[*distortion, 0.0, 0.0][:2], 0.0, 0.0]
    size = camera.width, camera.height
    return _camera((fx, fy), (cx - 0.5, cy - 0.5), distortion, size, models.get(name, "radtan"))


def _of_xml(document: Document) -> Cameras:
    """Return the cameras of Agisoft Metashape's XML ("cameras").

    A transform leads from a camera to the chunk. Principal points count from the middle of the
    image; P1 and P2 are OpenCV's p2 and p1.
    """
    tree = document[XML]
    if tree.tag != "document" or tree.find("chunk/sensors") is None:
        raise ValueError(
            f"is XML of {tree.tag!r}; accepts that of cv2.FileStorage, and Metashape's cameras"
        )
    sensors = {one.get("id"): one for one in tree.iterfind("chunk/sensors/sensor")}
    placed = [
        Placed(_of_sensor(sensors[one.get("sensor_id")]), _inverse(_of_transform(one)))
        for one in tree.iterfind("chunk/cameras//camera")
        if one.find("transform") is not None
    ]
    return _in_order(placed, "Metashape's XML")


def _of_transform(camera: Any) -> Matrix:
    return pose_of(np.reshape(numbers(camera.find("transform").text.split(), "transform"), (4, 4)),
                   "transform")  # fmt: skip


def _of_sensor(sensor: Any) -> Document:
    adjusted = sensor.find("calibration[@class='adjusted']")
    found = sensor.find("calibration") if adjusted is None else adjusted
    if sensor.get("type") != "frame" or found is None:
        raise ValueError(
            f"sensor: got type {sensor.get('type')}; accepts frame, with a calibration"
        )
    size = found.find("resolution")
    width, height = int(size.get("width")), int(size.get("height"))
    keys = "f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2"
    f, cx, cy, k1, k2, k3, k4, p1, p2, b1, b2 = (float(found.findtext(key, "0")) for key in keys)
    if k4 or b2:
        raise ValueError("sensor: got k4 or b2, which OpenCV does not know; accepts those without")
    center = (width - 1) / 2 + cx, (height - 1) / 2 + cy
    return _camera((f + b1, f), center, [k1, k2, p2, p1, k3], (width, height))


_MAKERS: list[tuple[Callable[[Document], bool], Callable[[Document], Cameras]]] = [
    (lambda found: MIDDLEBURY in found, _of_middlebury),
    (lambda found: NUMBERS in found, _of_numbers),
    (lambda found: COLMAP in found, _of_colmap),
    (lambda found: XML in found, _of_xml),
    (lambda found: "STEREO" in found and any("_CAM_" in name for name in found), _of_zed),
    (lambda found: "cameraData" in found and "stereoRectificationData" in found, _of_oak),
    (lambda found: "P_rect_00" in found or "P_rect_02" in found, _of_kitti_raw),
    (_is_kitti, _of_kitti),
    (lambda found: "LEFT.K" in found or "Camera.fx" in found or "Camera1.fx" in found, _of_orb),
    (lambda found: "cam0_calib" in found, _of_vins),
    (lambda found: isinstance(found.get("cameras"), list), _of_okvis),
    (lambda found: "fc_left" in found and "fc_right" in found, _of_toolbox),
    (lambda found: "CameraParameters1" in found, _of_matlab),
]
"""How each format is recognized, and what reads it."""
