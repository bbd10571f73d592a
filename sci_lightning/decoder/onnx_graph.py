"""The ONNX graph of a decoder, for any height and width, with the padding of the decoder's call inside.

Beside the decoder that it was made of, a graph is called in the same way: how far do their videos differ, and how long
do both take?
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import nn

from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.decoder.layers import kernels
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.operator import SnapshotOperator

if TYPE_CHECKING:
    from onnx import ModelProto

SMALLEST_SIDE = 16
"""Smallest H and W of a graph in pixels: below it STFormer takes smaller windows, which is another graph."""

TRACED_SIZE = (48, 64)
"""(H, W) of the measurement that torch is followed on; the graph does not depend on it."""

LARGEST_FILE = 2**31
"""Bytes of an ONNX file with its weights inside, a limit of its format."""

TOLERANCE = 1e-4
"""Largest difference of a pixel of the two videos, in units of the video or of its largest value if that is above 1."""

SIZES = ((48, 64), (50, 37), (64, 80))
"""(H, W) that a graph of any size is compared at: the one that torch was followed on, an odd one, a larger one."""


class SingleSnapshot(nn.Module):
    """A decoder's last estimate, without the checks and the padding of its call.

    Args:
        decoder: any network.
    """

    def __init__(self, decoder: Decoder) -> None:
        super().__init__()
        self.decoder = decoder

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.decoder.decode_stages(measurement, mask)[-1]


def onnx_graph(decoder: Decoder, frames: int, properties: Mapping[str, str] | None = None) -> ModelProto:
    """Return the graph of a decoder in float32.

    Inputs are ``measurement`` ``(1, H, W)`` and ``mask`` ``(T, H, W)``, the output is ``video`` ``(1, T, H, W)``; they
    mean what the decoder's call means by them, and H and W are any from 16 pixels.

    Args:
        decoder: a network, on the CPU.
        frames: T of the graph.
        properties: what the graph says about itself beside ``frames`` and ``smallest_side``.

    Raises:
        BadInput: a decoder that has no graph, or is too large for a file; onnx or onnxscript is not installed.
    """
    require("onnx", "onnxscript")
    name = (properties or {}).get("decoder", type(decoder).__name__)
    if isinstance(decoder, Iterative) or not count_parameters(decoder):
        raise BadInput(
            f"{name} has no graph: it is an algorithm whose steps depend on the mask and on its estimates; "
            "decode with `python -m sci_lightning.reconstruct`, or export a network such as decoder=e2e_cnn"
        )
    if decoder.frames is not None and frames != decoder.frames:
        raise BadInput(f"{name} was built for {decoder.frames} frames, a graph of {frames} was asked for")
    weights = sum(value.numel() * value.element_size() for value in decoder.state_dict().values())
    if weights >= LARGEST_FILE:
        raise BadInput(
            f"{name}: its weights take {weights / 2**30:.2f} GiB, an ONNX file holds at most 2 GiB; "
            "export a slimmer network"
        )
    height, width = (
        decoder.multiple * torch.export.Dim(side, min=-(-SMALLEST_SIDE // decoder.multiple)) for side in "hw"
    )
    inputs = torch.rand(1, *TRACED_SIZE), torch.ones(frames, *TRACED_SIZE)
    shapes = {1: height, 2: width}
    training = decoder.training
    try:
        with kernels.plainly(decoder), torch.no_grad(), _quiet():
            module = SingleSnapshot(decoder.eval())
            program = torch.export.export(module, inputs, dynamic_shapes=(shapes, shapes), strict=False)
            exported = torch.onnx.export(
                program, (), input_names=["measurement", "mask"], output_names=["video"], verbose=False
            )
            model: Any = exported and exported.model_proto
    except Exception as error:  # torch raises many kinds, of which the first line says most
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise BadInput(f"{name}: torch cannot express it as a graph of any height and width: {reason}") from error
    finally:
        decoder.train(training)
    _pad_and_crop(model, decoder.multiple)
    _name_dimensions(model, frames)
    about = {"frames": str(frames), "smallest_side": str(SMALLEST_SIDE), **(properties or {})}
    model.producer_name = "sci_lightning"
    model.doc_string = f"{name}: measurement (1, H, W) and mask (T, H, W) to video (1, T, H, W)"
    for key, value in about.items():
        model.metadata_props.add(key=key, value=value)
    return model


def with_mask(model: ModelProto, mask: torch.Tensor) -> ModelProto:
    """Return a graph with the mask ``(T, H, W)`` inside: only ``measurement`` is left, of the mask's height and width.

    Raises:
        BadInput: a mask smaller than the graph takes.
    """
    from onnx import ModelProto, numpy_helper

    frames, height, width = mask.shape
    if min(height, width) < SMALLEST_SIDE:
        raise BadInput(
            f"the mask is {height} x {width}, a graph takes {SMALLEST_SIDE} x {SMALLEST_SIDE} pixels or more"
        )
    fixed = ModelProto()
    fixed.CopyFrom(model)
    inputs = {value.name: value for value in fixed.graph.input}
    fixed.graph.input.remove(inputs["mask"])
    fixed.graph.initializer.append(numpy_helper.from_array(mask.float().contiguous().numpy(), "mask"))
    _set_shape(inputs["measurement"], (1, height, width))
    _set_shape(fixed.graph.output[0], (1, frames, height, width))
    return fixed


def require(*modules: str) -> None:
    """Import what the optional extra ``onnx`` installs.

    Raises:
        BadInput: one of them is not installed.
    """
    for module in modules:
        try:
            __import__(module)
        except ImportError as error:
            raise BadInput(f"ONNX graphs need the package '{module}': pip install 'sci-lightning[onnx]'") from error


def _pad_and_crop(model: Any, multiple: int) -> None:
    """Put replicating padding to a multiple in front of a graph and cropping behind it, as the decoder's call has them.

    They are nodes of ONNX rather than of torch, which then follows the network on sides that are multiples by
    construction and need no rounding anywhere.
    """
    from onnx import helper, numpy_helper

    graph = model.graph
    renamed = ("measurement", "mask", "video") if multiple > 1 else ("video",)
    for node in graph.node:
        for names in (node.input, node.output):
            names[:] = [f"padded_{name}" if name in renamed else name for name in names]
    constants = {"pad_multiple": [multiple], "pad_none": [0, 0, 0, 0], "crop_from": [0, 0], "crop_axes": [2, 3]}
    for name, values in constants.items():
        graph.initializer.append(numpy_helper.from_array(np.array(values, dtype=np.int64), name))
    sides = helper.make_node("Shape", ["measurement"], ["sides"], start=1, end=3)
    padding = [
        helper.make_node("Mod", ["sides", "pad_multiple"], ["sides_over"]),
        helper.make_node("Sub", ["pad_multiple", "sides_over"], ["sides_to_next"]),
        helper.make_node("Mod", ["sides_to_next", "pad_multiple"], ["sides_missing"]),
        helper.make_node("Concat", ["pad_none", "sides_missing"], ["pads"], axis=0),
        helper.make_node("Pad", ["measurement", "pads"], ["padded_measurement"], mode="edge"),
        helper.make_node("Pad", ["mask", "pads"], ["padded_mask"], mode="edge"),
    ]
    after = helper.make_node("Slice", ["padded_video", "crop_from", "sides", "crop_axes"], ["video"])
    nodes = [sides, *(padding if multiple > 1 else []), *graph.node, after]
    del graph.node[:]
    graph.node.extend(nodes)


def _name_dimensions(model: Any, frames: int) -> None:
    """Give inputs and output the shapes that a user reads; what torch inferred in between names other symbols."""
    del model.graph.value_info[:]
    for value in (*model.graph.input, *model.graph.output):
        first = {"measurement": (1,), "mask": (frames,), "video": (1, frames)}[value.name]
        _set_shape(value, (*first, "height", "width"))


def _set_shape(value: Any, shape: tuple[int | str, ...]) -> None:
    del value.type.tensor_type.shape.dim[:]
    for side in shape:
        value.type.tensor_type.shape.dim.add(**{"dim_param" if isinstance(side, str) else "dim_value": side})


@contextmanager
def _quiet() -> Iterator[None]:
    """Leave out what torch says on the way, which tells a user nothing."""
    loggers = [logging.getLogger(name) for name in ("torch.onnx", "onnxscript", "onnx_ir")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


class OnnxDecoder:
    """A graph in onnxruntime on the CPU, called as the decoder is.

    Args:
        path: of the ONNX file.
        threads: of onnxruntime; None: as many as torch uses.
        mask: whether the mask is an input of the graph; else it is inside.

    Raises:
        BadInput: onnxruntime is not installed.
    """

    def __init__(self, path: Path, threads: int | None = None) -> None:
        require("onnxruntime")
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or torch.get_num_threads()
        options.log_severity_level = 3  # errors
        self.session: Any = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        self.takes_mask = len(self.session.get_inputs()) > 1

    def __call__(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the video ``(1, T, H, W)`` of a measurement ``(1, H, W)`` and a mask ``(T, H, W)``."""
        inputs: dict[str, np.ndarray] = {"measurement": measurement.numpy()}
        if self.takes_mask:
            inputs["mask"] = mask.numpy()
        return torch.from_numpy(self.session.run(["video"], inputs)[0])


def largest_difference(
    graph: OnnxDecoder, decoder: Decoder, frames: int, sizes: Sequence[Sequence[int]], mask: torch.Tensor | None = None
) -> float:
    """Return by how much the videos of a graph and its decoder differ, as :data:`TOLERANCE` counts it.

    Args:
        graph, decoder: the two.
        frames: T.
        sizes: (H, W) of the snapshots, one after another.
        mask: of all snapshots, if the graph holds it; None: random binary masks.

    Raises:
        MachineFailure: they differ by more than the tolerance, or in shape.
    """
    largest = 0.0
    for size in sizes:
        snapshot = random_snapshot(frames, size, mask)
        with torch.no_grad():
            video, expected = graph(*snapshot), decoder(*snapshot)
        if video.shape != expected.shape:
            raise MachineFailure(
                f"the graph's video is {tuple(video.shape)}, torch's {tuple(expected.shape)}; nothing was written"
            )
        difference = float((video - expected).abs().max() / expected.abs().max().clamp(min=1))
        if not difference <= TOLERANCE:
            raise MachineFailure(
                f"at {size[0]} x {size[1]} the graph's video differs from torch's by {difference:.1e}, more than "
                f"{TOLERANCE:.0e}; nothing was written"
            )
        largest = max(largest, difference)
    return largest


def seconds_of(
    decoders: Sequence[Callable[[torch.Tensor, torch.Tensor], torch.Tensor]],
    frames: int,
    size: Sequence[int],
    mask: torch.Tensor | None = None,
    repeats: int = 3,
) -> list[float]:
    """Return the median seconds of each decoder for one snapshot; they take turns, after one call each to warm up."""
    snapshot = random_snapshot(frames, size, mask)
    seconds: list[list[float]] = [[] for _ in decoders]
    with torch.no_grad():
        for _ in range(repeats + 1):
            for decoder, times in zip(decoders, seconds, strict=True):
                start = time.perf_counter()
                decoder(*snapshot)
                times.append(time.perf_counter() - start)
    return [median(times[1:]) for times in seconds]


def random_snapshot(
    frames: int, size: Sequence[int], mask: torch.Tensor | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return measurement ``(1, H, W)`` and mask ``(T, H, W)`` of a random video, always the same for one size."""
    generator = torch.Generator().manual_seed(0)
    if mask is None:
        mask = (torch.rand(frames, *size, generator=generator) < 0.5).float()
    return SnapshotOperator(mask)(torch.rand(1, *mask.shape, generator=generator)), mask
