"""``benchmark.json``: what decoding one measurement costs; written after every decoder anew."""

from __future__ import annotations

from typing import Any, Literal

from sci_lightning.files.json_file import JsonFile, JsonObject, Number, says
from sci_lightning.runs.provenance import Provenance

Precision = Literal["32-true", "bf16-mixed", "16-mixed"]
"""Of a network, as Lightning's Trainer calls it."""


class Decoding(JsonObject):
    """Decoding in one precision."""

    seconds: float = says("median time for one measurement", ge=0)
    fastest: float = says("shortest time for one measurement, seconds", ge=0)
    calls: int = says("that were timed", ge=1)
    memory: int = says("most bytes of weights, activations and scratch at a time, if the system tells", ge=0, default=0)
    gflops: float = says("10^9 operations a second, two for each multiply-accumulate", ge=0)
    psnr: float = says("of the video, mean over its frames, dB")


class MachineSpeed(JsonObject):
    """What the machine reaches, 10^9 operations a second."""

    product_gflops: float = says("matrix product", ge=0)
    convolution_gflops: float = says("3 x 3, 64 to 64 channels, 256 x 256 pixels, channels last", ge=0)
    convolution_training_gflops: float = says("the same with the gradients of input and weight", ge=0, default=0)


class TrainingStep(JsonObject):
    """Forward, loss, backward with the gradient of the mask, and Adam, in one precision."""

    seconds: float = says("median time", ge=0)
    fastest: float = says("shortest time, seconds", ge=0)
    gflops: float = says("10^9 operations a second; the backward pass counts as two forward passes", ge=0)


class Training(JsonObject):
    """Training steps."""

    snapshots: int = says("of a step", ge=1)
    precisions: dict[Precision, TrainingStep] = says("steps by precision")
    times_as_fast: float = says("median over the rounds of the first precision's time over the last's", default=0)


class PaperFigures(JsonObject):
    """What the paper prints about a decoder."""

    table: int = says("number of the paper's table")
    row: str = says("the decoder's name in it")
    parameters_M: Number = says("10^6 parameters")
    macs_G: Number = says("10^9 multiply-accumulates for 256 x 256 pixels and 8 frames")
    macs_rules: Literal[2020, 2022] = says("generation of the counter that the number follows")
    seconds: Number = says("for one measurement on the paper's GPU")


class DecoderCost(JsonObject):
    """The cost of one decoder; what was not measured is absent."""

    parameters: int = says("that are learned", ge=0)
    macs: int = says("multiply-accumulate operations for one measurement", ge=0)
    macs_as_paper: int = says("the same by the rules that the paper counted by", ge=0)
    precisions: dict[Precision, Decoding] = says("decoding by precision")
    machine: dict[Precision, MachineSpeed] = says("the machine's own speed by precision", default={})
    training: Training | None = says("training steps", default=None)
    paper: PaperFigures | None = says("the paper's figures", default=None)


class Benchmark(JsonFile):
    """The whole file. Version 1 had one precision."""

    format: Literal["sci-benchmark"]
    format_version: Literal[2]
    provenance: Provenance = says("of the figures")
    torch: str = says("version of PyTorch")
    device: str = says("that was measured on")
    threads: int = says("that torch computes with", ge=1)
    frames: int = says("T of a measurement", ge=1)
    tile: Any = says("how decoders divide a large field: auto, none, or (H, W) in pixels", default=None)
    compile: bool = says("whether torch.compile was applied")
    warm_up: int = says("calls before those that were timed", ge=0, default=0)
    repeats: int = says("largest number of timed calls", ge=1, default=1)
    budget: Number = says("seconds after which no further call was timed", ge=0, default=0)
    product: int = says("n of the n x n matrix product that is compared with; 0 for none", ge=0, default=0)
    training: int = says("snapshots of a training step that was timed; 0 for none", ge=0, default=0)
    size: list[int] = says("(H, W) of a measurement in pixels", min_length=2, max_length=2)
    precisions: list[Precision] = says("of networks, the most exact first", min_length=1)
    kernels: Literal["auto", "plain"] = says("the faster kernels, or networks as their papers write them")
    scene: str = says("source and name of the scene whose first snapshot was decoded")
    weights: str = says("random, or trained and the name of their checkpoint")
    decoders: dict[str, DecoderCost] = says("by the name in the configuration")
    failed: dict[str, str] = says("why decoders could not be measured, in one line, by name")
