"""Images: the samples of a file arrive exactly, or the file is refused by name."""

import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo.io import read_image, read_pair, write_image
from support import counterpart

pil, tifffile, cv2 = map(counterpart, ("PIL.Image", "tifffile", "cv2"))


def noise(shape: tuple[int, ...], dtype: str, seed: int = 0) -> NDArray[Any]:
    """Return samples over the whole range of an integer type, or floats of both signs."""
    random = np.random.default_rng(seed)
    if dtype == "float32":
        return random.normal(0, 100, shape).astype(np.float32)
    return random.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def chunk(kind: bytes, content: bytes) -> bytes:
    """Return a PNG chunk."""
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


LOSSLESS = [
    (".png", "uint8", (5, 7)),
    (".png", "uint8", (5, 7, 3)),
    (".png", "uint8", (5, 7, 4)),
    (".png", "uint16", (5, 7)),
    (".pgm", "uint8", (5, 7)),
    (".pgm", "uint16", (5, 7)),
    (".ppm", "uint8", (5, 7, 3)),
    (".bmp", "uint8", (5, 7)),
    (".bmp", "uint8", (5, 7, 3)),
    (".pfm", "float32", (5, 7)),
    (".PFM", "float32", (5, 7, 3)),
    *[
        (suffix, dtype, shape)
        for suffix in (".tif", ".tiff", ".npy")
        for dtype in ("uint8", "uint16", "float32")
        for shape in [(5, 7), (5, 7, 3), (5, 7, 4)]
    ],
]


@pytest.mark.parametrize(("suffix", "dtype", "shape"), LOSSLESS)
def test_images_come_back_exactly(
    tmp_path: Path, suffix: str, dtype: str, shape: tuple[int, ...]
) -> None:
    image = noise(shape, dtype)

    path = tmp_path / f"image{suffix}"
    write_image(str(path), image)

    loaded = read_image(str(path))
    assert loaded.dtype == image.dtype
    assert loaded.flags.writeable
    np.testing.assert_array_equal(loaded, image)

    write_image(path, image[::-1, ::2])  # a view, over an existing file
    np.testing.assert_array_equal(read_image(path), image[::-1, ::2])


@pytest.mark.parametrize("channels", [3, 4])
def test_webp_comes_as_it_is_stored(tmp_path: Path, channels: int) -> None:
    image = noise((16, 24, channels), "uint8")
    path = tmp_path / "a.webp"
    pil.fromarray(image).save(path, lossless=True, exact=True)
    np.testing.assert_array_equal(read_image(path), image)

    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ValueError, match=r"a\.webp: "):
        read_image(path)

    path.write_bytes(b"RIFF\x04\0\0\0WAVE")
    with pytest.raises(ValueError, match=r"a\.webp: "):
        read_image(path)


@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "mpo"])
def test_pictures_are_turned_as_they_say(tmp_path: Path, ending: str) -> None:
    turned = counterpart("PIL.ImageOps").exif_transpose
    blocks = np.random.default_rng(0).integers(0, 256, (3, 5), dtype=np.uint8)
    image = pil.fromarray(np.kron(blocks, np.ones((8, 8), np.uint8)))
    options: dict[str, Any] = {"lossless": True} if ending == "webp" else {}
    if ending == "mpo":  # the second picture leaves to the first how both were held
        options = {"format": "MPO", "save_all": True, "append_images": [image]}

    for orientation in range(10):  # 0 and 9 are none
        exif = pil.Exif()
        exif[0x0112] = orientation
        path = tmp_path / f"{orientation}.{ending}"
        image.save(path, exif=exif, **options)

        with pil.open(path) as opened:
            expected = np.array(turned(opened)).astype(int)
        for picture in read_pair(path) if ending == "mpo" else (read_image(path),):
            assert picture.shape == expected.shape, orientation
            assert np.abs(picture - expected).max() <= 2, orientation


def test_of_pictures_with_a_preview_the_picture_is_read(tmp_path: Path) -> None:
    image = np.full((40, 64), 90, np.uint8)
    path = tmp_path / "a.jpg"
    preview = pil.fromarray(image[::2, ::2])
    pil.fromarray(image).save(path, format="MPO", save_all=True, append_images=[preview])
    np.testing.assert_array_equal(read_image(path), image)


@pytest.mark.parametrize(("mode", "dtype"), [("L", "uint8"), ("RGB", "uint8"), ("L;16", "uint16")])
def test_heif_comes_nearly_as_it_is_stored(tmp_path: Path, mode: str, dtype: str) -> None:
    heif = counterpart("pillow_heif")

    ramp = np.linspace(0, np.iinfo(dtype).max, 64).astype(dtype)
    shape = (48, 64, 3) if mode == "RGB" else (48, 64)
    image = np.broadcast_to(ramp[:, None] if mode == "RGB" else ramp, shape)
    path = tmp_path / "a.heic"

    heif.from_bytes(mode, (64, 48), image.tobytes()).save(path, quality=-1, chroma=444)
    loaded = read_image(path)

    assert (loaded.dtype, loaded.shape) == (image.dtype, image.shape)
    assert np.abs(loaded.astype(int) - image).max() <= np.iinfo(dtype).max / 64


def test_heif_that_unpacks_to_more_than_its_length_can_hold_is_refused(tmp_path: Path) -> None:
    heif = counterpart("pillow_heif")
    size = 1000, 1000
    heif.from_bytes("L", size, bytes(size[0] * size[1])).save(tmp_path / "a.heic", quality=1)
    with pytest.raises(ValueError, match=r"a\.heic: the header asks for 1000000 bytes of samples"):
        read_image(tmp_path / "a.heic")


def test_heif_needs_its_extra_and_is_not_taken_for_a_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)

    path = tmp_path / "a.heic"
    path.write_bytes(b"\0\0\0\x18ftypheic" + bytes(40))
    with pytest.raises(ImportError, match=r"pip install 'phasestereo\[heif\]'"):
        read_image(path)

    path.write_bytes(b"\0\0\0\x18ftypisom" + bytes(40))
    with pytest.raises(ValueError, match=r"a\.heic: not a HEIF picture, .* brand b'isom'"):
        read_image(path)


@pytest.mark.parametrize("shape", [(16, 24), (16, 24, 3)])
def test_jpeg_comes_back_nearly(tmp_path: Path, shape: tuple[int, ...]) -> None:
    image = np.broadcast_to(np.linspace(40, 200, 24).astype(np.uint8)[:, None], (16, 24, 3))
    image = image[:, :, 0] if len(shape) == 2 else image
    write_image(tmp_path / "a.jpg", np.ascontiguousarray(image))
    loaded = read_image(tmp_path / "a.jpg")
    assert loaded.shape == shape
    assert np.abs(loaded.astype(int) - image).max() <= 3


@pytest.mark.parametrize(
    ("suffix", "shape"),
    [(suffix, shape) for suffix in (".png", ".tif") for shape in [(9, 11), (9, 11, 3), (9, 11, 4)]]
    + [(".pgm", (9, 11)), (".ppm", (9, 11, 3))],
)
def test_opencv_agrees_about_16_bits(tmp_path: Path, suffix: str, shape: tuple[int, ...]) -> None:
    image = noise(shape, "uint16")
    path = tmp_path / f"wide{suffix}"
    swapped = image if len(shape) == 2 else image[..., [2, 1, 0, *range(3, shape[2])]]
    options = [cv2.IMWRITE_TIFF_COMPRESSION, 1] if suffix == ".tif" else []

    assert cv2.imwrite(str(path), swapped, options)

    loaded = read_image(path)
    assert loaded.dtype == np.uint16
    np.testing.assert_array_equal(loaded, image)


def png_16_bit(samples: NDArray[np.uint16], color_type: int) -> bytes:
    """Encode 16-bit samples by hand: one IDAT, no filter."""
    height, width = samples.shape[:2]
    rows = samples.astype(">u2").reshape(height, -1)
    coded = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    header = struct.pack(">IIBBBBB", width, height, 16, color_type, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", coded) + chunk(b"IEND", b"")
    )


def test_16_bit_gray_png_with_alpha_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "la.png"
    path.write_bytes(png_16_bit(noise((6, 5, 2), "uint16"), color_type=4))
    with pytest.raises(ValueError, match=r"la\.png: 16-bit samples .* cannot be read exactly"):
        read_image(path)


@pytest.mark.parametrize(
    ("maximum", "magic", "samples"),
    [
        (15, b"P5", [[0, 7, 15]]),
        (1023, b"P5", [[0, 511, 1023]]),
        (65535, b"P5", [[0, 511, 65535]]),
        (100, b"P6", [[[0, 50, 100]]]),
        (4095, b"P6", [[[0, 257, 4095]]]),
        (65535, b"P6", [[[0, 257, 65535]]]),
    ],
)
def test_netpbm_samples_are_not_rescaled(
    tmp_path: Path, maximum: int, magic: bytes, samples: list[Any]
) -> None:
    array = np.array(samples, "u1" if maximum < 256 else ">u2")
    head = b"%s\n# a comment\n%d 1 %d\n" % (magic, array.shape[1], maximum)
    (tmp_path / "a.pnm").write_bytes(head + array.tobytes())
    loaded = read_image(tmp_path / "a.pnm")
    assert loaded.dtype == (np.uint8 if maximum < 256 else np.uint16)
    np.testing.assert_array_equal(loaded, samples)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"P1\n3 1\n1 0 1\n", [[0, 255, 0]]),  # 1 is black
        (b"P2\n3 1\n255\n0 7 255\n", [[0, 7, 255]]),
        (b"P2\n3 1\n65535\n0 7 65535\n", [[0, 7, 65535]]),
        (b"P3\n1 1\n255\n0 7 255\n", [[[0, 7, 255]]]),
    ],
)
def test_plain_text_netpbm(tmp_path: Path, text: bytes, expected: list[Any]) -> None:
    (tmp_path / "a.pnm").write_bytes(text)
    np.testing.assert_array_equal(read_image(tmp_path / "a.pnm"), expected)


@pytest.mark.parametrize("text", [b"P2\n1 1\n15\n7\n", b"P3\n1 1\n65535\n0 7 65535\n"])
def test_plain_text_netpbm_that_would_be_rescaled_is_refused(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "a.pnm").write_bytes(text)
    with pytest.raises(ValueError, match=r"a\.pnm: .*rescaled"):
        read_image(tmp_path / "a.pnm")


def test_palettes_bits_and_alpha_are_expanded(tmp_path: Path) -> None:
    colors = pil.fromarray(np.array([[0, 1, 2]], np.uint8), mode="P")
    colors.putpalette([9, 8, 7, 255, 0, 0, 0, 0, 255])

    grays = colors.copy()
    grays.putpalette([0, 0, 0, 128, 128, 128, 255, 255, 255])

    bilevel = pil.fromarray(np.array([[True, False, True]]))
    gray_alpha = pil.fromarray(np.array([[[5, 200]]], np.uint8), mode="LA")

    kinds: list[tuple[Any, list[Any]]] = [
        (colors, [[[9, 8, 7], [255, 0, 0], [0, 0, 255]]]),
        (grays, [[0, 128, 255]]),
        (bilevel, [[255, 0, 255]]),
    ]
    cases = [(suffix, *kind) for suffix in (".png", ".tif", ".bmp") for kind in kinds]
    for suffix, image, expected in [*cases, (".png", gray_alpha, [[[5, 5, 5, 200]]])]:
        image.save(tmp_path / f"a{suffix}")
        np.testing.assert_array_equal(read_image(tmp_path / f"a{suffix}"), expected)


def test_other_kinds_of_color_are_refused(tmp_path: Path) -> None:
    for name in ("cmyk.jpg", "cmyk.tif"):
        pil.new("CMYK", (4, 4)).save(tmp_path / name)
        with pytest.raises(ValueError, match=name):
            read_image(tmp_path / name)


def test_several_images_in_a_file_are_refused(tmp_path: Path) -> None:
    for name in ("animated.png", "stereo.mpo", "pages.tif"):
        first, second = (pil.fromarray(noise((4, 4), "uint8", seed)) for seed in (1, 2))
        first.save(tmp_path / name, save_all=True, append_images=[second])

    tifffile.imwrite(
        tmp_path / "volume.tif",
        np.zeros((16, 16, 3), np.uint8),
        volumetric=True,
        tile=(16, 16, 16),
        photometric="minisblack",
    )

    for name in ("animated.png", "stereo.mpo", "pages.tif", "volume.tif"):
        with pytest.raises(ValueError, match=name):
            read_image(tmp_path / name)


def test_overviews_of_a_tiff_do_not_count(tmp_path: Path) -> None:
    image = noise((32, 32), "uint8")
    with tifffile.TiffWriter(tmp_path / "overview.tif") as writer:
        writer.write(image, tile=(16, 16), compression="zlib")
        writer.write(image[::2, ::2], subfiletype=1)
    np.testing.assert_array_equal(read_image(tmp_path / "overview.tif"), image)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize(
    "options",
    [
        {"planarconfig": "separate"},
        {"tile": (16, 16), "compression": "zlib"},
        {"bigtiff": True, "byteorder": ">"},
        {"rowsperstrip": 3, "compression": "zlib"},
    ],
)
def test_layouts_of_tiff(tmp_path: Path, dtype: str, options: dict[str, Any]) -> None:
    image = noise((19, 21, 3), dtype)
    stored = np.moveaxis(image, 2, 0) if "planarconfig" in options else image
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="rgb", **options)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image)


@pytest.mark.parametrize(
    ("dtype", "shape"),
    [
        ("uint8", (9, 7)), ("uint8", (9, 7, 3)), ("uint8", (9, 7, 4)),
        ("uint16", (9, 7)), ("uint16", (9, 7, 3)), ("uint16", (9, 7, 4)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("predictor", [1, 2])
def test_lzw_of_tiff_is_unpacked(
    tmp_path: Path, dtype: str, shape: tuple[int, ...], predictor: int
) -> None:
    image, path = noise(shape, dtype), tmp_path / "a.tif"
    tags = cv2.IMWRITE_TIFF_COMPRESSION, 5, cv2.IMWRITE_TIFF_PREDICTOR, predictor
    cv2.imwrite(
        str(path), image if image.ndim == 2 else image[:, :, [2, 1, 0, 3][: shape[2]]], tags
    )
    np.testing.assert_array_equal(read_image(path), image, strict=True)


def test_a_white_zero_of_tiff_is_turned_round(tmp_path: Path) -> None:
    image = noise((5, 7), "uint16")
    tifffile.imwrite(tmp_path / "a.tif", ~image, photometric="miniswhite")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), image)


def test_a_tiff_with_missing_tiles_is_refused(tmp_path: Path) -> None:
    tiles = iter([np.ones((16, 16), np.uint8), None, None, None])
    tifffile.imwrite(tmp_path / "a.tif", tiles, shape=(32, 32), dtype=np.uint8, tile=(16, 16))
    with pytest.raises(ValueError, match=r"a\.tif: some strips or tiles .* missing"):
        read_image(tmp_path / "a.tif")


def test_float64_and_single_channels_of_npy_become_pixels(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[[0.1], [np.nan]]]))
    loaded = read_image(tmp_path / "a.npy")
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, np.array([[0.1, np.nan]], np.float32))
    fortran = np.asfortranarray(noise((4, 5, 3), "uint16").astype(">u2"))
    np.save(tmp_path / "b.npy", fortran)
    np.testing.assert_array_equal(read_image(tmp_path / "b.npy"), fortran)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 2), np.int32), "dtype int32"),
        (np.zeros((2, 2), np.complex64), "dtype complex64"),
        (np.zeros((2, 2), bool), "dtype bool"),
        (np.array([[{"a": 1}]], object), "dtype object"),
        (np.array([["text"]]), "dtype <U4"),
        (np.zeros((2, 2, 2), np.uint8), "1, 3 or 4 channels"),
        (np.zeros((2, 2, 5), np.uint8), "1, 3 or 4 channels"),
        (np.zeros((1, 2, 2, 3), np.uint8), "1, 3 or 4 channels"),
        (np.zeros(4, np.uint8), "1, 3 or 4 channels"),
        (np.zeros((0, 4), np.uint8), "1, 3 or 4 channels"),
        (np.full((2, 2), 1e300), "overflow"),
    ],
)
def test_npy_files_of_other_arrays_are_refused(
    tmp_path: Path, array: NDArray[Any], message: str
) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ValueError, match=rf"a\.npy: .*{message}"):
        read_image(tmp_path / "a.npy")


def test_npy_headers_that_lie_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "lie.npy"
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 1000000000), }"
    header = header.ljust(117) + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    with pytest.raises(ValueError, match=r"lie\.npy: the header asks for 4000000000000"):
        read_image(path)


def test_sizes_beyond_the_limit_are_refused_before_they_are_allocated(tmp_path: Path) -> None:
    header = struct.pack(">IIBBBBB", 2**16, 2**15, 8, 0, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")
    (tmp_path / "bomb.png").write_bytes(bomb)
    (tmp_path / "bomb.pgm").write_bytes(b"P5\n1000000000 1000000000\n255\n")

    tiles = iter([np.zeros((2**11, 2**11), np.uint8), *[None] * (2**9 - 1)])
    tifffile.imwrite(
        tmp_path / "bomb.tif", tiles, shape=(2**16, 2**15), dtype="u1", tile=(2**11, 2**11)
    )

    for name in ("bomb.png", "bomb.pgm", "bomb.tif"):
        with pytest.raises(ValueError, match=rf"{name}: .* at most 200000000"):
            read_image(tmp_path / name)


def test_the_limit_of_pillow_is_neither_met_nor_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pil, "MAX_IMAGE_PIXELS", 10)  # Image.open would refuse 21 pixels
    image = noise((5, 7), "uint8")
    for suffix in (".png", ".pgm", ".bmp", ".jpg"):
        write_image(tmp_path / f"a{suffix}", image)
        assert read_image(tmp_path / f"a{suffix}").shape == image.shape
    assert pil.MAX_IMAGE_PIXELS == 10


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("a.ppm", np.zeros((2, 2), np.uint8), r"\.ppm cannot hold uint8 samples in 1 channel"),
        ("a.pgm", np.zeros((2, 2, 3), np.uint8), r"these can: \.png, \.ppm"),
        ("a.ppm", np.zeros((2, 2, 4), np.uint8), "4 channel"),
        ("a.png", np.zeros((2, 2, 3), np.uint16), r"these can: \.tif, \.tiff, \.npy"),
        ("a.png", np.zeros((2, 2), np.float32), r"these can: \.tif, \.tiff, \.npy, \.pfm"),
        ("a.jpg", np.zeros((2, 2), np.uint16), "uint16"),
        ("a.pfm", np.zeros((2, 2), np.uint8), "uint8"),
        ("a.pfm", np.zeros((2, 2, 4), np.float32), "4 channel"),
        ("a.xyz", np.zeros((2, 2), np.uint8), r"one of \.png, .*got '\.xyz'"),
        ("a", np.zeros((2, 2), np.uint8), "got ''"),
        ("a.png", np.zeros((2, 2, 2), np.uint8), "shape"),
        ("a.png", np.zeros((0, 2), np.uint8), "shape"),
        ("a.png", np.zeros(2, np.uint8), "shape"),
    ],
)
def test_images_a_format_cannot_hold_are_refused(
    tmp_path: Path, name: str, image: NDArray[Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("image", [np.zeros((2, 2)), np.zeros((2, 2), bool), [[1, 2]]])
def test_images_of_another_type_are_refused(tmp_path: Path, image: Any) -> None:
    with pytest.raises(TypeError, match="uint8 or uint16 or float32"):
        write_image(tmp_path / "a.npy", image)


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".ppm", ".bmp", ".jpg", ".tif", ".npy", ".pfm"])
def test_truncated_and_damaged_files_never_come_back_as_another_image(
    tmp_path: Path, suffix: str
) -> None:
    image = noise((16, 16), "float32" if suffix == ".pfm" else "uint8")
    image = np.dstack([image] * 3) if suffix == ".ppm" else image
    path = tmp_path / f"a{suffix}"
    write_image(path, image)

    content = path.read_bytes()
    original = read_image(path)

    for length in {*range(0, len(content), 7), len(content) - 1}:
        path.write_bytes(content[:length])
        try:
            loaded = read_image(path)
        except ValueError as error:
            assert str(path) in str(error)  # noqa: PT017 - some cuts leave the image whole
        else:
            np.testing.assert_array_equal(loaded, original)
