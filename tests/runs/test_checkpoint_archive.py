"""Bytes that torch would obey although nothing is executed: what inflates, allocates, or stands in for a method."""

from __future__ import annotations

import io
import pickle
import re
import struct
import sys
import zipfile
from collections import Counter, OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sci_lightning.cli.failure_line import exit_status, one_line
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import load_file, read_checkpoint
from tests.runs.small_checkpoint import CONFIG, content, saved

Change = Callable[[Path], None]


def append(end: bytes) -> Change:
    """Bytes behind the archive: Python's reader then finds no archive, or another one; torch's finds the first."""

    def change(path: Path) -> None:
        path.write_bytes(path.read_bytes() + end)

    return change


def compressed(path: Path) -> None:
    """The same archive with compressed entries, in which torch finds what it looks for."""
    with zipfile.ZipFile(path) as archive:
        entries = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, written in entries.items():
            archive.writestr(name, written)


@pytest.mark.parametrize("end", [b"PK\x05\x06", b"\0" * 66_000, b"x"], ids=["signature", "far", "byte"])
def test_an_archive_that_two_readers_read_differently(tmp_path: Path, end: bytes) -> None:
    path = saved(tmp_path / "a.ckpt")
    compressed(path)
    append(end)(path)
    with pytest.raises(BadInput, match="one table of contents"):
        read_checkpoint(path)


def test_a_second_table_of_contents(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.ckpt")
    written = path.read_bytes()
    end = written.rindex(b"PK\x05\x06")
    (length,) = struct.unpack_from("<I", written, end + 12)
    (start,) = struct.unpack_from("<I", written, end + 16)
    path.write_bytes(written[:end] + written[start : start + length] + written[end:])
    with pytest.raises(BadInput, match="one table of contents"):
        read_checkpoint(path)


def pickled(path: Path, *operations: bytes) -> Path:
    """A checkpoint whose pickle is written by hand."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", b"\x80\x02" + b"".join(operations) + b".")
        archive.writestr("archive/byteorder", "little")
        archive.writestr("archive/version", "3\n")
    return path


def text(value: str) -> bytes:
    written = value.encode("utf-8", "surrogatepass")
    return b"X" + struct.pack("<I", len(written)) + written


@pytest.mark.parametrize(
    "bomb",
    [
        b"cbuiltins\nbytearray\n(J" + struct.pack("<i", 2**31 - 1) + b"tR",
        b"c__builtin__\nbytearray\n(J" + struct.pack("<i", 2**31 - 1) + b"tR",
        b"c_codecs\nencode\n(" + text("\u4e00" * 100_000) + text("punycode") + b"tR",
        b"cnumpy._core.multiarray\nscalar\n(cnumpy\ndtype\n(" + text("V2000000000") + b"tRtR",
    ],
    ids=["bytearray", "Python 2", "punycode", "numpy"],
)
def test_pickles_that_would_fill_the_memory(tmp_path: Path, bomb: bytes) -> None:
    with pytest.raises(BadInput, match="Python objects other than tensors"):
        read_checkpoint(pickled(tmp_path / "a.ckpt", b"}(", text("config"), bomb, b"u"))


def test_the_format_from_before_2020(tmp_path: Path) -> None:
    torch.save(content(), tmp_path / "a.ckpt", _use_new_zipfile_serialization=False)
    assert read_checkpoint(tmp_path / "a.ckpt").decoder().frames == 4
    pickle_of_tensor = io.BytesIO()
    for part in (0x1950A86A20F9469CFC6C, 1001, {"protocol_version": 1001, "little_endian": True, "type_sizes": {}}):
        pickle.dump(part, pickle_of_tensor, 2)
    count = struct.pack("<i", 10**9)
    storage = b"((" + text("storage") + b"ctorch\nFloatStorage\n" + text("0") + text("cpu") + b"J" + count + b"NtQ"
    tensor = b"ctorch._utils\n_rebuild_tensor_v2\n" + storage + b"K\x00J" + count + b"\x85K\x01\x85\x89"
    tensor += b"ccollections\nOrderedDict\n)RtR"
    pickle_of_tensor.write(b"\x80\x02}(" + text("x") + tensor + b"u.")
    pickle.dump([], pickle_of_tensor, 2)
    (tmp_path / "b.ckpt").write_bytes(pickle_of_tensor.getvalue())
    with pytest.raises(BadInput, match="more bytes than the file holds"):
        load_file(tmp_path / "b.ckpt")


def test_attributes_do_not_stand_in_for_methods(tmp_path: Path) -> None:
    entries = b"ccollections\nOrderedDict\n)R(" + text("config") + b"}" + text("state_dict") + b"}u"
    attributes = b"}(" + text("get") + b"K\x05" + text("items") + b"cbuiltins\nset\nub"
    result = load_file(pickled(tmp_path / "a.ckpt", entries, attributes))
    assert dict(result.items()) == {"config": {}, "state_dict": {}}
    weight = torch.nn.Parameter(torch.zeros(4))
    weight.numel = 5  # type: ignore[assignment, method-assign]
    torch.save({"x": weight}, tmp_path / "b.ckpt")
    assert load_file(tmp_path / "b.ckpt")["x"].numel() == 4


def test_lists_without_end(tmp_path: Path) -> None:
    doubled: Any = ()
    for _ in range(60):
        doubled = (doubled, doubled)
    endless: list[Any] = []
    endless.append(endless)
    for callbacks in (doubled, endless):
        with pytest.raises(BadInput, match="too large for a checkpoint"):
            read_checkpoint(saved(tmp_path / "a.ckpt", callbacks={"a": callbacks}))


def test_names_and_tensors_that_nobody_can_write(tmp_path: Path) -> None:
    state = content()["state_dict"]
    for name, value in (
        ("\ud800", torch.zeros(1)),
        ("a", torch.zeros(2, dtype=torch.complex64).conj()),
        ("a", torch.zeros(2, dtype=torch.complex64).conj().imag),
    ):
        with pytest.raises(BadInput, match=r"printable names|ordinary tensor"):
            read_checkpoint(saved(tmp_path / "a.ckpt", state_dict={**state, name: value}, digest="x"))


def test_numbers_of_numpy_are_read(tmp_path: Path) -> None:
    scores = [np.float64(1.5), np.float32(0.25), np.int64(-3), np.bool_(True)]
    torch.save({"scores": scores}, tmp_path / "a.ckpt")
    assert load_file(tmp_path / "a.ckpt")["scores"] == [1.5, 0.25, -3, True]


EFFECT = "sci_lightning.encoder.effects."


@pytest.mark.parametrize(
    ("effect", "name", "value"),
    [
        ({"_target_": f"{EFFECT}RollingShutter", "delay": 0.5}, "delay", 1e9),
        ({"_target_": f"{EFFECT}RollingShutter", "delay": 0.5}, "delay", float("nan")),
        ({"_target_": f"{EFFECT}MaskBlur", "sigma": 0.5}, "sigma", float("inf")),
        ({"_target_": f"{EFFECT}MaskBlur", "sigma": 0.5}, "sigma", -1.0),
    ],
)
def test_a_state_is_held_to_the_bounds_of_a_configuration(
    tmp_path: Path, effect: dict[str, Any], name: str, value: float
) -> None:
    whole = content()
    encoder = {**CONFIG["encoder"], "effects": {"a": effect}}
    snake = re.sub(r"(?<!^)(?=[A-Z])", "_", effect["_target_"].rpartition(".")[2]).lower()
    state = {**whole["state_dict"], f"encoder.path.effects.{snake}.{name}": torch.tensor(value)}
    path = saved(tmp_path / "a.ckpt", config={**CONFIG, "encoder": encoder}, state_dict=state)
    with pytest.raises(BadInput, match=r"NaN or infinite|must be a number from"):
        read_checkpoint(path).encoder()


def test_a_mask_beyond_transmittance(tmp_path: Path) -> None:
    state = {**content()["state_dict"], "encoder.mask.pattern": torch.full((4, 8, 8), 1e30)}
    with pytest.raises(BadInput, match="0 to 1"):
        read_checkpoint(saved(tmp_path / "a.ckpt", state_dict=state)).encoder()


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("mask", {**CONFIG["encoder"]["mask"], "tile": [65536, 65536]}),
        ("effects", {"a": {"_target_": f"{EFFECT}Prnu", "std": 0.1, "size": [65536, 65536]}}),
        ("effects", {f"a{n}": {"_target_": f"{EFFECT}Prnu", "std": 0.1, "size": [20000, 20000]} for n in range(99)}),
    ],
    ids=["tile", "map", "maps"],
)
def test_encoders_that_would_fill_the_memory(tmp_path: Path, part: str, value: Any) -> None:
    with pytest.raises(BadInput, match="GiB"):
        read_checkpoint(saved(tmp_path / "a.ckpt", config={**CONFIG, "encoder": {**CONFIG["encoder"], part: value}}))


def test_an_encoder_that_cannot_record(tmp_path: Path) -> None:
    ghost = {"_target_": "sci_lightning.encoder.free_form.Ghost", "count": 7}
    encoder = {**CONFIG["encoder"], "effects": {"ghost": ghost}}
    with pytest.raises(BadInput, match="cannot record with these settings"):
        read_checkpoint(saved(tmp_path / "a.ckpt", config={**CONFIG, "encoder": encoder})).encoder()


def huge(number: int) -> bytes:
    written = number.to_bytes((number.bit_length() + 8) // 8, "little")
    return b"\x8a" + bytes([len(written)]) + written


COLLIDING = [huge(number * sys.hash_info.modulus) for number in range(1, 40_000)]
SET = b"cbuiltins\nset\n"


@pytest.mark.parametrize(
    "flood",
    [
        b"}(" + b"".join(key + b"N" for key in COLLIDING) + b"u",
        b"}(" + b"".join(key + b"\x85N" for key in COLLIDING) + b"u",
        SET + b"](" + b"".join(COLLIDING) + b"e\x85R",
        b"}" + b")q\x00" + 60 * b"h\x00\x86q\x00" + b"Ns",
        b"]q\x01\x85q\x02(h\x01(" + b"".join(COLLIDING) + b"e" + SET + b"h\x02Rt",
    ],
    ids=["numbers", "tuples", "set", "a tuple of tuples", "set of a list that grew"],
)
def test_keys_of_one_hash(tmp_path: Path, flood: bytes) -> None:
    """Such a file of half a megabyte keeps a dictionary busy for minutes."""
    with pytest.raises(BadInput, match=r"1,000 keys .*tuples"):
        load_file(pickled(tmp_path / "a.ckpt", b"}(", text("a"), flood, b"u"))


def test_keys_that_trainings_write(tmp_path: Path) -> None:
    whole = {
        "states": OrderedDict((str(n), torch.zeros(2, 3)) for n in range(400)),
        "optimizer": {n: {"step": torch.tensor(1.0)} for n in range(3000)},
        "seeds": {2**64 - n: n for n in range(50)},
        "milestones": Counter(dict.fromkeys(range(3000), 1)),
    }
    torch.save(whole, tmp_path / "a.ckpt")
    assert load_file(tmp_path / "a.ckpt")["seeds"] == whole["seeds"]


def test_a_large_argument_for_every_call(tmp_path: Path) -> None:
    words = b"](" + b"".join(text(str(number)) for number in range(10_000)) + b"e\x85q\x01"
    path = pickled(tmp_path / "a.ckpt", b"}(", text("a"), words, text("b"), b"](" + (SET + b"h\x01R") * 1000 + b"eu")
    with pytest.raises(BadInput, match="steps to unpickle"):
        load_file(path)


def test_missing_values_in_the_format_from_before_2020(tmp_path: Path) -> None:
    torch.save({"x": torch.ones(100)}, tmp_path / "a.ckpt", _use_new_zipfile_serialization=False)
    whole = (tmp_path / "a.ckpt").read_bytes()
    keys = whole.rindex(b"\x80\x02]")
    for end in (pickle.dumps([], 2), whole[keys : keys + 3], whole[keys:-9]):
        (tmp_path / "b.ckpt").write_bytes(whole[:keys] + end)
        with pytest.raises(BadInput) as caught:
            load_file(tmp_path / "b.ckpt")
        assert "\n" not in str(caught.value) and exit_status(caught.value) == 2


def test_a_file_that_lies_is_no_failure_of_the_machine() -> None:
    """A machine that is full or out of memory is status 1; whoever raises BadInput has judged the cause."""
    for cause in (MemoryError(), RuntimeError("[enforce fail at inline_container.cc:144] . file not found")):
        lie = BadInput("a.ckpt: damaged")
        lie.__cause__ = cause
        assert (exit_status(lie), one_line(lie)) == (2, "a.ckpt: damaged")
        assert exit_status(cause) == 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"strengths": [0.1], "iterations": [10**9]},
            r"decoder\.iterations=\[1000000000\]: expected .* from 1 to 10000",
        ),
        (
            {"strengths": [0.1] * 2, "iterations": [9000] * 2},
            r"decoder\.iterations: 18000 in all; expected at most 10000",
        ),
        ({"steps": 10**9}, r"decoder\.denoiser\.steps=1000000000: expected a whole number from 1 to 1000"),
        ({"reach": 10**4}, r"decoder\.motion\.reach=10000: expected a whole number from 0 to 64"),
    ],
)
def test_decoders_without_end(tmp_path: Path, settings: dict[str, Any], message: str) -> None:
    places = "sci_lightning.decoder."
    denoiser = {"_target_": f"{places}denoiser.TotalVariation", "steps": settings.get("steps", 1)}
    motion = (
        {"_target_": f"{places}motion_filter.MotionFilter", "reach": settings["reach"]} if "reach" in settings else None
    )
    decoder = {
        "_target_": f"{places}GAP",
        "denoiser": denoiser,
        "strengths": settings.get("strengths", [0.1]),
        "iterations": settings.get("iterations", [1]),
        "motion": motion,
    }
    with pytest.raises(BadInput, match=message):
        read_checkpoint(saved(tmp_path / "a.ckpt", config={**CONFIG, "decoder": decoder})).decoder()
