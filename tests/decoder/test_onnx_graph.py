"""Graphs give the videos that torch gives, at sizes that were never traced; what has no graph says so."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig

from sci_lightning.cli.composition import plain
from sci_lightning.decoder import E2ECNN, Decoder
from sci_lightning.decoder import onnx_graph as graph_module
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.decoder.onnx_graph import OnnxDecoder, largest_difference, onnx_graph, random_snapshot, with_mask
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.runs.checkpoint import write_weights
from tests.conftest import members
from tests.decoder.small import SMALL

Run = Refused = Callable[..., str]
FAST = ("gap_tv", "linear")
"""Decoders that take few seconds. The graphs of the other networks have more nodes, and their tests are `slow`."""

pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("onnx", "onnxruntime", "onnxscript")),
    reason="the extra is not installed: pip install 'sci-lightning[onnx]'",
)


@pytest.mark.parametrize(
    "name", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in members("decoder")]
)
def test_contract(name: str, configuration: Callable[..., DictConfig], tmp_path: Path) -> None:
    """Every network of the configuration, its single gains away from 0, at sizes that were never traced."""
    from sci_lightning.cli.composition import built

    decoder = built(configuration("train", f"decoder={name}", "frames=3", *SMALL.get(name, [])), "decoder")
    if isinstance(decoder, Iterative) or not count_parameters(decoder):
        with pytest.raises(BadInput, match="has no graph: it is an algorithm"):
            onnx_graph(decoder, 3)
        return
    with torch.no_grad():
        for parameter in decoder.parameters():
            if parameter.numel() == 1:
                parameter += 0.1
    model = onnx_graph(decoder, 3)
    (tmp_path / "a.onnx").write_bytes(model.SerializeToString())
    sizes = [(16, 16), (17, 30), (46, 65)]
    assert largest_difference(OnnxDecoder(tmp_path / "a.onnx"), decoder, 3, sizes) <= 1e-4
    shapes = {value.name: [side.dim_param or side.dim_value for side in value.type.tensor_type.shape.dim]
              for value in (*model.graph.input, *model.graph.output)}  # fmt: skip
    assert shapes["measurement"] == [1, "height", "width"] and shapes["mask"] == [3, "height", "width"]
    assert shapes["video"] == [1, 3, "height", "width"]


@pytest.fixture
def checkpoint(configuration: Callable[..., DictConfig], tmp_path: Path) -> tuple[E2ECNN, LearnedStructural]:
    """``a.ckpt`` of a small network with a trained mask of 18 x 21 pixels and T = 4; returns both."""
    cfg = configuration(
        "train", "decoder=e2e_cnn", "frames=4", "size=[18,21]", "decoder.channels=4", "encoder.mask.bits=3"
    )
    decoder, mask = E2ECNN(4, channels=4), LearnedStructural(3, 4, (18, 21), seed=1)
    config = {**plain(cfg), "names": {"encoder": "lsw_sr", "decoder": "e2e_cnn"}}
    state = {f"decoder.{key}": value for key, value in decoder.state_dict().items()}
    write_weights(tmp_path / "a.ckpt", config, {"encoder.mask.weight": mask.weight.detach(), **state})
    return decoder, mask


def test_the_command(checkpoint: tuple[E2ECNN, LearnedStructural], ran: Run, tmp_path: Path) -> None:
    import onnx

    decoder, _ = checkpoint
    printed = ran("export", "ckpt_path=a.ckpt", "out=new/model.onnx")
    assert "input measurement: float32 (1, height, width)" in printed and "50 x 37" in printed
    assert "one snapshot of 18 x 21" in printed and "onnxruntime" in printed and "new/model.onnx: " in printed
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["model.onnx"]
    properties = {entry.key: entry.value for entry in onnx.load(tmp_path / "new" / "model.onnx").metadata_props}
    assert properties["decoder"] == "e2e_cnn" and properties["frames"] == "4" and float(properties["aperture"]) > 0
    snapshot = random_snapshot(4, (33, 70))
    with torch.no_grad():
        expected = decoder(*snapshot)
    assert torch.allclose(OnnxDecoder(tmp_path / "new" / "model.onnx")(*snapshot), expected, atol=1e-5)


@pytest.mark.slow
def test_a_mask_inside(checkpoint: tuple[E2ECNN, LearnedStructural], ran: Run, tmp_path: Path) -> None:
    decoder, mask = checkpoint
    assert "input mask" not in ran("export", "ckpt_path=a.ckpt", "out=m.onnx", "mask=trained")
    measurement, _ = random_snapshot(4, (18, 21))
    graph = OnnxDecoder(tmp_path / "m.onnx")
    with torch.no_grad():
        assert torch.allclose(graph(measurement, mask()), decoder(measurement, mask()), atol=1e-5)
    np.save(tmp_path / "mask.npy", np.full((4, 20, 24), 0.25, np.float32))
    assert "(1, 20, 24)" in ran("export", "ckpt_path=a.ckpt", "out=m.onnx", "mask=mask.npy")  # its own file is replaced


def test_bad_input(
    checkpoint: tuple[E2ECNN, LearnedStructural], refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = "out=model.onnx"
    assert "error: desci has no graph: it is an algorithm" in refused("export", "decoder=desci", out)
    assert "size=[8,64]: a graph" in refused("export", "ckpt_path=a.ckpt", "size=[8,64]", out)
    assert "give ckpt_path=RUN/checkpoints/last.ckpt, or decoder=NAME" in refused("export", out)
    assert "no such file" in refused("export", "ckpt_path=none.ckpt", out)
    assert "mask=trained: without ckpt_path=" in refused("export", "decoder=e2e_cnn", "mask=trained", out)
    assert "was built for 4 frames" in refused("export", "ckpt_path=a.ckpt", "frames=5", out)
    with monkeypatch.context() as patch:
        patch.setattr(graph_module, "LARGEST_FILE", 1000)
        assert "holds at most 2 GiB" in refused("export", "ckpt_path=a.ckpt", out)
    assert "out=a.ckpt: expected the name of an ONNX file" in refused("export", "ckpt_path=a.ckpt", "out=a.ckpt")
    (tmp_path / "other.onnx").write_text("precious")
    assert "would be overwritten" in refused("export", "ckpt_path=a.ckpt", "out=other.onnx")
    assert (tmp_path / "other.onnx").read_text() == "precious"
    torch.save(torch.nn.Linear(2, 2), tmp_path / "whole.ckpt")
    assert "refused, nothing was executed" in refused("export", "ckpt_path=whole.ckpt", out)
    monkeypatch.setitem(__import__("sys").modules, "onnxruntime", None)
    assert "pip install 'sci-lightning[onnx]'" in refused("export", "ckpt_path=a.ckpt", out)
    assert not (tmp_path / "model.onnx").exists()


class DependsOnValues(Decoder):
    """Decides by what it sees, as no graph can."""

    def __init__(self) -> None:
        super().__init__()
        self.gain = torch.nn.Parameter(torch.ones(()))

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.gain * mask[None] * (1 if measurement.mean() > 0.5 else 2)


def test_a_network_of_your_own() -> None:
    with pytest.raises(BadInput, match=r"DependsOnValues: .*graph"):
        onnx_graph(DependsOnValues(), 2)


def test_a_graph_that_differs_is_not_written(
    checkpoint: tuple[E2ECNN, LearnedStructural], refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = E2ECNN(4, channels=4)  # a graph of other weights
    made = graph_module.onnx_graph(other, 4)
    monkeypatch.setattr(graph_module, "onnx_graph", lambda *arguments: made)
    line = refused("export", "ckpt_path=a.ckpt", "out=model.onnx", status=1)
    assert "the graph's video differs from torch's by" in line and "nothing was written" in line
    assert not list(tmp_path.glob("*.onnx"))


@pytest.mark.slow
def test_differences_of_shape(tmp_path: Path) -> None:
    decoder = E2ECNN(2, channels=4, blocks=1)
    (tmp_path / "a.onnx").write_bytes(with_mask(onnx_graph(decoder, 2), torch.ones(2, 16, 16)).SerializeToString())
    graph = OnnxDecoder(tmp_path / "a.onnx")
    with pytest.raises(BadInput, match="16 x 16 pixels or more"):
        with_mask(onnx_graph(decoder, 2), torch.ones(2, 8, 16))
    with pytest.raises(MachineFailure, match="differs from torch's"):
        largest_difference(graph, decoder, 2, [(16, 16)])  # another mask than the one inside
