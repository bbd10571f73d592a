"""Decoders for a notebook: by name, out of a checkpoint, or with the weights that their authors published."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.cli.composition import built, compose, group_members
from sci_lightning.errors import BadInput

if TYPE_CHECKING:
    from sci_lightning.decoder import Decoder


def load_decoder(
    source: str | Path, overrides: Iterable[str] = (), *, name: str | None = None, trusted: Iterable[str] = ()
) -> Decoder:
    """Return a decoder in evaluation mode: ``decoder(measurement, mask)`` gives the video.

    It takes a linear measurement ``(N, H, W)``, light in units of full scale over the aperture, and the mask
    ``(T, H, W)`` in [0, 1]; it returns the estimate ``(N, T, H, W)``.

    >>> import torch
    >>> import sci_lightning as sci
    >>> mask = (torch.rand(8, 16, 16) < 0.5).float()
    >>> decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
    >>> tuple(decoder(torch.rand(1, 8, 16, 16).mul(mask).sum(1), mask).shape)
    (1, 8, 16, 16)
    >>> network = sci.load_decoder("res2former", ["scale=smoke"])  # weights as they start, nothing learned yet

    Args:
        source: the name of a decoder in ``conf/decoder``, whose weights are those that it starts with; or the path of a
            checkpoint, ``RUN/checkpoints/last.ckpt``; or, together with ``name``, that of published weights.
        overrides: of a decoder that is configured by its name: ``["frames=10", "decoder.dim=48"]``.
        name: of the decoder that published weights belong to, such as ``res2former``.
        trusted: packages beside this one whose classes a checkpoint may name.

    Raises:
        BadInput: no such decoder or file, or weights that do not fit; nothing in a file is executed.
    """
    from sci_lightning.decoder.published import load_published
    from sci_lightning.runs.checkpoint import load_file, read_checkpoint

    names = group_members("decoder")
    chosen = str(source) if str(source) in names and name is None else name
    if chosen is None:
        if not Path(source).exists():
            raise BadInput(f"{source}: no such decoder or checkpoint; choose one of {', '.join(names)}, or give a path")
        return read_checkpoint(source, trusted).decoder().eval()
    if chosen not in names:
        raise BadInput(f"{chosen}: no such decoder; choose one of {', '.join(names)}")
    decoder: Decoder = built(compose("train", [f"decoder={chosen}", *overrides]).cfg, "decoder")
    if name is not None:
        try:
            load_published(decoder, load_file(Path(source)))
        except BadInput as error:
            raise BadInput(f"{source}: {error}") from error
    return decoder.eval()
