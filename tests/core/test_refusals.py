"""Bad arguments of a match: each is refused by its name, with what it got and what is accepted."""

from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo._images import as_pixels
from support import counterpart

IMAGE = np.zeros((6, 8), np.uint8)
REAL = np.zeros((6, 8), np.float32)


def refused(error: type[Exception], message: str, **arguments: Any) -> None:
    """Check that a match of a proper pair with these arguments exchanged is refused."""
    proper: dict[str, Any] = {"left": IMAGE, "right": IMAGE, "num_disparities": 4}
    with pytest.raises(error, match=message):
        ps.match(**(proper | arguments))


def holed(value: float) -> np.ndarray:
    image = REAL.copy()
    image[2, 3] = value
    return image


@pytest.mark.parametrize("name", ["left", "right"])
@pytest.mark.parametrize(
    "image",
    [
        IMAGE.astype(object),
        IMAGE.astype(complex),
        IMAGE.astype(np.int16),
        IMAGE.astype(np.int64),
        IMAGE.astype(np.float16),
        IMAGE.astype(np.longdouble),
        IMAGE.astype(bool),
        IMAGE.astype(str),
        np.zeros((6, 8), "datetime64[s]"),
        np.zeros((6, 8), [("red", np.uint8)]),
        None,
        b"left.png",
        [[0, 1], [2, 3]],
        [[0], [1, 2]],
        {1: 2},
    ],
    ids=lambda image: type(image).__name__ + "-" + str(getattr(image, "dtype", "")),
)
def test_what_is_no_image_of_a_known_type(name: str, image: object) -> None:
    refused(TypeError, f"^{name}: got .*; accepts ", **{name: image})


def test_what_was_not_read_is_named_by_its_type() -> None:
    refused(TypeError, "^right: got NoneType; accepts an array", right=None)  # from cv2.imread
    refused(TypeError, "^left: got bytes; accepts an array", left=b"left.png")
    refused(TypeError, "^left_mask: got str; accepts an array", left_mask="mask.png")


@pytest.mark.parametrize("mode", ["P", "CMYK", "YCbCr"])
def test_pictures_whose_numbers_are_no_colors_are_refused(mode: str) -> None:
    image = counterpart("PIL.Image")
    picture = image.fromarray(np.repeat(IMAGE[:, :, np.newaxis], 3, axis=2))
    refused(TypeError, f"^right: got Pillow's mode {mode}; acc", right=picture.convert(mode))
    for accepted in ("L", "RGB", "RGBA", "F"):
        np.testing.assert_array_equal(as_pixels(picture.convert(accepted), "left")[..., 0], IMAGE)


@pytest.mark.parametrize("name", ["left", "right"])
def test_files_that_are_not_there(name: str) -> None:
    refused(FileNotFoundError, "nowhere.png", **{name: "nowhere.png"})


@pytest.mark.parametrize("name", ["left", "right"])
@pytest.mark.parametrize(
    "shape", [(), (8,), (6, 8, 2), (6, 8, 5), (6, 8, 0), (0, 8), (6, 0), (0, 0, 3), (1, 6, 8, 3)]
)
def test_shapes_that_no_image_has(name: str, shape: tuple[int, ...]) -> None:
    refused(ValueError, f"^{name}: got shape .*; accepts ", **{name: np.zeros(shape, np.uint8)})


def test_sizes_that_no_pair_has() -> None:
    accepts = "accepts up to 8 times as many or as few rows and columns as left's 6 x 8"
    refused(ValueError, f"^right: got 6 x 65 pixels; {accepts}", right=np.zeros((6, 65), np.uint8))


@pytest.mark.parametrize("value", [np.inf, -np.inf])
@pytest.mark.parametrize("name", ["left", "right"])
def test_pixels_that_are_no_numbers(name: str, value: float) -> None:
    pair = {"left": REAL, "right": REAL} | {name: holed(value)}
    refused(
        ValueError, f"^{name}: got .* at row 2, column 3; accepts .* where a mask is False", **pair
    )


def test_pixels_beyond_any_use() -> None:
    huge = np.full((6, 8), 1e301)
    refused(ValueError, "^left: got 1e301 at .*1e300", left=huge, right=huge)


def test_masks_that_hide_too_little() -> None:
    mask = np.ones((6, 8), bool)
    refused(ValueError, "^left: got inf.* at row 2", left=holed(np.inf), right=REAL, left_mask=mask)


@pytest.mark.parametrize("name", ["left_mask", "right_mask"])
def test_masks_of_another_kind(name: str) -> None:
    for mask in (np.ones((6, 8), np.uint8), np.ones((6, 8)), [[1]], 5):
        refused(TypeError, f"^{name}: got dtype .*; accepts bool", **{name: mask})
    for shape in ((6, 9), (6,), (6, 8, 1), (0, 0)):
        refused(ValueError, f"^{name}: got shape .*; accepts", **{name: np.ones(shape, bool)})


@pytest.mark.parametrize("value", [0, -1, 9, 10**6, 10**30, -(10**30)])
def test_numbers_of_disparities_out_of_range(value: int) -> None:
    refused(ValueError, "^num_disparities: got ", num_disparities=value)


def test_integers_that_python_refuses_to_print() -> None:
    refused(ValueError, "^num_disparities: got an integer beyond 64 bits", num_disparities=10**5000)
    with pytest.raises(ValueError, match="^p2: got a huge integer; accepts 0 to"):
        ps.optimize(np.zeros((1, 1, 1), np.uint32), p1=1, p2=10**5000)


NO_INTEGERS = [True, False, 4.0, "4", np.float32(4), [4]]
if np.lib.NumpyVersion(np.__version__) >= "2.0.0":  # older ones convert it to an integer
    NO_INTEGERS.append(np.bool_(1))


@pytest.mark.parametrize("value", NO_INTEGERS)
def test_numbers_of_disparities_that_are_no_integer(value: object) -> None:
    refused(TypeError, "^num_disparities: got .*; accepts an integer", num_disparities=value)


@pytest.mark.parametrize("value", [8, -11, 10**6, -(10**6), 10**30])
def test_smallest_disparities_out_of_reach(value: int) -> None:
    refused(ValueError, "^min_disparity: got ", min_disparity=value)


@pytest.mark.parametrize("value", [True, 0.0, "0", None])
def test_smallest_disparities_that_are_no_integer(value: object) -> None:
    refused(TypeError, "^min_disparity: got .*; accepts an integer", min_disparity=value)


@pytest.mark.parametrize("value", [0, -1, 1025, 10**9, 10**30])
def test_numbers_of_threads_out_of_range(value: int) -> None:
    refused(ValueError, "^threads: got ", threads=value)


@pytest.mark.parametrize("value", [True, 1.0, "2"])
def test_numbers_of_threads_that_are_no_integer(value: object) -> None:
    refused(TypeError, "^threads: got .*; accepts an integer", threads=value)


def test_progress_that_cannot_be_called() -> None:
    refused(TypeError, "^progress: got int; accepts a callable", progress=3)


def test_a_range_that_is_to_be_found_begins_at_zero() -> None:
    with pytest.raises(ValueError, match="^min_disparity: got 3; accepts 0 where num_disparities"):
        ps.match(IMAGE, IMAGE, min_disparity=3)


@pytest.mark.parametrize("piece", [ps.descriptor, ps.cost_volume])
def test_the_pieces_refuse_the_same(piece: Any) -> None:
    images = (None,) if piece is ps.descriptor else (None, IMAGE)
    options = {} if piece is ps.descriptor else {"num_disparities": 2}
    with pytest.raises(
        TypeError, match="^(image|left): got NoneType|^(image|left): got dtype object"
    ):
        piece(*images, **options)


class Trap:
    """Claims to be an array, but is not."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("no array after all")

    def __index__(self) -> int:
        raise RuntimeError("no integer after all")


def test_objects_that_break_their_word() -> None:
    refused(TypeError, "^left: got Trap", left=Trap())
    refused(TypeError, "^num_disparities: got Trap", num_disparities=Trap())


class Tensor:
    """An array of another library, which shows it by DLPack alone."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def __dlpack__(self, **options: Any) -> Any:
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.array.__dlpack_device__()


def test_arrays_of_other_libraries_are_taken_without_a_copy() -> None:
    array = np.random.default_rng(0).integers(0, 256, (20, 30), np.uint8)
    tensor: Any = Tensor(array)
    assert np.shares_memory(as_pixels(tensor, "left"), array)
    found = ps.match(tensor, tensor, num_disparities=4)
    assert np.array_equal(found.disparity, ps.match(array, array, num_disparities=4).disparity)


class Interruption:
    """Is interrupted while it is asked for its value."""

    def __index__(self) -> int:
        raise KeyboardInterrupt

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise MemoryError("no room")


def test_what_is_no_fault_of_the_argument_is_let_through() -> None:
    with pytest.raises(KeyboardInterrupt):
        ps.match(IMAGE, IMAGE, num_disparities=Interruption())  # type: ignore[arg-type]  # the point
    with pytest.raises(MemoryError, match="no room"):
        ps.match(Interruption(), IMAGE, num_disparities=2)
