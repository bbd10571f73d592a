"""Checkpoints from strangers: refused with one line, nothing executed; damaged ones are noticed."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

import sci_lightning
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import read_checkpoint, write_weights
from sci_lightning.training.system import System
from tests.runs.small_checkpoint import CONFIG, content, saved


@pytest.mark.parametrize("name", ["a.ckpt", "a.safetensors"])
def test_written_and_read(tmp_path: Path, name: str) -> None:
    whole = content()
    write_weights(tmp_path / name, whole["config"], whole["state_dict"])
    checkpoint = read_checkpoint(str(tmp_path / name))
    encoder, decoder = checkpoint.encoder(), checkpoint.decoder()
    assert torch.equal(encoder.mask(), whole["state_dict"]["encoder.mask.pattern"])
    assert torch.equal(decoder.state_dict()["first.weight"], whole["state_dict"]["decoder.first.weight"])


def test_in_a_notebook(tmp_path: Path) -> None:
    whole = content()
    write_weights(tmp_path / "a.ckpt", whole["config"], whole["state_dict"])
    checkpoint = sci_lightning.load_checkpoint(str(tmp_path / "a.ckpt"))
    encoder, decoder = checkpoint.encoder(), checkpoint.decoder()
    video = torch.rand(2, 4, 8, 8)
    estimate = decoder(encoder(video), encoder.mask())
    assert estimate.shape == video.shape
    system = System.load_from_checkpoint(tmp_path / "a.ckpt")
    assert torch.equal(system(video), estimate)


def test_checkpoints_without_a_digest_open(tmp_path: Path) -> None:
    assert read_checkpoint(saved(tmp_path / "a.ckpt")).decoder().frames == 4


HOSTILE = "${oc.create:{_target_:pathlib.Path.touch,_args_:[executed]}}"
CALL = {"_target_": "pathlib.Path.touch", "self": "executed"}


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("encoder", {**CONFIG["encoder"], "sensor": HOSTILE}, "would be resolved"),
        ("encoder", {**CONFIG["encoder"], "sensor": CALL}, "not a module of sci_lightning"),
        ("decoder", CALL, "not a module of sci_lightning"),
        ("frames", CALL, "frames={.*expected a whole number"),
        ("frames", HOSTILE, "would be resolved"),
        ("size", CALL, "size="),
        ("size", [8, CALL], "size="),
        ("size", [8, 8, 8], "size="),
        ("seed", CALL, "seed="),
        ("crop", CALL, "crop="),
        ("seed", -1, "seed=-1"),
        ("seed", 10**40, "whole number of"),
        ("frames", 4.0, "frames=4.0"),
        ("frames", 100_000, "frames=100000"),
        ("size", [60_000, 60_000], "GiB"),
        ("names", {}, "names.encoder"),
        ("names", None, "names=null"),
        ("names", {"encoder": "x/../../y", "decoder": "e2e_cnn"}, "names.encoder"),
        ("names", {"encoder": "[/]\x1b[2J", "decoder": "e2e_cnn"}, "names.encoder"),
        ("encoder", [], "encoder="),
        ("decoder", "e2e_cnn", "decoder="),
        ("decoder", {}, "_target_"),
        ("decoder", {**CONFIG["decoder"], "channels": 60_000}, "does not fit"),
        ("decoder", {**CONFIG["decoder"], "channels": 10**12}, "decoder.channels"),
        ("encoder", {**CONFIG["encoder"], "mask": {**CONFIG["encoder"]["mask"], "size": [60_000] * 2}}, "GiB"),
        ("encoder", {**CONFIG["encoder"], "mask": CONFIG["decoder"]}, "encoder.mask=an E2ECNN: expected a Mask"),
        (5, 5, "not plain text"),
    ],
)
def test_configurations_that_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, value: Any, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = saved(tmp_path / "a.ckpt", config={**CONFIG, key: value})
    with pytest.raises(BadInput, match=line) as caught:
        checkpoint = read_checkpoint(path)
        checkpoint.encoder()
        checkpoint.decoder()
    message = str(caught.value)
    assert message.startswith(str(path)) and message.isprintable() and len(message) < 600
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("missing", sorted(CONFIG))
def test_configurations_that_lack_a_key(tmp_path: Path, missing: str) -> None:
    config = {key: value for key, value in CONFIG.items() if key != missing}
    with pytest.raises(BadInput, match=f"has no '{missing}'"):
        read_checkpoint(saved(tmp_path / "a.ckpt", config=config))


@pytest.mark.parametrize(
    "entry",
    [
        torch.zeros(1).expand(10**12),
        torch.zeros(2, 2).to_sparse(),
        torch.empty(10**12, device="meta"),
        3.0,
        [torch.zeros(1)],
    ],
    ids=["expanded", "sparse", "meta", "number", "list"],
)
def test_tensors_that_are_refused(tmp_path: Path, entry: Any) -> None:
    state = {**content()["state_dict"], "decoder.first.weight": entry}
    with pytest.raises(BadInput, match=r"ordinary tensor|expected tensors by name"):
        read_checkpoint(saved(tmp_path / "a.ckpt", state_dict=state))


@pytest.mark.parametrize("name", ["a.ckpt", "a.safetensors"])
def test_flipped_bits_are_noticed(tmp_path: Path, name: str) -> None:
    whole = content()
    write_weights(tmp_path / name, whole["config"], whole["state_dict"])
    bytes_ = bytearray((tmp_path / name).read_bytes())
    weight = whole["state_dict"]["decoder.first.weight"].numpy().tobytes()
    bytes_[bytes_.index(weight) + 5] ^= 1
    (tmp_path / name).write_bytes(bytes_)
    with pytest.raises(BadInput, match="damaged"):
        read_checkpoint(tmp_path / name)


def test_another_weight_under_a_right_checksum_is_noticed(tmp_path: Path) -> None:
    whole = content()
    write_weights(tmp_path / "a.ckpt", whole["config"], whole["state_dict"])
    changed = torch.load(tmp_path / "a.ckpt", weights_only=True)
    changed["state_dict"]["decoder.first.weight"][0] += 1
    torch.save(changed, tmp_path / "a.ckpt")
    with pytest.raises(BadInput, match="not those that were written"):
        read_checkpoint(tmp_path / "a.ckpt")


def test_archives_that_would_exhaust_the_memory(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.ckpt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", b"\0" * 10_000_000)
    with pytest.raises(BadInput, match="compressed"):
        read_checkpoint(tmp_path / "a.ckpt")


def test_a_header_that_declares_more_than_the_file_holds(tmp_path: Path) -> None:
    (tmp_path / "a.safetensors").write_bytes(struct.pack("<Q", 2**40) + b"{}")
    with pytest.raises(BadInput, match="damaged or truncated"):
        read_checkpoint(tmp_path / "a.safetensors")


def test_commands_refuse_what_the_reader_refuses(tmp_path: Path, refused: Callable[..., str]) -> None:
    saved(tmp_path / "a.ckpt", config={**CONFIG, "crop": CALL})
    (tmp_path / "x.npy").touch()
    for command, more in (
        ("evaluate", "data=synthetic"),
        ("reconstruct", f"measurement={tmp_path}/x.npy"),
        ("export_mask", "repeat=1"),
    ):
        assert "crop=" in refused(command, "ckpt_path=a.ckpt", more)
    assert not (tmp_path / "executed").exists()
