"""Raw files: the packings of cameras against numbers that are packed one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sci_lightning.captures.snapshots import read_snapshot
from sci_lightning.errors import BadInput
from sci_lightning.files.packed_file import RAW_FORMATS, RawLayout, raw_layout
from sci_lightning.files.picture_file import read_pictures

SIZE = (5, 7)  # 35 pixels: no whole number of bytes in any packing


def packed(values: np.ndarray, name: str) -> bytes:
    """Pack the pixels of one image with whole numbers of Python."""
    bits, pixels = RAW_FORMATS[name], [int(value) for value in values.reshape(-1)]
    if name.endswith("p"):
        number = sum(pixel << bits * index for index, pixel in enumerate(pixels))
        return number.to_bytes(-(-bits * len(pixels) // 8), "little")
    if name.endswith("Packed"):
        low = bits - 8
        pairs = [[*pixels, 0][index : index + 2] for index in range(0, len(pixels), 2)]
        return b"".join(bytes((a >> low, a % 2**low | (b % 2**low) << 4, b >> low)) for a, b in pairs)
    return values.astype("u1" if bits == 8 else "<u2").tobytes()


@pytest.mark.parametrize("name", RAW_FORMATS)
def test_every_format(tmp_path: Path, name: str) -> None:
    images = np.random.default_rng(0).integers(0, 2 ** RAW_FORMATS[name], (2, *SIZE))
    (tmp_path / "a.raw").write_bytes(b"".join(packed(image, name) for image in images))
    layout = RawLayout(name, SIZE)
    np.testing.assert_array_equal(read_pictures(tmp_path / "a.raw", prefer="", raw=layout), images)
    snapshot = read_snapshot(tmp_path / "a.raw", raw=layout)
    np.testing.assert_allclose(snapshot.measurement, images / (2 ** RAW_FORMATS[name] - 1), rtol=1e-6)


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.raw").write_bytes(bytes(100))
    with pytest.raises(BadInput, match=r"a\.raw: 100 bytes .* 5 x 7 .*Mono12p, 53"):
        read_pictures(tmp_path / "a.raw", prefer="", raw=RawLayout("Mono12p", SIZE))
    with pytest.raises(BadInput, match=r"a\.raw: .*raw_format=Mono12p 'raw_size"):
        read_pictures(tmp_path / "a.raw", prefer="")
    (tmp_path / "a.raw").write_bytes(b"\xff" * 70)
    with pytest.raises(BadInput, match=r"a\.raw: .*65535 in Mono12.* 4095"):
        read_pictures(tmp_path / "a.raw", prefer="", raw=RawLayout("Mono12", SIZE))


def test_settings() -> None:
    assert raw_layout(None, None) is None
    assert raw_layout("Mono12p", [5, 7]) == RawLayout("Mono12p", (5, 7))
    for settings in (("Mono12p", None), (None, [5, 7])):
        with pytest.raises(BadInput, match=r"raw_format=Mono12p and .*raw_size"):
            raw_layout(*settings)
    with pytest.raises(BadInput, match="raw_format=RGB8: use one of Mono8"):
        raw_layout("RGB8", [5, 7])
