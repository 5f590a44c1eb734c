"""PFM: every bit survives, and a header that lies is refused before anything is allocated."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from phasestereo.io import read_calibration, read_pfm, write_pfm

QUARTER = "middlebury/MiddEval3/trainingQ"


def floats(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return samples of both signs."""
    return np.random.default_rng(0).normal(0, 100, shape).astype(np.float32)


def bits(array: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return float32 as bit patterns, which distinguish NaN from NaN and 0 from -0."""
    return np.ascontiguousarray(array).view(np.uint32)


@given(
    patterns=hnp.arrays(
        np.uint32,
        st.tuples(st.integers(1, 5), st.integers(1, 5))
        | st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(3)),
    ),
    little=st.booleans(),
)
def test_pfm_keeps_every_bit_pattern(
    tmp_path_factory: pytest.TempPathFactory, patterns: NDArray[np.uint32], *, little: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "every.pfm"
    array = patterns.view(np.float32)
    write_pfm(path, array)

    if not little:
        head, samples = path.read_bytes().split(b"-1\n", 1)
        swapped = np.frombuffer(samples, "<u4").astype(">u4").tobytes()
        path.write_bytes(head + b"1\n" + swapped)

    loaded = read_pfm(path)
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(bits(loaded), patterns)


def test_pfm_is_laid_out_bottom_row_first(tmp_path: Path) -> None:
    path = tmp_path / "rows.pfm"
    write_pfm(path, np.array([[1, np.inf], [3, np.nan]], np.float32))
    samples = struct.pack("<4f", 3, np.nan, 1, np.inf)
    assert path.read_bytes() == b"Pf\n2 2\n-1\n" + samples


@pytest.mark.parametrize("scale", [b"-0.003922", b"-0.00392156862745098", b"-1e3", b"-.5"])
def test_pfm_samples_do_not_depend_on_the_size_of_the_scale(tmp_path: Path, scale: bytes) -> None:
    path = tmp_path / "scaled.pfm"
    path.write_bytes(b"Pf\n2 1\n" + scale + b"\n" + struct.pack("<2f", 59.5, np.inf))
    np.testing.assert_array_equal(read_pfm(path), [[59.5, np.inf]])


@pytest.mark.parametrize("head", [b"Pf\r\n2 1\r\n-1\r\n", b"Pf 2 1 -1 ", b"Pf\n2\n1\n-1.0\n"])
def test_pfm_headers_may_use_any_white_space(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "spaced.pfm"
    path.write_bytes(head + struct.pack("<2f", 1, 2))
    np.testing.assert_array_equal(read_pfm(path), [[1, 2]])


PFM_SAMPLES = bytes(24)  # of 3 x 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"Pf\n3 2\n-1\n" + PFM_SAMPLES[:-1], "asks for 34 bytes, but the file has 33"),
        (b"Pf\n3 2\n-1\n" + PFM_SAMPLES + b"x", "asks for 34 bytes, but the file has 35"),
        (b"PF\n3 2\n-1\n" + PFM_SAMPLES, "asks for 82 bytes"),
        (b"Pf\n1000000000 1000000000\n-1\n" + PFM_SAMPLES, "asks for 4000000000000000"),
        (b"Pf\n9999999999 9999999999\n-1\n" + PFM_SAMPLES, "but the file has"),
        (b"Pf\n0 2\n-1\n" + PFM_SAMPLES, "must not be zero"),
        (b"Pf\n3 0\n-1\n" + PFM_SAMPLES, "must not be zero"),
        (b"Pf\n-3 2\n-1\n" + PFM_SAMPLES, "two whole numbers"),
        (b"Pf\n3 two\n-1\n" + PFM_SAMPLES, "two whole numbers"),
        (b"Pf\n3.0 2\n-1\n" + PFM_SAMPLES, "two whole numbers"),
        (b"Pf\n99999999999 1\n-1\n" + PFM_SAMPLES, "two whole numbers"),
        (b"Pf\n3 2\n0\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\n-0.0\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\nnan\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\n-inf\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\n1e999\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\nlittle\n" + PFM_SAMPLES, "scale must be"),
        (b"Pf\n3 2\n" + PFM_SAMPLES, "not a PFM file"),
        (b"Pf\n3 2\n-1", "not a PFM file"),
        (b"Pf\n", "not a PFM file"),
        (b"P5\n3 2\n255\n" + PFM_SAMPLES, "not a PFM file"),
        (b"", "not a PFM file"),
    ],
)
def test_pfm_headers_that_lie_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "lie.pfm"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"lie\.pfm: .*" + message):
        read_pfm(path)


@pytest.mark.parametrize("dtype", [np.float64, np.uint8, np.float16, np.int32])
def test_pfm_of_another_type_is_refused(tmp_path: Path, dtype: type) -> None:
    with pytest.raises(TypeError, match="float32"):
        write_pfm(tmp_path / "a.pfm", np.zeros((2, 3), dtype))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("shape", [(3,), (2, 3, 4), (2, 3, 1), (0, 3), (2, 0), (1, 2, 3, 3), ()])
def test_pfm_of_another_shape_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        write_pfm(tmp_path / "a.pfm", np.zeros(shape, np.float32))


def test_pfm_writes_views_and_big_endian_arrays(tmp_path: Path) -> None:
    array = floats((4, 6))
    for view in (array[::2, ::-3], array.T, array.astype(">f4")):
        write_pfm(tmp_path / "view.pfm", view)
        np.testing.assert_array_equal(read_pfm(tmp_path / "view.pfm"), view)


@pytest.mark.parametrize("scene", ["Motorcycle", "Piano", "Playroom"])
def test_middlebury_pfm_survives_to_the_byte(data: Path, tmp_path: Path, scene: str) -> None:
    source = data / QUARTER / scene / "disp0GT.pfm"

    calibration = read_calibration(source.with_name("calib.txt"))
    truth = read_pfm(source)
    assert truth.shape == (calibration.height, calibration.width)

    known = truth[np.isfinite(truth)]
    assert known.size > truth.size / 2

    assert calibration.vmin - 1 <= known.min() < known.max() <= calibration.vmax + 1

    write_pfm(tmp_path / "again.pfm", truth)
    length = 4 * truth.size
    assert (tmp_path / "again.pfm").read_bytes()[-length:] == source.read_bytes()[-length:]


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 3)])
def test_opencv_agrees_about_pfm(tmp_path: Path, shape: tuple[int, ...]) -> None:
    cv2 = pytest.importorskip("cv2")

    array = floats(shape)
    array[0, :3] = np.inf
    array[1, :3] = np.nan
    path = tmp_path / "cv.pfm"

    write_pfm(path, array)
    theirs = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(theirs[..., ::-1] if len(shape) == 3 else theirs, array)

    assert cv2.imwrite(str(path), theirs)
    np.testing.assert_array_equal(read_pfm(path), array)
