"""TIFF, PNG and BMP: every kind of number is right or refused, and no file takes more memory than it is worth."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tifffile import TiffWriter, imwrite

from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.picture_file import read_pictures
from tests import hostile_files
from tests.hostile_files import deflated

RANDOM = np.random.default_rng(0)
STACK = RANDOM.integers(0, 200, (3, 32, 48))
READ = """
from sci_lightning.files.picture_file import read_pictures
def read(path):
    read_pictures(path, prefer="meas")
"""


@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2", "i2", "i4", "u4", "f2", "<f4", ">f4", "f8", "?"])
@pytest.mark.parametrize("layout", [{}, {"tile": (16, 16)}, {"compression": "zlib"}, {"rowsperstrip": 5}])
def test_every_type_of_tiff(tmp_path: Path, dtype: str, layout: dict[str, object]) -> None:
    stack = (STACK % 2 if dtype == "?" else STACK).astype(dtype)
    order = {"byteorder": ">"} if dtype[0] == ">" else {}
    for name, values in (("stack.tif", stack), ("one.tif", stack[0])):
        imwrite(tmp_path / name, values, photometric="minisblack", **layout, **order)
        result = read_pictures(tmp_path / name, prefer="meas")
        assert result.dtype.newbyteorder("=") == np.dtype(dtype).newbyteorder("=")
        np.testing.assert_array_equal(result, values)


def test_values_that_are_no_numbers_stay_what_they_are(tmp_path: Path) -> None:
    imwrite(tmp_path / "a.tif", np.array([[np.nan, np.inf], [-1, 0]], np.float32))
    np.testing.assert_array_equal(read_pictures(tmp_path / "a.tif", prefer="meas"), [[np.nan, np.inf], [-1, 0]])


@pytest.mark.parametrize("dtype", ["c8", "c16"])
def test_complex_tiff(tmp_path: Path, dtype: str) -> None:
    imwrite(tmp_path / "a.tif", np.ones((32, 48), dtype))
    with pytest.raises(BadInput, match=r"a\.tif: real .*complex"):
        read_pictures(tmp_path / "a.tif", prefer="meas")


def test_tiff_that_is_no_grey_picture(tmp_path: Path) -> None:
    page = STACK[0].astype(np.uint8)
    imwrite(tmp_path / "rgb.tif", STACK.astype(np.uint8).transpose(1, 2, 0), photometric="rgb")
    colours = np.stack([np.arange(256), np.zeros(256), np.arange(256)]).astype(np.uint16) * 257
    imwrite(tmp_path / "palette.tif", page, photometric="palette", colormap=colours)
    imwrite(tmp_path / "white.tif", STACK[0].astype(np.float32), photometric="miniswhite")
    for name, line in (("rgb", "channels that differ"), ("palette", "palette of colours"), ("white", "white as 0")):
        with pytest.raises(BadInput, match=rf"{name}\.tif: .*{line}"):
            read_pictures(tmp_path / f"{name}.tif", prefer="meas")
    imwrite(tmp_path / "hyper.tif", np.stack([STACK.astype(np.uint8)] * 2), imagej=True, metadata={"axes": "TCYX"})
    with pytest.raises(BadInput, match=r"hyper\.tif: .*hyperstack \(2 of T, 3 of C"):
        read_pictures(tmp_path / "hyper.tif", prefer="meas")
    with TiffWriter(tmp_path / "sizes.tif") as file:
        for size in (8, 9):
            file.write(np.zeros((size, size), np.uint8), photometric="minisblack", metadata=None)
    with pytest.raises(BadInput, match=r"sizes\.tif: .* 8 x 8 .*, 9 x 9 "):
        read_pictures(tmp_path / "sizes.tif", prefer="meas")


@pytest.mark.parametrize("compression", ["tiff_lzw", "packbits", "tiff_adobe_deflate", "tiff_deflate", "zstd", "lzma"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_every_compression_that_pillow_writes(tmp_path: Path, compression: str, dtype: type) -> None:
    pages = [Image.fromarray(page.astype(dtype)) for page in STACK]
    try:
        pages[0].save(tmp_path / "a.tif", compression=compression, save_all=True, append_images=pages[1:])
    except (OSError, KeyError, ValueError):
        pytest.skip(f"this Pillow writes no {compression}")
    np.testing.assert_array_equal(read_pictures(tmp_path / "a.tif", prefer="meas"), STACK)


@pytest.mark.parametrize("bits", [8, 16])
def test_lzw_in_which_white_is_0(tmp_path: Path, bits: int) -> None:
    """Pillow inverts numbers of 8 bits while it reads them, and no others."""
    values = (STACK[0] * (2**bits // 256)).astype(f"u{bits // 8}")
    Image.fromarray(values).save(tmp_path / "a.tif", compression="tiff_lzw")
    content = (tmp_path / "a.tif").read_bytes()
    entry = struct.pack("<HHIHH", 262, 3, 1, 1, 0)
    assert content.count(entry) == 1
    (tmp_path / "a.tif").write_bytes(content.replace(entry, struct.pack("<HHIHH", 262, 3, 1, 0, 0)))
    np.testing.assert_array_equal(read_pictures(tmp_path / "a.tif", prefer="meas"), 2**bits - 1 - values)


def test_a_compression_without_a_reader_is_named(tmp_path: Path) -> None:
    path = tiff(tmp_path / "a.tif", 8, 8, bytes(64), 34712)  # JPEG 2000, which Pillow's libtiff has not
    with pytest.raises(BadInput, match=r"a\.tif: .*JPEG.*2000.*imagecodecs"):
        read_pictures(path, prefer="meas")


@pytest.mark.parametrize("bits", [4, 10, 12, 14])
def test_tiff_of_packed_numbers(tmp_path: Path, bits: int) -> None:
    """Rows begin with a byte of their own: 7 numbers of 12 bits take 11 bytes."""
    values = RANDOM.integers(0, 2**bits, (5, 7))
    single = (values[..., None] >> np.arange(bits - 1, -1, -1)) & 1
    content = np.packbits(single.reshape(5, -1).astype(np.uint8), axis=1).tobytes()
    path = tiff(tmp_path / "a.tif", 5, 7, content, 1)
    eight, own = (struct.pack("<HHII", 258, 3, 1, number) for number in (8, bits))
    path.write_bytes(path.read_bytes().replace(eight, own))
    np.testing.assert_array_equal(read_pictures(path, prefer="meas"), values)


def test_grey_that_is_stored_in_other_ways(tmp_path: Path) -> None:
    page = STACK[0].astype(np.uint8)
    imwrite(tmp_path / "rgb.tif", np.stack([page] * 3, -1), photometric="rgb")
    imwrite(tmp_path / "white.tif", 255 - page, photometric="miniswhite")
    imwrite(tmp_path / "palette.tif", page, photometric="palette", colormap=np.stack([np.arange(256) * 257] * 3))
    imwrite(tmp_path / "axes.tif", page[None, None], photometric="minisblack")
    with TiffWriter(tmp_path / "thumbnail.tif") as file:
        file.write(page[::4, ::4].copy())
        file.write(page)
        file.write(np.zeros((8, 8, 3), np.uint8), photometric="rgb", subfiletype=1)
    for mode in ("RGB", "RGBA", "LA", "P"):
        Image.fromarray(page).convert(mode).save(tmp_path / f"{mode}.png")
    Image.fromarray(page).save(tmp_path / "a.bmp")
    (tmp_path / "bits12.pgm").write_bytes(
        b"P5\n# of a camera\n%d %d\n4095\n" % page.shape[::-1] + page.astype(">u2").tobytes()
    )
    for path in sorted(tmp_path.iterdir()):
        np.testing.assert_array_equal(read_pictures(path, prefer="meas"), page, err_msg=path.name)


def test_grey_pages_that_are_labelled_as_colour(tmp_path: Path) -> None:
    imwrite(tmp_path / "a.tif", STACK.astype(np.uint8))  # tifffile takes three pages for red, green and blue
    with pytest.warns(InputWarning, match="stack of grey pictures"):
        np.testing.assert_array_equal(read_pictures(tmp_path / "a.tif", prefer="meas"), STACK)


def test_a_mosaic_of_colours_is_named(tmp_path: Path) -> None:
    path = tiff(tmp_path / "a.tif", 8, 8, bytes(64), 1)
    grey, mosaic = (struct.pack("<HHII", 262, 3, 1, kind) for kind in (1, 32803))
    path.write_bytes(path.read_bytes().replace(grey, mosaic))
    with pytest.warns(InputWarning, match="Bayer"):
        read_pictures(path, prefer="meas")


def test_imagej_and_ome(tmp_path: Path) -> None:
    stack = STACK.astype(np.uint16)
    imwrite(tmp_path / "imagej.tif", stack, imagej=True)
    np.testing.assert_array_equal(read_pictures(tmp_path / "imagej.tif", prefer="meas"), stack)
    imwrite(tmp_path / "own.ome.tif", stack, photometric="minisblack", metadata={"axes": "TYX"})
    np.testing.assert_array_equal(read_pictures(tmp_path / "own.ome.tif", prefer="meas"), stack)


def test_no_other_file_is_read(tmp_path: Path) -> None:
    """OME metadata may say that the pixels of a picture lie in another file."""
    imwrite(tmp_path / "secret.tif", np.full((32, 48), 77, np.uint8))
    xml = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:1">'
        '<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="48" SizeY="32" SizeZ="1" '
        'SizeC="1" SizeT="1"><TiffData FirstT="0" IFD="0" PlaneCount="1"><UUID FileName="secret.tif">urn:uuid:2</UUID>'
        "</TiffData></Pixels></Image></OME>"
    )
    imwrite(tmp_path / "a.ome.tif", np.full((32, 48), 5, np.uint8), description=xml, metadata=None)
    assert (read_pictures(tmp_path / "a.ome.tif", prefer="meas") == 5).all()


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("layout", [{}, {"compression": "zlib"}, {"tile": (16, 16)}])
def test_truncated_tiff(tmp_path: Path, share: float, layout: dict[str, object]) -> None:
    imwrite(tmp_path / "a.tif", STACK.astype(np.uint16), photometric="minisblack", **layout)
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BadInput, match=r"a\.tif: .*damaged or truncated") as caught:
        read_pictures(tmp_path / "a.tif", prefer="meas")
    assert "\n" not in str(caught.value)


def tiff(path: Path, height: int, width: int, content: bytes, compression: int) -> Path:
    """A TIFF of one strip whose size need not fit its numbers."""
    tags = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, compression), (262, 3, 1), (273, 4, 8)]
    tags += [(277, 3, 1), (278, 4, height), (279, 4, len(content))]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    directory = struct.pack("<H", len(tags)) + entries + bytes(4)
    path.write_bytes(b"II*\0" + struct.pack("<I", 8 + len(content)) + content + directory)
    return path


def test_pages_in_a_circle(tmp_path: Path) -> None:
    path = tiff(tmp_path / "a.tif", 2, 2, bytes(4), 1)
    path.write_bytes(path.read_bytes()[:-4] + struct.pack("<I", 12))
    assert "pages that follow each other in a circle" in hostile_files.refusal(READ, path)


@pytest.mark.parametrize(
    ("size", "content", "compression", "message"),
    [
        ((2**16, 2**16), b"abc", 1, "declares 4294967296 bytes, the file holds 125 of them"),
        ((2**16, 2**16), deflated(b"", zeros=1), 8, "declares 4.0 GiB, but the file stores only"),
        (
            (64, 64),
            deflated(b"", zeros=600),
            8,
            "a part of the picture inflates to more than its shape (64, 64)",
        ),
    ],
)
def test_tiff_that_declares_too_much(
    tmp_path: Path, size: tuple[int, int], content: bytes, compression: int, message: str
) -> None:
    assert message in hostile_files.refusal(READ, tiff(tmp_path / "a.tif", *size, content, compression))


def png(path: Path, width: int, height: int, bits: int, content: bytes) -> Path:
    """A grey PNG whose size need not fit its numbers."""
    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", content), (b"IEND", b"")]
    parts = [struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


@pytest.mark.parametrize(
    ("bits", "dtype"), [(1, np.bool_), (2, np.uint8), (4, np.uint8), (8, np.uint8), (16, np.uint16)]
)
def test_every_depth_of_png(tmp_path: Path, bits: int, dtype: type) -> None:
    values = RANDOM.integers(0, 2**bits, (5, 16)).astype(np.uint16)
    if bits == 16:
        rows = [row.astype(">u2").tobytes() for row in values]
    else:
        single = (values[..., None] >> np.arange(bits - 1, -1, -1)) & 1
        rows = [np.packbits(row.reshape(-1).astype(np.uint8)).tobytes() for row in single]
    path = png(tmp_path / "a.png", 16, 5, bits, zlib.compress(b"".join(b"\0" + row for row in rows)))
    result = read_pictures(path, prefer="meas")
    assert result.dtype == dtype
    np.testing.assert_array_equal(result, values)


def test_png_that_is_no_grey_picture(tmp_path: Path) -> None:
    for mode in ("RGB", "RGBA", "P"):
        Image.new("RGB", (8, 8), (1, 2, 3)).convert(mode).save(tmp_path / "a.png")
        with pytest.raises(BadInput, match=rf"a\.png: .*grey.* {mode}"):
            read_pictures(tmp_path / "a.png", prefer="meas")


def test_png_that_declares_too_much(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", 2**15, 2**15, 16, zlib.compress(bytes(1000)))
    assert "a.png: not a readable picture" in hostile_files.refusal(READ, path)


def test_pictures_that_are_stored_in_next_to_nothing(tmp_path: Path) -> None:
    path = tiff(tmp_path / "a.tif", 2**14, 2**15, deflated(b"", zeros=512), 8)
    assert "pictures of 512.0 MiB are stored in" in hostile_files.refusal(READ, path)


def test_more_pages_than_anybody_reads(tmp_path: Path) -> None:
    one = tiff(tmp_path / "a.tif", 1, 1, bytes(4), 1).read_bytes()[12:-4]
    size = len(one) + 4
    pages = b"".join(one + struct.pack("<I", 12 + (number + 1) * size) for number in range(25_000))
    (tmp_path / "a.tif").write_bytes(b"II*\0" + struct.pack("<I", 12) + bytes(4) + pages[:-4] + bytes(4))
    assert "more than 20000 pages" in hostile_files.refusal(READ, tmp_path / "a.tif")
