"""Weights as their authors published them, into our decoders."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import excerpt, with_article

STATES = ("state_dict", "model_state_dict", "color_SCI_backward_dict")
"""What the authors call the state inside the dictionary that they save; without one the dictionary is the state."""
BESIDE = ("pretrain_epoch", "epoch", "best_psnr", "optimizer", "optim_state_dict", "amp")
"""What may lie beside it: how far the training had come, of which nothing is used."""
WRAPPERS = ("module.", "_orig_mod.")
"""Put before every key by data-parallel training and by ``torch.compile``."""


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
    """Fill ``decoder`` with weights as their authors saved them.

    Args:
        decoder: of the published size.
        state_dict: what their file holds: a state, with or without ``module.`` before its keys, by itself or in a
            dictionary with epoch and optimiser; or the state of the deep-optics wrapper (``encoder.weight`` and
            ``decoder.*``), with or without ``continuous_mask`` beside it.

    Returns:
        the wrapper's mask, else None.

    Raises:
        BadInput: a key without a place, a shape that does not fit, a key that is missing; each names it.
    """
    weights, mask = unpack(state_dict)
    decoder.load_state_dict(our_state(decoder, weights))
    return mask


def unpack(content: Mapping[str, Any]) -> tuple[dict[str, torch.Tensor], PublishedMask | None]:
    """The bare state of the decoder by its authors' keys, and the mask, of what :func:`load_published` takes."""
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
    """The decoder's state, made of its authors' (bare keys); raises as :func:`load_published` does.

    A key goes where the first pattern of ``decoder.published_names`` that matches all of it says, and is ours already
    where none does. Keys that go to one place are joined along their first dimension, in the order of the patterns.
    """
    name, wanted = type(decoder).__name__, decoder.state_dict()
    sources: dict[str, list[tuple[int, str]]] = {}
    for key in weights:
        if any(re.fullmatch(pattern, key) for pattern in decoder.published_unused):
            continue
        order, place = _place(decoder, key)
        if place not in wanted:
            raise BadInput(f"'{key}' has no place in {name}; is it of another network, or of another size?")
        sources.setdefault(place, []).append((order, key))
    state = {}
    for place, like in wanted.items():
        if place not in sources:
            ours = "" if (authors := authors_key(decoder, place)) == place else f" ('{place}' here)"
            raise BadInput(
                f"'{authors}'{ours} is missing, {name} needs it; is it of another network, or of another size?"
            )
        parts = {key: weights[key] for _, key in sorted(sources[place])}
        state[place] = _joined(list(parts.values()))
        if state[place].shape != like.shape:
            shapes = " and ".join(f"'{key}' {tuple(part.shape)}" for key, part in parts.items())
            raise BadInput(
                f"{shapes}: {name} as configured has {tuple(like.shape)} there; set frames= and decoder.* to the file's"
            )
    return state


def authors_key(decoder: Decoder, place: str) -> str:
    """The authors' key that goes to ``place``, for messages: our own where no pattern can be read backwards."""
    for pattern, replacement in decoder.published_names:
        literals = re.split(r"\([^()]*\)", pattern.replace("\\.", "."))
        groups = re.findall(r"\([^()]*\)", pattern)
        if re.compile(pattern).groups != len(groups):  # nested, or not capturing
            continue
        pieces = re.split(r"\\(\d)", replacement)  # literal, number of a group, literal, ..
        numbers = [int(each) - 1 for each in pieces[1::2]]
        backwards = "".join(groups[numbers[n // 2]] if n % 2 else re.escape(each) for n, each in enumerate(pieces))
        if match := re.fullmatch(backwards, place):
            told = dict(zip(numbers, match.groups(), strict=True))
            key = literals[0] + "".join(told.get(n, "") + literal for n, literal in enumerate(literals[1:]))
            if _place(decoder, key)[1] == place:
                return key
    return place


def _joined(parts: list[torch.Tensor]) -> torch.Tensor:
    """Side by side along the first dimension; of what cannot be joined, the first."""
    alike = len({part.shape[1:] for part in parts}) == 1 and parts[0].ndim > 0
    return torch.cat(parts) if alike and len(parts) > 1 else parts[0]


def _place(decoder: Decoder, key: str) -> tuple[int, str]:
    """Where an authors' key goes, and the number of the pattern that says so."""
    for number, (pattern, replacement) in enumerate(decoder.published_names):
        if match := re.fullmatch(pattern, key):
            return number, match.expand(replacement)
    return len(decoder.published_names), key


def _unwrapped(state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """A state whose keys start with no wrapper's name."""
    bare: dict[str, torch.Tensor] = {}
    for key, value in state.items():
        short = re.sub(rf"^({'|'.join(map(re.escape, WRAPPERS))})+", "", key)
        if short in bare:
            raise BadInput(f"'{key}' is in the file twice, with and without '{key.removesuffix(short)}' before it")
        bare[short] = value
    return bare
