"""Loading weights into our decoders as their authors published them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt, with_article

STATES = ("state_dict", "model_state_dict", "color_SCI_backward_dict")
"""Keys of the saved dictionary under which authors keep the state; without any of them the dictionary is the state."""
BESIDE = ("pretrain_epoch", "epoch", "best_psnr", "optimizer", "optim_state_dict", "amp")
"""Keys that may stand beside the state: the progress of the training, of which nothing is used."""
WRAPPERS = ("module.", "_orig_mod.")
"""Prefixes that data-parallel training and ``torch.compile`` put before every key."""


@dataclass(frozen=True)
class PublishedMask:
    """The mask in a checkpoint of the deep-optics code.

    Attributes:
        levels: ``(T, H, W)`` the discrete mask in use; for one bit it may be ``(H, W)``, the index of the open slot.
        real: ``(T, H, W)`` the real-valued mask behind it, None where the file has none.
    """

    levels: torch.Tensor
    real: torch.Tensor | None


def load_published(decoder: Decoder, state_dict: Mapping[str, Any]) -> PublishedMask | None:
    """Load weights into ``decoder`` as their authors saved them.

    Args:
        decoder: of the published size.
        state_dict: content of their file: a state, with or without ``module.`` before its keys, by itself or in a
            dictionary with epoch and optimiser; or the state of the deep-optics wrapper (``encoder.weight`` and
            ``decoder.*``), with or without ``continuous_mask`` beside it.

    Returns:
        the mask of the deep-optics wrapper, None for other files.

    Raises:
        BadInput: a key has no place, a key is missing, or a shape does not fit; the message names the key.
    """
    weights, mask = unpack(state_dict)
    decoder.load_state_dict(our_state(decoder, weights))
    return mask


def unpack(content: Mapping[str, Any]) -> tuple[dict[str, torch.Tensor], PublishedMask | None]:
    """Return the decoder's state under its authors' keys, and the mask, of what :func:`load_published` takes."""
    inside = next((name for name in STATES if isinstance(content.get(name), Mapping)), None)
    real = content.get("continuous_mask") if inside else None
    if inside:
        for key in content:
            if key not in (inside, "continuous_mask", *BESIDE):
                raise BadInput(f"'{key}' beside '{inside}' is not known; expected one of {', '.join(BESIDE)}")
        content = content[inside]
    for key, value in [*content.items(), *([] if real is None else [("continuous_mask", real)])]:
        if not isinstance(value, torch.Tensor):
            kind = with_article(type(value).__name__)
            raise BadInput(f"'{excerpt(key)}' is {kind}, expected a tensor; is it a network's state?")
        if not isinstance(key, str):
            kind = with_article(type(key).__name__)
            raise BadInput(f"the name {excerpt(key)} is {kind}, expected a text; is it a network's state?")
    weights = _unwrapped(content)
    if "encoder.weight" not in weights and not all(key.startswith("decoder.") for key in weights):
        return weights, None
    levels = weights.pop("encoder.weight", None)
    for key in weights:
        if not key.startswith("decoder."):
            raise BadInput(f"'{key}' has no place; beside 'encoder.weight' every key starts with 'decoder.'")
    weights = _unwrapped({key.removeprefix("decoder."): value for key, value in weights.items()})
    return weights, None if levels is None else PublishedMask(levels, real)


def our_state(decoder: Decoder, weights: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the decoder's state, made of its authors' tensors; raises as :func:`load_published` does.

    Args:
        decoder: of the published size. Its ``published_names`` say what the authors call every key; a key that they
            call as we do, or that is in the file under our name, needs no entry there.
        weights: the authors' state without wrappers. Tensors that are one tensor here are joined along their first
            dimension, in the order of ``published_names``.
    """
    name, wanted = type(decoder).__name__, decoder.state_dict()
    another = "is it of another network, or of another size?"
    sources = {key: authors_keys(decoder, key) for key in wanted}
    for key, theirs in sources.items():
        if key in weights and not any(part in weights for part in theirs):
            sources[key] = [key]
    used = {part for theirs in sources.values() for part in theirs}
    for key in weights:
        if key not in used and not any(re.fullmatch(pattern, key) for pattern in decoder.published_unused):
            raise BadInput(f"'{key}' has no place in {name}; {another}")
    state = {}
    for key, like in wanted.items():
        for part in sources[key]:
            if part not in weights:
                ours = "" if part == key else f" ('{key}' here)"
                raise BadInput(f"'{part}'{ours} is missing, {name} needs it; {another}")
        state[key] = _joined([weights[part] for part in sources[key]])
        if state[key].shape != like.shape:
            shapes = " and ".join(f"'{part}' {tuple(weights[part].shape)}" for part in sources[key])
            raise BadInput(
                f"{shapes}: {name} as configured has {tuple(like.shape)} there; set frames= and decoder.* to the file's"
            )
    return state


def authors_keys(decoder: Decoder, key: str) -> list[str]:
    """Return what the authors call the tensor of a key of ours; several where they keep its parts apart."""
    matches = ((re.fullmatch(ours, key), theirs) for ours, theirs in decoder.published_names)
    return [match.expand(theirs) for match, theirs in matches if match] or [key]


def _joined(parts: list[torch.Tensor]) -> torch.Tensor:
    """Join tensors along their first dimension; return the first of those that cannot be joined, such as counters."""
    alike = len({part.shape[1:] for part in parts}) == 1 and parts[0].ndim > 0
    return torch.cat(parts) if alike and len(parts) > 1 else parts[0]


def _unwrapped(state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return a state without the wrappers' prefixes before its keys."""
    bare: dict[str, torch.Tensor] = {}
    for key, value in state.items():
        short = re.sub(rf"^({'|'.join(map(re.escape, WRAPPERS))})+", "", key)
        if short in bare:
            raise BadInput(f"'{key}' is in the file twice, with and without '{key.removesuffix(short)}' before it")
        bare[short] = value
    return bare
