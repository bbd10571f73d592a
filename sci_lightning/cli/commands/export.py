"""``python -m sci_lightning.export``: a decoder as an ONNX graph, compared with torch and timed beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.cli.composition import Composition, built
from sci_lightning.cli.settings import CommandSettings, Name, NamedOrPath
from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Size
from sci_lightning.console import PlainConsole, styled, warn
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import check_writable

if TYPE_CHECKING:
    import torch

    from sci_lightning.decoder import Decoder
    from sci_lightning.runs.checkpoint import Checkpoint

UNTRAINED_FRAMES, UNTRAINED_SIZE = 8, (128, 128)
"""T of the graph and (H, W) of the snapshot that is timed where neither a training nor the user says."""


@dataclass(frozen=True)
class ExportSettings(CommandSettings):
    ckpt_path: ExistingPath | None
    trusted: Sequence[Name]
    mask: NamedOrPath
    frames: Frames | None
    size: Size | None
    seed: Seed


def export(composition: Composition) -> None:
    """Write the graph once it gives the same videos as torch; print its inputs, the difference and both times."""
    import torch

    from sci_lightning.cli.next_command import nearest
    from sci_lightning.decoder.onnx_graph import (
        SIZES,
        SMALLEST_SIDE,
        OnnxDecoder,
        largest_difference,
        onnx_graph,
        require,
        seconds_of,
        with_mask,
    )
    from sci_lightning.files.atomic_file import atomic_write

    cfg, console = composition.cfg, PlainConsole()
    out = Path(cfg.out)
    require("onnx", "onnxscript", "onnxruntime")
    replaced = check_place(out)
    if cfg.size is not None and min(cfg.size) < SMALLEST_SIDE:
        raise BadInput(
            f"size=[{cfg.size[0]},{cfg.size[1]}]: a graph takes snapshots from {SMALLEST_SIDE} pixels a side on"
        )
    decoder, checkpoint = _decoder(composition)
    mask = _mask(cfg.mask, checkpoint)
    trained = {} if checkpoint is None else checkpoint.config
    frames = (cfg.frames or trained.get("frames") or UNTRAINED_FRAMES) if mask is None else len(mask)
    about = {"decoder": trained["names"]["decoder"] if trained else composition.choice("decoder")}
    if checkpoint is not None:
        encoder = checkpoint.encoder()
        own = encoder.aperture_setting.is_carried
        about["aperture"] = "per_snapshot" if own else f"{float(encoder.aperture):.9g}"
    model = onnx_graph(decoder, frames, about)
    if checkpoint is None:
        warn("no ckpt_path=: the weights are random, good for trying out a runtime and its speed, not for decoding")
    sizes = list(SIZES)
    if mask is not None:
        model, sizes = with_mask(model, mask), [(mask.shape[1], mask.shape[2])]
    with atomic_write(out) as temporary:
        temporary.write_bytes(model.SerializeToString())
        graph = OnnxDecoder(temporary)
        difference = largest_difference(graph, decoder, frames, sizes, mask)
    for value in (*model.graph.input, *model.graph.output):
        sides = ", ".join(side.dim_param or str(side.dim_value) for side in value.type.tensor_type.shape.dim)
        console.print(f"{'output' if value.name == 'video' else 'input'} {value.name}: float32 ({sides})")
    console.print(
        f"as torch to {difference:.1e} (at most 1e-4) at " + ", ".join(f"{height} x {width}" for height, width in sizes)
    )
    size = sizes[0] if mask is not None else cfg.size or trained.get("size") or UNTRAINED_SIZE
    with torch.inference_mode():
        ours, theirs = seconds_of((decoder, graph), frames, size, mask)
    console.print(
        f"one snapshot of {size[0]} x {size[1]} in float32, {torch.get_num_threads()} thread(s): "
        f"onnxruntime {theirs:.3g} s, torch {ours:.3g} s"
    )
    megabytes = out.stat().st_size / 2**20
    place = ", in place of an earlier graph" if replaced else ""
    console.say(styled(nearest(out)), f": {megabytes:.1f} MiB, opset {model.opset_import[0].version}{place}")


def check_place(out: Path) -> bool:
    """Check that a graph can be written to a path; return whether a graph of an earlier call is there.

    Raises:
        BadInput: another ending than ``.onnx``, another program's file, or a folder in which nothing can be written.
    """
    import onnx

    if out.suffix != ".onnx":
        raise BadInput(f"out={out}: expected the name of an ONNX file, such as model.onnx")
    check_writable(out)
    if not out.is_file():
        return False
    try:
        producer = onnx.load(out, load_external_data=False).producer_name
    except Exception:  # whatever a file that is no graph makes of the parser
        producer = ""
    if producer != "sci_lightning":
        raise BadInput(f"{out}: this file is no graph of this command and would be overwritten; give another out=")
    return True


def _decoder(composition: Composition) -> tuple[Decoder, Checkpoint | None]:
    """Return the decoder that is exported, and the checkpoint that it was filled from."""
    import torch

    from sci_lightning.cli.encoder_and_decoder import resolve_checkpoint

    cfg = composition.cfg
    if cfg.ckpt_path is not None:
        checkpoint = resolve_checkpoint("export", composition)
        return checkpoint.decoder(), checkpoint
    if "_target_" not in (cfg.get("decoder") or {}):
        raise BadInput(
            "give ckpt_path=RUN/checkpoints/last.ckpt, or decoder=NAME to export a network that is untrained"
        )
    cfg.frames = cfg.frames or UNTRAINED_FRAMES
    torch.manual_seed(cfg.seed)
    decoder = built(cfg, "decoder")
    return decoder, None


def _mask(choice: str, checkpoint: Checkpoint | None) -> torch.Tensor | None:
    """Return the mask that goes into the graph; None if it stays an input."""
    import torch

    from sci_lightning.encoder.mask.measured import read_mask

    if choice == "input":
        return None
    if choice != "trained":
        return read_mask(choice, setting="")
    if checkpoint is None:
        raise BadInput("mask=trained: without ckpt_path= there is no trained mask; give one, or mask=FILE")
    encoder = checkpoint.encoder()
    with torch.no_grad():
        return encoder.decoder_mask()
